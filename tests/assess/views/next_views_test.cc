// SPDX-License-Identifier: Apache-2.0
#include "assess/views/next_views.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include "assess/compare.h"
#include "assess/frames/frame_influence.h"
#include "assess/views/view_information.h"
#include "calib/base/error.h"
#include "calib/estimate/describe.h"
#include "tests/calib/plenoptic_synthetic.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr size_t kAllMarkers = 1000;

// A board whose printed side looks along -z.
ViewTarget BoardOf(const std::map<int, Eigen::Vector3d>& markers, bool in_part = false) {
  ViewTarget shape{.markers = markers};
  Eigen::AlignedBox3d box;
  for (const auto& [number, position] : markers) {
    shape.normals[number] = -Eigen::Vector3d::UnitZ();
    box.extend(position);
  }
  const Eigen::Vector3d a = box.min(), b = box.max();
  shape.outlines = {{a, {b.x(), a.y(), 0}, b, {a.x(), b.y(), 0}}};
  shape.found_in_part = in_part;
  return shape;
}

struct Known {
  Calibration calibration;
  CalibrationRecord record;
  RigEstimate rig;
};

Known KnownFrom(const CalibrationInput& input) {
  Known known{Calibrate(input, {}), {}, {}};
  known.record = Describe(known.calibration);
  known.rig = MakeRigEstimate(known.record);
  std::map<int, Eigen::Vector3d> markers;
  for (const auto& [number, marker] : known.record.markers) markers[number] = marker.position;
  SetFactors(known.record, BoardOf(markers), &known.rig);
  return known;
}

Eigen::MatrixXd Inverted(const Eigen::MatrixXd& information) {
  return information.llt().solve(Eigen::MatrixXd::Identity(information.rows(), information.cols()));
}

Eigen::MatrixXd SoFar(const RigEstimate& rig, const RigUnknowns& unknowns) {
  std::map<int, Eigen::Vector3d> markers;
  for (const BundleMarker& marker : rig.bundle.markers) markers[marker.number] = marker.position;
  return ViewPredictor(rig, unknowns, BoardOf(markers)).InformationSoFar();
}

// Points without errors common to a frame, so that the factors are 1.
CalibrationInput TakeFrames(CalibrationInput input, size_t first, size_t count) {
  for (CameraInput& camera : input.cameras) {
    camera.views = {camera.views.begin() + static_cast<std::ptrdiff_t>(first),
                    camera.views.begin() + static_cast<std::ptrdiff_t>(first + count)};
  }
  return input;
}

TEST(RigEstimateOfRecord, HasTheCovarianceOfTheCalibration) {
  const Known known = KnownFrom(MakeProblem(4, {.cameras = 2, .frames = 12, .noise = 0.1}).input);
  const RigUnknowns unknowns = MakeRigUnknowns(known.rig.bundle, 1);
  ASSERT_EQ(unknowns.names, known.calibration.uncertainty.names);
  EXPECT_EQ(unknowns.unit.size(), unknowns.head);
  const Eigen::MatrixXd covariance = Inverted(SoFar(known.rig, unknowns));
  const Eigen::VectorXd scale = UnknownScales(known.rig, unknowns);
  const Eigen::MatrixXd& truth = known.calibration.uncertainty.covariance;
  for (Eigen::Index i = 0; i < truth.rows(); ++i) {
    // The factor is one of each camera, a median, as the record has several roundings.
    constexpr double kTolerance = 0.05;
    EXPECT_NEAR(scale[i] * std::sqrt(covariance(i, i)) / std::sqrt(truth(i, i)), 1, kTolerance)
        << unknowns.names[static_cast<size_t>(i)];
  }
}

