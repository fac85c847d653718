// SPDX-License-Identifier: Apache-2.0
#include "detectors/tag_assignment/assign_tags.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>
#include <variant>

#include "calib/base/statistics.h"

namespace plenocal::internal {
namespace {

// Sides of a square, between where it is and where its neighbours place it. On another target's
// layout a square is most of a side away or more; perspective and distortion from one neighbour to
// the next leave less.
constexpr double kNear = 0.5;
// px: by so much the outlines of squares may be too far out or in before their corners are
// measured (blur, the threshold between black and white). Layouts that differ by less in an image
// are alike.
constexpr double kOutline = 0.5;
// Part of a tag's side. Tags of 100 px that are arranged so alike differ by a pixel, which is what
// outlines may be off.
constexpr double kSameArrangement = 0.01;
// Of deciding for a target that fits no better than the other.
constexpr double kSure = 1e-3;

/// Squares that follow one target: index in the image by number.
struct Group {
  std::size_t target = 0;
  std::map<int, std::size_t> members;
};

class Sorter {
 public:
  Sorter(const std::vector<ReadTag>& read, const std::vector<TagPositions>& targets)
      : read_(read), targets_(targets), owners_(read.size()), owned_(targets.size()) {
    for (std::size_t k = 0; k < targets.size(); ++k) {
      std::size_t first = 0;
      while (first < k && !IsSamePrint(targets[first], targets[k])) ++first;
      prints_.push_back(first);
    }
  }

  std::vector<TagOwner> Sort() {
    while (AssignOne()) continue;
    for (std::size_t i = 0; i < read_.size(); ++i) {
      owners_[i].fits_several = !owners_[i].target && Candidates(i) > 1;
    }
    return std::move(owners_);
  }

 private:
  /// Whether square i may belong to the target, which has no square of that number yet.
  [[nodiscard]] bool IsCandidate(std::size_t i, std::size_t target) const {
    const int id = read_[i].id;
    return !owners_[i].target && targets_[target].contains(id) && !owned_[target].contains(id);
  }

  [[nodiscard]] std::size_t Candidates(std::size_t i) const {
    std::size_t count = 0;
    for (std::size_t k = 0; k < targets_.size(); ++k) count += IsCandidate(i, k) ? 1 : 0;
    return count;
  }

  /// Assigns the largest group that is decided; false when none is.
  bool AssignOne() {
    std::vector<Group> groups = FindGroups();
    std::ranges::stable_sort(
        groups, std::ranges::greater(), [](const Group& group) { return group.members.size(); });
    for (const Group& group : groups) {
      const Group* best = Best(group, groups);
      if (best == nullptr || IsMisplaced(*best)) continue;
      for (const auto& [id, i] : best->members) {
        owners_[i].target = best->target;
        owned_[best->target].emplace(id, read_[i].corners);
      }
      return true;
    }
    return false;
  }

  /// Whether a single square is not where the target's squares in view place it. Two that agree
  /// with each other may be behind what hides the squares between.
  [[nodiscard]] bool IsMisplaced(const Group& group) const {
    const auto& owned = owned_[group.target];
    if (group.members.size() > 1 || owned.empty()) return false;
    const int id = group.members.begin()->first;
    return Predict(targets_[group.target], id, owned, Neighbours::kNearest).has_value();
  }

  [[nodiscard]] std::vector<Group> FindGroups() const {
    std::vector<Group> groups;
    for (std::size_t k = 0; k < targets_.size(); ++k) {
      std::set<std::size_t> grouped;
      for (std::size_t seed = 0; seed < read_.size(); ++seed) {
        if (!IsCandidate(seed, k) || grouped.contains(seed)) continue;
        groups.push_back(Grow(k, seed));
        for (const auto& [id, i] : groups.back().members) grouped.insert(i);
      }
    }
    return groups;
  }

  [[nodiscard]] Group Grow(std::size_t target, std::size_t seed) const {
    Group group{target, {{read_[seed].id, seed}}};
    std::map<int, Quad> found{{read_[seed].id, read_[seed].corners}};
    for (bool more = true; more;) {
      // Distance on the target (sides), distance from the prediction (px), index. The nearest come
      // first and improve the prediction of the next.
      std::vector<std::tuple<double, double, std::size_t>> next;
      std::map<int, std::optional<Prediction>> predictions;
      for (std::size_t i = 0; i < read_.size(); ++i) {
        const int id = read_[i].id;
        if (!IsCandidate(i, target) || found.contains(id)) continue;
        const auto [at, is_new] = predictions.try_emplace(id);
        if (is_new) at->second = Predict(targets_[target], id, found, Neighbours::kNearest);
        if (!at->second) continue;
        const double away = Distance(at->second->corners, read_[i].corners);
        if (away < kNear * Side(read_[i].corners)) next.emplace_back(at->second->distance, away, i);
      }
      std::ranges::sort(next);
      more = !next.empty();
      for (const auto& [distance, away, i] : next) {
        constexpr double kAsNear = 1.6;  // the next squares of a grid, across its corners too
        if (distance > kAsNear * std::get<0>(next.front())) break;
        if (!group.members.emplace(read_[i].id, i).second) continue;
        found.emplace(read_[i].id, read_[i].corners);
      }
    }
    return group;
  }

  /// Largest distance of corners.
  static double Distance(const Quad& a, const Quad& b) {
    double largest = 0;
    for (std::size_t k = 0; k < 4; ++k) largest = std::max(largest, (a[k] - b[k]).norm());
    return largest;
  }

