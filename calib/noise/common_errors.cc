// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/common_errors.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <vector>

#include "calib/adjust/linearise.h"
#include "calib/base/linear_algebra.h"
#include "calib/noise/matrix_root.h"

namespace plenocal {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Of a model with very many unknowns so many of their combinations are looked at in place of all.
constexpr Eigen::Index kMostDirections = 32;

using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Indices of one camera's unknowns.
std::vector<int> IndicesOf(const Uncertainty& uncertainty, size_t camera) {
  std::vector<int> indices;
  for (const int index : uncertainty.param_index[camera]) {
    if (index >= 0) indices.push_back(index);
  }
  std::sort(indices.begin(), indices.end());
  indices.erase(std::unique(indices.begin(), indices.end()), indices.end());
  for (int i = 0; i < 6 && uncertainty.extrinsics_index[camera] >= 0; ++i) {
    indices.push_back(uncertainty.extrinsics_index[camera] + i);
  }
  return indices;
}

// Sums over rows that share a pose, of their products with B = [J D with the directions D, 6
// columns of the pose, residual, its change with each error that observations share]: J' B, whose
// first part is the information J' J times D, and E' B by the pose.
struct PoseSums {
  Eigen::Index directions;
  MatrixXd J_B, E_B;

  PoseSums(Eigen::Index rows, Eigen::Index directions_count, Eigen::Index residuals)
      : directions(directions_count),
        J_B(MatrixXd::Zero(rows, directions + 6 + residuals)),
        E_B(MatrixXd::Zero(6, J_B.cols())) {}

  [[nodiscard]] auto Information() const { return J_B.leftCols(directions); }
  [[nodiscard]] auto Cross() const { return J_B.middleCols<6>(directions); }
  [[nodiscard]] auto Gradient() const { return J_B.rightCols(J_B.cols() - directions - 6); }
  [[nodiscard]] Matrix6d PoseInformation() const { return E_B.middleCols<6>(directions); }

  // Eliminates the pose; false for one without information.
  bool EliminatePose() {
    const std::optional<MatrixXd> solved = SolvePositive(PoseInformation(), E_B);
    if (!solved) return false;
    Subtract(*solved);
    return true;
  }
  // Leaves the pose to the frame's other views, but for what is the view's own jitter `delta` with
  // the prior information Q.
  void EliminateJitter(const Matrix6d& Q, const Vector6d& delta) {
    MatrixXd right = E_B;
    right.col(directions + 6) += Q * delta;
    const Matrix6d own = PoseInformation() + Q;
    Subtract(own.llt().solve(right));
  }

 private:
  void Subtract(const MatrixXd& solved) {
    const MatrixXd cross = Cross();
    const Matrix6d pose = PoseInformation();
    J_B.noalias() -= cross * solved;
    E_B.noalias() -= pose * solved;
  }
};

// What the rows of all cameras share.
struct RowContext {
  const Bundle& bundle;
  const Uncertainty& uncertainty;
  const MatrixXd& D;       // directions in all unknowns
  MatrixXd marker_D = {};  // change of the best markers with these, its sign changed; empty: held
  Eigen::Index residuals = 1;  // columns: the residual, then shared errors of all cameras
};

// Derivatives of one camera's rows, view by view. They touch its own unknowns and, where markers
// are estimated, three coordinates, which follow all unknowns: these come in at the end, once a
// frame.
class Rows {
 public:
  // The camera's shared errors are columns [first, first + count) of all residuals.
  Rows(const RowContext& context, size_t camera, Eigen::Index first, Eigen::Index count)
      : context_(context),
        camera_(context.bundle.cameras[camera]),
        own_(IndicesOf(context.uncertainty, camera)),
        D_(context.D(own_, Eigen::all)),
        dimension_(static_cast<Eigen::Index>(camera_.model->measured.size())),
        J_params_(camera_.model->measured.size() * camera_.params.size()),
        J_(0, D_.rows()),
        E_(0, 6),
        J_marker_(0, 3),
        residuals_(0, context.residuals),
        first_(first),
        count_(count) {
    const auto column_of = [&](int index) {
      const auto found = std::ranges::find(own_, index);
      return found == own_.end() ? -1 : static_cast<int>(found - own_.begin());
    };
    for (const int index : context.uncertainty.param_index[camera]) {
      params_.push_back(column_of(index));
    }
    extrinsics_ = column_of(context.uncertainty.extrinsics_index[camera]);
  }

