// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/jackknife.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <map>
#include <mutex>
#include <set>
#include <utility>

#include "calib/adjust/solver/adjust.h"
#include "calib/base/format_error.h"
#include "calib/base/parallel.h"

namespace plenocal {
namespace {

// All cameras' numbers: of each its parameters, then the se(3) vector.
Eigen::VectorXd Numbers(const std::vector<BundleCamera>& cameras) {
  std::vector<double> numbers;
  for (const BundleCamera& camera : cameras) {
    numbers.insert(numbers.end(), camera.params.begin(), camera.params.end());
    const Vector6d xi = Log(camera.T_camera_rig);
    numbers.insert(numbers.end(), xi.begin(), xi.end());
  }
  return Eigen::Map<const Eigen::VectorXd>(numbers.data(), std::ssize(numbers));
}

}  // namespace

Jackknife EstimateByJackknife(const Bundle& bundle, const JackknifeOptions& options) {
  std::map<int, size_t> group_of;  // of frames with used observations, successive ones together
  for (const BundleObservation& observation : bundle.observations) {
    if (observation.used) group_of[observation.frame];
  }
  const size_t groups = std::min(group_of.size(), static_cast<size_t>(options.groups));
  if (groups < 2) {
    throw JobError("the jackknife over frames needs two frames or more");
  }
  size_t position = 0;
  for (auto& [frame, group] : group_of) group = position++ * groups / group_of.size();
  std::vector<std::set<size_t>> seen_by(bundle.cameras.size());
  for (const BundleObservation& observation : bundle.observations) {
    if (!observation.used) continue;
    seen_by[static_cast<size_t>(observation.camera)].insert(group_of[observation.frame]);
  }
  Eigen::MatrixXd results(Numbers(bundle.cameras).size(), static_cast<Eigen::Index>(groups));
  std::atomic<size_t> done{0};
  std::atomic<bool> stop{false};
  std::mutex mutex;
  ParallelFor(groups, options.threads, [&](size_t g) {
    if (stop) return;
    Bundle rest = bundle;
    for (BundleObservation& observation : rest.observations) {
      observation.used = observation.used && group_of.at(observation.frame) != g;
    }
    AdjustOptions adjust;
    adjust.loss = options.loss;
    adjust.cost_tolerance = options.cost_tolerance;
    const AdjustSummary summary = Adjust(&rest, adjust);
    if (!summary.usable) throw Error(ErrorKind::kJob, "the jackknife failed: " + summary.message);
    results.col(static_cast<Eigen::Index>(g)) = Numbers(rest.cameras);
    const std::lock_guard lock(mutex);
    if (options.progress && !options.progress(++done, groups)) stop = true;
  });
  if (stop) throw Stopped();

  // sqrt((G - 1) / G sum (x_g - mean)^2); a group that does not see a camera leaves it unchanged.
  const auto count = static_cast<double>(groups);
  const Eigen::VectorXd mean = results.rowwise().mean();
  const Eigen::VectorXd all =
      ((results.colwise() - mean).rowwise().squaredNorm() * (count - 1) / count).cwiseSqrt();
  Eigen::Index first = 0;
  Jackknife jackknife{static_cast<int>(groups), {}, {}};
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const auto params = std::ssize(bundle.cameras[c].params);
    Eigen::VectorXd errors = all.segment(std::exchange(first, first + params + 6), params + 6);
    if (seen_by[c].size() < 2) errors.setConstant(std::numeric_limits<double>::infinity());
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
