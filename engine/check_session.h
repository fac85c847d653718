// SPDX-License-Identifier: Apache-2.0
//
// An existing calibration against the images of a session.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "assess/check.h"
#include "calib/base/run.h"
#include "calib/files/calibration_record.h"
#include "calib/files/session.h"
#include "engine/compare_files.h"
#include "engine/session/run_folders.h"
#include "engine/session/session_options.h"

namespace plenocal {

/// With the cameras of the session and their counterparts in the calibration, if they differ.
struct CheckRequest : SessionOptions, ComparedBy {
  std::filesystem::path calibration;  ///< calibration.yaml, where none is given as a record
};

struct SessionCheck {
  CalibrationCheck check;
  /// Of the new images' own calibration (a) with the old one (b), where there is a folder.
  std::optional<CalibrationComparison> comparison;
  /// Of the old one (a) with the new images' own (b), where it is requested.
  std::optional<SpaceComparison> space;
  std::unique_ptr<RunFolders> folders;  ///< with compare.csv, to be committed
};

/// Does the calibration hold for the images of the session? Throws `Error`, and `Stopped`.
SessionCheck CheckSession(Session session, const CheckRequest& request, const Run& run);
SessionCheck CheckSession(Session session,
                          CalibrationRecord old,
                          const CheckRequest& request,
                          const Run& run);

}  // namespace plenocal
