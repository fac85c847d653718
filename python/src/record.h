// SPDX-License-Identifier: Apache-2.0
//
// Calibrations, and images in arrays, as Python holds them.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calib/files/calibration_record.h"
#include "engine/session/calibration_folder.h"
#include "engine/session/memory_session.h"
#include "python/src/bindings.h"
#include "targets/target.h"

namespace plenocal::python {

/// A calibration with the tables and pictures that belong to it: of a folder they are read when the
/// report is made.
struct Record {
  CalibrationRecord record;
  CameraFiles files;
  std::optional<Target> target = {};  ///< as stated, of a calibration that this process has made
};

/// Pixels (H, W) or (H, W, 3) of a frame, rows in any distance.
using Pixels = nb::ndarray<nb::ro, nb::device::cpu>;
using FramePixels = std::pair<std::string, Pixels>;
/// The pixels are lent: the caller keeps the arrays.
MemoryImages ViewsOf(const std::vector<FramePixels>& images);

}  // namespace plenocal::python
