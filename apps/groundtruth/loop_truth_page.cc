// SPDX-License-Identifier: Apache-2.0
#include "apps/groundtruth/loop_truth_page.h"

#include <fmt/format.h>

#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "apps/report/page.h"
#include "engine/json/calibration_json.h"

namespace plenocal {
namespace {

using Json = nlohmann::json;

// A cloud of more points is no clearer.
constexpr size_t kMostPoints = 8000;

// Which segments show each marker.
struct Sightings {
  std::vector<bool> start, end;

  [[nodiscard]] bool Common(size_t marker) const { return start[marker] && end[marker]; }
  [[nodiscard]] bool Any(size_t marker) const { return start[marker] || end[marker]; }
};

Sightings FindSightings(const LoopTruthResult& truth) {
  const std::set<size_t> start(truth.start.frames.begin(), truth.start.frames.end());
  Sightings seen{std::vector<bool>(truth.bundle.markers.size(), false), {}};
  seen.end = seen.start;
  for (const BundleObservation& observation : truth.bundle.observations) {
    if (!observation.used) continue;
    const bool of_start = start.contains(static_cast<size_t>(observation.frame));
    (of_start ? seen.start : seen.end)[static_cast<size_t>(observation.marker)] = true;
  }
  return seen;
}

Json MarkersJson(const LoopTruthResult& truth, const Sightings& seen) {
  size_t count = 0;
  for (size_t m = 0; m < seen.start.size(); ++m) count += seen.Any(m) ? 1 : 0;
  const size_t step = 1 + count / kMostPoints;
  Json markers = Json::array();
  size_t i = 0;
  for (size_t m = 0; m < seen.start.size(); ++m) {
    if (!seen.Any(m) || i++ % step != 0) continue;
    markers.push_back(
        {{"place", VectorJson(truth.bundle.markers[m].position)}, {"common", seen.Common(m)}});
  }
  return markers;
}

struct FrameSums {
  size_t observations = 0, common = 0;
  double square = 0;
};

Json FramesJson(const LoopTruthResult& truth, const SceneTracks& tracks, const Sightings& seen) {
  std::map<size_t, FrameSums> sums;
  for (const BundleObservation& observation : truth.bundle.observations) {
    double residual[kMaxObservationSize];
    if (!observation.used || !Residual(truth.bundle, observation, residual)) continue;
    FrameSums& frame = sums[static_cast<size_t>(observation.frame)];
    ++frame.observations;
    frame.common += seen.Common(static_cast<size_t>(observation.marker)) ? 1 : 0;
    const auto c = static_cast<size_t>(observation.camera);
    for (size_t r = 0; r < truth.bundle.cameras[c].model->measured.size(); ++r) {
      frame.square += residual[r] * residual[r];
    }
  }
  Json frames = Json::array();
  for (const auto& [frame, sum] : sums) {
    frames.push_back({{"name", tracks.frames[frame]},
                      {"T_target_rig", TransformJson(truth.bundle.T_rig_target[frame].Inverse())},
                      {"observations", sum.observations},
                      {"common", sum.common},
                      {"rms", std::sqrt(sum.square / static_cast<double>(sum.observations))},
                      {"position_sigma",
                       std::sqrt(truth.covariance.poses[frame].topLeftCorner<3, 3>().trace())}});
  }
  return frames;
}

Json SegmentJson(const LoopTruthResult& truth,
                 const SegmentTruth& segment,
                 const SceneTracks& tracks) {
  const PathSegment path = MakeSegment(truth.bundle, 0, segment.frames);
  Json frames = Json::array(), places = Json::array();
  for (const size_t frame : segment.frames) frames.push_back(tracks.frames[frame]);
  for (const Eigen::Vector3d& p : path.positions) places.push_back(VectorJson(p));
  return {{"frames", frames},
          {"left_out", segment.left_out.size()},
          {"extent", VectorJson(path.extent)},
          {"path", places}};
}

}  // namespace

std::string LoopTruthPage(const LoopTruthResult& truth, const LoopTruthContext& context) {
  const SceneTracks& tracks = *context.tracks;
  const Sightings seen = FindSightings(truth);
  const Matrix7d relative = truth.covariance.Relative();
  Json cameras = Json::array(), floors = Json::array();
  for (size_t c = 0; c < truth.bundle.cameras.size(); ++c) {
    const BundleCamera& camera = truth.bundle.cameras[c];
    cameras.push_back({{"name", camera.name},
                       {"image_size", camera.image_size},
                       {"rms", truth.rms[c]},
                       {"T_rig_camera", TransformJson(camera.T_camera_rig.Inverse())}});
  }
  for (const auto& [length, floor] : AlignmentFloors(truth)) floors.push_back({length, floor});
  const double position = std::sqrt(relative.topLeftCorner<3, 3>().trace()),
               rotation = std::sqrt(relative.block<3, 3>(3, 3).trace()),
               scale = std::sqrt(relative(6, 6));
  const std::string headline =
      fmt::format("End against start: ± {} mm, ± {} mrad, ± {} % of scale; absolute scale ± {} %",
                  BriefNumber(1e3 * position, 2),
                  BriefNumber(1e3 * rotation, 2),
                  BriefNumber(100 * scale, 2),
                  BriefNumber(100 * truth.covariance.scale_sigma, 2));
  PageText text;
  text.Box(context.findings.empty() ? "good" : "usable", headline, context.findings);
  const Json data{{"kind", "truth"},
                  {"headline", headline},
                  {"findings", context.findings},
                  {"cameras", cameras},
                  {"frames", FramesJson(truth, tracks, seen)},
                  {"markers", MarkersJson(truth, seen)},
                  {"truth",
                   {{"points", truth.points},
                    {"common", truth.common},
                    {"observations", truth.observations},
                    {"floors", floors},
                    {"segments",
                     {{"start", SegmentJson(truth, truth.start, tracks)},
                      {"end", SegmentJson(truth, truth.end, tracks)}}}}}};
  return MakePage("Ground truth of a loop", text, data);
}

}  // namespace plenocal
