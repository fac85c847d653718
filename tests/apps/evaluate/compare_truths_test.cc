// SPDX-License-Identifier: Apache-2.0
//
// `plenocal compare` of two ground truths of one loop.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <map>
#include <sstream>

#include "tests/apps/scene/small_loop.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

// A second pair beside that of `SmallLoopYaml`: its observations are independent of the first's.
std::string TwoPairsYaml() {
  const std::string camera =
      "    model: pinhole-radial3\n"
      "    image_size: [1280, 1024]\n"
      "    parameters: {f_x: 700, f_y: 700, c_x: 630, c_y: 515, A_0: -0.1, A_1: 0.03, A_2: 0}\n"
      "    detection_sigma: 0.3\n";
  return SmallLoopYaml({}) + "  upper:\n" + camera +
         "    xi_camera_rig: [0.02, 0.08, 0, 0.01, 0, 0]\n  lower:\n" + camera +
         "    xi_camera_rig: [-0.07, 0.16, 0, 0, 0.01, 0]\n";
}

// The file with the positions of its poses changed.
std::string Moved(const std::string& tum, double from_time, const Eigen::Affine3d& change) {
  std::string text;
  for (const std::string& line : Lines(tum)) {
    std::istringstream numbers(line);
    double t;
    Eigen::Vector3d p;
    std::string rotation;
    if (!(numbers >> t >> p.x() >> p.y() >> p.z()) || !std::getline(numbers, rotation)) continue;
    if (t >= from_time) p = change * p;
    text += fmt::format("{:.9f} {:.12f} {:.12f} {:.12f}{}\n", t, p.x(), p.y(), p.z(), rotation);
  }
  return text;
}

class CompareTruths : public Workspace {
 protected:
  Outcome Compare(const std::string& b) {
    return Run({"compare", "a/groundtruth.yaml", b + "/groundtruth.yaml", "-o", "compared"});
  }

  // Difference and standard error of each number of the last comparison.
  std::map<std::string, std::pair<double, double>> Numbers() const {
    const Table table(Read("compared/groundtruth_compare.csv"));
    const std::vector<std::string> names = table.Column("number");
    const std::vector<double> differences = table.Numbers("difference"),
                              sigmas = table.Numbers("sigma");
    std::map<std::string, std::pair<double, double>> numbers;
    for (size_t i = 0; i < names.size(); ++i) numbers[names[i]] = {differences[i], sigmas[i]};
    return numbers;
  }
};

TEST_F(CompareTruths, OfTwoPairsAgreeWithinTheirStandardErrors) {
  Write("loop.yaml", TwoPairsYaml());
  ASSERT_EQ(Run({"simulate", "loop.yaml", "--points", "-o", "loop"}).status, 0);
  ASSERT_EQ(Run({"groundtruth", "loop", "--cameras", "left,right", "-o", "a"}).status, 0);
  ASSERT_EQ(Run({"groundtruth", "loop", "--cameras", "upper,lower", "-o", "b"}).status, 0);
  const Outcome same = Compare("b");
  EXPECT_EQ(same.status, 0) << same.err;
  EXPECT_THAT(same.out, ::testing::HasSubstr("by the path of 'upper'"));
  EXPECT_THAT(same.out, ::testing::HasSubstr("\nsame within uncertainty\n"));
  const size_t whole = same.out.find("  the whole loop:\n");
  ASSERT_NE(whole, std::string::npos);
  EXPECT_NE(same.out.find("scale", whole), std::string::npos);
  for (const auto& [number, value] : Numbers()) {
    EXPECT_GT(value.second, 0) << number;
    EXPECT_LT(std::abs(value.first), 4 * value.second) << number;
    EXPECT_GT(std::abs(value.first), 0.01 * value.second) << number;
  }

  const Outcome camera =
      Run({"evaluate", "--estimate", "path=b/segments_left.txt", "--truth", "a/groundtruth.yaml"});
  EXPECT_EQ(camera.status, 0) << camera.err;
}

