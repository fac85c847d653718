// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "calib/base/error.h"
#include "detectors/images/detect_images.h"
#include "detectors/images/image.h"
#include "detectors/types/marker_detectors.h"
#include "tests/detectors/render_pattern.h"
#include "tests/optional_data.h"
#include "tests/targets/aruco_cells.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr double kMarker = 0.75;  // of a square

CharucoLayout Layout(int columns, int rows) {
  return {{}, columns, rows, 0.04, 0.04 * kMarker, "DICT_4X4_100", std::nullopt};
}

Target Charuco(int columns, int rows) {
  Target target;
  target.layout = Layout(columns, rows);
  return target;
}

/// In squares from the board's top left corner; white all around. `first_white`: a marker is in the
/// top left square.
GrayFunction Board(int columns, int rows, bool first_white, bool inverted = false) {
  const auto dictionary = ArucoDictionary(cv::aruco::DICT_4X4_100);
  std::map<std::pair<int, int>, cv::Mat> markers;
  int id = 0;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      if (((row + column) % 2 == 0) != first_white) continue;
      markers[{column, row}] = ArucoCells(*dictionary, id++);
    }
  }
  return [=](const Eigen::Vector2d& p) {
    const int column = static_cast<int>(std::floor(p.x())),
              row = static_cast<int>(std::floor(p.y()));
    bool white = true;
    if (column >= 0 && row >= 0 && column < columns && row < rows) {
      const auto marker = markers.find({column, row});
      white = marker != markers.end();
      const Eigen::Vector2d in_marker =
          (p - Eigen::Vector2d(column, row) - Eigen::Vector2d::Constant(0.5 * (1 - kMarker))) /
          kMarker;
      if (white && in_marker.minCoeff() >= 0 && in_marker.maxCoeff() < 1) {
        white = marker->second.at<uchar>(static_cast<int>(6 * in_marker.y()),
                                         static_cast<int>(6 * in_marker.x())) != 0;
      }
    }
    return white == inverted ? 50.0 : 200.0;
  };
}

Places Truth(int columns, int rows, const Eigen::Matrix3d& H) {
  Places places;
  int k = 0;
  for (int row = 1; row < rows; ++row) {
    for (int column = 1; column < columns; ++column) {
      places[k++] = (H * Eigen::Vector3d(column, row, 1)).hnormalized();
    }
  }
  return places;
}

TEST(CharucoDetector, MeasuresCornersAndStatesItsErrorHonestly) {
  constexpr int kColumns = 7, kRows = 5;
  const auto detector = MakeMarkerDetector(Charuco(kColumns, kRows));
  for (const double pitch : {44.0, 28.0}) {
    Statistics statistics;
    for (unsigned seed = 1; seed <= 6; ++seed) {
      const Eigen::Matrix3d H = TiltedView(pitch, 0.07 * seed, 90, 30);
      const cv::Mat image = Render(View(Board(kColumns, kRows, false), H),
                                   {static_cast<int>(9 * pitch) + 30, static_cast<int>(8 * pitch)},
                                   {.blur = 0.7, .noise = 4, .seed = seed});
      const MarkerDetections found = detector->Detect(image);
      ExpectWellFormed(found);
      EXPECT_EQ(found.markers.size(), 24) << found.failure;
      statistics.Add(found, Truth(kColumns, kRows, H));
    }
    EXPECT_LT(statistics.Rms(), 0.03) << "pitch " << pitch;
    // 288 coordinates: the mean of their squares scatters by 8 % of itself when sigma is right.
    EXPECT_GT(statistics.Ratio(), 0.7) << "pitch " << pitch;
    EXPECT_LT(statistics.Ratio(), 1.4) << "pitch " << pitch;
  }
}

