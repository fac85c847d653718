// SPDX-License-Identifier: Apache-2.0
//
// Measurements of a wall's points, by cell of a grid over it.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "apps/photometry/wall_views.h"

namespace plenocal {

/// The measurement of one cell by one view.
struct WallSample {
  std::uint16_t view = 0;
  float x = 0, y = 0;    ///< in the reduced image
  float brightness = 0;  ///< ln(light / exposure)
  float light = 0;
  float density = 0;  ///< samples per reduced pixel: neighbours share their noise
};

/// Cells of a part of the wall's plane.
struct WallGrid {
  double x = 0, y = 0;  ///< m, centre of the first cell
  double cell = 0;      ///< m, side
  int columns = 0, rows = 0;

  [[nodiscard]] Eigen::Vector3d At(int column, int row) const {
    return {x + column * cell, y + row * cell, 0};
  }
};

/// The samples of a row of cells, by cell.
struct WallRow {
  std::vector<WallSample> samples;
  std::vector<std::uint32_t> begin;  ///< of each cell, and the end of the last

  [[nodiscard]] std::span<const WallSample> Samples(std::size_t column) const {
    return std::span(samples).subspan(begin[column], begin[column + 1] - begin[column]);
  }
};

/// The part of the wall that several views show, in cells of about one pixel of the reduced images.
/// Throws `Error` of kind kJob where views have nothing in common.
WallGrid ChooseGrid(const WallRecording& wall, const std::string& where);

/// The projection of a point of the wall into the reduced image.
struct WallProjection {
  double x = 0, y = 0;
  double area = 0;  ///< reduced pixels^2 per m^2 of the wall
};
class WallProjector {
 public:
  explicit WallProjector(const WallRecording& wall);
  /// False where the view does not show the point.
  bool operator()(const WallView& view, const Eigen::Vector3d& point, WallProjection* out) const;
  /// From a position in the image to one in the reduced image, and back.
  [[nodiscard]] double Reduce(double x) const { return (x + 0.5) / reduction_ - 0.5; }
  [[nodiscard]] double Enlarge(double x) const { return (x + 0.5) * reduction_ - 0.5; }

 private:
  const CalibratedCamera& camera_;
  double reduction_;
  double pixels_ = 0;  // reduced px^2 per steradian in the middle of the image
};

/// The value that a share of the values is below; reorders them. REQUIRES: a value.
double Quantile(std::vector<double>* values, double share);

/// Bilinear; NaN beyond the image and beside values that are NaN.
float Interpolate(const cv::Mat& image, double x, double y);

/// All samples of the wall.
std::vector<WallRow> SampleWall(const WallRecording& wall, const WallGrid& grid, int threads);

}  // namespace plenocal
