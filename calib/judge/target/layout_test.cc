// SPDX-License-Identifier: Apache-2.0
#include "calib/judge/target/layout_test.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "calib/base/error.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"
#include "calib/judge/target/plane_map.h"
#include "calib/judge/target/plane_view.h"
#include "calib/judge/target/point_choice.h"

namespace plenocal {
namespace {

constexpr size_t kViews = 10;       // of a camera; more add time and no certainty
constexpr size_t kLeastPoints = 8;  // in a view: half of the equations of a homography are left
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Variances are measured by this quantile of the squared lengths, so that a fifth of the points may
// be wrong for other reasons. (A median is too low where half of the points agree by chance.)
constexpr double kQuantile = 0.8;
// Quantile over variance for normal errors, -2 ln(1 - 0.8), and the efficiency of the estimate, (1
// - 0.8) ln(1 - 0.8)^2 / 0.8, relative to the mean square's.
constexpr double kQuantileOfVariance = 3.2189, kEfficiency = 0.65;
constexpr double kFalseAlarm = 1e-6;
// A mistake that adds less than the noise is no cause of anything.
constexpr double kExplains = 2;  // ratio of variances
// Of the points' spacing. A right target is nearer: noise and what a smooth map leaves of a lens.
constexpr double kFits = 0.05;
// A wrong number, order or row moves many points by half a spacing or more; where the stated target
// fits better than this, none of that is the case and need not be tried.
constexpr double kSuspicious = 0.02;

/// All views of all cameras.
using Views = std::vector<std::vector<PlaneView>>;

/// Candidates for the place of each marker in the plane.
using Places = std::map<int, std::vector<Eigen::Vector2d>>;

/// Residuals of all views with one target.
struct Fit {
  double log_variance = 0;  ///< mean over the points of the log of their camera's variance, px^2
  double relative = 0;      ///< standard deviation over spacing, of the worst camera
  double redundancy = 0;    ///< equations less unknowns
  size_t points = 0;
};

Places OnPlane(const MarkerPlane& plane, const std::map<int, Eigen::Vector3d>& markers) {
  Places places;
  for (const auto& [number, p] : markers) places[number] = {plane(p)};
  return places;
}

// The view's points with their places; those without one are left out.
PlaneMap::Pairs PairsOf(const PlaneView& view, const Places& places) {
  std::vector<PlaneChoice> choices;
  bool open = false;
  for (const PlanePoint& point : view.points) {
    const auto found = places.find(point.marker);
    if (found == places.end()) continue;
    choices.push_back({point.image, &found->second});
    open = open || found->second.size() > 1;
  }
  if (open) return ChoosePlaces(choices, view.spacing);
  PlaneMap::Pairs pairs;
  for (const PlaneChoice& choice : choices) {
    pairs.plane.push_back(choice.places->front());
    pairs.image.push_back(choice.image);
  }
  return pairs;
}

// Of a coordinate, from squared lengths.
double VarianceOf(std::vector<double> squares) {
  const auto at = squares.begin() +
                  static_cast<std::ptrdiff_t>(kQuantile * static_cast<double>(squares.size()));
  std::ranges::nth_element(squares, at);
  return *at / kQuantileOfVariance;
}

Fit FitAll(const Views& cameras, const Places& places) {
  Fit fit;
  for (const std::vector<PlaneView>& views : cameras) {
    std::vector<double> squares, spacings;
    double redundancy = 0;
    for (const PlaneView& view : views) {
      const PlaneMap::Pairs pairs = PairsOf(view, places);
      if (pairs.plane.size() < kLeastPoints) continue;
      const int order = PlaneMap::OrderFor(pairs.plane.size());
      const std::optional<PlaneMap> map = PlaneMap::FitRobustly(pairs, order);
      if (!map) continue;
      const double equations = 2.0 * static_cast<double>(pairs.plane.size());
      const double left = equations - PlaneMap::Unknowns(order);
      for (const double length : map->Lengths(pairs)) {
        squares.push_back(length * length * equations / left);
      }
      spacings.push_back(view.spacing);
      redundancy += left;
    }
    if (squares.empty()) continue;
    constexpr double kSmallest = 1e-12;  // px^2; of exact points
    const double variance = std::max(kSmallest, VarianceOf(squares));
    const auto count = static_cast<double>(squares.size());
    fit.log_variance += count * std::log(variance);
    fit.relative = std::max(fit.relative, std::sqrt(variance) / Median(spacings));
    fit.redundancy += redundancy;
    fit.points += squares.size();
  }
  fit.log_variance =
      fit.points > 0 ? fit.log_variance / static_cast<double>(fit.points) : kInfinity;
  return fit;
}

// Whether `other` explains the images decisively better than `stated`.
bool Explains(const Fit& other, const Fit& stated) {
  constexpr double kMostPoints = 0.8;  // a target that explains some of the points explains nothing
  if (static_cast<double>(other.points) < kMostPoints * static_cast<double>(stated.points)) {
    return false;
  }
  const double ratio = std::exp(stated.log_variance - other.log_variance);
  return ratio > kExplains && other.relative < kFits &&
         FTail(ratio, kEfficiency * stated.redundancy, kEfficiency * other.redundancy) <
             kFalseAlarm;
}

// A number of the target's file, estimated.
struct Estimate {
  double value = 0, sigma = 0;
  Fit fit;
};

// The target with one of its numbers replaced.
Places WithNumber(const MarkerPlane& plane,
                  const std::map<int, Eigen::Vector3d>& markers,
                  const TargetNumber& number,
                  double value) {
  Places places;
  for (const auto& [marker, p] : markers) {
    const auto slope = number.by_number.find(marker);
    const Eigen::Vector3d moved =
        slope == number.by_number.end() ? p : p + (value - number.stated) * slope->second;
    places[marker] = {plane(moved)};
  }
  return places;
}

Estimate EstimateNumber(const Views& views,
                        const MarkerPlane& plane,
                        const std::map<int, Eigen::Vector3d>& markers,
                        const TargetNumber& number) {
  const auto fit = [&](double log_value) {
    return FitAll(views, WithNumber(plane, markers, number, std::exp(log_value)));
  };
  // A rough search, then the golden section.
  constexpr int kSteps = 24;
  const double first = std::log(number.least);
  const double step = (std::log(number.most) - first) / kSteps;
  double best = first, least = kInfinity;
  for (int i = 0; i <= kSteps; ++i) {
    const double now = fit(first + i * step).log_variance;
    if (now < least) least = now, best = first + i * step;
  }
  constexpr double kGolden = 0.381966, kPrecision = 1e-5;
  double low = best - step, high = best + step;
  double a = low + kGolden * (high - low), b = high - kGolden * (high - low);
  double of_a = fit(a).log_variance, of_b = fit(b).log_variance;
  while (high - low > kPrecision) {
    if (of_a < of_b) {
      high = b, b = a, of_b = of_a;
      a = low + kGolden * (high - low), of_a = fit(a).log_variance;
    } else {
      low = a, a = b, of_a = of_b;
      b = high - kGolden * (high - low), of_b = fit(b).log_variance;
    }
  }
  Estimate estimate;
  const double at = (low + high) / 2;
  estimate.value = std::exp(at);
  estimate.fit = fit(at);
  // The variance grows by 1 + k d^2 at the distance d from the best value; one standard error is
  // where the sum of squares has grown by one variance.
  constexpr double kDistance = 0.05;
  const double growth = (std::exp(fit(at - kDistance).log_variance - estimate.fit.log_variance) +
                         std::exp(fit(at + kDistance).log_variance - estimate.fit.log_variance)) /
                            2 -
                        1;
  const double degrees = kEfficiency * estimate.fit.redundancy;
  estimate.sigma = estimate.value * kDistance / std::sqrt(std::max(growth, 1e-12) * degrees);
  return estimate;
}

// With the digits that its standard error leaves.
std::string Rounded(double value, double sigma) {
  const int digits = std::clamp(static_cast<int>(std::ceil(-std::log10(2 * sigma))), 0, 6);
  return fmt::format("{:.{}f}", value, digits);
}

Finding NumberFinding(const TargetNumber& number, const Estimate& estimate) {
  const std::string value = Rounded(estimate.value, estimate.sigma);
  return {
      .code = number.code,
      .grade = Grade::kBad,
      .cameras = {},
      .value = estimate.value,
      .limit = number.stated,
      .what = fmt::format("the images show a {} ({}) of {} +- {:.1g}, the target's file states "
                          "{:g}",
                          number.key,
                          number.meaning,
                          value,
                          estimate.sigma,
                          number.stated),
      .remedy = fmt::format("set {}: {} in the target's file, or measure it", number.key, value)};
}

Finding HypothesisFinding(const TargetHypothesis& hypothesis, double ratio) {
  return {.code = hypothesis.code,
          .grade = Grade::kBad,
          .cameras = {},
          .value = std::sqrt(ratio),
          .limit = std::sqrt(kExplains),
          .what = fmt::format("{}: the points of the images then fit {:.0f} times better than to "
                              "the target's file",
                              hypothesis.what,
                              std::sqrt(ratio)),
          .remedy = hypothesis.remedy};
}

// The best of several explanations.
struct Best {
  double log_variance = kInfinity;
  std::optional<Finding> finding;

