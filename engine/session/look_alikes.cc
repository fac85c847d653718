// SPDX-License-Identifier: Apache-2.0
#include "engine/session/look_alikes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <variant>

#include "calib/base/format_error.h"
#include "detectors/tag_assignment/assign_tags.h"

namespace plenocal {
namespace {

// Relative difference of marker over square: markers of 100 px differ by a pixel.
constexpr double kSameRatio = 0.01;

// True if a detector of the one may find parts of the other.
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

// True for one family and a common number; the markers of all boards are numbered from 0 on.
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

bool SameCounts(int columns_a, int rows_a, int columns_b, int rows_b) {
  return std::minmax(columns_a, rows_a) == std::minmax(columns_b, rows_b);
}

// True if no single image distinguishes them, whatever the size.
bool SamePrint(const Target& a, const Target& b) {
  if (a.layout.index() != b.layout.index()) return false;
  if (const auto* one = std::get_if<TagLayout>(&a.layout)) {
    const auto& other = std::get<TagLayout>(b.layout);
    return one->family == other.family && one->border_bits == other.border_bits &&
           internal::IsSamePrint(internal::TagsOf(a), internal::TagsOf(b));
  }
  if (const auto* one = std::get_if<CharucoLayout>(&a.layout)) {
    const auto& other = std::get<CharucoLayout>(b.layout);
    return one->dictionary == other.dictionary && one->columns == other.columns &&
           one->rows == other.rows && one->legacy == other.legacy &&
           std::abs(one->marker / one->square - other.marker / other.square) < kSameRatio;
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

std::vector<IdenticalBoards> CheckDistinct(const Session& session,
                                           std::span<const Target> targets) {
  const auto with_images = [](const SessionCamera& camera) { return HasImages(camera); };
  std::vector<IdenticalBoards> pairs;
  if (std::ranges::none_of(session.cameras, with_images)) return pairs;
  const auto plenoptic = std::ranges::find_if(session.cameras, [&](const SessionCamera& camera) {
    return with_images(camera) && camera.model->plenoptic;
  });
  for (size_t k = 0; k < targets.size(); ++k) {
    for (size_t i = 0; i < k; ++i) {
      const auto refuse = [&](const std::string& why) {
        throw InputError(
            "{}: targets {} and {} look alike in images: {}; print one with other ids "
            "(aprilgrid: 'first_id'), of another family, or with another number of "
            "squares",
            session.path.string(),
            session.targets[i].name,
            session.targets[k].name,
            why);
      };
      if (plenoptic != session.cameras.end() && ShowsNumbers(targets[i]) &&
          ShareNumbers(targets[i], targets[k])) {
        refuse(
            fmt::format("tags of the same numbers, which are told apart in images of ordinary "
                        "cameras only ({} is plenoptic)",
                        plenoptic->name));
      }
      if (!SamePrint(targets[i], targets[k])) continue;
      if (!std::holds_alternative<TagLayout>(targets[i].layout)) {
        refuse("the same pattern with the same counts");
      }
      // Only their mutual pose distinguishes them.
      if (session.targets[i].moves || session.targets[k].moves) {
        refuse("the same tags in the same arrangement, and one of them is 'free'");
      }
      if (!std::ranges::all_of(session.cameras, with_images)) {
        refuse(
            "the same tags in the same arrangement, and a camera has 'detections' in place of "
            "images");
      }
      if (!pairs.empty()) refuse("more than two targets of the same tags in the same arrangement");
      pairs.push_back({i, k, session.targets[i].name, session.targets[k].name});
      const auto& one = session.targets[i].known;
      const auto& other = session.targets[k].known;
      // The frame of known poses is the first target's.
      if (other && (one || i == 0)) {
        pairs.back().T_first_second = i == 0 ? *other : one->Inverse() * *other;
      }
    }
  }
  return pairs;
}

OtherTargets OtherTargetsOf(std::span<const Target> targets, size_t k) {
  std::vector<Target> family;
  OtherTargets others;
  for (size_t i = 0; i < targets.size(); ++i) {
    if (!SameFamily(targets[i], targets[k])) continue;
    family.push_back(targets[i]);
    if (i == k) continue;
    others.targets.push_back(targets[i]);
    if (i < k) ++others.before_own;
  }
  for (size_t i = 0; i < family.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      if (ShareNumbers(family[i], family[j])) return others;
    }
  }
  return {};
}

}  // namespace plenocal
