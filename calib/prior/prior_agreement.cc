// SPDX-License-Identifier: Apache-2.0
#include "calib/prior/prior_agreement.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>

#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

// Directions of which the new images take less than this part of the prior's variance test rounding
// and nothing else.
constexpr double kLeastGained = 1e-3;
// A component is named from this many standard deviations on.
constexpr double kNamedSigmas = 3;
constexpr size_t kMostNamed = 4;

// Covariance of the prior's unknowns with the new images.
Eigen::MatrixXd CovarianceWithImages(const Bundle& bundle, const Uncertainty& uncertainty) {
  const std::vector<CalibrationPrior::Unknown>& unknowns = bundle.prior->unknowns;
  std::vector<int> index;
  for (const CalibrationPrior::Unknown& unknown : unknowns) {
    const int first = uncertainty.extrinsics_index[unknown.camera];
    index.push_back(unknown.param ? uncertainty.param_index[unknown.camera][*unknown.param]
                    : first < 0   ? -1
                                  : first + static_cast<int>(unknown.component));
  }
  const auto count = static_cast<Eigen::Index>(unknowns.size());
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(count, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    for (Eigen::Index j = 0; j < count; ++j) {
      const int a = index[static_cast<size_t>(i)], b = index[static_cast<size_t>(j)];
      if (a >= 0 && b >= 0) covariance(i, j) = uncertainty.covariance(a, b);
    }
  }
  return covariance;
}

// Chance of a deviation at least this large from a correct prior.
double ChanceOfDeviation(const CalibrationPrior& prior,
                         const Eigen::VectorXd& deviation,
                         const Eigen::MatrixXd& covariance) {
  const Eigen::MatrixXd& W = prior.weight;
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(W.rows(), W.rows());
  const SymmetricEigen gained =
      DecomposeSymmetric(Eigen::MatrixXd(identity - W * covariance * W.transpose()));
  const Eigen::VectorXd along = gained.vectors.transpose() * (W * deviation);
  double squares = 0;
  int directions = 0;
  for (Eigen::Index i = 0; i < along.size(); ++i) {
    if (gained.values[i] < kLeastGained) continue;
    squares += along[i] * along[i] / gained.values[i];
    ++directions;
  }
  return directions == 0 ? 1 : ChiSquareTail(directions, squares);
}

// RMS displacement of the camera's points when one unknown has the prior's value, px.
double EffectInImage(const Bundle& bundle, const CalibrationPrior::Unknown& unknown, double by) {
  Bundle moved = bundle;
  BundleCamera& camera = moved.cameras[unknown.camera];
  if (unknown.param) {
    camera.params[*unknown.param] -= by;
  } else {
    Vector6d delta = Vector6d::Zero();
    delta[unknown.component] = -by;
    camera.T_camera_rig = Retract(camera.T_camera_rig, delta);
  }
  double squares = 0, count = 0;
  const auto here = Residuals(bundle, unknown.camera), there = Residuals(moved, unknown.camera);
  for (size_t i = 0; i < here.size(); ++i) {
    if (!bundle.observations[i].used || std::isnan(here[i][0]) || std::isnan(there[i][0])) continue;
    for (size_t r = 0; r < camera.model->measured.size(); ++r) {
      squares += (here[i][r] - there[i][r]) * (here[i][r] - there[i][r]);
    }
    ++count;
  }
  return count > 0 ? std::sqrt(squares / count) : 0;
}

struct Contradiction {
  size_t unknown = 0;
  double sigmas = 0, effect_px = 0, deviation = 0, prior_sigma = 0;
};

std::vector<Contradiction> FindContradictions(const Bundle& bundle,
                                              const Eigen::VectorXd& deviation,
                                              const Eigen::MatrixXd& covariance) {
  const CalibrationPrior& prior = *bundle.prior;
  const Eigen::MatrixXd root = Inverse(prior.weight);
  std::vector<Contradiction> found;
  for (Eigen::Index i = 0; i < deviation.size(); ++i) {
    const double of_prior = root.row(i).squaredNorm(), gained = of_prior - covariance(i, i);
    if (gained < kLeastGained * of_prior) continue;
    const double sigmas = std::abs(deviation[i]) / std::sqrt(gained);
    if (sigmas < kNamedSigmas) continue;
    const auto k = static_cast<size_t>(i);
    found.push_back({.unknown = k,
                     .sigmas = sigmas,
                     .effect_px = EffectInImage(bundle, prior.unknowns[k], deviation[i]),
                     .deviation = deviation[i],
                     .prior_sigma = std::sqrt(of_prior)});
  }
  std::ranges::stable_sort(found, std::greater<>(), &Contradiction::effect_px);
  return found;
}

Finding FindingOfContradiction(const Bundle& bundle, const Contradiction& contradiction) {
  const CalibrationPrior::Unknown& unknown = bundle.prior->unknowns[contradiction.unknown];
  const BundleCamera& camera = bundle.cameras[unknown.camera];
  const std::string values = unknown.param
                                 ? fmt::format("{:.6g} +- {:.2g}, with the images {:.6g}",
                                               unknown.value,
                                               contradiction.prior_sigma,
                                               unknown.value + contradiction.deviation)
                                 : fmt::format("known to {:.2g} {}, with the images {:.3g} off",
                                               contradiction.prior_sigma,
                                               unknown.component < 3 ? "m" : "rad",
                                               contradiction.deviation);
  return {.code = "prior_contradicted",
          .grade = Grade::kUsable,
          .cameras = {camera.name},
          .value = contradiction.sigmas,
          .limit = kNamedSigmas,
          .what = fmt::format("{}: the images contradict the earlier calibration by {:.1f} sigma, "
                              "{:.2g} px in the image ({}).",
                              NameOfPriorUnknown(bundle, contradiction.unknown),
                              contradiction.sigmas,
                              contradiction.effect_px,
                              values),
          .remedy = fmt::format(
              "Was the {}? Then take the prior away: 'free: [{}]' for {}. Else look for what is "
              "wrong in the new images or in the earlier calibration.",
              unknown.param ? "lens refocused or exchanged" : "camera moved on the rig",
              unknown.param ? camera.model->params[*unknown.param].name : "extrinsics",
              camera.name)};
}

}  // namespace

std::vector<Finding> FindingsOfPrior(const Bundle& bundle, const Uncertainty& uncertainty) {
  if (!bundle.prior) return {};
  const Eigen::VectorXd deviation = DeviationFromPrior(bundle);
  const Eigen::MatrixXd covariance = CovarianceWithImages(bundle, uncertainty);
  if (ChanceOfDeviation(*bundle.prior, deviation, covariance) > kFalseAlarm) return {};
  std::vector<Finding> findings;
  for (const Contradiction& contradiction : FindContradictions(bundle, deviation, covariance)) {
    if (findings.size() < kMostNamed)
      findings.push_back(FindingOfContradiction(bundle, contradiction));
  }
  return findings;
}

}  // namespace plenocal
