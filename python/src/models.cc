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

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
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

/// Along its ray a point does not move in the image: what differences leave of that is rounding.
/// Where it is more, the model depends on the distance, and `models check` is to find it.
Eigen::Matrix<double, 2, 3> WithoutRadialRounding(const Eigen::Matrix<double, 2, 3>& J,
                                                  const Eigen::Vector3d& p,
                                                  const Eigen::Vector2d& u) {
  constexpr double kRounding = 1e-7;
  const Eigen::Vector2d along = J * p;
  if (along.cwiseAbs().maxCoeff() > kRounding * (1 + u.cwiseAbs().maxCoeff())) return J;
  return J - along * p.transpose() / p.squaredNorm();
}

/// Projections of a block of points: a row each point; derivatives of x, then those of y.
struct BlockRows {
  BlockRows(const PointBlock& in, const ProjectionOutput& out, size_t params)
      : p(in.p, static_cast<Eigen::Index>(in.count), 3),
        predicted(out.predicted, p.rows(), 2),
        J_params(out.J_params, p.rows(), out.J_params ? 2 * static_cast<Eigen::Index>(params) : 0),
        J_point(out.J_point, p.rows(), out.J_point ? 6 : 0) {}

  Eigen::Map<const Eigen::MatrixXd> p;
  Eigen::Map<Eigen::MatrixXd> predicted, J_params, J_point;
};

/// Central differences; one-sided where a neighbour is outside of the domain. All points and their
/// neighbours in one call.
void ProjectWithDifferences(const PythonModel& model,
                            const Eigen::RowVectorXd& params,
                            BlockRows* block) {
  // Truncation and rounding of a central difference are equally small at this relative step.
  static const double kStep = std::cbrt(std::numeric_limits<double>::epsilon());
  const Eigen::Index n = params.size(), count = block->p.rows();
  const Eigen::Index first = block->J_params.cols() > 0 ? 0 : n,
                     last = block->J_point.cols() > 0 ? n + 3 : n;
  const auto row_of = [&](Eigen::Index k, int side) {
    return (2 * (k - first) + side + 1) * count;
  };
  RowMajor cameras = params.replicate(row_of(last, 0), 1),
           points = block->p.replicate(2 * (last - first) + 1, 1);
  Eigen::MatrixXd steps(count, n + 3);
  for (Eigen::Index k = first; k < last; ++k) {
    if (k < n) {
      const double scale = model.params[static_cast<size_t>(k)].scale;
      steps.col(k).setConstant(kStep * std::max({std::abs(params[k]), scale, kStep}));
    } else {
      steps.col(k) = kStep * block->p.rowwise().norm();
    }
    for (const int side : {0, 1}) {
      auto values = k < n ? cameras.col(k) : points.col(k - n);
      values.segment(row_of(k, side), count) += (side == 0 ? -1 : 1) * steps.col(k);
    }
  }
  const auto projected = ProjectRows(model, cameras, points);
  if (!projected) {
    block->predicted.setConstant(kNan);
    return;
  }
  block->predicted = projected->topRows(count);
  for (Eigen::Index k = first; k < last; ++k) {
    for (Eigen::Index i = 0; i < count; ++i) {
      const auto middle = projected->row(i), before = projected->row(row_of(k, 0) + i),
                 after = projected->row(row_of(k, 1) + i);
      const bool low = before.allFinite(), high = after.allFinite();
      const Eigen::RowVector2d slope = ((high ? after : middle) - (low ? before : middle)) /
                                       ((low && high ? 2 : 1) * steps(i, k));
      for (Eigen::Index r = 0; r < 2; ++r) {
        (k < n ? block->J_params(i, r * n + k) : block->J_point(i, r * 3 + k - n)) =
            low || high ? slope[r] : kNan;
      }
    }
  }
  for (Eigen::Index i = 0; i < count && last > n; ++i) {
    Eigen::Matrix<double, 2, 3> J;
    J << block->J_point.row(i).head<3>(), block->J_point.row(i).tail<3>();
    J = WithoutRadialRounding(J, block->p.row(i), block->predicted.row(i));
    block->J_point.row(i) << J.row(0), J.row(1);
  }
}

