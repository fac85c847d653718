// SPDX-License-Identifier: Apache-2.0
#include "apps/report/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "apps/report/micro_lens_sections.h"
#include "apps/report/page.h"
#include "apps/report/page_parts.h"
#include "apps/report/precision.h"
#include "apps/report/residual_sections.h"
#include "apps/report/verdict.h"
#include "calib/error.h"

namespace plenocal {
namespace {

using Json = nlohmann::json;

Json Vector(const Eigen::Vector3d& v) {
  return {Short(v.x(), 7), Short(v.y(), 7), Short(v.z(), 7)};
}

Json Transform(const RigidTransform& T) {
  Json rows = Json::array();
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) rows.push_back(Short(T.R(r, c), 6));
  }
  return {{"R", rows}, {"t", Vector(T.t)}};
}

const char* GradeName(Grade grade) {
  switch (grade) {
    case Grade::kGood:
      return "good";
    case Grade::kWeak:
      return "weak";
    case Grade::kBad:
      return "bad";
  }
  return "";
}

Json VerdictJson(const Verdict& verdict) {
  Json findings = Json::array();
  for (const Finding& finding : verdict.findings) {
    findings.push_back(
        {{"grade", GradeName(finding.grade)}, {"what", finding.what}, {"remedy", finding.remedy}});
  }
  return {
      {"grade", GradeName(verdict.grade)}, {"headline", verdict.headline}, {"findings", findings}};
}

// Infinite numbers become null; the page says "not determined".
Json Numbers(std::span<const double> values) {
  Json list = Json::array();
  for (const double value : values) list.push_back(std::isfinite(value) ? Json(value) : Json());
  return list;
}

Json ParametersJson(const CameraResult& camera) {
  Json parameters = Json::array();
  for (size_t i = 0; i < camera.params.size(); ++i) {
    const Param& param = camera.model->params[i];
    if (param.prior_sigma > 0) continue;
    parameters.push_back(
        {{"name", param.name},
         {"unit", param.unit},
         {"value", camera.params[i]},
         {"sigma", std::isfinite(camera.Sigma(i)) ? Json(camera.Sigma(i)) : Json()},
         {"held", camera.Sigma(i) == 0}});
  }
  return parameters;
}

Json FitJson(const CameraResult& camera) {
  Json fit = {{"points", camera.points},
              {"rejected", camera.rejected},
              {"views", camera.views},
              {"rms", camera.rms},
              {"noise", camera.noise},
              {"rms_by_type", camera.rms_by_type}};
  if (camera.stated_sigma) fit["detector_sigma"] = *camera.stated_sigma;
  if (camera.floor) fit["floor"] = *camera.floor;
  return fit;
}

