// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/elimination/frame_elimination.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "calib/adjust/elimination/view_products.h"
#include "calib/kernels/processors.h"
#include "calib/kernels/row_products.h"

namespace plenocal::internal {
namespace {

using RowMajor6 = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;

// out = cross L^-T, six numbers a row, with `stride` numbers from one row of `out` to the next.
// `inverse`: L^-1 by columns, so that its column k is what the k-th number of a row contributes.
PLENOCAL_FOR_EACH_PROCESSOR
void SolveRows(const double* cross,
               Eigen::Index rows,
               const Matrix6d& inverse,
               double* out,
               Eigen::Index stride) {
  for (Eigen::Index i = 0; i < rows; ++i, cross += 6, out += stride) {
    double sums[6] = {};
    for (Eigen::Index k = 0; k < 6; ++k) {
      for (Eigen::Index j = 0; j < 6; ++j) sums[j] += cross[k] * inverse(j, k);
    }
    std::copy_n(sums, 6, out);
  }
}

// Columns W = cross L^-T of eliminated poses, which are collected: one large product W W' is faster
// than many small ones.
class EliminatedColumns {
 public:
  EliminatedColumns(const UnknownLayout& layout, const EliminationOptions& options)
      : rows_(layout.total + 1),
        head_(layout.head),
        keep_(options.keep_steps),
        separate_markers_(options.separate_markers) {}

  // Returns the index of the first column.
  Eigen::Index Add(const SixColumns& cross, const Matrix6d& L, Eigen::MatrixXd* S) {
    if (used_ == kColumns) Flush(S);
    if (used_ == 0 && (keep_ || batches_.empty())) {
      // Four more columns: rows that are apart by a power of two share few lines of the cache.
      batches_.push_back(ZeroRows(rows_, kColumns + 4));
    }
    const Matrix6d inverse = L.triangularView<Eigen::Lower>().solve(Matrix6d::Identity().eval());
    SolveRows(cross.data(), rows_, inverse, batches_.back().data() + used_, batches_.back().cols());
    used_ += 6;
    return static_cast<Eigen::Index>(batches_.size() - 1) * kColumns + used_ - 6;
  }

  // S -= W W'
  void Flush(Eigen::MatrixXd* S) {
    if (used_ == 0) return;
    const Eigen::Index columns = RoundUpToFour(used_);
    batches_.back().middleCols(used_, columns - used_).setZero();
    if (separate_markers_) {
      const auto W = batches_.back().topLeftCorner(rows_, columns);
      S->leftCols(head_).noalias() -= W * W.topRows(head_).transpose();
      S->row(rows_ - 1).tail(rows_ - head_).noalias() -=
          W.row(rows_ - 1) * W.bottomRows(rows_ - head_).transpose();
    } else {
      AddRowProducts(-1, batches_.back(), columns, S);
    }
    last_ = used_;
    used_ = 0;
  }

  // Rows of W, when all has been flushed.
  [[nodiscard]] Eigen::MatrixXd Rows(Eigen::Index first, Eigen::Index count) const {
    const auto batches = static_cast<Eigen::Index>(batches_.size());
    Eigen::MatrixXd rows(count, batches == 0 ? 0 : (batches - 1) * kColumns + last_);
    for (Eigen::Index b = 0; b < batches; ++b) {
      const Eigen::Index columns = b + 1 < batches ? kColumns : last_;
      rows.middleCols(b * kColumns, columns) =
          batches_[static_cast<size_t>(b)].block(first, 0, count, columns);
    }
    return rows;
  }

  // W' x
  [[nodiscard]] Eigen::VectorXd TimesTransposed(const Eigen::VectorXd& x) const {
    Eigen::VectorXd product(static_cast<Eigen::Index>(batches_.size()) * kColumns);
    for (size_t b = 0; b < batches_.size(); ++b) {
      product.segment<kColumns>(static_cast<Eigen::Index>(b) * kColumns).noalias() =
          batches_[b].topLeftCorner(rows_, kColumns).transpose() * x;
    }
    return product;
  }

 private:
  static constexpr Eigen::Index kColumns = 6 * 32;

