// SPDX-License-Identifier: Apache-2.0
//
// Points of tables of detections and of places in images.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "calib/files/calibration_file.h"
#include "calib/files/detections.h"
#include "calib/files/session.h"
#include "detectors/images/image.h"
#include "tests/engine/rigs/parallel_pair.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::EndsWith;

void WriteCalibration(const TemporaryFolder& folder, CalibrationRecord record) {
  record.adjustment.emplace();
  folder.Write("calibration.yaml", CalibrationYaml(record));
}

TEST(TriangulateTables, HaveThePointsOfTheirCameras) {
  const TemporaryFolder folder;
  const CalibrationRecord record = ParallelCameras(1e-6);
  WriteCalibration(folder, record);
  TriangulateRequest request;
  request.calibration = folder / "calibration.yaml";
  const std::vector<Eigen::Vector3d> points{{0, 0.1, 2}, {0.2, -0.1, 3}};
  for (const SeenPoints& each : SeenByPair(record, points)) {
    request.files.emplace_back(
        each.camera,
        folder.Write(each.camera + ".csv", DetectionsCsv(each.views, *record.cameras[0].model)));
  }
  const Triangulation made = TriangulatePoints(request, {});
  EXPECT_EQ(made.calibration, request.calibration.string());
  EXPECT_THAT(made.cameras, ElementsAre("left", "right"));
  ASSERT_EQ(made.points.size(), 2U);
  for (size_t k = 0; k < 2; ++k) {
    EXPECT_EQ(made.points[k].frame, "f1");
    EXPECT_LT((made.points[k].point.position - points[k]).norm(), 1e-4);
  }
  request.files[1].first = "up";
  EXPECT_THAT(Refusal([&] { TriangulatePoints(request, {}); }), ::testing::HasSubstr("up"));
}

class TriangulateSessions : public ::testing::Test {
 protected:
  TriangulateSessions() {
    WriteCalibration(folder_, record_);
    for (const SeenPoints& each : SeenByPair(record_, points_)) {
      folder_.Write(each.camera + ".csv", DetectionsCsv(each.views, *record_.cameras[0].model));
    }
    request_.calibration = folder_ / "calibration.yaml";
  }

  // Of a board with four points.
  [[nodiscard]] Session Read(const std::string& keys = "target: chessboard:2x2:200mm\n",
                             const std::string& right = "pinhole",
                             const std::string& name = "right") const {
    return ParseSession(
        fmt::format("plenocal: 1\n{}cameras:\n  left: {{model: pinhole, detections: left.csv, "
                    "image_size: [640, 480]}}\n  {}: {{model: {}, detections: right.csv, "
                    "image_size: [640, 480]{}}}\n",
                    keys,
                    name,
                    right,
                    right == "pinhole" ? "" : ", pixel_size: 5e-6"),
        folder_ / "s.yaml",
        CameraModels());
  }

  std::string Refused(const Session& session) {
    std::string why = Refusal([&] { TriangulatePoints(session, request_, {}); });
    const std::string path = (folder_ / "").string();
    for (size_t at = why.find(path); at != std::string::npos; at = why.find(path)) {
      why.erase(at, path.size());
    }
    return why;
  }

  TemporaryFolder folder_;
  const CalibrationRecord record_ = ParallelCameras(1e-6);
  const std::vector<Eigen::Vector3d> points_{
      {0, 0.1, 2}, {0.2, 0.1, 2}, {0, 0.3, 2}, {0.2, 0.3, 2.1}};
  TriangulateRequest request_;
};

TEST_F(TriangulateSessions, HaveThePointsOfTheirObservations) {
  request_.out = folder_ / "out";
  request_.lengths = {{{.name = "0", .points = {0}}, {.name = "1", .points = {1}}}};
  const Triangulation made = TriangulatePoints(Read(), request_, {});
  EXPECT_THAT(made.cameras, ElementsAre("left", "right"));
  ASSERT_EQ(made.points.size(), 4U);
  for (size_t k = 0; k < 4; ++k) {
    EXPECT_LT((made.points[k].point.position - points_[k]).norm(), 1e-4);
  }
  EXPECT_THAT(folder_.Read("out/points.csv"), ::testing::HasSubstr("f1,3,"));
  request_.out.clear();
  request_.lengths.clear();
  EXPECT_EQ(TriangulatePoints(Read(), request_, {}).points.size(), 4U);
}

TEST_F(TriangulateSessions, FitTheCalibration) {
  EXPECT_EQ(Refused(Read("target: chessboard:2x2:200mm\n", "focused-plenoptic")),
            "input: s.yaml: camera 'right' is plenoptic, but not so in calibration.yaml");
  EXPECT_THAT(Refused(Read("target: chessboard:2x2:200mm\n", "pinhole", "up")),
              ::testing::HasSubstr("'up'"));
  EXPECT_EQ(Refused(Read("scene: {}\n")),
            "input: s.yaml: has a scene in place of a target; give a target whose markers are "
            "found");
  for (auto* const sets : {&request_.lengths, &request_.angles, &request_.planes}) {
    sets->assign(1, {{.name = "marker 3", .points = {3}}, {.name = "marker 4", .points = {4}}});
    EXPECT_EQ(Refused(Read()), "input: s.yaml: the target has no marker 4");
    sets->clear();
  }
}

