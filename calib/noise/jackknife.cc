// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/jackknife.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <mutex>
#include <set>

#include "calib/adjust/solver/adjust.h"
#include "calib/base/format_error.h"
#include "calib/base/parallel.h"

namespace plenocal {
namespace {

// One camera's numbers: parameters, then the se(3) vector.
Eigen::VectorXd Numbers(const BundleCamera& camera) {
  Eigen::VectorXd numbers(camera.params.size() + 6);
  numbers << Eigen::Map<const Eigen::VectorXd>(camera.params.data(),
                                               static_cast<Eigen::Index>(camera.params.size())),
      Log(camera.T_camera_rig);
  return numbers;
}

// Group of each frame, successive frames together; `groups` for frames without observations.
std::vector<size_t> GroupFrames(const Bundle& bundle, const std::set<int>& frames, size_t groups) {
  std::vector<size_t> group_of(bundle.T_rig_target.size(), groups);
  size_t position = 0;
  for (const int frame : frames) {
    group_of[static_cast<size_t>(frame)] = position++ * groups / frames.size();
  }
  return group_of;
}

// sqrt((G - 1) / G sum (x_g - mean)^2) of one camera's numbers over the groups. A group that does
// not see the camera leaves it unchanged.
Eigen::VectorXd StandardErrors(const std::vector<std::vector<Eigen::VectorXd>>& results,
                               size_t camera) {
  const auto count = static_cast<double>(results.size());
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(results[0][camera].size());
  for (const auto& result : results) mean += result[camera] / count;
  Eigen::VectorXd variance = Eigen::VectorXd::Zero(mean.size());
  for (const auto& result : results) variance += (result[camera] - mean).cwiseAbs2();
  return (variance * (count - 1) / count).cwiseSqrt();
}

}  // namespace

Jackknife EstimateByJackknife(const Bundle& bundle, const JackknifeOptions& options) {
  std::set<int> frames;
  for (const BundleObservation& observation : bundle.observations) {
    if (observation.used) frames.insert(observation.frame);
  }
  const size_t groups = std::min(frames.size(), static_cast<size_t>(options.groups));
  if (groups < 2) {
    throw JobError("the jackknife over frames needs two frames or more");
  }
  const std::vector<size_t> group_of = GroupFrames(bundle, frames, groups);
  std::vector<std::set<size_t>> seen_by(bundle.cameras.size());
  for (const BundleObservation& observation : bundle.observations) {
    if (!observation.used) continue;
    seen_by[static_cast<size_t>(observation.camera)].insert(
        group_of[static_cast<size_t>(observation.frame)]);
  }
  std::vector<std::vector<Eigen::VectorXd>> results(groups);
  std::atomic<size_t> done{0};
  std::atomic<bool> stop{false};
  std::mutex mutex;
  ParallelFor(groups, options.threads, [&](size_t g) {
    if (stop) return;
    Bundle rest = bundle;
    for (BundleObservation& observation : rest.observations) {
      if (group_of[static_cast<size_t>(observation.frame)] == g) observation.used = false;
    }
    AdjustOptions adjust;
    adjust.loss = options.loss;
    adjust.cost_tolerance = options.cost_tolerance;
    const AdjustSummary summary = Adjust(&rest, adjust);
    if (!summary.usable) throw Error(ErrorKind::kJob, "the jackknife failed: " + summary.message);
    for (const BundleCamera& camera : rest.cameras) results[g].push_back(Numbers(camera));
    const std::lock_guard lock(mutex);
    if (options.progress && !options.progress(++done, groups)) stop = true;
  });
  if (stop) throw Stopped();

  Jackknife jackknife{static_cast<int>(groups), {}, {}};
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    Eigen::VectorXd errors = StandardErrors(results, c);
    if (seen_by[c].size() < 2) errors.setConstant(std::numeric_limits<double>::infinity());
    const auto params = static_cast<Eigen::Index>(bundle.cameras[c].params.size());
    for (Eigen::Index k = 0; k < params; ++k) {
      if (bundle.cameras[c].fixed[static_cast<size_t>(k)]) errors[k] = 0;
    }
    jackknife.param_std_errors.emplace_back(errors.begin(), errors.begin() + params);
    jackknife.extrinsics_std_errors.push_back(
        bundle.cameras[c].is_master ? Vector6d(Vector6d::Zero()) : Vector6d(errors.tail<6>()));
  }
  return jackknife;
}

}  // namespace plenocal
