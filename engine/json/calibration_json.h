// SPDX-License-Identifier: Apache-2.0
//
// Writes the JSON of a calibration that report, workbench, `--json` and Python share. The file
// calibration.schema.json describes it; web/src has its types from there.
#pragma once

#include <nlohmann/json.hpp>
#include <vector>

#include "assess/check.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

/// {grade, findings}, as in calibration.yaml; numbers that a finding does not have are null.
nlohmann::json VerdictJson(const Verdict& verdict);

/// Content of check.json.
nlohmann::json CheckJson(const CalibrationCheck& check);

/// `Calibration` of the schema: verdict and headline, cameras by name, number of frames. A record
/// without a verdict is judged.
nlohmann::json CalibrationJson(const CalibrationRecord& record);

/// `Space` of the schema: poses of the frames, markers.
nlohmann::json SpaceJson(const CalibrationRecord& record);

/// `SigmaMap`s of the schema: standard error of the projection over a camera's image.
nlohmann::json SigmaMapsJson(const CalibrationRecord& record, size_t camera);

/// `Field` of the schema: means of a camera's residuals over its image.
nlohmann::json FieldJson(const CalibratedCamera& camera);
/// The same of other vectors at points of an image.
nlohmann::json FieldJson(ImageSize image_size, std::vector<ResidualRow> vectors);

/// Three rows of [R t]; `digits` of t, and one less of R.
nlohmann::json TransformJson(const RigidTransform& T, int digits = 7);

/// x, y, z.
nlohmann::json VectorJson(const Eigen::Vector3d& v);

/// The number as calibration.yaml holds it, so that JSON of results in memory equals that of
/// files. Null where it is not finite.
nlohmann::json AsInFile(double value);

/// `value` with `digits` significant digits. Null where it is not finite.
nlohmann::json Short(double value, int digits = 4);

}  // namespace plenocal
