// SPDX-License-Identifier: Apache-2.0
//
// The back end that eliminates poses and markers against the one that gives Ceres all unknowns, on
// every kind of problem that both solve.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "calib/adjust/all_unknowns/minimise.h"
#include "calib/adjust/reduced/minimise.h"
#include "calib/adjust/solver/adjust.h"
#include "calib/noise/uncertainty.h"
#include "tests/calib/synthetic.h"

namespace plenocal {
namespace TEST_FILE {

using testing::MakeProblem;
using testing::TargetShape;
using testing::TrueBundle;

// A stereo pair near its optimum. Eight frames have fewer unknowns than their markers.
Bundle Stereo(int frames = 8) {
  Bundle bundle = TrueBundle(MakeProblem(5,
                                         {.shape = TargetShape::kPlane,
                                          .cameras = 2,
                                          .frames = frames,
                                          .noise = 0.2,
                                          .marker_tolerance = 0.0003}));
  bundle.observations[7].used = false;
  return bundle;
}

// Measures points where they are now seen, with the residuals that they had.
void MeasureAgain(const Bundle& before, Bundle* bundle) {
  for (size_t i = 0; i < bundle->observations.size(); ++i) {
    double had[kMaxObservationSize], has[kMaxObservationSize];
    BundleObservation& observation = bundle->observations[i];
    observation.used = observation.used && Residual(before, before.observations[i], had) &&
                       Residual(*bundle, observation, has);
    for (size_t r = 0; r < 2; ++r) observation.seen.values[r] += had[r] - has[r];
  }
}

// Makes outliers, and moves all that is estimated away from the optimum.
void Disturb(Bundle* bundle) {
  for (size_t i = 0; i < bundle->observations.size(); i += 50) {
    bundle->observations[i].seen.values[i % 2] += 3;
  }
  Vector6d delta;
  delta << 0.002, -0.003, 0.004, 0.01, -0.008, 0.006;
  for (BundleCamera& camera : bundle->cameras) {
    camera.params[0] *= 1.01;
    camera.params[2] += 3;
    if (!camera.is_master) camera.T_camera_rig = Retract(camera.T_camera_rig, delta);
  }
  for (RigidTransform& T : bundle->T_rig_target) T = Retract(T, delta = -delta);
  for (BundleMarker& marker : bundle->markers) marker.position = marker.nominal;
  for (Vector6d& jitter : bundle->jitter.delta) jitter *= -0.5;
}

void AddJitter(Bundle* bundle) {
  const Bundle before = *bundle;
  bundle->jitter.translation_sigma = 0.0005;
  bundle->jitter.rotation_sigma = 0.001;
  for (size_t view = 0; view < bundle->T_rig_target.size() * bundle->cameras.size(); ++view) {
    Vector6d delta;
    for (int i = 0; i < 6; ++i) {
      delta[i] = (i < 3 ? 0.0005 : 0.001) * std::sin(7 * static_cast<double>(view) + i);
    }
    bundle->jitter.delta.push_back(delta);
    bundle->jitter.misplaced.push_back(view == 3);
  }
  MeasureAgain(before, bundle);
}

// The second camera's images are from other times than the first one's, between which the rig
// moved.
void AddMotion(Bundle* bundle) {
  const Bundle before = *bundle;
  bundle->motion.resize(bundle->T_rig_target.size() * 2);
  for (size_t f = 0; f < bundle->T_rig_target.size(); ++f) {
    ViewMotion& motion = bundle->motion[bundle->View(f, 1)];
    const double sign = f % 2 == 0 ? 1 : -1;
    motion.at_zero_shift << 0, 0.001 * sign, 0, 0.02 * sign, 0, -0.01;
    motion.velocity << 0.5, sign, 0.1, 0.3, -0.5 * sign, 1;
  }
  AddNuisance(nuisances::kTimeShift, 0.01, &bundle->cameras[1]);
  MeasureAgain(before, bundle);
}

// A second target, which half of the markers are part of.
void AddTarget(Bundle* bundle) {
  bundle->targets.push_back({.name = "first", .T_target_own = {}, .is_fixed = true});
  RigidTransform pose;
  pose.t = {0.1, 0.2, 0.05};
  bundle->targets.push_back({.name = "second", .T_target_own = pose, .is_fixed = false});
  bundle->targets.push_back({.name = "third", .T_target_own = {}, .is_fixed = true});
  for (size_t m = 0; m < bundle->markers.size() / 2; ++m) bundle->markers[m].target = 1;
  pose.t.x() += 0.002;
  MoveTarget(1, pose, bundle);
}

// A print of another size along each axis, and distances between its markers, some of which share
// an error.
void AddScales(Bundle* bundle) {
  for (const int axis : {0, 1}) {
    bundle->scales.push_back({.axes = Eigen::Vector3d::Unit(axis), .sigma = 0.002 + 0.001 * axis});
  }
  const auto add = [&](std::vector<int> a, std::vector<int> b, double deviation, double common) {
    MarkerDistance distance{.markers_a = std::move(a), .markers_b = std::move(b)};
    const auto& [from, to] = std::pair(bundle->markers[static_cast<size_t>(distance.markers_a[0])],
                                       bundle->markers[static_cast<size_t>(distance.markers_b[0])]);
    distance.length = (from.nominal - to.nominal).norm() + deviation;
    distance.sigma = 0.0001;
    distance.common_sigma = common;
    bundle->distances.push_back(distance);
  };
  add({0}, {9}, 0.001, 0.0002);
  add({0}, {60}, -0.0005, 0.0002);
  add({5, 6, 7}, {65}, 0.001, 0);
}

// The second target is of another size, and distances lead to it.
void AddScaleOfTarget(Bundle* bundle) {
  AddTarget(bundle);
  bundle->scales.push_back({.target = 1, .sigma = 0.01});
  for (const auto& [a, b] : {std::pair(0, 9), std::pair(2, 60)}) {
    const double length = (bundle->markers[static_cast<size_t>(a)].nominal -
                           bundle->markers[static_cast<size_t>(b)].nominal)
                              .norm();
    bundle->distances.push_back(
        {.markers_a = {a}, .markers_b = {b}, .length = length + 0.001, .sigma = 0.0002});
  }
}

// Every marker is measured twice in a view, with an error that both measurements share.
void AddCommonNoise(Bundle* bundle) {
  std::vector<BundleObservation> twice;
  for (const BundleObservation& observation : bundle->observations) {
    twice.push_back(observation);
    twice.push_back(observation);
    twice.back().seen.values[0] += 0.1 * std::sin(static_cast<double>(twice.size()));
    twice.back().assumed_sigma = 1.5;
  }
  bundle->observations = twice;
  for (BundleCamera& camera : bundle->cameras) camera.noise.common_sigma = 0.15;
}

// Both cameras have errors that all of their points share.
void AddSharedErrors(Bundle* bundle) {
  for (BundleCamera& camera : bundle->cameras) {
    for (int k = 0; k < 2; ++k) AddNuisance(nuisances::kSharedError, 1, &camera);
  }
  for (BundleObservation& observation : bundle->observations) {
    const double x = observation.seen.values[0] / 500, y = observation.seen.values[1] / 500;
    observation.by_nuisance = {0.1 * x * y, 0.05 * y, -0.1 * x, 0.02 * x * x};
  }
}

void AddParamPriors(Bundle* bundle) {
  for (BundleCamera& camera : bundle->cameras) {
    camera.rules.resize(camera.params.size());
    camera.rules[2].prior = {.value = camera.params[2] + 0.5, .sigma = 0.3};
  }
}

// The optimum lies on three bounds; a fourth is far off.
void AddBounds(Bundle* bundle) {
  for (BundleCamera& camera : bundle->cameras) camera.rules.resize(camera.params.size());
  bundle->cameras[0].rules[0].upper = bundle->cameras[0].params[0] - 1;
  bundle->cameras[0].rules[2].lower = bundle->cameras[0].params[2] + 2;
  bundle->cameras[1].rules[0].upper = bundle->cameras[1].params[0] - 1;
  bundle->cameras[1].rules[1].lower = 1;
}

// The second camera's f_x and c_x are those of the first.
void Tie(Bundle* bundle) {
  const Bundle before = *bundle;
  for (const size_t k : {0, 2}) {
    BundleCamera& second = bundle->cameras[1];
    second.rules.resize(second.params.size());
    second.rules[k].tied_to = {0, k};
    second.params[k] = bundle->cameras[0].params[k];
  }
  MeasureAgain(before, bundle);
}

// An earlier calibration of parameters and extrinsics, with correlations.
void AddCalibrationPrior(Bundle* bundle) {
  CalibrationPrior prior;
  for (size_t c = 0; c < 2; ++c) {
    prior.T_camera_rig.push_back(bundle->cameras[c].T_camera_rig);
    for (size_t k = 0; k < 4; ++k) {
      prior.unknowns.push_back(
          {.camera = c, .param = k, .value = bundle->cameras[c].params[k] + 0.1});
    }
  }
  for (Eigen::Index i = 0; i < 6; ++i) prior.unknowns.push_back({.camera = 1, .component = i});
  const auto size = std::ssize(prior.unknowns);
  prior.weight = 5 * Eigen::MatrixXd::Identity(size, size);
  prior.weight.bottomRightCorner<6, 6>() *= 100;
  prior.weight.col(0).array() += 1;
  bundle->prior = prior;
}

struct Case {
  std::string name;
  std::function<void(Bundle*)> change;
  int frames = 8;
};

const std::vector<Case>& Cases() {
  static const std::vector<Case> kCases{
      {"Rigid", [](Bundle*) {}},
      {"ManyFrames", [](Bundle*) {}, 50},
      {"ManyFramesWithJitter", AddJitter, 50},
      {"Fixed", [](Bundle* bundle) { bundle->cameras[1].fixed[2] = true; }},
      {"HeldMarkers", [](Bundle* bundle) { bundle->marker_freedom = {}; }},
      {"Jitter", AddJitter},
      {"Motion", AddMotion},
      {"MotionAndJitter",
       [](Bundle* bundle) {
         AddMotion(bundle);
         AddJitter(bundle);
       }},
      {"Targets", AddTarget},
      {"Scales", AddScales},
      {"ScalesOfHeldMarkers",
       [](Bundle* bundle) {
         AddScales(bundle);
         bundle->marker_freedom = MarkerFreedom::Held();
       }},
      {"ManyFramesWithScales", AddScales, 50},
      {"ScaleOfTarget", AddScaleOfTarget},
      {"SharedErrors", AddSharedErrors},
      {"ParamPriors", AddParamPriors},
      {"Tied", Tie},
      {"Bounds", AddBounds},
      {"CalibrationPrior", AddCalibrationPrior},
      {"CommonNoise", AddCommonNoise}};
  return kCases;
}

Bundle MakeCase(size_t index) {
  Bundle bundle = Stereo(Cases()[index].frames);
  Cases()[index].change(&bundle);
  return bundle;
}

// The whole normal matrix, nothing eliminated: a visitor of rows.
struct WholeInformation {
  explicit WholeInformation(const Bundle& of)
      : bundle(of),
        layout(internal::MakeLayout(of)),
        J_of_row(layout.total + 6 * std::ssize(of.T_rig_target) * (1 + std::ssize(of.cameras))),
        H(Eigen::MatrixXd::Zero(J_of_row.size(), J_of_row.size())) {
    internal::RowWalk(of, {}, {.params = true, .extrinsics = true, .pose = true, .marker = true})
        .Visit(*this);
    for (const internal::SparseRow& row : internal::RowsOfPriors(of, layout)) AddPrior(row);
    for (const internal::SparseRow& row : internal::RowsOfDistances(of, layout)) AddPrior(row);
    const Eigen::Index markers = layout.Markers();
    if (markers > 0) {
      H.diagonal().segment(layout.head, markers).array() += 1 / of.marker_freedom.Variance();
    }
  }

