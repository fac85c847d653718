// SPDX-License-Identifier: Apache-2.0
#include "apps/report/results.h"

#include <fmt/format.h>

#include <unordered_map>

#include "apps/report/csv_table.h"
#include "calib/error.h"
#include "models/registry.h"
#include "targets/target.h"

namespace plenocal {
namespace {

/// A file of the calibration and the name that messages give it.
class FileReader {
 public:
  FileReader(const ResultFiles& files, std::string folder)
      : files_(files), folder_(std::move(folder)) {}

  [[nodiscard]] bool Has(const std::string& name) const { return files_.contains(name); }
  [[nodiscard]] std::string Path(const std::string& name) const { return folder_ + "/" + name; }
  [[nodiscard]] YamlNode Yaml(const std::string& name) const {
    return YamlNode::Parse(Text(name), Path(name));
  }
  [[nodiscard]] CsvTable Csv(const std::string& name) const { return {Text(name), Path(name)}; }
  [[nodiscard]] const std::string& Text(const std::string& name) const {
    const auto found = files_.find(name);
    if (found != files_.end()) return found->second;
    throw Error(ErrorKind::kInput,
                fmt::format("{}: no such file; is this the folder that 'plenocal calibrate' wrote?",
                            Path(name)));
  }

 private:
  const ResultFiles& files_;
  std::string folder_;
};

std::vector<std::string> Strings(const YamlNode& node, std::string_view key) {
  std::vector<std::string> strings;
  if (!node.Has(key)) return strings;
  for (const YamlNode& item : node.At(key).Elements()) strings.push_back(item.AsString());
  return strings;
}

std::optional<double> OptionalNumber(const YamlNode& node, std::string_view key) {
  if (!node.Has(key)) return std::nullopt;
  return node.At(key).AsNumber();
}

CameraResult ReadCamera(const std::string& name, const YamlNode& node) {
  CameraResult camera;
  static_cast<CalibratedCamera&>(camera) = ReadCalibratedCamera(name, node, CameraModels());
  camera.xi = node.At("xi_camera_rig").AsNumbers(6);
  const YamlNode residuals = node.At("residuals");
  camera.points = residuals.At("points").AsInteger();
  camera.rejected = residuals.At("rejected").AsInteger();
  camera.views = residuals.At("views").AsInteger();
  camera.rms = residuals.At("rms").AsNumber();
  camera.noise = residuals.At("noise").AsNumber();
  camera.stated_sigma = OptionalNumber(residuals, "detector_sigma");
  camera.floor = OptionalNumber(residuals, "floor");
  for (const auto& [key, text] : {std::pair("sample", &camera.sample),
                                  std::pair("sample_depth", &camera.sample_depth),
                                  std::pair("sample_frame", &camera.sample_frame)}) {
    if (node.Has(key)) *text = node.At(key).AsString();
  }
  if (residuals.Has("rms_by_type")) {
    for (const auto& [type, rms] : residuals.At("rms_by_type").Entries()) {
      camera.rms_by_type[type] = rms.AsNumber();
    }
  }
  return camera;
}

// `weak` where the file has it; else what `undetermined` says.
std::vector<WeakResult> ReadWeak(const YamlNode& node) {
  std::vector<WeakResult> weak;
  if (node.Has("weak")) {
    for (const YamlNode& item : node.At("weak").Elements()) {
      weak.push_back({Strings(item, "parameters"),
                      item.At("determined").AsBool(),
                      item.At("what").AsString(),
                      item.At("remedy").AsString()});
    }
  } else if (node.Has("undetermined")) {
    for (const YamlNode& item : node.At("undetermined").Elements()) {
      WeakResult open;
      for (const auto& [name, share] : item.At("parameters").Entries()) {
        open.parameters.push_back(name);
      }
      weak.push_back(std::move(open));
    }
  }
  return weak;
}

RigidTransform Pose(const CsvTable& table, size_t row, size_t first) {
  RigidTransform T;
  for (size_t i = 0; i < 3; ++i) {
    T.t[static_cast<Eigen::Index>(i)] = table.Number(row, first + i);
  }
  const Eigen::Quaterniond q(table.Number(row, first + 6),
                             table.Number(row, first + 3),
                             table.Number(row, first + 4),
                             table.Number(row, first + 5));
  T.R = q.normalized().toRotationMatrix();
  return T;
}

class ResultReader {
 public:
  ResultReader(const ResultFiles& files, const std::string& folder) : files_(files, folder) {}

  Results Read() {
    ReadCalibration();
    ReadMarkers();
    ReadPoses();
    if (files_.Has("view_poses.csv")) ReadViewPoses();
    ReadResiduals();
    if (files_.Has("correlations.csv")) {
      results_.correlations =
          ReadCorrelations(files_.Text("correlations.csv"), files_.Path("correlations.csv"));
    }
    return std::move(results_);
  }

 private:
  void ReadCalibration() {
    const YamlNode node = files_.Yaml("calibration.yaml");
    node.CheckVersion();
    for (const auto& [name, camera] : node.At("cameras").Entries()) {
      camera_index_[name] = results_.cameras.size();
      results_.cameras.push_back(ReadCamera(name, camera));
    }
    if (node.Has("adjustment")) {
      results_.converged = node.At("adjustment").At("converged").AsBool();
      results_.marker_tolerance = node.At("adjustment").At("marker_sigma").AsNumber();
    }
    results_.weak = ReadWeak(node);
    results_.warnings = Strings(node, "warnings");
    results_.left_out = Strings(node, "left_out");
    if (node.Has("provenance")) {
      for (const auto& [key, value] : node.At("provenance").Entries()) {
        results_.provenance.emplace_back(key, value.AsString());
      }
    }
  }

