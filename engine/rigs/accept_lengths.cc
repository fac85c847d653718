// SPDX-License-Identifier: Apache-2.0
#include "engine/rigs/accept_lengths.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "calib/base/format_error.h"
#include "calib/base/json_text.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/quoted_text.h"
#include "calib/base/statistics.h"
#include "calib/io/yaml.h"
#include "calib/space/congruent_points.h"
#include "engine/json/calibration_json.h"

namespace plenocal {
namespace {

// False-alarm rates of the tests of the standard errors and of a common scale.
constexpr double kContradiction = 1e-3;
// Requirements of VDI/VDE 2634 part 1 by a report on it (docs/space.md).
constexpr int kFewestLines = 7, kFewestOnLine = 5;
constexpr double kPartOfDiagonal = 2.0 / 3;

ScenePosition ReadPosition(const YamlNode& node) {
  try {
    return PositionNamed(node.AsString());
  } catch (const Error& error) {
    node.Fail(error.what());
  }
}

// A length at the temperature of the test over that of its certificate.
double ExpansionOf(const YamlNode& root) {
  const std::optional<YamlNode> node = root.Find("temperature");
  if (!node) return 1;
  node->CheckKeys({"bar", "calibrated", "expansion"});
  static constexpr std::array<std::string_view, 3> kRequired{"bar", "calibrated", "expansion"};
  node->RequireKeys(kRequired, "bar: 23.5\ncalibrated: 20\nexpansion: 1.2e-6\n");
  return 1 + node->At("expansion").AsNumber() *
                 (node->At("bar").AsNumber() - node->At("calibrated").AsNumber());
}

// One length in one frame: derivatives by the points at its ends.
struct Row {
  size_t reference = 0;
  std::string frame;
  std::vector<std::pair<const SpacePoint*, Eigen::RowVector3d>> by;
  std::array<Eigen::Vector3d, 2> ends;
};

// Covariance of all lengths: noise of common points, the calibration's error, the jitter of a
// frame, the error of a reference.
Eigen::MatrixXd CovarianceOf(const AcceptanceTest& test, const std::vector<Row>& rows) {
  const Eigen::Index n = std::ssize(rows);
  const SpacePoint& first = *rows[0].by[0].first;
  Eigen::MatrixXd root = Eigen::MatrixXd::Zero(n, first.shared.cols());
  std::map<const SpacePoint*, std::vector<std::pair<Eigen::Index, Eigen::RowVector3d>>> by_point;
  for (Eigen::Index i = 0; i < n; ++i) {
    for (const auto& [point, by] : rows[static_cast<size_t>(i)].by) {
      root.row(i) += by * point->shared;
      by_point[point].emplace_back(i, by);
    }
  }
  const auto calibration = root.leftCols(root.cols() - first.frame_columns);
  const auto jitter = root.rightCols(first.frame_columns);
  Eigen::MatrixXd covariance = calibration * calibration.transpose();
  for (const auto& [point, lengths] : by_point) {
    for (const auto& [i, by_i] : lengths) {
      for (const auto& [j, by_j] : lengths) covariance(i, j) += by_i.dot(by_j * point->noise);
    }
  }
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < n; ++j) {
      const Row &a = rows[static_cast<size_t>(i)], &b = rows[static_cast<size_t>(j)];
      if (a.frame == b.frame) covariance(i, j) += jitter.row(i).dot(jitter.row(j));
      if (a.reference == b.reference) {
        covariance(i, j) += std::pow(test.lengths[a.reference].sigma, 2);
      }
    }
  }
  return covariance;
}

class Test {
 public:
  Test(const AcceptanceTest& test, const Triangulation& made) : test_(test) {
    for (const TriangulatedPoint& each : made.points) {
      if (!each.used || !(each.point.rho > 0)) continue;
      if (!points_.contains(each.frame)) frames_.push_back(each.frame);
      points_[each.frame][each.marker] = &each.point;
    }
    if (test.bundle) Bundle();
  }

  Acceptance Make() {
    for (size_t k = 0; k < test_.lengths.size(); ++k) Measure(k);
    if (rows_.empty()) {
      throw JobError("no frame shows both ends of a length: {}", fmt::join(made_.left_out, "; "));
    }
    made_.passes = std::ranges::all_of(made_.lengths, &AcceptedLength::Passes);
    double squares = 0;
    for (const AcceptedLength& each : made_.lengths) {
      made_.largest = std::max(made_.largest, std::abs(each.Deviation()));
      squares += each.Deviation() * each.Deviation();
    }
    made_.rms = std::sqrt(squares / static_cast<double>(made_.lengths.size()));
    TestTogether();
    CheckComplete();
    return std::move(made_);
  }

