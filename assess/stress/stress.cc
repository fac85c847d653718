// SPDX-License-Identifier: Apache-2.0
#include "assess/stress/stress.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "assess/stress/halves.h"
#include "assess/stress/left_out_region.h"
#include "assess/stress/part_calibration.h"
#include "calib/base/number_text.h"
#include "calib/base/parallel.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

constexpr double kFalseAlarms = 0.05;  // of all tests of a session
constexpr size_t kFewestFrames = 8;
// The quartiles of the frames' distances, near over far, of halves that differ enough: what grows
// as the inverse of the distance differs between them by a tenth.
constexpr double kMostAlike = 0.9;
constexpr double kBorder = 0.2;  // part of the points

// Points of `part` against the others; of a region, `part` are the points outside of it.
struct Split {
  StressKind kind = StressKind::kNoise;
  std::string what;
  PartOfObservations part;
  std::string failure = {};
};

// From the middle of the image, px.
Eigen::Vector2d PlaceInImage(const Bundle& bundle, const BundleObservation& observation) {
  const ImageSize& size = bundle.cameras[static_cast<size_t>(observation.camera)].image_size;
  return {observation.seen.values[0] - (size[0] - 1) / 2.0,
          observation.seen.values[1] - (size[1] - 1) / 2.0};
}

class Splits {
 public:
  Splits(const Bundle& bundle, std::span<const size_t> cameras) : bundle_(bundle) {
    for (const size_t c : cameras) border_[c] = 0;
    std::map<size_t, std::vector<double>> radii;
    for (const BundleObservation& each : bundle.observations) {
      const auto c = static_cast<size_t>(each.camera);
      if (!each.used || !border_.contains(c)) continue;
      radii[c].push_back(PlaceInImage(bundle, each).norm());
      const RigidTransform T =
          bundle.cameras[c].T_camera_rig * bundle.SeenPose(static_cast<size_t>(each.frame), c);
      const BundleMarker& marker = bundle.markers[static_cast<size_t>(each.marker)];
      of_points_[each.frame].push_back((T * marker.position).norm());
    }
    for (const auto& [c, of_camera] : radii) border_[c] = Quantile(of_camera, 1 - kBorder);
    for (const auto& [frame, distances] : of_points_) distances_.push_back(Median(distances));
  }

  [[nodiscard]] std::vector<Split> All() const {
    std::vector<Split> splits{
        {StressKind::kNoise, "odd/even", ByFrame([](size_t i) { return i % 2 == 0; })},
        {StressKind::kTime, "first/second", ByFrame([&](size_t i) {
           return 2 * i < distances_.size();
         })},
        NearAndFar()};
    using Place = const Eigen::Vector2d;
    const auto leave_out = [&](const char* region, const auto& has) {
      splits.push_back({StressKind::kRegion, region, Outside(has)});
    };
    leave_out("border", [](Place& u, double border) { return u.norm() > border; });
    leave_out("upper left", [](Place& u, double) { return u.x() < 0 && u.y() < 0; });
    leave_out("upper right", [](Place& u, double) { return u.x() >= 0 && u.y() < 0; });
    leave_out("lower left", [](Place& u, double) { return u.x() < 0 && u.y() >= 0; });
    leave_out("lower right", [](Place& u, double) { return u.x() >= 0 && u.y() >= 0; });
    if (distances_.size() >= kFewestFrames) return splits;
    for (Split& split : splits) {
      split.failure = fmt::format(
          "{}; stress tests need {}", Counted(distances_.size(), "frame"), kFewestFrames);
    }
    return splits;
  }

 private:
  // Those of frames that `has`, given their place among frames with points.
  template <typename Has>
  [[nodiscard]] PartOfObservations ByFrame(const Has& has) const {
    std::set<int> frames;
    size_t place = 0;
    for (const auto& [frame, distances] : of_points_) {
      if (has(place++)) frames.insert(frame);
    }
    PartOfObservations part;
    for (const BundleObservation& each : bundle_.observations) {
      part.push_back(frames.contains(each.frame));
    }
    return part;
  }

  // Those outside of the region that `has` places. Other cameras have all points.
  template <typename Has>
  [[nodiscard]] PartOfObservations Outside(const Has& has) const {
    PartOfObservations part;
    for (const BundleObservation& each : bundle_.observations) {
      const auto border = border_.find(static_cast<size_t>(each.camera));
      part.push_back(border == border_.end() || !has(PlaceInImage(bundle_, each), border->second));
    }
    return part;
  }

