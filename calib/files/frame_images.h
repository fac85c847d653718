// SPDX-License-Identifier: Apache-2.0
//
// Lists of a camera's images from globs, folders and files.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "calib/files/image_store.h"

namespace plenocal {

/// An image and the frame that it belongs to.
struct FrameImage {
  std::string frame;
  std::filesystem::path path;  ///< of an image in a store its place there, for messages
  std::shared_ptr<const ImageStore> store = {};  ///< null: an image file
  size_t index = 0;                              ///< in the store
  std::optional<double> time = {};               ///< s
};

/// True for a name that ends as one of an image does (".png", ".JPG"), and is not hidden.
bool HasImageName(const std::filesystem::path& path);

/// The image files of a folder, or the files that match a glob, sorted by name. The frame of each
/// is the part of its path that matches the last `*`; of a folder, or for a pattern without `*`,
/// the file's name without extension. Throws `Error` when nothing matches or two files have the
/// same frame; `what` ("left: images") begins the message.
std::vector<FrameImage> ExpandImages(const std::string& pattern, const std::string& what);
/// The images of several globs, folders and files, one after the other.
std::vector<FrameImage> ExpandImages(const std::vector<std::string>& patterns,
                                     const std::string& what);

}  // namespace plenocal