  Eigen::Index rows_, head_;
  bool keep_, separate_markers_;
  std::vector<RowMajorMatrix> batches_;
  Eigen::Index used_ = 0, last_ = 0;  // columns of the last batch: not flushed, and flushed
};

// Derivative of a pose's chart whose rotation part is `rotation`; translations are the same.
Matrix6d WithRotation(const Eigen::Matrix3d& rotation) {
  Matrix6d chart = Matrix6d::Identity();
  chart.bottomRightCorner<3, 3>() = rotation;
  return chart;
}

class Steps : public PoseSteps {
 public:
  // A view's jitter and how it follows the frame's pose.
  struct OfJitter {
    size_t view = 0;
    Eigen::Index column = 0;
    Matrix6d L;         // of (E' E + Q)
    Matrix6d by_pose;   // L^-1 E' E C_pose
    Matrix6d to_chart;  // of the jitter
  };
  struct OfFrame {
    size_t frame = 0;
    Eigen::Index column = 0;
    Matrix6d L;
    std::vector<OfJitter> jitter;
  };

  Steps(const UnknownLayout& layout, const EliminationOptions& options)
      : columns(layout, options), head(layout.head), markers(layout.total - layout.head) {}

  void Apply(const Eigen::VectorXd& step,
             double line_search_factor,
             Bundle* bundle) const override {
    Eigen::VectorXd with_gradient(step.size() + 1);
    with_gradient << step, line_search_factor;
    const Eigen::VectorXd product = columns.TimesTransposed(with_gradient);
    for (const OfFrame& of : frames) {
      const Vector6d pose = -of.L.triangularView<Eigen::Lower>().transpose().solve(
          Vector6d(product.segment<6>(of.column)));
      RigidTransform& T_rig_target = bundle->T_rig_target[of.frame];
      T_rig_target = Retract(T_rig_target, pose);
      for (const OfJitter& own : of.jitter) {
        const Vector6d right = product.segment<6>(own.column) + own.by_pose * pose;
        bundle->jitter.delta[own.view] -=
            own.to_chart * own.L.triangularView<Eigen::Lower>().transpose().solve(right);
      }
    }
  }

  [[nodiscard]] Eigen::MatrixXd MarkerColumns() const override {
    return columns.Rows(head, markers);
  }

  EliminatedColumns columns;
  Eigen::Index head, markers;  // rows
  std::vector<OfFrame> frames;
};

// Goes through the observations frame by frame.
class Elimination {
 public:
  Elimination(const Bundle& bundle,
              const UnknownLayout& layout,
              const Objective& objective,
              const EliminationOptions& options)
      : bundle_(bundle),
        layout_(layout),
        objective_(objective),
        options_(options),
        cross_(layout.total + 1, 6),
        view_cross_(layout.total + 1, 6) {
    equations_.S = Eigen::MatrixXd::Zero(layout.total + 1, layout.total + 1);
    equations_.complete = true;
    if (options.keep_steps) {
      auto steps = std::make_unique<Steps>(layout, options);
      steps_ = steps.get();
      equations_.steps = std::move(steps);
    } else {
      unkept_.emplace(layout, options);
    }
    for (size_t c = 0; c < bundle.cameras.size(); ++c) products_.emplace_back(bundle, layout, c);
  }

  ReducedEquations Run() {
    const std::vector<BundleObservation>& observations = bundle_.observations;
    for (size_t begin = 0; begin < observations.size();) {
      const int frame = observations[begin].frame;
      pose_.setZero();
      cross_.setZero();
      views_.clear();
      jitter_.clear();
      while (begin < observations.size() && observations[begin].frame == frame) {
        const size_t end = EndOfView(observations, begin);
        AddView(begin, end);
        begin = end;
      }
      if (!views_.empty()) EliminatePose(static_cast<size_t>(frame));
    }
    Columns().Flush(&equations_.S);
    const Eigen::VectorXd eliminated = equations_.S.diagonal();
    for (const ViewProducts& products : products_) {
      products.AddTo(&equations_.S);
      equations_.squares += products.Squares();
    }
    if (layout_.markers) AddMarkerPriors();
    equations_.diagonal = equations_.S.diagonal() - eliminated;
    return std::move(equations_);
  }

 private:
  EliminatedColumns& Columns() { return steps_ != nullptr ? steps_->columns : *unkept_; }

  // Observations [begin, end) of one view.
  void AddView(size_t begin, size_t end) {
    const auto frame = static_cast<size_t>(bundle_.observations[begin].frame);
    const auto c = static_cast<size_t>(bundle_.observations[begin].camera);
    const LinearisedView linearised = ViewOf(bundle_, frame, c);
    const bool has_jitter = bundle_.EstimatesJitter();
    const bool turns = has_jitter || !bundle_.motion.empty();
    if (turns) view_cross_.setZero();
    SixColumns& cross = turns ? view_cross_ : cross_;
    ReducedView view{.camera = c};
    bool any = false;
    for (size_t of_marker = begin; begin < end; begin = of_marker) {
      of_marker = EndOfMarker(bundle_.observations, begin);
      any = AddMarker(linearised, begin, of_marker, &cross, &view) || any;
    }
    view.information = products_[c].EndView(&cross);
    if (!any) return;
    if (turns) {
      AddTurnedView(frame, &view);
    } else {
      pose_ += view.information;
    }
    views_.push_back(view);
  }

