// SPDX-License-Identifier: Apache-2.0
//
// Images that show the printed side of a target from behind: they are mirrored.
#include <fmt/format.h>

#include "assess/causes/cause.h"

namespace plenocal {
namespace {

/// Views of one camera.
struct Sides {
  int front = 0, back = 0;
};

// By camera.
std::vector<Sides> CountSides(const Bundle& bundle, const TargetDoubts& doubts) {
  std::vector<Sides> sides(bundle.cameras.size());
  const auto& observations = bundle.observations;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    end = EndOfView(observations, begin);
    const auto c = static_cast<size_t>(observations[begin].camera);
    const RigidTransform T_target_camera =
        (bundle.cameras[c].T_camera_rig *
         bundle.SeenPose(static_cast<size_t>(observations[begin].frame), c))
            .Inverse();
    int balance = 0;  // markers seen from the front less those from behind
    for (size_t i = begin; i < end; ++i) {
      const BundleMarker& marker = bundle.markers[static_cast<size_t>(observations[i].marker)];
      const auto normal = doubts.normals.find(marker.number);
      if (!observations[i].used || normal == doubts.normals.end()) continue;
      balance += normal->second.dot(T_target_camera.t - marker.position) > 0 ? 1 : -1;
    }
    if (balance > 0) ++sides[c].front;
    if (balance < 0) ++sides[c].back;
  }
  return sides;
}

// The mirror image of a plane is the plane seen from behind, with the same residuals; only the side
// differs. One finding for each camera that sees the markers from behind in nearly all views.
std::vector<Finding> FindMirroredImages(const CauseEvidence& evidence) {
  const Calibration& calibration = *evidence.calibration;
  constexpr double kNearlyAll = 0.9;  // a few views may have the wrong one of two minima
  const std::vector<Sides> sides = CountSides(calibration.bundle, *evidence.doubts);
  std::vector<Finding> findings;
  for (size_t c = 0; c < sides.size(); ++c) {
    const double all = sides[c].front + sides[c].back, part = sides[c].back / all;
    if (!(part > kNearlyAll)) continue;
    const std::string& name = calibration.bundle.cameras[c].name;
    findings.push_back(
        {.code = "images_mirrored",
         .role = FindingRole::kCause,
         .grade = Grade::kBad,
         .cameras = {name},
         .value = part,
         .limit = kNearlyAll,
         .what =
             fmt::format("{}: its images are mirrored: they show the printed side of the target "
                         "from behind ({} of {:.0f} images).",
                         name,
                         sides[c].back,
                         all),
         .remedy = "Record without mirroring (many webcams and phones flip a preview): parameters "
                   "of mirrored images do not hold for the camera. Where the points come from a "
                   "file, its numbering of the markers may be mirrored instead; then only the "
                   "poses are."});
  }
  return findings;
}

}  // namespace

Cause ImagesMirroredCause() { return {CauseStage::kTarget, FindMirroredImages}; }

}  // namespace plenocal
