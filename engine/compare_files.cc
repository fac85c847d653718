// SPDX-License-Identifier: Apache-2.0
#include "engine/compare_files.h"

#include "calib/base/names.h"
#include "calib/io/input_file.h"
#include "engine/session/calibration_folder.h"

namespace plenocal {

CalibrationComparison CompareFiles(const std::filesystem::path& a,
                                   const std::filesystem::path& b,
                                   const ComparedBy& by) {
  const RunScope inputs;
  const CalibrationRecord of_a = OpenWithCorrelations(a);
  CalibrationRecord of_b = OpenWithCorrelations(b);
  RenameCameras(by.map, NamesOf(of_a.cameras), &of_b);
  return CompareCalibrations(of_a, of_b, by.distances);
}

}  // namespace plenocal