TEST(ViewPredictor, FindsTheInformationThatTheFrameAddsToTheAdjustment) {
  for (const double tolerance : {0.0, 0.001}) {
    const SyntheticProblem problem =
        MakeProblem(7, {.cameras = 2, .frames = 10, .noise = 0.1, .marker_tolerance = tolerance});
    Known known = KnownFrom(problem.input);
    RigEstimate& rig = known.rig;
    const RigUnknowns unknowns = MakeRigUnknowns(rig.bundle, 1);
    const Eigen::MatrixXd with = SoFar(rig, unknowns);
    // The same frames without the last.
    RigEstimate fewer = rig;
    const int last = static_cast<int>(rig.bundle.T_rig_target.size()) - 1;
    std::erase_if(fewer.bundle.observations,
                  [&](const BundleObservation& each) { return each.frame == last; });
    const Eigen::MatrixXd without = SoFar(fewer, unknowns);
    const ViewTarget shape = BoardOf(problem.markers);
    const ViewPredictor predictor(rig, unknowns, shape);
    const auto added = predictor.Information(rig.bundle.T_rig_target.back(), kAllMarkers);
    ASSERT_TRUE(added);
    const Eigen::MatrixXd exact = Inverted(with), predicted = Inverted(without + *added);
    for (Eigen::Index i = 0; i < exact.rows(); ++i) {
      // Refined markers are unknowns of one frame only: their errors that frames share are taken
      // for independent. The sigmas of the detections differ by their rounding.
      EXPECT_NEAR(std::sqrt(predicted(i, i) / exact(i, i)), 1, tolerance > 0 ? 0.1 : 0.01)
          << unknowns.names[static_cast<size_t>(i)];
    }
  }
}

// Against the adjustment without the frame.
TEST(FrameInfluence, IsTheChangeWithoutTheFrame) {
  const SyntheticProblem problem = MakeProblem(5, {.cameras = 2, .frames = 10, .noise = 0.1});
  const Known known = KnownFrom(problem.input);
  const std::vector<FrameInfluence> influences = FrameInfluences(known.record);
  ASSERT_EQ(influences.size(), 10U);
  const Uncertainty& uncertainty = known.calibration.uncertainty;
  double largest = 0;
  for (const FrameInfluence& influence : influences) {
    CalibrationInput without = problem.input;
    for (CameraInput& camera : without.cameras) {
      std::erase_if(camera.views, [&](const View& view) {
        return view.frame == known.record.frames[static_cast<size_t>(influence.frame)].name;
      });
    }
    const Calibration calibration = Calibrate(without, {});
    double most = 0;
    std::string unknown;
    for (size_t i = 0; i < uncertainty.names.size(); ++i) {
      const std::string& name = uncertainty.names[i];
      if (name.find("T_camera_rig") != std::string::npos) continue;
      const size_t c = name.starts_with(known.record.cameras[0].name + ".") ? 0 : 1;
      const std::string param = name.substr(name.find('.') + 1);
      const std::span<const Param> params = known.record.cameras[c].model->params;
      const auto k =
          static_cast<size_t>(std::ranges::find(params, param, &Param::name) - params.begin());
      const double change =
          calibration.bundle.cameras[c].params[k] - known.record.cameras[c].params[k];
      const auto row = static_cast<Eigen::Index>(i);
      const double sigmas = std::abs(change) / std::sqrt(uncertainty.covariance(row, row));
      if (sigmas > most) unknown = name;
      most = std::max(most, sigmas);
    }
    largest = std::max(largest, most);
    if (influence.unknown.find("T_camera_rig") != std::string::npos) continue;
    EXPECT_NEAR(influence.sigmas / most, 1, 0.15) << influence.unknown << " against " << unknown;
  }
  EXPECT_GT(largest, 0.3) << "some frame counts";
}

TEST(ProjectionSigmaOfACamera, IsTheImageSigma) {
  const Known known = KnownFrom(MakeProblem(4, {.frames = 12, .noise = 0.1}).input);
  const RigUnknowns unknowns = MakeRigUnknowns(known.rig.bundle, 1);
  const std::vector<double> distances{0.5, 1, 5};
  const ProjectionSigma projection(known.rig, unknowns, distances);
  const double sigma = projection.Of(Inverted(SoFar(known.rig, unknowns)));
  // A motion that weighs no points lowers the RMS more.
  const double weighted = ImageSigma(known.record.cameras[0], distances);
  EXPECT_LT(sigma, 1.02 * weighted);
  EXPECT_GT(sigma, 0.8 * weighted);
}

