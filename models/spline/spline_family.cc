// SPDX-License-Identifier: Apache-2.0
//
// The members of the family of models/splined.h as camera models.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <memory>
#include <mutex>
#include <numbers>
#include <string>
#include <vector>

#include "calib/base/format_error.h"
#include "models/registry.h"
#include "models/splined.h"
#include "models/start/central_model.h"

namespace plenocal {
namespace {

// 8 x 6 cells over an image of 4 : 3, each somewhat larger than the distance of a target's points:
// more knots than points would follow the noise.
constexpr SplineLens kUsual{.order = 3, .columns = 11, .rows = 9};
constexpr std::string_view kFamily = "splined";

// The data of a model, and all that its table refers to.
struct Spline {
  SplineLens lens = {};
  std::string name = {}, source = {};
  std::vector<std::string> names = {};  // of the parameters
  std::vector<Param> params = {};
  std::vector<double> example = {};
  std::vector<std::array<size_t, 4>> neighbours = {};  // of the prior rows
  std::vector<PriorRow> roughness = {};
};

const SplineLens& LensIn(const CameraModel& model) {
  return static_cast<const Spline*>(model.self)->lens;
}

bool ProjectSpline(const CameraModel& model,
                   const double* params,
                   const double* /*config*/,
                   const double* /*values*/,
                   const Eigen::Vector3d& p,
                   double /*h*/,
                   double* predicted) {
  return LensIn(model).Project(params, p, predicted);
}

bool DifferentiateSpline(const CameraModel& model,
                         const double* params,
                         const double* /*config*/,
                         const double* /*values*/,
                         const Eigen::Vector3d& p,
                         double /*h*/,
                         const ProjectionOutput& out) {
  return LensIn(model).ProjectWithJacobian(params, p, out);
}

std::optional<Ray> UnprojectSpline(const CameraModel& model,
                                   const double* params,
                                   const double* /*config*/,
                                   const double* values) {
  const auto direction = LensIn(model).Unproject(params, {values[0], values[1]});
  if (!direction) return std::nullopt;
  return Ray{Eigen::Vector3d::Zero(), *direction};
}

// Third differences of neighbours are of the third derivative by u times this.
double CubeOfSpacing(const CameraModel& model, const double* params) {
  return std::pow(LensIn(model).KnotsPerUnit(params[SplineLens::kFov]), -3);
}

// Where there are no points, the lens continues smoothly.
void AddPriorRows(Spline* spline) {
  // Third derivative of m by u, focal lengths: of a pinhole camera 58 degrees off the axis; of a
  // fisheye it is below 1.
  constexpr double kRoughness = 20;
  static constexpr std::array kThirdDifference{-1.0, 3.0, -3.0, 1.0};
  const SplineLens& lens = spline->lens;
  const auto add = [&](int a, int b, size_t stride) {
    for (size_t x = lens.KnotPlace(a, b), axis = 0; axis < 2; ++x, ++axis) {
      spline->neighbours.push_back({x, x + stride, x + 2 * stride, x + 3 * stride});
    }
  };
  for (int b = 0; b < lens.rows; ++b) {
    for (int a = 0; a < lens.columns; ++a) {
      if (a + 3 < lens.columns) add(a, b, 2);
      if (b + 3 < lens.rows) add(a, b, 2 * static_cast<size_t>(lens.columns));
    }
  }
  for (const std::array<size_t, 4>& indices : spline->neighbours) {
    spline->roughness.push_back(
        {.indices = indices, .weights = kThirdDifference, .sigma = kRoughness});
  }
}

void DescribeParams(Spline* spline) {
  // In focal lengths: no lens is farther from stereographic.
  constexpr double kPriorSigma = 1;
  const SplineLens& lens = spline->lens;
  spline->params = {
      Param{.name = "f_x", .unit = "px", .lower = 0, .fixed = Fixed::kAlways},
      Param{.name = "f_y", .unit = "px", .lower = 0, .fixed = Fixed::kAlways},
      Param{.name = "c_x", .unit = "px", .fixed = Fixed::kAlways},
      Param{.name = "c_y", .unit = "px", .fixed = Fixed::kAlways},
      Param{.name = "fov", .unit = "deg", .lower = 0, .upper = 360, .fixed = Fixed::kAlways}};
  // "x_07_04": column, row.
  for (int k = 0; k < 2 * lens.Knots(); ++k) {
    spline->names.push_back(fmt::format(
        "{}_{:02}_{:02}", k % 2 == 0 ? 'x' : 'y', k / 2 % lens.columns, k / 2 / lens.columns));
  }
  for (const std::string& name : spline->names) {
    spline->params.push_back(
        {.name = name, .unit = "1", .scale = 1, .neutral = 0, .prior_sigma = kPriorSigma});
  }
  const int middle = lens.columns / 2, right = middle + std::max(1, lens.columns / 4);
  for (const size_t k : {lens.KnotPlace(middle, lens.rows / 2),
                         lens.KnotPlace(middle, lens.rows / 2) + 1,
                         lens.KnotPlace(right, lens.rows / 2) + 1}) {
    spline->params[k].fixed = Fixed::kAgainstPoses;
  }
}

// A fisheye between equidistant and stereographic, with a part of it pressed in: the same lens for
// all knots, whose full cells cover the image.
void MakeExample(Spline* spline) {
  const SplineLens& lens = spline->lens;
  constexpr double kHalfFov = 40 * std::numbers::pi / 180, kHeight = 0.75;
  const double wider =
                   std::max(1.0, kHeight * (lens.columns - lens.order) / (lens.rows - lens.order)),
               fov =
                   std::ceil(720 / std::numbers::pi * std::atan(wider * std::tan(kHalfFov)) - 1e-9);
  spline->example = {210, 212, 322, 243, fov};
  spline->example.resize(lens.ParamCount());
  const double usual = kUsual.KnotsPerUnit(160) / lens.KnotsPerUnit(fov);
  for (int b = 0; b < lens.rows; ++b) {
    for (int a = 0; a < lens.columns; ++a) {
      const double i = usual * (a - (lens.columns - 1) / 2.0),
                   j = usual * (b - (lens.rows - 1) / 2.0);
      const double stretch = -0.0012 * (i * i + j * j), pressed = i < -1 && j < -1 ? 0.01 : 0;
      spline->example[lens.KnotPlace(a, b)] = stretch * i + pressed;
      spline->example[lens.KnotPlace(a, b) + 1] = stretch * j - pressed / 2;
    }
  }
}

std::shared_ptr<const Spline> MakeSpline(const SplineLens& lens) {
  const auto made = std::make_shared<Spline>();
  made->lens = lens;
  made->name = Splined::NameOf(lens);
  made->source = fmt::format("mrcal, splined stereographic lens model of order {}, {} x {} knots",
                             lens.order,
                             lens.columns,
                             lens.rows);
  DescribeParams(made.get());
  AddPriorRows(made.get());
  MakeExample(made.get());
  return made;
}

// The number before `end`, which it removes; 0 for another text.
int TakeNumber(std::string_view* text, std::string_view end) {
  int number = 0;
  const auto [rest, error] = std::from_chars(text->data(), text->data() + text->size(), number);
  text->remove_prefix(static_cast<size_t>(rest - text->data()));
  if (error != std::errc() || !text->starts_with(end)) return 0;
  text->remove_prefix(end.size());
  return number;
}

CameraModel TableOf(const Spline& spline) {
  CameraModel model{};
  model.name = spline.name;
  model.source = spline.source;
  model.params = spline.params;
  model.measured = CentralModel::kMeasured;
  model.example = spline.example;
  model.example_size = {640, 480};
  model.functions = {.project = &ProjectSpline,
                     .project_with_jacobian = &DifferentiateSpline,
                     .unproject = &UnprojectSpline,
                     .start = &StartSpline,
                     .misfit = &CentralModel::JudgeFit,
                     .prior_unit = &CubeOfSpacing};
  model.self = &spline;
  model.homogeneous = true;
  model.support_size = spline.lens.SupportSize();
  model.prior_rows = spline.roughness;
  return model;
}

const CameraModel* Member(std::string_view name) {
  if (!name.starts_with(kFamily)) return nullptr;
  std::string_view text = name.substr(kFamily.size());
  SplineLens lens;
  lens.order = text.starts_with('2') ? 2 : 3;
  if (lens.order == 2) text.remove_prefix(1);
  if (!text.empty() && text.front() != '-') return nullptr;
  text.remove_prefix(std::min<size_t>(1, text.size()));
  lens.columns = TakeNumber(&text, "x");
  lens.rows = TakeNumber(&text, "");
  constexpr int kMostColumns = 60, kMostRows = 40;
  const auto within = [&](int knots, int most) { return knots > lens.order && knots <= most; };
  if (!text.empty() || !within(lens.columns, kMostColumns) || !within(lens.rows, kMostRows)) {
    throw InputError(
        "camera model '{}': a spline is 'splined-NxM' (order 3) or 'splined2-NxM' (order 2) with "
        "N = 4 to {} columns and M = 4 to {} rows of knots (order 2: from 3), like splined-20x14",
        name,
        kMostColumns,
        kMostRows);
  }
  static std::mutex mutex;
  const std::lock_guard lock(mutex);
  const std::string own_name = Splined::NameOf(lens);
  for (const CameraModel& model : CameraModels()) {
    if (model.name == own_name) return &model;
  }
  const std::shared_ptr<const Spline> spline = MakeSpline(lens);
  return &AddCameraModel(TableOf(*spline), spline, own_name);
}

}  // namespace

CameraModel Splined::Table() {
  static const std::shared_ptr<const Spline> spline = MakeSpline(kUsual);
  CameraModel model = TableOf(*spline);
  model.functions.member = &Member;
  return model;
}

const SplineLens* Splined::LensOf(const CameraModel& model) {
  return model.functions.project == &ProjectSpline ? &LensIn(model) : nullptr;
}

std::string Splined::NameOf(const SplineLens& lens) {
  if (lens.order == kUsual.order && lens.columns == kUsual.columns && lens.rows == kUsual.rows) {
    return std::string(kFamily);
  }
  return fmt::format("{}{}-{}x{}", kFamily, lens.order == 2 ? "2" : "", lens.columns, lens.rows);
}

}  // namespace plenocal
