// SPDX-License-Identifier: Apache-2.0
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

#include <array>

#include "engine/resample/pinhole_view.h"
#include "engine/resample/pixel_map.h"
#include "engine/resample/rectify.h"
#include "python/src/bindings.h"

namespace plenocal::python {
namespace {

using Floats = nb::ndarray<nb::numpy, float>;

std::pair<Floats, Floats> Tables(PixelMap map) {
  const auto table = [&](std::vector<float> values) {
    auto* const kept = new std::vector<float>(std::move(values));
    nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<float>*>(p); });
    return Floats(
        kept->data(), {static_cast<size_t>(map.size[1]), static_cast<size_t>(map.size[0])}, owner);
  };
  Floats x = table(std::move(map.x)), y = table(std::move(map.y));
  return {x, y};
}

ViewOptions Options(std::optional<ImageSize> size,
                    std::optional<double> fov,
                    std::optional<double> balance) {
  return {.size = size, .fov = fov, .balance = balance};
}

nb::tuple UndistortMaps(const CalibratedCamera& camera,
                        std::optional<ImageSize> size,
                        std::optional<double> fov,
                        std::optional<double> balance,
                        int threads) {
  const Eigen::Matrix3d no_rotation = Eigen::Matrix3d::Identity();
  CalibratedCamera view;
  PixelMap map;
  {
    const nb::gil_scoped_release release;
    const std::array seen{ImageOf(camera, no_rotation)};
    view = ChoosePinhole(seen, Options(size, fov, balance));
    view.name = camera.name;
    view.T_camera_rig = camera.T_camera_rig;
    map = MapPixels(view, camera, no_rotation, threads);
  }
  RethrowFromModel();
  auto [x, y] = Tables(std::move(map));
  return nb::make_tuple(x, y, view);
}

nb::tuple RectifyMaps(const CalibratedCamera& first,
                      const CalibratedCamera& second,
                      std::optional<ImageSize> size,
                      std::optional<double> fov,
                      std::optional<double> balance,
                      int threads) {
  const std::array cameras{&first, &second};
  RectifiedPair pair;
  std::array<PixelMap, 2> maps;
  {
    const nb::gil_scoped_release release;
    pair = Rectify(first, second, Options(size, fov, balance));
    for (size_t c = 0; c < 2; ++c) {
      maps[c] = MapPixels(pair.views[c], *cameras[c], pair.R_view_camera[c].transpose(), threads);
    }
  }
  RethrowFromModel();
  auto [x1, y1] = Tables(std::move(maps[0]));
  auto [x2, y2] = Tables(std::move(maps[1]));
  return nb::make_tuple(
      nb::make_tuple(x1, y1, pair.views[0]), nb::make_tuple(x2, y2, pair.views[1]), pair.baseline);
}

}  // namespace

void BindViews(nb::module_& module) {
  module.def("undistort_maps",
             &UndistortMaps,
             nb::arg("camera"),
             nb::arg("size").none(),
             nb::arg("fov").none(),
             nb::arg("balance").none(),
             nb::arg("threads"));
  module.def("rectify_maps",
             &RectifyMaps,
             nb::arg("first"),
             nb::arg("second"),
             nb::arg("size").none(),
             nb::arg("fov").none(),
             nb::arg("balance").none(),
             nb::arg("threads"));
}

}  // namespace plenocal::python
