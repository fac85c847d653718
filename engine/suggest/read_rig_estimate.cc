// SPDX-License-Identifier: Apache-2.0
#include "engine/suggest/read_rig_estimate.h"

#include "assess/views/view_information.h"
#include "calib/base/error.h"
#include "engine/session/calibration_folder.h"

namespace plenocal {

CalibrationRecord ReadTargetCalibration(const std::filesystem::path& folder) {
  CalibrationRecord calibration = OpenCalibrationFolder(folder);
  if (!calibration.HasScene()) return calibration;
  throw Error(ErrorKind::kInput,
              folder.string() +
                  ": is calibrated from a scene; views are suggested of a target. "
                  "What a scene calibration lacks stands in its verdict");
}

RigEstimate MakeRigEstimate(const std::filesystem::path& folder,
                            const CalibrationRecord& calibration,
                            const ViewTarget& shape) {
  RigEstimate rig = MakeRigEstimate(calibration);
  for (size_t c = 0; c < calibration.cameras.size(); ++c) {
    const CalibratedCamera& camera = calibration.cameras[c];
    if (!camera.model->plenoptic || camera.micro_lenses.empty()) continue;
    rig.lenses[c] = ReadMicroLenses(folder / camera.micro_lenses, camera.image_size);
  }
  SetFactors(calibration, shape, &rig);
  return rig;
}

}  // namespace plenocal
