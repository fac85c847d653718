// SPDX-License-Identifier: Apache-2.0
//
// Images wherever they are: files, and files that hold many.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "calib/files/frame_images.h"
#include "engine/recording/stores/message_log.h"

namespace plenocal {

/// Lists images of several cameras; a recording that many of them share is read once.
class ImageLister {
 public:
  /// The images of globs, folders, files, videos, archives ("images.zip/left"), and topics of
  /// recordings ("drive.mcap/left/image_raw"). Throws `Error` of kind kInput, which begins with
  /// `what`, when there is none or two belong to one frame.
  std::vector<FrameImage> List(const std::vector<std::string>& patterns, const std::string& what);

  /// A recording that is open already.
  void Use(std::shared_ptr<const MessageLog> log);

  /// Notes on what is unusual in the recordings so far, in whole sentences.
  [[nodiscard]] const std::vector<std::string>& Notes() const { return notes_; }

 private:
  std::vector<FrameImage> InRecording(const std::filesystem::path& path, const std::string& topic);

  std::map<std::filesystem::path, std::shared_ptr<const MessageLog>> logs_;
  std::vector<std::string> notes_;
};

/// The same of one camera, whose notes nobody reads.
std::vector<FrameImage> ListImages(const std::vector<std::string>& patterns,
                                   const std::string& what);

/// The images of words that a user gives: each a file, a glob or a folder with images. `what`
/// ("white images") is used in messages. Throws `Error` of kind kInput when an argument matches
/// nothing.
std::vector<FrameImage> FindImageInputs(const std::vector<std::string>& inputs,
                                        const std::string& what);

/// True for the name of a recording, a video or an archive.
bool IsStoreName(const std::filesystem::path& path);

/// The recording, video or archive that a pattern begins with, and what follows in it; `file` is
/// empty for a pattern of image files.
struct StorePattern {
  std::filesystem::path file;
  std::string part;
};
StorePattern SplitStorePattern(const std::filesystem::path& pattern);

}  // namespace plenocal
