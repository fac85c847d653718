// SPDX-License-Identifier: Apache-2.0
//
// Points on the rays of an image's places, and what calibrated cameras see of them.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "assess/views/micro_lens_visibility.h"
#include "calib/files/calibration_record.h"
#include "calib/space/point_fit.h"

namespace plenocal {

/// Cameras that see points together; the first one's frame is the rig's.
class PointsBeforeImage {
 public:
  /// `names` of `calibration`'s cameras, `rig`: these, outlives it; `lenses`: micro images of each
  /// camera of the calibration. Throws `Error` of kind kInput for a plenoptic camera whose micro
  /// images are not known.
  PointsBeforeImage(const CalibrationRecord& calibration,
                    const std::vector<std::string>& names,
                    const SpaceRig& rig,
                    const std::vector<MicroLensVisibility>& lenses);

  /// `lenses`: of each camera of `rig`, with micro images of plenoptic ones.
  PointsBeforeImage(const SpaceRig& rig, std::vector<MicroLensVisibility> lenses)
      : rig_(rig), lenses_(std::move(lenses)) {}

  /// The point at a z of the first camera's frame, m, on the ray of a place in its image, px.
  /// Nothing for rays that do not reach it, and outside the image circle.
  [[nodiscard]] std::optional<Eigen::Vector3d> At(const Eigen::Vector2d& u_px, double z) const;

  /// Exact places of a point in all cameras, of a plenoptic one in all micro images that show it,
  /// without sigmas. Empty where a camera does not image it.
  [[nodiscard]] std::vector<SpaceObservation> Seen(const Eigen::Vector3d& X) const;

 private:
  const SpaceRig& rig_;
  std::vector<MicroLensVisibility> lenses_;  // by camera of the rig
};

}  // namespace plenocal
