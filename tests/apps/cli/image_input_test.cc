// SPDX-License-Identifier: Apache-2.0
//
// Images in: good ones, and every kind of bad one among them.
#include <fmt/format.h>

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

#include "tests/apps/chessboard_images.h"
#include "tests/targets/aruco_cells.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

TEST_F(Images, OfAChessboardGiveTheCameraBack) {
  const Outcome outcome = Calibrate();
  EXPECT_THAT(outcome.err, HasSubstr("cam0: 8 images, target found in 8, 320 points"));
  const YAML::Node camera = Result()["cameras"]["cam0"];
  EXPECT_NEAR(camera["parameters"]["f_x"].as<double>(), kFocal, 0.005 * kFocal);
  EXPECT_LT(camera["residuals"]["rms"].as<double>(), 0.1);
  EXPECT_EQ(camera["image_size"].as<std::vector<int>>(), (std::vector<int>{640, 480}));
}

TEST_F(Images, ThatAreCorruptAreLeftOut) {
  Write("images/bad.png", "this is no image\n");
  ExpectLeftOut("images/bad.png", {"is not an image"});
}

TEST_F(Images, ThatAreTruncatedAreLeftOut) {
  const std::string good = Read("images/00.png");
  Write("images/bad.png", good.substr(0, good.size() / 2));
  ExpectLeftOut("images/bad.png", {"truncated"});
}

TEST_F(Images, ThatAreEmptyAreLeftOut) {
  Write("images/bad.png", "");
  ExpectLeftOut("images/bad.png", {"empty"});
}

TEST_F(Images, OfAnotherSizeAreLeftOut) {
  Save("images/bad.png", ChessboardView(3, {800, 600}));
  ExpectLeftOut("images/bad.png", {"800 x 600", "640 x 480"});
}

TEST_F(Images, WithoutTheTargetAreLeftOut) {
  Save("images/bad.png", cv::Mat(480, 640, CV_8UC1, cv::Scalar(128)));
  ExpectLeftOut("images/bad.png", {});
}

TEST_F(Images, ThatAllLackTheTargetAreNotEnough) {
  Save("gray/a.png", cv::Mat(480, 640, CV_8UC1, cv::Scalar(128)));
  Save("gray/b.png", cv::Mat(480, 640, CV_8UC1, cv::Scalar(128)));
  WriteSession({"gray/*.png"});
  ExpectFailure(kJobFailed, {"cam0", "none of its 2 images shows the target", "gray/a.png"});
  ExpectFailure(kJobFailed, {"cam0", "none of its 2 images shows the target"}, "detect");
}

TEST_F(Images, ThatAllAreCorruptAreNotEnough) {
  Write("broken/a.png", "nothing");
  WriteSession({"broken/*.png"});
  ExpectFailure(kJobFailed, {"cam0", "no image can be read", "broken/a.png"});
}

TEST_F(Images, OfAnotherSizeThanTheSessionSaysAreRefused) {
  Write("session.yaml", Read("session.yaml") + "    image_size: [320, 240]\n");
  ExpectFailure(kWrongInput, {"cam0", "640 x 480", "320 x 240", "image_size"});
}

TEST_F(Images, BelongToTheFrameThatTheLastStarStandsFor) {
  for (int i = 0; i < kImages; ++i) {
    const std::string from = fmt::format("images/{:02}.png", i);
    Write(fmt::format("day{}/left{:02}.png", i % 2, i), Read(from));
    Write(fmt::format("right{:02}.png", i), Read(from));
  }
  WriteSession({"day*/left*.png", "right*.png"});
  const Outcome outcome = Run({"detect", "session.yaml", "-o", "out"});
  EXPECT_EQ(outcome.status, kDone) << outcome.err;
  const Table left(Read("out/detections_cam0.csv")), right(Read("out/detections_cam1.csv"));
  const auto names = [](const Table& table) {
    const std::vector<std::string> column = table.Column("frame");
    return std::set<std::string>(column.begin(), column.end());
  };
  EXPECT_THAT(names(left), ::testing::ElementsAre("00", "01", "02", "03", "04", "05", "06", "07"));
  EXPECT_EQ(names(left), names(right));
}

TEST_F(Images, OfOneFrameTwiceAreRefused) {
  Write("a/x00.png", Read("images/00.png"));
  Write("b/x00.png", Read("images/00.png"));
  WriteSession({"?/x*.png"});
  ExpectFailure(kWrongInput, {"a/x00.png", "b/x00.png", "frame '00'", "tells them apart"});
}

TEST_F(Images, OfAPatternWithBracketsAreFound) {
  WriteSession({"\"[!x]mage[s]/*.png\""});
  const Outcome outcome = Run({"detect", "session.yaml", "-o", "out"});
  EXPECT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("8 frames"));
}

TEST_F(Images, DetectedOnceServeAsDetections) {
  Calibrate("direct");
  const Outcome detect = Run({"detect", "session.yaml", "-o", "found", "--quiet"});
  EXPECT_EQ(detect.status, kDone);
  EXPECT_EQ(detect.err, "");
  Write("session.yaml",
        Replaced(Read("session.yaml"),
                 "images: images/*.png",
                 "detections: found/detections_cam0.csv\n    image_size: [640, 480]"));
  Calibrate("again");
  EXPECT_EQ(Read("direct/detections_cam0.csv"), Read("again/detections_cam0.csv"));
  EXPECT_NEAR(Result("direct")["cameras"]["cam0"]["parameters"]["f_x"].as<double>(),
              Result("again")["cameras"]["cam0"]["parameters"]["f_x"].as<double>(),
              1e-4);
}

