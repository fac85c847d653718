// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <cmath>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>

#include "apps/evaluate/trajectory_metrics.h"
#include "tests/apps/workspace.h"
#include "tests/optional_data.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using Json = nlohmann::json;

constexpr double kDegrees = 180 / std::numbers::pi;

struct Pose {
  double time;
  Eigen::Vector3d p;
  Eigen::Quaterniond q;
};

Pose PoseAt(int i) {
  const double a = 0.02 * i;
  return {1000 + 0.1 * i,
          {20 * std::cos(a) + std::sin(0.9 * i),
           20 * std::sin(a) + std::cos(0.7 * i),
           0.5 * std::sin(1.3 * i)},
          Eigen::Quaterniond(Eigen::AngleAxisd(a, Eigen::Vector3d(0.6, 0, 0.8)))};
}

constexpr int kPoses = 314, kSegment = 40;  // one loop of 20 m radius

/// What maps the estimate to the truth at the start and at the end, and the estimate that it makes:
/// the first half of the poses by the one, the second by the other.
struct Drifting {
  Similarity start{1.25, Eigen::AngleAxisd(0.4, Eigen::Vector3d(0, 0.6, 0.8)).matrix(), {3, -2, 5}};
  Similarity end =
      Similarity{1.04,
                 Eigen::AngleAxisd(3 / kDegrees, Eigen::Vector3d(2, -1, 2).normalized()).matrix(),
                 {0.3, -0.4, 1.2}} *
      start;

  [[nodiscard]] Pose Estimate(int i) const {
    const Pose truth = PoseAt(i);
    const Similarity T = (i < kPoses / 2 ? start : end).Inverse();
    return {truth.time, T * truth.p, Eigen::Quaterniond(T.R) * truth.q};
  }
};

std::string Tum(const Pose& pose) {
  return fmt::format("{:.4f} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g}\n",
                     pose.time,
                     pose.p.x(),
                     pose.p.y(),
                     pose.p.z(),
                     pose.q.x(),
                     pose.q.y(),
                     pose.q.z(),
                     pose.q.w());
}

std::string Euroc(const Pose& pose) {
  return fmt::format("{:.0f},{:.17g},{:.17g},{:.17g},{:.17g},{:.17g},{:.17g},{:.17g},0,0,0\n",
                     1e9 * pose.time,
                     pose.p.x(),
                     pose.p.y(),
                     pose.p.z(),
                     pose.q.w(),
                     pose.q.x(),
                     pose.q.y(),
                     pose.q.z());
}

std::string Kitti(const Pose& pose) {
  const Eigen::Matrix3d R = pose.q.matrix();
  std::string line;
  for (int r = 0; r < 3; ++r) {
    line += fmt::format("{:.17g} {:.17g} {:.17g} {:.17g}{}",
                        R(r, 0),
                        R(r, 1),
                        R(r, 2),
                        pose.p[r],
                        r < 2 ? " " : "\n");
  }
  return line;
}

template <typename Make>
std::string Poses(int begin, int end, const Make& make) {
  std::string text;
  for (int i = begin; i < end; ++i) text += make(i);
  return text;
}

class EvaluateCommand : public Workspace {
 protected:
  EvaluateCommand() {
    const auto truth = [](int i) { return Tum(PoseAt(i)); };
    Write("start.txt", Poses(0, kSegment, truth));
    Write("end.txt", Poses(kPoses - kSegment, kPoses, truth));
    Write("truth.txt", "# t x y z qx qy qz qw\n" + Read("start.txt") + Read("end.txt"));
    Write("path.txt", Poses(0, kPoses, truth));
    Write("estimate.txt", EstimateText(Tum));
  }

  template <typename Form>
  [[nodiscard]] std::string EstimateText(const Form& form) const {
    return Poses(0, kPoses, [&](int i) { return form(drifting_.Estimate(i)); });
  }

