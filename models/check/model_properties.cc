// SPDX-License-Identifier: Apache-2.0
#include "models/check/model_properties.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>

#include "calib/camera/rays.h"

namespace plenocal {
namespace {

// Unproject solves to a few roundings of the image coordinates; 1e-10 of the image's width leaves
// room for the model's own conditioning inside the image.
constexpr double kRoundTrip = 1e-10;
// Near the edge of the domain the image stands still while the direction moves: kEdgeMargin inside
// it the derivative is some thousand times smaller, and so much larger is the error.
constexpr double kEdgeMargin = 1e-3;  // rad
constexpr double kRoundTripAtEdge = 1e-7;
// Two central differences extrapolated: h^4 = 1e-16 of truncation, 1e-16 / 1e-4 of rounding, and a
// factor of 100 for higher derivatives near the edge.
constexpr double kStep = 1e-4;
constexpr double kDerivative = 1e-9;
constexpr double kDerivativeAtEdge = 1e-6;
// J_point and p_cam are exact to rounding.
constexpr double kEuler = 1e-12;
// Distances along a ray at which points are placed, m.
constexpr std::array kDepths{0.3, 1.0, 7.5, 100.0};

using Values = std::array<double, kMaxObservationSize>;

Eigen::Vector3d Direction(double theta, double phi) {
  return {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)};
}

std::vector<double> Azimuths() {
  std::vector<double> azimuths;
  azimuths.reserve(16);
  for (int i = 0; i < 16; ++i) azimuths.push_back(i * std::numbers::pi / 8);
  return azimuths;
}

std::string Text(const Eigen::Vector3d& p) {
  return fmt::format("({:.6g}, {:.6g}, {:.6g})", p.x(), p.y(), p.z());
}

// A model at its example parameters, and what it was found to violate.
class Examination {
 public:
  explicit Examination(const CameraModel& model) : model_(model) {}

  // Notes a violation unless `holds`; returns `holds`.
  template <typename... Args>
  bool Expect(bool holds, fmt::format_string<Args...> text, Args&&... args) {
    if (!holds) violations_.push_back(fmt::format(text, std::forward<Args>(args)...));
    return holds;
  }
  std::vector<std::string> Violations() && { return std::move(violations_); }

  bool Project(const Eigen::Vector3d& p, Values* values, double h = 1) const {
    double predicted[kMaxObservationSize];
    if (!model_.Project(Params(), Config(), values->data(), p, predicted, h)) return false;
    std::copy_n(predicted, model_.measured.size(), values->begin());
    return true;
  }
  [[nodiscard]] std::optional<Ray> Unproject(const Values& values) const {
    return model_.Unproject(Params(), Config(), values.data());
  }
  // `Unproject` where the model must see something; nothing, and a violation, where it does not.
  std::optional<Ray> RayOf(const Values& values) {
    std::optional<Ray> ray = Unproject(values);
    Expect(ray.has_value(), "pixel ({:.6g}, {:.6g}) has no ray", values[0], values[1]);
    return ray;
  }
  [[nodiscard]] bool AllFinite(const Values& values) const {
    return std::all_of(values.begin(), values.begin() + model_.measured.size(), [](double value) {
      return std::isfinite(value);
    });
  }

