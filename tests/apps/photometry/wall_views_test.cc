// SPDX-License-Identifier: Apache-2.0
//
// Poses and light of pictures of a wall with a chessboard, and a recording of too few of them.
#include "apps/photometry/wall_views.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "apps/photometry/recorded_vignette.h"
#include "calib/base/error.h"
#include "calib/base/run.h"
#include "detectors/images/image.h"
#include "models/registry.h"
#include "tests/apps/workspace.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;

constexpr double kSquare = 0.1;

class WallViews : public Workspace {
 protected:
  // `scale`: of an image of 260 x 180 px.
  explicit WallViews(int scale = 1, const std::string& board = "5x4")
      : columns_(board[0] - '0'),
        rows_(board[2] - '0'),
        target_(TargetOfWord("chessboard:" + board + ":100mm")) {
    camera_.name = images_.name = "left";
    camera_.model = FindModel(CameraModels(), "pinhole-radial3");
    camera_.image_size = images_.image_size = {260 * scale, 180 * scale};
    camera_.covariance = Eigen::MatrixXd::Zero(7, 7);
    const double f = 240.0 * scale;
    camera_.params = {f, f, 130.0 * scale - 0.5, 90.0 * scale - 0.5, 0, 0, 0};
    recording_.path = "recording.yaml";
    ResponseCurve::Table table;
    for (size_t k = 0; k < 256; ++k) table[k] = static_cast<double>(k * k) / 255;
    options_ = {.recording = &recording_,
                .images = &images_,
                .camera = &camera_,
                .response = ResponseCurve(table),
                .target = &target_,
                .threads = 1,
                .progress = [&](size_t done, size_t total) {
                  steps_.push_back(fmt::format("{}/{}", done, total));
                  return true;
                }};
  }
  // Squares of 16 texels, with a white margin of a square around.
  [[nodiscard]] cv::Mat Picture(const RigidTransform& T) const {
    constexpr int kTexels = 16;
    cv::Mat board((rows_ + 3) * kTexels, (columns_ + 3) * kTexels, CV_8U, cv::Scalar(150));
    for (int row = 1; row < rows_ + 2; ++row) {
      for (int column = row % 2 == 0 ? 2 : 1; column < columns_ + 2; column += 2)
        board(cv::Rect(column * kTexels, row * kTexels, kTexels, kTexels)).setTo(40);
    }
    const double texel = kSquare / kTexels, first = texel / 2 - 2 * kSquare;
    const auto& p = camera_.params;
    const cv::Matx33d K(p[0], 0, p[2], 0, p[1], p[3], 0, 0, 1),
        place(texel, 0, first, 0, texel, first, 0, 0, 1);
    const Eigen::Matrix3d& R = T.R;
    const cv::Matx33d pose(
        R(0, 0), R(0, 1), T.t[0], R(1, 0), R(1, 1), T.t[1], R(2, 0), R(2, 1), T.t[2]);
    cv::Mat image;
    cv::warpPerspective(board,
                        image,
                        K * pose * place,
                        {camera_.image_size[0], camera_.image_size[1]},
                        cv::INTER_LINEAR,
                        cv::BORDER_CONSTANT,
                        cv::Scalar(150));
    cv::GaussianBlur(image, image, {5, 5}, 0.8);
    return image;
  }
  [[nodiscard]] RigidTransform Pose(int i) const {
    const double angle = 0.9 * i;
    RigidTransform T{ExpRotation({0.3 * std::cos(angle), 0.3 * std::sin(angle), 0.1 * (i % 3)}),
                     {}};
    T.t = Eigen::Vector3d(0.05 * std::sin(i), 0.04 * std::cos(2 * i), 1) -
          T.R * Eigen::Vector3d((columns_ - 1) * kSquare / 2, (rows_ - 1) * kSquare / 2, 0);
    return T;
  }
  void Add(const std::string& frame, const cv::Mat& image, std::optional<double> exposure) {
    Write(frame + ".png", EncodeImage(".png", image));
    RecordedImage recorded;
    recorded.frame = frame;
    recorded.path = Path(frame + ".png");
    recorded.exposure = exposure;
    images_.images.push_back(recorded);
  }
  std::string Refusal(ErrorKind kind) {
    return RefusalOf([&] { ReadWall(options_); }, kind);
  }

  int columns_, rows_;
  Target target_;
  CalibratedCamera camera_;
  RecordedCamera images_;
  Recording recording_;
  WallOptions options_;
  std::vector<std::string> steps_;
};

class LargeWallViews : public WallViews {
 protected:
  LargeWallViews() : WallViews(2) {}
};

