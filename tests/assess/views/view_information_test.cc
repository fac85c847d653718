// SPDX-License-Identifier: Apache-2.0
#include "assess/views/view_information.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "assess/views/pose_errors.h"
#include "assess/views/target_poses.h"
#include "calib/camera/noise_model.h"
#include "models/registry.h"
#include "tests/assess/views/virtual_lenses.h"
#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr int kMarkers = 70;

// Two cameras, the first with a fixed f_y and noise that the observations of a marker share, before
// a grid of 10 x 7 markers whose positions have errors and two common deformations.
struct Rig {
  RigEstimate estimate;
  RigUnknowns unknowns;
  ViewTarget target;
  RigidTransform T_rig_target{ExpRotation({0.2, -0.3, 0.1}), {-0.3, -0.15, 1.2}};

  explicit Rig(bool fixed = false) {
    Random random(3);
    Bundle& bundle = estimate.bundle;
    for (int c = 0; c < 2; ++c) {
      BundleCamera camera{.name = c == 0 ? "left" : "right",
                          .image_size = {400, 300},
                          .model = FindModel(CameraModels(), "pinhole"),
                          .config = {},
                          .params = {300 + 20.0 * c, 310, 200, 150},
                          .fixed = {fixed, fixed || c == 0, fixed, fixed},
                          .T_camera_rig = {},
                          .is_master = c == 0};
      bundle.cameras.push_back(camera);
    }
    bundle.cameras[0].noise.common_sigma = 0.2;
    bundle.cameras[1].T_camera_rig = {ExpRotation({0, 0.1, 0.05}), {-0.2, 0.01, 0.02}};
    estimate.sigma_px = {0.3, 0.5};
    estimate.factors = {1, 1};
    estimate.lenses.resize(2);
    for (int m = 0; m < kMarkers; ++m) {
      const Eigen::Vector3d place(0.06 * (m % 10), 0.05 * (m / 10), 0.01 * (m % 3));
      target.markers[m] = place;
      bundle.markers.push_back({.number = m, .position = place, .nominal = place});
      estimate.marker_sigmas[m] = {1e-3, 2e-3 + 1e-5 * m, 3e-3};
    }
    unknowns = MakeRigUnknowns(bundle, 1.5);
    unknowns.unit.conservativeResize(unknowns.head + 2);
    unknowns.unit.tail<2>().setOnes();
    for (int m = 1; m < kMarkers; ++m) {  // marker 0 stays where it is
      Eigen::Matrix3Xd by(3, 2);
      by << random.Gaussians<3>(1e-2), random.Gaussians<3>(1e-2);
      unknowns.deformations[m] = by;
    }
  }

  // So many observations with errors of each marker in each camera; other sigmas than the usual.
  void Observe(int frame, const std::vector<int>& markers, int twice_from, Random* random) {
    estimate.bundle.T_rig_target.push_back(T_rig_target);
    for (int c = 0; c < 2; ++c) {
      for (const int m : markers) {
        for (int i = 0; i < (c == 0 && m >= twice_from ? 2 : 1); ++i) {
          const Eigen::Vector2d u =
              Image(c, unknowns.unit * 0, Vector6d::Zero(), m, Eigen::Vector3d::Zero());
          BundleObservation seen{
              .camera = c, .frame = frame, .marker = m, .seen = {}, .assumed_sigma = 0.2 + 0.1 * i};
          seen.seen.values = {u.x() + random->Gaussian(0.5), u.y() + random->Gaussian(0.5)};
          estimate.bundle.observations.push_back(seen);
        }
      }
    }
  }

  // Image of a marker after changes of all unknowns (in units), pose and marker.
  [[nodiscard]] Eigen::Vector2d Image(int c,
                                      const Eigen::VectorXd& x,
                                      const Vector6d& pose,
                                      int m,
                                      const Eigen::Vector3d& moved) const {
    const auto index = static_cast<size_t>(c);
    BundleCamera camera = estimate.bundle.cameras[index];
    for (size_t k = 0; k < 4; ++k) {
      const int i = unknowns.params[index][k];
      if (i >= 0) camera.params[k] += unknowns.unit[i] * x[i];
    }
    if (const int first = unknowns.extrinsics[index]; first >= 0) {
      camera.T_camera_rig = Retract(
          camera.T_camera_rig, unknowns.unit.segment<6>(first).cwiseProduct(x.segment<6>(first)));
    }
    Eigen::Vector3d place = target.markers.at(m) + moved;
    if (unknowns.deformations.contains(m)) place += unknowns.deformations.at(m) * x.tail<2>();
    const Eigen::Vector3d p = camera.T_camera_rig * (Retract(T_rig_target, pose) * place);
    return {camera.params[0] * p.x() / p.z() + camera.params[2],
            camera.params[1] * p.y() / p.z() + camera.params[3]};
  }

