// SPDX-License-Identifier: Apache-2.0
#include "calib/space/point_derivative.h"

#include <algorithm>

namespace plenocal {

bool Differentiate(const SpaceRig& rig,
                   const SpaceObservation& seen,
                   const Eigen::Vector3d& p,
                   double h,
                   PointDerivative* out,
                   bool with_theta) {
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const BundleCamera& camera = rig.cameras[seen.camera];
  const CameraModel& model = *camera.model;
  const auto rows = static_cast<Eigen::Index>(model.measured.size()),
             count = static_cast<Eigen::Index>(model.params.size());
  // A model that projects p / 1 alone has the point itself, whose derivative by h follows.
  const double scale = model.homogeneous ? 1 : h;
  if (!(scale > 0)) return false;
  const Eigen::Vector3d rotated = camera.T_camera_rig.R * p;
  const Eigen::Vector3d at = (rotated + h * camera.T_camera_rig.t) / scale;
  Rows by_params(rows, with_theta ? count : 0), by_camera_point(rows, 3);
  Eigen::VectorXd predicted(rows), by_h = Eigen::VectorXd::Zero(rows);
  if (!model.ProjectWithJacobian(camera.params.data(),
                                 camera.config.data(),
                                 seen.values.data(),
                                 at,
                                 {.predicted = predicted.data(),
                                  .J_params = with_theta ? by_params.data() : nullptr,
                                  .J_point = by_camera_point.data(),
                                  .J_h = by_h.data()},
                                 model.homogeneous ? h : 1)) {
    return false;
  }
  // Columns: displacements by one standard deviation of the prior of each size.
  const Eigen::Index columns = std::ssize(seen.by_shared) / rows,
                     shared = std::min<Eigen::Index>(columns, std::ssize(camera.nuisances));
  const auto displaced =
      Eigen::Map<const Rows>(seen.by_shared.data(), rows, columns).leftCols(shared);
  out->residual = Eigen::Map<const Eigen::VectorXd>(seen.values.data(), rows) - predicted;
  out->residual -=
      displaced * Eigen::Map<const Eigen::VectorXd>(camera.params.data() + count, shared);
  out->by_point = by_camera_point * camera.T_camera_rig.R / scale;
  out->by_h = by_h + by_camera_point * camera.T_camera_rig.t / scale;
  if (!model.homogeneous) out->by_h -= by_camera_point * at / scale;
  if (!with_theta) return true;
  out->by_theta = Eigen::MatrixXd::Zero(rows, rig.Size());
  // The chart turns the point about the camera's centre and shifts it (`Retract`).
  const Eigen::Matrix3d turned = -Hat(rotated / scale);
  for (size_t i = 0; i < rig.unknowns.size(); ++i) {
    const CalibrationPrior::Unknown& unknown = rig.unknowns[i];
    if (unknown.camera != seen.camera) continue;
    auto column = out->by_theta.col(static_cast<Eigen::Index>(i));
    if (unknown.param >= model.params.size()) {
      const auto size = static_cast<Eigen::Index>(*unknown.param) - count;
      if (size < shared) column = displaced.col(size);
    } else if (unknown.param) {
      column = by_params.col(static_cast<Eigen::Index>(*unknown.param));
    } else if (unknown.component < 3) {
      column = by_camera_point.col(unknown.component) * (h / scale);
    } else {
      column = by_camera_point * turned.col(unknown.component - 3);
    }
  }
  if (rig.frame_columns > 0) {
    Eigen::Matrix<double, 3, 6> moved;
    moved << h * Eigen::Matrix3d::Identity(), -Hat(p - h * rig.centre);
    out->by_theta.middleCols(
        rig.Size() - rig.frame_columns + 6 * static_cast<Eigen::Index>(seen.camera), 6) =
        by_camera_point * camera.T_camera_rig.R * moved / scale;
  }
  return true;
}

}  // namespace plenocal
