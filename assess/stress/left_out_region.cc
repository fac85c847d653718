// SPDX-License-Identifier: Apache-2.0
#include "assess/stress/left_out_region.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "calib/adjust/rows.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"
#include "calib/noise/frame_scatter.h"
#include "calib/noise/matrix_root.h"

namespace plenocal {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Points that the others predict worse than this, in standard deviations of their noise, are
// beyond the linear prediction: a pose from a few points, or from a line of them.
constexpr double kLargestSigma = 20;
// Predictions are not linear in the parameters where their variance, less the noise, differs more
// than this between the optimum of the other points and that of all.
constexpr double kMostCurved = 2;

// Sums over the rows of one pose. G: derivatives by the unknowns.
struct PoseSums {
  Matrix6d information = Matrix6d::Zero();
  MatrixXd pose_G;
  Vector6d pose_r = Vector6d::Zero();

  template <typename Pose>
  void Add(const Pose& P, const MatrixXd& G, const VectorXd& r) {
    if (pose_G.size() == 0) pose_G = MatrixXd::Zero(6, G.cols());
    information += P.transpose() * P;
    pose_G += P.transpose() * G;
    pose_r += P.transpose() * r;
  }
};

// Sums over the rows of a camera: of the points of the calibration, and of the left-out ones.
struct RegionSums {
  double inside_squares = 0, inside_rows = 0;
  double squares = 0, variances = 0, rows = 0;
};

// Walks over whitened rows: of the points of the calibration, then of the left-out ones.
class RegionRows {
 public:
  RegionRows(const Calibration& calibration, size_t camera)
      : bundle_(calibration.bundle),
        covariance_(calibration.uncertainty.covariance),
        root_(Root(covariance_)),
        camera_(camera),
        layout_(internal::MakeLayout(bundle_)),
        score_(VectorXd::Zero(layout_.head)),
        information_(MatrixXd::Zero(layout_.head, layout_.head)) {
    Walk(bundle_);
    for (const auto& [pose, sums] : inside_) {
      const MatrixXd root = InverseRoot(MatrixXd(sums.information));
      if (root.cols() == 6) poses_[pose] = {root, root * root.transpose() * sums.pose_G};
    }
  }

  void Predict(const Bundle& left_out) {
    predicts_ = true;
    Walk(left_out);
    for (const auto& [pose, sums] : outside_) {
      const MatrixXd by_pose =
          SolveSymmetric(Matrix6d(inside_[pose].information + sums.information), sums.pose_G);
      score_ -= by_pose.transpose() * sums.pose_r;
      information_ -= sums.pose_G.transpose() * by_pose;
    }
  }

  [[nodiscard]] const RegionSums& Sums() const { return sums_; }

  /// Of so large a score of the camera's unknowns by errors alone.
  [[nodiscard]] double Probability(double degrees) const {
    const std::vector<int> own = internal::UnknownsOf(layout_, camera_);
    const MatrixXd covariance = information_ + information_ * covariance_ * information_;
    const MatrixXd root = InverseRoot(MatrixXd(covariance(own, own)));
    const auto rank = static_cast<double>(root.cols());
    return FTail((root.transpose() * score_(own)).squaredNorm() / rank, rank, degrees);
  }

  void Marker(const internal::VisitedView& view, const internal::MarkerRows& rows) {
    const bool by_view = bundle_.EstimatesJitter() || !bundle_.motion.empty();
    const size_t pose = by_view ? bundle_.View(view.frame, view.camera) : view.frame;
    const VectorXd r = rows.Residual();
    MatrixXd G = MatrixXd::Zero(r.size(), layout_.head);
    internal::ForEachDerivative(bundle_, layout_, view.camera, rows, [&](int at, const auto& J) {
      G.middleCols(at, J.cols()) += J;
    });
    if (!predicts_) {
      inside_[pose].Add(rows.Pose(), G, r);
      if (view.camera != camera_) return;
      sums_.inside_squares += r.squaredNorm();
      sums_.inside_rows += static_cast<double>(r.size());
      return;
    }
    const auto known = poses_.find(pose);
    if (known == poses_.end()) return;
    G -= rows.Pose() * known->second.by_unknowns;
    const VectorXd variance = 1 + (G * root_).rowwise().squaredNorm().array() +
                              (rows.Pose() * known->second.root).rowwise().squaredNorm().array();
    if (variance.maxCoeff() > kLargestSigma * kLargestSigma) return;
    outside_[pose].Add(rows.Pose(), G, r);
    score_ += G.transpose() * r;
    information_ += G.transpose() * G;
    if (view.camera != camera_) return;
    sums_.squares += r.squaredNorm();
    sums_.variances += variance.sum();
    sums_.rows += static_cast<double>(r.size());
  }
  void EndView(const internal::VisitedView& /*view*/) {}
  void EndFrame(size_t /*frame*/) {}

