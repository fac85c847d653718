// SPDX-License-Identifier: Apache-2.0
#include <ctime>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "detectors/images/image.h"
#include "detectors/types/marker_detectors.h"
#include "tests/detectors/render_pattern.h"
#include "tests/optional_data.h"

namespace plenocal::testing {
namespace TEST_FILE {

Target Chessboard(int columns, int rows) {
  Target target;
  target.layout = ChessboardLayout{{}, columns, rows, 0.03};
  return target;
}

constexpr double kBlack = 50, kWhite = 200;

/// Inner corners at the integers from (0, 0); a white margin of one square. `first` is the colour
/// of the outer square at corner 0.
GrayFunction Board(int columns, int rows, double first = kBlack) {
  return [=](const Eigen::Vector2d& p) {
    const bool outside = p.x() < -1 || p.y() < -1 || p.x() > columns || p.y() > rows;
    if (outside) return kWhite;
    const int parity = static_cast<int>(std::floor(p.x()) + std::floor(p.y()));
    return parity % 2 == 0 ? first : kBlack + kWhite - first;
  };
}

Places Truth(int columns, int rows, const Eigen::Matrix3d& H) {
  Places places;
  int k = 0;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      places[k++] = (H * Eigen::Vector3d(column, row, 1)).hnormalized();
    }
  }
  return places;
}

TEST(ChessboardDetector, AtTheBorderABoardMayBePartOfALargerTarget) {
  const Eigen::Matrix3d H = TiltedView(30, 0.05, 70, 60);
  const auto alone = MakeMarkerDetector(Chessboard(7, 5));
  const auto among = MakeMarkerDetector(Chessboard(7, 5), {.targets = {Chessboard(9, 6)}});
  // 7 x 5 of 9 x 6 inner corners are in view.
  const cv::Mat part = Render(View(Board(9, 6), H), {270, 200}, {.blur = 0.7});
  ASSERT_EQ(alone->Detect(part).markers.size(), 35);
  EXPECT_THAT(among->Detect(part).markers, ::testing::IsEmpty());
  EXPECT_THAT(among->Detect(part).failure, ::testing::HasSubstr("another target's larger board"));
  // With its margin in view it is the small board.
  const cv::Mat whole = Render(View(Board(7, 5), H), {340, 260}, {.blur = 0.7});
  EXPECT_EQ(among->Detect(whole).markers.size(), 35);
}

TEST(ChessboardDetector, BeatsCornerSubPixAndStatesItsErrorHonestly) {
  constexpr int kColumns = 9, kRows = 6;
  const auto detector = MakeMarkerDetector(Chessboard(kColumns, kRows));
  for (const double pitch : {36.0, 14.0}) {
    Statistics ours, sub_pix;
    for (unsigned seed = 1; seed <= 6; ++seed) {
      const Eigen::Matrix3d H = TiltedView(pitch, 0.05 * seed, 70 + seed, 60);
      const cv::Mat image =
          Render(View(Board(kColumns, kRows), H),
                 {static_cast<int>(12 * pitch) + 60, static_cast<int>(9 * pitch) + 80},
                 {.blur = 0.8, .noise = 4, .seed = seed});
      const MarkerDetections found = detector->Detect(image);
      ExpectWellFormed(found);
      ASSERT_EQ(found.markers.size(), kColumns * kRows) << found.failure;
      ours.Add(found, Truth(kColumns, kRows, H));

      std::vector<cv::Point2f> corners;
      for (const auto& [marker, p] : Truth(kColumns, kRows, H)) {
        corners.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()));
      }
      cv::cornerSubPix(image, corners, {5, 5}, {-1, -1}, {3, 40, 1e-3});
      MarkerDetections others = found;
      for (Observation& o : others.markers) o.values = {corners[o.marker].x, corners[o.marker].y};
      sub_pix.Add(others, Truth(kColumns, kRows, H));
    }
    // Measured: a third of cornerSubPix's error even when that starts from the truth.
    EXPECT_LT(ours.Rms(), 0.6 * sub_pix.Rms()) << "pitch " << pitch;
    EXPECT_LT(ours.Rms(), 0.03) << "pitch " << pitch;
    // 648 coordinates: the mean of their squares scatters by 6 % of itself when sigma is right.
    EXPECT_GT(ours.Ratio(), 0.7) << "pitch " << pitch;
    EXPECT_LT(ours.Ratio(), 1.4) << "pitch " << pitch;
  }
}