/// The model's own derivatives.
void ProjectWithOwnJacobian(const PythonModel& model,
                            const Eigen::RowVectorXd& params,
                            BlockRows* block) {
  block->predicted.setConstant(kNan);
  CallModel([&] {
    const nb::object result =
        model.object.attr("_jacobian_rows")(AsArray(params), AsArray(block->p));
    const RowMajor predicted = FromArray(result[0], 2),
                   J_params = FromArray(result[1], 2 * params.size()),
                   J_point = FromArray(result[2], 6);
    block->predicted = predicted;
    if (block->J_params.cols() > 0) block->J_params = J_params;
    if (block->J_point.cols() > 0) block->J_point = J_point;
  });
}

void ProjectBlock(const CameraModel& model,
                  const double* params,
                  const double* /*config*/,
                  const PointBlock& in,
                  const ProjectionOutput& out) {
  const PythonModel& own = PythonModelOf(model);
  const Eigen::RowVectorXd row =
      Eigen::Map<const Eigen::RowVectorXd>(params, static_cast<Eigen::Index>(own.params.size()));
  BlockRows block(in, out, own.params.size());
  const bool derive = out.J_params != nullptr || out.J_point != nullptr;
  if (out.J_h != nullptr) std::fill_n(out.J_h, 2 * in.count, 0.0);
  (own.has_jacobian && derive ? ProjectWithOwnJacobian : ProjectWithDifferences)(own, row, &block);
  for (Eigen::Index i = 0; i < block.p.rows(); ++i) {
    if (block.predicted.row(i).allFinite() && block.J_params.row(i).allFinite() &&
        block.J_point.row(i).allFinite()) {
      continue;
    }
    block.predicted.row(i).setConstant(kNan);
    block.J_params.row(i).setConstant(kNan);
    block.J_point.row(i).setConstant(kNan);
  }
}

bool ProjectWithJacobian(const CameraModel& model,
                         const double* params,
                         const double* config,
                         const double* /*values*/,
                         const Eigen::Vector3d& p,
                         double /*h*/,
                         const ProjectionOutput& out) {
  ProjectBlock(model, params, config, {1, p.data()}, out);
  return std::isfinite(out.predicted[0]);
}

bool ProjectOne(const CameraModel& model,
                const double* params,
                const double* config,
                const double* values,
                const Eigen::Vector3d& p,
                double h,
                double* predicted) {
  return ProjectWithJacobian(model, params, config, values, p, h, {.predicted = predicted});
}

std::vector<std::optional<Ray>> UnprojectBlock(
    const CameraModel& model,
    const double* params,
    const double* /*config*/,
    std::span<const std::array<double, kMaxObservationSize>> values) {
  RowMajor pixels(values.size(), 2);
  for (Eigen::Index i = 0; i < pixels.rows(); ++i) {
    pixels.row(i) = Eigen::Map<const Eigen::RowVector2d>(values[static_cast<size_t>(i)].data());
  }
  const auto n = static_cast<Eigen::Index>(model.params.size());
  std::vector<std::optional<Ray>> rays(values.size());
  CallModel([&] {
    const RowMajor directions =
        FromArray(PythonModelOf(model).object.attr("_unproject_rows")(
                      AsArray(Eigen::Map<const RowMajor>(params, 1, n)), AsArray(pixels)),
                  3);
    for (Eigen::Index i = 0; i < pixels.rows(); ++i) {
      const auto unit = UnitDirection(directions.row(i).transpose());
      if (unit) rays[static_cast<size_t>(i)] = Ray{Eigen::Vector3d::Zero(), *unit};
    }
  });
  return rays;
}

std::optional<Ray> UnprojectOne(const CameraModel& model,
                                const double* params,
                                const double* config,
                                const double* values) {
  std::array<double, kMaxObservationSize> pixel{values[0], values[1]};
  return UnprojectBlock(model, params, config, {&pixel, 1})[0];
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
                        .misfit = &CentralModel::JudgeFit,
                        .project_block = &ProjectBlock,
                        .unproject_block = &UnprojectBlock},
          .self = &own,
          .homogeneous = true};
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