  [[nodiscard]] Json Evaluate(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), "evaluate");
    arguments.push_back("--json");
    const Outcome outcome = Run(arguments);
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    EXPECT_THAT(outcome.out, Not(HasSubstr("null")));
    return Json::parse(outcome.out);
  }

  void ExpectRefused(int status,
                     std::vector<std::string> arguments,
                     const std::vector<std::string>& parts) const {
    arguments.insert(arguments.begin(), "evaluate");
    arguments.push_back("--quiet");
    const Outcome outcome = Run(arguments);
    EXPECT_EQ(outcome.status, status) << outcome.err;
    EXPECT_EQ(outcome.out, "");
    EXPECT_EQ(Lines(outcome.err).size(), 1U) << outcome.err;
    for (const std::string& part : parts) EXPECT_THAT(outcome.err, HasSubstr(part));
  }

  void ExpectDrift(const Json& json) const {
    EXPECT_NEAR(json["scale_drift"].get<double>(), 1.04, 1e-9);
    EXPECT_NEAR(json["scale_drift_folded"].get<double>(), 1.04, 1e-9);
    EXPECT_NEAR(json["rotation_drift_deg"].get<double>(), 3, 1e-9);
    EXPECT_NEAR(json["translation_drift"].get<double>(), 1.3, 1e-9);
    const double scale = 1.25 * std::sqrt(1.04);
    EXPECT_NEAR(json["absolute_scale"].get<double>(), scale, 1e-9);
    EXPECT_NEAR(json["absolute_scale_folded"].get<double>(), scale, 1e-9);
    EXPECT_NEAR(json["scale_min"].get<double>(), 1.25, 1e-9);
    EXPECT_NEAR(json["scale_max"].get<double>(), 1.25 * 1.04, 1e-9);
    EXPECT_EQ(json["frames"], kPoses);
    double squared = 0, length = 0;
    for (int i = 0; i < kPoses; ++i) {
      const Eigen::Vector3d p = drifting_.Estimate(i).p;
      squared += (drifting_.start * p - drifting_.end * p).squaredNorm();
      if (i > 0) length += scale * (p - drifting_.Estimate(i - 1).p).norm();
    }
    const double error = std::sqrt(squared / kPoses);
    EXPECT_NEAR(json["alignment_error"].get<double>(), error, 1e-9);
    EXPECT_NEAR(json["path_length"].get<double>(), length, 1e-9);
    EXPECT_NEAR(json["alignment_error_percent"].get<double>(), 100 * error / length, 1e-9);
  }

  Drifting drifting_;
};

TEST_F(EvaluateCommand, DriftPutInByHandComesBack) {
  const Json json = Evaluate({"--estimate", "estimate.txt", "--truth", "truth.txt"});
  ExpectDrift(json);
  const Eigen::Matrix4d T = drifting_.end.Matrix();
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 4; ++c) EXPECT_NEAR(json["T_e_gt"][r][c].get<double>(), T(r, c), 1e-9);
  }
}

TEST_F(EvaluateCommand, SegmentsInTwoFilesAndOtherFormsGiveTheSame) {
  Write("euroc.csv", "#timestamp [ns],p_x,p_y,p_z,q_w,q_x,q_y,q_z,v\n" + EstimateText(Euroc));
  Write("kitti.txt", EstimateText(Kitti));
  Write("times.txt",
        Poses(0, kPoses, [](int i) { return fmt::format("{:.4f}\n", 1000 + 0.1 * i); }));
  // ORB-SLAM3 writes its EuRoC runs with blanks and nanoseconds.
  Write("orb.txt", EstimateText([](const Pose& pose) {
          return fmt::format("{:.6f}", 1e9 * pose.time) + Tum(pose).substr(Tum(pose).find(' '));
        }));
  for (const char* estimate : {"estimate.txt", "euroc.csv", "kitti.txt", "orb.txt"}) {
    SCOPED_TRACE(estimate);
    ExpectDrift(Evaluate({"--estimate",
                          estimate,
                          "--start",
                          "start.txt",
                          "--end",
                          "end.txt",
                          "--times",
                          "times.txt"}));
  }
}

