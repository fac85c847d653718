// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/spec/spec_values.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "calib/base/error.h"
#include "calib/base/names.h"

namespace plenocal::simulate {
namespace {

void Set(const YamlNode& node, const SpecKey&, bool* value) { *value = node.AsBool(); }

void Set(const YamlNode& node, const SpecKey& key, double* value) {
  *value = NumberWithin(node, key.low, key.high);
}

void Set(const YamlNode& node, const SpecKey& key, int* value) {
  *value = node.AsInteger();
  if (*value < key.low || *value > key.high) {
    node.Fail(fmt::format("expected {:.0f} to {:.0f}, found {}", key.low, key.high, *value));
  }
}

template <typename T>
void Set(const YamlNode& node, const SpecKey& key, std::optional<T>* value) {
  Set(node, key, &value->emplace());
}

}  // namespace

std::filesystem::path PathBeside(const std::filesystem::path& spec, const YamlNode& node) {
  const std::string text = node.AsString();
  if (text.empty()) node.Fail("expected a path, found nothing");
  return spec.parent_path() / text;
}

double NumberWithin(const YamlNode& node, double low, double high) {
  const double value = node.AsNumber();
  if (value >= low && value <= high) return value;
  node.Fail(fmt::format("expected a number from {} to {}, found {}", low, high, value));
}

void ReadKeys(const YamlNode& node,
              std::initializer_list<SpecKey> keys,
              std::vector<std::string_view> others) {
  for (const SpecKey& key : keys) others.push_back(key.name);
  node.CheckKeys(others);
  for (const SpecKey& key : keys) {
    if (!node.Has(key.name)) continue;
    std::visit([&](auto* value) { Set(node.At(key.name), key, value); }, key.value);
  }
}

std::size_t ReadChoice(const YamlNode& node, std::span<const std::string_view> choices) {
  const std::string text = node.AsString();
  const auto found = std::ranges::find(choices, text);
  if (found != choices.end()) return static_cast<std::size_t>(found - choices.begin());
  node.Fail(fmt::format(
      "expected {}, found '{}'{}", fmt::join(choices, " or "), text, SuggestName(text, choices)));
}

void ReadFlags(const YamlNode& node, std::span<const SpecFlag> flags, std::string_view usual) {
  const std::vector<std::string_view> names = NamesOf(flags);
  const auto items = node.IsSequence() ? node.Elements() : std::vector{node};
  if (items.empty()) node.Fail(fmt::format("the list is empty; write {}", usual));
  for (const YamlNode& item : items) *flags[ReadChoice(item, names)].value = true;
}

}  // namespace plenocal::simulate
