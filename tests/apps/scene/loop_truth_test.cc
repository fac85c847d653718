// SPDX-License-Identifier: Apache-2.0
//
// Ground truth of a loop that a pair walks past one wall of points: its start and its end.
#include "apps/groundtruth/loop_truth.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "apps/groundtruth/loop_truth_files.h"
#include "apps/groundtruth/loop_truth_page.h"
#include "apps/groundtruth/recorded_tracks.h"
#include "calib/base/error.h"
#include "models/registry.h"
#include "tests/calib/random.h"
#include "tests/digest.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kFocal = 600, kNoise = 0.3;  // px
constexpr size_t kFrames = 6;                 // of each segment
const RigidTransform kRight{ExpRotation({0.01, 0.02, -0.01}), {-0.15, 0.01, 0.005}};

// T_rig_world of a frame: the end passes the wall again, a little beside the start.
RigidTransform PoseOf(size_t frame) {
  const bool at_end = frame >= kFrames;
  const double step = 0.15 * static_cast<double>(frame % kFrames);
  return {ExpRotation({0.02 * std::sin(5 * step), 0.1 * step, at_end ? 0.05 : 0.0}),
          {-step - (at_end ? 0.1 : 0.0), 0.3 * std::sin(4 * step), 0.2 * std::cos(3 * step)}};
}

BundleCamera Camera(const char* name, const RigidTransform& T_camera_rig) {
  BundleCamera camera{.name = name,
                      .image_size = {640, 480},
                      .model = FindModel(CameraModels(), "pinhole"),
                      .config = {},
                      .params = {kFocal, kFocal, 320, 240},
                      .fixed = std::vector<bool>(4, true),
                      .T_camera_rig = T_camera_rig};
  camera.is_master = true;  // all is known
  return camera;
}

struct Loop {
  CalibratedRig rig{.cameras = {Camera("left", {}), Camera("right", kRight)}, .prior = {}};
  SceneTracks tracks;
  LoopSegments segments{FramesFrom(0, kFrames), FramesFrom(kFrames, 2 * kFrames)};
};

struct LoopOptions {
  int points = 120;
  /// The end's points have numbers of their own, which `matches` lead to those of the start.
  int renumbered = 0;
  /// So many of these lead to a wrong point.
  int wrong_matches = 0;
  std::set<size_t> blind = {};  ///< frames whose observations have random places
};

Loop MakeLoop(const LoopOptions& options) {
  Loop loop;
  Random random(8);
  std::vector<Eigen::Vector3d> points;
  for (int k = 0; k < options.points; ++k) {
    const double z = random.Uniform(1.5, 4), y = random.Uniform(-1, 1), x = random.Uniform(-1, 2);
    points.emplace_back(x, y, z);
  }
  loop.tracks.views.resize(2);
  std::set<int> renumbered;
  for (size_t frame = 0; frame < 2 * kFrames; ++frame) {
    loop.tracks.frames.push_back(fmt::format("{:02}", frame));
    loop.tracks.times.push_back(0.5 * static_cast<double>(frame) + (frame >= kFrames ? 100 : 0));
    for (size_t c = 0; c < 2; ++c) {
      View& view = loop.tracks.views[c].emplace_back();
      view.frame = loop.tracks.frames.back();
      for (int k = 0; k < options.points; ++k) {
        const Eigen::Vector3d p =
            loop.rig.cameras[c].T_camera_rig * (PoseOf(frame) * points[static_cast<size_t>(k)]);
        double x = 320 + kFocal * p.x() / p.z(), y = 240 + kFocal * p.y() / p.z();
        if (x < 0 || x > 639 || y < 0 || y > 479) continue;
        if (options.blind.contains(frame)) {
          x = random.Uniform(0, 639);
          y = random.Uniform(0, 479);
        }
        Observation& seen = view.observations.emplace_back();
        seen.marker = k;
        if (frame >= kFrames && k < options.renumbered) {
          seen.marker += 1000;
          renumbered.insert(k);
        }
        seen.values[0] = x + random.Gaussian(kNoise);
        seen.values[1] = y + random.Gaussian(kNoise);
        seen.detector_sigma = kNoise;
      }
    }
  }
  for (const int k : renumbered) {
    loop.tracks.matches.emplace_back(1000 + k, k < options.wrong_matches ? k + 1 : k);
  }
  return loop;
}