TEST(ChessboardDetector, MeasuresCornersOfABoardBentByTheLens) {
  constexpr int kColumns = 8, kRows = 5;
  const auto detector = MakeMarkerDetector(Chessboard(kColumns, kRows));
  const cv::Size size(480, 360);
  const Eigen::Vector2d centre(240, 180);
  constexpr double kBarrel = 1.5e-6;  // px^-2: 10 % at 260 px from the centre
  const Eigen::Matrix3d H = TiltedView(45, 0, 60, 75);
  const GrayFunction ideal = View(Board(kColumns, kRows), H);
  const GrayFunction bent = [=](const Eigen::Vector2d& pixel) {
    const Eigen::Vector2d q = pixel - centre;
    return ideal(centre + q * (1 + kBarrel * q.squaredNorm()));
  };
  Places truth = Truth(kColumns, kRows, H);
  for (auto& [marker, p] : truth) {
    const Eigen::Vector2d undistorted = p - centre;
    Eigen::Vector2d q = undistorted;
    for (int k = 0; k < 50; ++k) q = undistorted / (1 + kBarrel * q.squaredNorm());
    p = centre + q;
  }
  const MarkerDetections found = detector->Detect(Render(bent, size, {.blur = 0.7}));
  ASSERT_EQ(found.markers.size(), kColumns * kRows) << found.failure;
  Statistics statistics;
  statistics.Add(found, truth);
  // Straight edges would miss the corners at the border by 0.02 px.
  EXPECT_LT(statistics.Rms(), 0.008);
}

TEST(ChessboardDetector, NumbersTheSameCornersWhateverTheBoardsTurn) {
  // columns + rows odd: the colours decide.
  const auto detector = MakeMarkerDetector(Chessboard(7, 4));
  for (int turn = 0; turn < 8; ++turn) {
    const Eigen::Matrix3d H = CentredView(24, turn * M_PI / 4, {3, 1.5}, {150, 150});
    const auto found = detector->Detect(Render(View(Board(7, 4), H), {300, 300}, {.blur = 0.7}));
    const Places truth = Truth(7, 4, H), places = Measured(found);
    ASSERT_EQ(places.size(), truth.size()) << found.failure;
    for (const auto& [marker, p] : truth) {
      EXPECT_LT((places.at(marker) - p).norm(), 0.1) << "turn " << turn << " corner " << marker;
    }
  }
}

TEST(ChessboardDetector, IsNeverMirroredAndBeginsAtTheTopLeftWhereColoursDoNotDecide) {
  for (const auto& [columns, rows] : {std::pair{6, 4}, {5, 7}, {5, 5}, {4, 4}}) {
    const auto detector = MakeMarkerDetector(Chessboard(columns, rows));
    for (int turn = 0; turn < 4; ++turn) {
      const Eigen::Matrix3d H =
          CentredView(26, turn * M_PI / 2, {0.5 * (columns - 1), 0.5 * (rows - 1)}, {150, 150});
      const auto found =
          detector->Detect(Render(View(Board(columns, rows), H), {300, 300}, {.blur = 0.7}));
      Places places = Measured(found);
      ASSERT_EQ(places.size(), columns * rows) << found.failure;
      const Eigen::Vector2d across = places.at(columns - 1) - places.at(0);
      const Eigen::Vector2d down = places.at((rows - 1) * columns) - places.at(0);
      EXPECT_GT(across.x() * down.y() - across.y() * down.x(), 0);
      EXPECT_LE(places.at(0).norm(), places.at(columns * rows - 1).norm() + 0.1);
      if (columns == rows && rows % 2 == 0) {
        for (const int corner : {columns - 1, (rows - 1) * columns}) {
          EXPECT_LE(places.at(0).norm(), places.at(corner).norm() + 0.1);
        }
      }
    }
  }
}

TEST(ChessboardDetector, SaysWhyNothingWasFound) {
  const auto detector = MakeMarkerDetector(Chessboard(9, 6));
  for (const cv::Mat& image : EmptyImages()) {
    const MarkerDetections found = detector->Detect(image);
    EXPECT_TRUE(found.markers.empty());
    EXPECT_FALSE(found.failure.empty());
  }
  // A board of which the last column is out of the image.
  const Eigen::Matrix3d H = TiltedView(30, 0, 60, 60);
  const MarkerDetections cut =
      detector->Detect(Render(View(Board(9, 6), H), {270, 260}, {.blur = 0.7}));
  EXPECT_TRUE(cut.markers.empty());
  EXPECT_THAT(cut.failure, ::testing::HasSubstr("only part of it is visible"));
  EXPECT_THAT(cut.failure, ::testing::HasSubstr("instead of 9 x 6"));
}

