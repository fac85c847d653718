// SPDX-License-Identifier: Apache-2.0
//
// Common part of focused plenoptic cameras: thin main lens, micro lenses as pinholes.
//
// Source: Zeller et al., synchronized stereo and plenoptic VO dataset, "Plenoptic Camera Model". A
// point x_C = (x_C, y_C, z_C) is observed through one micro lens, whose micro-image centre c_Id was
// detected in the distorted raw image. With all image coordinates in metres about the principal
// point, image axes turned by 180 degrees:
//
//   c_I  = undistorted c_Id                                      (section's distortion, below)
//   c_ML = c_I b_P / (b_P + B)                                   (centre of the micro lens)
//   p_ML = c_ML f_L / (b_L0 - f_L), z_C0 = f_L b_L0 / (f_L - b_L0)      (eq. projected_micro_lens)
//   x_p  = (x_C - p_ML) / (z_C + z_C0)
//   x_ML = x_p f_L B / (f_L - b_L0) - c_ML B / (f_L - b_L0)      (eq. projected_micro_lens_4_new)
//   x_R  = x_ML + c_ML
//
// The micro images' centres are the exit pupil's images, b_P in front of the micro lenses. In the
// paper the thin lens is its own pupil, b_P = b_L0.
//
// The last three lines have no value for f_L = b_L0, where the virtual cameras are infinitely far.
// Inserted into each other they do, and this is what is computed: with 1/v = B (z_C - f_L) / d,
// d = f_L z_C - b_L0 (z_C - f_L), the inverse of the paper's virtual depth,
//
//   x_R = x_C f_L B / d + c_ML (1 - 1/v).
//
// A point p / h, (x, y, z) = p, has h z_C = z: 1/v = B (z - f_L h) / d, d = f_L z - b_L0 (z - f_L
// h), x_R = (x, y) f_L B / d + c_ML (1 - 1/v), which goes on through infinity, h = 0.
//
// Distortion of raw coordinates and of micro-image centres alike, r^2 = x^2 + y^2:
//
//   x_d = x + x (A_0 r^2 + A_1 r^4) + B_0 (r^2 + 2 x^2) + 2 B_1 x y
//   y_d = y + y (A_0 r^2 + A_1 r^4) + B_1 (r^2 + 2 y^2) + 2 B_0 x y
//   x_Rd' = x_d / pixel_size + c_x, likewise y                   (pixels)
//
// The array may be tilted against the sensor about its middle by small angles: then the micro lens
// at c_ML is delta = t . c_ML farther from the sensor and nearer to the main lens. With the sensor
// at D = b_P + B from the pupil, k = t . c_I / D, it is delta = b_P k / (1 + k), and all equations
// hold with b_P - delta, b_L0 - delta, B + delta in place of b_P, b_L0, B.
//
// A thick main lens bends rays by third-order aberrations too, which of a rotationally symmetric
// lens are polynomials in c = c_I and the place d = x_thin - c in the micro image, x_thin the x_R
// above; with the distortion, their part at d = 0, they are complete:
//
//   x_R = x_thin + T_1 |d|^2 d + T_2 (2 (c . d) d + |d|^2 c) + T_3 (c . d) c + T_4 |c|^2 d
//
// (spherical aberration, coma, astigmatism, curvature of field). Their exit pupil may be at
// infinity: w_P = 1/b_P in place of b_P, b_P / (b_P + B) = 1 / (1 + B w_P).
//
// A marker may have been measured by a template that was scaled for the virtual depth v_t (that of
// docs/plenoptic.md, by micro-image centres), which is not quite right: then it is displaced by
// (1 - v_t / v) (x_depth, y_depth), the change of the measured position with ln v_t.
//
// Defined for z_C > f_L (a real image exists), for virtual image points not between the micro
// lenses and the sensor (1/v < 1), and where distortion and aberrations do not fold the image over.
#pragma once