TEST(NextViews, LowerSigmaAsPredictedWhenTheyAreTaken) {
  const SyntheticProblem problem = MakeProblem(9, {.frames = 8, .noise = 0.1});
  Known known = KnownFrom(problem.input);
  const ViewTarget shape = BoardOf(problem.markers);
  const NextViews next = ChooseNextViews(known.rig, shape, {.count = 3});
  ASSERT_EQ(next.views.size(), 3u);
  EXPECT_FALSE(next.reached);
  double before = next.sigma;
  RigEstimate taken = known.rig;
  for (const NextView& view : next.views) {
    EXPECT_LT(view.sigma_after, before);
    before = view.sigma_after;
    // Every marker of a chessboard must be in the image.
    const ImageSize size = taken.bundle.cameras[0].image_size;
    for (size_t m = 0; m < taken.bundle.markers.size(); ++m) {
      BundleObservation observation{.camera = 0,
                                    .frame = static_cast<int>(taken.bundle.T_rig_target.size()),
                                    .marker = static_cast<int>(m),
                                    .seen = {.marker = taken.bundle.markers[m].number},
                                    .assumed_sigma = taken.sigma_px[0]};
      const BundleCamera& camera = taken.bundle.cameras[0];
      double u[kMaxObservationSize];
      ASSERT_TRUE(camera.model->Project(camera.params.data(),
                                        nullptr,
                                        observation.seen.values.data(),
                                        view.T_rig_target * taken.bundle.markers[m].position,
                                        u));
      EXPECT_TRUE(u[0] > 0 && u[0] < size[0] && u[1] > 0 && u[1] < size[1]) << u[0] << " " << u[1];
      taken.bundle.observations.push_back(observation);
    }
    taken.bundle.T_rig_target.push_back(view.T_rig_target);
  }
  const RigUnknowns unknowns = MakeRigUnknowns(taken.bundle, 1);
  const ProjectionSigma projection(taken, unknowns, next.distances);
  const double sigma = projection.Of(Inverted(SoFar(taken, unknowns)));
  // The suggestion averages over its execution by a person.
  constexpr double kTolerance = 0.15;
  EXPECT_NEAR(next.views.back().sigma_after / sigma, 1, kTolerance);
}

TEST(NextViews, AreBetterThanMoreOfTheSame) {
  const SyntheticProblem problem = MakeProblem(9, {.frames = 12, .noise = 0.1});
  Known known = KnownFrom(TakeFrames(problem.input, 0, 6));
  const NextViews next = ChooseNextViews(known.rig, BoardOf(problem.markers), {.count = 2});
  const Known six_more = KnownFrom(problem.input);
  const RigUnknowns unknowns = MakeRigUnknowns(six_more.rig.bundle, 1);
  const ProjectionSigma projection(six_more.rig, unknowns, next.distances);
  ASSERT_EQ(next.views.size(), 2u);
  EXPECT_LT(next.views[1].sigma_after, projection.Of(Inverted(SoFar(six_more.rig, unknowns))));
}

TEST(NextViews, StateWhatTheBestChoiceCouldReach) {
  const SyntheticProblem problem = MakeProblem(9, {.frames = 8, .noise = 0.1});
  const Known known = KnownFrom(problem.input);
  const ViewTarget shape = BoardOf(problem.markers);
  const NextViews next = ChooseNextViews(known.rig, shape, {.count = 4});
  ASSERT_TRUE(next.bound);
  EXPECT_LT(next.bound->sigma, next.sigma);
  double further = -1;
  for (const double goal : {0.9, 0.5, 0.3}) {
    const NextViews until =
        ChooseNextViews(known.rig, shape, {.count = 1, .goal = goal * next.sigma});
    ASSERT_TRUE(until.bound && until.suggested) << goal;
    EXPECT_GT(until.bound->further, further) << "a lower goal takes more";
    further = until.bound->further;
    EXPECT_LE(until.bound->WholeFurther(), static_cast<double>(*until.suggested));
  }
  // The suggestions are a choice as well.
  const NextViews same =
      ChooseNextViews(known.rig, shape, {.count = 1, .goal = next.views.back().sigma_after});
  EXPECT_LE(same.bound->further, 4);
  EXPECT_EQ(ChooseNextViews(known.rig, shape, {.goal = 100}).bound->further, 0);
  const NextViews never = ChooseNextViews(known.rig, shape, {.count = 1, .goal = 1e-6});
  EXPECT_TRUE(std::isinf(never.bound->further));
  EXPECT_FALSE(never.suggested);
  EXPECT_THAT(ViewBoundText(never), HasSubstr("no number of these views reaches the goal"));
}