  void Marker(const internal::VisitedView& view, const internal::MarkerRows& rows) {
    const internal::ViewCharts charts = internal::ChartsOf(bundle, view.frame, view.camera);
    for (Eigen::Index r = 0; r < rows.Count(); ++r) {
      J_of_row.setZero();
      for (size_t k = 0; k < layout.params[view.camera].size(); ++k) {
        const int index = layout.params[view.camera][k];
        if (index >= 0) J_of_row[index] += rows.Params()(r, static_cast<Eigen::Index>(k));
      }
      const int extrinsics = layout.extrinsics[view.camera];
      if (extrinsics >= 0) J_of_row.segment<6>(extrinsics) = rows.Extrinsics().row(r);
      if (const auto target = bundle.FreeTarget(rows.Marker())) {
        J_of_row.segment<6>(layout.targets[*target]) =
            rows.Position().row(r) *
            internal::PointByTargetPose(
                bundle.targets[*target].T_target_own,
                bundle.markers[static_cast<size_t>(rows.Marker())].position);
      }
      for (size_t k = 0; layout.scales >= 0 && k < bundle.scales.size(); ++k) {
        J_of_row[layout.scales + static_cast<Eigen::Index>(k)] =
            rows.Position().row(r) * bundle.ByScale(bundle.scales[k], rows.Marker());
      }
      if (layout.markers) {
        J_of_row.segment<3>(layout.Marker(rows.Marker())) = rows.Position().row(r);
      }
      const auto pose = layout.total + 6 * static_cast<Eigen::Index>(view.frame);
      J_of_row.segment<6>(pose) = rows.Pose().row(r) * charts.pose;
      if (bundle.EstimatesJitter()) {
        J_of_row.segment<6>(Jitter(view.frame, view.camera)) = rows.Pose().row(r) * charts.jitter;
      }
      AddRow();
    }
  }
  void EndView(const internal::VisitedView& view) {
    if (!bundle.EstimatesJitter()) return;
    const Matrix6d W = JitterWeight(bundle, view.frame, view.camera);
    const Eigen::Index first = Jitter(view.frame, view.camera);
    H.block<6, 6>(first, first) += W.transpose() * W;
  }
  void EndFrame(size_t /*frame*/) {}

