// SPDX-License-Identifier: Apache-2.0
#include "assess/frames/frame_selection.h"

#include <algorithm>
#include <limits>
#include <optional>

#include "assess/views/information_state.h"
#include "assess/views/view_information.h"
#include "calib/base/parallel.h"

namespace plenocal {
namespace {

constexpr size_t kGainMarkers = 40;  // of a target: more of them change the order little
constexpr double kEnough = 1.02;     // sigma over that of all frames, below which more add little

}  // namespace

FrameSelection SelectFrames(const RigEstimate& rig,
                            const ViewTarget& shape,
                            const std::vector<RigidTransform>& T_rig_target,
                            size_t most,
                            int threads) {
  const std::vector<double> distances = ProjectionDistances(rig.bundle);
  const RigUnknowns unknowns = MakeRigUnknowns(rig.bundle, distances[0]);
  const ViewPredictor predictor(rig, unknowns, shape);
  const ProjectionSigma projection(rig, unknowns, distances);
  std::vector<std::optional<Eigen::MatrixXd>> information(T_rig_target.size());
  ParallelFor(T_rig_target.size(), threads, [&](size_t i) {
    information[i] = predictor.Information(T_rig_target[i], kGainMarkers);
  });
  const Eigen::Index size = unknowns.unit.size();
  const Eigen::MatrixXd prior = Eigen::MatrixXd::Identity(size, size);
  FrameSelection result;
  InformationState all(prior, unknowns.head, projection);
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(size, size);
  for (const auto& of_frame : information) {
    if (of_frame) sum += *of_frame;
  }
  all.Add(sum);
  result.sigma_of_all = all.Sigma();
  InformationState state(prior, unknowns.head, projection);
  while (result.chosen.size() < most) {
    std::vector<double> gains(information.size(), -std::numeric_limits<double>::infinity());
    ParallelFor(information.size(), threads, [&](size_t i) {
      if (information[i]) gains[i] = state.Gain(*information[i]);
    });
    const auto best = std::ranges::max_element(gains);
    if (best == gains.end() || !(*best > 0)) break;
    const auto index = static_cast<size_t>(best - gains.begin());
    state.Add(*information[index]);
    information[index].reset();
    result.chosen.push_back(index);
    result.sigma.push_back(state.Sigma());
    if (state.IsDetermined() && state.Sigma() < kEnough * result.sigma_of_all) break;
  }
  return result;
}

}  // namespace plenocal
