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
#include "assess/projection_map.h"
#include "calib/camera/marker_id.h"
#include "calib/estimate/calibrate.h"
#include "engine/json/calibration_json.h"

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

Json PrecisionJson(const std::vector<DistancePrecision>& precisions) {
  Json distance = Json::array(), calibration = Json::array(), noise = Json::array();
  for (const DistancePrecision& each : precisions) {
    distance.push_back(Short(each.distance));
    calibration.push_back(Short(each.calibration, 3));
    noise.push_back(Short(each.noise, 3));
  }
  return {{"distance", distance}, {"calibration", calibration}, {"noise", noise}};
}

// Diameter of the disc, px, by which each lens type blurs, at distances around those of the
// markers.
Json LensTypesJson(const CalibratedCamera& camera, const std::vector<DistancePrecision>& markers) {
  const auto geometry = MicroLensGeometryOf(camera);
  Json types = Json::array();
  if (!geometry || camera.lens_type_optics.empty() || markers.empty()) return types;
  constexpr int kSteps = 100;
  constexpr double kBeyond = 2;     // times the nearest and the farthest marker
  constexpr double kInFront = 1.1;  // of f_L: there is no real image of what is nearer
  const double from = std::max(markers.front().distance / kBeyond, kInFront * geometry->f_L);
  const double to = markers.back().distance * kBeyond;
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
    return data;
  }

 private:
  [[nodiscard]] Json CameraSections(size_t c) const {
    // Limits over all cameras, so that the page stays small and quick.
    constexpr size_t kMostPoints = 60'000, kMostOfOne = 6'000, kMostPrecisions = 600;
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
    const std::vector<DistancePrecision> precisions =
        DistancePrecisions(calibration_, c, kMostPrecisions);
    return {{"source", camera.model->source},
            {"summary", SummaryOf(camera)},
            {"residual_table", ResidualTable(camera.fit)},
            {"plots",
             ResidualSections(calibration_,
                              c,
                              std::min(kMostOfOne, kMostPoints / calibration_.cameras.size()),
                              lens_types)},
            {"projection", SigmaMapsJson(calibration_, c)},
            {"distance", PrecisionJson(precisions)},
            {"lens_types", LensTypesJson(camera, precisions)},
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

void AddReport(const std::filesystem::path& out, const Run& run, SessionCalibration* calibration) {
  run.Progress("report");
  CameraFiles files{out, {}};
  for (const CameraFile& file : calibration->files) files.contents[file.name] = file.content;
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

}  // namespace plenocal
