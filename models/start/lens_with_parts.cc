// SPDX-License-Identifier: Apache-2.0
#include "models/start/lens_with_parts.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <mutex>
#include <numeric>
#include <string>
#include <vector>

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "models/registry.h"
#include "models/start/axis_point.h"
#include "models/start/central_model.h"

namespace plenocal {
namespace {

constexpr std::array<std::string_view, 4> kIntrinsics{"f_x", "f_y", "c_x", "c_y"};
constexpr int kMostColumns = 64;

// The data of a model, and all that its table refers to.
struct Combination {
  std::string name, source;
  CameraModel lens;
  const LensPart* axial = nullptr;     // the part that moves the rays' origins, if any
  std::vector<const LensPart*> parts;  // the others
  std::vector<Param> params;
  std::vector<double> example;

  [[nodiscard]] size_t AxialCount() const { return axial == nullptr ? 0 : axial->params.size(); }
  // Parameters on which a point depends.
  [[nodiscard]] Eigen::Index LensColumns() const {
    return static_cast<Eigen::Index>(lens.support_size > 0 ? lens.support_size
                                                           : lens.params.size());
  }
  [[nodiscard]] Eigen::Index Columns() const {
    return LensColumns() + static_cast<Eigen::Index>(params.size() - lens.params.size());
  }
};

const Combination& Of(const CameraModel& model) {
  return *static_cast<const Combination*>(model.self);
}

// The point as the lens has to image it, by the parameters of the part for it.
std::optional<ShiftedPoint> AtLens(const Combination& of,
                                   const double* a,
                                   const Eigen::Vector3d& p,
                                   double h) {
  if (of.axial != nullptr) return ShiftToLens(*of.axial, a, p, h);
  return ShiftedPoint{.p = p, .z_by_p = Eigen::RowVector3d::UnitZ()};
}

bool Project(const CameraModel& model,
             const double* params,
             const double* config,
             const double* values,
             const Eigen::Vector3d& p,
             double h,
             double* predicted) {
  const Combination& of = Of(model);
  const double* a = params + of.lens.params.size();
  const std::optional<ShiftedPoint> at_lens = AtLens(of, a, p, h);
  Eigen::Vector2d u, m, next;
  if (!at_lens || !of.lens.Project(params, config, values, at_lens->p, u.data())) return false;
  for (int r = 0; r < 2; ++r) m[r] = (u[r] - params[2 + r]) / params[r];
  a += of.AxialCount();
  for (const LensPart* part : of.parts) {
    if (!part->map(a, m.data(), next.data())) return false;
    m = next;
    a += part->params.size();
  }
  for (int r = 0; r < 2; ++r) predicted[r] = params[r] * m[r] + params[2 + r];
  return std::isfinite(predicted[0]) && std::isfinite(predicted[1]);
}

using Rows = Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor, 2, kMostColumns>;

// A point on its way through lens and parts: its place m in the plane at distance 1, with
// derivatives by p and h and, where they are needed, by the parameters of `Combination::Columns`.
class DifferentiatedPoint {
 public:
  DifferentiatedPoint(const Combination& of, const double* params, bool by_params)
      : of_(of), params_(params), by_params_(by_params) {
    if (by_params) J_.setZero(2, of.Columns());
  }

  bool ThroughLens(const double* config, const double* values, const Eigen::Vector3d& p, double h) {
    const std::optional<ShiftedPoint> at_lens = AtLens(of_, params_ + of_.lens.params.size(), p, h);
    const Eigen::Index columns = of_.LensColumns();
    Rows of_lens(2, by_params_ ? columns : 0);
    const ProjectionOutput out{.predicted = m_.data(),
                               .J_params = by_params_ ? of_lens.data() : nullptr,
                               .J_point = by_p_.data(),
                               .support = of_.lens.support_size > 0 ? support_.data() : nullptr};
    if (!at_lens || !of_.lens.ProjectWithJacobian(params_, config, values, at_lens->p, out)) {
      return false;
    }
    for (int r = 0; r < 2; ++r) {
      m_[r] = (m_[r] - params_[2 + r]) / params_[r];
      by_p_.row(r) /= params_[r];
      of_lens.row(r) /= params_[r];
    }
    const Eigen::Vector2d by_z = by_p_.col(2);
    by_h_ = by_z * at_lens->z_by_h;
    by_p_.col(2).setZero();
    by_p_ += by_z * at_lens->z_by_p;
    if (!by_params_) return true;
    J_.middleCols(4, columns - 4) = of_lens.rightCols(columns - 4);
    for (size_t i = 0; i < of_.AxialCount(); ++i) {
      J_.col(columns + static_cast<Eigen::Index>(i)) = by_z * at_lens->z_by_a[i];
    }
    return true;
  }

  bool ThroughParts() {
    const double* a = params_ + of_.lens.params.size() + of_.AxialCount();
    Eigen::Vector2d next;
    Eigen::Index done = of_.LensColumns() + static_cast<Eigen::Index>(of_.AxialCount());
    for (const LensPart* part : of_.parts) {
      const auto n = static_cast<Eigen::Index>(part->params.size());
      Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor, 2, 2 + kMostPartParams> own(2,
                                                                                            2 + n);
      if (!part->map_with_jacobian(a, m_.data(), next.data(), own.data())) return false;
      const Eigen::Matrix2d by_m = own.leftCols<2>();
      m_ = next;
      by_p_ = by_m.lazyProduct(by_p_).eval();
      by_h_ = by_m.lazyProduct(by_h_).eval();
      if (by_params_) {
        J_.middleCols(4, done - 4) = by_m.lazyProduct(J_.middleCols(4, done - 4)).eval();
        J_.middleCols(done, n) = own.rightCols(n);
      }
      done += n;
      a += n;
    }
    return true;
  }

