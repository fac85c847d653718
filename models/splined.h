// SPDX-License-Identifier: Apache-2.0
//
// A spline over the image: what the lens does beyond a stereographic projection is a smooth field
// that each part of the image has for itself.
//
// Source: mrcal, splined stereographic lens models (mrcal.secretsauce.net/splined-models.html),
// LENSMODEL_SPLINED_STEREOGRAPHIC of order 3. With d = |p_C| and B the uniform cubic B-spline:
//
//   u = 2 (x_C, y_C) / (d + z_C)                                     (radius 2 tan(theta / 2))
//   s = (N_x - 3) / (4 tan(fov / 4))                                 (knots a unit of u)
//   i = s u_x + (N_x - 1) / 2, j = s u_y + (N_y - 1) / 2             (place among the knots)
//   m = u + sum over knots (a, b) of B(i - a) B(j - b) (x_a_b, y_a_b)
//   (x_Id, y_Id) = (f_x m_x + c_x, f_y m_y + c_y)                    (pixels)
//
// A point depends on the 16 knots around it. Between the outermost knots and the next, mrcal's
// polynomial of the last full cell holds. Defined over the rectangle of the knots, as far as the
// map does not fold.
//
// Spline and f_x, f_y, c_x, c_y can do the same, so these and fov are chosen before the adjustment
// and fixed. A rotation of the camera is a quadratic field in u, which the spline contains: one
// knot in the middle and half of one to its right are fixed: they define the rotation of the
// camera's frame.
#pragma once

#include <Eigen/Dense>
#include <numbers>

#include "calib/base/invert_map.h"
#include "calib/base/linear_algebra.h"
#include "models/kannala_brandt4.h"
#include "models/start/central_model.h"

namespace plenocal {

/// The knots of `Splined` and their places among its parameters.
struct SplinedGrid {
  // 8 x 6 cells over an image of 4 : 3, each somewhat larger than the distance of a target's
  // points: more knots than points would follow the noise.
  static constexpr int kColumns = 11, kRows = 9, kKnots = kColumns * kRows;
  static constexpr int kFov = 4, kFirstKnot = 5;

  /// Of knot (a, b)'s x; y follows.
  static constexpr size_t KnotPlace(int a, int b) {
    const int x = kFirstKnot + 2 * (b * kColumns + a);
    return static_cast<size_t>(x);
  }
};

struct Splined : LensModel<Splined>, SplinedGrid {
  static constexpr std::string_view kName = "splined";
  static constexpr std::string_view kSource =
      "mrcal, splined stereographic lens model of order 3, 11 x 9 knots";

 private:
  // "x_07_04": column, row.
  static constexpr auto kNames = [] {
    std::array<std::array<char, 7>, static_cast<size_t>(2 * kKnots)> names{};
    for (int k = 0; k < 2 * kKnots; ++k) {
      const int a = k / 2 % kColumns, b = k / 2 / kColumns;
      const auto digit = [](int value) { return static_cast<char>('0' + value); };
      names[static_cast<size_t>(k)] = {k % 2 == 0 ? 'x' : 'y',
                                       '_',
                                       digit(a / 10),
                                       digit(a % 10),
                                       '_',
                                       digit(b / 10),
                                       digit(b % 10)};
    }
    return names;
  }();
  // In focal lengths: no lens is farther from stereographic where its image is.
  static constexpr double kPriorSigma = 0.3;

 public:
  static constexpr auto kParams = [] {
    std::array<Param, kFirstKnot + 2 * kKnots> params{
        Param{.name = "f_x", .unit = "px", .lower = 0, .fixed = Fixed::kAlways},
        Param{.name = "f_y", .unit = "px", .lower = 0, .fixed = Fixed::kAlways},
        Param{.name = "c_x", .unit = "px", .fixed = Fixed::kAlways},
        Param{.name = "c_y", .unit = "px", .fixed = Fixed::kAlways},
        Param{.name = "fov", .unit = "deg", .lower = 0, .upper = 360, .fixed = Fixed::kAlways}};
    for (size_t k = 0; k < kNames.size(); ++k) {
      params[kFirstKnot + k] = {.name = std::string_view(kNames[k].data(), kNames[k].size()),
                                .unit = "1",
                                .scale = 1,
                                .neutral = 0,
                                .prior_sigma = kPriorSigma};
    }
    constexpr int kMiddle = kColumns / 2, kRight = kMiddle + kColumns / 4;
    params[KnotPlace(kMiddle, kRows / 2)].fixed = Fixed::kAgainstPoses;
    params[KnotPlace(kMiddle, kRows / 2) + 1].fixed = Fixed::kAgainstPoses;
    params[KnotPlace(kRight, kRows / 2) + 1].fixed = Fixed::kAgainstPoses;
    return params;
  }();

