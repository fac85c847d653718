// SPDX-License-Identifier: Apache-2.0
//
// The images of a session's cameras, with frames that are named by time where they have times.
#pragma once

#include <string>
#include <vector>

#include "calib/files/frame_images.h"
#include "calib/files/session.h"

namespace plenocal {

/// The images of each camera of a session, none where it has detections. Images that all have times
/// (recordings, videos) get the names of frames by time, that of the first camera with an image.
/// `notes` receives whole sentences on what is unusual, and on the pairing. Throws `Error` of kind
/// kInput.
std::vector<std::vector<FrameImage>> ListSessionImages(const Session& session,
                                                       std::vector<std::string>* notes);

}  // namespace plenocal
