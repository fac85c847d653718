// SPDX-License-Identifier: Apache-2.0
#include "assess/stress/stress.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>
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
// The near half's distance over the far half's. Of what changes between a distance and far away,
// these halves differ by a tenth.
constexpr double kMostAlike = 0.9;
constexpr double kOuter = 0.7;  // of half the diagonal

// Points of `part` against the others.
struct Split {
  StressKind kind = StressKind::kChance;
  std::string name;
  bool is_region = false;  // `part` are the points outside of it, from which alone is calibrated
  PartOfObservations part = {};
  std::string failure = {};
};

class Splits {
 public:
  Splits(const Bundle& bundle, std::span<const size_t> cameras)
      : bundle_(bundle), cameras_(cameras.begin(), cameras.end()) {
    std::map<int, std::vector<double>> distances;  // by frame
    for (const BundleObservation& each : bundle.observations) {
      const auto c = static_cast<size_t>(each.camera);
      if (!each.used || !cameras_.contains(c)) continue;
      const RigidTransform T = bundle.cameras[c].T_camera_rig *
                               bundle.SeenPose(static_cast<size_t>(each.frame), c);
      distances[each.frame].push_back(
          (T * bundle.markers[static_cast<size_t>(each.marker)].position).norm());
    }
    for (auto& [frame, of_points] : distances) {
      place_[frame] = order_.size();
      order_.push_back(Median(std::move(of_points)));
    }
  }

  [[nodiscard]] size_t Frames() const { return order_.size(); }

  [[nodiscard]] std::vector<Split> All() const {
    std::vector<Split> splits{
        {StressKind::kChance, "odd/even", false, ByFrame([](size_t i) { return i % 2 == 0; })},
        {StressKind::kTime,
         "first/second",
         false,
         ByFrame([&](size_t i) { return 2 * i < order_.size(); })},
        NearAndFar()};
    const auto add = [&](const char* name, bool is_region, const auto& has) {
      splits.push_back({StressKind::kRegion, name, is_region, ByPlace(has)});
    };
    add("left/right", false, [](const Eigen::Vector2d& m) { return m.x() < 0; });
    add("outside", true, [](const Eigen::Vector2d& m) { return m.norm() < kOuter; });
    add("upper left", true, [](const Eigen::Vector2d& m) { return m.x() >= 0 || m.y() >= 0; });
    add("upper right", true, [](const Eigen::Vector2d& m) { return m.x() < 0 || m.y() >= 0; });
    add("lower left", true, [](const Eigen::Vector2d& m) { return m.x() >= 0 || m.y() < 0; });
    add("lower right", true, [](const Eigen::Vector2d& m) { return m.x() < 0 || m.y() < 0; });
    return splits;
  }

 private:
  // `has` of a frame's place among those with points.
  template <typename Has>
  [[nodiscard]] PartOfObservations ByFrame(const Has& has) const {
    PartOfObservations part;
    for (const BundleObservation& each : bundle_.observations) {
      const auto found = place_.find(each.frame);
      part.push_back(found != place_.end() && has(found->second));
    }
    return part;
  }

  // `has` of a place in the image from its middle, half the diagonal long at the corners. Other
  // cameras have all points in each part.
  template <typename Has>
  [[nodiscard]] PartOfObservations ByPlace(const Has& has) const {
    PartOfObservations part;
    for (const BundleObservation& each : bundle_.observations) {
      const auto c = static_cast<size_t>(each.camera);
      const ImageSize& size = bundle_.cameras[c].image_size;
      const Eigen::Vector2d half(size[0] / 2.0, size[1] / 2.0);
      const Eigen::Vector2d u(each.seen.values[0] + 0.5, each.seen.values[1] + 0.5);
      part.push_back(!cameras_.contains(c) || has((u - half) / half.norm()));
    }
    return part;
  }

  [[nodiscard]] Split NearAndFar() const {
    Split split{StressKind::kDistance, "near/far"};
    std::vector<size_t> sorted(order_.size());
    std::iota(sorted.begin(), sorted.end(), size_t{0});
    std::ranges::stable_sort(sorted, {}, [&](size_t i) { return order_[i]; });
    const auto middle = static_cast<std::ptrdiff_t>(sorted.size() / 2);
    const std::set<size_t> near(sorted.begin(), sorted.begin() + middle);
    split.part = ByFrame([&](size_t i) { return near.contains(i); });
    const double ratio = order_[sorted[sorted.size() / 4]] / order_[sorted[3 * sorted.size() / 4]];
    if (ratio > kMostAlike) {
      split.failure = fmt::format("the frames' distances differ by {:.0f} % only", 100 / ratio - 100);
    }
    return split;
  }

  const Bundle& bundle_;
  std::set<size_t> cameras_;
  std::map<int, size_t> place_;
  std::vector<double> order_;  // distances of the frames with points
};

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

bool StressTest::Fails() const { return failure.empty() && probability < kFalseAlarms; }

StressTests TestStress(const Calibration& calibration,
                       std::span<const size_t> cameras,
                       const StressOptions& options) {
  StressTests result;
  const Splits of_points(calibration.bundle, cameras);
  if (of_points.Frames() < kFewestFrames) {
    result.failure = fmt::format("{}; stress tests need {}",
                                 Counted(of_points.Frames(), "frame"),
                                 kFewestFrames);
    return result;
  }
  const std::vector<Split> splits = of_points.All();
  std::vector<std::array<PartCalibration, 2>> parts(splits.size());
  ParallelFor(2 * splits.size(), options.threads, [&](size_t i) {
    const Split& split = splits[i / 2];
    if (!split.failure.empty() || (split.is_region && i % 2 == 1)) return;
    PartOfObservations part = split.part;
    if (i % 2 == 1) part.flip();
    parts[i / 2][i % 2] = CalibratePart(calibration, part, options.loss, options.go_on);
  });
  for (const size_t c : cameras) {
    for (size_t s = 0; s < splits.size(); ++s) {
      const auto& [first, second] = parts[s];
      StressTest test{.camera = calibration.bundle.cameras[c].name,
                      .kind = splits[s].kind,
                      .split = splits[s].name};
      test.failure = splits[s].failure + first.failure;
      if (test.failure.empty()) test.failure = second.failure;
      if (test.failure.empty() && splits[s].is_region) {
        TestLeftOutRegion(calibration, splits[s].part, first, c, &test);
      } else if (test.failure.empty()) {
        CompareHalves(calibration, splits[s].part, parts[s], c, &test);
      }
      result.tests.push_back(std::move(test));
    }
  }
  for (StressTest& t : result.tests) t.raw = t.probability;
  CorrectByHolm(&result.tests);
  return result;
}

std::vector<std::string> StressReading(const StressTests& stress) {
  std::map<std::string, std::set<StressKind>> failing;
  for (const StressTest& test : stress.tests) {
    if (test.Fails()) failing[test.camera].insert(test.kind);
  }
  std::vector<std::string> lines;
  for (const auto& [camera, kinds] : failing) {
    const char* what =
        kinds.contains(StressKind::kChance)
            ? "odd and even frames differ: noise or outliers are misjudged"
        : kinds.size() > 1 ? "several kinds"
        : *kinds.begin() == StressKind::kTime
            ? "only the recording's first and second half differ: the camera moved or warmed"
        : *kinds.begin() == StressKind::kDistance
            ? "only near and far frames differ: the camera is not central, or its focus breathes"
            : "only regions of the image differ: the model is too stiff";
    lines.push_back(fmt::format("{}: {}.", camera, what));
  }
  return lines;
}

}  // namespace plenocal