TEST_F(LargeWallViews, HavePosesAndTheLightOfBlocks) {
  cv::Mat marked = Picture(Pose(0));
  // Full pixels and a dark part, where no block of the board is.
  marked.at<std::uint8_t>(8, 11) = marked.at<std::uint8_t>(340, 505) = 255;
  marked.at<std::uint8_t>(20, 480) = 254;
  marked(cv::Rect(200, 2, 8, 4)).setTo(5);
  marked(cv::Rect(208, 2, 8, 4)).setTo(6);
  Add("f0", marked, 2);
  for (int i = 1; i < 10; ++i) Add(fmt::format("f{}", i), Picture(Pose(i)), 2 + 0.1 * i);
  cv::Mat full(360, 520, CV_8U, cv::Scalar(150));
  full(cv::Rect(0, 0, 520, 108)).setTo(255);  // 30 %
  Add("no", full, 3);
  full(cv::Rect(0, 0, 520, 112)).setTo(255);
  Add("full", full, 3);
  Add("deep", cv::Mat(360, 520, CV_16U, cv::Scalar(150)), 3);
  recording_.left_out = {{.where = "other", .reason = "", .camera = "right"},
                         {.where = "torn.png", .reason = "torn", .camera = "left"}};
  const WallRecording wall = ReadWall(options_);
  EXPECT_EQ(steps_.size(), 13u);
  EXPECT_EQ(steps_[0] + steps_[12], "1/1313/13");
  EXPECT_EQ(wall.camera, &camera_);
  EXPECT_EQ(wall.response.Values(), options_.response.Values());
  EXPECT_EQ(wall.reduction, 2);
  EXPECT_TRUE(wall.exposures_known);
  const double rim = 0.3 * 0.4;
  for (const auto& [found, expected] : {std::pair{wall.marker[0], -rim},
                                        {wall.marker[1], -rim},
                                        {wall.marker[2], 0.4 + rim},
                                        {wall.marker[3], 0.3 + rim}})
    EXPECT_NEAR(found, expected, 1e-12);
  ASSERT_EQ(wall.left_out.size(), 4u);
  const auto text = [](const LeftOut& item) {
    return fmt::format("{} {} {}", item.camera, item.frame, item.whole);
  };
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(wall.left_out[i].where, images_.images[10 + i].path.string());
    EXPECT_EQ(text(wall.left_out[i]), fmt::format("left {} true", images_.images[10 + i].frame));
  }
  EXPECT_THAT(wall.left_out[0].reason, ::testing::HasSubstr("chessboard"));
  EXPECT_EQ(wall.left_out[1].reason, "31 % of its pixels are saturated: expose it shorter");
  EXPECT_THAT(wall.left_out[2].reason,
              ::testing::HasSubstr("has 16 bits; a response holds 256 values"));
  EXPECT_EQ(wall.left_out[3].where, "torn.png");
  ASSERT_EQ(wall.views.size(), 10u);
  for (int i = 0; i < 10; ++i) {
    const WallView& view = wall.views[static_cast<size_t>(i)];
    EXPECT_EQ(view.frame, fmt::format("f{}", i));
    EXPECT_EQ(view.exposure, 2 + 0.1 * i);
    EXPECT_LT((view.T_camera_wall.t - Pose(i).t).norm(), 3e-3);
    EXPECT_LT((view.T_camera_wall.R - Pose(i).R).norm(), 5e-3);
    EXPECT_EQ(view.light.size(), cv::Size(260, 180));
    EXPECT_EQ(view.brightness.size(), cv::Size(260, 180));
  }
  // Blocks of 2 x 2 px; none has brightness with a pixel that is full or two beside one.
  const WallView& view = wall.views[0];
  int unknown = 0;
  for (int y = 0; y < 180; ++y) {
    for (int x = 0; x < 260; ++x) {
      double light = 0;
      bool full_near = false;
      for (int k = 0; k < 4; ++k) {
        const int px = 2 * x + k % 2, py = 2 * y + k / 2;
        light += std::pow(marked.at<std::uint8_t>(py, px), 2) / 255 / 4;
        full_near |= std::abs(px - 11) <= 2 && std::abs(py - 8) <= 2;
        full_near |= std::abs(px - 505) <= 2 && std::abs(py - 340) <= 2;
      }
      ASSERT_NEAR(view.light.at<float>(y, x), light, 1e-4);
      const float found = view.brightness.at<float>(y, x);
      if (full_near || light <= 25.0 / 255 + 1e-9) {
        ASSERT_TRUE(std::isnan(found)) << x << ' ' << y;
        ++unknown;
      } else {
        ASSERT_NEAR(found, std::log(light / 2), 1e-5) << x << ' ' << y;
      }
    }
  }
  EXPECT_EQ(unknown, 9 + 9 + 8);
}

class HighWallViews : public WallViews {
 protected:
  HighWallViews() : WallViews(1, "4x5") {}
};