  // An observation at a place in the example's image; what it is seen through lies close by.
  [[nodiscard]] Values At(double x, double y) const {
    Values values{};
    const double place[2] = {x, y};
    for (size_t i = 0; i < model_.measured.size(); ++i) values[i] = place[i % 2];
    for (size_t i = 0; i < model_.context.size(); ++i) {
      values[model_.measured.size() + i] = place[i % 2] + (i % 2 == 0 ? 3 : -2);
    }
    return values;
  }
  // With numbers in the context that observations may lack.
  [[nodiscard]] Values WithOptionalContext(Values values) const {
    for (size_t i = 0; i < model_.optional_context.size(); ++i) {
      values[model_.measured.size() + model_.context.size() + i] =
          (i % 2 == 0 ? 2.5 : -1.5) + 0.1 * static_cast<double>(i);
    }
    return values;
  }
  // A grid over the image from corner to corner.
  [[nodiscard]] std::vector<Values> Grid(int steps) const {
    std::vector<Values> grid;
    for (int i = 0; i <= steps; ++i) {
      for (int j = 0; j <= steps; ++j) {
        grid.push_back(At((model_.example_size[0] - 1.0) * i / steps,
                          (model_.example_size[1] - 1.0) * j / steps));
      }
    }
    return grid;
  }
  [[nodiscard]] Values Centre() const {
    return At((model_.example_size[0] - 1) / 2.0, (model_.example_size[1] - 1) / 2.0);
  }
  // The largest angle from the optical axis that is imaged, counted from inside; pi if all are.
  [[nodiscard]] double EdgeOfDomain(double phi) const {
    const auto seen = [&](double theta) {
      Values values = Centre();
      return Project(Direction(theta, phi), &values);
    };
    constexpr double kScan = 0.01;
    double inside = 0;
    while (inside + kScan < std::numbers::pi && seen(inside + kScan)) inside += kScan;
    double outside = std::min(inside + kScan, std::numbers::pi);
    if (seen(outside)) return std::numbers::pi;
    for (int i = 0; i < 60; ++i) {
      const double middle = (inside + outside) / 2;
      (seen(middle) ? inside : outside) = middle;
    }
    return inside;
  }

  // Size of a change of a parameter that matters.
  [[nodiscard]] double SizeOf(size_t param) const {
    const double size = std::max(std::abs(Params()[param]), model_.params[param].scale);
    return size == 0 ? 1 : size;
  }

  // Compares project_with_jacobian with differences of project.
  void CheckJacobian(const Eigen::Vector3d& p_cam,
                     const Values& values,
                     double tolerance,
                     double h = 1) {
    const size_t rows = model_.measured.size(), count = model_.params.size();
    std::vector<double> unknowns(Params(), Params() + count);
    unknowns.insert(unknowns.end(), p_cam.data(), p_cam.data() + 3);
    if (model_.homogeneous) unknowns.push_back(h);
    const auto evaluate = [&](const std::vector<double>& x) {
      Eigen::VectorXd predicted =
          Eigen::VectorXd::Constant(rows, std::numeric_limits<double>::quiet_NaN());
      const Eigen::Vector3d p(x[count], x[count + 1], x[count + 2]);
      const double h_at = model_.homogeneous ? x.back() : 1;
      Expect(model_.Project(x.data(), Config(), values.data(), p, predicted.data(), h_at),
             "point {} is not imaged",
             Text(p));
      return predicted;
    };

    std::vector<double> J_params(rows * count), J_point(rows * 3), J_h(rows);
    Eigen::VectorXd predicted(rows);
    if (!Expect(model_.ProjectWithJacobian(Params(),
                                           Config(),
                                           values.data(),
                                           p_cam,
                                           {.predicted = predicted.data(),
                                            .J_params = J_params.data(),
                                            .J_point = J_point.data(),
                                            .J_h = J_h.data()},
                                           h),
                "point {} is not imaged",
                Text(p_cam))) {
      return;
    }
    // Near the edge of some domains the image X / h goes to infinity, and a rounding of h changes
    // it by its square.
    const double width = model_.example_size[0];
    const double farthest = width + predicted.cwiseAbs().maxCoeff();
    // Jets divide by multiplying with the inverse: a few roundings.
    Expect((predicted - evaluate(unknowns)).cwiseAbs().maxCoeff() <
               1e-14 * farthest * (farthest / width),
           "the image of {} depends on the scalar type",
           Text(p_cam));
    const Eigen::Map<const Eigen::VectorXd> all_J_point(J_point.data(), rows * 3);
    Eigen::VectorXd alone(rows), J_alone(rows * 3);
    Expect(model_.ProjectWithJacobian(Params(),
                                      Config(),
                                      values.data(),
                                      p_cam,
                                      {.predicted = alone.data(), .J_point = J_alone.data()},
                                      h) &&
               (J_alone - all_J_point).norm() <= 1e-13 * all_J_point.norm(),
           "derivatives by the point at {} depend on whether those by parameters are needed",
           Text(p_cam));
    if (h == 1) CheckSupport(p_cam, values, J_params);
    const double image = farthest + all_J_point.cwiseAbs().maxCoeff() * p_cam.norm();
    for (size_t k = 0; k < unknowns.size(); ++k) {
      const bool is_param = k < count;
      const double size = is_param ? SizeOf(k) : k < count + 3 ? p_cam.norm() : 1;
      const auto difference = [&](double step) -> Eigen::VectorXd {
        std::vector<double> up = unknowns, down = unknowns;
        up[k] += step;
        down[k] -= step;
        return (evaluate(up) - evaluate(down)) / (up[k] - down[k]);
      };
      const double step = kStep * size;
      const Eigen::VectorXd numeric = (4 * difference(step / 2) - difference(step)) / 3;
      for (size_t r = 0; r < rows; ++r) {
        const double analytic = is_param        ? J_params[r * count + k]
                                : k < count + 3 ? J_point[r * 3 + (k - count)]
                                                : J_h[r];
        const double by_difference = numeric[static_cast<Eigen::Index>(r)];
        // In pixels for a change of the unknown by its own size.
        Expect(std::abs((analytic - by_difference) * size) <=
                   tolerance * (image + std::abs(analytic * size)),
               "derivative of {} by {} at {} is {:.9g}, differences give {:.9g}",
               model_.measured[r],
               is_param ? model_.params[k].name : std::string_view("xyzh").substr(k - count, 1),
               Text(p_cam),
               analytic,
               by_difference);
      }
    }
  }

