// SPDX-License-Identifier: Apache-2.0
//
// Sub-aperture and refocused images of a raw plenoptic image.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "calib/base/run.h"
#include "detectors/plenoptic/views/view_images.h"
#include "engine/recording/plenoptic_inputs.h"

namespace plenocal {

/// Without `camera`, `planes`, `threads` and `message` of the other request.
struct ViewFilesRequest : ViewsRequest {
  PlenopticInputs lenses;
  std::filesystem::path calibration;  ///< calibration.yaml; empty: none
  std::string camera_name;            ///< of it; empty: the only plenoptic one
  /// At which refocused images are sharp: m, of a calibrated camera, and virtual depths; both
  /// empty: three virtual depths of the image.
  std::vector<double> distances, depths;
  std::filesystem::path out;  ///< folder for the results; empty: none is written
};

/// Throws `Error`, and `Stopped`.
ViewsResult MakeViews(ViewFilesRequest request, const Run& run);

}  // namespace plenocal
