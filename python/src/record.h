// SPDX-License-Identifier: Apache-2.0
//
// A calibration as Python holds it.
#pragma once

#include "calib/files/calibration_record.h"
#include "engine/session/calibration_folder.h"

namespace plenocal::python {

/// A calibration with the tables and pictures that belong to it: of a folder they are read when the
/// report is made.
struct Record {
  CalibrationRecord record;
  CameraFiles files;
};

}  // namespace plenocal::python
