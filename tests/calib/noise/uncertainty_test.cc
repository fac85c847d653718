// SPDX-License-Identifier: Apache-2.0
//
// Covariance and redundancy of small bundles, against Monte Carlo and where they follow from
// counting or from Woodbury's formula.
#include "calib/noise/uncertainty.h"

#include <gtest/gtest.h>

#include <cmath>

#include "calib/adjust/solver/adjust.h"
#include "tests/calib/dense_problem.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"

namespace plenocal {
namespace TEST_FILE {

using testing::MakeProblem;
using testing::Random;
using testing::SyntheticProblem;
using testing::TrueBundle;

constexpr double kNoise = 0.2;  // px

Bundle ExactBundle(const testing::SyntheticOptions& options) {
  Bundle bundle = TrueBundle(MakeProblem(7, options));
  for (BundleObservation& observation : bundle.observations) observation.assumed_sigma = kNoise;
  return bundle;
}

TEST(Uncertainty, AgreesWithTheScatterOfRepeatedAdjustments) {
  const Bundle exact = ExactBundle({.cameras = 2, .frames = 5});
  const Uncertainty uncertainty = EstimateUncertainty(exact);
  constexpr int kTrials = 60;
  Random random(1);
  Eigen::MatrixXd squares = Eigen::MatrixXd::Zero(2, 7);
  Vector6d extrinsics = Vector6d::Zero();
  for (int trial = 0; trial < kTrials; ++trial) {
    Bundle noisy = exact;
    for (BundleObservation& observation : noisy.observations) {
      for (size_t r = 0; r < 2; ++r) observation.seen.values[r] += random.Gaussian(kNoise);
    }
    ASSERT_TRUE(Adjust(&noisy, {}).usable);
    for (size_t c = 0; c < 2; ++c) {
      for (size_t k = 0; k < 7; ++k) {
        squares(static_cast<Eigen::Index>(c), static_cast<Eigen::Index>(k)) +=
            std::pow(noisy.cameras[c].params[k] - exact.cameras[c].params[k], 2) / kTrials;
      }
    }
    const RigidTransform& was = exact.cameras[1].T_camera_rig;
    const RigidTransform& is = noisy.cameras[1].T_camera_rig;
    Vector6d d;
    d << is.t - was.t, LogRotation(is.R * was.R.transpose());
    extrinsics += d.cwiseAbs2() / kTrials;
  }
  // A variance from 60 trials has a relative standard error of sqrt(2 / 60) = 18 %.
  constexpr double kScatter = 0.7;
  for (size_t c = 0; c < 2; ++c) {
    for (size_t k = 0; k < 7; ++k) {
      const double predicted = std::pow(uncertainty.param_std_errors[c][k], 2);
      EXPECT_NEAR(squares(static_cast<Eigen::Index>(c), static_cast<Eigen::Index>(k)) / predicted,
                  1,
                  kScatter)
          << "camera " << c << " parameter " << k;
    }
  }
  for (int i = 0; i < 6; ++i) {
    EXPECT_NEAR(extrinsics[i] / uncertainty.extrinsics_covariance[1](i, i), 1, kScatter) << i;
  }
}

TEST(Uncertainty, GoesWithTheNoiseAndTheRootOfTheNumberOfObservations) {
  Bundle bundle = ExactBundle({.frames = 5});
  const Uncertainty once = EstimateUncertainty(bundle);
  bundle.cameras[0].noise.detector_scale = 3;
  const Uncertainty noisier = EstimateUncertainty(bundle);
  bundle.cameras[0].noise.detector_scale = 1;
  // Each observation four times.
  std::vector<BundleObservation> four;
  for (const BundleObservation& observation : bundle.observations)
    four.insert(four.end(), 4, observation);
  bundle.observations = four;
  const Uncertainty more = EstimateUncertainty(bundle);
  for (size_t k = 0; k < 7; ++k) {
    EXPECT_NEAR(noisier.param_std_errors[0][k] / once.param_std_errors[0][k], 3, 1e-6);
    EXPECT_NEAR(more.param_std_errors[0][k] / once.param_std_errors[0][k], 0.5, 1e-6);
  }
}

// Common noise t of n replicates with own noise s has the information of one observation with
// variance t^2 + s^2 / n.
TEST(Uncertainty, OfReplicatesWithCommonNoiseIsThatOfTheirMean) {
  Bundle one = ExactBundle({.frames = 5});
  Bundle replicated = one;
  constexpr int kReplicates = 4;
  constexpr double kCommon = 0.3;
  replicated.observations.clear();
  for (const BundleObservation& observation : one.observations) {
    replicated.observations.insert(replicated.observations.end(), kReplicates, observation);
  }
  replicated.cameras[0].noise.common_sigma = kCommon;
  const double sigma = std::sqrt(kCommon * kCommon + kNoise * kNoise / kReplicates);
  for (BundleObservation& observation : one.observations) observation.assumed_sigma = sigma;
  const Uncertainty expected = EstimateUncertainty(one);
  const Uncertainty found = EstimateUncertainty(replicated);
  for (size_t k = 0; k < 7; ++k) {
    EXPECT_NEAR(found.param_std_errors[0][k] / expected.param_std_errors[0][k], 1, 1e-6);
  }
  // All seven parameters and five poses are determined by the means.
  EXPECT_NEAR(found.degrees_used_by_means[0], 7 + 6 * 5, 1e-6);
}

TEST(Uncertainty, CountsTheUnknownsOfOneCamera) {
  const Bundle bundle = ExactBundle({.frames = 5});
  const Uncertainty uncertainty = EstimateUncertainty(bundle);
  const double coordinates = 2 * static_cast<double>(bundle.observations.size());
  EXPECT_NEAR(uncertainty.redundancy[0], coordinates - 7 - 6 * 5, 1e-6);
}

TEST(Uncertainty, SharesTheUnknownsOfARigAmongItsCameras) {
  const Bundle bundle = ExactBundle({.cameras = 2, .frames = 5, .marker_tolerance = 3e-4});
  const Uncertainty uncertainty = EstimateUncertainty(bundle);
  const double coordinates = 2 * static_cast<double>(bundle.observations.size());
  double markers = 0;  // the part that the observations determine beside the prior
  for (const Eigen::Vector3d& error : uncertainty.marker_std_errors) {
    for (const double each : error) {
      EXPECT_LT(each, bundle.marker_freedom.Sigma());
      markers += 1 - each * each / bundle.marker_freedom.Variance();
    }
  }
  EXPECT_NEAR(uncertainty.redundancy[0] + uncertainty.redundancy[1],
              coordinates - 2 * 7 - 6 - 6 * 5 - markers,
              1e-5);
}

// Poses and jitter alone, of cameras that are known.
TEST(Uncertainty, SharesTheDegreesOfPosesAndJitterAmongTheViews) {
  Bundle bundle = ExactBundle({.cameras = 2, .frames = 3, .noise = 0.2});
  bundle.jitter.translation_sigma = 3e-4;
  bundle.jitter.rotation_sigma = 2e-3;
  bundle.jitter.delta.assign(6, Vector6d::Constant(1e-4));
  bundle.jitter.misplaced.assign(6, false);
  for (BundleCamera& camera : bundle.cameras) camera.fixed.assign(7, true);
  const Uncertainty uncertainty = EstimateUncertainty(bundle);
  testing::DenseProblem dense{bundle};
  dense.Differentiate();
  const Eigen::Index first = dense.Pose(0), states = dense.Size() - first;
  const Eigen::MatrixXd J = dense.J.rightCols(states);
  const Eigen::MatrixXd C = dense.N.bottomRightCorner(states, states).inverse();
  const Eigen::VectorXd used = (J * C).cwiseProduct(J).rowwise().sum();
  std::vector<double> redundancy(2);
  double of_prior[2] = {-3, -3};  // less the extrinsics, which the mean of the jitter determines
  for (Eigen::Index r = 0; r < used.size(); ++r) {
    const int camera = dense.cameras[static_cast<size_t>(r)];
    if (camera >= 0) redundancy[static_cast<size_t>(camera)] += 1 - used[r];
    if (camera < 0) of_prior[r % 6 / 3] += 1 - used[r];
  }
  EXPECT_NEAR(uncertainty.redundancy[0], redundancy[0], 1e-4);
  EXPECT_NEAR(uncertainty.redundancy[1], redundancy[1], 1e-4);
  EXPECT_NEAR(uncertainty.jitter_translation_redundancy, of_prior[0], 1e-4);
  EXPECT_NEAR(uncertainty.jitter_rotation_redundancy, of_prior[1], 1e-4);
  // Both kinds of unknowns are partly determined, so that each term of their covariance counts.
  EXPECT_GT(of_prior[0], 1);
  EXPECT_LT(of_prior[0], 14);
}

// Against the inverse of the whole normal matrix.
void ExpectInverse(const Bundle& bundle) {
  const Uncertainty uncertainty = EstimateUncertainty(bundle);
  testing::DenseProblem dense{bundle};
  dense.Differentiate();
  const Eigen::VectorXd sigma = dense.N.inverse().diagonal().cwiseSqrt();
  for (size_t k = 0; k < 7; ++k) {
    const int i = dense.layout.params[0][k];
    EXPECT_NEAR(uncertainty.param_std_errors[0][k] / sigma[i], 1, 1e-4) << k;
  }
  ASSERT_EQ(uncertainty.marker_std_errors.size(), bundle.markers.size());
  for (size_t m = 0; m < bundle.markers.size(); ++m) {
    const Eigen::Vector3d expected = sigma.segment<3>(dense.layout.Marker(static_cast<int>(m)));
    EXPECT_LT((uncertainty.marker_std_errors[m] - expected).norm(), 1e-4 * expected.norm()) << m;
  }
}

TEST(Uncertainty, OfMarkersAndParametersIsTheInverseOfTheWholeNormalMatrix) {
  Bundle bundle = ExactBundle({.frames = 5});
  bundle.marker_freedom = MarkerFreedom::FromSigma(0.0005);
  ExpectInverse(bundle);
  // A distance between two middles that is known better than the markers are.
  const double sigma = 2e-5;
  MarkerDistance distance{.markers_a = {0, 1}, .markers_b = {68, 69}, .sigma = sigma};
  const auto at = [&](size_t m) { return bundle.markers[m].position; };
  distance.length = ((at(0) + at(1)) / 2 - (at(68) + at(69)) / 2).norm();
  bundle.distances = {distance};
  ExpectInverse(bundle);
}

TEST(Uncertainty, CombinesPriorsAsOneMoreObservation) {
  Bundle bundle = ExactBundle({.frames = 5});
  const Uncertainty without = EstimateUncertainty(bundle);
  const double variance = without.covariance(0, 0);
  const double prior = std::sqrt(variance);  // of f_x: as much as the images
  bundle.cameras[0].rules.resize(7);
  bundle.cameras[0].rules[0].prior = {.value = bundle.cameras[0].params[0], .sigma = prior};
  const Uncertainty with = EstimateUncertainty(bundle);
  // C' = C - c c' / (prior^2 + C_00) with the first column c of C.
  const Eigen::VectorXd c = without.covariance.col(0);
  const Eigen::MatrixXd expected = without.covariance - c * c.transpose() / (2 * variance);
  for (Eigen::Index i = 0; i < 7; ++i) {
    EXPECT_NEAR(with.covariance(i, i) / expected(i, i), 1, 1e-5) << i;
  }
  EXPECT_NEAR(with.redundancy[0] - without.redundancy[0], 0.5, 1e-5);
}

// A prior on the roughness of three parameters, of as much information as the images have.
TEST(Uncertainty, OfAModelWithPriorRowsIsThatOfTheNormalEquations) {
  Bundle bundle = ExactBundle({.frames = 5});
  constexpr std::array<size_t, 3> kIndices{4, 5, 6};
  const std::array<double, 3> weights{1, -2, 1};
  Eigen::VectorXd w = Eigen::VectorXd::Zero(7);
  w.tail<3>() << 1, -2, 1;
  const double variance = w.dot(EstimateUncertainty(bundle).covariance * w);
  const PriorRow row{.indices = kIndices, .weights = weights, .sigma = std::sqrt(variance)};
  CameraModel model = *bundle.cameras[0].model;
  model.prior_rows = std::span(&row, 1);
  bundle.cameras[0].model = &model;
  ASSERT_TRUE(Adjust(&bundle, {}).usable);
  const Uncertainty with = EstimateUncertainty(bundle);
  const Eigen::Map<const Eigen::VectorXd> params(bundle.cameras[0].params.data(), 7);
  const Eigen::MatrixXd of_prior = w * w.transpose() / variance;
  const Eigen::VectorXd step = with.covariance * (with.frames_gradient + of_prior * params);
  for (Eigen::Index i = 0; i < 7; ++i) {
    EXPECT_LT(std::abs(step[i]), 1e-3 * std::sqrt(with.covariance(i, i))) << i;
  }
  EXPECT_GT(std::abs((of_prior * params).dot(with.covariance * of_prior * params)), 0.1)
      << "the prior has no effect";
  const Eigen::MatrixXd one = with.covariance * (with.frames_information + of_prior);
  EXPECT_LT((one - Eigen::MatrixXd::Identity(7, 7)).diagonal().norm(), 1e-5);
  EXPECT_NEAR(with.redundancy[0],
              2 * static_cast<double>(bundle.observations.size()) - 7 - 6 * 5 +
                  w.dot(with.covariance * w) / variance,
              1e-5);
}

TEST(Uncertainty, OfFixedAndOfTiedParameters) {
  Bundle bundle = ExactBundle({.frames = 5});
  bundle.cameras[0].fixed[2] = true;
  bundle.cameras[0].rules.resize(7);
  bundle.cameras[0].rules[1].tied_to = ParamIndex{0, 0};
  const Uncertainty uncertainty = EstimateUncertainty(bundle);
  EXPECT_EQ(uncertainty.param_std_errors[0][2], 0);
  EXPECT_EQ(uncertainty.param_index[0][2], -1);
  EXPECT_EQ(uncertainty.param_index[0][1], uncertainty.param_index[0][0]);
  EXPECT_EQ(uncertainty.param_std_errors[0][1], uncertainty.param_std_errors[0][0]);
  EXPECT_EQ(uncertainty.names.size(), 5U);
}

TEST(Uncertainty, NamesWhatOneViewOfAPlaneLeavesOpen) {
  const Bundle bundle = ExactBundle({.frames = 1, .distorted = false});
  const Uncertainty uncertainty = EstimateUncertainty(bundle);
  // A homography has eight numbers, the pose six: at least two of f_x, f_y, c_x, c_y are open.
  EXPECT_FALSE(uncertainty.open.empty());
}

// No frame has points of both cameras: the extrinsics are not determined, all else is.
TEST(Uncertainty, OfExtrinsicsWithoutACommonFrameIsInfinite) {
  Bundle bundle = ExactBundle({.cameras = 2, .frames = 8});
  std::erase_if(bundle.observations, [](const BundleObservation& observation) {
    return observation.frame % 2 != observation.camera;
  });
  const Uncertainty uncertainty = EstimateUncertainty(bundle);
  ASSERT_EQ(uncertainty.open.size(), 6U);
  Eigen::Index infinite = 0;
  for (const OpenDirection& direction : uncertainty.open) {
    EXPECT_GT(direction.sigma, 100) << "rounding";
    infinite += std::isinf(direction.sigma) ? 1 : 0;
    EXPECT_TRUE(direction.parts.at(0).first.starts_with("cam1.T_camera_rig."))
        << direction.parts[0].first;
  }
  EXPECT_GT(infinite, 0);
  EXPECT_EQ(uncertainty.undetermined.cols(), infinite);
  EXPECT_TRUE(std::isinf(uncertainty.extrinsics_covariance[1].diagonal().maxCoeff()));
  EXPECT_EQ(uncertainty.extrinsics_covariance[0], Matrix6d::Zero());
  for (size_t c = 0; c < 2; ++c) {
    for (const double sigma : uncertainty.param_std_errors[c]) {
      EXPECT_TRUE(sigma > 0 && std::isfinite(sigma)) << c;
    }
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
