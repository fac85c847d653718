// SPDX-License-Identifier: Apache-2.0
#include "calib/files/image_keys.h"

#include <fmt/format.h>

#include <array>

#include "calib/base/error.h"
#include "calib/files/pairing_key.h"

namespace plenocal {
namespace {

Pairing::By ReadBy(const YamlNode& node) {
  const std::string by = node.AsString();
  if (by == "name") return Pairing::By::kName;
  if (by == "time") return Pairing::By::kTime;
  static constexpr std::array<std::string_view, 2> kKnown{"name", "time"};
  node.Fail(fmt::format("unknown '{}'{}", by, SuggestName(by, kKnown)));
}

}  // namespace

std::string PathBeside(const std::filesystem::path& file, const YamlNode& node) {
  const std::string text = node.AsString();
  if (text.empty()) node.Fail("expected a path, found nothing");
  return (file.parent_path() / text).string();
}

std::vector<std::string> PathsBeside(const std::filesystem::path& file, const YamlNode& node) {
  if (!node.IsSequence()) return {PathBeside(file, node)};
  std::vector<std::string> paths;
  for (const YamlNode& element : node.Elements()) paths.push_back(PathBeside(file, element));
  if (paths.empty()) node.Fail("expected a glob, a folder or a list of files, got an empty list");
  return paths;
}

std::vector<std::string> ReadImagePatterns(const std::filesystem::path& file,
                                           const YamlNode& camera) {
  std::vector<std::string> patterns = PathsBeside(file, camera.At("images"));
  if (!camera.Has("topic")) return patterns;
  std::string topic = camera.At("topic").AsString();
  topic.erase(0, topic.find_first_not_of('/'));
  if (topic.empty())
    camera.At("topic").Fail("expected the name of a topic, such as /left/image_raw");
  for (std::string& pattern : patterns) pattern = (std::filesystem::path(pattern) / topic).string();
  return patterns;
}

Pairing ReadPairing(const YamlNode& node) {
  node.CheckKeys({"by", "tolerance"});
  Pairing pairing;
  if (node.Has("by")) pairing.by = ReadBy(node.At("by"));
  if (node.Has("tolerance")) {
    if (pairing.by == Pairing::By::kName) {
      node.At("tolerance").Fail("is of pairing by time, but 'by' is 'name'; remove one of them");
    }
    pairing.tolerance = node.At("tolerance").AsPositive();
  }
  return pairing;
}

BayerOrder ReadBayerOrder(const YamlNode& node) {
  const std::string name = node.AsString();
  if (const std::optional<BayerOrder> order = ParseBayerOrder(name)) return *order;
  node.Fail(fmt::format("expected the colours of the top-left 2 x 2 pixels, found '{}'{}",
                        name,
                        SuggestName(name, kBayerOrders)));
}

}  // namespace plenocal
