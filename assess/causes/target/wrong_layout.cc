// SPDX-License-Identifier: Apache-2.0
//
// Another target in the images than the stated one, tested without a camera calibration.
//
// Each view of a flat target is a smooth map of its plane to the image (`PlaneMap`), whatever the
// lens (of strong distortions the most fitting one of a few is taken off first). The residuals of
// this map have the size of the noise for the target that is in the images, and that of the mistake
// for all others. The hypothesis with the smallest residuals is named when they explain more than
// half of the variance that the stated target leaves, when an F-test of these variances would
// accept such a ratio less than once in a million, and when they themselves are small compared with
// the spacing of the points. Variances are robust: by a quantile of the squared lengths. A target
// whose markers lie in no plane is tested by the initial guess of a camera instead, for each
// hypothesis.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "assess/causes/cause.h"
#include "assess/target/plane_map.h"
#include "assess/target/plane_view.h"
#include "assess/target/point_choice.h"
#include "calib/base/error.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

constexpr size_t kViews = 10;           // of a camera; more add time and no certainty
constexpr size_t kLeastViewPoints = 8;  // in a view: half of the equations of a homography are left
constexpr double kNoFit = std::numeric_limits<double>::infinity();

// Variances are measured by this quantile of the squared lengths, so that a fifth of the points may
// be wrong for other reasons. (A median is too low where half of the points agree by chance.)
constexpr double kQuantile = 0.8;
// Quantile over variance for normal errors, -2 ln(1 - 0.8), and the efficiency of the estimate, (1
// - 0.8) ln(1 - 0.8)^2 / 0.8, relative to the mean square's.
constexpr double kQuantileOfVariance = 3.2189, kEfficiency = 0.65;
constexpr double kLayoutFalseAlarm = 1e-6;
// A mistake that adds less than the noise is no cause of anything.
constexpr double kLayoutExplains = 2;  // ratio of variances
// Of the points' spacing. A right target is nearer: noise and what a smooth map leaves of a lens.
constexpr double kFitsSpacing = 0.05;
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

// Strengths of distortion, radius^2 lambda of the division model (A. Fitzgibbon, "Simultaneous
// linear estimation of multiple view geometry and lens distortion", 2001), from a pinhole to a
// fisheye of 170 degrees across its image; maps take what is between them.
constexpr std::array<double, 5> kDistortions{0, -0.25, -0.5, -0.75, -0.95};

// An image point without distortion, and px in the image per px there (along the radius).
std::pair<Eigen::Vector2d, double> Undistort(const PlaneView& view,
                                             const Eigen::Vector2d& image,
                                             double distortion) {
  constexpr double kLeast = 0.03;  // what a longer lens than the strongest images beyond 90 degrees
  const Eigen::Vector2d at = image - view.centre;
  const double stretch = distortion * at.squaredNorm() / (view.radius * view.radius);
  const double divisor = std::max(kLeast, 1 + stretch);
  return {at / divisor, divisor * divisor / (1 - stretch)};
}

