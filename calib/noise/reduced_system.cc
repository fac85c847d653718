// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/reduced_system.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "calib/adjust/linearise.h"
#include "calib/kernels/row_products.h"

namespace plenocal::internal {
namespace {

// The target of a marker whose pose is estimated.
struct MovingTarget {
  size_t index = 0;
  const RigidTransform* pose = nullptr;
};

// The derivatives J of one camera's observations by its own unknowns (parameters and extrinsics)
// and by the poses of targets, E by the frame's pose and M by the marker; and the sums J' J, J' E,
// J' M.
class OwnColumns {
 public:
  OwnColumns(const Bundle& bundle, const UnknownLayout& layout, size_t camera)
      : rows_(static_cast<int>(bundle.cameras[camera].model->measured.size())),
        local_(bundle.cameras[camera].model->local || bundle.targets.size() > 1) {
    const auto& params = layout.params[camera];
    J_params_.resize(rows_, static_cast<Eigen::Index>(params.size()));
    for (size_t k = 0; k < params.size(); ++k) {
      if (params[k] < 0) continue;
      const auto column = std::find(columns_.begin(), columns_.end(), params[k]);
      free_.emplace_back(static_cast<Eigen::Index>(k), column - columns_.begin());
      if (column == columns_.end()) columns_.push_back(params[k]);
    }
    own_params_ = static_cast<Eigen::Index>(columns_.size());
    extrinsics_ = layout.extrinsics[camera] >= 0;
    for (int i = 0; extrinsics_ && i < 6; ++i) columns_.push_back(layout.extrinsics[camera] + i);
    for (const int target : layout.targets) {
      target_columns_.push_back(static_cast<Eigen::Index>(columns_.size()));
      for (int i = 0; target >= 0 && i < 6; ++i) columns_.push_back(target + i);
    }
    const auto own = static_cast<Eigen::Index>(columns_.size());
    J_.resize(own, rows_);
    ClearSum();
    square_ = Eigen::MatrixXd::Zero(own, own);
    cross_ = Eigen::MatrixXd::Zero(own, 6);
    marker_cross_ = Eigen::MatrixXd::Zero(own, layout.total - layout.head);
  }

  bool Linearise(const BundleCamera& camera,
                 const internal::LinearisedView& view,
                 const Eigen::Vector3d& p_target,
                 const MovingTarget* target,
                 const BundleObservation& observation) {
    double residual[kMaxObservationSize];
    if (!internal::Linearise(camera,
                             camera.params.data(),
                             view,
                             p_target,
                             observation,
                             {.residual = residual,
                              .J_params = J_params_.data(),
                              .J_extrinsics = extrinsics_ ? J_extrinsics_.data() : nullptr,
                              .J_pose = J_pose_.data(),
                              .J_marker = J_marker_.data()})) {
      return false;
    }
    J_.setZero();
    for (const auto& [param, column] : free_) J_.row(column) += J_params_.col(param).transpose();
    if (extrinsics_) J_.middleRows<6>(own_params_) = J_extrinsics_.topRows(rows_).transpose();
    if (target != nullptr) {
      J_.middleRows<6>(target_columns_[target->index]) =
          (J_marker_.topRows(rows_) * internal::PointByTargetPose(*target->pose, p_target))
              .transpose();
    }
    return true;
  }

  // Sums over the observations of one marker in one view. The camera's own columns matter where
  // there is common noise.
  void ClearSum() {
    information_ = 0;
    J_sum_.resize(0, 0);
    pose_sum_.setZero();
    marker_sum_.setZero();
  }
  void AddToSum(double own_sigma, double common_sigma) {
    information_ += 1 / (own_sigma * own_sigma);
    if (common_sigma > 0) {
      if (J_sum_.size() == 0) J_sum_ = Eigen::MatrixXd::Zero(J_.rows(), J_.cols());
      J_sum_ += J_ / own_sigma;
    }
    pose_sum_.topRows(rows_) += J_pose_.topRows(rows_) / own_sigma;
    marker_sum_.topRows(rows_) += J_marker_.topRows(rows_) / own_sigma;
  }
  // Makes the present rows those of the marker's mean, in its sigmas; returns the part of their
  // squares that common noise takes away.
  double LoadMean(double common_sigma) {
    const double root = std::sqrt(information_);
    if (common_sigma > 0) J_ = J_sum_ / root;
    J_pose_ = pose_sum_ / root;
    J_marker_ = marker_sum_ / root;
    const double taken = internal::CommonShare(common_sigma, information_) * information_;
    ClearSum();
    return taken;
  }

  [[nodiscard]] auto Pose() const { return J_pose_.topRows(rows_); }
  [[nodiscard]] auto Marker() const { return J_marker_.topRows(rows_); }

