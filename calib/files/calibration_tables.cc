// SPDX-License-Identifier: Apache-2.0
#include "calib/files/calibration_tables.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <set>
#include <string_view>
#include <unordered_map>

#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"
#include "calib/files/checks/correlation_check.h"
#include "calib/io/csv.h"

namespace plenocal {
namespace {

// Quaternions that people typed have few digits.
constexpr double kUnitQuaternion = 1e-3;

std::string PoseCells(const RigidTransform& T) {
  const Eigen::Quaterniond q(T.R);
  return fmt::format(",{:.12g},{:.12g}", fmt::join(T.t, ","), fmt::join(q.coeffs(), ","));
}

// The columns x, y, z, qx, qy, qz, qw.
struct PoseColumns {
  explicit PoseColumns(const CsvReader& table)
      : t{table.Column("x"), table.Column("y"), table.Column("z")},
        q{table.Column("qx"), table.Column("qy"), table.Column("qz"), table.Column("qw")} {}

  [[nodiscard]] RigidTransform Read(const CsvReader& table) const {
    const Eigen::Quaterniond rotation(
        table.Number(q[3]), table.Number(q[0]), table.Number(q[1]), table.Number(q[2]));
    if (!(std::abs(rotation.norm() - 1) < kUnitQuaternion)) {
      table.FailAt(q[0], fmt::format("the quaternion has length {:.6g}, not 1", rotation.norm()));
    }
    return {rotation.normalized().toRotationMatrix(),
            {table.Number(t[0]), table.Number(t[1]), table.Number(t[2])}};
  }

  std::array<size_t, 3> t;
  std::array<size_t, 4> q;
};

// Rows of a table by the names of cameras and frames.
class RecordIndex {
 public:
  explicit RecordIndex(const CalibrationRecord& calibration) {
    for (const CalibratedCamera& camera : calibration.cameras) {
      cameras_.emplace(camera.name, cameras_.size());
    }
    for (const FrameRecord& frame : calibration.frames) {
      frames_.emplace(frame.name, static_cast<int>(frames_.size()));
    }
  }

  [[nodiscard]] size_t Camera(const CsvReader& table, size_t column) const {
    const auto found = cameras_.find(std::string(table.Text(column)));
    if (found != cameras_.end()) return found->second;
    table.FailAt(column, fmt::format("'{}' is not in calibration.yaml", table.Text(column)));
  }

  [[nodiscard]] int Frame(const CsvReader& table, size_t column) const {
    const auto found = frames_.find(std::string(table.Text(column)));
    if (found != frames_.end()) return found->second;
    table.FailAt(column, fmt::format("'{}' is not in poses.csv", table.Text(column)));
  }

 private:
  std::unordered_map<std::string, size_t> cameras_;
  std::unordered_map<std::string, int> frames_;
};

using Names = std::span<const std::string_view>;

// Names of columns, each once, in the order in which the cameras' models bring them.
std::vector<std::string_view> UnionOf(const CalibrationRecord& calibration,
                                      Names CameraModel::*names) {
  std::vector<std::string_view> all;
  for (const CalibratedCamera& camera : calibration.cameras) {
    for (const std::string_view name : camera.model->*names) {
      if (std::ranges::find(all, name) == all.end()) all.push_back(name);
    }
  }
  return all;
}

// Appends a cell for each of `columns`: the value of that name, or nothing.
void AppendCells(const std::vector<std::string_view>& columns,
                 Names names,
                 const double* values,
                 std::string* text) {
  for (const std::string_view column : columns) {
    text->push_back(',');
    const auto found = std::ranges::find(names, column);
    if (found == names.end()) continue;
    const double value = values[found - names.begin()];
    if (!std::isnan(value)) AppendFixed(value, kResidualDecimals, text);
  }
}

// Columns of residuals.csv that belong to one camera's model.
struct ResidualColumns {
  ResidualColumns(const CsvReader& table, const CameraModel& model) {
    for (const std::string_view name : model.measured) {
      values.push_back(table.Column(name));
      residual.push_back(table.Column(fmt::format("d{}", name)));
    }
    for (const std::string_view name : model.context) values.push_back(table.Column(name));
  }

