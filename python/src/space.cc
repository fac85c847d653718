// SPDX-License-Identifier: Apache-2.0
//
// Points in space from arrays of their places in images, and the standard error of projections.
#include <fmt/format.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <limits>
#include <tuple>

#include "assess/projection_map.h"
#include "calib/base/format_error.h"
#include "engine/json/calibration_json.h"
#include "engine/rigs/triangulate_points.h"
#include "python/src/record.h"
#include "python/src/run.h"

namespace plenocal::python {
namespace {

/// Camera, its values (measured coordinates, context) in rows, the number of each row's point, and
/// the noise of each row, px, or none: the calibration's.
using Seen = std::tuple<std::string, Rows, std::vector<int>, std::vector<double>>;

/// The points of `triangulate` by number: an index of the arrays.
struct SpacePoints {
  std::vector<SpacePoint> points;
  std::vector<bool> used;
  Triangulation made;  // without its points

  [[nodiscard]] const SpacePoint& At(size_t i) const {
    if (i < points.size() && used[i] && points[i].rho > 0) return points[i];
    throw InputError("point {}: {}",
                     i,
                     i >= points.size()          ? "there is none of this number"
                     : !points[i].reason.empty() ? points[i].reason
                     : points[i].rho > 0         ? "its rays miss each other"
                                                 : "it lies at infinity");
  }
};

std::vector<SeenPoints> ToSeen(const CalibrationRecord& calibration,
                               const std::vector<Seen>& cameras) {
  std::vector<SeenPoints> all;
  for (const auto& [name, rows, numbers, sigmas] : cameras) {
    const size_t columns = rows.shape(1);
    View view{.frame = "0", .observations = {}};
    for (size_t i = 0; i < numbers.size(); ++i) {
      Observation& each = view.observations.emplace_back(Observation{.marker = numbers[i]});
      std::copy_n(rows.data() + i * columns, columns, each.values.begin());
      if (!sigmas.empty()) each.detector_sigma = sigmas.at(i);
    }
    all.push_back({.camera = FindCamera(calibration, name).name,
                   .source = name,
                   .views = {view},
                   .is_noise = !sigmas.empty()});
  }
  return all;
}

SpacePoints TriangulateArrays(const Record& calibration,
                              const std::vector<Seen>& cameras,
                              size_t count,
                              double correlation,
                              bool housing,
                              bool adjust,
                              double level,
                              const Caller& caller) {
  const std::vector<SeenPoints> seen = ToSeen(calibration.record, cameras);
  TriangulateRequest request;
  request.correlation = correlation;
  request.adjust = adjust;
  request.level = level;
  if (housing) request.frame = SpaceFrame::kHousing;
  return RunEngine(caller, [&](const Run& run) {
    SpacePoint none;
    none.reason = "no camera sees it";
    SpacePoints result{std::vector(count, none),
                       std::vector<bool>(count),
                       TriangulatePoints(calibration.record, seen, request, run)};
    for (TriangulatedPoint& each : result.made.points) {
      const auto i = static_cast<size_t>(each.marker);
      result.points[i] = std::move(each.point);
      result.used[i] = each.used;
    }
    result.made.points.clear();
    return result;
  });
}

/// (N, rows, columns) of each point's `value`, NaN where there is no point.
template <typename Value>
Numbers Blocks(const SpacePoints& all, size_t rows, size_t columns, const Value& value) {
  Numbers array = NewArray({all.points.size(), rows, columns});
  double* out = array.data();
  for (const SpacePoint& point : all.points) {
    if (point.IsFound()) {
      const Eigen::MatrixXd block = value(point);
      for (Eigen::Index i = 0; i < block.rows(); ++i) {
        for (Eigen::Index j = 0; j < block.cols(); ++j) *out++ = block(i, j);
      }
    } else {
      out = std::fill_n(out, rows * columns, std::numeric_limits<double>::quiet_NaN());
    }
  }
  return array;
}

/// One number of each point.
template <typename Value>
Numbers Column(const SpacePoints& all, const Value& value) {
  return ToColumn(all.points, [&](const SpacePoint& point) {
    return point.IsFound() ? value(point) : std::numeric_limits<double>::quiet_NaN();
  });
}

Numbers Shared(const SpacePoints& all) {
  const auto found = std::ranges::find_if(all.points, &SpacePoint::IsFound);
  return Blocks(all, 3, static_cast<size_t>(found->shared.cols()), [](const SpacePoint& point) {
    return point.shared;
  });
}

nb::tuple ToTuple(const SpacePoints& all, const Measured& number) {
  const double reach = all.made.sigmas * number.Sigma();
  return nb::make_tuple(number.value,
                        number.Sigma(),
                        number.noise,
                        number.calibration,
                        number.bias,
                        number.value - reach,
                        number.value + reach,
                        number.jitter);
}

nb::tuple Plane(const SpacePoints& all, const std::vector<size_t>& indices) {
  std::vector<const SpacePoint*> points;
  for (const size_t i : indices) points.push_back(&all.At(i));
  const MeasuredPlane plane = PlaneOf(points);
  if (plane.degrees < 0) {
    throw InputError("plane: expected three points or more that do not lie on a line");
  }
  return nb::make_tuple(ToArray(std::vector(plane.normal.begin(), plane.normal.end())),
                        plane.offset,
                        plane.rms,
                        plane.chi_square,
                        plane.degrees,
                        plane.probability);
}

/// Of `values` as in `Seen`.
Numbers ProjectionSigma(const Record& calibration,
                        size_t index,
                        const Rows& values,
                        double distance) {
  Numbers sigmas = NewArray({values.shape(0)});
  double* const out = sigmas.data();
  Call([&] {
    const HousedProjection projection(calibration.record, index);
    if (!projection.IsKnown()) {
      throw InputError(
          "camera '{}' has no standard errors with the points that they come from: give a folder of "
          "'plenocal calibrate'",
          calibration.record.cameras.at(index).name);
    }
    std::vector<std::array<double, kMaxObservationSize>> all(values.shape(0));
    for (size_t i = 0; i < all.size(); ++i) {
      std::copy_n(values.data() + i * values.shape(1), values.shape(1), all[i].begin());
    }
    std::ranges::copy(projection.Sigmas(projection.RaysOf(all), distance), out);
  });
  return sigmas;
}

}  // namespace

void BindSpace(nb::module_& module) {
  nb::class_<SpacePoints>(module, "SpacePoints")
      .def("__len__", [](const SpacePoints& all) { return all.points.size(); })
      .def("positions",
           [](const SpacePoints& all) {
             return Blocks(all, 1, 3, [](const SpacePoint& point) {
               return Eigen::MatrixXd(point.position.transpose());
             });
           })
      .def("noise",
           [](const SpacePoints& all) {
             return Blocks(
                 all, 3, 3, [](const SpacePoint& point) { return Eigen::MatrixXd(point.noise); });
           })
      .def("shared", &Shared)
      .def("inverse_depth",
           [](const SpacePoints& all) {
             return Column(all, [](const SpacePoint& point) { return point.rho; });
           })
      .def("sigma_inverse_depth",
           [](const SpacePoints& all) {
             return Column(all, [](const SpacePoint& point) { return point.sigma_rho; });
           })
      .def("probability",
           [](const SpacePoints& all) {
             return Column(all, [](const SpacePoint& point) { return point.probability; });
           })
      .def("used",
           [](const SpacePoints& all) {
             return ToColumn(std::vector<std::uint8_t>(all.used.begin(), all.used.end()));
           })
      .def("rays",
           [](const SpacePoints& all) {
             const RaysTest& rays = all.made.rays;
             return nb::make_tuple(rays.chi_square, rays.degrees, rays.probability);
           })
      .def("findings",
           [](const SpacePoints& all) {
             return VerdictJson({.findings = all.made.findings}).at("findings").dump();
           })
      .def("adjusted",
           [](const SpacePoints& all) { return AdjustedJson(all.made.adjusted).dump(); })
      .def("length",
           [](const SpacePoints& all, size_t i, size_t j) {
             return ToTuple(all, LengthOf(all.At(i), all.At(j)));
           })
      .def("angle",
           [](const SpacePoints& all, size_t i, size_t j, size_t k) {
             return ToTuple(all, AngleOf(all.At(i), all.At(j), all.At(k)));
           })
      .def("plane", &Plane);
  module.def("triangulate", &TriangulateArrays);
  module.def("projection_sigma", &ProjectionSigma);
}

}  // namespace plenocal::python