Json MapsJson(const std::vector<ProjectionMap>& maps) {
  Json list = Json::array();
  for (const ProjectionMap& map : maps) {
    Json sigma = Json::array();
    for (const double value : map.sigma) sigma.push_back(Short(value, 3));
    list.push_back({{"distance", Short(map.distance)},
                    {"columns", map.grid.Columns()},
                    {"rows", map.grid.Rows()},
                    {"sigma", sigma}});
  }
  return list;
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

// A cross section with at most `most` points: means of neighbours.
Json Section(const std::vector<float>& values) {
  constexpr size_t kMost = 2000;
  const size_t step = (values.size() + kMost - 1) / kMost;
  Json section = Json::array();
  for (size_t i = 0; i < values.size(); i += step) {
    const size_t end = std::min(values.size(), i + step);
    double sum = 0;
    for (size_t k = i; k < end; ++k) sum += values[k];
    section.push_back(Short(sum / static_cast<double>(end - i), 3));
  }
  return {{"step", step}, {"values", section}};
}

// `pitch` of the micro images, px; 0: there are none.
Json VignettingJson(const AttenuationMap& map, double pitch) {
  Json values = Json::array();
  for (const float value : map.values) values.push_back(Short(value, 3));
  Json json = {{"columns", map.columns},
               {"rows", map.rows},
               {"values", values},
               {"row", Section(map.middle_row)},
               {"column", Section(map.middle_column)}};
  if (pitch > 0) {
    // So many micro images that their profiles can be seen.
    constexpr double kShown = 8;
    const double middle = static_cast<double>(map.middle_row.size()) / 2;
    const auto first = static_cast<size_t>(std::max(0.0, middle - kShown / 2 * pitch));
    const auto last = std::min(map.middle_row.size(), first + static_cast<size_t>(kShown * pitch));
    Json detail = Json::array();
    for (size_t x = first; x < last; ++x) detail.push_back(Short(map.middle_row[x], 3));
    json["detail"] = {{"first", first}, {"values", detail}};
  }
  return json;
}

// Where markers came to lie against their nominal places.
Json MarkersJson(const Results& results) {
  Json markers = Json::array();
  for (const auto& [number, place] : results.markers) {
    Json marker = {{"number", number}, {"place", Vector(place)}};
    const auto nominal = results.nominal_markers.find(number);
    const auto sigma = results.marker_sigma.find(number);
    // Markers without sigma were not seen.
    if (results.marker_tolerance > 0 && nominal != results.nominal_markers.end() &&
        sigma != results.marker_sigma.end()) {
      marker["moved"] = Vector(place - nominal->second);
      marker["sigma"] = Vector(sigma->second);
    }
    markers.push_back(std::move(marker));
  }
  return markers;
}

Json CorrelationJson(const Results& results) {
  Json rows = Json::array();
  for (Eigen::Index i = 0; i < results.correlations.matrix.rows(); ++i) {
    Json row = Json::array();
    // 0.9999 and 0.99999 are worlds apart.
    for (Eigen::Index j = 0; j < i; ++j) row.push_back(Short(results.correlations.matrix(i, j), 5));
    rows.push_back(std::move(row));
  }
  return {{"names", results.correlations.names}, {"below_diagonal", rows}};
}

std::string Base64(std::string_view bytes) {
  constexpr std::string_view kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (size_t i = 0; i < bytes.size(); i += 3) {
    unsigned bits = 0;
    for (size_t k = 0; k < 3; ++k) {
      bits = bits << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    }
    for (size_t k = 0; k < 4; ++k) {
      text += i + k <= bytes.size() ? kDigits[bits >> (18 - 6 * k) & 63] : '=';
    }
  }
  return text;
}

class ReportData {
 public:
  ReportData(const ResultFiles& files,
             const std::string& folder,
             const AttenuationReader& read_attenuation)
      : files_(files),
        folder_(folder),
        read_attenuation_(read_attenuation),
        results_(ReadResults(files, folder)) {}

  Json Make() {
    std::vector<std::vector<ProjectionMap>> maps;
    Json cameras = Json::array(), frames = Json::array();
    for (size_t c = 0; c < results_.cameras.size(); ++c) {
      maps.push_back(ProjectionMaps(results_, c));
      cameras.push_back(CameraJson(c, maps.back()));
    }
    for (size_t f = 0; f < results_.frames.size(); ++f) {
      frames.push_back(
          {{"name", results_.frames[f]}, {"T_target_rig", Transform(results_.T_target_rig[f])}});
    }
    Json provenance = Json::array();
    for (const auto& [key, value] : results_.provenance) provenance.push_back({key, value});
    return {{"verdict", VerdictJson(Judge(results_, maps))},
            {"cameras", cameras},
            {"frames", frames},
            {"markers", MarkersJson(results_)},
            {"marker_tolerance", results_.marker_tolerance},
            {"correlation", CorrelationJson(results_)},
            {"left_out", results_.left_out},
            {"provenance", provenance}};
  }

 private:
  Json CameraJson(size_t c, const std::vector<ProjectionMap>& maps) const {
    // All cameras together, so that the page stays small and quick.
    constexpr size_t kMostPoints = 60'000, kMostOfOne = 6'000, kMostPrecisions = 600;
    const CameraResult& camera = results_.cameras[c];
    std::vector<int> lens_types;
    Json micro_lenses = Json::object();
    if (const std::string* csv = File(camera.micro_lenses)) {
      const MicroLensTable table(*csv, folder_ + "/" + camera.micro_lenses);
      if (camera.model->context.size() == 2) lens_types = table.TypesOf(camera);
      micro_lenses = table.GridSection(camera.image_size);
    }
    Json vignetting = Json::object();
    if (const std::string* tiff = File(camera.vignetting)) {
      // In blocks larger than micro images, these do not show as a moire.
      constexpr double kCells = 96, kBlock = 1.25;
      const double pitch = micro_lenses.value("pitch", 0.0);
      const double most =
          pitch > 0 ? std::max(camera.image_size[0], camera.image_size[1]) / (kBlock * pitch)
                    : kCells;
      vignetting = VignettingJson(read_attenuation_(*tiff,
                                                    folder_ + "/" + camera.vignetting,
                                                    static_cast<int>(std::min(kCells, most)) + 1),
                                  pitch);
    }
    Json pictures = Json::object();
    for (const auto& [key, name] :
         {std::pair("picture", camera.sample), std::pair("depth", camera.sample_depth)}) {
      if (const std::string* jpeg = File(name)) {
        pictures[key] = "data:image/jpeg;base64," + Base64(*jpeg);
      }
    }
    return {
        {"name", camera.name},
        {"model", camera.model->name},
        {"source", camera.model->source},
        {"image_size", camera.image_size},
        {"parameters", ParametersJson(camera)},
        {"coefficients",
         std::ranges::count_if(camera.model->params,
                               [](const Param& param) { return param.prior_sigma > 0; })},
        {"T_camera_rig", Transform(camera.T_camera_rig)},
        {"xi_camera_rig", Numbers(camera.xi)},
        {"sigma_xi", Numbers({camera.sigma_xi.data(), 6})},
        {"residuals", FitJson(camera)},
        {"plots",
         ResidualSections(
             results_, c, std::min(kMostOfOne, kMostPoints / results_.cameras.size()), lens_types)},
        {"projection", MapsJson(maps)},
        {"distance", PrecisionJson(DistancePrecisions(results_, c, kMostPrecisions))},
        {"vignetting", vignetting},
        {"micro_lenses", micro_lenses},
        {"sample", {{"frame", camera.sample_frame}, {"pictures", pictures}}}};
  }

  [[nodiscard]] const std::string* File(const std::string& name) const {
    const auto found = files_.find(name);
    return name.empty() || found == files_.end() ? nullptr : &found->second;
  }

  const ResultFiles& files_;
  const std::string& folder_;
  const AttenuationReader& read_attenuation_;
  Results results_;
};

}  // namespace