  // Indices of the camera's own unknowns.
  [[nodiscard]] const std::vector<int>& Own() const { return own_; }

  // Of the observations [begin, end) of one view: rows of the own unknowns, then of all markers.
  PoseSums SumView(const internal::LinearisedView& view, size_t begin, size_t end) {
    Reserve(static_cast<Eigen::Index>(end - begin) * dimension_ *
            (camera_.noise.common_sigma > 0 ? 2 : 1));
    used_ = 0;
    spans_.clear();
    for (size_t of_marker = begin; begin < end; begin = of_marker) {
      of_marker = EndOfMarker(context_.bundle.observations, begin);
      const Eigen::Index first_row = used_;
      AddMarker(view, begin, of_marker);
      spans_.push_back({context_.bundle.observations[begin].marker, first_row, used_ - first_row});
    }
    PoseSums sums(J_.cols() + context_.marker_D.rows(), D_.cols(), residuals_.cols());
    const auto J = J_.topRows(used_), E = E_.topRows(used_);
    MatrixXd B(used_, sums.J_B.cols());
    B.leftCols(D_.cols()).noalias() = J * D_;
    B.middleCols<6>(D_.cols()) = E;
    B.rightCols(residuals_.cols()) = residuals_.topRows(used_);
    const bool has_markers = context_.marker_D.rows() > 0;
    for (const auto& [marker, first, count] : spans_) {
      if (!has_markers) break;
      B.block(first, 0, count, D_.cols()).noalias() -=
          J_marker_.middleRows(first, count) * context_.marker_D.middleRows<3>(3 * marker);
    }
    if (camera_.noise.common_sigma > 0) B = weight_.head(used_).asDiagonal() * B;
    sums.J_B.topRows(J.cols()).noalias() = J.transpose() * B;
    for (const auto& [marker, first, count] : spans_) {
      if (!has_markers) break;
      sums.J_B.middleRows<3>(J.cols() + 3 * marker).noalias() =
          J_marker_.middleRows(first, count).transpose() * B.middleRows(first, count);
    }
    sums.E_B.noalias() = E.transpose() * B;
    return sums;
  }

 private:
  // Rows of one marker.
  struct Span {
    Eigen::Index marker, first, count;
  };

  void Reserve(Eigen::Index rows) {
    if (rows <= J_.rows()) return;
    J_.resize(rows, J_.cols());
    E_.resize(rows, 6);
    J_marker_.resize(rows, 3);
    residuals_.resize(rows, residuals_.cols());
    weight_.resize(rows);
  }

  // Rows of one marker in one view; where they have common noise, their sum with a negative weight.
  void AddMarker(const internal::LinearisedView& view, size_t begin, size_t end) {
    const Eigen::Index first_row = used_;
    double information = 0;
    std::vector<double> own_sigmas;
    for (size_t i = begin; i < end; ++i) {
      const BundleObservation& observation = context_.bundle.observations[i];
      if (!observation.used || !Linearise(view, observation)) continue;
      const double own = camera_.noise.OwnSigma(observation.assumed_sigma);
      auto shared = residuals_.block(used_, first_, dimension_, count_);
      if (observation.shared_errors.empty()) {
        shared.setZero();
      } else {
        shared =
            Eigen::Map<const RowMatrix>(observation.shared_errors.data(), dimension_, count_) / own;
      }
      weight_.segment(used_, dimension_).setOnes();
      used_ += dimension_;
      if (camera_.noise.common_sigma == 0) continue;
      information += 1 / (own * own);
      own_sigmas.push_back(own);
    }
    if (own_sigmas.empty()) return;
    const auto sum = [&](auto& rows) {
      auto target = rows.middleRows(used_, dimension_);
      target.setZero();
      Eigen::Index row = first_row;
      for (const double own : own_sigmas) {
        target += rows.middleRows(row, dimension_) / own;
        row += dimension_;
      }
    };
    sum(J_);
    sum(E_);
    sum(J_marker_);
    sum(residuals_);
    weight_.segment(used_, dimension_)
        .setConstant(-internal::CommonShare(camera_.noise.common_sigma, information));
    used_ += dimension_;
  }

