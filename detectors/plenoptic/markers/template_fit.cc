// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/template_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <variant>
#include <vector>

#include "calib/base/robust.h"
#include "detectors/plenoptic/markers/aperture_shape.h"

namespace plenocal::internal {
namespace {

/// A pixel must have at least this share of the light in its micro image's middle.
constexpr float kLeastAttenuation = 0.75f;

/// Unknowns of a fit.
enum { kShiftX, kShiftY, kLevel, kContrast, kBlur, kShape, kCount };
using Vector = Eigen::Matrix<double, kCount, 1>;
using Matrix = Eigen::Matrix<double, kCount, kCount>;

/// The pattern of a tag or of a corner.
struct CellPattern {
  using Drawn = CellTemplate::Drawn;

  CellTemplate drawing;
  int margin;  ///< as of `MarkerTemplate`

  static constexpr double kLeastShape = -2, kMostShape = 2;  ///< brightness beyond the tag
  static constexpr double kWindow = 1.5;  ///< cells around the marker: those that meet there

  void SetShape(double value) {
    if (margin > 0) drawing.SetBeyond(static_cast<float>(value));
  }
  [[nodiscard]] double ByShape(const Drawn& drawn, int lane) const {
    return margin > 0 ? drawn.by_beyond[lane] : 0;
  }
  /// True when the pattern is known at a point whose value spans `reach` cells. Half a cell around
  /// a tag is usable: other tags and Kalibr's black squares may lie a little beside their nominal
  /// positions. The outermost cells of tags that are next to each other are not of one brightness;
  /// half a cell before them their blur may still be ignored.
  [[nodiscard]] bool IsKnown(const Eigen::Vector2f& cells, double reach) const {
    constexpr double kUsable = 0.5, kBlurred = 1.5;  // cells: beyond the tag, before the outermost
    if (margin == 0) return true;
    const double middle = 0.5 * drawing.size();
    const double off = (cells.array() - static_cast<float>(middle)).abs().maxCoeff();
    return off < middle - margin + std::min(kUsable, margin - kBlurred - reach);
  }
  /// Half of the square around a marker, cells, within the window. The corners of a board (no
  /// margin) are one cell apart: each has the pixels nearest to it, or of small cells as many as a
  /// fit needs.
  [[nodiscard]] double HalfOfSquare(double cell_px) const {
    constexpr double kToNextCorner = 0.5, kLeast = 4;  // cells, px
    if (margin > 0) return std::numeric_limits<double>::infinity();
    return std::clamp(kLeast / cell_px, kToNextCorner, kWindow);
  }
  /// Number of markers that are measured by the same pixel, so that its noise is common to them.
  [[nodiscard]] double MarkersPerPixel(double cell_px) const {
    const double side = 2 * HalfOfSquare(cell_px);
    return margin > 0 ? 1 : side * side;
  }
  /// True when a fit is wrong without the pixel at a point.
  [[nodiscard]] static bool IsNeeded(const Eigen::Vector2f&, const FitPriors&, double) {
    return false;
  }
};

/// A disc.
struct DiscPattern {
  using Drawn = DiscTemplate::Drawn;

  DiscTemplate drawing;

  static constexpr double kLeastShape = 0.2, kMostShape = 1.9;  ///< radius over the nominal one
  static constexpr double kWindow = 2;  ///< nominal radii: half-way to the next disc

