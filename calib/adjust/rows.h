// SPDX-License-Identifier: Apache-2.0
//
// Rows of the adjustment: residuals and their derivatives in standard deviations, and the walk over
// them frame by frame. Both back ends, the covariance and the tests of a calibration use these.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/adjust/layout.h"
#include "calib/base/robust.h"

namespace plenocal::internal {

/// Poses that one view's observations share.
struct LinearisedView {
  RigidTransform T_camera_rig, T_rig_target;
  /// Change of T_rig_target with each nuisance of the camera, as the chart about its present value
  /// has it; empty: none moves it.
  std::vector<Vector6d> by_nuisance = {};
};

/// The poses of a view of `bundle` as they are.
LinearisedView ViewOf(const BundleState& bundle, size_t frame, size_t camera);

/// Derivatives of the pose that a camera saw by the frame's pose and by the view's jitter
/// (`Jitter::delta`); poses in the charts about their present values.
struct ViewCharts {
  Matrix6d pose = Matrix6d::Identity(), jitter = Matrix6d::Identity();
};
ViewCharts ChartsOf(const BundleState& bundle, size_t frame, size_t camera);

/// Memory for one observation's residual and derivatives; row-major, one row a measured coordinate.
/// Null pointers are not written.
struct LinearisedRows {
  double* residual = nullptr;
  double* J_params = nullptr;      ///< rows x params
  double* J_extrinsics = nullptr;  ///< rows x 6, chart of T_camera_rig about its present value
  double* J_pose = nullptr;        ///< rows x 6, chart of the pose that the camera saw, likewise
  double* J_marker = nullptr;      ///< rows x 3

  [[nodiscard]] bool HasDerivatives() const {
    return J_params != nullptr || J_extrinsics != nullptr || J_pose != nullptr ||
           J_marker != nullptr;
  }
};

/// Residual of one observation in standard deviations of its own noise with its derivatives; false
/// outside the model's domain. Without J_params the others cost a third.
bool Linearise(const BundleCamera& camera,
               const LinearisedView& view,
               const Eigen::Vector3d& p_target,
               const BundleObservation& observation,
               const LinearisedRows& out);

/// Derivative of a point at `p_target`, in the frame of the first target, by the chart of the pose
/// of the target on which it is.
inline Eigen::Matrix<double, 3, 6> PointByTargetPose(const RigidTransform& T_target_own,
                                                     const Eigen::Vector3d& p_target) {
  Eigen::Matrix<double, 3, 6> J;
  J << Eigen::Matrix3d::Identity(), -Hat(p_target - T_target_own.t);
  return J;
}

/// A robust loss of each observation; `width` in sigmas of all its noise.
struct RobustLoss {
  Loss loss = Loss::kNone;
  double width = 0;
  /// Scales rows by the root of Huber's weight (iteratively reweighted least squares) in place of
  /// the loss' own derivatives: shorter steps, for fits without a test of the step.
  bool reweights = false;
};

/// Derivatives that rows have.
struct RowColumns {
  bool params = false, extrinsics = false, pose = false, marker = false;

  [[nodiscard]] bool Any() const { return params || extrinsics || pose || marker; }
};

/// Rows of the used observations of one marker in one view, whitened: their errors are independent
/// with standard deviation 1, the common noise of the marker included. Observations outside the
/// model's domain have none.
class MarkerRows {
 public:
  template <int columns>
  using Rows = Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, columns, Eigen::RowMajor>,
                          Eigen::Unaligned>;

  /// `camera` must outlive this.
  MarkerRows(const BundleCamera& camera, const RowColumns& columns);

  /// Projects the observations of a view all at once, where the model has a function for that.
  /// Until the next call, `Load` is then for these, in this view.
  void Prepare(const LinearisedView& view,
               std::span<const BundleObservation> of_view,
               std::span<const BundleMarker> markers);

  /// As `internal::Linearise`, without another projection where the observation is prepared.
  bool Linearise(const LinearisedView& view,
                 const Eigen::Vector3d& p_target,
                 const BundleObservation& observation,
                 const LinearisedRows& out) const;

  /// Loads the used ones of `of_marker`; false where one does not project.
  bool Load(const LinearisedView& view,
            const Eigen::Vector3d& p_target,
            std::span<const BundleObservation> of_marker,
            const RobustLoss& loss);

  [[nodiscard]] Eigen::Index Count() const { return count_; }
  /// Index of the marker whose rows are loaded.
  [[nodiscard]] int Marker() const { return marker_; }
  [[nodiscard]] Eigen::Map<const Eigen::VectorXd> Residual() const {
    return {residual_.data(), count_};
  }
  /// Rows x params, 6, 6, 3: as in `LinearisedRows`.
  [[nodiscard]] Rows<Eigen::Dynamic> Params() const { return Of<Eigen::Dynamic>(params_, width_); }
  [[nodiscard]] Rows<6> Extrinsics() const { return Of<6>(extrinsics_, 6); }
  [[nodiscard]] Rows<6> Pose() const { return Of<6>(pose_, 6); }
  [[nodiscard]] Rows<3> Position() const { return Of<3>(position_, 3); }
  /// Information on the pose of the mean of the marker's observations alone.
  [[nodiscard]] Matrix6d PoseInformationOfMean() const;