std::string ReportHtml(const ResultFiles& files,
                       const std::string& folder,
                       const AttenuationReader& read_attenuation) {
  return MakePage("Calibration report",
                  {kSceneJs, kPageJs},
                  ReportData(files, folder, read_attenuation).Make());
}

ResultFiles ReadResultFiles(const std::filesystem::path& folder) {
  ResultFiles files;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    const bool is_read = name == "calibration.yaml" || name == "target.yaml" ||
                         name == "poses.csv" || name == "view_poses.csv" ||
                         name == "residuals.csv" || name == "correlations.csv" ||
                         name.starts_with("micro_lenses_") || name.starts_with("vignetting_") ||
                         name.starts_with("sample_") || name.starts_with("virtual_depth_");
    if (!is_read || !entry.is_regular_file(error)) continue;
    std::ifstream file(entry.path(), std::ios::binary);
    std::ostringstream text;
    text << file.rdbuf();
    if (!file) throw Error(ErrorKind::kInput, entry.path().string() + ": cannot be read");
    files[name] = std::move(text).str();
  }
  if (error) {
    throw Error(
        ErrorKind::kInput,
        fmt::format("{}: no folder that can be read; give the one that 'plenocal calibrate' "
                    "wrote",
                    folder.string()));
  }
  return files;
}

}  // namespace plenocal
