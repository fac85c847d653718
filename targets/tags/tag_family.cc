// SPDX-License-Identifier: Apache-2.0
#include "targets/tags/tag_family.h"

#include <apriltag/tag16h5.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h10.h>
#include <apriltag/tag36h11.h>
#include <apriltag/tagCircle21h7.h>
#include <apriltag/tagCircle49h12.h>
#include <apriltag/tagCustom48h12.h>
#include <apriltag/tagStandard41h12.h>
#include <apriltag/tagStandard52h13.h>

#include <algorithm>
#include <array>

#include "calib/base/format_error.h"
#include "calib/base/names.h"

namespace plenocal::internal {
namespace {

/// The library's functions for a family.
struct FamilyEntry {
  std::string_view name;
  apriltag_family_t* (*create)();
  void (*destroy)(apriltag_family_t*);
};

constexpr std::array kFamilies{
    FamilyEntry{"tag16h5", tag16h5_create, tag16h5_destroy},
    FamilyEntry{"tag25h9", tag25h9_create, tag25h9_destroy},
    FamilyEntry{"tag36h10", tag36h10_create, tag36h10_destroy},
    FamilyEntry{"tag36h11", tag36h11_create, tag36h11_destroy},
    FamilyEntry{"tagCircle21h7", tagCircle21h7_create, tagCircle21h7_destroy},
    FamilyEntry{"tagCircle49h12", tagCircle49h12_create, tagCircle49h12_destroy},
    FamilyEntry{"tagCustom48h12", tagCustom48h12_create, tagCustom48h12_destroy},
    FamilyEntry{"tagStandard41h12", tagStandard41h12_create, tagStandard41h12_destroy},
    FamilyEntry{"tagStandard52h13", tagStandard52h13_create, tagStandard52h13_destroy},
};

const FamilyEntry& FindFamily(std::string_view name) {
  for (const FamilyEntry& entry : kFamilies) {
    if (entry.name == name) return entry;
  }
  throw InputError("unknown tag family '{}'{}", name, SuggestName(name, NamesOf(kFamilies)));
}

}  // namespace

TagFamily::TagFamily(std::string_view name, int border_bits) : border_bits_(border_bits) {
  const FamilyEntry& entry = FindFamily(name);
  apriltag_family_t* original = entry.create();
  family_ = *original;
  codes_.assign(original->codes, original->codes + original->ncodes);
  bit_x_.assign(original->bit_x, original->bit_x + original->nbits);
  bit_y_.assign(original->bit_y, original->bit_y + original->nbits);
  entry.destroy(original);
  const auto wider = static_cast<std::uint32_t>(border_bits - 1);
  for (auto* bits : {&bit_x_, &bit_y_}) {
    for (std::uint32_t& bit : *bits) bit += wider;
  }
  family_.width_at_border += 2 * (border_bits - 1);
  family_.total_width += 2 * (border_bits - 1);
  family_.name = const_cast<char*>(entry.name.data());  // a literal, which the library only reads
  // Those of the original are gone; `Subset` sets the copies.
  family_.codes = nullptr;
  family_.bit_x = family_.bit_y = nullptr;
  family_.impl = nullptr;
}

std::vector<bool> TagFamily::Bits(int id) const {
  const int width = family_.width_at_border;
  const std::uint64_t code = codes_[static_cast<std::size_t>(id)];
  std::vector<bool> white(static_cast<std::size_t>(width) * width, false);
  for (int y = 0; y < width; ++y) {
    for (int x = 0; x < width; ++x) {
      const int to_outline = std::min({x, y, width - 1 - x, width - 1 - y});
      white[y * width + x] = !classic() && to_outline < border_bits_;
    }
  }
  for (std::size_t i = 0; i < bit_x_.size(); ++i) {
    const int x = static_cast<int>(bit_x_[i]), y = static_cast<int>(bit_y_[i]);
    if (x < 0 || y < 0 || x >= width || y >= width) continue;  // outside the outline
    white[y * width + x] = IsWhite(code, i);
  }
  if (!classic()) white.flip();
  return white;
}

TagPicture TagFamily::Picture(int id) const {
  const int width = family_.total_width, outline = family_.width_at_border;
  TagPicture picture{.width = width, .margin = (width - outline) / 2, .white = {}};
  picture.white.assign(static_cast<std::size_t>(width) * width, false);
  const std::vector<bool> other = Bits(id);  // than the ring inside the outline
  for (int y = 0; y < width; ++y) {
    for (int x = 0; x < width; ++x) {
      const int u = x - picture.margin, v = y - picture.margin;
      const bool inside = u >= 0 && v >= 0 && u < outline && v < outline;
      picture.white[y * width + x] = inside ? other[v * outline + u] == classic() : classic();
    }
  }
  // Some families have data outside of their outline.
  const std::uint64_t code = codes_[static_cast<std::size_t>(id)];
  for (std::size_t i = 0; i < bit_x_.size(); ++i) {
    // The library keeps negative coordinates in unsigned numbers.
    const int x = static_cast<int>(bit_x_[i]) + picture.margin;
    const int y = static_cast<int>(bit_y_[i]) + picture.margin;
    picture.white[y * width + x] = IsWhite(code, i);
  }
  return picture;
}

apriltag_family_t TagFamily::Subset(const std::vector<int>& ids,
                                    std::vector<std::uint64_t>* codes) const {
  codes->clear();
  for (const int id : ids) codes->push_back(codes_[static_cast<std::size_t>(id)]);
  apriltag_family_t subset = family_;
  subset.ncodes = static_cast<std::uint32_t>(codes->size());
  subset.codes = codes->data();
  // The library takes these as not const, but only reads them.
  subset.bit_x = const_cast<std::uint32_t*>(bit_x_.data());
  subset.bit_y = const_cast<std::uint32_t*>(bit_y_.data());
  return subset;
}

TagFamily MakeTagFamily(std::string_view name, int border_bits, std::span<const int> ids) {
  TagFamily family(name, border_bits);
  if (border_bits < 1 || (border_bits > 1 && !family.classic())) {
    throw InputError("border_bits: {} does not suit family {}; expected {}",
                     border_bits,
                     name,
                     family.classic() ? "1 or more" : "1");
  }
  for (const int id : ids) {
    if (id < 0 || id >= family.size()) {
      throw InputError(
          "tag {} is not in family {}; it has tags 0 to {}", id, name, family.size() - 1);
    }
  }
  return family;
}

}  // namespace plenocal::internal
