// SPDX-License-Identifier: Apache-2.0
#include "calib/pixel_map.h"

#include "calib/parallel.h"

namespace plenocal {

bool PixelMap::HasSource(size_t i) const {
  const auto covered = [](float place, int length) {
    return place >= -0.5F && place <= static_cast<float>(length) - 0.5F;
  };
  return covered(x[i], source_size[0]) && covered(y[i], source_size[1]);
}

PixelMap MapPixels(const CalibratedCamera& view,
                   const CalibratedCamera& camera,
                   const Eigen::Matrix3d& R_camera_view,
                   int threads) {
  const auto columns = static_cast<size_t>(view.image_size[0]);
  const auto rows = static_cast<size_t>(view.image_size[1]);
  PixelMap map{view.image_size, camera.image_size, {}, {}};
  map.x.assign(columns * rows, PixelMap::kNowhere);
  map.y = map.x;
  ParallelFor(rows, threads, [&](size_t row) {
    for (size_t column = 0; column < columns; ++column) {
      const double pixel[kMaxObservationSize] = {static_cast<double>(column),
                                                 static_cast<double>(row)};
      const auto ray = view.model->unproject(view.params.data(), view.config.data(), pixel);
      double u[2];
      if (!ray || !camera.model->project(camera.params.data(),
                                         camera.config.data(),
                                         pixel,
                                         R_camera_view * ray->direction,
                                         u)) {
        continue;
      }
      map.x[row * columns + column] = static_cast<float>(u[0]);
      map.y[row * columns + column] = static_cast<float>(u[1]);
    }
  });
  return map;
}

}  // namespace plenocal
