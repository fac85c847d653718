// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/run_json.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <utility>
#include <vector>

#include "apps/report/report.h"
#include "apps/report/residual_sections.h"
#include "apps/report/transform_json.h"
#include "apps/report/verdict_json.h"
#include "assess/compare.h"
#include "assess/frames/exclusion_preview.h"
#include "assess/frames/frame_influence.h"
#include "assess/projection_map.h"
#include "assess/verdict.h"
#include "calib/base/error.h"
#include "calib/camera/micro_lens_array.h"
#include "calib/files/calibration_file.h"
#include "calib/files/exclusion.h"
#include "engine/suggest/calibrated_rig.h"
#include "models/registry.h"

namespace plenocal::workbench {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

Json Finite(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

Verdict VerdictOf(const CalibrationRecord& record) {
  return record.verdict ? *record.verdict : Judge(record);
}

// Reading residuals of a large run takes a second: the last one is kept.
std::shared_ptr<const CalibrationRecord> RecordOf(const fs::path& folder) {
  static std::mutex mutex;
  static fs::path last;
  static fs::file_time_type time;
  static std::shared_ptr<const CalibrationRecord> record;
  const std::lock_guard lock(mutex);
  const auto written = fs::last_write_time(folder / "calibration.yaml");
  if (!record || last != folder || time != written) {
    record = std::make_shared<CalibrationRecord>(ReadCalibrationFolder(folder, CameraModels()));
    last = folder;
    time = written;
  }
  return record;
}

struct FrameSums {
  int used = 0, rejected = 0;
  double squares = 0;
};

Json FramesJson(const CalibrationRecord& record, const CalibratedCamera& camera) {
  std::map<int, FrameSums> frames;
  for (const ResidualRow& row : camera.residuals) {
    FrameSums& sums = frames[row.frame];
    row.used ? ++sums.used : ++sums.rejected;
    if (row.used) sums.squares += row.Error().squaredNorm();
  }
  Json list = Json::array();
  for (const auto& [frame, sums] : frames) {
    list.push_back({{"frame", record.frames[static_cast<size_t>(frame)].name},
                    {"points", sums.used},
                    {"rejected", sums.rejected},
                    {"rms", sums.used > 0 ? Json(std::sqrt(sums.squares / sums.used)) : nullptr}});
  }
  return list;
}

Json CameraJson(const CalibrationRecord& record, const CalibratedCamera& camera) {
  Json parameters = Json::array();
  for (size_t k = 0; k < camera.params.size(); ++k) {
    const Param& param = camera.model->params[k];
    if (param.prior_sigma > 0) continue;
    parameters.push_back({{"name", param.name},
                          {"unit", param.unit},
                          {"value", camera.params[k]},
                          {"sigma", Finite(camera.Sigma(k))}});
  }
  return {{"name", camera.name},
          {"model", camera.model->name},
          {"plenoptic", camera.model->plenoptic},
          {"image_size", camera.image_size},
          {"parameters", parameters},
          {"rms", Finite(camera.fit.rms)},
          {"noise", Finite(camera.fit.noise_sigma)},
          {"detector_sigma", Finite(camera.fit.detector_sigma)},
          {"points", camera.fit.points},
          {"rejected", camera.fit.rejected},
          {"frames", FramesJson(record, camera)}};
}

}  // namespace

Json RunBriefJson(const fs::path& folder, int number) {
  Json brief = {{"run", number}};
  try {
    const CalibrationRecord record = ReadCalibration(folder / "calibration.yaml", CameraModels());
    Json rms = Json::array();
    for (const CalibratedCamera& camera : record.cameras) rms.push_back(Finite(camera.fit.rms));
    brief["rms"] = rms;
    if (record.verdict) brief["grade"] = GradeName(record.verdict->grade);
  } catch (const Error& error) {
    brief["problem"] = error.what();
  }
  return brief;
}

Json RunJson(const fs::path& folder, int number) {
  const auto record = RecordOf(folder);
  const Verdict verdict = VerdictOf(*record);
  Json judged = VerdictJson(verdict);
  judged["headline"] = Headline(verdict);
  Json cameras = Json::array();
  for (const CalibratedCamera& camera : record->cameras) {
    cameras.push_back(CameraJson(*record, camera));
  }
  return {{"run", number},
          {"verdict", judged},
          {"cameras", cameras},
          {"left_out", record->left_out},
          {"folder", folder.string()}};
}

Json PointsJson(const fs::path& folder, const std::string& camera, const std::string& frame) {
  const auto record = RecordOf(folder);
  Json points = Json::array();
  for (const ResidualRow& row : FindCamera(*record, camera).residuals) {
    if (record->frames[static_cast<size_t>(row.frame)].name != frame) continue;
    points.push_back({row.marker,
                      row.values[0],
                      row.values[1],
                      Finite(row.residual[0]),
                      Finite(row.residual[1]),
                      row.used ? 1 : 0});
  }
  return {{"camera", camera}, {"frame", frame}, {"points", points}};
}

Json ResidualsJson(const fs::path& folder, const std::string& camera) {
  struct OfMarker {
    FrameSums sums;
    double largest = -1;  // squared, px^2
    int frame = 0;        // that has it
  };
  const auto record = RecordOf(folder);
  const CalibratedCamera& of_camera = FindCamera(*record, camera);
  std::map<int, OfMarker> by_number;
  for (const ResidualRow& row : of_camera.residuals) {
    OfMarker& marker = by_number[row.marker];
    row.used ? ++marker.sums.used : ++marker.sums.rejected;
    if (!row.used) continue;
    const double square = row.Error().squaredNorm();
    marker.sums.squares += square;
    if (square > marker.largest) marker.largest = square, marker.frame = row.frame;
  }
  Json markers = Json::array();
  for (const auto& [number, marker] : by_number) {
    const FrameSums& sums = marker.sums;
    if (sums.used == 0) continue;
    markers.push_back({{"marker", number},
                       {"points", sums.used},
                       {"rejected", sums.rejected},
                       {"rms", std::sqrt(sums.squares / sums.used)},
                       {"worst", record->frames[static_cast<size_t>(marker.frame)].name}});
  }
  return {{"markers", markers}, {"field", FieldJson(FieldOf(of_camera))}};
}

Json LensesJson(const fs::path& folder, const std::string& camera, const fs::path& micro_lenses) {
  const MicroLensArray array =
      ReadMicroLenses(micro_lenses, FindCamera(*RecordOf(folder), camera).image_size);
  Json centres = Json::array();
  for (const MicroLens& lens : array.lenses) {
    centres.push_back({lens.centre.x(), lens.centre.y(), lens.type});
  }
  return {{"pitch", array.Pitch()}, {"centres", centres}};
}

Json InfluenceJson(const fs::path& folder) {
  const auto record = RecordOf(folder);
  Json frames = Json::array();
  try {
    for (const FrameInfluence& influence : FrameInfluences(*record)) {
      frames.push_back({{"frame", record->frames[static_cast<size_t>(influence.frame)].name},
                        {"sigmas", Finite(influence.sigmas)},
                        {"unknown", influence.unknown}});
    }
  } catch (const Error& error) {
    return {{"frames", frames}, {"why", error.what()}};
  }
  return {{"frames", frames}, {"why", nullptr}};
}

Json PreviewJson(const fs::path& folder, const Session& session, const ImagesOf& images_of) {
  const auto record = RecordOf(folder);
  if (record->HasScene()) return nullptr;
  // By camera: frames and markers that the session keeps.
  std::vector<std::set<std::pair<int, int>>> kept(record->cameras.size());
  Exclusion exclusion(session.exclude);
  for (size_t c = 0; c < record->cameras.size(); ++c) {
    const CalibratedCamera& camera = record->cameras[c];
    std::map<std::string, int> index;
    std::map<std::string, View> of_frames;
    for (const ResidualRow& row : camera.residuals) {
      const std::string& name = record->frames[static_cast<size_t>(row.frame)].name;
      index[name] = row.frame;
      View& view = of_frames[name];
      view.frame = name;
      view.observations.push_back({.marker = row.marker});
    }
    std::vector<View> views;
    for (auto& [name, view] : of_frames) views.push_back(std::move(view));
    std::vector<LeftOut> left_out;
    exclusion.RemoveViews(camera.name, images_of(camera.name), &views, &left_out);
    for (const View& view : views) {
      for (const Observation& seen : view.observations) {
        kept[c].emplace(index[view.frame], seen.marker);
      }
    }
  }
  const auto leaves_out = [&](const BundleObservation& each) {
    return !kept[static_cast<size_t>(each.camera)].contains({each.frame, each.seen.marker});
  };
  ViewTarget shape;
  for (const auto& [number, marker] : record->markers) shape.markers[number] = marker.position;
  const ExclusionPreview preview =
      PreviewExclusion(KnowledgeOf(folder, *record, shape), shape, leaves_out);
  if (preview.points == 0) return nullptr;
  return {{"points", preview.points},
          {"rms", {preview.rms_before, preview.rms_after}},
          {"sigma", {Finite(preview.sigma_before), Finite(preview.sigma_after)}},
          {"sigmas", Finite(preview.sigmas)},
          {"unknown", preview.unknown}};
}

Json SpaceJson(const fs::path& folder) {
  const auto record = RecordOf(folder);
  Json markers = Json::array(), displacements = Json::array();
  Json cameras = Json::array(), frames = Json::array();
  const bool refined = record->adjustment && record->adjustment->marker_sigma > 0;
  for (const auto& [number, marker] : record->markers) {
    markers.push_back(VectorJson(marker.position));
    if (!refined) continue;
    displacements.push_back(VectorJson(marker.position - marker.nominal.value_or(marker.position)));
  }
  for (const CalibratedCamera& camera : record->cameras) {
    cameras.push_back({{"name", camera.name},
                       {"image_size", camera.image_size},
                       {"T_rig_camera", TransformJson(camera.T_camera_rig.Inverse())}});
  }
  for (const FrameRecord& frame : record->frames) {
    frames.push_back({{"name", frame.name}, {"T_target_rig", TransformJson(frame.T_target_rig)}});
  }
  return {{"markers", markers},
          {"displacements", displacements},
          {"cameras", cameras},
          {"frames", frames}};
}

namespace {

// The pixels as `FieldJson` has a field.
Json DifferenceField(const DistanceDifference& difference, ImageSize size) {
  constexpr size_t kCells = size_t{kComparedColumns} * kComparedRows;
  std::vector<int> points(kCells, 0);
  std::vector<Json> x(kCells), y(kCells), length(kCells);
  for (const PixelDifference& pixel : difference.pixels) {
    const auto column = static_cast<size_t>((pixel.u_px.x() + 0.5) * kComparedColumns / size[0]);
    const auto row = static_cast<size_t>((pixel.u_px.y() + 0.5) * kComparedRows / size[1]);
    const size_t cell = row * kComparedColumns + column;
    if (cell >= kCells) continue;
    points[cell] = 1;
    x[cell] = Short(pixel.difference_px.x());
    y[cell] = Short(pixel.difference_px.y());
    length[cell] = Short(pixel.difference_px.norm());
  }
  return {{"columns", kComparedColumns},
          {"rows", kComparedRows},
          {"points", points},
          {"mean_x", x},
          {"mean_y", y},
          {"rms", length}};
}

}  // namespace

Json DifferenceJson(const fs::path& a, const fs::path& b) {
  const auto first = RecordOf(a);
  const auto second = RecordOf(b);
  Json maps = Json::array();
  for (const CalibratedCamera& camera : first->cameras) {
    const auto other = std::ranges::find(second->cameras, camera.name, &CalibratedCamera::name);
    if (other == second->cameras.end()) continue;
    try {
      constexpr double kFar = std::numeric_limits<double>::infinity();
      for (const DistanceDifference& at : CompareCameras(camera, *other, {1, kFar}).distances) {
        maps.push_back({{"camera", camera.name},
                        {"image_size", camera.image_size},
                        {"distance", Finite(at.distance)},
                        {"rms", Finite(at.all.rms)},
                        {"predicted", Finite(at.all.predicted)},
                        {"differs", at.all.differs},
                        {"field", DifferenceField(at, camera.image_size)}});
      }
    } catch (const Error&) {
      // Its words are in what `plenocal compare` prints.
    }
  }
  return maps;
}

Json MapsJson(const fs::path& folder, const std::string& name) {
  const auto record = RecordOf(folder);
  Json maps = Json::array();
  for (size_t c = 0; c < record->cameras.size(); ++c) {
    if (record->cameras[c].name != name) continue;
    for (const ProjectionMap& map : ProjectionMaps(*record, c)) {
      Json sigma = Json::array();
      for (const double value : map.sigma) sigma.push_back(Finite(value));
      maps.push_back({{"distance", map.distance},
                      {"columns", map.grid.Columns()},
                      {"rows", map.grid.Rows()},
                      {"sigma", sigma}});
    }
  }
  return maps;
}

}  // namespace plenocal::workbench
