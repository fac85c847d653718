// SPDX-License-Identifier: Apache-2.0
//
// `plenocal target`: what is printed is found by our own detectors, at its true size.
#include <Eigen/LU>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>

#include "detectors/types/marker_detectors.h"
#include "targets/target.h"
#include "targets/target_drawing.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;

constexpr double kDpi = 150;
constexpr double kPixel = 0.0254 / kDpi;  // m

class TargetCommand : public Workspace {
 protected:
  Outcome Print(const std::string& out, const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments{"target", "target.yaml", "-o", out};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return Run(arguments);
  }

  [[nodiscard]] cv::Mat Page(const std::string& name) const {
    cv::Mat page = cv::imread(Path(name).string(), cv::IMREAD_GRAYSCALE);
    // As sharp as a good camera has it.
    if (!page.empty()) cv::GaussianBlur(page, page, {}, 0.8);
    return page;
  }

  /// Markers found in a page, also as a tilted camera sees it; their places on the page.
  [[nodiscard]] std::map<int, Eigen::Vector2d> Found(const Target& target,
                                                     const cv::Mat& page) const {
    const auto detector = MakeMarkerDetector(target);
    const auto w = static_cast<float>(page.cols), h = static_cast<float>(page.rows);
    const std::vector<cv::Point2f> corners{{0, 0}, {w, 0}, {w, h}, {0, h}};
    const std::vector<cv::Point2f> seen{{0.08f * w, 0.05f * h},
                                        {0.9f * w, 0.12f * h},
                                        {0.85f * w, 0.9f * h},
                                        {0.05f * w, 0.97f * h}};
    cv::Mat view;
    cv::warpPerspective(page,
                        view,
                        cv::getPerspectiveTransform(corners, seen),
                        page.size(),
                        cv::INTER_AREA,
                        cv::BORDER_CONSTANT,
                        cv::Scalar(190));
    cv::GaussianBlur(view, view, {}, 1);
    EXPECT_EQ(detector->Detect(view).markers.size(), detector->Detect(page).markers.size());
    std::map<int, Eigen::Vector2d> found;
    for (const Observation& o : detector->Detect(page).markers) {
      found[o.marker] = {o.values[0], o.values[1]};
    }
    return found;
  }

  /// All markers of the target are in the page, as far apart as they should be.
  void ExpectAll(const cv::Mat& page, std::size_t count) const {
    const Target target = ReadTarget(Path("target.yaml"));
    ASSERT_EQ(target.markers.size(), count);
    const auto found = Found(target, page);
    ASSERT_EQ(found.size(), count);
    for (const auto& [marker, place] : found) {
      const double away = kPixel * (place - found.begin()->second).norm();
      const double meant =
          (target.markers.at(marker) - target.markers.at(found.begin()->first)).norm();
      EXPECT_NEAR(away, meant, 0.00004) << marker;  // a quarter of a pixel
    }
  }
};

TEST_F(TargetCommand, PrintsBoardsThatAreFoundAtTheirTrueSize) {
  const std::vector<std::pair<std::string, std::size_t>> targets{
      {"type: aprilgrid\ncolumns: 4\nrows: 3\nsize: 0.03\nspacing: 0.3\n", 48},
      {"type: aprilgrid\ncolumns: 3\nrows: 3\nsize: 0.03\nspacing: 0.3\nborder_bits: 1\n"
       "family: tag25h9\n",
       36},
      {"type: chessboard\ncolumns: 8\nrows: 5\nsquare: 0.02\n", 40},
      {"type: charuco\ncolumns: 7\nrows: 5\nsquare: 0.025\nmarker: 0.018\n"
       "dictionary: DICT_5X5_100\n",
       24},
      {"type: charuco\ncolumns: 6\nrows: 4\nsquare: 0.025\nmarker: 0.018\n"
       "dictionary: DICT_4X4_50\nlegacy: true\n",
       15},
      {"type: circles\ncolumns: 7\nrows: 5\nspacing: 0.02\npattern: symmetric\n", 35},
      {"type: circles\ncolumns: 4\nrows: 7\nspacing: 0.02\npattern: asymmetric\n", 28}};
  for (const auto& [text, count] : targets) {
    SCOPED_TRACE(text);
    Write("target.yaml", "plenocal: 1\n" + text);
    ASSERT_EQ(Print("print.png", {"--dpi", "150"}).status, kDone);
    ExpectAll(Page("print.png"), count);
  }
}

