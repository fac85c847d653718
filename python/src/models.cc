// SPDX-License-Identifier: Apache-2.0
//
// Camera models written in Python: `self` of the model's table is a `PythonModel`.
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cmath>
#include <deque>
#include <limits>
#include <memory>
#include <tuple>

#include "models/registry.h"
#include "models/start/central_model.h"
#include "models/start/central_start.h"
#include "python/src/run.h"

namespace plenocal::python {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// A Python object that is a camera model, and the text to which its table refers. It is never
/// given back, since the table is not.
struct PythonModel {
  nb::handle object;
  std::string name, source;
  std::deque<std::string> texts;  // of params
  std::vector<Param> params;
  std::vector<double> example;
  bool has_jacobian = false;
};

const PythonModel& PythonModelOf(const CameraModel& model) {
  return *static_cast<const PythonModel*>(model.self);
}

/// Calls into Python, which works in one thread at a time; false after an exception, which the
/// `EngineCall` of this thread throws.
template <typename Function>
bool CallModel(const Function& function) {
  const nb::gil_scoped_acquire acquire;
  try {
    function();
    return true;
  } catch (...) {
    EngineCall::KeepException();
    return false;
  }
}

nb::object AsArray(const RowMajor& matrix) {
  const size_t shape[]{static_cast<size_t>(matrix.rows()), static_cast<size_t>(matrix.cols())};
  return nb::cast(
      nb::ndarray<nb::numpy, const double, nb::ndim<2>>(matrix.data(), 2, shape, nb::handle()),
      nb::rv_policy::copy);
}

RowMajor FromArray(const nb::object& object, Eigen::Index columns) {
  const auto rows = nb::cast<Rows>(object);
  return Eigen::Map<const RowMajor>(rows.data(), static_cast<Eigen::Index>(rows.shape(0)), columns);
}

/// Image points (K x 2) of points (K x 3) by cameras of these parameters (K x params).
std::optional<RowMajor> ProjectRows(const PythonModel& model,
                                    const RowMajor& params,
                                    const RowMajor& points) {
  std::optional<RowMajor> projected;
  CallModel([&] {
    projected = FromArray(model.object.attr("_project_rows")(AsArray(params), AsArray(points)), 2);
  });
  return projected;
}

bool ProjectOne(const CameraModel& model,
                const double* params,
                const double* /*config*/,
                const double* /*values*/,
                const Eigen::Vector3d& p_cam,
                double* predicted) {
  const auto n = static_cast<Eigen::Index>(model.params.size());
  const auto projected = ProjectRows(
      PythonModelOf(model), Eigen::Map<const RowMajor>(params, 1, n), p_cam.transpose());
  if (!projected || !projected->allFinite()) return false;
  std::copy_n(projected->data(), 2, predicted);
  return true;
}

/// Along its ray a point does not move in the image: what differences leave of that is rounding.
/// Where it is more, the model depends on the distance, and `models check` is to find it.
void RemoveRadialRounding(const Eigen::Vector3d& p_cam,
                          const Eigen::RowVector2d& u,
                          double* J_point) {
  constexpr double kRounding = 1e-7;
  Eigen::Map<Eigen::Matrix<double, 2, 3, Eigen::RowMajor>> J(J_point);
  const Eigen::Vector2d along = J * p_cam;
  if (along.cwiseAbs().maxCoeff() > kRounding * (1 + u.cwiseAbs().maxCoeff())) return;
  J -= along * p_cam.transpose() / p_cam.squaredNorm();
}

/// Central differences; one-sided where a neighbour is outside of the domain.
bool ProjectWithDifferences(const PythonModel& model,
                            const double* params,
                            const Eigen::Vector3d& p_cam,
                            const ProjectionOutput& out) {
  // Truncation and rounding of a central difference are equally small at this relative step.
  static const double kStep = std::cbrt(std::numeric_limits<double>::epsilon());
  const auto n = static_cast<Eigen::Index>(model.params.size()), unknowns = n + 3;
  const Eigen::Index first = out.J_params != nullptr ? 0 : n;
  RowMajor cameras(2 * unknowns + 1, n), points(2 * unknowns + 1, 3);
  cameras.rowwise() = Eigen::Map<const Eigen::RowVectorXd>(params, n);
  points.rowwise() = p_cam.transpose();
  Eigen::VectorXd steps(unknowns);
  for (Eigen::Index k = first; k < unknowns; ++k) {
    const Param* const param = k < n ? &model.params[static_cast<size_t>(k)] : nullptr;
    const double size = param ? std::max({std::abs(params[k]), param->scale, kStep}) : p_cam.norm();
    steps[k] = kStep * size;
    for (const int side : {0, 1}) {
      double& value = k < n ? cameras(2 * k + side, k) : points(2 * k + side, k - n);
      value += side == 0 ? -steps[k] : steps[k];
    }
  }
  const auto projected = ProjectRows(model, cameras, points);
  if (!projected) return false;
  const auto middle = projected->row(2 * unknowns);
  if (!middle.allFinite()) return false;
  for (Eigen::Index k = first; k < unknowns; ++k) {
    const bool low = projected->row(2 * k).allFinite(),
               high = projected->row(2 * k + 1).allFinite();
    if (!low && !high) return false;
    const Eigen::RowVector2d slope =
        ((high ? projected->row(2 * k + 1) : middle) - (low ? projected->row(2 * k) : middle)) /
        ((low && high ? 2 : 1) * steps[k]);
    for (Eigen::Index r = 0; r < 2; ++r) {
      (k < n ? out.J_params[r * n + k] : out.J_point[r * 3 + k - n]) = slope[r];
    }
  }
  RemoveRadialRounding(p_cam, middle, out.J_point);
  std::copy_n(middle.data(), 2, out.predicted);
  return true;
}

/// The model's own derivatives: u (1 x 2), by the parameters (2 x n), by the point (2 x 3).
bool ProjectWithJacobian(const CameraModel& model,
                         const double* params,
                         const double* /*config*/,
                         const double* /*values*/,
                         const Eigen::Vector3d& p_cam,
                         const ProjectionOutput& out) {
  const PythonModel& own = PythonModelOf(model);
  if (!own.has_jacobian) return ProjectWithDifferences(own, params, p_cam, out);
  const auto n = static_cast<Eigen::Index>(model.params.size());
  bool inside = false;
  CallModel([&] {
    const nb::object result = own.object.attr("_jacobian_row")(
        AsArray(Eigen::Map<const RowMajor>(params, 1, n)), AsArray(p_cam.transpose()));
    const RowMajor u = FromArray(result[0], 2), J_params = FromArray(result[1], n),
                   J_point = FromArray(result[2], 3);
    inside = u.allFinite() && J_params.allFinite() && J_point.allFinite();
    if (!inside) return;
    std::copy_n(u.data(), 2, out.predicted);
    if (out.J_params != nullptr) std::copy_n(J_params.data(), 2 * n, out.J_params);
    std::copy_n(J_point.data(), 6, out.J_point);
  });
  return inside;
}

std::optional<Ray> UnprojectOne(const CameraModel& model,
                                const double* params,
                                const double* /*config*/,
                                const double* values) {
  const auto n = static_cast<Eigen::Index>(model.params.size());
  std::optional<Ray> ray;
  CallModel([&] {
    const RowMajor direction = FromArray(PythonModelOf(model).object.attr("_unproject_rows")(
                                             AsArray(Eigen::Map<const RowMajor>(params, 1, n)),
                                             AsArray(Eigen::Map<const RowMajor>(values, 1, 2))),
                                         3);
    const Eigen::Vector3d unit = direction.row(0).transpose().stableNormalized();
    if (unit.allFinite() && unit.squaredNorm() > 0) ray = Ray{Eigen::Vector3d::Zero(), unit};
  });
  return ray;
}

std::vector<StartCandidate> Start(const CameraModel& model, const StartProblem& problem) {
  return StartCentral(model, problem, [&](double f, double c_x, double c_y) {
    std::vector<std::vector<double>> cameras;
    CallModel([&] {
      const nb::object starts = PythonModelOf(model).object.attr("_starts")(f, c_x, c_y);
      for (const nb::handle camera : nb::list(starts)) {
        cameras.push_back(nb::cast<std::vector<double>>(camera));
      }
    });
    return cameras;
  });
}

constexpr std::array<std::string_view, 2> kMeasured{"x", "y"};

CameraModel TableOf(const PythonModel& own, ImageSize size) {
  return {.name = own.name,
          .source = own.source,
          .params = own.params,
          .config = {},
          .measured = kMeasured,
          .context = {},
          .example = own.example,
          .example_config = {},
          .example_size = size,
          .plenoptic = false,
          .functions = {.project = &ProjectOne,
                        .project_with_jacobian = &ProjectWithJacobian,
                        .unproject = &UnprojectOne,
                        .start = &Start,
                        .misfit = &CentralModel::JudgeFit},
          .self = &own};
}

using ParamTuple = std::
    tuple<std::string, std::string, double, double, double, std::optional<double>, int, double>;

void Register(const nb::object& object,
              const std::string& name,
              const std::string& source,
              const std::vector<ParamTuple>& params,
              const std::vector<double>& example,
              ImageSize example_size,
              bool has_jacobian) {
  const auto own = std::make_shared<PythonModel>(PythonModel{.object = object,
                                                             .name = name,
                                                             .source = source,
                                                             .texts = {},
                                                             .params = {},
                                                             .example = example,
                                                             .has_jacobian = has_jacobian});
  for (const auto& [symbol, unit, lower, upper, scale, neutral, fixed, prior_sigma] : params) {
    own->params.push_back({.name = own->texts.emplace_back(symbol),
                           .unit = own->texts.emplace_back(unit),
                           .lower = lower,
                           .upper = upper,
                           .scale = scale,
                           .neutral = neutral,
                           .fixed = static_cast<Fixed>(fixed),
                           .prior_sigma = prior_sigma});
  }
  AddCameraModel(TableOf(*own, example_size), own, name);
  own->object.inc_ref();
}

}  // namespace

void BindModels(nb::module_& module) { module.def("register_model", &Register); }

}  // namespace plenocal::python