 private:
  template <int columns>
  [[nodiscard]] Rows<columns> Of(const std::vector<double>& data, Eigen::Index width) const {
    return {data.data(), count_, width};
  }
  [[nodiscard]] LinearisedRows Next();
  // Applies `loss` to the rows of one observation; returns the factor on their weight.
  double Robustify(const RobustLoss& loss, double assumed_sigma, const LinearisedRows& rows) const;
  void Whiten();

  const BundleCamera& camera_;
  RowColumns columns_;
  Eigen::Index rows_, width_;  // of one observation; of J_params
  int marker_ = 0;
  Eigen::Index count_ = 0;
  std::vector<double> residual_, params_, extrinsics_, pose_, position_;
  std::vector<double> inverse_sigma_;  // per loaded observation
  // Of the prepared observations: points, projections.
  std::span<const BundleObservation> prepared_;
  ViewPoints points_;
  std::vector<double> predicted_, J_params_, J_point_;
};

/// Calls add(first, J) for derivatives J of a marker's rows by unknowns of `layout` from `first`
/// on, one or several columns; more than once for parameters that are tied together.
template <typename Add>
void ForEachDerivative(const BundleState& bundle,
                       const UnknownLayout& layout,
                       size_t camera,
                       const MarkerRows& rows,
                       const Add& add) {
  const std::vector<int>& params = layout.params[camera];
  for (size_t k = 0; k < params.size(); ++k) {
    if (params[k] >= 0) add(params[k], rows.Params().col(static_cast<Eigen::Index>(k)));
  }
  if (layout.extrinsics[camera] >= 0) add(layout.extrinsics[camera], rows.Extrinsics());
  if (const auto target = bundle.FreeTarget(rows.Marker())) {
    const Eigen::Vector3d& position = bundle.markers[static_cast<size_t>(rows.Marker())].position;
    const auto by_pose = PointByTargetPose(bundle.targets[*target].T_target_own, position);
    add(layout.targets[*target], rows.Position() * by_pose);
  }
  for (size_t k = 0; layout.scales >= 0 && k < bundle.scales.size(); ++k) {
    if (bundle.scales[k].target != bundle.markers[static_cast<size_t>(rows.Marker())].target)
      continue;
    add(layout.scales + static_cast<int>(k),
        (rows.Position() * bundle.ByScale(bundle.scales[k], rows.Marker())).eval());
  }
  if (layout.markers) add(layout.Marker(rows.Marker()), rows.Position());
}

/// A view whose rows are visited.
struct VisitedView {
  size_t frame = 0, camera = 0;
  LinearisedView poses;
};

/// Walks over rows frame by frame. A visitor has
///   void Marker(const VisitedView& view, const MarkerRows& rows);  // not called without rows
///   void EndView(const VisitedView& view);                         // after markers with rows
///   void EndFrame(size_t frame);                                   // likewise
class RowWalk {
 public:
  RowWalk(const Bundle& bundle, const RobustLoss& loss, const RowColumns& columns)
      : bundle_(bundle), loss_(loss) {
    rows_.reserve(bundle.cameras.size());
    for (const BundleCamera& camera : bundle.cameras) rows_.emplace_back(camera, columns);
  }

  /// Visits the observations [begin, end); false where a used one does not project.
  template <typename Visitor>
  bool Visit(size_t begin, size_t end, Visitor&& visitor) {
    const std::vector<BundleObservation>& observations = bundle_.observations;
    bool complete = true, in_frame = false;
    while (begin < end) {
      const auto frame = static_cast<size_t>(observations[begin].frame);
      const auto camera = static_cast<size_t>(observations[begin].camera);
      const VisitedView view{frame, camera, ViewOf(bundle_, frame, camera)};
      bool in_view = false;
      const size_t end_of_view = EndOfView(observations, begin);
      MarkerRows& rows = rows_[camera];
      rows.Prepare(
          view.poses, std::span(observations).subspan(begin, end_of_view - begin), bundle_.markers);
      for (size_t next = 0; begin < end_of_view; begin = next) {
        next = EndOfMarker(observations, begin);
        const auto marker = static_cast<size_t>(observations[begin].marker);
        complete &= rows.Load(view.poses,
                              bundle_.markers[marker].position,
                              std::span(observations).subspan(begin, next - begin),
                              loss_);
        if (rows.Count() == 0) continue;
        visitor.Marker(view, rows);
        in_view = true;
      }
      if (in_view) visitor.EndView(view);
      in_frame |= in_view;
      if (begin < end && static_cast<size_t>(observations[begin].frame) == frame) continue;
      if (in_frame) visitor.EndFrame(frame);
      in_frame = false;
    }
    return complete;
  }
  template <typename Visitor>
  bool Visit(Visitor&& visitor) {
    return Visit(0, bundle_.observations.size(), visitor);
  }

 private:
  const Bundle& bundle_;
  RobustLoss loss_;
  std::vector<MarkerRows> rows_;  // per camera
};

}  // namespace plenocal::internal