  // Writes the next rows.
  bool Linearise(const internal::LinearisedView& view, const BundleObservation& observation) {
    Eigen::Matrix<double, kMaxObservationSize, 6, Eigen::RowMajor> J_extrinsics;
    double residual[kMaxObservationSize];
    const auto marker = static_cast<size_t>(observation.marker);
    const bool inside =
        internal::Linearise(camera_,
                            camera_.params.data(),
                            view,
                            context_.bundle.markers[marker].position,
                            observation,
                            {.residual = residual,
                             .J_params = J_params_.data(),
                             .J_extrinsics = extrinsics_ >= 0 ? J_extrinsics.data() : nullptr,
                             .J_pose = E_.row(used_).data(),
                             .J_marker = J_marker_.row(used_).data()});
    if (!inside) return false;
    auto J = J_.middleRows(used_, dimension_);
    auto residuals = residuals_.middleRows(used_, dimension_);
    residuals.setZero();
    residuals.col(0) = Eigen::Map<const VectorXd>(residual, dimension_);
    J.setZero();
    for (size_t k = 0; k < params_.size(); ++k) {
      for (Eigen::Index r = 0; r < dimension_ && params_[k] >= 0; ++r) {
        J(r, params_[k]) += J_params_[static_cast<size_t>(r) * params_.size() + k];
      }
    }
    if (extrinsics_ >= 0) J.middleCols<6>(extrinsics_) = J_extrinsics.topRows(dimension_);
    return true;
  }

  const RowContext& context_;
  const BundleCamera& camera_;
  std::vector<int> own_;     // indices of the camera's unknowns: the columns of J_
  std::vector<int> params_;  // per parameter its column, or -1
  int extrinsics_ = -1;      // first column; -1: not estimated
  MatrixXd D_;               // rows of the directions
  Eigen::Index dimension_;
  std::vector<double> J_params_;
  RowMatrix J_, E_;
  Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor> J_marker_;
  RowMatrix residuals_;  // `used_` rows count, here and above
  VectorXd weight_;
  std::vector<Span> spans_;
  Eigen::Index used_ = 0, first_, count_;
};

// Goes through the observations frame by frame.
class FrameScores {
 public:
  FrameScores(const Bundle& bundle, const Uncertainty& uncertainty, const MatrixXd& D)
      : context_{.bundle = bundle, .uncertainty = uncertainty, .D = D} {
    if (uncertainty.marker_gain.size() > 0) context_.marker_D = uncertainty.marker_gain * D;
    std::vector<Eigen::Index> errors(bundle.cameras.size(), 0);  // shared by each camera's points
    for (const BundleObservation& observation : bundle.observations) {
      const auto c = static_cast<size_t>(observation.camera);
      errors[c] = std::max(errors[c],
                           static_cast<Eigen::Index>(observation.shared_errors.size() /
                                                     bundle.cameras[c].model->measured.size()));
    }
    std::vector<Eigen::Index> first;
    for (const Eigen::Index count : errors) {
      first.push_back(context_.residuals);
      context_.residuals += count;
    }
    for (size_t c = 0; c < bundle.cameras.size(); ++c) {
      rows_.emplace_back(context_, c, first[c], errors[c]);
    }
  }
  FrameScores(const FrameScores&) = delete;
  FrameScores& operator=(const FrameScores&) = delete;

  [[nodiscard]] Eigen::Index Residuals() const { return context_.residuals; }