  [[nodiscard]] Split NearAndFar() const {
    const double middle = Median(distances_);
    Split split{StressKind::kDistance, "near/far", ByFrame([&](size_t i) {
                  return distances_[i] < middle;
                })};
    const double ratio = Quantile(distances_, 0.25) / Quantile(distances_, 0.75);
    if (ratio > kMostAlike) {
      split.failure =
          fmt::format("the distances of the frames differ by {:.0f} % only", 100 / ratio - 100);
    }
    return split;
  }

  const Bundle& bundle_;
  std::map<size_t, double> border_;               // per tested camera: its radius, px
  std::map<int, std::vector<double>> of_points_;  // per frame: distances of its points
  std::vector<double> distances_;                 // medians of these
};

StressTest TestSplit(const Calibration& calibration,
                     size_t camera,
                     const Split& split,
                     const std::array<PartCalibration, 2>& parts) {
  StressTest test{
      .camera = calibration.bundle.cameras[camera].name, .kind = split.kind, .what = split.what};
  for (const std::string& failure : {split.failure, parts[0].failure, parts[1].failure}) {
    if (test.failure.empty()) test.failure = failure;
  }
  if (!test.failure.empty()) return test;
  if (split.kind == StressKind::kRegion) {
    TestLeftOutRegion(calibration, split.part, parts[0], camera, &test);
  } else {
    CompareHalves(calibration, split.part, parts, camera, &test);
  }
  if (!test.failure.empty()) return test;
  const bool is_finite = std::isfinite(test.difference) && std::isfinite(test.predicted) &&
                         std::isfinite(test.factor) && std::isfinite(test.probability);
  if (!is_finite) test.failure = "a part of the points leaves parameters open";
  return test;
}

void CorrectByHolm(std::vector<StressTest>* tests) {
  std::vector<StressTest*> sorted;
  for (StressTest& test : *tests) {
    if (test.failure.empty()) sorted.push_back(&test);
  }
  std::ranges::stable_sort(sorted, {}, &StressTest::probability);
  double least = 0;
  for (size_t i = 0; i < sorted.size(); ++i) {
    const auto left = static_cast<double>(sorted.size() - i);
    least = std::max(least, std::min(1.0, left * sorted[i]->probability));
    sorted[i]->probability = least;
  }
}

}  // namespace

std::string_view StressKindName(StressKind kind) {
  constexpr std::array<std::string_view, 4> kNames{"noise", "time", "distance", "region"};
  return kNames[static_cast<size_t>(kind)];
}

bool StressTest::Fails() const { return failure.empty() && probability < kFalseAlarms; }

std::vector<StressTest> TestStress(const Calibration& calibration,
                                   std::span<const size_t> cameras,
                                   const StressOptions& options) {
  Calibration held = calibration;  // refined markers: all parts share their errors
  held.bundle.marker_freedom = MarkerFreedom::Rigid();
  held.uncertainty = EstimateUncertainty(held.bundle);
  const std::vector<Split> splits = Splits(calibration.bundle, cameras).All();
  std::vector<std::array<PartCalibration, 2>> parts(splits.size());
  ParallelFor(2 * splits.size(), options.threads, [&](size_t i) {
    const Split& split = splits[i / 2];
    if (!split.failure.empty() || (split.kind == StressKind::kRegion && i % 2 == 1)) return;
    PartOfObservations part = split.part;
    if (i % 2 == 1) part.flip();
    parts[i / 2][i % 2] = CalibratePart(held, part, options.loss, options.go_on);
  });
  std::vector<StressTest> tests(cameras.size() * splits.size());
  ParallelFor(tests.size(), options.threads, [&](size_t i) {
    const size_t s = i % splits.size();
    tests[i] = TestSplit(held, cameras[i / splits.size()], splits[s], parts[s]);
  });
  CorrectByHolm(&tests);
  return tests;
}

std::string StressReading(const std::vector<StressTest>& tests) {
  constexpr std::array<const char*, 4> kReadings{
      "odd and even frames differ: noise or outliers are misjudged",
      "the first and second half of the frames differ: the camera moved or warmed",
      "near and far frames differ: rays without a common origin (try +pupil), or focus that changes",
      "regions of the image differ: the model is too stiff there, or the target is not as described"};
  std::map<std::string, std::set<StressKind>> failing;  // by camera
  for (const StressTest& test : tests) {
    if (test.Fails()) failing[test.camera].insert(test.kind);
  }
  std::string text;
  for (const auto& [camera, kinds] : failing) {
    for (const StressKind kind : kinds) {
      text += fmt::format("{}: {}{}.\n",
                          camera,
                          kinds.size() == 1 ? "only " : "",
                          kReadings[static_cast<size_t>(kind)]);
    }
  }
  return text;
}

}  // namespace plenocal
