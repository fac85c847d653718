// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/micro_image.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>

#include "calib/base/cubic_spline.h"
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

/// The pixels within `radius` of a place along one axis of the image.
struct PixelRange {
  int first, last;

  PixelRange(double centre, double radius, int count)
      : first(std::max(0, static_cast<int>(std::ceil(centre - radius)))),
        last(std::min(count - 1, static_cast<int>(std::floor(centre + radius)))) {}
};

/// Calls visit(x, y, d) for the pixels with |d| <= radius, d = pixel - centre.
template <typename Visit>
void ForPixels(const cv::Mat& white, const Vector2d& centre, double radius, const Visit& visit) {
  const PixelRange columns(centre.x(), radius, white.cols), rows(centre.y(), radius, white.rows);
  for (int y = rows.first; y <= rows.last; ++y) {
    for (int x = columns.first; x <= columns.last; ++x) {
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
    value = CubicBSplines(s - cell);
    for (int k = 0; k < 4; ++k) index[k] = std::abs(cell - 1 + k);
  }
};

/// A pixel less the modelled light of all micro images.
float Residual(const ModelledImage& scene, int x, int y) {
  return scene.white.at<float>(y, x) - scene.light.at<float>(y, x);
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

/// A micro image's model, for eight pixels at a time.
class LaneModel {
 public:
  LaneModel(const RadialProfile& profile, const MicroImage& image)
      : gain_(static_cast<float>(image.gain)),
        scale_(static_cast<float>(image.scale)),
        gradient_(image.gradient.cast<float>()),
        map_(image.map.cast<float>()),
        last_(static_cast<float>(profile.Cells().size() - 1)),
        radius_(static_cast<float>(profile.Radius()) * scale_) {
    cells_.reserve(profile.Cells().size());
    for (const Eigen::Vector4d& cell : profile.Cells()) cells_.push_back(cell.cast<float>());
  }

  struct Values {
    Lanes r, value, slope, brightness;  // slope per px at scale 1
  };
  /// At the offsets (x, y), px, from the centre.
  PLENOCAL_LANES Values At(const Lanes& x, const Lanes& y) const {
    constexpr auto kStep = static_cast<float>(kKnotStep);
    Values out;
    const Lanes xx = x * x, xy = x * y, yy = y * y;
    const Lanes u =
        map_(0, 0) * x + map_(0, 1) * y + map_(0, 2) * xx + map_(0, 3) * xy + map_(0, 4) * yy;
    const Lanes v =
        map_(1, 0) * x + map_(1, 1) * y + map_(1, 2) * xx + map_(1, 3) * xy + map_(1, 4) * yy;
    out.r = u * u + v * v;
    Sqrt(&out.r);
    const Lanes at = out.r / (scale_ * kStep), bounded = at < last_ ? at : Lanes{} + last_;
    const IntLanes index = __builtin_convertvector(bounded, IntLanes);
    const Lanes t = at - __builtin_convertvector(index, Lanes);
    Lanes c0, c1, c2, c3;
    for (int l = 0; l < kLanes; ++l) {
      const float* cell = cells_[index[l]].data();
      c0[l] = cell[0];
      c1[l] = cell[1];
      c2[l] = cell[2];
      c3[l] = cell[3];
    }
    const Lanes inside = out.r <= radius_ ? Lanes{} + 1 : Lanes{};
    out.value = inside * (c0 + t * (c1 + t * (c2 + t * c3)));
    out.slope = inside * (c1 + t * (2 * c2 + t * (3 * c3))) / kStep;
    out.brightness = gain_ + gradient_.x() * x + gradient_.y() * y;
    return out;
  }

  [[nodiscard]] float Scale() const { return scale_; }
  [[nodiscard]] const Eigen::Vector2f& Gradient() const { return gradient_; }

 private:
  float gain_, scale_;
  Eigen::Vector2f gradient_;
  Eigen::Matrix<float, 2, 5> map_;
  float last_, radius_;
  std::vector<Eigen::Vector4f> cells_;  // see RadialProfile::Cells
};

/// Rows of the Jacobian and the errors of `pixels`, row after row.
PLENOCAL_FOR_EACH_PROCESSOR
void FillRows(const LaneModel& model,
              const Vector2d& moved,
              std::span<const OwnPixels> pixels,
              Lanes* rows) {
  const Eigen::Vector2f from = moved.cast<float>(), gradient = model.Gradient();
  const float scale = model.Scale();
  const auto count = static_cast<std::ptrdiff_t>(pixels.size());
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    const OwnPixels& pixel = pixels[i];
    const Lanes x = pixel.x - from.x(), y = pixel.y - from.y();
    const LaneModel::Values m = model.At(x, y);
    const Lanes value = pixel.used * m.value;
    const Lanes by_size = pixel.used * m.slope * m.brightness / scale;
    const Lanes by_r = m.r > 0 ? by_size / m.r : Lanes{};
    Lanes* row = rows + i;
    row[0 * count] = -by_r * x - value * gradient.x();
    row[1 * count] = -by_r * y - value * gradient.y();
    row[2 * count] = value;
    row[3 * count] = value * x;
    row[4 * count] = value * y;
    row[5 * count] = -by_size * m.r / scale;
    row[6 * count] = pixel.used * (pixel.light - value * m.brightness);
  }
}

/// Adds the model's light to that of the pixels.
PLENOCAL_FOR_EACH_PROCESSOR
void AddOwnLight(const LaneModel& model, std::span<OwnPixels> pixels) {
  for (OwnPixels& pixel : pixels) {
    const LaneModel::Values m = model.At(pixel.x, pixel.y);
    pixel.light += m.value * m.brightness;
  }
}

/// Adds the light of a micro image, whose centre is at `y` below the row and at `x` right of its
/// first pixel, to the `count` pixels of a row.
PLENOCAL_FOR_EACH_PROCESSOR
void AddLightToRow(const LaneModel& model, float x, float y, int count, float* row) {
  const Lanes steps = {0, 1, 2, 3, 4, 5, 6, 7};
  for (int i = 0; i < count; i += kLanes) {
    const LaneModel::Values m = model.At(steps + (static_cast<float>(i) - x), Lanes{} - y);
    const Lanes light = m.value * m.brightness;
    for (int l = 0; l < std::min(kLanes, count - i); ++l) row[i + l] += light[l];
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
    FillRows(LaneModel(profile, fit), moved, pixels, first);
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

double RadialProfile::Normalise() {
  double highest = 0;
  for (double r = 0; r <= radius_; r += kSampleStep) highest = std::max(highest, At(r).value);
  if (highest > 0) {
    for (Eigen::Vector4d& cell : cells_) cell /= highest;
  }
  return highest;
}

void AddLight(const RadialProfile& profile, const MicroImage& image, cv::Mat* light) {
  const LaneModel model(profile, image);
  const Vector2d& centre = image.centre;
  const PixelRange columns(centre.x(), profile.Radius() * image.scale, light->cols);
  const PixelRange rows(centre.y(), profile.Radius() * image.scale, light->rows);
  for (int y = rows.first; y <= rows.last; ++y) {
    AddLightToRow(model,
                  static_cast<float>(centre.x() - columns.first),
                  static_cast<float>(centre.y() - y),
                  columns.last - columns.first + 1,
                  light->ptr<float>(y) + columns.first);
  }
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
  for (int i = 0; i < count; ++i) {
    const Term& a = terms[i];
    const double weighted = weight * a.value;
    right_[a.index] += weighted * pixel;
    // A half of the matrix; `Solve` adds the other.
    for (int j = 0; j < i; ++j) normal_(terms[j].index, a.index) += weighted * terms[j].value;
    normal_(a.index, a.index) += weighted * a.value / 2;
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
  Eigen::MatrixXd normal = normal_ + normal_.transpose();
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
  // There is no micro image farther off or of another size. Where the brightness changes by half
  // over the radius, the first place is an eighth of it beside the centre.
  const double most_move = std::max(1.0, radius / 8);  // px
  constexpr double kMostDoublings = 1;                 // of the size
  using Vector = Eigen::Matrix<double, kParams, 1>;
  using Matrix = Eigen::Matrix<double, kParams, kParams>;
  MicroImage fit = start;
  std::vector<OwnPixels> seen;
  int pixels = 0;
  ForPixels(scene.white, start.centre, radius, [&](int x, int y, const Vector2d& d) {
    const int lane = pixels++ % kLanes;
    if (lane == 0) seen.emplace_back();
    OwnPixels& to = seen.back();
    to.light[lane] = Residual(scene, x, y);
    to.x[lane] = static_cast<float>(d.x());
    to.y[lane] = static_cast<float>(d.y());
    to.used[lane] = 1;
  });
  if (pixels <= kParams) return start;
  AddOwnLight(LaneModel(profile, start), seen);
  for (int step = 0; step < kSteps; ++step) {
    const Equations equations(profile, fit, fit.centre - start.centre, seen);
    const Vector change = SolveSymmetric(equations.normal, equations.right);
    if (!change.allFinite()) return start;
    fit.centre += change.head<2>();
    fit.gain += change[2];
    fit.gradient += change.segment<2>(3);
    fit.scale += change[5];
    // The logarithm of a negative size is not a number.
    if ((fit.centre - start.centre).norm() > most_move ||
        !(std::abs(std::log2(fit.scale)) <= kMostDoublings)) {
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
    sums[ring] += Residual(scene, x, y) / image.gain;
    counts[ring] += 1;
  });
  return sums.cwiseQuotient(counts.cwiseMax(1));
}

}  // namespace plenocal::internal
