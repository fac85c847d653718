// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/bundle.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/base/names.h"
#include "calib/camera/rays.h"

namespace plenocal {

Eigen::Vector3d BundleState::ByScale(const TargetScale& scale, int marker) const {
  const BundleMarker& of = markers[static_cast<size_t>(marker)];
  if (of.target != scale.target) return Eigen::Vector3d::Zero();
  if (targets.empty()) return scale.axes.cwiseProduct(of.nominal);
  const RigidTransform& T = targets[static_cast<size_t>(of.target)].T_target_own;
  return T.R * scale.axes.cwiseProduct(T.Inverse() * of.nominal);
}

Eigen::Vector3d BundleState::Expected(int marker) const {
  Eigen::Vector3d place = markers[static_cast<size_t>(marker)].nominal;
  for (const TargetScale& scale : scales) place += scale.value * ByScale(scale, marker);
  return place;
}

Vector6d BundleState::MotionIncrement(size_t frame, size_t camera) const {
  const ViewMotion& of_view = motion[View(frame, camera)];
  const BundleCamera& of = cameras[camera];
  Vector6d increment = of_view.at_zero_shift;
  for (size_t k = 0; k < of.nuisances.size(); ++k) {
    if (of.nuisances[k]->pose_rate == nullptr) continue;
    increment += of.params[of.ModelParams() + k] * of.nuisances[k]->pose_rate(of_view);
  }
  return increment;
}

void AddNuisance(const NuisanceKind& kind, double prior_sigma, BundleCamera* camera) {
  camera->at_bound.clear();  // of the adjustment before
  camera->rules.resize(camera->params.size());
  camera->rules.push_back({.prior = ParamRule::Prior{.value = 0, .sigma = prior_sigma}});
  camera->params.push_back(0);
  camera->fixed.push_back(false);
  camera->nuisances.push_back(&kind);
}

void AddSharedErrors(std::span<const View> views, BundleCamera* camera) {
  size_t stated = 0;
  for (const View& view : views) {
    if (view.by_nuisance.empty()) continue;
    stated = std::max(stated, view.by_nuisance[0].size() / camera->model->measured.size());
  }
  while (camera->nuisances.size() < stated) AddNuisance(nuisances::kSharedError, 1, camera);
}

std::string NuisanceName(const BundleCamera& camera, size_t index) {
  const size_t nuisance = index - camera.ModelParams();
  const NuisanceKind& kind = *camera.nuisances[nuisance];
  std::string name = camera.name;
  name.append(".").append(kind.name);
  if (kind.numbered) name.append("_").append(std::to_string(camera.IndexInKind(nuisance) + 1));
  return name;
}

Observation WithoutDisplacement(const BundleObservation& observation, const BundleCamera& camera) {
  Observation seen = observation.seen;
  if (observation.by_nuisance.empty()) return seen;
  for (size_t k = 0; k < camera.nuisances.size(); ++k) {
    const double value = camera.params[camera.ModelParams() + k];
    if (camera.nuisances[k]->displace == nullptr || value == 0) continue;
    camera.nuisances[k]->displace(observation,
                                  camera.IndexInKind(k),
                                  camera.model->measured.size(),
                                  -value,
                                  seen.values.data());
  }
  return seen;
}

std::vector<ParamPrior> ParamPriors(const BundleState& bundle) {
  std::vector<ParamPrior> priors;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const BundleCamera& camera = bundle.cameras[c];
    for (size_t k = 0; k < camera.rules.size(); ++k) {
      const auto& prior = camera.rules[k].prior;
      if (prior) priors.push_back({{{bundle.Root(c, k)}}, prior->value, prior->sigma});
    }
    const auto unit_of = camera.model->functions.prior_unit;
    const double unit = unit_of == nullptr ? 1 : unit_of(*camera.model, camera.params.data());
    for (const PriorRow& row : camera.model->prior_rows) {
      ParamPrior prior{.terms = {}, .sigma = row.sigma * unit};
      bool own = false;  // else all of them are another camera's, which has the same prior
      for (size_t i = 0; i < row.indices.size(); ++i) {
        prior.terms.push_back({bundle.Root(c, row.indices[i]), row.weights[i]});
        own = own || prior.terms.back().param.camera == c;
      }
      if (own) priors.push_back(std::move(prior));
    }
  }
  return priors;
}

