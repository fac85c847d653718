// SPDX-License-Identifier: Apache-2.0
#include "tests/calib/plenoptic_synthetic.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <string>
#include <utility>

#include "calib/camera/lens_lattice.h"
#include "models/registry.h"
#include "tests/calib/random.h"

namespace plenocal::testing {
namespace {

constexpr double kPixel = 5.5e-6;
constexpr ImageSize kSize{2048, 1800};
constexpr double kPitch = 20;  // px

}  // namespace

PlenopticProblem MakePlenopticProblem(unsigned seed, const PlenopticOptions& options) {
  Random random(seed);
  Random noise(seed + 77777);  // so that the scene does not depend on how often it is seen
  PlenopticProblem problem;
  const double half_width = kSize[0] * kPixel / 2;
  const double distance = std::max(12 * options.f_L, 0.12 * options.f_L / half_width);
  const double B = random.Uniform(0.35e-3, 0.6e-3);
  const auto image_distance = [&](double z) { return options.f_L * z / (z - options.f_L); };
  double depth = random.Uniform(2.2, 2.8);  // least virtual depth
  if (options.virtual_depth > 0) depth = options.virtual_depth;
  const double b_L0 = options.galilean ? image_distance(1.4 * distance) - depth * B
                                       : image_distance(0.6 * distance) + depth * B;
  // Distortion of some pixels in the corners.
  const double r = half_width;
  problem.params = {options.f_L,
                    b_L0,
                    B,
                    kSize[0] / 2.0 + random.Uniform(-30, 30),
                    kSize[1] / 2.0 + random.Uniform(-30, 30),
                    random.Uniform(-0.01, 0.01) / std::pow(r, 2),
                    random.Uniform(-0.002, 0.002) / std::pow(r, 4),
                    random.Uniform(-3e-4, 3e-4) / r,
                    random.Uniform(-3e-4, 3e-4) / r};

  const double width = 1.2 * distance * half_width / options.f_L;
  for (int plane = 0; plane < (options.corner ? 2 : 1); ++plane) {
    for (int row = 0; row < options.rows; ++row) {
      for (int column = 0; column < options.columns; ++column) {
        const double u = width * column / (options.columns - 1),
                     v = width * row / (options.columns - 1);
        problem.input.markers[1000 * plane + 100 * row + column] =
            plane == 0 ? Eigen::Vector3d(u, v, 0) : Eigen::Vector3d(u, 0, v);
      }
    }
  }
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const auto& [number, position] : problem.input.markers) {
    centre += position / static_cast<double>(problem.input.markers.size());
    Eigen::Vector3d& p = problem.markers[number] = position;
    for (int i = 0; i < 3; ++i) p[i] += noise.Gaussian(options.marker_tolerance);
  }
  problem.input.marker_freedom = MarkerFreedom::FromSigma(options.marker_tolerance);
  problem.input.loss = options.noise > 0 ? Loss::kHuber : Loss::kNone;

