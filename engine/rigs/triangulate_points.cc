// SPDX-License-Identifier: Apache-2.0
#include "engine/rigs/triangulate_points.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <map>
#include <set>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/base/parallel.h"
#include "calib/base/statistics.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"

namespace plenocal {
namespace {

// Part of the recordings without an outlier in which a point is left out.
constexpr double kFalseAlarms = 0.05;
// False-alarm rate of the test of all rays against a calibration that holds.
constexpr double kContradiction = 1e-3;

class Job {
 public:
  Job(const CalibrationRecord& calibration,
      const std::vector<SeenPoints>& seen,
      const TriangulateRequest& request,
      const Run& run)
      : calibration_(calibration), seen_(seen), request_(request), run_(run) {
    for (const SeenPoints& each : seen) {
      if (std::ranges::find(made_.cameras, each.camera) != made_.cameras.end()) {
        throw InputError("{}: camera '{}' has points already", each.source, each.camera);
      }
      made_.cameras.push_back(each.camera);
    }
    CheckRequest();
    rig_ = MakeSpaceRig(calibration, made_.cameras, SharedCounts());
    rig_.correlation = request.correlation;
    if (request.adjust && !rig_.has_errors) {
      throw InputError("{}: has no standard errors, within which --adjust moves it", Name());
    }
    if (request.adjust && rig_.frame_columns > 0) {
      throw InputError(
          "{}: the rig is not rigid, or its cameras are not synchronous (jitter): --adjust would "
          "take the motion of single frames for an error of the calibration",
          Name());
    }
    made_.calibration = calibration.path.string();
    made_.correlation = request.correlation;
    made_.frame = request.frame;
    made_.level = request.level;
    made_.sigmas = std::sqrt(ChiSquareQuantile(1, 1 - request.level));
  }

  Triangulation Make() {
    Warn();
    FindPoints();
    CheckTables();
    Judge();
    if (request_.adjust) Adjust();
    for (const std::string& frame : frames_) MeasureIn(frame);
    return std::move(made_);
  }

 private:
  [[nodiscard]] std::string Name() const {
    return calibration_.path.empty() ? "the calibration" : calibration_.path.string();
  }