  // Normal equations by numeric derivatives: unknowns, pose, residual.
  [[nodiscard]] Eigen::MatrixXd Normal(const std::vector<BundleObservation>& observations,
                                       double weight) const {
    const Eigen::Index size = unknowns.unit.size();
    Eigen::MatrixXd N = Eigen::MatrixXd::Zero(size + 7, size + 7);
    constexpr double kStep = 1e-6;
    for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
      const int c = observations[begin].camera, m = observations[begin].marker;
      while (end < observations.size() && observations[end].camera == c &&
             observations[end].marker == m) {
        ++end;
      }
      Eigen::MatrixXd J(2, size + 6), B(2, 3);
      const auto derivative = [&](Eigen::Index column, const Eigen::VectorXd& step) {
        const Eigen::Vector3d moved = step.tail<3>();
        const Vector6d pose = step.segment<6>(size);
        return Eigen::Vector2d((Image(c, -step.head(size), -pose, m, -moved) -
                                Image(c, step.head(size), pose, m, moved)) /
                               (2 * step[column]));
      };
      for (Eigen::Index k = 0; k < size + 9; ++k) {
        const Eigen::Vector2d d = derivative(k, kStep * Eigen::VectorXd::Unit(size + 9, k));
        if (k < size + 6) J.col(k) = d;
        if (k >= size + 6) B.col(k - size - 6) = d * estimate.marker_sigmas.at(m)[k - size - 6];
      }
      const auto rows = static_cast<Eigen::Index>(2 * (end - begin));
      Eigen::MatrixXd all(rows, size + 7), shared(rows, 5);
      const double common = estimate.bundle.cameras[static_cast<size_t>(c)].noise.common_sigma;
      for (size_t i = begin; i < end; ++i) {
        const auto row = static_cast<Eigen::Index>(2 * (i - begin));
        const double sigma = observations[i].assumed_sigma;
        const Eigen::Vector2d seen(observations[i].seen.values[0], observations[i].seen.values[1]);
        const Eigen::Vector2d r =
            seen - Image(c, unknowns.unit * 0, Vector6d::Zero(), m, {0, 0, 0});
        all.middleRows<2>(row) << J / sigma, r / sigma;
        shared.middleRows<2>(row) << B / sigma, common / sigma * Eigen::Matrix2d::Identity();
      }
      const Eigen::MatrixXd V = Eigen::MatrixXd::Identity(rows, rows) + shared * shared.transpose();
      N += weight * all.transpose() * V.inverse() * all;
    }
    return N;
  }
};

void ExpectClose(const Eigen::MatrixXd& found, const Eigen::MatrixXd& expected) {
  ASSERT_EQ(found.rows(), expected.rows());
  ASSERT_EQ(found.cols(), expected.cols());
  EXPECT_LT((found - expected).norm(), 1e-5 * expected.norm());
}