void ViewPoints::Set(const BundleCamera& camera,
                     const RigidTransform& T_camera_target,
                     std::span<const BundleObservation> of_view,
                     std::span<const BundleMarker> markers) {
  p_.clear();
  values_.clear();
  for (const BundleObservation& observation : of_view) {
    const Eigen::Vector3d p =
        T_camera_target * markers[static_cast<size_t>(observation.marker)].position;
    p_.insert(p_.end(), p.begin(), p.end());
    const Observation seen = WithoutDisplacement(observation, camera);
    values_.insert(values_.end(), seen.values.begin(), seen.values.end());
  }
}

bool Residual(const Bundle& bundle, const BundleObservation& observation, double* residual) {
  const BundleCamera& camera = bundle.cameras[static_cast<size_t>(observation.camera)];
  const RigidTransform T_camera_target =
      camera.T_camera_rig * bundle.SeenPose(static_cast<size_t>(observation.frame),
                                            static_cast<size_t>(observation.camera));
  const Observation seen = WithoutDisplacement(observation, camera);
  double predicted[kMaxObservationSize];
  if (!camera.model->Project(
          camera.params.data(),
          camera.config.data(),
          seen.values.data(),
          T_camera_target * bundle.markers[static_cast<size_t>(observation.marker)].position,
          predicted)) {
    return false;
  }
  for (size_t r = 0; r < camera.model->measured.size(); ++r) {
    residual[r] = seen.values[r] - predicted[r];
    if (!std::isfinite(residual[r])) return false;
  }
  return true;
}

double WeightedLength(const Bundle& bundle,
                      const BundleObservation& observation,
                      const double* residual) {
  const BundleCamera& camera = bundle.cameras[static_cast<size_t>(observation.camera)];
  double sum = 0;
  for (size_t r = 0; r < camera.model->measured.size(); ++r) sum += residual[r] * residual[r];
  return std::sqrt(sum) / camera.noise.Sigma(observation.assumed_sigma);
}

std::vector<std::array<double, kMaxObservationSize>> Residuals(const Bundle& bundle,
                                                               std::optional<size_t> camera) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<BundleObservation>& observations = bundle.observations;
  std::vector<std::array<double, kMaxObservationSize>> residuals(observations.size());
  std::vector<double> predicted;
  ViewPoints points;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    end = EndOfView(observations, begin);
    const auto c = static_cast<size_t>(observations[begin].camera);
    for (size_t i = begin; i < end; ++i) residuals[i].fill(kNan);
    if (camera && c != *camera) continue;
    const BundleCamera& seen_by = bundle.cameras[c];
    const CameraModel& model = *seen_by.model;
    points.Set(
        seen_by,
        seen_by.T_camera_rig * bundle.SeenPose(static_cast<size_t>(observations[begin].frame), c),
        std::span(observations).subspan(begin, end - begin),
        bundle.markers);
    const size_t rows = model.measured.size();
    predicted.resize(rows * (end - begin));
    ProjectPoints(model,
                  seen_by.params.data(),
                  seen_by.config.data(),
                  points.Block(),
                  {.predicted = predicted.data()});
    for (size_t i = 0; begin + i < end; ++i) {
      std::array<double, kMaxObservationSize> own{};
      for (size_t r = 0; r < rows; ++r) own[r] = points.Values(i)[r] - predicted[rows * i + r];
      if (std::ranges::all_of(own, [](double value) { return std::isfinite(value); })) {
        residuals[begin + i] = own;
      }
    }
  }
  return residuals;
}

std::vector<double> WeightedLengths(const Bundle& bundle) {
  const auto residuals = Residuals(bundle);
  std::vector<double> lengths;
  for (size_t i = 0; i < residuals.size(); ++i) {
    const double length = WeightedLength(bundle, bundle.observations[i], residuals[i].data());
    lengths.push_back(std::isnan(length) ? std::numeric_limits<double>::infinity() : length);
  }
  return lengths;
}

