// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/plenoptic_inputs.h"

#include "calib/base/format_error.h"
#include "engine/recording/stores/image_lister.h"

namespace plenocal {

PlenopticSource FindPlenopticSource(const PlenopticInputs& inputs) {
  PlenopticSource source{.white_images = {},
                         .grid = inputs.grid,
                         .vignetting = inputs.vignetting,
                         .bayer = inputs.bayer};
  if (inputs.white.empty()) {
    if (!inputs.grid.empty()) return source;
    throw InputError(
        "the micro-image centres are missing; give white images with --white, or --grid "
        "micro_lenses.csv with --vignetting vignetting.tiff");
  }
  if (!inputs.vignetting.empty()) {
    throw InputError(
        "--vignetting: the white images give the attenuation already; leave one of --white and "
        "--vignetting out");
  }
  source.white_images = FindImageInputs(inputs.white, "white images");
  return source;
}

}  // namespace plenocal
