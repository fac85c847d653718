// SPDX-License-Identifier: Apache-2.0
#include "assess/text/compare_text.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>

#include "assess/space/accuracy.h"
#include "assess/verdict.h"
#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"

namespace plenocal {
namespace {

constexpr std::array<std::string_view, 3> kRowNames{"top", "middle", "bottom"};
constexpr std::array<std::string_view, 3> kColumnNames{"left", "centre", "right"};

std::string PartText(size_t part) {
  return part == 4 ? "centre" : fmt::format("{} {}", kRowNames[part / 3], kColumnNames[part % 3]);
}

// Calls `visit` with each distance, the name of each part of the image, and the difference there.
void ForEachPart(const CameraDifference& camera,
                 const std::function<void(const DistanceDifference& at,
                                          const std::string& part,
                                          const ImageDifference& difference)>& visit) {
  for (const DistanceDifference& at : camera.distances) {
    visit(at, "all", at.all);
    for (size_t p = 0; p < at.parts.size(); ++p) visit(at, PartText(p), at.parts[p]);
  }
}

std::string CameraVerdict(const CameraDifference& camera) {
  if (!camera.has_prediction) {
    return "no verdict: a file has no sigmas, or a parameter that is not determined";
  }
  if (camera.same) return "same within uncertainty";
  std::string places;
  for (const DistanceDifference& at : camera.distances) {
    std::string parts;
    for (size_t p = 0; p < at.parts.size(); ++p) {
      if (at.parts[p].differs) parts += (parts.empty() ? "" : ", ") + PartText(p);
    }
    if (!parts.empty()) {
      places +=
          fmt::format("{}{}: {}", places.empty() ? "" : "; ", DistanceText(at.distance), parts);
    }
  }
  return fmt::format("they differ by more than their sigmas explain at {}", places);
}

// Of cameras of one model; images may agree where correlated parameters do not.
std::string ParametersText(const CalibratedCamera& a, const CalibratedCamera& b) {
  std::string text = fmt::format(
      "  {:<10} {:>16} {:>16} {:>14} {:>10}\n", "parameter", "A", "B", "A - B", "in sigmas");
  for (size_t i = 0; i < a.params.size(); ++i) {
    if (a.model->params[i].prior_sigma > 0) continue;  // too many to read
    const auto k = static_cast<Eigen::Index>(i);
    const double difference = a.params[i] - b.params[i];
    const double sigma = std::sqrt(a.covariance(k, k) + b.covariance(k, k));
    text += fmt::format("  {:<10} {:>16.9g} {:>16.9g} {:>14.3g} {:>10}\n",
                        a.model->params[i].name,
                        a.params[i],
                        b.params[i],
                        difference,
                        sigma > 0 ? fmt::format("{:.1f}", difference / sigma) : "");
  }
  return text;
}

std::string CameraText(const CameraDifference& camera,
                       const CalibratedCamera& a,
                       const CalibratedCamera& b,
                       bool is_only) {
  std::string text = fmt::format("{}  ({} and {}, {} x {} px)\n",
                                 camera.name,
                                 a.model->name,
                                 b.model->name,
                                 a.image_size[0],
                                 a.image_size[1]);
  if (a.model == b.model) text += ParametersText(a, b);
  const Eigen::Vector3d turn = LogRotation(camera.T_b_a.R) * 180 / std::numbers::pi;
  const Eigen::Vector3d shift = 1e3 * camera.T_b_a.t;
  text += fmt::format(
      "  taken out: a rotation vector ({:.4f}, {:.4f}, {:.4f}) degrees and a translation ({:.3f}, "
      "{:.3f}, {:.3f}) mm of the camera's frame\n",
      turn.x(),
      turn.y(),
      turn.z(),
      shift.x(),
      shift.y(),
      shift.z());
  text += fmt::format("  {:<10} {:<14} {:>10} {:>10} {:>12} {:>8}\n",
                      "distance",
                      "part",
                      "RMS px",
                      "max px",
                      "sigmas' px",
                      "pixels");
  ForEachPart(camera, [&](const auto& at, const auto& part, const ImageDifference& difference) {
    text +=
        fmt::format("  {:<10} {:<14} {:>10.4f} {:>10.4f} {:>12} {:>8}{}\n",
                    DistanceText(at.distance),
                    part,
                    difference.rms,
                    difference.largest,
                    camera.has_prediction ? fmt::format("{:.4f}", difference.predicted) : "unknown",
                    difference.points,
                    difference.differs ? "  differs" : "");
  });
  // Of a single camera the conclusion of all follows.
  return is_only && camera.same ? text : text + fmt::format("  {}\n", CameraVerdict(camera));
}

std::string ExtrinsicsText(const ExtrinsicsDifference& difference, bool has_correlations) {
  const auto degrees = [](double angle) { return angle * 180 / std::numbers::pi; };
  return fmt::format(
      "  on the rig: turned by {:.4f} degrees (sigmas: {:.4f}), shifted by {:.3f} mm (sigmas: "
      "{:.3f}{}){}\n",
      degrees(difference.rotation),
      degrees(difference.rotation_sigma),
      1e3 * difference.translation,
      1e3 * difference.translation_sigma,
      has_correlations
          ? ""
          : "; too large, without the correlations of a correlations.csv beside each file",
      difference.differs ? ": more than the sigmas explain" : "");
}

std::string LeftOverText(const CalibrationComparison& comparison,
                         const std::string& a,
                         const std::string& b) {
  std::string text;
  for (const auto& [path, names] : {std::pair(a, &comparison.only_a), {b, &comparison.only_b}}) {
    if (names->empty()) continue;
    text += fmt::format("not compared, only in {}: {}\n", path, fmt::join(*names, ", "));
  }
  if (comparison.only_a.empty() || comparison.only_b.empty()) return text;
  return text + fmt::format("  {}\n", MapSuggestion(comparison.only_a, comparison.only_b));
}

std::string VerdictText(const CalibrationComparison& comparison) {
  const bool judged =
      std::ranges::all_of(comparison.differences, &CameraDifference::has_prediction) &&
      std::ranges::all_of(comparison.extrinsics, &ExtrinsicsDifference::has_prediction);
  if (!judged) return "no verdict for all cameras";
  const bool same = std::ranges::all_of(comparison.differences, &CameraDifference::same) &&
                    std::ranges::none_of(comparison.extrinsics, &ExtrinsicsDifference::differs);
  return same ? "same within uncertainty" : "not the same within uncertainty";
}

}  // namespace

std::string DistanceText(double distance) {
  return std::isfinite(distance) ? fmt::format("{:g} m", distance) : "far away";
}

std::string ComparisonText(const CalibrationComparison& comparison,
                           const std::string& a,
                           const std::string& b) {
  std::string text;
  for (size_t c = 0; c < comparison.a.size(); ++c) {
    text += CameraText(
        comparison.differences[c], comparison.a[c], comparison.b[c], comparison.a.size() == 1);
    if (c > 0) text += ExtrinsicsText(comparison.extrinsics[c - 1], comparison.has_correlations);
    text += "\n";
  }
  return text + LeftOverText(comparison, a, b) + VerdictText(comparison) + "\n";
}

std::string ComparisonCsv(const CalibrationComparison& comparison) {
  std::string text = "camera,distance,part,rms,largest,predicted,probability,pixels,differs\n";
  for (const CameraDifference& camera : comparison.differences) {
    ForEachPart(camera, [&](const auto& at, const auto& part, const ImageDifference& difference) {
      text +=
          fmt::format("{},{:g},{},{:.6g},{:.6g},{},{},{},{}\n",
                      CsvCell(camera.name),
                      at.distance,
                      part,
                      difference.rms,
                      difference.largest,
                      camera.has_prediction ? fmt::format("{:.6g}", difference.predicted) : "",
                      camera.has_prediction ? fmt::format("{:.3g}", difference.probability) : "",
                      difference.points,
                      difference.differs ? 1 : 0);
    });
  }
  return text;
}

std::string SpaceText(const SpaceComparison& comparison) {
  std::string text =
      "in space, less the motion of all points together; a scale that both have from one target "
      "is not seen\n";
  for (const SpaceDifference& each : comparison.differences) {
    const std::string what = each.quantity == "bar"
                                 ? fmt::format("length of {:.4g} mm", 1e3 * comparison.bar)
                                 : (each.quantity == "z" ? "z" : "x, y");
    text += fmt::format("  {} at {:.3g} m: {} {} mm RMS, at most {}",
                        CamerasText(each.cameras),
                        each.distance,
                        what,
                        MillimetresText(each.rms),
                        MillimetresText(each.largest));
    if (comparison.has_prediction) {
      text += fmt::format(
          "; predicted {:.2g}{}", 1e3 * each.predicted, each.differs ? ", so it differs" : "");
    }
    text += "\n";
  }
  return text;
}

std::string SpaceCsv(const SpaceComparison& comparison) {
  std::string text = "cameras,distance,quantity,points,rms,largest,predicted,probability,differs\n";
  for (const SpaceDifference& each : comparison.differences) {
    text += fmt::format("{},{:g},{},{},{:.6g},{:.6g},{},{},{:d}\n",
                        CsvCell(fmt::format("{}", fmt::join(each.cameras, "+"))),
                        each.distance,
                        each.quantity,
                        each.points,
                        each.rms,
                        each.largest,
                        comparison.has_prediction ? fmt::format("{:.6g}", each.predicted) : "",
                        comparison.has_prediction ? fmt::format("{:.3g}", each.probability) : "",
                        each.differs);
  }
  return text;
}

std::string CheckText(const CalibrationCheck& check) {
  std::string text;
  for (const CameraCheck& camera : check.cameras) {
    text += fmt::format(
        "{}: {} in {}; RMS with only poses free {:.4f} px; expected of a calibration that "
        "holds {:.4f}\n",
        camera.name,
        Counted(static_cast<size_t>(camera.points), "point"),
        Counted(static_cast<size_t>(check.frames), "frame"),
        camera.rms_held,
        camera.expected);
  }
  const Verdict verdict = JudgeCheck(check);
  for (const Finding& finding : verdict.findings) text += FindingText(finding);
  return text + fmt::format("verdict: {}. {}\n",
                            GradeName(verdict.grade),
                            check.valid ? "the calibration is still valid"
                                        : "the calibration is not valid any more");
}

}  // namespace plenocal
