// SPDX-License-Identifier: Apache-2.0
#include "engine/compare_files.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "calib/base/names.h"
#include "calib/io/input_file.h"
#include "engine/rigs/predict_accuracy.h"
#include "engine/session/calibration_folder.h"

namespace plenocal {

CalibrationComparison CompareFiles(const std::filesystem::path& a,
                                   const std::filesystem::path& b,
                                   const ComparedBy& by) {
  const RunScope inputs;
  const CalibrationRecord of_a = OpenWithCorrelations(a);
  CalibrationRecord of_b = OpenWithCorrelations(b);
  RenameCameras(by.map, NamesOf(of_a.cameras), &of_b);
  CalibrationComparison comparison = CompareCalibrations(of_a, of_b, by.distances);
  if (!by.in_space) return comparison;
  std::vector<double> finite;
  std::ranges::copy_if(by.distances, std::back_inserter(finite), [](double distance) {
    return std::isfinite(distance);
  });
  if (finite.empty()) finite = {1};
  comparison.space =
      CompareInSpace(of_a, of_b, ReadVisibility(a.parent_path(), of_a), finite, by.bar);
  return comparison;
}

}  // namespace plenocal
