// SPDX-License-Identifier: Apache-2.0
//
// Detections and other intermediate results that take long to compute, kept between runs: a later
// run uses those whose inputs have not changed.
#pragma once

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <initializer_list>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>

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

// Numbers and texts as bytes, for entries of the cache: read by the program that wrote them, on the
// same machine.

class CacheEntryWriter {
 public:
  template <typename T>
  requires std::is_arithmetic_v<T>
  void Put(T number) { text_.append(reinterpret_cast<const char*>(&number), sizeof number); }
  void Put(std::string_view text) {
    Put(static_cast<std::uint64_t>(text.size()));
    text_.append(text);
  }
  /// The length of a list, then each item by `put`.
  template <typename List, typename Function>
  void PutAll(const List& list, const Function& put) {
    Put(static_cast<std::uint64_t>(list.size()));
    for (const auto& item : list) put(item);
  }
  [[nodiscard]] const std::string& Text() const { return text_; }

 private:
  std::string text_;
};

class CacheEntryReader {
 public:
  explicit CacheEntryReader(std::string_view text) : rest_(text) {}

  /// The next number or text; zero or empty where the bytes end before.
  template <typename T>
  T Get() {
    T value{};
    if constexpr (std::is_same_v<T, bool>) {
      value = Get<unsigned char>() != 0;  // no other byte may become a bool
    } else if constexpr (std::is_arithmetic_v<T>) {
      if (Has(sizeof value)) std::memcpy(&value, rest_.data(), sizeof value);
      Skip(sizeof value);
    } else {
      const auto size = Get<std::uint64_t>();
      if (Has(size)) value = T(rest_.substr(0, size));
      Skip(size);
    }
    return value;
  }
  /// Calls `get` for each item of a list, at most until the bytes end.
  template <typename Function>
  void GetAll(const Function& get) {
    for (auto count = Get<std::uint64_t>(); count > 0 && good_; --count) get();
  }
  /// True when every item could be read and no bytes are left.
  [[nodiscard]] bool IsComplete() const { return good_ && rest_.empty(); }

 private:
  [[nodiscard]] bool Has(std::uint64_t size) const { return good_ && size <= rest_.size(); }
  void Skip(std::uint64_t size) {
    good_ = Has(size);
    if (good_) rest_.remove_prefix(size);
  }

  std::string_view rest_;
  bool good_ = true;
};

}  // namespace plenocal