#include <Eigen/LU>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "calib/base/invert_map.h"
#include "calib/camera/camera_model.h"
#include "models/start/plenoptic_points.h"

namespace plenocal {

/// Parameters f_L, b_L0, B, c_x, c_y, A_0, A_1, B_0, B_1 and what a model adds; `kPupil` is the
/// place of b_P among them, `kTilt` that of the first of two angles t of the array, or -1,
/// `kThick` that of T_1 to T_4, or -1; then w_P stands in the place of b_P.
template <int kPupil, int kTilt = -1, int kThick = -1>
struct PlenopticModel {
  // The scales of the distortion are of an image 10 mm wide that it would make another.
  static constexpr std::array kSharedParams{
      Param{"f_L", "m", 0},
      Param{"b_L0", "m", 0},
      Param{"B", "m", 0},
      Param{"c_x", "px"},
      Param{"c_y", "px"},
      Param{.name = "A_0", .unit = "m^-2", .scale = 1e4, .neutral = 0},
      Param{.name = "A_1", .unit = "m^-4", .scale = 1e8, .neutral = 0},
      Param{.name = "B_0", .unit = "m^-1", .scale = 1e2, .neutral = 0},
      Param{.name = "B_1", .unit = "m^-1", .scale = 1e2, .neutral = 0}};
  // No sensor has finer or coarser pixels: a unit was mistaken.
  static constexpr std::array kConfig{Param{"pixel_size", "m", 1e-7, 1e-3}};
  static constexpr std::array<std::string_view, 2> kMeasured{"x", "y"};
  static constexpr std::array<std::string_view, 2> kContext{"lens_x", "lens_y"};
  static constexpr std::array<std::string_view, 3> kOptionalContext{"depth", "x_depth", "y_depth"};
  static constexpr Centre kCentre = Centre::kNone;
  static constexpr bool kPlenoptic = true;
  static constexpr std::array kExampleConfig{7.4e-6};
  static constexpr ImageSize kExampleSize{800, 780};

  static std::string Remedy(std::span<const size_t> weak, const DepthRange& seen) {
    return PlenopticRemedy(
        weak, kPupil, kTilt < 0 ? std::nullopt : std::optional<size_t>(kTilt), seen);
  }
  static void ReplicateFit(std::span<const Observation* const> of_marker,
                           std::span<const double> weights,
                           ReplicateResidual* residuals) {
    FitMicroImages(of_marker, weights, residuals);
  }
  static Eigen::MatrixXd ReplicateTerms(const double* params,
                                        std::span<const Observation* const> of_marker) {
    return ThirdOrderOfMicroImages({params[3], params[4]}, of_marker);
  }
  static void AssignLensTypes(std::vector<View>* views) { FindLensTypes(views); }

  /// u_px = distorted raw coordinates; `lens_px` = (lens_x, lens_y, depth, x_depth, y_depth).
  static bool Project(const double* params,
                      const double* config,
                      const double* lens_px,
                      const Eigen::Vector3d& p,
                      double h,
                      double* u_px) {
    const auto image = ImageOf(params, config, lens_px, p, h);
    if (!image) return false;
    Write(*image, params, config, lens_px, u_px);
    return true;
  }

