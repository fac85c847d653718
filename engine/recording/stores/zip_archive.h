// SPDX-License-Identifier: Apache-2.0
//
// Zip archives of images, read in place, and of results.
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "calib/files/frame_images.h"
#include "calib/io/output_folder.h"

struct zip;

namespace plenocal {

/// A zip archive, of which files are read one by one. It may be larger than the memory. The index
/// of an image is that of its file.
class ZipArchive : public ImageStore {
 public:
  /// Opens the archive and reads its directory. Throws `Error` of kind kInput for a file that is
  /// missing or no zip archive.
  explicit ZipArchive(const std::filesystem::path& path);

  [[nodiscard]] const std::filesystem::path& Path() const { return path_; }
  /// Names of the files, folders before them ("left/0001.png"), in the order of the archive.
  [[nodiscard]] const std::vector<std::string>& Names() const { return names_; }
  /// Throws `Error` of kind kInput, naming archive and file, for one that is damaged or encrypted.
  [[nodiscard]] StoredImage Read(size_t file) const override;
  [[nodiscard]] StoredImage Start(size_t file, size_t most) const override;
  [[nodiscard]] std::string Hash(size_t file) const override;
  /// "archive.zip/left/0001.png", for messages.
  [[nodiscard]] std::string Place(size_t file) const;

 private:
  struct Close {
    void operator()(zip* archive) const;
  };
  std::filesystem::path path_;
  std::unique_ptr<zip, Close> archive_;
  std::vector<std::string> names_;
  std::vector<size_t> indices_;  // of the names in the archive
  mutable std::mutex mutex_;     // libzip reads one file at a time
};

/// True for a name that ends in ".zip" or ".ZIP".
bool IsArchiveName(const std::filesystem::path& path);

/// Folders of an archive that hold images; "" where they are in none.
std::vector<std::string> ImageFoldersIn(const ZipArchive& archive);

/// The images in a zip archive by name, or in one folder of it; the frame of each is its file's
/// stem. Throws `Error` of kind kInput, which begins with `what`, when there is none.
std::vector<FrameImage> ZipImages(const std::filesystem::path& archive,
                                  const std::string& folder,
                                  const std::string& what);

/// A zip archive of these files, in memory. Equal files give equal bytes, on every day and in every
/// time zone.
std::string ZipBytes(const OutputContents& files);

}  // namespace plenocal