TEST_F(CompareTruths, FindsHowFarTheEndOfOneIsOff) {
  Write("loop.yaml", SmallLoopYaml({}));
  ASSERT_EQ(Run({"simulate", "loop.yaml", "--points", "-o", "loop"}).status, 0);
  ASSERT_EQ(Run({"groundtruth", "loop", "-o", "a"}).status, 0);
  const std::string path = Read("a/segments_left.txt"), stated = Read("a/groundtruth.yaml");
  // The same in another frame and unit.
  const Eigen::Affine3d frame = Eigen::Translation3d(3, -2, 7) *
                                Eigen::AngleAxisd(2, Eigen::Vector3d(1, 2, -1).normalized()) *
                                Eigen::Scaling(1.5);
  Write("b/groundtruth.yaml", stated);
  Write("b/segments_left.txt", Moved(path, 0, frame));
  ASSERT_EQ(Compare("b").status, 0);
  for (const auto& [number, value] : Numbers()) {
    EXPECT_NEAR(value.first, number == "scale" ? 0.5 : 0, 1e-6) << number;
  }
  // Its end turned, grown and shifted by d about the centre of A's.
  const auto values =
      YAML::Load(stated)["segment_covariance"]["end_centre"].as<std::vector<double>>();
  const Eigen::Vector3d centre(values[0], values[1], values[2]);
  const Eigen::Vector3d d(2e-3, -1e-3, 3e-3);
  const Eigen::Affine3d off = Eigen::Translation3d(centre + d) *
                              Eigen::AngleAxisd(4e-3, Eigen::Vector3d::UnitY()) *
                              Eigen::Scaling(1.002) * Eigen::Translation3d(-centre);
  const double middle = 0.5 * (std::stod(Lines(path).at(1)) + std::stod(Lines(path).back()));
  Write("b/segments_left.txt", Moved(Moved(path, middle, off), 0, frame));
  const Outcome differs = Compare("b");
  EXPECT_THAT(differs.out,
              ::testing::HasSubstr(
                  "\nnot the same within uncertainty: the end of the loop and the scale\n"));
  auto found = Numbers();
  EXPECT_NEAR(found["end_x"].first, d.x(), 1e-6);
  EXPECT_NEAR(found["end_y"].first, d.y(), 1e-6);
  EXPECT_NEAR(found["end_z"].first, d.z(), 1e-6);
  EXPECT_NEAR(found["end_w_y"].first, 4e-3, 1e-6);
  EXPECT_NEAR(found["end_w_x"].first, 0, 1e-6);
  EXPECT_NEAR(found["end_scale"].first, 2e-3, 1e-6);
}

TEST_F(CompareTruths, RefusesWhatIsNoSecondTruth) {
  Write("loop.yaml", SmallLoopYaml({}));
  ASSERT_EQ(Run({"simulate", "loop.yaml", "--points", "-o", "loop"}).status, 0);
  ASSERT_EQ(Run({"groundtruth", "loop", "-o", "a"}).status, 0);
  const Outcome mixed = Run({"compare", "a/groundtruth.yaml", "loop/calibration.yaml"});
  EXPECT_EQ(mixed.status, 2);
  EXPECT_THAT(mixed.err, ::testing::HasSubstr("ground truths are compared with each other"));
  std::string renamed = Read("a/groundtruth.yaml");
  for (const std::string name : {"left", "right"}) {
    renamed.replace(renamed.find("  " + name + ":"), name.size() + 3, "  cam" + name + ":");
  }
  Write("b/groundtruth.yaml", renamed);
  const Outcome others = Compare("b");
  EXPECT_EQ(others.status, 2);
  EXPECT_THAT(others.err, ::testing::HasSubstr("b/groundtruth.yaml"));
  EXPECT_THAT(others.err, ::testing::HasSubstr("left, right"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
