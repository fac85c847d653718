// SPDX-License-Identifier: Apache-2.0
//
// Standard error of a rig's projection, or of another result, as a function of the covariance of
// its unknowns: what a next view is to lower.
#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "assess/views/rig_estimate.h"

namespace plenocal {

/// Ninths of an image, row by row: upper left, upper, upper right, left, ...
inline constexpr size_t kRegions = 9;

/// What is to be lowered, in words.
struct LoweredSigma {
  std::string of = "the projection", unit = "px";
  double determined = 5;  ///< in `unit`; above it sigma depends on the weak prior
};

/// Mean squared error of projections, linear in the covariance C of the unknowns in units:
/// tr(M C). The points lie at `distances` on the rays of 16 x 12 pixels of each camera; the motion
/// of the rig's frame that compensates most of an error over all of them is left out, since every
/// pose of the target follows it.
class ProjectionSigma {
 public:
  /// Throws `Error` of kind kJob when no camera
  /// images any of these points.
  ProjectionSigma(const RigEstimate& rig,
                  const RigUnknowns& unknowns,
                  const std::vector<double>& distances);

  /// Of other results at points: their derivatives by the unknowns in units, one row each.
  struct Result {
    size_t camera = 0, region = 0;  ///< of the image in which the point is seen
    Eigen::MatrixXd by_unknowns;
  };
  ProjectionSigma(const std::vector<Result>& results, size_t cameras, LoweredSigma words);

  [[nodiscard]] const LoweredSigma& Words() const { return words_; }
  /// M of all cameras together.
  [[nodiscard]] const Eigen::MatrixXd& All() const { return all_; }
  /// RMS length of the error, px; `covariance` of the unknowns in units. `ImageSigma` of a camera
  /// at these distances is larger by a few percent, as its motion weighs points by their errors.
  [[nodiscard]] double Of(const Eigen::MatrixXd& covariance) const { return Of(all_, covariance); }
  /// The same in one ninth of a camera's image; NaN where it images nothing.
  [[nodiscard]] double InRegion(size_t camera,
                                size_t region,
                                const Eigen::MatrixXd& covariance) const;

 private:
  static double Of(const Eigen::MatrixXd& M, const Eigen::MatrixXd& covariance);

  LoweredSigma words_;
  Eigen::MatrixXd all_;
  std::vector<std::array<Eigen::MatrixXd, kRegions>> regions_;  // per camera; empty: no points
};

/// The ninth of an image that has a place.
size_t RegionOf(const Eigen::Vector2d& u_px, ImageSize image_size);

}  // namespace plenocal
