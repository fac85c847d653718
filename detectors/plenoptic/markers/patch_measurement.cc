// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/patch_measurement.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>

#include "calib/base/parallel.h"
#include "calib/base/statistics.h"
#include "detectors/plenoptic/markers/aperture_shape.h"

namespace plenocal {
namespace {

using internal::LensPatches;

// Largest distance of a point from its micro-image centre, pitches, as for markers.
constexpr double kPatchReach = 0.35;
// Half the side of the patch, px of the focused image: that of the optical flow's window.
constexpr double kHalfSide = 10;
// Pixels darker than this part of their micro image's brightest are not used, as for markers.
constexpr float kLeastLight = 0.75F;
// Unknowns of a fit: translation, gain, offset; fewer than this many times as many pixels make no
// template.
constexpr int kFitUnknowns = 4, kPixelsPerUnknown = 6;
// A different point: farther than this from the place expected, raw px.
constexpr double kMostShift = 1.5;
// Least correlation of patch and template.
constexpr double kLeastCorrelation = 0.8;
constexpr size_t kFewestLenses = 2;
// Parallax of a patch with depth in it, px.
constexpr double kMostRelief = 0.5;

// A value of an 8-bit image with its gradient, bilinear; nothing beside the image.
struct Sample {
  double value, by_x, by_y;
};

std::optional<Sample> SampleAt(const cv::Mat& image, double x, double y) {
  const double left = std::floor(x), top = std::floor(y);
  if (!(left >= 1 && top >= 1 && left < image.cols - 2 && top < image.rows - 2)) {
    return std::nullopt;
  }
  const int i = static_cast<int>(left), j = static_cast<int>(top);
  const double fx = x - left, fy = y - top;
  const auto at = [&](int column, int row) {
    return static_cast<double>(image.ptr<float>(row)[column]);
  };
  // Central differences, interpolated as the values are: smooth where bilinear ones have steps.
  const auto blend = [&](const auto& of) {
    return (1 - fy) * ((1 - fx) * of(i, j) + fx * of(i + 1, j)) +
           fy * ((1 - fx) * of(i, j + 1) + fx * of(i + 1, j + 1));
  };
  return Sample{blend(at),
                blend([&](int c, int r) { return (at(c + 1, r) - at(c - 1, r)) / 2; }),
                blend([&](int c, int r) { return (at(c, r + 1) - at(c, r - 1)) / 2; })};
}

struct LensMeasurement {
  size_t lens = 0;
  Eigen::Vector2d position{0, 0};  // raw px
  double sigma = 0;                // of a coordinate, px
  double inverse_depth = 0;        // of the template
  Eigen::Matrix2d vignetting_sensitivity = Eigen::Matrix2d::Zero();
  Eigen::Vector2d depth_sensitivity{0, 0};
};

// One point in one raw image.
class PointMeasurement {
 public:
  PointMeasurement(const ScenePatch& point,
                   const cv::Mat& reference,
                   const Reconstruction& view,
                   const LensPatches& patches,
                   const MicroLensArray& array)
      : point_(point), reference_(reference), view_(view), patches_(patches), array_(array) {}

  // Empty when the point cannot be measured.
  [[nodiscard]] std::vector<LensMeasurement> Measure() const {
    const Eigen::Vector2d q = point_.position * view_.depth.scale;
    std::optional<double> z = DepthUnderPatch();
    if (!z || !(std::abs(*z) < 1)) return {};
    std::vector<LensMeasurement> found;
    constexpr int kRounds = 3;
    for (int round = 0; round < kRounds; ++round) {
      found = MeasureInLenses(q, *z);
      z = KeepConsistent(&found);
      if (!z) return {};
    }
    return found;
  }

 private:
  // 1 / v at the point; nothing where it is not known or the patch has depth in it.
  [[nodiscard]] std::optional<double> DepthUnderPatch() const {
    const cv::Mat& inverse = view_.depth.inverse;
    const cv::Rect patch(static_cast<int>(std::lround(point_.position.x() - kHalfSide)),
                         static_cast<int>(std::lround(point_.position.y() - kHalfSide)),
                         static_cast<int>(2 * kHalfSide) + 1,
                         static_cast<int>(2 * kHalfSide) + 1);
    const cv::Rect inside = patch & cv::Rect(0, 0, inverse.cols, inverse.rows);
    std::vector<double> values;
    for (int y = inside.y; y < inside.br().y; ++y) {
      for (int x = inside.x; x < inside.br().x; ++x) {
        if (view_.depth.known.ptr<unsigned char>(y)[x] == 0) continue;
        values.push_back(inverse.ptr<float>(y)[x]);
      }
    }
    if (2 * values.size() < static_cast<size_t>(patch.area())) return std::nullopt;
    const double z = Median(values);
    // A point half a micro image from its centre moves by its distance to the centre in the virtual
    // image times the change of z.
    const double arm = kPatchReach * array_.Pitch() / std::abs(z);
    for (double& value : values) value = std::abs(value - z) * arm;
    if (!(Median(values) < kMostRelief)) return std::nullopt;
    return z;
  }

