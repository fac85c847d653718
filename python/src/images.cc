// SPDX-License-Identifier: Apache-2.0
//
// Runs of the engine on images: white images, raw plenoptic ones, and those of calibrated cameras.
#include <nanobind/stl/array.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cstring>
#include <opencv2/core/mat.hpp>

#include "calib/base/format_error.h"
#include "detectors/images/image_codecs.h"
#include "detectors/plenoptic/white/white_text.h"
#include "engine/exchange/export_calibration.h"
#include "engine/images/rectify_images.h"
#include "engine/images/undistort_images.h"
#include "engine/plenoptic/focus_files.h"
#include "engine/plenoptic/white_files.h"
#include "python/src/record.h"
#include "python/src/run.h"

namespace plenocal::python {
namespace {

template <typename Pixel>
nb::object ArrayOf(const cv::Mat& image) {
  auto* const kept = new cv::Mat(image.isContinuous() ? image : image.clone());
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<cv::Mat*>(p); });
  const size_t shape[]{static_cast<size_t>(kept->rows),
                       static_cast<size_t>(kept->cols),
                       static_cast<size_t>(kept->channels())};
  const size_t dimensions = kept->channels() == 1 ? 2 : 3;
  return nb::cast(nb::ndarray<nb::numpy, Pixel>(kept->data, dimensions, shape, owner));
}

/// The pixels of an image file's content: (H, W), or (H, W, 3) in the order blue, green, red.
nb::object ArrayOfFile(const std::string& content) {
  const cv::Mat image =
      DecodeImage(std::vector<std::uint8_t>(content.begin(), content.end()), Channels::kAsStored);
  switch (image.depth()) {
    case CV_8U:
      return ArrayOf<std::uint8_t>(image);
    case CV_16U:
      return ArrayOf<std::uint16_t>(image);
    default:
      return ArrayOf<float>(image);
  }
}

nb::object MicroLenses(const std::optional<MicroLensGrid>& grid) {
  if (!grid) return nb::none();
  const std::vector<MicroLens>& lenses = grid->array.lenses;
  nb::dict columns;
  columns["x"] = ToColumn(lenses, [](const MicroLens& lens) { return lens.centre.x(); });
  columns["y"] = ToColumn(lenses, [](const MicroLens& lens) { return lens.centre.y(); });
  columns["type"] = ToColumn(lenses, [](const MicroLens& lens) { return lens.type; });
  columns["row"] = ToColumn(lenses, [](const MicroLens& lens) { return lens.row; });
  columns["column"] = ToColumn(lenses, [](const MicroLens& lens) { return lens.column; });
  columns["usable"] = ToColumn(
      lenses, [](const MicroLens& lens) { return static_cast<std::uint8_t>(lens.usable); });
  return columns;
}

nb::object NoiseOf(const std::optional<PhotonTransfer>& noise) {
  if (!noise) return nb::none();
  nb::dict values;
  values["gain"] = noise->gain;
  values["gain_sigma"] = noise->gain_sigma;
  values["read"] = noise->read;
  values["read_sigma"] = noise->read_sigma;
  values["saturation"] = noise->saturation;
  values["misfit"] = noise->misfit;
  return values;
}

nb::list White(const WhiteRequest& request, const Caller& caller) {
  const std::vector<WhiteResult> results =
      RunEngine(caller, [&](const Run& run) { return MeasureWhiteImages(request, run); });
  nb::list cameras;
  for (const auto& [camera, images, white] : results) {
    cameras.append(nb::make_tuple(camera,
                                  ArrayOfFile(white.attenuation_tiff),
                                  MicroLenses(white.grid),
                                  NoiseOf(white.noise),
                                  WhiteText(camera, images, white)));
  }
  return cameras;
}

nb::list Focus(const FocusFilesRequest& request, const Caller& caller) {
  const std::vector<FocusResult> focused =
      RunEngine(caller, [&](const Run& run) { return FocusImages(request, run); });
  nb::list images;
  for (const auto& [frame, files, summary] : focused) {
    const auto picture = [&files = files](const char* name) {
      const auto found = files.find(name);
      return found == files.end() ? nb::none() : ArrayOfFile(found->second);
    };
    images.append(nb::make_tuple(frame,
                                 picture("focused.png"),
                                 picture("virtual_depth.tiff"),
                                 picture("virtual_depth_sigma.tiff"),
                                 summary));
  }
  return images;
}

nb::tuple RectifyFiles(const Record& calibration,
                       const RectifyRequest& request,
                       const Caller& caller) {
  const RectifiedImages made = RunEngine(
      caller, [&](const Run& run) { return RectifyImages(calibration.record, request, run); });
  const EpipolarErrors& errors = made.epipolar.errors;
  nb::dict epipolar;
  epipolar["points"] = errors.points;
  epipolar["frames"] = errors.frames;
  epipolar["rms"] = errors.rms;
  epipolar["mean_absolute"] = errors.mean_absolute;
  epipolar["largest"] = errors.largest;
  return nb::make_tuple(made.pair.views, made.pair.baseline, made.images, epipolar);
}

