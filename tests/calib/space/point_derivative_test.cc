// SPDX-License-Identifier: Apache-2.0
//
// Derivatives of the image of a point against differences, for each kind of model.
#include "calib/space/point_derivative.h"

#include <gtest/gtest.h>

#include <functional>
#include <string>

#include "tests/calib/space/uncertain_rig.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr double kStep = 1e-6;

SpaceObservation At(const SpaceRig& rig, size_t camera) {
  SpaceObservation seen{.camera = camera, .sigma = kNoise};
  if (rig.cameras[camera].model->plenoptic) {
    seen.values[2] = rig.cameras[camera].image_size[0] / 2.0 + 20;
    seen.values[3] = rig.cameras[camera].image_size[1] / 2.0 - 10;
  }
  return seen;
}

// The image less the measurement, which is zero, for cameras with an error of theta.
Eigen::VectorXd Predicted(const SpaceRig& rig,
                          const SpaceObservation& seen,
                          const Eigen::VectorXd& theta,
                          const Eigen::Vector3d& p,
                          double h) {
  SpaceRig moved = rig;
  moved.cameras = Moved(rig, theta);
  PointDerivative out;
  EXPECT_TRUE(Differentiate(moved, seen, p, h, &out, false));
  return -out.residual;
}

void ExpectDerivative(const Eigen::VectorXd& found,
                      const std::function<Eigen::VectorXd(double)>& predicted,
                      double step) {
  const Eigen::VectorXd numeric = (predicted(step) - predicted(-step)) / (2 * step);
  EXPECT_LT((found - numeric).norm(), 1e-5 * (1 + numeric.norm()))
      << found.transpose() << " and " << numeric.transpose();
}

// A model that images no points at infinity.
CameraModel Finite(const CameraModel& model) {
  CameraModel finite = model;
  finite.homogeneous = false;
  finite.functions.project_with_jacobian = [](const CameraModel& own,
                                              const double* params,
                                              const double* config,
                                              const double* values,
                                              const Eigen::Vector3d& p,
                                              double h,
                                              const ProjectionOutput& out) {
    ProjectionOutput without_h = out;
    without_h.J_h = nullptr;
    return FindModel(CameraModels(), own.name)
        ->functions.project_with_jacobian(own, params, config, values, p, h, without_h);
  };
  return finite;
}

TEST(PointDerivative, IsThatOfDifferences) {
  for (const auto& [name, is_finite] : {std::pair("pinhole-radial3", false),
                                        std::pair("kannala-brandt4", false),
                                        std::pair("kannala-brandt4", true),
                                        std::pair("spherical", false),
                                        std::pair("focused-plenoptic", false),
                                        std::pair("focused-plenoptic", true)}) {
    const std::string model = name;
    const CameraModel finite = Finite(*FindModel(CameraModels(), model));
    RigOptions options{.models = {model, model}};
    options.nuisances = model == "focused-plenoptic";
    SpaceRig rig = MakeSpaceRig(UncertainRig(options), {}, {1, 1});
    for (BundleCamera& camera : rig.cameras) {
      if (is_finite) camera.model = &finite;
    }
    const Eigen::VectorXd zero = Eigen::VectorXd::Zero(rig.Size());
    const bool far = !rig.cameras[0].model->plenoptic;
    // The same point for each h, and one at infinity where the model images it.
    for (const double h : {1.0, 0.3, 2.5, 1e-3}) {
      const Eigen::Vector3d p = (h > 0.01 ? h : 1) * Eigen::Vector3d(0.06, -0.04, far ? 0.9 : 0.35);
      for (size_t c = 0; c < 2; ++c) {
        SCOPED_TRACE(model + (is_finite ? ", finite" : "") + ", camera " + std::to_string(c) +
                     ", h " + std::to_string(h));
        const SpaceObservation seen = At(rig, c);
        PointDerivative out;
        ASSERT_TRUE(Differentiate(rig, seen, p, h, &out));
        EXPECT_LT((out.residual + Predicted(rig, seen, zero, p, h)).norm(), 1e-12);
        for (int i = 0; i < 3; ++i) {
          const Eigen::Vector3d unit = Eigen::Vector3d::Unit(i);
          ExpectDerivative(
              out.by_point.col(i),
              [&](double step) { return Predicted(rig, seen, zero, p + step * unit, h); },
              kStep * p.norm());
        }
        ExpectDerivative(
            out.by_h,
            [&](double step) { return Predicted(rig, seen, zero, p, h + step); },
            kStep * h);
        for (Eigen::Index i = 0; i < std::ssize(rig.unknowns); ++i) {
          SCOPED_TRACE(NameOfUnknown(rig, static_cast<size_t>(i)));
          const Eigen::VectorXd unit = Eigen::VectorXd::Unit(rig.Size(), i);
          // A hundredth of a standard error of the calibration.
          ExpectDerivative(
              out.by_theta.col(i),
              [&](double step) { return Predicted(rig, seen, step * unit, p, h); },
              0.01 * rig.root.row(i).norm());
        }
      }
    }
  }
}

// Of a frame whose points move by a translation and a rotation about the rig's centre.
TEST(PointDerivative, ByTheJitterIsThatOfMovedPoints) {
  const SpaceRig rig = MakeSpaceRig(
      UncertainRig({.jitter = {.translation_sigma = 1e-4, .rotation_sigma = 2e-4}}), {});
  ASSERT_EQ(rig.frame_columns, 12);
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(rig.Size());
  const Eigen::Vector3d p(0.1, -0.05, 0.8);
  for (const double h : {1.0, 0.5}) {
    for (size_t c = 0; c < 2; ++c) {
      const SpaceObservation seen = At(rig, c);
      PointDerivative out;
      ASSERT_TRUE(Differentiate(rig, seen, p, h, &out));
      for (int i = 0; i < 6; ++i) {
        const auto moved = [&](double step) {
          const Eigen::Vector3d about = p - h * rig.centre;
          const Eigen::Vector3d to =
              i < 3 ? Eigen::Vector3d(p + step * h * Eigen::Vector3d::Unit(i))
                    : Eigen::Vector3d(h * rig.centre +
                                      ExpRotation(step * Eigen::Vector3d::Unit(i - 3)) * about);
          return Predicted(rig, seen, zero, to, h);
        };
        const Eigen::Index first = rig.Size() - 12;
        ExpectDerivative(
            out.by_theta.col(first + 6 * static_cast<Eigen::Index>(c) + i), moved, kStep);
        EXPECT_EQ(out.by_theta.col(first + 6 * static_cast<Eigen::Index>(1 - c) + i).norm(), 0);
      }
    }
  }
}

TEST(PointDerivative, IsNoneBehindTheCamera) {
  SpaceRig rig = MakeSpaceRig(UncertainRig({}), {});
  PointDerivative out;
  EXPECT_FALSE(Differentiate(rig, At(rig, 0), {0.1, 0, -1}, 1, &out));
  EXPECT_TRUE(Differentiate(rig, At(rig, 0), {0.1, 0, 1}, 0, &out));
  const CameraModel finite = Finite(*rig.cameras[0].model);
  rig.cameras[0].model = &finite;
  EXPECT_FALSE(Differentiate(rig, At(rig, 0), {0.1, 0, 1}, 0, &out));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
