// SPDX-License-Identifier: Apache-2.0
//
// Images of one camera, resampled into an output folder.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "calib/base/run.h"
#include "calib/camera/bayer.h"
#include "calib/files/calibration_record.h"
#include "calib/files/frame_images.h"
#include "calib/io/output_folder.h"
#include "engine/resample/pixel_map.h"

namespace plenocal {

/// How images are resampled.
struct ResampleSettings {
  std::string interpolation = "linear";  ///< one of `kInterpolations`
  std::optional<BayerOrder> bayer;       ///< of raw mosaics
  bool keep_vignetting = false;          ///< do not remove the vignetting that the calibration has
  /// pcalib.txt of a response that is to be undone, of all cameras, or NAME=pcalib.txt of one.
  std::vector<std::string> photometric;
  bool mask = false;  ///< write mask.png: the pixels that have a source
};

/// Throws `Error` of kind kInput when the results of two images would have one name, which ends in
/// `suffix`, or that of an image would be the `mask` of the results.
void CheckImageNames(const std::vector<FrameImage>& images,
                     const std::string& suffix = ".png",
                     bool mask = false);

/// Throws the `Error` of the first image unless one of them can be read and has this size: a map
/// for a wrong size, which may be far larger, is not computed.
void CheckImageSizes(const std::vector<FrameImage>& images, ImageSize size);

/// How the images of `camera`, one of `calibration`, are resampled.
struct FolderResampling {
  const CalibrationRecord& calibration;
  const CalibratedCamera& camera;
  const PixelMap& map;
  const ResampleSettings& settings;
  std::string prefix;                                  ///< of the names in the folder
  std::map<std::string, std::string>* keep = nullptr;  ///< the PNG of each frame; null: not kept
};

/// Writes `<prefix><frame>.png` of each image into `out`. Returns the number of images written.
/// Throws `Error`: of kind kInput when `photometric` names the responses of other cameras only; and
/// `Stopped`.
size_t ResampleToFolder(const std::vector<FrameImage>& images,
                        const FolderResampling& resampling,
                        const Run& run,
                        OutputFolder* out);

}  // namespace plenocal
