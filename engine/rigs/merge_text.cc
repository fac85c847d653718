// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>

#include "calib/base/number_text.h"
#include "engine/rigs/merge_calibrations.h"
#include "engine/rigs/pose_text.h"

namespace plenocal {
namespace {

std::string CameraText(const CalibratedCamera& camera) {
  std::string text = fmt::format(
      "{}  ({}, {} px)\n", camera.name, camera.model->name, fmt::join(camera.image_size, " x "));
  for (size_t k = 0; k < camera.params.size(); ++k) {
    if (camera.model->params[k].prior_sigma > 0) continue;  // too many to read
    text += fmt::format("  {:<10} {:>16.9g} +- {:.2g}\n",
                        camera.model->params[k].name,
                        camera.params[k],
                        camera.Sigma(k));
  }
  if (!(camera.sigma_xi.array() > 0).any()) return text;
  return text + fmt::format("  on the rig: xi = {}\n",
                            PoseText(Log(camera.T_camera_rig), camera.sigma_xi));
}

// The places of cameras that moved.
std::string MountsText(const MergedFiles& result) {
  const MergedCalibrations& merged = result.merged;
  std::string text;
  for (const MovedExtrinsics& mount : merged.mounts) {
    text += fmt::format("{} on the rig in {}: xi = {}\n",
                        merged.record.cameras[mount.camera].name,
                        result.names[mount.calibration],
                        PoseText(Log(mount.T_camera_rig), mount.sigma_xi));
  }
  return text;
}

// A line a calibration: how far it is from all together, and where farthest.
std::string DeviationsText(const MergedFiles& result) {
  const auto& [merged, names] = result;
  std::string text = fmt::format(
      "{:<40} {:>10}  farthest from the merged calibration\n", "calibration", "RMS sigmas");
  for (size_t p = 0; p < names.size(); ++p) {
    double squares = 0;
    int count = 0;
    const MergeDeviation* farthest = nullptr;
    for (const MergeDeviation& deviation : merged.deviations) {
      if (deviation.calibration != p || !(deviation.sigma > 0)) continue;
      squares += deviation.InSigmas() * deviation.InSigmas();
      ++count;
      if (farthest == nullptr || deviation.InSigmas() > farthest->InSigmas()) {
        farthest = &deviation;
      }
    }
    text += fmt::format("{:<40} ", names[p]);
    text += farthest == nullptr ? fmt::format("{:>10}  has nothing in common with others\n", "")
                                : fmt::format("{:>10.2f}  {} by {}, {:.1f} sigma\n",
                                              std::sqrt(squares / count),
                                              NameOfDeviation(merged, *farthest),
                                              SizeOfDeviation(merged, *farthest),
                                              farthest->InSigmas());
  }
  if (merged.degrees <= 0) return text;
  text += fmt::format("chi-square of all deviations: {:.1f} at {}",
                      merged.chi_square,
                      Counted(merged.degrees, "degree") + " of freedom");
  return text + (merged.scale == 1
                     ? "; the calibrations agree\n"
                     : fmt::format("; the calibrations disagree, and standard errors were scaled "
                                   "by {:.2f}\n",
                                   merged.scale));
}

}  // namespace

std::string MergeText(const MergedFiles& result) {
  std::string text;
  for (const CalibratedCamera& camera : result.merged.record.cameras) text += CameraText(camera);
  text += MountsText(result) + "\n" + DeviationsText(result);
  for (const Finding& finding : result.merged.record.findings) {
    text += fmt::format("\n{} {}\n", finding.what, finding.remedy);
  }
  return text;
}

}  // namespace plenocal
