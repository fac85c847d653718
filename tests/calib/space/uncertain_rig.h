// SPDX-License-Identifier: Apache-2.0
//
// A calibrated rig with uncertain numbers, and what cameras with an error of them see.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <string>
#include <vector>

#include "calib/base/statistics.h"
#include "calib/camera/rays.h"
#include "calib/space/point_fit.h"
#include "models/registry.h"
#include "tests/calib/random.h"

namespace plenocal::testing {

constexpr double kNoise = 0.05;  // px

struct RigOptions {
  std::vector<std::string> models{"pinhole-radial3", "pinhole-radial3"};
  double baseline = 0.1;    // m
  double calibration = 1;   // factor on the calibration's standard errors
  double common_noise = 0;  // px
  bool nuisances = false;   // a displacement common to all images, which correlates with parameters
  double correlation = 0;   // of the noise of ordinary cameras
  JitterRecord jitter = {};
};

/// A rig whose parameters and extrinsics are uncertain and correlated: one number shifts all.
inline CalibrationRecord UncertainRig(const RigOptions& options) {
  CalibrationRecord record;
  if (options.jitter.translation_sigma > 0) record.jitter = options.jitter;
  for (size_t c = 0; c < options.models.size(); ++c) {
    CalibratedCamera& camera = record.cameras.emplace_back();
    camera.name = "camera" + std::to_string(c);
    camera.model = FindModel(CameraModels(), options.models[c]);
    camera.image_size = camera.model->example_size;
    camera.params.assign(camera.model->example.begin(), camera.model->example.end());
    camera.config.assign(camera.model->example_config.begin(), camera.model->example_config.end());
    std::vector<double> sigma;
    for (size_t k = 0; k < camera.params.size(); ++k) {
      const double scale = camera.model->params[k].scale;
      sigma.push_back(1e-4 * options.calibration *
                      std::max(std::abs(camera.params[k]), std::min(scale, 1.0)));
    }
    const auto n = static_cast<Eigen::Index>(sigma.size());
    const Eigen::MatrixXd correlation =
        0.5 * Eigen::MatrixXd::Identity(n, n) + 0.5 * Eigen::MatrixXd::Ones(n, n);
    camera.covariance = CovarianceOf(sigma, correlation);
    camera.fit.noise_sigma = std::hypot(kNoise, options.common_noise);
    camera.fit.common_noise = options.common_noise;
    if (options.nuisances) {
      camera.nuisances = {{0.7, 0.4}};
      record.correlations = {{camera.name + ".B", camera.name + ".shared_1"},
                             Eigen::MatrixXd{{1, 0.6}, {0.6, 1}}};
    }
    if (c == 0) continue;
    Vector6d xi;
    xi << -options.baseline * static_cast<double>(c), 0.002, -0.003, 0.01, -0.02, 0.015;
    camera.T_camera_rig = Exp(xi);
    camera.sigma_xi << 2e-5, 3e-5, 4e-5, 1e-4, 5e-5, 7e-5;
    camera.sigma_xi *= options.calibration;
  }
  return record;
}

/// Whether a camera of these numbers images X / h; its place.
inline bool ImageOf(const BundleCamera& camera,
                    const Eigen::Vector3d& X,
                    double h,
                    double* values) {
  const Eigen::Vector3d p = camera.T_camera_rig.R * X + h * camera.T_camera_rig.t;
  return camera.model->Project(camera.params.data(), camera.config.data(), values, p, values, h);
}

/// The cameras with an error of theta.
inline std::vector<BundleCamera> Moved(const SpaceRig& rig, const Eigen::VectorXd& theta) {
  std::vector<BundleCamera> cameras = rig.cameras;
  AddToTheta(rig, theta, &cameras);
  return cameras;
}

/// What true cameras see of X / h: each micro lens of `lenses` of a plenoptic one.
inline std::vector<SpaceObservation> Seen(const std::vector<BundleCamera>& truth,
                                          const Eigen::Vector3d& X,
                                          double h,
                                          double common_noise,
                                          Random* random) {
  std::vector<SpaceObservation> seen;
  for (size_t c = 0; c < truth.size(); ++c) {
    const Eigen::Vector2d common = random->Gaussians<2>(common_noise);
    const bool plenoptic = truth[c].model->plenoptic;
    for (int lens = 0; lens < (plenoptic ? 7 : 1); ++lens) {
      SpaceObservation each{.camera = c, .sigma = kNoise};
      if (plenoptic) {
        // Around the middle of the image.
        constexpr double kPitch = 20;
        each.values[2] = truth[c].image_size[0] / 2.0 + kPitch * (lens % 3 - 1);
        each.values[3] = truth[c].image_size[1] / 2.0 + kPitch * (lens / 3 - 1);
      }
      if (!ImageOf(truth[c], X, h, each.values.data())) continue;
      if (!truth[c].nuisances.empty()) {
        for (size_t k = 0; k < 2; ++k) {
          each.by_shared.push_back(0.01 * (each.values[k] - each.values[k + 2]));
          each.values[k] += truth[c].params.back() * each.by_shared[k];
        }
      }
      const Eigen::Vector2d noise = random->Gaussians<2>(kNoise);
      for (size_t k = 0; k < 2; ++k) {
        each.values[k] += noise[static_cast<Eigen::Index>(k)];
        if (plenoptic) each.values[k] += common[static_cast<Eigen::Index>(k)];
      }
      seen.push_back(each);
    }
  }
  return seen;
}

/// Inside 99.9 % of means of `count` squares with `degrees`.
inline void ExpectOne(double mean, int count, int degrees, const char* what) {
  const double n = count * degrees;
  EXPECT_GT(mean, ChiSquareQuantile(n, 0.9995) / n) << what;
  EXPECT_LT(mean, ChiSquareQuantile(n, 0.0005) / n) << what;
}

}  // namespace plenocal::testing