TEST(NextViews, StateNoBoundWhileSomethingIsNotDetermined) {
  const SyntheticProblem problem = MakeProblem(9, {.frames = 8, .noise = 0.1});
  RigEstimate rig = KnownFrom(problem.input).rig;
  rig.bundle.observations.clear();
  EXPECT_FALSE(ChooseNextViews(rig, BoardOf(problem.markers), {.count = 1}).bound);
  // Before the first frame the lens is given.
  rig.bundle.T_rig_target.clear();
  const NextViews first = ChooseNextViews(rig, BoardOf(problem.markers), {.count = 1});
  ASSERT_TRUE(first.bound && first.suggested);
  EXPECT_TRUE(std::isinf(first.bound->sigma));
  EXPECT_GE(first.bound->further, 1);
  EXPECT_LE(first.bound->further, static_cast<double>(*first.suggested));
}

// Frames that all face the camera at one distance leave focal length and distance together.
TEST(NextViews, TiltWhereNothingWasTilted) {
  SyntheticProblem problem = MakeProblem(9, {.frames = 8});
  CameraInput& camera = problem.input.cameras[0];
  const CameraModel& model = *camera.model;
  camera.views.clear();
  for (int f = 0; f < 8; ++f) {
    View view{.frame = std::to_string(f), .observations = {}};
    const Eigen::Vector3d place(-0.135 + 0.03 * (f % 3 - 1), -0.09 + 0.02 * (f % 2), 0.6);
    for (const auto& [number, position] : problem.markers) {
      Observation seen{.marker = number, .detector_sigma = 0.1};
      ASSERT_TRUE(model.Project(
          problem.params[0].data(), nullptr, nullptr, position + place, seen.values.data()));
      view.observations.push_back(seen);
    }
    camera.views.push_back(view);
  }
  const NextViews next =
      ChooseNextViews(KnownFrom(problem.input).rig, BoardOf(problem.markers), {.count = 1});
  ASSERT_EQ(next.views.size(), 1u);
  constexpr double kTilted = 15 * std::numbers::pi / 180;
  EXPECT_GT(next.views[0].pose.tilt, kTilted);
}

TEST(NextViews, SayTheGoalIsReached) {
  const SyntheticProblem problem = MakeProblem(9, {.frames = 10, .noise = 0.1});
  const Known known = KnownFrom(problem.input);
  const NextViews next =
      ChooseNextViews(known.rig, BoardOf(problem.markers), {.count = 1, .goal = 100});
  EXPECT_TRUE(next.reached);
}

TEST(NextViews, KeepTheDistancesOfTheUser) {
  const SyntheticProblem problem = MakeProblem(9, {.frames = 8, .noise = 0.1});
  const Known known = KnownFrom(problem.input);
  const ViewTarget shape = BoardOf(problem.markers);
  const NextViews next =
      ChooseNextViews(known.rig, shape, {.count = 5, .range = {0.9, 1.1}, .largest_tilt = 0.2});
  ASSERT_FALSE(next.views.empty());
  for (const NextView& view : next.views) {
    EXPECT_GE(view.pose.distance, 0.9 - 1e-9);
    EXPECT_LE(view.pose.distance, 1.1 + 1e-9);
    EXPECT_LE(view.pose.tilt, 0.2 + 1e-9);
  }
  EXPECT_THROW(ChooseNextViews(known.rig, shape, {.range = {2, 1}}), Error);
  // A detail of a micrometre is resolved nowhere.
  ViewTarget fine = shape;
  fine.finest = 1e-6;
  NextViewChooser chooser(fine, {.range = {0.9, 1.1}});
  EXPECT_THROW(chooser.Choose(known.rig), Error);
  EXPECT_THROW(chooser.Choose(known.rig), Error) << "a choice that failed leaves no candidates";
}

TEST(NextViews, OfARigAreSeenByBothCameras) {
  const SyntheticProblem problem = MakeProblem(3, {.cameras = 2, .frames = 6, .noise = 0.1});
  const Known known = KnownFrom(problem.input);
  const NextViews next = ChooseNextViews(known.rig, BoardOf(problem.markers), {.count = 2});
  ASSERT_EQ(next.views.size(), 2u);
  EXPECT_EQ(next.views[0].cameras.size(), 2u);
  for (const NextView& view : next.views) {
    EXPECT_TRUE(std::ranges::count(view.cameras, view.pose.camera) == 1)
        << "the words name a camera that sees it";
  }
  EXPECT_THAT(NextViewText(next.views[0], known.rig, {}), HasSubstr("seen by cam0, cam1"));
}

