// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <limits>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

struct zip;

namespace plenocal {

/// A zip archive, of which files are read in place, one by one. It may be larger than the memory.
/// Its functions may be called from several threads.
class ZipArchive {
 public:
  /// Opens the archive and reads its directory. Throws `Error` of kind kInput for a file that is
  /// missing or no zip archive.
  explicit ZipArchive(const std::filesystem::path& path);

  [[nodiscard]] const std::filesystem::path& Path() const { return path_; }
  /// Names of the files, folders before them ("left/0001.png"), in the order of the archive.
  [[nodiscard]] const std::vector<std::string>& Names() const { return names_; }
  /// The first `most` bytes of a file, or all of a shorter one. Throws `Error` of kind kInput,
  /// naming archive and file, for one that is damaged or encrypted.
  [[nodiscard]] std::vector<unsigned char> Read(
      size_t file, size_t most = std::numeric_limits<size_t>::max()) const;
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

}  // namespace plenocal
