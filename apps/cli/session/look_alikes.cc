// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/session/look_alikes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <variant>

#include "calib/base/error.h"

namespace plenocal {
namespace {

// Part of a tag's side. Tags of 100 px that are arranged so alike differ by a pixel, which is what
// outlines may be off.
constexpr double kSameArrangement = 0.01;

// Whether a detector of the one may find parts of the other.
bool SameFamily(const Target& a, const Target& b) {
  if (a.layout.index() != b.layout.index()) return false;
  if (const auto* tags = std::get_if<TagLayout>(&a.layout)) {
    return tags->family == std::get<TagLayout>(b.layout).family;
  }
  if (const auto* board = std::get_if<CharucoLayout>(&a.layout)) {
    return board->dictionary == std::get<CharucoLayout>(b.layout).dictionary;
  }
  if (const auto* grid = std::get_if<CirclesLayout>(&a.layout)) {
    return grid->asymmetric == std::get<CirclesLayout>(b.layout).asymmetric;
  }
  return std::holds_alternative<ChessboardLayout>(a.layout);
}

// Of one family. The markers of all boards have the numbers from 0 on.
bool ShareNumbers(const Target& a, const Target& b) {
  return SameFamily(a, b) && std::ranges::any_of(a.markers, [&](const auto& marker) {
           return b.markers.contains(marker.first);
         });
}

// Tags and ArUco markers have a number that images show.
bool ShowsNumbers(const Target& target) {
  return std::holds_alternative<TagLayout>(target.layout) ||
         std::holds_alternative<CharucoLayout>(target.layout);
}

// The same numbers at places that differ by a change of scale at most.
bool SameArrangement(const Target& a, const Target& b) {
  if (a.markers.size() != b.markers.size()) return false;
  const auto first = a.markers.begin();
  const int origin = first->first;  // corner 0 of the tag with the lowest number
  const auto in_sides = [&](const Target& target, int from, int to) {
    const double side = (target.markers.at(origin + 1) - target.markers.at(origin)).norm();
    return (target.markers.at(to) - target.markers.at(from)).norm() / side;
  };
  return std::ranges::all_of(a.markers, [&](const auto& marker) {
    if (!b.markers.contains(marker.first)) return false;
    // Distances from the four corners of one tag.
    for (int corner = origin; corner < origin + 4; ++corner) {
      if (std::abs(in_sides(a, corner, marker.first) - in_sides(b, corner, marker.first)) >
          kSameArrangement) {
        return false;
      }
    }
    return true;
  });
}

bool SameCounts(int columns_a, int rows_a, int columns_b, int rows_b) {
  return std::minmax(columns_a, rows_a) == std::minmax(columns_b, rows_b);
}

// Whether no image tells them apart, whatever the size.
bool SamePrint(const Target& a, const Target& b) {
  if (a.layout.index() != b.layout.index()) return false;
  if (std::holds_alternative<TagLayout>(a.layout)) {
    return ShareNumbers(a, b) && SameArrangement(a, b);
  }
  if (const auto* one = std::get_if<CharucoLayout>(&a.layout)) {
    const auto& other = std::get<CharucoLayout>(b.layout);
    return one->dictionary == other.dictionary && one->columns == other.columns &&
           one->rows == other.rows && one->legacy == other.legacy &&
           std::abs(one->marker / one->square - other.marker / other.square) < kSameArrangement;
  }
  if (const auto* one = std::get_if<ChessboardLayout>(&a.layout)) {
    const auto& other = std::get<ChessboardLayout>(b.layout);
    return SameCounts(one->columns, one->rows, other.columns, other.rows);
  }
  if (const auto* one = std::get_if<CirclesLayout>(&a.layout)) {
    const auto& other = std::get<CirclesLayout>(b.layout);
    return one->asymmetric == other.asymmetric &&
           SameCounts(one->columns, one->rows, other.columns, other.rows);
  }
  return false;
}

}  // namespace

void CheckDistinct(const Session& session, std::span<const Target> targets) {
  const auto seen_by = [&](bool plenoptic) {
    return std::ranges::find_if(session.cameras, [&](const SessionCamera& camera) {
      return !camera.images.empty() && (!plenoptic || camera.model->plenoptic);
    });
  };
  const bool detects = seen_by(false) != session.cameras.end();
  const auto plenoptic = seen_by(true);
  for (size_t k = 0; detects && k < targets.size(); ++k) {
    for (size_t i = 0; i < k; ++i) {
      const auto refuse = [&](const std::string& why) {
        throw Error(
            ErrorKind::kInput,
            fmt::format("{}: targets {} and {} look alike in images: {}; print one with other ids "
                        "(aprilgrid: 'first_id'), of another family, or with another number of "
                        "squares",
                        session.path.string(),
                        session.targets[i].name,
                        session.targets[k].name,
                        why));
      };
      if (SamePrint(targets[i], targets[k])) {
        refuse("the same tags or the same pattern in the same arrangement");
      }
      if (plenoptic != session.cameras.end() && ShowsNumbers(targets[i]) &&
          ShareNumbers(targets[i], targets[k])) {
        refuse(fmt::format("tags of the same numbers, which are told apart in images of ordinary "
                           "cameras only ({} is plenoptic)",
                           plenoptic->name));
      }
    }
  }
}

std::vector<Target> RivalsOf(std::span<const Target> targets, size_t k) {
  std::vector<Target> family, rivals;
  for (size_t i = 0; i < targets.size(); ++i) {
    if (!SameFamily(targets[i], targets[k])) continue;
    family.push_back(targets[i]);
    if (i != k) rivals.push_back(targets[i]);
  }
  for (size_t i = 0; i < family.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      if (ShareNumbers(family[i], family[j])) return rivals;
    }
  }
  return {};
}

}  // namespace plenocal
