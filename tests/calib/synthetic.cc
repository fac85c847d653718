// SPDX-License-Identifier: Apache-2.0
#include "tests/calib/synthetic.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "models/registry.h"
#include "tests/calib/random.h"

namespace plenocal::testing {
namespace {

std::map<int, Eigen::Vector3d> NominalMarkers(TargetShape shape) {
  constexpr double kSpacing = 0.03;
  std::map<int, Eigen::Vector3d> markers;
  const int planes = shape == TargetShape::kPlane ? 1 : 3;
  for (int plane = 0; plane < planes; ++plane) {
    for (int row = 0; row < 7; ++row) {
      for (int column = 0; column < 10; ++column) {
        const double u = kSpacing * (column + (planes > 1 ? 1 : 0));
        const double v = kSpacing * (row + (planes > 1 ? 1 : 0));
        const Eigen::Vector3d p = plane == 0   ? Eigen::Vector3d(u, v, 0)
                                  : plane == 1 ? Eigen::Vector3d(u, 0, v)
                                               : Eigen::Vector3d(0, u, v);
        markers[1000 * plane + 10 * row + column] = p;
      }
    }
  }
  return markers;
}

}  // namespace

SyntheticProblem MakeProblem(unsigned seed, const SyntheticOptions& options) {
  Random random(seed);
  Random jitter(seed + 1000000);  // of its own: without jitter a seed gives the same problem
  SyntheticProblem problem;
  const std::map<int, Eigen::Vector3d> nominal = NominalMarkers(options.shape);
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const auto& [number, position] : nominal) {
    centre += position / static_cast<double>(nominal.size());
    Eigen::Vector3d& p = problem.markers[number] = position;
    for (int i = 0; i < 3; ++i) p[i] += random.Gaussian(options.marker_tolerance);
  }
  problem.input.markers = nominal;
  problem.input.marker_freedom = MarkerFreedom::FromSigma(options.marker_tolerance);
  problem.input.loss = options.noise > 0 ? Loss::kHuber : Loss::kNone;

  const CameraModel* model = FindModel(CameraModels(), "pinhole-radial3");
  const ImageSize size{1280, 960};
  const double half_fov = options.fov_deg / 2 * std::numbers::pi / 180;
  const double distance = 0.3 / std::tan(half_fov) + 0.1;  // the target about fills the view
  for (int c = 0; c < options.cameras; ++c) {
    const double f = size[0] / 2.0 / std::tan(half_fov) * random.Uniform(0.95, 1.05);
    // Distortion of up to some per cent at the image's edge, as lenses of that angle have.
    const double edge = std::tan(half_fov);
    const double bend = options.distorted ? random.Uniform(-0.12, 0.02) : 0;
    std::vector<double> params{
        f,
        f * random.Uniform(0.99, 1.01),
        size[0] / 2.0 + random.Uniform(-40, 40),
        size[1] / 2.0 + random.Uniform(-30, 30),
        bend / std::pow(edge, 2),
        options.distorted ? random.Uniform(0, 0.02) / std::pow(edge, 4) : 0,
        options.distorted ? random.Uniform(0, 0.002) / std::pow(edge, 6) : 0};
    problem.params.push_back(params);
    RigidTransform mount;
    if (c > 0) {
      Vector6d xi;
      // Side by side and nearly parallel, closer so when the view is narrow: all see the target.
      const double baseline = distance * std::min(0.1, 0.35 * std::tan(half_fov));
      const double turn = std::min(0.03, 0.2 * half_fov);
      xi << -baseline * c, random.Gaussian(0.01), random.Gaussian(0.01), random.Gaussian(turn),
          random.Gaussian(turn), random.Gaussian(turn);
      mount = Exp(xi);
    }
    problem.T_camera_rig.push_back(mount);
    problem.input.cameras.push_back({.name = fmt::format("cam{}", c),
                                     .model = model,
                                     .config = {},
                                     .initial = std::vector<std::optional<double>>(params.size()),
                                     .fixed = std::vector<bool>(params.size(), false),
                                     .image_size = size,
                                     .views = {}});
  }

