// SPDX-License-Identifier: Apache-2.0
#include "targets/reading.h"

#include <fmt/format.h>

#include <string>

#include "calib/base/error.h"

namespace plenocal::internal {

int ReadCount(const YamlNode& node, int least) {
  constexpr int kMost = 1000;
  const int count = node.AsInteger();
  if (count < least || count > kMost) {
    node.Fail(fmt::format("expected a number from {} to {}, got '{}'; count them on the target",
                          least,
                          kMost,
                          count));
  }
  return count;
}

Eigen::Vector3d ReadVector(const YamlNode& node) {
  const std::vector<double> numbers = node.AsNumbers(3);
  return {numbers[0], numbers[1], numbers[2]};
}

const CodeBook& ReadCodeBook(const YamlNode& node,
                             std::span<const CodeBook> books,
                             std::string_view what) {
  const std::string name = node.AsString();
  std::vector<std::string_view> names;
  for (const CodeBook& book : books) {
    if (book.name == name) return book;
    names.push_back(book.name);
  }
  node.Fail(fmt::format("expected {}, got '{}'{}", what, name, SuggestName(name, names)));
}

std::vector<std::string_view> KeyNames(std::span<const TargetKey> keys, std::string_view list) {
  std::vector<std::string_view> names;
  for (const TargetKey& key : keys) {
    const size_t dot = key.name.find('.');
    const bool of_list = dot != std::string_view::npos;
    const std::string_view owner = of_list ? key.name.substr(0, dot) : std::string_view();
    if (owner == list) names.push_back(of_list ? key.name.substr(dot + 1) : key.name);
  }
  return names;
}

}  // namespace plenocal::internal
