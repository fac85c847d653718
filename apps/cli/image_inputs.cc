// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/image_inputs.h"

#include <fmt/format.h>

#include <charconv>
#include <filesystem>

#include "calib/base/error.h"

namespace plenocal {
std::vector<FrameImage> FindImageInputs(const std::vector<std::string>& inputs,
                                        const std::string& what) {
  std::vector<FrameImage> images;
  for (const std::string& input : inputs) {
    if (!std::filesystem::exists(input) && input.find('*') == std::string::npos) {
      throw Error(ErrorKind::kInput, fmt::format("{}: no such file; check the path", input));
    }
    const std::vector<FrameImage> found = ExpandImages(input, what);
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
