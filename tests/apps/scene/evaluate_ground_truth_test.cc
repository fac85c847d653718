// SPDX-License-Identifier: Apache-2.0
//
// The paper's evaluation from a recording: `groundtruth`, then `evaluate` of a path with known
// drift.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/apps/scene/small_loop.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr double kScale = 1.01, kDegrees = 0.5;
const Eigen::Vector3d kShift(0.2, -0.2, 0.1);  // 0.3 m

struct TimedPose {
  double time;
  Eigen::Vector3d p;
  Eigen::Quaterniond q;
};

std::vector<TimedPose> Poses(const std::string& tum) {
  std::vector<TimedPose> poses;
  for (const std::string& line : Lines(tum)) {
    std::istringstream numbers(line);
    double t, x, y, z, qx, qy, qz, qw;
    if (numbers >> t >> x >> y >> z >> qx >> qy >> qz >> qw) {
      poses.push_back({t, {x, y, z}, {qw, qx, qy, qz}});
    }
  }
  return poses;
}

std::string Tum(const std::vector<TimedPose>& poses) {
  std::string text;
  for (const auto& [t, p, q] : poses) {
    text += fmt::format("{:.9f} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f}\n",
                        t,
                        p.x(),
                        p.y(),
                        p.z(),
                        q.x(),
                        q.y(),
                        q.z(),
                        q.w());
  }
  return text;
}

// A path that drifts by this share of the drift, between the segments alone.
std::string Drifting(const std::string& path, double share) {
  std::vector<TimedPose> poses = Poses(path);
  const double begin = poses.front().time, duration = poses.back().time - begin;
  for (auto& [t, p, q] : poses) {
    const double s = share * std::clamp((t - begin) / duration * 2 - 0.5, 0.0, 1.0);
    const Eigen::Quaterniond turn(
        Eigen::AngleAxisd(s * kDegrees * M_PI / 180, Eigen::Vector3d(1, 2, 3).normalized()));
    p = std::pow(kScale, s) * (turn * p) + s * kShift;
    q = turn * q;
  }
  return Tum(poses);
}

// The poses in the frame of that at `time`.
std::string InFrameOf(const std::string& path, double time) {
  std::vector<TimedPose> poses = Poses(path);
  const auto nearest = std::ranges::min_element(
      poses, {}, [&](const TimedPose& pose) { return std::abs(pose.time - time); });
  const TimedPose first = *nearest;
  for (auto& [t, p, q] : poses) {
    p = first.q.conjugate() * (p - first.p);
    q = first.q.conjugate() * q;
  }
  return Tum(poses);
}

class EvaluateGroundTruth : public Workspace {
 protected:
  EvaluateGroundTruth() {
    Write("loop.yaml", SmallLoopYaml({}));
    EXPECT_EQ(Run({"simulate", "loop.yaml", "--points", "-o", "loop"}).status, 0);
    EXPECT_EQ(Run({"groundtruth", "loop", "-o", "truth"}).status, 0);
  }

  nlohmann::json Evaluate(const std::string& truth) {
    const Outcome outcome = Run({"evaluate", "--estimate", "run.txt", "--truth", truth, "--json"});
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    return nlohmann::json::parse(outcome.out);
  }
};

TEST_F(EvaluateGroundTruth, FindsAKnownDriftWithinItsStandardErrors) {
  Write("run.txt", Drifting(Read("loop/truth/trajectory_left.txt"), 1));
  const double first = Poses(Read("truth/segments_left.txt")).front().time;
  Write("exact.txt", InFrameOf(Read("loop/truth/segments_left.txt"), first));
  const nlohmann::json exact = Evaluate("exact.txt");
  const nlohmann::json found = Evaluate("truth/groundtruth.yaml");
  EXPECT_FALSE(exact.contains("errors_by_truth"));
  EXPECT_NEAR(exact["scale_drift"], 1 / kScale, 1e-6);
  EXPECT_NEAR(exact["rotation_drift_deg"], kDegrees, 1e-6);
  const double e_align = exact["alignment_error"];
  EXPECT_NEAR(found["alignment_error"], e_align, 0.01 * e_align);
  EXPECT_NEAR(found["scale_drift"], exact["scale_drift"], 5e-4);
  for (const auto& [metric, error] : found["errors_by_truth"].items()) {
    const double sigma = error["sigma"];
    EXPECT_GT(sigma, 0) << metric;
    const double apart = found[metric].get<double>() - exact[metric].get<double>();
    EXPECT_LT(std::abs(apart), 3 * sigma) << metric;
    EXPECT_TRUE(metric == "absolute_scale" || error["resolved"]) << metric;
  }
}

TEST_F(EvaluateGroundTruth, MarksWhatIsBelowItsOwnErrors) {
  Write("run.txt", Read("loop/truth/trajectory_left.txt"));
  const nlohmann::json evaluated = Evaluate("truth/groundtruth.yaml");
  for (const auto& [metric, error] : evaluated["errors_by_truth"].items()) {
    // The estimate has no errors: what it shows is the truth's.
    const bool is_scale = metric.find("scale") != std::string::npos;
    const double deviation = std::abs(evaluated[metric].get<double>() - (is_scale ? 1 : 0));
    const double floor = error["floor"], sigma = error["sigma"];
    const bool resolved = error["resolved"];
    EXPECT_EQ(resolved, deviation >= floor) << metric;
    EXPECT_LT(deviation, 4 * floor) << metric;
    if (!resolved) {
      EXPECT_EQ(sigma, floor) << metric;
    }
  }
  Write("run.txt", Drifting(Read("loop/truth/trajectory_left.txt"), 1e-5));
  const Outcome outcome =
      Run({"evaluate", "--estimate", "run.txt", "--truth", "truth/groundtruth.yaml"});
  EXPECT_THAT(outcome.out, ::testing::HasSubstr("* not resolved"));
}

TEST_F(EvaluateGroundTruth, TakesTheSegmentsOfTheCameraThatIsNamed) {
  Write("run.txt", Read("truth/segments_right.txt"));
  const auto evaluate = [&](const std::vector<std::string>& camera) {
    std::vector<std::string> arguments{
        "evaluate", "--estimate", "run.txt", "--truth", "truth/groundtruth.yaml", "--json"};
    arguments.insert(arguments.end(), camera.begin(), camera.end());
    return Run(arguments);
  };
  const auto unaligned = [](const Outcome& outcome) {
    return nlohmann::json::parse(outcome.out)["ate"]["unaligned"]["rmse"].get<double>();
  };
  EXPECT_LT(unaligned(evaluate({"--camera", "right"})), 1e-6);
  EXPECT_NEAR(unaligned(evaluate({})), 0.1, 0.001);
  const Outcome unknown = evaluate({"--camera", "rigt"});
  EXPECT_EQ(unknown.status, 2);
  EXPECT_THAT(unknown.err, ::testing::HasSubstr("truth/groundtruth.yaml"));
  EXPECT_THAT(unknown.err, ::testing::HasSubstr("right"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
