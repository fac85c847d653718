// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/spec_values.h"

namespace plenocal::simulate {

std::filesystem::path PathBeside(const std::filesystem::path& spec, const YamlNode& node) {
  const std::string text = node.AsString();
  if (text.empty()) node.Fail("expected a path, found nothing");
  return spec.parent_path() / text;
}

void ReadNumber(
    const YamlNode& node, std::string_view key, double low, double high, double* value) {
  if (!node.Has(key)) return;
  const YamlNode number = node.At(key);
  *value = number.AsNumber();
  if (!(*value >= low && *value <= high)) {
    number.Fail(fmt::format("expected a number from {} to {}, found {}", low, high, *value));
  }
}

void ReadInteger(const YamlNode& node, std::string_view key, int low, int high, int* value) {
  if (!node.Has(key)) return;
  const YamlNode number = node.At(key);
  *value = number.AsInteger();
  if (*value < low || *value > high) {
    number.Fail(fmt::format("expected {} to {}, found {}", low, high, *value));
  }
}

}  // namespace plenocal::simulate