TEST_F(Images, GiveTheSameBytesOnAnyNumberOfThreads) {
  for (const char* threads : {"1", "2"}) {
    const Outcome outcome =
        Run({"detect", "session.yaml", "-o", std::string("out") + threads, "--threads", threads});
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
  }
  EXPECT_EQ(Files("out1"), Files("out2"));
}

TEST_F(Images, OfATagThatStandsTwiceInThemLoseThatTag) {
  cv::Mat image(480, 640, CV_8UC1, cv::Scalar(230));
  const auto dictionary = ArucoDictionary(cv::aruco::DICT_APRILTAG_36h11);
  const auto paint = [&](int id, int x, int y) {
    cv::Mat tag;
    cv::resize(255 * ArucoCells(*dictionary, id), tag, {96, 96}, 0, 0, cv::INTER_NEAREST);
    tag.copyTo(image(cv::Rect(x, y, tag.cols, tag.rows)));
  };
  paint(0, 50, 50);
  paint(0, 450, 300);
  paint(1, 250, 60);
  paint(2, 60, 300);
  cv::GaussianBlur(image, image, {5, 5}, 0.8);
  Save("tags/0.png", image);
  std::string target = "plenocal: 1\ntype: apriltag\nfamily: tag36h11\ntags:\n";
  for (int id = 0; id < 3; ++id) {
    target += fmt::format(
        "  - {{id: {0}, corners: [[{0}, 0, 0], [{0}.5, 0, 0], [{0}.5, 0.5, 0], [{0}, 0.5, 0]]}}\n",
        id);
  }
  Write("target.yaml", target);
  WriteSession({"tags/*.png"});
  const Outcome outcome = Run({"detect", "session.yaml", "-o", "out"});
  EXPECT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("tags/0.png"), HasSubstr("tag 0"), HasSubstr("twice")));
  EXPECT_THAT(Table(Read("out/detections_cam0.csv")).Numbers("marker"),
              ::testing::ElementsAre(4, 5, 6, 7, 8, 9, 10, 11));
}

TEST_F(Images, InterruptedLeaveNoResults) {
  for (int i = 0; i < 600; ++i) {
    fs::create_directories(Path("many"));
    fs::create_symlink(Path(fmt::format("images/{:02}.png", i % kImages)),
                       Path(fmt::format("many/{:04}.png", i)));
  }
  WriteSession({"many/*.png"});
  for (const char* command : {"calibrate", "detect"}) {
    fs::remove_all(Path("out"));
    // The program makes the folder just before it starts to detect.
    const Outcome outcome = Run({command, "session.yaml", "-o", "out"},
                                {.interrupt_when = [this] { return fs::exists(Path("out")); }});
    EXPECT_EQ(outcome.status, kInterrupted) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr("interrupted; no result files were written"));
    EXPECT_EQ(outcome.out, "");
    EXPECT_THAT(Results("out"), ::testing::IsEmpty());
  }
}

TEST_F(Images, AreFreedOfVignettingByWhiteImages) {
  // Fall-off to a tenth, off centre, as a steep gradient moves corners most.
  cv::Mat shade(480, 640, CV_32F);
  for (int y = 0; y < shade.rows; ++y) {
    for (int x = 0; x < shade.cols; ++x) {
      const double r2 = ((x - 100) * (x - 100) + (y - 80) * (y - 80)) / (450.0 * 450.0);
      shade.at<float>(y, x) = static_cast<float>(1 / std::pow(1 + r2, 2));
    }
  }
  const auto save = [&](const std::string& name, const cv::Mat& image) {
    cv::Mat exact, shaded;
    image.convertTo(exact, CV_32F, 256);
    exact = exact.mul(shade);
    exact.convertTo(shaded, CV_16U);
    Save(name, shaded);
  };
  const auto detect = [&](const std::string& out) {
    const Outcome outcome = Run({"detect", "session.yaml", "-o", out});
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    const Table table(Read(out + "/detections_cam0.csv"));
    const auto frame = table.Column("frame"), marker = table.Column("marker");
    const auto x = table.Numbers("x"), y = table.Numbers("y");
    std::map<std::string, cv::Point2d> places;
    for (size_t i = 0; i < x.size(); ++i) places[frame[i] + " " + marker[i]] = {x[i], y[i]};
    return places;
  };
  const auto even = detect("even");
  for (int i = 0; i < kImages; ++i) save(fmt::format("images/{:02}.png", i), ChessboardView(i));
  const auto distance = [&](const std::map<std::string, cv::Point2d>& places) {
    EXPECT_EQ(places.size(), even.size());
    double squares = 0;
    for (const auto& [name, place] : places) {
      const cv::Point2d off = place - even.at(name);
      squares += off.dot(off);
    }
    return std::sqrt(squares / static_cast<double>(places.size()));
  };
  const double shaded = distance(detect("shaded"));
  save("white/0.png", cv::Mat(480, 640, CV_8U, cv::Scalar(200)));
  Write("session.yaml",
        Replaced(Read("session.yaml"),
                 "images: images/*.png",
                 "images: images/*.png\n    white_images: white/*.png"));
  const double corrected = distance(detect("corrected"));
  RecordProperty("shaded_px", std::to_string(shaded));
  RecordProperty("corrected_px", std::to_string(corrected));
  EXPECT_FALSE(fs::exists(Path("shaded/vignetting_cam0.tiff")));
  EXPECT_TRUE(fs::exists(Path("corrected/vignetting_cam0.tiff")));
  EXPECT_LT(corrected, 0.01);
  EXPECT_LT(corrected, shaded / 3);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