  void SetShape(double value) { drawing.SetRadius(static_cast<float>(value)); }
  [[nodiscard]] static double ByShape(const Drawn& drawn, int lane) {
    return drawn.by_radius[lane];
  }
  [[nodiscard]] static bool IsKnown(const Eigen::Vector2f& radii, double) {
    return radii.norm() < kWindow;
  }
  [[nodiscard]] static double HalfOfSquare(double) {
    return std::numeric_limits<double>::infinity();
  }
  [[nodiscard]] static double MarkersPerPixel(double) { return 1; }
  /// Beside a dark edge the position depends on the radius and on the displacement by vignetting on
  /// the other side.
  [[nodiscard]] static bool IsNeeded(const Eigen::Vector2f& radii,
                                     const FitPriors& priors,
                                     double cell_px) {
    return radii.norm() < priors.shape.mean + priors.edge / cell_px;
  }
};

CellPattern PatternOf(const CellTemplate& drawing, int margin) { return {drawing, margin}; }
DiscPattern PatternOf(const DiscTemplate& drawing, int) { return {drawing}; }

/// A pixel of a fit.
struct SeenPixel {
  float x, y;  ///< about the expected position
  float value, weight;
};

/// Derivatives of a value of a fit.
struct Derivatives {
  /// By the unknowns; by the contrast it is the template itself.
  Vector by_unknowns = Vector::Zero();
  Eigen::RowVector2d by_vignetting = Eigen::RowVector2d::Zero();  ///< by k_pixel and k
};

/// Displacement of the raw pixels of one micro image by vignetting.
class Displacements {
 public:
  Displacements(const LensPatches& patches, size_t lens)
      : patches_(patches), lens_(lens), highest_(patches.HighestAttenuation(lens)) {}

  /// Appends the displacements, px, per px^2 of k_pixel and of k, of each pixel of a value, by
  /// rows. Returns false and appends nothing where one of these pixels has lost too much light.
  bool Append(int column, int row) {
    const size_t before = values_.size();
    const int reach = patches_.filter_radius;
    for (int y = row - reach; y <= row + reach; ++y) {
      for (int x = column - reach; x <= column + reach; ++x) {
        const float V = patches_.Attenuation(lens_, x, y) / highest_;
        if (V < kLeastAttenuation) {
          values_.resize(before);
          return false;
        }
        values_.push_back(VignettingDisplacement(patches_, lens_, V, x, y));
      }
    }
    return true;
  }
  [[nodiscard]] const std::vector<Eigen::Matrix2d>& Values() const { return values_; }

 private:
  const LensPatches& patches_;
  size_t lens_;
  float highest_;
  std::vector<Eigen::Matrix2d> values_;
};

/// Normal equations of a fit at some values of its unknowns.
struct NormalEquations {
  Matrix information = Matrix::Zero();
  Vector right = Vector::Zero();
  double chi2 = 0;
  Eigen::Matrix<double, kCount, 2> vignetting = Eigen::Matrix<double, kCount, 2>::Zero();
  Vector depth = Vector::Zero();
  Eigen::Matrix<double, kCount, 2> gradient = Eigen::Matrix<double, kCount, 2>::Zero();

  void AddPrior(int unknown, const Prior& prior, double value) {
    const double precision = 1 / (prior.sigma * prior.sigma);
    information(unknown, unknown) += precision;
    right[unknown] += precision * (prior.mean - value);
  }
};

template <typename Pattern>
class Fit {
 public:
  Fit(Pattern pattern,
      const ExpectedMarker& expected,
      const LensPatches& patches,
      const FitPriors& priors)
      : pattern_(std::move(pattern)),
        expected_(expected),
        patches_(patches),
        priors_(priors),
        displacements_(patches, static_cast<size_t>(expected.lens)) {}

  std::optional<TemplateFit> Solve(const SensorNoise& noise);

 private:
  bool CollectPixels(const SensorNoise& noise);
  void AddPixel(int column, int row, const Eigen::Vector2d& about, const SensorNoise& noise);
  void Differentiate(const Vector& p);
  [[nodiscard]] NormalEquations Equations(const Vector& p);
  [[nodiscard]] TemplateFit Result(const Vector& p, const NormalEquations& last) const;
  /// Variance of a coordinate, px^2, by noise as the weights state it.
  [[nodiscard]] double Variance(const Matrix& inverse) const;
  /// Largest distance, px, between the expected and the measured position.
  [[nodiscard]] double Limit() const {
    constexpr double kLargestMove = 0.5;  // cells
    return std::max(1.0, kLargestMove * expected_.cell_px);
  }

