// SPDX-License-Identifier: Apache-2.0
#include "assess/space/points_before_image.h"

#include <limits>

#include "assess/views/place_in_image.h"
#include "calib/base/format_error.h"

namespace plenocal {

PointsBeforeImage::PointsBeforeImage(const CalibrationRecord& calibration,
                                     const std::vector<std::string>& names,
                                     const SpaceRig& rig,
                                     const std::vector<MicroLensVisibility>& lenses)
    : rig_(rig) {
  for (const std::string& name : names) {
    const CalibratedCamera& camera = FindCamera(calibration, name);
    const auto index = static_cast<size_t>(&camera - calibration.cameras.data());
    lenses_.push_back(index < lenses.size() ? lenses[index] : MicroLensVisibility());
    if (!camera.model->plenoptic || lenses_.back().HasLenses()) continue;
    throw InputError("{}: the micro images of camera '{}' are not known ({})",
                     calibration.path.string(),
                     name,
                     camera.micro_lenses.empty() ? "no file is named"
                                                 : camera.micro_lenses + " is not beside it");
  }
}

std::optional<Eigen::Vector3d> PointsBeforeImage::At(const Eigen::Vector2d& u_px, double z) const {
  const BundleCamera& camera = rig_.cameras[0];
  if (camera.image_circle && !camera.image_circle->Has(u_px)) return std::nullopt;
  std::array<double, kMaxObservationSize> values{u_px.x(), u_px.y()};
  if (camera.model->plenoptic) {
    // Places beside the middle of micro images, as points have them: fewer show one at a middle.
    const Eigen::Vector2d lens = lenses_[0].Nearest(u_px);
    values = {u_px.x(), u_px.y(), lens.x(), lens.y()};
  }
  const std::optional<Ray> ray = Unproject(camera, values.data());
  constexpr double kFlattest = 1e-3;  // rays that do not cross the plane
  if (!ray || !(ray->direction.z() > kFlattest)) return std::nullopt;
  const double along = (z - ray->origin.z()) / ray->direction.z();
  if (!(along > 0)) return std::nullopt;
  return ray->origin + along * ray->direction;
}

std::vector<SpaceObservation> PointsBeforeImage::Seen(const Eigen::Vector3d& X) const {
  constexpr size_t kAll = std::numeric_limits<size_t>::max(), kFewest = 2;
  std::vector<SpaceObservation> seen;
  for (size_t c = 0; c < rig_.cameras.size(); ++c) {
    const BundleCamera& camera = rig_.cameras[c];
    const Eigen::Vector3d p = camera.T_camera_rig * X;
    SpaceObservation one{.camera = c};
    if (!camera.model->plenoptic) {
      const auto u = PlaceInImage(camera, p, 0);
      if (!u || (camera.image_circle && !camera.image_circle->Has(*u))) return {};
      one.values = {u->x(), u->y()};
      seen.push_back(one);
      continue;
    }
    const MicroLensVisibility::Seen shown = lenses_[c].LensesShowing(camera, p, kAll);
    if (shown.all < kFewest) return {};
    for (const Eigen::Vector2d& lens : shown.centres) {
      one.values = {lens.x(), lens.y(), lens.x(), lens.y()};
      Eigen::Vector2d u;
      if (!Project(camera, one.values.data(), p, u.data())) return {};
      one.values[0] = u.x();
      one.values[1] = u.y();
      seen.push_back(one);
    }
  }
  return seen;
}

}  // namespace plenocal
