// SPDX-License-Identifier: Apache-2.0
#include "calib/result_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <numbers>
#include <set>

#include "calib/number_text.h"
#include "calib/weak_directions.h"

namespace plenocal {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;

template <typename Values>
std::string YamlList(const Values& values) {
  std::string text = "[";
  for (const double value : values) text += (text.size() > 1 ? ", " : "") + YamlNumber(value);
  return text + "]";
}

std::string YamlMatrix(const RigidTransform& T) {
  std::string text = "[";
  for (int r = 0; r < 3; ++r) {
    text += fmt::format("[{:.15g}, {:.15g}, {:.15g}, {:.15g}], ",
                        T.R(r, 0) + 0.0,
                        T.R(r, 1) + 0.0,
                        T.R(r, 2) + 0.0,
                        T.t[r] + 0.0);
  }
  return text + "[0, 0, 0, 1]]";
}

std::string ParamMap(const CameraModel& model, const std::vector<double>& values) {
  std::string text = "{";
  for (size_t i = 0; i < values.size(); ++i) {
    text +=
        fmt::format("{}{}: {}", i == 0 ? "" : ", ", model.params[i].name, YamlNumber(values[i]));
  }
  return text + "}";
}

// Digits of a value next to a limit of the parameter do not round onto it, where no reader takes
// it.
std::string ParameterMap(const CameraModel& model, const std::vector<double>& params) {
  std::string text = "{";
  for (size_t i = 0; i < params.size(); ++i) {
    const Param& param = model.params[i];
    std::string number = YamlNumber(params[i]);
    const double read = std::strtod(number.c_str(), nullptr);  // takes denormal numbers, too
    if (!(read > param.lower && read < param.upper)) number = fmt::format("{}", params[i]);
    text += fmt::format("{}{}: {}", i == 0 ? "" : ", ", param.name, number);
  }
  return text + "}";
}

std::vector<std::string_view> AtBound(const BundleCamera& camera) {
  std::vector<std::string_view> names;
  for (size_t k = 0; k < camera.at_bound.size(); ++k) {
    if (camera.at_bound[k]) names.push_back(camera.model->params[k].name);
  }
  return names;
}

// Correlations of a camera's parameters; held ones have none.
Eigen::MatrixXd ParamCorrelation(const Calibration& calibration, size_t c) {
  const Uncertainty& uncertainty = calibration.uncertainty;
  // A truth that was not estimated has no correlations.
  const std::vector<int> places =
      uncertainty.places.empty() ? std::vector<int>(calibration.bundle.cameras[c].params.size(), -1)
                                 : uncertainty.places[c];
  const auto count = static_cast<Eigen::Index>(places.size());
  Eigen::MatrixXd correlation = Eigen::MatrixXd::Identity(count, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    for (Eigen::Index j = 0; j < i; ++j) {
      const int a = places[static_cast<size_t>(i)], b = places[static_cast<size_t>(j)];
      if (a < 0 || b < 0) continue;
      correlation(i, j) = correlation(j, i) = uncertainty.correlation(a, b) + 0.0;  // no "-0"
    }
  }
  return correlation;
}

// The lower triangle, one row a parameter.
std::string CorrelationTriangle(const Calibration& calibration, size_t c) {
  const Eigen::MatrixXd correlation = ParamCorrelation(calibration, c);
  std::string text = "[";
  for (Eigen::Index i = 0; i < correlation.rows(); ++i) {
    text += i == 0 ? "[" : ", [";
    for (Eigen::Index j = 0; j < i; ++j) text += fmt::format("{:.12g}, ", correlation(i, j));
    text += "1]";
  }
  return text + "]";
}

// Sigmas of the se(3) vector of T_camera_rig, from its covariance in the estimation's chart.
Vector6d SigmaXi(const Calibration& calibration, size_t c) {
  const Matrix6d& covariance = calibration.uncertainty.mount[c];
  if (!covariance.allFinite()) return Vector6d::Constant(std::numeric_limits<double>::infinity());
  const Matrix6d J = LogJacobian(calibration.bundle.cameras[c].T_camera_rig);
  return (J * covariance * J.transpose()).diagonal().cwiseMax(0).cwiseSqrt();
}

std::string PoseColumns(const RigidTransform& T) {
  const Eigen::Quaterniond q(T.R);
  return fmt::format(",{:.12g},{:.12g},{:.12g},{:.12g},{:.12g},{:.12g},{:.12g}",
                     T.t.x(),
                     T.t.y(),
                     T.t.z(),
                     q.x(),
                     q.y(),
                     q.z(),
                     q.w());
}

// Names of columns, each once, in the order in which the cameras' models bring them.
std::vector<std::string_view> UnionOf(const Bundle& bundle,
                                      std::span<const std::string_view> CameraModel::*names) {
  std::vector<std::string_view> all;
  for (const BundleCamera& camera : bundle.cameras) {
    for (const std::string_view name : camera.model->*names) {
      if (std::find(all.begin(), all.end(), name) == all.end()) all.push_back(name);
    }
  }
  return all;
}

int IndexOf(std::span<const std::string_view> names, std::string_view name) {
  const auto found = std::find(names.begin(), names.end(), name);
  return found == names.end() ? -1 : static_cast<int>(found - names.begin());
}

// Value with as many digits as its sigma justifies (two digits of the sigma).
std::string WithSigma(double value, double sigma) {
  if (!(sigma > 0)) return fmt::format("{:.9g}", value);
  if (std::isinf(sigma)) return fmt::format("{:.6g}  (not determined)", value);
  const int digits = std::clamp(1 - static_cast<int>(std::floor(std::log10(sigma))), 0, 12);
  return fmt::format("{:.{}f} +- {:.{}f}", value, digits, sigma, digits);
}

// What was known of a parameter beside the images.
std::string RuleText(const Calibration& calibration, size_t c, size_t k) {
  const BundleCamera& camera = calibration.bundle.cameras[c];
  if (camera.rules.empty()) return {};
  const ParamPlace root = calibration.bundle.Root(c, k);
  const ParamRule& rule = calibration.bundle.cameras[root.camera].rules[root.param];
  std::string text;
  if (root != ParamPlace{c, k}) {
    text += fmt::format("  (one with {}{})",
                        root.camera == c ? "" : calibration.camera_names[root.camera] + ".",
                        calibration.bundle.cameras[root.camera].model->params[root.param].name);
  }
  if (camera.at_bound[k]) text += "  (at its bound)";
  if (rule.prior)
    text += fmt::format("  (prior {:g} +- {:g})", rule.prior->value, rule.prior->sigma);
  return text;
}

// The floor beside the RMS. A gap between them is error of model or target, not noise.
std::string FloorText(const CameraFit& fit) {
  if (!fit.floor) return {};
  const double per_coordinate = fit.rms / fit.floor->Length() * fit.floor->Coordinate();
  return fmt::format(
      "  floor that the points allow any model: {:.4f} px; RMS a coordinate {:.4f} px, floor "
      "{:.4f} "
      "({:.0f} degrees of freedom); with the rejected {:.4f}, floor {:.4f}\n",
      fit.floor->Length(),
      per_coordinate,
      fit.floor->Coordinate(),
      fit.floor->redundancy,
      fit.rms_all / fit.floor->Length() * fit.floor->Coordinate(),
      fit.floor_all->Coordinate());
}

std::string KindText(std::string_view name, const CameraFit& fit) {
  if (fit.kinds.empty()) return {};
  std::string text = fmt::format("  RMS by {}:", name);
  for (const auto& [number, kind] : fit.kinds) {
    text += fmt::format("{} {:.4f} px over {}",
                        number == fit.kinds.begin()->first ? "" : ",",
                        kind.rms,
                        kind.points);
  }
  return text + " points\n";
}

}  // namespace

