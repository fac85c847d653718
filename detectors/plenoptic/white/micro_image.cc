// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/micro_image.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>

#include "calib/base/linear_algebra.h"
#include "calib/kernels/processors.h"
#include "detectors/templates/lanes.h"
#include "detectors/templates/square_sums.h"

namespace plenocal::internal {
namespace {

using Eigen::Vector2d;

/// Distance of the spline's knots: there is no finer detail behind a sensor's pixels and blur.
constexpr double kKnotStep = 0.5;  // px
/// Distance of samples of a profile.
constexpr double kSampleStep = kKnotStep / 4;

/// Calls visit(x, y, d) for the pixels with |d| <= radius, d = pixel - centre.
template <typename Visit>
void ForPixels(const cv::Mat& white, const Vector2d& centre, double radius, const Visit& visit) {
  const int top = std::max(0, static_cast<int>(std::ceil(centre.y() - radius)));
  const int bottom = std::min(white.rows - 1, static_cast<int>(std::floor(centre.y() + radius)));
  const int left = std::max(0, static_cast<int>(std::ceil(centre.x() - radius)));
  const int right = std::min(white.cols - 1, static_cast<int>(std::floor(centre.x() + radius)));
  for (int y = top; y <= bottom; ++y) {
    for (int x = left; x <= right; ++x) {
      const Vector2d d(x - centre.x(), y - centre.y());
      if (d.squaredNorm() <= radius * radius) visit(x, y, d);
    }
  }
}

/// The four cubic B-splines that are not zero at r and their coefficients. The spline is even:
/// coefficient -1 is that of +1.
struct Basis {
  std::array<double, 4> value;
  std::array<int, 4> index;

  explicit Basis(double r) {
    const double s = r / kKnotStep;
    const int cell = static_cast<int>(s);
    const double t = s - cell, u = 1 - t;
    value = {u * u * u / 6,
             (3 * t * t * t - 6 * t * t + 4) / 6,
             (3 * u * u * u - 6 * u * u + 4) / 6,
             t * t * t / 6};
    for (int k = 0; k < 4; ++k) index[k] = std::abs(cell - 1 + k);
  }
};

double Model(const RadialProfile& profile, const MicroImage& image, const Vector2d& d) {
  return profile.At(d.norm() / image.scale).value * (image.gain + image.gradient.dot(d));
}

/// A pixel less the modelled light of all micro images but `own`.
double OwnLight(const ModelledImage& scene, int x, int y, double own) {
  return scene.white.at<float>(y, x) - scene.light.at<float>(y, x) + own;
}

/// A pixel lies within the radius, 0.7 pitches, of at most four micro images.
constexpr int kMaxParts = 4;

int CoefficientCount(double radius) { return static_cast<int>(radius / kKnotStep) + 3; }

/// Pixels of a fit, less the light of other micro images.
struct OwnPixels {
  Lanes light;
  Lanes x, y;  // px, from the initial centre
  Lanes used;  // 1, or 0 beyond the last pixel
};

constexpr int kParams = 6;  // c_x, c_y, g, h_x, h_y, s
constexpr int kRows = 9;    // the parameters, the error, and zeros for AddSquares

/// Coefficients of the profile's cubics in the cells `index`: see RadialProfile::Cells.
struct CellLanes {
  Lanes c0, c1, c2, c3;

  PLENOCAL_LANES CellLanes(const Eigen::Vector4d* cells, const IntLanes& index) {
    for (int l = 0; l < kLanes; ++l) {
      const Eigen::Vector4d& cell = cells[index[l]];
      c0[l] = static_cast<float>(cell[0]);
      c1[l] = static_cast<float>(cell[1]);
      c2[l] = static_cast<float>(cell[2]);
      c3[l] = static_cast<float>(cell[3]);
    }
  }
};

/// Rows of the Jacobian and the errors of `pixels`, row after row.
PLENOCAL_FOR_EACH_PROCESSOR
void FillRows(const RadialProfile& profile,
              const MicroImage& fit,
              const Vector2d& moved,
              std::span<const OwnPixels> pixels,
              Lanes* rows) {
  const auto gain = static_cast<float>(fit.gain), scale = static_cast<float>(fit.scale);
  const Eigen::Vector2f gradient = fit.gradient.cast<float>(), from = moved.cast<float>();
  constexpr auto kStep = static_cast<float>(kKnotStep);
  const auto last = static_cast<float>(profile.Cells().size() - 1);
  const auto radius = static_cast<float>(profile.Radius()) * scale;
  const auto count = static_cast<std::ptrdiff_t>(pixels.size());
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    const OwnPixels& pixel = pixels[i];
    const Lanes x = pixel.x - from.x(), y = pixel.y - from.y();
    Lanes r = x * x + y * y;
    Sqrt(&r);
    const Lanes at = r / (scale * kStep), bounded = at < last ? at : Lanes{} + last;
    const IntLanes index = __builtin_convertvector(bounded, IntLanes);
    const Lanes t = at - __builtin_convertvector(index, Lanes);
    const CellLanes c(profile.Cells().data(), index);
    const Lanes inside = r <= radius ? pixel.used : Lanes{};
    const Lanes value = inside * (c.c0 + t * (c.c1 + t * (c.c2 + t * c.c3)));
    const Lanes slope = inside * (c.c1 + t * (2 * c.c2 + t * (3 * c.c3))) / kStep;
    const Lanes brightness = gain + gradient.x() * x + gradient.y() * y;
    const Lanes by_size = slope * brightness / scale;
    const Lanes by_r = r > 0 ? by_size / r : Lanes{};
    Lanes* row = rows + i;
    row[0 * count] = -by_r * x - value * gradient.x();
    row[1 * count] = -by_r * y - value * gradient.y();
    row[2 * count] = value;
    row[3 * count] = value * x;
    row[4 * count] = value * y;
    row[5 * count] = -by_size * r / scale;
    row[6 * count] = pixel.used * (pixel.light - value * brightness);
  }
}

/// Normal equations of a Gauss-Newton step.
struct Equations {
  Eigen::Matrix<double, kParams, kParams> normal;
  Eigen::Matrix<double, kParams, 1> right;
  double squares = 0;  // sum of squared residuals