LoopTruthResult Estimate(const Loop& loop) {
  return EstimateLoopTruth(
      {.rig = &loop.rig, .tracks = &loop.tracks, .segments = loop.segments, .progress = {}});
}

struct Counts {
  size_t observations = 0, points = 0, common = 0;
  std::vector<double> rms;
};

// By the definitions of `LoopTruthResult`.
Counts CountsOf(const LoopTruthResult& truth) {
  Counts counts;
  std::map<int, std::set<bool>> seen_at_end;
  std::vector<double> squares(2), numbers(2);
  for (const BundleObservation& each : truth.bundle.observations) {
    if (!each.used) continue;
    ++counts.observations;
    seen_at_end[each.marker].insert(each.frame >= static_cast<int>(kFrames));
    const Eigen::Vector3d p = truth.bundle.cameras[static_cast<size_t>(each.camera)].T_camera_rig *
                              (truth.bundle.T_rig_target[static_cast<size_t>(each.frame)] *
                               truth.bundle.markers[static_cast<size_t>(each.marker)].position);
    const double x = 320 + kFocal * p.x() / p.z() - each.seen.values[0],
                 y = 240 + kFocal * p.y() / p.z() - each.seen.values[1];
    squares[static_cast<size_t>(each.camera)] += x * x + y * y;
    numbers[static_cast<size_t>(each.camera)] += 1;
  }
  counts.points = seen_at_end.size();
  counts.common = static_cast<size_t>(
      std::ranges::count_if(seen_at_end, [](const auto& seen) { return seen.second.size() == 2; }));
  for (size_t c = 0; c < 2; ++c) counts.rms.push_back(std::sqrt(squares[c] / numbers[c]));
  return counts;
}

// Poses against the truth, in the frame of the first pose; (error / sigma)^2 / 6 of the last frame.
double ErrorOfTheEnd(const LoopTruthResult& truth) {
  const size_t last = truth.end.frames.back();
  const RigidTransform expected = PoseOf(last) * PoseOf(truth.start.frames.front()).Inverse();
  const RigidTransform T_world_rig = truth.bundle.T_rig_target[last].Inverse();
  const RigidTransform error = T_world_rig * expected;
  Vector6d vector;
  vector << error.t, Eigen::AngleAxisd(error.R).angle() * Eigen::AngleAxisd(error.R).axis();
  return vector.dot(truth.covariance.poses[last].ldlt().solve(vector)) / 6;
}

void ExpectConsistent(const LoopTruthResult& truth) {
  const Counts counts = CountsOf(truth);
  EXPECT_EQ(truth.observations, counts.observations);
  EXPECT_EQ(truth.points, counts.points);
  EXPECT_EQ(truth.common, counts.common);
  ASSERT_EQ(truth.rms.size(), 2);
  for (size_t c = 0; c < 2; ++c) EXPECT_NEAR(truth.rms[c], counts.rms[c], 1e-9) << c;
}

