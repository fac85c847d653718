// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/compared_files.h"

#include "apps/cli/result_pictures.h"
#include "apps/evaluate/compare_truths.h"
#include "apps/photometry/attenuation_compare.h"
#include "assess/text/compare_text.h"
#include "calib/base/format_error.h"

namespace plenocal {

ComparedFiles CompareFilesOfAnyKind(const std::filesystem::path& first,
                                    const std::filesystem::path& second,
                                    const ComparedBy& by,
                                    bool files) {
  const std::string a = first.string(), b = second.string();
  const bool for_calibrations = !by.map.empty() || !by.distances.empty() || by.in_space;
  if (IsAttenuation(a)) {
    if (!IsAttenuation(b) || for_calibrations) {
      throw InputError(
          "attenuations are compared with each other: give two TIFF files and -o only");
    }
    const AttenuationComparison comparison = CompareAttenuationFiles(a, b);
    return {ComparisonText(comparison, a, b),
            {{"vignetting_compare.csv", ComparisonCsv(comparison)},
             {"report.html", ComparisonPage(comparison, a, b)}}};
  }
  if (IsGroundTruth(a)) {
    if (b.empty() || !IsGroundTruth(b) || for_calibrations) {
      throw InputError(
          "ground truths are compared with each other: give two groundtruth.yaml and -o only");
    }
    const TruthComparison comparison = CompareTruths(a, b);
    return {ComparisonText(comparison, a, b),
            {{"groundtruth_compare.csv", ComparisonCsv(comparison)}}};
  }
  const CalibrationComparison comparison = CompareFiles(a, b, by);
  ComparedFiles shown{ComparisonText(comparison, a, b), {}};
  if (comparison.space) shown.text += "\n" + SpaceText(*comparison.space);
  if (!files) return shown;
  shown.text += "\n";
  shown.files = {{"compare.csv", ComparisonCsv(comparison)},
                 {"difference.png", DifferencePicture(comparison)}};
  if (comparison.space) {
    shown.files.emplace_back("compare_space.csv", SpaceCsv(*comparison.space));
  }
  return shown;
}

}  // namespace plenocal
