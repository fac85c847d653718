// SPDX-License-Identifier: Apache-2.0
#include "assess/frames/exclusion_preview.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <vector>

#include "assess/views/information_state.h"
#include "assess/views/projection_sigma.h"
#include "assess/views/view_information.h"
#include "calib/base/linear_algebra.h"

namespace plenocal {
namespace {

// Sums over the used points: squared residuals, px^2 and in sigmas, and their number.
Eigen::Array3d ResidualSums(const Bundle& bundle) {
  Eigen::Array3d sums = Eigen::Array3d::Zero();
  for (const BundleObservation& observation : bundle.observations) {
    double residual[kMaxObservationSize];
    if (!observation.used || !Residual(bundle, observation, residual)) continue;
    const double square = residual[0] * residual[0] + residual[1] * residual[1];
    sums +=
        Eigen::Array3d(square, square / (observation.assumed_sigma * observation.assumed_sigma), 1);
  }
  return sums;
}

double RmsOf(const Eigen::Array3d& sums) {
  return sums[2] > 0 ? std::sqrt(std::max(0.0, sums[0]) / sums[2]) : 0;
}

// Information of frames and J' W r of their residuals.
struct Normal {
  Eigen::MatrixXd information;
  Eigen::VectorXd gradient;

  Normal(const RigEstimate& rig, const RigUnknowns& unknowns, const ViewTarget& shape)
      : information(Eigen::MatrixXd::Identity(unknowns.unit.size(), unknowns.unit.size())),
        gradient(Eigen::VectorXd::Zero(unknowns.unit.size())) {
    ViewPredictor(rig, unknowns, shape)
        .ForFrames([&](const ViewPredictor::FrameInformation& frame) {
          information += frame.information;
          gradient += frame.gradient;
        });
  }
};

}  // namespace

ExclusionPreview PreviewExclusion(RigEstimate rig,
                                  const ViewTarget& shape,
                                  const std::function<bool(const BundleObservation&)>& leaves_out) {
  ExclusionPreview preview;
  std::set<int> frames;  // that lose points
  for (const BundleObservation& each : rig.bundle.observations) {
    if (each.used && leaves_out(each)) frames.insert(each.frame);
  }
  const std::vector<double> distances = ProjectionDistances(rig.bundle);
  const RigUnknowns unknowns = MakeRigUnknowns(rig.bundle, distances[0]);
  const ProjectionSigma projection(rig, unknowns, distances);
  const Normal all(rig, unknowns, shape);
  const Eigen::Array3d residuals = ResidualSums(rig.bundle);
  // Of these frames only, with and without the points.
  std::erase_if(rig.bundle.observations,
                [&](const BundleObservation& each) { return !frames.contains(each.frame); });
  const Normal with(rig, unknowns, shape);
  const Eigen::Array3d residuals_with = ResidualSums(rig.bundle);
  for (BundleObservation& each : rig.bundle.observations) {
    if (!each.used || !leaves_out(each)) continue;
    each.used = false;
    ++preview.points;
  }
  const Normal without(rig, unknowns, shape);
  const Eigen::Array3d residuals_without = ResidualSums(rig.bundle);

  const InformationState before(all.information, unknowns.head, projection);
  const Eigen::MatrixXd information = all.information - with.information + without.information;
  const InformationState after(information, unknowns.head, projection);
  preview.sigma_before = before.SigmaOfImages();
  preview.sigma_after = after.SigmaOfImages();

  // The adjustment has balanced the gradients of all frames.
  const Eigen::VectorXd gradient = without.gradient - with.gradient;
  const Eigen::VectorXd change = information.ldlt().solve(gradient);
  const Eigen::VectorXd sigma = before.Covariance()
                                    .diagonal()
                                    .cwiseSqrt()
                                    .cwiseProduct(UnknownScales(rig, unknowns))
                                    .cwiseQuotient(unknowns.unit);
  for (Eigen::Index k = 0; k < unknowns.head; ++k) {
    const double sigmas = std::abs(change[k]) / sigma[k];
    if (!(sigmas > preview.sigmas)) continue;
    preview.sigmas = sigmas;
    preview.unknown = unknowns.names[static_cast<size_t>(k)];
  }
  const Eigen::Array3d left = residuals - residuals_with + residuals_without;
  preview.rms_before = RmsOf(residuals);
  const double gained = left[1] > 0 ? gradient.dot(change) / left[1] : 0;
  preview.rms_after = RmsOf(left) * std::sqrt(std::clamp(1 - gained, 0.0, 1.0));
  return preview;
}

}  // namespace plenocal
