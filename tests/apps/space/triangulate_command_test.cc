// SPDX-License-Identifier: Apache-2.0
//
// `plenocal triangulate`: points of a simulated pair lie where they are, within their standard
// errors, and what does not fit is named.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <Eigen/Core>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <tuple>
#include <vector>

#include "tests/apps/space/simulated_pair.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;

class Triangulate : public Workspace {
 protected:
  void SetUp() override {
    Workspace::SetUp();
    Write("board.yaml", kBoard);
    for (const auto& [name, seed, frames] : {std::tuple{"set", 1, 12}, {"new", 2, 2}}) {
      Write(fmt::format("{}.yaml", name), Spec(seed, frames));
      ASSERT_EQ(Run({"simulate", fmt::format("{}.yaml", name), "--points", "-o", name}).status, 0);
    }
    ASSERT_EQ(Run({"calibrate", "set/session.yaml", "-o", "result", "--no-report"}).status, 0);
  }

  [[nodiscard]] static std::string Spec(int seed, int frames) {
    return PairSpec(seed, fmt::format("frames: {}, distance: [0.4, 1.0]", frames));
  }

  // Place of a marker on the board.
  [[nodiscard]] static Eigen::Vector2d Corner(int marker) {
    constexpr double kSize = kTagSize, kPitch = kTagPitch;
    const int tag = marker / 4, k = marker % 4;
    return {kPitch * (tag % 6) + (k == 1 || k == 2 ? kSize : 0),
            kPitch * (tag / 6) + (k >= 2 ? kSize : 0)};
  }

  [[nodiscard]] Outcome Points(const std::vector<std::string>& more,
                               const std::string& calibration = "result") const {
    std::vector<std::string> words{"triangulate",
                                   calibration,
                                   "left=new/detections_left.csv",
                                   "right=new/detections_right.csv"};
    words.insert(words.end(), more.begin(), more.end());
    return Run(words);
  }
};