TEST(NextViews, OfAPlenopticCameraStayWhereMicroImagesShowThem) {
  const PlenopticProblem problem =
      MakePlenopticProblem(3, {.noise = 0.1, .frames = 8, .depth_span = 0.2});
  Known known = KnownFrom(problem.input);
  MicroLensArray& array = known.rig.lenses[0];
  array.image_size = problem.input.cameras[0].image_size;
  double pitch = std::numeric_limits<double>::infinity();
  for (const View& view : problem.input.cameras[0].views) {
    for (const Observation& seen : view.observations) {
      const Eigen::Vector2d centre(seen.values[2], seen.values[3]);
      bool known_lens = false;
      for (const MicroLens& lens : array.lenses) {
        const double distance = (lens.centre - centre).norm();
        if (distance < 1e-3) known_lens = true;
        if (distance > 1e-3) pitch = std::min(pitch, distance);
      }
      if (!known_lens) array.lenses.push_back({.centre = centre});
    }
  }
  array.e_column = {pitch, 0};
  array.e_row = {pitch / 2, pitch * std::sqrt(0.75)};
  // Micro images are known where points were seen.
  const NextViews next = ChooseNextViews(known.rig, BoardOf(problem.markers, true), {.count = 2});
  ASSERT_FALSE(next.views.empty());
  EXPECT_LT(next.views[0].sigma_after, next.views[0].sigma_before);
  const std::vector<double> seen = PointDistances(known.rig.bundle, 0);
  EXPECT_GT(next.views[0].pose.distance, seen.front() / 2.5);
  EXPECT_LT(next.views[0].pose.distance, seen.back() * 2.5);
  EXPECT_FALSE(next.views[0].outlines.at(0).at(0).empty());
  ASSERT_EQ(next.distances.size(), 3U);
  EXPECT_NEAR(2 / next.distances[1], 1 / next.distances[0] + 1 / next.distances[2], 1e-9);
}

TEST(NextViews, StateTheBoundInWords) {
  NextViews next;
  next.frames = 9;
  next.bound = {.sigma = 0.0214, .further = 1.2};
  next.suggested = 3;
  EXPECT_EQ(ViewBoundText(next),
            "the best 9 frames possible would reach 0.021 px; the goal takes at least 2 more, 3 as "
            "suggested");
  next.reached = true;
  EXPECT_EQ(ViewBoundText(next), "the best 9 frames possible would reach 0.021 px");
  next.bound.reset();
  EXPECT_EQ(ViewBoundText(next), "");
}

TEST(NextViews, AreInWords) {
  const SyntheticProblem problem = MakeProblem(9, {.frames = 8, .noise = 0.1});
  const Known known = KnownFrom(problem.input);
  NextView view{.pose = {.place = {10, 10}, .distance = 0.3, .tilt = 0.6981317, .away = 0},
                .region = 0,
                .region_before = 1.63,
                .region_after = 0.41};
  EXPECT_EQ(NextViewText(view, known.rig, {}),
            "target in the upper left corner, 30 cm away, its right side tilted away by 40 "
            "degrees: sigma in the upper left corner 1.6 -> 0.41 px");
}

// The side that the words name is the one that is farther from the camera.
TEST(TargetPoses, TiltTheSideAwayThatTheyName) {
  const SyntheticProblem problem = MakeProblem(9, {.frames = 8, .noise = 0.1});
  const Known known = KnownFrom(problem.input);
  const ViewTarget shape = BoardOf(problem.markers);
  const auto T = PlaceTarget(
      known.rig, shape, {.place = {320, 240}, .distance = 1, .tilt = 0.5, .away = 0, .turn = 0});
  ASSERT_TRUE(T);
  const Eigen::Vector3d left = *T * Eigen::Vector3d(0, 0.1, 0),
                        to_right = *T * Eigen::Vector3d(0.27, 0.1, 0);
  EXPECT_LT(left.x(), to_right.x());
  EXPECT_LT(left.z(), to_right.z());
}

