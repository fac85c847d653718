// SPDX-License-Identifier: Apache-2.0
//
// Images by their names: the natural order, and an index by what other files call them.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "calib/files/frame_images.h"

namespace plenocal {

/// Finds images by what other files call them: the frame's name, the file's name with folders and
/// extension, or the number without its zeros ("0007", "left/0007.png", "7").
class ImageIndex {
 public:
  explicit ImageIndex(const std::vector<FrameImage>& images);
  [[nodiscard]] std::optional<size_t> Find(const std::string& text) const;

 private:
  std::unordered_map<std::string, size_t> index_of_;
};

/// Order of names in which numbers count by their value: "2" before "10".
bool NaturalLess(std::string_view a, std::string_view b);

}  // namespace plenocal