/// A view at 8 squares' distance of the board's middle, which appears at (250, 200); 36 px a
/// square.
Eigen::Matrix3d SteepView(int columns, int rows, double tilt, double turn) {
  Eigen::Matrix3d to_middle = Eigen::Matrix3d::Identity();
  to_middle.topRightCorner<2, 1>() = -0.5 * Eigen::Vector2d(columns - 1, rows - 1);
  Eigen::Matrix3d turned = Eigen::Matrix3d::Identity();
  turned.topLeftCorner<2, 2>() = Eigen::Rotation2Dd(turn).toRotationMatrix();
  Eigen::Matrix3d tilted = Eigen::Matrix3d::Identity();
  tilted(1, 1) = std::cos(tilt);
  tilted(2, 1) = std::sin(tilt) / 50;
  Eigen::Matrix3d camera = Eigen::Vector3d(36, 36, 1).asDiagonal();
  camera.topRightCorner<2, 1>() = Eigen::Vector2d(250, 200);
  return camera * tilted * turned * to_middle;
}

TEST(ChessboardDetector, FindsSteepSmallBlurredAndNoisyBoards) {
  constexpr int kColumns = 9, kRows = 6;
  const auto detector = MakeMarkerDetector(Chessboard(kColumns, kRows));
  const auto expect_found =
      [&](const Eigen::Matrix3d& H, const RenderOptions& options, double rms, const char* what) {
        const MarkerDetections found =
            detector->Detect(Render(View(Board(kColumns, kRows), H), {500, 400}, options));
        ASSERT_EQ(found.markers.size(), kColumns * kRows) << what << ": " << found.failure;
        Statistics statistics;
        statistics.Add(found, Truth(kColumns, kRows, H));
        EXPECT_LT(statistics.Rms(), rms) << what;
      };
  // OpenCV's finders lose the boards that are steep and turned, and those with small squares.
  expect_found(SteepView(kColumns, kRows, 1.3, 0), {.blur = 0.8, .noise = 3}, 0.1, "steep");
  expect_found(SteepView(kColumns, kRows, 1.3, 0.4), {.blur = 0.8, .noise = 3}, 0.1, "turned");
  expect_found(TiltedView(7, 0.3, 100, 100), {.blur = 0.8, .noise = 3}, 0.1, "small");
  expect_found(TiltedView(24, 0.3, 150, 80), {.blur = 6, .noise = 3}, 0.3, "blurred");
  expect_found(TiltedView(24, 0.3, 150, 80), {.blur = 0.8, .noise = 30}, 0.2, "noisy");
}

TEST(ChessboardDetector, FindsABoardSomeOfWhoseCornersAreHidden) {
  const Eigen::Matrix3d H = TiltedView(30, 0.1, 80, 60);
  cv::Mat image = Render(View(Board(9, 6), H), {420, 320}, {.blur = 0.7});
  const Places truth = Truth(9, 6, H);
  for (const int hidden : {0, 30}) {
    const auto x = static_cast<int>(truth.at(hidden).x()),
               y = static_cast<int>(truth.at(hidden).y());
    image(cv::Rect(x - 12, y - 12, 25, 25)) = 120;
  }
  const MarkerDetections found = MakeMarkerDetector(Chessboard(9, 6))->Detect(image);
  ASSERT_EQ(found.markers.size(), 52) << found.failure;
  EXPECT_THAT(found.left_out,
              ::testing::ElementsAre(::testing::StartsWith("corner 0: "),
                                     ::testing::StartsWith("corner 30: ")));
  Statistics statistics;
  statistics.Add(found, truth);
  EXPECT_LT(statistics.Rms(), 0.02);
}