  // Compares the columns of the parameters on which a point depends with all of them.
  void CheckSupport(const Eigen::Vector3d& p_cam, const Values& values, std::vector<double> J) {
    const size_t rows = model_.measured.size(), width = model_.support_size;
    if (width == 0) return;
    std::vector<double> J_own(rows * width), J_point(rows * 3), predicted(rows);
    std::vector<size_t> support(width);
    model_.ProjectWithJacobian(Params(),
                               Config(),
                               values.data(),
                               p_cam,
                               {.predicted = predicted.data(),
                                .J_params = J_own.data(),
                                .J_point = J_point.data(),
                                .support = support.data()});
    for (size_t r = 0; r < rows; ++r) {
      for (size_t i = 0; i < width; ++i)
        J[r * model_.params.size() + support[i]] -= J_own[r * width + i];
    }
    Expect(std::ranges::all_of(J, [](double value) { return value == 0; }),
           "derivatives at {} by the parameters on which it depends are not those by all",
           Text(p_cam));
  }

  [[nodiscard]] const double* Params() const { return model_.example.data(); }
  [[nodiscard]] const double* Config() const { return model_.example_config.data(); }

 private:
  const CameraModel& model_;
  std::vector<std::string> violations_;
};

void IsDescribed(const CameraModel& model, Examination& check) {
  check.Expect(!model.name.empty() &&
                   model.name.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789-+") ==
                       std::string_view::npos,
               "name '{}': only a to z, 0 to 9, '-' and, before parts, '+' may stand in it",
               model.name);
  check.Expect(!model.source.empty(), "no source");
  check.Expect(!model.params.empty(), "no parameters");
  check.Expect(!model.measured.empty(), "nothing is measured");
  check.Expect(model.measured.size() + model.context.size() <= kMaxObservationSize,
               "an observation holds more than {} numbers",
               kMaxObservationSize);
  check.Expect(model.params.size() == model.example.size() &&
                   model.config.size() == model.example_config.size(),
               "the example has another number of parameters than the model");
  check.Expect(model.example_size[0] > 0 && model.example_size[1] > 0, "the example has no image");
  std::set<std::string_view> names;
  const auto describe = [&](std::span<const Param> params, std::span<const double> example) {
    for (size_t i = 0; i < std::min(params.size(), example.size()); ++i) {
      const Param& param = params[i];
      check.Expect(!param.name.empty(), "parameter {} has no name", i);
      check.Expect(!param.unit.empty(), "{} has no unit", param.name);
      check.Expect(names.insert(param.name).second, "{} stands twice", param.name);
      check.Expect(param.scale >= 0, "{} has a negative scale", param.name);
      check.Expect(param.lower < example[i] && example[i] < param.upper,
                   "the example's {} = {} is not within its limits",
                   param.name,
                   example[i]);
    }
  };
  describe(model.params, model.example);
  describe(model.config, model.example_config);
  // The detections' other columns.
  std::set<std::string_view> columns{"camera", "frame", "marker", "sigma", "dx", "dy", "used"};
  for (const auto& list : {model.measured, model.context}) {
    for (const std::string_view name : list) {
      check.Expect(!name.empty(), "a coordinate has no name");
      check.Expect(columns.insert(name).second, "coordinate {} is a column already", name);
    }
  }
}

void FindsPixelsAgain(const CameraModel& model, Examination& check) {
  for (const Values& seen : check.Grid(20)) {
    const std::optional<Ray> ray = check.RayOf(seen);
    if (!ray) continue;
    check.Expect(std::abs(ray->direction.norm() - 1) <= kEuler,
                 "direction of pixel ({:.6g}, {:.6g}) has length {:.15g}",
                 seen[0],
                 seen[1],
                 ray->direction.norm());
    for (const double depth : kDepths) {
      Values values = seen;
      if (!check.Expect(check.Project(ray->origin + depth * ray->direction, &values),
                        "the point {} m along the ray of pixel ({:.6g}, {:.6g}) is not imaged",
                        depth,
                        seen[0],
                        seen[1])) {
        continue;
      }
      for (size_t i = 0; i < model.measured.size(); ++i) {
        check.Expect(std::abs(values[i] - seen[i]) <= kRoundTrip * model.example_size[0],
                     "pixel ({:.6g}, {:.6g}), {} m along its ray: {} off by {:.3g}",
                     seen[0],
                     seen[1],
                     depth,
                     model.measured[i],
                     values[i] - seen[i]);
      }
    }
  }
}

void FindsDirectionsAgain(const CameraModel& /*model*/, Examination& check) {
  for (const double phi : Azimuths()) {
    const double edge = check.EdgeOfDomain(phi);
    if (!check.Expect(edge > 2 * kEdgeMargin, "nothing is imaged around the optical axis")) break;
    for (const double part : {0.0, 1e-9, 1e-4, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0}) {
      const double theta = part * (edge - kEdgeMargin);
      const Eigen::Vector3d direction = Direction(theta, phi);
      for (const double depth : kDepths) {
        Values values{};
        if (!check.Expect(check.Project(depth * direction, &values) && check.AllFinite(values),
                          "point {} is not imaged",
                          Text(depth * direction))) {
          continue;
        }
        const std::optional<Ray> ray = check.Unproject(values);
        const double tolerance = part < 0.95 ? kRoundTrip : kRoundTripAtEdge;
        check.Expect(ray.has_value() && (ray->direction - direction).norm() < tolerance,
                     "the direction {:.6g} rad off the axis at azimuth {:.6g} (the domain ends at "
                     "{:.6g}) comes back {}",
                     theta,
                     phi,
                     edge,
                     ray ? fmt::format("wrong by {:.3g}", (ray->direction - direction).norm())
                         : "not at all");
      }
    }
  }
}

void HasOneDomain(const CameraModel& model, Examination& check) {
  constexpr double kScan = 0.003;  // rad
  for (const double phi : Azimuths()) {
    // The domain has one edge: what lies beyond it is not imaged again (a fold would show here).
    // Without a single centre it depends on the distance, and is sought at 1 m.
    const double edge = check.EdgeOfDomain(phi);
    for (double theta = edge + 1e-6; theta < std::numbers::pi; theta += kScan) {
      for (const double depth : kDepths) {
        if (!model.IsCentral() && depth != 1) continue;
        Values values = check.Centre();
        check.Expect(!check.Project(depth * Direction(theta, phi), &values),
                     "imaged {:.6g} rad off the axis, beyond the edge of the domain at {:.6g} "
                     "(azimuth {:.6g})",
                     theta,
                     edge,
                     phi);
      }
    }
    for (double theta = 0; theta <= edge; theta += kScan) {
      Values values = check.Centre();
      check.Expect(check.Project(Direction(theta, phi), &values) && check.AllFinite(values),
                   "not imaged {:.6g} rad off the axis, inside the domain's edge at {:.6g} "
                   "(azimuth {:.6g})",
                   theta,
                   edge,
                   phi);
    }
  }
  Values values = check.Centre();
  check.Expect(!check.Project(Eigen::Vector3d::Zero(), &values),
               "the camera frame's origin is imaged");
}

void GivesNoNan(const CameraModel& model, Examination& check) {
  std::vector<double> sizes;
  for (int power = -320; power <= 300; power += 20) sizes.push_back(std::pow(10.0, power));
  sizes.push_back(0);
  std::vector<double> J_params(kMaxObservationSize * model.params.size());
  double J_point[kMaxObservationSize * 3];
  for (const double lateral : sizes) {
    for (const double sign : {-1.0, 1.0}) {
      for (const double axial : sizes) {
        Values values = check.Centre();
        const Eigen::Vector3d p_cam(lateral, -0.3 * lateral, sign * axial);
        check.Expect(!check.Project(p_cam, &values) || check.AllFinite(values),
                     "the image of {} is not finite",
                     Text(p_cam));
        const Values centre = check.Centre();
        Values predicted{};
        check.Expect(!model.ProjectWithJacobian(check.Params(),
                                                check.Config(),
                                                centre.data(),
                                                p_cam,
                                                {predicted.data(), J_params.data(), J_point}) ||
                         check.AllFinite(predicted),
                     "with derivatives, the image of {} is not finite",
                     Text(p_cam));
      }
      const std::optional<Ray> ray = check.Unproject(check.At(sign * lateral, lateral));
      check.Expect(!ray || (ray->direction.allFinite() && ray->origin.allFinite()),
                   "the ray of pixel ({:.6g}, {:.6g}) is not finite",
                   sign * lateral,
                   lateral);
    }
  }
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const Eigen::Vector3d& p_cam : {Eigen::Vector3d(nan, 0, 1), Eigen::Vector3d(0, 0, nan)}) {
    Values values = check.Centre();
    check.Expect(!check.Project(p_cam, &values), "point {} is imaged", Text(p_cam));
  }
}