  Pattern pattern_;
  const ExpectedMarker& expected_;
  const LensPatches& patches_;
  const FitPriors& priors_;
  std::vector<SeenPixel> pixels_;
  Displacements displacements_;
  std::vector<Derivatives> derivatives_;
  double low_ = std::numeric_limits<double>::infinity(), high_ = -low_;  ///< of the values
};

/// The pixels around the marker; false when there are too few or a needed one is missing.
template <typename Pattern>
bool Fit<Pattern>::CollectPixels(const SensorNoise& noise) {
  constexpr double kBlurReach = 2;        // px: detail that blurs into the window
  constexpr size_t kFewest = 3 * kCount;  // pixels: three per unknown
  const auto lens = static_cast<size_t>(expected_.lens);
  const float* value = patches_.Value(lens);
  const double window = Pattern::kWindow * expected_.cell_px + kBlurReach;
  const Eigen::Vector2f at_marker = expected_.cells_by_raw.col(2).hnormalized();
  const double half = pattern_.HalfOfSquare(expected_.cell_px);
  for (int row = 0; row < patches_.size; ++row) {
    for (int column = 0; column < patches_.size; ++column) {
      const Eigen::Vector2d about(patches_.origin[lens].x() + column - expected_.position.x(),
                                  patches_.origin[lens].y() + row - expected_.position.y());
      if (about.x() * about.x() + about.y() * about.y() > window * window) continue;
      const Eigen::Vector3f there(static_cast<float>(about.x()), static_cast<float>(about.y()), 1);
      const Eigen::Vector2f cells = (expected_.cells_by_raw * there).hnormalized();
      if ((cells - at_marker).cwiseAbs().maxCoeff() > half) continue;
      if (!pattern_.IsKnown(cells, patches_.filter_radius / expected_.cell_px)) continue;
      if (std::isnan(value[row * patches_.size + column]) || !displacements_.Append(column, row)) {
        if (pattern_.IsNeeded(cells, priors_, expected_.cell_px)) return false;
        continue;
      }
      AddPixel(column, row, about, noise);
    }
  }
  derivatives_.resize(pixels_.size());
  return pixels_.size() >= kFewest;
}

template <typename Pattern>
void Fit<Pattern>::AddPixel(int column,
                            int row,
                            const Eigen::Vector2d& about,
                            const SensorNoise& noise) {
  const auto lens = static_cast<size_t>(expected_.lens);
  const float value = patches_.Value(lens)[row * patches_.size + column];
  const float attenuation = patches_.Attenuation(lens, column, row), raw = value * attenuation;
  const float variance = noise.read + noise.shot * std::max(raw, 0.f);
  pixels_.push_back({static_cast<float>(about.x()),
                     static_cast<float>(about.y()),
                     value,
                     attenuation * attenuation / variance});
  low_ = std::min(low_, static_cast<double>(value));
  high_ = std::max(high_, static_cast<double>(value));
}

/// Derivatives of each value at p. In a mosaic, whose values are means, the derivatives are the
/// same means.
template <typename Pattern>
void Fit<Pattern>::Differentiate(const Vector& p) {
  std::fill(derivatives_.begin(), derivatives_.end(), Derivatives{});
  const Eigen::Matrix3f& G = expected_.cells_by_raw;
  const std::vector<Eigen::Matrix2d>& displacements = displacements_.Values();
  const double k = p[kContrast];
  const int reach = patches_.filter_radius;
  const size_t pixels_of_value = displacements.size() / pixels_.size();
  // Micro images in focus are so sharp that a Gaussian alone displaces edges by up to 0.05 px.
  constexpr float kPixel = 1;
  size_t number = 0;  // of a value's pixel
  typename Pattern::Drawn drawn;
  for (int down = -reach; down <= reach; ++down) {
    for (int right = -reach; right <= reach; ++right) {
      const double share = patches_.FilterWeight(right, down);
      for (std::size_t i = 0; i < pixels_.size(); ++i) {
        const auto lane = static_cast<int>(i % kLanes);
        if (lane == 0) {
          Lanes x{}, y{};
          for (std::size_t l = 0; l < kLanes && i + l < pixels_.size(); ++l) {
            x[l] = pixels_[i + l].x + static_cast<float>(right - p[kShiftX]);
            y[l] = pixels_[i + l].y + static_cast<float>(down - p[kShiftY]);
          }
          pattern_.drawing.Draw(G, static_cast<float>(p[kBlur]), kPixel, x, y, &drawn);
        }
        const float by_u = drawn.by_u[lane], by_v = drawn.by_v[lane];
        const float u = drawn.u[lane], v = drawn.v[lane], scale = drawn.scale[lane];
        Vector j;
        j << -k * (by_u * (G(0, 0) - u * G(2, 0)) + by_v * (G(1, 0) - v * G(2, 0))) / scale,
            -k * (by_u * (G(0, 1) - u * G(2, 1)) + by_v * (G(1, 1) - v * G(2, 1))) / scale, 1,
            drawn.value[lane], k * drawn.by_blur[lane], k * pattern_.ByShape(drawn, lane);
        Derivatives& sum = derivatives_[i];
        sum.by_unknowns += share * j;
        // A displacement of the image is a translation of the template the other way.
        sum.by_vignetting -=
            share * j.head<2>().transpose() * displacements[i * pixels_of_value + number];
      }
      ++number;
    }
  }
}

template <typename Pattern>
NormalEquations Fit<Pattern>::Equations(const Vector& p) {
  pattern_.SetShape(p[kShape]);
  Differentiate(p);
  NormalEquations sums;
  const double k = p[kContrast];
  const auto lens = static_cast<size_t>(expected_.lens);
  const Eigen::Vector2d from_centre = expected_.position - patches_.origin[lens].cast<double>() -
                                      patches_.centre[lens].cast<double>();
  for (std::size_t i = 0; i < pixels_.size(); ++i) {
    const SeenPixel& pixel = pixels_[i];
    const Vector& j = derivatives_[i].by_unknowns;
    const double residual = pixel.value - p[kLevel] - k * j[kContrast];
    sums.information += pixel.weight * j * j.transpose();
    sums.right += pixel.weight * residual * j;
    sums.vignetting += pixel.weight * j * derivatives_[i].by_vignetting;
    // A template for a larger depth is smaller.
    const Eigen::Vector2d arm(pixel.x - p[kShiftX], pixel.y - p[kShiftY]);
    sums.depth += pixel.weight * j * j.head<2>().dot(arm);
    // So is a template whose ln v has a larger gradient, on that side.
    const Eigen::Vector2d place = from_centre + Eigen::Vector2d(pixel.x, pixel.y);
    sums.gradient += pixel.weight * j.head<2>().dot(place) * j * arm.transpose();
    sums.chi2 += pixel.weight * residual * residual;
  }
  sums.AddPrior(kBlur, priors_.blur, p[kBlur]);
  sums.AddPrior(kShape, priors_.shape, p[kShape]);
  return sums;
}

template <typename Pattern>
double Fit<Pattern>::Variance(const Matrix& inverse) const {
  const double alone = inverse.topLeftCorner<2, 2>().trace() / 2;
  if (patches_.filter_radius == 0) return alone;
  // Correlation of means of 3 x 3 pixels along an axis, by their distance.
  constexpr std::array kCorrelation{1.0, 4 / 6.0, 1 / 6.0};
  const auto by_noise = [&](size_t i) -> Eigen::Vector2d {
    return std::sqrt(pixels_[i].weight) * inverse.topRows<2>() * derivatives_[i].by_unknowns;
  };
  double together = 0;
  for (size_t i = 0; i < pixels_.size(); ++i) {
    for (size_t k = 0; k < i; ++k) {
      const auto x = std::lround(std::abs(pixels_[i].x - pixels_[k].x));
      const auto y = std::lround(std::abs(pixels_[i].y - pixels_[k].y));
      if (std::max(x, y) > 2) continue;
      together += kCorrelation[x] * kCorrelation[y] * by_noise(i).dot(by_noise(k));
    }
  }
  return alone + together;
}

template <typename Pattern>
TemplateFit Fit<Pattern>::Result(const Vector& p, const NormalEquations& last) const {
  const Matrix covariance_of_all = last.information.inverse();
  const double excess = last.chi2 / static_cast<double>(pixels_.size() - kCount);
  return {.position = expected_.position + p.head<2>(),
          .sigma = std::sqrt(Variance(covariance_of_all) * std::max(1.0, excess) *
                             pattern_.MarkersPerPixel(expected_.cell_px)),
          .blur = p[kBlur],
          .blur_sigma = std::sqrt(covariance_of_all(kBlur, kBlur) * std::max(1.0, excess)),
          .shape = p[kShape],
          .vignetting_sensitivity = covariance_of_all.topRows<2>() * last.vignetting,
          .depth_sensitivity = covariance_of_all.topRows<2>() * last.depth,
          .gradient_sensitivity = covariance_of_all.topRows<2>() * last.gradient};
}

template <typename Pattern>
std::optional<TemplateFit> Fit<Pattern>::Solve(const SensorNoise& noise) {
  constexpr int kIterations = 12;
  constexpr double kMostBlur = 4;      // px: wider than any micro image resolves
  constexpr double kConverged = 1e-3;  // px
  if (!CollectPixels(noise)) return std::nullopt;

  Vector p = Vector::Zero();
  p[kLevel] = (low_ + high_) / 2;
  p[kBlur] = priors_.blur.mean;
  p[kShape] = priors_.shape.mean;
  const double limit = Limit();
  NormalEquations equations;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    equations = Equations(p);
    const Matrix& H = equations.information;
    const Vector& g = equations.right;
    // The first step finds level and contrast, which the others need.
    Vector step = Vector::Zero();
    if (iteration == 0) {
      step.segment<2>(kLevel) = H.block<2, 2>(kLevel, kLevel).ldlt().solve(g.segment<2>(kLevel));
    } else {
      step = H.ldlt().solve(g);
    }
    if (!step.allFinite()) return std::nullopt;
    const double length = step.head<2>().norm();
    if (length > limit / 2) step *= limit / 2 / length;
    p += step;
    p[kBlur] = std::clamp(p[kBlur], kPixelSigma, kMostBlur);
    p[kShape] = std::clamp(p[kShape], Pattern::kLeastShape, Pattern::kMostShape);
    if (p.head<2>().norm() > limit) return std::nullopt;
    if (iteration > 1 && length < kConverged) break;
  }
  const TemplateFit fit = Result(p, equations);
  // Without two edges in the window one direction is undetermined; also false for NaN.
  if (!(fit.sigma < limit / 3)) return std::nullopt;
  return fit;
}

}  // namespace

Prior ShapePrior(const MarkerTemplate& marker) {
  constexpr Prior kSurround{0, 1};  // grey: between black, -1, and white, 1
  constexpr Prior kRadius{1, 0.5};  // over the nominal radius
  return std::holds_alternative<CellTemplate>(marker.pattern) ? kSurround : kRadius;
}

std::optional<TemplateFit> FitTemplate(const MarkerTemplate& marker,
                                       const ExpectedMarker& expected,
                                       const LensPatches& patches,
                                       const SensorNoise& noise,
                                       const FitPriors& priors) {
  return std::visit(
      [&](const auto& pattern) {
        return Fit(PatternOf(pattern, marker.margin), expected, patches, priors).Solve(noise);
      },
      marker.pattern);
}

}  // namespace plenocal::internal
