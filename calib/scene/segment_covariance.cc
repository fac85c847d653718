// SPDX-License-Identifier: Apache-2.0
#include "calib/scene/segment_covariance.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "calib/adjust/priors.h"
#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"
#include "calib/noise/landmark_system.h"

namespace plenocal {
namespace {

// Derivative of a camera's position in the landmarks' frame by the chart of T_rig_target and by
// that of the camera's extrinsics: p = -R' q, q = t + R_c' t_c.
struct PositionDerivative {
  Eigen::Matrix<double, 3, 6> by_pose, by_extrinsics;
};

PositionDerivative DifferentiatePosition(const RigidTransform& T_rig_target,
                                         const RigidTransform& T_camera_rig) {
  const Eigen::Vector3d q = T_rig_target.t + T_camera_rig.R.transpose() * T_camera_rig.t;
  const Eigen::Matrix3d Rt = T_rig_target.R.transpose();
  const Eigen::Matrix3d Rc = Rt * T_camera_rig.R.transpose();
  PositionDerivative derivative;
  derivative.by_pose << -Rt, -Rt * Hat(q);
  derivative.by_extrinsics << -Rc, -Rc * Hat(T_camera_rig.t);
  return derivative;
}

// Rows of the seven numbers of a segment by all unknowns.
Eigen::MatrixXd SegmentRows(const Bundle& bundle,
                            const PoseSystem& system,
                            int extrinsics,
                            size_t camera,
                            const PathSegment& segment,
                            std::span<const size_t> frames) {
  Matrix7d normal = Matrix7d::Zero();
  Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(7, system.Size());
  for (size_t i = 0; i < frames.size(); ++i) {
    const auto A = SimilarityEffect(segment.positions[i], segment.centre);
    normal += A.transpose() * A;
    const PositionDerivative dp =
        DifferentiatePosition(bundle.T_rig_target[frames[i]], bundle.cameras[camera].T_camera_rig);
    const int pose = system.pose[frames[i]];
    if (pose >= 0) rows.middleCols<6>(pose) += A.transpose() * dp.by_pose;
    if (extrinsics >= 0) rows.middleCols<6>(extrinsics) += A.transpose() * dp.by_extrinsics;
  }
  return SolveSymmetric(Eigen::MatrixXd(normal), rows);
}

// Diagonal 6 x 6 blocks of (L L')^-1 of each frame's pose in its chart.
std::vector<Matrix6d> PoseBlocks(const Eigen::LLT<Eigen::MatrixXd>& factor,
                                 const std::vector<int>& pose) {
  std::vector<Matrix6d> blocks(pose.size(), Matrix6d::Zero());
  const Eigen::Index size = factor.rows();
  for (size_t frame = 0; frame < pose.size(); ++frame) {
    if (pose[frame] < 0) continue;
    const Eigen::Index rest = size - pose[frame];
    const auto L = factor.matrixLLT().bottomRightCorner(rest, rest);
    const Eigen::MatrixXd columns =
        L.triangularView<Eigen::Lower>().solve(Eigen::MatrixXd::Identity(rest, 6));
    blocks[frame] = columns.transpose() * columns;
  }
  return blocks;
}

// A covariance, no smaller in any direction than another estimate of it.
struct Widened {
  Eigen::MatrixXd covariance;
  double factor = 1;  // mean over the directions
};

Widened Widen(const Eigen::MatrixXd& covariance, const Eigen::MatrixXd& other) {
  const Eigen::LLT<Eigen::MatrixXd> root(covariance);
  if (root.info() != Eigen::Success) return {covariance};
  const Eigen::MatrixXd left = root.matrixL().solve(other);
  const SymmetricEigen spectrum =
      DecomposeSymmetric(Eigen::MatrixXd(root.matrixL().solve(left.transpose())));
  const Eigen::VectorXd factors = spectrum.values.cwiseMax(1);
  const Eigen::MatrixXd directions = root.matrixL() * spectrum.vectors;
  return {directions * factors.asDiagonal() * directions.transpose(), factors.mean()};
}

// Groups of neighbouring landmarks: halves of halves across the longer side of the rays to them.
// Each half has as many landmarks that both segments show, since these tie the end to the start.
class Neighbourhoods {
 public:
  // Wide enough for errors that reach from wall to wall, and enough for a factor of some 10 %.
  static constexpr int kHalvings = 4;

