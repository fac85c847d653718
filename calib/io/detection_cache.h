// SPDX-License-Identifier: Apache-2.0
//
// Detections and other intermediate results that take long to compute, kept between runs: a later
// run uses those whose inputs have not changed.
#pragma once

#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>

namespace plenocal {

/// Hash of a file's content (XXH3, 128 bits, hexadecimal); empty when it cannot be read.
std::string HashFile(const std::filesystem::path& path);
/// `HashFile` of bytes in memory.
std::string HashBytes(std::span<const std::uint8_t> bytes);

/// A folder with one file per entry. A file is written under a temporary name and renamed, and
/// holds a checksum: a truncated or damaged one counts as absent. May be used from several threads.
/// When the folder cannot be written (full disk), nothing is kept and nothing is reported, since
/// the cache only saves time.
class DetectionCache {
 public:
  /// `program` identifies the program that makes the entries; `fresh` ignores those of earlier
  /// runs. The folder is made with its first entry; an empty `folder` keeps nothing.
  DetectionCache(std::filesystem::path folder, std::string program, bool fresh);

  /// Key of a result from everything that it depends on. Empty, a key under which nothing is kept,
  /// when one of the parts is empty (an input that cannot be read).
  [[nodiscard]] std::string Key(std::initializer_list<std::string_view> parts) const;

  std::optional<std::string> Load(const std::string& key);
  void Save(const std::string& key, const std::string& content);
  /// Removes the entries that this object neither loaded nor saved, and the temporary files of
  /// killed runs; nothing else, and nothing where the folder is a symbolic link.
  void RemoveUnused();

 private:
  std::filesystem::path folder_;
  std::string program_;
  bool fresh_;
  std::mutex mutex_;
  std::set<std::string> used_;
};

}  // namespace plenocal
