// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/image_inputs.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <filesystem>

#include "calib/base/error.h"

namespace plenocal {
namespace {

std::vector<FrameImage> ImagesInFolder(const std::string& folder, const std::string& what) {
  static constexpr std::array kExtensions{
      ".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm"};
  std::vector<FrameImage> images;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    std::string extension = entry.path().extension().string();
    std::transform(extension.begin(), extension.end(), extension.begin(), [](unsigned char c) {
      return static_cast<char>(std::tolower(c));
    });
    if (std::find(kExtensions.begin(), kExtensions.end(), extension) == kExtensions.end()) continue;
    images.push_back({.frame = entry.path().stem().string(), .path = entry.path()});
  }
  std::sort(images.begin(), images.end(), [](const FrameImage& a, const FrameImage& b) {
    return a.path < b.path;
  });
  if (images.empty()) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: no {} (png, tiff, jpeg, bmp, pgm) in this folder", folder, what));
  }
  return images;
}

}  // namespace

std::vector<FrameImage> FindImageInputs(const std::vector<std::string>& inputs,
                                        const std::string& what) {
  std::vector<FrameImage> images;
  for (const std::string& input : inputs) {
    std::vector<FrameImage> found;
    if (std::filesystem::is_directory(input)) {
      found = ImagesInFolder(input, what);
    } else if (std::filesystem::exists(input)) {
      // A shell has expanded globs already; a name of its own may hold any character.
      found = {{.frame = std::filesystem::path(input).stem().string(), .path = input}};
    } else if (input.find('*') == std::string::npos) {
      throw Error(ErrorKind::kInput, fmt::format("{}: no such file; check the path", input));
    } else {
      found = ExpandImages(input, what);
    }
    images.insert(images.end(), found.begin(), found.end());
  }
  return images;
}

std::optional<ImageSize> ParseImageSize(const std::string& text) {
  if (text.empty()) return std::nullopt;
  ImageSize size{};
  const char* const end = text.data() + text.size();
  const auto width = std::from_chars(text.data(), end, size[0]);
  if (width.ec == std::errc() && width.ptr != end && *width.ptr == 'x') {
    const auto height = std::from_chars(width.ptr + 1, end, size[1]);
    if (height.ec == std::errc() && height.ptr == end && size[0] > 0 && size[1] > 0) return size;
  }
  throw Error(ErrorKind::kInput,
              fmt::format("--size: expected WIDTHxHEIGHT such as 640x480, found '{}'", text));
}

}  // namespace plenocal
