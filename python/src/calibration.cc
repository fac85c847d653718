// SPDX-License-Identifier: Apache-2.0
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <limits>

#include "apps/charts/field_map.h"
#include "apps/report/report.h"
#include "assess/residual_field.h"
#include "calib/files/calibration_file.h"
#include "calib/files/calibration_tables.h"
#include "calib/io/output_folder.h"
#include "engine/json/calibration_json.h"
#include "engine/session/calibration_folder.h"
#include "python/src/bindings.h"
#include "python/src/record.h"

namespace plenocal::python {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

Record Load(const std::filesystem::path& path) {
  const nb::gil_scoped_release release;
  if (std::filesystem::is_directory(path)) {
    return {OpenCalibrationFolder(path), {path, {}}};
  }
  return {OpenCalibration(path), {path.parent_path(), {}}};
}

Record OfCameras(const std::vector<CalibratedCamera>& cameras) {
  Record calibration;
  calibration.record.path = "calibration.yaml";
  calibration.record.cameras = cameras;
  return calibration;
}

std::string Yaml(const Record& calibration) {
  return calibration.record.adjustment
             ? CalibrationYaml(calibration.record)
             : GivenCamerasYaml(calibration.record.cameras, calibration.record.provenance);
}

void Save(const Record& calibration, const std::filesystem::path& path) {
  WriteOutput(path, Yaml(calibration));
}

std::string Report(const Record& calibration) {
  const nb::gil_scoped_release release;
  const bool is_read = calibration.files.folder.empty();
  return ReportHtml(
      calibration.record,
      is_read ? calibration.files : ReadCameraFiles(calibration.files.folder, calibration.record));
}

nb::dict Poses(const Record& calibration) {
  const std::vector<FrameRecord>& frames = calibration.record.frames;
  std::vector<std::string> names;
  Numbers poses = NewArray({frames.size(), 4, 4});
  for (size_t i = 0; i < frames.size(); ++i) {
    names.push_back(frames[i].name);
    const Numbers pose = ToArray(frames[i].T_target_rig);
    std::copy_n(pose.data(), 16, poses.data() + 16 * i);
  }
  nb::dict columns;
  columns["frame"] = names;
  columns["T_target_rig"] = poses;
  return columns;
}

nb::dict Markers(const Record& calibration) {
  const auto& markers = calibration.record.markers;
  std::vector<int> numbers;
  Numbers positions = NewArray({markers.size(), 3}), sigmas = NewArray({markers.size(), 3});
  for (const auto& [number, marker] : markers) {
    const size_t i = numbers.size();
    numbers.push_back(number);
    for (Eigen::Index k = 0; k < 3; ++k) {
      positions.data()[3 * i + static_cast<size_t>(k)] = marker.position[k];
      sigmas.data()[3 * i + static_cast<size_t>(k)] = marker.sigma ? (*marker.sigma)[k] : kNan;
    }
  }
  nb::dict columns;
  columns["marker"] = ToColumn(std::move(numbers));
  columns["position"] = positions;
  columns["sigma"] = sigmas;
  return columns;
}

nb::dict Residuals(const Record& calibration, size_t index) {
  const CalibratedCamera& camera = calibration.record.cameras.at(index);
  const CameraModel& model = *camera.model;
  const size_t count = camera.residuals.size();
  std::vector<std::string> frames;
  std::vector<int> markers;
  std::vector<double> sigmas;
  std::vector<std::uint8_t> used;
  for (const ResidualRow& row : camera.residuals) {
    frames.push_back(calibration.record.frames[static_cast<size_t>(row.frame)].name);
    markers.push_back(row.marker);
    sigmas.push_back(row.noise_sigma);
    used.push_back(row.used ? 1 : 0);
  }
  const auto column = [&](const auto& value) {
    Numbers numbers = NewArray({count});
    for (size_t i = 0; i < count; ++i) numbers.data()[i] = value(camera.residuals[i]);
    return numbers;
  };
  nb::dict columns;
  columns["frame"] = frames;
  columns["marker"] = ToColumn(std::move(markers));
  const auto put = [&](const std::string& name, const Numbers& numbers) {
    columns[nb::str(name.c_str())] = numbers;
  };
  for (size_t k = 0; k < model.measured.size() + model.context.size(); ++k) {
    const size_t measured = model.measured.size();
    put(std::string(k < measured ? model.measured[k] : model.context[k - measured]),
        column([&](const ResidualRow& row) { return row.values[k]; }));
  }
  for (size_t k = 0; k < model.measured.size(); ++k) {
    put("residual_" + std::string(model.measured[k]),
        column([&](const ResidualRow& row) { return row.residual[k]; }));
  }
  columns["noise_sigma"] = ToColumn(std::move(sigmas));
  columns["used"] = ToColumn(std::move(used));
  return columns;
}

/// PNG of the mean residuals over the image; empty without residuals.
nb::bytes ResidualPicture(const Record& calibration, size_t index) {
  const CalibratedCamera& camera = calibration.record.cameras.at(index);
  if (camera.residuals.empty()) return nb::bytes("", 0);
  const ResidualField field = MakeResidualField(camera);
  FieldMap map{camera.name + ": mean residuals",
               camera.image_size,
               field.grid.Columns(),
               field.grid.Rows(),
               {}};
  map.vectors.resize(field.grid.Cells());
  double largest = 0;
  for (size_t cell = 0; cell < field.grid.Cells(); ++cell) {
    if (field.points[cell] == 0) continue;
    map.vectors[cell] = {field.mean[cell].x(), field.mean[cell].y()};
    largest = std::max(largest, field.mean[cell].norm());
  }
  const std::string png = DrawFieldMaps({map}, largest);
  return nb::bytes(png.data(), png.size());
}

std::string VerdictText(const Record& calibration) {
  return calibration.record.verdict ? VerdictJson(*calibration.record.verdict).dump() : "null";
}

}  // namespace

void BindCalibration(nb::module_& module) {
  nb::class_<Record>(module, "Record")
      .def_static("load", &Load, nb::arg("path"))
      .def_static("of_cameras", &OfCameras, nb::arg("cameras"))
      .def("yaml", &Yaml)
      .def("save", &Save, nb::arg("path"), nb::call_guard<nb::gil_scoped_release>())
      .def("report", &Report)
      .def("poses", &Poses)
      .def("markers", &Markers)
      .def("residuals", &Residuals, nb::arg("camera"))
      .def("residual_picture", &ResidualPicture, nb::arg("camera"))
      .def("verdict", &VerdictText)
      .def_prop_ro("path", [](const Record& record) { return record.record.path.string(); })
      .def_prop_ro(
          "cameras",
          [](const Record& record) { return record.record.cameras; },
          nb::rv_policy::move)
      .def_prop_ro(
          "correlations",
          [](const Record& record) {
            const Correlations& correlations = record.record.correlations;
            return nb::make_tuple(correlations.names, ToArray(correlations.matrix));
          },
          nb::rv_policy::move)
      .def_prop_ro("left_out", [](const Record& record) { return record.record.left_out; })
      .def_prop_ro("provenance", [](const Record& record) {
        nb::dict entries;
        for (const auto& [key, value] : record.record.provenance) {
          entries[nb::str(key.c_str())] = value;
        }
        return entries;
      });
}

}  // namespace plenocal::python