void HasDerivativesOverTheImage(const CameraModel& model, Examination& check) {
  for (const Values& seen : check.Grid(6)) {
    const std::optional<Ray> ray = check.RayOf(seen);
    if (!ray) continue;
    for (const double depth : kDepths) {
      const Eigen::Vector3d p_cam = ray->origin + depth * ray->direction;
      check.CheckJacobian(p_cam, seen, kDerivative);
      if (model.optional_context.empty()) continue;
      check.CheckJacobian(p_cam, check.WithOptionalContext(seen), kDerivative);
    }
  }
}

void HasDerivativesOnTheAxis(const CameraModel& /*model*/, Examination& check) {
  const Values centre = check.Centre();
  for (const double depth : kDepths) {
    check.CheckJacobian({0, 0, depth}, centre, kDerivative);
    for (const double offset : {1e-300, 1e-160, 1e-15, 1e-9, 1e-5, 1e-3}) {
      check.CheckJacobian({offset * depth, 0, depth}, centre, kDerivative);
      check.CheckJacobian({0, -offset * depth, depth}, centre, kDerivative);
      check.CheckJacobian({-offset * depth, offset * depth, depth}, centre, kDerivative);
    }
  }
}

void HasDerivativesAtTheEdge(const CameraModel& /*model*/, Examination& check) {
  for (const double phi : Azimuths()) {
    const double theta = check.EdgeOfDomain(phi) - 4 * kEdgeMargin;
    for (const double depth : kDepths) {
      check.CheckJacobian(depth * Direction(theta, phi), check.Centre(), kDerivativeAtEdge);
    }
  }
}

