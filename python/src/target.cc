// SPDX-License-Identifier: Apache-2.0
#include "targets/target.h"

#include <fmt/format.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <opencv2/core.hpp>

#include "calib/base/error.h"
#include "calib/files/detections.h"
#include "detectors/images/image.h"
#include "detectors/types/marker_detectors.h"
#include "engine/session/open_session.h"
#include "models/registry.h"
#include "python/src/bindings.h"

namespace plenocal::python {
namespace {

nb::dict Positions(const Target& target) {
  std::vector<int> numbers;
  Numbers positions = NewArray({target.markers.size(), 3});
  for (const auto& [number, position] : target.markers) {
    for (Eigen::Index k = 0; k < 3; ++k) {
      positions.data()[3 * numbers.size() + static_cast<size_t>(k)] = position[k];
    }
    numbers.push_back(number);
  }
  nb::dict columns;
  columns["marker"] = ToColumn(std::move(numbers));
  columns["position"] = positions;
  return columns;
}

nb::tuple Detections(const MarkerDetections& detections) {
  const size_t count = detections.markers.size();
  std::vector<int> numbers;
  Numbers x = NewArray({count}), y = NewArray({count}), sigma = NewArray({count});
  for (size_t i = 0; i < count; ++i) {
    const Observation& marker = detections.markers[i];
    numbers.push_back(marker.marker);
    x.data()[i] = marker.values[0];
    y.data()[i] = marker.values[1];
    sigma.data()[i] = marker.detector_sigma;
  }
  nb::dict columns;
  columns["marker"] = ToColumn(std::move(numbers));
  columns["x"] = x;
  columns["y"] = y;
  columns["sigma"] = sigma;
  return nb::make_tuple(columns, detections.failure, detections.left_out);
}

template <typename Pixel>
using Image = nb::ndarray<const Pixel, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

MarkerDetections DetectGray(const cv::Mat& gray, const Target& target) {
  return MakeMarkerDetector(target)->Detect(gray);
}

template <typename Pixel>
nb::tuple DetectInImage(const Image<Pixel>& image, const Target& target) {
  const MarkerDetections detections = [&] {
    const nb::gil_scoped_release release;
    // The detector only reads; cv::Mat has no view of constant data.
    const cv::Mat pixels(static_cast<int>(image.shape(0)),
                         static_cast<int>(image.shape(1)),
                         cv::DataType<Pixel>::type,
                         const_cast<Pixel*>(image.data()));
    return DetectGray(ScaledTo8Bits(pixels), target);
  }();
  return Detections(detections);
}

nb::tuple DetectInFile(const std::filesystem::path& path, const Target& target) {
  const MarkerDetections detections = [&] {
    const nb::gil_scoped_release release;
    return DetectGray(ReadGray(path), target);
  }();
  return Detections(detections);
}

/// The file of detections of an ordinary camera; all its models have the same columns.
std::string DetectionsTable(const std::vector<std::string>& frames,
                            const nb::ndarray<const int, nb::ndim<1>, nb::c_contig>& markers,
                            const Rows& x_y_sigma) {
  std::vector<View> views;
  for (size_t i = 0; i < frames.size(); ++i) {
    if (views.empty() || views.back().frame != frames[i]) views.emplace_back().frame = frames[i];
    Observation observation;
    observation.marker = markers(i);
    observation.values[0] = x_y_sigma(i, 0);
    observation.values[1] = x_y_sigma(i, 1);
    observation.detector_sigma = x_y_sigma(i, 2);
    views.back().observations.push_back(observation);
  }
  return DetectionsCsv(views, *FindModel(CameraModels(), "pinhole"));
}

nb::list SessionCameras(const Session& session) {
  nb::list cameras;
  for (const SessionCamera& camera : session.cameras) {
    nb::dict entry;
    entry["name"] = camera.name;
    entry["model"] = std::string(camera.model->name);
    entry["images"] = camera.images;
    entry["white_images"] = camera.white_images;
    entry["detections"] = camera.detections.string();
    cameras.append(entry);
  }
  return cameras;
}

}  // namespace

void BindTarget(nb::module_& module) {
  nb::class_<Target>(module, "Target")
      .def_static(
          "load", nb::overload_cast<const std::filesystem::path&>(&ReadTarget), nb::arg("path"))
      .def_static("parse", &TargetOfWord, nb::arg("word"))
      .def("positions", &Positions)
      .def_prop_ro("tolerance",
                   [](const Target& target) -> nb::object {
                     return target.tolerance ? nb::cast(*target.tolerance) : nb::none();
                   })
      .def_prop_ro("yaml", [](const Target& target) { return RefinedTargetYaml(target, {}, {}); });
  module.def("detect_8", &DetectInImage<std::uint8_t>, nb::arg("image"), nb::arg("target"));
  module.def("detect_16", &DetectInImage<std::uint16_t>, nb::arg("image"), nb::arg("target"));
  module.def("detect_file", &DetectInFile, nb::arg("path"), nb::arg("target"));
  module.def("detections_table",
             &DetectionsTable,
             nb::arg("frames"),
             nb::arg("markers"),
             nb::arg("x_y_sigma"));
  nb::class_<Session>(module, "Session")
      .def_static("load", &OpenSession, nb::arg("path"))
      .def_prop_ro("path", [](const Session& session) { return session.path.string(); })
      .def_ro("text", &Session::text)
      .def_prop_ro("has_scene", [](const Session& session) { return session.scene.has_value(); })
      .def("cameras", &SessionCameras)
      .def("target", [](const Session& session) { return ReadTarget(session.target); });
}

}  // namespace plenocal::python