 private:
  // A pose by the points of the calibration.
  struct Pose {
    MatrixXd root;         // N N': its covariance with the unknowns as they are
    MatrixXd by_unknowns;  // -d pose / d unknowns
  };

  void Walk(const Bundle& bundle) {
    internal::RowWalk(bundle, {}, {.params = true, .extrinsics = true, .pose = true}).Visit(*this);
  }

  const Bundle& bundle_;
  const MatrixXd& covariance_;
  MatrixXd root_;  // of `covariance_`
  size_t camera_;
  internal::UnknownLayout layout_;
  bool predicts_ = false;
  std::map<size_t, PoseSums> inside_, outside_;
  std::map<size_t, Pose> poses_;

  RegionSums sums_;
  VectorXd score_;        // of all left-out rows by the unknowns, poses at their best
  MatrixXd information_;  // likewise
};

// Mean variance of the predictions less that of the noise.
double ExcessAtOptimumOfAll(const Calibration& all,
                            const PartCalibration& trained,
                            Bundle left_out,
                            size_t camera) {
  Calibration at_all = trained.calibration;
  at_all.uncertainty = trained.at_optimum_of_all;
  ScaleByScatter(trained.factors, &at_all.uncertainty);
  for (Bundle* bundle : {&at_all.bundle, &left_out}) {
    bundle->cameras = all.bundle.cameras;
    bundle->T_rig_target = all.bundle.T_rig_target;
  }
  RegionRows rows(at_all, camera);
  rows.Predict(left_out);
  return rows.Sums().variances / rows.Sums().rows - 1;
}

}  // namespace

void TestLeftOutRegion(const Calibration& all,
                       const PartOfObservations& rest,
                       const PartCalibration& trained,
                       size_t camera,
                       StressTest* test) {
  const Calibration& calibration = trained.calibration;
  const std::vector<double>& sigmas = calibration.uncertainty.param_std_errors[camera];
  if (std::ranges::any_of(sigmas, [](double sigma) { return !std::isfinite(sigma); })) {
    test->failure = "the other points leave parameters open";
    return;
  }
  Bundle left_out = calibration.bundle;
  for (size_t i = 0; i < rest.size(); ++i) {
    left_out.observations[i].used = all.bundle.observations[i].used && !rest[i];
  }
  RegionRows rows(calibration, camera);
  rows.Predict(left_out);
  const RegionSums& sums = rows.Sums();
  const size_t measured = calibration.bundle.cameras[camera].model->measured.size();
  if (sums.rows < static_cast<double>(kFewestPartPoints * measured)) {
    test->failure = fmt::format("the other points predict fewer than {} there", kFewestPartPoints);
    return;
  }
  const double excess = sums.variances / sums.rows - 1,
               excess_at_all = ExcessAtOptimumOfAll(all, trained, left_out, camera);
  if (!(std::max(excess, excess_at_all) < kMostCurved * std::min(excess, excess_at_all))) {
    test->failure = "the prediction is not linear in the parameters";
    return;
  }
  const double rms = RmsResidual(calibration.bundle, camera);
  const double inside = sums.inside_squares / sums.inside_rows;
  test->factor = std::sqrt(sums.squares / sums.rows / inside);
  test->difference = rms * test->factor;
  test->predicted = rms * std::sqrt(sums.variances / sums.rows / inside);
  test->probability = rows.Probability(trained.degrees[camera]);
}

}  // namespace plenocal
