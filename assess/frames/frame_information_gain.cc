// SPDX-License-Identifier: Apache-2.0
#include "assess/frames/frame_information_gain.h"

#include <algorithm>
#include <map>
#include <optional>
#include <utility>

#include "assess/views/information_state.h"
#include "assess/views/view_information.h"

namespace plenocal {
namespace {

// The only frame of a rig without frames.
void Append(const RigidTransform& T_rig_target, const std::vector<View>& views, RigEstimate* rig) {
  Bundle& bundle = rig->bundle;
  std::map<int, int> index;
  for (size_t m = 0; m < bundle.markers.size(); ++m) {
    index[bundle.markers[m].number] = static_cast<int>(m);
  }
  const auto frame = static_cast<int>(bundle.T_rig_target.size());
  bundle.T_rig_target.push_back(T_rig_target);
  for (size_t c = 0; c < views.size(); ++c) {
    const size_t first = bundle.observations.size();
    for (const Observation& seen : views[c].observations) {
      const auto marker = index.find(seen.marker);
      if (marker == index.end()) continue;
      bundle.observations.push_back({.camera = static_cast<int>(c),
                                     .frame = frame,
                                     .marker = marker->second,
                                     .seen = seen,
                                     .assumed_sigma = rig->sigma_px[c]});
    }
    std::ranges::stable_sort(bundle.observations.begin() + static_cast<std::ptrdiff_t>(first),
                             bundle.observations.end(),
                             {},
                             &BundleObservation::marker);
  }
}

RigEstimate WithoutFrames(RigEstimate rig) {
  rig.bundle.T_rig_target.clear();
  rig.bundle.observations.clear();
  rig.bundle.jitter.delta.clear();
  rig.bundle.jitter.misplaced.clear();
  return rig;
}

}  // namespace

// What follows from the frames so far.
struct FrameGainEvaluator::State {
  State(const RigEstimate& rig, const ViewTarget& of_target, const NextViews& best)
      : without_frames(WithoutFrames(rig)),
        shape(of_target),
        unknowns(MakeRigUnknowns(rig.bundle, best.distances[0])),
        projection(rig, unknowns, best.distances),
        information(
            ViewPredictor(rig, unknowns, shape).InformationSoFar(), unknowns.head, projection) {
    if (best.views.empty()) return;
    const auto more = ViewPredictor(rig, unknowns, shape)
                          .Information(best.views[0].T_rig_target, shape.markers.size());
    if (more) best_gain = information.Gain(*more);
  }

  RigEstimate without_frames;
  ViewTarget shape;
  RigUnknowns unknowns;
  ProjectionSigma projection;
  InformationState information;
  double best_gain = 0;
};

FrameGainEvaluator::FrameGainEvaluator(const RigEstimate& rig,
                                       const ViewTarget& shape,
                                       const NextViews& best)
    : state_(std::make_unique<State>(rig, shape, best)) {}

FrameGainEvaluator::FrameGainEvaluator(FrameGainEvaluator&&) noexcept = default;
FrameGainEvaluator& FrameGainEvaluator::operator=(FrameGainEvaluator&&) noexcept = default;
FrameGainEvaluator::~FrameGainEvaluator() = default;

FrameInformationGain FrameGainEvaluator::Evaluate(const RigidTransform& T_rig_target,
                                                  const std::vector<View>& views) const {
  RigEstimate one = state_->without_frames;
  Append(T_rig_target, views, &one);
  FrameInformationGain gain;
  gain.sigma_before = gain.sigma_after = state_->information.SigmaOfImages();
  ViewPredictor(one, state_->unknowns, state_->shape)
      .ForFrames([&](const ViewPredictor::FrameInformation& of_frame) {
        const double lowered = state_->information.Gain(of_frame.information);
        if (state_->best_gain > 0) gain.share = std::max(0.0, lowered / state_->best_gain);
        InformationState with = state_->information;
        with.Add(of_frame.information);
        gain.sigma_after = with.SigmaOfImages();
      });
  return gain;
}

}  // namespace plenocal
