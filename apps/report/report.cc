// SPDX-License-Identifier: Apache-2.0
#include "apps/report/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>

#include "apps/report/attenuation_map.h"
#include "apps/report/calibration_text.h"
#include "apps/report/micro_lens_sections.h"
#include "apps/report/page.h"
#include "apps/report/residual_sections.h"
#include "calib/camera/marker_id.h"
#include "calib/estimate/calibrate.h"
#include "engine/json/accuracy_json.h"
#include "engine/json/calibration_json.h"
#include "engine/rigs/predict_accuracy.h"

namespace plenocal {
namespace {

using Json = nlohmann::json;

// Rows of name, value and unit.
Json ResidualTable(const CameraFit& fit) {
  Json rows = Json::array({{"RMS reprojection error", AsInFile(fit.rms), "px"},
                           {"points used", fit.points, ""},
                           {"points rejected", fit.rejected, ""},
                           {"images", fit.views, ""},
                           {"noise of one coordinate", AsInFile(fit.noise_sigma), "px"}});
  if (fit.detector_sigma > 0) {
    rows.push_back({"noise stated by the detector", AsInFile(fit.detector_sigma), "px"});
  }
  if (fit.noise_floor) {
    rows.push_back({"noise floor of the affine law", AsInFile(fit.noise_floor->length), "px"});
    if (fit.noise_floor->third_order > 0) {
      rows.push_back(
          {"noise floor with third order", AsInFile(fit.noise_floor->third_order), "px"});
    }
  }
  for (const auto& [type, of_type] : fit.lens_types) {
    rows.push_back({fmt::format("RMS of lens type {}", type), AsInFile(of_type.rms), "px"});
  }
  return rows;
}

std::string SummaryOf(const CalibratedCamera& camera) {
  const CameraFit& fit = camera.fit;
  const std::string detector =
      fit.detector_sigma > 0
          ? fmt::format(", detector {} px", BriefNumber(AsInFile(fit.detector_sigma)))
          : "";
  return fmt::format(
      "{}: reprojection error {} px RMS over {} points in {} images; noise {} px per coordinate{}.",
      camera.name,
      BriefNumber(AsInFile(fit.rms), 4),
      fit.points,
      fit.views,
      BriefNumber(AsInFile(fit.noise_sigma)),
      detector);
}

// Diameter of the disc, px, by which each lens type blurs, at distances around those of the
// markers.
Json LensTypesJson(const CalibrationRecord& calibration, size_t c) {
  const CalibratedCamera& camera = calibration.cameras[c];
  const auto geometry = MicroLensGeometryOf(camera);
  Json types = Json::array();
  if (!geometry || camera.lens_type_optics.empty()) return types;
  double nearest = std::numeric_limits<double>::infinity(), farthest = 0;
  for (const ResidualRow& row : camera.residuals) {
    if (!row.used) continue;
    const double distance =
        (calibration.CameraFromTarget(c, row.frame) * calibration.markers.at(row.marker).position)
            .norm();
    nearest = std::min(nearest, distance);
    farthest = std::max(farthest, distance);
  }
  if (!(farthest > 0)) return types;
  constexpr int kSteps = 100;
  constexpr double kBeyond = 2;     // times the nearest and the farthest marker
  constexpr double kInFront = 1.1;  // of f_L: there is no real image of what is nearer
  const double from = std::max(nearest / kBeyond, kInFront * geometry->f_L);
  const double to = farthest * kBeyond;
  for (const LensTypeOptics& type : camera.lens_type_optics) {
    Json distance = Json::array(), disc = Json::array();
    for (int i = 0; i <= kSteps; ++i) {
      const double z = from * std::pow(to / from, static_cast<double>(i) / kSteps);
      distance.push_back(Short(z));
      disc.push_back(Short(BlurDisc(type, *geometry, z), 3));
    }
    types.push_back({{"type", type.lens_type},
                     {"focal_length", AsInFile(type.focal_length)},
                     {"focal_length_sigma", AsInFile(type.focal_length_sigma)},
                     {"aperture", AsInFile(type.aperture)},
                     {"aperture_sigma", AsInFile(type.aperture_sigma)},
                     {"in_focus", AsInFile(type.in_focus)},
                     {"near", AsInFile(type.near)},
                     {"far", AsInFile(type.far)},
                     {"distance", distance},
                     {"disc", disc}});
  }
  return types;
}

// Who saw what when: of a rig, the frames in which each camera saw each target, and those that two
// cameras have in common.
Json SightingsJson(const CalibrationRecord& calibration) {
  const size_t count = calibration.cameras.size();
  if (count < 2 || calibration.HasScene()) return nullptr;
  std::vector<std::string> targets;
  for (const TargetRecord& target : calibration.targets) targets.push_back(target.name);
  if (targets.empty()) targets.emplace_back("target");
  std::vector<std::vector<std::set<int>>> frames(count, std::vector<std::set<int>>(targets.size()));
  std::vector<std::set<int>> of_camera(count);
  for (size_t c = 0; c < count; ++c) {
    for (const ResidualRow& row : calibration.cameras[c].residuals) {
      const size_t target = targets.size() == 1 ? 0 : MarkerId::FromNumber(row.marker).target;
      if (!row.used || target >= targets.size()) continue;
      frames[c][target].insert(row.frame);
      of_camera[c].insert(row.frame);
    }
  }
  Json seen = Json::array(), common = Json::array();
  for (size_t c = 0; c < count; ++c) {
    Json of_targets = Json::array(), with_others = Json::array();
    for (const std::set<int>& each : frames[c]) of_targets.push_back(each.size());
    for (size_t other = 0; other < count; ++other) {
      with_others.push_back(std::ranges::count_if(
          of_camera[c], [&](int frame) { return of_camera[other].contains(frame); }));
    }
    seen.push_back(std::move(of_targets));
    common.push_back(std::move(with_others));
  }
  return {{"targets", targets}, {"seen", seen}, {"common", common}};
}

Json CorrelationJson(const CalibrationRecord& calibration) {
  Json rows = Json::array();
  for (Eigen::Index i = 0; i < calibration.correlations.matrix.rows(); ++i) {
    Json row = Json::array();
    // Five digits, since 0.9999 and 0.99999 are very different.
    for (Eigen::Index j = 0; j < i; ++j)
      row.push_back(Short(calibration.correlations.matrix(i, j), 5));
    rows.push_back(std::move(row));
  }
  return {{"names", calibration.correlations.names}, {"below_diagonal", rows}};
}

std::string Base64(std::string_view bytes) {
  constexpr std::string_view kBase64Digits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (size_t i = 0; i < bytes.size(); i += 3) {
    unsigned bits = 0;
    for (size_t k = 0; k < 3; ++k) {
      bits = bits << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    }
    for (size_t k = 0; k < 4; ++k) {
      text += i + k <= bytes.size() ? kBase64Digits[bits >> (18 - 6 * k) & 63] : '=';
    }
  }
  return text;
}

// Micro images of each camera; none of ordinary ones.
std::vector<MicroLensVisibility> VisibilityOf(const CalibrationRecord& calibration,
                                              const CameraFiles& files) {
  std::vector<MicroLensVisibility> lenses;
  for (const CalibratedCamera& camera : calibration.cameras) {
    MicroLensVisibility& of_camera = lenses.emplace_back();
    const std::string* csv = files.Find(camera.micro_lenses);
    if (csv == nullptr) continue;
    const MicroLensTable table(*csv, files.Path(camera.micro_lenses));
    if (table.HasLattice()) of_camera = table.Visibility(camera.image_size);
  }
  return lenses;
}

class ReportData {
 public:
  ReportData(const CalibrationRecord& calibration, const CameraFiles& files)
      : calibration_(calibration), files_(files) {}