  Equations(const RadialProfile& profile,
            const MicroImage& fit,
            const Vector2d& moved,
            std::span<const OwnPixels> pixels) {
    struct Row {
      Lanes values;
    };
    const auto count = static_cast<int>(pixels.size());
    std::vector<Row> rows(static_cast<std::size_t>(kRows) * count);
    Lanes* const first = &rows.front().values;
    FillRows(profile, fit, moved, pixels, first);
    Eigen::Matrix<double, kRows, kRows> sums = Eigen::Matrix<double, kRows, kRows>::Zero();
    AddSquares(first, kRows, count, count, sums.data());
    normal = sums.topLeftCorner<kParams, kParams>().selfadjointView<Eigen::Lower>();
    right = sums.row(kParams).head<kParams>();
    squares = sums(kParams, kParams);
  }
};

}  // namespace

RadialProfile::RadialProfile(double radius)
    : radius_(radius), cells_(CoefficientCount(radius) - 2, Eigen::Vector4d::Zero()) {}

RadialProfile::Value RadialProfile::At(double r) const {
  if (r > radius_) return {};
  const double at = r / kKnotStep;
  const int cell = static_cast<int>(at);
  const double t = at - cell;
  const Eigen::Vector4d& c = cells_[cell];
  return {.value = c[0] + t * (c[1] + t * (c[2] + t * c[3])),
          .slope = (c[1] + t * (2 * c[2] + t * 3 * c[3])) / kKnotStep};
}

double RadialProfile::SquareRadiusOfEdge(double most) const {
  double weights = 0, sum = 0;
  for (double r = 0; r <= std::min(most, radius_); r += kSampleStep) {
    const double slope = At(r).slope, weight = slope * slope * r;  // the pixels of a ring
    weights += weight;
    sum += weight * r * r;
  }
  return weights > 0 ? sum / weights : 0;
}

double RadialProfile::Normalise() {
  double highest = 0;
  for (double r = 0; r <= radius_; r += kSampleStep) highest = std::max(highest, At(r).value);
  if (highest > 0) {
    for (Eigen::Vector4d& cell : cells_) cell /= highest;
  }
  return highest;
}

void AddLight(const RadialProfile& profile, const MicroImage& image, cv::Mat* light) {
  ForPixels(
      *light, image.centre, profile.Radius() * image.scale, [&](int x, int y, const Vector2d& d) {
        light->at<float>(y, x) += static_cast<float>(Model(profile, image, d));
      });
}

ProfileFit::ProfileFit(double radius, int types)
    : radius_(radius),
      types_(types),
      normal_(Eigen::MatrixXd::Zero(types * CoefficientCount(radius),
                                    types * CoefficientCount(radius))),
      right_(Eigen::VectorXd::Zero(types * CoefficientCount(radius))) {}

void ProfileFit::Add(double pixel, double weight, std::span<const Contribution> parts) {
  struct Term {
    int index;
    double value;
  };
  std::array<Term, 4 * kMaxParts> terms;
  int count = 0;
  for (const Contribution& part : parts) {
    if (part.r > radius_ || count == static_cast<int>(terms.size())) continue;
    const Basis basis(part.r);
    for (int k = 0; k < 4; ++k) {
      terms[count++] = {part.type * CoefficientCount(radius_) + basis.index[k],
                        basis.value[k] * part.brightness};
    }
  }
  for (const Term& a : std::span(terms).first(count)) {
    right_[a.index] += weight * a.value * pixel;
    for (const Term& b : std::span(terms).first(count)) {
      normal_(a.index, b.index) += weight * a.value * b.value;
    }
  }
}

