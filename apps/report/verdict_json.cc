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

nlohmann::json CalibrationJson(const CalibrationRecord& record) {
  nlohmann::json cameras = nlohmann::json::object();
  for (const CalibratedCamera& camera : record.cameras) {
    nlohmann::json parameters = nlohmann::json::object(), sigma = nlohmann::json::object();
    for (size_t k = 0; k < camera.params.size(); ++k) {
      const std::string name(camera.model->params[k].name);
      parameters[name] = camera.params[k];
      sigma[name] = std::isfinite(camera.Sigma(k)) ? nlohmann::json(camera.Sigma(k)) : nullptr;
    }
    cameras[camera.name] = {{"model", camera.model->name},
                            {"image_size", camera.image_size},
                            {"parameters", parameters},
                            {"sigma", sigma},
                            {"rms", camera.fit.rms},
                            {"points", camera.fit.points},
                            {"rejected", camera.fit.rejected},
                            {"views", camera.fit.views}};
  }
  return {{"verdict", VerdictJson(*record.verdict)},
          {"cameras", cameras},
          {"frames", record.frames.size()}};
}

}  // namespace plenocal
