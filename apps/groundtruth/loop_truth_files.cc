// SPDX-License-Identifier: Apache-2.0
#include "apps/groundtruth/loop_truth_files.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numbers>

#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"
#include "engine/scene/locate_view.h"

namespace plenocal {
namespace {

// Lengths of loops for which the floor of the alignment error is given, m.
constexpr std::array kLoopLengths{25.0, 100.0, 274.0};

std::string SegmentsName(const std::string& camera) { return "segments_" + camera + ".txt"; }

double TimeOf(const SceneTracks& tracks, size_t frame) {
  return tracks.times.empty() ? static_cast<double>(frame) : tracks.times[frame];
}

std::vector<size_t> AllFrames(const LoopTruthResult& truth) {
  std::vector<size_t> frames = truth.start.frames;
  frames.insert(frames.end(), truth.end.frames.begin(), truth.end.frames.end());
  return frames;
}

// Lines "t x y z qx qy qz qw" of T_world_camera (TUM). The number of the frame stands for a time
// that is not known.
std::string PathText(const LoopTruthResult& truth,
                     const SceneTracks& tracks,
                     const RigidTransform& T_camera_rig,
                     const std::vector<size_t>& frames) {
  std::string text = "# time x y z qx qy qz qw (T_world_camera, m)\n";
  for (const size_t frame : frames) {
    const RigidTransform T = (T_camera_rig * truth.bundle.T_rig_target[frame]).Inverse();
    const Eigen::Quaterniond q(T.R);
    fmt::format_to(std::back_inserter(text),
                   "{:.6f} {:.9f} {:.9f} {:.9f} {:.12f} {:.12f} {:.12f} {:.12f}\n",
                   TimeOf(tracks, frame),
                   T.t.x(),
                   T.t.y(),
                   T.t.z(),
                   q.x(),
                   q.y(),
                   q.z(),
                   q.w());
  }
  return text;
}

std::string CovarianceCsv(const LoopTruthResult& truth, const SceneTracks& tracks) {
  constexpr std::array kNames{"x", "y", "z", "wx", "wy", "wz"};
  std::string text = "frame";
  for (size_t i = 0; i < kNames.size(); ++i) {
    for (size_t j = i; j < kNames.size(); ++j) text += fmt::format(",{}_{}", kNames[i], kNames[j]);
  }
  text += '\n';
  for (const size_t frame : AllFrames(truth)) {
    text += CsvCell(tracks.frames[frame]);
    for (Eigen::Index i = 0; i < 6; ++i) {
      for (Eigen::Index j = i; j < 6; ++j) {
        text += fmt::format(",{:.9g}", truth.covariance.poses[frame](i, j));
      }
    }
    text += '\n';
  }
  return text;
}

// The used landmarks as a map for `locate`.
LandmarkMap MakeMap(const LoopTruthResult& truth, const cv::Mat& descriptors) {
  std::vector<bool> used(truth.bundle.markers.size(), false);
  for (const BundleObservation& observation : truth.bundle.observations) {
    if (observation.used) used[static_cast<size_t>(observation.marker)] = true;
  }
  LandmarkMap map;
  for (size_t m = 0; m < used.size(); ++m) {
    const BundleMarker& marker = truth.bundle.markers[m];
    if (!used[m]) continue;
    map.points.emplace(marker.number, marker.position);
    map.numbers.push_back(marker.number);
    if (!descriptors.empty()) map.descriptors.push_back(descriptors.row(marker.number));
  }
  return map;
}

std::string PointsPly(const LandmarkMap& map) {
  std::string text = fmt::format(
      "ply\nformat ascii 1.0\ncomment landmarks in the frame of the first rig pose, m\n"
      "element vertex {}\nproperty double x\nproperty double y\nproperty double z\n"
      "property int track\nend_header\n",
      map.numbers.size());
  for (const int number : map.numbers) {
    const Eigen::Vector3d& p = map.points.at(number);
    fmt::format_to(
        std::back_inserter(text), "{:.6f} {:.6f} {:.6f} {}\n", p.x(), p.y(), p.z(), number);
  }
  return text;
}

std::string YamlList(std::span<const double> values) {
  std::string text = "[";
  for (size_t i = 0; i < values.size(); ++i) {
    text += (i > 0 ? ", " : "") + YamlNumber(values[i]);
  }
  return text + "]";
}

// A circle of this length through the start, level in the frame of the first rig pose.
std::vector<Eigen::Vector3d> Circle(const PathSegment& start, double length) {
  constexpr int kPoints = 360;
  const double radius = length / (2 * std::numbers::pi);
  std::vector<Eigen::Vector3d> path;
  for (int i = 0; i < kPoints; ++i) {
    const double angle = 2 * std::numbers::pi * i / kPoints;
    // The rig's y axis points down: a walk rotates about it.
    path.push_back(start.centre +
                   radius * Eigen::Vector3d(std::sin(angle), 0, 1 - std::cos(angle)));
  }
  return path;
}

std::string SegmentYaml(const char* name, const SegmentTruth& segment, const SceneTracks& tracks) {
  return fmt::format("  {}: {{frames: {}, left_out: {}, first: {}, last: {}}}\n",
                     name,
                     segment.frames.size(),
                     segment.left_out.size(),
                     YamlText(tracks.frames[segment.frames.front()]),
                     YamlText(tracks.frames[segment.frames.back()]));
}

std::string GroundTruthYaml(const LoopTruthResult& truth, const LoopTruthContext& context) {
  const PathSegment start = MakeSegment(truth.bundle, 0, truth.start.frames);
  const PathSegment end = MakeSegment(truth.bundle, 0, truth.end.frames);
  std::string text = "plenocal: 1\n";
  const auto out = std::back_inserter(text);
  text += "segments:\n" + SegmentYaml("start", truth.start, *context.tracks) +
          SegmentYaml("end", truth.end, *context.tracks);
  text += "cameras:\n";
  for (size_t c = 0; c < truth.bundle.cameras.size(); ++c) {
    const std::string& name = truth.bundle.cameras[c].name;
    fmt::format_to(out,
                   "  {}: {{segments: {}, rms: {}}}\n",
                   YamlText(name),
                   YamlText(SegmentsName(name)),
                   YamlNumber(truth.rms[c]));
  }
  for (const MountedCamera& camera : context.others) {
    fmt::format_to(out,
                   "  {}: {{segments: {}}}\n",
                   YamlText(camera.name),
                   YamlText(SegmentsName(camera.name)));
  }
  fmt::format_to(out,
                 "points: {}\ncommon_points: {}\nobservations: {}\nconverged: {}\n",
                 truth.points,
                 truth.common,
                 truth.observations,
                 truth.converged);
  fmt::format_to(
      out, "scale: {{source: calibration, sigma: {}}}\n", YamlNumber(truth.covariance.scale_sigma));
  fmt::format_to(out, "track_factor: {}\n", YamlNumber(truth.covariance.track_factor));
  fmt::format_to(out, "floor_of_alignment_error:  # m, of a circle of that length, m\n");
  for (const auto& [length, floor] : AlignmentFloors(truth)) {
    fmt::format_to(out, "  {}: {}\n", length, YamlNumber(floor));
  }
  text +=
      "# Small similarities [x, y, z, w_x, w_y, w_z, scale] of start and end about these centres\n";
  text += "segment_covariance:\n";
  fmt::format_to(out,
                 "  start_centre: {}\n  end_centre: {}\n  matrix:\n",
                 YamlList({start.centre.data(), 3}),
                 YamlList({end.centre.data(), 3}));
  for (Eigen::Index i = 0; i < 14; ++i) {
    const Eigen::Matrix<double, 14, 1> row = truth.covariance.segments.row(i);
    text += "    - " + YamlList({row.data(), 14}) + "\n";
  }
  if (!context.findings.empty()) text += "findings:\n";
  for (const std::string& finding : context.findings) text += "  - " + YamlText(finding) + "\n";
  if (!context.provenance.empty()) text += "provenance:\n";
  for (const auto& [key, value] : context.provenance) {
    fmt::format_to(out, "  {}: {}\n", key, YamlText(value));
  }
  return text;
}

// A segment that does not determine its orientation or scale.
void AddExtentFinding(const char* name, const PathSegment& segment, std::vector<std::string>* all) {
  constexpr double kLineShare = 0.05;  // second extent over the first
  if (segment.extent[0] > 0 && segment.extent[1] >= kLineShare * segment.extent[0]) return;
  all->push_back(fmt::format(
      "the {} segment moves along a line ({:.3g} m long, {:.2g} m across): an alignment with it "
      "leaves the rotation about the line open; move the rig sideways by {:.2g} m or more",
      name,
      segment.extent[0],
      segment.extent[1],
      kLineShare * segment.extent[0]));
}

}  // namespace

std::vector<std::string> FindingsOf(const LoopTruthResult& truth, bool from_images) {
  constexpr double kPoorScale = 0.01;
  constexpr double kStaleSigmas = 4;
  constexpr double kSharedErrors = 2;  // of the variance
  std::vector<std::string> findings;
  AddExtentFinding("start", MakeSegment(truth.bundle, 0, truth.start.frames), &findings);
  AddExtentFinding("end", MakeSegment(truth.bundle, 0, truth.end.frames), &findings);
  if (truth.covariance.scale_sigma > kPoorScale) {
    findings.push_back(fmt::format(
        "the scale is known to {:.2g} % only: the scene is far against the baseline; record a "
        "nearer part of it, or calibrate the rig better",
        100 * truth.covariance.scale_sigma));
  }
  if (truth.most_changed_sigmas > kStaleSigmas) {
    findings.push_back(fmt::format(
        "the calibration is stale: {} differs from it by {:.1f} of its sigmas; calibrate again",
        truth.most_changed,
        truth.most_changed_sigmas));
  }
  if (truth.rival) {
    findings.push_back(fmt::format(
        "the end against the start: {}; something has moved, or the scene repeats itself: more of "
        "such points would leave the end's pose open",
        truth.rival->Text()));
  }
  if (!truth.bundle.prior) {
    findings.emplace_back(
        "the calibration states no standard errors: its parameters were held, and the sigmas given "
        "here leave out their errors");
  }
  if (truth.covariance.track_factor > kSharedErrors) {
    findings.push_back(fmt::format(
        "observations of one track share errors (patches that look different from another side, "
        "points that are none): the standard errors are {:.1f} times those of the noise alone",
        std::sqrt(truth.covariance.track_factor)));
  }
  const auto is_plenoptic = [](const BundleCamera& camera) { return camera.model->plenoptic; };
  if (from_images && std::ranges::all_of(truth.bundle.cameras, is_plenoptic)) {
    findings.emplace_back(
        "the scale is that of depths measured in patches of micro images: systematic errors common to all patches "
        "are not in its standard error and may be some percent; compare it with the truth of "
        "a stereo pair ('plenocal compare'). The end against the start does not depend on it");
  }
  if (!truth.converged) findings.emplace_back("the bundle adjustment has not converged");
  return findings;
}

std::vector<std::pair<double, double>> AlignmentFloors(const LoopTruthResult& truth) {
  const PathSegment start = MakeSegment(truth.bundle, 0, truth.start.frames);
  const PathSegment end = MakeSegment(truth.bundle, 0, truth.end.frames);
  std::vector<std::pair<double, double>> floors;
  for (const double length : kLoopLengths) {
    floors.emplace_back(length, truth.covariance.AlignmentFloor(start, end, Circle(start, length)));
  }
  return floors;
}

std::vector<std::pair<std::string, std::string>> LoopTruthFiles(const LoopTruthResult& truth,
                                                                const LoopTruthContext& context) {
  std::vector<std::pair<std::string, std::string>> files;
  const auto add_paths = [&](const std::string& name, const RigidTransform& T_camera_rig) {
    const auto path = [&](const std::vector<size_t>& frames) {
      return PathText(truth, *context.tracks, T_camera_rig, frames);
    };
    files.emplace_back(SegmentsName(name), path(AllFrames(truth)));
    files.emplace_back("start_" + name + ".txt", path(truth.start.frames));
    files.emplace_back("end_" + name + ".txt", path(truth.end.frames));
  };
  for (const BundleCamera& camera : truth.bundle.cameras) {
    add_paths(camera.name, camera.T_camera_rig);
  }
  for (const MountedCamera& camera : context.others) add_paths(camera.name, camera.T_camera_rig);
  files.emplace_back("covariance.csv", CovarianceCsv(truth, *context.tracks));
  const LandmarkMap map = MakeMap(truth, context.descriptors);
  files.emplace_back("points.ply", PointsPly(map));
  files.emplace_back("points.csv", PointsCsv(map));
  if (!map.descriptors.empty()) files.emplace_back("descriptors.png", DescriptorsPng(map));
  files.emplace_back("groundtruth.yaml", GroundTruthYaml(truth, context));
  return files;
}

std::string LoopTruthSummary(const LoopTruthResult& truth) {
  const Matrix7d relative = truth.covariance.Relative();
  std::string text;
  const auto out = std::back_inserter(text);
  fmt::format_to(out,
                 "start: {} frames, end: {} frames; {} points, {} of them in both; {} "
                 "observations\n",
                 truth.start.frames.size(),
                 truth.end.frames.size(),
                 truth.points,
                 truth.common,
                 truth.observations);
  for (size_t c = 0; c < truth.rms.size(); ++c) {
    fmt::format_to(out, "{}: RMS {:.3f} px\n", truth.bundle.cameras[c].name, truth.rms[c]);
  }
  fmt::format_to(out,
                 "scale: +- {:.3f} %\nend against start: +- {:.2g} mm, {:.2g} mrad, {:.2g} % of "
                 "scale\n",
                 100 * truth.covariance.scale_sigma,
                 1e3 * std::sqrt(relative.topLeftCorner<3, 3>().trace()),
                 1e3 * std::sqrt(relative.block<3, 3>(3, 3).trace()),
                 100 * std::sqrt(relative(6, 6)));
  text += "alignment error of a perfect estimate:";
  for (const auto& [length, floor] : AlignmentFloors(truth)) {
    fmt::format_to(out,
                   " {:.1f} mm over {} m{}",
                   1e3 * floor,
                   length,
                   length == kLoopLengths.back() ? "\n" : ",");
  }
  return text;
}

}  // namespace plenocal
