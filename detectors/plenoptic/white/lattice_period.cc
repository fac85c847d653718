// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/lattice_period.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <opencv2/core.hpp>
#include <vector>

#include "calib/camera/lens_lattice.h"

namespace plenocal::internal {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;

/// px, side of the part of the image that is used. A larger one does not make the period more
/// precise, and lens distortion would smear the peaks.
constexpr int kMaxPatch = 1024;
/// px; smaller micro images have no pixels that are free of their neighbours' light.
constexpr double kMinPitch = 5;
/// A peak is the maximum within this part of its distance from zero: lattice peaks are 1 apart, so
/// ripples on a peak or within a micro image do not count.
constexpr double kPeakRadius = 0.3;
/// Largest deviation of the lattice from an exact hexagon or right angle, pitches: that of tilted
/// and distorted lattices is smaller.
constexpr double kShapeTolerance = 0.15;
/// Longest side of a rectangular cell over its shortest.
constexpr double kMostElongated = 2;
/// Least height of the shortest lattice peak over the range of the autocorrelation. Neighbours of
/// different lens types are less alike than next neighbours of one type.
constexpr double kLatticeHeight = 0.5;
/// Peaks of the autocorrelation of pure noise stay below this many of its standard deviations.
constexpr double kSignificance = 8;

/// Autocorrelation of an image; zero lag at (reach, reach).
class Autocorrelation {
 public:
  explicit Autocorrelation(const cv::Mat& image)
      : reach_(std::min(image.cols, image.rows) / 2), pixels_(static_cast<double>(image.total())) {
    const cv::Scalar mean = cv::mean(image);
    const cv::Size padded(cv::getOptimalDFTSize(image.cols + reach_),
                          cv::getOptimalDFTSize(image.rows + reach_));
    cv::Mat work = cv::Mat::zeros(padded, CV_32F);
    cv::Mat inner = work(cv::Rect(0, 0, image.cols, image.rows));
    cv::subtract(image, mean, inner);
    cv::dft(work, work, 0, image.rows);
    cv::mulSpectrums(work, work, work, 0, true);
    cv::idft(work, work, cv::DFT_SCALE);
    values_.create(2 * reach_ + 1, 2 * reach_ + 1, CV_32F);
    for (int y = -reach_; y <= reach_; ++y) {
      for (int x = -reach_; x <= reach_; ++x) {
        // Fewer pairs of pixels are far apart than near.
        const double pairs =
            static_cast<double>(image.cols - std::abs(x)) * (image.rows - std::abs(y));
        values_.at<float>(y + reach_, x + reach_) = static_cast<float>(
            work.at<float>((y + padded.height) % padded.height, (x + padded.width) % padded.width) /
            pairs);
      }
    }
  }

  [[nodiscard]] int Reach() const { return reach_; }
  [[nodiscard]] double At(int x, int y) const { return values_.at<float>(y + reach_, x + reach_); }
  /// Standard deviation that white noise of the image's variance has at any lag but zero.
  [[nodiscard]] double Noise() const { return At(0, 0) / std::sqrt(pixels_); }
  [[nodiscard]] double Lowest() const {
    double lowest = 0;
    cv::minMaxLoc(values_, &lowest);
    return lowest;
  }
  [[nodiscard]] bool Covers(const Vector2d& lag, double margin) const {
    return std::max(std::abs(lag.x()), std::abs(lag.y())) + margin < reach_;
  }

  /// True when (x, y) is the maximum within `radius`.
  [[nodiscard]] bool IsPeak(int x, int y, double radius) const {
    const int r = std::max(1, static_cast<int>(radius));
    const double value = At(x, y);
    for (int dy = -r; dy <= r; ++dy) {
      for (int dx = -r; dx <= r; ++dx) {
        if (dx * dx + dy * dy <= r * r && At(x + dx, y + dy) > value) return false;
      }
    }
    return true;
  }

  /// The peak within `radius` of `lag` to a fraction of a pixel; nothing where the maximum lies on
  /// the rim.
  [[nodiscard]] std::optional<Vector2d> PeakNear(const Vector2d& lag, double radius) const {
    if (!Covers(lag, radius + 2)) return std::nullopt;
    Eigen::Vector2i best(0, 0);
    double highest = -std::numeric_limits<double>::infinity();
    const int r = static_cast<int>(std::ceil(radius));
    const Eigen::Vector2i middle = lag.array().round().matrix().cast<int>();
    for (int dy = -r; dy <= r; ++dy) {
      for (int dx = -r; dx <= r; ++dx) {
        const double value = At(middle.x() + dx, middle.y() + dy);
        if (dx * dx + dy * dy > r * r || value <= highest) continue;
        highest = value;
        best = {dx, dy};
      }
    }
    const Eigen::Vector2i at = middle + best;
    if (!IsPeak(at.x(), at.y(), 1)) return std::nullopt;
    const auto offset = [](double before, double here, double after) {
      const double curvature = before - 2 * here + after;
      return curvature < 0 ? 0.5 * (before - after) / curvature : 0.0;
    };
    const double here = At(at.x(), at.y());
    return Vector2d(at.x() + offset(At(at.x() - 1, at.y()), here, At(at.x() + 1, at.y())),
                    at.y() + offset(At(at.x(), at.y() - 1), here, At(at.x(), at.y() + 1)));
  }