 private:
  // One set of points in place of those of all frames.
  void Bundle() {
    std::vector<PointsOfFrame> frames;
    for (const std::string& frame : frames_) frames.push_back(points_.at(frame));
    together_ = AdjustCongruent(frames);
    for (size_t f = 0; f < frames_.size(); ++f) {
      if (together_.used[f]) continue;
      made_.left_out.push_back(
          fmt::format("{}: it has no three points in common with the others", frames_[f]));
    }
    frames_ = {"all"};
    points_.clear();
    for (const auto& [number, point] : together_.points) points_["all"][number] = &point;
  }

  void Measure(size_t k) {
    const ReferenceLength& reference = test_.lengths[k];
    bool is_seen = false;
    for (const std::string& frame : frames_) {
      Row row{k, frame, {}, {}};
      const PointsOfFrame& points = points_.at(frame);
      if (!Add(reference.a, points, 0, &row) || !Add(reference.b, points, 1, &row)) continue;
      is_seen = true;
      const Eigen::Vector3d difference = row.ends[0] - row.ends[1];
      const Eigen::RowVector3d u = difference.normalized();
      double noise = 0;
      Eigen::RowVectorXd by_root = Eigen::RowVectorXd::Zero(row.by[0].first->shared.cols());
      for (auto& [point, by] : row.by) {
        by = by.x() * u;
        noise += by.dot(by * point->noise);
        by_root += by * point->shared;
      }
      made_.lengths.push_back({.reference = &reference,
                               .frame = frame,
                               .measured = difference.norm(),
                               .sigma = std::sqrt(noise + by_root.squaredNorm()),
                               .limit = test_.LimitOf(reference)});
      rows_.push_back(std::move(row));
    }
    if (!is_seen) made_.left_out.push_back(fmt::format("{}: {}", reference.line, reference.Of()));
  }

  // The mean of an end's points. False where one is not there. Weights stand in x of `by`.
  static bool Add(const ScenePosition& end, const PointsOfFrame& points, size_t which, Row* row) {
    const double weight = (which == 0 ? 1.0 : -1.0) / static_cast<double>(end.points.size());
    row->ends.at(which).setZero();
    for (const int number : end.points) {
      const auto found = points.find(number);
      if (found == points.end()) return false;
      row->by.emplace_back(found->second, Eigen::RowVector3d(weight, 0, 0));
      row->ends.at(which) += std::abs(weight) * found->second->position;
    }
    return true;
  }

  void TestTogether() {
    const Eigen::Index n = std::ssize(rows_);
    const Eigen::MatrixXd covariance = CovarianceOf(test_, rows_);
    Eigen::VectorXd deviation(n), length(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const AcceptedLength& each = made_.lengths[static_cast<size_t>(i)];
      deviation[i] = each.Deviation();
      length[i] = each.reference->length;
    }
    const Eigen::LLT<Eigen::MatrixXd> root(covariance);
    if (root.info() != Eigen::Success) return;  // exact points of an exact calibration
    const Eigen::VectorXd d = root.matrixL().solve(deviation), l = root.matrixL().solve(length);
    made_.chi_square = d.squaredNorm();
    made_.probability = ChiSquareTail(static_cast<double>(n), made_.chi_square);
    made_.scale_sigma = 1 / l.norm();
    made_.scale = l.dot(d) / l.squaredNorm();
    const double t = made_.scale / made_.scale_sigma;
    // A scale explains the deviations only where it leaves what the standard errors explain.
    const bool explains = n > 1 && ChiSquareTail(static_cast<double>(n - 1),
                                                 made_.chi_square - t * t) >= kContradiction;
    if (explains && ChiSquareTail(1, t * t) < kContradiction) {
      made_.findings.push_back(
          {.code = "acceptance_scale",
           .grade = Grade::kUsable,
           .value = t,
           .what = fmt::format("All lengths are {:.2g} +- {:.1g} % too {}.",
                               1e2 * std::abs(made_.scale),
                               1e2 * made_.scale_sigma,
                               made_.scale > 0 ? "long" : "short"),
           .remedy = "Check the size of the target's print; state its scale_sigma and a measured "
                     "distance in the session."});
    } else if (made_.probability < kContradiction) {
      made_.findings.push_back(
          {.code = "acceptance_sigma",
           .grade = Grade::kUsable,
           .value = made_.chi_square / static_cast<double>(n),
           .what = fmt::format("The deviations are larger than the standard errors explain; the "
                               "largest of them: {}.",
                               Escaped(LargestInSigmas())),
           .remedy =
               "Check this reference length. If others deviate as well, see the calibration's "
               "verdict, and calibrate again if a camera has moved."});
    }
  }