void IsCentral(const CameraModel& model, Examination& check) {
  for (const Values& seen : check.Grid(10)) {
    const std::optional<Ray> ray = check.RayOf(seen);
    if (!ray) continue;
    check.Expect(ray->origin == Eigen::Vector3d::Zero(),
                 "the ray of pixel ({:.6g}, {:.6g}) starts at {}",
                 seen[0],
                 seen[1],
                 Text(ray->origin));
    for (const double depth : kDepths) {
      const Eigen::Vector3d p_cam = depth * ray->direction;
      std::vector<double> J_params(kMaxObservationSize * model.params.size());
      double predicted[kMaxObservationSize], J_point[kMaxObservationSize * 3];
      if (!check.Expect(model.ProjectWithJacobian(check.Params(),
                                                  check.Config(),
                                                  seen.data(),
                                                  p_cam,
                                                  {predicted, J_params.data(), J_point}),
                        "point {} is not imaged",
                        Text(p_cam))) {
        continue;
      }
      for (size_t r = 0; r < model.measured.size(); ++r) {
        const Eigen::Map<const Eigen::Vector3d> row(J_point + 3 * r);
        check.Expect(std::abs(row.dot(p_cam)) <= kEuler * row.norm() * p_cam.norm(),
                     "{} changes along the ray of pixel ({:.6g}, {:.6g})",
                     model.measured[r],
                     seen[0],
                     seen[1]);
      }
    }
  }
}

