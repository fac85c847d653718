// SPDX-License-Identifier: Apache-2.0
//
// Exposures of the cameras of a frame against each other: cameras that are to share one exposure
// time can take it over late. J. Engel's photometric model I = G(t V E): what two cameras see of a
// matt point has one E.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "calib/base/run.h"
#include "engine/recording/recording.h"

namespace plenocal {

/// Exposure of one image against that of the first camera's image of its frame.
struct RelativeExposure {
  std::string frame, camera;
  double recorded = 0;  ///< ms; NaN: not known
  /// ln of the light per recorded exposure over that of the first camera, less the recording's
  /// median of this camera: 0 where the recorded exposures are right.
  double log_ratio = 0;
  double sigma = 0;   ///< of `log_ratio`
  size_t points = 0;  ///< that both images show
  bool differs = false;

  /// The exposure that the image shows, ms; the recorded one where it does not differ; NaN: not
  /// known.
  [[nodiscard]] double Exposure() const;
};

struct FrameExposures {
  /// By camera, then frame; the first camera's exposures are taken as recorded.
  std::vector<RelativeExposure> images;
  std::vector<std::string> warnings;
  std::vector<LeftOut> left_out;  ///< frames without a comparison
};

/// Compares the brightness of scene points that two cameras of a frame show; each camera's
/// `response` and `vignetting` of the recording are applied. `done` is called before each frame; it
/// may throw.
///
/// Throws `Error` of kind kInput for a recording of a single camera or a response that does not fit
/// the images; of kind kJob when no frame has points in common.
FrameExposures CompareExposures(const Recording& recording,
                                int threads,
                                const std::function<void(size_t done, size_t total)>& done);

/// exposures.csv: frame, camera, exposure_ms, relative, sigma; of all cameras. A recording.yaml
/// reads it by `exposures`.
std::string FrameExposuresCsv(const Recording& recording, const FrameExposures& exposures);

/// The same of a run: compares, writes exposures.csv into the folder `out`, if one is given, and
/// returns the result in words.
std::string MeasureExposures(const Recording& recording,
                             const std::filesystem::path& out,
                             const Run& run);

}  // namespace plenocal
