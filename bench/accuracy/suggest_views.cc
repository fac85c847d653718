// SPDX-License-Identifier: Apache-2.0
//
// Frames until a goal: suggested views against random ones and greedy coverage, in simulation
// (docs/suggest.md). Usage: suggest_views CLASS SEED [without-coverage], one camera; CSV on
// standard output.
#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <numbers>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "assess/compare.h"
#include "assess/views/micro_lens_visibility.h"
#include "assess/views/next_views.h"
#include "assess/views/view_information.h"
#include "calib/base/error.h"
#include "calib/camera/micro_lens_array.h"
#include "calib/estimate/calibrate.h"
#include "calib/estimate/describe.h"
#include "models/registry.h"

namespace plenocal {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr int kStart = 4, kRandomFrames = 20, kMostFrames = 40;
constexpr double kNoise = 0.1, kFrameError = 0.03;  // px
constexpr double kBend = 0.0003;                    // m
constexpr double kExecutionAngle = 5 * kDegree, kExecutionPart = 0.05;
constexpr ImageSize kImage{1280, 960};

class Dice {
 public:
  explicit Dice(unsigned seed) : engine_(seed) {}
  double Uniform(double a, double b) { return std::uniform_real_distribution(a, b)(engine_); }
  double Gaussian(double sigma) { return std::normal_distribution(0.0, sigma)(engine_); }
  size_t Index(size_t count) {
    return std::uniform_int_distribution<size_t>(0, count - 1)(engine_);
  }

 private:
  std::mt19937 engine_;
};

constexpr double kBoard = 0.66;  // m, width of the board at scale 1

// 6 x 6 tags of 88 mm, gaps of 26 mm; both times `scale`.
ViewTarget Board(double scale) {
  ViewTarget board{.markers = {}};
  for (int tag = 0; tag < 36; ++tag) {
    for (int k = 0; k < 4; ++k) {
      const double x = tag % 6 * 0.1144 + (k == 1 || k == 2 ? 0.088 : 0),
                   y = tag / 6 * 0.1144 + (k >= 2 ? 0.088 : 0);
      board.markers[4 * tag + k] = scale * Eigen::Vector3d(x, y, 0);
      board.normals[4 * tag + k] = -Eigen::Vector3d::UnitZ();
    }
  }
  const double a = scale * kBoard;
  board.outlines = {{{0, 0, 0}, {a, 0, 0}, {a, a, 0}, {0, a, 0}}};
  board.finest = scale * 0.011;  // a bit
  board.found_in_part = true;
  return board;
}

struct World {
  std::string name;
  RigEstimate truth;
  ViewTarget board;
  double bend = kBend;                     // m
  std::map<int, Eigen::Vector3d> markers;  // of the bent board
  ViewRange range = {};                    // that the user states; of plenoptic cameras