  // Standard errors of the head, scaled against rounding.
  [[nodiscard]] Eigen::VectorXd Sigmas() const {
    const Eigen::VectorXd unit = H.diagonal().unaryExpr(
        [](double square) { return square > 0 ? 1 / std::sqrt(square) : 0.0; });
    Eigen::MatrixXd scaled = unit.asDiagonal() * H * unit.asDiagonal();
    scaled.diagonal().array() += (unit.array() == 0).cast<double>();
    return scaled.inverse().diagonal().cwiseSqrt().cwiseProduct(unit).head(layout.head);
  }

  [[nodiscard]] Eigen::Index Jitter(size_t frame, size_t camera) const {
    return layout.total +
           6 * static_cast<Eigen::Index>(bundle.T_rig_target.size() + bundle.View(frame, camera));
  }
  void AddPrior(const internal::SparseRow& row) {
    J_of_row.setZero();
    for (const auto& [index, J] : row.J) J_of_row[index] += J;
    AddRow();
  }
  void AddRow() {
    std::vector<Eigen::Index> touched;
    for (Eigen::Index i = 0; i < J_of_row.size(); ++i) {
      if (J_of_row[i] != 0) touched.push_back(i);
    }
    for (const Eigen::Index i : touched) {
      for (const Eigen::Index j : touched) H(i, j) += J_of_row[i] * J_of_row[j];
    }
  }

