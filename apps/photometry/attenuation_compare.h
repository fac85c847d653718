// SPDX-License-Identifier: Apache-2.0
//
// Two attenuations of one camera against each other.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "apps/photometry/white_attenuation.h"

namespace plenocal {

struct AttenuationComparison {
  /// One position, or the mean of several: attenuations with a common factor that makes their mean
  /// ratio 1; standard deviation of the ratio, NaN where one is not known.
  struct Row {
    double x = 0, first = 0, second = 0, sigma = 0;
  };
  std::vector<Row> middle_row;  ///< x: px
  std::vector<Row> radial;      ///< x: px from the image's middle
  double rms = 0, largest = 0;  ///< of the ratio from 1
  double expected = 0;          ///< of the ratio's standard deviation, RMS; NaN: not known
  double chi_square = 0;        ///< mean of (ratio - 1)^2 / sigma^2; NaN: not known
  Row border;                   ///< outermost of `radial` with whole circles in the image's corners
};

/// True for the name of a TIFF, as attenuations are.
bool IsAttenuation(const std::filesystem::path& path);

/// REQUIRES: equal sizes.
AttenuationComparison CompareAttenuations(const Attenuation& first, const Attenuation& second);
/// The same of two attenuation TIFFs with the standard deviations beside them, if there are any:
/// vignetting_<camera>.tiff and vignetting_sigma_<camera>.tiff. Throws `Error` of kind kInput, also
/// for two sizes.
AttenuationComparison CompareAttenuationFiles(const std::filesystem::path& first,
                                              const std::filesystem::path& second);

/// vignetting_compare.csv: section (row, radial), x, first, second, ratio, sigma (of the ratio).
std::string ComparisonCsv(const AttenuationComparison& comparison);
/// For the terminal; the names stand for the two.
std::string ComparisonText(const AttenuationComparison& comparison,
                           const std::string& first,
                           const std::string& second);
/// report.html of the comparison alone.
std::string ComparisonPage(const AttenuationComparison& comparison,
                           const std::string& first,
                           const std::string& second);
/// For the page of a vignetting.
nlohmann::json ComparisonJson(const AttenuationComparison& comparison,
                              const std::string& first,
                              const std::string& second);

}  // namespace plenocal
