// SPDX-License-Identifier: Apache-2.0
//
// Images of the simulator against the camera models' own projection.
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <opencv2/core.hpp>

#include "apps/simulate/render/observer.h"
#include "apps/simulate/render/renderer.h"
#include "apps/simulate/render/sensor.h"
#include "apps/simulate/targets/target_surface.h"
#include "models/registry.h"

namespace plenocal::simulate {
namespace TEST_FILE {

constexpr double kSpacing = 0.02;  // m

// 3 x 3 discs of 10 mm, each 20 mm from the next.
Target Discs() {
  Target target;
  target.layout = CirclesLayout{{}, 3, 3, kSpacing};
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      target.markers[3 * row + column] = {kSpacing * column, kSpacing * row, 0};
    }
  }
  target.nominal_yaml =
      "plenocal: 1\ntype: circles\ncolumns: 3\nrows: 3\nspacing: 0.02\npattern: symmetric\n";
  return target;
}

// Tilted; its middle at (x, y, z).
RigidTransform Pose(double x, double y, double z) {
  const Eigen::Matrix3d R = ExpRotation({0.25, -0.2, 0.3});
  return {R, Eigen::Vector3d(x, y, z) - R * Eigen::Vector3d(kSpacing, kSpacing, 0)};
}

// Centroid of what is darker than paper around `at`, over the pixels within `radius`.
Eigen::Vector2d DarkCentroid(const cv::Mat& light,
                             const cv::Mat& white,
                             const Eigen::Vector2d& at,
                             double radius) {
  Eigen::Vector2d sum(0, 0);
  double weight = 0;
  for (int y = 0; y < light.rows; ++y) {
    for (int x = 0; x < light.cols; ++x) {
      if ((Eigen::Vector2d(x, y) - at).norm() > radius || white.at<float>(y, x) < 0.2) continue;
      const double dark = 1 - light.at<float>(y, x) / white.at<float>(y, x);
      sum += dark * Eigen::Vector2d(x, y);
      weight += dark;
    }
  }
  return sum / weight;
}

TEST(SimulatedImages, OfAnOrdinaryCameraShowMarkersWhereTheModelDoes) {
  CameraSpec camera{.name = "left",
                    .model = FindModel(CameraModels(), "pinhole-radial3"),
                    .image_size = {320, 240},
                    .config = {},
                    .params = {400, 402, 162, 118, -0.2, 0.05, 0},
                    .T_camera_rig = {},
                    .sensor = {},
                    .micro_lenses = {}};
  camera.sensor.blur = 0.7;
  const Target nominal = Discs();
  const TrueTarget made = MakeTarget(nominal, 0.0004, TagErrors::kRigid, 3);
  const RigidTransform pose = Pose(0.02, -0.01, 0.35);
  const auto renderer = MakeOrdinaryRenderer(camera);
  const cv::Mat light = renderer->Render(PosedSurface(TargetSurface(nominal, made, 1), pose), 1);
  SimulationSpec spec;
  spec.cameras = {camera};
  const std::vector<Observation> seen = Observer(spec).Observe(0, made, pose);
  ASSERT_EQ(seen.size(), 9u);
  for (const Observation& o : seen) {
    const Eigen::Vector2d at(o.values[0], o.values[1]);
    // A disc's image has its centroid a little off its centre's image, here by up to 0.02 px.
    EXPECT_LT((DarkCentroid(light, renderer->White(), at, 10) - at).norm(), 0.04) << o.marker;
  }
}

TEST(SimulatedImages, OfAPlenopticCameraShowMarkersWhereTheModelDoes) {
  for (const char* name : {"focused-plenoptic", "focused-plenoptic-pupil"}) {
    for (const bool keplerian : {false, true}) {
      SCOPED_TRACE(std::string(name) + (keplerian ? ", Keplerian" : ""));
      CameraSpec camera{
          .name = "plenoptic",
          .model = FindModel(CameraModels(), name),
          .image_size = {300, 300},
          .config = {7.4e-6},
          .params = {0.0125, keplerian ? 0.0141 : 0.012, 0.00026, 151, 147, -800, 3e7, 0.05, -0.03},
          .T_camera_rig = {},
          .sensor = {},
          .micro_lenses = {}};
      camera.sensor.blur = 0.3;
      // Small micro lenses: defocus beyond the stop's edge shifts what is seen.
      camera.micro_lenses = {
          .pitch = 24, .rotation = 0.3, .focus = {-3}, .aperture = 0.15, .fill = 0.95};
      if (!keplerian) {
        camera.micro_lenses->focus = {2.5, 3, 4};
        camera.micro_lenses->pattern = *UsualPattern(LatticeKind::kHexagonal, 3);
      }
      if (camera.params.size() < camera.model->params.size()) camera.params.push_back(0.02);
      const Target nominal = Discs();
      const TrueTarget made = MakeTarget(nominal, 0.0004, TagErrors::kRigid, 3);
      const RigidTransform pose = Pose(0.004, -0.002, 0.45);
      const MicroLensOptics optics(camera);
      const auto renderer = MakePlenopticRenderer(camera, optics, 1, 2);
      const cv::Mat light =
          renderer->Render(PosedSurface(TargetSurface(nominal, made, 1), pose), 1);
      int compared = 0;
      double worst = 0;
      Eigen::Vector2d mean(0, 0);
      for (const auto& [marker, position] : made.markers) {
        for (const Observation& o : optics.Observe(marker, pose * position)) {
          const Eigen::Vector2d at(o.values[0], o.values[1]), lens(o.values[2], o.values[3]);
          // The whole disc must be in the micro image, and the micro image on the sensor.
          if ((at - lens).norm() > 4 || lens.minCoeff() < 14 || lens.maxCoeff() > 285) continue;
          const Eigen::Vector2d error = DarkCentroid(light, renderer->White(), at, 6) - at;
          worst = std::max(worst, error.norm());
          mean += error;
          ++compared;
        }
      }
      ASSERT_GT(compared, 5);
      EXPECT_LT(worst, 0.12);
      EXPECT_LT((mean / compared).norm(), 0.03);
    }
  }
}

