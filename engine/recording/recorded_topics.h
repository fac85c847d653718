// SPDX-License-Identifier: Apache-2.0
//
// Finds the cameras in recordings of messages by the topics of their images.
#pragma once

#include <filesystem>

#include "engine/recording/recording_file.h"

namespace plenocal {

/// Opens a recording of messages. Each topic of images is a camera, named by the part of the topic
/// in which it differs from others ("/left/image_raw" is left). Throws `Error` of kind kInput with
/// all topics if none has images that can be read.
RecordingFile FindInMessages(const std::filesystem::path& path);

}  // namespace plenocal