// One texture, 24 px farther left in the right image.
class TriangulateImages : public ::testing::Test {
 protected:
  static constexpr int kDisparity = 24;
  static constexpr double kFocal = 300;

  void SetUp() override {
    CalibrationRecord record = ParallelCameras(1e-6);
    for (CalibratedCamera& camera : record.cameras) {
      camera.image_size = {320, 120};
      camera.params = {kFocal, kFocal, 159.5, 59.5};
    }
    WriteCalibration(folder_, record);
    cv::RNG random(3);
    cv::Mat texture(120, 400, CV_32F);
    random.fill(texture, cv::RNG::NORMAL, 0, 1);
    cv::GaussianBlur(texture, texture, {}, 1.5);
    texture = 128 + texture * 120;
    texture.convertTo(texture_, CV_8U);
    request_.calibration = folder_ / "calibration.yaml";
    for (const auto& [name, at] : {std::pair{"left", 0}, {"right", kDisparity}}) {
      WriteImage(name, texture_(cv::Rect(at, 0, 320, 120)).clone());
      request_.files.emplace_back(name, folder_ / (std::string(name) + ".png"));
    }
  }

  void WriteImage(const std::string& name, const cv::Mat& image) {
    folder_.Write(name + ".png", EncodeImage(".png", image));
  }

  TemporaryFolder folder_;
  TriangulateRequest request_;
  cv::Mat texture_;
};

TEST_F(TriangulateImages, FindThePlacesOfEitherCameraInTheOther) {
  request_.at = {{"left", 160.5, 60}, {"right", 100, 50.25}};
  const Triangulation made = TriangulatePoints(request_, {});
  ASSERT_EQ(made.points.size(), 2U);
  const double z = kFocal * kPairBase / kDisparity;
  const Eigen::Vector3d expected[] = {
      {z * (160.5 - 159.5) / kFocal, z * (60 - 59.5) / kFocal, z},
      {z * (100 + kDisparity - 159.5) / kFocal, z * (50.25 - 59.5) / kFocal, z}};
  for (size_t k = 0; k < 2; ++k) {
    EXPECT_EQ(made.points[k].frame, "left");
    EXPECT_EQ(made.points[k].marker, static_cast<int>(k));
    EXPECT_EQ(made.points[k].point.observations, 2);
    EXPECT_LT((made.points[k].point.position - expected[k]).norm(), 0.02) << k;
    EXPECT_LT(std::sqrt(made.points[k].point.noise(2, 2)), 0.02);
  }
}

TEST_F(TriangulateImages, WarnOfPlacesThatLookLikeNoOther) {
  cv::Mat half = texture_(cv::Rect(kDisparity, 0, 320, 120)).clone();
  half.colRange(160, 320) = 90;
  WriteImage("right", half);
  request_.at = {{"left", 100.5, 60}, {"left", 280, 60}};
  std::vector<std::string> warnings;
  plenocal::Run run;
  run.listener.warning = [&](const std::string& line) { warnings.push_back(line); };
  const Triangulation made = TriangulatePoints(request_, run);
  EXPECT_EQ(std::ranges::count(warnings,
                               fmt::format("point 1: no place in {} is clearly like that of {}",
                                           request_.files[1].second.string(),
                                           request_.files[0].second.string())),
            1);
  ASSERT_EQ(made.points.size(), 2U);
  EXPECT_TRUE(made.points[0].used);
  EXPECT_FALSE(made.points[1].used);
}

TEST_F(TriangulateImages, HaveTheSizeOfTheirCameras) {
  request_.at = {{"up", 10, 20.5}};
  EXPECT_EQ(Refusal([&] { TriangulatePoints(request_, {}); }),
            "input: --at up:10,20.5: there is no image of that camera");
  request_.at = {{"left", 100, 60}};
  for (const cv::Rect& part : {cv::Rect(0, 0, 319, 120), cv::Rect(0, 0, 320, 119)}) {
    WriteImage("right", texture_(part).clone());
    EXPECT_EQ(Refusal([&] { TriangulatePoints(request_, {}); }),
              fmt::format("input: {}: has {} x {} pixels, the calibration of 'right' 320 x 120",
                          request_.files[1].second.string(),
                          part.width,
                          part.height));
  }
}

TEST_F(TriangulateImages, AreOfOrdinaryCameras) {
  CalibrationRecord record = ParallelCameras(1e-6);
  CalibratedCamera& camera = record.cameras[1];
  camera.model = FindModel(CameraModels(), "focused-plenoptic");
  camera.config.assign(camera.model->example_config.begin(), camera.model->example_config.end());
  camera.params.assign(camera.model->example.begin(), camera.model->example.end());
  camera.covariance = 1e-12 * Eigen::MatrixXd::Identity(9, 9);
  record.cameras[0].image_size = {320, 120};
  WriteCalibration(folder_, record);
  request_.at = {{"left", 100, 60}};
  EXPECT_THAT(Refusal([&] { TriangulatePoints(request_, {}); }),
              EndsWith("right.png: --at takes images of ordinary cameras, 'right' is plenoptic"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