TEST(LoopTruth, FindsTheEndAgainstTheStartWithinItsCovariance) {
  const Loop loop = MakeLoop({});
  const LoopTruthResult truth = Estimate(loop);
  EXPECT_TRUE(truth.converged);
  EXPECT_EQ(truth.start.frames, loop.segments.start);
  EXPECT_EQ(truth.end.frames, loop.segments.end);
  EXPECT_THAT(truth.start.left_out, IsEmpty());
  EXPECT_THAT(truth.end.left_out, IsEmpty());
  ExpectConsistent(truth);
  EXPECT_GT(truth.common, 90);
  EXPECT_LE(truth.common, truth.points);
  EXPECT_LE(truth.points, 120);
  EXPECT_TRUE(truth.bundle.T_rig_target[0].t.isZero(1e-12));
  EXPECT_TRUE(truth.bundle.T_rig_target[0].R.isIdentity(1e-12));
  // 6 values: 99.9 % are below 3.7.
  EXPECT_LT(ErrorOfTheEnd(truth), 3.7);
  EXPECT_FALSE(truth.rival);
  // Of the noise of two coordinates, less what poses and points take.
  for (const double rms : truth.rms) EXPECT_NEAR(rms, std::sqrt(2.0) * kNoise, 0.1 * kNoise);
}

TEST(LoopTruth, LeavesOutAFrameWhosePointsContradictTheOthers) {
  const Loop loop = MakeLoop({.blind = {2, kFrames + 4}});
  const LoopTruthResult truth = Estimate(loop);
  EXPECT_THAT(truth.start.frames, ElementsAre(0, 1, 3, 4, 5));
  EXPECT_THAT(truth.start.left_out, ElementsAre(2));
  EXPECT_THAT(truth.end.left_out, ElementsAre(kFrames + 4));
  ExpectConsistent(truth);
  EXPECT_LT(ErrorOfTheEnd(truth), 3.7);
  for (const BundleObservation& each : truth.bundle.observations) {
    EXPECT_TRUE(!each.used || (each.frame != 2 && each.frame != kFrames + 4));
  }
}

TEST(LoopTruth, IsInTheFrameOfTheFirstPoseThatItHas) {
  Loop loop = MakeLoop({});
  for (std::vector<View>& views : loop.tracks.views) views[0].observations.clear();
  const LoopTruthResult truth = Estimate(loop);
  EXPECT_THAT(truth.start.frames, ElementsAre(1, 2, 3, 4, 5));
  EXPECT_EQ(truth.bundle.fixed_frame, 1);
  EXPECT_LT((truth.bundle.T_rig_target[1].R - Eigen::Matrix3d::Identity()).norm(), 1e-12);
  EXPECT_LT(truth.bundle.T_rig_target[1].t.norm(), 1e-12);
  EXPECT_EQ(truth.covariance.poses[1], Matrix6d::Zero());
  EXPECT_GT(truth.covariance.poses[2].trace(), 0);
}

TEST(LoopTruth, RefusesASegmentOfTwoFrames) {
  for (const size_t begin : {size_t{0}, kFrames}) {
    Loop loop = MakeLoop({});
    for (std::vector<View>& views : loop.tracks.views) {
      for (size_t frame = begin + 2; frame < begin + kFrames; ++frame)
        views[frame].observations.clear();
    }
    const char* const words = begin == 0 ? "start segment: poses for 2 of 6 frames only"
                                         : "end segment: poses for 2 of 6 frames only";
    EXPECT_THAT([&] { Estimate(loop); }, ::testing::ThrowsMessage<Error>(HasSubstr(words)));
  }
}

TEST(LoopTruth, IsThatOfTheMatchedPoints) {
  const Loop loop = MakeLoop({.renumbered = 120, .wrong_matches = 10});
  const LoopTruthResult truth = Estimate(loop);
  ExpectConsistent(truth);
  EXPECT_GT(truth.common, 80);
  EXPECT_LT(ErrorOfTheEnd(truth), 3.7);
  // Where the match is wrong, the end's points stay points of their own.
  size_t own = 0;
  for (const BundleObservation& each : truth.bundle.observations) {
    const int number = truth.bundle.markers[static_cast<size_t>(each.marker)].number;
    EXPECT_TRUE(number < 1000 || each.frame >= static_cast<int>(kFrames));
    own += number >= 1000 && number < 1010 ? 1 : 0;
  }
  EXPECT_GT(own, 10);
}