// The view's points with their places; those without one are left out.
PlaneMap::Pairs PairsOf(const PlaneView& view, const Places& places, double distortion) {
  std::vector<PlaneChoice> choices;
  bool open = false;
  for (const PlanePoint& point : view.points) {
    const auto found = places.find(point.marker);
    if (found == places.end()) continue;
    const auto [image, scale] = Undistort(view, point.image, distortion);
    choices.push_back({image, scale, &found->second});
    open = open || found->second.size() > 1;
  }
  if (open) return ChoosePlaces(choices, view.spacing);
  PlaneMap::Pairs pairs;
  for (const PlaneChoice& choice : choices) {
    pairs.Add(choice.places->front(), choice.image, choice.scale);
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

// Residuals of one camera.
struct CameraResiduals {
  std::vector<double> squares, spacings;
  double redundancy = 0;
};

CameraResiduals Residuals(const std::vector<PlaneView>& views,
                          const Places& places,
                          double distortion) {
  CameraResiduals residuals;
  for (const PlaneView& view : views) {
    const PlaneMap::Pairs pairs = PairsOf(view, places, distortion);
    if (pairs.plane.size() < kLeastViewPoints) continue;
    const int order = PlaneMap::OrderFor(pairs.plane.size());
    const std::optional<PlaneMap> map = PlaneMap::FitRobustly(pairs, order);
    if (!map) continue;
    const double equations = 2.0 * static_cast<double>(pairs.plane.size());
    const double left = equations - PlaneMap::Unknowns(order);
    for (const double length : map->Lengths(pairs)) {
      residuals.squares.push_back(length * length * equations / left);
    }
    residuals.spacings.push_back(view.spacing);
    residuals.redundancy += left;
  }
  return residuals;
}

// With the distortion of each camera: one of `kDistortions`, or, for each camera in `distortions`
// that is not empty, that one.
Fit FitAll(const Views& cameras, const Places& places, std::vector<double>* distortions) {
  constexpr double kSmallest = 1e-12;  // px^2; of exact points
  const bool choose = distortions->empty();
  if (choose) distortions->resize(cameras.size());
  Fit fit;
  for (size_t c = 0; c < cameras.size(); ++c) {
    double least = kNoFit;
    CameraResiduals best;
    const auto try_one = [&](double distortion) {
      CameraResiduals residuals = Residuals(cameras[c], places, distortion);
      if (residuals.squares.size() < best.squares.size() || residuals.squares.empty()) return;
      const double variance = std::max(kSmallest, VarianceOf(residuals.squares));
      if (variance >= least) return;
      least = variance;
      best = std::move(residuals);
      (*distortions)[c] = distortion;
    };
    if (choose) {
      std::ranges::for_each(kDistortions, try_one);
    } else {
      try_one((*distortions)[c]);
    }
    if (best.squares.empty()) continue;
    const auto count = static_cast<double>(best.squares.size());
    fit.log_variance += count * std::log(least);
    fit.relative = std::max(fit.relative, std::sqrt(least) / Median(best.spacings));
    fit.redundancy += best.redundancy;
    fit.points += best.squares.size();
  }
  fit.log_variance = fit.points > 0 ? fit.log_variance / static_cast<double>(fit.points) : kNoFit;
  return fit;
}

Fit FitAll(const Views& cameras, const Places& places) {
  std::vector<double> distortions;
  return FitAll(cameras, places, &distortions);
}

// The target as it is stated.
struct Stated {
  Fit fit;
  std::vector<double> distortions;  // of each camera
};

// Whether `other` explains the images decisively better than `stated`.
bool Explains(const Fit& other, const Fit& stated) {
  constexpr double kMostPoints = 0.8;  // a target that explains some of the points explains nothing
  if (static_cast<double>(other.points) < kMostPoints * static_cast<double>(stated.points)) {
    return false;
  }
  const double ratio = std::exp(stated.log_variance - other.log_variance);
  return ratio > kLayoutExplains && other.relative < kFitsSpacing &&
         FTail(ratio, kEfficiency * stated.redundancy, kEfficiency * other.redundancy) <
             kLayoutFalseAlarm;
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

// Logarithms between which the best value is searched.
struct Bracket {
  double low = 0, high = 0;
  std::vector<double> distortions;
};

// Whether another value near the stated one may explain the images. Points move in proportion to
// the value, so that the variance is a parabola of it: three values give its least one.
bool MayExplain(const Views& views,
                const TargetNumber& number,
                const Stated& stated,
                const std::function<Places(double)>& places) {
  constexpr double kStep = 0.02;
  constexpr double kWorthSearching = 1 + (kLayoutExplains - 1) / 2;
  std::vector<double> distortions = stated.distortions;
  const auto variance = [&](double step) {
    return std::exp(
        FitAll(views, places(std::log(number.stated) + step), &distortions).log_variance -
        stated.fit.log_variance);
  };
  const double below = variance(-kStep), above = variance(kStep);
  const double slope = (above - below) / 2, curvature = above - 2 + below;
  return !(curvature > 0) || 1 - slope * slope / (2 * curvature) < 1 / kWorthSearching;
}

// Where the stated value is right but for some per cent, the search stays near it.
Bracket FindBracket(const Views& views,
                    const TargetNumber& number,
                    const Stated& stated,
                    const std::function<Places(double)>& places) {
  constexpr double kNearby = 0.2;
  const double at = std::log(number.stated);
  Bracket bracket{at - kNearby, at + kNearby, stated.distortions};
  if (stated.fit.relative < kSuspicious) return bracket;
  constexpr int kSteps = 24;
  const double first = std::log(number.least);
  const double step = (std::log(number.most) - first) / kSteps;
  double least = kNoFit;
  for (int i = 0; i <= kSteps; ++i) {
    std::vector<double> distortions;
    const double now = FitAll(views, places(first + i * step), &distortions).log_variance;
    if (now >= least) continue;
    least = now;
    bracket = {first + (i - 1) * step, first + (i + 1) * step, distortions};
  }
  return bracket;
}

Estimate EstimateNumber(const Views& views,
                        const TargetNumber& number,
                        const Stated& stated,
                        const std::function<Places(double)>& places) {
  Bracket bracket = FindBracket(views, number, stated, places);
  const auto fit = [&](double log_value) {
    return FitAll(views, places(log_value), &bracket.distortions);
  };
  constexpr double kGolden = 0.381966, kPrecision = 1e-4;
  double low = bracket.low, high = bracket.high;
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
      .role = FindingRole::kTargetCause,
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
          .role = FindingRole::kTargetCause,
          .grade = Grade::kBad,
          .cameras = {},
          .value = std::sqrt(ratio),
          .limit = std::sqrt(kLayoutExplains),
          .what = fmt::format("{}: the points of the images then fit {:.0f} times better than to "
                              "the target's file",
                              hypothesis.what,
                              std::sqrt(ratio)),
          .remedy = hypothesis.remedy};
}

// The best of several explanations.
struct Best {
  double log_variance = kNoFit;
  std::optional<Finding> finding;

  void Offer(const Fit& fit, const Fit& stated, const auto& describe) {
    if (fit.log_variance >= log_variance || !Explains(fit, stated)) return;
    log_variance = fit.log_variance;
    finding = describe();
  }
};

// Residuals of a camera's initial guess with one target.
Fit GuessFit(const CameraInput& camera,
             const PlaneView& typical,
             const std::map<int, Eigen::Vector3d>& markers) {
  Fit fit{.log_variance = kNoFit};
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

/// The camera with the most views of the target, by whose model a target can be tested.
struct ReferenceCamera {
  const CameraInput& camera;
  const PlaneView& typical;  ///< one of its views
};

// The fit with an estimated number, relative to the spacing also by the initial guess of a camera:
// through a wide lens smooth maps of the plane leave large residuals with any target.
Fit CheckedByCamera(const ReferenceCamera& reference,
                    const TargetNumber& number,
                    double value,
                    std::map<int, Eigen::Vector3d> markers,
                    Fit fit) {
  if (fit.relative < kFitsSpacing) return fit;
  for (const auto& [marker, slope] : number.by_number) {
    markers[marker] += (value - number.stated) * slope;
  }
  fit.relative =
      std::min(fit.relative, GuessFit(reference.camera, reference.typical, markers).relative);
  return fit;
}

Views FirstOf(const Views& cameras) {
  constexpr size_t kFew = 2;
  Views few;
  for (const std::vector<PlaneView>& views : cameras) {
    few.emplace_back(views.begin(), views.begin() + std::min(kFew, views.size()));
  }
  return few;
}

std::optional<Finding> TestFlat(const Views& views,
                                const ReferenceCamera& reference,
                                const MarkerPlane& plane,
                                const std::map<int, Eigen::Vector3d>& markers,
                                const TargetDoubts& doubts) {
  Stated stated;
  stated.fit = FitAll(views, OnPlane(plane, markers), &stated.distortions);
  if (stated.fit.points == 0) return std::nullopt;
  Best best;
  if (stated.fit.relative > kSuspicious) {
    // Of the fullest views: what does not fit these better is not tried on all.
    const Views few = FirstOf(views);
    const Fit stated_few = FitAll(few, OnPlane(plane, markers));
    for (const TargetHypothesis& hypothesis : doubts.hypotheses) {
      Places places;
      for (const auto& [number, candidates] : hypothesis.places()) {
        for (const Eigen::Vector3d& p : candidates) places[number].push_back(plane(p));
      }
      if (FitAll(few, places).log_variance > stated_few.log_variance) continue;
      const Fit fit = FitAll(views, places);
      best.Offer(fit, stated.fit, [&] {
        return HypothesisFinding(hypothesis, std::exp(stated.fit.log_variance - fit.log_variance));
      });
    }
  }
  for (const TargetNumber& number : doubts.numbers) {
    const auto places = [&](double log_value) {
      return WithNumber(plane, markers, number, std::exp(log_value));
    };
    if (stated.fit.relative < kFitsSpacing && !MayExplain(views, number, stated, places)) continue;
    const Estimate estimate = EstimateNumber(views, number, stated, places);
    const Fit fit = CheckedByCamera(reference, number, estimate.value, markers, estimate.fit);
    best.Offer(fit, stated.fit, [&] { return NumberFinding(number, estimate); });
  }
  return best.finding;
}

std::optional<Finding> TestSolid(const ReferenceCamera& reference,
                                 const std::map<int, Eigen::Vector3d>& markers,
                                 const TargetDoubts& doubts) {
  Fit stated = GuessFit(reference.camera, reference.typical, markers);
  if (stated.relative < kSuspicious && stated.points > 0) return std::nullopt;
  Best best;
  for (const TargetHypothesis& hypothesis : doubts.hypotheses) {
    std::map<int, Eigen::Vector3d> places;
    for (const auto& [number, candidates] : hypothesis.places())
      places[number] = candidates.front();
    const Fit fit = GuessFit(reference.camera, reference.typical, places);
    if (stated.points == 0) {
      // No guess at all: as far off as a spacing.
      stated = fit;
      stated.log_variance = 2 * std::log(reference.typical.spacing);
    }
    best.Offer(fit, stated, [&] {
      return HypothesisFinding(hypothesis, std::exp(stated.log_variance - fit.log_variance));
    });
  }
  return best.finding;
}

Views ViewsOf(const std::vector<CameraInput>& cameras) {
  Views views;
  views.reserve(cameras.size());
  for (const CameraInput& camera : cameras) {
    views.push_back(MakePlaneViews(camera, kViews, kLeastViewPoints));
  }
  return views;
}

std::optional<Finding> FindOtherTarget(const std::vector<CameraInput>& cameras,
                                       const std::map<int, Eigen::Vector3d>& markers,
                                       const TargetDoubts& doubts) {
  if (doubts.hypotheses.empty() && doubts.numbers.empty()) return std::nullopt;
  const Views views = ViewsOf(cameras);
  const auto most = std::ranges::max_element(views, {}, &std::vector<PlaneView>::size);
  if (most == views.end() || most->empty()) return std::nullopt;
  const ReferenceCamera reference{cameras[static_cast<size_t>(most - views.begin())],
                                  most->front()};
  const std::optional<MarkerPlane> plane = FindPlane(markers);
  return plane ? TestFlat(views, reference, *plane, markers, doubts)
               : TestSolid(reference, markers, doubts);
}

// Two targets with equal numbers in one image: the points follow two smooth maps. Of flat targets
// only.
std::optional<Finding> FindTargetTwice(const std::vector<CameraInput>& cameras,
                                       const std::map<int, Eigen::Vector3d>& markers) {
  const std::optional<MarkerPlane> plane = FindPlane(markers);
  if (!plane) return std::nullopt;
  const Places places = OnPlane(*plane, markers);
  size_t twice = 0, all = 0;
  for (const std::vector<PlaneView>& views : ViewsOf(cameras)) {
    for (const PlaneView& view : views) {
      ++all;
      const auto any = [&](const auto& test) {
        return std::ranges::any_of(kDistortions, [&](double distortion) {
          return test(PairsOf(view, places, distortion), view.spacing);
        });
      };
      if (!any(FollowsOneMap) && any(FollowsTwoMaps)) ++twice;
    }
  }
  // Reflections and false readings are no second target: they do not follow a map, image by image.
  constexpr size_t kLeastViews = 2;
  constexpr double kLeastPart = 0.1;
  if (twice < kLeastViews || static_cast<double>(twice) < kLeastPart * static_cast<double>(all)) {
    return std::nullopt;
  }
  return Finding{
      .code = "target_ids_twice",
      .role = FindingRole::kTargetResiduals,
      .grade = Grade::kBad,
      .cameras = {},
      .value = static_cast<double>(twice),
      .limit = static_cast<double>(kLeastViews),
      .what = fmt::format("in {} of {} images the points lie on two targets: a part of them "
                          "fits the stated target in one place, the rest in another",
                          twice,
                          all),
      .remedy =
          "remove or cover the second target with the same numbers (ids), or give it "
          "others"};
}

std::vector<Finding> FindWrongLayout(const CauseEvidence& evidence) {
  std::optional<Finding> finding =
      FindOtherTarget(*evidence.inputs, *evidence.markers, *evidence.doubts);
  if (!finding) finding = FindTargetTwice(*evidence.inputs, *evidence.markers);
  return finding ? std::vector<Finding>{*std::move(finding)} : std::vector<Finding>{};
}

}  // namespace

Cause WrongLayoutCause() { return {CauseStage::kLayout, FindWrongLayout}; }

}  // namespace plenocal
