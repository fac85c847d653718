// SPDX-License-Identifier: Apache-2.0
#include "engine/resample/pixel_map.h"

#include "calib/base/format_error.h"
#include "calib/base/parallel.h"
#include "calib/camera/rays.h"

namespace plenocal {

bool PixelMap::HasSource(size_t i) const {
  const auto covered = [](float place, int length) {
    return place >= -0.5F && place <= static_cast<float>(length) - 0.5F;
  };
  return covered(x[i], source_size[0]) && covered(y[i], source_size[1]);
}

PixelMap MapPixels(const CalibratedCamera& view,
                   ImageSize source_size,
                   const ImagePlace& place,
                   int threads) {
  const auto columns = static_cast<size_t>(view.image_size[0]);
  const auto rows = static_cast<size_t>(view.image_size[1]);
  PixelMap map{view.image_size, source_size, {}, {}};
  map.x.assign(columns * rows, PixelMap::kNowhere);
  map.y = map.x;
  ParallelFor(rows, threads, [&](size_t row) {
    for (size_t column = 0; column < columns; ++column) {
      const double pixel[kMaxObservationSize] = {static_cast<double>(column),
                                                 static_cast<double>(row)};
      const auto ray = Unproject(view, pixel);
      if (!ray) continue;
      const auto u = place(ray->direction);
      if (!u) continue;
      map.x[row * columns + column] = static_cast<float>(u->x());
      map.y[row * columns + column] = static_cast<float>(u->y());
    }
  });
  return map;
}

void RequireCentral(const CalibratedCamera& camera) {
  if (camera.model->IsCentral()) return;
  throw InputError(
      "camera '{}': {} has no single centre, so that no map of pixels undistorts its images",
      camera.name,
      camera.model->name);
}

PixelMap MapPixels(const CalibratedCamera& view,
                   const CalibratedCamera& camera,
                   const Eigen::Matrix3d& R_camera_view,
                   int threads) {
  RequireCentral(camera);
  const auto place = [&](const Eigen::Vector3d& direction) -> std::optional<Eigen::Vector2d> {
    const double values[kMaxObservationSize] = {};
    Eigen::Vector2d u;
    if (!Project(camera, values, R_camera_view * direction, u.data())) {
      return std::nullopt;
    }
    return u;
  };
  return MapPixels(view, camera.image_size, place, threads);
}

}  // namespace plenocal
