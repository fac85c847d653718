// SPDX-License-Identifier: Apache-2.0
#include "assess/target/target_causes.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <iterator>
#include <optional>
#include <string_view>

#include "assess/target/back_side.h"
#include "assess/target/frame_choice.h"
#include "assess/target/marker_offsets.h"
#include "assess/target/wrong_layout.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

// m: targets and distances that are usual. Outside of both a wrong unit is suspected when the file
// states none and another one brings both inside.
constexpr double kLeastSize = 0.02, kMostSize = 4;
constexpr double kLeastDistance = 0.05, kMostDistance = 30;

struct Unit {
  std::string_view name;
  double metres = 1;
};
constexpr std::array<Unit, 3> kUnits{
    {{"inches", 0.0254}, {"millimetres", 1e-3}, {"centimetres", 1e-2}}};

double SizeOf(const std::map<int, Eigen::Vector3d>& markers) {
  Eigen::AlignedBox3d box;
  for (const auto& [number, p] : markers) box.extend(p);
  return box.diagonal().norm();
}

double DistanceOf(const Calibration& calibration) {
  std::vector<double> distances;
  for (const RigidTransform& T_rig_target : calibration.bundle.T_rig_target) {
    distances.push_back(T_rig_target.t.norm());
  }
  return Median(distances);
}

bool IsUsual(double size, double distance) {
  return size > kLeastSize && size < kMostSize && distance > kLeastDistance &&
         distance < kMostDistance;
}

std::vector<Finding> FindWrongUnit(const std::map<int, Eigen::Vector3d>& markers,
                                   const Calibration& calibration) {
  const double size = SizeOf(markers), distance = DistanceOf(calibration);
  const bool large = size > kMostSize && distance > kMostSize;
  const bool small = size < kLeastSize / 2 && distance < kLeastDistance;
  if (!large && !small) return {};
  for (const Unit& unit : kUnits) {
    const double factor = large ? unit.metres : 1 / unit.metres;
    if (!IsUsual(factor * size, factor * distance)) continue;
    return {{.code = "target_scale",
             .grade = Grade::kBad,
             .cameras = {},
             .value = distance,
             .limit = large ? kMostDistance : kLeastDistance,
             .what = fmt::format("the target is {:.3g} m across and was {:.3g} m away: lengths in "
                                 "its file seem to be {}",
                                 size,
                                 distance,
                                 large ? fmt::format("in {}", unit.name)
                                       : fmt::format("{:g} times too small", factor)),
             .remedy = fmt::format("lengths in the target's file are metres: multiply them by {:g}",
                                   factor)}};
  }
  return {};
}

}  // namespace

std::vector<Finding> FindTargetCauses(const CalibrationInput& input,
                                      const TargetDoubts& doubts,
                                      const Calibration* calibration) {
  const std::vector<CameraInput> cameras = ChooseFrames(input.cameras);
  std::vector<Finding> findings = FindWrongLayout(cameras, input.markers, doubts);
  if (findings.empty()) findings = FindTargetTwice(cameras, input.markers);
  // The rest measures with a calibration, which a wrong layout has spoilt.
  if (!findings.empty() || calibration == nullptr) return findings;
  if (!doubts.unit_is_stated) Append(FindWrongUnit(input.markers, *calibration), &findings);
  Append(FindMirroredImages(*calibration, doubts), &findings);
  Append(FindMovedMarkers(ChooseFrames(*calibration), doubts), &findings);
  std::ranges::stable_sort(findings, std::ranges::greater(), &Finding::grade);
  return findings;
}

}  // namespace plenocal