// `fixed`: all parameters, so that extrinsics are the first unknowns.
void ExpectNormalEquations(bool fixed) {
  Rig rig(fixed);
  Random random(5);
  std::vector<int> all(kMarkers);
  for (int m = 0; m < kMarkers; ++m) all[static_cast<size_t>(m)] = m;
  rig.Observe(0, all, 20, &random);
  const std::vector<BundleObservation> good = rig.estimate.bundle.observations;
  auto& seen = rig.estimate.bundle.observations;
  // What adds nothing: not used, not finite (alone and beside another), of an unknown marker, and
  // of one behind the cameras (alone and beside another).
  rig.estimate.bundle.markers.push_back(
      {.number = 500, .position = Eigen::Vector3d::Zero(), .nominal = Eigen::Vector3d::Zero()});
  std::vector<BundleObservation> counted = good;
  seen[3].used = seen[130].used = false;
  seen[7].seen.values[0] = std::numeric_limits<double>::quiet_NaN();
  seen[30].seen.values[1] = std::numeric_limits<double>::quiet_NaN();
  const int bad = seen[30].marker;
  std::erase_if(counted, [&](const BundleObservation& each) {
    return each.camera == 0 ? each.marker == 3 || each.marker == 7 || each.marker == bad
                            : each.marker == 10;
  });
  BundleObservation stray = seen.back();
  stray.marker = kMarkers;
  seen.push_back(stray);
  rig.target.markers[600] = {0, 0, -3};
  rig.estimate.marker_sigmas[600] = Eigen::Vector3d::Zero();
  rig.estimate.bundle.markers.push_back(
      {.number = 600, .position = rig.target.markers[600], .nominal = rig.target.markers[600]});
  stray.marker = kMarkers + 1;
  seen.push_back(stray);
  for (int i = 0; i < 2; ++i) {
    stray.camera = 0;
    seen.insert(seen.begin(), stray);
  }
  const ViewPredictor predictor(rig.estimate, rig.unknowns, rig.target);
  int frames = 0;
  predictor.ForFrames([&](const ViewPredictor::FrameInformation& frame) {
    ++frames;
    EXPECT_EQ(frame.frame, 0);
    const Eigen::Index n = rig.unknowns.unit.size();
    const Eigen::MatrixXd N = rig.Normal(counted, 1);
    const Eigen::MatrixXd tx = N.block(0, n, n, 6);
    const Matrix6d covariance = N.block<6, 6>(n, n).inverse();
    ExpectClose(frame.information, N.topLeftCorner(n, n) - tx * covariance * tx.transpose());
    ExpectClose(frame.gradient,
                N.col(n + 6).head(n) - tx * covariance * N.col(n + 6).segment<6>(n));
    EXPECT_EQ(frame.information, frame.information.transpose());
    ExpectClose(frame.pose_covariance, covariance);
    ExpectClose(frame.pose_by_unknowns, -covariance * tx.transpose());
    ExpectClose(predictor.InformationSoFar(), frame.information + Eigen::MatrixXd::Identity(n, n));
  });
  EXPECT_EQ(frames, 1);
}

TEST(FrameInformation, IsOfTheNormalEquationsWithoutThePose) {
  ExpectNormalEquations(false);
  ExpectNormalEquations(true);
}

// The last observation of a frame and the first of the next one are of one camera and marker.
TEST(FrameInformation, EndsWithItsFrame) {
  const auto first = [](const std::vector<int>& markers_of_next) {
    Rig rig;
    Random random(8);
    rig.Observe(0, {0, 60, 69, 9}, 1000, &random);
    rig.Observe(1, markers_of_next, 1000, &random);
    std::erase_if(rig.estimate.bundle.observations,
                  [](const BundleObservation& each) { return each.camera == 1; });
    std::vector<Eigen::MatrixXd> found;
    ViewPredictor(rig.estimate, rig.unknowns, rig.target).ForFrames([&](const auto& frame) {
      found.push_back(frame.information);
    });
    return found.at(0);
  };
  EXPECT_EQ(first({9, 0, 60, 69}), first({0, 60, 69, 9}));
}

TEST(FrameInformation, IsOfEachFrameWhosePoseIsDetermined) {
  Rig rig;
  Random random(6);
  rig.estimate.marker_sigmas.clear();
  for (int f = 0; f < 131; ++f) {
    if (f == 70) {
      rig.Observe(f, {4}, 0, &random);
      std::erase_if(rig.estimate.bundle.observations,
                    [](const BundleObservation& each) { return each.frame == 70 && each.camera; });
    } else {
      rig.Observe(f, {0, 9, 60, 69}, 1000, &random);
    }
  }
  const ViewPredictor predictor(rig.estimate, rig.unknowns, rig.target);
  std::vector<int> frames, expected;
  predictor.ForFrames([&](const auto& frame) { frames.push_back(frame.frame); });
  for (int f = 0; f < 131; ++f) {
    if (f != 70) expected.push_back(f);
  }
  EXPECT_EQ(frames, expected);
}