TEST_F(EvaluateCommand, AScaleThatShrinksIsFolded) {
  drifting_.end.s = 0.8 * drifting_.start.s;
  Write("estimate.txt", EstimateText(Tum));
  const Json json = Evaluate({"--estimate", "estimate.txt", "--truth", "truth.txt"});
  EXPECT_NEAR(json["scale_drift"].get<double>(), 0.8, 1e-9);
  EXPECT_NEAR(json["scale_drift_folded"].get<double>(), 1.25, 1e-9);
}

TEST_F(EvaluateCommand, PosesBelongTogetherOnlyWithinTheTolerance) {
  Write("late.txt", Poses(0, kPoses, [&](int i) {
          Pose pose = drifting_.Estimate(i);
          pose.time += 0.015;
          return Tum(pose);
        }));
  ExpectRefused(kJobFailed,
                {"--estimate", "late.txt", "--truth", "truth.txt"},
                {"late.txt", "within 0.01 s", "1000.015 to", "--tolerance"});
  ExpectDrift(Evaluate({"--estimate", "late.txt", "--truth", "truth.txt", "--tolerance", "0.02"}));
}

TEST_F(EvaluateCommand, WithoutAGapTheTruthIsThatOfTheWholePath) {
  const Outcome outcome =
      Run({"evaluate", "--estimate", "path.txt", "--truth", "path.txt", "--json"});
  EXPECT_EQ(outcome.status, kDone);
  EXPECT_THAT(outcome.err, HasSubstr("no gap stands out"));
  const Json json = Json::parse(outcome.out);
  EXPECT_FALSE(json.contains("scale_drift"));
  EXPECT_EQ(json["ate"]["pairs"], kPoses);
  EXPECT_NEAR(json["ate"]["sim3"]["rmse"].get<double>(), 0, 1e-12);
}

TEST_F(EvaluateCommand, AteAndRpeEqualThoseOfEvo) {
  const std::filesystem::path folder = OptionalData("frames/traj_tum_rgbd");
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << Absent(folder);
  std::ifstream file(folder / "reference_metrics.json");
  int checked = 0;
  const Json references = Json::parse(file);
  for (const Json& reference : references["results"]) {
    const std::string metric = reference["metric"];
    const bool is_ten = metric.find("delta 10") != std::string::npos;
    const Json json = Evaluate({"--estimate",
                                folder / reference["est"].get<std::string>(),
                                "--truth",
                                folder / reference["ref"].get<std::string>(),
                                "--delta",
                                is_ten ? "10" : "1"});
    if (metric == "Sim3 Umeyama scale") {
      EXPECT_NEAR(json["ate"]["scale"].get<double>(), reference["value"].get<double>(), 1e-12);
      continue;
    }
    const std::map<std::string, Json> own{
        {"APE trans, no align", json["ate"]["unaligned"]},
        {"APE trans, SE3 Umeyama", json["ate"]["se3"]},
        {"APE trans, Sim3 Umeyama", json["ate"]["sim3"]},
        {"APE rot angle deg, SE3 Umeyama", json["ate"]["rotation_deg"]},
        {"RPE trans, delta 1 frame, no align", json["rpe"]["se3"]},
        {"RPE trans, delta 10 frames all_pairs, no align", json["rpe"]["se3"]},
        {"RPE rot deg, delta 1 frame, no align", json["rpe"]["rotation_deg"]},
        {"RPE trans, delta 1 frame, Sim3 Umeyama", json["rpe"]["sim3"]}};
    ASSERT_TRUE(own.contains(metric)) << metric;
    EXPECT_EQ(json["ate"]["pairs"], reference["pairs"]);
    for (const char* key : {"rmse", "mean", "median", "std", "min", "max", "sse"}) {
      const double expected = reference[key];
      EXPECT_NEAR(own.at(metric)[key].get<double>(), expected, 1e-11 * std::max(1.0, expected))
          << metric << " " << key;
      ++checked;
    }
  }
  EXPECT_GT(checked, 200);
}

TEST_F(EvaluateCommand, MonocularRunsLeaveOutWhatHasNoScale) {
  const Json json = Evaluate({"--estimate", "estimate.txt", "--truth", "truth.txt", "--monocular"});
  for (const char* key : {"absolute_scale", "absolute_scale_folded", "scale_min", "scale_max"}) {
    EXPECT_FALSE(json.contains(key)) << key;
  }
  EXPECT_FALSE(json["ate"].contains("se3"));
  EXPECT_TRUE(json["ate"].contains("sim3"));
  EXPECT_NEAR(json["scale_drift"].get<double>(), 1.04, 1e-9);
}

