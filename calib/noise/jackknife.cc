// SPDX-License-Identifier: Apache-2.0
#include "calib/jackknife.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <mutex>
#include <set>

#include "calib/error.h"
#include "calib/parallel.h"

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

}  // namespace

Jackknife EstimateByJackknife(const Bundle& bundle, const JackknifeOptions& options) {
  std::set<int> frames;
  for (const BundleObservation& observation : bundle.observations) {
    if (observation.used) frames.insert(observation.frame);
  }
  const size_t groups = std::min(frames.size(), static_cast<size_t>(options.groups));
  if (groups < 2) {
    throw Error(ErrorKind::kJob, "the jackknife over frames needs two frames or more");
  }
  std::vector<size_t> group_of(bundle.T_rig_target.size(), groups);
  size_t place = 0;
  for (const int frame : frames) {
    group_of[static_cast<size_t>(frame)] = place++ * groups / frames.size();
  }

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
    // A group that does not see the camera leaves it where it was.
    const auto count = static_cast<double>(groups);
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(results[0][c].size());
    for (const auto& result : results) mean += result[c] / count;
    Eigen::VectorXd variance = Eigen::VectorXd::Zero(mean.size());
    for (const auto& result : results) variance += (result[c] - mean).cwiseAbs2();
    Eigen::VectorXd sigma = (variance * (count - 1) / count).cwiseSqrt();
    if (seen_by[c].size() < 2) sigma.setConstant(std::numeric_limits<double>::infinity());
    const auto params = static_cast<Eigen::Index>(bundle.cameras[c].params.size());
    for (Eigen::Index k = 0; k < params; ++k) {
      if (bundle.cameras[c].fixed[static_cast<size_t>(k)]) sigma[k] = 0;
    }
    jackknife.params.emplace_back(sigma.begin(), sigma.begin() + params);
    jackknife.xi.push_back(bundle.cameras[c].is_master ? Vector6d(Vector6d::Zero())
                                                       : Vector6d(sigma.tail<6>()));
  }
  return jackknife;
}

}  // namespace plenocal