  [[nodiscard]] std::string LargestInSigmas() const {
    const AcceptedLength& worst = *std::ranges::max_element(
        made_.lengths, {}, [](const AcceptedLength& each) { return std::abs(each.InSigmas()); });
    return fmt::format(
        "{} in {}, {:.2g} sigma", worst.reference->Of(), worst.frame, std::abs(worst.InSigmas()));
  }

  void CheckComplete() {
    std::map<std::string, std::set<const ReferenceLength*>> lines;
    double longest = 0;
    Eigen::AlignedBox3d box;
    for (size_t i = 0; i < rows_.size(); ++i) {
      const AcceptedLength& each = made_.lengths[i];
      lines[each.reference->line].insert(each.reference);
      longest = std::max(longest, each.reference->length);
      for (const Eigen::Vector3d& end : rows_[i].ends) box.extend(end);
    }
    made_.lines = static_cast<int>(lines.size());
    made_.volume = box.sizes();
    const auto lacks = [&](bool is, std::string what) {
      if (is) made_.lacks.push_back(std::move(what));
    };
    lacks(made_.lines < kFewestLines,
          fmt::format("{} measuring lines of {}", made_.lines, kFewestLines));
    for (const auto& [line, lengths] : lines) {
      lacks(std::ssize(lengths) < kFewestOnLine,
            fmt::format("{} lengths of {} on {}", lengths.size(), kFewestOnLine, line));
    }
    lacks(longest < made_.volume.minCoeff(), "a length as long as the shortest side");
    lacks(longest < kPartOfDiagonal * made_.volume.norm(), "a length of 2/3 of the diagonal");
    for (int corner = 0; corner < 8; ++corner) {
      const Eigen::Vector3d at = box.corner(static_cast<Eigen::AlignedBox3d::CornerType>(corner));
      const auto is_near = [&](const Eigen::Vector3d& end) {
        return ((end - at).array().abs() <= made_.volume.array() / 4).all();
      };
      const bool has_end = std::ranges::any_of(
          rows_, [&](const Row& row) { return is_near(row.ends[0]) || is_near(row.ends[1]); });
      if (has_end) continue;
      made_.lacks.emplace_back("an end in every corner of the volume");
      break;
    }
  }

  const AcceptanceTest& test_;
  std::vector<std::string> frames_;
  std::map<std::string, PointsOfFrame> points_;
  CongruentPoints together_;
  std::vector<Row> rows_;  // parallel to the lengths
  Acceptance made_;
};

}  // namespace

double AcceptanceTest::LimitOf(const ReferenceLength& length) const {
  constexpr double kGuard = 2;  // standard deviations
  double limit = constant + per_metre * length.length;
  if (at_most) limit = std::min(limit, *at_most);
  return std::max(0.0, guarded ? limit - kGuard * length.sigma : limit);
}

double AcceptedLength::InSigmas() const {
  return Deviation() / std::hypot(sigma, reference->sigma);
}

