// SPDX-License-Identifier: Apache-2.0
//
// Tables for cv2.remap of undistorted and rectified images.
#include <nanobind/stl/pair.h>

#include <array>

#include "assess/central_view.h"
#include "engine/resample/pinhole_view.h"
#include "engine/resample/pixel_map.h"
#include "engine/resample/rectify.h"
#include "python/src/run.h"

namespace plenocal::python {
namespace {

using Floats = nb::ndarray<nb::numpy, float>;

std::pair<Floats, Floats> Tables(PixelMap map) {
  const auto table = [&](std::vector<float> values) {
    return Kept(std::move(values),
                {static_cast<size_t>(map.size[1]), static_cast<size_t>(map.size[0])});
  };
  Floats x = table(std::move(map.x)), y = table(std::move(map.y));
  return {x, y};
}

nb::tuple UndistortMaps(const CalibratedCamera& camera, const ViewOptions& options, int threads) {
  CalibratedCamera view;
  PixelMap map;
  Call([&] {
    const CentralView central({}, camera, options.distance);
    view = UndistortedView(central.camera(), options);
    map = MapPixels(view, central.camera(), Eigen::Matrix3d::Identity(), threads);
  });
  auto [x, y] = Tables(std::move(map));
  return nb::make_tuple(x, y, view);
}

nb::tuple RectifyMaps(const CalibratedCamera& first,
                      const CalibratedCamera& second,
                      const ViewOptions& options,
                      int threads) {
  RectifiedPair pair;
  std::array<PixelMap, 2> maps;
  Call([&] {
    const CentralView one({}, first, options.distance), two({}, second, options.distance);
    const std::array cameras{&one.camera(), &two.camera()};
    pair = Rectify(*cameras[0], *cameras[1], options);
    for (size_t c = 0; c < 2; ++c) {
      maps[c] = MapPixels(pair.views[c], *cameras[c], pair.R_view_camera[c].transpose(), threads);
    }
  });
  auto [x1, y1] = Tables(std::move(maps[0]));
  auto [x2, y2] = Tables(std::move(maps[1]));
  return nb::make_tuple(
      nb::make_tuple(x1, y1, pair.views[0]), nb::make_tuple(x2, y2, pair.views[1]), pair.baseline);
}

}  // namespace

void BindViews(nb::module_& module) {
  module.def("undistort_maps", &UndistortMaps);
  module.def("rectify_maps", &RectifyMaps);
}

}  // namespace plenocal::python