  // Adds the products of the present rows, those by the marker where it is estimated.
  void AddProducts(double sign, std::optional<Eigen::Index> marker) {
    for (Eigen::Index r = 0; r < rows_; ++r) {
      const auto E = J_pose_.row(r);
      const auto M = J_marker_.row(r);
      if (!local_) {
        scaled_ = sign * J_.col(r);
        square_.noalias() += scaled_ * J_.col(r).transpose();
        cross_.noalias() += scaled_ * E;
        if (marker) marker_cross_.middleCols<3>(3 * *marker).noalias() += scaled_ * M;
        continue;
      }
      FindTouched(r);
      for (const Eigen::Index i : touched_) {
        const double j = sign * J_(i, r);
        for (const Eigen::Index k : touched_) square_(k, i) += j * J_(k, r);
        cross_.row(i) += j * E;
        if (marker) marker_cross_.block<1, 3>(i, 3 * *marker) += j * M;
      }
    }
  }
  // Adds J' E to the rows of all unknowns and sets it to zero.
  void MoveCrossTo(Eigen::MatrixXd* cross) {
    for (size_t i = 0; i < columns_.size(); ++i) {
      cross->row(columns_[i]) += cross_.row(static_cast<Eigen::Index>(i));
    }
    cross_.setZero();
  }
  // The lower triangle.
  void AddTo(Eigen::MatrixXd* S) const {
    for (size_t i = 0; i < columns_.size(); ++i) {
      for (size_t j = 0; j <= i; ++j) {
        const auto [column, row] = std::minmax(columns_[i], columns_[j]);
        (*S)(row, column) += square_(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
      }
      // A row of a matrix without columns is an offset of a null pointer.
      if (marker_cross_.cols() == 0) continue;
      S->col(columns_[i]).tail(marker_cross_.cols()) +=
          marker_cross_.row(static_cast<Eigen::Index>(i)).transpose();
    }
  }

 private:
  void FindTouched(Eigen::Index r) {
    touched_.clear();
    for (Eigen::Index i = 0; i < J_.rows(); ++i) {
      if (J_(i, r) != 0) touched_.push_back(i);
    }
  }

  int rows_;
  bool local_;
  bool extrinsics_ = false;
  // Parameters that are estimated, each with its column; equal ones have one.
  std::vector<std::pair<Eigen::Index, Eigen::Index>> free_;
  Eigen::Index own_params_ = 0;               // columns of parameters
  std::vector<Eigen::Index> target_columns_;  // per target: first of its six columns
  std::vector<int> columns_;                  // index of each column in the reduced system
  std::vector<Eigen::Index> touched_;         // columns that differ from zero in a row
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> J_params_;
  Eigen::Matrix<double, kMaxObservationSize, 6, Eigen::RowMajor> J_extrinsics_, J_pose_, pose_sum_;
  Eigen::Matrix<double, kMaxObservationSize, 3, Eigen::RowMajor> J_marker_, marker_sum_;
  Eigen::MatrixXd J_, J_sum_;  // of the present rows, one column each
  Eigen::VectorXd scaled_;     // a column of J_ with its sign; kept to save its allocation
  double information_ = 0;
  Eigen::MatrixXd square_;        // J' J over all observations
  Eigen::MatrixXd cross_;         // J' E of the present view
  Eigen::MatrixXd marker_cross_;  // J' M over all observations, three columns a marker
};

// Columns of W are collected and W W' is subtracted at once: one large product is faster than many
// small ones.
class Subtraction {
 public:
  explicit Subtraction(Eigen::MatrixXd* S) : S_(*S), batch_(ZeroRows(S->rows(), kColumns)) {}

  // S -= cross (L L')^-1 cross'
  void Add(const Eigen::MatrixXd& cross, const Eigen::LLT<Matrix6d>& factor) {
    // Without unknowns beside the poses: Eigen's solver does not take the empty matrix.
    if (cross.rows() == 0) return;
    batch_.block(0, columns_, cross.rows(), 6) =
        factor.matrixL().solve(cross.transpose()).transpose();
    columns_ += 6;
    if (columns_ == kColumns) Flush();
  }
  void Flush() {
    if (columns_ == 0) return;
    batch_.rightCols(kColumns - columns_).setZero();
    AddRowProducts(-1, batch_, &S_);
    columns_ = 0;
  }

