// SPDX-License-Identifier: Apache-2.0
//
// Lengths in the target's file that are not in metres.
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <array>
#include <string_view>

#include "assess/causes/cause.h"
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

double MedianDistance(const Calibration& calibration) {
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

std::vector<Finding> FindWrongUnit(const CauseEvidence& evidence) {
  if (const std::string& key = evidence.doubts->unknown; !key.empty()) {
    return {
        {.code = "target_size_unknown",
         .grade = Grade::kGood,
         .what = fmt::format("All lengths are in units of the target's '{0}', which is unknown: "
                             "1 m in this result is one {0}. Intrinsics do not depend on it.",
                             key),
         .remedy = fmt::format("To have lengths in metres, measure '{}' and state it.", key)}};
  }
  if (evidence.doubts->unit_is_stated) return {};
  const double size = SizeOf(*evidence.markers), distance = MedianDistance(*evidence.calibration);
  const bool large = size > kMostSize && distance > kMostSize;
  const bool small = size < kLeastSize / 2 && distance < kLeastDistance;
  if (!large && !small) return {};
  for (const Unit& unit : kUnits) {
    const double factor = large ? unit.metres : 1 / unit.metres;
    if (!IsUsual(factor * size, factor * distance)) continue;
    return {
        {.code = "target_scale",
         .role = FindingRole::kTargetCause,
         .grade = Grade::kBad,
         .cameras = {},
         .value = distance,
         .limit = large ? kMostDistance : kLeastDistance,
         .what = fmt::format(
             "the target is {:.3g} m across and was {:.3g} m away: lengths in "
             "its file seem to be {}",
             size,
             distance,
             large ? fmt::format("in {}", unit.name) : fmt::format("{:g} times too small", factor)),
         .remedy = fmt::format("lengths in the target's file are metres: multiply them by {:g}; "
                               "or was 'unknown' meant? Then write it in place of the length{}",
                               factor,
                               large ? ", for which 1 often stands" : "")}};
  }
  return {};
}

}  // namespace

Cause DistanceUnitCause() { return {CauseStage::kTarget, FindWrongUnit}; }

}  // namespace plenocal
