// SPDX-License-Identifier: Apache-2.0
//
// `plenocal triangulate`: points of a simulated pair lie where they are, within their standard
// errors, and what does not fit is named.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <Eigen/Core>
#include <string>
#include <tuple>
#include <vector>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;

class Triangulate : public Workspace {
 protected:
  void SetUp() override {
    Workspace::SetUp();
    Write("board.yaml",
          "plenocal: 1\ntype: aprilgrid\ncolumns: 6\nrows: 6\nsize: 0.055\nspacing: 0.3\n");
    for (const auto& [name, seed, frames] : {std::tuple{"set", 1, 12}, {"new", 2, 2}}) {
      Write(fmt::format("{}.yaml", name), Spec(seed, frames));
      ASSERT_EQ(Run({"simulate", fmt::format("{}.yaml", name), "--points", "-o", name}).status, 0);
    }
    ASSERT_EQ(Run({"calibrate", "set/session.yaml", "-o", "result", "--no-report"}).status, 0);
  }

  [[nodiscard]] static std::string Spec(int seed, int frames) {
    return fmt::format(
        "plenocal: 1\nseed: {}\ntarget: board.yaml\n"
        "poses: {{kind: varied, frames: {}, distance: [0.4, 1.0]}}\n"
        "cameras:\n"
        "  left: {{model: pinhole, image_size: [1280, 960], detection_sigma: 0.1,\n"
        "    parameters: {{f_x: 900, f_y: 901, c_x: 636, c_y: 483}}}}\n"
        "  right: {{model: pinhole, image_size: [1280, 960], detection_sigma: 0.1,\n"
        "    parameters: {{f_x: 905, f_y: 904, c_x: 641, c_y: 475}},\n"
        "    xi_camera_rig: [-0.12, 0.001, 0.002, 0.01, -0.02, 0.01]}}\n",
        seed,
        frames);
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
  const auto corner = [](int marker) {
    constexpr double kSize = 0.055, kPitch = 1.3 * kSize;
    const int tag = marker / 4, k = marker % 4;
    return Eigen::Vector2d(kPitch * (tag % 6) + (k == 1 || k == 2 ? kSize : 0),
                           kPitch * (tag / 6) + (k >= 2 ? kSize : 0));
  };
  const std::vector<std::string> of = measures.Column("of");
  const std::vector<double> value = measures.Numbers("value"), sigma = measures.Numbers("sigma");
  double mean = 0;
  for (size_t i = 0; i < of.size(); ++i) {
    const int first = std::stoi(of[i]), second = std::stoi(of[i].substr(of[i].find(' ')));
    const double error = value[i] - (corner(first) - corner(second)).norm();
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
  refused({left, right, "--length", "3,x"}, "--length 3,x: expected numbers");
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
