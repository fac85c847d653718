// SPDX-License-Identifier: Apache-2.0
//
// Texts of the files of a simulated scene.
#include "apps/simulate/scene/scene_files.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>

#include "apps/simulate/spec/random.h"
#include "calib/base/error.h"
#include "tests/apps/simulate/small_scene.h"
#include "tests/refusal.h"

namespace plenocal::simulate {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

// With a plenoptic camera and a mosaic.
SimulationSpec Mixed() {
  SimulationSpec spec = SmallScene();
  spec.scenery->scene.points = 321;
  CameraSpec raw;
  raw.name = "raw";
  raw.model = FindModel(CameraModels(), "focused-plenoptic");
  raw.image_size = {90, 80};
  raw.config = {7.4e-6};
  raw.params.assign(raw.model->params.size(), 0);
  spec.cameras[0].sensor.bayer = BayerOrder::kGrbg;
  spec.cameras[1] = raw;
  return spec;
}

RigPath ThreeInstants() {
  RigPath path;
  path.instants = {{"000000", 0, Part::kStart, true, {}},
                   {"000001",
                    0.5,
                    Part::kBetween,
                    false,
                    {ExpRotation({0, 0, std::numbers::pi / 2}), {1, 2, 3}}},
                   {"000002", 1.25, Part::kEnd, true, {Eigen::Matrix3d::Identity(), {0.1, 0, -4}}}};
  return path;
}

TEST(SceneFiles, AreARecordingAndASessionOfItsCameras) {
  const SimulationSpec spec = Mixed();
  EXPECT_EQ(RecordingYaml(spec, true),
            "plenocal: 1\ncameras:\n"
            "  left:\n    tracks: tracks_left.csv\n    times: times.txt\n    exposure_unit: ms\n"
            "  raw:\n    tracks: tracks_raw.csv\n    times: times.txt\n    exposure_unit: ms\n"
            "    pixel_size: 7.4e-06\n"
            "pairing: {by: name}\ncalibration: calibration.yaml\n");
  EXPECT_EQ(
      RecordingYaml(spec, false),
      "plenocal: 1\ncameras:\n"
      "  left:\n    images: left/*.png\n    bayer: GRBG\n    times: times.txt\n    exposure_unit: ms\n"
      "  raw:\n    images: raw/*.png\n    white_images: raw_white/*.png\n    times: times.txt\n"
      "    exposure_unit: ms\n    pixel_size: 7.4e-06\n"
      "pairing: {by: name}\ncalibration: calibration.yaml\n");
  EXPECT_EQ(
      SceneSessionYaml(spec, true, {"{a: 1}", "{b: 2}"}),
      "plenocal: 1\nscene:\n  points: 321\n  distances:\n    - {a: 1}\n    - {b: 2}\ncameras:\n"
      "  left:\n    model: pinhole-radial3\n    detections: tracks_left.csv\n    image_size: [64, 48]\n"
      "  raw:\n    model: focused-plenoptic\n    detections: tracks_raw.csv\n    image_size: [90, 80]\n"
      "    pixel_size: 7.4e-06\n");
  EXPECT_EQ(
      SceneSessionYaml(spec, false, {}),
      "plenocal: 1\nscene:\n  points: 321\ncameras:\n"
      "  left:\n    model: pinhole-radial3\n    images: left/*.png\n    bayer: GRBG\n"
      "  raw:\n    model: focused-plenoptic\n    images: raw/*.png\n    white_images: raw_white/*.png\n"
      "    pixel_size: 7.4e-06\n");
}

TEST(SceneFiles, HaveTimesAndPosesOfTheUsedFrames) {
  const RigPath path = ThreeInstants();
  EXPECT_EQ(TimesText(path), "# frame time_s exposure_ms\n000000 0.000000 5\n000002 1.250000 5\n");
  const std::string poses = PathPosesCsv(path);
  EXPECT_EQ(std::ranges::count(poses, '\n'), 3);
  EXPECT_THAT(poses, ::testing::HasSubstr("\n000002,0.1,0,-4"));
}

TEST(SceneFiles, HaveTheCamerasPathsInTheWorld) {
  CameraSpec camera = SmallCamera("left", {Eigen::Matrix3d::Identity(), {-0.5, 0, 0}});
  const RigPath path = ThreeInstants();
  const std::string start = "# time x y z qx qy qz qw\n0.000000 0.5 0 0 0 0 0 1\n";
  const std::string end = "1.250000 0.6 0 -4 0 0 0 1\n";
  EXPECT_EQ(TrajectoryText(path, camera, PathExtent::kSegments), start + end);
  // The camera is 0.5 m along the rig's x axis, which is the world's y axis there.
  EXPECT_EQ(TrajectoryText(path, camera, PathExtent::kWhole),
            start + "0.500000 1 2.5 3 0 0 0.707106781187 0.707106781187\n" + end);
}

ScenePoint Point(int number, std::optional<int> at_end, std::optional<size_t> box = {}) {
  ScenePoint point;
  point.position = {number + 0.5, 2.0 * number, -1};
  point.number = number;
  point.number_at_end = at_end;
  point.box = box;
  return point;
}

TEST(SceneFiles, NameStillAndMovingPointsByTheirNumbers) {
  const std::vector<ScenePoint> points{Point(1, 1),
                                       Point(2, 12),
                                       Point(3, {}),
                                       Point(4, 5),
                                       Point(5, 5),
                                       Point(6, 16, 3),
                                       Point(7, 7, 0),
                                       Point(8, {}, 1)};
  EXPECT_EQ(
      PointsCsv(points),
      "marker,x,y,z\n1,1.5,2,-1\n2,2.5,4,-1\n12,2.5,4,-1\n3,3.5,6,-1\n4,4.5,8,-1\n5,5.5,10,-1\n");
  EXPECT_EQ(MovingCsv(points), "marker,box\n6,3\n16,3\n7,0\n8,1\n");
  CameraTracks tracks;
  tracks.wrong = {{"000005", 7}, {"000006", 1}};
  EXPECT_EQ(WrongMatchesCsv(tracks), "frame,marker\n000005,7\n000006,1\n");
}

TEST(SceneFiles, GiveCalibrationsWithErrorsOfTheirSigmas) {
  SimulationSpec spec = SmallScene();
  CalibrationSigma& sigma = spec.scenery->calibration_sigma;
  sigma = {.baseline = 0.002,
           .rotation = 0.01,
           .focal = 0.3,
           .parameters = {{"right", {{"f_x", 2}, {"A_0", 0.1}}}}};
  const CalibrationRecord record = GivenRecord(spec);
  const std::vector<std::vector<double>> sigmas{{0.3, 0.3, 0.3, 0.3, 0, 0, 0},
                                                {2, 0.3, 0.3, 0.3, 0.1, 0, 0}};
  for (size_t c = 0; c < 2; ++c) {
    const CalibratedCamera& camera = record.cameras[c];
    Random random(5, "calibration", {c});
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(7, 7);
    for (size_t i = 0; i < 7; ++i) {
      const double s = sigmas[c][i];
      EXPECT_DOUBLE_EQ(camera.params[i], spec.cameras[c].params[i] + random.Gaussian(s));
      covariance(static_cast<int>(i), static_cast<int>(i)) = s * s;
    }
    EXPECT_EQ(camera.covariance, covariance);
    const Vector6d change = Log(camera.T_camera_rig) - Log(spec.cameras[c].T_camera_rig);
    for (int i = 0; i < 6; ++i) {
      const double s = c == 0 ? 0 : i < 3 ? 0.002 : 0.01;
      EXPECT_EQ(camera.sigma_xi[i], s);
      EXPECT_NEAR(change[i], random.Gaussian(s), 1e-12);
    }
  }
}

TEST(SceneFiles, HaveTheLongestOfSomeDistancesBetweenPointsThatAreSeenOften) {
  SimulationSpec spec = SmallScene();
  SceneSpec& scene = spec.scenery->scene;
  scene.distances = 3;
  scene.distance_sigma = 0.25;
  std::vector<ScenePoint> points;
  std::vector<int> observed;
  for (int i = 0; i < 12; ++i) {
    points.push_back(Point(i, i, i == 11 ? std::optional<size_t>(0) : std::nullopt));
    observed.push_back(i == 0 ? 9 : 10);  // the first one too rarely, the last one moves
  }
  const std::vector<std::string> lines = DrawDistances(spec, points, observed);
  ASSERT_EQ(lines.size(), 3u);
  for (size_t k = 0; k < 3; ++k) {
    Random random(5, "distance", {k});
    const auto draw = [&] { return 1 + static_cast<int>(random.Uniform(0, 10)); };
    int a = 1, b = 1;
    for (int i = 0; i < 20; ++i) {
      const int from = draw(), to = draw();
      if (std::abs(from - to) > std::abs(a - b)) a = from, b = to;
    }
    EXPECT_EQ(lines[k],
              fmt::format("{{between: [point {}, point {}], value: {:.6f}, sigma: 0.25}}",
                          a,
                          b,
                          std::abs(a - b) * std::sqrt(5) + random.Gaussian(0.25)));
  }
  scene.distances = 0;
  EXPECT_THAT(DrawDistances(spec, points, observed), IsEmpty());
  observed.assign(12, 9);
  EXPECT_THAT(DrawDistances(spec, points, observed), IsEmpty());
  scene.distances = 1;
  observed[4] = 10;
  EXPECT_EQ(
      testing::RefusalOf([&] { DrawDistances(spec, points, observed); }, ErrorKind::kJob),
      "spec.yaml: scene.distances: no two points are seen in 10 images; give more frames or points");
  observed[5] = 10;
  EXPECT_THAT(DrawDistances(spec, points, observed),
              ElementsAre(::testing::StartsWith("{between: [point ")));
}

}  // namespace TEST_FILE
}  // namespace plenocal::simulate
