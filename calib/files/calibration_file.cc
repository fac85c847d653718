// SPDX-License-Identifier: Apache-2.0
#include "calib/files/calibration_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>

#include "calib/base/error.h"
#include "calib/base/names.h"
#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"
#include "calib/files/checks/correlation_check.h"
#include "calib/files/checks/transform_keys.h"

namespace plenocal {
namespace {

// As many digits as the number has; no "-0".
std::string Exact(double value) { return fmt::format("{}", value + 0.0); }

template <typename Values, typename Format>
std::string Joined(const Values& values, const Format& format) {
  std::string text;
  for (const auto& value : values) text.append(text.empty() ? "" : ", ").append(format(value));
  return text;
}

template <typename Values, typename Format>
std::string List(const Values& values, const Format& format) {
  return fmt::format("[{}]", Joined(values, format));
}

std::string ParamMap(const CameraModel& model,
                     const std::vector<double>& values,
                     std::string (*format)(double)) {
  size_t i = 0;
  const std::string entries = Joined(values, [&](double value) {
    return fmt::format("{}: {}", model.params[i++].name, format(value));
  });
  return fmt::format("{{{}}}", entries);
}

std::string Matrix(const RigidTransform& T) {
  std::string text = "[";
  for (int r = 0; r < 3; ++r) {
    text += List(std::array{T.R(r, 0), T.R(r, 1), T.R(r, 2), T.t[r]}, Exact) + ", ";
  }
  return text + "[0, 0, 0, 1]]";
}

// The lower triangle of the correlations of the parameters, a row per parameter.
std::string CorrelationTriangle(const CalibratedCamera& camera) {
  std::string text = "[";
  for (size_t i = 0; i < camera.params.size(); ++i) {
    text += i == 0 ? "[" : ", [";
    for (size_t j = 0; j < i; ++j) {
      const double size = camera.Sigma(i) * camera.Sigma(j);
      const double covariance =
          camera.covariance(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
      const bool known = size > 0 && std::isfinite(size);
      text += fmt::format("{:.12g}, ", known ? covariance / size + 0.0 : 0.0);
    }
    text += "1]";
  }
  return text + "]";
}

std::string ResidualsMap(const CameraFit& fit) {
  std::string text = fmt::format("{{points: {}, rms: {}, rejected: {}, views: {}, noise: {}",
                                 fit.points,
                                 YamlNumber(fit.rms),
                                 fit.rejected,
                                 fit.views,
                                 YamlNumber(fit.noise_sigma));
  const auto add = [&](const char* key, double value) {
    text += fmt::format(", {}: {}", key, YamlNumber(value));
  };
  if (fit.detector_sigma > 0) add("detector_sigma", fit.detector_sigma);
  if (fit.common_noise > 0) add("common_noise", fit.common_noise);
  if (fit.noise_floor && fit.noise_floor_all) {
    add("floor", fit.noise_floor->length);
    add("rms_all", fit.rms_all);
    add("floor_all", fit.noise_floor_all->length);
    if (fit.noise_floor->third_order > 0) {
      add("floor_third_order", fit.noise_floor->third_order);
      add("floor_all_third_order", fit.noise_floor_all->third_order);
    }
  }
  if (!fit.lens_types.empty()) {
    const std::string types = Joined(fit.lens_types, [](const auto& type) {
      return fmt::format("{}: {}", type.first, YamlNumber(type.second.rms));
    });
    text += fmt::format(", rms_by_type: {{{}}}", types);
  }
  return text + "}";
}

std::string EstimateMap(const EstimatedNumber& estimate) {
  return fmt::format("{{value: {}, sigma: {}}}", Exact(estimate.value), YamlNumber(estimate.sigma));
}

// Distances that are infinite are left out.
std::string LensTypesYaml(const std::vector<LensTypeOptics>& types) {
  std::string text = types.empty() ? "" : "    lens_types:\n";
  for (const LensTypeOptics& type : types) {
    text += fmt::format(
        "      - {{type: {}, focal_length: {}, sigma_focal_length: {}, aperture: {}, "
        "sigma_aperture: {}",
        type.lens_type,
        YamlNumber(type.focal_length),
        YamlNumber(type.focal_length_sigma),
        YamlNumber(type.aperture),
        YamlNumber(type.aperture_sigma));
    for (const auto& [key, distance] : {std::pair("near", type.near),
                                        std::pair("in_focus", type.in_focus),
                                        std::pair("far", type.far)}) {
      if (std::isfinite(distance)) text += fmt::format(", {}: {}", key, YamlNumber(distance));
    }
    text += "}\n";
  }
  return text;
}

std::string TargetsYaml(const std::vector<TargetRecord>& targets) {
  std::string text = targets.empty() ? "" : "targets:\n";
  for (const TargetRecord& target : targets) {
    text += fmt::format("  {}:\n    T_target_own: {}\n    xi_target_own: {}\n    sigma_xi: {}\n",
                        YamlText(target.name),
                        Matrix(target.T_target_own),
                        List(Log(target.T_target_own), Exact),
                        List(target.sigma_xi, YamlNumber));
  }
  return text;
}

// The number of a single scale, else a map by their names.
std::string TargetScalesYaml(const CalibrationRecord& calibration) {
  std::string text;
  for (const auto& [name, scale] : calibration.target_scales) {
    if (name == "target.scale") return fmt::format("target_scale: {}\n", EstimateMap(scale));
    text += fmt::format("  {}: {}\n", YamlText(name), EstimateMap(scale));
  }
  return text.empty() ? text : "target_scale:\n" + text;
}

std::string CameraYaml(const CalibratedCamera& camera, bool is_estimated) {
  const CameraModel& model = *camera.model;
  std::string text = fmt::format("  {}:\n    model: {}\n    image_size: [{}, {}]\n",
                                 YamlText(camera.name),
                                 model.name,
                                 camera.image_size[0],
                                 camera.image_size[1]);
  const auto add = [&](std::string_view key, const std::string& value) {
    text += fmt::format("    {}: {}\n", key, value);
  };
  if (const std::optional<ImageCircle>& circle = camera.image_circle) {
    const std::array numbers{
        circle->centre.x(), circle->centre.y(), circle->radii.x(), circle->radii.y()};
    add("image_circle", List(numbers, YamlNumber));
  }
  for (size_t i = 0; i < camera.config.size(); ++i) {
    add(model.config[i].name, Exact(camera.config[i]));
  }
  add("parameters", ParamMap(model, camera.params, Exact));
  if (is_estimated) {
    std::vector<double> sigma;
    for (size_t i = 0; i < camera.params.size(); ++i) sigma.push_back(camera.Sigma(i));
    add("sigma", ParamMap(model, sigma, YamlNumber));
    if (!camera.at_bound.empty()) {
      add("at_bound", List(camera.at_bound, YamlText));
    }
    if (!camera.sigma_jackknife.empty()) {
      add("sigma_jackknife", ParamMap(model, camera.sigma_jackknife, YamlNumber));
    }
    add("correlation", CorrelationTriangle(camera));
  }
  add("T_camera_rig", Matrix(camera.T_camera_rig));
  add("xi_camera_rig", List(Log(camera.T_camera_rig), Exact));
  if (!is_estimated) return text;
  add("sigma_xi", List(camera.sigma_xi, YamlNumber));
  if (!camera.sigma_xi_jackknife.empty()) {
    add("sigma_xi_jackknife", List(camera.sigma_xi_jackknife, YamlNumber));
  }
  if (camera.time_shift) {
    add("time_shift", Exact(camera.time_shift->value));
    add("sigma_time_shift", YamlNumber(camera.time_shift->sigma));
  }
  if (!camera.nuisances.empty()) {
    size_t k = 0;
    const std::string sizes = Joined(camera.nuisances, [&](const EstimatedNumber& size) {
      return fmt::format("shared_{}: {}", ++k, EstimateMap(size));
    });
    add("nuisances", fmt::format("{{{}}}", sizes));
  }
  add("residuals", ResidualsMap(camera.fit));
  for (const auto& [key, member] : kCameraTextKeys) {
    const std::string& value = camera.*member;
    if (!value.empty())
      add(key, member == &CalibratedCamera::sample_frame ? YamlQuoted(value) : YamlText(value));
  }
  return text + LensTypesYaml(camera.lens_type_optics);
}

// "key:" with one line per item, or "key: []".
template <typename Items, typename Format>
void AppendItems(const char* key, const Items& items, const Format& format, std::string* text) {
  text->append(key).append(":");
  for (const auto& item : items) text->append("\n  - ").append(format(item));
  text->append(std::empty(items) ? " []\n" : "\n");
}

// Pairs of unknowns with a strong correlation: their sigmas alone would mislead.
std::string StrongCorrelations(const Correlations& correlations) {
  constexpr double kStrong = 0.9;
  std::vector<std::string> pairs;
  for (Eigen::Index i = 0; i < correlations.matrix.rows(); ++i) {
    for (Eigen::Index j = 0; j < i; ++j) {
      if (std::abs(correlations.matrix(i, j)) < kStrong) continue;
      pairs.push_back(fmt::format("[{}, {}, {:.4f}]",
                                  YamlText(correlations.names[static_cast<size_t>(j)]),
                                  YamlText(correlations.names[static_cast<size_t>(i)]),
                                  correlations.matrix(i, j)));
    }
  }
  std::string text;
  AppendItems(
      "correlations", pairs, [](const std::string& pair) { return pair; }, &text);
  return text;
}

std::string OpenDirectionMap(const OpenDirection& direction) {
  const std::string parts = Joined(direction.parts, [](const auto& part) {
    return fmt::format("{}: {:.3f}", YamlText(part.first), part.second);
  });
  return fmt::format("{{sigma: {}, parameters: {{{}}}}}", YamlNumber(direction.sigma), parts);
}

std::string WeakUnknownsMap(const WeakUnknowns& weak) {
  return fmt::format("{{parameters: {}, determined: {}, what: {}, remedy: {}}}",
                     List(weak.names, YamlText),
                     !weak.open,
                     YamlQuoted(weak.what),
                     YamlQuoted(weak.remedy));
}

std::string FindingMap(const Finding& finding) {
  std::string text = fmt::format("{{code: {}, grade: {}, cameras: {}",
                                 finding.code,
                                 GradeName(finding.grade),
                                 List(finding.cameras, YamlText));
  if (finding.value) text += fmt::format(", value: {}", YamlNumber(*finding.value));
  if (finding.limit) text += fmt::format(", limit: {}", YamlNumber(*finding.limit));
  return text + fmt::format(", what: {}, remedy: {}}}",
                            YamlQuoted(finding.what),
                            YamlQuoted(finding.remedy));
}

std::string VerdictYaml(const Verdict& verdict) {
  std::string text = fmt::format("verdict:\n  grade: {}\n  findings:", GradeName(verdict.grade));
  for (const Finding& finding : verdict.findings) text += "\n    - " + FindingMap(finding);
  return text + (verdict.findings.empty() ? " []\n" : "\n");
}

std::string AdjustmentYaml(const CalibrationRecord& calibration) {
  const AdjustmentRecord& adjustment = *calibration.adjustment;
  std::string text = fmt::format(
      "frames: {}\nadjustment: {{converged: {}, iterations: {}, rejection_sigmas: {}, "
      "marker_sigma: {}}}\n",
      calibration.frames.size(),
      adjustment.converged,
      adjustment.iterations,
      YamlNumber(adjustment.rejection_sigmas),
      YamlNumber(adjustment.marker_freedom.Sigma()));
  if (calibration.jitter) {
    text += fmt::format("jitter: {{translation: {}, rotation: {}, misplaced: {}}}\n",
                        YamlNumber(calibration.jitter->translation_sigma),
                        YamlNumber(calibration.jitter->rotation_sigma),
                        calibration.jitter->misplaced);
  }
  text += StrongCorrelations(calibration.correlations);
  text += UndeterminedYaml(calibration.undetermined);
  AppendItems("weak", calibration.weak, WeakUnknownsMap, &text);
  AppendItems("left_out", calibration.left_out, YamlQuoted, &text);
  return text;
}

// A number; `.inf` for what is not determined.
double ReadReal(const YamlNode& node) {
  return node.AsString() == ".inf" ? std::numeric_limits<double>::infinity() : node.AsNumber();
}

// An RMS or a known standard deviation, whose square must be a number too.
double ReadRms(const YamlNode& node) {
  const double rms = node.AsNumber();
  if (rms < 0) node.Fail("expected a standard deviation, found a negative number");
  if (rms > 0 && !std::isnormal(rms * rms)) node.Fail("expected 0 or 1e-150 to 1e150");
  return rms;
}

// A standard deviation; `.inf` for that of what is not determined.
double ReadSigma(const YamlNode& node) {
  return node.AsString() == ".inf" ? std::numeric_limits<double>::infinity() : ReadRms(node);
}

EstimatedNumber ReadEstimate(const YamlNode& node) {
  return {.value = node.At("value").AsNumber(), .sigma = ReadSigma(node.At("sigma"))};
}

std::vector<double> ReadParamSigmas(const YamlNode& node, const CameraModel& model) {
  std::vector<double> sigma;
  for (const Param& param : model.params) sigma.push_back(ReadSigma(node.At(param.name)));
  return sigma;
}

std::vector<double> ReadSixSigmas(const YamlNode& node) {
  const std::vector<YamlNode> elements = node.Elements();
  if (elements.size() != 6) node.Fail("expected six numbers");
  std::vector<double> sigma;
  for (const YamlNode& element : elements) sigma.push_back(ReadSigma(element));
  return sigma;
}

// The key `sigma_xi` of a camera or target; zeros without it.
Vector6d ReadSigmaXi(const YamlNode& node) {
  const auto sigma = node.Find("sigma_xi");
  return sigma ? Vector6d(ReadSixSigmas(*sigma).data()) : Vector6d(Vector6d::Zero());
}

// The entries of an optional map.
std::vector<std::pair<std::string, YamlNode>> Entries(const YamlNode& node, std::string_view key) {
  const auto map = node.Find(key);
  return map ? map->Entries() : std::vector<std::pair<std::string, YamlNode>>();
}

Eigen::MatrixXd ReadCovariance(const YamlNode& node, const CameraModel& model) {
  const auto count = static_cast<Eigen::Index>(model.params.size());
  const std::vector<double> sigma = node.Has("sigma")
                                        ? ReadParamSigmas(node.At("sigma"), model)
                                        : std::vector<double>(model.params.size(), 0.0);
  Eigen::MatrixXd correlation = Eigen::MatrixXd::Identity(count, count);
  if (const auto triangle = node.Find("correlation")) {
    const auto rows = triangle->Elements();
    if (static_cast<Eigen::Index>(rows.size()) != count) {
      triangle->Fail(
          fmt::format("expected {} rows, one per parameter, found {}", count, rows.size()));
    }
    for (Eigen::Index i = 0; i < count; ++i) {
      const std::vector<double> row =
          rows[static_cast<size_t>(i)].AsNumbers(static_cast<size_t>(i) + 1);
      for (Eigen::Index j = 0; j <= i; ++j) {
        correlation(i, j) = correlation(j, i) = row[static_cast<size_t>(j)];
      }
    }
    std::vector<std::string> names;
    for (const Param& param : model.params) names.emplace_back(param.name);
    if (const auto defect = CorrelationDefect(correlation, names, kCorrelationRounding)) {
      triangle->Fail(*defect);
    }
  }
  return CovarianceOf(sigma, correlation);
}

double RmsOf(const YamlNode& node, std::string_view key) {
  return node.Has(key) ? ReadRms(node.At(key)) : 0;
}

int CountOf(const YamlNode& node, std::string_view key) {
  if (!node.Has(key)) return 0;
  const int count = node.At(key).AsInteger();
  if (count < 0) node.At(key).Fail("expected a number of at least 0");
  return count;
}

CameraFit ReadFit(const YamlNode& node) {
  CameraFit fit;
  fit.points = CountOf(node, "points");
  fit.rejected = CountOf(node, "rejected");
  fit.views = CountOf(node, "views");
  fit.rms = RmsOf(node, "rms");
  fit.noise_sigma = RmsOf(node, "noise");
  fit.detector_sigma = RmsOf(node, "detector_sigma");
  fit.common_noise = RmsOf(node, "common_noise");
  fit.rms_all = RmsOf(node, "rms_all");
  if (node.Has("floor")) {
    fit.noise_floor =
        NoiseFloor{.length = RmsOf(node, "floor"), .third_order = RmsOf(node, "floor_third_order")};
  }
  if (node.Has("floor_all")) {
    fit.noise_floor_all = NoiseFloor{.length = RmsOf(node, "floor_all"),
                                     .third_order = RmsOf(node, "floor_all_third_order")};
  }
  for (const auto& [type, rms] : Entries(node, "rms_by_type")) {
    const std::optional<int> number = ParseInt(type);
    if (!number) rms.Fail(fmt::format("'{}' is no number of a lens type", type));
    fit.lens_types[*number].rms = ReadRms(rms);
  }
  return fit;
}

std::vector<std::string> Strings(const YamlNode& node, std::string_view key) {
  std::vector<std::string> strings;
  if (!node.Has(key)) return strings;
  for (const YamlNode& item : node.At(key).Elements()) strings.push_back(item.AsString());
  return strings;
}

std::vector<LensTypeOptics> ReadLensTypes(const YamlNode& node) {
  const auto distance = [](const YamlNode& item, const char* key) {
    return item.Has(key) ? item.At(key).AsNumber() : std::numeric_limits<double>::infinity();
  };
  std::vector<LensTypeOptics> types;
  for (const YamlNode& item : node.Elements()) {
    types.push_back({.lens_type = item.At("type").AsInteger(),
                     .focal_length = item.At("focal_length").AsPositive(),
                     .focal_length_sigma = ReadRms(item.At("sigma_focal_length")),
                     .aperture = item.At("aperture").AsPositive(),
                     .aperture_sigma = ReadRms(item.At("sigma_aperture")),
                     .in_focus = distance(item, "in_focus"),
                     .near = distance(item, "near"),
                     .far = distance(item, "far")});
  }
  return types;
}

CalibratedCamera ReadCamera(const std::string& name,
                            const YamlNode& node,
                            std::span<const CameraModel> models) {
  CalibratedCamera camera;
  camera.name = name;
  camera.model = ReadModel(node.At("model"), models);
  camera.image_size = ReadImageSize(node.At("image_size"));
  if (node.Has("image_circle")) {
    camera.image_circle = ReadImageCircle(node.At("image_circle"));
    if (!camera.image_circle->IsOf(camera.image_size)) {
      node.At("image_circle").Fail("lies beside the image, or covers hardly any of it");
    }
  }
  for (const Param& param : camera.model->config) {
    camera.config.push_back(ReadWithin(node.At(param.name), param));
  }
  for (const Param& param : camera.model->params) {
    camera.params.push_back(ReadWithin(node.At("parameters").At(param.name), param));
  }
  camera.covariance = ReadCovariance(node, *camera.model);
  camera.T_camera_rig = ReadTransform(node.At("T_camera_rig"));
  camera.sigma_xi = ReadSigmaXi(node);
  if (const auto shift = node.Find("time_shift")) {
    camera.time_shift = {.value = shift->AsNumber(),
                         .sigma = ReadSigma(node.At("sigma_time_shift"))};
  }
  for (const auto& [key, size] : Entries(node, "nuisances")) {
    const std::string expected = fmt::format("shared_{}", camera.nuisances.size() + 1);
    if (key != expected) size.Fail(fmt::format("expected {}, found {}", expected, key));
    camera.nuisances.push_back(ReadEstimate(size));
    if (!(camera.nuisances.back().sigma > 0)) size.Fail("expected a sigma above 0");
  }
  camera.at_bound = Strings(node, "at_bound");
  if (const auto sigma = node.Find("sigma_jackknife")) {
    camera.sigma_jackknife = ReadParamSigmas(*sigma, *camera.model);
  }
  if (const auto sigma = node.Find("sigma_xi_jackknife")) {
    camera.sigma_xi_jackknife = ReadSixSigmas(*sigma);
  }
  if (node.Has("residuals")) camera.fit = ReadFit(node.At("residuals"));
  for (const auto& [key, member] : kCameraTextKeys) {
    if (node.Has(key)) camera.*member = node.At(key).AsString();
  }
  if (node.Has("lens_types")) camera.lens_type_optics = ReadLensTypes(node.At("lens_types"));
  return camera;
}

std::vector<OpenDirection> ReadOpenDirections(const YamlNode& node) {
  std::vector<OpenDirection> directions;
  for (const YamlNode& item : node.Elements()) {
    OpenDirection& direction = directions.emplace_back();
    direction.sigma = ReadSigma(item.At("sigma"));
    for (const auto& [name, share] : item.At("parameters").Entries()) {
      direction.parts.emplace_back(name, share.AsNumber());
    }
  }
  return directions;
}

// `weak`; files of older versions have `undetermined` alone.
std::vector<WeakUnknowns> ReadWeakUnknowns(const YamlNode& root,
                                           const std::vector<OpenDirection>& undetermined) {
  std::vector<WeakUnknowns> weak;
  if (const auto list = root.Find("weak")) {
    for (const YamlNode& item : list->Elements()) {
      weak.push_back({.open = !item.At("determined").AsBool(),
                      .names = Strings(item, "parameters"),
                      .what = item.At("what").AsString(),
                      .remedy = item.At("remedy").AsString()});
    }
    return weak;
  }
  for (const OpenDirection& direction : undetermined) {
    WeakUnknowns& open = weak.emplace_back();
    open.open = true;
    for (const auto& [name, share] : direction.parts) open.names.push_back(name);
  }
  return weak;
}

Grade ReadGrade(const YamlNode& node) {
  const std::string name = node.AsString();
  if (const std::optional<Grade> grade = ParseGrade(name)) return *grade;
  node.Fail(fmt::format("expected a grade, found '{}'{}", name, SuggestName(name, kGradeNames)));
}

Verdict ReadVerdict(const YamlNode& node) {
  Verdict verdict{.grade = ReadGrade(node.At("grade"))};
  for (const YamlNode& item : node.At("findings").Elements()) {
    Finding finding{.code = item.At("code").AsString(), .grade = ReadGrade(item.At("grade"))};
    finding.cameras = Strings(item, "cameras");
    if (item.Has("value")) finding.value = ReadReal(item.At("value"));
    if (item.Has("limit")) finding.limit = ReadReal(item.At("limit"));
    finding.what = item.At("what").AsString();
    finding.remedy = item.At("remedy").AsString();
    verdict.findings.push_back(std::move(finding));
  }
  return verdict;
}

// Files of version 0.1 have texts alone.
std::vector<Finding> ReadWarnings(const YamlNode& root) {
  std::vector<Finding> findings;
  for (const std::string& warning : Strings(root, "warnings")) {
    findings.push_back({.code = "warning", .grade = Grade::kUsable, .what = warning});
  }
  return findings;
}

// `models`: the formulas of the models that the cameras use, if any.
std::string FormulasYaml(const std::vector<CalibratedCamera>& cameras) {
  std::map<std::string_view, std::string_view> texts;  // by lens
  for (const CalibratedCamera& camera : cameras) {
    const CameraModel& model = *camera.model;
    if (!model.formula.empty()) texts[model.name.substr(0, model.name.find('+'))] = model.formula;
  }
  std::string all = texts.empty() ? "" : "models:\n";
  for (const auto& [name, text] : texts) {
    all += fmt::format("  {}:\n", name);
    for (size_t begin = 0; begin < text.size();) {
      const size_t end = std::min(text.find('\n', begin), text.size());
      all += fmt::format("    {}\n", text.substr(begin, end - begin));
      begin = end + 1;
    }
  }
  return all;
}

}  // namespace

std::string CalibrationYaml(const CalibrationRecord& calibration) {
  std::string text = "plenocal: 1\n" + FormulasYaml(calibration.cameras) + "cameras:\n";
  for (const CalibratedCamera& camera : calibration.cameras) {
    text += CameraYaml(camera, calibration.adjustment.has_value());
  }
  text += TargetsYaml(calibration.targets) + TargetScalesYaml(calibration);
  if (calibration.adjustment) text += AdjustmentYaml(calibration);
  if (calibration.verdict) text += VerdictYaml(*calibration.verdict);
  if (!calibration.provenance.empty()) text += "provenance:\n";
  for (const auto& [key, value] : calibration.provenance) {
    text += fmt::format("  {}: {}\n", key, YamlQuoted(value));
  }
  return text;
}

std::string UndeterminedYaml(const std::vector<OpenDirection>& directions) {
  std::string text;
  AppendItems("undetermined", directions, OpenDirectionMap, &text);
  return text;
}

std::string GivenCamerasYaml(std::span<const CalibratedCamera> cameras,
                             const Provenance& provenance) {
  CalibrationRecord given;
  given.cameras.assign(cameras.begin(), cameras.end());
  given.provenance = provenance;
  return CalibrationYaml(given);
}

CalibrationRecord ReadCalibration(const std::filesystem::path& path,
                                  std::span<const CameraModel> models) {
  const YamlNode root = YamlNode::ReadFile(path);
  root.CheckVersion();
  CalibrationRecord calibration;
  calibration.path = path;
  for (const auto& [name, node] : root.At("cameras").Entries()) {
    CheckName(name, node);
    calibration.cameras.push_back(ReadCamera(name, node, models));
  }
  if (calibration.cameras.empty()) root.At("cameras").Fail("expected at least one camera");
  for (const auto& [name, node] : Entries(root, "targets")) {
    calibration.targets.push_back({.name = name,
                                   .T_target_own = ReadXi(node.At("xi_target_own")),
                                   .sigma_xi = ReadSigmaXi(node)});
  }
  if (const auto scale = root.Find("target_scale"); scale && scale->Has("value")) {
    calibration.target_scales = {{"target.scale", ReadEstimate(*scale)}};
  } else {
    for (const auto& [name, node] : Entries(root, "target_scale")) {
      calibration.target_scales.emplace_back(name, ReadEstimate(node));
    }
  }
  if (const auto node = root.Find("adjustment")) {
    calibration.adjustment = {
        .converged = node->At("converged").AsBool(),
        .iterations = CountOf(*node, "iterations"),
        .rejection_sigmas = RmsOf(*node, "rejection_sigmas"),
        .marker_freedom = MarkerFreedom::FromSigma(ReadSigma(node->At("marker_sigma")))};
  }
  if (const auto node = root.Find("jitter")) {
    calibration.jitter = {.translation_sigma = ReadRms(node->At("translation")),
                          .rotation_sigma = ReadRms(node->At("rotation")),
                          .misplaced = CountOf(*node, "misplaced")};
  }
  if (const auto node = root.Find("undetermined")) {
    calibration.undetermined = ReadOpenDirections(*node);
  }
  calibration.weak = ReadWeakUnknowns(root, calibration.undetermined);
  calibration.findings = ReadWarnings(root);
  if (root.Has("verdict")) calibration.verdict = ReadVerdict(root.At("verdict"));
  calibration.left_out = Strings(root, "left_out");
  for (const auto& [key, value] : Entries(root, "provenance")) {
    calibration.provenance.emplace_back(key, value.AsString());
  }
  return calibration;
}

void CheckName(const std::string& name, const YamlNode& node) {
  if (const std::optional<std::string> defect = CameraNameDefect(name)) {
    node.Fail("this name " + *defect);
  }
}

const CameraModel* ReadModel(const YamlNode& node, std::span<const CameraModel> models) {
  const std::string name = node.AsString();
  try {
    if (const CameraModel* model = FindModel(models, name)) return model;
  } catch (const Error& error) {
    node.Fail(error.what());
  }
  node.Fail(fmt::format(
      "unknown camera model '{}'{} (a model from outside needs --plugin or --model-file FILE)",
      name,
      SuggestName(name, NamesOf(models))));
}

ImageSize ReadImageSize(const YamlNode& node) {
  const std::vector<YamlNode> elements = node.Elements();
  if (elements.size() != 2) node.Fail("expected [width, height]");
  ImageSize size{};
  for (size_t i = 0; i < 2; ++i) {
    size[i] = elements[i].AsInteger();
    if (size[i] < 1) elements[i].Fail("expected a positive number of pixels");
  }
  return size;
}

ImageCircle ReadImageCircle(const YamlNode& node) {
  const std::vector<YamlNode> elements = node.Elements();
  if (elements.size() != 4) node.Fail("expected [c_x, c_y, r_x, r_y], px");
  const auto number = [&](size_t i) { return elements[i].AsNumber(); };
  for (size_t i = 2; i < 4; ++i) {
    if (!(number(i) > 0)) elements[i].Fail("expected a positive radius, px");
  }
  return {{number(0), number(1)}, {number(2), number(3)}};
}

double ReadWithin(const YamlNode& node, const Param& param) {
  const double value = param.unit == "m" ? node.AsSignedLength() : node.AsNumber();
  if (!(value > param.lower && value < param.upper)) {
    node.Fail(fmt::format(
        "{} = {} {} is outside ({}, {})", param.name, value, param.unit, param.lower, param.upper));
  }
  return value;
}

}  // namespace plenocal