  Json Make() {
    Json provenance = Json::array();
    for (const auto& [key, value] : calibration_.provenance) provenance.push_back({key, value});
    Json data = CalibrationJson(calibration_);
    data.update(SpaceJson(calibration_));
    data.update({{"kind", "calibration"},
                 {"marker_tolerance",
                  calibration_.adjustment ? calibration_.adjustment->marker_freedom.Sigma() : 0},
                 {"scene", calibration_.HasScene()},
                 {"sightings", SightingsJson(calibration_)},
                 {"correlation", CorrelationJson(calibration_)},
                 {"left_out", calibration_.left_out},
                 {"provenance", provenance}});
    for (size_t c = 0; c < calibration_.cameras.size(); ++c) {
      data["cameras"][calibration_.cameras[c].name].update(CameraSections(c));
    }
    data["accuracy"] =
        AccuracyJson(AccuracyInBrief(calibration_, VisibilityOf(calibration_, files_)));
    return data;
  }

 private:
  [[nodiscard]] Json CameraSections(size_t c) const {
    // Limits over all cameras, so that the page stays small and quick.
    constexpr size_t kMostPoints = 60'000, kMostOfOne = 6'000;
    const CalibratedCamera& camera = calibration_.cameras[c];
    std::vector<int> lens_types;
    Json micro_lenses;
    if (const std::string* csv = files_.Find(camera.micro_lenses)) {
      const MicroLensTable table(*csv, files_.Path(camera.micro_lenses));
      if (camera.model->plenoptic) lens_types = table.TypesOf(camera);
      micro_lenses = table.GridSection(camera.image_size);
    }
    Json vignetting;
    if (const std::string* tiff = files_.Find(camera.vignetting)) {
      const double pitch = micro_lenses.is_null() ? 0 : micro_lenses.at("pitch").get<double>();
      vignetting = VignettingJson(*tiff, files_.Path(camera.vignetting), pitch);
    }
    Json pictures = Json::object();
    for (const auto& [key, name] :
         {std::pair("picture", camera.sample), std::pair("depth", camera.sample_depth)}) {
      if (const std::string* jpeg = files_.Find(name)) {
        pictures[key] = "data:image/jpeg;base64," + Base64(*jpeg);
      }
    }
    return {{"source", camera.model->source},
            {"summary", SummaryOf(camera)},
            {"residual_table", ResidualTable(camera.fit)},
            {"plots",
             ResidualSections(calibration_,
                              c,
                              std::min(kMostOfOne, kMostPoints / calibration_.cameras.size()),
                              lens_types)},
            {"projection", SigmaMapsJson(calibration_, c)},
            {"lens_types", LensTypesJson(calibration_, c)},
            {"vignetting", vignetting},
            {"micro_lenses", micro_lenses},
            {"sample", {{"frame", camera.sample_frame}, {"pictures", pictures}}}};
  }