  [[nodiscard]] bool IsPlenoptic() const { return truth.bundle.cameras[0].model->plenoptic; }
};

BundleCamera Lens(const std::string& kind, Dice* dice, bool master) {
  double lo = 30, hi = 95;
  if (kind == "narrow") lo = 10, hi = 30;
  if (kind == "fisheye") lo = 110, hi = 190;
  const double half = dice->Uniform(lo, hi) / 2 * kDegree;
  const bool fisheye = kind == "fisheye";
  BundleCamera camera{
      .name = master ? "left" : "right",
      .image_size = kImage,
      .model = FindModel(CameraModels(), fisheye ? "kannala-brandt4" : "pinhole-radtan4"),
      .config = {},
      .params = {},
      .fixed = std::vector<bool>(8, false),
      .T_camera_rig = {},
      .is_master = master};
  const double f = fisheye ? 640 / half : 640 / std::tan(half);
  const double c_x = 639.5 + dice->Uniform(-40, 40), c_y = 479.5 + dice->Uniform(-30, 30);
  const double edge = fisheye ? half : std::tan(half);
  const auto term = [&](double low, double high, int power) {
    return dice->Uniform(low, high) / std::pow(edge, power);
  };
  if (fisheye) {
    camera.params = {f, f, c_x, c_y, term(-0.05, 0.05, 2), term(-0.01, 0.01, 4), 0, 0};
  } else {
    camera.params = {f,
                     f * dice->Uniform(0.99, 1.01),
                     c_x,
                     c_y,
                     term(-0.15, 0.05, 2),
                     term(0, 0.03, 4),
                     dice->Uniform(-1e-3, 1e-3),
                     dice->Uniform(-1e-3, 1e-3)};
  }
  return camera;
}

// A hexagonal array that fills the image, 20 px apart.
MicroLensArray LensesShowing(ImageSize size, Dice* dice) {
  constexpr double kPitch = 20;
  constexpr int kReach = 100;
  const double turn = dice->Uniform(-0.5, 0.5);
  MicroLensArray array;
  array.image_size = size;
  array.e_column = kPitch * Eigen::Vector2d(std::cos(turn), std::sin(turn));
  const double sixth = turn + std::numbers::pi / 3;
  array.e_row = kPitch * Eigen::Vector2d(std::cos(sixth), std::sin(sixth));
  for (int row = -kReach; row <= kReach; ++row) {
    for (int column = -kReach; column <= kReach; ++column) {
      const Eigen::Vector2d centre =
          Eigen::Vector2d(size[0], size[1]) / 2 + column * array.e_column + row * array.e_row;
      if (centre.minCoeff() < 0 || centre.x() >= size[0] || centre.y() >= size[1]) continue;
      array.lenses.push_back({row, column, centre});
    }
  }
  return array;
}

// A plenoptic camera whose virtual depth is from 2.5 on between 0.6 and 1.4 times the distance at
// which the board, made to suit, fills its image.
void AddPlenoptic(Dice* dice, World* world) {
  constexpr double kPixel = 5.5e-6, kLeastDepth = 2.5;
  const double f_L = dice->Uniform(0.012, 0.035);
  const double distance = dice->Uniform(12, 25) * f_L;
  const double half = kImage[0] * kPixel / 2;
  const double scale = 2 * distance * half / f_L / kBoard;
  world->range = {0.6 * distance, 1.4 * distance};
  world->board = Board(scale);
  world->bend *= scale;
  const double nearest = f_L * world->range.farthest / (world->range.farthest - f_L);
  const double farthest = f_L * world->range.nearest / (world->range.nearest - f_L);
  const double B = (farthest - nearest) / dice->Uniform(2, 4);
  world->truth.bundle.cameras.push_back(
      {.name = "plenoptic",
       .image_size = kImage,
       .model = FindModel(CameraModels(), "focused-plenoptic"),
       .config = {kPixel},
       .params = {f_L,
                  nearest - kLeastDepth * B,
                  B,
                  kImage[0] / 2.0 + dice->Uniform(-30, 30),
                  kImage[1] / 2.0 + dice->Uniform(-30, 30),
                  dice->Uniform(-0.01, 0.01) / std::pow(half, 2),
                  dice->Uniform(-0.002, 0.002) / std::pow(half, 4),
                  dice->Uniform(-3e-4, 3e-4) / half,
                  dice->Uniform(-3e-4, 3e-4) / half},
       .fixed = std::vector<bool>(9, false),
       .T_camera_rig = {},
       .is_master = true});
  world->truth.lenses = {LensesShowing(kImage, dice)};
}

World MakeWorld(const std::string& kind, unsigned seed) {
  Dice dice(seed);
  World world{
      .name = fmt::format("{}{}", kind, seed), .truth = {}, .board = Board(1), .markers = {}};
  const std::string lens = kind == "stereo" ? "normal" : kind;
  Bundle& bundle = world.truth.bundle;
  if (kind == "plenoptic") {
    AddPlenoptic(&dice, &world);
  } else {
    bundle.cameras.push_back(Lens(lens, &dice, true));
  }
  if (kind == "stereo") {
    bundle.cameras.push_back(Lens(lens, &dice, false));
    bundle.cameras[1].T_camera_rig = {
        ExpRotation({dice.Gaussian(0.03), dice.Gaussian(0.03), dice.Gaussian(0.03)}),
        {-0.12, 0, 0}};
  }
  world.markers = world.board.markers;
  const Eigen::Vector3d middle = MiddleOf(world.board);
  for (auto& [number, p] : world.markers) {
    const double x = p.x() / middle.x() - 1, y = p.y() / middle.y() - 1;
    p.z() += world.bend * (x * x - 0.5 * y * y);
    bundle.markers.push_back({number, p, p});
  }
  world.truth.sigma_px.assign(bundle.cameras.size(), kNoise);
  world.truth.factors.assign(bundle.cameras.size(), 1);
  if (kind != "plenoptic") world.truth.lenses.resize(bundle.cameras.size());
  return world;
}

// Poses that a person may take before the true cameras.
struct Pool {
  std::vector<TargetPose> poses;
  std::vector<RigidTransform> T_rig_target;
  std::vector<std::vector<TargetVisibility>> visibilities;  // per pose and camera
};

Pool Feasible(const World& world) {
  Pool pool;
  const RigEstimate& truth = world.truth;
  const ViewTarget& board = world.board;
  const RigUnknowns unknowns = MakeRigUnknowns(truth.bundle, 1);
  const ViewPredictor predictor(truth, unknowns, board);
  for (size_t c = 0; c < truth.bundle.cameras.size(); ++c) {
    const ViewRange range = FeasibleRange(truth, c, board, {}, world.range);
    for (const TargetPose& pose : CandidatePoses(truth, c, board, range, 50 * kDegree)) {
      const auto T = PlaceTarget(truth, board, pose);
      if (!T) continue;
      const RigidTransform T_rig_target = truth.bundle.cameras[c].T_camera_rig.Inverse() * *T;
      std::vector<TargetVisibility> visibilities;
      for (size_t other = 0; other < truth.bundle.cameras.size(); ++other) {
        visibilities.push_back(predictor.PredictVisibility(other, T_rig_target, 40));
      }
      if (!visibilities[c].found) continue;
      pool.poses.push_back(pose);
      pool.T_rig_target.push_back(T_rig_target);
      pool.visibilities.push_back(std::move(visibilities));
    }
  }
  return pool;
}

RigidTransform Execute(const World& world,
                       const TargetPose& pose,
                       const RigidTransform& T,
                       Dice* dice) {
  const RigidTransform& T_camera_rig = world.truth.bundle.cameras[pose.camera].T_camera_rig;
  const RigidTransform T_camera_target = T_camera_rig * T;
  const Eigen::Vector3d middle_of_board = MiddleOf(world.board);
  const Eigen::Vector3d middle = T_camera_target * middle_of_board;
  const double angle = kExecutionAngle / std::sqrt(3.0);
  const Eigen::Matrix3d R =
      ExpRotation({dice->Gaussian(angle), dice->Gaussian(angle), dice->Gaussian(angle)}) *
      T_camera_target.R;
  const Eigen::Vector3d place = (1 + dice->Gaussian(kExecutionPart)) * middle;
  return T_camera_rig.Inverse() * RigidTransform{R, place - R * middle_of_board};
}

// Points of a marker in the image of a camera, without errors, and px of a bit there (of a
// plenoptic camera not known: 0).
struct Imaged {
  std::vector<Observation> points;
  double bit = 0;
};

Imaged ImagesOf(const World& world,
                size_t c,
                const MicroLensVisibility& lenses,
                const RigidTransform& T,
                const Eigen::Vector3d& p) {
  const BundleCamera& camera = world.truth.bundle.cameras[c];
  Imaged imaged;
  const auto project = [&](const Eigen::Vector3d& point, Observation* seen) {
    Eigen::Vector2d u;
    if (!camera.model->Project(
            camera.params.data(), camera.config.data(), seen->values.data(), point, u.data())) {
      return false;
    }
    seen->values[0] = u.x();
    seen->values[1] = u.y();
    return true;
  };
  if (camera.model->plenoptic) {
    constexpr size_t kAll = 1000;
    for (const Eigen::Vector2d& centre : lenses.LensesShowing(camera, p, kAll).centres) {
      Observation seen{.values = {0, 0, centre.x(), centre.y()}};
      if (project(p, &seen)) imaged.points.push_back(seen);
    }
    return imaged;
  }
  Observation seen, moved;
  if (!project(p, &seen) || !project(p + T.R * Eigen::Vector3d(world.board.finest, 0, 0), &moved)) {
    return imaged;
  }
  if (std::min(seen.values[0], seen.values[1]) < 3 || seen.values[0] > kImage[0] - 4 ||
      seen.values[1] > kImage[1] - 4) {
    return imaged;
  }
  const auto ray =
      camera.model->Unproject(camera.params.data(), camera.config.data(), seen.values.data());
  if (!ray || ray->direction.dot(p.normalized()) < 0.999) return imaged;
  imaged.bit = std::hypot(moved.values[0] - seen.values[0], moved.values[1] - seen.values[1]);
  imaged.points.push_back(seen);
  return imaged;
}

// Images of one frame. The noise grows with tilt and distance by a law that nobody is told.
void Record(const World& world,
            const RigidTransform& T_rig_target,
            int frame,
            Dice* dice,
            std::vector<CameraInput>* cameras) {
  for (size_t c = 0; c < cameras->size(); ++c) {
    const RigidTransform T = world.truth.bundle.cameras[c].T_camera_rig * T_rig_target;
    const MicroLensVisibility lenses =
        world.IsPlenoptic() ? MicroLensVisibility(world.truth.lenses[c]) : MicroLensVisibility();
    View view{.frame = fmt::format("{:03}", frame), .observations = {}};
    Eigen::Matrix2d shared;
    for (double& value : shared.reshaped()) value = dice->Gaussian(kFrameError);
    size_t found = 0;
    for (const auto& [number, position] : world.markers) {
      const Eigen::Vector3d p = T * position;
      const double facing = -(T.R * -Eigen::Vector3d::UnitZ()).dot(p.normalized());
      if (facing < 0.2) continue;
      const Imaged imaged = ImagesOf(world, c, lenses, T, p);
      constexpr size_t kFewestLenses = 2;
      if (imaged.points.size() < (world.IsPlenoptic() ? kFewestLenses : 1)) continue;
      ++found;
      double variance = 0.7 + 0.3 / (facing * facing);
      if (imaged.bit > 0) variance += 4 / (imaged.bit * imaged.bit);
      const double sigma = kNoise * std::sqrt(variance);
      for (Observation seen : imaged.points) {
        const Eigen::Vector2d u(seen.values[0], seen.values[1]);
        const Eigen::Vector2d moved =
            u + shared * Eigen::Vector2d(u.x() / 640 - 1, u.y() / 480 - 1);
        seen.marker = number;
        seen.values[0] = moved.x() + dice->Gaussian(sigma);
        seen.values[1] = moved.y() + dice->Gaussian(sigma);
        seen.detector_sigma = kNoise;
        view.observations.push_back(seen);
      }
    }
    if (found >= 72) (*cameras)[c].views.push_back(view);
  }
}

struct Solved {
  CalibrationRecord record;
  RigEstimate rig;
  double phi = 0, error = 0;  // px
};

double PhiOf(const RigEstimate& rig,
             const ViewTarget& board,
             const std::vector<double>& distances) {
  const RigUnknowns unknowns = MakeRigUnknowns(rig.bundle, distances[0]);
  const Eigen::MatrixXd S = ViewPredictor(rig, unknowns, board).InformationSoFar();
  return ProjectionSigma(rig, unknowns, distances)
      .Of(S.llt().solve(Eigen::MatrixXd::Identity(S.rows(), S.cols())));
}

std::optional<Solved> Solve(const World& world,
                            const std::vector<CameraInput>& cameras,
                            const std::vector<double>& distances) {
  try {
    const CalibrationInput input{.cameras = cameras,
                                 .markers = world.board.markers,
                                 .marker_freedom = MarkerFreedom::FromSigma(world.bend),
                                 .loss = Loss::kHuber};
    Solved solved{Describe(Calibrate(input, {.threads = 1, .progress = {}})), {}};
    solved.rig = MakeRigEstimate(solved.record);
    solved.rig.lenses = world.truth.lenses;
    SetFactors(solved.record, world.board, &solved.rig);
    solved.phi = PhiOf(solved.rig, world.board, distances);
    double squares = 0, count = 0;
    for (size_t c = 0; c < cameras.size(); ++c) {
      CalibratedCamera truth = solved.record.cameras[c];
      truth.params = world.truth.bundle.cameras[c].params;
      for (const auto& at : CompareCameras(truth, solved.record.cameras[c], distances).distances) {
        squares += at.all.rms * at.all.rms;
        ++count;
      }
    }
    solved.error = std::sqrt(squares / count);
    return solved;
  } catch (const Error&) {
    return std::nullopt;
  }
}

size_t CellOf(const Eigen::Vector2d& u, size_t camera) {
  return camera * 1000 + static_cast<size_t>(u.y() / kImage[1] * 6) * 8 +
         static_cast<size_t>(u.x() / kImage[0] * 8);
}

// Greedy coverage of image cells, tilt classes and distance classes.
class Coverage {
 public:
  explicit Coverage(const Pool& pool) : pool_(pool) {
    for (const TargetPose& pose : pool.poses) {
      nearest_ = std::min(nearest_, pose.distance);
      farthest_ = std::max(farthest_, pose.distance);
    }
  }
  void Add(size_t i) {
    for (const size_t key : Keys(i)) ++seen_[key];
  }
  size_t Best(Dice* dice) const {
    double best = -1;
    std::vector<size_t> all;
    for (size_t i = 0; i < pool_.poses.size(); ++i) {
      double score = 0;
      for (const size_t key : Keys(i)) {
        const auto found = seen_.find(key);
        const double weight = key >= 100000 ? 6 : 1;
        score += weight / (1 + (found == seen_.end() ? 0 : found->second));
      }
      if (score > best + 1e-9) best = score, all.clear();
      if (score > best - 1e-9) all.push_back(i);
    }
    return all[dice->Index(all.size())];
  }