TEST(PredictedInformation, IsOfTheMarkersThatAreSeenForAll) {
  const Rig rig;
  const ViewPredictor predictor(rig.estimate, rig.unknowns, rig.target);
  for (const size_t most : {size_t{8}, size_t{24}, size_t{1000}}) {
    std::vector<BundleObservation> observations;
    std::vector<Eigen::Vector3d> order;
    for (int c = 0; c < 2; ++c) {
      const TargetVisibility view =
          predictor.PredictVisibility(static_cast<size_t>(c), rig.T_rig_target, most);
      ASSERT_TRUE(view.found);
      ASSERT_EQ(view.markers.size(), std::min<size_t>(most, kMarkers));
      ASSERT_EQ(view.u_px.size(), view.markers.size());
      for (const Eigen::Vector2d& u_px : view.u_px) {
        int marker = -1;
        for (int m = 0; m < kMarkers; ++m) {
          const Eigen::Vector2d u =
              rig.Image(c, rig.unknowns.unit * 0, Vector6d::Zero(), m, {0, 0, 0});
          if ((u - u_px).norm() < 1e-9) marker = m;
        }
        ASSERT_GE(marker, 0);
        if (c == 0) order.push_back(rig.target.markers.at(marker));
        observations.push_back({.camera = c,
                                .marker = marker,
                                .seen = {},
                                .assumed_sigma = rig.estimate.sigma_px[static_cast<size_t>(c)]});
      }
    }
    // Each next marker is the farthest from those before.
    for (size_t i = 1; i < order.size(); ++i) {
      const auto nearest = [&](size_t j) {
        double least = std::numeric_limits<double>::infinity();
        for (size_t k = 0; k < i; ++k) least = std::min(least, (order[j] - order[k]).norm());
        return least;
      };
      for (size_t j = i + 1; j < order.size(); ++j) ASSERT_LE(nearest(j), nearest(i)) << i;
    }
    const Eigen::Index n = rig.unknowns.unit.size();
    const Eigen::MatrixXd N =
        rig.Normal(observations, kMarkers / static_cast<double>(std::min<size_t>(most, kMarkers)));
    const Eigen::MatrixXd tx = N.block(0, n, n, 6);
    const auto found = predictor.Information(rig.T_rig_target, most);
    ASSERT_TRUE(found);
    ExpectClose(*found,
                N.topLeftCorner(n, n) - tx * N.block<6, 6>(n, n).inverse() * tx.transpose());
    EXPECT_EQ(predictor.Information(rig.T_rig_target, most, 1), found);
  }
  // Behind both cameras; beside one of them.
  RigidTransform behind = rig.T_rig_target;
  behind.t.z() = -2;
  EXPECT_FALSE(predictor.Information(behind, 24));
  RigEstimate turned = rig.estimate;
  turned.bundle.cameras[1].T_camera_rig.R = ExpRotation({0, 2, 0});
  const ViewPredictor one(turned, rig.unknowns, rig.target);
  EXPECT_TRUE(one.Information(rig.T_rig_target, 24));
  EXPECT_TRUE(one.Information(rig.T_rig_target, 24, 0));
  EXPECT_FALSE(one.Information(rig.T_rig_target, 24, 1));
}

// A camera of 300 px a radian before markers one metre away; all on the optical axis, or as many
// `hidden` far beside it.
struct Axis {
  RigEstimate rig;
  RigUnknowns unknowns;
  ViewTarget target;

  explicit Axis(int visible, int hidden = 0) {
    rig.bundle.cameras.push_back({.name = "left",
                                  .image_size = {400, 300},
                                  .model = FindModel(CameraModels(), "pinhole"),
                                  .config = {},
                                  .params = {300, 300, 200, 150},
                                  .fixed = std::vector<bool>(4, false),
                                  .T_camera_rig = {},
                                  .is_master = true});
    rig.lenses.resize(1);
    for (int m = 0; m < visible + hidden; ++m) {
      target.markers[m] = {m < visible ? 0.0 : 5.0, 0, 0};
    }
  }
  [[nodiscard]] bool Finds(double tilt = 0) const {
    const RigidTransform T{ExpRotation({0, tilt, 0}), {0, 0, 1}};
    return ViewPredictor(rig, unknowns, target).PredictVisibility(0, T, 1000).found;
  }
};

TEST(TargetVisibility, NeedsEnoughMarkers) {
  const auto finds = [](int visible, int hidden, bool in_part) {
    Axis axis(visible, hidden);
    axis.target.found_in_part = in_part;
    return axis.Finds();
  };
  EXPECT_TRUE(finds(12, 0, false));
  EXPECT_FALSE(finds(11, 1, false));
  EXPECT_TRUE(finds(6, 6, true));
  EXPECT_FALSE(finds(6, 7, true)) << "less than half";
  EXPECT_FALSE(finds(5, 3, true)) << "fewer than six";
  EXPECT_TRUE(finds(5, 0, true)) << "all that there are";
}