  /// The derivatives are written out: those of dual numbers take three times as long.
  static bool ProjectWithJacobian(const double* params,
                                  const double* config,
                                  const double* values,
                                  const Eigen::Vector3d& p,
                                  double h,
                                  const ProjectionOutput& out) {
    using Rows = Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor>;
    const double* lens_px = values + kMeasured.size();
    const auto image = ImageOf(params, config, lens_px, p, h);
    if (!image) return false;
    Write(*image, params, config, lens_px, out.predicted);

    const Eigen::Matrix2d by_x_R = DistortionJacobian(params, image->x_R) / config[0];
    Eigen::Matrix2d by_x_thin = by_x_R;
    if constexpr (kThick >= 0)
      by_x_thin = by_x_R * Aberrations(params, image->c_I, image->x_thin).Slope();
    const Eigen::Vector2d by_s = by_x_thin * p.head<2>();
    const Eigen::Vector2d by_m =
        by_x_thin * image->c_I - lens_px[2] * Eigen::Vector2d(lens_px[3], lens_px[4]);
    const ScaleDerivatives by = image->Derivatives(params[0], p.z(), h);
    const auto chain = [&](const Scales& change) -> Eigen::Vector2d {
      return by_s * change.s + by_m * change.m;
    };
    Eigen::Map<Eigen::Matrix<double, 2, 3, Eigen::RowMajor>> J_point(out.J_point);
    J_point << by_x_thin * image->scales.s, chain(by.z_C);
    if (out.J_h != nullptr) Eigen::Map<Eigen::Vector2d>(out.J_h) = chain(by.h);
    if (out.J_params == nullptr) return true;

    Eigen::Map<Rows> J(out.J_params, 2, kCount);
    J.setZero();
    J.col(0) = chain(by.f_L);
    J.col(1) = chain(by.b_L0);
    J.col(2) = chain(by.B);
    J.col(kPupil) += chain(by.b_P);
    Eigen::Matrix2d by_c_I = by_x_thin * image->scales.m;
    if constexpr (kThick >= 0) {
      if (params[kPupil] == kByOthers) {
        J.col(1) -= chain(by.b_P) / (params[1] * params[1]);
        J.col(kPupil).setZero();
      }
      const Aberrations at(params, image->c_I, image->x_thin);
      by_c_I += by_x_R * at.ByCentre() - by_x_thin + by_x_R;
      J.template middleCols<4>(kThick) = by_x_R * at.Terms();
    }
    if constexpr (kTilt >= 0) {
      // b_P - delta, b_L0 - delta, B + delta with delta = b_P k / (1 + k), k = t . c_I / D
      const Eigen::Vector2d by_delta = chain(by.B) - chain(by.b_L0) - chain(by.b_P);
      const double b_P = params[kPupil], D = b_P + params[2];
      const Eigen::Vector2d t(params[kTilt], params[kTilt + 1]);
      const double k = t.dot(image->c_I) / D, by_k = b_P / ((1 + k) * (1 + k));
      J.col(kPupil) += by_delta * (k / (1 + k) - by_k * k / D);
      J.col(2) -= by_delta * (by_k * k / D);
      J.template middleCols<2>(kTilt) = by_delta * image->c_I.transpose() * (by_k / D);
      by_c_I += by_delta * t.transpose() * (by_k / D);
    }
    // Through c_I, where the distortion's inverse is.
    const Eigen::Matrix2d by_c_Id = by_c_I * DistortionJacobian(params, image->c_I).inverse();
    J.template middleCols<2>(3) = Eigen::Matrix2d::Identity() - config[0] * by_c_Id;
    J.template middleCols<4>(5) =
        DistortionTerms(image->x_R) / config[0] - by_c_Id * DistortionTerms(image->c_I);
    return true;
  }

  /// The ray that reaches the raw image at values[0..1] through the micro lens at values[2..3]. It
  /// starts in the main lens' front focal plane.
  static std::optional<Ray> Unproject(const double* params,
                                      const double* config,
                                      const double* values) {
    const double f_L = params[0];
    const Eigen::Vector2d c(params[3], params[4]);
    const auto x_R = Undistort(params, (Eigen::Vector2d(values[0], values[1]) - c) * config[0]);
    const auto c_I = Undistort(params, (Eigen::Vector2d(values[2], values[3]) - c) * config[0]);
    if (!x_R || !c_I) return std::nullopt;
    const auto [b_P, b_L0, B] = DistancesAt(params, *c_I);
    const Eigen::Vector2d c_ML = *c_I * PupilScale(b_P, B);
    std::optional<Eigen::Vector2d> x_thin = x_R;
    if constexpr (kThick >= 0) x_thin = Aberrations::Without(params, *c_I, *x_R);
    if (!x_thin) return std::nullopt;
    const Eigen::Vector2d x_ML = *x_thin - c_ML;
    // The images of the ray's points behind the main lens lie on x_ML / B. Its point at infinity is
    // the image of `origin`, its point on the micro lens that of origin - direction / ..., both by
    // the thin lens; their difference has no singularity at f_L = b_L0.
    Ray ray;
    ray.origin << x_ML * (f_L / B), f_L;
    ray.direction << c_ML * B - x_ML * (b_L0 - f_L), f_L * B;
    ray.direction.normalize();
    return ray;
  }