TEST_F(EvaluateCommand, SeveralRunsStandSideBySideAndFailedOnesAreMarked) {
  Write("lost.txt", Poses(0, 150, [&](int i) { return Tum(drifting_.Estimate(i)); }));
  const std::vector<std::string> runs{
      "--estimate", "DSO=estimate.txt", "ORB2=lost.txt", "SPO=estimate.txt", "--monocular", "DSO"};
  std::vector<std::string> arguments = runs;
  for (const char* more : {"--truth", "truth.txt"}) arguments.emplace_back(more);
  const Json json = Evaluate(arguments)["runs"];
  EXPECT_FALSE(json["DSO"].contains("absolute_scale"));
  EXPECT_TRUE(json["SPO"].contains("absolute_scale"));
  EXPECT_THAT(json["ORB2"]["failed"].get<std::string>(), HasSubstr("end segment"));
  EXPECT_EQ(json["ORB2"].size(), 1U);

  arguments.insert(arguments.begin(), "evaluate");
  const Outcome table = Run(arguments);
  EXPECT_EQ(table.status, kDone);
  EXPECT_THAT(table.out, AllOf(HasSubstr("e_align %"), HasSubstr("ORB2  FAILED: lost.txt: end")));

  for (const char* chart : {"chart.svg", "chart.png"}) {
    std::vector<std::string> with_chart = arguments;
    with_chart.insert(with_chart.end(), {"--chart", chart});
    EXPECT_EQ(Run(with_chart).status, kDone);
  }
  EXPECT_THAT(Read("chart.svg"), HasSubstr("</svg>"));
  EXPECT_EQ(Read("chart.png").substr(1, 3), "PNG");
}

TEST_F(EvaluateCommand, WhatASegmentCannotTellIsSaid) {
  Write("few.txt",
        Read("start.txt") + Poses(kPoses - 2, kPoses, [](int i) { return Tum(PoseAt(i)); }));
  ExpectRefused(kJobFailed,
                {"--estimate", "estimate.txt", "--truth", "few.txt"},
                {"estimate.txt", "end segment", "2 poses", "at least 3"});

  const auto straight = [](double wiggle) {
    return [=](int i) {
      Pose pose = PoseAt(i);
      pose.p = {0.3 * i, 0.1 * i, wiggle * std::sin(37.0 * i)};
      return Tum(pose);
    };
  };
  Write("line.txt", Poses(0, kSegment, straight(0)) + Read("end.txt"));
  Write("run.txt", Poses(0, kPoses, straight(0)));
  ExpectRefused(kJobFailed,
                {"--estimate", "run.txt", "--truth", "line.txt"},
                {"start segment", "straight line", "rotation"});
  // The same with errors off the line that have nothing to do with each other.
  Write("line.txt", Poses(0, kSegment, straight(1e-3)) + Read("end.txt"));
  Write("run.txt", Poses(0, kPoses, [&](int i) {
          Pose pose = PoseAt(i);
          pose.p = {0.3 * i, 0.1 * i, 2e-3 * std::sin(91.0 * i + 1)};
          return Tum(pose);
        }));
  ExpectRefused(kJobFailed,
                {"--estimate", "run.txt", "--truth", "line.txt"},
                {"start segment", "straight line", "rotation"});

  Write("still.txt", Poses(0, kPoses, [](int i) {
          Pose pose = PoseAt(i);
          pose.p = {1, 2, 3};
          return Tum(pose);
        }));
  ExpectRefused(kJobFailed,
                {"--estimate", "still.txt", "--truth", "truth.txt"},
                {"still.txt", "does not move"});
}

