// SPDX-License-Identifier: Apache-2.0
//
// Two ground truths of one loop against each other, as one from the stereo pair and one from the
// plenoptic camera.
#pragma once

#include <filesystem>
#include <string>

#include "calib/scene/segment_covariance.h"

namespace plenocal {

struct TruthComparison {
  std::string camera;  ///< whose path was compared
  /// B's end segment against A's where the start segments coincide: the small similarity
  /// (translation in m, rotation in rad, scale) about A's end that moves A's to B's; zero where
  /// both are right. Its covariance is the sum of those that both state.
  Vector7d end = Vector7d::Zero();
  Matrix7d covariance = Matrix7d::Zero();
  double chi_square = 0;   ///< end' covariance^-1 end
  double probability = 1;  ///< that the stated errors alone cause as much
  /// Lengths in B over those in A, less 1, and its standard error. Errors of a calibration that
  /// both truths share are counted twice.
  double scale = 0, scale_sigma = 0;
  /// By more than errors explain once in two hundred comparisons.
  bool end_differs = false, scale_differs = false;
};

/// True for a file of `plenocal groundtruth`. Throws as `YamlNode::ReadFile`.
bool IsGroundTruth(const std::filesystem::path& path);

/// Compares two groundtruth.yaml of one recording. Throws `Error`: of kind kInput for files without
/// a camera in common; of kind kJob when frames in common do not determine the similarities.
TruthComparison CompareTruths(const std::filesystem::path& a, const std::filesystem::path& b);

/// For the terminal; the names stand for the two.
std::string ComparisonText(const TruthComparison& comparison,
                           const std::string& a,
                           const std::string& b);
/// groundtruth_compare.csv: number, difference, sigma, unit.
std::string ComparisonCsv(const TruthComparison& comparison);

}  // namespace plenocal