TEST(TargetVisibility, NeedsThePrintedSideBelow75Degrees) {
  Axis axis(6);
  constexpr double kDegree = std::numbers::pi / 180;
  EXPECT_TRUE(axis.Finds(80 * kDegree)) << "it has none";
  for (int m = 0; m < 6; ++m) axis.target.normals[m] = {0, 0, -1};
  EXPECT_TRUE(axis.Finds(74 * kDegree));
  EXPECT_FALSE(axis.Finds(76 * kDegree));
  EXPECT_FALSE(axis.Finds(180 * kDegree));
}

// Three pixels are 10 mm, or 20 mm on a side that is tilted by 60 degrees.
TEST(TargetVisibility, NeedsResolvedDetails) {
  const auto finds = [](double finest, bool printed, double tilt) {
    Axis axis(6);
    axis.target.finest = finest;
    for (int m = 0; m < 6 && printed; ++m) axis.target.normals[m] = {0, 0, -1};
    return axis.Finds(tilt);
  };
  for (const bool printed : {false, true}) {
    EXPECT_TRUE(finds(0.0101, printed, 0));
    EXPECT_FALSE(finds(0.0099, printed, 0));
  }
  EXPECT_TRUE(finds(0.0101, false, 1)) << "a ball has no side";
  EXPECT_TRUE(finds(0.0207, true, std::numbers::pi / 3));
  EXPECT_FALSE(finds(0.0193, true, std::numbers::pi / 3));
  EXPECT_FALSE(finds(0.0207, true, -1.4)) << "hardly any of the other direction";
}

TEST(TargetVisibility, OfAPlenopticCameraNeedsTwoLenses) {
  VirtualLenses made;
  Axis axis(6);
  axis.rig.bundle.cameras = {made.camera};
  const auto finds = [&](const Eigen::Vector2d& place) {
    const RigidTransform T{Eigen::Matrix3d::Identity(), {place.x(), place.y(), 1.2}};
    return ViewPredictor(axis.rig, axis.unknowns, axis.target).PredictVisibility(0, T, 1000).found;
  };
  const Eigen::Vector2d lens = made.centres[315];
  EXPECT_FALSE(finds(lens + Eigen::Vector2d(5, 0))) << "no lens is known";
  axis.rig.lenses[0] = made.array;
  // Lenses show what is 5.4 px away; neighbours of a row are 10 px apart.
  EXPECT_TRUE(finds(lens + Eigen::Vector2d(5, 0)));
  EXPECT_FALSE(finds(lens));
}