std::string CalibrationYaml(const Calibration& calibration,
                            const std::vector<std::pair<std::string, std::string>>& provenance) {
  std::string text = "plenocal: 1\ncameras:\n";
  const auto out = std::back_inserter(text);
  for (size_t c = 0; c < calibration.camera_names.size(); ++c) {
    const BundleCamera& camera = calibration.bundle.cameras[c];
    const CameraModel& model = *camera.model;
    const CameraFit& fit = calibration.fits[c];
    const Vector6d xi = Log(camera.T_camera_rig);
    fmt::format_to(out, "  {}:\n    model: {}\n", calibration.camera_names[c], model.name);
    fmt::format_to(out,
                   "    image_size: [{}, {}]\n",
                   calibration.image_sizes[c][0],
                   calibration.image_sizes[c][1]);
    for (size_t i = 0; i < camera.config.size(); ++i) {
      fmt::format_to(out, "    {}: {}\n", model.config[i].name, YamlNumber(camera.config[i]));
    }
    fmt::format_to(out, "    parameters: {}\n", ParameterMap(model, camera.params));
    fmt::format_to(out, "    sigma: {}\n", ParamMap(model, calibration.uncertainty.params[c]));
    const std::vector<std::string_view> at_bound = AtBound(camera);
    if (!at_bound.empty()) {
      fmt::format_to(out, "    at_bound: [{}]\n", fmt::join(at_bound, ", "));
    }
    const auto& jackknife = calibration.jackknife;
    if (jackknife) {
      fmt::format_to(out, "    sigma_jackknife: {}\n", ParamMap(model, jackknife->params[c]));
    }
    fmt::format_to(out, "    correlation: {}\n", CorrelationTriangle(calibration, c));
    fmt::format_to(out, "    T_camera_rig: {}\n", YamlMatrix(camera.T_camera_rig));
    fmt::format_to(out, "    xi_camera_rig: {}\n", YamlList(xi));
    fmt::format_to(out, "    sigma_xi: {}\n", YamlList(SigmaXi(calibration, c)));
    if (jackknife) {
      fmt::format_to(out, "    sigma_xi_jackknife: {}\n", YamlList(jackknife->xi[c]));
    }
    fmt::format_to(out,
                   "    residuals: {{points: {}, rms: {}, rejected: {}, views: {}, noise: {}",
                   fit.points,
                   YamlNumber(fit.rms),
                   fit.rejected,
                   fit.views,
                   YamlNumber(fit.sigma));
    if (fit.stated_sigma > 0) {
      fmt::format_to(out, ", detector_sigma: {}", YamlNumber(fit.stated_sigma));
    }
    if (camera.common_noise > 0) {
      fmt::format_to(out, ", common_noise: {}", YamlNumber(camera.common_noise));
    }
    if (fit.floor) {
      fmt::format_to(out,
                     ", floor: {}, rms_all: {}, floor_all: {}",
                     YamlNumber(fit.floor->Length()),
                     YamlNumber(fit.rms_all),
                     YamlNumber(fit.floor_all->Length()));
    }
    if (!fit.kinds.empty()) {
      text += ", rms_by_type: {";
      for (const auto& [number, kind] : fit.kinds) {
        fmt::format_to(out,
                       "{}{}: {}",
                       number == fit.kinds.begin()->first ? "" : ", ",
                       number,
                       YamlNumber(kind.rms));
      }
      text += "}";
    }
    text += "}\n";
    if (c >= calibration.camera_files.size()) continue;
    for (const auto& [key, name] : calibration.camera_files[c]) {
      fmt::format_to(out, "    {}: {}\n", key, name);
    }
  }
  fmt::format_to(out, "frames: {}\n", calibration.frames.size());
  fmt::format_to(out,
                 "adjustment: {{converged: {}, iterations: {}, rejection_sigmas: {}, "
                 "marker_sigma: {}}}\n",
                 calibration.converged,
                 calibration.iterations,
                 YamlNumber(calibration.rejection_threshold),
                 YamlNumber(calibration.bundle.marker_sigma));

  if (const Jitter& jitter = calibration.bundle.jitter; !jitter.delta.empty()) {
    fmt::format_to(out,
                   "jitter: {{translation: {}, rotation: {}, misplaced: {}}}\n",
                   YamlNumber(jitter.translation_sigma),
                   YamlNumber(jitter.rotation_sigma),
                   std::count(jitter.misplaced.begin(), jitter.misplaced.end(), true));
  }

  // Unknowns with a strong correlation: the reader of a sigma needs to know of them.
  constexpr double kStrong = 0.9;
  const Uncertainty& uncertainty = calibration.uncertainty;
  const auto [names, correlation] = CorrelationsOf(calibration);
  text += "correlations:";
  bool any = false;
  for (Eigen::Index i = 0; i < correlation.rows(); ++i) {
    for (Eigen::Index j = 0; j < i; ++j) {
      if (std::abs(correlation(i, j)) < kStrong) continue;
      fmt::format_to(out,
                     "\n  - [{}, {}, {:.4f}]",
                     names[static_cast<size_t>(j)],
                     names[static_cast<size_t>(i)],
                     correlation(i, j));
      any = true;
    }
  }
  text += any ? "\n" : " []\n";
  text += "undetermined:";
  for (const OpenDirection& direction : uncertainty.open) {
    fmt::format_to(out, "\n  - {{sigma: {}, parameters: {{", YamlNumber(direction.sigma));
    for (size_t i = 0; i < direction.parts.size(); ++i) {
      fmt::format_to(out,
                     "{}{}: {:.3f}",
                     i == 0 ? "" : ", ",
                     direction.parts[i].first,
                     direction.parts[i].second);
    }
    text += "}}";
  }
  text += uncertainty.open.empty() ? " []\n" : "\n";
  const std::vector<WeakUnknowns> weak = FindWeakUnknowns(calibration);
  text += "weak:";
  for (const WeakUnknowns& unknowns : weak) {
    fmt::format_to(out,
                   "\n  - {{parameters: [{}], determined: {}, what: {}, remedy: {}}}",
                   fmt::join(unknowns.names, ", "),
                   !unknowns.open,
                   YamlQuoted(unknowns.what),
                   YamlQuoted(unknowns.remedy));
  }
  text += weak.empty() ? " []\n" : "\n";
  const auto list = [&](const char* key, const std::vector<std::string>& lines) {
    fmt::format_to(out, "{}:", key);
    for (const std::string& line : lines) fmt::format_to(out, "\n  - {}", YamlQuoted(line));
    text += lines.empty() ? " []\n" : "\n";
  };
  list("warnings", calibration.warnings);
  std::vector<std::string> left_out;
  for (const LeftOut& item : calibration.left_out)
    left_out.push_back(item.where + ": " + item.reason);
  list("left_out", left_out);
  text += "provenance:\n";
  for (const auto& [key, value] : provenance) {
    fmt::format_to(out, "  {}: {}\n", key, YamlQuoted(value));
  }
  return text;
}