  // Calls `use` with the sums of each frame that has a pose, this eliminated, and with the unknowns
  // that they depend on: rows of others are zero.
  template <typename Use>
  void ForEach(const Use& use) {
    const auto& observations = context_.bundle.observations;
    for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
      const auto same = [&](const BundleObservation& o) {
        return o.frame == observations[begin].frame;
      };
      const auto first = observations.begin() + static_cast<std::ptrdiff_t>(begin);
      end = static_cast<size_t>(std::find_if_not(first, observations.end(), same) -
                                observations.begin());
      std::vector<int> touched;
      PoseSums sums = SumFrame(begin, end, &touched);
      if (sums.EliminatePose()) use(touched, sums);
    }
  }

 private:
  PoseSums SumFrame(size_t begin, size_t end, std::vector<int>* touched) {
    const Bundle& bundle = context_.bundle;
    const Eigen::Index unknowns = context_.D.rows(), markers = context_.marker_D.rows();
    const auto frame = static_cast<size_t>(bundle.observations[begin].frame);
    PoseSums sums(unknowns, context_.D.cols(), context_.residuals);
    MatrixXd of_markers = MatrixXd::Zero(markers, sums.J_B.cols());
    for (size_t next = 0; begin < end; begin = next) {
      const auto c = static_cast<size_t>(bundle.observations[begin].camera);
      next = EndOfView(bundle.observations, begin);
      PoseSums view = rows_[c].SumView({.T_camera_rig = bundle.cameras[c].T_camera_rig,
                                        .T_rig_target = bundle.SeenPose(frame, c)},
                                       begin,
                                       next);
      if (bundle.EstimatesJitter()) {
        const Matrix6d W = JitterWeight(bundle, frame, c);
        view.EliminateJitter(W.transpose() * W, bundle.jitter.delta[bundle.View(frame, c)]);
      }
      const std::vector<int>& own = rows_[c].Own();
      sums.J_B(own, Eigen::all) += view.J_B.topRows(static_cast<Eigen::Index>(own.size()));
      of_markers += view.J_B.bottomRows(markers);
      sums.E_B += view.E_B;
      touched->insert(touched->end(), own.begin(), own.end());
    }
    if (markers > 0) {
      sums.J_B.noalias() -= context_.uncertainty.marker_gain.transpose() * of_markers;
      touched->resize(static_cast<size_t>(unknowns));
      std::iota(touched->begin(), touched->end(), 0);
    }
    std::ranges::sort(*touched);
    touched->erase(std::ranges::unique(*touched).begin(), touched->end());
    return sums;
  }

  RowContext context_;
  std::vector<Rows> rows_;
};

// Directions in a space of `unknowns` dimensions: all, or combinations with signs drawn at random.
MatrixXd Directions(Eigen::Index unknowns) {
  if (unknowns <= kMostDirections) return MatrixXd::Identity(unknowns, unknowns);
  std::minstd_rand random;
  MatrixXd signs(unknowns, kMostDirections);
  for (double& sign : signs.reshaped()) sign = random() > random.max() / 2 ? 1 : -1;
  return signs;
}

// Gradient of half the sum of squares over all frames by the unknowns, and columns of its change
// with each error that points share.
MatrixXd GradientOfFrames(const Bundle& bundle, const Uncertainty& uncertainty) {
  const MatrixXd none(uncertainty.covariance.rows(), 0);
  FrameScores scores(bundle, uncertainty, none);
  MatrixXd gradient = MatrixXd::Zero(none.rows(), scores.Residuals());
  scores.ForEach([&](const std::vector<int>& /*touched*/, const PoseSums& sums) {
    gradient += sums.Gradient();
  });
  return gradient;
}

}  // namespace

