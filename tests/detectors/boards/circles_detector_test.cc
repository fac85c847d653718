// SPDX-License-Identifier: Apache-2.0
#include <opencv2/core.hpp>
#include <opencv2/core/persistence.hpp>

#include "detectors/images/image.h"
#include "detectors/types/marker_detectors.h"
#include "tests/detectors/render_pattern.h"
#include "tests/optional_data.h"

namespace plenocal::testing {
namespace TEST_FILE {

Target Circles(int columns, int rows, bool asymmetric) {
  Target target;
  target.layout = CirclesLayout{{}, columns, rows, 0.03, asymmetric};
  return target;
}

constexpr double kRadius = 0.28;  // of the spacing

/// In units of the spacing; an asymmetric grid's circles are two apart in a row, and every other
/// row is offset by one.
Eigen::Vector2d Centre(int column, int row, bool asymmetric) {
  return {asymmetric ? 2.0 * column + row % 2 : column, row};
}

GrayFunction Board(int columns, int rows, bool asymmetric, bool white_circles = false) {
  const double radius = asymmetric ? 1.4 * kRadius : kRadius;
  return [=](const Eigen::Vector2d& p) {
    bool inside = false;
    const int row = static_cast<int>(std::lround(p.y()));
    for (int r = std::max(0, row - 1); r <= std::min(rows - 1, row + 1); ++r) {
      for (int c = 0; c < columns; ++c) {
        inside = inside || (p - Centre(c, r, asymmetric)).norm() < radius;
      }
    }
    return inside == white_circles ? 200.0 : 50.0;
  };
}

Places Truth(int columns, int rows, bool asymmetric, const Eigen::Matrix3d& H) {
  Places places;
  for (int k = 0; k < columns * rows; ++k) {
    places[k] = (H * Centre(k % columns, k / columns, asymmetric).homogeneous()).hnormalized();
  }
  return places;
}

TEST(CirclesDetector, MeasuresEllipsesAndStatesItsErrorHonestly) {
  constexpr int kColumns = 8, kRows = 6;
  const auto detector = MakeMarkerDetector(Circles(kColumns, kRows, false));
  for (const double pitch : {30.0, 16.0}) {
    Statistics statistics;
    for (unsigned seed = 1; seed <= 6; ++seed) {
      const Eigen::Matrix3d H = TiltedView(pitch, 0.04 * seed, 70, 60);
      const cv::Mat image =
          Render(View(Board(kColumns, kRows, false), H),
                 {static_cast<int>(10 * pitch) + 60, static_cast<int>(8 * pitch) + 80},
                 {.blur = 0.8, .noise = 4, .seed = seed});
      const MarkerDetections found = detector->Detect(image);
      ExpectWellFormed(found);
      ASSERT_EQ(found.markers.size(), kColumns * kRows) << found.failure;
      statistics.Add(found, Truth(kColumns, kRows, false, H));
    }
    // Noise of 4 against a contrast of 150 on a circumference of 28 px and more.
    EXPECT_LT(statistics.Rms(), 0.03) << "pitch " << pitch;
    // 576 coordinates: the mean of their squares scatters by 6 % of itself when sigma is right.
    EXPECT_GT(statistics.Ratio(), 0.7) << "pitch " << pitch;
    EXPECT_LT(statistics.Ratio(), 1.4) << "pitch " << pitch;
  }
}

// The image of a centre is not that of its ellipse where distances within a circle are distorted.
TEST(CirclesDetector, MeasuresTheImagesOfCentresThroughADistortingLens) {
  constexpr int kColumns = 8, kRows = 6;
  const Eigen::Vector2d axis(200, 160);
  const auto undistorted = [&](const Eigen::Vector2d& p) -> Eigen::Vector2d {
    return p + 2e-6 * (p - axis).squaredNorm() * (p - axis);
  };
  Statistics statistics;
  for (unsigned seed = 1; seed <= 3; ++seed) {
    const Eigen::Matrix3d H = TiltedView(40.0, 0.06 * seed, 60, 50);
    const GrayFunction plane = View(Board(kColumns, kRows, false), H);
    const cv::Mat image = Render([&](const Eigen::Vector2d& p) { return plane(undistorted(p)); },
                                 {400, 320},
                                 {.blur = 0.8, .noise = 2, .seed = seed});
    const MarkerDetections found =
        MakeMarkerDetector(Circles(kColumns, kRows, false))->Detect(image);
    ASSERT_EQ(found.markers.size(), kColumns * kRows) << found.failure;
    Places truth = Truth(kColumns, kRows, false, H);
    for (auto& [marker, place] : truth) {
      Eigen::Vector2d p = place;
      for (int i = 0; i < 50; ++i) p += place - undistorted(p);
      place = p;
    }
    statistics.Add(found, truth);
  }
  EXPECT_LT(statistics.Rms(), 0.01);
  EXPECT_LT(statistics.Ratio(), 1.3);
}

TEST(CirclesDetector, APartOfALargerTargetIsNoTarget) {
  const OtherTargets others{.targets = {Circles(9, 6, false)}};
  const auto detector = MakeMarkerDetector(Circles(7, 5, false), others);
  const GrayFunction board = Board(9, 6, false);
  // The whole larger grid, and all of it but one row and two columns, which are outside.
  const Eigen::Matrix3d whole = TiltedView(30, 0.1, 60, 50), cut = TiltedView(30, 0, 13, 50);
  for (const auto& [H, size] : {std::pair(whole, cv::Size(400, 320)), {cut, cv::Size(210, 193)}}) {
    const cv::Mat image = Render(View(board, H), size, {.blur = 0.7});
    EXPECT_THAT(detector->Detect(image).markers, ::testing::IsEmpty());
  }
  // Both side by side.
  const GrayFunction both = [&](const Eigen::Vector2d& p) {
    return p.x() < 9.5 ? board(p) : Board(7, 5, false)(p - Eigen::Vector2d(11, 0.5));
  };
  const cv::Mat image = Render(View(both, TiltedView(30, 0.1, 60, 50)), {680, 320}, {.blur = 0.7});
  EXPECT_EQ(detector->Detect(image).markers.size(), 35);
  EXPECT_EQ(MakeMarkerDetector(Circles(9, 6, false))->Detect(image).markers.size(), 54);
}

// All within the image, so that only the circles beside it show that a grid goes on.
TEST(CirclesDetector, APartOfALargerTargetWithAHiddenCircleIsNoTarget) {
  const OtherTargets others{.targets = {Circles(9, 6, false)}};
  const auto detector = MakeMarkerDetector(Circles(7, 5, false), others);
  const Eigen::Matrix3d H = TiltedView(30, 0.1, 100, 90);
  const GrayFunction larger = [](const Eigen::Vector2d& p) {
    return p.norm() < 0.5 ? 200 : Board(9, 6, false)(p);
  };
  EXPECT_THAT(detector->Detect(Render(View(larger, H), {480, 400}, {.blur = 0.7})).markers,
              ::testing::IsEmpty());
  const cv::Mat own = Render(View(Board(7, 5, false), H), {480, 400}, {.blur = 0.7});
  EXPECT_EQ(detector->Detect(own).markers.size(), 35);
}

TEST(CirclesDetector, FindsWhiteCirclesOnBlack) {
  const Eigen::Matrix3d H = TiltedView(28, 0.1, 60, 50);
  const auto found =
      MakeMarkerDetector(Circles(7, 5, false))
          ->Detect(Render(View(Board(7, 5, false, true), H), {300, 240}, {.blur = 0.7}));
  ASSERT_EQ(found.markers.size(), 35) << found.failure;
  Statistics statistics;
  statistics.Add(found, Truth(7, 5, false, H));
  EXPECT_LT(statistics.Rms(), 0.01);
}

TEST(CirclesDetector, ResultsOnHardImagesAreTheSameAsBefore) {
  constexpr int kColumns = 8, kRows = 6;
  const auto view = [&](const Eigen::Matrix3d& H, RenderOptions options) {
    options.supersampling = 4;
    return Render(View(Board(kColumns, kRows, false), H), {400, 320}, options);
  };
  const GrayFunction board = View(Board(kColumns, kRows, false), TiltedView(40, 0.06, 60, 50));
  const GrayFunction bent = [&](const Eigen::Vector2d& pixel) {
    const Eigen::Vector2d q = pixel - Eigen::Vector2d(200, 160);
    return board(pixel + 2e-6 * q.squaredNorm() * q);
  };
  cv::Mat partly_hidden = view(TiltedView(34, 0.1, 90, 40), {.blur = 1, .noise = 6});
  partly_hidden(cv::Rect(190, 100, 9, 12)) = 120;
  Eigen::Matrix3d steep = TiltedView(34, 0.1, 60, 100);
  steep.row(1) *= 0.35;
  ExpectDigests(*MakeMarkerDetector(Circles(kColumns, kRows, false)),
                {view(TiltedView(7, 0.3, 100, 100), {.blur = 0.7, .noise = 3}),
                 view(TiltedView(5, -0.2, 100, 100), {.blur = 0.5, .noise = 2}),
                 view(TiltedView(30, 0.2, 110, 60), {.blur = 5, .noise = 3}),
                 view(TiltedView(30, 0.2, 110, 60), {.blur = 6.5, .noise = 2}),
                 view(TiltedView(30, 0.2, 110, 60), {.blur = 0.8, .noise = 40}),
                 view(steep, {.blur = 0.8, .noise = 3}),
                 partly_hidden,
                 UnevenlyLit(Render(bent, {400, 320}, {.blur = 0.6, .noise = 3}), 0.3),
                 0.15 * view(TiltedView(30, -0.2, 60, 70), {.blur = 0.9, .noise = 2}) + 60,
                 Render(View(Board(kColumns, kRows, false), TiltedView(90, 0.05, 140, 100)),
                        {1000, 800},
                        {.blur = 2, .noise = 5, .supersampling = 2})},
                {-5382.9232,
                 -4837.3196,
                 -7225.5552,
                 -7072.4793,
                 -7009.0123,
                 -3893.5316,
                 -6755.2774,
                 -7569.5020,
                 -6105.5331,
                 -16983.8890});
  ExpectDigests(*MakeMarkerDetector(Circles(4, 9, true)),
                {Render(View(Board(4, 9, true, true), TiltedView(22, 0.4, 120, 40)),
                        {340, 340},
                        {.blur = 1.5, .noise = 8}),
                 Render(View(Board(4, 9, true), TiltedView(8, 1.9, 120, 60)),
                        {200, 200},
                        {.blur = 0.7, .noise = 3})},
                {-4141.2219, -1941.1712});
}

TEST(CirclesDetector, NumbersAsymmetricGridsByTheirOffsetRows) {
  for (const int rows : {11, 10}) {
    const auto detector = MakeMarkerDetector(Circles(4, rows, true));
    for (int turn = 0; turn < 4; ++turn) {
      const Eigen::Matrix3d H =
          CentredView(20, turn * M_PI / 2 + 0.1, {3.5, 0.5 * (rows - 1)}, {160, 160});
      const auto found =
          detector->Detect(Render(View(Board(4, rows, true), H), {320, 320}, {.blur = 0.7}));
      Places truth = Truth(4, rows, true, H);
      const Places places = Measured(found);
      ASSERT_EQ(places.size(), truth.size()) << found.failure;
      const int last = 4 * rows - 1;
      // Even rows: the grid looks the same from its other end.
      if (rows % 2 == 0 && truth.at(last).norm() < truth.at(0).norm()) {
        Places turned;
        for (const auto& [marker, p] : truth) turned[last - marker] = p;
        truth = turned;
      }
      for (const auto& [marker, p] : truth) {
        EXPECT_LT((places.at(marker) - p).norm(), 0.1) << rows << " rows, turn " << turn;
      }
    }
  }
}

TEST(CirclesDetector, IsNeverMirroredAndBeginsAtTheTopLeft) {
  for (const auto& [columns, rows] : {std::pair{7, 4}, {5, 5}}) {
    const auto detector = MakeMarkerDetector(Circles(columns, rows, false));
    for (int turn = 0; turn < 4; ++turn) {
      const Eigen::Matrix3d H = CentredView(
          30, turn * M_PI / 2 + 0.1, {0.5 * (columns - 1), 0.5 * (rows - 1)}, {150, 150});
      const auto found =
          detector->Detect(Render(View(Board(columns, rows, false), H), {300, 300}, {.blur = 0.7}));
      Places places = Measured(found);
      ASSERT_EQ(places.size(), columns * rows) << found.failure;
      const Eigen::Vector2d across = places.at(columns - 1) - places.at(0);
      const Eigen::Vector2d down = places.at((rows - 1) * columns) - places.at(0);
      EXPECT_GT(across.x() * down.y() - across.y() * down.x(), 0);
      EXPECT_LE(places.at(0).norm(), places.at(columns * rows - 1).norm() + 0.1);
    }
  }
}

TEST(CirclesDetector, SaysWhyNothingWasFound) {
  for (const bool asymmetric : {false, true}) {
    const auto detector = MakeMarkerDetector(Circles(7, 5, asymmetric));
    for (const cv::Mat& image : EmptyImages()) {
      const MarkerDetections found = detector->Detect(image);
      EXPECT_TRUE(found.markers.empty());
      EXPECT_NE(found.failure.find("7 x 5 circles"), std::string::npos) << found.failure;
    }
  }
}

void ExpectNearShipped(const std::string& name, int index, int columns, int rows, bool asymmetric) {
  const std::string folder =
      std::string("circles_opencv_extra/") + (asymmetric ? "asymmetric" : "symmetric");
  const auto image = OptionalFiles(folder, name + std::to_string(index) + ".", ".png");
  if (image.empty()) GTEST_SKIP() << Absent(OptionalData("frames/" + folder));
  const auto data = OptionalFiles(folder, name + "_corners" + std::to_string(index) + ".", ".dat");
  ASSERT_EQ(data.size(), 1);
  cv::FileStorage storage(data[0].string(), cv::FileStorage::READ);
  cv::Mat shipped;
  storage["corners"] >> shipped;
  const auto found =
      MakeMarkerDetector(Circles(columns, rows, asymmetric))->Detect(ReadGray(image[0]));
  ExpectWellFormed(found);
  ASSERT_EQ(found.markers.size(), columns * rows) << image[0] << found.failure;
  for (const Observation& o : found.markers) {
    const auto expected = shipped.at<cv::Vec2f>(o.marker / columns, o.marker % columns);
    // Those are the blobs' centres of gravity.
    EXPECT_LT(std::hypot(o.values[0] - expected[0], o.values[1] - expected[1]), 0.5) << image[0];
  }
}

TEST(CirclesDetector, AgreesWithOpenCvsSymmetricGrids) {
  for (int k = 1; k <= 14; ++k) ExpectNearShipped("circles", k, 7, 7, false);
}

TEST(CirclesDetector, AgreesWithOpenCvsAsymmetricGrids) {
  for (int k = 1; k <= 3; ++k) ExpectNearShipped("acircles", k, 7, 13, true);
  for (int k = 4; k <= 6; ++k) ExpectNearShipped("acircles", k, 5, 5, true);
  for (int k = 7; k <= 9; ++k) ExpectNearShipped("acircles", k, 3, 9, true);
}

TEST(CirclesDetector, FindsVispsGrids) {
  const auto files = OptionalFiles("circles_visp", "circles-", ".jpg");
  if (files.empty()) GTEST_SKIP() << Absent(OptionalData("frames/circles_visp"));
  const auto detector = MakeMarkerDetector(Circles(6, 6, false));
  for (const auto& file : files) {
    const auto found = detector->Detect(ReadGray(file));
    ExpectWellFormed(found);
    EXPECT_EQ(found.markers.size(), 36) << file << found.failure;
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
