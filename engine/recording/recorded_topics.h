// SPDX-License-Identifier: Apache-2.0
//
// Cameras of recordings of messages, by the topics of their images.
#pragma once

#include <filesystem>

#include "engine/recording/recording_file.h"

namespace plenocal {

/// A recording of messages: each topic of images is a camera, called after the part of the topic
/// in which it differs from others ("/left/image_raw" is left). Throws `Error` of kind kInput,
/// which names the topics, when none has images that can be read.
RecordingFile FindInMessages(const std::filesystem::path& path);

}  // namespace plenocal
