// SPDX-License-Identifier: Apache-2.0
//
// report.html: what it says against calibration.yaml, and that a browser draws all of it.
#include "apps/report/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <nlohmann/json.hpp>
#include <random>
#include <regex>

#include "apps/report/page_text.h"
#include "calib/camera/marker_id.h"
#include "engine/session/calibration_folder.h"
#include "models/registry.h"
#include "tests/apps/calibration_schema.h"
#include "tests/apps/chessboard_images.h"
#include "tests/digest.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;
using Json = nlohmann::json;
namespace fs = std::filesystem;

/// Whether the build has put the components of web/ into the pages.
constexpr bool kHasScript = PLENOCAL_WEB;

/// The data in a page.
Json DataIn(const std::string& page) {
  const std::string open = R"(<script type="application/json" id="report-data">)";
  const size_t begin = page.find(open);
  EXPECT_NE(begin, std::string::npos);
  if (begin == std::string::npos) return {};
  const size_t end = page.find("</script>", begin);
  return Json::parse(page.substr(begin + open.size(), end - begin - open.size()));
}

std::string Base64Decoded(const std::string& text) {
  const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string decoded;
  unsigned bits = 0;
  int count = 0;
  for (const char c : text) {
    const size_t digit = digits.find(c);
    if (digit == std::string::npos) break;
    bits = (bits << 6 | static_cast<unsigned>(digit)) & 0xffffff;
    if ((count += 6) >= 8) decoded += static_cast<char>(bits >> (count -= 8) & 0xff);
  }
  return decoded;
}

class Report : public Workspace {
 protected:
  /// The example's rig of two ordinary cameras and a plenoptic one, as points, calibrated into out.
  void CalibrateExample() const {
    const fs::path examples = fs::path(PLENOCAL_EXAMPLES) / "simulate";
    fs::copy(examples / "target.yaml", Path("target.yaml"));
    fs::copy(examples / "plenoptic_stereo.yaml", Path("spec.yaml"));
    ASSERT_EQ(Run({"simulate", "spec.yaml", "-o", "set", "--points"}).status, kDone);
    const Outcome outcome = Run({"calibrate", "set/session.yaml", "-o", "out"});
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
  }

  [[nodiscard]] Json Data() const { return DataIn(Read("out/report.html")); }

  /// What each finding of the verdict says.
  [[nodiscard]] std::vector<std::string> Findings() const {
    std::vector<std::string> findings;
    const Json data = Data();
    for (const Json& finding : data["verdict"]["findings"]) {
      if (finding["code"] != "projection") findings.push_back(finding["what"]);
    }
    return findings;
  }
};

// 12 digits stand in the file.
void ExpectSame(const Json& shown, const YAML::Node& written) {
  const double value = written.as<double>();
  if (std::isinf(value)) {
    EXPECT_TRUE(shown.is_null());
  } else {
    EXPECT_NEAR(shown.get<double>(), value, 1e-11 * std::abs(value));
  }
}

// Pages made from memory and from files differ by how numbers are rounded in the files, and by
// nothing else.
void ExpectSamePage(const std::string& a, const std::string& b) {
  constexpr double kRounding = 2e-3, kSmallest = 1e-5;  // residuals have five decimals in the files
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  const char *x = a.c_str(), *y = b.c_str();
  int numbers = 0;
  while (*x != '\0' && *y != '\0') {
    if (is_digit(*x) && is_digit(*y)) {
      char *x_end = nullptr, *y_end = nullptr;
      const double u = std::strtod(x, &x_end), v = std::strtod(y, &y_end);
      ASSERT_NEAR(u, v, kRounding * std::max(u, kSmallest)) << std::string(x, 60);
      x = x_end;
      y = y_end;
      ++numbers;
    } else {
      ASSERT_EQ(*x, *y) << std::string(x, std::min<size_t>(60, std::strlen(x)));
      ++x;
      ++y;
    }
  }
  EXPECT_EQ(*x, *y);
  EXPECT_GT(numbers, 1000);
}