 private:
  static constexpr int kColumns = 6 * 64;
  Eigen::MatrixXd& S_;
  RowMajorMatrix batch_;
  int columns_ = 0;
};

// One camera's observations in one frame, reduced to the target pose.
struct ReducedView {
  size_t camera = 0;
  Matrix6d information = Matrix6d::Zero();  // of the pose that the camera saw, E' E
  Matrix6d of_means = Matrix6d::Zero();     // that of the means of markers
  // With jitter about the frame's pose, of information W' W = Q: W and (E' E + Q)^-1.
  Matrix6d W = Matrix6d::Zero();
  Matrix6d jitter_covariance = Matrix6d::Zero();
};

// Goes through the observations frame by frame.
class Reduction {
 public:
  Reduction(const Bundle& bundle, const UnknownLayout& layout)
      : bundle_(bundle),
        layout_(layout),
        reduced_{.S = Eigen::MatrixXd::Zero(layout.total, layout.total),
                 .degrees_of_poses = std::vector<double>(bundle.cameras.size(), 0.0),
                 .degrees_of_poses_by_means = std::vector<double>(bundle.cameras.size(), 0.0)},
        subtraction_(&reduced_.S),
        cross_(layout.total, 6),
        view_cross_(layout.total, 6) {
    for (size_t c = 0; c < bundle.cameras.size(); ++c) own_.emplace_back(bundle, layout, c);
  }

  ReducedSystem Run() {
    const std::vector<BundleObservation>& observations = bundle_.observations;
    for (size_t begin = 0; begin < observations.size();) {
      const int frame = observations[begin].frame;
      Matrix6d pose = Matrix6d::Zero();
      cross_.setZero();
      views_.clear();
      while (begin < observations.size() && observations[begin].frame == frame) {
        const size_t end = EndOfView(observations, begin);
        AddView(begin, end, &pose);
        begin = end;
      }
      EliminatePose(static_cast<size_t>(frame), pose);
    }
    subtraction_.Flush();
    for (const OwnColumns& columns : own_) columns.AddTo(&reduced_.S);
    if (layout_.markers) {
      reduced_.S.diagonal().tail(layout_.total - layout_.head).array() +=
          1 / (bundle_.marker_sigma * bundle_.marker_sigma);
    }
    return std::move(reduced_);
  }

 private:
  // Observations [begin, end) of one view; adds to the information on the frame's pose.
  void AddView(size_t begin, size_t end, Matrix6d* pose) {
    const bool has_jitter = bundle_.EstimatesJitter();
    const auto frame = static_cast<size_t>(bundle_.observations[begin].frame);
    const auto c = static_cast<size_t>(bundle_.observations[begin].camera);
    const LinearisedView linearised = ViewOf(bundle_, frame, c);
    if (has_jitter) view_cross_.setZero();
    ReducedView view{.camera = c};
    for (size_t of_marker = begin; begin < end; begin = of_marker) {
      of_marker = EndOfMarker(bundle_.observations, begin);
      AddMarker(linearised, begin, of_marker, &view);
    }
    own_[c].MoveCrossTo(has_jitter ? &view_cross_ : &cross_);
    if (has_jitter) {
      EliminateJitter(frame, &view, pose);
    } else {
      *pose += view.information;
    }
    views_.push_back(view);
  }

  // Observations [begin, end) of one marker in one view.
  void AddMarker(const LinearisedView& linearised, size_t begin, size_t end, ReducedView* view) {
    const int marker = bundle_.observations[begin].marker;
    const BundleCamera& camera = bundle_.cameras[view->camera];
    const std::optional<size_t> target = bundle_.FreeTarget(marker);
    const MovingTarget moving{target.value_or(0),
                              target ? &bundle_.targets[*target].T_target_own : nullptr};
    OwnColumns& own = own_[view->camera];
    bool any = false;
    for (; begin < end; ++begin) {
      const BundleObservation& observation = bundle_.observations[begin];
      if (!observation.used || !own.Linearise(camera,
                                              linearised,
                                              bundle_.markers[static_cast<size_t>(marker)].position,
                                              target ? &moving : nullptr,
                                              observation)) {
        continue;
      }
      AddRows(marker, 1, view);
      own.AddToSum(camera.noise.OwnSigma(observation.assumed_sigma), camera.noise.common_sigma);
      any = true;
    }
    if (!any) return;
    const double taken = own.LoadMean(camera.noise.common_sigma);
    view->of_means.noalias() += (1 - taken) * own.Pose().transpose().lazyProduct(own.Pose());
    if (taken > 0) AddRows(marker, -taken, view);
  }

  // The present rows of the view's camera.
  void AddRows(int marker, double sign, ReducedView* view) {
    OwnColumns& own = own_[view->camera];
    Eigen::MatrixXd& cross = bundle_.EstimatesJitter() ? view_cross_ : cross_;
    const auto E = own.Pose();
    view->information.noalias() += sign * E.transpose().lazyProduct(E);
    own.AddProducts(sign, layout_.markers ? std::optional<Eigen::Index>(marker) : std::nullopt);
    if (!layout_.markers) return;
    const int m = layout_.Marker(marker);
    const auto M = own.Marker();
    cross.middleRows<3>(m).noalias() += sign * M.transpose().lazyProduct(E);
    reduced_.S.block<3, 3>(m, m).noalias() += sign * M.transpose().lazyProduct(M);
  }

