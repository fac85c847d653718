// SPDX-License-Identifier: Apache-2.0
//
// What a view of the target that has not been taken would add to a calibration.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "assess/views/micro_lens_visibility.h"
#include "assess/views/rig_estimate.h"

namespace plenocal {

/// How one camera would see the target.
struct TargetVisibility {
  bool found = false;                 ///< enough markers for a detector
  std::vector<size_t> markers;        ///< that can be measured, in the predictor's order
  std::vector<Eigen::Vector2d> u_px;  ///< of those, in the image
};

/// Predicts views of one target by one rig. Const after construction: may be shared by threads.
class ViewPredictor {
 public:
  /// The arguments must outlive it.
  ViewPredictor(const RigEstimate& rig, const RigUnknowns& unknowns, const ViewTarget& shape);

  /// Information that a frame with this pose adds on the unknowns in units, its pose eliminated:
  ///   J_t' W J_t - J_t' W J_x (J_x' W J_x)^-1 J_x' W J_t,
  /// W the inverse of the variance of the points and of the markers, which are taken for unknowns
  /// of this frame. Nothing when no camera finds the target, or not the one that must, or the pose
  /// is not determined. `most_markers`: at most so many are computed, evenly spread; they stand for
  /// all.
  [[nodiscard]] std::optional<Eigen::MatrixXd> Information(
      const RigidTransform& T_rig_target,
      size_t most_markers,
      std::optional<size_t> camera_that_must = {}) const;

  /// Normal equations of one frame (unknowns in units), pose eliminated: its part of the
  /// information, and J' W r of its residuals r.
  struct FrameInformation {
    int frame = 0;
    Eigen::MatrixXd information;
    Eigen::VectorXd gradient;
    /// Covariance of the frame's pose (chart of T_rig_target, m and rad) for given unknowns.
    Matrix6d pose_covariance;
    /// Change of this pose with the unknowns in units, 6 x unknowns.
    Eigen::Matrix<double, 6, Eigen::Dynamic> pose_by_unknowns;
  };
  /// Calls `take` with those of the frames so far whose pose is determined, one after the other.
  void ForFrames(const std::function<void(const FrameInformation&)>& take) const;

  /// Information of the frames so far on the unknowns in units, with a prior of one unit on each:
  /// weak, but for the deformations of the target, whose tolerance it is. Its inverse times the
  /// cameras' factors is the covariance.
  [[nodiscard]] Eigen::MatrixXd InformationSoFar() const;

  /// Markers count where they are in the image with a margin, face the camera, and the image
  /// resolves the target's finest detail; of a plenoptic camera, where two micro images show
  /// them. A target is found when half of its markers count, or all unless it is found in part.
  [[nodiscard]] TargetVisibility PredictVisibility(size_t camera,
                                                   const RigidTransform& T_rig_target,
                                                   size_t most_markers) const;

 private:
  struct MarkerShape {
    int number = 0;
    Eigen::Vector3d position, normal, sigma;
  };
  struct Sums;
  class CameraRows;

  [[nodiscard]] std::optional<Eigen::Vector2d> Image(size_t camera,
                                                     const RigidTransform& T_camera_target,
                                                     const MarkerShape& marker) const;
  /// `of_frame`: all observations of one frame.
  [[nodiscard]] std::optional<FrameInformation> MakeFrameInformation(
      std::span<const BundleObservation> of_frame) const;
  /// Observations of a marker, and how many each stands for.
  [[nodiscard]] std::pair<std::vector<BundleObservation>, double> Predicted(
      size_t camera, const RigidTransform& T_rig_target, const MarkerShape& marker) const;
  /// The information is not set where the pose is not determined.
  [[nodiscard]] std::optional<FrameInformation> WithoutPose(const Sums& sums) const;

  const RigEstimate& rig_;
  const RigUnknowns& unknowns_;
  const ViewTarget& shape_;
  std::vector<MarkerShape> markers_;  // each next one the farthest from those before
  std::map<int, size_t> by_number_;   // of `markers_`
  std::vector<MicroLensVisibility> lenses_;
};

/// Sets the factors of a rig such that the variances of its cameras' parameters are those of the
/// calibration (by their median ratio; at least 1).
void SetFactors(const CalibrationRecord& calibration, const ViewTarget& target, RigEstimate* rig);

/// A calibration with its factors, and a predictor of its frames. Throws as `MakeRigEstimate`.
class CalibratedViews {
 public:
  explicit CalibratedViews(const CalibrationRecord& calibration);
  CalibratedViews(const CalibratedViews&) = delete;
  CalibratedViews& operator=(const CalibratedViews&) = delete;

  [[nodiscard]] const RigUnknowns& Unknowns() const { return unknowns_; }
  [[nodiscard]] const ViewPredictor& Predictor() const { return predictor_; }
  /// Per unknown: the root of its camera's factor.
  [[nodiscard]] Eigen::VectorXd Factors() const {
    return UnknownScales(rig_, unknowns_).cwiseQuotient(unknowns_.unit);
  }

 private:
  ViewTarget target_;
  RigEstimate rig_;
  RigUnknowns unknowns_;
  ViewPredictor predictor_;
};

}  // namespace plenocal