  for (int f = 0; f < options.frames; ++f) {
    const std::string frame = fmt::format("{:04}", f);
    // Tilted by 15 to 40 degrees about a random axis, turned about the line of sight, off the axis.
    const double tilt = random.Uniform(15, 40) * std::numbers::pi / 180;
    const double azimuth = random.Uniform(0, 2 * std::numbers::pi);
    const Eigen::Vector3d axis(std::cos(azimuth), std::sin(azimuth), 0);
    Eigen::Matrix3d R =
        ExpRotation(tilt * axis) * ExpRotation(Eigen::Vector3d(0, 0, random.Uniform(-0.6, 0.6)));
    if (options.shape == TargetShape::kCorner) {
      // Look into the corner along its diagonal.
      const Eigen::Vector3d diagonal = -Eigen::Vector3d(1, 1, 1).normalized();
      R = ExpRotation(random.Uniform(0, 0.4) * axis) *
          Eigen::Quaterniond::FromTwoVectors(diagonal, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    }
    const double z = distance * random.Uniform(0.7, 1.3);
    const double reach = 0.4 * z * std::tan(half_fov);
    const Eigen::Vector2d aside = random.Uniforms<2>(-reach, reach);
    const Eigen::Vector3d place(aside.x(), aside.y(), z);
    const RigidTransform T_rig_target{R, place - R * centre};
    problem.T_rig_target[frame] = T_rig_target;
    for (size_t c = 0; c < problem.params.size(); ++c) {
      if (random.Uniform(0, 1) > options.visible) continue;
      View view{frame, {}};
      const Eigen::Vector3d moved = jitter.Gaussians<3>(options.jitter_translation);
      const Eigen::Vector3d turned = jitter.Gaussians<3>(options.jitter_rotation);
      const RigidTransform seen{ExpRotation(turned) * R,
                                place + moved - ExpRotation(turned) * R * centre};
      for (const auto& [number, position] : problem.markers) {
        Observation observation{.marker = number,
                                .detector_sigma = options.noise > 0 ? options.noise : 0};
        const Eigen::Vector3d p_cam = problem.T_camera_rig[c] * (seen * position);
        const bool missing = random.Uniform(0, 1) < options.partial;
        if (!model->Project(problem.params[c].data(),
                            nullptr,
                            observation.values.data(),
                            p_cam,
                            observation.values.data())) {
          continue;
        }
        if (observation.values[0] < 0 || observation.values[0] > size[0] - 1 ||
            observation.values[1] < 0 || observation.values[1] > size[1] - 1 || missing) {
          continue;
        }
        observation.values[0] += random.Gaussian(options.noise);
        observation.values[1] += random.Gaussian(options.noise);
        view.observations.push_back(observation);
      }
      if (view.observations.size() >= 6) problem.input.cameras[c].views.push_back(view);
    }
  }
  return problem;
}

void SetModel(const CameraModel& model, CameraInput* camera) {
  camera->model = &model;
  camera->config.assign(model.example_config.begin(), model.example_config.end());
  camera->initial.assign(model.params.size(), std::nullopt);
  camera->fixed.assign(model.params.size(), false);
}

CalibrationInput WithNoise(CalibrationInput input, double sigma, unsigned seed) {
  Random random(seed);
  for (CameraInput& camera : input.cameras) {
    for (View& view : camera.views) {
      for (Observation& seen : view.observations) {
        for (size_t i = 0; i < 2; ++i) seen.values[i] += random.Gaussian(sigma);
        seen.detector_sigma = sigma;
      }
    }
  }
  return input;
}

Bundle TrueBundle(const SyntheticProblem& problem) {
  Bundle bundle;
  for (size_t c = 0; c < problem.params.size(); ++c) {
    bundle.cameras.push_back({.name = problem.input.cameras[c].name,
                              .image_size = problem.input.cameras[c].image_size,
                              .model = problem.input.cameras[c].model,
                              .config = {},
                              .params = problem.params[c],
                              .fixed = std::vector<bool>(problem.params[c].size(), false),
                              .T_camera_rig = problem.T_camera_rig[c],
                              .is_master = c == 0});
  }
  std::map<int, int> index;
  for (const auto& [number, position] : problem.markers) {
    index[number] = static_cast<int>(bundle.markers.size());
    bundle.markers.push_back({number, position, problem.input.markers.at(number)});
  }
  for (const auto& [name, T_rig_target] : problem.T_rig_target) {
    const int frame = static_cast<int>(bundle.T_rig_target.size());
    bundle.T_rig_target.push_back(T_rig_target);
    for (size_t c = 0; c < problem.params.size(); ++c) {
      for (const View& view : problem.input.cameras[c].views) {
        if (view.frame != name) continue;
        for (const Observation& seen : view.observations) {
          bundle.observations.push_back(
              {static_cast<int>(c), frame, index.at(seen.marker), seen, true});
          if (seen.detector_sigma > 0) {
            bundle.observations.back().assumed_sigma = seen.detector_sigma;
          }
        }
      }
    }
  }
  bundle.marker_freedom = problem.input.marker_freedom;
  return bundle;
}

double LargestShift(const SyntheticProblem& problem,
                    const Calibration& calibration,
                    size_t camera) {
  const BundleCamera& estimate = calibration.bundle.cameras[camera];
  double largest = 0;
  for (const View& view : problem.input.cameras[camera].views) {
    for (const Observation& observation : view.observations) {
      const std::optional<Ray> ray = estimate.model->Unproject(
          problem.params[camera].data(), nullptr, observation.values.data());
      double predicted[kMaxObservationSize];
      if (!ray || !estimate.model->Project(estimate.params.data(),
                                           nullptr,
                                           observation.values.data(),
                                           ray->direction,
                                           predicted)) {
        return std::numeric_limits<double>::infinity();
      }
      largest = std::max(
          largest,
          std::hypot(predicted[0] - observation.values[0], predicted[1] - observation.values[1]));
    }
  }
  return largest;
}

std::vector<std::string> CodesOf(const std::vector<Finding>& findings) {
  std::vector<std::string> codes;
  for (const Finding& finding : findings) codes.push_back(finding.code);
  return codes;
}

}  // namespace plenocal::testing
