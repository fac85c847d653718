// SPDX-License-Identifier: Apache-2.0
//
// The pose of one image with its covariance by numeric derivatives; maps in files; features that
// look alike.
#include "engine/scene/locate_view.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "engine/scene/track/feature_tracker.h"
#include "models/registry.h"
#include "tests/calib/random.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Pair;

constexpr double kSigma = 0.2;  // px
const RigidTransform kMapCamera{ExpRotation({0.2, -0.1, 0.3}), {0.3, -0.2, 0.5}};

CalibratedCamera Camera() {
  CalibratedCamera camera;
  camera.name = "left";
  camera.model = FindModel(CameraModels(), "pinhole");
  camera.image_size = {800, 600};
  camera.params = {500, 510, 400, 300};
  camera.covariance = Eigen::MatrixXd::Zero(4, 4);
  return camera;
}

Eigen::Vector2d ImageOf(const CalibratedCamera& camera,
                        const RigidTransform& T_map_camera,
                        const Eigen::Vector3d& point) {
  const Eigen::Vector3d p = T_map_camera.Inverse() * point;
  return {camera.params[2] + camera.params[0] * p.x() / p.z(),
          camera.params[3] + camera.params[1] * p.y() / p.z()};
}

struct Before {
  std::map<int, Eigen::Vector3d> points;
  View view;
};

Before Seen(int count) {
  Random random(2);
  Before made;
  for (int k = 0; k < count; ++k) {
    const Eigen::Vector3d p =
        kMapCamera *
        Eigen::Vector3d(random.Uniform(-1, 1), random.Uniform(-0.8, 0.8), random.Uniform(2, 4));
    made.points[10 + k] = p;
    Observation& seen = made.view.observations.emplace_back();
    seen.marker = 10 + k;
    const Eigen::Vector2d u = ImageOf(Camera(), kMapCamera, p);
    seen.values = {u.x() + random.Gaussian(kSigma), u.y() + random.Gaussian(kSigma)};
  }
  made.points[1000] = {9, 9, 9};  // is not seen
  return made;
}

double ErrorOf(const RigidTransform& found) {
  return (found.t - kMapCamera.t).norm() + LogRotation(found.R * kMapCamera.R.transpose()).norm();
}

TEST(LocateView, CovarianceIsThatOfNoiseAndParameters) {
  constexpr int kPoints = 25;
  Before seen = Seen(kPoints);
  seen.view.observations.push_back({.marker = 500});  // of no point
  CalibratedCamera camera = Camera();
  const auto exact = LocateView(camera, seen.view, seen.points, Numbering::kByMarker);
  ASSERT_TRUE(exact);
  EXPECT_EQ(exact->points, static_cast<size_t>(kPoints));
  ASSERT_EQ(exact->used, static_cast<size_t>(kPoints));
  EXPECT_FALSE(exact->alternative);
  EXPECT_LT(ErrorOf(exact->T_map_camera), 0.01);
  // Residuals, and their derivatives by xi and by the parameters.
  const Vector6d xi = Log(exact->T_map_camera);
  const auto predict = [&](const Vector6d& at, const std::vector<double>& params) {
    CalibratedCamera with = camera;
    with.params = params;
    Eigen::VectorXd places(2 * kPoints);
    for (int k = 0; k < kPoints; ++k) {
      places.segment<2>(2 * k) = ImageOf(with, Exp(at), seen.points.at(10 + k));
    }
    return places;
  };
  Eigen::VectorXd measured(2 * kPoints);
  for (int k = 0; k < kPoints; ++k) {
    const auto& values = seen.view.observations[static_cast<size_t>(k)].values;
    measured.segment<2>(2 * k) << values[0], values[1];
  }
  const double square = (measured - predict(xi, camera.params)).squaredNorm();
  EXPECT_NEAR(exact->rms, std::sqrt(square / kPoints), 1e-6);
  Eigen::MatrixXd J(2 * kPoints, 6), by_params(2 * kPoints, 4);
  constexpr double kStep = 1e-6;
  for (int i = 0; i < 6; ++i) {
    const Vector6d step = kStep * Vector6d::Unit(i);
    J.col(i) =
        (predict(xi + step, camera.params) - predict(xi - step, camera.params)) / (2 * kStep);
  }
  for (size_t i = 0; i < 4; ++i) {
    std::vector<double> above = camera.params, below = camera.params;
    above[i] += 0.01;
    below[i] -= 0.01;
    by_params.col(static_cast<Eigen::Index>(i)) = (predict(xi, above) - predict(xi, below)) / 0.02;
  }
  const Matrix6d by_noise = square / (2 * kPoints - 6) * (J.transpose() * J).inverse().eval();
  EXPECT_LT((exact->covariance - by_noise).norm(), 0.02 * by_noise.norm());

  const Eigen::MatrixXd root{{2, 0, 0, 0}, {1, 2, 0, 0}, {0, -1, 3, 0}, {0, 0, 0, 0}};
  camera.covariance = root * root.transpose();
  const auto uncertain = LocateView(camera, seen.view, seen.points, Numbering::kByMarker);
  ASSERT_TRUE(uncertain);
  const Eigen::MatrixXd gain = (J.transpose() * J).ldlt().solve(J.transpose() * by_params);
  const Matrix6d expected = by_noise + gain * camera.covariance * gain.transpose();
  EXPECT_LT((uncertain->covariance - expected).norm(), 0.02 * expected.norm());
}