TEST_F(EvaluateCommand, BadTrajectoriesAreNamedByFileAndLine) {
  const std::string text = Read("estimate.txt");
  const std::vector<std::string> lines = Lines(text);
  const auto with_third = [&](const std::string& line) {
    return lines[0] + "\n" + lines[1] + "\n" + line + "\n" + lines[3] + "\n";
  };
  const auto expect = [&](const std::string& content, const std::vector<std::string>& parts) {
    Write("bad.txt", content);
    ExpectRefused(kWrongInput, {"--estimate", "bad.txt", "--truth", "truth.txt"}, parts);
    ExpectRefused(kWrongInput, {"--estimate", "estimate.txt", "--truth", "bad.txt"}, parts);
  };
  expect(with_third("1000.2 1 nan 3 0 0 0 1"), {"bad.txt:3:", "nan"});
  expect(with_third("1000.2 1 2 inf 0 0 0 1"), {"bad.txt:3:", "inf"});
  expect(with_third("1000.05 1 2 3 0 0 0 1"), {"bad.txt:3:", "1000.05", "sort"});
  expect(with_third("1000.2 1 2 3 0 0 0 0"), {"bad.txt:3:", "quaternion"});
  expect(with_third("1000.2 1 2 3 0 0 0"), {"bad.txt:3:", "8 numbers", "7"});
  expect(with_third("1000.2 1 2 3 0 0 0 1 5"), {"bad.txt:3:", "8 numbers", "9"});
  expect(with_third("1000.2 1 2m 3 0 0 0 1"), {"bad.txt:3:", "2m"});
  expect("", {"bad.txt", "no poses"});
  expect("# nothing\n\n", {"bad.txt", "no poses"});
  expect("1 2 3\n", {"bad.txt:1:", "TUM", "EuRoC", "KITTI"});
  expect("1 0 0 0 0 1 0 0 0 0 2 0\n", {"bad.txt:1:", "rotation"});
  ExpectRefused(kWrongInput,
                {"--estimate", "none.txt", "--truth", "truth.txt"},
                {"none.txt", "no such file"});
}

TEST_F(EvaluateCommand, RepeatedTimesKeepTheFirstPoseAndAreReported) {
  const std::vector<std::string> lines = Lines(Read("estimate.txt"));
  std::string text;
  for (size_t i = 0; i < lines.size(); ++i) {
    text += lines[i] + "\n";
    if (i == 5) text += lines[i].substr(0, lines[i].find(' ')) + " 900 900 900 0 0 0 1\n";
  }
  Write("twice.txt", text);
  const Outcome outcome =
      Run({"evaluate", "--estimate", "twice.txt", "--truth", "truth.txt", "--json"});
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("twice.txt"), HasSubstr("left out 1 ")));
  ExpectDrift(Json::parse(outcome.out));
}

TEST_F(EvaluateCommand, CommandLinesThatSayTooLittleOrTooMuchAreRefused) {
  ExpectRefused(kWrongInput, {"--truth", "truth.txt"}, {"--estimate"});
  ExpectRefused(kWrongInput, {"--estimate", "estimate.txt"}, {"--truth", "--start"});
  ExpectRefused(kWrongInput, {"--estimate", "estimate.txt", "--start", "start.txt"}, {"--end"});
  ExpectRefused(kWrongInput,
                {"--estimate", "estimate.txt", "--truth", "truth.txt", "--end", "end.txt"},
                {"--truth"});
  ExpectRefused(kWrongInput,
                {"--estimate", "estimate.txt", "--start", "end.txt", "--end", "start.txt"},
                {"exchanged"});
  ExpectRefused(kWrongInput,
                {"--estimate", "estimate.txt", "estimate.txt", "--truth", "truth.txt"},
                {"'estimate'", "NAME=FILE"});
  ExpectRefused(kWrongInput,
                {"--estimate", "DSO=estimate.txt", "--truth", "truth.txt", "--monocular", "DS0"},
                {"'DS0'", "'DSO'"});
  ExpectRefused(kWrongInput,
                {"--estimate", "estimate.txt", "--truth", "truth.txt", "--chart", "chart.gif"},
                {"chart.gif", ".svg"});
  Write("kitti.txt", EstimateText(Kitti));
  ExpectRefused(
      kWrongInput, {"--estimate", "kitti.txt", "--truth", "truth.txt"}, {"kitti.txt", "--times"});
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