CalibratedCamera CameraOf(const Calibration& calibration, size_t c) {
  const BundleCamera& camera = calibration.bundle.cameras[c];
  const std::vector<double>& sigma = calibration.uncertainty.params[c];
  return {calibration.camera_names[c],
          camera.model,
          calibration.image_sizes[c],
          camera.config,
          camera.params,
          CovarianceOf(sigma, ParamCorrelation(calibration, c)),
          camera.T_camera_rig,
          SigmaXi(calibration, c)};
}

std::string PosesCsv(const Calibration& calibration) {
  std::string text = "frame,x,y,z,qx,qy,qz,qw\n";
  for (size_t f = 0; f < calibration.frames.size(); ++f) {
    text +=
        calibration.frames[f] + PoseColumns(calibration.bundle.T_rig_target[f].Inverse()) + "\n";
  }
  return text;
}

std::string ViewPosesCsv(const Calibration& calibration) {
  const Bundle& bundle = calibration.bundle;
  const bool has_jitter = !bundle.jitter.delta.empty();
  std::string text = "camera,frame,x,y,z,qx,qy,qz,qw,misplaced\n";
  std::vector<bool> used(calibration.frames.size() * bundle.cameras.size(), false);
  for (const BundleObservation& observation : bundle.observations) {
    if (!observation.used) continue;
    used[bundle.View(static_cast<size_t>(observation.frame),
                     static_cast<size_t>(observation.camera))] = true;
  }
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    for (size_t f = 0; f < calibration.frames.size(); ++f) {
      const size_t view = bundle.View(f, c);
      if (!used[view]) continue;
      text += calibration.camera_names[c] + "," + calibration.frames[f] +
              PoseColumns(bundle.SeenPose(f, c).Inverse()) +
              (has_jitter && bundle.jitter.misplaced[view] ? ",1\n" : ",0\n");
    }
  }
  return text;
}

