// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/image_names.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <iterator>
#include <map>
#include <regex>
#include <set>
#include <string_view>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/quoted_text.h"
#include "calib/io/yaml.h"
#include "engine/recording/stores/image_lister.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

bool IsDigit(char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; }
bool HasWildcard(const std::string& text) { return text.find_first_of("*?[") != std::string::npos; }

// The common beginning of all texts, without a part of a number.
std::string CommonBeginning(const std::vector<std::string>& texts) {
  std::string common = texts.front();
  for (const std::string& text : texts) {
    const auto end = std::ranges::mismatch(common, text).in1;
    common.erase(end, common.end());
  }
  while (!common.empty() && IsDigit(common.back())) common.pop_back();
  return common;
}

std::string CommonEnd(std::vector<std::string> texts) {
  for (std::string& text : texts) std::ranges::reverse(text);
  std::string common = CommonBeginning(texts);
  std::ranges::reverse(common);
  return common;
}

// The files whose names are alike but for numbers, without a few others.
std::vector<FrameImage> MostAlike(const std::vector<FrameImage>& files) {
  static const std::regex number("[0-9]+");
  std::map<std::string, std::vector<FrameImage>> by_form;
  for (const FrameImage& file : files) {
    by_form[std::regex_replace(file.path.string(), number, "#")].push_back(file);
  }
  constexpr size_t kOthers = 4;
  for (auto& [form, alike] : by_form) {
    if (kOthers * (files.size() - alike.size()) <= files.size()) return std::move(alike);
  }
  return files;
}

std::set<std::string> FramesOf(const std::vector<std::string>& images, const std::string& name) {
  std::set<std::string> frames;
  for (const FrameImage& image : ListImages(images, name)) frames.insert(image.frame);
  return frames;
}

// Least number of frames that a camera shares with the first.
size_t SharedFrames(const std::vector<std::string>& names,
                    const std::vector<std::vector<std::string>>& images) {
  const std::set<std::string> first = FramesOf(images[0], names[0]);
  size_t least = first.size();
  for (size_t c = 1; c < images.size(); ++c) {
    const std::set<std::string> frames = FramesOf(images[c], names[c]);
    const auto shared = std::ranges::count_if(
        frames, [&](const std::string& frame) { return first.contains(frame); });
    least = std::min(least, static_cast<size_t>(shared));
  }
  return least;
}

bool HoldStores(const std::vector<std::string>& patterns) {
  return std::ranges::any_of(patterns, [](const std::string& pattern) {
    return !SplitStorePattern(pattern).file.empty();
  });
}

// `pattern` relative to `folder`, in the notation of YAML.
std::string YamlPath(const std::string& pattern, const fs::path& folder) {
  // Only existing parts can be made relative.
  fs::path base, rest;
  for (const fs::path& part : fs::absolute(pattern).lexically_normal()) {
    (rest.empty() && !HasWildcard(part.string()) ? base : rest) /= part;
  }
  const fs::path to = fs::weakly_canonical(base), from = fs::weakly_canonical(folder);
  // The whole path is easier to read if the root alone is common.
  const auto top = [](const fs::path& path) {
    return *std::next(path.begin(), path.has_relative_path() ? 1 : 0);
  };
  fs::path all = top(to) == top(from) ? fs::relative(to, from) : to;
  if (!rest.empty() || fs::is_directory(to)) all /= rest;  // a folder's ends with a slash
  const std::string text = all.lexically_normal().string();
  const bool plain = std::ranges::all_of(text, [](unsigned char c) {
    return std::isalnum(c) != 0 ||
           std::string_view("_-./*").find(static_cast<char>(c)) != std::string_view::npos;
  });
  if (plain && text[0] != '*' && text[0] != '-') return text;
  std::string quoted = YamlQuoted(text);
  if (YamlNode::Parse(quoted, text).AsString() != text) {
    throw InputError("{}: the path is not UTF-8, as a session is; rename it", text);
  }
  return quoted;
}

}  // namespace

std::string GlobOf(const std::vector<FrameImage>& files,
                   const std::function<bool(const fs::path&)>& allowed) {
  std::vector<std::string> names;
  for (const FrameImage& file : files) {
    if (file.path.parent_path() != files[0].path.parent_path()) return {};
    names.push_back(file.path.filename().string());
  }
  if (names.size() < 2) return {};
  const std::string begin = CommonBeginning(names);
  for (std::string& name : names) name.erase(0, begin.size());
  const std::string end = CommonEnd(names);
  const fs::path folder = files[0].path.parent_path();
  const std::string glob = (folder / (begin + "*" + end)).string();
  if (HasWildcard(folder.string() + begin + end)) return {};
  std::set<fs::path> wanted;
  for (const FrameImage& file : files) wanted.insert(file.path);
  const std::vector<FrameImage> matched = ExpandImages(glob, "images");
  const bool fits = std::ranges::all_of(matched, [&](const FrameImage& file) {
    return wanted.contains(file.path) || allowed(file.path);
  });
  return fits ? glob : std::string();
}

std::vector<std::string> AsGlobs(const std::vector<std::string>& inputs, const std::string& what) {
  if (HoldStores(inputs)) return inputs;
  for (const std::string& input : inputs) {
    if (!fs::exists(input) && !HasWildcard(input)) {
      throw InputError("{}: no such file or folder; check the path", input);
    }
  }
  if (inputs.size() == 1) return inputs;
  const std::string glob =
      GlobOf(ExpandImages(inputs, what), [](const fs::path&) { return false; });
  return glob.empty() ? inputs : std::vector{glob};
}

void ShareFrames(const std::vector<std::string>& names,
                 std::vector<std::vector<std::string>>* images) {
  // Their images are paired by time, or by names that no glob can change.
  if (std::ranges::any_of(*images, HoldStores)) return;
  if (images->size() < 2) return;
  const size_t shared = SharedFrames(names, *images);
  if (shared > 1) return;
  std::vector<std::vector<std::string>> globs;
  for (size_t c = 0; c < images->size(); ++c) {
    const std::string glob = GlobOf(MostAlike(ExpandImages((*images)[c], names[c])),
                                    [](const fs::path&) { return true; });
    globs.push_back(glob.empty() ? (*images)[c] : std::vector{glob});
  }
  if (SharedFrames(names, globs) > shared) *images = std::move(globs);
  if (SharedFrames(names, *images) > 0) return;
  std::vector<std::string> examples;
  for (size_t c = 0; c < images->size(); ++c) {
    examples.push_back(
        fmt::format("{} has '{}'", names[c], *FramesOf((*images)[c], names[c]).begin()));
  }
  throw InputError(
      "the cameras' images have no frame in common ({}): images of one instant "
      "have equal names, or equal parts where a glob's last '*' stands",
      fmt::join(examples, ", "));
}

std::string PathsYaml(const std::vector<std::string>& patterns, const fs::path& folder) {
  if (patterns.size() == 1) return YamlPath(patterns[0], folder);
  std::string list;
  for (const std::string& pattern : patterns) list += "\n      - " + YamlPath(pattern, folder);
  return list;
}

}  // namespace plenocal
