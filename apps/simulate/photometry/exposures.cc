// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/photometry/exposures.h"

#include <fmt/format.h>

#include <cmath>

#include "apps/simulate/spec/random.h"
#include "calib/base/quoted_text.h"

namespace plenocal::simulate {

Exposures DrawExposures(const SimulationSpec& spec, std::size_t frames) {
  const ExposureSpec& wanted = *spec.exposures;
  Exposures exposures(spec.cameras.size(), std::vector<Exposure>(frames));
  for (size_t f = 0; f < frames; ++f) {
    // All cameras take over the master's.
    Random common(spec.seed, "exposure", {f});
    const double last = std::max(static_cast<double>(frames) - 1, 1.0);
    const double share = wanted.sweep ? static_cast<double>(f) / last : common.Uniform(0, 1);
    const double written = wanted.least * std::pow(wanted.largest / wanted.least, share);
    for (size_t c = 0; c < spec.cameras.size(); ++c) {
      Random random(spec.seed, "shutter", {c, f});
      const double error = random.Gaussian(wanted.error);
      const bool late =
          spec.cameras[c].name == wanted.late_camera && random.Uniform(0, 1) < wanted.late_share;
      exposures[c][f] = {written, written * (1 + error) * (late ? 1 + wanted.late_change : 1)};
    }
  }
  return exposures;
}

std::string PhotometryRecordingYaml(const SimulationSpec& spec) {
  std::string text = "plenocal: 1\ncameras:\n";
  for (const CameraSpec& camera : spec.cameras) {
    text += fmt::format("  {}:\n{}    times: times_{}.txt\n    exposure_unit: ms\n{}",
                        YamlText(camera.name),
                        ImageKeys(camera, true),
                        camera.name,
                        BayerKey(camera));
  }
  return text + "pairing: {by: name}\ncalibration: truth/calibration.yaml\n";
}

std::string ExposureTimesText(const std::vector<std::string>& frames,
                              const std::vector<Exposure>& exposures,
                              bool known) {
  constexpr double kInterval = 0.2;  // s
  std::string text = known ? "# frame time_s exposure_ms\n" : "# frame time_s\n";
  for (size_t f = 0; f < frames.size(); ++f) {
    text += fmt::format("{} {:.6f}", frames[f], kInterval * static_cast<double>(f + 1));
    text += known ? fmt::format(" {:.9g}\n", exposures[f].written) : "\n";
  }
  return text;
}

std::string TrueExposuresCsv(const SimulationSpec& spec,
                             const std::vector<std::string>& frames,
                             const Exposures& exposures) {
  std::string text = "frame,camera,exposure_ms\n";
  for (size_t c = 0; c < exposures.size(); ++c) {
    for (size_t f = 0; f < frames.size(); ++f) {
      const std::string frame = CsvCell(frames[f]), camera = CsvCell(spec.cameras[c].name);
      text += fmt::format("{},{},{:.9g}\n", frame, camera, exposures[c][f].exact);
    }
  }
  return text;
}

}  // namespace plenocal::simulate