  // Observations [begin, end) of one marker in one view; false where none counts.
  bool AddMarker(const LinearisedView& linearised,
                 size_t begin,
                 size_t end,
                 SixColumns* cross,
                 ReducedView* view) {
    const int marker = bundle_.observations[begin].marker;
    const NoiseModel& noise = bundle_.cameras[view->camera].noise;
    ViewProducts& products = products_[view->camera];
    const bool means = noise.common_sigma > 0 || options_.visit;
    bool any = false;
    for (; begin < end; ++begin) {
      const BundleObservation& observation = bundle_.observations[begin];
      if (!observation.used) continue;
      if (!products.Load(linearised, observation, objective_.loss)) {
        equations_.complete = false;
        continue;
      }
      products.Add();
      if (means) products.AddToMean(noise.OwnSigma(observation.assumed_sigma));
      any = true;
    }
    if (any && means) {
      const double taken = products.LoadMean(noise.common_sigma);
      if (options_.visit) view->of_means += (1 - taken) * products.PoseSquare();
      if (taken > 0) products.Subtract(taken);
    }
    if (any) products.EndMarker(marker, cross, &equations_.S);
    return any;
  }

  // Adds a view whose pose is that of the frame after a change of its own: motion and jitter, which
  // is eliminated. All is in the chart of the pose that the camera saw, until it is that of the
  // frame's.
  void AddTurnedView(size_t frame, ReducedView* view) {
    const ViewCharts charts = ChartsOf(bundle_, frame, view->camera);
    const Matrix6d by_pose = WithRotation(charts.pose);
    Matrix6d information = view->information;
    if (bundle_.EstimatesJitter()) {
      information = information * EliminateJitter(frame, charts, by_pose, view);
    }
    pose_ += by_pose.transpose() * information * by_pose;
    cross_ += view_cross_ * by_pose;
  }

  // Returns the part of the pose's information that passes to the frame's pose and has applied it
  // to `view_cross_`.
  Matrix6d EliminateJitter(size_t frame,
                           const ViewCharts& charts,
                           const Matrix6d& by_pose,
                           ReducedView* view) {
    const size_t index = bundle_.View(frame, view->camera);
    const Vector6d& delta = bundle_.jitter.delta[index];
    const Matrix6d to_chart = WithRotation(charts.jitter.inverse());
    const Matrix6d& weight = objective_.jitter_weights[index];
    equations_.squares += (weight * delta).squaredNorm();
    view->W = weight * to_chart;
    const Matrix6d Q = view->W.transpose() * view->W;
    const Eigen::LLT<Matrix6d> factor(view->information + Q);
    const Vector6d of_prior = view->W.transpose() * (weight * delta);
    const Vector6d of_images = view_cross_.row(layout_.total);
    view_cross_.row(layout_.total) += of_prior.transpose();
    const Matrix6d L = factor.matrixL();
    const Eigen::Index column = Columns().Add(view_cross_, L, &equations_.S);
    if (steps_ != nullptr) {
      const Matrix6d follows = factor.matrixL().solve(Matrix6d(view->information * by_pose));
      jitter_.push_back({index, column, L, follows, to_chart});
    }
    view->jitter_covariance = factor.solve(Matrix6d::Identity());
    const Matrix6d passed = view->jitter_covariance * Q;
    // What the prior's gradient moves the jitter by, the pose takes back.
    view_cross_.row(layout_.total) = of_images.transpose();
    view_cross_ = (view_cross_ * passed).eval();
    view_cross_.row(layout_.total) -=
        (view->information * view->jitter_covariance * of_prior).transpose();
    return passed;
  }

  void EliminatePose(size_t frame) {
    Matrix6d information = pose_;
    information.diagonal() *= 1 + options_.damping;
    Eigen::LLT<Matrix6d> factor(information);
    if (factor.info() != Eigen::Success) {
      // A frame with too few observations for a pose.
      if (steps_ == nullptr) return;
      constexpr double kLeast = 1e-6;
      information.diagonal() += kLeast * pose_.diagonal();
      information.diagonal().array() += kLeast * kLeast * pose_.diagonal().maxCoeff();
      factor.compute(information);
      if (factor.info() != Eigen::Success) return;
    }
    const Matrix6d L = factor.matrixL();
    const Eigen::Index column = Columns().Add(cross_, L, &equations_.S);
    if (steps_ != nullptr) steps_->frames.push_back({frame, column, L, std::move(jitter_)});
    if (options_.visit) options_.visit(frame, factor.solve(Matrix6d::Identity()), views_);
  }