  const CalibrationRecord& calibration_;
  const CameraFiles& files_;
};

// A session.yaml is named by its folder. The page adds the day by the file's time, so that equal
// inputs give equal bytes.
std::string TitleOf(const CalibrationRecord& calibration) {
  std::filesystem::path session;
  for (const char* key : {"folder", "session"}) {
    const auto found =
        std::ranges::find(calibration.provenance, key, &std::pair<std::string, std::string>::first);
    if (found != calibration.provenance.end()) session /= found->second;
  }
  std::filesystem::path name = session.stem();
  if (name == "session") name = session.parent_path().filename();
  return fmt::format("Calibration{}{}", name.empty() ? "" : " of ", name.string());
}

}  // namespace

std::string ReportHtml(const CalibrationRecord& calibration, const CameraFiles& files) {
  const Json data = ReportData(calibration, files).Make();
  return MakePage(TitleOf(calibration), CalibrationText(data), data);
}

namespace {

CameraFiles FilesOf(const std::filesystem::path& out, const SessionCalibration& calibration) {
  CameraFiles files{out, {}};
  for (const CameraFile& file : calibration.files) files.contents[file.name] = file.content;
  return files;
}

}  // namespace

void AddReport(const std::filesystem::path& out, const Run& run, SessionCalibration* calibration) {
  run.Progress("report");
  const CameraFiles files = FilesOf(out, *calibration);
  if (calibration->target) AddTarget(*calibration->target, &calibration->record);
  std::string html;
  // A calibration is not lost because its report fails.
  try {
    html = ReportHtml(calibration->record, files);
  } catch (const Error& error) {
    run.Message(fmt::format("report.html was not written: {}", error.what()));
    return;
  }
  calibration->folders->out()->Write("report.html", html);
}

std::string AccuracyLines(const std::filesystem::path& out, const SessionCalibration& calibration) {
  std::string text;
  for (const RigAccuracy& accuracy : AccuracyInBrief(
           calibration.record, VisibilityOf(calibration.record, FilesOf(out, calibration)))) {
    // At the farthest marker.
    const auto at =
        std::ranges::min_element(accuracy.distances, {}, [](const AccuracyAtDistance& each) {
          return std::abs(std::log(each.seen_at.value_or(1)));
        });
    text += "  " + AccuracyLine(accuracy, *at) + "\n";
  }
  if (text.empty()) return text;
  return "standard errors in space (more: plenocal accuracy)\n" + text + "\n";
}

}  // namespace plenocal
