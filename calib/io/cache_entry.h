// SPDX-License-Identifier: Apache-2.0
//
// Results as bytes, for entries of the detection cache: read by the program that wrote them, on the
// same machine.
//
// Numbers, texts, lists, tuples and Eigen's matrices are known. For a struct a function beside it
// names its members, once for both directions:
//   template <MaybeConst<Pose> T>
//   auto EntryMembers(T& pose) { return std::tie(pose.R, pose.t); }
#pragma once

#include <concepts>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>

#include "calib/io/detection_cache.h"

namespace plenocal {

template <typename T, typename Of>
concept MaybeConst = std::same_as<std::remove_const_t<T>, Of>;

namespace internal {

template <typename T>
concept HasEntryMembers = requires(T& value) {
  EntryMembers(value);
};
template <typename T>
concept IsTupleLike = requires {
  std::tuple_size<T>::value;
};
template <typename T>
concept IsMatrix = requires(T& value) {
  value.reshaped();
};
/// A list whose items lie in memory one after the other, each a number.
template <typename T>
concept IsListOfNumbers = std::is_arithmetic_v<typename T::value_type> && requires(T& value) {
  value.data();
};

class CacheEntryWriter {
 public:
  template <typename T>
  void Put(const T& value) {
    const auto put = [&](const auto&... items) { (Put(items), ...); };
    if constexpr (std::is_arithmetic_v<T>) {
      Append(&value, sizeof value);
    } else if constexpr (HasEntryMembers<const T>) {
      std::apply(put, EntryMembers(value));
    } else if constexpr (IsTupleLike<T>) {
      std::apply(put, value);
    } else if constexpr (IsMatrix<const T>) {
      for (const auto number : value.reshaped()) Put(number);
    } else {
      Put(static_cast<std::uint64_t>(value.size()));
      if constexpr (IsListOfNumbers<T>) {
        Append(value.data(), value.size() * sizeof *value.data());
      } else {
        for (const auto& item : value) Put(item);
      }
    }
  }
  [[nodiscard]] const std::string& Text() const { return text_; }

 private:
  void Append(const void* bytes, std::size_t size) {
    text_.append(static_cast<const char*>(bytes), size);
  }

  std::string text_;
};

class CacheEntryReader {
 public:
  explicit CacheEntryReader(std::string_view text) : rest_(text) {}

  /// The next value; what lies behind the end of the bytes is zero or empty.
  template <typename T>
  void Get(T& value) {
    const auto get = [&](auto&... items) { (Get(items), ...); };
    if constexpr (std::is_same_v<T, bool>) {
      unsigned char byte = 0;
      Get(byte);
      value = byte != 0;  // no other byte may become a bool
    } else if constexpr (std::is_arithmetic_v<T>) {
      Take(&value, 1);
    } else if constexpr (HasEntryMembers<T>) {
      std::apply(get, EntryMembers(value));
    } else if constexpr (IsTupleLike<T>) {
      std::apply(get, value);
    } else if constexpr (IsMatrix<T>) {
      for (auto& number : value.reshaped()) Get(number);
    } else {
      std::uint64_t count = 0;
      Get(count);
      if constexpr (IsListOfNumbers<T>) {
        good_ = good_ && count <= rest_.size() / sizeof *value.data();
        if (good_) value.resize(count);
        Take(value.data(), value.size());
      } else {
        for (; count > 0 && good_; --count) Get(value.emplace_back());
      }
    }
  }
  /// True when every item could be read and no bytes are left.
  [[nodiscard]] bool IsComplete() const { return good_ && rest_.empty(); }

 private:
  template <typename T>
  void Take(T* numbers, std::size_t count) {
    good_ = good_ && count * sizeof(T) <= rest_.size();
    if (!good_ || count == 0) return;
    std::memcpy(numbers, rest_.data(), count * sizeof(T));
    rest_.remove_prefix(count * sizeof(T));
  }

  std::string_view rest_;
  bool good_ = true;
};

}  // namespace internal

template <typename T>
std::string PackEntry(const T& value) {
  internal::CacheEntryWriter writer;
  writer.Put(value);
  return writer.Text();
}

/// Nothing for bytes that are no complete entry.
template <typename T>
std::optional<T> UnpackEntry(std::string_view text) {
  internal::CacheEntryReader reader(text);
  T value;
  reader.Get(value);
  return reader.IsComplete() ? std::optional(std::move(value)) : std::nullopt;
}

/// The entry of a key; nothing where there is none, or a damaged one.
template <typename T>
std::optional<T> LoadEntry(DetectionCache& cache, const std::string& key) {
  const std::optional<std::string> kept = cache.Load(key);
  return kept ? UnpackEntry<T>(*kept) : std::nullopt;
}

}  // namespace plenocal
