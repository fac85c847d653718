// SPDX-License-Identifier: Apache-2.0
//
// What the classes of plenocal/engine.h hold.
#pragma once

#include <array>
#include <optional>

#include "calib/files/calibration_record.h"
#include "calib/files/session.h"
#include "engine/api/plenocal/engine.h"
#include "targets/target.h"

namespace plenocal::api {

struct Camera::Data {
  CalibratedCamera camera;
};

struct Session::Data {
  plenocal::Session session;
};

struct Calibration::Data {
  CalibrationRecord record;
  std::optional<Target> target = {};  ///< of a calibration that this process has made
};

/// 4 x 4, row by row.
std::array<double, 16> MatrixOf(const RigidTransform& transform);

}  // namespace plenocal::api