  /// The group itself, or another target's that has squares of it: the one that fits better than
  /// all others. Null: none does.
  [[nodiscard]] const Group* Best(const Group& group, const std::vector<Group>& groups) const {
    std::vector<const Group*> best(targets_.size());
    std::vector<std::size_t> most(targets_.size());
    for (const Group& other : groups) {
      const auto common = static_cast<std::size_t>(std::ranges::count_if(
          other.members, [&](const auto& member) { return Has(group, member); }));
      if (common > most[other.target]) {
        most[other.target] = common;
        best[other.target] = &other;
      }
    }
    std::erase(best, nullptr);
    for (const Group* one : best) {
      if (std::ranges::all_of(best, [&](const Group* other) {
            return one == other || FitsBetter(*one, *other) || MayStandFor(*one, *other);
          })) {
        return one;
      }
    }
    return nullptr;
  }

  /// Whether either is as good: both of one print, and neither in view yet.
  [[nodiscard]] bool MayStandFor(const Group& one, const Group& other) const {
    return prints_[one.target] == prints_[other.target] && owned_[one.target].empty() &&
           owned_[other.target].empty() && one.members.size() > 1 &&
           one.members.size() == other.members.size();
  }

  static bool Has(const Group& group, const std::pair<const int, std::size_t>& member) {
    const auto at = group.members.find(member.first);
    return at != group.members.end() && at->second == member.second;
  }

  /// Sum of squared residuals, px^2, and degrees of freedom.
  struct Residuals {
    double square = 0, freedom = 0;
  };

  /// Of the group's squares where their surroundings have them.
  [[nodiscard]] Residuals Measure(const Group& group) const {
    std::map<int, Quad> found;
    for (const auto& [id, i] : group.members) found.emplace(id, read_[i].corners);
    Residuals residuals;
    for (const auto& [id, corners] : found) {
      const std::optional<Prediction> smooth = Smooth(targets_[group.target], id, found);
      if (!smooth) {
        residuals.square += Misfit(corners);
        continue;
      }
      double square = 0;
      for (std::size_t k = 0; k < 4; ++k) square += (smooth->corners[k] - corners[k]).squaredNorm();
      residuals.square += std::min(square, Misfit(corners));
      // The homography's 8 unknowns are shared by the squares that it is fitted to.
      residuals.freedom += 8 - 8.0 / static_cast<double>(smooth->neighbours);
    }
    return residuals;
  }

  /// Of a square that a target does not explain.
  static double Misfit(const Quad& corners) {
    const double away = kNear * Side(corners);
    return 4 * away * away;
  }

  /// Residuals of `one` over all squares of both groups.
  [[nodiscard]] double Square(const Group& one, const Residuals& own, const Group& other) const {
    double square = own.square;
    for (const auto& member : other.members) {
      if (!Has(one, member)) square += Misfit(read_[member.second].corners);
    }
    return square;
  }

  /// F test of both targets' residuals over the squares of both groups.
  [[nodiscard]] bool FitsBetter(const Group& one, const Group& other) const {
    const Residuals a = Measure(one), b = Measure(other);
    const double freedom = a.freedom;
    if (freedom == 0) return false;
    const double outlines = freedom * kOutline * kOutline;
    const double ratio = (Square(other, b, one) + outlines) / (Square(one, a, other) + outlines);
    return ratio > 1 && FTail(ratio, freedom, freedom) < kSure;
  }

  const std::vector<ReadTag>& read_;
  const std::vector<TagPositions>& targets_;
  std::vector<TagOwner> owners_;
  std::vector<std::map<int, Quad>> owned_;  // by target
  std::vector<std::size_t> prints_;         // by target: the first of its print
};

}  // namespace

TagPositions TagsOf(const Target& target) {
  TagPositions tags;
  for (const int id : std::get<TagLayout>(target.layout).ids) {
    for (int k = 0; k < 4; ++k) {
      tags[id][static_cast<std::size_t>(k)] = target.markers.at(4 * id + k);
    }
  }
  return tags;
}

bool IsSamePrint(const TagPositions& a, const TagPositions& b) {
  if (a.size() != b.size() || a.empty()) return false;
  // Distances from the four corners of the first square, in its sides.
  const auto in_sides =
      [](const TagPositions& target, std::size_t corner, const Eigen::Vector3d& p) {
        const QuadPoints& first = target.begin()->second;
        return (p - first[corner]).norm() / (first[1] - first[0]).norm();
      };
  return std::ranges::equal(a, b, [&](const auto& one, const auto& other) {
    if (one.first != other.first) return false;
    for (std::size_t from = 0; from < 4; ++from) {
      for (std::size_t k = 0; k < 4; ++k) {
        if (std::abs(in_sides(a, from, one.second[k]) - in_sides(b, from, other.second[k])) >
            kSameArrangement) {
          return false;
        }
      }
    }
    return true;
  });
}

std::vector<TagOwner> AssignTags(const std::vector<ReadTag>& read,
                                 const std::vector<TagPositions>& targets) {
  return Sorter(read, targets).Sort();
}

std::string FitsSeveral(const char* what, int id) {
  return fmt::format(
      "{} {} fits several targets alike: too few of those that tell them apart are in view",
      what,
      id);
}

}  // namespace plenocal::internal