nb::tuple UndistortFiles(const Record& calibration,
                         const UndistortRequest& request,
                         const Caller& caller) {
  const UndistortedImages made = RunEngine(
      caller, [&](const Run& run) { return UndistortImages(calibration.record, request, run); });
  return nb::make_tuple(made.view, made.count);
}

/// The paths of the files written.
std::vector<std::filesystem::path> Export(const Record& calibration,
                                          const ExportRequest& request,
                                          const Caller& caller) {
  return RunEngine(caller, [&](const Run& run) {
    if (!calibration.record.frames.empty() || calibration.record.path.empty()) {
      return ExportCalibration(calibration.record, request, run);
    }
    ExportRequest of_file = request;
    of_file.calibration = calibration.record.path;
    return ExportCalibration(of_file, run);
  });
}

template <typename Request>
void SetBayer(Request& request, const std::string& name) {
  request.bayer = ParseBayerOrder(name);
  if (!request.bayer && !name.empty()) {
    throw InputError("bayer: expected RGGB, BGGR, GRBG or GBRG, found '{}'", name);
  }
}

void BindRequests(nb::module_& module) {
  nb::class_<WhiteRequest>(module, "WhiteRequest")
      .def(nb::init<>())
      .def_rw("inputs", &WhiteRequest::inputs)
      .def_rw("model", &WhiteRequest::model)
      .def_rw("camera", &WhiteRequest::camera)
      .def_rw("grid", &WhiteRequest::grid)
      .def_rw("out", &WhiteRequest::out)
      .def("set_bayer", &SetBayer<WhiteRequest>);
  nb::class_<PlenopticInputs>(module, "PlenopticInputs")
      .def_rw("white", &PlenopticInputs::white)
      .def_rw("grid", &PlenopticInputs::grid)
      .def_rw("vignetting", &PlenopticInputs::vignetting)
      .def("set_bayer", &SetBayer<PlenopticInputs>);
  nb::class_<FocusFilesRequest>(module, "FocusRequest")
      .def(nb::init<>())
      .def_rw("raw", &FocusFilesRequest::raw)
      .def_rw("camera", &FocusFilesRequest::camera)
      .def_rw("markers", &FocusFilesRequest::markers)
      .def_rw("scale", &FocusFilesRequest::scale)
      .def_rw("out", &FocusFilesRequest::out);
  nb::class_<ViewOptions>(module, "ViewOptions")
      .def(nb::init<>())
      .def_rw("size", &ViewOptions::size)
      .def_rw("fov", &ViewOptions::fov)
      .def_rw("balance", &ViewOptions::balance)
      .def_rw("distance", &ViewOptions::distance);
  nb::class_<ResampleSettings>(module, "ResampleSettings")
      .def_rw("interpolation", &ResampleSettings::interpolation)
      .def_rw("keep_vignetting", &ResampleSettings::keep_vignetting)
      .def("set_bayer", &SetBayer<ResampleSettings>);
  nb::class_<RectifyRequest>(module, "RectifyRequest")
      .def(nb::init<>())
      .def_rw("left", &RectifyRequest::left)
      .def_rw("right", &RectifyRequest::right)
      .def_rw("cameras", &RectifyRequest::cameras)
      .def_rw("view", &RectifyRequest::view)
      .def_rw("settings", &RectifyRequest::settings)
      .def_rw("maps", &RectifyRequest::maps)
      .def_rw("preview", &RectifyRequest::preview)
      .def_rw("out", &RectifyRequest::out);
  nb::class_<UndistortRequest>(module, "UndistortRequest")
      .def(nb::init<>())
      .def_rw("camera", &UndistortRequest::camera)
      .def_rw("images", &UndistortRequest::images)
      .def_rw("view", &UndistortRequest::view)
      .def_rw("settings", &UndistortRequest::settings)
      .def_rw("out", &UndistortRequest::out);
  nb::class_<ExportRequest>(module, "ExportRequest")
      .def(nb::init<>())
      .def_rw("format", &ExportRequest::format)
      .def_rw("cameras", &ExportRequest::cameras)
      .def_rw("response", &ExportRequest::response)
      .def_rw("out", &ExportRequest::out);
}

}  // namespace

void BindImages(nb::module_& module) {
  BindRequests(module);
  module.def("white", &White);
  module.def("focus", &Focus);
  module.def("rectify", &RectifyFiles);
  module.def("undistort", &UndistortFiles);
  module.def("export", &Export);
}

}  // namespace plenocal::python