TEST(LoopTruth, RefusesAnEndThatSeesNothingOfTheStart) {
  const Loop loop = MakeLoop({.renumbered = 118});
  Loop apart = loop;
  apart.tracks.matches.clear();
  EXPECT_THAT([&] { Estimate(apart); },
              ::testing::ThrowsMessage<Error>(
                  HasSubstr("start and end do not see the same scene: 2 points in common")));
}

TEST(LoopTruth, IsStoppedAtEachStage) {
  const Loop loop = MakeLoop({});
  std::vector<std::string> stages;
  for (size_t stop = 1; stop <= 4; ++stop) {
    stages.clear();
    const auto progress = [&](const std::string& stage) {
      if (stages.empty() || stages.back() != stage) stages.push_back(stage);
      return stages.size() < stop;
    };
    EXPECT_THROW(EstimateLoopTruth({.rig = &loop.rig,
                                    .tracks = &loop.tracks,
                                    .segments = loop.segments,
                                    .progress = progress}),
                 Stopped);
  }
  EXPECT_THAT(stages,
              ElementsAre("start segment", "end segment", "bundle adjustment", "uncertainty"));
}

TEST(LoopTruth, NamesWhatMovedMostAgainstThePrior) {
  Loop loop = MakeLoop({});
  // The right camera's f_x is wrong by 5 standard errors of its prior, which the scene cannot
  // confirm: its own weight is far larger.
  loop.rig.cameras[1].fixed = {false, true, true, true};
  const double sigma = 3;
  loop.rig.cameras[1].params[0] = kFocal + 5 * sigma;
  CalibrationPrior prior;
  prior.unknowns.push_back({.camera = 1, .param = 0, .value = kFocal + 5 * sigma});
  prior.T_camera_rig = {{}, kRight};
  prior.weight = Eigen::MatrixXd::Constant(1, 1, 1 / sigma);
  loop.rig.prior = prior;
  const LoopTruthResult truth = Estimate(loop);
  EXPECT_EQ(truth.prior_unknowns, 1);
  EXPECT_THAT(truth.most_changed, HasSubstr("f_x"));
  const double change = (truth.bundle.cameras[1].params[0] - kFocal) / sigma - 5;
  EXPECT_NEAR(truth.most_changed_sigmas, std::abs(change), 1e-9);
  EXPECT_NEAR(truth.prior_change, change * change, 1e-9);
  EXPECT_LT(change, -4);
  EXPECT_THAT(FindingsOf(truth, false), ::testing::Contains(HasSubstr("the calibration is stale")));
}

TEST(LoopTruth, OfHardLoopsIsTheSameAsBefore) {
  const std::vector<std::pair<LoopOptions, double>> loops{
      {{.points = 40}, -605.3519},
      {{.renumbered = 100, .wrong_matches = 30, .blind = {3}}, -1559.2497},
      {{.points = 60, .renumbered = 60, .wrong_matches = 20, .blind = {1, kFrames + 2}},
       -705.2843}};
  for (const auto& [options, expected] : loops) {
    const LoopTruthResult truth = Estimate(MakeLoop(options));
    Digest digest;
    for (const RigidTransform& T : truth.bundle.T_rig_target) digest.Add(T);
    for (const Matrix6d& covariance : truth.covariance.poses) {
      digest.AddAll(1e4 * Eigen::VectorXd(covariance.diagonal().cwiseSqrt()));
    }
    for (const size_t count : {truth.points, truth.common, truth.observations}) {
      digest.Add(static_cast<double>(count));
    }
    digest.AddAll(truth.rms);
    EXPECT_NEAR(digest.Sum(), expected, 1e-3);
  }
}

// The files.

std::string FileOf(const LoopTruthResult& truth,
                   const LoopTruthContext& context,
                   const char* name) {
  for (const auto& [file, text] : LoopTruthFiles(truth, context)) {
    if (file == name) return text;
  }
  ADD_FAILURE() << "no file " << name;
  return {};
}

