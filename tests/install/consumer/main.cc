// SPDX-License-Identifier: Apache-2.0
//
// Another project that uses the installed library.
#include <iostream>

#include "calib/estimate/calibrate.h"
#include "models/registry.h"

int main() {
  const auto models = plenocal::CameraModels();
  for (const plenocal::CameraModel& model : models) std::cout << model.name << "\n";
  // Never reached, but linked.
  if (models.empty()) plenocal::Calibrate({}, {});
}
