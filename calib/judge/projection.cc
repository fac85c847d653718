// SPDX-License-Identifier: Apache-2.0
#include "calib/judge/projection.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "calib/base/statistics.h"
#include "calib/describe.h"
#include "calib/judge/compare.h"

namespace plenocal {
namespace {

double MedianDistance(const Bundle& bundle, size_t camera) {
  std::vector<double> distances;
  for (const BundleObservation& observation : bundle.observations) {
    if (observation.camera != static_cast<int>(camera) || !observation.used) continue;
    const RigidTransform T_camera_target =
        bundle.cameras[camera].T_camera_rig *
        bundle.SeenPose(static_cast<size_t>(observation.frame), camera);
    distances.push_back(
        (T_camera_target * bundle.markers[static_cast<size_t>(observation.marker)].position)
            .norm());
  }
  return Median(std::move(distances));
}

// The cells of the compared grid that have points of a camera, and their neighbours.
class Support {
 public:
  Support(const Bundle& bundle, size_t camera) : size_(bundle.cameras[camera].image_size) {
    for (const BundleObservation& observation : bundle.observations) {
      if (observation.camera != static_cast<int>(camera) || !observation.used) continue;
      const auto [column, row] = Cell(observation.seen.values[0], observation.seen.values[1]);
      for (int y = std::max(row - 1, 0); y <= std::min(row + 1, kComparedRows - 1); ++y) {
        for (int x = std::max(column - 1, 0); x <= std::min(column + 1, kComparedColumns - 1);
             ++x) {
          cells_[static_cast<size_t>(y * kComparedColumns + x)] = true;
        }
      }
    }
  }

  [[nodiscard]] bool Has(const Eigen::Vector2d& u_px) const {
    const auto [column, row] = Cell(u_px.x(), u_px.y());
    return cells_[static_cast<size_t>(row * kComparedColumns + column)];
  }

 private:
  [[nodiscard]] std::pair<int, int> Cell(double x, double y) const {
    const auto place = [](double u, int pixels, int cells) {
      return std::clamp(static_cast<int>((u + 0.5) / pixels * cells), 0, cells - 1);
    };
    return {place(x, size_[0], kComparedColumns), place(y, size_[1], kComparedRows)};
  }

  ImageSize size_;
  std::array<bool, static_cast<size_t>(kComparedColumns* kComparedRows)> cells_{};
};

// Mean over the supported pixels.
double MeanSquare(const CameraDifference& camera,
                  const Support& support,
                  double (*length)(const PixelDifference&)) {
  double sum = 0, count = 0;
  for (const DistanceDifference& at : camera.distances) {
    for (const PixelDifference& pixel : at.pixels) {
      if (!support.Has(pixel.u_px)) continue;
      sum += length(pixel) * length(pixel);
      ++count;
    }
  }
  return sum / count;
}

std::vector<double> Distances(const Bundle& bundle, size_t camera) {
  std::vector<double> distances{MedianDistance(bundle, camera)};
  if (bundle.cameras[camera].model->central) {
    distances.push_back(std::numeric_limits<double>::infinity());
  }
  return distances;
}

}  // namespace

double TypicalImageSigma(const Calibration& calibration, std::span<const size_t> cameras) {
  double squares = 0;
  for (const size_t c : cameras) {
    const double sigma =
        ImageSigma(DescribeCamera(calibration, c), {MedianDistance(calibration.bundle, c)});
    squares += sigma * sigma;
  }
  return std::sqrt(squares / static_cast<double>(cameras.size()));
}

double SupportedSigma(const Calibration& calibration, std::span<const size_t> cameras) {
  double squares = 0;
  for (const size_t c : cameras) {
    const CalibratedCamera camera = DescribeCamera(calibration, c);
    if (!camera.covariance.allFinite()) return std::numeric_limits<double>::infinity();
    CalibratedCamera exact = camera;
    exact.covariance.setZero();
    squares += MeanSquare(CompareCameras(camera, exact, Distances(calibration.bundle, c)),
                          Support(calibration.bundle, c),
                          [](const PixelDifference& pixel) { return pixel.predicted_px; });
  }
  return std::sqrt(squares / static_cast<double>(cameras.size()));
}

double SupportedDifference(const Calibration& a,
                           const Calibration& b,
                           std::span<const size_t> cameras) {
  double squares = 0;
  for (const size_t c : cameras) {
    squares += MeanSquare(
        CompareCameras(DescribeCamera(a, c), DescribeCamera(b, c), Distances(a.bundle, c)),
        Support(a.bundle, c),
        [](const PixelDifference& pixel) { return pixel.difference_px.norm(); });
  }
  return std::sqrt(squares / static_cast<double>(cameras.size()));
}

}  // namespace plenocal
