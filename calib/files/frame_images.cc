// SPDX-License-Identifier: Apache-2.0
#include "calib/files/frame_images.h"

#include <fnmatch.h>
#include <glob.h>

#include <algorithm>
#include <array>
#include <map>
#include <optional>

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/base/quoted_text.h"

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

std::vector<FrameImage> ImagesInFolder(const std::string& folder, const std::string& what) {
  std::vector<FrameImage> images;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (!HasImageName(entry.path())) continue;
    images.push_back({.frame = entry.path().stem().string(), .path = entry.path()});
  }
  std::ranges::sort(images, {}, &FrameImage::path);
  if (images.empty()) {
    throw InputError(
        "{}: no image (png, tiff, jpeg, bmp, pgm) in the folder {}; give a folder "
        "below it, or find the cameras by 'plenocal init'",
        what,
        folder);
  }
  return images;
}

std::vector<FrameImage> MatchGlob(const std::string& pattern, const std::string& what) {
  glob_t found{};
  const int status = glob(pattern.c_str(), 0, nullptr, &found);
  std::vector<FrameImage> images;
  for (size_t i = 0; i < found.gl_pathc; ++i) images.push_back({"", found.gl_pathv[i]});
  globfree(&found);
  if (status != 0 || images.empty()) {
    throw InputError(
        "{}: no file matches '{}'; check the path (in a session it is relative to the "
        "session file) and the pattern",
        what,
        pattern);
  }
  for (FrameImage& image : images) {
    image.frame = LastStar(image.path.string(), pattern).value_or(image.path.stem().string());
  }
  return images;
}

}  // namespace

bool HasImageName(const std::filesystem::path& path) {
  static constexpr std::array kExtensions{
      ".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm"};
  const std::string extension = LowerCase(path.extension().string());
  return !path.filename().string().starts_with('.') &&
         std::ranges::find(kExtensions, extension) != kExtensions.end();
}

std::vector<FrameImage> ExpandImages(const std::string& pattern, const std::string& what) {
  return ExpandImages(std::vector{pattern}, what);
}

std::vector<FrameImage> ExpandImages(const std::vector<std::string>& patterns,
                                     const std::string& what) {
  std::vector<FrameImage> images;
  std::map<std::string, std::filesystem::path> frames;
  for (const std::string& pattern : patterns) {
    std::vector<FrameImage> found;
    if (std::filesystem::is_directory(pattern)) {
      found = ImagesInFolder(pattern, what);
    } else if (std::filesystem::exists(pattern)) {
      // A name of its own may hold any character.
      found = {{.frame = std::filesystem::path(pattern).stem().string(), .path = pattern}};
    } else {
      found = MatchGlob(pattern, what);
    }
    for (FrameImage& image : found) {
      // "left*.png" matches left.png too, which belongs to right.png of "right*.png".
      if (image.frame.empty()) image.frame.assign(1, '_');
      if (const auto defect = FrameNameDefect(image.frame)) {
        throw InputError("{}: {}: the name of its frame, '{}', {}; rename the file",
                         what,
                         image.path.string(),
                         image.frame,
                         *defect);
      }
      const auto [place, is_new] = frames.emplace(image.frame, image.path);
      if (!is_new) {
        throw InputError(
            "{}: {} and {} both belong to frame '{}' (what the last '*' of '{}' "
            "stands for); use a pattern that tells them apart",
            what,
            place->second.string(),
            image.path.string(),
            image.frame,
            pattern);
      }
      images.push_back(std::move(image));
    }
  }
  return images;
}

}  // namespace plenocal