  void ReadMarkers() {
    const YamlNode node = files_.Yaml("target.yaml");
    const Target target = ReadTarget(node);
    results_.markers = target.markers;
    results_.nominal_markers = NominalTarget(target).markers;
    if (!node.Has("sigma")) return;
    for (const auto& [key, value] : node.At("sigma").Entries()) {
      const std::vector<double> sigma = value.AsNumbers(3);
      results_.marker_sigma[std::stoi(key)] = {sigma[0], sigma[1], sigma[2]};
    }
  }

  void ReadPoses() {
    const CsvTable table = files_.Csv("poses.csv");
    const size_t frame = table.Column("frame"), first = table.Column("x");
    for (size_t row = 0; row < table.Rows(); ++row) {
      frame_index_[std::string(table.Text(row, frame))] = static_cast<int>(results_.frames.size());
      results_.frames.emplace_back(table.Text(row, frame));
      results_.T_target_rig.push_back(Pose(table, row, first));
    }
    results_.seen_poses.resize(results_.cameras.size());
  }

  void ReadViewPoses() {
    const CsvTable table = files_.Csv("view_poses.csv");
    const size_t camera = table.Column("camera"), frame = table.Column("frame"),
                 first = table.Column("x");
    for (size_t row = 0; row < table.Rows(); ++row) {
      results_.seen_poses[Camera(table, row, camera)][Frame(table, row, frame)] =
          Pose(table, row, first);
    }
  }

  void ReadResiduals() {
    const CsvTable table = files_.Csv("residuals.csv");
    const size_t camera = table.Column("camera"), frame = table.Column("frame"),
                 marker = table.Column("marker"), used = table.Column("used");
    const bool has_sigma = table.Has("sigma");
    const size_t sigma = has_sigma ? table.Column("sigma") : 0;
    std::vector<std::vector<size_t>> values, d;  // columns of each camera's model
    for (const CameraResult& each : results_.cameras) {
      values.emplace_back();
      d.emplace_back();
      for (const std::string_view name : each.model->measured) {
        values.back().push_back(table.Column(name));
        d.back().push_back(table.Column("d" + std::string(name)));
      }
      for (const std::string_view name : each.model->context) {
        values.back().push_back(table.Column(name));
      }
    }
    for (size_t row = 0; row < table.Rows(); ++row) {
      const size_t c = Camera(table, row, camera);
      ResidualRow residual;
      residual.frame = Frame(table, row, frame);
      residual.marker = table.Integer(row, marker);
      if (!results_.markers.contains(residual.marker)) {
        table.Fail(row, fmt::format("marker {} is not in target.yaml", residual.marker));
      }
      for (size_t i = 0; i < values[c].size(); ++i) {
        residual.values[i] = table.Number(row, values[c][i]);
      }
      residual.d = {table.Number(row, d[c][0]), table.Number(row, d[c][1])};
      residual.used = table.Text(row, used) == "1";
      if (has_sigma) residual.sigma = table.Number(row, sigma);
      if (residual.used && !residual.d.allFinite()) table.Fail(row, "a used row without residual");
      results_.cameras[c].residuals.push_back(residual);
    }
  }

  [[nodiscard]] size_t Camera(const CsvTable& table, size_t row, size_t column) const {
    const auto found = camera_index_.find(std::string(table.Text(row, column)));
    if (found != camera_index_.end()) return found->second;
    table.Fail(row, fmt::format("camera '{}' is not in calibration.yaml", table.Text(row, column)));
  }

  [[nodiscard]] int Frame(const CsvTable& table, size_t row, size_t column) const {
    const auto found = frame_index_.find(std::string(table.Text(row, column)));
    if (found != frame_index_.end()) return found->second;
    table.Fail(row, fmt::format("frame '{}' is not in poses.csv", table.Text(row, column)));
  }

  FileReader files_;
  Results results_;
  std::unordered_map<std::string, size_t> camera_index_;
  std::unordered_map<std::string, int> frame_index_;
};

}  // namespace

RigidTransform Results::CameraFromTarget(size_t camera, int frame) const {
  const auto seen = seen_poses[camera].find(frame);
  const RigidTransform& T =
      seen == seen_poses[camera].end() ? T_target_rig[static_cast<size_t>(frame)] : seen->second;
  return cameras[camera].T_camera_rig * T.Inverse();
}

Results ReadResults(const ResultFiles& files, const std::string& folder) {
  return ResultReader(files, folder).Read();
}

Correlations ReadCorrelations(const std::string& text, const std::string& name) {
  const CsvTable table(text, name);
  const auto count = static_cast<Eigen::Index>(table.Rows());
  if (table.Header().size() != table.Rows() + 1) table.Fail(0, "the matrix is not square");
  Correlations correlations{{}, Eigen::MatrixXd(count, count)};
  for (Eigen::Index i = 0; i < count; ++i) {
    const auto row = static_cast<size_t>(i);
    correlations.names.emplace_back(table.Text(row, 0));
    for (Eigen::Index j = 0; j < count; ++j) {
      correlations.matrix(i, j) = table.Number(row, static_cast<size_t>(j) + 1);
    }
  }
  return correlations;
}

}  // namespace plenocal