// (h origin + direction, h) is a point of the ray: at 1 / h, for h = 0 at infinity, and beyond.
void GoesOnThroughInfinity(const CameraModel& model, Examination& check) {
  if (!model.homogeneous) return;
  for (const Values& seen : check.Grid(6)) {
    const std::optional<Ray> ray = check.RayOf(seen);
    if (!ray) continue;
    for (const double h : {1.0, 0.1, 1e-6, 0.0, -1e-6, -0.1}) {
      const Eigen::Vector3d p = h * ray->origin + ray->direction;
      Values values = seen;
      if (!check.Expect(check.Project(p, &values, h),
                        "the point (p, h) = ({}, {}) on the ray of pixel ({:.6g}, {:.6g}) is not "
                        "imaged",
                        Text(p),
                        h,
                        seen[0],
                        seen[1])) {
        continue;
      }
      for (size_t i = 0; i < model.measured.size(); ++i) {
        check.Expect(std::abs(values[i] - seen[i]) <= kRoundTrip * model.example_size[0],
                     "pixel ({:.6g}, {:.6g}), h = {} on its ray: {} off by {:.3g}",
                     seen[0],
                     seen[1],
                     h,
                     model.measured[i],
                     values[i] - seen[i]);
      }
      check.CheckJacobian(p, seen, kDerivative, h);
    }
  }
}