 private:
  std::set<size_t> Keys(size_t i) const {
    std::set<size_t> keys;
    for (size_t c = 0; c < pool_.visibilities[i].size(); ++c) {
      for (const Eigen::Vector2d& u : pool_.visibilities[i][c].u_px) keys.insert(CellOf(u, c));
    }
    const TargetPose& pose = pool_.poses[i];
    const auto tilt = pose.tilt < 0.1
                          ? size_t{0}
                          : 1 + static_cast<size_t>(std::lround(pose.away / kDegree / 45)) % 8;
    const double part =
        farthest_ > nearest_ ? (pose.distance - nearest_) / (farthest_ - nearest_) : 0;
    keys.insert(100000 + tilt);
    keys.insert(200000 + std::min<size_t>(2, static_cast<size_t>(3 * part)));
    return keys;
  }
  const Pool& pool_;
  std::map<size_t, double> seen_;
  double nearest_ = 1e9, farthest_ = 0;
};

struct Outcome {
  int frames = kMostFrames;  // until the goal, after the start
  double phi = 0, error = 0;
  std::vector<double> predicted;  // over computed
  double bound = 0;               // on the number of frames
  // Number of frames that a sigma 3 % above theirs takes by the bound, over their number: of those
  // that were taken, and of poses that a continuous search finds. Above 1 they beat it.
  double taken = 0, searched = 0;
};

// The bound by the estimate and the noise at the end, given the frames at the start.
class BoundTest {
 public:
  BoundTest(const World& world, const RigEstimate& at_end, const std::vector<double>& distances)
      : world_(world),
        start_(at_end),
        unknowns_(MakeRigUnknowns(at_end.bundle, distances[0])),
        predictor_(at_end, unknowns_, world.board),
        projection_(at_end, unknowns_, distances),
        range_{distances[0], world.IsPlenoptic() ? distances[2] : distances[1]} {
    start_.bundle.T_rig_target.resize(kStart);
    std::erase_if(start_.bundle.observations,
                  [](const BundleObservation& each) { return each.frame >= kStart; });
  }