TEST_F(Report, HoldsTheFiguresOfTheCalibration) {
  CalibrateExample();
  const Json data = Data();
  const YAML::Node result = Result();
  ASSERT_EQ(data["cameras"].size(), 3u);
  EXPECT_THAT(CalibrationSchema(PLENOCAL_DOCS).Violations(data, "Report"), ::testing::IsEmpty());
  for (const Json& camera : data["cameras"]) {
    const YAML::Node written = result["cameras"][camera["name"].get<std::string>()];
    EXPECT_EQ(camera["model"], written["model"].Scalar());
    ASSERT_EQ(camera["units"].size(), written["parameters"].size());
    for (const Json& unit : camera["units"]) {
      const std::string name = unit[0];
      ExpectSame(camera["parameters"][name], written["parameters"][name]);
      ExpectSame(camera["sigma"][name], written["sigma"][name]);
    }
    EXPECT_EQ(camera["extrinsics"].size(), camera["index"] == 0 ? 0u : 8u);
    for (const char* key : {"points", "rejected", "views", "rms", "noise", "detector_sigma"}) {
      ExpectSame(camera[key], written["residuals"][key]);
    }
    // Every section of the page has data.
    const Json& plots = camera["plots"];
    const int points = written["residuals"]["points"].as<int>();
    EXPECT_EQ(plots["histogram"]["coordinates"], 2 * points);
    for (const char* group : {"frames", "markers", "field"}) {
      int sum = 0;
      for (const Json& count : plots[group]["points"]) sum += count.get<int>();
      EXPECT_EQ(sum, points) << group;
    }
    ASSERT_EQ(camera["projection"].size(), 4u);
  }
  EXPECT_EQ(data["poses"].size(), result["frames"].as<size_t>());
  EXPECT_EQ(data["correlation"]["names"].size(), 23u + 12u);
  const Json& markers = data["markers"];
  EXPECT_GT(std::count_if(
                markers.begin(), markers.end(), [](const Json& m) { return m.contains("moved"); }),
            100);
  EXPECT_THAT(Findings(), Not(Contains(HasSubstr("only in"))));
  EXPECT_NE(data["verdict"]["grade"], "bad") << data["verdict"];
  EXPECT_THAT(Read("out/report.html"),
              HasSubstr(kHasScript ? "default-src 'none'; script-src 'sha256-"
                                   : "default-src 'none'; style-src"));
  EXPECT_THAT(Read("out/report.html"), Not(HasSubstr("src=\"http")));
  Json same = data;
  same.erase("provenance");
  Digest digest;
  digest.AddNumbersOf(same.dump());
  EXPECT_NEAR(digest.Sum(), -159.9742, 5e-3);
}

// Two cameras, two targets, four frames: the first camera sees both targets in the frames 0 and 1,
// the second one the second target in 1 and 2, and the first target in 3 by rejected points alone.
TEST(ReportOfARecord, CountsTheFramesInWhichCamerasSeeTargets) {
  CalibrationRecord record;
  for (const char* name : {"floor", "wall"}) record.targets.emplace_back().name = name;
  for (int f = 0; f < 4; ++f) {
    record.frames.push_back({fmt::format("f{}", f), {Eigen::Matrix3d::Identity(), {0, 0, -2}}});
  }
  for (const size_t target : {size_t{0}, size_t{1}}) {
    for (int k = 0; k < 4; ++k) {
      record.markers[MarkerId{target, k}.Number()].position = {0.1 * k, 0.1 * (k % 2), 0};
    }
  }
  const auto see = [&](size_t c, size_t target, int frame, bool used) {
    for (int k = 0; k < 4; ++k) {
      record.cameras[c].residuals.push_back({.frame = frame,
                                             .marker = MarkerId{target, k}.Number(),
                                             .values = {320.0 + 25 * k, 240},
                                             .residual = {0.1, 0},
                                             .used = used});
    }
  };
  for (const char* name : {"left", "right"}) {
    CalibratedCamera& camera = record.cameras.emplace_back();
    camera.name = name;
    camera.model = FindModel(CameraModels(), "pinhole");
    camera.image_size = {640, 480};
    camera.params = {500, 500, 320, 240};
    camera.covariance = Eigen::Matrix4d::Zero();
  }
  for (const int frame : {0, 1}) {
    for (const size_t target : {size_t{0}, size_t{1}}) see(0, target, frame, true);
  }
  for (const int frame : {1, 2}) see(1, 1, frame, true);
  see(1, 0, 3, false);
  const Json sightings = DataIn(ReportHtml(record, {}))["sightings"];
  EXPECT_EQ(sightings["targets"], Json({"floor", "wall"}));
  EXPECT_EQ(sightings["seen"], Json::parse("[[2, 2], [0, 2]]"));
  EXPECT_EQ(sightings["common"], Json::parse("[[2, 1], [1, 2]]"));
}

