// SPDX-License-Identifier: Apache-2.0
//
// From images to a calibration without a session file: calibrate with images, init; and what a
// session may hold beside paths.
#include <fmt/format.h>

#include <regex>

#include "tests/apps/chessboard_images.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr const char* kWord = "chessboard:8x5:30mm";

class OneCommand : public Workspace {
 protected:
  void Save(const std::string& name, const cv::Mat& image) const {
    std::filesystem::create_directories(Path(name).parent_path());
    ASSERT_TRUE(cv::imwrite(Path(name).string(), image));
  }
  void SaveViews(const std::string& names, int count = kImages) const {
    for (int i = 0; i < count; ++i) Save(fmt::format(fmt::runtime(names), i), ChessboardView(i));
  }
  /// The session that was written gives the same calibration again.
  void ExpectSameAgain() const {
    const Outcome again = Run({"calibrate", "out/session.yaml", "-o", "again", "--no-report"});
    ASSERT_EQ(again.status, kDone) << again.err;
    EXPECT_EQ(Read("again/poses.csv"), Read("out/poses.csv"));
    EXPECT_EQ(Read("again/target.yaml"), Read("out/target.yaml"));
  }
};

TEST_F(OneCommand, CalibratesImagesOfAGlob) {
  SaveViews("images/{:02}.png");
  const Outcome outcome =
      Run({"calibrate", "images/*.png", "--target", kWord, "-o", "out", "--no-report"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("Camera model: "), HasSubstr("Target: ")));
  const YAML::Node camera = Result()["cameras"]["cam"];
  EXPECT_NEAR(camera["parameters"]["f_x"].as<double>(), kFocal, 5);
  EXPECT_THAT(Read("out/session.yaml"), HasSubstr("images: ../images/*.png"));
  EXPECT_EQ(Result()["provenance"]["session_text"].as<std::string>(), Read("out/session.yaml"));
  ExpectSameAgain();
}

TEST_F(OneCommand, TakesFilesFoldersAndUpperCaseExtensions) {
  SaveViews("images/IMG_{:04}.PNG");
  for (const std::vector<std::string>& images : {std::vector<std::string>{"images"},
                                                 {"images/IMG_0000.PNG",
                                                  "images/IMG_0002.PNG",
                                                  "images/IMG_0003.PNG",
                                                  "images/IMG_0005.PNG"}}) {
    std::vector<std::string> arguments{"calibrate"};
    arguments.insert(arguments.end(), images.begin(), images.end());
    arguments.insert(arguments.end(),
                     {"--target", kWord, "--model", "pinhole", "-o", "out", "--no-report"});
    const Outcome outcome = Run(arguments);
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
    EXPECT_EQ(Result()["frames"].as<int>(), images.size() == 1 ? kImages : 4);
    EXPECT_EQ(Result()["cameras"]["cam"]["model"].as<std::string>(), "pinhole");
    ExpectSameAgain();
  }
}

TEST_F(OneCommand, MakesARigOfTwoGlobsOrOfAFolder) {
  SaveViews("images/left{:02}.png");
  SaveViews("images/right{:02}.png");
  for (const std::vector<std::string>& images :
       {std::vector<std::string>{"images/left*.png", "--right", "images/right*.png"},
        {"images"},
        {"--camera", "left=images/left*.png", "--camera", "right=images/right*.png"}}) {
    std::vector<std::string> arguments{"calibrate"};
    arguments.insert(arguments.end(), images.begin(), images.end());
    arguments.insert(arguments.end(),
                     {"--target", kWord, "--model", "pinhole", "-o", "out", "--no-report"});
    const Outcome outcome = Run(arguments);
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
    EXPECT_EQ(Result()["frames"].as<int>(), kImages);
    const YAML::Node cameras = Result()["cameras"];
    ASSERT_EQ(cameras.size(), 2U);
    EXPECT_NEAR(cameras["right"]["xi_camera_rig"][0].as<double>(), 0, 1e-5);
  }
}