  // `from`: a place that both segments see the scene from.
  Neighbourhoods(const Bundle& bundle, const Eigen::Vector3d& from, std::span<const size_t> end)
      : group_(bundle.markers.size(), 0) {
    std::vector<bool> of_end(bundle.T_rig_target.size(), false);
    for (const size_t frame : end) of_end[frame] = true;
    std::vector<bool> in_start(bundle.markers.size(), false), in_end(in_start);
    for (const BundleObservation& seen : bundle.observations) {
      if (!seen.used) continue;
      const bool late = of_end[static_cast<size_t>(seen.frame)];
      (late ? in_end : in_start)[static_cast<size_t>(seen.marker)] = true;
    }
    std::vector<Ray> rays;
    for (size_t m = 0; m < bundle.markers.size(); ++m) {
      if (!in_start[m] && !in_end[m]) continue;
      const Eigen::Vector3d direction = (bundle.markers[m].position - from).normalized();
      rays.push_back({m, in_start[m] && in_end[m], direction});
    }
    Halve(rays, kHalvings, 0);
  }

  [[nodiscard]] const std::vector<int>& Group() const { return group_; }

 private:
  struct Ray {
    size_t landmark = 0;
    bool common = false;
    Eigen::Vector3d direction;
  };

  void Halve(std::span<Ray> rays, int halvings, int group) {
    if (halvings == 0) {
      for (const Ray& ray : rays) group_[ray.landmark] = group;
      return;
    }
    Eigen::AlignedBox3d box;
    for (const Ray& ray : rays) box.extend(ray.direction);
    Eigen::Index axis = 0;
    if (!rays.empty()) box.sizes().maxCoeff(&axis);
    std::ranges::stable_sort(rays, {}, [&](const Ray& ray) { return ray.direction[axis]; });
    const auto all = std::ranges::count_if(rays, &Ray::common);
    size_t middle = all > 0 ? 0 : rays.size() / 2;
    for (std::ptrdiff_t count = 0; 2 * count < all; ++middle) count += rays[middle].common ? 1 : 0;
    Halve(rays.first(middle), halvings - 1, 2 * group);
    Halve(rays.subspan(middle), halvings - 1, 2 * group + 1);
  }

  std::vector<int> group_;
};

// By how much the covariance that follows from the scatter of groups of tracks is larger than that
// from the scatter of tracks: neighbours share errors. Jackknife, a group left out at a time.
double NeighbourFactor(const Eigen::MatrixXd& covariance,
                       const LandmarkScores& scores,
                       std::span<const int> group,
                       const Eigen::MatrixXd& of_calibration,
                       const Eigen::MatrixXd& by_tracks) {
  const Eigen::Index size = covariance.rows();
  Eigen::MatrixXd sums =
      Eigen::MatrixXd::Zero(size, static_cast<Eigen::Index>(scores.information.size()));
  for (size_t m = 0; m < group.size(); ++m) {
    sums.col(group[m]) += scores.gradients.col(static_cast<Eigen::Index>(m)).head(size);
  }
  Eigen::MatrixXd by_groups = of_calibration;
  const double jackknife_factor = 1 - 1 / static_cast<double>(sums.cols());
  for (Eigen::Index g = 0; g < sums.cols(); ++g) {
    const Eigen::MatrixXd others =
        covariance - scores.information[static_cast<size_t>(g)].topLeftCorner(size, size);
    Eigen::VectorXd change = sums.col(g);
    const Eigen::LLT<Eigen::MatrixXd> factor(others);
    // Without a group that alone determines a direction there is no estimate to compare with.
    if (factor.info() == Eigen::Success) change = covariance * factor.solve(change).eval();
    by_groups += jackknife_factor * change * change.transpose();
  }
  const Eigen::LLT<Eigen::MatrixXd> factor(by_tracks);
  if (factor.info() != Eigen::Success) return 1;
  return std::max(1.0, factor.solve(by_groups).trace() / static_cast<double>(size));
}

// The squares of errors in units of a covariance that is itself estimated from tracks are too
// large, to first order by (size + 1) / tracks; tracks in proportion to what they contribute.
double FewTracksFactor(const Eigen::MatrixXd& gradients, const Eigen::MatrixXd& by_tracks) {
  const Eigen::LLT<Eigen::MatrixXd> factor(by_tracks);
  if (factor.info() != Eigen::Success) return 1;
  const Eigen::ArrayXd shares = gradients.cwiseProduct(factor.solve(gradients)).colwise().sum();
  const double sum = shares.sum();
  if (!(sum > 0)) return 1;
  const double tracks = sum * sum / shares.square().sum();
  return 1 + static_cast<double>(gradients.rows() + 1) / tracks;
}

}  // namespace

Eigen::Matrix<double, 3, 7> SimilarityEffect(const Eigen::Vector3d& p,
                                             const Eigen::Vector3d& centre) {
  Eigen::Matrix<double, 3, 7> effect;
  effect << Eigen::Matrix3d::Identity(), -Hat(p - centre), p - centre;
  return effect;
}

Vector7d PathSegment::Fit(std::span<const Eigen::Vector3d> dp) const {
  Matrix7d normal = Matrix7d::Zero();
  Vector7d right = Vector7d::Zero();
  for (size_t i = 0; i < positions.size(); ++i) {
    const auto A = SimilarityEffect(positions[i], centre);
    normal += A.transpose() * A;
    right += A.transpose() * dp[i];
  }
  return SolveSymmetric(Eigen::MatrixXd(normal), Eigen::VectorXd(right));
}

PathSegment MakeSegment(const Bundle& bundle, size_t camera, std::span<const size_t> frames) {
  PathSegment segment;
  for (const size_t frame : frames) {
    segment.positions.push_back(
        (bundle.cameras[camera].T_camera_rig * bundle.T_rig_target[frame]).Inverse().t);
    segment.centre += segment.positions.back();
  }
  const double count = std::max<double>(1, static_cast<double>(frames.size()));
  segment.centre /= count;
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& p : segment.positions) {
    scatter += (p - segment.centre) * (p - segment.centre).transpose() / count;
  }
  segment.extent = DecomposeSymmetric(scatter).values.reverse().cwiseMax(0).cwiseSqrt();
  return segment;
}

