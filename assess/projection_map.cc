// SPDX-License-Identifier: Apache-2.0
#include "assess/projection_map.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "assess/views/projection_jacobian.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"
#include "calib/camera/rays.h"

namespace plenocal {
namespace {

// Calls use(row, point in the camera's frame) for each used observation of a camera.
template <typename Use>
void ForEachUsed(const CalibrationRecord& calibration, size_t c, const Use& use) {
  int frame = -1;  // rows of one frame follow each other
  RigidTransform T_camera_target;
  for (const ResidualRow& row : calibration.cameras[c].residuals) {
    if (!row.used) continue;
    if (row.frame != frame) {
      frame = row.frame;
      T_camera_target = calibration.CameraFromTarget(c, frame);
    }
    use(row, Eigen::Vector3d(T_camera_target * calibration.markers.at(row.marker).position));
  }
}

// An observation in the middle of each cell; NaN outside the image circle and where there is none.
// The context (micro lens) is that of the nearest observation, since a model does not have the
// places of its micro lenses.
std::vector<std::array<double, kMaxObservationSize>> CellValues(const CalibratedCamera& camera,
                                                                const ImageGrid& grid) {
  std::array<double, kMaxObservationSize> none{};
  none.fill(std::nan(""));
  std::vector values(grid.Cells(), none);
  std::vector<double> nearest(grid.Cells(), std::numeric_limits<double>::infinity());
  for (const ResidualRow& row : camera.residuals) {
    if (!row.used || !camera.model->plenoptic) continue;
    const Eigen::Vector2d place(row.values[0], row.values[1]);
    const size_t cell = grid.Cell(place.x(), place.y());
    const double distance = (place - grid.Middle(cell)).norm();
    if (distance >= nearest[cell]) continue;
    nearest[cell] = distance;
    values[cell] = row.values;
  }
  for (size_t cell = 0; cell < grid.Cells(); ++cell) {
    const Eigen::Vector2d middle = grid.Middle(cell);
    if (!camera.model->plenoptic) values[cell] = {middle.x(), middle.y()};
    if (camera.image_circle && !camera.image_circle->Has(middle)) values[cell] = none;
  }
  return values;
}

Eigen::Matrix<double, 2, 6> ByMotion(const ProjectionJacobian& seen, const Eigen::Vector3d& p) {
  Eigen::Matrix<double, 3, 6> moved;
  moved << Eigen::Matrix3d::Identity(), -Hat(p);
  return seen.by_point.topRows<2>() * moved;
}

double WorstSigma(const Eigen::MatrixXd& J, const Eigen::MatrixXd& covariance) {
  const Eigen::Matrix2d spread = J * covariance * J.transpose();
  const double greatest = (spread(0, 0) + spread(1, 1)) / 2 +
                          std::hypot((spread(0, 0) - spread(1, 1)) / 2, spread(1, 0));
  return std::sqrt(std::max(greatest, 0.0));  // NaN stays
}

}  // namespace

double ProjectionMap::Most(double systematic) const {
  std::vector<double> known;
  std::ranges::copy_if(
      sigma, std::back_inserter(known), [](double each) { return !std::isnan(each); });
  if (known.empty()) return std::nan("");
  return std::hypot(Quantile(std::move(known), kMostOfImage), systematic);
}

HousedProjection::HousedProjection(const CalibrationRecord& calibration, size_t c)
    : camera_(calibration.cameras[c]) {
  if (!camera_.covariance.allFinite()) return;
  std::vector<ObservedPoint> points;
  ForEachUsed(calibration, c, [&](const ResidualRow& row, const Eigen::Vector3d& p) {
    distances_.push_back(p.norm());
    points.push_back({row.values, p});
  });
  Matrix6d normal = Matrix6d::Zero();
  Eigen::MatrixXd mixed =
      Eigen::MatrixXd::Zero(6, static_cast<Eigen::Index>(camera_.params.size()));
  DifferentiateEach(camera_, points, [&](size_t i, const ProjectionJacobian& seen) {
    const Eigen::Matrix<double, 2, 6> J = ByMotion(seen, points[i].p);
    normal.noalias() += J.transpose().lazyProduct(J);
    mixed.noalias() += J.transpose().lazyProduct(seen.by_params);
  });
  if (!distances_.empty()) follow_ = SolveSymmetric(normal, mixed);
  std::ranges::sort(distances_);
}

bool HousedProjection::IsKnown() const { return follow_.size() > 0 && follow_.allFinite(); }

std::vector<std::optional<SeenRay>> HousedProjection::RaysOf(
    std::span<const std::array<double, kMaxObservationSize>> values) const {
  std::vector<size_t> places;
  std::vector<std::array<double, kMaxObservationSize>> known;
  for (size_t i = 0; i < values.size(); ++i) {
    if (std::isnan(values[i][0])) continue;
    places.push_back(i);
    known.push_back(values[i]);
  }
  std::vector<std::optional<SeenRay>> rays(values.size());
  const auto found = Unproject(camera_, known);
  for (size_t i = 0; i < found.size(); ++i) {
    if (found[i]) rays[places[i]] = SeenRay{known[i], *found[i]};
  }
  return rays;
}

std::vector<double> HousedProjection::Sigmas(std::span<const std::optional<SeenRay>> rays,
                                             double distance) const {
  std::vector<ObservedPoint> points;
  std::vector<size_t> ray_of_point;
  for (size_t i = 0; i < rays.size(); ++i) {
    if (!rays[i]) continue;
    const Ray& ray = rays[i]->ray;
    points.push_back({rays[i]->values, ray.origin + distance * ray.direction});
    ray_of_point.push_back(i);
  }
  std::vector<double> sigmas(rays.size(), std::nan(""));
  DifferentiateEach(camera_, points, [&](size_t i, const ProjectionJacobian& seen) {
    sigmas[ray_of_point[i]] =
        WorstSigma(seen.by_params - ByMotion(seen, points[i].p) * follow_, camera_.covariance);
  });
  return sigmas;
}

std::vector<ProjectionMap> ProjectionMaps(const CalibrationRecord& calibration, size_t c) {
  constexpr int kCells = 24;
  const CalibratedCamera& camera = calibration.cameras[c];
  const HousedProjection projection(calibration, c);
  if (!projection.IsKnown()) return {};
  const std::vector<double>& distances = projection.distances();
  const ImageGrid grid(camera.image_size, kCells);
  const std::vector<std::optional<SeenRay>> rays = projection.RaysOf(CellValues(camera, grid));
  std::vector<ProjectionMap> maps;
  for (const double distance : {distances.front(),
                                distances[distances.size() / 2],
                                distances.back(),
                                10 * distances.back()}) {
    maps.push_back({distance, grid, projection.Sigmas(rays, distance)});
  }
  return maps;
}

}  // namespace plenocal