  // A fisheye between equidistant and stereographic, with a part of it pressed in.
  static constexpr auto kExample = [] {
    std::array<double, kParams.size()> example{210, 212, 322, 243, 160};
    for (int b = 0; b < kRows; ++b) {
      for (int a = 0; a < kColumns; ++a) {
        const double i = a - (kColumns - 1) / 2.0, j = b - (kRows - 1) / 2.0;
        const double stretch = -0.0012 * (i * i + j * j), pressed = a < 4 && b < 3 ? 0.01 : 0;
        example[KnotPlace(a, b)] = stretch * i + pressed;
        example[KnotPlace(a, b) + 1] = stretch * j - pressed / 2;
      }
    }
    return example;
  }();

  /// The parameters on which the image of a point depends.
  static std::array<size_t, kFirstKnot + 32> Support(const double* params,
                                                     const Eigen::Vector3d& p_cam) {
    std::array<size_t, kFirstKnot + 32> support{};
    for (size_t k = 0; k < kFirstKnot; ++k) support[k] = k;
    const Vector3<double> p = p_cam / p_cam.cwiseAbs().maxCoeff();
    double u[2] = {}, place[2];
    Stereographic(p, u);
    Place(params[kFov], u, place);
    const int a = Cell(place[0], kColumns), b = Cell(place[1], kRows);
    auto next = support.begin() + kFirstKnot;
    for (int knot = 0; knot < 16; ++knot) {
      const size_t x = KnotPlace(a + knot % 4, b + knot / 4);
      *next++ = x;
      *next++ = x + 1;
    }
    return support;
  }

  template <typename T>
  static bool Map(const T* k, const Vector3<T>& p, T* m) {
    T u[2];
    Eigen::Matrix2d slope;
    return Stereographic(p, u) && Distort(k, u, m, &slope);
  }

  static std::optional<Eigen::Vector3d> Unmap(const double* k, const Eigen::Vector2d& m) {
    const double s = KnotsPerUnit(k[0]);
    const Eigen::Vector2d edge((kColumns - 1) / 2.0 / s, (kRows - 1) / 2.0 / s);
    if (!m.allFinite()) return std::nullopt;
    // The map is near the identity: m itself first, then places all over the rectangle.
    if (auto direction = SolveFrom(k, m, m.cwiseMax(-edge).cwiseMin(edge))) {
      return direction;
    }
    constexpr int kStarts = 9;
    for (int row = 0; row < kStarts; ++row) {
      for (int column = 0; column < kStarts; ++column) {
        const Eigen::Vector2d part(2.0 * column / (kStarts - 1) - 1, 2.0 * row / (kStarts - 1) - 1);
        if (auto direction = SolveFrom(k, m, edge.cwiseProduct(part))) return direction;
      }
    }
    return std::nullopt;
  }

  /// Start values of `kannala-brandt4`, each with the spline through its rays.
  static std::vector<StartCandidate> Start(const StartProblem& problem) {
    const CameraModel fisheye = MakeCameraModel<KannalaBrandt4>();
    const std::vector<std::optional<double>> given(fisheye.params.size());
    StartProblem of_fisheye = problem;
    of_fisheye.given = given;
    std::vector<StartCandidate> candidates;
    for (const StartCandidate& candidate : KannalaBrandt4::Start(of_fisheye)) {
      candidates.push_back({LikeFisheye(candidate.params.data(), problem)});
    }
    return candidates;
  }

 private:
  /// u of a point whose largest coordinate is 1; false straight behind.
  template <typename T>
  static bool Stereographic(const Vector3<T>& p, T* u) {
    using std::sqrt;
    const T r2 = p.x() * p.x() + p.y() * p.y();
    const T d = sqrt(r2 + p.z() * p.z());
    // 1 / (d + z), behind the camera without cancellation.
    if (!(p.z() > 0.0 || r2 > 0.0)) return false;
    const T scale = p.z() > 0.0 ? T(2.0 / (d + p.z())) : T(2.0 * (d - p.z()) / r2);
    u[0] = p.x() * scale;
    u[1] = p.y() * scale;
    return true;
  }
  static Eigen::Vector3d FromStereographic(const Eigen::Vector2d& u) {
    return {u.x(), u.y(), 1 - u.squaredNorm() / 4};
  }

  template <typename T>
  static T KnotsPerUnit(const T& fov_deg) {
    using std::tan;
    return (kColumns - 3.0) / (4.0 * tan(fov_deg * (std::numbers::pi / 720)));
  }
  template <typename T>
  static void Place(const T& fov_deg, const T* u, T* place) {
    const T s = KnotsPerUnit(fov_deg);
    place[0] = s * u[0] + (kColumns - 1) / 2.0;
    place[1] = s * u[1] + (kRows - 1) / 2.0;
  }

