// SPDX-License-Identifier: Apache-2.0
//
// Exposure times of a simulated recording, and its files.
#pragma once

#include <string>
#include <vector>

#include "apps/simulate/spec/simulation_spec.h"

namespace plenocal::simulate {

/// The exposure of one image.
struct Exposure {
  double written = 0;  ///< ms, as times.txt has it
  double exact = 0;    ///< ms
};

/// By camera and frame.
using Exposures = std::vector<std::vector<Exposure>>;

/// REQUIRES: `spec.exposures`.
Exposures DrawExposures(const SimulationSpec& spec, std::size_t frames);

/// recording.yaml: cameras, times, the true calibration.
std::string PhotometryRecordingYaml(const SimulationSpec& spec);
/// times_<camera>.txt: a line "name time exposure_ms" an image.
std::string ExposureTimesText(const std::vector<std::string>& frames,
                              const std::vector<Exposure>& exposures,
                              bool known);
/// truth/exposures.csv: frame, camera, exposure_ms.
std::string TrueExposuresCsv(const SimulationSpec& spec,
                             const std::vector<std::string>& frames,
                             const Exposures& exposures);

}  // namespace plenocal::simulate
