// SPDX-License-Identifier: Apache-2.0
#include "apps/evaluate/compare_truths.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "apps/evaluate/trajectory_metrics.h"
#include "apps/evaluate/truth_uncertainty.h"
#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"
#include "calib/camera/rigid_transform.h"
#include "calib/io/yaml.h"

namespace plenocal {
namespace {

constexpr double kTolerance = 0.01;  // s between poses of one frame
constexpr double kLevel = 0.005;     // of each test

// A row of the table and of the file.
struct ComparedNumber {
  const char* name;
  const char* unit;
  double factor;  // of the unit for the terminal
  const char* shown_unit;
};

constexpr std::array<ComparedNumber, 7> kNumbers{{{"x", "m", 1e3, "mm"},
                                                  {"y", "m", 1e3, "mm"},
                                                  {"z", "m", 1e3, "mm"},
                                                  {"w_x", "rad", 1e3, "mrad"},
                                                  {"w_y", "rad", 1e3, "mrad"},
                                                  {"w_z", "rad", 1e3, "mrad"},
                                                  {"scale", "1", 100, "%"}}};

// The camera whose path is compared: the first of B where A has it, else the first of A that B has.
std::string CommonCamera(const GroundTruthFile& a,
                         const GroundTruthFile& b,
                         const std::filesystem::path& path_b) {
  const auto has = [](const GroundTruthFile& file, const std::string& camera) {
    return std::ranges::find(file.cameras, camera) != file.cameras.end();
  };
  if (has(a, b.cameras.front())) return b.cameras.front();
  for (const std::string& camera : a.cameras) {
    if (has(b, camera)) return camera;
  }
  throw InputError(
      "{}: has no camera of the other ground truth ({}); both must be of one "
      "recording and of calibrations that name its cameras alike",
      path_b.string(),
      fmt::join(a.cameras, ", "));
}

// Change of the similarity between start and end about `centre` by those of [start, end] about
// their own centres; `T` takes these to the frame of `centre`.
Eigen::Matrix<double, 7, 14> RelativeChange(const TruthUncertainty& uncertainty,
                                            const Similarity& T,
                                            const Eigen::Vector3d& centre) {
  const auto moved = [&](const Eigen::Vector3d& own_centre) {
    Matrix7d change = Matrix7d::Identity();
    change.topRows<3>() = SimilarityEffect(centre, T * own_centre);
    Matrix7d turned = Matrix7d::Identity();
    turned.topLeftCorner<3, 3>() = T.s * T.R;
    turned.block<3, 3>(3, 3) = T.R;
    return Matrix7d(change * turned);
  };
  Eigen::Matrix<double, 7, 14> relative;
  relative << -moved(uncertainty.start_centre), moved(uncertainty.end_centre);
  return relative;
}

std::string VerdictText(const TruthComparison& comparison) {
  if (!comparison.end_differs && !comparison.scale_differs) return "same within uncertainty";
  std::string what = comparison.end_differs ? "the end of the loop" : "";
  if (comparison.scale_differs) what += what.empty() ? "the scale" : " and the scale";
  return "not the same within uncertainty: " + what;
}

LoopTruth ReadLoop(const std::filesystem::path& path) {
  std::optional<LoopTruth> loop = SplitAtLargestGap(ReadTrajectory(path, {}));
  if (loop) return *std::move(loop);
  throw InputError("{}: no gap separates start and end of the loop", path.string());
}

}  // namespace

bool IsGroundTruth(const std::filesystem::path& path) {
  const YamlNode root = YamlNode::ReadFile(path);
  return root.IsMap() && root.Has("segment_covariance");
}

TruthComparison CompareTruths(const std::filesystem::path& a, const std::filesystem::path& b) {
  TruthComparison comparison;
  comparison.camera = CommonCamera(ReadGroundTruth(a, ""), ReadGroundTruth(b, ""), b);
  const GroundTruthFile of_a = ReadGroundTruth(a, comparison.camera);
  const GroundTruthFile of_b = ReadGroundTruth(b, comparison.camera);
  const LoopMetrics metrics =
      MeasureLoop(ReadTrajectory(of_b.segments, {}), ReadLoop(of_a.segments), kTolerance);

  const Eigen::Vector3d& centre = of_a.uncertainty.end_centre;
  const Similarity T_b_a = metrics.T_drift.Inverse();
  comparison.end << T_b_a * centre - centre, LogRotation(T_b_a.R), T_b_a.s - 1;
  const auto add = [&](const TruthUncertainty& uncertainty, const Similarity& T_a) {
    const auto J = RelativeChange(uncertainty, T_a, centre);
    comparison.covariance += J * uncertainty.covariance.segments * J.transpose();
  };
  add(of_a.uncertainty, {});
  add(of_b.uncertainty, metrics.T_s_gt);
  comparison.chi_square = comparison.end.dot(
      SolveSymmetric(Eigen::MatrixXd(comparison.covariance), Eigen::VectorXd(comparison.end)));
  if (!std::isfinite(comparison.chi_square)) {
    throw InputError(
        "{}, {}: the sum of their covariances is singular, so that there is no "
        "uncertainty to compare with",
        a.string(),
        b.string());
  }
  comparison.probability = ChiSquareTail(7, comparison.chi_square);
  comparison.scale = 1 / metrics.absolute_scale - 1;
  comparison.scale_sigma =
      std::hypot(of_a.uncertainty.covariance.scale_sigma, of_b.uncertainty.covariance.scale_sigma);
  comparison.end_differs = comparison.probability < kLevel;
  comparison.scale_differs =
      ChiSquareTail(1, std::pow(comparison.scale / comparison.scale_sigma, 2)) < kLevel;
  return comparison;
}

std::string ComparisonText(const TruthComparison& comparison,
                           const std::string& a,
                           const std::string& b) {
  std::string text = fmt::format(
      "{} (B) against {} (A), by the path of '{}'\n"
      "  end of the loop, the starts made equal:\n"
      "  {:<10} {:>12} {:>12} {:>10}\n",
      b,
      a,
      comparison.camera,
      "",
      "B - A",
      "sigma",
      "in sigmas");
  const auto row =
      [&](const char* name, double difference, double sigma, double factor, const char* unit) {
        text += fmt::format("  {:<10} {:>12.4g} {:>12.3g} {:>10.1f}  {}\n",
                            name,
                            factor * difference,
                            factor * sigma,
                            sigma > 0 ? difference / sigma : 0.0,
                            unit);
      };
  for (size_t i = 0; i < kNumbers.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    row(kNumbers[i].name,
        comparison.end[k],
        std::sqrt(comparison.covariance(k, k)),
        kNumbers[i].factor,
        kNumbers[i].shown_unit);
  }
  text += fmt::format(
      "  chi-square {:.3g} of 7 numbers: the stated errors cause as much in {} % of all loops\n"
      "  the whole loop:\n",
      comparison.chi_square,
      comparison.probability > 0.01 ? fmt::format("{:.0f}", 100 * comparison.probability)
                                    : fmt::format("{:.1g}", 100 * comparison.probability));
  row("scale", comparison.scale, comparison.scale_sigma, 100, "%");
  return text + VerdictText(comparison) + "\n";
}

std::string ComparisonCsv(const TruthComparison& comparison) {
  std::string text = "number,difference,sigma,unit\n";
  const auto row = [&](const std::string& name, double difference, double sigma, const char* unit) {
    text += fmt::format("{},{:.9g},{:.6g},{}\n", name, difference, sigma, unit);
  };
  for (size_t i = 0; i < kNumbers.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    row(fmt::format("end_{}", kNumbers[i].name),
        comparison.end[k],
        std::sqrt(comparison.covariance(k, k)),
        kNumbers[i].unit);
  }
  row("scale", comparison.scale, comparison.scale_sigma, "1");
  return text;
}

}  // namespace plenocal