TEST(CharucoDetector, ResultsOnHardImagesAreTheSameAsBefore) {
  constexpr int kColumns = 7, kRows = 5;
  const auto view = [&](const Eigen::Matrix3d& H, RenderOptions options) {
    options.supersampling = 4;
    return Render(View(Board(kColumns, kRows, false), H), {420, 360}, options);
  };
  cv::Mat partly_hidden = view(TiltedView(44, 0.2, 90, 30), {.blur = 1, .noise = 6});
  partly_hidden(cv::Rect(150, 90, 60, 50)) = 120;
  Eigen::Matrix3d steep = TiltedView(44, 0.1, 60, 200);
  steep.row(1) *= 0.5;
  ExpectDigests(*MakeMarkerDetector(Charuco(kColumns, kRows)),
                {view(TiltedView(24, 0.3, 130, 60), {.blur = 0.7, .noise = 3}),
                 view(TiltedView(19, -0.2, 100, 100), {.blur = 0.5, .noise = 2}),
                 view(TiltedView(44, 0.2, 90, 30), {.blur = 2, .noise = 3}),
                 view(TiltedView(44, 0.2, 90, 30), {.blur = 0.8, .noise = 40}),
                 view(TiltedView(44, 0.2, -70, -60), {.blur = 0.8, .noise = 3}),
                 view(steep, {.blur = 0.8, .noise = 3}),
                 partly_hidden,
                 UnevenlyLit(view(TiltedView(44, 0.1, 70, 50), {.blur = 0.6, .noise = 3}), 0.3),
                 0.15 * view(TiltedView(44, 0.1, 70, 50), {.blur = 0.9, .noise = 2}) + 60},
                {-2103.3244,
                 -1978.0893,
                 -1632.8558,
                 -2245.7004,
                 -495.3154,
                 -2451.1653,
                 -2129.1078,
                 -2570.1586,
                 -2572.9215});
}

TEST(CharucoDetector, BoardsWithTheSameMarkersAreToldApart) {
  const GrayFunction left = Board(7, 5, false), right = Board(5, 7, false);
  const GrayFunction both = [&](const Eigen::Vector2d& p) {
    return p.x() < 7.5 ? left(p) : right(p - Eigen::Vector2d(8, 0));
  };
  const Eigen::Matrix3d H = TiltedView(44, 0.1, 40, 30);
  const cv::Mat image = Render(View(both, H), {640, 400}, {.blur = 0.7, .noise = 4});
  const Eigen::Matrix3d H_right = H * Eigen::Affine2d(Eigen::Translation2d(8, 0)).matrix();
  const auto expect = [&](const Target& target, const OtherTargets& others, const Places& truth) {
    const MarkerDetections found = MakeMarkerDetector(target, others)->Detect(image);
    EXPECT_EQ(found.markers.size(), 24) << found.failure;
    Statistics statistics;
    statistics.Add(found, truth);
    EXPECT_LT(statistics.Rms(), 0.05);
  };
  expect(Charuco(7, 5), {.targets = {Charuco(5, 7)}}, Truth(7, 5, H));
  expect(Charuco(5, 7), {.targets = {Charuco(7, 5)}, .before_own = 1}, Truth(5, 7, H_right));
}

TEST(CharucoDetector, TellsTheLayoutsOfOpenCvApart) {
  const Eigen::Matrix3d H = TiltedView(40, 0.2, 90, 40);
  for (const auto& [columns, rows] : {std::pair{6, 4}, {5, 4}, {5, 5}, {6, 5}}) {
    for (const bool legacy : {false, true}) {
      for (const bool inverted : {false, true}) {
        const bool first_white = legacy && rows % 2 == 0;
        const auto found = MakeMarkerDetector(Charuco(columns, rows))
                               ->Detect(Render(View(Board(columns, rows, first_white, inverted), H),
                                               {380, 320},
                                               {.blur = 0.7}));
        ASSERT_EQ(found.markers.size(), (columns - 1) * (rows - 1)) << found.failure;
        Statistics statistics;
        statistics.Add(found, Truth(columns, rows, H));
        EXPECT_LT(statistics.Rms(), 0.02) << columns << " x " << rows << (legacy ? " legacy" : "");
      }
    }
  }
}

TEST(CharucoDetector, ReportsThePartOfTheBoardThatIsInView) {
  const Eigen::Matrix3d H = TiltedView(40, 0, -50, -60);  // the first row and column are cut off
  const auto found = MakeMarkerDetector(Charuco(8, 6))
                         ->Detect(Render(View(Board(8, 6, false), H), {300, 240}, {.blur = 0.7}));
  ExpectWellFormed(found);
  EXPECT_GE(found.markers.size(), 16) << found.failure;
  EXPECT_LT(found.markers.size(), 35);
  Statistics statistics;
  statistics.Add(found, Truth(8, 6, H));
  EXPECT_LT(statistics.Rms(), 0.02);
}