// A block of all pixels' points gives what they give one by one.
void AgreesInBlocks(const CameraModel& model, Examination& check) {
  std::vector<double> points, values;
  for (const Values& seen : check.Grid(20)) {
    const Eigen::Vector3d p = check.Unproject(seen).value_or(Ray{}).direction;
    points.insert(points.end(), p.begin(), p.end());
    values.insert(values.end(), seen.begin(), seen.end());
  }
  const size_t count = points.size() / 3, rows = model.measured.size();
  const auto project = [&](size_t begin, size_t end) {
    std::vector<double> out((end - begin) * rows * (4 + model.params.size()));
    double* const J_params = out.data() + (end - begin) * rows;
    ProjectPoints(
        model,
        check.Params(),
        check.Config(),
        {end - begin, points.data() + 3 * begin, values.data() + kMaxObservationSize * begin},
        {.predicted = out.data(),
         .J_params = J_params,
         .J_point = J_params + (end - begin) * rows * model.params.size()});
    return out;
  };
  const std::vector<double> all = project(0, count);
  for (size_t i = 0; i < count; ++i) {
    const std::vector<double> one = project(i, i + 1);
    size_t place = 0, first = 0;  // in `one`, and of a kind of numbers in `all`
    for (const size_t width : {rows, rows * model.params.size(), rows * 3}) {
      for (size_t k = 0; k < width; ++k, ++place) {
        const double in_block = all[first + i * width + k];
        // Libraries may round vectors otherwise; differences magnify that.
        check.Expect(std::abs(in_block - one[place]) <= 1e-7 * (1 + std::abs(one[place])) ||
                         (std::isnan(in_block) && std::isnan(one[place])),
                     "point {} in a block gives {:.17g} for {:.17g}",
                     i,
                     in_block,
                     one[place]);
      }
      first += count * width;
    }
  }
}

template <auto property>
std::vector<std::string> ViolationsOf(const CameraModel& model) {
  Examination check(model);
  property(model, check);
  return std::move(check).Violations();
}

}  // namespace

std::span<const ModelProperty> ModelProperties() {
  static constexpr std::array<ModelProperty, 11> kProperties{{
      {"IsDescribed",
       "names, units, limits and source are there, the example lies within the limits",
       false,
       &ViolationsOf<IsDescribed>},
      {"FindsPixelsAgain",
       "the whole example image is seen, and points on a pixel's ray are imaged in that pixel",
       false,
       &ViolationsOf<FindsPixelsAgain>},
      {"FindsDirectionsAgain",
       "the image of a direction leads back to it, up to the edge of the domain",
       true,
       &ViolationsOf<FindsDirectionsAgain>},
      {"HasOneDomain",
       "all directions up to one edge are imaged and none beyond it",
       false,
       &ViolationsOf<HasOneDomain>},
      {"GivesNoNan",
       "huge, tiny and NaN points and pixels give no NaN",
       false,
       &ViolationsOf<GivesNoNan>},
      {"HasDerivativesOverTheImage",
       "derivatives agree with differences over the image",
       false,
       &ViolationsOf<HasDerivativesOverTheImage>},
      {"HasDerivativesOnTheAxis",
       "derivatives agree with differences on the optical axis and near it",
       false,
       &ViolationsOf<HasDerivativesOnTheAxis>},
      {"HasDerivativesAtTheEdge",
       "derivatives agree with differences at the edge of the domain",
       true,
       &ViolationsOf<HasDerivativesAtTheEdge>},
      {"GoesOnThroughInfinity",
       "points of a ray up to infinity and beyond are imaged in its pixel, with their derivatives",
       false,
       &ViolationsOf<GoesOnThroughInfinity>},
      {"AgreesInBlocks",
       "many points give what they give one by one",
       false,
       &ViolationsOf<AgreesInBlocks>},
      {"IsCentral", "points of one ray are imaged in one pixel", true, &ViolationsOf<IsCentral>},
  }};
  return kProperties;
}

std::string CheckModel(const CameraModel& model, size_t* violated) {
  constexpr size_t kShown = 3;  // violations of a property; the rest is of the same kind
  std::string text;
  *violated = 0;
  for (const ModelProperty& property : ModelProperties()) {
    if (property.central_only && !model.IsCentral()) {
      text += fmt::format("not asked  {} (of central models only)\n", property.claim);
      continue;
    }
    const std::vector<std::string> violations = property.violations(model);
    text += fmt::format("{}  {}\n", violations.empty() ? "holds    " : "VIOLATED ", property.claim);
    for (size_t i = 0; i < std::min(violations.size(), kShown); ++i) {
      text += fmt::format("             {}\n", violations[i]);
    }
    if (violations.size() > kShown) {
      text += fmt::format("             and {} more\n", violations.size() - kShown);
    }
    *violated += violations.empty() ? 0 : 1;
  }
  return text;
}

}  // namespace plenocal