 private:
  int reach_;
  double pixels_;
  cv::Mat values_;
};

/// Fits the basis to all peaks of the two inner rings; nothing when one of them is missing.
std::optional<Matrix2d> FitRings(const Autocorrelation& correlation, Matrix2d basis) {
  const bool hexagonal = KindOfLattice(basis) == LatticeKind::kHexagonal;
  // The inner ring first: it predicts the outer one well.
  for (const int rings : {1, 2}) {
    Matrix2d lags_nodes = Matrix2d::Zero(), nodes_nodes = Matrix2d::Zero();
    for (int row = 0; row <= rings; ++row) {
      for (int column = -rings; column <= rings; ++column) {
        const int distance =
            std::max({std::abs(column), row, hexagonal ? std::abs(column + row) : 0});
        if (distance == 0 || distance > rings || (row == 0 && column < 0)) continue;
        const Vector2d node(column, row);
        const Vector2d expected = basis * node;
        const double radius = kPeakRadius * basis.colwise().norm().minCoeff();
        if (rings == 2 && !correlation.Covers(expected, radius + 2)) continue;
        const auto peak = correlation.PeakNear(expected, radius);
        if (!peak) return std::nullopt;
        lags_nodes += *peak * node.transpose();
        nodes_nodes += node * node.transpose();
      }
    }
    basis = nodes_nodes.ldlt().solve(lags_nodes.transpose()).transpose();
  }
  return basis;
}

double At(const Autocorrelation& correlation, const Vector2d& lag) {
  return correlation.At(static_cast<int>(std::lround(lag.x())),
                        static_cast<int>(std::lround(lag.y())));
}

/// All peaks of the upper half plane, shortest first; the lower half plane mirrors it.
std::vector<Vector2d> FindPeaks(const Autocorrelation& correlation) {
  std::vector<Vector2d> peaks;
  const int reach = correlation.Reach();
  for (int y = 0; y < reach; ++y) {
    for (int x = -reach + 1; x < reach; ++x) {
      const Vector2d lag(x, y);
      const double radius = kPeakRadius * lag.norm();
      if (lag.norm() < kMinPitch || (y == 0 && x < 0) || !correlation.Covers(lag, radius + 1)) {
        continue;
      }
      if (!correlation.IsPeak(x, y, 1) || !correlation.IsPeak(x, y, radius)) continue;
      peaks.push_back(lag);
    }
  }
  std::sort(peaks.begin(), peaks.end(), [](const Vector2d& a, const Vector2d& b) {
    return a.squaredNorm() < b.squaredNorm();
  });
  return peaks;
}

/// The periods of the image, shortest first. The gaps between micro images repeat as well, at lower
/// peaks.
std::vector<Vector2d> FindPeriods(const Autocorrelation& correlation) {
  std::vector<Vector2d> peaks = FindPeaks(correlation);
  double highest = 0;
  for (const Vector2d& peak : peaks) highest = std::max(highest, At(correlation, peak));
  const double lowest = correlation.Lowest();
  std::erase_if(peaks, [&](const Vector2d& peak) {
    return At(correlation, peak) - lowest < kLatticeHeight * (highest - lowest);
  });
  return peaks;
}

/// Two sides of a cell by the periods: of a hexagon of peaks around zero, or of a rectangle.
std::optional<Matrix2d> FindCell(const Autocorrelation& correlation,
                                 const std::vector<Vector2d>& periods) {
  if (periods.empty()) return std::nullopt;
  const Vector2d& a = periods[0];
  const Vector2d b = Eigen::Rotation2Dd(std::numbers::pi / 3) * a;
  const auto nearby = [&](const Vector2d& lag) {
    return correlation.PeakNear(lag, kShapeTolerance * a.norm()).has_value();
  };
  Matrix2d cell;
  if (nearby(b) && nearby(b - a)) {
    cell << a, b;
    return cell;
  }
  for (const Vector2d& across : periods) {
    if (across.norm() > kMostElongated * a.norm()) break;
    if (std::abs(a.dot(across)) > kShapeTolerance * a.norm() * across.norm()) continue;
    if (!nearby(a + across) || !nearby(a - across)) continue;
    cell << a, across;
    return CanonicalLatticeBasis(cell);
  }
  return std::nullopt;
}

/// Mean height of the peaks nearest to zero above that between them.
double HeightOfPeaks(const Autocorrelation& correlation, const Matrix2d& basis) {
  const auto at = [&](const Vector2d& lag) { return At(correlation, lag); };
  const Vector2d a = basis.col(0), b = basis.col(1);
  if (KindOfLattice(basis) == LatticeKind::kRectangular) {
    return (at(a) + at(b)) / 2 - (at((a + b) / 2) + at((a - b) / 2)) / 2;
  }
  return (at(a) + at(b) + at(b - a)) / 3 - (at((a + b) / 3) + at((2 * b - a) / 3)) / 2;
}

}  // namespace

std::optional<Matrix2d> FindLatticePeriod(const cv::Mat& flat) {
  const cv::Size size(std::min(flat.cols, kMaxPatch), std::min(flat.rows, kMaxPatch));
  if (std::min(size.width, size.height) < 2 * kMinPitch) return std::nullopt;
  const Autocorrelation correlation(
      flat(cv::Rect({(flat.cols - size.width) / 2, (flat.rows - size.height) / 2}, size)));
  const std::optional<Matrix2d> cell = FindCell(correlation, FindPeriods(correlation));
  if (!cell) return std::nullopt;
  const std::optional<Matrix2d> basis = FitRings(correlation, *cell);
  if (!basis || HeightOfPeaks(correlation, *basis) < kSignificance * correlation.Noise()) {
    return std::nullopt;
  }
  return CanonicalLatticeBasis(*basis);
}

}  // namespace plenocal::internal
