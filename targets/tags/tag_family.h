// SPDX-License-Identifier: Apache-2.0
//
// Codes and pictures of the tags of an AprilTag family.
#pragma once

#include <apriltag/apriltag.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

namespace plenocal::internal {

/// A whole tag as it is printed, row by row from the upright tag's upper left.
struct TagPicture {
  int width = 0;            ///< bits
  int margin = 0;           ///< bits between the picture's edge and the tag's outline
  std::vector<bool> white;  ///< width x width
};

/// The codes of an AprilTag family, with a black border of any width.
class TagFamily {
 public:
  /// REQUIRES: border_bits = 1 unless the family is classic. Throws `Error` for a family that does
  /// not exist.
  TagFamily(std::string_view name, int border_bits);

  [[nodiscard]] int size() const { return static_cast<int>(codes_.size()); }
  [[nodiscard]] int border_bits() const { return border_bits_; }
  /// The border is black and all data is inside; otherwise the colours are exchanged.
  [[nodiscard]] bool classic() const { return !family_.reversed_border; }
  /// Bits between the left and the right edge of the outline.
  [[nodiscard]] int width_at_border() const { return family_.width_at_border; }
  [[nodiscard]] int data_bits() const { return static_cast<int>(family_.nbits); }

  /// Bits within the outline, row by row from the upright tag's upper left corner: true where the
  /// colour is not that of the ring just inside the outline.
  [[nodiscard]] std::vector<bool> Bits(int id) const;

  /// A tag with what is around its outline, as `apriltag_to_image` draws it.
  [[nodiscard]] TagPicture Picture(int id) const;

  /// The family with only the tags `ids`, for the library, whose table for decoding holds every
  /// code with every correctable error: 3 GB for all of tagStandard52h13. The pointers are valid as
  /// long as `this` and `codes` are.
  [[nodiscard]] apriltag_family_t Subset(const std::vector<int>& ids,
                                         std::vector<std::uint64_t>* codes) const;

 private:
  [[nodiscard]] bool IsWhite(std::uint64_t code, std::size_t bit) const {
    return (code >> (bit_x_.size() - 1 - bit) & 1) != 0;
  }

  apriltag_family_t family_{};
  int border_bits_;
  std::vector<std::uint64_t> codes_;
  std::vector<std::uint32_t> bit_x_, bit_y_;
};

/// The family of a target's tags `ids`, with a border of `border_bits`. Throws `Error` for a
/// family, border or tag that does not exist.
TagFamily MakeTagFamily(std::string_view name, int border_bits, std::span<const int> ids);

}  // namespace plenocal::internal