TEST(CharucoDetector, AsksForTheLayoutWhereTheImageCannotTell) {
  // Odd columns, even rows: without the border the layouts differ by a shift of one column.
  const Eigen::Matrix3d H = TiltedView(40, 0, -50, -60);
  const cv::Mat image = Render(View(Board(7, 6, false), H), {300, 240}, {.blur = 0.7});
  EXPECT_THAT(MakeMarkerDetector(Charuco(7, 6))->Detect(image).failure,
              ::testing::HasSubstr("state legacy: true or false"));
  Target stated = Charuco(7, 6);
  std::get<CharucoLayout>(stated.layout).legacy = false;
  const auto found = MakeMarkerDetector(stated)->Detect(image);
  EXPECT_GE(found.markers.size(), 16) << found.failure;
  Statistics statistics;
  statistics.Add(found, Truth(7, 6, H));
  EXPECT_LT(statistics.Rms(), 0.02);
}

TEST(CharucoDetector, AllImagesOfACameraDecideTheLayout) {
  const Eigen::Matrix3d H_part = TiltedView(40, 0, -50, -60), H_whole = TiltedView(30, 0.1, 30, 25);
  const TemporaryFolder folder;
  std::vector<FrameImage> images;
  const auto add = [&](const std::string& frame, bool legacy, const Eigen::Matrix3d& H) {
    images.push_back({frame, folder / (frame + ".png")});
    cv::imwrite(images.back().path.string(),
                Render(View(Board(7, 6, legacy), H), {300, 240}, {.blur = 0.7}));
  };
  add("part", false, H_part);
  add("whole", false, H_whole);
  add("again", false, H_whole);
  add("other", true, H_whole);
  const auto detect = [&](int threads, DetectionCache* cache) {
    return DetectOrdinaryImages(images,
                                [] { return MakeMarkerDetector(Charuco(7, 6)); },
                                {.threads = threads, .cache = cache, .progress = {}});
  };
  DetectionCache cache(folder / "cache", "test", false);
  for (const int threads : {1, 2, 1}) {
    const ImageDetections found = detect(threads, &cache);
    ASSERT_THAT(found.views, ::testing::SizeIs(3));
    ASSERT_THAT(found.left_out, ::testing::SizeIs(1));
    EXPECT_EQ(found.left_out[0].where, (folder / "other.png").string());
    EXPECT_THAT(found.left_out[0].reason, ::testing::HasSubstr("shows the legacy layout"));
    for (const auto& view : found.views) {
      const bool part = view.frame == "part";
      EXPECT_GE(view.observations.size(), part ? 16 : 30);
      MarkerDetections markers;
      markers.markers = view.observations;
      Statistics statistics;
      statistics.Add(markers, Truth(7, 6, part ? H_part : H_whole));
      EXPECT_LT(statistics.Rms(), 0.02) << view.frame;
    }
    EXPECT_GT(found.traits.at("part").blur, 0);
    std::ranges::reverse(images);
  }
  const std::vector<ImageSketch> sketches = SketchOrdinaryImages(
      images, [] { return MakeMarkerDetector(Charuco(7, 6)); }, {.cache = &cache, .progress = {}});
  const auto points = [](const ImageSketch& sketch) { return !sketch.points.empty(); };
  EXPECT_EQ(std::ranges::count_if(sketches, points), 3);
  // Those that none decides.
  std::erase_if(images, [](const FrameImage& image) { return image.frame != "part"; });
  EXPECT_THAT(detect(1, nullptr).left_out.at(0).reason, ::testing::HasSubstr("state legacy"));
}

TEST(CharucoDetector, LeavesOutCoveredCorners) {
  const Eigen::Matrix3d H = TiltedView(40, 0, 40, 30);
  cv::Mat image = Render(View(Board(7, 5, false), H), {360, 260}, {.blur = 0.7});
  const Eigen::Vector2d covered = Truth(7, 5, H).at(8);
  image(cv::Rect(static_cast<int>(covered.x()) - 12, static_cast<int>(covered.y()) - 12, 25, 25)) =
      120;
  const auto found = MakeMarkerDetector(Charuco(7, 5))->Detect(image);
  EXPECT_FALSE(Measured(found).contains(8));
  EXPECT_EQ(found.markers.size(), 23);
  EXPECT_THAT(found.left_out, ::testing::ElementsAre(::testing::StartsWith("corner 8: ")));
}