  std::vector<size_t> values, residual;
};

}  // namespace

std::string PosesCsv(const CalibrationRecord& calibration) {
  std::string text = "frame,x,y,z,qx,qy,qz,qw\n";
  for (const FrameRecord& frame : calibration.frames) {
    text.append(CsvCell(frame.name)).append(PoseCells(frame.T_target_rig)).append("\n");
  }
  return text;
}

std::vector<FrameRecord> ReadPoses(const std::filesystem::path& path) {
  CsvReader table(path);
  const size_t name = table.Column("frame");
  const PoseColumns pose(table);
  std::vector<FrameRecord> frames;
  std::set<std::string_view> names;
  while (table.Next()) {
    if (const auto defect = FrameNameDefect(table.Text(name))) {
      table.FailAt(name, "this frame's name " + *defect);
    }
    if (!names.insert(table.Text(name)).second) {
      table.FailAt(name, fmt::format("'{}' stands here twice", table.Text(name)));
    }
    frames.push_back({std::string(table.Text(name)), pose.Read(table)});
  }
  return frames;
}

std::string ViewPosesCsv(const CalibrationRecord& calibration) {
  std::string text = "camera,frame,x,y,z,qx,qy,qz,qw,misplaced\n";
  for (const CalibratedCamera& camera : calibration.cameras) {
    for (const auto& [frame, view] : camera.view_poses) {
      text.append(CsvCell(camera.name))
          .append(",")
          .append(CsvCell(calibration.frames[static_cast<size_t>(frame)].name))
          .append(PoseCells(view.T_target_rig))
          .append(view.misplaced ? ",1\n" : ",0\n");
    }
  }
  return text;
}

void ReadViewPoses(const std::filesystem::path& path, CalibrationRecord* calibration) {
  CsvReader table(path);
  const size_t camera = table.Column("camera"), frame = table.Column("frame");
  const std::optional<size_t> misplaced = table.Find("misplaced");
  const PoseColumns pose(table);
  const RecordIndex index(*calibration);
  while (table.Next()) {
    ViewPose& view =
        calibration->cameras[index.Camera(table, camera)].view_poses[index.Frame(table, frame)];
    view.T_target_rig = pose.Read(table);
    view.misplaced = misplaced && table.Text(*misplaced) == "1";
  }
}

std::string ScenePointsCsv(const CalibrationRecord& calibration) {
  std::string text = "marker,x,y,z\n";
  for (const auto& [number, point] : calibration.markers) {
    fmt::format_to(
        std::back_inserter(text), "{},{:.12g}\n", number, fmt::join(point.position, ","));
  }
  return text;
}

std::vector<std::pair<int, Eigen::Vector3d>> ReadScenePoints(const std::filesystem::path& path) {
  CsvReader table(path, CsvSyntax::kCsv, {}, "marker,x,y,z");
  const size_t marker = table.Column("marker"), x = table.Column("x"), y = table.Column("y"),
               z = table.Column("z");
  std::vector<std::pair<int, Eigen::Vector3d>> points;
  std::set<int> numbers;
  while (table.Next()) {
    const int number = table.Integer(marker);
    if (!numbers.insert(number).second) {
      table.FailAt(marker, fmt::format("point {} stands here twice", number));
    }
    points.emplace_back(number, Eigen::Vector3d(table.Number(x), table.Number(y), table.Number(z)));
  }
  return points;
}

std::string ResidualsCsv(const CalibrationRecord& calibration) {
  const auto measured = UnionOf(calibration, &CameraModel::measured);
  const auto context = UnionOf(calibration, &CameraModel::context);
  std::string text = "camera,frame,marker";
  for (const std::string_view name : measured) text.append(",").append(name);
  for (const std::string_view name : measured) text.append(",d").append(name);
  text += ",used";
  for (const std::string_view name : context) text.append(",").append(name);
  text += ",noise_sigma\n";
  // A text that grows by doubling takes three times its size at the last.
  constexpr size_t kFirst = 1000;
  size_t rows = 0, written = 0;
  for (const CalibratedCamera& camera : calibration.cameras) rows += camera.residuals.size();
  for (const CalibratedCamera& camera : calibration.cameras) {
    const CameraModel& model = *camera.model;
    for (const ResidualRow& row : camera.residuals) {
      if (++written == kFirst) text.reserve(text.size() / kFirst * (rows + rows / 10));
      text.append(CsvCell(camera.name))
          .append(",")
          .append(CsvCell(calibration.frames[static_cast<size_t>(row.frame)].name))
          .append(",")
          .append(std::to_string(row.marker));
      AppendCells(measured, model.measured, row.values.data(), &text);
      AppendCells(measured, model.measured, row.residual.data(), &text);
      text += row.used ? ",1" : ",0";
      AppendCells(context, model.context, row.values.data() + model.measured.size(), &text);
      text += ',';
      AppendFixed(row.noise_sigma, kNoiseSigmaDecimals, &text);
      text += '\n';
    }
  }
  return text;
}

void ReadResiduals(const std::filesystem::path& path, CalibrationRecord* calibration) {
  CsvReader table(path);
  const size_t camera = table.Column("camera"), frame = table.Column("frame"),
               marker = table.Column("marker"), used = table.Column("used");
  const std::optional<size_t> noise_sigma =
      table.Find("noise_sigma") ? table.Find("noise_sigma") : table.Find("sigma");
  std::vector<ResidualColumns> columns;
  for (const CalibratedCamera& each : calibration->cameras)
    columns.emplace_back(table, *each.model);
  const RecordIndex index(*calibration);
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  while (table.Next()) {
    const size_t c = index.Camera(table, camera);
    ResidualRow row;
    row.frame = index.Frame(table, frame);
    row.marker = table.Integer(marker);
    if (!calibration->markers.contains(row.marker)) {
      table.FailAt(marker,
                   fmt::format("{} is not in {}",
                               row.marker,
                               calibration->HasScene() ? "points.csv" : "target.yaml"));
    }
    for (size_t i = 0; i < columns[c].values.size(); ++i) {
      row.values[i] = table.Number(columns[c].values[i]);
    }
    row.used = table.Text(used) == "1";
    for (size_t i = 0; i < columns[c].residual.size(); ++i) {
      const size_t column = columns[c].residual[i];
      row.residual[i] = table.NumberIfAny(column).value_or(kNone);
      if (row.used && std::isnan(row.residual[i])) {
        table.FailAt(column, "a used observation needs a residual, found nothing");
      }
    }
    if (noise_sigma) row.noise_sigma = table.NumberIfAny(*noise_sigma).value_or(0);
    calibration->cameras[c].residuals.push_back(row);
  }
}

std::string CorrelationsCsv(const Correlations& correlations) {
  const Eigen::MatrixXd& matrix = correlations.matrix;
  std::string text = "unknown";
  for (const std::string& name : correlations.names) text.append(",").append(CsvCell(name));
  text += '\n';
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    text += CsvCell(correlations.names[static_cast<size_t>(i)]);
    for (Eigen::Index j = 0; j < matrix.cols(); ++j) {
      fmt::format_to(std::back_inserter(text), ",{:.12g}", matrix(i, j));
    }
    text += '\n';
  }
  return text;
}

