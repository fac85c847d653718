// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/rig_rigidity.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "calib/adjust/poses.h"
#include "calib/base/statistics.h"
#include "calib/estimate/reject.h"
#include "calib/noise/camera_noise.h"

namespace plenocal {
namespace {

constexpr double kSmallestJitter = 1e-12;  // m and rad; less counts as none

double LargestNoise(const Bundle& bundle, std::span<const double> typical_sigmas) {
  double noise = 0;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    noise = std::max(noise, bundle.cameras[c].noise.Sigma(typical_sigmas[c]));
  }
  return noise;
}

}  // namespace

bool FramesAgree(const Bundle& bundle,
                 const Uncertainty& uncertainty,
                 std::span<const double> typical_sigmas) {
  const size_t cameras = bundle.cameras.size();
  if (cameras == 1 || LargestNoise(bundle, typical_sigmas) < kRoundingNoise) return true;
  const std::vector<PoseStep> steps = OwnPoseSteps(bundle);
  const std::vector<double> coordinates = UsedCoordinates(bundle);
  std::set<int> frames;
  std::vector<double> gain(cameras, 0.0), own_unknowns(cameras, 0.0);
  for (const PoseStep& step : steps) {
    frames.insert(step.frame);
    gain[static_cast<size_t>(step.camera)] += step.gain;
    own_unknowns[static_cast<size_t>(step.camera)] += 6;
  }
  // A disagreement that dominates a camera's residuals is in the noise of some cameras, and the
  // others have taken all the weight.
  constexpr double kDominates = 0.5;  // part of the residuals that is left without it
  double all_gain = 0, squares = 0;
  bool dominates = false;
  for (size_t c = 0; c < cameras; ++c) {
    // The noise is such that a camera's sum of squares equals its redundancy.
    const double own_squares = uncertainty.redundancy[c];
    const double own_redundancy =
        coordinates[c] - own_unknowns[c] - static_cast<double>(bundle.cameras[c].params.size());
    dominates = dominates || (own_squares - gain[c]) / own_redundancy < kDominates;
    all_gain += gain[c];
    squares += own_squares;
  }
  // Less the degrees of freedom that the poses of the frames and the extrinsics have used.
  const double unknowns =
      6.0 * (static_cast<double>(steps.size()) - static_cast<double>(frames.size() + cameras - 1));
  const double rest = squares - unknowns;
  if (!dominates || unknowns <= 0 || rest <= 0) return true;
  return FTail(all_gain / unknowns / ((squares - all_gain) / rest), unknowns, rest) > kFalseAlarm;
}

void StartJitter(std::span<const CameraInput> cameras,
                 std::span<const CameraGuess> guesses,
                 const std::vector<std::string>& frames,
                 Bundle* bundle) {
  std::map<std::string, size_t> index;
  for (size_t f = 0; f < frames.size(); ++f) index[frames[f]] = f;
  Jitter& jitter = bundle->jitter;
  jitter.translation_sigma = jitter.rotation_sigma = 1;
  jitter.delta.assign(frames.size() * cameras.size(), Vector6d::Zero());
  jitter.misplaced.assign(jitter.delta.size(), false);
  std::vector<double> displacements, rotations;
  for (size_t c = 0; c < cameras.size(); ++c) {
    const RigidTransform T_rig_camera = bundle->cameras[c].T_camera_rig.Inverse();
    for (size_t v = 0; v < cameras[c].views.size(); ++v) {
      const auto frame = index.find(cameras[c].views[v].frame);
      const auto& T_camera_target = guesses[c].T_camera_target[v];
      if (frame == index.end() || !T_camera_target) continue;
      const RigidTransform seen = T_rig_camera * *T_camera_target;
      const RigidTransform shared = bundle->PoseAtView(frame->second, c);
      const Vector6d delta = LocalCoordinates(shared, seen);
      jitter.delta[bundle->View(frame->second, c)] = delta;
      const Vector6d error = JitterWeight(*bundle, frame->second) * delta;
      if (error.norm() < kSmallestJitter) continue;  // the view that gave the frame its pose
      displacements.push_back(error.head<3>().norm());
      rotations.push_back(error.tail<3>().norm());
    }
  }
  const double median = std::sqrt(ChiSquareQuantile(3, 0.5));
  jitter.translation_sigma = std::max(Median(displacements) / median, kSmallestJitter);
  jitter.rotation_sigma = std::max(Median(rotations) / median, kSmallestJitter);
}

double UpdateJitter(const Uncertainty& uncertainty, Bundle* bundle) {
  Jitter& jitter = bundle->jitter;
  if (!bundle->EstimatesJitter()) return 0;
  std::set<std::pair<int, int>> used;  // (frame, camera)
  for (const BundleObservation& observation : bundle->observations) {
    if (observation.used) used.emplace(observation.frame, observation.camera);
  }
  double displacements = 0, rotations = 0;  // sums of squares in sigmas
  std::vector<Vector6d> errors;             // parallel to `used`
  for (const auto& [frame, camera] : used) {
    const auto f = static_cast<size_t>(frame);
    const size_t view = bundle->View(f, static_cast<size_t>(camera));
    const Vector6d error = JitterWeight(*bundle, f) * jitter.delta[view];
    errors.push_back(error);
    if (jitter.misplaced[view]) continue;
    displacements += error.head<3>().squaredNorm();
    rotations += error.tail<3>().squaredNorm();
  }
  const auto factor = [](double squares, double redundancy) {
    return redundancy > 0 ? std::sqrt(squares / redundancy) : 1;
  };
  const double displacement = factor(displacements, uncertainty.jitter_translation_redundancy);
  const double rotation = factor(rotations, uncertainty.jitter_rotation_redundancy);
  jitter.translation_sigma = std::max(displacement * jitter.translation_sigma, kSmallestJitter);
  jitter.rotation_sigma = std::max(rotation * jitter.rotation_sigma, kSmallestJitter);

  const double limit = ChiSquareQuantile(6, kFalseRejections / static_cast<double>(used.size()));
  auto error = errors.begin();
  for (const auto& [frame, camera] : used) {
    const size_t view = bundle->View(static_cast<size_t>(frame), static_cast<size_t>(camera));
    jitter.misplaced[view] = error->head<3>().squaredNorm() / (displacement * displacement) +
                                 error->tail<3>().squaredNorm() / (rotation * rotation) >
                             limit;
    ++error;
  }
  return std::max(std::abs(displacement - 1), std::abs(rotation - 1));
}

}  // namespace plenocal
