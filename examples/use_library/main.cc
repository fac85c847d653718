// SPDX-License-Identifier: Apache-2.0
//
// Reads a calibration, projects a point and undistorts: use_library OUT/calibration.yaml
#include <iostream>

#include "models/api/camera.h"

int main(int /*argc*/, char** argv) {
  for (const plenocal::api::Camera& camera : plenocal::api::Camera::Read(argv[1])) {
    const auto pixel = camera.Project({0.1, 0.05, 1.0});
    const auto [width, height] = camera.image_size();
    const auto tables = camera.Undistort({width, height}, width, width / 2.0, height / 2.0);
    std::cout << camera.name() << ": " << (*pixel)[0] << " " << (*pixel)[1]
              << ", the middle of the "
              << "undistorted image comes from " << tables.x[tables.x.size() / 2] << "\n";
  }
}
