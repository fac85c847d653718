// SPDX-License-Identifier: Apache-2.0
//
// The report's uncertainties of projection and distance against the scatter of calibrations from
// the same true points with different noise.
#include "assess/projection_map.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <random>

#include "calib/estimate/describe.h"
#include "calib/space/point_fit.h"
#include "tests/calib/plenoptic_synthetic.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr int kTrials = 60;
// Of a variance that is estimated from kTrials: chi-square quantiles at 1e-5 and 1 - 1e-5.
constexpr double kLow = 0.41, kHigh = 1.95;

CalibrationRecord Calibrated(const CalibrationInput& input) {
  return Describe(Calibrate(input, {}));
}

CalibrationInput WithNoise(CalibrationInput input, double sigma, int seed) {
  std::mt19937 random(static_cast<unsigned>(seed));
  std::normal_distribution<double> noise(0, sigma);
  for (View& view : input.cameras[0].views) {
    for (Observation& o : view.observations) {
      o.values[0] += noise(random);
      o.values[1] += noise(random);
      o.detector_sigma = sigma;
    }
  }
  return input;
}

struct Image {
  Eigen::Vector2d x;
  Eigen::Matrix<double, 2, 3, Eigen::RowMajor> by_point;
};

Image Project(const CalibratedCamera& camera, const double* values, const Eigen::Vector3d& p) {
  double predicted[kMaxObservationSize];
  std::vector<double> by_params(2 * camera.params.size());
  Image image;
  EXPECT_TRUE(
      camera.model->ProjectWithJacobian(camera.params.data(),
                                        camera.config.data(),
                                        values,
                                        p,
                                        {predicted, by_params.data(), image.by_point.data()}));
  image.x = {predicted[0], predicted[1]};
  return image;
}

/// The motion of the true camera's frame with which `estimate` takes the true camera's place best.
RigidTransform BestMotion(const CalibrationRecord& truth, const CalibratedCamera& estimate) {
  RigidTransform T;
  for (int iteration = 0; iteration < 5; ++iteration) {
    Matrix6d normal = Matrix6d::Zero();
    Vector6d right = Vector6d::Zero();
    for (const ResidualRow& row : truth.cameras[0].residuals) {
      const Eigen::Vector3d p =
          truth.CameraFromTarget(0, row.frame) * truth.markers.at(row.marker).position;
      const Image image = Project(estimate, row.values.data(), T * p);
      Eigen::Matrix<double, 3, 6> moved;
      moved << Eigen::Matrix3d::Identity(), -Hat(T.R * p);
      const Eigen::Matrix<double, 2, 6> J = image.by_point * moved;
      normal += J.transpose() * J;
      right += J.transpose() * (Project(truth.cameras[0], row.values.data(), p).x - image.x);
    }
    const Vector6d step = normal.ldlt().solve(right);
    T.t += step.head<3>();
    T.R = ExpRotation(step.tail<3>()) * T.R;
  }
  return T;
}

TEST(ProjectionUncertainty, IsTheScatterOfWhatNoisyCalibrationsProject) {
  constexpr int kEvery = 29;  // cells
  constexpr double kNoise = 0.2;
  const CalibrationInput exact = MakeProblem(11, {.frames = 8}).input;
  const CalibrationRecord truth = Calibrated(exact);
  const CalibratedCamera& camera = truth.cameras[0];
  const std::vector<ProjectionMap> places = ProjectionMaps(truth, 0);
  ASSERT_EQ(places.size(), 4u);
  struct Place {
    Eigen::Vector2d at{0, 0};
    Eigen::Vector3d point{0, 0, 0};
    Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
    double predicted = 0;  // variance
  };
  std::map<std::pair<size_t, size_t>, Place> compared;
  for (int trial = 0; trial < kTrials; ++trial) {
    const CalibrationRecord found = Calibrated(WithNoise(exact, kNoise, trial));
    const std::vector<ProjectionMap> maps = ProjectionMaps(found, 0);
    ASSERT_EQ(maps.size(), 4u);
    const RigidTransform T = BestMotion(truth, found.cameras[0]);
    for (size_t m = 0; m < maps.size(); ++m) {
      for (size_t cell = m; cell < maps[m].grid.Cells(); cell += kEvery) {
        Place& place = compared[{m, cell}];
        if (trial == 0) {
          place.at = maps[m].grid.Middle(cell);
          const auto ray = camera.model->Unproject(camera.params.data(), nullptr, place.at.data());
          ASSERT_TRUE(ray);
          place.point = ray->origin + places[m].distance * ray->direction;
        }
        const Eigen::Vector2d error =
            Project(found.cameras[0], place.at.data(), T * place.point).x - place.at;
        place.scatter += error * error.transpose() / kTrials;
        place.predicted += maps[m].sigma[cell] * maps[m].sigma[cell] / kTrials;
      }
    }
  }
  ASSERT_GT(compared.size(), 50u);
  double mean = 0;
  for (const auto& [key, place] : compared) {
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver(place.scatter);
    const double ratio = solver.eigenvalues()[1] / place.predicted;
    mean += ratio / static_cast<double>(compared.size());
    EXPECT_GT(ratio, kLow) << "map " << key.first << ", " << place.at.transpose();
    // The greater eigenvalue of an estimated 2 x 2 covariance is too large by up to 15 %.
    EXPECT_LT(ratio, 1.15 * kHigh) << "map " << key.first << ", " << place.at.transpose();
  }
  std::cout << "mean ratio of variances: " << mean << "\n";
  // Places share their parameters' errors: no better than five independent ones.
  EXPECT_NEAR(mean, 1.07, 4 * std::sqrt(2.0 / (5 * kTrials)));
}

