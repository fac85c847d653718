// SPDX-License-Identifier: Apache-2.0
//
// What the classes of plenocal/engine.h hold.
#pragma once

#include "calib/files/calibration_record.h"
#include "calib/files/session.h"
#include "engine/api/plenocal/engine.h"

namespace plenocal::api {

struct Camera::Data {
  CalibratedCamera camera;
};

struct Session::Data {
  plenocal::Session session;
};

}  // namespace plenocal::api
