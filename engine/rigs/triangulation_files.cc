// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "calib/base/json_text.h"
#include "calib/base/quoted_text.h"
#include "engine/json/calibration_json.h"
#include "engine/rigs/triangulate_points.h"

namespace plenocal {
namespace {

using Json = nlohmann::ordered_json;

const std::array kCoordinates{"x", "y", "z"};

// A table: names of the columns, then rows.
using Table = std::vector<std::vector<std::string>>;

std::string Number(double value, int digits = 9) { return fmt::format("{:.{}g}", value, digits); }

Table PointsTable(const Triangulation& made) {
  Table table{{"frame", "marker", "x", "y", "z", "rho", "sigma_rho", "nearest", "farthest"}};
  for (const char* kind : {"cov", "noise"}) {
    for (size_t i = 0; i < 3; ++i) {
      for (size_t j = i; j < 3; ++j) {
        table[0].push_back(fmt::format("{}_{}_{}", kind, kCoordinates[i], kCoordinates[j]));
      }
    }
  }
  for (const char* name : {"sigma_z_noise",
                           "sigma_z_calibration",
                           "sigma_z_jitter",
                           "rays",
                           "rms",
                           "probability",
                           "used"}) {
    table[0].emplace_back(name);
  }
  for (const TriangulatedPoint& each : made.points) {
    const SpacePoint& point = each.point;
    if (!point.IsFound()) continue;
    const DistanceInterval interval = DistanceOf(point, made.sigmas);
    std::vector<std::string>& row = table.emplace_back();
    row = {each.frame, std::to_string(each.marker)};
    for (const double value : point.position) row.push_back(Number(value, 12));
    row.push_back(Number(point.rho, 12));
    for (const double value : {point.sigma_rho, interval.nearest, interval.farthest}) {
      row.push_back(Number(value));
    }
    for (const Eigen::Matrix3d& covariance : {point.Covariance(), point.noise}) {
      for (Eigen::Index i = 0; i < 3; ++i) {
        for (Eigen::Index j = i; j < 3; ++j) row.push_back(Number(covariance(i, j)));
      }
    }
    row.push_back(Number(std::sqrt(point.noise(2, 2))));
    row.push_back(Number(point.ByCalibration().row(2).norm()));
    row.push_back(Number(point.ByFrame().row(2).norm()));
    row.push_back(std::to_string(point.observations));
    row.push_back(Number(point.rms, 6));
    row.push_back(Number(point.probability, 6));
    row.push_back(each.used ? "1" : "0");
  }
  return table;
}

Table SharedTable(const Triangulation& made) {
  Table table{{"frame", "marker", "coordinate"}};
  const SpacePoint& first = std::ranges::find_if(made.points, &TriangulatedPoint::used)->point;
  const Eigen::Index of_calibration = first.ByCalibration().cols();
  for (Eigen::Index k = 0; k < first.shared.cols(); ++k) {
    table[0].push_back(k < of_calibration ? fmt::format("c_{}", k + 1)
                                          : fmt::format("jitter_{}", k + 1 - of_calibration));
  }
  for (const TriangulatedPoint& each : made.points) {
    if (!each.used) continue;
    for (Eigen::Index i = 0; i < 3; ++i) {
      table.push_back(
          {each.frame, std::to_string(each.marker), kCoordinates[static_cast<size_t>(i)]});
      for (const double value : each.point.shared.row(i)) table.back().push_back(Number(value, 6));
    }
  }
  return table;
}

Table MeasuresTable(const Triangulation& made) {
  Table table{{"frame",
               "kind",
               "of",
               "value",
               "unit",
               "sigma",
               "sigma_noise",
               "sigma_calibration",
               "sigma_jitter",
               "bias",
               "low",
               "high",
               "chi_square",
               "degrees"}};
  for (const TriangulatedMeasure& each : made.measures) {
    std::vector<std::string>& row = table.emplace_back();
    row = {each.frame, each.kind, each.of};
    if (each.number) {
      const Measured& number = *each.number;
      const double reach = made.sigmas * number.Sigma();
      row.push_back(Number(number.value, 12));
      row.emplace_back(each.kind == "angle" ? "rad" : "m");
      for (const double value : {number.Sigma(),
                                 number.noise,
                                 number.calibration,
                                 number.jitter,
                                 number.bias,
                                 number.value - reach,
                                 number.value + reach}) {
        row.push_back(Number(value));
      }
    } else {
      const bool found = each.plane->degrees >= 0;
      row.push_back(found ? Number(each.plane->rms) : "");
      row.emplace_back("m");
      row.resize(table[0].size());
      if (!found) continue;
      row[row.size() - 2] = Number(each.plane->chi_square, 6);
      row.back() = std::to_string(each.plane->degrees);
    }
    row.resize(table[0].size());
  }
  return table;
}

std::string Csv(const Table& table) {
  std::string text;
  for (const std::vector<std::string>& row : table) {
    for (const std::string& cell : row) text.append(CsvCell(cell)).append(",");
    text.back() = '\n';
  }
  return text;
}

Json RowsJson(const Table& table) {
  Json rows = Json::array();
  for (size_t i = 1; i < table.size(); ++i) {
    Json& row = rows.emplace_back();
    for (size_t k = 0; k < table[0].size(); ++k) {
      const std::string &name = table[0][k], &cell = table[i][k];
      const bool is_text = name == "frame" || name == "kind" || name == "of" || name == "unit" ||
                           name == "coordinate";
      row[name] = is_text ? Json(cell) : Json::parse(cell, nullptr, false);
      if (row[name].is_discarded()) row[name] = nullptr;
    }
  }
  return rows;
}

Json Summary(const Triangulation& made) {
  const auto used = std::ranges::count_if(made.points, &TriangulatedPoint::used);
  const auto number = [](double value) { return Json::parse(Number(value, 6)); };
  return {{"plenocal", 1},
          {"calibration", made.calibration},
          {"cameras", made.cameras},
          {"frame_of_reference", made.frame == SpaceFrame::kRig ? "rig" : "housing"},
          {"points", used},
          {"left_out", made.left_out.size()},
          {"chi_square", number(made.rays.chi_square)},
          {"degrees", made.rays.degrees},
          {"probability", number(made.rays.probability)},
          {"level", made.level},
          {"correlation", made.correlation},
          {"adjusted", AdjustedJson(made.adjusted)},
          {"findings", VerdictJson({.findings = made.findings}).at("findings")}};
}

}  // namespace

nlohmann::ordered_json AdjustedJson(const std::vector<AdjustedNumber>& adjusted) {
  Json json = Json::object();
  for (const AdjustedNumber& each : adjusted) {
    const auto number = [](double value) { return Json::parse(Number(value)); };
    json[each.name] = {{"change", number(each.change)},
                       {"sigma_before", number(each.sigma_before)},
                       {"sigma", number(each.sigma)}};
  }
  return json;
}

void WriteTriangulation(const Triangulation& made, OutputFolder* out) {
  out->Write("points.csv", Csv(PointsTable(made)));
  out->Write("shared.csv", Csv(SharedTable(made)));
  out->Write("measures.csv", Csv(MeasuresTable(made)));
  std::string yaml;
  const Json summary = Summary(made);
  for (const auto& [key, value] : summary.items()) {
    yaml += fmt::format("{}: {}\n", key, JsonText(value, -1));  // JSON is YAML
  }
  out->Write("triangulation.yaml", yaml);
}

std::string TriangulationJson(const Triangulation& made) {
  Json json = Summary(made);
  json["points"] = RowsJson(PointsTable(made));
  json["shared"] = RowsJson(SharedTable(made));
  json["measures"] = RowsJson(MeasuresTable(made));
  return JsonText(json) + "\n";
}

}  // namespace plenocal