  void AddMarkerPriors() {
    const double information = 1 / bundle_.marker_freedom.Variance();
    for (size_t m = 0; m < bundle_.markers.size(); ++m) {
      const Eigen::Vector3d moved = bundle_.markers[m].position - bundle_.markers[m].nominal;
      const int first = layout_.Marker(static_cast<int>(m));
      equations_.squares += information * moved.squaredNorm();
      equations_.S.diagonal().segment<3>(first).array() += information;
      equations_.S.row(layout_.total).segment<3>(first) += information * moved.transpose();
    }
  }

  const Bundle& bundle_;
  const UnknownLayout& layout_;
  const Objective& objective_;
  const EliminationOptions& options_;
  ReducedEquations equations_;
  Steps* steps_ = nullptr;
  std::optional<EliminatedColumns> unkept_;  // where no steps are kept
  Matrix6d pose_;                            // information on the frame's pose
  SixColumns cross_;                         // F' E of the frame
  SixColumns view_cross_;                    // and of one view whose pose is not the frame's
  std::vector<ReducedView> views_;
  std::vector<Steps::OfJitter> jitter_;
  std::vector<ViewProducts> products_;  // per camera
};

}  // namespace

Objective ObjectiveOf(const Bundle& bundle, const RobustLoss& loss) {
  Objective objective{loss, {}};
  for (size_t frame = 0; bundle.EstimatesJitter() && frame < bundle.T_rig_target.size(); ++frame) {
    for (size_t c = 0; c < bundle.cameras.size(); ++c) {
      objective.jitter_weights.push_back(JitterWeight(bundle, frame, c));
    }
  }
  return objective;
}

ReducedEquations EliminateFrames(const Bundle& bundle,
                                 const UnknownLayout& layout,
                                 const Objective& objective,
                                 const EliminationOptions& options) {
  return Elimination(bundle, layout, objective, options).Run();
}

double SumOfSquares(const Bundle& bundle, const Objective& objective) {
  const std::vector<BundleObservation>& observations = bundle.observations;
  double squares = 0;
  for (size_t begin = 0; begin < observations.size();) {
    const size_t end = EndOfView(observations, begin);
    const auto frame = static_cast<size_t>(observations[begin].frame);
    const auto c = static_cast<size_t>(observations[begin].camera);
    const BundleCamera& camera = bundle.cameras[c];
    const size_t rows = camera.model->measured.size();
    const LinearisedView view = ViewOf(bundle, frame, c);
    bool any = false;
    while (begin < end) {
      const size_t of_marker = EndOfMarker(observations, begin);
      double information = 0;
      double sum[kMaxObservationSize] = {};
      for (; begin < of_marker; ++begin) {
        const BundleObservation& observation = observations[begin];
        if (!observation.used) continue;
        double residual[kMaxObservationSize];
        const LinearisedRows out{.residual = residual};
        if (!Linearise(camera,
                       camera.params.data(),
                       view,
                       bundle.markers[static_cast<size_t>(observation.marker)].position,
                       observation,
                       out)) {
          return std::numeric_limits<double>::infinity();
        }
        Robustify(objective.loss, camera, observation.assumed_sigma, out);
        const double weight = 1 / camera.noise.OwnSigma(observation.assumed_sigma);
        information += weight * weight;
        for (size_t r = 0; r < rows; ++r) {
          squares += residual[r] * residual[r];
          sum[r] += weight * residual[r];
        }
        any = true;
      }
      const double common = CommonShare(camera.noise.common_sigma, information);
      for (size_t r = 0; r < rows; ++r) squares -= common * sum[r] * sum[r];
    }
    if (any && bundle.EstimatesJitter()) {
      const size_t index = bundle.View(frame, c);
      squares += (objective.jitter_weights[index] * bundle.jitter.delta[index]).squaredNorm();
    }
  }
  for (const BundleMarker& marker : bundle.markers) {
    if (!bundle.EstimatesMarkers()) break;
    squares += ((marker.position - marker.nominal) / bundle.marker_freedom.Sigma()).squaredNorm();
  }
  return squares;
}

}  // namespace plenocal::internal
