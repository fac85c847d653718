// SPDX-License-Identifier: Apache-2.0
#include "apps/report/verdict_json.h"

#include <cmath>

#include "calib/base/number_text.h"

namespace plenocal {
namespace {

// A number with the digits of calibration.yaml, so that both are the same.
nlohmann::json NumberOrNull(const std::optional<double>& value) {
  if (!value || !std::isfinite(*value)) return nullptr;
  return *ParseDouble(YamlNumber(*value));
}

}  // namespace

nlohmann::json VerdictJson(const Verdict& verdict) {
  nlohmann::json findings = nlohmann::json::array();
  for (const Finding& finding : verdict.findings) {
    findings.push_back({{"code", finding.code},
                        {"grade", GradeName(finding.grade)},
                        {"cameras", finding.cameras},
                        {"value", NumberOrNull(finding.value)},
                        {"limit", NumberOrNull(finding.limit)},
                        {"what", finding.what},
                        {"remedy", finding.remedy}});
  }
  return {{"grade", GradeName(verdict.grade)}, {"findings", findings}};
}

nlohmann::json CheckJson(const CalibrationCheck& check) {
  nlohmann::json cameras = nlohmann::json::array();
  for (const CameraCheck& camera : check.cameras) {
    cameras.push_back({{"name", camera.name},
                       {"valid", camera.valid},
                       {"points", camera.points},
                       {"rms_poses_only", camera.rms_held},
                       {"rms_expected", camera.expected},
                       {"rms_all_free", camera.rms_free},
                       {"probability", camera.probability},
                       {"mount_turn", camera.rotation},
                       {"mount_shift", camera.translation},
                       {"mount_probability", camera.extrinsics_probability}});
  }
  return {{"valid", check.valid},
          {"frames", check.frames},
          {"verdict", VerdictJson(JudgeCheck(check))},
          {"cameras", cameras}};
}

}  // namespace plenocal