// Six markers that fill most of the image, so that few candidates are feasible.
ViewTarget FewMarkers(const SyntheticProblem& problem) {
  ViewTarget shape = BoardOf(problem.markers);
  Eigen::AlignedBox3d box;
  for (const auto& [number, position] : problem.markers) box.extend(position);
  const Eigen::Vector3d a = box.min(), b = box.max();
  shape.markers.clear();
  for (int i = 0; i < 6; ++i) {
    shape.markers[i] = {i % 3 == 0   ? a.x()
                        : i % 3 == 1 ? (a.x() + b.x()) / 2
                                     : b.x(),
                        i < 3 ? a.y() : b.y(),
                        0};
    shape.normals[i] = -Eigen::Vector3d::UnitZ();
  }
  return shape;
}

// The chooser of a calibration that goes on finds what a new one finds, and keeps its candidates
// only while these are still right.
TEST(NextViewChooser, ChoosesAnewWhereTheEstimateChanges) {
  const SyntheticProblem problem = MakeProblem(9, {.frames = 8, .noise = 0.1});
  RigEstimate rig = KnownFrom(problem.input).rig;
  rig.bundle.observations.clear();
  const ViewTarget shape = FewMarkers(problem);
  const NextViewOptions options{.count = 1, .range = {0.33, 0.36}};
  const auto same = [](const NextViews& a, const NextViews& b) {
    return a.views.size() == 1 && b.views.size() == 1 &&
           std::abs(a.views[0].sigma_after / b.views[0].sigma_after - 1) < 1e-9;
  };
  NextViewChooser chooser(shape, options);
  const NextViews first = chooser.Choose(rig);
  EXPECT_TRUE(same(first, chooser.Choose(rig)));
  EXPECT_THAT(first.distances,
              ElementsAre(DoubleNear(0.33, 1e-9), DoubleNear(0.36, 1e-9), DoubleNear(3.6, 1e-9)));
  EXPECT_EQ(first.views[0].criterion, ViewCriterion::kEntropy);
  const auto is_new = [&](const std::function<void(RigEstimate*)>& change) {
    RigEstimate other = rig;
    change(&other);
    NextViewChooser before(shape, options);
    before.Choose(rig);
    return same(before.Choose(other), ChooseNextViews(other, shape, options));
  };
  // Units stay with the candidates; noise alone shows in their ranking only.
  const auto change = [&](double noise, double focal_length) {
    return is_new([=](RigEstimate* other) {
      other->sigma_px[0] *= noise;
      other->bundle.cameras[0].params[0] *= focal_length;
    });
  };
  EXPECT_FALSE(change(0.96, 1.009));
  EXPECT_TRUE(change(1.06, 1.005));
  EXPECT_TRUE(change(1, 0.989));
  EXPECT_TRUE(is_new([](RigEstimate* other) { other->bundle.cameras[0].fixed[4] = true; }));
}