void ProfileFit::Add(const ProfileFit& other) {
  normal_ += other.normal_;
  right_ += other.right_;
}

std::vector<RadialProfile> ProfileFit::Solve() const {
  // Few micro images on a regular raster may leave radii without a pixel, and a constant light
  // could belong to any of the overlapping tails. A little smoothness (second differences, and zero
  // at the end) decides there and is negligible elsewhere.
  constexpr double kSmoothness = 1e-6;  // of the largest information of a coefficient
  Eigen::MatrixXd normal = normal_;
  const double weight = kSmoothness * normal.diagonal().maxCoeff();
  const int count = CoefficientCount(radius_);
  for (int type = 0; type < types_; ++type) {
    auto block = normal.block(type * count, type * count, count, count);
    for (int i = 1; i + 1 < count; ++i) {
      const Eigen::Vector3d difference(1, -2, 1);
      block.block<3, 3>(i - 1, i - 1) += weight * difference * difference.transpose();
    }
    block(count - 1, count - 1) += weight;
  }
  const Eigen::VectorXd solution = SolveSymmetric(normal, right_);
  std::vector<RadialProfile> profiles(types_, RadialProfile(radius_));
  for (int type = 0; type < types_; ++type) {
    // The four B-splines of a cell as powers.
    const Eigen::Matrix4d powers =
        (Eigen::Matrix4d() << 1, 4, 1, 0, -3, 0, 3, 0, 3, -6, 3, 0, -1, 3, -3, 1).finished() / 6;
    const auto coefficients = solution.segment(type * count, count);
    for (int cell = 0; cell + 2 < count; ++cell) {
      profiles[type].cells_[cell] = powers * Eigen::Vector4d(coefficients[std::abs(cell - 1)],
                                                             coefficients[cell],
                                                             coefficients[cell + 1],
                                                             coefficients[cell + 2]);
    }
  }
  return profiles;
}

MicroImage FitMicroImage(const ModelledImage& scene,
                         const RadialProfile& profile,
                         double radius,
                         const MicroImage& start) {
  constexpr int kSteps = 2;  // the caller repeats the fit with better profiles
  // The error of the lattice is smaller: there is no micro image farther off or of another size.
  constexpr double kMostMove = 1, kMostDoublings = 1;  // px; of the size
  using Vector = Eigen::Matrix<double, kParams, 1>;
  using Matrix = Eigen::Matrix<double, kParams, kParams>;
  MicroImage fit = start;
  std::vector<OwnPixels> seen;
  int pixels = 0;
  ForPixels(scene.white, start.centre, radius, [&](int x, int y, const Vector2d& d) {
    const int lane = pixels++ % kLanes;
    if (lane == 0) seen.emplace_back();
    OwnPixels& to = seen.back();
    to.light[lane] = static_cast<float>(OwnLight(scene, x, y, Model(profile, start, d)));
    to.x[lane] = static_cast<float>(d.x());
    to.y[lane] = static_cast<float>(d.y());
    to.used[lane] = 1;
  });
  if (pixels <= kParams) return start;
  for (int step = 0; step < kSteps; ++step) {
    const Equations equations(profile, fit, fit.centre - start.centre, seen);
    const Vector change = SolveSymmetric(equations.normal, equations.right);
    if (!change.allFinite()) return start;
    fit.centre += change.head<2>();
    fit.gain += change[2];
    fit.gradient += change.segment<2>(3);
    fit.scale += change[5];
    if ((fit.centre - start.centre).norm() > kMostMove ||
        std::abs(std::log2(fit.scale)) > kMostDoublings) {
      return start;
    }
  }
  const Equations equations(profile, fit, fit.centre - start.centre, seen);
  fit.residual = std::sqrt(equations.squares / (pixels - kParams));
  const Matrix covariance = equations.normal.ldlt().solve(Matrix::Identity());
  fit.centre_sigma = std::sqrt((covariance(0, 0) + covariance(1, 1)) / 2);
  if (!std::isfinite(fit.centre_sigma)) return start;
  return fit;
}

Eigen::VectorXd RingResiduals(const ModelledImage& scene,
                              const MicroImage& image,
                              double radius,
                              int rings) {
  Eigen::VectorXd sums = Eigen::VectorXd::Zero(rings), counts = Eigen::VectorXd::Zero(rings);
  ForPixels(scene.white, image.centre, radius, [&](int x, int y, const Vector2d& d) {
    const int ring = std::min(rings - 1, static_cast<int>(rings * d.norm() / radius));
    sums[ring] += OwnLight(scene, x, y, 0) / image.gain;
    counts[ring] += 1;
  });
  return sums.cwiseQuotient(counts.cwiseMax(1));
}

}  // namespace plenocal::internal