TEST(LocateView, ParametersThatAreNotDeterminedCountAsExact) {
  const Before seen = Seen(25);
  CalibratedCamera camera = Camera();
  const auto exact = LocateView(camera, seen.view, seen.points, Numbering::kByMarker);
  camera.covariance(2, 2) = std::numeric_limits<double>::infinity();
  const auto found = LocateView(camera, seen.view, seen.points, Numbering::kByMarker);
  ASSERT_TRUE(exact && found);
  EXPECT_EQ(found->covariance, exact->covariance);
}

// Each point is measured four times, with an error of its own and one in common.
TEST(LocateView, NoiseThatMeasurementsOfAPointShareDoesNotAverageOut) {
  constexpr int kPoints = 40, kTimes = 4;
  constexpr double kCommon = 0.1;
  Random random(9);
  Before seen = Seen(kPoints);
  const std::vector<Observation> single = seen.view.observations;
  seen.view.observations.clear();
  for (const Observation& each : single) {
    Observation common = each;
    const Eigen::Vector2d u = ImageOf(Camera(), kMapCamera, seen.points.at(each.marker));
    for (Eigen::Index k = 0; k < 2; ++k) {
      common.values[static_cast<size_t>(k)] = u[k] + random.Gaussian(kCommon);
    }
    seen.view.observations.insert(seen.view.observations.end(), kTimes, common);
  }
  for (Observation& each : seen.view.observations) {
    for (size_t k = 0; k < 2; ++k) each.values[k] += random.Gaussian(kSigma);
  }
  // In any order.
  std::ranges::stable_sort(
      seen.view.observations, {}, [](const Observation& each) { return each.values[0]; });
  CalibratedCamera camera = Camera();
  const auto covariance = [&] {
    const auto found = LocateView(camera, seen.view, seen.points, Numbering::kByMarker);
    EXPECT_TRUE(found);
    EXPECT_EQ(found->used, static_cast<size_t>(kPoints));
    EXPECT_EQ(found->points, static_cast<size_t>(kPoints));
    return found->covariance;
  };
  const Matrix6d independent = covariance();
  camera.fit.common_noise = kCommon;
  // The noise of all is the same; of four measurements (0.2^2 + 0.1^2) / 4 against
  // 0.2^2 / 4 + 0.1^2.
  constexpr double kRatio =
      (kSigma * kSigma + kTimes * kCommon * kCommon) / (kSigma * kSigma + kCommon * kCommon);
  EXPECT_NEAR(covariance().trace() / independent.trace(), kRatio, 0.1);
}

// Those with a tenth of the sigma have a hundred times the weight: of the displacement a 101st is
// left, not half. How much of the pose's error that is depends on where the points are.
TEST(LocateView, DetectorsSigmasAreWeights) {
  Before seen = Seen(40);
  for (size_t k = 0; k < 40; ++k) {
    Observation& each = seen.view.observations[k];
    const Eigen::Vector2d u = ImageOf(Camera(), kMapCamera, seen.points.at(each.marker));
    each.values = {u.x() + (k % 2 == 0 ? 0 : 0.5), u.y()};
    each.detector_sigma = k % 2 == 0 ? 0.05 : 0.5;
  }
  const auto error = [&] {
    const auto found = LocateView(Camera(), seen.view, seen.points, Numbering::kByMarker);
    EXPECT_TRUE(found);
    return ErrorOf(found->T_map_camera);
  };
  const double weighted = error();
  for (Observation& each : seen.view.observations) each.detector_sigma = 0;
  EXPECT_LT(weighted, 0.1 * error());
}

