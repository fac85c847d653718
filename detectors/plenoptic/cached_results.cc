// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/cached_results.h"

#include <algorithm>

namespace plenocal::internal {

std::optional<MicroLensCalibration> UnpackMicroLenses(const std::string& bytes) {
  auto micro_lenses = UnpackEntry<MicroLensCalibration>(bytes);
  if (!micro_lenses) return std::nullopt;
  const MicroLensArray& array = micro_lenses->array;
  const auto [width, height] = array.image_size;
  // The types are indices.
  const bool good = width > 0 && height > 0 && array.types <= kMostLensTypes &&
                    micro_lenses->attenuation.size() / static_cast<size_t>(width) ==
                        static_cast<size_t>(height) &&
                    micro_lenses->attenuation.size() % static_cast<size_t>(width) == 0 &&
                    std::ranges::all_of(array.lenses, [&](const MicroLens& lens) {
                      return lens.type >= 0 && lens.type < array.types;
                    });
  return good ? std::move(micro_lenses) : std::nullopt;
}

}  // namespace plenocal::internal