 protected:
  /// w_P of a pupil in the thin main lens.
  static double InverseOfMainLens(const double* params) { return 1 / params[1]; }

 private:
  static constexpr double kLastStep =
      1e-7;  // relative; its square, the error after it, is rounding
  static constexpr int kCount =
      9 + (kPupil < 9 ? 0 : 1) + (kTilt < 0 ? 0 : 2) + (kThick < 0 ? 0 : 4);

  /// Distances pupil - micro lens (of a thick lens its inverse), main lens - micro lens, micro lens
  /// - sensor.
  struct Distances {
    double b_P, b_L0, B;
  };
  static Distances DistancesAt(const double* params, const Eigen::Vector2d& c_I) {
    const double b_L0 = params[1], B = params[2];
    const bool in_main_lens = kThick >= 0 && params[kPupil] == kByOthers;
    const double b_P = in_main_lens ? InverseOfMainLens(params) : params[kPupil];
    if constexpr (kTilt < 0) {
      return {b_P, b_L0, B};
    } else {
      const double k = (params[kTilt] * c_I.x() + params[kTilt + 1] * c_I.y()) / (b_P + B);
      const double delta = b_P * k / (1 + k);
      return {b_P - delta, b_L0 - delta, B + delta};
    }
  }

  /// c_ML / c_I
  static double PupilScale(double b_P, double B) {
    return kThick >= 0 ? 1 / (1 + B * b_P) : b_P / (b_P + B);
  }

  /// The third order at a place x_thin behind a micro lens.
  struct Aberrations {
    Eigen::Map<const Eigen::Vector4d> T;
    Eigen::Vector2d c, d;

    Aberrations(const double* params, const Eigen::Vector2d& c_I, const Eigen::Vector2d& x_thin)
        : T(params + kThick), c(c_I), d(x_thin - c_I) {}

    [[nodiscard]] Eigen::Vector2d Displacement() const { return Terms() * T; }
    /// Derivatives of the displacement by T_1 to T_4.
    [[nodiscard]] Eigen::Matrix<double, 2, 4> Terms() const { return ThirdOrderTerms(c, d); }
    /// Of x_R by x_thin.
    [[nodiscard]] Eigen::Matrix2d Slope() const {
      const Eigen::Matrix2d across = d * c.transpose();
      const double even = T[0] * d.squaredNorm() + 2 * T[1] * c.dot(d) + T[3] * c.squaredNorm();
      return (1 + even) * Eigen::Matrix2d::Identity() + 2 * T[0] * d * d.transpose() +
             2 * T[1] * (across + across.transpose()) + T[2] * c * c.transpose();
    }
    /// Of the displacement by c, d fixed.
    [[nodiscard]] Eigen::Matrix2d ByCentre() const {
      return (T[1] * d.squaredNorm() + T[2] * c.dot(d)) * Eigen::Matrix2d::Identity() +
             2 * T[1] * d * d.transpose() + T[2] * c * d.transpose() + 2 * T[3] * d * c.transpose();
    }
    /// Whether the slope, symmetric, is positive from d = 0 on. Its terms' eigenvalues are at most
    /// 3, 6, 1 and 1 of |d|^2, |c| |d|, |c|^2 and |c|^2.
    [[nodiscard]] bool Unfolded() const {
      const double c2 = c.squaredNorm(), d2 = d.squaredNorm();
      return 1 + 3 * std::min(T[0], 0.0) * d2 - 6 * std::abs(T[1]) * std::sqrt(c2 * d2) +
                 (std::min(T[2], 0.0) + std::min(T[3], 0.0)) * c2 >
             0;
    }
    /// x_thin of x_R.
    static std::optional<Eigen::Vector2d> Without(const double* params,
                                                  const Eigen::Vector2d& c_I,
                                                  const Eigen::Vector2d& x_R) {
      const auto map = [&](const Eigen::Vector2d& p, Eigen::Vector2d* x, Eigen::Matrix2d* slope) {
        const Aberrations at(params, c_I, p);
        *x = p + at.Displacement();
        *slope = at.Slope();
        return at.Unfolded();
      };
      return InvertMap(map, x_R, x_R, kLastStep * (x_R - c_I).norm());
    }
  };