std::string ResidualsCsv(const Calibration& calibration) {
  constexpr int kDecimals = 5;
  constexpr int kSigmaDecimals = 9;  // simulated observations may be all but exact
  const Bundle& bundle = calibration.bundle;
  const auto measured = UnionOf(bundle, &CameraModel::measured);
  const auto context = UnionOf(bundle, &CameraModel::context);
  std::string text = "camera,frame,marker";
  for (const std::string_view name : measured) text.append(",").append(name);
  for (const std::string_view name : measured) text.append(",d").append(name);
  text += ",used";
  for (const std::string_view name : context) text.append(",").append(name);
  text += ",sigma\n";
  text.reserve(text.size() + 64 * bundle.observations.size());

  // Camera by camera, as a reader of one camera expects.
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const CameraModel& model = *bundle.cameras[c].model;
    const auto number =
        [&](std::span<const std::string_view> own, std::string_view name, const double* values) {
          text += ',';
          const int index = IndexOf(own, name);
          if (index >= 0 && values != nullptr) AppendFixed(values[index], kDecimals, &text);
        };
    for (const BundleObservation& observation : bundle.observations) {
      if (observation.camera != static_cast<int>(c)) continue;
      double residual[kMaxObservationSize];
      const bool projects = Residual(bundle, observation, residual);
      text.append(calibration.camera_names[c])
          .append(",")
          .append(calibration.frames[static_cast<size_t>(observation.frame)])
          .append(",")
          .append(std::to_string(bundle.markers[static_cast<size_t>(observation.marker)].number));
      const double* values = observation.seen.values.data();
      for (const std::string_view name : measured) number(model.measured, name, values);
      for (const std::string_view name : measured) {
        number(model.measured, name, projects ? residual : nullptr);
      }
      text += observation.used ? ",1" : ",0";
      for (const std::string_view name : context) {
        number(model.context, name, values + model.measured.size());
      }
      text += ',';
      AppendFixed(NoiseSigma(bundle.cameras[c], observation.seen), kSigmaDecimals, &text);
      text += '\n';
    }
  }
  return text;
}

