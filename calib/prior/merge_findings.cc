// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <numbers>
#include <optional>

#include "calib/base/names.h"
#include "calib/prior/merge.h"

namespace plenocal {
namespace {

// The camera that, with a place of its own in each calibration, makes all calibrations agree best;
// nothing where none does. One that is in a single calibration, or has such places already, changes
// no residual.
std::optional<std::string> MovedCamera(const MergedCalibrations& merged,
                                       std::span<const CalibrationRecord> calibrations,
                                       const MergeOptions& options) {
  std::optional<std::string> found;
  double least = std::numeric_limits<double>::infinity();
  for (size_t c = 1; c < merged.record.cameras.size(); ++c) {
    const std::string& name = merged.record.cameras[c].name;
    MergeOptions moved = options;
    moved.moved.push_back(name);
    const MergedCalibrations other = MergeCalibrations(calibrations, moved);
    if (other.scale > 1 || other.chi_square > least) continue;
    least = other.chi_square;
    found = name;
  }
  return found;
}

}  // namespace

std::string NameOfDeviation(const MergedCalibrations& merged, const MergeDeviation& deviation) {
  const CalibratedCamera& camera = merged.record.cameras[deviation.camera];
  if (deviation.param) {
    return fmt::format("{}.{}", camera.name, camera.model->params[*deviation.param].name);
  }
  return fmt::format("{0}.T_{0}_{1}.{2}",
                     camera.name,
                     merged.record.cameras[deviation.master].name,
                     kExtrinsicsNames[static_cast<size_t>(deviation.component)]);
}

std::string SizeOfDeviation(const MergedCalibrations& merged, const MergeDeviation& deviation) {
  if (!deviation.param) {
    return deviation.component < 3
               ? fmt::format("{:.3g} mm", 1e3 * deviation.deviation)
               : fmt::format("{:.3g} degrees", deviation.deviation * 180 / std::numbers::pi);
  }
  const Param& param = merged.record.cameras[deviation.camera].model->params[*deviation.param];
  return fmt::format(
      "{:.3g}{}", deviation.deviation, param.unit == "1" ? "" : fmt::format(" {}", param.unit));
}

std::vector<Finding> FindingsOfMerge(const MergedCalibrations& merged,
                                     std::span<const CalibrationRecord> calibrations,
                                     const MergeOptions& options) {
  constexpr double kNamedFrom = 3;  // standard deviations
  constexpr size_t kMostFindings = 3;
  if (merged.scale == 1) return {};
  if (const auto moved = MovedCamera(merged, calibrations, options)) {
    return {
        {.code = "mount_moved",
         .grade = Grade::kUsable,
         .cameras = {*moved},
         .value = merged.scale,
         .limit = 1,
         .what = fmt::format("{} moved on the rig between the calibrations: with a place of "
                             "its own in each of them they agree.",
                             *moved),
         .remedy = fmt::format("Merge with '--moved {}': the result has its last place.", *moved)}};
  }
  std::vector<MergeDeviation> far;
  for (const MergeDeviation& deviation : merged.deviations) {
    if (deviation.InSigmas() > kNamedFrom) far.push_back(deviation);
  }
  std::ranges::stable_sort(far, std::greater<>(), &MergeDeviation::InSigmas);
  far.resize(std::min(far.size(), kMostFindings));
  std::vector<Finding> findings;
  for (const MergeDeviation& deviation : far) {
    findings.push_back(
        {.code = "calibrations_disagree",
         .grade = Grade::kUsable,
         .cameras = {merged.record.cameras[deviation.camera].name},
         .value = deviation.InSigmas(),
         .limit = kNamedFrom,
         .what = fmt::format("{}: {} is {} away from all calibrations together, {:.1f} sigma.",
                             NameOfDeviation(merged, deviation),
                             calibrations[deviation.calibration].path.string(),
                             SizeOfDeviation(merged, deviation),
                             deviation.InSigmas()),
         .remedy = "Was a lens refocused or exchanged? Then merge only the calibrations since. "
                   "Else look for what is wrong in that calibration."});
  }
  return findings;
}

}  // namespace plenocal