TEST(ChessboardDetector, ResultsOnHardImagesAreTheSameAsBefore) {
  constexpr int kColumns = 9, kRows = 6;
  const GrayFunction board = View(Board(kColumns, kRows), TiltedView(30, 0.1, 90, 60));
  const GrayFunction bent = [&](const Eigen::Vector2d& pixel) {
    const Eigen::Vector2d q = pixel - Eigen::Vector2d(250, 200);
    return board(pixel + 1.5e-6 * q.squaredNorm() * q);
  };
  const auto view = [&](const Eigen::Matrix3d& H, RenderOptions options) {
    options.supersampling = 4;
    return Render(View(Board(kColumns, kRows), H), {500, 400}, options);
  };
  cv::Mat partly_hidden = view(TiltedView(30, 0.1, 90, 60), {.blur = 1, .noise = 6});
  partly_hidden(cv::Rect(80, 50, 40, 30)) = 120;
  partly_hidden(cv::Rect(200, 120, 22, 19)) = 70;
  const GrayFunction beside_another = [&](const Eigen::Vector2d& p) {
    return p.x() < 9.5 ? Board(9, 6)(p) : Board(7, 5)(p - Eigen::Vector2d(11, 0.5));
  };
  ExpectDigests(
      *MakeMarkerDetector(Chessboard(kColumns, kRows)),
      {view(SteepView(kColumns, kRows, 1.35, 0.4), {.blur = 0.8, .noise = 3}),
       view(SteepView(kColumns, kRows, 1.4, 0), {.blur = 0.7, .noise = 2}),
       view(TiltedView(6, 0.3, 100, 100), {.blur = 0.8, .noise = 3}),
       view(TiltedView(5.3, -0.2, 100, 100), {.blur = 0.6, .noise = 2}),
       view(TiltedView(24, 0.3, 150, 80), {.blur = 6, .noise = 3}),
       view(TiltedView(24, 0.3, 150, 80), {.blur = 8, .noise = 2}),
       view(TiltedView(24, 0.3, 150, 80), {.blur = 0.8, .noise = 35}),
       view(TiltedView(24, 0.3, 150, 80), {.blur = 0.8, .noise = 46}),
       partly_hidden,
       UnevenlyLit(Render(bent, {500, 400}, {.blur = 0.6, .noise = 3}), 0.2),
       0.1 * view(TiltedView(26, -0.2, 90, 140), {.blur = 0.9, .noise = 2}) + 60,
       Render(View(beside_another, TiltedView(22, 0.1, 60, 50)), {500, 260}, {.blur = 0.7}),
       Render(View(Board(kColumns, kRows), TiltedView(110, 0.05, 240, 150)),
              {1500, 1000},
              {.blur = 2, .noise = 5, .supersampling = 2})},
      {-11539.6765,
       -11999.6888,
       -6417.0204,
       -4508.1117,
       -9427.0355,
       -8905.9714,
       -9475.2551,
       -9343.9424,
       -8441.6186,
       -8850.7716,
       -10456.7076,
       -6516.0836,
       -28298.5624});
}

TEST(ChessboardDetector, TakesNoLongOverImagesWithoutABoard) {
  const auto detector = MakeMarkerDetector(Chessboard(9, 6));
  cv::RNG random(7);
  for (const double correlation : {0.0, 1.0, 3.0}) {  // px
    cv::Mat texture(1000, 1000, CV_32F), image;
    random.fill(texture, cv::RNG::NORMAL, 0, 1);
    if (correlation > 0) cv::GaussianBlur(texture, texture, {}, correlation);
    cv::normalize(texture, image, 0, 255, cv::NORM_MINMAX, CV_8U);
    const std::clock_t start = std::clock();
    EXPECT_TRUE(detector->Detect(image).markers.empty());
    // Measured: 0.04 to 0.1 s; OpenCV's finders take 2 to 200 s. Wide for slow machines and
    // sanitizers.
    constexpr double kMaxSeconds = 2;
    EXPECT_LT(static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC, kMaxSeconds)
        << correlation;
  }
}

struct RealSet {
  std::string folder, prefix, extension;
  int columns, rows;
  std::size_t images;   // in the set
  std::size_t corners;  // at least, of images * columns * rows
};

class ChessboardRealSet : public ::testing::TestWithParam<RealSet> {};

TEST_P(ChessboardRealSet, IsFoundInEveryImage) {
  const RealSet& set = GetParam();
  const auto files = OptionalFiles(set.folder, set.prefix, set.extension);
  if (files.empty()) GTEST_SKIP() << Absent(OptionalData("frames/" + set.folder));
  EXPECT_EQ(files.size(), set.images);
  const auto detector = MakeMarkerDetector(Chessboard(set.columns, set.rows));
  std::size_t corners = 0;
  for (const auto& file : files) {
    const MarkerDetections found = detector->Detect(ReadGray(file));
    ExpectWellFormed(found);
    EXPECT_TRUE(found.failure.empty()) << file << ": " << found.failure;
    EXPECT_EQ(found.markers.size() + found.left_out.size(), set.columns * set.rows) << file;
    corners += found.markers.size();
  }
  EXPECT_GE(corners, set.corners);
}