TEST(SimulatedImages, MicroImagesOfThePupilAreCentredOnTheMicroLenses) {
  CameraSpec camera{.name = "plenoptic",
                    .model = FindModel(CameraModels(), "focused-plenoptic"),
                    .image_size = {240, 240},
                    .config = {7.4e-6},
                    .params = {0.0125, 0.012, 0.00026, 121, 117, -800, 3e7, 0.05, -0.03},
                    .T_camera_rig = {},
                    .sensor = {},
                    .micro_lenses = {}};
  camera.sensor.blur = 0.3;
  camera.micro_lenses = {.pitch = 20, .focus = {3}, .fill = 0.8};
  for (const bool raw : {false, true}) {
    camera.micro_lenses->regular_in_raw = raw;
    const MicroLensOptics optics(camera);
    const auto renderer = MakePlenopticRenderer(camera, optics, 1, 1);
    const cv::Mat& white = renderer->White();
    const Eigen::Vector2d first = optics.Lenses().front().centre;
    double off_lattice = 0;
    int inside = 0;
    for (const MicroLens& lens : optics.Lenses()) {
      const double rows = (lens.centre - first).y() / (20 * std::sqrt(0.75));
      off_lattice = std::max(off_lattice, std::abs(rows - std::round(rows)));
      if (lens.centre.minCoeff() < 12 || lens.centre.maxCoeff() > 227) continue;
      ++inside;
      const cv::Mat paper(white.size(), CV_32F, cv::Scalar(1));
      EXPECT_LT((DarkCentroid(paper - white, paper, lens.centre, 10) - lens.centre).norm(), 0.06);
    }
    EXPECT_GT(inside, 90);
    EXPECT_EQ(off_lattice < 1e-9, raw);
  }
}

TEST(SimulatedImages, PixelQuantilesHaveTheVarianceOfThePointSpreadFunction) {
  for (const double blur : {0.0, 0.35, 1.0}) {
    const std::vector<float> x = PixelQuantiles(512, blur);
    ASSERT_EQ(x.size(), 512u);
    double variance = 0;
    for (const float value : x) variance += value * value / 512.0;
    EXPECT_NEAR(variance, blur * blur + 1 / 12.0, 0.01 * (blur * blur + 1 / 12.0));
  }
}

TEST(SimulatedTarget, TagsStayFlatAndCoordinatesHaveTheirSigma) {
  Target nominal;
  TagLayout layout{.family = "tag36h11", .ids = {}};
  for (int id = 0; id < 400; ++id) {
    layout.ids.push_back(id);
    const Eigen::Matrix3d R = ExpRotation({0.3 * id, 0.2, 0.1});
    for (int k = 0; k < 4; ++k) {
      nominal.markers[4 * id + k] =
          R * Eigen::Vector3d(k == 1 || k == 2 ? 0.03 : 0, k > 1 ? 0.03 : 0, 0);
    }
  }
  nominal.layout = layout;
  for (const bool rigid : {false, true}) {
    const TrueTarget made =
        MakeTarget(nominal, 0.0005, rigid ? TagErrors::kRigid : TagErrors::kCorners, 1);
    double squares = 0;
    for (const int id : layout.ids) {
      const auto at = [&](int k) -> Eigen::Vector3d { return made.markers.at(4 * id + k); };
      for (int k = 0; k < 4; ++k) {
        squares += (at(k) - nominal.markers.at(4 * id + k)).squaredNorm() / (3 * 1600.0);
      }
      const Eigen::Vector3d a = at(1) - at(0), b = at(2) - at(0), c = at(3) - at(0);
      EXPECT_LT(std::abs(a.cross(c).normalized().dot(b)), 1e-12);
      if (rigid) {
        EXPECT_NEAR(a.norm(), c.norm(), 1e-12);
      }
    }
    EXPECT_NEAR(std::sqrt(squares), 0.0005, 0.00002);
  }
}

TEST(SimulatedImages, NoiseIsThatOfTheElectrons) {
  const SensorSpec sensor{.bits = 12, .full_well = 5000, .read_noise = 12, .exposure = 0.8};
  Random random(1, "test");
  const cv::Mat image = Expose(cv::Mat(300, 300, CV_32F, cv::Scalar(0.5)), sensor, &random);
  ASSERT_EQ(image.type(), CV_16U);
  cv::Scalar mean, sigma;
  cv::meanStdDev(image, mean, sigma);
  constexpr double kElectrons = 5000 * 0.8 * 0.5, kGrays = 4095 / 5000.0;
  EXPECT_NEAR(mean[0], kElectrons * kGrays, 1);
  EXPECT_NEAR(sigma[0], std::sqrt(kElectrons + 144) * kGrays, 0.5);
}

}  // namespace TEST_FILE
}  // namespace plenocal::simulate