// What each suggestion is said to lower.
TEST(NextViews, DifferAndNameTheRegionThatTheyLowerMost) {
  const SyntheticProblem problem = MakeProblem(9, {.frames = 8, .noise = 0.1});
  const RigEstimate rig = KnownFrom(problem.input).rig;
  const ViewTarget shape = FewMarkers(problem);
  const NextViewOptions options{.count = 4, .goal = 100};
  const NextViews next = ChooseNextViews(rig, shape, options);
  ASSERT_EQ(next.views.size(), 4U);
  EXPECT_EQ(next.views[0].sigma_before, next.sigma);
  const ImageSize size = rig.bundle.cameras[0].image_size;
  const RigUnknowns unknowns = MakeRigUnknowns(rig.bundle, next.distances[0]);
  const ProjectionSigma projection(rig, unknowns, next.distances);
  const ViewPredictor predictor(rig, unknowns, shape);
  Eigen::MatrixXd information = predictor.InformationSoFar();
  for (size_t i = 0; i < 4; ++i) {
    const NextView& view = next.views[i];
    const TargetPose& a = view.pose;
    EXPECT_EQ(view.criterion, ViewCriterion::kSigma);
    // As a person carries it out.
    const Eigen::MatrixXd before = Inverted(information);
    for (const RigidTransform& T : ExecutedPoses(view.T_rig_target, shape, 0.087, 0.05)) {
      if (const auto more = predictor.Information(T, 150)) information += *more / 7;
    }
    const Eigen::MatrixXd after = Inverted(information);
    EXPECT_NEAR(view.sigma_before / projection.Of(before), 1, 1e-6) << i;
    EXPECT_NEAR(view.sigma_after / projection.Of(after), 1, 1e-6) << i;
    EXPECT_NEAR(view.region_before / projection.InRegion(0, view.region, before), 1, 1e-6);
    EXPECT_NEAR(view.region_after / projection.InRegion(0, view.region, after), 1, 1e-6);
    for (size_t r = 0; r < kRegions; ++r) {
      EXPECT_LE(projection.InRegion(0, r, before) - projection.InRegion(0, r, after),
                (view.region_before - view.region_after) * (1 + 1e-6));
    }
    // Twelve places of each of the four edges, from the first corner on.
    const auto& outline = view.outlines.at(0).at(0);
    ASSERT_EQ(outline.size(), 48U);
    for (size_t k = 0; k < 48; ++k) {
      const std::vector<Eigen::Vector3d>& corners = shape.outlines[0];
      const Eigen::Vector3d &from = corners[k / 12], &to = corners[(k / 12 + 1) % 4];
      const Eigen::Vector3d p =
          view.T_rig_target * (from + (to - from) * static_cast<double>(k % 12) / 12);
      Eigen::Vector2d u;
      const BundleCamera& camera = rig.bundle.cameras[0];
      ASSERT_TRUE(camera.model->Project(camera.params.data(), nullptr, nullptr, p, u.data()));
      EXPECT_LT((u - outline[k]).norm(), 1e-9);
    }
    for (size_t j = 0; j < i; ++j) {
      const TargetPose& b = next.views[j].pose;
      const auto normal = [](const TargetPose& pose) {
        return Eigen::AngleAxisd(pose.away, Eigen::Vector3d::UnitZ()) *
               (Eigen::AngleAxisd(pose.tilt, Eigen::Vector3d::UnitY()) * Eigen::Vector3d::UnitZ());
      };
      const double angle = std::acos(std::min(1.0, normal(a).dot(normal(b))));
      EXPECT_TRUE(angle > 20 * std::numbers::pi / 180 || a.turn != b.turn ||
                  std::abs(a.distance - b.distance) > 0.2 * std::max(a.distance, b.distance) ||
                  std::abs(a.place.x() - b.place.x()) > size[0] / 3.0 ||
                  std::abs(a.place.y() - b.place.y()) > size[1] / 3.0)
          << i << " " << j;
    }
  }
  EXPECT_EQ(next.exhausted, next.views.back().sigma_after > 0.9 * next.sigma);
}

// A target of one's own aim: the words are those of what is lowered.
TEST(NextViews, LowerWhatTheUserWants) {
  const SyntheticProblem problem = MakeProblem(9, {.frames = 8, .noise = 0.1});
  RigEstimate rig = KnownFrom(problem.input).rig;
  NextViewOptions options{.count = 1, .range = {0.33, 0.36}, .goal = 1};
  options.lowered = [](const RigEstimate& /*rig*/, const RigUnknowns& unknowns) {
    const Eigen::MatrixXd row = Eigen::RowVectorXd::Unit(unknowns.unit.size(), 0);
    return ProjectionSigma({{0, 4, 1e-3 * row}}, 1, {"the focal length", "mm", 5});
  };
  const NextViews next = ChooseNextViews(rig, FewMarkers(problem), options);
  EXPECT_EQ(next.lowered.of, "the focal length");
  EXPECT_TRUE(next.reached);
  ASSERT_EQ(next.views.size(), 1U);
  EXPECT_EQ(next.views[0].region, 4U);
  EXPECT_LT(next.views[0].sigma_after, next.views[0].sigma_before);
  // Views gain more than a tenth, or hardly anything if their points are ten times worse.
  const double factor = 3e-3 / next.sigma;
  options.lowered = [&](const RigEstimate& /*rig*/, const RigUnknowns& unknowns) {
    const Eigen::MatrixXd row = Eigen::RowVectorXd::Unit(unknowns.unit.size(), 0);
    return ProjectionSigma({{0, 4, factor * row}}, 1, {});
  };
  for (const double noise : {1.0, 10.0}) {
    rig.sigma_px[0] *= noise;
    const NextViews scaled = ChooseNextViews(rig, FewMarkers(problem), options);
    EXPECT_NEAR(scaled.sigma, 3, 1e-9);
    ASSERT_EQ(scaled.views.size(), 1U);
    EXPECT_EQ(scaled.views[0].sigma_after > 2.7, noise == 10);
    EXPECT_EQ(scaled.exhausted, noise == 10);
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