CommonErrors EstimateCommonErrors(const Bundle& bundle, const Uncertainty& uncertainty) {
  const MatrixXd& C = uncertainty.covariance;
  // Directions in each camera's unknowns, in which these have unit covariance; and what they are of
  // the score: a step of all unknowns by C g is one of D' g there.
  std::vector<Eigen::Index> first{0};
  MatrixXd D(C.rows(), 0);
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const std::vector<int> indices = IndicesOf(uncertainty, c);
    const MatrixXd root = InverseRoot(C(indices, indices));
    const MatrixXd directions = root * Directions(root.cols());
    D.conservativeResize(C.rows(), D.cols() + directions.cols());
    D.rightCols(directions.cols()) = C(Eigen::all, indices) * directions;
    first.push_back(D.cols());
  }
  const MatrixXd gradient = GradientOfFrames(bundle, uncertainty);
  // Change of the unknowns by each shared error.
  const MatrixXd by_shared = C * gradient.rightCols(gradient.cols() - 1);
  CommonErrors errors{std::vector<FrameScatter>(bundle.cameras.size()),
                      by_shared * by_shared.transpose()};
  // Step from the optimum to that of the frames alone, without priors.
  const MatrixXd frames_root = InverseRoot(uncertainty.frames_information);
  const VectorXd by_priors = frames_root * (frames_root.transpose() * gradient.col(0));
  struct Found {
    double squares = 0, expected = 0, expected2 = 0;
  };
  std::vector<Found> found(bundle.cameras.size());
  FrameScores(bundle, uncertainty, D)
      .ForEach([&](const std::vector<int>& touched, const PoseSums& sums) {
        // Information and gradient of the frame in the directions.
        const MatrixXd V_D = sums.Information()(touched, Eigen::all);
        const VectorXd D_g = D.transpose() * sums.Gradient().col(0);
        // Step of the unknowns by this frame, and its variance by the noise of its points. The
        // optimum has taken a part of it: the frame's share of the information of all frames.
        const VectorXd moved = D_g - V_D.transpose() * by_priors(touched);
        const MatrixXd own_root = frames_root(touched, Eigen::all).transpose() * V_D;
        for (size_t c = 0; c < found.size(); ++c) {
          const auto of_camera = Eigen::seq(first[c], first[c + 1] - 1);
          const auto own = own_root(Eigen::all, of_camera);
          const MatrixXd spread = D(touched, of_camera).transpose() * V_D(Eigen::all, of_camera) -
                                  own.transpose() * own;
          found[c].squares += moved(of_camera).squaredNorm();
          found[c].expected += spread.trace();
          found[c].expected2 += spread.squaredNorm();
        }
      });
  for (size_t c = 0; c < found.size(); ++c) {
    const auto& [squares, expected, expected2] = found[c];
    if (!(expected > 0) || !(expected2 > 0)) continue;
    errors.scatter[c] = {squares / expected, expected * expected / expected2};
  }
  return errors;
}

void AddCommonErrors(const std::vector<double>& factors,
                     const MatrixXd& shared,
                     Uncertainty* uncertainty) {
  MatrixXd& C = uncertainty->covariance;
  VectorXd scale = VectorXd::Ones(C.rows());  // of each unknown's variance
  for (size_t c = 0; c < factors.size(); ++c) {
    for (const int index : IndicesOf(*uncertainty, c)) {
      scale[index] = std::max(scale[index], factors[c]);
    }
  }
  const VectorXd root = scale.cwiseSqrt(), before = C.diagonal();
  C = root.asDiagonal() * C * root.asDiagonal();
  if (shared.size() > 0) C += shared;
  for (size_t c = 0; c < factors.size(); ++c) {
    for (size_t k = 0; k < uncertainty->param_std_errors[c].size(); ++k) {
      const int index = uncertainty->param_index[c][k];
      if (index < 0 || !(before[index] > 0)) continue;
      uncertainty->param_std_errors[c][k] *= std::sqrt(C(index, index) / before[index]);
    }
    const int first = uncertainty->extrinsics_index[c];
    // An unknown without any information stays infinite.
    for (int i = 0; first >= 0 && i < 6; ++i) {
      for (int j = 0; j < 6; ++j) {
        double& entry = uncertainty->extrinsics_covariance[c](i, j);
        if (std::isfinite(entry)) entry = C(first + i, first + j);
      }
    }
  }
  const VectorXd sigma = C.diagonal().cwiseMax(1e-300).cwiseSqrt();
  uncertainty->correlation =
      sigma.cwiseInverse().asDiagonal() * C * sigma.cwiseInverse().asDiagonal();
}

}  // namespace plenocal
