// SPDX-License-Identifier: Apache-2.0
//
// Choice of the frames of a long recording that lower the uncertainty of a calibration most.
#pragma once

#include <string>
#include <vector>

#include "calib/base/run.h"
#include "calib/camera/observation.h"
#include "calib/files/frame_images.h"
#include "calib/files/session.h"
#include "calib/io/detection_cache.h"
#include "targets/target.h"

namespace plenocal {

/// The images of one camera; empty where the session has none.
struct CameraImages {
  std::vector<FrameImage> images, white;
};

/// Images that are left out, and chosen_frames.csv; empty: all frames are kept.
struct FrameChoice {
  std::vector<LeftOut> left_out;
  std::string table;
};

/// Keeps in `cameras` the images of the frames that are chosen, at most
/// `Session::frames`. Of frames that follow each other the one is taken whose target moves least
/// and is sharpest; of these, the ones that lower the standard error of the projection most.
/// Without a number, recordings and videos of more than 200 frames keep 100. The target is detected
/// in all images; detections stay in the cache.
FrameChoice ChooseFrames(const Session& session,
                         const Target& target,
                         DetectionCache* cache,
                         const Run& run,
                         std::vector<CameraImages>* cameras);

}  // namespace plenocal