  // m and its slope by u; false outside the rectangle of the knots and where the map folds.
  template <typename T>
  static bool Distort(const T* k, const T* u, T* m, Eigen::Matrix2d* slope) {
    T place[2];
    Place(k[0], u, place);
    const double i = ValueOf(place[0]), j = ValueOf(place[1]);
    if (!(i >= 0 && i <= kColumns - 1 && j >= 0 && j <= kRows - 1)) return false;
    const int a = Cell(i, kColumns), b = Cell(j, kRows);
    const std::array<T, 4> along = Weights(T(place[0] - (a + 1.0)));
    const std::array<T, 4> down = Weights(T(place[1] - (b + 1.0)));
    const std::array<double, 4> d_along = Slopes(i - (a + 1)), d_down = Slopes(j - (b + 1));
    m[0] = u[0];
    m[1] = u[1];
    Eigen::Matrix2d by_place = Eigen::Matrix2d::Zero();
    for (size_t row = 0; row < 4; ++row) {
      T sum[2] = {T(0.0), T(0.0)};
      for (size_t column = 0; column < 4; ++column) {
        const T* const knot =
            k + KnotPlace(a + static_cast<int>(column), b + static_cast<int>(row)) - kFov;
        const Eigen::Vector2d value(ValueOf(knot[0]), ValueOf(knot[1]));
        by_place.col(0) += d_along[column] * ValueOf(down[row]) * value;
        by_place.col(1) += ValueOf(along[column]) * d_down[row] * value;
        sum[0] += along[column] * knot[0];
        sum[1] += along[column] * knot[1];
      }
      m[0] += down[row] * sum[0];
      m[1] += down[row] * sum[1];
    }
    *slope = Eigen::Matrix2d::Identity() + KnotsPerUnit(ValueOf(k[0])) * by_place;
    // A map of a convex region whose slope has a positive definite symmetric part has an inverse.
    const Eigen::Matrix2d symmetric = *slope + slope->transpose();
    return symmetric(0, 0) > 0 && symmetric.determinant() > 0;
  }

  // The first of the four knots of a row that a place depends on.
  static int Cell(double place, int knots) {
    return place > 1 ? static_cast<int>(std::min<double>(place, knots - 3)) - 1 : 0;
  }
  // Of the four knots, at t cells from the second.
  template <typename T>
  static std::array<T, 4> Weights(const T& t) {
    const T t2 = t * t, t3 = t2 * t;
    return {T((1.0 - 3.0 * t + 3.0 * t2 - t3) / 6.0),
            T((4.0 - 6.0 * t2 + 3.0 * t3) / 6.0),
            T((1.0 + 3.0 * t + 3.0 * t2 - 3.0 * t3) / 6.0),
            T(t3 / 6.0)};
  }
  static std::array<double, 4> Slopes(double t) {
    return {-(1 - t) * (1 - t) / 2, (3 * t - 4) * t / 2, (1 + 2 * t - 3 * t * t) / 2, t * t / 2};
  }

  static std::optional<Eigen::Vector3d> SolveFrom(const double* k,
                                                  const Eigen::Vector2d& m,
                                                  const Eigen::Vector2d& start) {
    constexpr double kLastStep = 1e-9;  // its square, the error after it, is rounding
    const auto map =
        [&](const Eigen::Vector2d& at, Eigen::Vector2d* image, Eigen::Matrix2d* slope) {
          return Distort(k, at.data(), image->data(), slope);
        };
    const std::optional<Eigen::Vector2d> u = InvertMap(map, m, start, kLastStep);
    if (!u) return std::nullopt;
    return FromStereographic(*u);
  }

  // Image points with their stereographic coordinates u.
  struct SeenPoints {
    std::vector<Eigen::Vector2d> pixels, u;
  };

  static std::optional<Eigen::Vector2d> SeenBy(const double* fisheye,
                                               const Eigen::Vector2d& pixel) {
    const auto ray = KannalaBrandt4::Unproject(fisheye, pixel);
    Eigen::Vector2d u;
    if (!ray || !Stereographic(*ray, u.data())) return std::nullopt;
    return u;
  }

  static SeenPoints PointsSeenBy(const double* fisheye, const StartProblem& problem) {
    SeenPoints points;
    for (const View& view : problem.views) {
      for (const Observation& seen : view.observations) {
        const Eigen::Vector2d pixel(seen.values[0], seen.values[1]);
        if (const auto u = SeenBy(fisheye, pixel)) {
          points.pixels.push_back(pixel);
          points.u.push_back(*u);
        }
      }
    }
    return points;
  }