  // Through focal lengths and principal point into the image.
  bool Write(const ProjectionOutput& out) {
    for (int r = 0; r < 2; ++r) {
      out.predicted[r] = params_[r] * m_[r] + params_[2 + r];
      Eigen::Map<Eigen::RowVector3d>(out.J_point + 3 * r) = params_[r] * by_p_.row(r);
      if (out.J_h != nullptr) out.J_h[r] = params_[r] * by_h_[r];
      if (!by_params_) continue;
      J_.row(r) *= params_[r];
      J_(r, r) = m_[r];
      J_(r, 2 + r) = 1;
    }
    if (by_params_) WriteParams(out);
    return std::isfinite(out.predicted[0]) && std::isfinite(out.predicted[1]);
  }

 private:
  // By the parameters of the support; where `out.support` is null, by all.
  void WriteParams(const ProjectionOutput& out) {
    const auto columns = static_cast<size_t>(J_.cols());
    if (of_.lens.support_size == 0) {
      std::copy_n(J_.data(), 2 * columns, out.J_params);
      return;
    }
    std::iota(support_.begin() + of_.LensColumns(), support_.end(), of_.lens.params.size());
    if (out.support != nullptr) {
      std::copy_n(support_.begin(), columns, out.support);
      std::copy_n(J_.data(), 2 * columns, out.J_params);
      return;
    }
    const size_t width = of_.params.size();
    std::fill_n(out.J_params, 2 * width, 0.0);
    for (size_t r = 0; r < 2; ++r) {
      for (size_t k = 0; k < columns; ++k) {
        out.J_params[r * width + support_[k]] = J_.data()[r * columns + k];
      }
    }
  }

  const Combination& of_;
  const double* params_;
  bool by_params_;
  Eigen::Vector2d m_, by_h_;
  Eigen::Matrix<double, 2, 3, Eigen::RowMajor> by_p_;
  Rows J_;
  std::array<size_t, kMostColumns> support_;  // of the lens, then of the parts
};

bool ProjectWithJacobian(const CameraModel& model,
                         const double* params,
                         const double* config,
                         const double* values,
                         const Eigen::Vector3d& p,
                         double h,
                         const ProjectionOutput& out) {
  DifferentiatedPoint point(Of(model), params, out.J_params != nullptr);
  return point.ThroughLens(config, values, p, h) && point.ThroughParts() && point.Write(out);
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
  std::array<double, kMaxObservationSize> at{params[0] * m.x() + params[2],
                                             params[1] * m.y() + params[3]};
  std::optional<Ray> ray = of.lens.Unproject(params, config, at.data());
  if (!ray || of.axial == nullptr) return ray;
  const std::optional<double> z_p =
      AxisPointOf(*of.axial, params + of.lens.params.size(), ray->direction);
  if (!z_p) return std::nullopt;
  ray->origin.z() = *z_p;
  return ray;
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

std::string Remedy(const CameraModel& model, std::span<const size_t> weak, const DepthRange& seen) {
  const Combination& of = Of(model);
  const size_t first = of.lens.params.size(), end = first + of.AxialCount();
  if (std::ranges::none_of(weak, [&](size_t i) { return i >= first && i < end; })) return "";
  return fmt::format(
      "Only points at different distances tell these parameters apart, and the target was seen at "
      "{:.3g} to {:.3g} m: add frames that are nearer, and frames that are farther; or keep all "
      "but one of them at 0 with 'fixed'.",
      seen.nearest,
      seen.farthest);
}

double PriorUnit(const CameraModel& model, const double* params) {
  const CameraModel& lens = Of(model).lens;
  return lens.functions.prior_unit(lens, params);
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
    if (part.ray_offset == nullptr) {
      made->parts.push_back(&part);
    } else if (made->params.size() == lens.params.size()) {
      made->axial = &part;
    } else {
      throw InputError("camera model '{}': {} acts before the lens; name it first: '{}+{}+...'",
                       name,
                       part.name,
                       lens.name,
                       part.name);
    }
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
  if (made->Columns() > kMostColumns) {
    throw InputError("camera model '{}': more than {} parameters", name, kMostColumns);
  }
  return made;
}

}  // namespace

bool TakesParts(const CameraModel& lens) {
  if (lens.plenoptic || !lens.IsCentral() || !lens.config.empty()) return false;
  if (lens.name.find('+') != std::string_view::npos) return false;
  return lens.params.size() >= kIntrinsics.size() &&
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
  if (made->axial != nullptr) model.centre = Centre::kAxis;
  model.homogeneous = true;
  if (lens.support_size > 0) model.support_size = static_cast<size_t>(made->Columns());
  model.functions = {.project = &Project,
                     .project_with_jacobian = &ProjectWithJacobian,
                     .unproject = &Unproject,
                     .start = &Start,
                     .misfit = &CentralModel::JudgeFit,
                     .remedy = &Remedy};
  if (lens.functions.prior_unit != nullptr) model.functions.prior_unit = &PriorUnit;
  return &AddCameraModel(model, made, made->name);
}

}  // namespace plenocal
