// SPDX-License-Identifier: Apache-2.0
#include "calib/files/calibration_record.h"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>

#include "calib/base/format_error.h"
#include "calib/base/names.h"

namespace plenocal {

RigidTransform CalibrationRecord::CameraFromTarget(size_t camera, int frame) const {
  const std::map<int, ViewPose>& seen = cameras[camera].view_poses;
  const auto own = seen.find(frame);
  const RigidTransform& T_target_rig = own == seen.end()
                                           ? frames[static_cast<size_t>(frame)].T_target_rig
                                           : own->second.T_target_rig;
  return cameras[camera].T_camera_rig * T_target_rig.Inverse();
}

std::optional<MicroLensGeometry> MicroLensGeometryOf(const CalibratedCamera& camera) {
  const auto place = [](std::span<const Param> params, std::string_view name) {
    return static_cast<size_t>(std::ranges::find(params, name, &Param::name) - params.begin());
  };
  const std::span<const Param> params = camera.model->params;
  const size_t f_L = place(params, "f_L"), b_L0 = place(params, "b_L0"), B = place(params, "B"),
               b_P = place(params, "b_P"), w_P = place(params, "w_P"),
               pixel_size = place(camera.model->config, "pixel_size");
  const size_t none = params.size();
  if (f_L == none || b_L0 == none || B == none || pixel_size == camera.config.size()) {
    return std::nullopt;
  }
  const auto two = [&](std::string_view x, std::string_view y) -> Eigen::Vector2d {
    const size_t at_x = place(params, x), at_y = place(params, y);
    if (at_x == none || at_y == none) return {0, 0};
    return {camera.params[at_x], camera.params[at_y]};
  };
  return MicroLensGeometry{.f_L = camera.params[f_L],
                           .b_L0 = camera.params[b_L0],
                           .B = camera.params[B],
                           .b_P = w_P != none ? PupilDistance(camera.params[w_P])
                                              : camera.params[b_P == none ? b_L0 : b_P],
                           .pixel_size = camera.config[pixel_size],
                           .sigma_B = camera.Sigma(B),
                           .tilt = two("t_x", "t_y"),
                           .principal_point = two("c_x", "c_y")};
}

std::filesystem::path FileBeside(const CalibrationRecord& calibration, const std::string& name) {
  if (calibration.path.empty()) {
    throw InputError(
        "{}: this file of the camera is needed, but the calibration is in memory; calibrate into a "
        "folder and read the calibration from there",
        name);
  }
  return calibration.path.parent_path() / name;
}

Eigen::MatrixXd CovarianceOf(const std::vector<double>& sigma, const Eigen::MatrixXd& correlation) {
  const Eigen::Index count = correlation.rows();
  Eigen::MatrixXd covariance(count, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    for (Eigen::Index j = 0; j < count; ++j) {
      const double a = sigma[static_cast<size_t>(i)], b = sigma[static_cast<size_t>(j)];
      const bool known = i == j || (std::isfinite(a) && std::isfinite(b));
      covariance(i, j) = known ? correlation(i, j) * a * b : 0;
    }
  }
  return covariance;
}

Eigen::MatrixXd JointCovariance(const std::vector<const CalibratedCamera*>& cameras,
                                const Correlations& correlations) {
  std::vector<double> sigma;
  std::vector<Eigen::Index> index;  // in `correlations`; -1: not there
  const auto add = [&](const std::string& name, double value) {
    const auto found = std::ranges::find(correlations.names, name);
    index.push_back(found == correlations.names.end() ? -1 : found - correlations.names.begin());
    sigma.push_back(value);
  };
  std::vector<Eigen::Index> first;
  for (const CalibratedCamera* camera : cameras) {
    first.push_back(static_cast<Eigen::Index>(sigma.size()));
    for (size_t k = 0; k < camera->params.size(); ++k) {
      add(fmt::format("{}.{}", camera->name, camera->model->params[k].name), camera->Sigma(k));
    }
    for (size_t i = 0; i < kExtrinsicsNames.size(); ++i) {
      add(fmt::format("{}.T_camera_rig.{}", camera->name, kExtrinsicsNames[i]),
          camera->sigma_xi[static_cast<Eigen::Index>(i)]);
    }
  }
  for (const CalibratedCamera* camera : cameras) {
    for (size_t k = 0; k < camera->nuisances.size(); ++k) {
      add(fmt::format("{}.shared_{}", camera->name, k + 1), camera->nuisances[k].sigma);
    }
  }
  const auto count = static_cast<Eigen::Index>(sigma.size());
  Eigen::MatrixXd correlation = Eigen::MatrixXd::Identity(count, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    for (Eigen::Index j = 0; j < count; ++j) {
      const Eigen::Index a = index[static_cast<size_t>(i)], b = index[static_cast<size_t>(j)];
      if (i != j && a >= 0 && b >= 0) correlation(i, j) = correlations.matrix(a, b);
    }
  }
  Eigen::MatrixXd covariance = CovarianceOf(sigma, correlation);
  for (size_t c = 0; c < cameras.size(); ++c) {
    const Eigen::MatrixXd& own = cameras[c]->covariance;
    covariance.block(first[c], first[c], own.rows(), own.cols()) = own;
  }
  return covariance;
}

const CalibratedCamera& FindCamera(const CalibrationRecord& calibration, const std::string& name) {
  if (name.empty() && calibration.cameras.size() == 1) return calibration.cameras[0];
  const std::string path = calibration.path.string();
  const std::vector<std::string_view> names = NamesOf(calibration.cameras);
  if (name.empty()) {
    throw InputError("{}: holds {} cameras; name one with --camera (the first is '{}')",
                     path,
                     names.size(),
                     names[0]);
  }
  const auto found = std::ranges::find(calibration.cameras, name, &CalibratedCamera::name);
  if (found != calibration.cameras.end()) return *found;
  throw InputError("{}: no camera '{}'{}", path, name, SuggestName(name, names));
}

}  // namespace plenocal
