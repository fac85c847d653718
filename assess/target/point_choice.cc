// SPDX-License-Identifier: Apache-2.0
#include "assess/target/point_choice.h"

#include <algorithm>
#include <array>
#include <limits>
#include <numeric>
#include <optional>
#include <random>

#include "calib/base/statistics.h"

namespace plenocal {
namespace {

constexpr size_t kSample = 4;
// All four points are right at least once with a probability of 0.9999 when a third of the points
// is, and of 0.998 when each of them has two places.
constexpr int kTrials = 400;
// Of the points' spacing: a wrong place is a whole spacing away; a homography leaves a part of it
// in images of strong distortion.
constexpr double kNear = 0.3;
// Points of a group: twice the equations that a homography needs.
constexpr size_t kLeastGroup = 8;

// The place nearest to the point's image under the map, and its distance there, px.
struct Nearest {
  size_t place = 0;
  double distance = std::numeric_limits<double>::infinity();
};

Nearest NearestPlace(const PlaneMap& map, const PlaneChoice& choice) {
  Nearest nearest;
  for (size_t k = 0; k < choice.places->size(); ++k) {
    const double distance = choice.scale * (map((*choice.places)[k]) - choice.image).norm();
    if (distance < nearest.distance) nearest = {k, distance};
  }
  return nearest;
}

// Indices of the points nearest to each point in the image, itself first.
std::vector<std::vector<size_t>> Neighbourhoods(const std::vector<PlaneChoice>& choices) {
  constexpr size_t kAround = 16;
  std::vector<std::vector<size_t>> around(choices.size());
  for (size_t i = 0; i < choices.size(); ++i) {
    std::vector<size_t>& of_one = around[i];
    of_one.resize(choices.size());
    std::iota(of_one.begin(), of_one.end(), size_t{0});
    std::ranges::sort(
        of_one, {}, [&](size_t k) { return (choices[k].image - choices[i].image).squaredNorm(); });
    of_one.resize(std::min(kAround, of_one.size()));
  }
  return around;
}

enum class Draw { kAll, kNeighbourhood };

// Four different points with one of their places each: of all points, or, every second time, of a
// neighbourhood, where a lens distorts less and a second target is seldom.
std::optional<PlaneMap::Pairs> DrawSample(const std::vector<PlaneChoice>& choices,
                                          const std::vector<std::vector<size_t>>& around,
                                          Draw from,
                                          std::mt19937* random) {
  const std::vector<size_t>& near = around[(*random)() % choices.size()];
  PlaneMap::Pairs sample;
  std::array<size_t, kSample> drawn{};
  for (size_t i = 0; i < kSample; ++i) {
    drawn[i] = from == Draw::kNeighbourhood ? near[(*random)() % near.size()]
                                            : (*random)() % choices.size();
    const auto end = drawn.begin() + static_cast<std::ptrdiff_t>(i);
    if (std::find(drawn.begin(), end, drawn[i]) != end) return std::nullopt;
    const PlaneChoice& choice = choices[drawn[i]];
    sample.Add((*choice.places)[(*random)() % choice.places->size()], choice.image, choice.scale);
  }
  return sample;
}

// The homography of four random points that most points are near.
std::optional<PlaneMap> Consensus(const std::vector<PlaneChoice>& choices, double spacing) {
  std::mt19937 random(1);
  const std::vector<std::vector<size_t>> around = Neighbourhoods(choices);
  const std::vector<double> weights(kSample, 1.0);
  std::optional<PlaneMap> best;
  size_t most = kSample;
  for (int trial = 0; trial < kTrials; ++trial) {
    const auto sample =
        DrawSample(choices, around, trial % 2 == 0 ? Draw::kNeighbourhood : Draw::kAll, &random);
    const std::optional<PlaneMap> map =
        sample ? PlaneMap::Fit(*sample, weights, 1) : std::optional<PlaneMap>();
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
  for (size_t i = 0; i < places.size(); ++i)
    choices.push_back({pairs.image[i], pairs.scale[i], &places[i]});
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
  constexpr int kRounds = 8;  // the consensus grows from its neighbourhood
  for (int round = 0; map && round < kRounds; ++round) {
    split = {};
    const std::vector<double> lengths = map->Lengths(pairs);
    for (size_t i = 0; i < lengths.size(); ++i) {
      PlaneMap::Pairs& side = lengths[i] < kNear * spacing ? split.near : split.others;
      side.Add(pairs.plane[i], pairs.image[i], pairs.scale[i]);
    }
    map = PlaneMap::FitRobustly(split.near, PlaneMap::OrderFor(split.near.plane.size()));
  }
  if (!map) return std::nullopt;
  return split;
}

// Of each point in `from`: distance in the image from the point of `to` that is nearest on the
// plane, over their distance there; the median. Px per unit of the plane.
double Stretch(const PlaneMap::Pairs& from, const PlaneMap::Pairs& to) {
  std::vector<double> stretches;
  for (size_t i = 0; i < from.plane.size(); ++i) {
    double least = std::numeric_limits<double>::infinity(), stretch = 0;
    for (size_t k = 0; k < to.plane.size(); ++k) {
      const double distance = (from.plane[i] - to.plane[k]).norm();
      if (!(distance > 0 && distance < least)) continue;
      least = distance;
      stretch = std::min(from.scale[i], to.scale[k]) * (from.image[i] - to.image[k]).norm() / least;
    }
    if (stretch > 0) stretches.push_back(stretch);
  }
  return Median(stretches);
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
      pairs.Add((*choice.places)[NearestPlace(*map, choice).place], choice.image, choice.scale);
    }
    map = PlaneMap::FitRobustly(pairs, std::min(2, PlaneMap::OrderFor(choices.size())));
  }
  return pairs;
}

bool FollowsOneMap(const PlaneMap::Pairs& pairs, double spacing) {
  const std::optional<PlaneMap> map =
      PlaneMap::FitRobustly(pairs, PlaneMap::OrderFor(pairs.plane.size()));
  return map && static_cast<size_t>(std::ranges::count_if(map->Lengths(pairs), [&](double length) {
                  return length > kNear * spacing;
                })) < kLeastGroup;
}

bool FollowsTwoMaps(const PlaneMap::Pairs& pairs, double spacing) {
  constexpr double kMost = 0.5;  // of the rest; under a fisheye a map leaves points at the rim
  // Neighbours on the plane of which one is on the other target are so many times as far apart in
  // the image as those on one target; no lens tears them apart.
  constexpr double kApart = 3;
  if (pairs.plane.size() < 2 * kLeastGroup) return false;
  const std::optional<Split> split = SplitByConsensus(pairs, spacing);
  if (!split || split->others.plane.size() < kLeastGroup ||
      Stretch(split->others, split->near) < kApart * Stretch(split->near, split->near)) {
    return false;
  }
  const std::optional<Split> second = SplitByConsensus(split->others, spacing);
  return second && static_cast<double>(second->near.plane.size()) >=
                       std::max(static_cast<double>(kLeastGroup),
                                kMost * static_cast<double>(split->others.plane.size()));
}

}  // namespace plenocal