TEST(LoopTruth, HasAPageWithTheNumbersOfTheResult) {
  const Loop loop = MakeLoop({.blind = {2}});
  const LoopTruthResult truth = Estimate(loop);
  const LoopTruthContext context{.tracks = &loop.tracks, .findings = {}, .provenance = {}};
  const std::string page = LoopTruthPage(truth, context);
  const size_t begin = page.find("{\"cameras\":");
  ASSERT_NE(begin, std::string::npos);
  const nlohmann::json data =
      nlohmann::json::parse(page.substr(begin, page.find("</script>", begin) - begin));
  EXPECT_EQ(data["frames"].size(), 2 * kFrames - 1);
  size_t observations = 0;
  for (const nlohmann::json& frame : data["frames"]) {
    const auto f = static_cast<size_t>(std::stoi(frame["name"].get<std::string>()));
    observations += frame["observations"].get<size_t>();
    EXPECT_LE(frame["common"], frame["observations"]);
    EXPECT_NEAR(frame["rms"].get<double>(), std::sqrt(2.0) * kNoise, 0.3 * kNoise);
    EXPECT_NEAR(frame["position_sigma"].get<double>(),
                std::sqrt(truth.covariance.poses[f].topLeftCorner<3, 3>().trace()),
                1e-9);
  }
  EXPECT_EQ(observations, truth.observations);
  EXPECT_EQ(data["markers"].size(), truth.points);
  const auto common = std::ranges::count_if(
      data["markers"], [](const nlohmann::json& marker) { return marker["common"].get<bool>(); });
  EXPECT_EQ(common, truth.common);
  const nlohmann::json& segments = data["truth"]["segments"];
  EXPECT_EQ(segments["start"]["left_out"], 1);
  EXPECT_EQ(segments["end"]["left_out"], 0);
  EXPECT_EQ(segments["start"]["frames"],
            nlohmann::json::parse(R"(["00", "01", "03", "04", "05"])"));
  EXPECT_EQ(segments["end"]["path"].size(), kFrames);
  EXPECT_EQ(data["truth"]["floors"].size(), 3);
}

TEST(LoopTruth, HasPathsOfAllCameras) {
  const Loop loop = MakeLoop({});
  const LoopTruthResult truth = Estimate(loop);
  const RigidTransform T_third_rig{ExpRotation({0.1, -0.2, 0.3}), {0.3, 0.2, -0.1}};
  const LoopTruthContext context{.tracks = &loop.tracks,
                                 .others = {{"third", T_third_rig}},
                                 .findings = {"one", "two"},
                                 .provenance = {{"version", "x"}}};
  for (const auto& [camera, T_camera_rig] :
       {std::pair("left", RigidTransform()), {"right", kRight}, {"third", T_third_rig}}) {
    for (const auto& [kind, frames] :
         {std::pair("segments", 2 * kFrames), {"start", kFrames}, {"end", kFrames}}) {
      std::istringstream lines(
          FileOf(truth, context, fmt::format("{}_{}.txt", kind, camera).c_str()));
      std::string head;
      std::getline(lines, head);
      EXPECT_EQ(head.front(), '#');
      size_t row = std::string(kind) == "end" ? kFrames : 0, count = 0;
      for (std::string line; std::getline(lines, line); ++row, ++count) {
        std::istringstream numbers(line);
        double t, x, y, z, qx, qy, qz, qw;
        ASSERT_TRUE(numbers >> t >> x >> y >> z >> qx >> qy >> qz >> qw) << line;
        const RigidTransform T = (T_camera_rig * truth.bundle.T_rig_target[row]).Inverse();
        EXPECT_NEAR(t, loop.tracks.times[row], 1e-6);
        EXPECT_LT((T.t - Eigen::Vector3d(x, y, z)).norm(), 1e-8);
        EXPECT_LT((T.R - Eigen::Quaterniond(qw, qx, qy, qz).toRotationMatrix()).norm(), 1e-9);
      }
      EXPECT_EQ(count, frames);
    }
  }
  const std::string yaml = FileOf(truth, context, "groundtruth.yaml");
  for (const std::string& part :
       {std::string("  start: {frames: 6, left_out: 0, first: \"00\", last: \"05\"}\n"),
        fmt::format("points: {}\ncommon_points: {}\nobservations: {}\nconverged: true\n",
                    truth.points,
                    truth.common,
                    truth.observations),
        std::string("  third: {segments: segments_third.txt}\n"),
        std::string("findings:\n  - one\n  - two\nprovenance:\n  version: x\n")}) {
    EXPECT_THAT(yaml, HasSubstr(part));
  }
  const std::string csv = FileOf(truth, context, "covariance.csv");
  EXPECT_EQ(std::ranges::count(csv, '\n'), 1 + 2 * kFrames);
  const Matrix6d& last = truth.covariance.poses[2 * kFrames - 1];
  EXPECT_THAT(csv, HasSubstr(fmt::format("\n11,{:.9g},{:.9g}", last(0, 0), last(0, 1))));
  EXPECT_THAT(csv, HasSubstr(fmt::format(",{:.9g},{:.9g}\n", last(4, 5), last(5, 5))));
  EXPECT_THAT(FileOf(truth, context, "points.ply"),
              HasSubstr(fmt::format("element vertex {}\n", truth.points)));
  EXPECT_THAT(
      LoopTruthSummary(truth),
      HasSubstr(fmt::format(
          "start: 6 frames, end: 6 frames; {} points, {} of them in both; {} observations\n",
          truth.points,
          truth.common,
          truth.observations)));
}

