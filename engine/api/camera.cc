// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <utility>

#include "assess/projection.h"
#include "calib/camera/camera_model.h"
#include "engine/api/data.h"
#include "engine/api/plenocal/engine.h"
#include "engine/session/calibration_folder.h"

namespace plenocal::api {

Camera::Camera(std::shared_ptr<const Data> data) : data_(std::move(data)) {}

std::vector<Camera> Camera::Read(const std::string& calibration_yaml) {
  std::vector<Camera> cameras;
  for (CalibratedCamera& camera : OpenCalibration(calibration_yaml).cameras) {
    if (camera.model->plenoptic) continue;
    cameras.push_back(Camera(std::make_shared<const Data>(Data{std::move(camera)})));
  }
  return cameras;
}

std::string Camera::name() const { return data_->camera.name; }
std::string Camera::model() const { return std::string(data_->camera.model->name); }
std::array<int, 2> Camera::image_size() const { return data_->camera.image_size; }

std::vector<Parameter> Camera::parameters() const {
  const CalibratedCamera& camera = data_->camera;
  std::vector<Parameter> parameters;
  for (size_t k = 0; k < camera.params.size(); ++k) {
    const Param& param = camera.model->params[k];
    parameters.push_back(
        {std::string(param.name), std::string(param.unit), camera.params[k], camera.Sigma(k)});
  }
  return parameters;
}

std::array<double, 16> MatrixOf(const RigidTransform& transform) {
  using RowMajor = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;
  std::array<double, 16> values{};
  Eigen::Map<RowMajor> matrix(values.data());
  matrix.setIdentity();
  matrix.topLeftCorner<3, 3>() = transform.R;
  matrix.topRightCorner<3, 1>() = transform.t;
  return values;
}

std::array<double, 16> Camera::T_camera_rig() const { return MatrixOf(data_->camera.T_camera_rig); }

std::optional<std::array<double, 2>> Camera::Project(const std::array<double, 3>& p_camera) const {
  const CalibratedCamera& camera = data_->camera;
  std::array<double, kMaxObservationSize> values{};
  std::array<double, 2> pixel{};
  if (!camera.model->Project(camera.params.data(),
                             camera.config.data(),
                             values.data(),
                             {p_camera[0], p_camera[1], p_camera[2]},
                             pixel.data())) {
    return std::nullopt;
  }
  return pixel;
}

std::optional<std::array<double, 4>> Camera::Covariance(
    const std::array<double, 3>& p_camera) const {
  const CalibratedCamera& camera = data_->camera;
  std::array<double, kMaxObservationSize> values{};
  std::array<double, 2> pixel{};
  using RowMajor = Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor>;
  std::vector<size_t> support(camera.model->support_size);
  const size_t columns = support.empty() ? camera.params.size() : support.size();
  RowMajor J_params(2, static_cast<Eigen::Index>(columns));
  Eigen::Matrix<double, 2, 3, Eigen::RowMajor> J_point;
  if (!camera.model->ProjectWithJacobian(
          camera.params.data(),
          camera.config.data(),
          values.data(),
          {p_camera[0], p_camera[1], p_camera[2]},
          {pixel.data(), J_params.data(), J_point.data(), support.data()})) {
    return std::nullopt;
  }
  const Eigen::Matrix2d C = ImageCovariance(camera).Propagate(J_params, support);
  return std::array{C(0, 0), C(0, 1), C(1, 0), C(1, 1)};
}

std::optional<std::array<double, 3>> Camera::Unproject(const std::array<double, 2>& pixel) const {
  const CalibratedCamera& camera = data_->camera;
  std::array<double, kMaxObservationSize> values{};
  std::ranges::copy(pixel, values.begin());
  const std::optional<Ray> ray =
      camera.model->Unproject(camera.params.data(), camera.config.data(), values.data());
  if (!ray) return std::nullopt;
  return std::array{ray->direction.x(), ray->direction.y(), ray->direction.z()};
}

RemapTables Camera::Undistort(const std::array<int, 2>& size,
                              double f,
                              double c_x,
                              double c_y) const {
  RemapTables tables;
  for (int v = 0; v < size[1]; ++v) {
    for (int u = 0; u < size[0]; ++u) {
      const auto place = Project({(u - c_x) / f, (v - c_y) / f, 1});
      tables.x.push_back(place ? static_cast<float>((*place)[0]) : -1);
      tables.y.push_back(place ? static_cast<float>((*place)[1]) : -1);
    }
  }
  return tables;
}

}  // namespace plenocal::api