namespace {

// End of the run of observations, from `begin` on, that have the same `numbers`.
template <int BundleObservation::*... numbers>
size_t EndOfRun(const std::vector<BundleObservation>& observations, size_t begin) {
  size_t end = begin + 1;
  while (end < observations.size() &&
         ((observations[begin].*numbers == observations[end].*numbers) && ...)) {
    ++end;
  }
  return end;
}

}  // namespace

size_t EndOfMarker(const std::vector<BundleObservation>& observations, size_t begin) {
  using Seen = BundleObservation;
  return EndOfRun<&Seen::frame, &Seen::camera, &Seen::marker>(observations, begin);
}

size_t EndOfView(const std::vector<BundleObservation>& observations, size_t begin) {
  return EndOfRun<&BundleObservation::frame, &BundleObservation::camera>(observations, begin);
}

size_t EndOfFrame(const std::vector<BundleObservation>& observations, size_t begin) {
  return EndOfRun<&BundleObservation::frame>(observations, begin);
}

void MoveTarget(size_t target, const RigidTransform& T_target_own, BundleState* bundle) {
  const RigidTransform moved = T_target_own * bundle->targets[target].T_target_own.Inverse();
  bundle->targets[target].T_target_own = T_target_own;
  for (BundleMarker& marker : bundle->markers) {
    if (marker.target != static_cast<int>(target)) continue;
    marker.position = moved * marker.position;
    marker.nominal = moved * marker.nominal;
  }
}

Eigen::VectorXd DeviationFromPrior(const BundleState& bundle) {
  const CalibrationPrior& prior = *bundle.prior;
  Eigen::VectorXd deviation(static_cast<Eigen::Index>(prior.unknowns.size()));
  for (size_t i = 0; i < prior.unknowns.size(); ++i) {
    const CalibrationPrior::Unknown& unknown = prior.unknowns[i];
    const BundleCamera& camera = bundle.cameras[unknown.camera];
    double& value = deviation[static_cast<Eigen::Index>(i)];
    if (unknown.param) {
      value = camera.params[*unknown.param] - unknown.value;
      continue;
    }
    value = LocalCoordinates(prior.T_camera_rig[unknown.camera],
                             camera.T_camera_rig)[unknown.component];
  }
  return deviation;
}

std::string NameOfScale(const BundleState& bundle, const TargetScale& scale) {
  const bool one = bundle.targets.empty();
  std::string name = one ? "target" : bundle.targets[static_cast<size_t>(scale.target)].name;
  name += ".scale";
  return scale.axes == Eigen::Vector3d::Ones() ? name : name + (scale.axes.x() > 0 ? "_x" : "_y");
}

std::string NameOfPriorUnknown(const Bundle& bundle, size_t unknown) {
  const CalibrationPrior::Unknown& of = bundle.prior->unknowns[unknown];
  const BundleCamera& camera = bundle.cameras[of.camera];
  if (of.param) return camera.name + "." + std::string(camera.model->params[*of.param].name);
  return camera.name + ".T_camera_rig." + kExtrinsicsNames[static_cast<size_t>(of.component)];
}

Matrix6d JitterWeight(const BundleState& bundle, size_t frame) {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const BundleMarker& marker : bundle.markers) centre += marker.nominal;
  centre /= std::max(1.0, static_cast<double>(bundle.markers.size()));
  // The target's centre c moves by v + w x (R c).
  Matrix6d weight = Matrix6d::Zero();
  weight.topLeftCorner<3, 3>().setIdentity();
  weight.topRightCorner<3, 3>() = -Hat(bundle.T_rig_target[frame].R * centre);
  weight.topRows<3>() /= bundle.jitter.translation_sigma;
  weight.bottomRightCorner<3, 3>() = Eigen::Matrix3d::Identity() / bundle.jitter.rotation_sigma;
  return weight;
}

Matrix6d JitterWeight(const BundleState& bundle, size_t frame, size_t camera) {
  // Factor on the weight; zero would leave a frame undetermined whose only view is misplaced.
  constexpr double kMisplacedWeight = 1e-3;
  return (bundle.jitter.misplaced[bundle.View(frame, camera)] ? kMisplacedWeight : 1.0) *
         JitterWeight(bundle, frame);
}

}  // namespace plenocal