TEST(LoopTruth, SummaryHasTheLengthsOfTheSigmas) {
  LoopTruthResult truth = Estimate(MakeLoop({}));
  truth.covariance.scale_sigma = 0.0075;
  Eigen::Matrix<double, 14, 1> variances;
  variances << Vector7d::Zero(), 1e-6, 4e-6, 4e-6, 1e-6, 4e-6, 20e-6, 4e-6;
  truth.covariance.segments = variances.asDiagonal();
  EXPECT_THAT(LoopTruthSummary(truth),
              HasSubstr("scale: +- 0.750 %\nend against start: +- 3 mm, 5 mrad, 0.2 % of scale\n"));
}

TEST(LoopTruth, NamesItsWeaknesses) {
  const LoopTruthResult truth = Estimate(MakeLoop({}));
  EXPECT_THAT(FindingsOf(truth, false),
              ElementsAre(HasSubstr("the calibration states no standard errors")));
  LoopTruthResult weak = truth;
  weak.bundle.prior.emplace();
  weak.covariance.scale_sigma = 0.012;
  weak.covariance.track_factor = 9;
  weak.converged = false;
  EXPECT_THAT(FindingsOf(weak, false),
              ElementsAre(HasSubstr("the scale is known to 1.2 % only"),
                          HasSubstr("are 3.0 times those of the noise alone"),
                          HasSubstr("has not converged")));
  weak.covariance.scale_sigma = 0.01;
  weak.covariance.track_factor = 2;
  weak.converged = true;
  weak.most_changed_sigmas = 4;
  EXPECT_THAT(FindingsOf(weak, true), IsEmpty());
  // A path along a line, or at one place.
  for (const double length : {1.0, 0.0}) {
    for (size_t i = 0; i < kFrames; ++i) {
      weak.bundle.T_rig_target[kFrames + i] = {Eigen::Matrix3d::Identity(),
                                               {length * static_cast<double>(i), 0, 0}};
    }
    EXPECT_THAT(FindingsOf(weak, false),
                ElementsAre(HasSubstr("the end segment moves along a line")));
  }
}

// The choice of the segments.