  const bool tilted = options.tilt[0] != 0 || options.tilt[1] != 0;
  if (tilted) problem.params.insert(problem.params.end(), options.tilt.begin(), options.tilt.end());
  const bool thick = options.third_order != std::array<double, 4>{};
  if (thick) problem.params.push_back(1 / b_L0);
  if (thick)
    problem.params.insert(
        problem.params.end(), options.third_order.begin(), options.third_order.end());
  const CameraModel* model = FindModel(CameraModels(),
                                       tilted  ? "focused-plenoptic-tilt"
                                       : thick ? "plenoptic-thick"
                                               : "focused-plenoptic");
  CameraInput camera{.name = "plenoptic",
                     .model = model,
                     .config = {kPixel},
                     .initial = std::vector<std::optional<double>>(problem.params.size()),
                     .fixed = std::vector<bool>(problem.params.size(), false),
                     .image_size = kSize,
                     .views = {}};
  const double turn = random.Uniform(-0.5, 0.5);
  const Eigen::Vector2d e_column = kPitch * Eigen::Vector2d(std::cos(turn), std::sin(turn));
  const Eigen::Vector2d e_row = Eigen::Rotation2Dd(std::numbers::pi / 3) * e_column;
  std::vector<std::pair<Eigen::Vector2d, int>> lenses;  // with the interleaved set
  for (int i = -150; i <= 150; ++i) {
    for (int j = -150; j <= 150; ++j) {
      const Eigen::Vector2d c = Eigen::Vector2d(kSize[0], kSize[1]) / 2 + i * e_column + j * e_row;
      if (c.x() > 0 && c.y() > 0 && c.x() < kSize[0] && c.y() < kSize[1])
        lenses.emplace_back(c, kThreeInterleaved.Set({i, j}));
    }
  }
  const double shared_slope = options.shared_slope > 0 ? noise.Gaussian(options.shared_slope) : 0;
  if (options.shared_slope > 0) problem.shared_size = shared_slope / options.shared_slope;
  for (int f = 0; f < options.frames; ++f) {
    const double tilt = options.tilt_factor * random.Uniform(0.3, 0.8),
                 azimuth = random.Uniform(0, 6.3);
    const Eigen::Matrix3d R =
        ExpRotation(tilt * Eigen::Vector3d(std::cos(azimuth), std::sin(azimuth), 0)) *
        ExpRotation(Eigen::Vector3d(options.corner ? 0.8 : 0, 0, random.Uniform(-0.6, 0.6)));
    const double z = distance * (1 + options.depth_span * random.Uniform(-1, 1));
    const double reach = 0.2 * z * half_width / options.f_L;
    const Eigen::Vector2d aside = random.Uniforms<2>(-reach, reach);
    const Eigen::Vector3d place(aside.x(), aside.y(), z);
    const RigidTransform T{R, place - R * centre};
    View view{std::string("f").append(std::to_string(1000 + f)), {}};
    const double slope = options.frame_slope > 0 ? noise.Gaussian(options.frame_slope) : 0;
    for (const auto& [number, position] : problem.markers) {
      const Eigen::Vector3d p_cam = T * position;
      if (p_cam.z() < 0.6 * distance || p_cam.z() > 1.4 * distance) continue;
      const double b_L = image_distance(p_cam.z()), v = (b_L - b_L0) / B;
      const Eigen::Vector2d x_V = p_cam.head<2>() * (b_L / p_cam.z()) / kPixel +
                                  Eigen::Vector2d(problem.params[3], problem.params[4]);
      Eigen::Vector2d common(0, 0);
      for (int i = 0; i < 2 && options.common_noise > 0; ++i) {
        common[i] = noise.Gaussian(options.common_noise);
      }
      for (const auto& [lens, type] : lenses) {
        // A generous circle; which micro image the point falls into is checked below.
        if ((lens - x_V).norm() > std::abs(v) * kPitch + 0.1 * kSize[0]) continue;
        Observation seen{.marker = number, .values = {0, 0, lens.x(), lens.y()}};
        double predicted[2];
        if (!model->Project(problem.params.data(), &kPixel, seen.values.data(), p_cam, predicted)) {
          continue;
        }
        const Eigen::Vector2d x_R(predicted[0], predicted[1]);
        if ((x_R - lens).norm() > 0.45 * kPitch) continue;
        const double sigma = options.noise * options.noise_of_type[static_cast<size_t>(type)];
        const Eigen::Vector2d shift = common + (slope + shared_slope) * (x_R - lens);
        seen.values[0] = x_R.x() + shift.x() + noise.Gaussian(sigma);
        seen.values[1] = x_R.y() + shift.y() + noise.Gaussian(sigma);
        if (options.state_sigmas) seen.detector_sigma = options.noise;
        view.observations.push_back(seen);
        if (options.shared_slope > 0) {
          const Eigen::Vector2d moved = options.shared_slope * (x_R - lens);
          view.by_nuisance.push_back({moved.x(), moved.y()});
        }
      }
    }
    camera.views.push_back(view);
  }
  problem.input.cameras.push_back(camera);
  return problem;
}

}  // namespace plenocal::testing