Correlations ReadCorrelations(const std::filesystem::path& path) {
  CsvReader table(path);
  const auto count = static_cast<Eigen::Index>(table.Header().size()) - 1;
  Correlations correlations{{}, Eigen::MatrixXd(count, count)};
  for (Eigen::Index i = 0; table.Next(); ++i) {
    if (i >= count) table.Fail("the matrix has more rows than columns");
    correlations.names.emplace_back(table.Text(0));
    if (table.Text(0) != table.Header()[static_cast<size_t>(i) + 1]) {
      table.FailAt(
          0,
          fmt::format("expected {}, as in the header", table.Header()[static_cast<size_t>(i) + 1]));
    }
    for (Eigen::Index j = 0; j < count; ++j) {
      correlations.matrix(i, j) = table.Number(static_cast<size_t>(j) + 1);
    }
  }
  if (static_cast<Eigen::Index>(correlations.names.size()) != count) {
    table.Fail("the matrix has fewer rows than columns (is the file truncated?)");
  }
  const auto defect =
      CorrelationDefect(correlations.matrix, correlations.names, kCorrelationRounding);
  if (defect) throw InputError("{}: {}", path.string(), *defect);
  return correlations;
}

Correlations ReadCorrelationsBeside(const CalibrationRecord& calibration) {
  const std::filesystem::path path = calibration.path.parent_path() / "correlations.csv";
  if (!std::filesystem::exists(path)) return {};
  Correlations correlations = ReadCorrelations(path);
  constexpr double kSame = 1e-6;  // of correlations that stand in both files
  for (const CalibratedCamera& camera : calibration.cameras) {
    const Eigen::VectorXd sigma = camera.covariance.diagonal().cwiseSqrt();
    std::vector<std::pair<Eigen::Index, Eigen::Index>> places;  // here and in the table
    for (size_t k = 0; k < camera.params.size(); ++k) {
      const std::string name = fmt::format("{}.{}", camera.name, camera.model->params[k].name);
      const auto found = std::ranges::find(correlations.names, name);
      const auto here = static_cast<Eigen::Index>(k);
      if (found == correlations.names.end() || !std::isfinite(sigma[here])) continue;
      places.emplace_back(here, found - correlations.names.begin());
    }
    for (const auto& [i, row] : places) {
      for (const auto& [j, column] : places) {
        const double expected = camera.covariance(i, j), size = sigma[i] * sigma[j];
        if (std::abs(correlations.matrix(row, column) * size - expected) <= kSame * size) continue;
        throw InputError(
            "{}: is of another calibration than {} beside it (the correlations "
            "of {} and {} differ); take both from one run, or remove it",
            path.string(),
            calibration.path.filename().string(),
            correlations.names[static_cast<size_t>(row)],
            correlations.names[static_cast<size_t>(column)]);
      }
    }
  }
  return correlations;
}

}  // namespace plenocal