// Rows of twelve lenses, which stand for all that show a marker.
TEST(PredictedInformation, OfAPlenopticCameraIsOfTheLensesThatShowEachMarker) {
  VirtualLenses made;
  made.camera.params[0] = 1e-5;
  made.camera.noise.common_sigma = 0.1;
  RigEstimate rig;
  rig.bundle.cameras = {made.camera};
  rig.sigma_px = {0.4};
  rig.lenses = {made.array};
  ViewTarget target;
  for (int m = 0; m < 7; ++m) {
    target.markers[m] = {20.0 * (m % 3), 15.0 * (m / 3), 0.4 * (m % 2)};
    rig.marker_sigmas[m] = {0.3, 0.2, 0.01};
  }
  const RigUnknowns unknowns = MakeRigUnknowns(rig.bundle, 1);
  const RigidTransform T{ExpRotation({0.001, 0.002, 0.1}), {120, 90, 5}};
  const auto project = [&](int m, const Eigen::Vector2d& lens, const Eigen::VectorXd& change) {
    std::vector<double> params = made.camera.params;
    for (size_t k = 0; k < 2; ++k) params[k] += change[static_cast<Eigen::Index>(k)];
    const std::array values{lens.x(), lens.y(), lens.x(), lens.y()};
    Eigen::Vector2d u;
    made.model.Project(params.data(),
                       nullptr,
                       values.data(),
                       Retract(T, change.segment<6>(2)) * (target.markers.at(m) + change.tail<3>()),
                       u.data());
    return u;
  };
  const MicroLensVisibility lenses(made.array);
  Eigen::MatrixXd N = Eigen::MatrixXd::Zero(8, 8);
  for (int m = 0; m < 7; ++m) {
    const auto seen = lenses.LensesShowing(made.camera, T * target.markers.at(m), 12);
    ASSERT_EQ(seen.centres.size(), 12U);
    ASSERT_GT(seen.all, 13U);
    // Each row is there seen.all / 12 times.
    const double root = std::sqrt(static_cast<double>(seen.all) / 12) / 0.4;
    Eigen::MatrixXd J(24, 8), shared(24, 5);
    for (Eigen::Index i = 0; i < 12; ++i) {
      for (Eigen::Index k = 0; k < 11; ++k) {
        const double step = k < 2 ? 1e-7 : 1e-5;
        const Eigen::VectorXd change = step * Eigen::VectorXd::Unit(11, k);
        const Eigen::Vector2d& lens = seen.centres[static_cast<size_t>(i)];
        const Eigen::Vector2d d =
            root * (project(m, lens, change) - project(m, lens, -change)) / (2 * step);
        if (k < 8) J.block<2, 1>(2 * i, k) = d * (k < 2 ? unknowns.unit[k] : 1);
        if (k >= 8) shared.block<2, 1>(2 * i, k - 8) = d * rig.marker_sigmas.at(m)[k - 8];
      }
      shared.block<2, 2>(2 * i, 3) = root * 0.1 * Eigen::Matrix2d::Identity();
    }
    const Eigen::MatrixXd V = Eigen::MatrixXd::Identity(24, 24) + shared * shared.transpose();
    N += J.transpose() * V.inverse() * J;
  }
  const Eigen::MatrixXd tx = N.topRightCorner(2, 6);
  const auto found = ViewPredictor(rig, unknowns, target).Information(T, 1000);
  ASSERT_TRUE(found);
  ExpectClose(*found,
              N.topLeftCorner(2, 2) - tx * N.bottomRightCorner(6, 6).inverse() * tx.transpose());
}

// A record of one camera with four frames of 12 markers; `scale` is that of its sigmas.
CalibrationRecord Record() {
  CalibrationRecord record;
  record.path = "calibration.yaml";
  CalibratedCamera camera{.name = "left",
                          .model = FindModel(CameraModels(), "pinhole"),
                          .image_size = {400, 300},
                          .config = {},
                          .params = {300, 310, 200, 150},
                          .covariance = 0.04 * Eigen::Matrix4d::Identity(),
                          .T_camera_rig = {}};
  camera.fit.noise_sigma = 0.1;
  for (int m = 0; m < 12; ++m) {
    record.markers[m] = {.position = {0.1 * (m % 4), 0.1 * (m / 4), 0}};
  }
  for (int f = 0; f < 4; ++f) {
    const RigidTransform T{ExpRotation({0.4 * (f % 2), 0.5 * (f / 2) - 0.2, 0.1 * f}),
                           {-0.15, -0.1, 1 + 0.1 * f}};
    record.frames.push_back({std::to_string(f), T.Inverse()});
    for (int m = 0; m < 12; ++m) {
      const Eigen::Vector3d p = T * record.markers[m].position;
      camera.residuals.push_back({.frame = f,
                                  .marker = m,
                                  .values = {300 * p.x() / p.z() + 200, 310 * p.y() / p.z() + 150},
                                  .residual = {},
                                  .noise_sigma = 0.1,
                                  .used = true});
    }
  }
  record.cameras = {camera};
  return record;
}