  // The spline through a fisheye's rays of the points that the views show.
  static std::vector<double> LikeFisheye(const double* fisheye, const StartProblem& problem) {
    const SeenPoints points = PointsSeenBy(fisheye, problem);
    std::vector<double> params(kParams.size(), 0.0);
    SetNearestStereographic(points, fisheye, problem, &params);
    constexpr double kMostFov = 350;
    const double edge = BorderEdge(fisheye, problem.image_size, params);
    const double fov = std::ceil(4 * std::atan(edge / 2) * 180 / std::numbers::pi);
    params[kFov] = problem.given[kFov].value_or(std::clamp(fov, 1.0, kMostFov));
    const Eigen::MatrixXd spline = FitKnots(points, params);
    size_t k = kFirstKnot;
    for (int knot = 0; knot < kKnots; ++knot) {
      for (int axis = 0; axis < 2; ++axis, ++k) {
        params[k] = problem.given[k].value_or(spline(knot, axis));
      }
    }
    return params;
  }

  // f and c of the nearest stereographic lens.
  static void SetNearestStereographic(const SeenPoints& points,
                                      const double* fisheye,
                                      const StartProblem& problem,
                                      std::vector<double>* params) {
    const auto n = static_cast<double>(points.pixels.size());
    for (Eigen::Index r = 0; r < 2; ++r) {
      double su = 0, sq = 0, suu = 0, suq = 0;
      for (size_t i = 0; i < points.pixels.size(); ++i) {
        const double u = points.u[i][r], q = points.pixels[i][r];
        su += u;
        sq += q;
        suu += u * u;
        suq += u * q;
      }
      const double f = (n * suq - su * sq) / (n * suu - su * su);
      const auto k = static_cast<size_t>(r);
      const bool found = f > 0 && std::isfinite(f);
      double& f_k = (*params)[k];
      f_k = problem.given[k].value_or(found ? f : fisheye[k]);
      (*params)[2 + k] =
          problem.given[2 + k].value_or(found ? (sq - f_k * su) / n : fisheye[2 + k]);
    }
  }

  static Eigen::Vector2d Normalised(const std::vector<double>& params,
                                    const Eigen::Vector2d& pixel) {
    return {(pixel.x() - params[2]) / params[0], (pixel.y() - params[3]) / params[1]};
  }

  // Largest |u_x| that the knots must reach, over the image's border; where the fisheye is
  // extrapolated it may err.
  static double BorderEdge(const double* fisheye,
                           const ImageSize& image_size,
                           const std::vector<double>& params) {
    constexpr int kBorder = 16;
    constexpr double kMostStretch = 1.5;
    double edge = 0;
    for (int i = 0; i <= kBorder; ++i) {
      const double w = image_size[0] - 1.0, h = image_size[1] - 1.0;
      const double part = static_cast<double>(i) / kBorder;
      for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(part * w, 0),
                                           Eigen::Vector2d(part * w, h),
                                           Eigen::Vector2d(0, part * h),
                                           Eigen::Vector2d(w, part * h)}) {
        const Eigen::Vector2d m = Normalised(params, pixel);
        Eigen::Vector2d u = SeenBy(fisheye, pixel).value_or(m);
        u *= std::min(1.0, kMostStretch * m.norm() / std::max(u.norm(), 1e-9));
        edge = std::max({edge, std::abs(u.x()), std::abs(u.y()) * (kColumns - 3) / (kRows - 3)});
      }
    }
    return edge;
  }

  // Linear least squares of the knots; a little of the prior where there are no points.
  static Eigen::MatrixXd FitKnots(const SeenPoints& points, const std::vector<double>& params) {
    constexpr double kLittle = 1e-4;
    Eigen::MatrixXd H = kLittle * Eigen::MatrixXd::Identity(kKnots, kKnots);
    Eigen::MatrixXd g = Eigen::MatrixXd::Zero(kKnots, 2);
    for (size_t i = 0; i < points.pixels.size(); ++i) {
      double place[2];
      Place(params[kFov], points.u[i].data(), place);
      if (!(std::abs(place[0]) < kColumns && std::abs(place[1]) < kRows)) continue;
      const int a = Cell(place[0], kColumns), b = Cell(place[1], kRows);
      const std::array<double, 4> along = Weights(place[0] - (a + 1)),
                                  down = Weights(place[1] - (b + 1));
      Eigen::Matrix<double, 16, 1> weights;
      std::array<Eigen::Index, 16> knots;
      for (size_t knot = 0; knot < 16; ++knot) {
        weights[static_cast<Eigen::Index>(knot)] = along[knot % 4] * down[knot / 4];
        knots[knot] = (b + static_cast<int>(knot / 4)) * kColumns + a + static_cast<int>(knot % 4);
      }
      H(knots, knots) += weights * weights.transpose();
      g(knots, Eigen::all) +=
          weights * (Normalised(params, points.pixels[i]) - points.u[i]).transpose();
    }
    return SolveSymmetric(H, g);
  }
};

}  // namespace plenocal