  const Bundle& bundle;
  internal::UnknownLayout layout;
  Eigen::VectorXd J_of_row;
  Eigen::MatrixXd H;
};

class BackEnds : public ::testing::TestWithParam<size_t> {};

INSTANTIATE_TEST_SUITE_P(Adjustment,
                         BackEnds,
                         ::testing::Range<size_t>(0, Cases().size()),
                         [](const auto& test) { return Cases()[test.param].name; });

TEST_P(BackEnds, HaveOneOptimum) {
  for (const Loss loss : {Loss::kNone, Loss::kHuber}) {
    Bundle reduced = MakeCase(GetParam());
    Disturb(&reduced);
    // Tied parameters have one value.
    for (size_t k = 0; k < reduced.cameras[1].params.size(); ++k) {
      const ParamIndex root = reduced.Root(1, k);
      reduced.cameras[1].params[k] = reduced.cameras[root.camera].params[root.param];
    }
    for (BundleCamera& camera : reduced.cameras) {
      for (size_t k = 0; k < camera.rules.size(); ++k) {
        camera.params[k] =
            std::clamp(camera.params[k], camera.rules[k].lower, camera.rules[k].upper);
      }
    }
    Bundle whole = reduced;
    ASSERT_EQ(ReasonForAllUnknowns(reduced), "");
    // Ceres takes many steps along bounds.
    const AdjustOptions options{
        .loss = loss, .max_iterations = 1000, .cost_tolerance = 1e-17, .on_iteration = {}};
    const AdjustSummary a = internal::MinimiseReduced(options, &reduced);
    const AdjustSummary b = internal::MinimiseAllUnknowns(options, &whole);
    ASSERT_TRUE(a.converged) << a.message;
    ASSERT_TRUE(b.converged) << b.message;
    constexpr double kRelative = 1e-8, kOfSigma = 1e-5;
    const Uncertainty uncertainty = EstimateUncertainty(whole);
    EXPECT_NEAR(a.cost_before / b.cost_before, 1, 1e-10);
    EXPECT_NEAR(a.cost / b.cost, 1, kRelative);
    for (size_t c = 0; c < reduced.cameras.size(); ++c) {
      const BundleCamera &found = reduced.cameras[c], &expected = whole.cameras[c];
      EXPECT_EQ(found.at_bound, expected.at_bound);
      for (size_t k = 0; k < found.params.size(); ++k) {
        const double sigma = uncertainty.param_std_errors[c][k];
        EXPECT_NEAR(found.params[k],
                    expected.params[k],
                    std::max(kRelative * std::abs(expected.params[k]), kOfSigma * sigma))
            << c << " " << k;
      }
      EXPECT_LT(LocalCoordinates(found.T_camera_rig, expected.T_camera_rig).norm(), kRelative);
    }
    for (size_t k = 0; k < reduced.scales.size(); ++k) {
      EXPECT_NEAR(reduced.scales[k].value, whole.scales[k].value, kRelative) << k;
    }
    for (size_t f = 0; f < reduced.T_rig_target.size(); ++f) {
      for (size_t c = 0; c < 2; ++c) {
        EXPECT_LT(LocalCoordinates(reduced.SeenPose(f, c), whole.SeenPose(f, c)).norm(), kRelative)
            << f;
      }
    }
    for (size_t m = 0; m < reduced.markers.size(); ++m) {
      EXPECT_LT((reduced.markers[m].position - whole.markers[m].position).norm(), kRelative) << m;
      EXPECT_LT((reduced.markers[m].nominal - whole.markers[m].nominal).norm(), kRelative) << m;
    }
    if (loss != Loss::kNone) continue;
    // The covariance is that of the inverse of the whole normal matrix.
    const Eigen::VectorXd sigmas = WholeInformation(whole).Sigmas();
    for (Eigen::Index i = 0; i < sigmas.size(); ++i) {
      EXPECT_NEAR(std::sqrt(uncertainty.covariance(i, i)) / sigmas[i], 1, 1e-6)
          << uncertainty.names[static_cast<size_t>(i)];
    }
  }
}

TEST_P(BackEnds, SumOfSquaresIsThatOfTheElimination) {
  Bundle bundle = MakeCase(GetParam());
  Disturb(&bundle);
  const internal::Objective huber = internal::ObjectiveOf(bundle, {Loss::kHuber, 3});
  const internal::UnknownLayout layout = internal::MakeLayout(bundle);
  const internal::ReducedEquations equations =
      internal::EliminateFrames(bundle, layout, huber, 0, {});
  EXPECT_TRUE(equations.complete);
  EXPECT_NEAR(equations.squares / internal::SumOfSquares(bundle, huber), 1, 1e-12);
}

// Values at a point are the same bytes whatever was evaluated before: other points, and whether the
// squares or the derivatives come first.
TEST_P(BackEnds, ReducedValuesDoNotDependOnWhatWasEvaluatedBefore) {
  const auto evaluate = [&](bool detours) {
    Bundle bundle = MakeCase(GetParam());
    Disturb(&bundle);
    internal::ReducedProblem problem({Loss::kHuber, 3}, &bundle);
    const auto start = problem.Linearise();
    Eigen::VectorXd step = -1e-3 * start->diagonal.cwiseMax(1e-9).cwiseSqrt().cwiseInverse();
    if (detours) {
      problem.MoveFrom(*start, -2 * step, 0.5);
      (void)problem.Squares();
      (void)problem.Linearise();
    }
    problem.MoveFrom(*start, step, 1);
    std::vector<double> values;
    if (!detours) values.push_back(problem.Squares());
    const auto there = problem.Linearise();
    if (detours) values.push_back(problem.Squares());
    values.push_back(there->squares);
    values.insert(values.end(), there->gradient.begin(), there->gradient.end());
    for (const double entry : there->matrix.reshaped()) values.push_back(entry);
    return values;
  };
  EXPECT_EQ(evaluate(false), evaluate(true));
}

TEST(BackEnds, ReducedReachesTheOptimumAfterRejectedSteps) {
  const AdjustOptions fine{.cost_tolerance = 1e-15, .on_iteration = {}};
  Bundle near = Stereo();
  const Bundle start = near;
  ASSERT_TRUE(internal::MinimiseReduced(fine, &near).converged);
  const Uncertainty uncertainty = EstimateUncertainty(near);
  // So far from the optimum that a first step is too long, for at least one factor; rounding
  // decides for which.
  bool was_rejected = false;
  for (const double factor : {3.0, 4.0, 5.0, 6.0}) {
    Bundle far = start;
    for (BundleCamera& camera : far.cameras) camera.params[0] *= factor;
    AdjustOptions options = fine;
    std::vector<double> costs;
    options.on_iteration = [&](int /*iteration*/, double cost) {
      costs.push_back(cost);
      return true;
    };
    ASSERT_TRUE(internal::MinimiseReduced(options, &far).converged) << factor;
    was_rejected = was_rejected || std::ranges::adjacent_find(costs) != costs.end();
    for (size_t c = 0; c < 2; ++c) {
      for (size_t k = 0; k < far.cameras[c].params.size(); ++k) {
        const double expected = near.cameras[c].params[k];
        EXPECT_NEAR(far.cameras[c].params[k],
                    expected,
                    std::max(1e-8 * std::abs(expected), 1e-5 * uncertainty.param_std_errors[c][k]))
            << factor << " " << c << " " << k;
      }
    }
  }
  EXPECT_TRUE(was_rejected);
}

TEST(BackEnds, AreChosenForAReason) {
  Bundle bundle = Stereo();
  EXPECT_EQ(ReasonForAllUnknowns(bundle), "");
  Bundle landmarks = Stereo();
  landmarks.marker_freedom = MarkerFreedom::Landmarks();
  EXPECT_NE(ReasonForAllUnknowns(landmarks).find("landmarks"), std::string::npos);
  Bundle local = Stereo();
  CameraModel model = *local.cameras[1].model;
  model.support_size = 1;
  local.cameras[1].model = &model;
  EXPECT_NE(ReasonForAllUnknowns(local).find("few of its camera's"), std::string::npos);
  Bundle poses = Stereo();
  for (BundleCamera& camera : poses.cameras) {
    camera.is_master = true;
    camera.fixed.assign(camera.fixed.size(), true);
  }
  EXPECT_NE(ReasonForAllUnknowns(poses).find("common"), std::string::npos);
}

}  // namespace TEST_FILE
}  // namespace plenocal
