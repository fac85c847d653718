// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/camera_format.h"

#include <fmt/format.h>

#include "calib/base/format_error.h"
#include "calib/files/checks/transform_keys.h"

namespace plenocal {
namespace {

/// Why no rig has such a camera; empty when one may.
std::string CameraDefect(CalibratedCamera* camera) {
  const auto [width, height] = camera->image_size;
  if (width < 1 || height < 1) {
    return fmt::format("{} x {} is no size of an image", width, height);
  }
  for (size_t i = 0; i < camera->config.size(); ++i) {
    const Param& config = camera->model->config[i];
    if (camera->config[i] > config.lower && camera->config[i] < config.upper) continue;
    return fmt::format("{} = {} {} is outside ({}, {})",
                       config.name,
                       camera->config[i],
                       config.unit,
                       config.lower,
                       config.upper);
  }
  if (!WithinBounds(*camera->model, camera->params.data())) {
    return fmt::format("parameters that model {} cannot have", camera->model->name);
  }
  if (!MakeRotation(&camera->T_camera_rig.R)) return "the rotation of its extrinsics is none";
  if (!(camera->T_camera_rig.t.cwiseAbs().maxCoeff() < kFarthestPart)) {
    return "its extrinsics are farther from the rig than any camera";
  }
  return {};
}

}  // namespace

std::vector<CalibratedCamera> ReadCameraFile(const CameraFormat& format,
                                             const CameraSource& source) {
  std::vector<CalibratedCamera> cameras = format.read(source);
  for (size_t i = 0; i < cameras.size(); ++i) {
    const std::string defect = CameraDefect(&cameras[i]);
    if (defect.empty()) continue;
    throw InputError("{}: camera {}: {}", source.path.string(), i + 1, defect);
  }
  return cameras;
}

const CameraFormat* FindCameraFormat(std::string_view name, const std::filesystem::path& file) {
  const CameraFormat* found = nullptr;
  for (const CameraFormat& format : CameraFormats()) {
    if (format.variant_of == name && format.extension == file.extension().string()) return &format;
    if (format.name == name) found = &format;
  }
  return found;
}

std::string CameraFormatList() {
  std::string list;
  for (const CameraFormat& format : CameraFormats()) {
    if (!format.variant_of.empty()) continue;
    list += fmt::format("{}{}", list.empty() ? "" : ", ", format.name);
    for (const CameraFormat& other : CameraFormats()) {
      if (other.variant_of == format.name)
        list += fmt::format(" (FILE or FILE{})", other.extension);
    }
  }
  return list;
}

}  // namespace plenocal