TEST_F(Report, IsWrittenAgainFromTheFilesAlone) {
  WriteProblem(EasyProblem(2, 2e-4));
  Calibrate();
  const std::string page = Read("out/report.html");
  fs::rename(Path("out"), Path("elsewhere"));
  fs::remove(Path("elsewhere/report.html"));
  fs::remove(Path("session.yaml"));
  fs::remove(Path("target.yaml"));
  const Outcome outcome = Run({"report", "elsewhere"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  ExpectSamePage(Read("elsewhere/report.html"), page);
}

TEST_F(Report, CanBeLeftOut) {
  WriteProblem(EasyProblem());
  ASSERT_EQ(Run({"calibrate", "session.yaml", "-o", "out", "--no-report"}).status, kDone);
  EXPECT_FALSE(fs::exists(Path("out/report.html")));
  EXPECT_TRUE(fs::exists(Path("out/residuals.csv")));
}

TEST_F(Report, OfAnEarlierRunDoesNotStayBesideNewResults) {
  WriteProblem(EasyProblem());
  Calibrate();
  ASSERT_TRUE(fs::exists(Path("out/report.html")));
  Write("broken.yaml", Replaced(Read("session.yaml"), "target.yaml", "missing.yaml"));
  ASSERT_EQ(Run({"calibrate", "broken.yaml", "-o", "out", "--no-report"}).status, kWrongInput);
  EXPECT_TRUE(fs::exists(Path("out/report.html"))) << "it belongs to the results that stay";
  ASSERT_EQ(Run({"calibrate", "session.yaml", "-o", "out", "--no-report"}).status, kDone);
  EXPECT_FALSE(fs::exists(Path("out/report.html")));
  EXPECT_TRUE(fs::exists(Path("out/calibration.yaml")));
}

class ReportOfImages : public Images {};

TEST_F(ReportOfImages, ShowsTheFrameWithMostMarkersFromTheFilesAlone) {
  Save("images/00.png", cv::Mat(480, 640, CV_8UC1, cv::Scalar(200)));
  Calibrate();
  const std::string page = Read("out/report.html");
  const Json sample = DataIn(page)["cameras"]["cam0"]["sample"];
  EXPECT_EQ(sample["frame"], "01");
  const std::string source = sample["pictures"]["picture"];
  const std::string head = "data:image/jpeg;base64,";
  ASSERT_TRUE(source.starts_with(head));
  const std::string jpeg = Base64Decoded(source.substr(head.size()));
  EXPECT_TRUE(jpeg == Read("out/sample_cam0.jpg"));
  const cv::Mat picture = cv::imread(Path("out/sample_cam0.jpg").string(), cv::IMREAD_COLOR);
  ASSERT_EQ(picture.size(), cv::Size(640, 480));
  cv::Mat green;
  cv::inRange(picture, cv::Scalar(0, 150, 0), cv::Scalar(120, 255, 120), green);
  EXPECT_GT(cv::countNonZero(green), kColumns * kRows * 5);

  for (int i = 0; i < kImages; ++i) fs::remove(Path(fmt::format("images/{:02}.png", i)));
  ASSERT_EQ(Run({"report", "out"}).status, kDone);
  EXPECT_TRUE(Read("out/report.html") == page);
  fs::remove(Path("out/sample_cam0.jpg"));
  ASSERT_EQ(Run({"report", "out"}).status, kDone);
  EXPECT_TRUE(DataIn(Read("out/report.html"))["cameras"]["cam0"]["sample"]["pictures"].empty());
}

// 1000 frames of two cameras stay far below 25 MB (bench/speed/report_page.js): beyond the points
// that are drawn singly a frame adds its pose and its bars.
TEST_F(Report, StaysSmallWithManyFrames) {
  const fs::path examples = fs::path(PLENOCAL_EXAMPLES) / "simulate";
  fs::copy(examples / "board.yaml", Path("board.yaml"));
  fs::copy(examples / "one_camera.yaml", Path("one_camera.yaml"));
  std::map<int, size_t> bytes;
  for (const int frames : {100, 300}) {
    Write("spec.yaml",
          Replaced(Read("one_camera.yaml"), "frames: 30", fmt::format("frames: {}", frames)));
    ASSERT_EQ(Run({"simulate", "spec.yaml", "-o", "set", "--points"}).status, kDone);
    ASSERT_EQ(Run({"calibrate", "set/session.yaml", "-o", "out"}).status, kDone);
    bytes[frames] = Read("out/report.html").size();
    const Json sample = (*Data()["cameras"].begin())["plots"]["sample"];
    EXPECT_GT(sample["all"].get<int>(), 100 * frames);
    EXPECT_LE(sample["x"].size(), 6000u);
  }
  EXPECT_LT(bytes[100], 1'000'000u);
  EXPECT_LT((bytes[300] - bytes[100]) / 200, 600u) << "bytes a frame";
}

// White images of an ordinary camera give its vignetting, to the result and to the page.
TEST_F(ReportOfImages, ShowsTheVignettingOfAnOrdinaryCamera) {
  cv::Mat white(480, 640, CV_8UC1);
  for (int y = 0; y < white.rows; ++y) {
    for (int x = 0; x < white.cols; ++x) {
      white.at<unsigned char>(y, x) = cv::saturate_cast<unsigned char>(240 - 120 * x / 640.);
    }
  }
  Save("white/0.png", white);
  Write("session.yaml", Read("session.yaml") + "    white_images: white/*.png\n");
  Calibrate();
  EXPECT_EQ(Result()["cameras"]["cam0"]["vignetting"].Scalar(), "vignetting_cam0.tiff");
  const Json vignetting = DataIn(Read("out/report.html"))["cameras"]["cam0"]["vignetting"];
  const Json row = vignetting["row"]["values"];
  ASSERT_EQ(row.size(), 640u);
  EXPECT_NEAR(row[320].get<double>(), 180 / 240., 0.01);
  EXPECT_NEAR(
      vignetting["values"][vignetting["columns"].get<size_t>() - 1].get<double>(), 0.5, 0.03);
  EXPECT_FALSE(vignetting.contains("detail"));
}

TEST_F(Report, SaysWhatIsMissingOrDamaged) {
  WriteProblem(EasyProblem());
  Calibrate();
  const auto expect = [&](const std::string& folder, const std::vector<std::string>& parts) {
    const Outcome outcome = Run({"report", folder});
    EXPECT_EQ(outcome.status, kWrongInput);
    EXPECT_EQ(Lines(outcome.err).size(), 1u) << outcome.err;
    for (const std::string& part : parts) EXPECT_THAT(outcome.err, HasSubstr(part));
  };
  expect("nowhere", {"nowhere", "no folder"});
  const std::string poses = Read("out/poses.csv"), residuals = Read("out/residuals.csv");
  fs::remove(Path("out/poses.csv"));
  expect("out", {"out/poses.csv", "no such file"});
  Write("out/poses.csv", poses);
  Write("out/residuals.csv", residuals + "cam0,no such frame,1,1,1,1,1,1,1\n");
  expect("out", {"out/residuals.csv:", "no such frame"});
  Write("out/residuals.csv", residuals.substr(0, residuals.size() - 16));
  expect("out", {"out/residuals.csv:", "columns"});
}

TEST_F(Report, EscapesWhatUsersWrite) {
  const std::string evil = "</script><script>alert(1)</script>";
  WriteProblem(EasyProblem());
  Write("session.yaml", Read("session.yaml") + "# " + evil + " \"quoted\" \\ \n");
  Calibrate();
  EXPECT_THAT(Read("out/report.html"), Not(HasSubstr("alert(1)</script>")));
  std::map<std::string, std::string> provenance;
  const Json data = Data();
  for (const Json& pair : data["provenance"]) provenance[pair[0]] = pair[1];
  EXPECT_EQ(provenance["session_text"], Read("session.yaml"));
  EXPECT_EQ(provenance["target_text"], Read("target.yaml"));
  EXPECT_TRUE(fs::equivalent(provenance["folder"], Path(""))) << provenance["folder"];
}

// A board at one distance, parallel to the image, in one corner of it.
TEST_F(Report, NamesWhatABadPoseSetLacks) {
  SyntheticProblem problem = EasyProblem();
  CameraInput& camera = problem.input.cameras[0];
  camera.views.clear();
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 0.1);
  std::uniform_real_distribution<double> shift(-0.01, 0.01), turn(-0.02, 0.02);
  for (int frame = 0; frame < 12; ++frame) {
    RigidTransform T;
    T.R = ExpRotation({turn(random), turn(random), 20 * turn(random)});
    Eigen::Vector3d middle(0, 0, 0);
    for (const auto& [number, place] : problem.input.markers) middle += place;
    middle /= static_cast<double>(problem.input.markers.size());
    // In the upper left quarter, smaller than it.
    T.t = Eigen::Vector3d(-0.28, -0.2, 1) + 0.5 * Eigen::Vector3d(shift(random), shift(random), 0) -
          T.R * middle;
    View view{fmt::format("{:02}", frame), {}};
    for (const auto& [number, place] : problem.input.markers) {
      Observation seen{.marker = number, .values = {}, .detector_sigma = 0.1};
      if (!camera.model->Project(problem.params[0].data(),
                                 nullptr,
                                 seen.values.data(),
                                 T * place,
                                 seen.values.data())) {
        continue;
      }
      seen.values[0] += noise(random);
      seen.values[1] += noise(random);
      const bool inside = seen.values[0] > 0 && seen.values[1] > 0;
      if (inside) view.observations.push_back(seen);
    }
    camera.views.push_back(view);
  }
  WriteProblem(problem);
  const Outcome outcome = Run({"calibrate", "session.yaml", "-o", "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_EQ(Data()["verdict"]["grade"], "bad");
  const std::vector<std::string> findings = Findings();
  EXPECT_THAT(findings, Contains(HasSubstr("only in the upper left corner of the image")));
  EXPECT_THAT(findings, Contains(HasSubstr("all images are from one distance")));
  EXPECT_THAT(findings, Contains(HasSubstr("the target was not tilted")));
}

TEST_F(Report, NamesEachThingThatASimulatedPoseSetLacks) {
  const fs::path examples = fs::path(PLENOCAL_EXAMPLES) / "simulate";
  fs::copy(examples / "board.yaml", Path("board.yaml"));
  fs::copy(examples / "one_camera.yaml", Path("one_camera.yaml"));
  const std::map<std::string, std::string> sayings{
      {"one-distance", "all images are from one distance"},
      {"no-tilt", "the target was not tilted"},
      {"corner", "only in the upper left corner of the image"}};
  const auto expect = [&](const std::string& kinds) {
    const std::string spec = Replaced(Read("one_camera.yaml"), "frames: 30", "frames: 14");
    Write("spec.yaml", Replaced(spec, "varied", kinds));
    ASSERT_EQ(Run({"simulate", "spec.yaml", "-o", "set", "--points"}).status, kDone);
    ASSERT_EQ(Run({"calibrate", "set/session.yaml", "-o", "out"}).status, kDone);
    for (const auto& [kind, saying] : sayings) {
      const auto named = Contains(HasSubstr(saying));
      if (kinds.find(kind) != std::string::npos) {
        EXPECT_THAT(Findings(), named) << kinds;
      } else {
        EXPECT_THAT(Findings(), Not(named)) << kinds;
      }
    }
  };
  for (const auto& [kind, saying] : sayings) expect(kind);
  expect("[one-distance, no-tilt, corner]");
  EXPECT_EQ(Data()["verdict"]["grade"], "bad");
  expect("varied");
  EXPECT_THAT(Findings(), ::testing::IsEmpty());
}

// A target in space shows depth and tilt in each image, so the same poses are no weakness.
TEST_F(Report, NamesOneDistanceAndNoTiltOfATargetInSpace) {
  const fs::path examples = fs::path(PLENOCAL_EXAMPLES) / "simulate";
  fs::copy(examples / "target.yaml", Path("target.yaml"));
  const std::string spec = Read(examples / "plenoptic_stereo.yaml");
  Write("spec.yaml", Replaced(spec, "varied", "[one-distance, no-tilt]"));
  ASSERT_EQ(Run({"simulate", "spec.yaml", "-o", "set", "--points"}).status, kDone);
  ASSERT_EQ(Run({"calibrate", "set/session.yaml", "-o", "out"}).status, kDone);
  const Json data = Data();
  int said = 0;
  for (const Json& finding : data["verdict"]["findings"]) {
    const std::string what = finding["what"];
    if (what.find("own depth") == std::string::npos) continue;
    EXPECT_NE(std::ranges::find(finding["cameras"], "plenoptic"), finding["cameras"].end());
    ++said;
    EXPECT_EQ(finding["grade"], "good") << what;
  }
  EXPECT_EQ(said, 2) << data["verdict"];
}

TEST_F(Report, DoesNotBlameTheTiltsOfAGoodSet) {
  WriteProblem(MakeProblem(4, {.frames = 40, .noise = 0.1}));
  Calibrate();
  for (const char* blame : {"tilted", "distance (", "only", "rejected", "pattern", "determined"}) {
    EXPECT_THAT(Findings(), Not(Contains(HasSubstr(blame)))) << blame;
  }
}

// The page as it stands before its data: what a reader without script has.
std::string TextOf(const std::string& page) {
  return page.substr(0, page.find("<script type=\"application/json\""));
}

TEST_F(Report, HasVerdictAndParametersWithoutScript) {
  CalibrateExample();
  const std::string text = TextOf(Read("out/report.html"));
  const Json data = Data();
  EXPECT_THAT(text, HasSubstr(HtmlText(data["headline"].get<std::string>())));
  for (const Json& finding : data["verdict"]["findings"]) {
    EXPECT_THAT(text, HasSubstr(HtmlText(finding["what"].get<std::string>())));
    EXPECT_THAT(text, HasSubstr(HtmlText(finding["remedy"].get<std::string>())));
  }
  int parameters = 0;
  for (const Json& camera : data["cameras"]) {
    EXPECT_THAT(text, HasSubstr(camera["summary"].get<std::string>()));
    for (const Json& unit : camera["units"]) {
      const std::string name = unit[0];
      const auto [value, sigma] =
          NumberWithSigma(camera["parameters"][name].get<double>(), camera["sigma"][name]);
      EXPECT_THAT(text,
                  HasSubstr(fmt::format(
                      "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td>", name, value, sigma)));
      ++parameters;
    }
  }
  EXPECT_EQ(parameters, 23);
}

TEST(PageText, WritesNumbersWithTheDigitsOfTheirSigma) {
  const auto both = [](double value, const Json& sigma) {
    const auto [text, error] = NumberWithSigma(value, sigma);
    return text + " " + error;
  };
  EXPECT_EQ(both(534.26789, 0.4187), "534.27 0.42");
  EXPECT_EQ(both(-83274.3, 1234), "-83274 1234");
  EXPECT_EQ(both(0.0000123616, 1.2e-7), "1.236e-5 1.2e-7");
  EXPECT_EQ(both(1234567.8, 0.5), "1.23456780e+6 5.0e-1");
  EXPECT_EQ(both(0.25, nullptr), "0.25 not determined");
  EXPECT_EQ(both(0.1234567891234, 0), "0.123456789 fixed");
  EXPECT_EQ(BriefNumber(12345678., 6), "12345700");
  EXPECT_EQ(BriefNumber(0.00001, 2), "0.00001");
  EXPECT_EQ(BriefNumber(1.5e-9), "1.5e-9");
  EXPECT_EQ(BriefNumber(0), "0");
  EXPECT_EQ(BriefNumber(nullptr), "–");
}

class ReportInABrowser : public Report {
 protected:
  void SetUp() override {
    Report::SetUp();
    if (!kHasScript) GTEST_SKIP() << "built with -DPLENOCAL_WEB=OFF: the page has no script";
    if (!fs::exists(kBrowser)) {
      GTEST_SKIP() << "the page is not opened: install Debian's chromium (scripts/test does)";
    }
  }

  /// The document that Chromium makes of a page. Nothing may be written to the console: neither
  /// errors nor what the page's policy refuses.
  [[nodiscard]] std::string Dom(const std::string& name, const std::string& options) const {
    const std::string command = fmt::format(
        "HOME={0} {1} --headless --no-sandbox --disable-gpu --disable-dev-shm-usage "
        "--user-data-dir={0}/browser --enable-logging=stderr {2} --dump-dom file://{0}/{3} "
        "> {0}/dom.html 2> {0}/log.txt",
        Path("").parent_path().string(),
        kBrowser,
        options,
        name);
    EXPECT_EQ(std::system(command.c_str()), 0) << Read("log.txt");
    EXPECT_THAT(Read("log.txt"), Not(HasSubstr("CONSOLE")));
    return Read("dom.html");
  }

  static constexpr const char* kBrowser = "/usr/bin/chromium";
};

// Cells of the tables of parameters, residuals and poses.
std::vector<std::string> NumbersOf(const std::string& dom) {
  const std::regex table(
      "<caption>(parameters|residuals|poses in the frame of [^<]*)</caption>([^]*?)</table>"),
      cell("<t[hd][^>]*>([^<]*)</t[hd]>");
  std::vector<std::string> cells;
  for (std::sregex_iterator it(dom.begin(), dom.end(), table), end; it != end; ++it) {
    const std::string rows = (*it)[2].str();
    for (std::sregex_iterator c(rows.begin(), rows.end(), cell); c != end; ++c) {
      cells.push_back((*c)[1].str());
    }
  }
  return cells;
}

TEST_F(ReportInABrowser, HasTheSameNumbersWithAndWithoutScript) {
  CalibrateExample();
  const std::string dom = Dom("out/report.html", "");
  EXPECT_THAT(dom, HasSubstr("<canvas"));
  const std::vector<std::string> cells = NumbersOf(dom);
  EXPECT_GT(cells.size(), 150u);
  EXPECT_EQ(cells, NumbersOf(TextOf(Read("out/report.html"))));
}

TEST_F(ReportInABrowser, ShowsHostileNamesAsText) {
  const std::string evil = "</script><img src=x onerror=alert(1)>", turned = "\u202Eevil";
  WriteProblem(EasyProblem());
  Calibrate();
  CalibrationRecord record = OpenCalibrationFolder(Path("out"));
  record.cameras[0].name = evil + turned;
  for (FrameRecord& frame : record.frames) frame.name = evil + frame.name;
  record.verdict = Verdict{Grade::kBad,
                           {Finding{.code = "evil",
                                    .grade = Grade::kBad,
                                    .what = "what" + evil + turned,
                                    .remedy = "remedy" + evil}}};
  record.left_out = {evil};
  Write("hostile.html", ReportHtml(record, {}));
  const std::string page = Read("hostile.html");
  EXPECT_THAT(page, Not(HasSubstr("<img src=x")));
  EXPECT_THAT(page, Not(HasSubstr("\u202E")));
  EXPECT_EQ(DataIn(page)["poses"][0]["name"], evil + record.frames[0].name.substr(evil.size()));
  for (const std::string& document : {TextOf(page), Dom("hostile.html", "")}) {
    const std::string body = TextOf(document);
    EXPECT_THAT(body, Not(HasSubstr("<img")));
    for (const char* before : {"what", "remedy"}) {
      EXPECT_THAT(body, HasSubstr(before + std::string("&lt;/script&gt;&lt;img src=x")));
    }
    EXPECT_THAT(body, HasSubstr("&lt;img src=x onerror=alert(1)&gt;\uFFFDevil: "));
  }
}

// Adds to a page a script that draws everything and leaves what came of it in the document. The
// page's own policy would refuse it.
std::string WithAudit(const std::string& page) {
  const size_t begin = page.find("<meta http-equiv=");
  const size_t end = page.find('>', begin) + 1;
  return page.substr(0, begin) + page.substr(end) + R"(<script>
addEventListener("load", async () => {
plenocalReport.drawAll();
for (let i = 0; i < 9; ++i) await null;  // charts draw in microtasks
const audit = { errors: plenocalReport.errors, figures: [...plenocalReport.drawings].map(({ title, count, canvas }) => {
  const { width, height } = canvas();
  const pixels = width * height === 0 ? [] : canvas().getContext("2d").getImageData(0, 0, width, height).data;
  const colours = new Set();
  for (let i = 0; i < pixels.length; i += 4) if (pixels[i + 3] > 0) colours.add((pixels[i] << 16) | (pixels[i + 1] << 8) | pixels[i + 2]);
  return { title, count, colours: colours.size };
}), values: [...document.querySelectorAll("[data-value]")].map((node) => Number(node.dataset.value)), images: [...document.images].map((image) => image.naturalWidth), sections: [...document.querySelectorAll("h2")].map((node) => node.textContent), width: document.documentElement.scrollWidth };
const node = document.createElement("pre");
node.id = "audit";
node.textContent = "AUDIT" + btoa(JSON.stringify(audit)) + "TIDUA";
document.body.append(node);
});
</script>)";
}

TEST_F(ReportInABrowser, IsDrawn) {
  CalibrateExample();
  ASSERT_TRUE(cv::imwrite(Path("out/sample_left.jpg").string(), ChessboardView(1)));
  Write("out/calibration.yaml",
        Replaced(Read("out/calibration.yaml"),
                 "  left:\n",
                 "  left:\n    sample: sample_left.jpg\n    sample_frame: '000105'\n"));
  ASSERT_EQ(Run({"report", "out"}).status, kDone);
  Write("audit.html", WithAudit(Read("out/report.html")));
  for (const int width : {1400, 500}) {
    const std::string dom = Dom("audit.html", fmt::format("--window-size={},900", width));
    const size_t begin = dom.find("AUDIT", dom.rfind("id=\"audit\"")),
                 end = dom.find("TIDUA", begin);
    ASSERT_NE(end, std::string::npos) << Read("log.txt");
    const Json audit = Json::parse(Base64Decoded(dom.substr(begin + 5, end - begin - 5)));
    EXPECT_TRUE(audit["errors"].empty()) << audit["errors"];
    EXPECT_GT(audit["figures"].size(), 30u);
    for (const Json& figure : audit["figures"]) {
      EXPECT_GT(figure["count"].get<int>(), 0) << figure["title"];
      EXPECT_GT(figure["colours"].get<int>(), 5) << figure["title"];
    }
    EXPECT_EQ(audit["sections"],
              Json({"Verdict",
                    "Parameters",
                    "Residuals",
                    "Coverage",
                    "Who saw what",
                    "In space",
                    "Markers",
                    "Correlations",
                    "Uncertainty in use",
                    "Sample images",
                    "Left out",
                    "Reproduce"}));
    EXPECT_EQ(audit["images"], Json{640});
    EXPECT_LE(audit["width"].get<int>(), width) << "the page is wider than the window";
    // The figures on the page are those of the file.
    const std::vector<double> shown = audit["values"];
    for (const auto& camera : Result()["cameras"]) {
      for (const char* key : {"parameters", "sigma"}) {
        for (const auto& value : camera.second[key]) {
          EXPECT_THAT(shown, Contains(value.second.as<double>()));
        }
      }
      for (const char* key : {"points", "rejected", "rms", "noise"}) {
        EXPECT_THAT(shown, Contains(camera.second["residuals"][key].as<double>()));
      }
    }
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
