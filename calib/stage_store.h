// SPDX-License-Identifier: Apache-2.0
//
// Results of stages that take long, kept between runs: a later run takes over those whose inputs
// are the same.
#pragma once

#include <filesystem>
#include <initializer_list>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <string_view>

namespace plenocal {

/// Hash of a file's content (XXH3, 128 bits, hexadecimal); empty when it cannot be read.
std::string HashFile(const std::filesystem::path& path);

/// A folder of entries, each written under another name first and renamed, with a checksum inside:
/// one that was cut off or damaged counts as absent. May be used from several threads. A store that
/// cannot be written (full disk) keeps nothing and says nothing: it only saves time.
class StageStore {
 public:
  /// `program` says by which program the entries are made; `fresh` takes over nothing from earlier
  /// runs. The folder is made when there is something to keep; without a name nothing is kept.
  StageStore(std::filesystem::path folder, std::string program, bool fresh);

  /// The key of a stage's result by all that decides it. Empty, the key that is never kept, when
  /// one of the parts is empty (an input that cannot be read).
  [[nodiscard]] std::string Key(std::initializer_list<std::string_view> parts) const;

  std::optional<std::string> Load(const std::string& key);
  void Save(const std::string& key, const std::string& content);
  /// Removes the entries that this object neither loaded nor saved, and what killed runs left.
  void RemoveUnused();

 private:
  std::filesystem::path folder_;
  std::string program_;
  bool fresh_;
  std::mutex mutex_;
  std::set<std::string> used_;
};

}  // namespace plenocal