AcceptanceTest ReadAcceptanceTest(const std::filesystem::path& path) {
  const YamlNode root = YamlNode::ReadFile(path);
  root.CheckVersion();
  root.CheckKeys({"plenocal", "limit", "decision", "mode", "temperature", "lines"});
  static constexpr std::array<std::string_view, 2> kRequired{"limit", "lines"};
  root.RequireKeys(kRequired,
                   "limit: {constant: 0.05 mm, per_metre: 0.05 mm}\n"
                   "lines: [{name: 1, bars: [{between: [tag 3, tag 7], length: 499.962 mm}]}]\n");
  AcceptanceTest test;
  const YamlNode limit = root.At("limit");
  limit.CheckKeys({"constant", "per_metre", "at_most"});
  test.constant = limit.At("constant").AsLength();
  if (const auto per_metre = limit.Find("per_metre")) test.per_metre = per_metre->AsLength();
  if (const auto at_most = limit.Find("at_most")) test.at_most = at_most->AsLength();
  if (const auto decision = root.Find("decision")) {
    test.guarded = decision->AsString() == "guarded";
    if (!test.guarded && decision->AsString() != "simple") {
      decision->Fail("expected guarded or simple, found '" + decision->AsString() + "'");
    }
  }
  if (const auto mode = root.Find("mode")) {
    test.bundle = mode->AsString() == "bundle";
    if (!test.bundle && mode->AsString() != "single") {
      mode->Fail("expected single or bundle, found '" + mode->AsString() + "'");
    }
  }
  const double expansion = ExpansionOf(root);
  std::set<std::string> names;
  for (const YamlNode& line : root.At("lines").Elements()) {
    line.CheckKeys({"name", "bars"});
    const std::string name = line.At("name").AsString();
    if (!names.insert(name).second) line.At("name").Fail("stands twice");
    for (const YamlNode& bar : line.At("bars").Elements()) {
      bar.CheckKeys({"between", "length", "sigma"});
      const std::vector<YamlNode> ends = bar.At("between").Elements();
      if (ends.size() != 2) bar.At("between").Fail("expected two ends, as [tag 3, tag 7]");
      ReferenceLength length{name, ReadPosition(ends[0]), ReadPosition(ends[1])};
      if (length.a.points == length.b.points) bar.At("between").Fail("both ends are the same");
      length.length = expansion * bar.At("length").AsLength();
      if (const auto sigma = bar.Find("sigma")) length.sigma = sigma->AsLength();
      test.lengths.push_back(std::move(length));
    }
  }
  if (test.lengths.empty()) root.At("lines").Fail("no line has a bar");
  return test;
}

Acceptance AcceptLengths(const AcceptanceTest& test, const Triangulation& made) {
  return Test(test, made).Make();
}

nlohmann::json AcceptanceJson(const Acceptance& acceptance) {
  return {{"passes", acceptance.passes},
          {"complete", acceptance.lacks.empty()},
          {"lacks", acceptance.lacks},
          {"lengths", acceptance.lengths.size()},
          {"lines", acceptance.lines},
          {"volume", {acceptance.volume.x(), acceptance.volume.y(), acceptance.volume.z()}},
          {"largest", acceptance.largest},
          {"rms", acceptance.rms},
          {"chi_square", acceptance.chi_square},
          {"probability", acceptance.probability},
          {"scale", acceptance.scale},
          {"scale_sigma", acceptance.scale_sigma},
          {"findings", VerdictJson({Grade::kGood, acceptance.findings}).at("findings")},
          {"left_out", acceptance.left_out}};
}

OutputContents AcceptanceFiles(const Acceptance& acceptance) {
  std::string csv =
      "line,of,frame,reference,sigma_reference,measured,sigma,deviation,limit,passes,in_sigmas\n";
  for (const AcceptedLength& each : acceptance.lengths) {
    csv += fmt::format("{},{},{},{:.9g},{:.6g},{:.9g},{:.6g},{:.6g},{:.6g},{:d},{:.4g}\n",
                       CsvCell(each.reference->line),
                       CsvCell(each.reference->Of()),
                       CsvCell(each.frame),
                       each.reference->length,
                       each.reference->sigma,
                       each.measured,
                       each.sigma,
                       each.Deviation(),
                       each.limit,
                       each.Passes(),
                       each.InSigmas());
  }
  return {{"acceptance.csv", csv},
          {"acceptance.json", JsonText(AcceptanceJson(acceptance)) + "\n"}};
}

std::string AcceptanceText(const Acceptance& acceptance) {
  const AcceptedLength& worst =
      *std::ranges::max_element(acceptance.lengths, {}, [](const AcceptedLength& each) {
        return std::abs(each.Deviation()) - each.limit;
      });
  std::string text = fmt::format(
      "{}: {} lengths, RMS deviation {:.2g} mm, at most {:.2g} mm; nearest to its limit: {} in {}, "
      "{:+.2g} mm of {:.2g} mm\n",
      acceptance.passes ? "pass" : "fail",
      acceptance.lengths.size(),
      1e3 * acceptance.rms,
      1e3 * acceptance.largest,
      worst.reference->Of(),
      Escaped(worst.frame),
      1e3 * worst.Deviation(),
      1e3 * worst.limit);
  if (!acceptance.lacks.empty()) {
    text += fmt::format("  no complete test after VDI/VDE 2634 part 1; it lacks: {}\n",
                        fmt::join(acceptance.lacks, "; "));
  }
  for (const std::string& each : acceptance.left_out) {
    text += fmt::format("  not measured: {}\n", each);
  }
  for (const Finding& finding : acceptance.findings) {
    text += fmt::format("  {}: {} {}\n", finding.code, finding.what, finding.remedy);
  }
  return text;
}

}  // namespace plenocal
