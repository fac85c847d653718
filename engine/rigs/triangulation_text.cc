// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "calib/base/quoted_text.h"
#include "calib/base/statistics.h"
#include "engine/rigs/triangulate_points.h"

namespace plenocal {
namespace {

// "noise 0.2, calibration 0.1".
std::string PartsText(double noise, double calibration, double jitter) {
  const std::string parts = fmt::format("noise {:.2g}, calibration {:.2g}", noise, calibration);
  return jitter > 0 ? fmt::format("{}, jitter {:.2g}", parts, jitter) : parts;
}

// Medians over the points that are not at infinity.
std::string SpreadText(const Triangulation& made) {
  std::vector<double> sigma, noise, calibration, jitter;
  for (const TriangulatedPoint& each : made.points) {
    if (!each.used || !(each.point.rho > 0)) continue;
    sigma.push_back(std::sqrt(each.point.Covariance()(2, 2)));
    noise.push_back(std::sqrt(each.point.noise(2, 2)));
    calibration.push_back(each.point.ByCalibration().row(2).norm());
    jitter.push_back(each.point.ByFrame().row(2).norm());
  }
  if (sigma.empty()) return "all at infinity";
  return fmt::format(
      "sigma of z {:.2g} mm ({}; medians)",
      1e3 * Median(sigma),
      PartsText(1e3 * Median(noise), 1e3 * Median(calibration), 1e3 * Median(jitter)));
}

std::string MeasureText(const TriangulatedMeasure& measure) {
  const std::string name =
      fmt::format("{}: {} {}: ", Escaped(measure.frame), measure.kind, measure.of);
  if (measure.plane) {
    if (measure.plane->degrees < 0) return name + "no plane: the points lie on a line\n";
    return name + fmt::format("{:.3g} mm RMS from the plane, chi-square {:.3g} of {} degrees\n",
                              1e3 * measure.plane->rms,
                              measure.plane->chi_square,
                              measure.plane->degrees);
  }
  const bool is_angle = measure.kind == "angle";
  const double unit = is_angle ? 180 / std::numbers::pi : 1e3;
  const Measured& number = *measure.number;
  return name +
         fmt::format(
             "{:.6g} +- {:.2g} {} ({})\n",
             unit * number.value,
             unit * number.Sigma(),
             is_angle ? "degrees" : "mm",
             PartsText(unit * number.noise, unit * number.calibration, unit * number.jitter));
}

// The number that changed most, and the one of which the points determine most.
std::string AdjustedText(const std::vector<AdjustedNumber>& adjusted) {
  const auto change = [](const AdjustedNumber& of) {
    return std::abs(of.change) / of.sigma_before;
  };
  const auto left = [](const AdjustedNumber& of) { return of.sigma / of.sigma_before; };
  const AdjustedNumber& moved = *std::ranges::max_element(adjusted, {}, change);
  const AdjustedNumber& determined = *std::ranges::min_element(adjusted, {}, left);
  return fmt::format(
      "calibration adjusted: {} by {:.2g} of its standard errors, the others by less; {} has {:.2g} "
      "of its standard error left\n",
      moved.name,
      change(moved),
      determined.name,
      left(determined));
}

}  // namespace

std::string TriangulationText(const Triangulation& made) {
  const auto used = std::ranges::count_if(made.points, &TriangulatedPoint::used);
  std::string text = fmt::format("{}: {} points, {} left out; {}\n",
                                 fmt::join(made.cameras, " + "),
                                 used,
                                 made.points.size() - static_cast<size_t>(used),
                                 SpreadText(made));
  if (!made.adjusted.empty()) text += AdjustedText(made.adjusted);
  constexpr size_t kMostLines = 20;
  for (size_t i = 0; i < made.measures.size() && i < kMostLines; ++i) {
    text += MeasureText(made.measures[i]);
  }
  if (made.measures.size() > kMostLines) {
    text += fmt::format("and {} more in measures.csv\n", made.measures.size() - kMostLines);
  }
  for (size_t i = 0; i < made.left_out.size() && i < kMostLines; ++i) {
    text +=
        fmt::format("left out: {}: {}\n", Escaped(made.left_out[i].where), made.left_out[i].reason);
  }
  for (const Finding& finding : made.findings) {
    text += fmt::format("{} [{}] {}\n    {}\n",
                        GradeName(finding.grade),
                        finding.code,
                        finding.what,
                        finding.remedy);
  }
  return text;
}

}  // namespace plenocal
