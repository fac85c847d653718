// SPDX-License-Identifier: Apache-2.0
#include "assess/stress/left_out_region.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <optional>
#include <utility>

#include "calib/adjust/rows.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"
#include "calib/noise/matrix_root.h"

namespace plenocal {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using PoseColumns = Eigen::Matrix<double, Eigen::Dynamic, 6>;

// Whitened rows of the points that share a pose.
struct PoseRows {
  PoseColumns pose;
  MatrixXd unknowns;  // by those before the markers, markers at their best
  VectorXd residual;
  std::vector<size_t> camera;  // per row
};

// Collects the rows of each frame, or of each view where every view has a pose of its own: a
// visitor of rows.
class CollectRows {
 public:
  CollectRows(const Calibration& calibration, const internal::UnknownLayout& layout)
      : bundle_(calibration.bundle),
        layout_(layout),
        gain_(calibration.uncertainty.marker_gain),
        by_view_(bundle_.EstimatesJitter() || !bundle_.motion.empty()) {}

  void Marker(const internal::VisitedView& view, const internal::MarkerRows& rows) {
    const size_t pose = by_view_ ? bundle_.View(view.frame, view.camera) : view.frame;
    MatrixXd by_unknowns = MatrixXd::Zero(rows.Count(), layout_.head);
    internal::ForEachDerivative(
        bundle_, layout_, view.camera, rows, [&](int first, const auto& J) {
          if (first < layout_.head) {
            by_unknowns.middleCols(first, J.cols()) += J;
          } else {
            by_unknowns -= J * gain_.middleRows(first - layout_.head, J.cols());
          }
        });
    marker_rows_[pose].push_back({rows.Pose(),
                                  std::move(by_unknowns),
                                  rows.Residual(),
                                  std::vector<size_t>(static_cast<size_t>(rows.Count()), view.camera)});
  }
  void EndView(const internal::VisitedView& /*view*/) {}
  void EndFrame(size_t /*frame*/) {}

  [[nodiscard]] const std::map<size_t, std::vector<PoseRows>>& ByPose() const {
    return marker_rows_;
  }

 private:
  const Bundle& bundle_;
  const internal::UnknownLayout& layout_;
  const MatrixXd& gain_;
  bool by_view_;
  std::map<size_t, std::vector<PoseRows>> marker_rows_;
};

// What the remaining points tell of a pose: its information, and -d pose / d unknowns.
struct KnownPose {
  Matrix6d information = Matrix6d::Zero();
  MatrixXd by_unknowns;
};

std::optional<KnownPose> PoseFrom(const std::vector<PoseRows>& markers) {
  constexpr Eigen::Index kFewestRows = 12;  // a pose and as many degrees again
  KnownPose known;
  known.by_unknowns = MatrixXd::Zero(6, markers.front().unknowns.cols());
  Eigen::Index count = 0;
  for (const PoseRows& rows : markers) {
    known.information += rows.pose.transpose() * rows.pose;
    known.by_unknowns += rows.pose.transpose() * rows.unknowns;
    count += rows.residual.size();
  }
  const std::optional<MatrixXd> solved = SolvePositive(known.information, known.by_unknowns);
  if (!solved || count < kFewestRows) return std::nullopt;
  known.by_unknowns = *solved;
  return known;
}

// Sums over the left-out points.
struct RegionSums {
  VectorXd score;        // by the unknowns, poses at their best
  MatrixXd information;  // likewise
  double squares = 0, count = 0;  // of residuals in predicted standard deviations

  // `covariance`: of the unknowns.
  void Add(const std::vector<PoseRows>& markers,
           const KnownPose& known,
           size_t camera,
           const MatrixXd& covariance) {
    const Matrix6d pose_covariance = Inverse(known.information);
    Matrix6d all = known.information;
    MatrixXd pose_G = MatrixXd::Zero(6, score.size());
    Vector6d pose_r = Vector6d::Zero();
    for (const PoseRows& rows : markers) {
      const MatrixXd G = rows.unknowns - rows.pose * known.by_unknowns;
      all += rows.pose.transpose() * rows.pose;
      pose_G += rows.pose.transpose() * G;
      pose_r += rows.pose.transpose() * rows.residual;
      score += G.transpose() * rows.residual;
      information += G.transpose() * G;
      for (Eigen::Index i = 0; i < G.rows(); ++i) {
        if (rows.camera[static_cast<size_t>(i)] != camera) continue;
        const double variance = 1 + G.row(i).dot(G.row(i) * covariance) +
                                rows.pose.row(i).dot(rows.pose.row(i) * pose_covariance);
        squares += rows.residual[i] * rows.residual[i] / variance;
        count += 1;
      }
    }
    const MatrixXd by_pose = SolveSymmetric(all, pose_G);
    score -= by_pose.transpose() * pose_r;
    information -= pose_G.transpose() * by_pose;
  }
};

Bundle WithPoints(const Bundle& trained, const Bundle& all, const PartOfObservations& rest) {
  Bundle bundle = trained;
  for (size_t i = 0; i < rest.size(); ++i) {
    bundle.observations[i].used = all.observations[i].used && !rest[i];
  }
  return bundle;
}

}  // namespace

void TestLeftOutRegion(const Calibration& all,
                       const PartOfObservations& rest,
                       const PartCalibration& trained,
                       size_t camera,
                       StressTest* test) {
  const Calibration& calibration = trained.calibration;
  const Uncertainty& uncertainty = calibration.uncertainty;
  for (const double sigma : uncertainty.param_std_errors[camera]) {
    if (std::isfinite(sigma)) continue;
    test->failure = "the other points leave parameters open";
    return;
  }
  const internal::UnknownLayout layout = internal::MakeLayout(calibration.bundle);
  const Bundle left_out = WithPoints(calibration.bundle, all.bundle, rest);
  const auto collect = [&](const Bundle& bundle) {
    CollectRows rows(calibration, layout);
    internal::RowWalk(bundle, {}, {.params = true, .extrinsics = true, .pose = true, .marker = true})
        .Visit(rows);
    return rows;
  };
  const CollectRows inside = collect(calibration.bundle), outside = collect(left_out);
  RegionSums sums{VectorXd::Zero(layout.head), MatrixXd::Zero(layout.head, layout.head)};
  for (const auto& [pose, markers] : outside.ByPose()) {
    const auto found = inside.ByPose().find(pose);
    if (found == inside.ByPose().end()) continue;
    const std::optional<KnownPose> known = PoseFrom(found->second);
    if (known) sums.Add(markers, *known, camera, uncertainty.covariance);
  }
  const ResidualSum of_left_out = SumResiduals(left_out, camera);
  test->points = static_cast<size_t>(sums.count) / calibration.bundle.cameras[camera].model->measured.size();
  if (test->points < kFewestPartPoints) {
    test->failure = "fewer than 30 points there";
    return;
  }
  test->factor = of_left_out.Rms() / SumResiduals(calibration.bundle, camera).Rms();
  test->square = sums.squares / sums.count;
  const std::vector<int> own = internal::UnknownsOf(layout, camera);
  const MatrixXd& I = sums.information;
  const MatrixXd of_score = I + I * uncertainty.covariance * I;
  const MatrixXd root = InverseRoot(MatrixXd(of_score(own, own)));
  const auto count = static_cast<double>(root.cols());
  test->probability = FTail((root.transpose() * sums.score(own)).squaredNorm() / count,
                            count,
                            trained.degrees[camera]);
}

}  // namespace plenocal
