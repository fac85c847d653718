// SPDX-License-Identifier: Apache-2.0
#include "targets/reading.h"

#include <fmt/format.h>

#include <string>

#include "calib/base/error.h"
#include "calib/base/number_text.h"

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

double ReadPrintedLength(const YamlNode& node) {
  constexpr double kLongest = 2, kShortest = 1e-4;                // m
  constexpr double kLargestTarget = 1e3, kSmallestTarget = 1e-8;  // m; sums of them are finite
  if (node.IsScalar() && node.AsString() == kUnknown) return 1;
  const double length = node.AsLength();
  const std::string number = node.AsString();
  if (ParseLength(number)->has_unit && (length < kSmallestTarget || length > kLargestTarget)) {
    node.Fail(fmt::format("expected a length from 10 nm to 1000 m, got '{}'; correct it", number));
  }
  if ((length >= kShortest && length <= kLongest) || ParseLength(number)->has_unit) return length;
  if (length < kShortest) {
    node.Fail(
        fmt::format("{} m, which is {:.4g} mm? if {:.4g} mm are meant, write {:.4g} mm; if "
                    "not, write {:.4g} mm",
                    number,
                    1e3 * length,
                    1e6 * length,
                    1e6 * length,
                    1e3 * length));
  }
  constexpr double kFewMillimetres = 10;  // then centimetres are as likely
  node.Fail(fmt::format(
      "{0} m? if millimetres are meant, write {0} mm{1}; if metres, write {0} m",
      number,
      length < kFewMillimetres ? fmt::format("; if centimetres, {} cm", number) : std::string()));
}

Eigen::Vector3d ReadVector(const YamlNode& node) {
  const std::vector<double> numbers = node.AsSignedLengths(3);
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