  void EliminateJitter(size_t frame, ReducedView* view, Matrix6d* pose) {
    view->W = JitterWeight(bundle_, frame, view->camera);
    const Matrix6d Q = view->W.transpose() * view->W;
    const Eigen::LLT<Matrix6d> factor(view->information + Q);
    subtraction_.Add(view_cross_, factor);
    view->jitter_covariance = factor.solve(Matrix6d::Identity());
    const Matrix6d passed = view->jitter_covariance * Q;
    cross_.noalias() += view_cross_ * passed;
    *pose += view->information * passed;
  }

  void EliminatePose(size_t frame, const Matrix6d& pose) {
    const Eigen::LLT<Matrix6d> factor(pose);
    if (factor.info() != Eigen::Success) return;  // a frame without used observations
    subtraction_.Add(cross_, factor);
    const Matrix6d pose_covariance = factor.solve(Matrix6d::Identity());
    for (const ReducedView& view : views_) {
      Matrix6d seen = pose_covariance;  // covariance of the pose that the camera saw
      if (bundle_.EstimatesJitter()) {
        seen = PoseCovarianceWithJitter(view, pose_covariance);
        CountJitter(frame, view, pose_covariance);
      }
      reduced_.degrees_of_poses[view.camera] += (view.information * seen).trace();
      reduced_.degrees_of_poses_by_means[view.camera] += (view.of_means * seen).trace();
    }
  }

  static Matrix6d PoseCovarianceWithJitter(const ReducedView& view,
                                           const Matrix6d& pose_covariance) {
    const Matrix6d& A = view.jitter_covariance;
    const Matrix6d Q = view.W.transpose() * view.W;
    return A + A * Q * pose_covariance * Q * A;
  }

  void CountJitter(size_t frame, const ReducedView& view, const Matrix6d& pose_covariance) {
    if (bundle_.jitter.misplaced[bundle_.View(frame, view.camera)]) return;
    const Matrix6d& A = view.jitter_covariance;
    const Matrix6d& N = view.information;
    const Matrix6d jitter = A + A * N * pose_covariance * N * A;
    const Vector6d known = Vector6d::Ones() - (view.W * jitter * view.W.transpose()).diagonal();
    reduced_.jitter_translations += known.head<3>().sum();
    reduced_.jitter_rotations += known.tail<3>().sum();
  }

  const Bundle& bundle_;
  const UnknownLayout& layout_;
  ReducedSystem reduced_;
  Subtraction subtraction_;
  Eigen::MatrixXd cross_;       // F' E of the frame
  Eigen::MatrixXd view_cross_;  // and of one view, where views have jitter
  std::vector<ReducedView> views_;
  std::vector<OwnColumns> own_;  // per camera
};

}  // namespace

UnknownLayout MakeLayout(const Bundle& bundle, const std::vector<bool>& has_data) {
  UnknownLayout layout;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const BundleCamera& camera = bundle.cameras[c];
    std::vector<int> indices;
    for (size_t k = 0; k < camera.params.size(); ++k) {
      const bool own = bundle.Root(c, k) == ParamIndex{c, k};
      const bool fixed = camera.fixed[k] || (!camera.at_bound.empty() && camera.at_bound[k]);
      indices.push_back(!own || fixed || !has_data[c] ? -1 : layout.head++);
    }
    layout.params.push_back(indices);
    const bool free = !camera.is_master && has_data[c];
    layout.extrinsics.push_back(free ? layout.head : -1);
    if (free) layout.head += 6;
  }
  for (const BundleTarget& target : bundle.targets) {
    layout.targets.push_back(target.is_fixed ? -1 : layout.head);
    if (!target.is_fixed) layout.head += 6;
  }
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    for (size_t k = 0; k < layout.params[c].size(); ++k) {
      const ParamIndex root = bundle.Root(c, k);
      layout.params[c][k] = layout.params[root.camera][root.param];
    }
  }
  layout.markers = bundle.EstimatesMarkers() && !bundle.HasLandmarks();
  layout.total = layout.head + (layout.markers ? 3 * static_cast<int>(bundle.markers.size()) : 0);
  return layout;
}

ReducedSystem Reduce(const Bundle& bundle, const UnknownLayout& layout) {
  return Reduction(bundle, layout).Run();
}

}  // namespace plenocal::internal