Correlations CorrelationsOf(const Calibration& calibration) {
  const Uncertainty& uncertainty = calibration.uncertainty;
  Correlations result{uncertainty.names, uncertainty.correlation};
  // Mounts were estimated in another chart than files hold.
  Eigen::VectorXd sigma = uncertainty.covariance.diagonal().cwiseMax(0).cwiseSqrt();
  for (size_t c = 0; c < uncertainty.mount_places.size(); ++c) {
    const int place = uncertainty.mount_places[c];
    if (place < 0) continue;
    Matrix6d J = LogJacobian(calibration.bundle.cameras[c].T_camera_rig) *
                 sigma.segment<6>(place).asDiagonal();
    const Vector6d sigma_xi =
        (J * result.matrix.block<6, 6>(place, place) * J.transpose()).diagonal().cwiseSqrt();
    J = sigma_xi.cwiseMax(1e-300).cwiseInverse().asDiagonal() * J;
    result.matrix.middleRows<6>(place) = (J * result.matrix.middleRows<6>(place)).eval();
    result.matrix.middleCols<6>(place) =
        (result.matrix.middleCols<6>(place) * J.transpose()).eval();
  }
  return result;
}

std::string CorrelationsCsv(const Calibration& calibration) {
  const auto [names, matrix] = CorrelationsOf(calibration);
  std::string text = "unknown";
  for (const std::string& name : names) text += "," + name;
  text += '\n';
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    text += names[static_cast<size_t>(i)];
    for (Eigen::Index j = 0; j < matrix.cols(); ++j) {
      fmt::format_to(std::back_inserter(text), ",{:.12g}", matrix(i, j));
    }
    text += '\n';
  }
  return text;
}