  [[nodiscard]] std::vector<LensMeasurement> MeasureInLenses(const Eigen::Vector2d& q,
                                                             double z) const {
    std::vector<LensMeasurement> found;
    const double reach = kPatchReach * array_.Pitch() / std::abs(z);
    for (size_t lens = 0; lens < array_.lenses.size(); ++lens) {
      const Eigen::Vector2d& c = array_.lenses[lens].centre;
      if (!array_.lenses[lens].usable || (q - c).norm() > reach) continue;
      if (const auto fit = FitLens(lens, c + z * (q - c), z)) found.push_back(*fit);
    }
    return found;
  }

  // Gauss-Newton in translation, gain and offset.
  [[nodiscard]] std::optional<LensMeasurement> FitLens(size_t lens,
                                                       const Eigen::Vector2d& expected,
                                                       double z) const {
    using Vector = Eigen::Matrix<double, kFitUnknowns, 1>;
    using Matrix = Eigen::Matrix<double, kFitUnknowns, kFitUnknowns>;
    const Eigen::Vector2d origin = patches_.origin[lens].cast<double>();
    const float brightest = patches_.HighestAttenuation(lens);
    const Eigen::Matrix2d to_reference = point_.by_reference.inverse() / (z * view_.depth.scale);
    Eigen::Vector2d position = expected;
    double gain = 0, offset = 0;
    constexpr int kIterations = 10;
    constexpr double kConverged = 1e-3;  // px
    Matrix H;
    Eigen::Matrix<double, kFitUnknowns, 2> vignetting;
    Vector depth;
    double chi2 = 0, sum = 0, sum2 = 0;
    int count = 0;
    for (int iteration = 0; iteration < kIterations; ++iteration) {
      H.setZero();
      vignetting.setZero();
      depth.setZero();
      Vector g = Vector::Zero();
      chi2 = sum = sum2 = 0;
      count = 0;
      for (int y = 0; y < patches_.size; ++y) {
        for (int x = 0; x < patches_.size; ++x) {
          const float value = patches_.Value(lens)[y * patches_.size + x];
          if (!std::isfinite(value)) continue;  // may lie outside of the image
          const float attenuation = patches_.Attenuation(lens, x, y);
          if (attenuation < kLeastLight * brightest) continue;
          const Eigen::Vector2d away = to_reference * (origin + Eigen::Vector2d(x, y) - position);
          if (away.cwiseAbs().maxCoeff() > kHalfSide) continue;
          const auto drawn = SampleAt(
              reference_, point_.in_reference.x() + away.x(), point_.in_reference.y() + away.y());
          if (!drawn) continue;
          const Eigen::Vector2d slope =
              to_reference.transpose() * Eigen::Vector2d(drawn->by_x, drawn->by_y);
          const Vector j(-gain * slope.x(), -gain * slope.y(), drawn->value, 1);
          const double residual = value - gain * drawn->value - offset;
          // A displacement of the image is a translation of the template the other way.
          vignetting -=
              j * (j.head<2>().transpose() *
                   internal::VignettingDisplacement(patches_, lens, attenuation / brightest, x, y));
          depth += j * j.head<2>().dot(origin + Eigen::Vector2d(x, y) - position);
          H += j * j.transpose();
          g += residual * j;
          chi2 += residual * residual;
          sum += value;
          sum2 += static_cast<double>(value) * value;
          ++count;
        }
      }
      if (count < kPixelsPerUnknown * kFitUnknowns) return std::nullopt;
      if (iteration == 0) {
        // The first step finds gain and offset, which the others need.
        const Eigen::Vector2d step = H.bottomRightCorner<2, 2>().ldlt().solve(g.tail<2>());
        gain += step[0];
        offset += step[1];
        continue;
      }
      const Vector step = H.ldlt().solve(g);
      if (!step.allFinite()) return std::nullopt;
      position += step.head<2>();
      gain += step[2];
      offset += step[3];
      if ((position - expected).norm() > kMostShift) return std::nullopt;
      if (step.head<2>().norm() < kConverged) break;
    }
    const double variance = sum2 - sum * sum / count;
    const bool alike = gain > 0 && chi2 < (1 - kLeastCorrelation * kLeastCorrelation) * variance;
    if (!alike) return std::nullopt;
    const double noise = chi2 / (count - kFitUnknowns);
    const double light = sum / count;
    const double least = view_.noise.read + view_.noise.shot * std::max(0.0, light);
    const Matrix inverse = H.inverse();
    const double sigma =
        std::sqrt(inverse.topLeftCorner<2, 2>().trace() / 2 * std::max(noise, least));
    if (!(sigma < kMostShift / 3)) return std::nullopt;
    return LensMeasurement{.lens = lens,
                           .position = position,
                           .sigma = sigma,
                           .inverse_depth = z,
                           .vignetting_sensitivity = inverse.topRows<2>() * vignetting,
                           .depth_sensitivity = inverse.topRows<2>() * depth};
  }