// Two markers of one corner of the board are printed at the opposite one, where they agree with
// each other alone.
TEST(CharucoDetector, LeavesOutMarkersThatMostOfTheirNeighboursContradict) {
  const GrayFunction board = Board(7, 5, false);
  const GrayFunction swapped = [&](const Eigen::Vector2d& p) {
    const Eigen::Vector2d offset(5, 3), square = p.array().floor();
    for (const Eigen::Vector2d& one : {Eigen::Vector2d(1, 0), Eigen::Vector2d(0, 1)}) {
      if (square == one) return board(p + offset);
      if (square == one + offset) return board(p - offset);
    }
    return board(p);
  };
  const Eigen::Matrix3d H = TiltedView(40, 0.1, 40, 30);
  const MarkerDetections found = MakeMarkerDetector(Charuco(7, 5))
                                     ->Detect(Render(View(swapped, H), {360, 280}, {.blur = 0.7}));
  EXPECT_EQ(found.markers.size(), 24) << found.failure;
  Statistics statistics;
  statistics.Add(found, Truth(7, 5, H));
  EXPECT_LT(statistics.Rms(), 0.05);
}

TEST(CharucoDetector, SaysWhyNothingWasFound) {
  const auto detector = MakeMarkerDetector(Charuco(7, 5));
  for (const cv::Mat& image : EmptyImages()) {
    const MarkerDetections found = detector->Detect(image);
    EXPECT_TRUE(found.markers.empty());
    EXPECT_FALSE(found.failure.empty());
  }
}

TEST(CharucoDetector, RefusesDictionariesThatDoNotServe) {
  Target target = Charuco(7, 5);
  std::get<CharucoLayout>(target.layout).dictionary = "DICT_4x4_100";
  EXPECT_THROW(MakeMarkerDetector(target), Error);
  target.layout = CharucoLayout{{}, 20, 10, 0.04, 0.03, "DICT_4X4_50", {}};
  EXPECT_THROW(MakeMarkerDetector(target), Error);
}

struct RealSet {
  std::string name;
  std::size_t opencv_corners;
};

class CharucoRealSet : public ::testing::TestWithParam<RealSet> {};

TEST_P(CharucoRealSet, GivesAtLeastOpenCvsCorners) {
  const std::string& name = GetParam().name;
  const auto files = OptionalFiles("charuco_lifecam/" + name, "", ".jpg");
  if (files.empty()) GTEST_SKIP() << Absent(OptionalData("frames/charuco_lifecam"));
  // image,corner,x,y; OpenCV 4.6's ChArUco corners are half a pixel too far right and down (it adds
  // 0.5 after cornerSubPix).
  std::map<std::string, Places> reference;
  std::ifstream csv(OptionalData("frames/charuco_lifecam/corners_" + name + ".csv"));
  std::string line;
  std::getline(csv, line);
  while (std::getline(csv, line)) {
    std::stringstream fields(line);
    std::string image, id, x, y;
    std::getline(fields, image, ',');
    std::getline(fields, id, ',');
    std::getline(fields, x, ',');
    std::getline(fields, y, ',');
    reference[image][std::stoi(id)] = {std::stod(x) - 0.5, std::stod(y) - 0.5};
  }
  Target target;
  target.layout = CharucoLayout{{}, 8, 8, 0.0254, 0.01905, "DICT_4X4_1000", {}};
  const auto detector = MakeMarkerDetector(target);
  std::size_t corners = 0;
  int compared = 0, near = 0;
  for (const auto& file : files) {
    const MarkerDetections found = detector->Detect(ReadGray(file));
    ExpectWellFormed(found);
    corners += found.markers.size();
    const Places& expected = reference[name + "/" + file.filename().string()];
    for (const auto& [marker, p] : Measured(found)) {
      if (!expected.contains(marker)) continue;
      ++compared;
      near += (expected.at(marker) - p).norm() < 0.7 ? 1 : 0;
    }
  }
  EXPECT_GE(corners, GetParam().opencv_corners);
  EXPECT_GE(near, 0.99 * compared);
}

INSTANTIATE_TEST_SUITE_P(Shared,
                         CharucoRealSet,
                         ::testing::Values(RealSet{"2024-05-07_lifecam_1280", 749},
                                           RealSet{"2024-05-07_lifecam_480", 769},
                                           RealSet{"2024-06-19_lifecam_1280_Old_Pattern", 572}),
                         [](const auto& test) {
                           std::string name = test.param.name;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

}  // namespace TEST_FILE
}  // namespace plenocal::testing
