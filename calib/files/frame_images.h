// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace plenocal {

/// An image file and the frame that it belongs to.
struct FrameImage {
  std::string frame;
  std::filesystem::path path;
};

/// The files that match a glob, sorted by name. The frame of each is the part of its path that
/// matches the last `*`, or the file's name without extension for a pattern without `*`. Throws
/// `Error` when nothing matches or two files have the same frame; `what` ("left: images") begins
/// the message.
std::vector<FrameImage> ExpandImages(const std::string& pattern, const std::string& what);

}  // namespace plenocal
