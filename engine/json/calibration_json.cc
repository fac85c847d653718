// SPDX-License-Identifier: Apache-2.0
#include "engine/json/calibration_json.h"

#include <cmath>
#include <string>
#include <utility>

#include "assess/projection_map.h"
#include "assess/residual_field.h"
#include "assess/verdict.h"
#include "calib/base/number_text.h"
#include "calib/rig/extrinsics.h"

namespace plenocal {
namespace {

using Json = nlohmann::json;

Json CameraJson(const CalibratedCamera& camera, size_t index, const Correlations& correlations) {
  Json parameters = Json::object(), sigma = Json::object(), units = Json::array();
  Json extrinsics = Json::array();
  for (size_t k = 0; k < camera.params.size(); ++k) {
    const Param& param = camera.model->params[k];
    const std::string name(param.name);
    parameters[name] = camera.params[k];
    sigma[name] = AsInFile(camera.Sigma(k));
    if (!(param.prior_sigma > 0)) units.push_back({name, param.unit});
  }
  for (const Extrinsic& each : ExtrinsicsOf(camera, correlations)) {
    extrinsics.push_back({{"name", each.name},
                          {"unit", each.unit},
                          {"value", Short(each.value, 9)},
                          {"sigma", Short(each.sigma, 6)}});
  }
  constexpr int kAllDigits = 12;
  const CameraFit& fit = camera.fit;
  return {{"name", camera.name},
          {"index", index},
          {"model", camera.model->name},
          {"plenoptic", camera.model->plenoptic},
          {"image_size", camera.image_size},
          {"parameters", parameters},
          {"sigma", sigma},
          {"units", units},
          {"T_rig_camera", TransformJson(camera.T_camera_rig.Inverse(), kAllDigits)},
          {"extrinsics", extrinsics},
          {"rms", AsInFile(fit.rms)},
          {"noise", AsInFile(fit.noise_sigma)},
          {"detector_sigma", fit.detector_sigma > 0 ? AsInFile(fit.detector_sigma) : Json()},
          {"points", fit.points},
          {"rejected", fit.rejected},
          {"views", fit.views}};
}

}  // namespace

Json AsInFile(double value) {
  if (!std::isfinite(value)) return nullptr;
  return *ParseDouble(YamlNumber(value));
}

Json Short(double value, int digits) {
  if (!std::isfinite(value)) return nullptr;
  if (value == 0) return 0;
  const double scale = std::pow(10, digits - 1 - std::floor(std::log10(std::abs(value))));
  // Dividing by a power of ten gives the double nearest to the short decimal number.
  return scale >= 1 ? std::round(value * scale) / scale
                    : std::round(value * scale) * std::round(1 / scale);
}

Json VectorJson(const Eigen::Vector3d& v) {
  constexpr int kDigits = 7;
  return {Short(v.x(), kDigits), Short(v.y(), kDigits), Short(v.z(), kDigits)};
}

Json TransformJson(const RigidTransform& T, int digits) {
  Json rows = Json::array();
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) rows.push_back(Short(T.R(r, c), digits - 1));
    rows.push_back(Short(T.t[r], digits));
  }
  return rows;
}

Json VerdictJson(const Verdict& verdict) {
  const auto number = [](const std::optional<double>& value) {
    return value ? AsInFile(*value) : Json();
  };
  Json findings = Json::array();
  for (const Finding& finding : verdict.findings) {
    findings.push_back({{"code", finding.code},
                        {"grade", GradeName(finding.grade)},
                        {"cameras", finding.cameras},
                        {"value", number(finding.value)},
                        {"limit", number(finding.limit)},
                        {"what", finding.what},
                        {"remedy", finding.remedy}});
  }
  return {{"grade", GradeName(verdict.grade)}, {"findings", findings}};
}

Json CheckJson(const CalibrationCheck& check) {
  Json cameras = Json::array();
  for (const CameraCheck& camera : check.cameras) {
    cameras.push_back({{"name", camera.name},
                       {"valid", camera.valid},
                       {"points", camera.points},
                       {"rms_poses_only", camera.rms_held},
                       {"rms_expected", camera.expected},
                       {"rms_all_free", camera.rms_free},
                       {"probability", camera.probability},
                       {"mount_turn", camera.rotation},
                       {"mount_shift", camera.translation},
                       {"mount_probability", camera.extrinsics_probability}});
  }
  return {{"valid", check.valid},
          {"frames", check.frames},
          {"verdict", VerdictJson(JudgeCheck(check))},
          {"cameras", cameras}};
}

Json CalibrationJson(const CalibrationRecord& record) {
  Json cameras = Json::object();
  for (size_t c = 0; c < record.cameras.size(); ++c) {
    cameras[record.cameras[c].name] = CameraJson(record.cameras[c], c, record.correlations);
  }
  const Verdict verdict = record.verdict ? *record.verdict : Judge(record);
  Json json{{"verdict", VerdictJson(verdict)},
            {"headline", Headline(verdict)},
            {"cameras", cameras},
            {"frames", record.frames.size()}};
  for (const auto& [name, scale] : record.target_scales) {
    json["target_scale"][name] = {{"value", AsInFile(scale.value)},
                                  {"sigma", AsInFile(scale.sigma)}};
  }
  return json;
}

Json SpaceJson(const CalibrationRecord& record) {
  Json poses = Json::array(), markers = Json::array();
  for (const FrameRecord& frame : record.frames) {
    poses.push_back({{"name", frame.name}, {"T_target_rig", TransformJson(frame.T_target_rig)}});
  }
  const bool refined = record.adjustment && !record.adjustment->marker_freedom.IsRigid();
  for (const auto& [number, marker] : record.markers) {
    Json& json = markers.emplace_back();
    json = {{"number", number}, {"place", VectorJson(marker.position)}};
    if (!refined || !marker.nominal || !marker.sigma) continue;
    json["moved"] = VectorJson(marker.position - *marker.nominal);
    json["sigma"] = VectorJson(*marker.sigma);
  }
  return {{"poses", poses}, {"markers", markers}};
}

Json SigmaMapsJson(const CalibrationRecord& record, size_t camera) {
  Json maps = Json::array();
  for (const ProjectionMap& map : ProjectionMaps(record, camera)) {
    Json sigma = Json::array();
    for (const double value : map.sigma) sigma.push_back(Short(value, 3));
    maps.push_back({{"distance", Short(map.distance)},
                    {"columns", map.grid.Columns()},
                    {"rows", map.grid.Rows()},
                    {"sigma", sigma}});
  }
  return maps;
}

Json FieldJson(const CalibratedCamera& camera) {
  const ResidualField field = MakeResidualField(camera);
  Json mean_x = Json::array(), mean_y = Json::array(), rms = Json::array();
  for (size_t cell = 0; cell < field.grid.Cells(); ++cell) {
    const bool any = field.points[cell] > 0;
    mean_x.push_back(any ? Short(field.mean[cell].x()) : Json());
    mean_y.push_back(any ? Short(field.mean[cell].y()) : Json());
    rms.push_back(any ? Short(std::sqrt(field.square[cell])) : Json());
  }
  return {{"columns", field.grid.Columns()},
          {"rows", field.grid.Rows()},
          {"points", field.points},
          {"mean_x", mean_x},
          {"mean_y", mean_y},
          {"rms", rms}};
}

Json FieldJson(ImageSize image_size, std::vector<ResidualRow> vectors) {
  CalibratedCamera camera;
  camera.image_size = image_size;
  camera.residuals = std::move(vectors);
  return FieldJson(camera);
}

}  // namespace plenocal