  void Offer(const Fit& fit, const Fit& stated, const auto& describe) {
    if (fit.log_variance >= log_variance || !Explains(fit, stated)) return;
    log_variance = fit.log_variance;
    finding = describe();
  }
};

std::vector<Finding> ListOf(std::optional<Finding> finding) {
  return finding ? std::vector<Finding>{*std::move(finding)} : std::vector<Finding>{};
}

std::vector<Finding> TestFlat(const Views& views,
                              const MarkerPlane& plane,
                              const std::map<int, Eigen::Vector3d>& markers,
                              const TargetDoubts& doubts) {
  const Fit stated = FitAll(views, OnPlane(plane, markers));
  if (stated.points == 0) return {};
  Best best;
  if (stated.relative > kSuspicious) {
    for (const TargetHypothesis& hypothesis : doubts.hypotheses) {
      Places places;
      for (const auto& [number, candidates] : hypothesis.places) {
        for (const Eigen::Vector3d& p : candidates) places[number].push_back(plane(p));
      }
      const Fit fit = FitAll(views, places);
      best.Offer(fit, stated, [&] {
        return HypothesisFinding(hypothesis, std::exp(stated.log_variance - fit.log_variance));
      });
    }
  }
  for (const TargetNumber& number : doubts.numbers) {
    const Estimate estimate = EstimateNumber(views, plane, markers, number);
    best.Offer(estimate.fit, stated, [&] { return NumberFinding(number, estimate); });
  }
  return ListOf(std::move(best.finding));
}

// Residuals of a camera's initial guess with one target.
Fit GuessFit(const CameraInput& camera,
             const PlaneView& typical,
             const std::map<int, Eigen::Vector3d>& markers) {
  Fit fit{.log_variance = kInfinity};
  try {
    const CameraGuess guess = GuessCamera(camera, markers);
    const double sigma = kSigmaPerMedianLength2d * guess.median_error;
    fit.log_variance = 2 * std::log(std::max(sigma, 1e-6));
    fit.relative = sigma / typical.spacing;
    for (const View& view : camera.views) fit.points += view.observations.size();
    fit.redundancy = static_cast<double>(2 * fit.points) -
                     static_cast<double>(6 * camera.views.size() + camera.model->params.size());
  } catch (const Error&) {
    // The views do not suffice with this target.
  }
  return fit;
}

std::vector<Finding> TestSolid(const CameraInput& camera,
                               const PlaneView& typical,
                               const std::map<int, Eigen::Vector3d>& markers,
                               const TargetDoubts& doubts) {
  Fit stated = GuessFit(camera, typical, markers);
  if (stated.relative < kSuspicious && stated.points > 0) return {};
  Best best;
  for (const TargetHypothesis& hypothesis : doubts.hypotheses) {
    std::map<int, Eigen::Vector3d> places;
    for (const auto& [number, candidates] : hypothesis.places) places[number] = candidates.front();
    const Fit fit = GuessFit(camera, typical, places);
    if (stated.points == 0) {
      // No guess at all: as far off as a spacing.
      stated = fit;
      stated.log_variance = 2 * std::log(typical.spacing);
    }
    best.Offer(fit, stated, [&] {
      return HypothesisFinding(hypothesis, std::exp(stated.log_variance - fit.log_variance));
    });
  }
  return ListOf(std::move(best.finding));
}

Views ViewsOf(const std::vector<CameraInput>& cameras) {
  Views views;
  views.reserve(cameras.size());
  for (const CameraInput& camera : cameras) {
    views.push_back(MakePlaneViews(camera, kViews, kLeastPoints));
  }
  return views;
}

}  // namespace

std::vector<Finding> FindWrongLayout(const std::vector<CameraInput>& cameras,
                                     const std::map<int, Eigen::Vector3d>& markers,
                                     const TargetDoubts& doubts) {
  if (doubts.hypotheses.empty() && doubts.numbers.empty()) return {};
  const Views views = ViewsOf(cameras);
  if (const std::optional<MarkerPlane> plane = FindPlane(markers)) {
    return TestFlat(views, *plane, markers, doubts);
  }
  const auto most = std::ranges::max_element(views, {}, &std::vector<PlaneView>::size);
  if (most == views.end() || most->empty()) return {};
  return TestSolid(
      cameras[static_cast<size_t>(most - views.begin())], most->front(), markers, doubts);
}

std::vector<Finding> FindTargetTwice(const std::vector<CameraInput>& cameras,
                                     const std::map<int, Eigen::Vector3d>& markers) {
  const std::optional<MarkerPlane> plane = FindPlane(markers);
  if (!plane) return {};
  const Places places = OnPlane(*plane, markers);
  size_t twice = 0, all = 0;
  for (const std::vector<PlaneView>& views : ViewsOf(cameras)) {
    for (const PlaneView& view : views) {
      ++all;
      if (FollowsTwoMaps(PairsOf(view, places), view.spacing)) ++twice;
    }
  }
  // Reflections and false readings are no second target: they do not follow a map, image by image.
  constexpr size_t kLeastViews = 2;
  constexpr double kLeastPart = 0.1;
  if (twice < kLeastViews || static_cast<double>(twice) < kLeastPart * static_cast<double>(all)) {
    return {};
  }
  return {{.code = "target_ids_twice",
           .grade = Grade::kBad,
           .cameras = {},
           .value = static_cast<double>(twice),
           .limit = static_cast<double>(kLeastViews),
           .what = fmt::format("in {} of {} images the points lie on two targets: a part of them "
                               "fits the stated target in one place, the rest in another",
                               twice,
                               all),
           .remedy = "remove or cover the second target with the same numbers (ids), or give it "
                     "others"}};
}

}  // namespace plenocal
