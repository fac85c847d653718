// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/frames/time_pairs.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "calib/base/robust.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

/// Index of the value that is nearest to `time`; of two the earlier one. `sorted` is not empty.
size_t NearestIndex(const std::vector<double>& sorted, double time) {
  const auto after = std::ranges::lower_bound(sorted, time);
  const auto index = static_cast<size_t>(after - sorted.begin());
  if (after == sorted.begin()) return 0;
  if (after == sorted.end()) return index - 1;
  return time - sorted[index - 1] <= sorted[index] - time ? index - 1 : index;
}

/// The index in `sorted` of the nearest value of each value, if both are nearest to each other.
std::vector<std::optional<size_t>> Mutual(const std::vector<double>& values,
                                          const std::vector<double>& sorted) {
  std::vector<std::optional<size_t>> nearest(values.size());
  if (sorted.empty()) return nearest;
  for (size_t i = 0; i < values.size(); ++i) {
    const size_t j = NearestIndex(sorted, values[i]);
    if (NearestIndex(values, sorted[j]) == i) nearest[i] = j;
  }
  return nearest;
}

double ToleranceOf(const std::vector<std::vector<double>>& times) {
  constexpr double kSigmas = 5, kResolution = 1e-3;  // s
  double tolerance = 0;
  for (size_t c = 1; c < times.size(); ++c) {
    const auto nearest = Mutual(times[c], times[0]);
    std::vector<double> differences;
    for (size_t i = 0; i < nearest.size(); ++i) {
      if (nearest[i]) differences.push_back(times[c][i] - times[0][*nearest[i]]);
    }
    const double median = Median(differences);
    for (double& difference : differences) difference = std::abs(difference - median);
    const double sigma = kSigmaPerMad * Median(std::move(differences));
    tolerance = std::max(tolerance, std::abs(median) + kSigmas * sigma + kResolution);
  }
  const double interval = times.empty() ? 0 : UsualInterval(times[0]);
  return interval > 0 ? std::min(tolerance, interval / 2) : tolerance;
}

}  // namespace

size_t FirstCamera(const std::vector<std::optional<size_t>>& images) {
  const auto has = std::ranges::find_if(images, [](const auto& i) { return i.has_value(); });
  return static_cast<size_t>(has - images.begin());
}

double UsualInterval(const std::vector<double>& values) {
  std::vector<double> intervals;
  for (size_t i = 1; i < values.size(); ++i) intervals.push_back(values[i] - values[i - 1]);
  return Median(std::move(intervals));
}

TimePairs PairTimes(const std::vector<std::vector<double>>& times,
                    std::optional<double> tolerance) {
  using Frame = std::pair<double, std::vector<std::optional<size_t>>>;
  TimePairs pairs{.frames = {}, .tolerance = tolerance ? *tolerance : ToleranceOf(times)};
  std::vector<Frame> frames;
  for (size_t c = 0; c < times.size(); ++c) {
    std::vector<double> frame_times;
    for (const Frame& frame : frames) frame_times.push_back(frame.first);
    const auto nearest = Mutual(times[c], frame_times);
    std::vector<Frame> alone;
    for (size_t i = 0; i < times[c].size(); ++i) {
      if (nearest[i] && std::abs(times[c][i] - frame_times[*nearest[i]]) <= pairs.tolerance) {
        frames[*nearest[i]].second[c] = i;
        continue;
      }
      alone.emplace_back(times[c][i], std::vector<std::optional<size_t>>(times.size()));
      alone.back().second[c] = i;
    }
    std::ranges::move(alone, std::back_inserter(frames));
    std::ranges::stable_sort(frames, {}, &Frame::first);
  }
  for (Frame& frame : frames) pairs.frames.push_back(std::move(frame.second));
  return pairs;
}

}  // namespace plenocal
