// SPDX-License-Identifier: Apache-2.0
//
// Sub-aperture and refocused images of one raw plenoptic image, from files to the content of result
// files. No OpenCV type here: the command line includes this header without it.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "detectors/plenoptic/plenoptic_source.h"

namespace plenocal {

/// A plane on which a refocused image is sharp.
struct RefocusPlane {
  double virtual_depth = 0;             ///< docs/plenoptic.md; by micro-image centres
  std::optional<double> distance = {};  ///< m, of a calibrated camera
};

struct ViewsRequest {
  std::filesystem::path raw_image;
  PlenopticSource camera;
  int views = 5;        ///< sub-aperture images along either axis
  double radius = 0.3;  ///< of the outermost ones from the middle of the micro images, pitches
  double step = 2;      ///< raw px a pixel of the results
  /// Empty: three virtual depths of the image where its depth can be estimated, else (an unfocused
  /// camera) five around the micro lenses.
  std::vector<RefocusPlane> planes = {};
  int threads = 0;  ///< 0: all cores
  std::function<void(const std::string&)> message;
};

struct ViewsResult {
  std::map<std::string, std::string> files;  ///< name -> content
  std::string summary;                       ///< one line
};

/// Throws `Error` with the file or the reason.
ViewsResult MakeViews(const ViewsRequest& request);

}  // namespace plenocal