/// The point that observations of one marker in one image see.
Eigen::Vector3d Intersect(const CalibratedCamera& camera,
                          const std::vector<std::array<double, kMaxObservationSize>>& seen,
                          Eigen::Vector3d p) {
  for (int iteration = 0; iteration < 6; ++iteration) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right(0, 0, 0);
    for (const auto& values : seen) {
      const Image image = Project(camera, values.data(), p);
      normal += image.by_point.transpose() * image.by_point;
      right += image.by_point.transpose() * (Eigen::Vector2d(values[0], values[1]) - image.x);
    }
    p += normal.ldlt().solve(right);
  }
  return p;
}

TEST(ErrorOfPoint, IsTheScatterOfDistancesThatNoisyCalibrationsMeasure) {
  constexpr int kEvery = 7;  // markers
  constexpr double kNoise = 0.05;
  const CalibrationInput exact =
      MakePlenopticProblem(3, {.corner = true, .frames = 6, .columns = 4, .rows = 3}).input;
  const CalibrationRecord truth = Calibrated(exact);
  struct Marker {
    Eigen::Vector3d point{0, 0, 0};
    std::vector<std::array<double, kMaxObservationSize>> seen;
    double by_calibration = 0, by_noise = 0;  // scatter, m^2
    double calibration = 0, noise = 0;        // predicted, m^2
  };
  std::map<std::pair<int, int>, Marker> markers;
  for (const ResidualRow& row : truth.cameras[0].residuals) {
    Marker& marker = markers[{row.frame, row.marker}];
    marker.point = truth.CameraFromTarget(0, row.frame) * truth.markers.at(row.marker).position;
    marker.seen.push_back(row.values);
  }
  int index = 0;
  std::erase_if(markers, [&](const auto& item) {
    return item.second.seen.size() < 4 || index++ % kEvery != 0;
  });
  ASSERT_GT(markers.size(), 6u);
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, kNoise);
  for (int trial = 0; trial < kTrials; ++trial) {
    const CalibrationRecord found = Calibrated(WithNoise(exact, kNoise, trial));
    const SpaceRig rig = MakeSpaceRig(found, {});
    for (auto& [key, marker] : markers) {
      const Eigen::Vector3d p =
          found.CameraFromTarget(0, key.first) * found.markers.at(key.second).position;
      std::vector<SpaceObservation> observations;
      for (const auto& values : marker.seen)
        observations.push_back({.values = values, .sigma = kNoise});
      const std::optional<PointError> predicted = ErrorAt(rig, observations, p, SpaceFrame::kRig);
      ASSERT_TRUE(predicted);
      const Eigen::RowVector3d along = p.normalized();
      marker.calibration += (along * predicted->by_theta * rig.root).squaredNorm() / kTrials;
      marker.noise += along.dot(along * predicted->noise) / kTrials;
      const auto error = [&marker = marker](const CalibratedCamera& camera, const auto& seen) {
        return Intersect(camera, seen, marker.point).norm() - marker.point.norm();
      };
      marker.by_calibration += std::pow(error(found.cameras[0], marker.seen), 2) / kTrials;
      auto noisy = marker.seen;
      for (auto& values : noisy) {
        values[0] += noise(random);
        values[1] += noise(random);
      }
      marker.by_noise += std::pow(error(truth.cameras[0], noisy), 2) / kTrials;
    }
  }
  double mean_calibration = 0, mean_noise = 0;
  for (const auto& [key, marker] : markers) {
    const double calibration = marker.by_calibration / marker.calibration,
                 noise_ratio = marker.by_noise / marker.noise;
    for (const double ratio : {calibration, noise_ratio}) {
      EXPECT_GT(ratio, kLow) << "frame " << key.first << ", marker " << key.second;
      EXPECT_LT(ratio, kHigh) << "frame " << key.first << ", marker " << key.second;
    }
    mean_calibration += calibration / static_cast<double>(markers.size());
    mean_noise += noise_ratio / static_cast<double>(markers.size());
  }
  std::cout << "mean ratios of variances: calibration " << mean_calibration << ", noise "
            << mean_noise << "\n";
  // The calibrations' errors are common to all markers, the noise is each one's own.
  EXPECT_NEAR(mean_calibration, 1, 4 * std::sqrt(2.0 / kTrials));
  EXPECT_NEAR(mean_noise, 1, 4 * std::sqrt(2.0 / (kTrials * static_cast<double>(markers.size()))));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
