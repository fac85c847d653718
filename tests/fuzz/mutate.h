// SPDX-License-Identifier: Apache-2.0
//
// Changes of the files of a session by their meaning: other numbers, units, rows and images, which
// a reader mostly accepts. What is behind the readers is tested by them.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace plenocal::fuzz {

/// Names of files, with folders, and contents.
using Files = std::map<std::string, std::string>;

/// Choices that an input, which must outlive them, makes: two bytes each; 0 after its end.
class Choices {
 public:
  explicit Choices(std::string_view input) : left_(input) {}

  [[nodiscard]] bool Empty() const { return left_.size() < 2; }
  /// A number below `count`.
  size_t Below(size_t count);

 private:
  std::string_view left_;
};

/// Changes files of these names, until the choices or eight changes are made.
void Mutate(const std::vector<std::string>& names, Choices* choices, Files* files);

}  // namespace plenocal::fuzz
