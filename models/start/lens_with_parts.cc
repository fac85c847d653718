// SPDX-License-Identifier: Apache-2.0
#include "models/start/lens_with_parts.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "models/registry.h"
#include "models/start/central_model.h"

namespace plenocal {
namespace {

constexpr std::array<std::string_view, 4> kIntrinsics{"f_x", "f_y", "c_x", "c_y"};
constexpr size_t kMostParams = 64;

// The data of a model, and all that its table refers to.
struct Combination {
  std::string name, source;
  CameraModel lens;
  std::vector<const LensPart*> parts;
  std::vector<Param> params;
  std::vector<double> example;
};

const Combination& Of(const CameraModel& model) {
  return *static_cast<const Combination*>(model.self);
}

// The lens' parameters for f_x = f_y = 1, c_x = c_y = 0: its image is m.
struct LensParams {
  LensParams(const Combination& of, const double* params) {
    numbers[0] = numbers[1] = 1;
    numbers[2] = numbers[3] = 0;
    std::copy(params + 4, params + of.lens.params.size(), numbers.begin() + 4);
  }
  std::array<double, kMostParams> numbers;  // those of the lens are set
};

bool Project(const CameraModel& model,
             const double* params,
             const double* config,
             const double* values,
             const Eigen::Vector3d& p,
             double h,
             double* predicted) {
  const Combination& of = Of(model);
  Eigen::Vector2d m, next;
  const LensParams lens(of, params);
  if (!of.lens.Project(lens.numbers.data(), config, values, p, m.data(), h)) return false;
  const double* a = params + of.lens.params.size();
  for (const LensPart* part : of.parts) {
    if (!part->map(a, m.data(), next.data())) return false;
    m = next;
    a += part->params.size();
  }
  for (int r = 0; r < 2; ++r) predicted[r] = params[r] * m[r] + params[2 + r];
  return std::isfinite(predicted[0]) && std::isfinite(predicted[1]);
}

bool ProjectWithJacobian(const CameraModel& model,
                         const double* params,
                         const double* config,
                         const double* values,
                         const Eigen::Vector3d& p,
                         double h,
                         const ProjectionOutput& out) {
  using Rows = Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor, 2, kMostParams>;
  const Combination& of = Of(model);
  const auto lens_count = static_cast<Eigen::Index>(of.lens.params.size()),
             count = static_cast<Eigen::Index>(of.params.size());
  const bool by_params = out.J_params != nullptr;
  const LensParams lens(of, params);
  Eigen::Vector2d m, next;
  Rows of_lens(2, by_params ? lens_count : 0), J = Rows::Zero(2, by_params ? count : 0);
  Eigen::Matrix<double, 2, 3, Eigen::RowMajor> by_point;
  if (!of.lens.ProjectWithJacobian(lens.numbers.data(),
                                   config,
                                   values,
                                   p,
                                   {.predicted = m.data(),
                                    .J_params = by_params ? of_lens.data() : nullptr,
                                    .J_point = by_point.data()},
                                   h)) {
    return false;
  }
  if (by_params) J.middleCols(4, lens_count - 4) = of_lens.rightCols(lens_count - 4);
  Eigen::Index done = lens_count;
  for (const LensPart* part : of.parts) {
    const auto n = static_cast<Eigen::Index>(part->params.size());
    Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor, 2, 2 + kMostPartParams> own(2, 2 + n);
    if (!part->map_with_jacobian(params + done, m.data(), next.data(), own.data())) return false;
    const Eigen::Matrix2d by_m = own.leftCols<2>();
    m = next;
    by_point = (by_m * by_point).eval();
    if (by_params) {
      J.middleCols(4, done - 4) = (by_m * J.middleCols(4, done - 4)).eval();
      J.middleCols(done, n) = own.rightCols(n);
    }
    done += n;
  }
  const Eigen::Vector2d f(params[0], params[1]);
  for (int r = 0; r < 2; ++r) {
    out.predicted[r] = f[r] * m[r] + params[2 + r];
    Eigen::Map<Eigen::RowVector3d>(out.J_point + 3 * r) = f[r] * by_point.row(r);
    if (out.J_h != nullptr) out.J_h[r] = 0;
    if (!by_params) continue;
    J.row(r) *= f[r];
    J(r, r) = m[r];
    J(r, 2 + r) = 1;
  }
  if (by_params) std::copy_n(J.data(), 2 * count, out.J_params);
  return std::isfinite(out.predicted[0]) && std::isfinite(out.predicted[1]);
}

std::optional<Ray> Unproject(const CameraModel& model,
                             const double* params,
                             const double* config,
                             const double* values) {
  const Combination& of = Of(model);
  Eigen::Vector2d m((values[0] - params[2]) / params[0], (values[1] - params[3]) / params[1]);
  const double* a = params + of.params.size();
  for (auto part = of.parts.rbegin(); part != of.parts.rend(); ++part) {
    a -= (*part)->params.size();
    const std::optional<Eigen::Vector2d> before = (*part)->unmap(a, m);
    if (!before) return std::nullopt;
    m = *before;
  }
  const LensParams lens(of, params);
  std::array<double, kMaxObservationSize> at{m.x(), m.y()};
  return of.lens.Unproject(lens.numbers.data(), config, at.data());
}

// Those of the lens, with parts that have no effect.
std::vector<StartCandidate> Start(const CameraModel& model, const StartProblem& problem) {
  const Combination& of = Of(model);
  const size_t count = of.lens.params.size();
  StartProblem of_lens = problem;
  of_lens.given = problem.given.first(std::min(count, problem.given.size()));
  of_lens.rules = problem.rules.first(std::min(count, problem.rules.size()));
  std::vector<bool> fixed;
  if (problem.fixed != nullptr) {
    fixed.assign(problem.fixed->begin(),
                 problem.fixed->begin() +
                     static_cast<std::ptrdiff_t>(std::min(count, problem.fixed->size())));
    of_lens.fixed = &fixed;
  }
  std::vector<StartCandidate> candidates = of.lens.Start(of_lens);
  for (StartCandidate& candidate : candidates) {
    for (size_t i = count; i < of.params.size(); ++i) {
      const std::optional<double> given =
          i < problem.given.size() ? problem.given[i] : std::nullopt;
      candidate.params.push_back(given.value_or(*of.params[i].neutral));
    }
  }
  return candidates;
}

const LensPart& PartNamed(std::string_view part, std::string_view model) {
  const std::span<const LensPart> parts = LensParts();
  const auto found = std::ranges::find(parts, part, &LensPart::name);
  if (found != parts.end()) return *found;
  std::vector<std::string_view> names;
  for (const LensPart& each : parts) names.push_back(each.name);
  throw InputError("camera model '{}': there is no part '{}'{}",
                   model,
                   part,
                   SuggestName(std::string(part), names));
}

std::shared_ptr<Combination> Combine(const CameraModel& lens, std::string_view name) {
  const auto made = std::make_shared<Combination>();
  made->name = name;
  made->lens = lens;
  made->source = lens.source;
  made->params.assign(lens.params.begin(), lens.params.end());
  made->example.assign(lens.example.begin(), lens.example.end());
  for (std::string_view rest = name.substr(lens.name.size() + 1);;) {
    const size_t plus = rest.find('+');
    const LensPart& part = PartNamed(rest.substr(0, plus), name);
    made->parts.push_back(&part);
    made->source += fmt::format("; {}: {}", part.name, part.source);
    for (const Param& param : part.params) {
      if (std::ranges::find(made->params, param.name, &Param::name) != made->params.end()) {
        throw InputError("camera model '{}': two of its parts have a parameter '{}'; leave one out",
                         name,
                         param.name);
      }
      made->params.push_back(param);
    }
    made->example.insert(made->example.end(), part.example.begin(), part.example.end());
    if (plus == std::string_view::npos) break;
    rest.remove_prefix(plus + 1);
  }
  if (made->params.size() > kMostParams) {
    throw InputError("camera model '{}': more than {} parameters", name, kMostParams);
  }
  return made;
}

}  // namespace

bool TakesParts(const CameraModel& lens) {
  if (lens.plenoptic || !lens.IsCentral() || lens.support_size > 0 || !lens.config.empty()) {
    return false;
  }
  if (lens.name.find('+') != std::string_view::npos) return false;
  return lens.params.size() >= kIntrinsics.size() && lens.params.size() <= kMostParams &&
         std::equal(kIntrinsics.begin(),
                    kIntrinsics.end(),
                    lens.params.begin(),
                    [](std::string_view name, const Param& param) { return param.name == name; });
}

const CameraModel* WithParts(const CameraModel& lens, std::string_view name) {
  static std::mutex mutex;
  const std::lock_guard lock(mutex);
  for (const CameraModel& model : CameraModels()) {
    if (model.name == name) return &model;
  }
  const std::shared_ptr<Combination> made = Combine(lens, name);
  CameraModel model = lens;
  model.name = made->name;
  model.source = made->source;
  model.params = made->params;
  model.example = made->example;
  model.self = made.get();
  model.usage = Usage::kRare;
  model.functions = {.project = &Project,
                     .project_with_jacobian = &ProjectWithJacobian,
                     .unproject = &Unproject,
                     .start = &Start,
                     .misfit = &CentralModel::JudgeFit};
  return &AddCameraModel(model, made, made->name);
}

}  // namespace plenocal