TEST(SetFactors, TakesTheMedianRatioOfVariances) {
  CalibrationRecord record = Record();
  ViewTarget target;
  for (const auto& [number, marker] : record.markers) target.markers[number] = marker.position;
  RigEstimate rig = MakeRigEstimate(record);
  const std::vector<double> distances = PointDistances(rig.bundle, 0);
  const RigUnknowns unknowns = MakeRigUnknowns(rig.bundle, distances[distances.size() / 2]);
  const Eigen::MatrixXd C = ViewPredictor(rig, unknowns, target).InformationSoFar().inverse();
  const auto set = [&](const Eigen::Vector4d& ratios) {
    for (Eigen::Index k = 0; k < 4; ++k) {
      record.cameras[0].covariance(k, k) = ratios[k] * C(k, k) * std::pow(unknowns.unit[k], 2);
    }
    SetFactors(record, target, &rig);
    return rig.factors[0];
  };
  ASSERT_LT(C.diagonal().maxCoeff(), 0.01);
  EXPECT_NEAR(set({4, 4, 4, 4}), 4, 1e-6);
  EXPECT_NEAR(set({2.25, 2.25, 9, 2.25}), 2.25, 1e-6);
  EXPECT_NEAR(set({16, 9, 9, 0.5}), 9, 1e-6);
  EXPECT_NEAR(set({9, 4, 4, 9}), 9, 1e-6);  // the upper one of an even number
  EXPECT_NEAR(set({4, 4, 9, 9}), 9, 1e-6);
  EXPECT_EQ(set({0.5, 0.25, 0.5, 0.5}), 1);
  set({4, 4, 4, 4});
  const CalibratedViews views(record);
  ExpectClose(views.Factors(), Eigen::Vector4d::Constant(2));
  ExpectClose(views.Unknowns().unit, unknowns.unit);
  ExpectClose(views.Predictor().InformationSoFar().inverse(), C);
  // What the prior alone determines has no part in the factor.
  RigEstimate poor = MakeRigEstimate(record);
  poor.bundle.observations.clear();
  record.cameras[0].covariance.diagonal() = 4 * unknowns.unit.cwiseAbs2();
  SetFactors(record, target, &poor);
  EXPECT_EQ(poor.factors[0], 1);
}

// Extrinsics are judged in the first camera's distance from the target.
TEST(CalibratedViews, MeasureExtrinsicsByTheDistanceOfPoints) {
  CalibrationRecord record = Record();
  CalibratedCamera other = record.cameras[0];
  other.name = "right";
  other.T_camera_rig.t = {0, 0, 2};
  record.cameras.push_back(other);
  const auto unit = [&] {
    const CalibratedViews views(record);
    return views.Unknowns().unit[views.Unknowns().extrinsics[1]];
  };
  const std::vector<double> distances = PointDistances(MakeRigEstimate(record).bundle, 0);
  EXPECT_EQ(unit(), distances[24]);
  record.cameras[0].residuals.clear();
  EXPECT_EQ(unit(), 1);
}

TEST(ComputePoseErrors, AreThoseOfTheFrameAndOfAllUnknowns) {
  CalibrationRecord record = Record();
  record.cameras[0].covariance *= 1e3;
  const CalibratedViews views(record);
  const std::map<int, PoseErrors> errors = ComputePoseErrors(record);
  ASSERT_EQ(errors.size(), 4U);
  ASSERT_GT(views.Factors()[0], 1.5);
  const Eigen::MatrixXd F = views.Factors().asDiagonal();
  const Eigen::MatrixXd C = F * views.Predictor().InformationSoFar().inverse() * F;
  int frames = 0;
  views.Predictor().ForFrames([&](const ViewPredictor::FrameInformation& frame) {
    const PoseErrors& found = errors.at(frame.frame);
    ExpectClose(found.own, frame.pose_covariance);
    ExpectClose(found.shared * found.shared.transpose(),
                frame.pose_by_unknowns * C * frame.pose_by_unknowns.transpose());
    ++frames;
  });
  EXPECT_EQ(frames, 4);
  // What two poses share has their correlation.
  EXPECT_EQ(errors.at(0).shared.cols(), errors.at(3).shared.cols());
}

TEST(PlaceTarget, OfAPlenopticCameraIsOnTheRayOfTheNearestLens) {
  VirtualLenses made;
  RigEstimate rig;
  rig.bundle.cameras = {made.camera};
  rig.lenses.resize(1);
  ViewTarget target{.markers = {{0, {0, 0, 0}}, {1, {2, 0, 0}}}};
  const TargetPose pose{.place = {28, 11}, .distance = 4};
  EXPECT_FALSE(PlaceTarget(rig, target, pose));
  for (const Eigen::Vector2d& centre : {Eigen::Vector2d(20, 10),
                                        Eigen::Vector2d(30, 12),
                                        Eigen::Vector2d(28, 40),
                                        Eigen::Vector2d(90, 11)}) {
    rig.lenses[0].lenses.push_back({.centre = centre});
  }
  const auto T = PlaceTarget(rig, target, pose);
  ASSERT_TRUE(T);
  const Eigen::Vector3d expected =
      Eigen::Vector3d(30, 12, 0) + 4 * Eigen::Vector3d(30, 12, 100).normalized();
  EXPECT_LT((*T * Eigen::Vector3d(1, 0, 0) - expected).norm(), 1e-9);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
