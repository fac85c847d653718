// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/run_json.h"

#include <algorithm>
#include <map>
#include <mutex>
#include <set>
#include <utility>
#include <vector>

#include "apps/report/residual_sections.h"
#include "assess/frames/exclusion_preview.h"
#include "assess/frames/frame_influence.h"
#include "calib/base/error.h"
#include "calib/camera/micro_lens_array.h"
#include "calib/files/exclusion.h"
#include "engine/json/accuracy_json.h"
#include "engine/json/calibration_json.h"
#include "engine/rigs/predict_accuracy.h"
#include "engine/session/calibration_folder.h"
#include "engine/suggest/read_rig_estimate.h"

namespace plenocal::workbench {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

}  // namespace

std::shared_ptr<const CalibrationRecord> RecordOf(const fs::path& folder) {
  static std::mutex mutex;
  static fs::path last;
  static fs::file_time_type time;
  static std::shared_ptr<const CalibrationRecord> record;
  const std::lock_guard lock(mutex);
  const auto written = fs::last_write_time(folder / "calibration.yaml");
  if (!record || last != folder || time != written) {
    record = std::make_shared<CalibrationRecord>(OpenCalibrationFolder(folder));
    last = folder;
    time = written;
  }
  return record;
}

Json RunBriefJson(const fs::path& folder, int number) {
  Json brief = {{"run", number}};
  try {
    const CalibrationRecord record = OpenCalibration(folder / "calibration.yaml");
    Json rms = Json::array(), models = Json::array();
    for (const CalibratedCamera& camera : record.cameras) {
      rms.push_back(AsInFile(camera.fit.rms));
      models.push_back(camera.model->name);
    }
    brief.update({{"rms", rms}, {"models", models}});
    if (!record.verdict) return brief;
    brief["grade"] = GradeName(record.verdict->grade);
    double error = 0;
    for (const Finding& finding : record.verdict->findings) {
      if (finding.code == "projection") error = std::max(error, finding.value.value_or(0));
    }
    if (error > 0) brief["projection"] = AsInFile(error);
  } catch (const Error& error) {
    brief["problem"] = error.what();
  }
  return brief;
}

Json RunJson(const fs::path& folder, int number) {
  const auto record = RecordOf(folder);
  Json run = CalibrationJson(*record);
  for (const CalibratedCamera& camera : record->cameras) {
    const auto frame_of = [&](size_t row) { return camera.residuals[row].frame; };
    Json frames = SumsJson(camera, "frame", frame_of);
    for (Json& frame : frames["frame"]) frame = record->frames[frame.get<size_t>()].name;
    run["cameras"][camera.name]["frames"] = frames;
  }
  run.update({{"run", number}, {"left_out", record->left_out}, {"folder", folder.string()}});
  return run;
}

Json PointsJson(const fs::path& folder, const std::string& camera, const std::string& frame) {
  const auto record = RecordOf(folder);
  Json points = Json::array();
  for (const ResidualRow& row : FindCamera(*record, camera).residuals) {
    if (record->frames[static_cast<size_t>(row.frame)].name != frame) continue;
    points.push_back({row.marker,
                      row.values[0],
                      row.values[1],
                      row.residual[0],
                      row.residual[1],
                      row.used ? 1 : 0});
  }
  return {{"camera", camera}, {"frame", frame}, {"points", points}};
}

Json ResidualsJson(const fs::path& folder, const std::string& name) {
  const auto record = RecordOf(folder);
  const CalibratedCamera& camera = FindCamera(*record, name);
  Json markers =
      SumsJson(camera, "marker", [&](size_t row) { return camera.residuals[row].marker; });
  std::map<int, const ResidualRow*> largest;  // null: no used point
  for (const ResidualRow& row : camera.residuals) {
    const ResidualRow*& so_far = largest[row.marker];
    if (!row.used) continue;
    if (so_far == nullptr || row.Error().norm() > so_far->Error().norm()) so_far = &row;
  }
  Json worst = Json::array();
  for (const auto& [marker, row] : largest) {
    worst.push_back(row == nullptr ? "" : record->frames[static_cast<size_t>(row->frame)].name);
  }
  markers["worst"] = worst;
  return {{"markers", markers}, {"field", FieldJson(camera)}};
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
                        {"sigmas", influence.sigmas},
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
      PreviewExclusion(MakeRigEstimate(folder, *record, shape), shape, leaves_out);
  if (preview.points == 0) return nullptr;
  return {{"points", preview.points},
          {"rms", {preview.rms_before, preview.rms_after}},
          {"sigma", {preview.sigma_before, preview.sigma_after}},
          {"sigmas", preview.sigmas},
          {"unknown", preview.unknown}};
}

Json SpaceJson(const fs::path& folder) { return plenocal::SpaceJson(*RecordOf(folder)); }

Json AccuracyJson(const fs::path& folder) {
  const auto record = RecordOf(folder);
  return plenocal::AccuracyJson(AccuracyInBrief(*record, ReadVisibility(folder, *record)));
}

Json DifferenceJson(const CalibrationComparison& comparison) {
  Json maps = Json::array();
  for (size_t c = 0; c < comparison.differences.size(); ++c) {
    const ImageSize size = comparison.a[c].image_size;
    for (const DistanceDifference& at : comparison.differences[c].distances) {
      std::vector<ResidualRow> vectors;
      for (const PixelDifference& pixel : at.pixels) {
        vectors.push_back({.values = {pixel.u_px.x(), pixel.u_px.y()},
                           .residual = {pixel.difference_px.x(), pixel.difference_px.y()}});
      }
      maps.push_back({{"camera", comparison.a[c].name},
                      {"image_size", size},
                      {"distance", at.distance},
                      {"rms", at.all.rms},
                      {"predicted", at.all.predicted},
                      {"differs", at.all.differs},
                      {"field", FieldJson(size, std::move(vectors))}});
    }
  }
  return maps;
}

Json MapsJson(const fs::path& folder, const std::string& name) {
  const auto record = RecordOf(folder);
  const auto camera = std::ranges::find(record->cameras, name, &CalibratedCamera::name);
  if (camera == record->cameras.end()) return Json::array();
  return SigmaMapsJson(*record, static_cast<size_t>(camera - record->cameras.begin()));
}

}  // namespace plenocal::workbench
