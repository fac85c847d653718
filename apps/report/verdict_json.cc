// SPDX-License-Identifier: Apache-2.0
#include "apps/report/verdict_json.h"

#include <cmath>

namespace plenocal {
namespace {

nlohmann::json NumberOrNull(const std::optional<double>& value) {
  return value && std::isfinite(*value) ? nlohmann::json(*value) : nlohmann::json();
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

}  // namespace plenocal
