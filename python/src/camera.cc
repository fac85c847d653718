// SPDX-License-Identifier: Apache-2.0
//
// A calibrated camera on arrays of points.
#include <fmt/format.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cmath>
#include <limits>

#include "assess/compare.h"
#include "assess/convert.h"
#include "assess/projection.h"
#include "calib/base/error.h"
#include "calib/base/names.h"
#include "calib/camera/rays.h"
#include "calib/files/calibration_file.h"
#include "models/registry.h"
#include "python/src/run.h"

namespace plenocal::python {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

const CameraModel& ModelOf(const std::string& name) {
  if (const CameraModel* model = FindModel(CameraModels(), name)) return *model;
  const std::vector<std::string_view> known = NamesOf(CameraModels());
  throw Error(ErrorKind::kInput,
              fmt::format("unknown camera model '{}'{}", name, SuggestName(name, known)));
}

void CheckParams(const CameraModel& model, const std::vector<double>& params) {
  for (size_t i = 0; i < params.size(); ++i) {
    const Param& param = model.params[i];
    if (params[i] > param.lower && params[i] < param.upper) continue;
    throw Error(ErrorKind::kInput,
                fmt::format("{}: {} must be above {} and below {}, found {}",
                            model.name,
                            param.name,
                            param.lower,
                            param.upper,
                            params[i]));
  }
}

CalibratedCamera MakeCamera(const std::string& name,
                            const std::string& model_name,
                            ImageSize image_size,
                            const std::vector<double>& params,
                            const std::vector<double>& config,
                            const Rows& T_camera_rig,
                            const std::optional<Rows>& covariance) {
  const CameraModel& model = ModelOf(model_name);
  const auto require = [&](const char* what, size_t expected, size_t found) {
    if (expected == found) return;
    throw Error(
        ErrorKind::kInput,
        fmt::format("{}: {}: expected {} values, found {}", model.name, what, expected, found));
  };
  require("params", model.params.size(), params.size());
  require("config", model.config.size(), config.size());
  CheckParams(model, params);
  if (image_size[0] <= 0 || image_size[1] <= 0) {
    throw Error(ErrorKind::kInput, "image_size: expected two positive numbers of pixels");
  }
  const auto n = static_cast<Eigen::Index>(params.size());
  CalibratedCamera camera{.name = name,
                          .model = &model,
                          .image_size = image_size,
                          .config = config,
                          .params = params,
                          .covariance = Eigen::MatrixXd::Zero(n, n),
                          .T_camera_rig = ToTransform(T_camera_rig)};
  if (covariance) {
    require("covariance", params.size() * params.size(), covariance->size());
    camera.covariance = Eigen::Map<const Eigen::MatrixXd>(covariance->data(), n, n);
  }
  return camera;
}

/// Observations (N x kMaxObservationSize) of these measured coordinates and contexts, zeros where
/// not given.
std::vector<double> ValuesOf(const CameraModel& model,
                             size_t count,
                             const Rows* pixels,
                             const std::optional<Rows>& context) {
  std::vector<double> values(count * kMaxObservationSize);
  const size_t measured = model.measured.size(), n = model.context.size();
  for (size_t i = 0; i < count; ++i) {
    double* const own = values.data() + i * kMaxObservationSize;
    if (pixels != nullptr) std::copy_n(pixels->data() + i * measured, measured, own);
    if (context) std::copy_n(context->data() + i * n, n, own + measured);
  }
  return values;
}

/// `ProjectPoints` of arrays from Python.
void ProjectAll(const CalibratedCamera& camera,
                const Rows& points,
                const std::optional<Rows>& context,
                const ProjectionOutput& out) {
  const size_t count = points.shape(0);
  std::vector<double> values;
  if (context) values = ValuesOf(*camera.model, count, nullptr, context);
  ProjectPoints(*camera.model,
                camera.params.data(),
                camera.config.data(),
                {count, points.data(), context ? values.data() : nullptr},
                out);
}

Numbers Project(const CalibratedCamera& camera,
                const Rows& points,
                const std::optional<Rows>& context) {
  Numbers projected = NewArray({points.shape(0), camera.model->measured.size()});
  Call([&] { ProjectAll(camera, points, context, {.predicted = projected.data()}); });
  return projected;
}

nb::tuple Jacobian(const CalibratedCamera& camera,
                   const Rows& points,
                   const std::optional<Rows>& context) {
  const size_t count = points.shape(0), measured = camera.model->measured.size();
  Numbers values = NewArray({count, measured}),
          by_params = NewArray({count, measured, camera.params.size()}),
          by_point = NewArray({count, measured, 3});
  const ProjectionOutput out{
      .predicted = values.data(), .J_params = by_params.data(), .J_point = by_point.data()};
  Call([&] { ProjectAll(camera, points, context, out); });
  return nb::make_tuple(values, by_params, by_point);
}

/// J C J^T of each point. A parameter that was not determined makes infinite what depends on it.
Numbers Uncertainty(const CalibratedCamera& camera,
                    const Rows& points,
                    const std::optional<Rows>& context) {
  const size_t count = points.shape(0), measured = camera.model->measured.size(),
               own = camera.model->support_size, columns = own > 0 ? own : camera.params.size();
  Numbers covariances = NewArray({count, measured, measured});
  double* const out = covariances.data();
  Call([&] {
    const ImageCovariance image(camera);
    std::vector<double> predicted(count * measured), J_params(count * measured * columns);
    std::vector<size_t> supports(count * own);
    ProjectAll(camera,
               points,
               context,
               {.predicted = predicted.data(),
                .J_params = J_params.data(),
                .support = own > 0 ? supports.data() : nullptr});
    for (size_t i = 0; i < count; ++i) {
      const RowMajor covariance =
          image.Propagate(Eigen::Map<const RowMajor>(J_params.data() + i * measured * columns,
                                                     static_cast<Eigen::Index>(measured),
                                                     static_cast<Eigen::Index>(columns)),
                          {supports.begin() + static_cast<std::ptrdiff_t>(i * own),
                           supports.begin() + static_cast<std::ptrdiff_t>((i + 1) * own)});
      std::copy_n(covariance.data(), measured * measured, out + i * measured * measured);
    }
  });
  return covariances;
}

nb::tuple Rays(const CalibratedCamera& camera,
               const Rows& pixels,
               const std::optional<Rows>& context) {
  const CameraModel& model = *camera.model;
  const size_t count = pixels.shape(0);
  Numbers origins = NewArray({count, 3}), directions = NewArray({count, 3});
  double *const o = origins.data(), *const d = directions.data();
  const std::vector<double> values = ValuesOf(model, count, &pixels, context);
  std::vector<std::array<double, kMaxObservationSize>> of_points(count);
  for (size_t i = 0; i < count; ++i) {
    std::copy_n(values.data() + i * kMaxObservationSize, kMaxObservationSize, of_points[i].data());
  }
  Call([&] {
    const std::vector<std::optional<Ray>> rays = Unproject(camera, of_points);
    for (size_t i = 0; i < count; ++i) {
      const std::optional<Ray>& ray = rays[i];
      for (Eigen::Index k = 0; k < 3; ++k) {
        o[3 * i + static_cast<size_t>(k)] = ray ? ray->origin[k] : kNan;
        d[3 * i + static_cast<size_t>(k)] = ray ? ray->direction[k] : kNan;
      }
    }
  });
  return nb::make_tuple(origins, directions);
}

nb::dict FitOf(const CameraFit& fit) {
  nb::dict result;
  result["points"] = fit.points;
  result["rejected"] = fit.rejected;
  result["views"] = fit.views;
  result["rms"] = fit.rms;
  result["noise_sigma"] = fit.noise_sigma;
  result["detector_sigma"] = fit.detector_sigma;
  return result;
}

nb::list NamesAndUnits(const CameraModel& model) {
  nb::list entries;
  for (const Param& param : model.params) {
    entries.append(nb::make_tuple(std::string(param.name), std::string(param.unit)));
  }
  return entries;
}

std::vector<std::string> Strings(std::span<const std::string_view> names) {
  return {names.begin(), names.end()};
}

nb::list DistancesOf(const CameraDifference& difference) {
  nb::list rows;
  for (const DistanceDifference& at : difference.distances) {
    nb::dict row;
    row["distance"] = at.distance;
    row["points"] = at.all.points;
    row["rms"] = at.all.rms;
    row["largest"] = at.all.largest;
    row["predicted"] = difference.has_prediction ? at.all.predicted : kNan;
    row["probability"] = difference.has_prediction ? at.all.probability : kNan;
    row["differs"] = at.all.differs;
    Numbers pixels = NewArray({at.pixels.size(), 5});
    double* out = pixels.data();
    for (const PixelDifference& pixel : at.pixels) {
      for (const double value : {pixel.u_px.x(),
                                 pixel.u_px.y(),
                                 pixel.difference_px.x(),
                                 pixel.difference_px.y(),
                                 pixel.predicted_px}) {
        *out++ = value;
      }
    }
    row["pixels"] = pixels;
    rows.append(row);
  }
  return rows;
}

nb::dict Compare(const CalibratedCamera& a,
                 const CalibratedCamera& b,
                 const std::vector<double>& distances) {
  const CameraDifference difference = Call([&] { return CompareCameras(a, b, distances); });
  nb::dict result;
  result["name"] = difference.name;
  result["T_b_a"] = ToArray(difference.T_b_a);
  result["distances"] = DistancesOf(difference);
  result["has_prediction"] = difference.has_prediction;
  result["same"] = difference.same;
  return result;
}

nb::tuple ConvertTo(const CalibratedCamera& camera, const std::string& name) {
  const CameraModel& model = ModelOf(name);
  const Conversion conversion = Call([&] { return Convert(camera, model); });
  CalibratedCamera converted{.name = camera.name,
                             .model = &model,
                             .image_size = camera.image_size,
                             .config = {},
                             .params = conversion.params,
                             .covariance = {},
                             .T_camera_rig = camera.T_camera_rig};
  const auto n = static_cast<Eigen::Index>(conversion.params.size());
  converted.covariance = Eigen::MatrixXd::Zero(n, n);
  return nb::make_tuple(converted, conversion.rms, conversion.largest, conversion.unseen);
}

}  // namespace

