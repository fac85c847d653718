// SPDX-License-Identifier: Apache-2.0
#include "calib/calibration_file.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "calib/camera_yaml.h"
#include "calib/error.h"
#include "calib/names.h"
#include "calib/number_text.h"

namespace plenocal {
namespace {

// A sigma: not negative, and `.inf` for what is not determined.
double Sigma(const YamlNode& node) {
  if (node.AsString() == ".inf") return std::numeric_limits<double>::infinity();
  const double sigma = node.AsNumber();
  if (sigma < 0) node.Fail("expected a standard deviation, found a negative number");
  return sigma;
}

RigidTransform ReadTransform(const YamlNode& node) {
  const auto rows = node.Elements();
  if (rows.size() != 4) node.Fail("expected the four rows of a 4 x 4 matrix");
  RigidTransform T;
  for (int r = 0; r < 3; ++r) {
    const std::vector<double> row = rows[static_cast<size_t>(r)].AsNumbers(4);
    for (int c = 0; c < 3; ++c) T.R(r, c) = row[static_cast<size_t>(c)];
    T.t[r] = row[3];
  }
  if (rows[3].AsNumbers(4) != std::vector<double>{0, 0, 0, 1}) {
    rows[3].Fail("expected [0, 0, 0, 1]");
  }
  // Matrices that people typed have few digits.
  constexpr double kOrthonormal = 1e-3;
  if ((T.R * T.R.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() > kOrthonormal ||
      T.R.determinant() < 0) {
    node.Fail("the left 3 x 3 part is no rotation");
  }
  return T;
}

Eigen::MatrixXd ReadCovariance(const YamlNode& node, const CameraModel& model) {
  const auto count = static_cast<Eigen::Index>(model.params.size());
  std::vector<double> sigma(model.params.size(), 0.0);
  if (node.Has("sigma")) {
    for (size_t i = 0; i < sigma.size(); ++i) {
      sigma[i] = Sigma(node.At("sigma").At(model.params[i].name));
    }
  }
  Eigen::MatrixXd correlation = Eigen::MatrixXd::Identity(count, count);
  if (node.Has("correlation")) {
    const YamlNode triangle = node.At("correlation");
    const auto rows = triangle.Elements();
    if (static_cast<Eigen::Index>(rows.size()) != count) {
      triangle.Fail(fmt::format("expected {} rows, one a parameter, found {}", count, rows.size()));
    }
    for (Eigen::Index i = 0; i < count; ++i) {
      const std::vector<double> row =
          rows[static_cast<size_t>(i)].AsNumbers(static_cast<size_t>(i) + 1);
      for (Eigen::Index j = 0; j < i; ++j) {
        correlation(i, j) = correlation(j, i) = row[static_cast<size_t>(j)];
      }
    }
  }
  return CovarianceOf(sigma, correlation);
}

}  // namespace

Eigen::MatrixXd CovarianceOf(std::span<const double> sigma, const Eigen::MatrixXd& correlation) {
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
  std::vector<Eigen::Index> places;  // in `correlations`; -1: not there
  const auto add = [&](const std::string& name, double value) {
    const auto found = std::ranges::find(correlations.names, name);
    places.push_back(found == correlations.names.end() ? -1 : found - correlations.names.begin());
    sigma.push_back(value);
  };
  std::vector<Eigen::Index> first;
  for (const CalibratedCamera* camera : cameras) {
    first.push_back(static_cast<Eigen::Index>(sigma.size()));
    for (size_t k = 0; k < camera->params.size(); ++k) {
      const auto i = static_cast<Eigen::Index>(k);
      add(fmt::format("{}.{}", camera->name, camera->model->params[k].name),
          std::sqrt(camera->covariance(i, i)));
    }
    for (size_t i = 0; i < kMountNames.size(); ++i) {
      add(fmt::format("{}.T_camera_rig.{}", camera->name, kMountNames[i]),
          camera->sigma_xi[static_cast<Eigen::Index>(i)]);
    }
  }
  const auto count = static_cast<Eigen::Index>(sigma.size());
  Eigen::MatrixXd correlation = Eigen::MatrixXd::Identity(count, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    for (Eigen::Index j = 0; j < count; ++j) {
      const Eigen::Index a = places[static_cast<size_t>(i)], b = places[static_cast<size_t>(j)];
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

CalibratedCamera ReadCalibratedCamera(const std::string& name,
                                      const YamlNode& node,
                                      std::span<const CameraModel> models) {
  CalibratedCamera camera;
  camera.name = name;
  camera.model = ReadModel(node.At("model"), models);
  camera.image_size = ReadImageSize(node.At("image_size"));
  for (const Param& param : camera.model->config) {
    camera.config.push_back(ReadWithin(node.At(param.name), param));
  }
  for (const Param& param : camera.model->params) {
    camera.params.push_back(ReadWithin(node.At("parameters").At(param.name), param));
  }
  camera.covariance = ReadCovariance(node, *camera.model);
  camera.T_camera_rig = ReadTransform(node.At("T_camera_rig"));
  if (node.Has("sigma_xi")) {
    const auto sigmas = node.At("sigma_xi").Elements();
    if (sigmas.size() != 6) node.At("sigma_xi").Fail("expected six numbers");
    for (size_t i = 0; i < 6; ++i) camera.sigma_xi[static_cast<Eigen::Index>(i)] = Sigma(sigmas[i]);
  }
  for (const auto& [key, file] : {std::pair("micro_lenses", &camera.micro_lenses),
                                  std::pair("vignetting", &camera.vignetting)}) {
    if (node.Has(key)) *file = node.At(key).AsString();
  }
  return camera;
}

CalibrationFile ReadCalibration(const std::filesystem::path& path,
                                std::span<const CameraModel> models) {
  const YamlNode root = YamlNode::ReadFile(path);
  root.CheckVersion();
  CalibrationFile calibration;
  calibration.path = path;
  for (const auto& [name, node] : root.At("cameras").Entries()) {
    calibration.cameras.push_back(ReadCalibratedCamera(name, node, models));
  }
  if (calibration.cameras.empty()) root.At("cameras").Fail("expected at least one camera");
  return calibration;
}

const CalibratedCamera& FindCamera(const CalibrationFile& calibration, const std::string& name) {
  if (name.empty() && calibration.cameras.size() == 1) return calibration.cameras[0];
  std::vector<std::string_view> names;
  for (const CalibratedCamera& camera : calibration.cameras) {
    if (camera.name == name) return camera;
    names.push_back(camera.name);
  }
  throw Error(
      ErrorKind::kInput,
      name.empty()
          ? fmt::format("{}: holds {} cameras; say which by --camera (the first is '{}')",
                        calibration.path.string(),
                        names.size(),
                        names[0])
          : fmt::format(
                "{}: no camera '{}'{}", calibration.path.string(), name, SuggestName(name, names)));
}

std::string CalibrationText(std::span<const CalibratedCamera> cameras,
                            const std::vector<std::pair<std::string, std::string>>& provenance) {
  const auto list = [](const auto& values) {
    std::string text;
    for (const double value : values) {
      text += fmt::format("{}{}", text.empty() ? "" : ", ", value == 0 ? 0.0 : value);
    }
    return "[" + text + "]";
  };
  std::string text = "plenocal: 1\ncameras:\n";
  for (const CalibratedCamera& camera : cameras) {
    const CameraModel& model = *camera.model;
    text += fmt::format("  {}:\n    model: {}\n    image_size: [{}, {}]\n",
                        camera.name,
                        model.name,
                        camera.image_size[0],
                        camera.image_size[1]);
    for (size_t i = 0; i < camera.config.size(); ++i) {
      text += fmt::format("    {}: {}\n", model.config[i].name, camera.config[i]);
    }
    text += "    parameters: {";
    for (size_t i = 0; i < camera.params.size(); ++i) {
      text +=
          fmt::format("{}{}: {}", i == 0 ? "" : ", ", model.params[i].name, camera.params[i] + 0.0);
    }
    const RigidTransform& T = camera.T_camera_rig;
    text += "}\n    T_camera_rig: [";
    for (int r = 0; r < 3; ++r) {
      text += list(std::array{T.R(r, 0), T.R(r, 1), T.R(r, 2), T.t[r]}) + ", ";
    }
    text += fmt::format("[0, 0, 0, 1]]\n    xi_camera_rig: {}\n", list(Log(T)));
  }
  if (!provenance.empty()) text += "provenance:\n";
  for (const auto& [key, value] : provenance) {
    text += fmt::format("  {}: {}\n", key, YamlQuoted(value));
  }
  return text;
}

}  // namespace plenocal
