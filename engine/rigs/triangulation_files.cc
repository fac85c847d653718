// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "calib/base/quoted_text.h"
#include "engine/rigs/triangulate_points.h"

namespace plenocal {
namespace {

const std::array kCoordinates{"x", "y", "z"};

std::string PointsCsv(const Triangulation& made) {
  std::string text = "frame,marker,x,y,z,rho,sigma_rho,nearest,farthest";
  for (const char* kind : {"cov", "noise"}) {
    for (size_t i = 0; i < 3; ++i) {
      for (size_t j = i; j < 3; ++j) {
        text += fmt::format(",{}_{}_{}", kind, kCoordinates[i], kCoordinates[j]);
      }
    }
  }
  text += ",sigma_z_noise,sigma_z_calibration,rays,rms,probability,used\n";
  for (const TriangulatedPoint& each : made.points) {
    const SpacePoint& point = each.point;
    if (!point.IsFound()) continue;
    const DistanceInterval interval = DistanceOf(point, made.sigmas);
    text += fmt::format("{},{}", CsvCell(each.frame), each.marker);
    for (const double value : point.position) text += fmt::format(",{:.12g}", value);
    text += fmt::format(",{:.12g},{:.9g},{:.9g},{:.9g}",
                        point.rho,
                        point.sigma_rho,
                        interval.nearest,
                        interval.farthest);
    for (const Eigen::Matrix3d& covariance : {point.Covariance(), point.noise}) {
      for (Eigen::Index i = 0; i < 3; ++i) {
        for (Eigen::Index j = i; j < 3; ++j) text += fmt::format(",{:.9g}", covariance(i, j));
      }
    }
    text += fmt::format(",{:.9g},{:.9g},{},{:.6g},{:.6g},{:d}\n",
                        std::sqrt(point.noise(2, 2)),
                        point.shared.row(2).norm(),
                        point.observations,
                        point.rms,
                        point.probability,
                        each.used);
  }
  return text;
}

std::string SharedCsv(const Triangulation& made) {
  std::string text = "frame,marker,coordinate";
  const auto columns = static_cast<int>(
      std::ranges::find_if(made.points, &TriangulatedPoint::used)->point.shared.cols());
  for (int k = 1; k <= columns; ++k) text += fmt::format(",c_{}", k);
  text += "\n";
  for (const TriangulatedPoint& each : made.points) {
    if (!each.used) continue;
    for (Eigen::Index i = 0; i < 3; ++i) {
      text += fmt::format(
          "{},{},{}", CsvCell(each.frame), each.marker, kCoordinates[static_cast<size_t>(i)]);
      for (const double value : each.point.shared.row(i)) text += fmt::format(",{:.6g}", value);
      text += "\n";
    }
  }
  return text;
}

std::string MeasuresCsv(const Triangulation& made) {
  std::string text =
      "frame,kind,of,value,unit,sigma,sigma_noise,sigma_calibration,bias,low,high,chi_square,"
      "degrees\n";
  for (const TriangulatedMeasure& each : made.measures) {
    text += fmt::format("{},{},{}", CsvCell(each.frame), each.kind, each.of);
    if (each.number) {
      const Measured& number = *each.number;
      const double reach = made.sigmas * number.Sigma();
      text += fmt::format(",{:.12g},{},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},,\n",
                          number.value,
                          each.kind == "angle" ? "rad" : "m",
                          number.Sigma(),
                          number.noise,
                          number.calibration,
                          number.bias,
                          number.value - reach,
                          number.value + reach);
    } else if (each.plane->degrees >= 0) {
      text += fmt::format(",{:.9g},m,,,,,,,{:.6g},{}\n",
                          each.plane->rms,
                          each.plane->chi_square,
                          each.plane->degrees);
    } else {
      text += ",,m,,,,,,,,\n";
    }
  }
  return text;
}

std::string SummaryYaml(const CalibrationRecord& calibration, const Triangulation& made) {
  const auto used = std::ranges::count_if(made.points, &TriangulatedPoint::used);
  std::vector<std::string> cameras;
  for (const std::string& camera : made.cameras) cameras.push_back(YamlQuoted(camera));
  std::string text = fmt::format(
      "plenocal: 1\ncalibration: {}\ncameras: [{}]\nframe_of_reference: {}\npoints: {}\n"
      "left_out: {}\nchi_square: {:.6g}\ndegrees: {}\nprobability: {:.4g}\nlevel: {}\nfindings:",
      YamlQuoted(calibration.path.string()),
      fmt::join(cameras, ", "),
      made.frame == SpaceFrame::kRig ? "rig" : "housing",
      used,
      made.left_out.size(),
      made.rays.chi_square,
      made.rays.degrees,
      made.rays.probability,
      made.level);
  if (made.findings.empty()) text += " []";
  text += "\n";
  for (const Finding& finding : made.findings) {
    text += fmt::format("  - {{code: {}, what: {}}}\n", finding.code, YamlQuoted(finding.what));
  }
  return text;
}

}  // namespace

OutputContents TriangulationFiles(const CalibrationRecord& calibration, const Triangulation& made) {
  return {{"points.csv", PointsCsv(made)},
          {"shared.csv", SharedCsv(made)},
          {"measures.csv", MeasuresCsv(made)},
          {"triangulation.yaml", SummaryYaml(calibration, made)}};
}

}  // namespace plenocal