void BindCamera(nb::module_& module) {
  using Camera = CalibratedCamera;
  nb::class_<Camera>(module, "Camera")
      .def_static("make", &MakeCamera)
      .def_ro("name", &Camera::name)
      .def_ro("image_size", &Camera::image_size)
      .def_ro("at_bound", &Camera::at_bound)
      .def_prop_ro("model", [](const Camera& camera) { return std::string(camera.model->name); })
      .def_prop_ro("centre", [](const Camera& camera) { return NameOf(camera.model->centre); })
      .def_prop_ro("plenoptic", [](const Camera& camera) { return camera.model->plenoptic; })
      .def_prop_ro("measured", [](const Camera& camera) { return Strings(camera.model->measured); })
      .def_prop_ro("context", [](const Camera& camera) { return Strings(camera.model->context); })
      .def_prop_ro(
          "names_and_units",
          [](const Camera& camera) { return NamesAndUnits(*camera.model); },
          nb::rv_policy::move)
      .def_prop_ro(
          "params",
          [](const Camera& camera) { return ToArray(camera.params); },
          nb::rv_policy::move)
      .def_prop_ro(
          "config",
          [](const Camera& camera) { return ToArray(camera.config); },
          nb::rv_policy::move)
      .def_prop_ro(
          "covariance",
          [](const Camera& camera) { return ToArray(camera.covariance); },
          nb::rv_policy::move)
      .def_prop_ro(
          "T_camera_rig",
          [](const Camera& camera) { return ToArray(camera.T_camera_rig); },
          nb::rv_policy::move)
      .def_prop_ro(
          "fit", [](const Camera& camera) { return FitOf(camera.fit); }, nb::rv_policy::move)
      .def("project", &Project)
      .def("jacobian", &Jacobian)
      .def("uncertainty", &Uncertainty)
      .def("rays", &Rays)
      .def("compare", &Compare)
      .def("convert", &ConvertTo)
      .def("image_sigma",
           [](const Camera& camera, const std::vector<double>& distances) {
             return Call([&] { return ImageSigma(camera, distances); });
           })
      .def("yaml", [](const Camera& camera) { return GivenCamerasYaml(std::array{camera}, {}); });
}

}  // namespace plenocal::python
