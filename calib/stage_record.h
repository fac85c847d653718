// SPDX-License-Identifier: Apache-2.0
//
// Numbers, texts and observations in a row of bytes, for entries of a `StageStore`: read by the
// program that wrote them, on the same machine.
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>

#include "calib/observation.h"

namespace plenocal {

class StageWriter {
 public:
  template <typename T>
  requires std::is_arithmetic_v<T>
  void Put(T number) { text_.append(reinterpret_cast<const char*>(&number), sizeof number); }
  void Put(std::string_view text) {
    Put(static_cast<std::uint64_t>(text.size()));
    text_.append(text);
  }
  void Put(const Observation& seen) {
    Put(seen.marker);
    for (const double value : seen.values) Put(value);
    Put(seen.sigma);
    Put(seen.kind);
  }
  /// A list's length, then what `put` writes of each item.
  template <typename List, typename Function>
  void PutAll(const List& list, const Function& put) {
    Put(static_cast<std::uint64_t>(list.size()));
    for (const auto& item : list) put(item);
  }
  [[nodiscard]] const std::string& Text() const { return text_; }

 private:
  std::string text_;
};

class StageReader {
 public:
  explicit StageReader(std::string_view text) : rest_(text) {}

  template <typename T>
  T Get() {
    T value{};
    if constexpr (std::is_same_v<T, Observation>) {
      value.marker = Get<int>();
      for (double& number : value.values) number = Get<double>();
      value.sigma = Get<double>();
      value.kind = Get<int>();
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
  /// Calls `get` for each item of a list, until the bytes end.
  template <typename Function>
  void GetAll(const Function& get) {
    for (auto count = Get<std::uint64_t>(); count > 0 && good_; --count) get();
  }
  /// Whether all that was asked for was there and nothing is left.
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