  void CheckRequest() const {
    if (seen_.empty()) throw InputError("give the points of one camera or more");
    if (seen_.size() == 1 && !FindCamera(calibration_, made_.cameras[0]).model->plenoptic) {
      throw InputError(
          "{}: one ordinary camera sees directions, no points; give those of another camera, too",
          seen_[0].source);
    }
    if (request_.correlation != 0) {
      for (const std::string& name : made_.cameras) {
        if (!FindCamera(calibration_, name).model->plenoptic) continue;
        throw InputError("--correlation is that of ordinary cameras; '{}' is plenoptic", name);
      }
      const double least = -1 / std::max(1.0, static_cast<double>(seen_.size()) - 1);
      if (!(request_.correlation > least && request_.correlation < 1)) {
        throw InputError("--correlation {}: that of {} cameras lies between {:.3g} and 1",
                         request_.correlation,
                         seen_.size(),
                         least);
      }
    }
    const auto check = [](const auto& sets, const char* option, size_t least, size_t most) {
      for (const std::vector<ScenePosition>& ends : sets) {
        std::set<std::vector<int>> different;
        for (const ScenePosition& end : ends) different.insert(end.points);
        if (ends.size() >= least && ends.size() <= most && different.size() == ends.size())
          continue;
        throw InputError("{} {}: expected {}{} different points",
                         option,
                         fmt::join(NamesOf(ends), ","),
                         least,
                         most > least ? " or more" : "");
      }
    };
    check(request_.lengths, "--length", 2, 2);
    check(request_.angles, "--angle", 3, 3);
    check(request_.planes, "--plane", 3, 100'000);
  }

  // The displacements that the tables of each camera state.
  [[nodiscard]] std::vector<size_t> SharedCounts() const {
    std::vector<size_t> counts;
    for (size_t c = 0; c < seen_.size(); ++c) {
      size_t most = 0;
      for (const View& view : seen_[c].views) {
        for (const std::vector<double>& by : view.by_nuisance) most = std::max(most, by.size());
      }
      counts.push_back(most / FindCamera(calibration_, made_.cameras[c]).model->measured.size());
    }
    return counts;
  }

  void Warn() {
    const auto warn = [&](const std::string& what) {
      run_.Warning(fmt::format("{}: {}", Name(), what));
    };
    if (!rig_.has_errors) {
      warn("no standard errors; those of points contain the noise of the images alone");
    } else if (made_.cameras.size() > 1 && calibration_.correlations.names.empty()) {
      warn(
          "no correlations.csv beside it, without which the cameras' errors count as independent: "
          "standard errors of points can be far too large");
    }
    if (rig_.open.empty()) return;
    made_.findings.push_back(
        {.code = "undetermined",
         .grade = Grade::kBad,
         .cameras = made_.cameras,
         .what = fmt::format("The calibration does not determine {}: standard errors of points "
                             "hold for the values that it has.",
                             fmt::join(rig_.open, ", ")),
         .remedy = "Calibrate with images that determine them, or state the values."});
  }

  void FindPoints() {
    std::map<std::string, std::map<int, std::vector<SpaceObservation>>> seen;
    for (size_t c = 0; c < seen_.size(); ++c) {
      for (const View& view : seen_[c].views) {
        if (!seen.contains(view.frame)) frames_.push_back(view.frame);
        for (size_t i = 0; i < view.observations.size(); ++i) {
          const Observation& each = view.observations[i];
          seen[view.frame][each.marker].push_back(
              {.camera = c,
               .values = each.values,
               .sigma = seen_[c].is_noise
                            ? each.detector_sigma
                            : request_.sigma.value_or(rig_.NoiseOf(c, each.detector_sigma)),
               .by_shared =
                   view.by_nuisance.empty() ? std::vector<double>() : view.by_nuisance[i]});
        }
      }
    }
    for (const std::string& frame : frames_) {
      for (auto& [marker, observations] : seen[frame]) {
        made_.points.push_back({.frame = frame, .marker = marker, .point = {}});
        of_point_.push_back(std::move(observations));
        for (const SpaceObservation& each : of_point_.back()) {
          if (each.sigma > 0) continue;
          throw InputError("camera '{}' has no noise in {}: state it with --sigma",
                           made_.cameras[each.camera],
                           Name());
        }
      }
    }
    if (request_.frame == SpaceFrame::kHousing && rig_.follow.size() == 0) {
      throw InputError(
          "--frame housing needs the calibration's own points: give the folder that 'plenocal "
          "calibrate' wrote, in place of {}",
          Name());
    }
    const auto fit = [&](const auto& rig_of) {
      ParallelFor(of_point_.size(), run_.threads, [&](size_t i) {
        const TriangulatedPoint& each = made_.points[i];
        made_.points[i].point = FitPoint(rig_of(each.frame), of_point_[i], request_.frame);
      });
    };
    fit([&](const std::string&) -> const SpaceRig& { return rig_; });
    if (rig_.frame_columns == 0) return;
    // The jitter of a frame turns about the middle of its points.
    std::map<std::string, SpaceRig> rigs;
    for (const std::string& frame : frames_) {
      std::vector<Eigen::Vector3d> positions;
      for (const TriangulatedPoint& each : made_.points) {
        if (each.frame == frame && each.point.IsFound() && each.point.rho > 0) {
          positions.push_back(each.point.position);
        }
      }
      SpaceRig& rig = rigs.emplace(frame, rig_).first->second;
      for (const Eigen::Vector3d& position : positions) {
        rig.centre += position / static_cast<double>(positions.size());
      }
    }
    fit([&](const std::string& frame) -> const SpaceRig& { return rigs.at(frame); });
  }

  // Points of another camera are far from every ray.
  void CheckTables() const {
    constexpr double kFar = 50;  // sigmas
    std::vector<double> misses;
    for (const TriangulatedPoint& each : made_.points) {
      if (!each.point.IsFound() || each.point.degrees == 0) continue;
      misses.push_back(std::sqrt(each.point.misses.squaredNorm() / each.point.degrees));
    }
    if (misses.empty() || Median(misses) <= kFar) return;
    std::vector<std::string> names;
    for (const SeenPoints& each : seen_) {
      names.push_back(fmt::format("{}={}", each.camera, each.source));
    }
    throw InputError(
        "{}: rays of one point miss each other by {:.3g} times their noise in half of the points; "
        "check that they belong to these cameras, and have the same numbers for the same "
        "points",
        fmt::join(names, ", "),
        Median(misses));
  }

  // Points whose rays pass each other are left out. Where they are most of all, the calibration is
  // wrong, not the points: it is named, and they stay.
  void Judge() {
    const double limit = kFalseAlarms / std::max<double>(1, made_.points.size());
    const auto misses = [&](const TriangulatedPoint& each) {
      return each.point.IsFound() && each.point.probability < limit;
    };
    const auto found = std::ranges::count_if(
        made_.points, [](const TriangulatedPoint& each) { return each.point.IsFound(); });
    const bool most_miss = 2 * std::ranges::count_if(made_.points, misses) > found;
    std::map<std::string, std::vector<SpacePoint>> used;
    for (TriangulatedPoint& each : made_.points) {
      std::string why = each.point.reason;
      if (!most_miss && misses(each)) {
        why = fmt::format("its rays miss each other by {:.2g} px RMS (probability {:.1g})",
                          each.point.rms,
                          each.point.probability);
      }
      each.used = why.empty();
      if (each.used) {
        used[each.frame].push_back(each.point);
      } else {
        made_.left_out.push_back({.where = each.Place(), .reason = why, .frame = each.frame});
      }
    }
    if (used.empty()) {
      const std::string why =
          made_.left_out.empty() ? "" : fmt::format("; {}", made_.left_out[0].reason);
      throw JobError("no point is seen by two rays that meet{}", why);
    }
    CommonErrors common;
    for (const auto& [frame, points] : used) common.Add(CommonErrors(points));
    made_.rays = common.Test();
    if (made_.rays.probability >= kContradiction) return;
    made_.findings.push_back(
        {.code = "rays_contradict_calibration",
         .grade = Grade::kBad,
         .cameras = made_.cameras,
         .value = made_.rays.chi_square / made_.rays.degrees,
         .what = fmt::format("The rays of all points together miss each other by more than noise "
                             "and the calibration explain (chi-square {:.4g} of {} degrees of "
                             "freedom).",
                             made_.rays.chi_square,
                             made_.rays.degrees),
         .remedy = "A camera has moved or its focus has changed since, or the noise is larger: "
                   "test the calibration with 'plenocal compare --check', state --sigma."});
  }

  // The calibration follows the rays of all used points, and these follow it.
  void Adjust() {
    std::vector<std::vector<SpaceObservation>> of_used;
    for (size_t i = 0; i < of_point_.size(); ++i) {
      if (made_.points[i].used) of_used.push_back(of_point_[i]);
    }
    AdjustedRig adjusted = AdjustedTo(rig_, of_used, run_.threads);
    const SpaceRig before = std::exchange(rig_, std::move(adjusted.rig));
    ParallelFor(of_point_.size(), run_.threads, [&](size_t i) {
      TriangulatedPoint& each = made_.points[i];
      if (!each.used) return;
      SpacePoint point = FitPoint(rig_, of_point_[i], request_.frame);
      // The test of its rays is that by the calibration as it was.
      point.chi_square = each.point.chi_square;
      point.probability = each.point.probability;
      each.point = std::move(point);
      each.used = each.point.IsFound();
    });
    for (size_t i = 0; i < rig_.unknowns.size(); ++i) {
      const auto row = static_cast<Eigen::Index>(i);
      made_.adjusted.push_back({.name = NameOfUnknown(rig_, i),
                                .change = adjusted.change[row],
                                .sigma_before = before.root.row(row).norm(),
                                .sigma = rig_.root.row(row).norm()});
    }
  }

  // Calls measure(points) where the frame has all of them.
  template <typename Measure>
  void Each(const std::string& frame,
            const std::string& kind,
            const std::vector<std::vector<ScenePosition>>& sets,
            const std::map<int, const SpacePoint*>& by_number,
            const Measure& measure) {
    for (const std::vector<ScenePosition>& ends : sets) {
      std::vector<SpacePoint> points;
      for (const ScenePosition& end : ends) {
        std::vector<const SpacePoint*> parts;
        for (const int number : end.points) {
          const auto found = by_number.find(number);
          if (found != by_number.end()) parts.push_back(found->second);
        }
        if (parts.size() == end.points.size()) points.push_back(MeanOf(parts));
      }
      const std::string of = fmt::format("{}", fmt::join(NamesOf(ends), " "));
      if (points.size() == ends.size()) {
        made_.measures.push_back({frame, kind, of, std::nullopt, std::nullopt});
        measure(points, &made_.measures.back());
      } else {
        made_.left_out.push_back({.where = fmt::format("{} {} {}", frame, kind, of),
                                  .reason = "a point of it is not there",
                                  .frame = frame});
      }
    }
  }

  void MeasureIn(const std::string& frame) {
    std::map<int, const SpacePoint*> by_number;
    for (const TriangulatedPoint& each : made_.points) {
      if (each.used && each.frame == frame && each.point.rho > 0) {
        by_number.emplace(each.marker, &each.point);
      }
    }
    std::vector<std::vector<ScenePosition>> lengths = request_.lengths;
    if (request_.all_lengths) {
      const auto end = [](int number) { return ScenePosition{std::to_string(number), {number}}; };
      for (auto i = by_number.begin(); i != by_number.end(); ++i) {
        for (auto j = std::next(i); j != by_number.end(); ++j) {
          lengths.push_back({end(i->first), end(j->first)});
        }
      }
    }
    Each(frame, "length", lengths, by_number, [](const auto& points, auto* measure) {
      measure->number = LengthOf(points[0], points[1]);
    });
    Each(frame, "angle", request_.angles, by_number, [](const auto& points, auto* measure) {
      measure->number = AngleOf(points[0], points[1], points[2]);
    });
    Each(frame, "plane", request_.planes, by_number, [](const auto& points, auto* measure) {
      std::vector<const SpacePoint*> pointers;
      for (const SpacePoint& point : points) pointers.push_back(&point);
      measure->plane = PlaneOf(pointers);
    });
  }

  const CalibrationRecord& calibration_;
  const std::vector<SeenPoints>& seen_;
  const TriangulateRequest& request_;
  const Run& run_;
  std::vector<std::string> frames_;
  std::vector<std::vector<SpaceObservation>> of_point_;  // parallel to the points
  SpaceRig rig_;
  Triangulation made_;
};

}  // namespace

ScenePosition PositionNamed(const std::string& name) {
  int number = 0;
  const char* const end = name.data() + name.size();
  const auto [rest, error] = std::from_chars(name.data(), end, number);
  if (error == std::errc() && rest == end && number >= 0) return {name, {number}};
  const auto corner = [](int id, int k) { return 4 * id + k; };
  if (const auto tag = TagPosition(name, corner)) return *tag;
  throw InputError("'{}' is no point: expected its number, 'tag ID' or 'tag ID corner 0' to 3",
                   name);
}

std::string TriangulatedPoint::Place() const { return fmt::format("{} point {}", frame, marker); }

Triangulation TriangulatePoints(const CalibrationRecord& calibration,
                                const std::vector<SeenPoints>& seen,
                                const TriangulateRequest& request,
                                const Run& run) {
  const RunScope inputs;
  UseAsInput(calibration.path);
  const std::unique_ptr<OutputFolder> out = OpenOutput(request.out);
  Triangulation made = Job(calibration, seen, request, run).Make();
  if (!out) return made;
  WriteTriangulation(made, out.get());
  out->Commit();
  return made;
}

}  // namespace plenocal