SceneTracks Frames(size_t count, double period, const std::set<size_t>& with_points = {}) {
  SceneTracks tracks;
  tracks.views.resize(1);
  for (size_t i = 0; i < count; ++i) {
    tracks.frames.push_back(fmt::format("f{:02}", i));
    if (period > 0) tracks.times.push_back(1000 + period * static_cast<double>(i));
    View& view = tracks.views[0].emplace_back();
    view.frame = tracks.frames.back();
    for (int k = 0; k < 30; ++k) {
      Observation& seen = view.observations.emplace_back();
      seen.marker = with_points.contains(i) ? k : 1000 * static_cast<int>(1 + i) + k;
    }
  }
  return tracks;
}

std::string Segments(const SceneTracks& tracks, const SegmentChoice& choice) {
  try {
    const LoopSegments segments = ChooseTrackedSegments(tracks, choice);
    return fmt::format("{}-{} {}-{}",
                       segments.start.front(),
                       segments.start.back(),
                       segments.end.front(),
                       segments.end.back());
  } catch (const Error& error) {
    return error.what();
  }
}

TEST(Segments, AreNamedBySecondsOrFrames) {
  const SceneTracks tracks = Frames(20, 2);
  EXPECT_EQ(Segments(tracks, {":10", "30:"}), "0-4 15-19");  // the end of a time does not belong
  EXPECT_EQ(Segments(tracks, {"2:10.5", "29:31"}), "1-5 15-15");
  EXPECT_EQ(Segments(tracks, {"f02:f04", "f06:f06"}), "2-4 6-6");
  EXPECT_EQ(
      Segments(tracks, {"f02:f04", "f04:"}),
      "--start, --end: the end segment begins at frame 'f04', before the start segment ends at "
      "'f04'");
  EXPECT_EQ(Segments(tracks, {"f02:f04", "f05:"}), "2-4 5-19");
  EXPECT_EQ(Segments(tracks, {"5", "f05:"}),
            "--start 5: no ':'; write A:B, names of frames or seconds");
  EXPECT_EQ(Segments(tracks, {":f33", "f05:"}),
            "--start :f33: no frame 'f33'; write A:B, names of frames or seconds");
  EXPECT_EQ(Segments(tracks, {"f3x:f33", "f05:"}),
            "--start f3x:f33: no frame 'f3x'; write A:B, names of frames or seconds");
  EXPECT_EQ(Segments(tracks, {":f01", "nan:"}),
            "--end nan:: no frame 'nan'; write A:B, names of frames or seconds");
  EXPECT_EQ(Segments(tracks, {":f01", "50:60"}),
            "--end 50:60: no frames lie there; write A:B, names of frames or seconds");
  EXPECT_EQ(Segments(Frames(20, 0), {":5", "f07:"}),
            "--start :5: no frame '5'; write A:B, names of frames");
}

TEST(Segments, AreTheFirstSecondsAndWhatSeesThemAgain) {
  EXPECT_EQ(Segments(Frames(20, 2, {0, 12, 13}), {}), "0-7 12-19");
  EXPECT_EQ(Segments(Frames(20, 2, {0, 9, 13}), {}), "0-7 13-19");  // the first half is no end
  EXPECT_EQ(Segments(Frames(20, 2, {0, 10}), {}), "0-7 10-19");
  EXPECT_EQ(Segments(Frames(20, 0, {3, 12}), {}), "0-3 12-19");  // a sixth, rounded up
  EXPECT_EQ(Segments(Frames(20, 0, {4, 12}), {}),
            "start and end do not see the same scene: 0 points in common; give --start and --end");
  SceneTracks few = Frames(20, 0, {0, 12});
  few.views[0][12].observations.pop_back();
  EXPECT_EQ(Segments(few, {}),
            "start and end do not see the same scene: 29 points in common; give --start and --end");
}

TEST(Segments, LieBeforeAndAfterTheLargestGap) {
  SceneTracks tracks = Frames(20, 2, {0, 12});
  for (size_t i = 8; i < 20; ++i) tracks.times[i] += 300;
  EXPECT_EQ(Segments(tracks, {}), "0-7 8-19");
  EXPECT_EQ(Segments(tracks, {"f00:f02", ""}), "0-2 12-19");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
