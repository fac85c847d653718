// SPDX-License-Identifier: Apache-2.0
#include "calib/judge/target/point_choice.h"

#include <algorithm>
#include <array>
#include <limits>
#include <optional>
#include <random>

namespace plenocal {
namespace {

constexpr size_t kSample = 4;
// All four points are right at least once with a probability of 0.9999 when a third of the points
// is, and of 0.998 when each of them has two places.
constexpr int kTrials = 400;
// Of the points' spacing: a wrong place is a whole spacing away; a homography leaves a part of it
// in images of strong distortion.
constexpr double kNear = 0.3;

// The place nearest to the point's image under the map, and its distance there, px.
struct Nearest {
  size_t place = 0;
  double distance = std::numeric_limits<double>::infinity();
};

Nearest NearestPlace(const PlaneMap& map, const PlaneChoice& choice) {
  Nearest nearest;
  for (size_t k = 0; k < choice.places->size(); ++k) {
    const double distance = (map((*choice.places)[k]) - choice.image).norm();
    if (distance < nearest.distance) nearest = {k, distance};
  }
  return nearest;
}

// The homography of four random points that most points are near.
std::optional<PlaneMap> Consensus(const std::vector<PlaneChoice>& choices, double spacing) {
  std::mt19937 random(1);
  std::optional<PlaneMap> best;
  size_t most = kSample;
  const std::vector<double> weights(kSample, 1.0);
  for (int trial = 0; trial < kTrials; ++trial) {
    PlaneMap::Pairs sample;
    std::array<size_t, kSample> drawn{};
    for (size_t i = 0; i < kSample; ++i) {
      drawn[i] = random() % choices.size();
      if (std::find(drawn.begin(), drawn.begin() + static_cast<std::ptrdiff_t>(i), drawn[i]) !=
          drawn.begin() + static_cast<std::ptrdiff_t>(i)) {
        break;
      }
      const PlaneChoice& choice = choices[drawn[i]];
      sample.plane.push_back((*choice.places)[random() % choice.places->size()]);
      sample.image.push_back(choice.image);
    }
    if (sample.plane.size() < kSample) continue;
    const std::optional<PlaneMap> map = PlaneMap::Fit(sample, weights, 1);
    if (!map) continue;
    const auto near =
        static_cast<size_t>(std::ranges::count_if(choices, [&](const PlaneChoice& choice) {
          return NearestPlace(*map, choice).distance < kNear * spacing;
        }));
    if (near > most) most = near, best = map;
  }
  return best;
}

std::vector<PlaneChoice> ChoicesOf(const PlaneMap::Pairs& pairs,
                                   const std::vector<std::vector<Eigen::Vector2d>>& places) {
  std::vector<PlaneChoice> choices;
  for (size_t i = 0; i < places.size(); ++i) choices.push_back({pairs.image[i], &places[i]});
  return choices;
}

// Pairs within `kNear` of the largest consensus, improved by smoother maps, and the others.
struct Split {
  PlaneMap::Pairs near, others;
};

std::optional<Split> SplitByConsensus(const PlaneMap::Pairs& pairs, double spacing) {
  std::vector<std::vector<Eigen::Vector2d>> places;
  for (const Eigen::Vector2d& p : pairs.plane) places.push_back({p});
  std::optional<PlaneMap> map = Consensus(ChoicesOf(pairs, places), spacing);
  Split split;
  constexpr int kRounds = 4;
  for (int round = 0; map && round < kRounds; ++round) {
    split = {};
    const std::vector<double> lengths = map->Lengths(pairs);
    for (size_t i = 0; i < lengths.size(); ++i) {
      PlaneMap::Pairs& side = lengths[i] < kNear * spacing ? split.near : split.others;
      side.plane.push_back(pairs.plane[i]);
      side.image.push_back(pairs.image[i]);
    }
    map = PlaneMap::FitRobustly(split.near, PlaneMap::OrderFor(split.near.plane.size()));
  }
  if (!map) return std::nullopt;
  return split;
}

}  // namespace

PlaneMap::Pairs ChoosePlaces(const std::vector<PlaneChoice>& choices, double spacing) {
  PlaneMap::Pairs pairs;
  if (choices.size() < 2 * kSample) return pairs;
  std::optional<PlaneMap> map = Consensus(choices, spacing);
  constexpr int kRounds = 5;
  for (int round = 0; map && round < kRounds; ++round) {
    pairs = {};
    for (const PlaneChoice& choice : choices) {
      pairs.plane.push_back((*choice.places)[NearestPlace(*map, choice).place]);
      pairs.image.push_back(choice.image);
    }
    map = PlaneMap::FitRobustly(pairs, std::min(2, PlaneMap::OrderFor(choices.size())));
  }
  return pairs;
}

bool FollowsTwoMaps(const PlaneMap::Pairs& pairs, double spacing) {
  // Points of a group: twice the equations that a homography needs.
  constexpr size_t kLeast = 8;
  constexpr double kMost = 0.8;  // of the rest
  // One map for all points first: what strong distortion keeps from the consensus' homography
  // follows it as well.
  if (pairs.plane.size() < 2 * kLeast) return false;
  const std::optional<PlaneMap> one =
      PlaneMap::FitRobustly(pairs, PlaneMap::OrderFor(pairs.plane.size()));
  if (one && static_cast<size_t>(std::ranges::count_if(one->Lengths(pairs), [&](double length) {
               return length > kNear * spacing;
             })) < kLeast) {
    return false;
  }
  const std::optional<Split> split = SplitByConsensus(pairs, spacing);
  if (!split || split->others.plane.size() < kLeast) return false;
  const std::optional<Split> second = SplitByConsensus(split->others, spacing);
  return second && static_cast<double>(second->near.plane.size()) >=
                       kMost * static_cast<double>(split->others.plane.size());
}

}  // namespace plenocal