  double Further(double goal) const {
    const NextViews next =
        ChooseNextViews(start_, world_.board, {.count = 1, .range = range_, .goal = goal});
    return next.bound ? next.bound->further : 0;
  }

  double Over(const std::vector<RigidTransform>& frames) const {
    Eigen::MatrixXd S = Start();
    for (const RigidTransform& T : frames) Add(T, &S);
    return Further(1.03 * Sigma(S)) / static_cast<double>(frames.size());
  }

  // Greedy choice with a local search over all that a pose has.
  std::vector<RigidTransform> Search(const Pool& pool, size_t count, Dice* dice) const {
    constexpr int kTrials = 150, kMoves = 120;
    Eigen::MatrixXd S = Start();
    std::vector<RigidTransform> frames;
    while (frames.size() < count) {
      TargetPose best;
      double least = 1e9;
      for (int i = 0; i < kTrials + kMoves; ++i) {
        TargetPose pose = best;
        if (i < kTrials) {
          pose = pool.poses[dice->Index(pool.poses.size())];
        } else {
          const double step = std::pow(0.97, i - kTrials);
          pose.place += step * Eigen::Vector2d(dice->Gaussian(60), dice->Gaussian(60));
          pose.distance = std::clamp(
              pose.distance * (1 + step * dice->Gaussian(0.1)), range_.nearest, range_.farthest);
          pose.tilt = std::clamp(pose.tilt + step * dice->Gaussian(0.2), 0.0, 50 * kDegree);
          pose.away += step * dice->Gaussian(0.4);
          pose.turn += step * dice->Gaussian(0.4);
        }
        const auto T = PlaceTarget(start_, world_.board, pose);
        if (!T) continue;
        Eigen::MatrixXd with = S;
        Add(start_.bundle.cameras[pose.camera].T_camera_rig.Inverse() * *T, &with);
        const double sigma = Sigma(with);
        if (sigma < least) least = sigma, best = pose;
      }
      frames.push_back(start_.bundle.cameras[best.camera].T_camera_rig.Inverse() *
                       *PlaceTarget(start_, world_.board, best));
      Add(frames.back(), &S);
    }
    return frames;
  }