Matrix7d LoopCovariance::Relative() const {
  return segments.topLeftCorner<7, 7>() + segments.bottomRightCorner<7, 7>() -
         segments.topRightCorner<7, 7>() - segments.bottomLeftCorner<7, 7>();
}

double LoopCovariance::AlignmentFloor(const PathSegment& start,
                                      const PathSegment& end,
                                      std::span<const Eigen::Vector3d> path) const {
  double sum = 0;
  for (const Eigen::Vector3d& p : path) {
    Eigen::Matrix<double, 3, 14> M;
    M << -SimilarityEffect(p, start.centre), SimilarityEffect(p, end.centre);
    sum += (M * segments * M.transpose()).trace();
  }
  // Rounding may make a sum of zeros negative.
  return std::sqrt(std::max(0.0, sum) / std::max<double>(1, static_cast<double>(path.size())));
}

LoopCovariance EstimateLoopCovariance(const Bundle& bundle,
                                      size_t camera,
                                      std::span<const size_t> start,
                                      std::span<const size_t> end) {
  const internal::UnknownLayout layout = internal::MakeLayout(bundle);
  const PoseSystem system = EliminateLandmarks(bundle, layout);
  const Eigen::LLT<Eigen::MatrixXd> factor(system.information.selfadjointView<Eigen::Lower>());
  if (factor.info() != Eigen::Success) {
    throw JobError(
        "the scene points do not determine all poses and the scale; images with more "
        "points in common, and a calibration with standard errors, may");
  }
  const auto rows_of = [&](std::span<const size_t> frames) {
    const PathSegment segment = MakeSegment(bundle, camera, frames);
    return SegmentRows(bundle, system, layout.extrinsics[camera], camera, segment, frames);
  };
  std::vector<size_t> both(start.begin(), start.end());
  both.insert(both.end(), end.begin(), end.end());
  Eigen::MatrixXd rows(21, system.Size());
  rows << rows_of(start), rows_of(end), rows_of(both);
  const Eigen::MatrixXd directions = factor.solve(rows.transpose());
  const Eigen::MatrixXd covariance = rows * directions;
  const Neighbourhoods neighbourhoods(bundle, MakeSegment(bundle, camera, start).centre, end);
  const LandmarkScores scores = ScoreLandmarks(bundle, layout, directions, neighbourhoods.Group());
  Eigen::MatrixXd of_prior = Eigen::MatrixXd::Zero(system.Size(), system.Size());
  AddInformation(internal::RowsOfCalibrationPrior(bundle, layout), &of_prior);
  const Eigen::MatrixXd of_calibration =
      directions.transpose() * (of_prior.selfadjointView<Eigen::Lower>() * directions);
  Eigen::MatrixXd by_tracks = scores.gradients * scores.gradients.transpose() + of_calibration;
  const Eigen::MatrixXd of_segments = by_tracks.topLeftCorner(14, 14);
  by_tracks *= FewTracksFactor(scores.gradients.topRows(14), of_segments) *
               NeighbourFactor(covariance.topLeftCorner(14, 14),
                               scores,
                               neighbourhoods.Group(),
                               of_calibration.topLeftCorner(14, 14),
                               of_segments);
  LoopCovariance result;
  const Widened widened = Widen(covariance.topLeftCorner(14, 14), by_tracks.topLeftCorner(14, 14));
  result.segments = widened.covariance;
  result.track_factor = widened.factor;
  result.scale_sigma = std::sqrt(std::max(covariance(20, 20), by_tracks(20, 20)));
  result.poses = PoseBlocks(factor, system.pose);
  for (size_t frame = 0; frame < result.poses.size(); ++frame) {
    const Matrix6d J = InverseLogJacobian(bundle.T_rig_target[frame]);
    result.poses[frame] = widened.factor * J * result.poses[frame] * J.transpose();
  }
  return result;
}

}  // namespace plenocal
