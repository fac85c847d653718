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
  if (by.in_space) comparison.space = CompareInSpace(of_a, of_b, by);
  return comparison;
}

SpaceComparison CompareInSpace(const CalibrationRecord& a,
                               const CalibrationRecord& b,
                               const ComparedBy& by) {
  std::vector<double> finite;
  std::ranges::copy_if(by.distances, std::back_inserter(finite), [](double distance) {
    return std::isfinite(distance);
  });
  if (finite.empty()) finite = {1};
  return CompareInSpace(a, b, ReadVisibility(a.path.parent_path(), a), finite, by.bar);
}

}  // namespace plenocal