// Columns of a page that are dark in the row `y`, mm, as whole mm.
std::vector<int> DarkAt(const cv::Mat& page, double y, double dpi) {
  const double scale = dpi / 25.4;
  std::vector<int> places;
  for (int x = 0; x < page.cols; ++x) {
    if (page.at<uchar>(static_cast<int>(scale * y), x) > 160) continue;
    const int mm = static_cast<int>(std::lround(x / scale));
    if (places.empty() || places.back() != mm) places.push_back(mm);
  }
  return places;
}

TEST_F(TargetCommand, HasARulerThatIsAsLongAsThePageAllows) {
  Write("target.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 8\nrows: 5\nsquare: 0.0125\n");
  ASSERT_EQ(Print("print.png", {"--dpi", "300"}).status, kDone);
  const cv::Mat page = cv::imread(Path("print.png").string(), cv::IMREAD_GRAYSCALE);
  // 9 x 6 squares, 112.5 x 75 mm, and their white border.
  const double width = page.cols * 25.4 / 300, height = page.rows * 25.4 / 300;
  const int length = static_cast<int>((width - 20) / 10) * 10;
  const double y = height - 12;
  std::vector<int> fives, tens, fifties;
  for (int mm = 0; mm <= length; mm += 5) {
    fives.push_back(10 + mm);
    if (mm % 10 == 0) tens.push_back(10 + mm);
    if (mm % 50 == 0) fifties.push_back(10 + mm);
  }
  EXPECT_EQ(DarkAt(page, y - 1.2, 300), fives);
  EXPECT_EQ(DarkAt(page, y - 2.1, 300), tens);
  EXPECT_EQ(DarkAt(page, y - 3.2, 300), fifties);
  EXPECT_TRUE(DarkAt(page, y - 4.3, 300).empty());
}

TEST_F(TargetCommand, MarksWhereSheetsAreCut) {
  Write("target.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 8\nrows: 5\nsquare: 0.03\n");
  ASSERT_EQ(Print("print.png", {"--dpi", "300", "--paper", "a4"}).status, kDone);
  const cv::Mat page = cv::imread(Path("print-1.png").string(), cv::IMREAD_GRAYSCALE);
  // As wide as the paper allows, as high as the board with its white border of half a square.
  const double width = page.cols * 25.4 / 300;
  const int left = 10, right = static_cast<int>(std::lround(width - 10)),
            bottom = 10 + 6 * 30 + 2 * 15;
  EXPECT_EQ(DarkAt(page, 8, 300), (std::vector<int>{left, right}));
  EXPECT_TRUE(DarkAt(page, 6.5, 300).empty());
  EXPECT_EQ(DarkAt(page, bottom + 2.5, 300), (std::vector<int>{left, right}));
  // The marks beside the rows, of the transposed page.
  const cv::Mat across = page.t();
  EXPECT_EQ(DarkAt(across, 8, 300), (std::vector<int>{10, bottom}));
  EXPECT_TRUE(DarkAt(across, 6.5, 300).empty());
}

