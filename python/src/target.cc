// SPDX-License-Identifier: Apache-2.0
//
// Targets, their markers in single images, and sessions.
#include "targets/target.h"

#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "calib/files/detections.h"
#include "detectors/images/image.h"
#include "detectors/types/marker_detectors.h"
#include "engine/session/open_session.h"
#include "models/registry.h"
#include "python/src/record.h"
#include "python/src/run.h"

namespace plenocal::python {
namespace {

nb::dict Positions(const Target& target) {
  nb::dict columns;
  columns["marker"] = ToColumn(target.markers, [](const auto& marker) { return marker.first; });
  columns["position"] = ToRows(target.markers, [](const auto& marker) { return marker.second; });
  return columns;
}

nb::tuple Detections(const MarkerDetections& detections) {
  const std::vector<Observation>& markers = detections.markers;
  nb::dict columns;
  columns["marker"] = ToColumn(markers, [](const Observation& seen) { return seen.marker; });
  columns["x"] = ToColumn(markers, [](const Observation& seen) { return seen.values[0]; });
  columns["y"] = ToColumn(markers, [](const Observation& seen) { return seen.values[1]; });
  columns["sigma"] = ToColumn(markers, [](const Observation& seen) { return seen.detector_sigma; });
  return nb::make_tuple(columns, detections.failure, detections.left_out);
}

nb::tuple DetectInFile(const std::filesystem::path& path, const Target& target) {
  return Detections(Call([&] { return MakeMarkerDetector(target)->Detect(ReadGray(path)); }));
}

nb::tuple DetectInArray(const Pixels& pixels, const Target& target) {
  const FrameImage image = ImagesInMemory("image", ViewsOf({{"", pixels}})).front();
  return Detections(Call([&] { return MakeMarkerDetector(target)->Detect(ReadGray(image)); }));
}

/// Points of a frame: markers and rows of x, y, sigma.
using FramePoints = std::tuple<std::string, std::vector<int>, Rows>;
using CameraInMemory = std::tuple<std::string,
                                  std::string,
                                  std::vector<int>,
                                  std::vector<FramePixels>,
                                  std::vector<FramePoints>>;

std::vector<View> ViewsOf(const std::vector<FramePoints>& points) {
  std::vector<View> views;
  for (const auto& [frame, markers, rows] : points) {
    View& view = views.emplace_back();
    view.frame = frame;
    for (size_t i = 0; i < markers.size(); ++i) {
      Observation& seen = view.observations.emplace_back();
      seen.marker = markers[i];
      seen.values[0] = rows(i, 0);
      seen.values[1] = rows(i, 1);
      seen.detector_sigma = rows(i, 2);
    }
  }
  return views;
}

/// The file of detections of an ordinary camera; all its models have the same columns.
std::string DetectionsTable(const std::vector<FramePoints>& points) {
  return DetectionsCsv(ViewsOf(points), *FindModel(CameraModels(), "pinhole"));
}

Session SessionOfArrays(const std::string& target, const std::vector<CameraInMemory>& cameras) {
  std::vector<MemoryCamera> all;
  for (const auto& [name, model, size, images, points] : cameras) {
    MemoryCamera& camera = all.emplace_back();
    camera.name = name;
    camera.model = model.empty() ? nullptr : ModelNamed(name + ": model", model);
    if (size.size() == 2) camera.image_size = {size[0], size[1]};
    camera.images = python::ViewsOf(images);
    camera.views = ViewsOf(points);
  }
  return SessionInMemory(target, all);
}

nb::list SessionCameras(const Session& session) {
  nb::list cameras;
  for (const SessionCamera& camera : session.cameras) {
    nb::dict entry;
    entry["name"] = camera.name;
    entry["model"] = camera.model != nullptr ? std::string(camera.model->name) : "auto";
    entry["images"] = camera.images;
    entry["white_images"] = camera.white_images;
    entry["detections"] = camera.detections.string();
    cameras.append(entry);
  }
  return cameras;
}

}  // namespace

MemoryImages ViewsOf(const std::vector<FramePixels>& images) {
  MemoryImages views;
  for (const auto& [frame, pixels] : images) {
    views.emplace_back(
        frame,
        PixelView{.data = pixels.data(),
                  .size = {static_cast<int>(pixels.shape(1)), static_cast<int>(pixels.shape(0))},
                  .stride = static_cast<size_t>(pixels.stride(0)) * pixels.itemsize(),
                  .channels = pixels.ndim() == 3 ? static_cast<int>(pixels.shape(2)) : 1,
                  .bytes_per_value = static_cast<int>(pixels.itemsize())});
  }
  return views;
}

void BindTarget(nb::module_& module) {
  nb::class_<Target>(module, "Target")
      .def_static("load", nb::overload_cast<const std::filesystem::path&>(&ReadTarget))
      .def_static("parse", &TargetOfWord)
      .def("positions", &Positions)
      .def_prop_ro("tolerance",
                   [](const Target& target) -> nb::object {
                     return target.tolerance ? nb::cast(*target.tolerance) : nb::none();
                   })
      .def_prop_ro("yaml", [](const Target& target) { return RefinedTargetYaml(target, {}, {}); });
  module.def("detect_array", &DetectInArray);
  module.def("detect_file", &DetectInFile);
  module.def("session_of_arrays", &SessionOfArrays);
  module.def("detections_table", &DetectionsTable);
  nb::class_<Session>(module, "Session")
      .def_static("load", &OpenSession)
      .def_prop_ro("path", [](const Session& session) { return session.path.string(); })
      .def_ro("text", &Session::text)
      .def_prop_ro("has_scene", [](const Session& session) { return session.scene.has_value(); })
      .def("cameras", &SessionCameras)
      .def("target", [](const Session& session) { return ReadTarget(session.target); });
}

}  // namespace plenocal::python
