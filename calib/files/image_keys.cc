// SPDX-License-Identifier: Apache-2.0
#include "calib/files/image_keys.h"

#include <fmt/format.h>

#include "calib/base/error.h"

namespace plenocal {

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

BayerOrder ReadBayerOrder(const YamlNode& node) {
  const std::string name = node.AsString();
  if (const std::optional<BayerOrder> order = ParseBayerOrder(name)) return *order;
  node.Fail(fmt::format("expected the colours of the top-left 2 x 2 pixels, found '{}'{}",
                        name,
                        SuggestName(name, kBayerOrders)));
}

}  // namespace plenocal
