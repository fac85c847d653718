// SPDX-License-Identifier: Apache-2.0
//
// Image files on the disk and in zip archives.
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "apps/recording/zip_archive.h"

namespace plenocal {

/// Where a camera's images are. Its functions may be called from several threads.
class ImageSource {
 public:
  ImageSource() = default;
  virtual ~ImageSource() = default;
  ImageSource(const ImageSource&) = delete;
  ImageSource& operator=(const ImageSource&) = delete;

  /// The content of an image file. Throws `Error` of kind kInput.
  [[nodiscard]] virtual std::vector<unsigned char> Bytes(size_t index) const = 0;
  /// Its first `most` bytes, or all of a shorter one.
  [[nodiscard]] virtual std::vector<unsigned char> Start(size_t index, size_t most) const = 0;
  /// The file, for messages: "left/0001.png", "images.zip/0001.png".
  [[nodiscard]] virtual std::string Place(size_t index) const = 0;
};

/// An image file.
struct ImageFile {
  std::string name;            ///< as `ExpandImages` gives it, of an archive the file's stem
  std::filesystem::path path;  ///< in an archive "archive.zip/folder/file"
  std::shared_ptr<const ZipArchive> archive = {};  ///< null: on the disk
  size_t entry = 0;                                ///< in the archive
};

/// The image files of globs, folders, files, zip archives and folders in archives
/// ("archive.zip/left"), by name (`NaturalLess`). Throws `Error` of kind kInput, which begins with
/// `what`, when there is none or two have the same name.
std::vector<ImageFile> FindImageFiles(const std::vector<std::string>& patterns,
                                      const std::string& what);

/// The source of these files, by the same index.
std::shared_ptr<const ImageSource> MakeImageSource(std::vector<ImageFile> files);

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
