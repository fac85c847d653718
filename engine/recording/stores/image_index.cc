// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/stores/image_index.h"

#include <algorithm>
#include <cctype>

namespace plenocal {
namespace {

namespace fs = std::filesystem;

/// A name that is a number loses its leading zeros; other names stay.
std::string NumberKey(const std::string& name) {
  const bool number = !name.empty() && std::ranges::all_of(name, [](unsigned char c) {
    return std::isdigit(c) != 0;
  });
  return number ? name.substr(std::min(name.find_first_not_of('0'), name.size() - 1)) : name;
}

}  // namespace

ImageIndex::ImageIndex(const std::vector<FrameImage>& images) {
  for (size_t i = 0; i < images.size(); ++i) index_of_.emplace(images[i].frame, i);
  for (size_t i = 0; i < images.size(); ++i) index_of_.emplace(images[i].path.stem().string(), i);
  for (size_t i = 0; i < images.size(); ++i) {
    index_of_.emplace(NumberKey(images[i].frame), i);
    index_of_.emplace(NumberKey(images[i].path.stem().string()), i);
  }
}

std::optional<size_t> ImageIndex::Find(const std::string& text) const {
  const std::string stem =
      HasImageName(text) ? fs::path(text).stem().string() : fs::path(text).filename().string();
  for (const std::string& key : {text, stem, NumberKey(stem)}) {
    if (const auto found = index_of_.find(key); found != index_of_.end()) return found->second;
  }
  return std::nullopt;
}

bool NaturalLess(std::string_view a, std::string_view b) {
  const auto digits = [](std::string_view text) {
    const auto end = std::ranges::find_if(text, [](unsigned char c) { return !std::isdigit(c); });
    return text.substr(0, static_cast<size_t>(end - text.begin()));
  };
  const std::string_view whole_a = a, whole_b = b;
  while (!a.empty() && !b.empty()) {
    std::string_view x = digits(a), y = digits(b);
    if (x.empty() || y.empty()) {
      if (a.front() != b.front()) return a.front() < b.front();
      a.remove_prefix(1);
      b.remove_prefix(1);
      continue;
    }
    a.remove_prefix(x.size());
    b.remove_prefix(y.size());
    x.remove_prefix(std::min(x.find_first_not_of('0'), x.size()));
    y.remove_prefix(std::min(y.find_first_not_of('0'), y.size()));
    if (x.size() != y.size()) return x.size() < y.size();
    if (x != y) return x < y;
  }
  if (a.empty() != b.empty()) return a.empty();
  return whole_a < whole_b;  // "1" and "01"
}

}  // namespace plenocal