std::string Summary(const Calibration& calibration) {
  std::string text;
  const auto out = std::back_inserter(text);
  const Bundle& bundle = calibration.bundle;
  fmt::format_to(out,
                 "{} camera{}, {} frames, {} markers; {} iterations, {}\n",
                 bundle.cameras.size(),
                 bundle.cameras.size() == 1 ? "" : "s",
                 calibration.frames.size(),
                 bundle.markers.size(),
                 calibration.iterations,
                 calibration.converged ? "converged" : "NOT CONVERGED");
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const BundleCamera& camera = bundle.cameras[c];
    const CameraFit& fit = calibration.fits[c];
    fmt::format_to(out,
                   "\n{}  ({}, {} x {} px)\n",
                   calibration.camera_names[c],
                   camera.model->name,
                   calibration.image_sizes[c][0],
                   calibration.image_sizes[c][1]);
    fmt::format_to(
        out,
        "  RMS {:.4f} px over {} points in {} images, {} rejected; noise {:.4f} px a coordinate",
        fit.rms,
        fit.points,
        fit.views,
        fit.rejected,
        fit.sigma);
    if (fit.stated_sigma > 0) fmt::format_to(out, " (detector: {:.4f})", fit.stated_sigma);
    if (camera.common_noise > 0) {
      fmt::format_to(out, ", {:.4f} of it common to a marker's points", camera.common_noise);
    }
    text += '\n' + FloorText(fit) + KindText(camera.model->kind_name, fit);
    std::vector<std::string_view> of_field;
    for (size_t i = 0; i < camera.params.size(); ++i) {
      const Param& param = camera.model->params[i];
      if (param.prior_sigma > 0) {
        of_field.push_back(param.name);
        continue;
      }
      fmt::format_to(
          out,
          "    {:<6} {}{}{}{}{}\n",
          param.name,
          WithSigma(camera.params[i], calibration.uncertainty.params[c][i]),
          param.unit == "1" ? "" : fmt::format(" {}", param.unit),
          camera.fixed[i] ? "  (held)" : "",
          RuleText(calibration, c, i),
          calibration.jackknife && !camera.fixed[i]
              ? fmt::format("  (jackknife +- {:.2g})", calibration.jackknife->params[c][i])
              : "");
    }
    if (!of_field.empty()) {
      fmt::format_to(out,
                     "    {} ... {}: {} coefficients of a field over the image\n",
                     of_field.front(),
                     of_field.back(),
                     of_field.size());
    }
    if (camera.is_master) continue;
    // Where the camera stands in the rig: its centre and how it is turned.
    const RigidTransform T_rig_camera = camera.T_camera_rig.Inverse();
    const Matrix6d& covariance = calibration.uncertainty.mount[c];
    const Eigen::Vector3d sigma =
        covariance.diagonal().tail<3>().cwiseMax(0).cwiseSqrt() * kDegrees;
    const Eigen::Vector3d along = T_rig_camera.t.normalized();
    // centre = -R' t: d centre = -R' dv + R' [t]x dw... to first order along the baseline.
    Eigen::Matrix<double, 1, 6> J;
    J.leftCols<3>() = -along.transpose() * camera.T_camera_rig.R.transpose();
    J.rightCols<3>() =
        -along.transpose() * camera.T_camera_rig.R.transpose() * Hat(camera.T_camera_rig.t);
    const double sigma_baseline =
        covariance.allFinite() ? std::sqrt(std::max(0.0, (J * covariance * J.transpose()).value()))
                               : std::numeric_limits<double>::infinity();
    const Eigen::Vector3d w = LogRotation(camera.T_camera_rig.R) * kDegrees;
    fmt::format_to(out,
                   "    in the rig of {}: baseline {} mm, centre ({:.3f}, {:.3f}, {:.3f}) mm\n",
                   calibration.camera_names[0],
                   WithSigma(1e3 * T_rig_camera.t.norm(), 1e3 * sigma_baseline),
                   1e3 * T_rig_camera.t.x(),
                   1e3 * T_rig_camera.t.y(),
                   1e3 * T_rig_camera.t.z());
    fmt::format_to(out,
                   "    turned by ({}, {}, {}) degrees about x, y, z\n",
                   WithSigma(w.x(), sigma.x()),
                   WithSigma(w.y(), sigma.y()),
                   WithSigma(w.z(), sigma.z()));
  }
  if (bundle.marker_sigma > 0) {
    double sum = 0, largest = 0;
    int worst = 0;
    for (const BundleMarker& marker : bundle.markers) {
      const double moved = (marker.position - marker.nominal).norm();
      sum += moved * moved;
      if (moved > largest) {
        largest = moved;
        worst = marker.number;
      }
    }
    fmt::format_to(
        out,
        "\nmarkers moved by {:.3f} mm RMS from their nominal places (tolerance {:.3f} mm a "
        "coordinate), at most {:.3f} mm (marker {})\n",
        1e3 * std::sqrt(sum / static_cast<double>(bundle.markers.size())),
        1e3 * bundle.marker_sigma,
        1e3 * largest,
        worst);
  }
  const std::vector<WeakUnknowns> weak = FindWeakUnknowns(calibration);
  const auto list = [&](bool open, const char* heading) {
    bool any = false;
    for (const WeakUnknowns& unknowns : weak) {
      if (unknowns.open != open) continue;
      if (!any) text += heading;
      any = true;
      fmt::format_to(
          out, "  {}: {}\n    {}\n", Listed(unknowns.names), unknowns.what, unknowns.remedy);
    }
  };
  list(true, "\nNOT DETERMINED by these images:\n");
  list(false, "\nweakly determined by these images:\n");
  for (const std::string& warning : calibration.warnings) {
    fmt::format_to(out, "\nWARNING: {}\n", warning);
  }
  return text;
}

}  // namespace plenocal