TEST_F(Triangulate, LengthsOfTheTargetAreTrueWithinTheirStandardErrors) {
  const Outcome outcome = Points({"--all-lengths", "-o", "points"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("left + right: "));
  const Table measures(Read("points/measures.csv"));
  ASSERT_GT(measures.Rows(), 1000U);
  const std::vector<std::string> of = measures.Column("of");
  const std::vector<double> value = measures.Numbers("value"), sigma = measures.Numbers("sigma");
  double mean = 0;
  for (size_t i = 0; i < of.size(); ++i) {
    const int first = std::stoi(of[i]), second = std::stoi(of[i].substr(of[i].find(' ')));
    const double error = value[i] - (Corner(first) - Corner(second)).norm();
    mean += error * error / (sigma[i] * sigma[i]) / static_cast<double>(of.size());
  }
  // Lengths of one calibration, and of common points, are alike.
  EXPECT_GT(mean, 0.3);
  EXPECT_LT(mean, 2.5);
  const YAML::Node summary = YAML::LoadFile(Path("points/triangulation.yaml").string());
  EXPECT_GT(summary["probability"].as<double>(), 1e-3);
  EXPECT_EQ(summary["findings"].size(), 0U);
}

TEST_F(Triangulate, TheHousingsFrameChangesErrorsOfPlacesNotOfLengths) {
  ASSERT_EQ(Points({"--all-lengths", "-o", "rig"}).status, 0);
  ASSERT_EQ(Points({"--all-lengths", "--frame", "housing", "-o", "housing"}).status, 0);
  EXPECT_NE(Read("rig/points.csv"), Read("housing/points.csv"));
  const std::vector<double> a = Table(Read("rig/measures.csv")).Numbers("sigma"),
                            b = Table(Read("housing/measures.csv")).Numbers("sigma");
  ASSERT_FALSE(a.empty());
  ASSERT_EQ(a.size(), b.size());
  for (size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(a[i], b[i], 1e-6 * a[i]);
  const Outcome alone = Points({"--frame", "housing"}, "result/calibration.yaml");
  EXPECT_EQ(alone.status, kWrongInput);
  EXPECT_THAT(alone.err, HasSubstr("give the folder"));
}

TEST_F(Triangulate, TheMarkersOfASessionsImagesAreItsPoints) {
  const std::vector<std::string> measures{
      "--length", "tag 3,tag 7 corner 2", "--length", "30,31", "--plane", "12,tag 3,tag 7,tag 20"};
  std::vector<std::string> of_session{"triangulate", "result", "new/session.yaml", "-o", "session"};
  of_session.insert(of_session.end(), measures.begin(), measures.end());
  const Outcome outcome = Run(of_session);
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  std::vector<std::string> of_tables = measures;
  of_tables.insert(of_tables.end(), {"-o", "tables"});
  ASSERT_EQ(Points(of_tables).status, 0);
  for (const char* file : {"points.csv", "shared.csv", "measures.csv", "triangulation.yaml"}) {
    EXPECT_EQ(Read(fmt::format("session/{}", file)), Read(fmt::format("tables/{}", file))) << file;
  }
  // From the middle of a tag to its neighbour's corner in the next row.
  const Table lengths(Read("session/measures.csv"));
  EXPECT_EQ(lengths.Column("of").at(0), "tag 3 tag 7 corner 2");
  constexpr double kSize = 0.055;
  const Eigen::Vector2d between(kSize / 2 - 2 * 1.3 * kSize, 1.3 * kSize + kSize / 2);
  EXPECT_NEAR(lengths.Numbers("value").at(0), between.norm(), 5 * lengths.Numbers("sigma").at(0));
}

TEST_F(Triangulate, JsonHasTheNumbersOfTheFiles) {
  const Outcome outcome =
      Points({"--json", "--length", "60,61", "--plane", "60,61,64", "-o", "files"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  const nlohmann::json json = nlohmann::json::parse(outcome.out);
  for (const std::string name : {"points", "shared", "measures"}) {
    const Table table(Read(fmt::format("files/{}.csv", name)));
    ASSERT_EQ(json.at(name).size(), table.Rows());
    ASSERT_GT(table.Rows(), 0U);
    for (const auto& [column, value] : json.at(name).at(0).items()) {
      const std::string cell = table.Column(column).at(0);
      if (value.is_number()) {
        EXPECT_EQ(value.get<double>(), std::stod(cell)) << column;
      } else {
        EXPECT_EQ(value.is_null() ? "" : value.get<std::string>(), cell) << column;
      }
    }
  }
  const YAML::Node summary = YAML::LoadFile(Path("files/triangulation.yaml").string());
  EXPECT_EQ(json.at("chi_square").get<double>(), summary["chi_square"].as<double>());
  EXPECT_EQ(json.at("cameras").size(), summary["cameras"].size());
}

// Along a ray noise that both images share moves the point less: z is by the difference of places.
TEST_F(Triangulate, CorrelatedNoiseIsLessNoiseOfTheDistance) {
  const auto sigma = [&](const char* correlation) {
    EXPECT_EQ(Points({"--correlation", correlation, "-o", "correlated"}).status, 0);
    return Table(Read("correlated/points.csv")).Numbers("sigma_z_noise").at(0);
  };
  const double none = sigma("0");
  EXPECT_NEAR(sigma("0.75"), none / 2, 0.02 * none);
  EXPECT_NEAR(sigma("-0.5"), none * std::sqrt(1.5), 0.02 * none);
}

TEST_F(Triangulate, AdjustsTheCalibrationByTheRays) {
  const Outcome outcome = Points({"--adjust", "-o", "adjusted"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("calibration adjusted: "));
  const YAML::Node adjusted =
      YAML::LoadFile(Path("adjusted/triangulation.yaml").string())["adjusted"];
  ASSERT_TRUE(adjusted["left.f_x"] && adjusted["right.T_camera_rig.w_x"]);
  double left = 1;
  for (const auto& each : adjusted) {
    const auto before = each.second["sigma_before"].as<double>();
    const auto sigma = each.second["sigma"].as<double>();
    EXPECT_LE(sigma, before * (1 + 1e-6));
    EXPECT_LT(std::abs(each.second["change"].as<double>()), 4 * before);
    left = std::min(left, sigma / before);
  }
  EXPECT_LT(left, 0.95);
  ASSERT_EQ(Points({"-o", "held"}).status, 0);
  EXPECT_EQ(YAML::LoadFile(Path("held/triangulation.yaml").string())["adjusted"].size(), 0U);
  // Jitter is no error of the calibration.
  Write("result/calibration.yaml",
        Read("result/calibration.yaml") +
            "jitter: {translation: 0.001, rotation: 1e-6, misplaced: 0}\n");
  const Outcome refused = Points({"--adjust"});
  EXPECT_EQ(refused.status, kWrongInput);
  EXPECT_THAT(refused.err, HasSubstr("(jitter)"));
  const Outcome shaken = Points({"--all-lengths", "-o", "shaken"});
  ASSERT_EQ(shaken.status, 0) << shaken.err;
  EXPECT_THAT(shaken.out, HasSubstr(", jitter "));
  EXPECT_GT(Table(Read("shaken/points.csv")).Numbers("sigma_z_jitter").at(0), 1e-3);
  EXPECT_GT(Table(Read("shaken/measures.csv")).Numbers("sigma_jitter").at(0), 1e-5);
  EXPECT_THAT(Read("shaken/shared.csv"), HasSubstr(",jitter_12\n"));
}

TEST_F(Triangulate, FindsAPlaceOfOneImageInTheOther) {
  Write("images.yaml", Spec(5, 1));
  ASSERT_EQ(Run({"simulate", "images.yaml", "-o", "images"}).status, 0);
  ASSERT_EQ(Run({"simulate", "images.yaml", "--points", "-o", "points"}).status, 0);
  const Table corners(Read("points/detections_left.csv"));
  const std::string name = corners.Column("frame").at(0) + ".png";
  std::vector<std::string> words{"triangulate",
                                 "result",
                                 "left=images/left/" + name,
                                 "right=images/right/" + name,
                                 "--all-lengths",
                                 "-o",
                                 "at"};
  std::vector<int> markers;
  for (size_t i = 0; i < corners.Rows(); i += 3) {
    markers.push_back(std::stoi(corners.Column("marker")[i]));
    words.emplace_back("--at");
    words.push_back("left:" + corners.Column("x")[i] + "," + corners.Column("y")[i]);
  }
  const Outcome outcome = Run(words);
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  const Table lengths(Read("at/measures.csv"));
  ASSERT_GT(lengths.Rows(), 30U);
  for (size_t i = 0; i < lengths.Rows(); ++i) {
    const std::string of = lengths.Column("of")[i];
    const int first = std::stoi(of), second = std::stoi(of.substr(of.find(' ')));
    const double length =
        (Corner(markers[static_cast<size_t>(first)]) - Corner(markers[static_cast<size_t>(second)]))
            .norm();
    EXPECT_NEAR(lengths.Numbers("value")[i], length, 1e-3) << of;
  }
  words.back() = "front:1,2";
  const Outcome other = Run(words);
  EXPECT_EQ(other.status, kWrongInput);
  EXPECT_THAT(other.err, HasSubstr("there is no image of that camera"));
}

TEST_F(Triangulate, ACameraThatHasMovedIsNamed) {
  std::string text = Read("result/calibration.yaml");
  const size_t right = text.find("right:");
  const size_t at = text.find("c_y: ", right) + 5;
  const double c_y = std::stod(text.substr(at));
  text.replace(at, text.find_first_of(",}", at) - at, fmt::format("{}", c_y + 1));
  Write("result/calibration.yaml", text);
  const Outcome outcome = Points({});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("rays_contradict_calibration"));
}

TEST_F(Triangulate, NamesWhatDoesNotFit) {
  const auto refused = [&](const std::vector<std::string>& words, const std::string& what) {
    std::vector<std::string> all{"triangulate", "result"};
    all.insert(all.end(), words.begin(), words.end());
    const Outcome outcome = Run(all);
    EXPECT_EQ(outcome.status, kWrongInput) << what;
    EXPECT_THAT(outcome.err, HasSubstr(what));
  };
  const std::string left = "left=new/detections_left.csv", right = "right=new/detections_right.csv";
  refused({left}, "one ordinary camera sees directions");
  refused({left, left}, "camera 'left' has points already");
  refused({"new/detections_left.csv"}, "expected a camera and its table");
  refused({left, "rihgt=new/detections_right.csv"}, "rihgt");
  refused({left, "right=new/none.csv"}, "new/none.csv");
  refused({left, right, "--length", "3,3"}, "--length 3,3: expected 2 different points");
  refused({left, right, "--length", "3,x"}, "--length 3,x: 'x' is no point");
  refused({left, right, "--length", "tag 3,tag 3 corner 4"}, "'tag 3 corner 4' is no point");
  refused({"new/session.yaml", "--at", "left:1,2"}, "--at goes with images");
  refused({left, right, "--at", "left:1;2"}, "--at left:1;2: expected a camera and a place");
  refused({left, right, "--at", "left:1,2"}, "new/detections_left.csv");
  refused({left, right, "--correlation", "1.5"}, "--correlation");
  refused({left, right, "--angle", "1,2"}, "--angle 1,2: expected 3 different points");
  // Numbers that mean other points: rays pass each other far away.
  const Table table(Read("new/detections_right.csv"));
  std::string mixed = "frame,marker,x,y\n";
  for (size_t i = 0; i < table.Rows(); ++i) {
    mixed += fmt::format("{},{},{},{}\n",
                         table.Column("frame")[i],
                         143 - std::stoi(table.Column("marker")[i]),
                         table.Column("x")[i],
                         table.Column("y")[i]);
  }
  Write("mixed.csv", mixed);
  refused({left, "right=mixed.csv"}, "rays of one point miss each other");
  Write("empty.csv", "frame,marker,x,y\n");
  const Outcome outcome = Run({"triangulate", "result", left, "right=empty.csv"});
  EXPECT_EQ(outcome.status, kJobFailed);
  EXPECT_THAT(outcome.err, HasSubstr("no point is seen by two rays"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
