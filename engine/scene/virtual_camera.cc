// SPDX-License-Identifier: Apache-2.0
#include "engine/scene/virtual_camera.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "models/pinhole_radial3.h"
#include "models/start/plenoptic_start.h"

namespace plenocal {
namespace {

const CameraModel& VirtualCameraModel() {
  static constexpr CameraModel kModel = MakeCameraModel<PinholeRadial3>();
  return kModel;
}

}  // namespace

size_t ParamOf(const CameraModel& model, std::string_view name) {
  const auto found = std::ranges::find(model.params, name, &Param::name);
  return static_cast<size_t>(found - model.params.begin());
}

bool IsFocal(const Param& param) { return param.unit == "px" && param.name.starts_with("f"); }

std::vector<double> OrdinaryStart(const CameraInput& camera, double focal) {
  std::vector<double> params;
  for (size_t k = 0; k < camera.model->params.size(); ++k) {
    const Param& param = camera.model->params[k];
    const double usual = IsFocal(param)        ? focal
                         : param.name == "c_x" ? (camera.image_size[0] - 1) / 2.0
                         : param.name == "c_y" ? (camera.image_size[1] - 1) / 2.0
                                               : param.neutral.value_or(0);
    params.push_back(camera.initial[k].value_or(usual));
  }
  return params;
}

CameraInput VirtualCamera(const CameraInput& camera) {
  const CameraModel& model = VirtualCameraModel();
  CameraInput image{.name = camera.name,
                    .model = &model,
                    .config = {},
                    .initial = std::vector<std::optional<double>>(model.params.size()),
                    .fixed = std::vector<bool>(model.params.size(), false),
                    .image_size = camera.image_size,
                    .views = VirtualImageViews(camera.views)};
  const auto& lens = camera.initial[ParamOf(*camera.model, "b_L0")];
  const auto& sensor = camera.initial[ParamOf(*camera.model, "B")];
  if (lens && sensor) {
    for (const size_t k : {0, 1}) image.initial[k] = (*lens + *sensor) / camera.config[0];
  }
  for (const auto& [of_image, name] : {std::pair{2, "c_x"}, std::pair{3, "c_y"}}) {
    image.initial[static_cast<size_t>(of_image)] = camera.initial[ParamOf(*camera.model, name)];
  }
  return image;
}

}  // namespace plenocal
