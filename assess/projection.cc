// SPDX-License-Identifier: Apache-2.0
#include "assess/projection.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include "assess/compare.h"
#include "assess/projection_map.h"
#include "assess/views/rig_estimate.h"
#include "calib/base/error.h"
#include "calib/base/statistics.h"
#include "calib/estimate/describe.h"

namespace plenocal {
namespace {

// The cells of the compared grid that have points of a camera, with gaps of a cell or two between
// them closed. Beyond the outermost points a rich model extrapolates.
class Support {
 public:
  Support(const Bundle& bundle, size_t camera) : size_(bundle.cameras[camera].image_size) {
    Cells seen{};
    for (const BundleObservation& observation : bundle.observations) {
      if (observation.camera != static_cast<int>(camera) || !observation.used) continue;
      seen[Index(observation.seen.values[0], observation.seen.values[1])] = true;
    }
    Cells near{};
    for (size_t cell = 0; cell < near.size(); ++cell) {
      near[cell] = CountAround(seen, cell) > 0;
    }
    constexpr int kAll = 9;
    for (size_t cell = 0; cell < near.size(); ++cell) {
      cells_[cell] = seen[cell] || CountAround(near, cell) == kAll;
    }
  }

  [[nodiscard]] bool Has(const Eigen::Vector2d& u_px) const {
    return cells_[Index(u_px.x(), u_px.y())];
  }

 private:
  using Cells = std::array<bool, static_cast<size_t>(kComparedColumns* kComparedRows)>;

  [[nodiscard]] size_t Index(double x, double y) const {
    const auto place = [](double u, int pixels, int cells) {
      return std::clamp(static_cast<int>((u + 0.5) / pixels * cells), 0, cells - 1);
    };
    return static_cast<size_t>(place(y, size_[1], kComparedRows)) * kComparedColumns +
           static_cast<size_t>(place(x, size_[0], kComparedColumns));
  }

  // Of a cell and its eight neighbours, those in the image that are set.
  static int CountAround(const Cells& cells, size_t cell) {
    const int column = static_cast<int>(cell) % kComparedColumns;
    const int row = static_cast<int>(cell) / kComparedColumns;
    int count = 0;
    for (int y = std::max(row - 1, 0); y <= std::min(row + 1, kComparedRows - 1); ++y) {
      for (int x = std::max(column - 1, 0); x <= std::min(column + 1, kComparedColumns - 1); ++x) {
        count += cells[static_cast<size_t>(y) * kComparedColumns + static_cast<size_t>(x)] ? 1 : 0;
      }
    }
    return count;
  }

  ImageSize size_;
  Cells cells_{};
};

// Between them lie four fifths of the points.
std::vector<double> SupportedDistances(const Bundle& bundle, size_t camera) {
  const std::vector<double> sorted = PointDistances(bundle, camera);
  return {sorted[sorted.size() / 10], sorted[sorted.size() - 1 - sorted.size() / 10]};
}

// Mean square over the pixels that points of a camera of `bundle` support; infinite where one of
// the two cameras is so far from any lens that they have no pixel in common.
double MeanSquare(const CalibratedCamera& a,
                  const CalibratedCamera& b,
                  const Bundle& bundle,
                  size_t camera,
                  double (*length)(const PixelDifference&)) {
  const Support support(bundle, camera);
  double sum = 0, count = 0;
  try {
    for (const DistanceDifference& at :
         CompareCameras(a, b, SupportedDistances(bundle, camera)).distances) {
      for (const PixelDifference& pixel : at.pixels) {
        if (!support.Has(pixel.u_px)) continue;
        sum += length(pixel) * length(pixel);
        ++count;
      }
    }
  } catch (const Error&) {
  }
  return count > 0 ? sum / count : std::numeric_limits<double>::infinity();
}

// Root of the mean of `square` over the cameras.
double RmsOver(std::span<const size_t> cameras, const std::function<double(size_t)>& square) {
  double sum = 0;
  for (const size_t c : cameras) sum += square(c);
  return std::sqrt(sum / static_cast<double>(cameras.size()));
}

}  // namespace

double TypicalImageSigma(const Calibration& calibration, std::span<const size_t> cameras) {
  return RmsOver(cameras, [&](size_t c) {
    const double sigma =
        ImageSigma(DescribeCamera(calibration, c), {Median(PointDistances(calibration.bundle, c))});
    return sigma * sigma;
  });
}

double SupportedSigma(const Calibration& calibration, std::span<const size_t> cameras) {
  return RmsOver(cameras, [&](size_t c) {
    const CalibratedCamera camera = DescribeCamera(calibration, c);
    if (!camera.covariance.allFinite()) return std::numeric_limits<double>::infinity();
    CalibratedCamera exact = camera;
    exact.covariance.setZero();
    return MeanSquare(camera, exact, calibration.bundle, c, [](const PixelDifference& pixel) {
      return pixel.predicted_px;
    });
  });
}

double SupportedDifference(const Calibration& a,
                           const Calibration& b,
                           std::span<const size_t> cameras) {
  return RmsOver(cameras, [&](size_t c) {
    return MeanSquare(
        DescribeCamera(a, c), DescribeCamera(b, c), a.bundle, c, [](const PixelDifference& pixel) {
          return pixel.difference_px.norm();
        });
  });
}

double UnexplainedDifference(const Calibration& a,
                             const Calibration& b,
                             std::span<const size_t> cameras) {
  double largest = 0;
  for (const size_t c : cameras) {
    const CalibratedCamera camera = DescribeCamera(a, c);
    std::vector<double> squares;
    const CameraDifference difference =
        CompareCameras(camera, DescribeCamera(b, c), {Median(PointDistances(a.bundle, c))});
    for (const PixelDifference& pixel : difference.distances.at(0).pixels) {
      if (camera.image_circle && !camera.image_circle->Has(pixel.u_px)) continue;
      squares.push_back(pixel.difference_px.squaredNorm() -
                        pixel.predicted_px * pixel.predicted_px);
    }
    if (squares.empty()) continue;
    largest = std::max(largest, Quantile(std::move(squares), kMostOfImage));
  }
  return std::sqrt(largest);
}

ImageCovariance::ImageCovariance(const CalibratedCamera& camera) : finite_(camera.covariance) {
  for (Eigen::Index k = 0; k < finite_.rows(); ++k) {
    open_.push_back(!std::isfinite(finite_(k, k)));
    if (!open_.back()) continue;
    finite_.row(k).setZero();
    finite_.col(k).setZero();
  }
}

Eigen::MatrixXd ImageCovariance::Propagate(const Eigen::Ref<const Eigen::MatrixXd>& J,
                                           const std::vector<size_t>& support) const {
  Eigen::MatrixXd covariance = support.empty()
                                   ? Eigen::MatrixXd(J * finite_ * J.transpose())
                                   : Eigen::MatrixXd(J * finite_(support, support) * J.transpose());
  for (Eigen::Index i = 0; i < J.cols(); ++i) {
    const auto column = static_cast<size_t>(i);
    if (!open_[support.empty() ? column : support[column]]) continue;
    for (Eigen::Index r = 0; r < J.rows(); ++r) {
      if (J(r, i) != 0) covariance(r, r) = std::numeric_limits<double>::infinity();
    }
  }
  return covariance;
}

}  // namespace plenocal
