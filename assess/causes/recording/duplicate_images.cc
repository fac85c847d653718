// SPDX-License-Identifier: Apache-2.0
//
// Frames of a camera that are the same image.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "assess/causes/cause.h"
#include "assess/causes/residual_tests.h"
#include "calib/noise/camera_noise.h"

namespace plenocal {
namespace {

// Sorted by marker and occurrence.
using Points = std::vector<std::pair<std::pair<int, int>, Eigen::Vector2d>>;

std::map<int, Points> PointsByFrame(const Bundle& bundle, size_t camera) {
  std::map<int, Points> frames;
  int occurrence = 0, last_marker = -1, last_frame = -1;
  for (const BundleObservation& observation : bundle.observations) {
    if (observation.camera != static_cast<int>(camera)) continue;
    const bool again = observation.marker == last_marker && observation.frame == last_frame;
    occurrence = again ? occurrence + 1 : 0;
    last_marker = observation.marker;
    last_frame = observation.frame;
    frames[observation.frame].push_back(
        {{observation.marker, occurrence},
         Eigen::Vector2d(observation.seen.values[0], observation.seen.values[1])});
  }
  return frames;
}

// Whether two images have the same points: the mean square of a coordinate's difference is at most
// `limit`, px^2.
bool AreSame(const Points& a, const Points& b, double limit) {
  constexpr size_t kLeast = 6;
  // Of equal images no single point is so far off; most pairs differ in their first one.
  constexpr double kFarOff = 100;
  double sum = 0;
  size_t count = 0;
  auto other = b.begin();
  for (const auto& [key, place] : a) {
    while (other != b.end() && other->first < key) ++other;
    if (other == b.end()) break;
    if (other->first != key) continue;
    const double square = (place - other->second).squaredNorm();
    if (square > kFarOff * limit) return false;
    sum += square;
    ++count;
  }
  return count >= kLeast && 2 * count >= std::max(a.size(), b.size()) &&
         sum <= limit * 2.0 * static_cast<double>(count);
}

// x of the target in the rig, m.
double TargetX(const Bundle& bundle, int frame) {
  return bundle.T_rig_target[static_cast<size_t>(frame)].t.x();
}

std::vector<int> SortedByTargetX(const std::map<int, Points>& frames, const Bundle& bundle) {
  std::vector<int> sorted;
  for (const auto& [frame, points] : frames) sorted.push_back(frame);
  std::ranges::stable_sort(sorted, {}, [&](int frame) { return TargetX(bundle, frame); });
  return sorted;
}

// Whether two frames may be the same image: whatever part of the points was found, the target is at
// one place. Only such frames are compared, since all pairs of a long recording take too long.
bool AreNear(const Bundle& bundle, int a, int b) {
  constexpr double kPart = 0.05;  // of the distance; poses are far more exact
  return std::abs(TargetX(bundle, b) - TargetX(bundle, a)) <=
         kPart * bundle.T_rig_target[static_cast<size_t>(a)].t.norm();
}

// Two exposures of a target at rest differ by the noise of both; the same image, even compressed
// twice, by much less.
std::vector<Finding> FindDuplicates(const CauseEvidence& evidence) {
  constexpr double kPartOfNoise = 0.5;
  const Calibration& calibration = *evidence.calibration;
  const CameraFit& fit = calibration.fits[evidence.camera];
  double noise = fit.noise_sigma;
  if (fit.detector_sigma > 0) noise = std::min(noise, fit.detector_sigma);
  const double limit = 2 * std::pow(kPartOfNoise * std::max(noise, kSmallestNoise), 2);
  const std::map<int, Points> frames = PointsByFrame(calibration.bundle, evidence.camera);
  std::map<int, int> copies;  // frame to the next that is the same
  const std::vector<int> sorted = SortedByTargetX(frames, calibration.bundle);
  for (size_t i = 0; i < sorted.size(); ++i) {
    for (size_t j = i + 1; j < sorted.size(); ++j) {
      if (!AreNear(calibration.bundle, sorted[i], sorted[j])) break;
      const auto [a, b] = std::minmax(sorted[i], sorted[j]);
      const auto known = copies.find(a);
      if (known != copies.end() && known->second < b) continue;
      if (AreSame(frames.at(a), frames.at(b), limit)) copies[a] = b;
    }
  }
  if (copies.empty()) return {};
  std::vector<std::string> pairs;
  for (const auto& [a, b] : copies) {
    pairs.push_back(fmt::format("{} = {}",
                                calibration.frames[static_cast<size_t>(a)],
                                calibration.frames[static_cast<size_t>(b)]));
  }
  return {{.code = "duplicate_images",
           .role = FindingRole::kOutlier,
           .grade = Grade::kUsable,
           .value = static_cast<double>(pairs.size()),
           .limit = 1,
           .what = fmt::format("{} image{} the same as another: {}.",
                               pairs.size(),
                               pairs.size() == 1 ? " is" : "s are",
                               FirstNames(pairs)),
           .remedy = "Remove the copies: they count as measurements of their own, so that standard "
                     "errors are too small."}};
}

}  // namespace

Cause DuplicateImagesCause() { return {CauseStage::kImages, FindDuplicates}; }

}  // namespace plenocal