// The classic finder of OpenCV 4.6 finds 13 + 13, 10 + 10, 16 + 16, 12, 15, 12 of 16, and SB fewer.
INSTANTIATE_TEST_SUITE_P(
    Shared,
    ChessboardRealSet,
    ::testing::Values(
        RealSet{"stereo_chess_opencv", "left", ".jpg", 9, 6, 13, 13 * 54},
        RealSet{"stereo_chess_opencv", "right", ".jpg", 9, 6, 13, 13 * 54},
        RealSet{"stereo_chess_anamorphic_drobotics", "left_", ".png", 11, 8, 10, 10 * 88},
        RealSet{"stereo_chess_anamorphic_drobotics", "right_", ".png", 11, 8, 10, 10 * 88},
        RealSet{"stereo_fisheye_ros", "left-", ".png", 8, 6, 16, 16 * 48},
        RealSet{"stereo_fisheye_ros", "right-", ".png", 8, 6, 16, 16 * 48},
        RealSet{"mono_fisheye_camodocal", "img", ".png", 9, 6, 12, 12 * 54},
        RealSet{"mono_fisheye_ocamcalib/fisheye1", "Fisheye1", ".jpg", 8, 6, 15, 15 * 48 - 2},
        RealSet{"mono_fisheye_ocamcalib/fisheye2", "Fisheye2", ".jpg", 8, 6, 16, 16 * 48},
        RealSet{"chess_corners_gt_opencv_extra", "m-0", ".png", 4, 5, 17, 17 * 20},
        RealSet{"handeye_visp/data-eye-in-hand", "franka_image", ".png", 9, 6, 8, 8 * 54}),
    [](const auto& test) {
      std::string name = test.param.folder + "_" + test.param.prefix;
      for (char& c : name) {
        if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '_';
      }
      return name;
    });

TEST(ChessboardDetector, AgreesWithOpenCvsExpectedCorners) {
  const auto files = OptionalFiles("chess_corners_gt_opencv_extra", "chess_corners", ".dat");
  if (files.empty()) GTEST_SKIP() << Absent(OptionalData("frames/chess_corners_gt_opencv_extra"));
  for (const auto& file : files) {
    cv::Mat expected;
    cv::FileStorage(file.string(), cv::FileStorage::READ)["corners"] >> expected;
    std::string name = file.stem().string();
    name.erase(name.find("_corners"), std::string("_corners").size());
    const auto found = MakeMarkerDetector(Chessboard(expected.cols, expected.rows))
                           ->Detect(ReadGray(file.parent_path() / (name + ".png")));
    ASSERT_EQ(found.markers.size(), expected.total()) << file << found.failure;
    // In whatever order: the files begin at other corners than we do.
    for (const Observation& o : found.markers) {
      double nearest = std::numeric_limits<double>::max();
      for (const cv::Point2f& p : cv::Mat_<cv::Point2f>(expected)) {
        nearest = std::min(nearest, std::hypot(o.values[0] - p.x, o.values[1] - p.y));
      }
      EXPECT_LT(nearest, 1.5) << file << " corner " << o.marker;
    }
  }
}

TEST(ChessboardDetector, NumbersBothCamerasOfARigAlike) {
  const auto left = OptionalFiles("stereo_chess_opencv", "left", ".jpg");
  const auto right = OptionalFiles("stereo_chess_opencv", "right", ".jpg");
  if (left.empty()) GTEST_SKIP() << Absent(OptionalData("frames/stereo_chess_opencv"));
  const auto detector = MakeMarkerDetector(Chessboard(9, 6));
  for (std::size_t i = 0; i < left.size(); ++i) {
    const Places a = Measured(detector->Detect(ReadGray(left[i])));
    const Places b = Measured(detector->Detect(ReadGray(right[i])));
    ASSERT_TRUE(a.contains(0) && a.contains(53) && b.contains(0) && b.contains(53));
    // The cameras are side by side: the board has nearly the same direction in both.
    const Eigen::Vector2d along_a = (a.at(53) - a.at(0)).normalized();
    const Eigen::Vector2d along_b = (b.at(53) - b.at(0)).normalized();
    EXPECT_GT(along_a.dot(along_b), 0.9) << left[i];
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