// Red numbers at the markers, blue axes that begin at the origin, neither without --numbers.
TEST_F(TargetCommand, NumbersMarkersAndDrawsTheAxes) {
  constexpr double kMargin = 0.010;  // m
  const std::vector<std::string> targets{
      "type: chessboard\ncolumns: 4\nrows: 3\nsquare: 0.02\n",
      "type: charuco\ncolumns: 5\nrows: 4\nsquare: 0.02\nmarker: 0.014\n"
      "dictionary: DICT_4X4_50\n",
      "type: circles\ncolumns: 4\nrows: 3\nspacing: 0.02\npattern: symmetric\n"};
  for (const std::string& text : targets) {
    SCOPED_TRACE(text);
    Write("target.yaml", "plenocal: 1\n" + text);
    ASSERT_EQ(Print("plain.png", {"--dpi", "150"}).status, kDone);
    ASSERT_EQ(Print("numbers.png", {"--dpi", "150", "--numbers"}).status, kDone);
    const auto coloured = [&](const std::string& name, int strong, const cv::Rect& part) {
      const cv::Mat page = cv::imread(Path(name).string());
      std::array<cv::Mat, 3> channels;
      cv::split(page(part & cv::Rect({}, page.size())), channels.data());
      cv::Mat difference;
      cv::subtract(channels[strong], channels[2 - strong], difference);
      return cv::countNonZero(difference > 60);
    };
    const cv::Rect all(0, 0, 100000, 100000);
    EXPECT_EQ(coloured("plain.png", 0, all) + coloured("plain.png", 2, all), 0);
    const TargetPart part = DrawTarget(ReadTarget(Path("target.yaml"))).at(0);
    const Eigen::Vector2d origin = Eigen::Vector2d::Constant(kMargin) - part.paper.min();
    const auto around = [&](const Eigen::Vector2d& place, double radius) {
      const Eigen::Vector2d corner = (place - Eigen::Vector2d::Constant(radius)) / kPixel;
      const int size = static_cast<int>(2 * radius / kPixel);
      return cv::Rect(static_cast<int>(corner.x()), static_cast<int>(corner.y()), size, size);
    };
    EXPECT_GT(coloured("numbers.png", 0, around(origin, 0.002)), 10);
    EXPECT_EQ(coloured("numbers.png", 0, around(origin - Eigen::Vector2d(0.004, 0.004), 0.002)), 0);
    for (const auto& [marker, position] : ReadTarget(Path("target.yaml")).markers) {
      EXPECT_GT(coloured("numbers.png", 2, around(origin + position.head<2>(), 0.004)), 5)
          << marker;
    }
  }
}

TEST_F(TargetCommand, PrintsTagsOfAllKindsUpright) {
  for (const std::string family : {"tag36h11", "tag16h5", "tagStandard41h12", "tagCircle21h7"}) {
    SCOPED_TRACE(family);
    Write("target.yaml",
          "plenocal: 1\ntype: apriltag\nfamily: " + family +
              "\ntags:\n"
              "  - {id: 3, corners: [[0, 0, 0], [0.04, 0, 0], [0.04, 0.04, 0], [0, 0.04, 0]]}\n"
              "  - {id: 7, corners: [[0.09, 0, 0], [0.13, 0, 0], [0.13, 0.04, 0], [0.09, 0.04, "
              "0]]}\n");
    ASSERT_EQ(Print("print.png", {"--dpi", "150"}).status, kDone);
    ExpectAll(Page("print.png"), 8);
  }
}

