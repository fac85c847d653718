// SPDX-License-Identifier: Apache-2.0
//
// What a calibration is worth in space: standard errors of points and lengths before any is
// measured, over image and distance.
#pragma once

#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "assess/views/micro_lens_visibility.h"
#include "calib/files/calibration_record.h"
#include "calib/space/point_fit.h"
#include "calib/traits/image_grid.h"

namespace plenocal {

/// Standard error of a length by independent sources, m.
struct ErrorBudget {
  double noise = 0;        ///< of the image points
  double calibration = 0;  ///< without the target's scale
  double scale = 0;        ///< of the target
  double jitter = 0;       ///< cameras that do not expose at once

  [[nodiscard]] double Sigma() const;
};

/// A point on the ray through the middle of a cell.
struct AccuracyCell {
  size_t cell = 0;      ///< of `RigAccuracy::grid`
  ErrorBudget z;        ///< zero for one ordinary camera
  ErrorBudget lateral;  ///< root mean square of x and y
  /// Of a length that begins at the point, parallel to the image and away from the camera; not set:
  /// its end is not imaged.
  std::optional<ErrorBudget> across, along;
  double relative = 0;             ///< sigma of the inverse distance over it
  std::vector<double> z_if_known;  ///< sigma of z, in the order of `RigAccuracy::known`, m
};

/// Points at one distance: medians over the cells, of each number by itself.
struct AccuracyAtDistance {
  double distance = 0;              ///< z in the first camera's frame, m
  std::optional<double> seen_at;    ///< over the distance of the farthest marker
  std::vector<AccuracyCell> cells;  ///< those that all cameras image
  ErrorBudget z, lateral;           ///< NaN without cells
  double sigma_z = 0, worst_z = 0;  ///< `worst`: nine tenths of the cells have less
  double sigma_lateral = 0, worst_lateral = 0;
  std::optional<double> across, along;  ///< sigma of a length, m
  double relative = 0;
  std::vector<double> z_if_known;
};

/// Cameras that measure points together.
struct RigAccuracy {
  std::vector<std::string> cameras;  ///< the first has the frame and the grid
  ImageSize image_size{1, 1};
  ImageGrid grid{{1, 1}, 1};
  double bar = 0;                  ///< the length of `across` and `along`, m
  bool has_depth = true;           ///< false: one ordinary camera, points of known z
  std::vector<double> noise;       ///< by camera, of one coordinate of a point, px
  std::vector<std::string> known;  ///< "intrinsics", "extrinsics", or a camera's name
  std::vector<AccuracyAtDistance> distances;
  /// Distances at which noise and calibration have equal shares of sigma_z; at which sigma_z is one
  /// percent; beyond which the inverse distance is less than three of its sigmas. m; not set: there
  /// is none up to a thousand times the farthest distance.
  std::optional<double> calibration_equals_noise, relative_1_percent, beyond;
  std::vector<std::string> open;  ///< numbers that the calibration leaves open
  std::vector<Finding> findings;
};

struct AccuracyOptions {
  std::vector<double> distances = {};        ///< m; empty: from the nearest marker to far beyond
  std::map<std::string, double> noise = {};  ///< by camera, px
  std::optional<double> noise_of_all = {};   ///< of the others; not set: the calibration's
  double bar = 0.1;                          ///< m
  SpaceFrame frame = SpaceFrame::kRig;
  int cells = 24;  ///< along the longer side of the image
};

/// `names`: cameras of the calibration, `lenses`: micro images of each camera of the calibration.
/// Throws `Error` of kind kInput for a calibration without standard errors, for a plenoptic camera
/// whose micro images are not known, and where no distance is known.
RigAccuracy PredictAccuracy(const CalibrationRecord& calibration,
                            const std::vector<std::string>& names,
                            const std::vector<MicroLensVisibility>& lenses,
                            const AccuracyOptions& options);

/// All pairs of ordinary cameras, each plenoptic camera, and all cameras where that is another set;
/// or the one ordinary camera.
std::vector<std::vector<std::string>> CameraSets(const CalibrationRecord& calibration);

/// A length in mm with two digits, without exponent: "0.31", "8500".
std::string MillimetresText(double metres);
/// "left + right".
std::string CamerasText(const std::vector<std::string>& cameras);

}  // namespace plenocal