TEST_F(OneCommand, SharesFramesOfFoldersWithOtherBeginnings) {
  SaveViews("l/left_{:02}.png");
  SaveViews("r/right_{:02}.png");
  const Outcome outcome = Run({"calibrate",
                               "l",
                               "--right",
                               "r",
                               "--target",
                               kWord,
                               "--model",
                               "pinhole",
                               "-o",
                               "out",
                               "--no-report"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_EQ(Result()["frames"].as<int>(), kImages);
  EXPECT_THAT(Read("out/session.yaml"), HasSubstr("images: ../l/left_*.png"));
  ExpectSameAgain();
}

TEST_F(OneCommand, UsesAPlainModelForFewFrames) {
  SaveViews("images/{:02}.png", 3);
  const Outcome outcome =
      Run({"calibrate", "images", "--target", kWord, "-o", "out", "--no-report"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(
      outcome.out,
      HasSubstr("3 frames are too few to choose by: camera model pinhole-radtan and a rigid "
                "target taken"));
}

TEST_F(OneCommand, CalibratesABoardOfUnknownSizeInSquares) {
  SaveViews("images/{:02}.png");
  const auto calibrate = [&](const std::string& word) {
    const Outcome outcome =
        Run({"calibrate", "images", "--target", word, "-o", "out", "--no-report"});
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    return outcome.out;
  };
  EXPECT_THAT(calibrate(kWord), Not(HasSubstr("unknown")));
  const YAML::Node known = Result();
  EXPECT_THAT(calibrate("chessboard:8x5:unknown"),
              HasSubstr("All lengths are in units of the target's 'square', which is unknown"));
  const YAML::Node unknown = Result();
  EXPECT_NEAR(known["cameras"]["cam"]["parameters"]["f_x"].as<double>(),
              unknown["cameras"]["cam"]["parameters"]["f_x"].as<double>(),
              1e-3);
  EXPECT_EQ(known["verdict"]["grade"].as<std::string>(),
            unknown["verdict"]["grade"].as<std::string>());
}

TEST_F(OneCommand, TriesDetectsAndChecksImagesToo) {
  SaveViews("images/{:02}.png");
  ASSERT_EQ(Run({"calibrate", "images", "--target", kWord, "-o", "out", "--no-report"}).status,
            kDone);
  const Outcome tried = Run(
      {"try", "images", "--target", kWord, "-o", "tried", "--models", "pinhole,pinhole-radtan"});
  EXPECT_EQ(tried.status, kDone) << tried.err;
  EXPECT_THAT(tried.out, HasSubstr("recommended: "));
  const Outcome detected = Run({"detect", "images", "--target", kWord, "-o", "detected"});
  EXPECT_EQ(detected.status, kDone) << detected.err;
  EXPECT_THAT(detected.out, HasSubstr("cam: 8 frames, 320 points"));
  const Outcome checked =
      Run({"compare", "out/calibration.yaml", "--check", "images", "--target", kWord});
  EXPECT_EQ(checked.status, kDone) << checked.err;
  EXPECT_EQ(Run({"try", "session.yaml", "--target", kWord, "-o", "tried"}).status, kWrongInput);
}

TEST_F(OneCommand, ProposesTheTarget) {
  SaveViews("images/{:02}.png");
  Save("images/empty.png", cv::Mat(480, 640, CV_8UC1, cv::Scalar(128)));
  const Outcome outcome = Run({"calibrate", "images/*.png", "-o", "out"});
  EXPECT_EQ(outcome.status, kWrongInput);
  EXPECT_THAT(outcome.err,
              HasSubstr("chessboard with 8 x 5 inner corners in 8 of 9 images; state the square: "
                        "--target chessboard:8x5:SIZE"));
  EXPECT_FALSE(std::filesystem::exists(Path("out")));
}

TEST_F(OneCommand, RefusesArgumentsThatDoNotFit) {
  SaveViews("images/{:02}.png", 2);
  Write("session.yaml", "plenocal: 1\n");
  const auto expect = [&](const std::vector<std::string>& arguments, const std::string& part) {
    std::vector<std::string> all{"calibrate"};
    all.insert(all.end(), arguments.begin(), arguments.end());
    all.insert(all.end(), {"-o", "out"});
    const Outcome outcome = Run(all);
    EXPECT_EQ(outcome.status, kWrongInput) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr(part));
  };
  expect({}, "give session.yaml, or images");
  expect({"--right", "images", "--target", kWord}, "--right takes all that follows");
  expect({"session.yaml", "--target", kWord}, "go with images");
  expect({"images/*.jpg", "--target", kWord}, "no file matches 'images/*.jpg'");
  expect({"nowhere", "--target", kWord}, "nowhere: no such file or folder");
  expect({"images", "--target", "board.yaml"}, "board.yaml: no such file");
  expect({"images", "--target", "chessboard:8x5:30"}, "30 m? if millimetres are meant");
  expect({"images", "--target", kWord, "--model", "pinholee"}, "did you mean 'pinhole'");
  expect({"images", "--target", kWord, "--model", "focused-plenoptic"}, "plenocal init");
  expect({"images", "--camera", "a=images", "--target", kWord}, "--camera");
  Write("out/session.yaml", "plenocal: 1\n");
  expect({"images", "--target", kWord}, "give another folder with -o");
  EXPECT_EQ(Read("out/session.yaml"), "plenocal: 1\n");
}

class SessionContent : public Images {
 protected:
  void WriteSessionWith(const std::string& target,
                        const std::string& images,
                        const std::string& more = "") const {
    Write(
        "session.yaml",
        fmt::format("plenocal: 1\ntarget: {}\ncameras: {{cam: {{model: pinhole, images: {}}}}}\n{}",
                    target,
                    images,
                    more));
  }
};

TEST_F(SessionContent, MayHoldTheTarget) {
  WriteSessionWith("target.yaml", "images/*.png");
  Calibrate();
  const std::string poses = Read("out/poses.csv");
  for (const char* target : {"{type: chessboard, columns: 8, rows: 5, square: 30 mm}",
                             "chessboard:8x5:30mm",
                             "{target_type: checkerboard, targetCols: 8, targetRows: 5, "
                             "rowSpacingMeters: 3 cm, colSpacingMeters: 0.03}"}) {
    WriteSessionWith(target, "images/*.png");
    Calibrate();
    EXPECT_EQ(Read("out/poses.csv"), poses) << target;
    EXPECT_THAT(Read("out/target.yaml"), HasSubstr("plenocal: 1\ntype: chessboard\n"));
  }
}

TEST_F(SessionContent, MayNameImagesByFolderOrList) {
  for (const char* images : {"images", "[images/00.png, images/01.png, 'images/0[2-7].png']"}) {
    WriteSessionWith("target.yaml", images);
    Calibrate();
    EXPECT_EQ(Result()["frames"].as<int>(), kImages) << images;
  }
}

TEST_F(SessionContent, MayExcludeWithAReason) {
  WriteSessionWith("target.yaml",
                   "images/*.png",
                   "exclude:\n  - {frame: '03', note: blurred}\n  - {markers: [7]}\n"
                   "  - {camera: cam, frame: '0[45]', markers: [1, 2], note: glare}\n"
                   "  - {frame: nowhere}\n");
  const Outcome outcome = Calibrate();
  EXPECT_EQ(Result()["frames"].as<int>(), kImages - 1);
  const Table residuals(Read("out/residuals.csv"));
  EXPECT_EQ(residuals.Rows(), static_cast<std::size_t>((kImages - 1) * (kColumns * kRows - 1) - 4));
  EXPECT_THAT(outcome.err, HasSubstr("left out images/03.png: excluded by the session: blurred"));
  EXPECT_THAT(outcome.err,
              HasSubstr("left out 7 times in 7 images, the first images/00.png marker 7"));
  EXPECT_THAT(outcome.err, HasSubstr("exclude[3] (frame: nowhere) leaves out nothing"));
  const Table left_out(Read("out/left_out.csv"));
  EXPECT_EQ(left_out.Rows(), 1U + 7U + 4U);
  EXPECT_EQ(left_out.Column("camera")[0], "cam");
  EXPECT_EQ(left_out.Column("frame")[0], "03");
}

TEST_F(SessionContent, OfAnotherBoardNamesTheOneInTheImages) {
  WriteSessionWith("chessboard:7x4:30mm", "images/*.png");
  const Outcome outcome = Run({"calibrate", "session.yaml", "-o", "out"});
  EXPECT_EQ(outcome.status, kJobFailed);
  EXPECT_THAT(Lines(outcome.err).back(),
              HasSubstr("all 8 images show 8 x 5 inner corners: set columns: 8, rows: 5"));
  EXPECT_THAT(outcome.err, HasSubstr("left out 8 images, the first "));
  WriteSessionWith("charuco:7x4:30mm:20mm:4X4_50", "images/*.png");
  EXPECT_THAT(Run({"calibrate", "session.yaml", "-o", "out"}).err,
              HasSubstr("set type: chessboard, columns: 8, rows: 5"));
}

class Init : public OneCommand {};

TEST_F(Init, LeavesTheSameChoiceAsImagesWithoutASession) {
  SaveViews("set/{:02}.png");
  ASSERT_EQ(Run({"init", "set", "-o", "session.yaml"}).status, kDone);
  EXPECT_THAT(Read("session.yaml"), Not(HasSubstr("on one rig")));
  Write("target.yaml",
        std::regex_replace(Read("target.yaml"), std::regex("square:.*"), "square: 30 mm"));
  const Outcome session = Run({"calibrate", "session.yaml", "-o", "a", "--no-report"});
  ASSERT_EQ(session.status, kDone) << session.err;
  ASSERT_EQ(Run({"calibrate", "set", "--target", kWord, "-o", "b", "--no-report"}).status, kDone);
  EXPECT_EQ(Read("a/poses.csv"), Read("b/poses.csv"));
  EXPECT_THAT(session.out,
              HasSubstr("To keep this choice, state it in the session: cam: {model: " +
                        Result("a")["cameras"]["cam"]["model"].as<std::string>() +
                        "}, refine_target: false."));
}

TEST_F(Init, FindsPairsAndTarget) {
  SaveViews("set/left{:02}.png");
  SaveViews("set/right{:02}.png");
  const Outcome outcome = Run({"init", "set", "-o", "session.yaml"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out,
              AllOf(HasSubstr("left: 8 images"),
                    HasSubstr("right: 8 images"),
                    HasSubstr("8 frames that all cameras have"),
                    HasSubstr("chessboard with 8 x 5 inner corners in all 16 images"),
                    HasSubstr("state square")));
  EXPECT_THAT(Read("session.yaml"), HasSubstr("cameras:  # on one rig; the first is its master"));
  // What is to be stated is asked for; then the session runs.
  const Outcome early = Run({"calibrate", "session.yaml", "-o", "out"});
  EXPECT_EQ(early.status, kWrongInput);
  EXPECT_THAT(early.err, AllOf(HasSubstr("target.yaml:"), HasSubstr("square")));
  Write("target.yaml", Replaced(Read("target.yaml"), "square:", "square: 30 mm"));
  const Outcome done = Run({"calibrate", "session.yaml", "-o", "out", "--no-report"});
  ASSERT_EQ(done.status, kDone) << done.err;
  EXPECT_EQ(Result()["cameras"].size(), 2U);
  EXPECT_EQ(Result()["frames"].as<int>(), kImages);
  // Nothing of the user's is replaced.
  EXPECT_EQ(Run({"init", "set", "-o", "session.yaml"}).status, kWrongInput);
}

TEST_F(Init, FindsSubfoldersWhiteImagesAndNumberingSchemes) {
  SaveViews("set/cam_a/data/frame-{}.jpg", 3);
  SaveViews("set/cam_b/data/frame-{}.jpg", 3);
  Save("set/cam_a_white/0.png", cv::Mat(480, 640, CV_8UC1, cv::Scalar(200)));
  ASSERT_EQ(Run({"init", "set", "-o", "one.yaml"}).status, kDone);
  const std::string one = Read("one.yaml");
  EXPECT_THAT(one,
              AllOf(HasSubstr("  cam_a:"), HasSubstr("  cam_b:"), HasSubstr("one_target.yaml")));
  EXPECT_THAT(one, Not(HasSubstr("focused-plenoptic")));

  SaveViews("numbers/{:03}_cam0.png", 3);
  SaveViews("numbers/{:03}_cam1.png", 3);
  ASSERT_EQ(Run({"init", "numbers", "-o", "two.yaml"}).status, kDone);
  EXPECT_THAT(Read("two.yaml"),
              AllOf(HasSubstr("  cam0:"), HasSubstr("images: numbers/*_cam1.png")));

  // Times in names are no cameras.
  for (const char* time : {"10-01-05", "10-01-47", "10-02-13", "10-03-01"}) {
    Save(fmt::format("times/2026-11-22_{}.png", time), ChessboardView(1));
  }
  ASSERT_EQ(Run({"init", "times", "-o", "three.yaml"}).status, kDone);
  EXPECT_THAT(Read("three.yaml"), HasSubstr("  cam:  # 4 images"));
}

TEST_F(Init, SaysWhatIsMissing) {
  std::filesystem::create_directory(Path("empty"));
  EXPECT_THAT(Run({"init", "empty"}).err, HasSubstr("no images"));
  EXPECT_THAT(Run({"init", "nowhere"}).err, HasSubstr("no such folder"));
  EXPECT_EQ(Run({"init", "empty"}).status, kWrongInput);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
