// SPDX-License-Identifier: Apache-2.0
#include "calib/files/frame_images.h"

#include <fmt/format.h>
#include <fnmatch.h>
#include <glob.h>

#include <map>
#include <optional>

#include "calib/base/error.h"

namespace plenocal {
namespace {

// The part of a path that matches the last `*` of a pattern: 01 for a_b_01.png and `*_*.png`, since
// earlier stars match as much as they can. Nothing for a pattern without `*`.
std::optional<std::string> LastStar(const std::string& text, const std::string& pattern) {
  const size_t star = pattern.rfind('*');
  if (star == std::string::npos) return std::nullopt;
  const std::string before = pattern.substr(0, star), after = pattern.substr(star + 1);
  const auto matches = [](const std::string& part, const std::string& text_part) {
    return fnmatch(part.c_str(), text_part.c_str(), FNM_PATHNAME) == 0;
  };
  for (size_t begin = text.size() + 1; begin-- > 0;) {
    if (!matches(before, text.substr(0, begin))) continue;
    for (size_t end = text.size() + 1; end-- > begin;) {
      const std::string name = text.substr(begin, end - begin);
      if (name.find('/') == std::string::npos && matches(after, text.substr(end))) return name;
    }
  }
  return std::nullopt;
}

}  // namespace

std::vector<FrameImage> ExpandImages(const std::string& pattern, const std::string& what) {
  glob_t found{};
  const int status = glob(pattern.c_str(), 0, nullptr, &found);
  std::vector<FrameImage> images;
  for (size_t i = 0; i < found.gl_pathc; ++i) images.push_back({"", found.gl_pathv[i]});
  globfree(&found);
  if (status != 0 || images.empty()) {
    throw Error(
        ErrorKind::kInput,
        fmt::format("{}: no file matches '{}'; check the path (it is relative to the session "
                    "file) and the pattern",
                    what,
                    pattern));
  }

  std::map<std::string, std::filesystem::path> frames;
  for (FrameImage& image : images) {
    const std::string text = image.path.string();
    image.frame = LastStar(text, pattern).value_or(image.path.stem().string());
    const auto [place, is_new] = frames.emplace(image.frame, image.path);
    if (!is_new) {
      throw Error(ErrorKind::kInput,
                  fmt::format("{}: {} and {} both belong to frame '{}' (what the last '*' of '{}' "
                              "stands for); use a pattern that tells them apart",
                              what,
                              place->second.string(),
                              text,
                              image.frame,
                              pattern));
    }
  }
  return images;
}

}  // namespace plenocal