TEST(LocateView, PointsThatDisagreeAreLeftOut) {
  Before seen = Seen(30);
  seen.view.observations[3].values[0] += 20;
  seen.view.observations[8].values[1] -= 20;
  const auto found = LocateView(Camera(), seen.view, seen.points, Numbering::kByMarker);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->points, 30U);
  EXPECT_EQ(found->used, 28U);
  EXPECT_LT(found->rms, 2 * kSigma);
  EXPECT_LT(ErrorOf(found->T_map_camera), 0.01);
}

TEST(LocateView, MostPointsMayBeWrongByAppearance) {
  Before seen = Seen(60);
  Random random(3);
  for (size_t k = 0; k < 36; ++k) {
    seen.view.observations[k].values = {random.Uniform(0, 800), random.Uniform(0, 600)};
  }
  const auto found = LocateView(Camera(), seen.view, seen.points, Numbering::kByAppearance);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->points, 60U);
  EXPECT_GE(found->used, 22U);
  EXPECT_LE(found->used, 25U);
  EXPECT_LT(ErrorOf(found->T_map_camera), 0.01);
  EXPECT_FALSE(found->alternative);
}

TEST(LocateView, NeedsFourPoints) {
  for (const int count : {0, 3}) {
    const Before seen = Seen(count);
    EXPECT_FALSE(LocateView(Camera(), seen.view, seen.points, Numbering::kByMarker));
  }
  const Before six = Seen(6);
  EXPECT_TRUE(LocateView(Camera(), six.view, six.points, Numbering::kByMarker));
  EXPECT_FALSE(LocateView(Camera(), six.view, six.points, Numbering::kByAppearance));
}

TEST(LandmarkMaps, AreReadAsTheyWereWritten) {
  const TemporaryFolder folder;
  LandmarkMap map;
  map.points = {{3, {0.5, -1.25, 2}}, {1, {1e-3, 0, 4}}};
  map.numbers = {3, 1};
  map.descriptors = cv::Mat::zeros(2, 128, CV_32F);
  map.descriptors.at<float>(0, 5) = 0.25F;
  map.descriptors.at<float>(1, 127) = 100 / 512.0F;
  EXPECT_EQ(PointsCsv(map), "marker,x,y,z\n3,0.5,-1.25,2\n1,0.001,0,4\n");
  const auto path = folder.Write("points.csv", PointsCsv(map));
  LandmarkMap read = ReadLandmarkMap(path);
  EXPECT_THAT(read.numbers, ElementsAre(3, 1));
  EXPECT_EQ(read.points, map.points);
  EXPECT_TRUE(read.descriptors.empty());
  const auto beside = folder.Write("descriptors.png", DescriptorsPng(map));
  read = ReadLandmarkMap(path);
  EXPECT_EQ(cv::norm(read.descriptors - map.descriptors), 0);
  folder.Write("points.csv", "marker,x,y,z\n3,0,0,1\n");
  EXPECT_EQ(Refusal([&] { ReadLandmarkMap(path); }),
            fmt::format("input: {}: has 2 rows for the 1 points of {}; both come from one run",
                        beside.string(),
                        path.string()));
}

cv::Mat Texture(int width, int height) {
  cv::RNG random(11);
  cv::Mat texture(height, width, CV_32F), grey;
  random.fill(texture, cv::RNG::NORMAL, 0, 1);
  cv::GaussianBlur(texture, texture, {}, 2);
  texture = 128 + texture * 160;
  texture.convertTo(grey, CV_8U);
  return grey;
}

TEST(LandmarkMaps, AreFoundAgainInAShiftedImage) {
  const cv::Mat texture = Texture(260, 200);
  const ImageFeatures features = FindFeatures(texture(cv::Rect(0, 0, 240, 200)), 200, {}, 0);
  ASSERT_GT(features.points.size(), 50U);
  ASSERT_LE(features.points.size(), 208U);  // cells of 15.5 px, 16 x 13
  ASSERT_EQ(features.descriptors.rows, static_cast<int>(features.points.size()));
  LandmarkMap map;
  map.descriptors = features.descriptors;
  for (size_t k = 0; k < features.points.size(); ++k) {
    map.numbers.push_back(100 + static_cast<int>(k));
    EXPECT_NEAR(cv::norm(features.descriptors.row(static_cast<int>(k))), 1, 1e-4);
  }
  const View view = MatchLandmarks(texture(cv::Rect(20, 0, 240, 200)).clone(), map);
  ASSERT_GT(view.observations.size(), 30U);
  size_t good = 0;
  for (const Observation& seen : view.observations) {
    const cv::Point2f& point = features.points[static_cast<size_t>(seen.marker - 100)];
    if (std::hypot(seen.values[0] + 20 - point.x, seen.values[1] - point.y) < 0.5) ++good;
  }
  EXPECT_GT(good, view.observations.size() * 9 / 10);
}

