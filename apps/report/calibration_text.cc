// SPDX-License-Identifier: Apache-2.0
#include "apps/report/calibration_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <vector>

namespace plenocal {
namespace {

using Json = nlohmann::json;

// "m^-1" -> "m⁻¹", "1" -> "".
std::string UnitText(const std::string& unit) {
  constexpr std::array kRaised{"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  if (unit == "1") return {};
  std::string text;
  bool is_power = false;
  for (const char c : unit) {
    if (c == '^') {
      is_power = true;
    } else if (is_power && c == '-') {
      text += "⁻";
    } else if (is_power && c >= '0' && c <= '9') {
      text += kRaised.at(static_cast<size_t>(c - '0'));
    } else {
      is_power = false;
      text += c;
    }
  }
  return text;
}

void AddParameters(std::string_view caption, const Json& parameters, PageText* text) {
  if (parameters.empty()) return;
  std::vector<std::vector<std::string>> rows;
  for (const Json& parameter : parameters) {
    const auto [value, sigma] =
        NumberWithSigma(parameter.at("value").get<double>(), parameter.at("sigma"));
    rows.push_back({parameter.at("name").get<std::string>(),
                    value,
                    sigma,
                    UnitText(parameter.at("unit").get<std::string>())});
  }
  text->Table(caption, {"", "value", "standard error", "unit"}, rows);
}

// Those of the model's equations, with their units.
Json ParametersOf(const Json& camera) {
  Json parameters = Json::array();
  for (const Json& unit : camera.at("units")) {
    const std::string& name = unit.at(0).get_ref<const std::string&>();
    parameters.push_back({{"name", name},
                          {"unit", unit.at(1)},
                          {"value", camera.at("parameters").at(name)},
                          {"sigma", camera.at("sigma").at(name)}});
  }
  return parameters;
}

void AddCamera(const Json& camera, PageText* text) {
  text->Subheading(fmt::format("{}: {}, {} x {} px",
                               camera.at("name").get<std::string>(),
                               camera.at("model").get<std::string>(),
                               camera.at("image_size").at(0).get<int>(),
                               camera.at("image_size").at(1).get<int>()));
  AddParameters("parameters", ParametersOf(camera), text);
  std::vector<std::vector<std::string>> rows;
  for (const Json& row : camera.at("residual_table")) {
    rows.push_back(
        {row.at(0).get<std::string>(), BriefNumber(row.at(1), 6), row.at(2).get<std::string>()});
  }
  text->Table("residuals", {}, rows);
}

// The cameras of a rig side by side, without the master.
void AddExtrinsics(const std::vector<Json>& cameras, PageText* text) {
  if (cameras.size() < 2) return;
  std::vector<std::string> head{""};
  std::vector<std::vector<std::string>> rows;
  for (size_t c = 1; c < cameras.size(); ++c) {
    head.push_back(cameras[c].at("name").get<std::string>());
    size_t row = 0;
    for (const Json& each : cameras[c].at("extrinsics")) {
      if (c == 1) rows.push_back({each.at("name").get<std::string>()});
      const auto [value, sigma] = NumberWithSigma(each.at("value").get<double>(), each.at("sigma"));
      const bool known = each.at("sigma").is_number() && each.at("sigma").get<double>() > 0;
      rows.at(row++).push_back(fmt::format("{}{}{}", value, known ? " ± " : ", ", sigma));
    }
  }
  head.emplace_back();
  for (size_t row = 0; row < rows.size(); ++row) {
    const Json& unit = cameras[1].at("extrinsics").at(row).at("unit");
    rows[row].push_back(UnitText(unit.get<std::string>()));
  }
  text->Table(fmt::format("poses in the frame of {} ± standard errors",
                          cameras[0].at("name").get<std::string>()),
              head,
              rows);
}

}  // namespace

PageText CalibrationText(const Json& report) {
  PageText text;
  text.Heading("Verdict");
  const Json& verdict = report.at("verdict");
  const auto grade = verdict.at("grade").get<std::string>();
  // The rig's master first.
  std::vector<Json> cameras(report.at("cameras").begin(), report.at("cameras").end());
  std::ranges::sort(cameras, {}, [](const Json& camera) { return camera.at("index").get<int>(); });
  std::vector<std::string> lines;
  for (const Json& camera : cameras) lines.push_back(camera.at("summary").get<std::string>());
  text.Box(grade, fmt::format("{}: {}", grade, report.at("headline").get<std::string>()), lines);
  text.Findings(verdict.at("findings"));
  text.Heading("Parameters");
  AddExtrinsics(cameras, &text);
  for (const Json& camera : cameras) AddCamera(camera, &text);
  return text;
}

}  // namespace plenocal
