// SPDX-License-Identifier: Apache-2.0
//
// A calibration with its tables as arrays.
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
  return {OpenWithCorrelations(path), {path.parent_path(), {}}};
}

Record OfCameras(const std::vector<CalibratedCamera>& cameras) {
  Record calibration;
  calibration.record.cameras = cameras;
  // Their frames are another calibration's.
  for (CalibratedCamera& camera : calibration.record.cameras) camera.residuals.clear();
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
  std::vector<std::string> names;
  std::vector<double> poses;
  for (const FrameRecord& frame : calibration.record.frames) {
    names.push_back(frame.name);
    const Numbers pose = ToArray(frame.T_target_rig);
    poses.insert(poses.end(), pose.data(), pose.data() + 16);
  }
  nb::dict columns;
  columns["T_target_rig"] = Kept(std::move(poses), {names.size(), 4, 4});
  columns["frame"] = names;
  return columns;
}

nb::dict Markers(const Record& calibration) {
  const auto& markers = calibration.record.markers;
  nb::dict columns;
  columns["marker"] = ToColumn(markers, [](const auto& marker) { return marker.first; });
  columns["position"] = ToRows(markers, [](const auto& marker) { return marker.second.position; });
  columns["sigma"] = ToRows(markers, [](const auto& marker) {
    return marker.second.sigma.value_or(Eigen::Vector3d::Constant(kNan));
  });
  return columns;
}

nb::dict Residuals(const Record& calibration, size_t index) {
  const CalibratedCamera& camera = calibration.record.cameras.at(index);
  const CameraModel& model = *camera.model;
  const std::vector<ResidualRow>& rows = camera.residuals;
  std::vector<std::string> frames;
  for (const ResidualRow& row : rows) {
    frames.push_back(calibration.record.frames[static_cast<size_t>(row.frame)].name);
  }
  nb::dict columns;
  columns["frame"] = frames;
  columns["marker"] = ToColumn(rows, [](const ResidualRow& row) { return row.marker; });
  const std::vector<std::string> names = ValueNames(model);
  for (size_t k = 0; k < names.size(); ++k) {
    columns[names[k].c_str()] =
        ToColumn(rows, [&](const ResidualRow& row) { return row.values[k]; });
  }
  for (size_t k = 0; k < model.measured.size(); ++k) {
    columns[("residual_" + names[k]).c_str()] =
        ToColumn(rows, [&](const ResidualRow& row) { return row.residual[k]; });
  }
  columns["noise_sigma"] = ToColumn(rows, [](const ResidualRow& row) { return row.noise_sigma; });
  columns["used"] =
      ToColumn(rows, [](const ResidualRow& row) { return static_cast<std::uint8_t>(row.used); });
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
      .def_static("load", &Load)
      .def_static("of_cameras", &OfCameras)
      .def("yaml", &Yaml)
      .def("save", &Save, nb::call_guard<nb::gil_scoped_release>())
      .def("report", &Report)
      .def("poses", &Poses)
      .def("markers", &Markers)
      .def("residuals", &Residuals)
      .def("residual_picture", &ResidualPicture)
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
      .def_prop_ro("target_scale",
                   [](const Record& record) {
                     nb::dict scales;
                     for (const auto& [name, scale] : record.record.target_scales) {
                       scales[nb::str(name.c_str())] = nb::make_tuple(scale.value, scale.sigma);
                     }
                     return scales;
                   })
      .def_prop_ro("provenance", [](const Record& record) {
        nb::dict entries;
        for (const auto& [key, value] : record.record.provenance) {
          entries[nb::str(key.c_str())] = value;
        }
        return entries;
      });
}

}  // namespace plenocal::python