TEST(Features, AreFewAndApartFromThoseTaken) {
  const cv::Mat texture = Texture(240, 200);
  const ImageFeatures all = FindFeatures(texture, 100, {}, 0);
  const std::vector<cv::Point2f> taken{all.points[0], all.points[5]};
  const ImageFeatures others = FindFeatures(texture, 100, taken, 15);
  EXPECT_LE(FindFeatures(texture, 20, {}, 0).points.size(), 25U);  // cells of 49 px
  ASSERT_FALSE(others.points.empty());
  for (const cv::Point2f& point : others.points) {
    for (const cv::Point2f& other : taken) EXPECT_GE(cv::norm(point - other), 14.5);
  }
  EXPECT_THAT(FindFeatures(cv::Mat(100, 100, CV_8U, cv::Scalar(50)), 100, {}, 0).points, IsEmpty());
}

cv::Mat Rows(const std::vector<float>& x) {
  cv::Mat rows(static_cast<int>(x.size()), 2, CV_32F, cv::Scalar(0));
  for (int i = 0; i < rows.rows; ++i) rows.at<float>(i, 0) = x[static_cast<size_t>(i)];
  return rows;
}

TEST(Descriptors, MatchWhereEachIsTheOthersBestByFar) {
  EXPECT_THAT(MatchDescriptors(Rows({0, 10}), Rows({9, 1})), ElementsAre(Pair(0, 1), Pair(1, 0)));
  // 0.79 and 0.81 of the second best.
  EXPECT_THAT(MatchDescriptors(Rows({0, 50}), Rows({7.9F, -10, 50})),
              ElementsAre(Pair(0, 0), Pair(1, 2)));
  EXPECT_THAT(MatchDescriptors(Rows({0, 50}), Rows({8.1F, -10, 50})), ElementsAre(Pair(1, 2)));
  // 1 is the best for 0 and for 0.5, which is nearer to it.
  EXPECT_THAT(MatchDescriptors(Rows({0, 0.5F}), Rows({1, 30})), ElementsAre(Pair(1, 0)));
  EXPECT_THAT(MatchDescriptors(Rows({0}), Rows({0, 5})), IsEmpty());
  EXPECT_THAT(MatchDescriptors(Rows({0, 5}), Rows({0})), IsEmpty());
}

TEST(EpipolarGeometry, IsThatOfFifteenPairsAndMore) {
  Random random(4);
  std::vector<cv::Point2f> a, b;
  for (int k = 0; k < 40; ++k) {
    const Eigen::Vector3d p(random.Uniform(-1, 1), random.Uniform(-1, 1), random.Uniform(2, 5));
    const auto image = [](const Eigen::Vector3d& q) {
      return cv::Point2f(static_cast<float>(300 + 400 * q.x() / q.z()),
                         static_cast<float>(300 + 400 * q.y() / q.z()));
    };
    a.push_back(image(p));
    b.push_back(image(ExpRotation({0.05, 0.1, 0.02}) * p + Eigen::Vector3d(0.4, 0.1, 0.1)));
  }
  for (const size_t wrong : {3U, 17U}) b[wrong] += cv::Point2f(30, -60);
  const std::vector<bool> agrees = OnOneEpipolarGeometry(a, b);
  EXPECT_FALSE(agrees[3]);
  EXPECT_FALSE(agrees[17]);
  EXPECT_EQ(std::ranges::count(agrees, true), 38);
  a.erase(a.begin(), a.begin() + 25);
  b.erase(b.begin(), b.begin() + 25);
  EXPECT_EQ(std::ranges::count(OnOneEpipolarGeometry(a, b), true), 15);
  a.pop_back();
  b.pop_back();
  EXPECT_EQ(OnOneEpipolarGeometry(a, b), std::vector<bool>(14, false));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
