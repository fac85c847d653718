// SPDX-License-Identifier: Apache-2.0
#include "assess/projection_map.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "assess/views/projection_jacobian.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"

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

// An observation in the middle of each cell. The context (micro lens) is that of the nearest
// observation, since a model does not know where its micro lenses are.
std::vector<std::optional<std::array<double, kMaxObservationSize>>> CellValues(
    const CalibratedCamera& camera, const ImageGrid& grid) {
  std::vector<std::optional<std::array<double, kMaxObservationSize>>> values(grid.Cells());
  if (!camera.model->plenoptic) {
    for (size_t cell = 0; cell < grid.Cells(); ++cell) {
      const Eigen::Vector2d middle = grid.Middle(cell);
      values[cell] = {middle.x(), middle.y()};
    }
    return values;
  }
  std::vector<double> nearest(grid.Cells(), std::numeric_limits<double>::infinity());
  for (const ResidualRow& row : camera.residuals) {
    if (!row.used) continue;
    const Eigen::Vector2d place(row.values[0], row.values[1]);
    const size_t cell = grid.Cell(place.x(), place.y());
    const double distance = (place - grid.Middle(cell)).norm();
    if (distance >= nearest[cell]) continue;
    nearest[cell] = distance;
    values[cell] = row.values;
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
  return std::sqrt(std::max(0.0, greatest));
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
  Matrix6d normal = Matrix6d::Zero();
  Eigen::MatrixXd mixed =
      Eigen::MatrixXd::Zero(6, static_cast<Eigen::Index>(camera_.params.size()));
  ProjectionJacobian seen;
  ForEachUsed(calibration, c, [&](const ResidualRow& row, const Eigen::Vector3d& p) {
    distances_.push_back(p.norm());
    if (!Differentiate(camera_, row.values.data(), p, &seen)) return;
    const Eigen::Matrix<double, 2, 6> J = ByMotion(seen, p);
    normal.noalias() += J.transpose().lazyProduct(J);
    mixed.noalias() += J.transpose().lazyProduct(seen.by_params);
  });
  if (!distances_.empty()) follow_ = SolveSymmetric(normal, mixed);
  std::ranges::sort(distances_);
}

bool HousedProjection::IsKnown() const { return follow_.size() > 0 && follow_.allFinite(); }

double HousedProjection::Sigma(const double* values, double distance) const {
  const std::optional<Ray> ray =
      camera_.model->Unproject(camera_.params.data(), camera_.config.data(), values);
  if (!ray) return std::nan("");
  const Eigen::Vector3d p = ray->origin + distance * ray->direction;
  ProjectionJacobian seen;
  if (!Differentiate(camera_, values, p, &seen)) return std::nan("");
  return WorstSigma(seen.by_params - ByMotion(seen, p) * follow_, camera_.covariance);
}

std::vector<ProjectionMap> ProjectionMaps(const CalibrationRecord& calibration, size_t c) {
  constexpr int kCells = 24;
  const CalibratedCamera& camera = calibration.cameras[c];
  const HousedProjection projection(calibration, c);
  if (!projection.IsKnown()) return {};
  const std::vector<double>& distances = projection.distances();
  const ImageGrid grid(camera.image_size, kCells);
  const auto cell_values = CellValues(camera, grid);
  std::vector<ProjectionMap> maps;
  for (const double distance : {distances.front(),
                                distances[distances.size() / 2],
                                distances.back(),
                                10 * distances.back()}) {
    ProjectionMap& map = maps.emplace_back(ProjectionMap{distance, grid, {}});
    for (size_t cell = 0; cell < grid.Cells(); ++cell) {
      const bool outside = camera.image_circle && !camera.image_circle->Has(grid.Middle(cell));
      map.sigma.push_back(cell_values[cell] && !outside
                              ? projection.Sigma(cell_values[cell]->data(), distance)
                              : std::nan(""));
    }
  }
  return maps;
}

}  // namespace plenocal
