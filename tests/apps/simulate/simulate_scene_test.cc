// SPDX-License-Identifier: Apache-2.0
//
// `plenocal simulate` of scenes without a target: recordings with known truth.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>
#include <string>

#include "calib/files/calibration_tables.h"
#include "calib/files/detections.h"
#include "engine/session/calibration_folder.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

class SimulateScene : public Workspace {
 protected:
  SimulateScene() { UseExample("loop.yaml"); }

  void UseExample(const std::string& name) const {
    fs::copy_file(fs::path(PLENOCAL_EXAMPLES) / "simulate" / name,
                  Path("spec.yaml"),
                  fs::copy_options::overwrite_existing);
  }
  void Change(const std::string& from, const std::string& to) const {
    Write("spec.yaml", Replaced(Read("spec.yaml"), from, to));
  }
  void Make(const std::string& out = "set", const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments{"simulate", "spec.yaml", "-o", out, "--points"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const Outcome outcome = Run(arguments);
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
  }
  [[nodiscard]] CalibrationRecord Calibration(const std::string& file) const {
    return OpenCalibration(Path(file));
  }
  [[nodiscard]] std::vector<View> Tracks(const CalibratedCamera& camera) const {
    return ReadDetections(Path("set/tracks_" + camera.name + ".csv"), *camera.model);
  }
  [[nodiscard]] std::map<int, Eigen::Vector3d> Points() const {
    const Table table(Read("set/truth/points.csv"));
    const auto marker = table.Numbers("marker"), x = table.Numbers("x"), y = table.Numbers("y"),
               z = table.Numbers("z");
    std::map<int, Eigen::Vector3d> points;
    for (std::size_t i = 0; i < marker.size(); ++i) {
      points[static_cast<int>(marker[i])] = {x[i], y[i], z[i]};
    }
    return points;
  }
  [[nodiscard]] std::map<std::string, RigidTransform> Poses() const {
    std::map<std::string, RigidTransform> poses;
    for (const FrameRecord& frame : ReadPoses(Path("set/truth/poses.csv"))) {
      poses[frame.name] = frame.T_target_rig;
    }
    return poses;
  }
  /// Markers that are tracked in the first or the second half of the frames of camera left.
  [[nodiscard]] std::set<int> Tracked(bool second_half) const {
    const std::vector<View> views = Tracks(Calibration("set/truth/calibration.yaml").cameras[0]);
    std::set<int> markers;
    for (const View& view : views) {
      if ((view.frame >= std::string("000100")) != second_half) continue;
      for (const Observation& seen : view.observations) markers.insert(seen.marker);
    }
    return markers;
  }
  void ExpectRefused(const std::vector<std::string>& parts) const {
    const Outcome outcome = Run({"simulate", "spec.yaml", "-o", "set", "--points"});
    EXPECT_EQ(outcome.status, kWrongInput) << outcome.err;
    EXPECT_EQ(Lines(outcome.err).size(), 1U) << outcome.err;
    for (const std::string& part : parts) EXPECT_THAT(outcome.err, HasSubstr(part));
    EXPECT_TRUE(Files("set").empty());
  }
};

/// RMS of each coordinate's error of the tracks against points, poses and cameras; the number of
/// coordinates.
struct TrackErrors {
  double rms = 0, largest = 0;
  int count = 0;
};

TrackErrors ErrorsOf(const std::vector<View>& views,
                     const CalibratedCamera& camera,
                     const std::map<std::string, RigidTransform>& poses,
                     const std::map<int, Eigen::Vector3d>& points) {
  TrackErrors errors;
  for (const View& view : views) {
    const RigidTransform T_camera_world = camera.T_camera_rig * poses.at(view.frame).Inverse();
    for (const Observation& seen : view.observations) {
      std::array<double, 4> predicted{};
      const bool is_imaged = camera.model->Project(camera.params.data(),
                                                   camera.config.data(),
                                                   seen.values.data(),
                                                   T_camera_world * points.at(seen.marker),
                                                   predicted.data());
      EXPECT_TRUE(is_imaged);
      for (std::size_t i = 0; i < 2; ++i) {
        const double error = seen.values[i] - predicted[i];
        errors.rms += error * error;
        errors.largest = std::max(errors.largest, std::abs(error));
        ++errors.count;
      }
    }
  }
  errors.rms = std::sqrt(errors.rms / std::max(errors.count, 1));
  return errors;
}

TEST_F(SimulateScene, TracksAreTheTruePointsWithNoise) {
  Change("wrong_matches: 0.05", "wrong_matches: 0");
  Change("moving: 0.1", "moving: 0");
  Make();
  const CalibrationRecord truth = Calibration("set/truth/calibration.yaml");
  const std::map<std::string, double> sigma{{"left", 0.3}, {"right", 0.3}, {"plenoptic", 0.15}};
  for (const CalibratedCamera& camera : truth.cameras) {
    SCOPED_TRACE(camera.name);
    const TrackErrors errors = ErrorsOf(Tracks(camera), camera, Poses(), Points());
    EXPECT_GT(errors.count, 1000);
    EXPECT_NEAR(errors.rms, sigma.at(camera.name), 0.03 * sigma.at(camera.name));
    EXPECT_LT(errors.largest, 6 * sigma.at(camera.name));
  }
}

TEST_F(SimulateScene, WrongMatchesAndMovingPointsAreNamed) {
  Change("wrong_matches: 0.05", "wrong_matches: 0.2");
  Make();
  const CalibratedCamera left = Calibration("set/truth/calibration.yaml").cameras[0];
  const Table wrong(Read("set/truth/wrong_matches_left.csv"));
  const std::vector<std::string> frames = wrong.Column("frame"), markers = wrong.Column("marker");
  std::set<std::pair<std::string, int>> is_wrong;
  for (std::size_t i = 0; i < frames.size(); ++i) is_wrong.emplace(frames[i], stoi(markers[i]));
  std::set<int> moving;
  for (const double marker : Table(Read("set/truth/moving.csv")).Numbers("marker")) {
    moving.insert(static_cast<int>(marker));
  }
  EXPECT_EQ(moving.size(), 50U);
  std::vector<View> views = Tracks(left);
  std::size_t all = 0, of_moving = 0;
  for (View& view : views) {
    all += view.observations.size();
    std::erase_if(view.observations, [&](const Observation& seen) {
      const bool is_moving = moving.contains(seen.marker);
      of_moving += is_moving ? 1 : 0;
      return is_moving || is_wrong.contains({view.frame, seen.marker});
    });
  }
  EXPECT_NEAR(static_cast<double>(is_wrong.size()) / static_cast<double>(all), 0.2, 0.03);
  EXPECT_GT(of_moving, 20U);
  // What is not named is right.
  EXPECT_LT(ErrorsOf(views, left, Poses(), Points()).largest, 6 * 0.3);
}

TEST_F(SimulateScene, SameSeedSameFilesWhateverTheThreads) {
  Make("a", {"--threads", "1"});
  Make("b", {"--threads", "3"});
  for (const char* file : {"tracks_left.csv",
                           "tracks_plenoptic.csv",
                           "calibration.yaml",
                           "recording.yaml",
                           "session.yaml",
                           "truth/points.csv",
                           "truth/segments_right.txt"}) {
    // Not EXPECT_EQ, which would print the files. The provenance names the folder.
    const auto text = [&](const std::string& folder) {
      const std::string all = Read(folder + "/" + file);
      return all.substr(0, all.find("provenance:"));
    };
    EXPECT_FALSE(text("a").empty()) << file;
    EXPECT_TRUE(text("a") == text("b")) << file;
  }
  Change("seed: 5", "seed: 6");
  Make("c");
  EXPECT_NE(Read("a/truth/points.csv"), Read("c/truth/points.csv"));
  EXPECT_NE(Read("a/truth/poses.csv"), Read("c/truth/poses.csv"));
}

TEST_F(SimulateScene, GivenCalibrationHasErrorsOfItsSigmas) {
  double squares = 0;
  int count = 0;
  for (int seed = 1; seed <= 8; ++seed) {
    UseExample("loop.yaml");
    Change("seed: 5", "seed: " + std::to_string(seed));
    Change("points: 500", "points: 20");
    Make();
    const CalibrationRecord given = Calibration("set/calibration.yaml"),
                            truth = Calibration("set/truth/calibration.yaml");
    for (std::size_t c = 0; c < truth.cameras.size(); ++c) {
      for (std::size_t i = 0; i < truth.cameras[c].params.size(); ++i) {
        const double error = given.cameras[c].params[i] - truth.cameras[c].params[i];
        const double sigma = given.cameras[c].Sigma(i);
        if (sigma == 0) {
          EXPECT_EQ(error, 0);
          continue;
        }
        squares += error * error / (sigma * sigma);
        ++count;
      }
      const Vector6d shift =
          Log(given.cameras[c].T_camera_rig) - Log(truth.cameras[c].T_camera_rig);
      for (int i = 0; i < 6; ++i) {
        const double sigma = given.cameras[c].sigma_xi[i];
        EXPECT_EQ(sigma == 0, c == 0);
        if (sigma == 0) continue;
        squares += shift[i] * shift[i] / (sigma * sigma);
        ++count;
      }
    }
    EXPECT_EQ(given.cameras[0].Sigma(0), 0.15);
    EXPECT_EQ(given.cameras[2].Sigma(0), 2e-6);
  }
  EXPECT_EQ(count, 8 * (4 + 4 + 4 + 2 * 6));
  EXPECT_NEAR(squares / count, 1, 4 * std::sqrt(2.0 / count));
}

TEST_F(SimulateScene, TheEndSeesTheStartsPointsUnlessItShallNot) {
  const auto common = [&] {
    const std::set<int> start = Tracked(false), end = Tracked(true);
    return std::ranges::count_if(start, [&](int marker) { return end.contains(marker); });
  };
  Make();
  EXPECT_GT(common(), 100);
  Change("kind: loop", "kind: no-overlap");
  Make();
  EXPECT_EQ(common(), 0);
  UseExample("loop.yaml");
  Change("moving: 0.1", "merged: 0.1");
  Make();
  EXPECT_GT(common(), 10);
  EXPECT_LT(common(), 80);
}

TEST_F(SimulateScene, SegmentsAreTheCamerasPathsInTheWorld) {
  Make();
  const CalibrationRecord truth = Calibration("set/truth/calibration.yaml");
  const auto poses = Poses();
  EXPECT_EQ(poses.size(), 40U);
  EXPECT_EQ(Lines(Read("set/times.txt")).size(), 41U);
  for (const CalibratedCamera& camera : truth.cameras) {
    const auto segments = Lines(Read("set/truth/segments_" + camera.name + ".txt"));
    const auto whole = Lines(Read("set/truth/trajectory_" + camera.name + ".txt"));
    EXPECT_EQ(segments.size(), 1U + 41 + 41);  // 4 s at 10 Hz each
    EXPECT_EQ(whole.size(), 1U + 201);         // 8 m at 0.4 m/s
    double time = 0;
    Eigen::Vector3d position;
    std::istringstream(segments[1]) >> time >> position.x() >> position.y() >> position.z();
    const RigidTransform T = poses.at("000000") * camera.T_camera_rig.Inverse();
    EXPECT_LT((position - T.t).norm(), 1e-9);
  }
}

TEST_F(SimulateScene, BadPathsAreBadInTheirOwnWay) {
  const auto start_extent = [&] {
    Eigen::MatrixXd positions(3, 20);
    int column = 0;
    for (const auto& [name, T] : Poses()) {
      if (column < 20) positions.col(column++) = T.t;
    }
    positions.colwise() -= positions.rowwise().mean().eval();
    return Eigen::JacobiSVD<Eigen::MatrixXd>(positions).singularValues().eval();
  };
  Make();
  EXPECT_GT(start_extent()[1], 0.1 * start_extent()[0]);
  Change("kind: loop", "kind: straight");
  Change("  rate: 10 ", "  shake: 0\n  rate: 10 ");
  Make();
  EXPECT_LT(start_extent()[1], 0.05 * start_extent()[0]);
  Change("kind: straight", "kind: rotation");
  Make();
  EXPECT_EQ(start_extent()[0], 0);
  Change("kind: rotation", "kind: one-depth");
  Make();
  double nearest = 1e9, farthest = 0;
  const CalibratedCamera left = Calibration("set/truth/calibration.yaml").cameras[0];
  const auto points = Points();
  const auto poses = Poses();
  for (const View& view : Tracks(left)) {
    for (const Observation& seen : view.observations) {
      if (!points.contains(seen.marker)) continue;
      const double depth = (poses.at(view.frame).Inverse() * points.at(seen.marker)).z();
      nearest = std::min(nearest, depth), farthest = std::max(farthest, depth);
    }
  }
  EXPECT_LT(farthest, 1.11 * nearest);
}

TEST_F(SimulateScene, HandheldFramesTurnAndRollAndSessionHasDistances) {
  UseExample("scene_free.yaml");
  Make();
  EXPECT_EQ(Poses().size(), 40U);
  double most_roll = 0;
  for (const auto& [name, T] : Poses()) {
    most_roll = std::max(most_roll, std::abs(std::asin(T.R.col(0).z())));
  }
  EXPECT_GT(most_roll, 0.4);
  const YAML::Node session = YAML::Load(Read("set/session.yaml"));
  const auto points = Points();
  ASSERT_EQ(session["scene"]["distances"].size(), 4U);
  for (const YAML::Node& distance : session["scene"]["distances"]) {
    const auto point = [&](int i) {
      return points.at(std::stoi(distance["between"][i].as<std::string>().substr(6)));
    };
    EXPECT_NEAR((point(0) - point(1)).norm(), distance["value"].as<double>(), 5 * 0.0005);
  }
}

TEST_F(SimulateScene, RepeatsAGivenTrajectory) {
  Make();
  fs::copy(Path("set/truth/trajectory_left.txt"), Path("path.txt"));
  const auto before = Poses();
  Change("  kind: loop\n", "");
  Change("  length: 8                        # m\n", "");
  Change("  speed: 0.4                       # m/s\n", "");
  Change("  rate: 10                         # frames a second\n", "  file: path.txt\n");
  Change("  winding: {amplitude: 0.15, seconds: 3}\n", "");
  Make();
  const auto after = Poses();
  ASSERT_EQ(after.size(), before.size());
  for (const auto& [name, T] : after) EXPECT_LT((T.t - before.at(name).t).norm(), 1e-9) << name;
}

// Pixels of an image are where the rays of the model meet the surfaces whose points are tracked:
// what the left camera sees around a point, the right one sees around its true projection.
TEST_F(SimulateScene, ImagesShowTheSamePointsAsTracks) {
  Change("frames: 20", "frames: 2");
  Change("track_length: 20                 # frames, mean", "boxes: 0");
  Change("moving: 0.1", "moving: 0");
  const std::string spec = Read("spec.yaml");
  Write("spec.yaml", spec.substr(0, spec.find("  plenoptic:\n    model")));
  Change("  parameters: {plenoptic: {f_L: 2e-6, B: 1e-6}}\n", "");
  Make();
  const Outcome outcome = Run({"simulate", "spec.yaml", "-o", "images"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const CalibrationRecord truth = Calibration("set/truth/calibration.yaml");
  const auto points = Points();
  const auto poses = Poses();
  int checked = 0;
  for (const auto& [frame, T_world_rig] : poses) {
    std::array<cv::Mat, 2> image;
    for (std::size_t c = 0; c < 2; ++c) {
      const std::string file = "images/" + truth.cameras[c].name + "/" + frame + ".png";
      image[c] = cv::imread(Path(file).string(), cv::IMREAD_GRAYSCALE);
      ASSERT_EQ(image[c].size(), cv::Size(640, 512));
    }
    for (const auto& [marker, position] : points) {
      constexpr int kHalf = 7;  // px, of the compared patches
      std::array<cv::Mat, 2> patch;
      for (std::size_t c = 0; c < 2; ++c) {
        const CalibratedCamera& camera = truth.cameras[c];
        const Eigen::Vector3d p = camera.T_camera_rig * T_world_rig.Inverse() * position;
        std::array<double, 4> u{};
        if (!camera.model->Project(
                camera.params.data(), camera.config.data(), u.data(), p, u.data()) ||
            !(u[0] > 20 && u[0] < 620 && u[1] > 20 && u[1] < 490)) {
          break;
        }
        cv::getRectSubPix(image[c],
                          {2 * kHalf + 1, 2 * kHalf + 1},
                          cv::Point2f(static_cast<float>(u[0]), static_cast<float>(u[1])),
                          patch[c]);
      }
      if (patch[0].empty() || patch[1].empty()) continue;
      cv::Mat match;
      cv::matchTemplate(patch[0], patch[1], match, cv::TM_CCOEFF_NORMED);
      // Seen obliquely the patches differ in shape.
      EXPECT_GT(match.at<float>(0, 0), 0.25) << frame << " " << marker;
      ++checked;
    }
  }
  EXPECT_GT(checked, 100);
}

TEST_F(SimulateScene, NamesWhatIsWrongInTheSpecification) {
  const std::string good = Read("spec.yaml");
  const std::vector<std::array<std::string, 4>> cases{
      {"points: 500", "pionts: 500", "spec.yaml:7", "points"},
      {"far: 1.2", "far: 0.2", "spec.yaml:9", "near"},
      {"kind: loop", "kind: lop", "spec.yaml:14", "loop"},
      {"kind: loop", "kind: []", "spec.yaml:14", "empty"},
      {"kind: loop", "kind: [handheld, repeated]", "spec.yaml:14", "'loop' only"},
      {"kind: loop", "kind: [loop, no-turning]", "spec.yaml:14", "'handheld' only"},
      {"kind: loop", "kind: straight\n  overlap: 1\n  length: 4", "spec.yaml", "length"},
      {"length: 8 ", "length: 3 ", "spec.yaml:15", "shorter than a start and an end"},
      {"amplitude: 0.15", "amplitud: 0.15", "spec.yaml:19", "amplitude"},
      {"f_L: 2e-6", "f_M: 2e-6", "spec.yaml:25", "f_L"},
      {"{plenoptic: {f_L", "{plenopti: {f_L", "spec.yaml:25", "plenoptic"},
      {"seed: 5", "seed: 5\ntarget: board.yaml", "spec.yaml:6", "in place of"},
      {"  kind: loop\n", "  file: path.txt\n", "spec.yaml:15", "length"}};
  for (const auto& [from, to, place, part] : cases) {
    SCOPED_TRACE(to);
    Write("spec.yaml", Replaced(good, from, to));
    ExpectRefused({place, part});
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