TEST_F(TargetCommand, LaysTagsOfAnArrangementInSpaceOutOverPages) {
  std::filesystem::copy(std::filesystem::path(PLENOCAL_EXAMPLES) / "simulate" / "target.yaml",
                        Path("target.yaml"));
  const Outcome outcome = Print("tags.png", {"--dpi", "150", "--paper", "a4"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const std::vector<std::string> files = Lines(outcome.out);
  ASSERT_GE(files.size(), 2u);
  std::vector<cv::Mat> pages;
  for (std::size_t i = 0; i < files.size(); ++i) {
    pages.push_back(Page("tags-" + std::to_string(i + 1) + ".png"));
    EXPECT_EQ(pages.back().cols, std::lround(0.210 / kPixel));
    EXPECT_EQ(pages.back().rows, std::lround(0.297 / kPixel));
  }
  // On the pages the tags are not where they are on the target, so each is looked for alone.
  const Target target = ReadTarget(Path("target.yaml"));
  for (const int id : {0, 1, 13, 20, 31}) {
    Target one = target;
    std::get<TagLayout>(one.layout).ids = {id};
    one.markers.clear();
    for (int k = 0; k < 4; ++k) one.markers[4 * id + k] = target.markers.at(4 * id + k);
    const auto detector = MakeMarkerDetector(one);
    int seen = 0;
    for (const cv::Mat& page : pages) {
      std::map<int, Eigen::Vector2d> found;
      for (const Observation& o : detector->Detect(page).markers) {
        found[o.marker] = {o.values[0], o.values[1]};
      }
      if (found.empty()) continue;
      ++seen;
      ASSERT_EQ(found.size(), 4u);
      for (int k = 1; k < 4; ++k) {
        EXPECT_NEAR(kPixel * (found.at(4 * id + k) - found.at(4 * id)).norm(),
                    (one.markers.at(4 * id + k) - one.markers.at(4 * id)).norm(),
                    0.00004);
      }
    }
    EXPECT_EQ(seen, 1) << id;
  }
}

TEST_F(TargetCommand, SpreadsALargeBoardOverPagesThatJoin) {
  Write("target.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 9\nrows: 6\nsquare: 0.05\n");
  const Outcome outcome = Print("board.png", {"--dpi", "150", "--paper", "a4"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  // 550 x 400 mm in windows of 190 x 263 mm.
  EXPECT_EQ(Lines(outcome.out).size(), 6u) << outcome.out;
  ASSERT_EQ(Print("board.pdf", {"--paper", "a2"}).status, kDone);

  // Cut at the marks, 10 mm from the paper's edges, and joined: 10 px a millimetre.
  ASSERT_EQ(Print("cut.png", {"--dpi", "254", "--paper", "a4"}).status, kDone);
  cv::Mat joined(4000, 5500, CV_8UC1, cv::Scalar(255));
  for (int i = 0; i < 6; ++i) {
    const cv::Mat page =
        cv::imread(Path("cut-" + std::to_string(i + 1) + ".png").string(), cv::IMREAD_GRAYSCALE);
    ASSERT_FALSE(page.empty());
    const cv::Rect place = cv::Rect(1900 * (i % 3), 2630 * (i / 3), 1900, 2630) &
                           cv::Rect(0, 0, joined.cols, joined.rows);
    page(cv::Rect(100, 100, place.width, place.height)).copyTo(joined(place));
  }
  cv::Mat view;
  cv::resize(joined, view, {}, 0.25, 0.25, cv::INTER_AREA);
  cv::GaussianBlur(view, view, {}, 0.8);
  const Target target = ReadTarget(Path("target.yaml"));
  const auto found = Found(target, view);
  ASSERT_EQ(found.size(), 54u);
  for (const auto& [marker, place] : found) {
    const double away = 0.0004 * (place - found.begin()->second).norm();
    EXPECT_NEAR(away, (target.markers.at(marker) - target.markers.at(0)).norm(), 0.0001) << marker;
  }
}

TEST_F(TargetCommand, FilesStateTheirSize) {
  Write("target.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 8\nrows: 5\nsquare: 0.02\n");
  ASSERT_EQ(Print("a.svg").status, kDone);
  ASSERT_EQ(Run({"target", "chessboard:9x6:25mm", "-o", "word.pdf"}).status, kDone);
  const Outcome unknown = Run({"target", "chessboard:9x6:unknown", "-o", "unknown.pdf"});
  EXPECT_EQ(unknown.status, kWrongInput);
  EXPECT_THAT(unknown.err, HasSubstr("'square' is unknown; state it"));
  ASSERT_EQ(Print("a.pdf").status, kDone);
  ASSERT_EQ(Print("a.png", {"--dpi", "300"}).status, kDone);
  // 9 x 6 squares, half a square of white, 10 mm of margin, 14 mm for the ruler.
  EXPECT_THAT(Read("a.svg"), HasSubstr("width=\"220mm\" height=\"174mm\""));
  EXPECT_THAT(Read("a.pdf"), HasSubstr("MediaBox [ 0 0 623.622"));
  const std::string png = Read("a.png");
  const std::size_t chunk = png.find("pHYs");
  ASSERT_NE(chunk, std::string::npos);
  const std::string per_metre(png, chunk + 4, 4);
  EXPECT_EQ(per_metre, std::string("\0\0\x2e\x23", 4));  // 11811
  EXPECT_FALSE(Page("a.png").empty());
}

TEST_F(TargetCommand, SaysWhatItCannotPrint) {
  Write("target.yaml", "plenocal: 1\ntype: markers\nmarkers: {0: [0, 0, 0]}\n");
  const auto expect = [&](const Outcome& outcome, const std::string& part) {
    EXPECT_EQ(outcome.status, kWrongInput);
    EXPECT_EQ(Lines(outcome.err).size(), 1u) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr(part));
  };
  expect(Print("a.svg"), "cannot be drawn");
  Write("target.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 8\nrows: 5\nsquare: 0.02\n");
  expect(Print("a.jpg"), ".svg, .pdf or .png");
  expect(Print("a.svg", {"--paper", "a44"}), "did you mean 'a4'");
  expect(Print("a.png", {"--dpi", "2400", "--paper", "a0"}), "lower --dpi");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