TEST_F(HighWallViews, MustShowTheMarkerInTenImages) {
  for (int i = 0; i < 9; ++i) Add(fmt::format("f{}", i), Picture(Pose(i)), 2);
  Add("no", cv::Mat(180, 260, CV_8U, cv::Scalar(150)), 3);
  EXPECT_THAT(
      Refusal(ErrorKind::kJob),
      ::testing::MatchesRegex(
          "recording.yaml: camera left: the marker was found in 9 of 10 images \\(first failure: .*chessboard.*\\); the "
          "wall must show the target of --target in every image, sharp and whole: at least 10 images"));
  // Markers beside the origin.
  for (auto& [number, position] : target_.markers) position += Eigen::Vector3d(0.5, -0.3, 0);
  images_.images.back() = images_.images[3];
  images_.images[4].exposure.reset();
  const WallRecording wall = ReadWall(options_);
  EXPECT_EQ(wall.reduction, 1);
  EXPECT_FALSE(wall.exposures_known);
  const std::array<double, 4> area{0.5 - 0.12, -0.3 - 0.12, 0.8 + 0.12, 0.1 + 0.12};
  for (size_t i = 0; i < 4; ++i) EXPECT_NEAR(wall.marker[i], area[i], 1e-12);
  ASSERT_EQ(wall.views.size(), 10u);
  for (const WallView& view : wall.views) EXPECT_EQ(view.exposure, 1);
  EXPECT_TRUE(wall.left_out.empty());
  EXPECT_NEAR(wall.views[2].brightness.at<float>(0, 0), std::log(150.0 * 150 / 255), 1e-5);
  options_.progress = [](size_t, size_t) { return false; };
  EXPECT_THROW(ReadWall(options_), Stopped);
}

TEST_F(WallViews, AreRefusedForAnotherSizeOrATargetThatIsNotFlat) {
  const std::string none =
      "recording.yaml: camera left: the marker was found in 0 of 0 images; the wall must show the target of --target in "
      "every image, sharp and whole: at least 10 images";
  EXPECT_EQ(Refusal(ErrorKind::kJob), none);
  // One in a hundred of the farthest marker's distance from the origin: 0.5 m.
  target_.markers.begin()->second.z() = -0.00499;
  EXPECT_EQ(Refusal(ErrorKind::kJob), none);
  target_.markers.begin()->second.z() = -0.00501;
  EXPECT_EQ(
      Refusal(ErrorKind::kInput),
      "the target's markers are up to 0.00501 m off its plane z = 0; a wall is flat: give a target.yaml with the "
      "markers that hang on it");
  camera_.image_size = {260, 181};
  EXPECT_EQ(
      Refusal(ErrorKind::kInput),
      "recording.yaml: images of camera left are 260 x 180 pixels, but the calibration is of 260 x 181");
  // A target whose markers are hardly known gives no pose.
  camera_.image_size = {260, 180};
  target_.markers.begin()->second.z() = 0;
  while (target_.markers.size() > 3) target_.markers.erase(std::prev(target_.markers.end()));
  Add("f", Picture(Pose(0)), 2);
  EXPECT_THAT(Refusal(ErrorKind::kJob),
              ::testing::HasSubstr(
                  "found in 0 of 1 image (first failure: the marker gives no pose); the wall"));
}

class VignetteOfARecording : public WallViews {
 protected:
  VignetteOfARecording() {
    std::filesystem::create_directory(Path("left"));
    for (int i = 0; i < 2; ++i) Add(fmt::format("left/f{}", i), Picture(Pose(i)), {});
    Write("target.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 5\nrows: 4\nsquare: 0.1\n");
    Write("calibration.yaml",
          "plenocal: 1\ncameras:\n  left:\n    model: pinhole-radial3\n    image_size: [260, 180]\n"
          "    parameters: {f_x: 240, f_y: 240, c_x: 129.5, c_y: 89.5, A_0: 0, A_1: 0, A_2: 0}\n"
          "    T_camera_rig: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n");
    Write("recording.yaml", "plenocal: 1\ncameras: {left: {images: left}}\n");
    request_ = {.recording = Path("recording.yaml"),
                .camera = {},
                .calibration = Path("calibration.yaml"),
                .response = {},
                .target = Path("target.yaml"),
                .white = {},
                .out = Path("out")};
    run_.threads = 1;
    run_.listener.progress = [&](const std::string& stage, size_t done, size_t total) {
      steps_.push_back(fmt::format("{} {}/{}", stage, done, total));
    };
  }
  std::string RefusalOfRun(ErrorKind kind) {
    return RefusalOf([&] { MeasureVignette(request_, run_); }, kind);
  }

  VignetteRequest request_;
  ::plenocal::Run run_;
};

TEST_F(VignetteOfARecording, NeedsTenImagesOfTheMarker) {
  const std::string path = Path("recording.yaml").string();
  EXPECT_EQ(
      RefusalOfRun(ErrorKind::kJob),
      path +
          ": camera left: the marker was found in 2 of 2 images; the wall must show the target of --target in every "
          "image, sharp and whole: at least 10 images");
  EXPECT_THAT(steps_, ElementsAre("read " + path + " 0/0", "left: images 1/2", "left: images 2/2"));
  EXPECT_FALSE(std::filesystem::exists(Path("out")));
  request_.camera = "right";
  EXPECT_EQ(RefusalOfRun(ErrorKind::kInput), path + ": has no camera 'right'; known: left");
  request_.camera = "left";
  request_.response = Path("none.txt");
  EXPECT_THAT(RefusalOfRun(ErrorKind::kInput), ::testing::HasSubstr("none.txt"));
  request_.target = Path("none.yaml");
  EXPECT_THAT(RefusalOfRun(ErrorKind::kInput), ::testing::HasSubstr("none.yaml"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
