// SPDX-License-Identifier: Apache-2.0
#include "apps/formats/camera_format.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "apps/formats/formats.h"
#include "calib/error.h"
#include "models/registry.h"

namespace plenocal {
namespace {

constexpr std::array<std::string_view, 4> kIntrinsics{"f_x", "f_y", "c_x", "c_y"};

std::optional<double> Value(const CalibratedCamera& camera, std::string_view name) {
  for (size_t i = 0; i < camera.params.size(); ++i) {
    if (camera.model->params[i].name == name) return camera.params[i];
  }
  return std::nullopt;
}

bool Holds(std::span<const std::string_view> names, std::string_view name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

/// The first parameter that is not zero and has no place in the form.
std::optional<Param> Lost(const CalibratedCamera& camera, const LensForm& form) {
  for (size_t i = 0; i < camera.params.size(); ++i) {
    const Param& param = camera.model->params[i];
    if (camera.params[i] == 0 || Holds(kIntrinsics, param.name) ||
        Holds(form.coefficients, param.name)) {
      continue;
    }
    return param;
  }
  return std::nullopt;
}

}  // namespace

std::span<const CameraFormat> CameraFormats() {
  static const std::array kFormats{OpenCvFormat(),
                                   RosFormat(),
                                   KalibrFormat(),
                                   MrcalFormat(),
                                   ColmapFormat(),
                                   OrbSlam2Format(),
                                   OrbSlam3Format(),
                                   DsoFormat(),
                                   BasaltFormat(),
                                   MatlabFormat(),
                                   MatFormat(),
                                   LifcalFormat()};
  return kFormats;
}

const CameraFormat* FindCameraFormat(std::string_view name, const std::filesystem::path& file) {
  if (name == "matlab" && file.extension() == ".mat") name = "mat";
  for (const CameraFormat& format : CameraFormats()) {
    if (format.name == name) return &format;
  }
  return nullptr;
}

Lens ToLens(const CalibratedCamera& camera,
            std::span<const LensForm> forms,
            std::string_view format) {
  std::optional<Param> lost;
  for (const LensForm& form : forms) {
    if (form.model != camera.model->name) continue;
    lost = Lost(camera, form);
    if (lost) continue;
    Lens lens{std::string(form.name),
              *Value(camera, "f_x"),
              *Value(camera, "f_y"),
              *Value(camera, "c_x"),
              *Value(camera, "c_y"),
              {}};
    for (const std::string_view name : form.coefficients) {
      lens.coefficients.push_back(name == "0" ? 0 : *Value(camera, name));
    }
    return lens;
  }
  std::vector<std::string_view> known;
  for (const LensForm& form : forms) {
    if (FindModel(CameraModels(), form.model) == nullptr || Holds(known, form.model)) continue;
    known.push_back(form.model);
  }
  throw Error(
      ErrorKind::kJob,
      lost ? fmt::format("camera '{}': {} has no place for {} of model {}; make it one of {} with "
                         "'plenocal convert' first",
                         camera.name,
                         format,
                         lost->name,
                         camera.model->name,
                         fmt::join(known, ", "))
           : fmt::format("camera '{}': {} cannot hold model {}; make it one of {} with 'plenocal "
                         "convert' first",
                         camera.name,
                         format,
                         camera.model->name,
                         fmt::join(known, ", ")));
}

CalibratedCamera FromLens(const Lens& lens,
                          ImageSize image_size,
                          std::span<const LensForm> forms,
                          const std::string& where) {
  const auto coefficient = [&](size_t i) {
    return i < lens.coefficients.size() ? lens.coefficients[i] : 0;
  };
  std::vector<std::string_view> names;
  for (const LensForm& form : forms) {
    if (!Holds(names, form.name)) names.push_back(form.name);
    const CameraModel* model = FindModel(CameraModels(), form.model);
    bool fits = form.name == lens.name && model != nullptr;
    const size_t count = std::max(lens.coefficients.size(), form.coefficients.size());
    for (size_t i = 0; fits && i < count; ++i) {
      const bool has_place = i < form.coefficients.size() && form.coefficients[i] != "0";
      fits = has_place || coefficient(i) == 0;
    }
    if (!fits) continue;
    CalibratedCamera camera;
    camera.model = model;
    camera.image_size = image_size;
    for (const Param& param : model->params) {
      const auto place = std::find(form.coefficients.begin(), form.coefficients.end(), param.name);
      const auto intrinsic = std::find(kIntrinsics.begin(), kIntrinsics.end(), param.name);
      const std::array intrinsics{lens.f_x, lens.f_y, lens.c_x, lens.c_y};
      const double value = intrinsic != kIntrinsics.end()
                               ? intrinsics[static_cast<size_t>(intrinsic - kIntrinsics.begin())]
                           : place != form.coefficients.end()
                               ? coefficient(static_cast<size_t>(place - form.coefficients.begin()))
                               : 0;
      if (!(value > param.lower && value < param.upper)) {
        throw Error(ErrorKind::kInput,
                    fmt::format("{}: {} = {} is outside ({}, {})",
                                where,
                                param.name,
                                value,
                                param.lower,
                                param.upper));
      }
      camera.params.push_back(value);
    }
    return camera;
  }
  const bool known = Holds(names, lens.name);
  throw Error(ErrorKind::kInput,
              fmt::format("{}: {}",
                          where,
                          known ? fmt::format("no camera model of this plenocal has all "
                                              "coefficients [{}] of the lens '{}'",
                                              fmt::join(lens.coefficients, ", "),
                                              lens.name)
                                : fmt::format("the lens '{}' is not read{}",
                                              lens.name,
                                              SuggestName(lens.name, names))));
}

std::span<const LensForm> OpenCvLenses() {
  static const std::vector<LensForm> kForms{
      {"pinhole", "radtan", {"0", "0", "0", "0", "0"}},
      {"pinhole-radial3", "radtan", {"A_0", "A_1", "0", "0", "A_2"}},
      {"pinhole-radtan4", "radtan", {"k_1", "k_2", "p_1", "p_2"}},
      {"pinhole-radtan", "radtan", {"k_1", "k_2", "p_1", "p_2", "k_3"}},
      {"pinhole-radtan8", "radtan", {"k_1", "k_2", "p_1", "p_2", "k_3", "k_4", "k_5", "k_6"}},
      {"pinhole-radtan12",
       "radtan",
       {"k_1", "k_2", "p_1", "p_2", "k_3", "k_4", "k_5", "k_6", "s_1", "s_2", "s_3", "s_4"}},
      {"kannala-brandt4", "fisheye", {"k_1", "k_2", "k_3", "k_4"}}};
  return kForms;
}

std::string RealText(double value) {
  std::string text = fmt::format("{}", value == 0 ? 0.0 : value);
  if (text.find_first_of(".e") == std::string::npos) text += ".0";
  return text;
}

std::string RealList(std::span<const double> values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : ", ") + RealText(value);
  return text;
}

std::array<double, 9> RowMajor(const Eigen::Matrix3d& R) {
  std::array<double, 9> values{};
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(values.data()) = R;
  return values;
}

RigidTransform FromRectified(const std::vector<double>& R, double shift, const YamlNode& node) {
  const Eigen::Matrix3d rotation =
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(R.data());
  constexpr double kOrthonormal = 1e-3;  // matrices with few digits
  if (!((rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() <
        kOrthonormal)) {
    node.Fail("is no rotation");
  }
  return {rotation.transpose(), rotation.transpose() * Eigen::Vector3d(shift, 0, 0)};
}

double Inverted(double value, double guess, const std::function<double(double)>& forward) {
  double below = guess, above = guess;
  constexpr int kSteps = 8;  // a few operations lose no more
  for (int i = 0; i < kSteps; ++i) {
    if (forward(below) == value) return below;
    if (forward(above) == value) return above;
    below = std::nextafter(below, -std::numeric_limits<double>::infinity());
    above = std::nextafter(above, std::numeric_limits<double>::infinity());
  }
  return guess;
}

void MakeFirstMaster(std::vector<CalibratedCamera>* cameras) {
  const RigidTransform T_rig_first = cameras->front().T_camera_rig.Inverse();
  for (CalibratedCamera& camera : *cameras) {
    camera.T_camera_rig =
        &camera == &cameras->front() ? RigidTransform() : camera.T_camera_rig * T_rig_first;
  }
}

}  // namespace plenocal
