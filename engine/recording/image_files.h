// SPDX-License-Identifier: Apache-2.0
//
// Image files on the disk and in files that hold many.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "calib/files/frame_images.h"
#include "engine/recording/zip_archive.h"

namespace plenocal {

class ImageLister;

/// The images of globs, folders, files, zip archives, folders in archives ("archive.zip/left"),
/// videos and topics of recordings ("drive.mcap/left/image_raw"), by name (`NaturalLess`). Throws
/// `Error` of kind kInput, which begins with `what`, when there is none or two have the same name.
std::vector<FrameImage> FindImageFiles(const std::vector<std::string>& patterns,
                                       const std::string& what,
                                       ImageLister* lister);

/// Finds images by what other files call them: the frame's name, the file's name with folders and
/// extension, or the number without its zeros ("0007", "left/0007.png", "7").
class ImageIndex {
 public:
  /// Names of the images' frames and their files, by the same index.
  ImageIndex(const std::vector<std::string>& names,
             const std::vector<std::filesystem::path>& files);
  [[nodiscard]] std::optional<size_t> Find(const std::string& text) const;

 private:
  std::unordered_map<std::string, size_t> index_of_;
};

/// Folders of an archive that hold images; "" where they are in none.
std::vector<std::string> ImageFoldersIn(const ZipArchive& archive);

/// True for a name that ends in ".zip" or ".ZIP".
bool IsArchiveName(const std::filesystem::path& path);

/// Order of names in which numbers count by their value: "2" before "10".
bool NaturalLess(std::string_view a, std::string_view b);

}  // namespace plenocal