  /// The two numbers in x_R = s x_C + m c_I.
  struct Scales {
    double s, m;
  };
  struct ScaleDerivatives {
    Scales f_L, b_L0, B, b_P, z_C, h;
  };
  /// A point behind a micro lens, undistorted.
  struct Image {
    Scales scales;
    Eigen::Vector2d c_I, x_thin, x_R;
    Distances lens;  ///< there
    double d, inverse_v, pupil;

    [[nodiscard]] ScaleDerivatives Derivatives(double f_L, double z_C, double h) const {
      const auto& [b_P, b_L0, B] = lens;
      const double w = inverse_v, beyond = z_C - f_L * h, sum = b_P + B;
      // With d's own derivative: s = f_L B / d, w = B (z_C - f_L h) / d.
      const auto by = [&](double d_d, double ds, double dw) -> Scales {
        return {(ds - scales.s * d_d) / d, -pupil * (dw - w * d_d) / d};
      };
      ScaleDerivatives result{.f_L = by(z_C + b_L0 * h, B, -B * h),
                              .b_L0 = by(-beyond, 0, 0),
                              .B = by(0, f_L, beyond),
                              .b_P = {0, (1 - w) * B / (sum * sum)},
                              .z_C = by(f_L - b_L0, 0, B),
                              .h = by(f_L * b_L0, 0, -f_L * B)};
      if constexpr (kThick >= 0) {
        result.b_P.m = -(1 - w) * B * pupil * pupil;
        result.B.m -= (1 - w) * b_P * pupil * pupil;
      } else {
        result.B.m -= (1 - w) * b_P / (sum * sum);
      }
      return result;
    }
  };

  static std::optional<Image> ImageOf(const double* params,
                                      const double* config,
                                      const double* lens_px,
                                      const Eigen::Vector3d& p,
                                      double h) {
    const double f_L = params[0], z_C = p.z(), beyond = z_C - f_L * h;
    Image image;
    const Eigen::Vector2d c_Id(lens_px[0] - params[3], lens_px[1] - params[4]);
    const std::optional<Eigen::Vector2d> c_I = Undistort(params, c_Id * config[0]);
    if (!c_I) return std::nullopt;
    image.c_I = *c_I;
    image.lens = DistancesAt(params, image.c_I);
    const auto& [b_P, b_L0, B] = image.lens;
    if (!(beyond > 0 && z_C > 0)) return std::nullopt;
    image.d = f_L * z_C - b_L0 * beyond;
    // Beyond infinity up to the pole only.
    if (image.d == 0 || (h < 0 && (image.d > 0) != (f_L > b_L0))) return std::nullopt;
    image.inverse_v = B * beyond / image.d;
    if (!(image.inverse_v < 1)) return std::nullopt;
    image.pupil = PupilScale(b_P, B);
    image.scales.s = f_L * B / image.d;
    image.scales.m = image.pupil * (1 - image.inverse_v);
    image.x_thin = image.scales.s * p.head<2>() + image.scales.m * image.c_I;
    image.x_R = image.x_thin;
    if constexpr (kThick >= 0) {
      const Aberrations at(params, image.c_I, image.x_thin);
      if (!at.Unfolded()) return std::nullopt;
      image.x_R += at.Displacement();
    }
    if (!Unfolded(params, image.x_R)) return std::nullopt;
    return image;
  }