  // Leaves the measurements that lie on one line x = u_0 + s c; its 1 / v = 1 - s. Nothing when
  // they are too few.
  [[nodiscard]] std::optional<double> KeepConsistent(std::vector<LensMeasurement>* found) const {
    constexpr double kOutlier = 3;  // sigmas
    while (found->size() >= kFewestLenses) {
      Eigen::Vector2d mean_x(0, 0), mean_c(0, 0);
      double weights = 0;
      const auto weight = [](const LensMeasurement& m) { return 1 / (m.sigma * m.sigma); };
      for (const LensMeasurement& m : *found) {
        mean_x += weight(m) * m.position;
        mean_c += weight(m) * array_.lenses[m.lens].centre;
        weights += weight(m);
      }
      mean_x /= weights;
      mean_c /= weights;
      double xc = 0, cc = 0;
      for (const LensMeasurement& m : *found) {
        const Eigen::Vector2d c = array_.lenses[m.lens].centre - mean_c;
        xc += weight(m) * c.dot(m.position - mean_x);
        cc += weight(m) * c.squaredNorm();
      }
      const double s = xc / cc;
      std::vector<double> errors;
      for (const LensMeasurement& m : *found) {
        const Eigen::Vector2d c = array_.lenses[m.lens].centre - mean_c;
        errors.push_back((m.position - mean_x - s * c).norm() / m.sigma);
      }
      // Sigmas of single fits miss what the template itself has of errors: the scatter decides.
      const double usual = std::max(1.0, Median(errors));
      const auto worst = std::ranges::max_element(errors);
      if (*worst <= kOutlier * usual) return 1 - s;
      found->erase(found->begin() + (worst - errors.begin()));
    }
    return std::nullopt;
  }

  const ScenePatch& point_;
  const cv::Mat& reference_;
  const Reconstruction& view_;
  const LensPatches& patches_;
  const MicroLensArray& array_;
};

}  // namespace

internal::RawMeasurements MeasurePatches(const std::vector<ScenePatch>& points,
                                         const Reconstruction& view,
                                         const LensPatches& patches,
                                         const MicroLensArray& array,
                                         int threads) {
  std::map<const cv::Mat*, cv::Mat> references;  // as floats
  for (const ScenePatch& point : points) {
    cv::Mat& reference = references[point.reference];
    if (reference.empty()) point.reference->convertTo(reference, CV_32F);
  }
  std::vector<std::vector<LensMeasurement>> found(points.size());
  ParallelFor(points.size(), threads, [&](size_t i) {
    found[i] = PointMeasurement(points[i], references.at(points[i].reference), view, patches, array)
                   .Measure();
  });
  internal::RawMeasurements measurements;
  for (size_t i = 0; i < points.size(); ++i) {
    for (const LensMeasurement& m : found[i]) {
      const MicroLens& lens = array.lenses[m.lens];
      measurements.push_back(
          {.observation =
               {.marker = points[i].number,
                .values = {m.position.x(), m.position.y(), lens.centre.x(), lens.centre.y()},
                .detector_sigma = m.sigma},
           .inverse_depth = m.inverse_depth,
           .vignetting_sensitivity = m.vignetting_sensitivity,
           .depth_sensitivity = m.depth_sensitivity,
           .lens_type = lens.type});
    }
  }
  std::ranges::stable_sort(
      measurements, {}, [](const internal::MarkerMeasurement& m) { return m.observation.marker; });
  return measurements;
}

}  // namespace plenocal