 private:
  Eigen::MatrixXd Start() const {
    return ViewPredictor(start_, unknowns_, world_.board).InformationSoFar();
  }
  void Add(const RigidTransform& T, Eigen::MatrixXd* S) const {
    constexpr size_t kAll = 1000;
    if (const auto more = predictor_.Information(T, kAll)) *S += *more;
  }
  double Sigma(const Eigen::MatrixXd& S) const {
    return projection_.Of(S.llt().solve(Eigen::MatrixXd::Identity(S.rows(), S.cols())));
  }

  const World& world_;
  RigEstimate start_;
  RigUnknowns unknowns_;
  ViewPredictor predictor_;
  ProjectionSigma projection_;
  ViewRange range_;
};

Outcome RunPolicy(const World& world,
                  const Pool& pool,
                  const std::string& policy,
                  const std::vector<double>& distances,
                  double goal,
                  unsigned seed) {
  Dice start(seed), dice(seed + 1000), noise(seed + 2000);
  std::vector<CameraInput> cameras;
  for (const BundleCamera& camera : world.truth.bundle.cameras) {
    cameras.push_back({.name = camera.name,
                       .model = camera.model,
                       .config = camera.config,
                       .initial = std::vector<std::optional<double>>(camera.params.size()),
                       .fixed = std::vector<bool>(camera.params.size(), false),
                       .image_size = kImage,
                       .views = {}});
  }
  Coverage coverage(pool);
  for (int f = 0; f < kStart; ++f) {
    const size_t i = start.Index(pool.poses.size());
    coverage.Add(i);
    Record(world, Execute(world, pool.poses[i], pool.T_rig_target[i], &start), f, &noise, &cameras);
  }
  Outcome outcome;
  std::optional<Solved> solved = Solve(world, cameras, distances);
  std::vector<RigidTransform> taken;
  const int last = policy == "random" ? kRandomFrames - kStart : kMostFrames;
  for (int f = 0; f < last; ++f) {
    double predicted = 0;
    RigidTransform T;
    TargetPose pose;
    if (policy == "suggest" && solved) {
      const NextViews next = ChooseNextViews(
          solved->rig, world.board, {.count = 1, .range = world.range, .threads = 1});
      if (next.views.empty()) break;
      pose = next.views[0].pose;
      T = next.views[0].T_rig_target;
      predicted = next.views[0].criterion == ViewCriterion::kSigma ? 1 : 0;
      // Sigma after it at the distances of the bench.
      if (predicted > 0) {
        RigEstimate rig = solved->rig;
        const RigUnknowns unknowns = MakeRigUnknowns(rig.bundle, distances[0]);
        const ViewPredictor predictor(rig, unknowns, world.board);
        Eigen::MatrixXd S = predictor.InformationSoFar();
        const RigidTransform& T_c = rig.bundle.cameras[pose.camera].T_camera_rig;
        const auto executed = ExecutedPoses(T_c * T, world.board, kExecutionAngle, kExecutionPart);
        for (const RigidTransform& each : executed) {
          if (const auto more = predictor.Information(T_c.Inverse() * each, 200))
            S += *more / executed.size();
        }
        predicted = ProjectionSigma(rig, unknowns, distances)
                        .Of(S.llt().solve(Eigen::MatrixXd::Identity(S.rows(), S.cols())));
      }
    } else {
      const size_t i = policy == "coverage" ? coverage.Best(&dice) : dice.Index(pool.poses.size());
      coverage.Add(i);
      pose = pool.poses[i];
      T = pool.T_rig_target[i];
    }
    taken.push_back(Execute(world, pose, T, &dice));
    Record(world, taken.back(), kStart + f, &noise, &cameras);
    solved = Solve(world, cameras, distances);
    if (!solved) continue;
    if (predicted > 0) outcome.predicted.push_back(predicted / solved->phi);
    outcome.phi = solved->phi;
    outcome.error = solved->error;
    if (goal > 0 && solved->phi <= goal) {
      outcome.frames = f + 1;
      break;
    }
  }
  if (policy == "random") outcome.frames = last;
  if (policy == "suggest" && solved) {
    const BoundTest test(world, solved->rig, distances);
    outcome.bound = std::max(1.0, std::ceil(test.Further(goal)));
    outcome.taken = test.Over(taken);
    outcome.searched = test.Over(test.Search(pool, taken.size(), &dice));
  }
  return outcome;
}

int Main(int argc, char** argv) {
  if (argc != 3 && argc != 4) {
    fmt::print(stderr, "usage: suggest_views CLASS SEED [without-coverage]\n");
    return 2;
  }
  const auto seed = static_cast<unsigned>(std::atoi(argv[2]));
  const World world = MakeWorld(argv[1], seed);
  const Pool pool = Feasible(world);
  double nearest = 1e9, farthest = 0;
  for (const TargetPose& pose : pool.poses) {
    nearest = std::min(nearest, pose.distance);
    farthest = std::max(farthest, pose.distance);
  }
  std::vector<double> distances{nearest, farthest, 10 * farthest};
  if (world.IsPlenoptic()) distances = {nearest, 2 / (1 / nearest + 1 / farthest), farthest};
  fmt::print(
      "camera,policy,frames,goal_px,sigma_px,error_px,predicted_over_computed,bound,taken_by_bound,"
      "searched_by_bound\n");
  double goal = 0;
  for (const std::string policy : {"random", "coverage", "suggest"}) {
    if (policy == "coverage" && argc == 4) continue;
    const Outcome outcome = RunPolicy(world, pool, policy, distances, goal, seed);
    if (goal == 0) goal = outcome.phi;
    std::string predicted;
    for (const double ratio : outcome.predicted)
      predicted += fmt::format("{}{:.3f}", predicted.empty() ? "" : " ", ratio);
    fmt::print("{},{},{},{:.4f},{:.4f},{:.4f},{},{:.0f},{:.3f},{:.3f}\n",
               world.name,
               policy,
               outcome.frames,
               goal,
               outcome.phi,
               outcome.error,
               predicted,
               outcome.bound,
               outcome.taken,
               outcome.searched);
    std::fflush(stdout);
  }
  return 0;
}

}  // namespace
}  // namespace plenocal

int main(int argc, char** argv) { return plenocal::Main(argc, argv); }