  static void Write(const Image& image,
                    const double* params,
                    const double* config,
                    const double* lens_px,
                    double* u_px) {
    const Eigen::Vector2d x_Rd = Distort(params, image.x_R);
    // 1 - v_t / v, for the virtual depth v by centres
    const double v_t = lens_px[2], depth_error = v_t == 0 ? 0 : 1 - v_t * (1 - image.scales.m);
    u_px[0] = x_Rd.x() / config[0] + params[3] - depth_error * lens_px[3];
    u_px[1] = x_Rd.y() / config[0] + params[4] - depth_error * lens_px[4];
  }

  static Eigen::Vector2d Distort(const double* params, const Eigen::Vector2d& p) {
    const double A_0 = params[5], A_1 = params[6], B_0 = params[7], B_1 = params[8];
    const double x = p.x(), y = p.y(), r2 = p.squaredNorm(), xy = 2 * x * y;
    const double radial = 1 + r2 * (A_0 + r2 * A_1);
    return {x * radial + B_0 * (r2 + 2 * x * x) + B_1 * xy,
            y * radial + B_1 * (r2 + 2 * y * y) + B_0 * xy};
  }

  /// Derivatives of `Distort` by A_0, A_1, B_0, B_1.
  static Eigen::Matrix<double, 2, 4> DistortionTerms(const Eigen::Vector2d& p) {
    const double x = p.x(), y = p.y(), r2 = p.squaredNorm(), xy = 2 * x * y;
    Eigen::Matrix<double, 2, 4> terms;
    terms << x * r2, x * r2 * r2, r2 + 2 * x * x, xy,  //
        y * r2, y * r2 * r2, xy, r2 + 2 * y * y;
    return terms;
  }

  static Eigen::Matrix2d DistortionJacobian(const double* params, const Eigen::Vector2d& p) {
    const double A_0 = params[5], A_1 = params[6], B_0 = params[7], B_1 = params[8];
    const double x = p.x(), y = p.y(), r2 = p.squaredNorm();
    const double radial = 1 + r2 * (A_0 + r2 * A_1), slope = 2 * (A_0 + 2 * A_1 * r2);
    const double across = x * y * slope + 2 * (B_0 * y + B_1 * x);
    Eigen::Matrix2d J;
    J << radial + x * x * slope + 6 * B_0 * x + 2 * B_1 * y, across,  //
        across, radial + y * y * slope + 6 * B_1 * y + 2 * B_0 * x;
    return J;
  }

  /// Whether the distortion preserves neighbourhoods at p and, its radial part, all the way there.
  static bool Unfolded(const double* params, const Eigen::Vector2d& p) {
    const double A_0 = params[5], A_1 = params[6], r2 = p.squaredNorm();
    // The slope 1 + 3 A_0 r^2 + 5 A_1 r^4 has its minimum within.
    const bool minimum_within = A_0 < 0 && -3 * A_0 < 10 * A_1 * r2;
    if (minimum_within && !(9 * A_0 * A_0 < 20 * A_1)) return false;
    return 1 + r2 * (3 * A_0 + 5 * A_1 * r2) > 0 && DistortionJacobian(params, p).determinant() > 0;
  }

  static std::optional<Eigen::Vector2d> Undistort(const double* params,
                                                  const Eigen::Vector2d& distorted) {
    const auto map = [&](const Eigen::Vector2d& p, Eigen::Vector2d* image, Eigen::Matrix2d* slope) {
      *image = Distort(params, p);
      *slope = DistortionJacobian(params, p);
      return true;
    };
    const auto p = InvertMap(map, distorted, distorted, kLastStep * distorted.norm());
    return p && Unfolded(params, *p) ? p : std::nullopt;
  }
};

}  // namespace plenocal
