// SPDX-License-Identifier: Apache-2.0
//
// The next views of a target that lower the standard error of a rig's projection most.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "assess/views/projection_sigma.h"
#include "assess/views/rig_estimate.h"
#include "assess/views/target_poses.h"
#include "calib/files/finding.h"

namespace plenocal {

enum class ViewCriterion {
  kSigma,    ///< mean squared error of the projection
  kEntropy,  ///< log determinant of the information
};

struct NextViewOptions {
  int count = 5;
  ViewRange range = {};        ///< m; 0: as the target and the cameras allow
  double largest_tilt = 0.87;  ///< rad, 50 degrees
  double goal = 0.05;          ///< px of the projection's standard error, or as `lowered` has it
  /// What views are to lower; not set: the projection's standard error.
  std::function<ProjectionSigma(const RigEstimate&, const RigUnknowns&)> lowered = {};
  double angle_error = 0.087;    ///< of a pose that a person makes, rad (5 degrees)
  double distance_error = 0.05;  ///< likewise, part of the distance
  int threads = 0;               ///< 0: all cores
};

/// One suggestion. Sigmas are standard errors of the projection, px, or of what is to be lowered;
/// those after it are with all suggestions before it as well.
struct NextView {
  TargetPose pose = {};
  RigidTransform T_rig_target = {};
  ViewCriterion criterion = ViewCriterion::kSigma;
  double sigma_before = 0, sigma_after = 0;
  size_t region = 0;  ///< of the image of `pose.camera` in which it lowers sigma most
  double region_before = 0, region_after = 0;
  std::vector<size_t> cameras = {};  ///< that find the target
  /// Per camera of `cameras`: the target's outlines in its image, px.
  std::map<size_t, std::vector<std::vector<Eigen::Vector2d>>> outlines = {};
};

/// What the best choice of views could reach at the present estimate and noise: no whole number of
/// candidates is better (`OptimalDesign`).
struct ViewBound {
  /// Sigma of the projection of as many frames as there are now, px; infinite where these need not
  /// determine all.
  double sigma = std::numeric_limits<double>::infinity();
  /// Fewest views beside the frames so far until the goal, not rounded; infinite: no number of them
  /// reaches it.
  double further = 0;

  /// Whole number of views to a goal that is not reached.
  [[nodiscard]] double WholeFurther() const { return std::max(1.0, std::ceil(further)); }
};

struct NextViews {
  std::vector<NextView> views = {};  ///< best first; fewer than asked for when no more are feasible
  double sigma = 0;                  ///< now, px; infinite while something is not determined
  double goal = 0;
  LoweredSigma lowered = {};             ///< of all sigmas here
  bool reached = false;                  ///< `sigma` is below the goal
  bool exhausted = false;                ///< `views` together gain less than a tenth
  std::optional<ViewBound> bound = {};   ///< none: something is not determined yet
  std::optional<size_t> suggested = {};  ///< views until the goal, as suggested one by one
  std::vector<double> distances;         ///< at which the projection is judged, m
  size_t frames = 0;
};

/// Greedy choice over `CandidatePoses` of each camera, of those whose information (averaged over
/// `ExecutedPoses`) lowers the sigma most. While something is not determined (a sigma above its
/// unit, the projection's above 5 px) the log determinant takes the place of sigma, which would
/// measure the weak prior. Two suggestions differ by 20 degrees, a fifth of the distance or a third
/// of the image. The sigma is that over the image at the nearest and farthest distance of the range
/// and at ten times the farthest (of plenoptic cameras without the last).
///
/// Throws `Error` of kind kJob when no pose is feasible.
NextViews ChooseNextViews(const RigEstimate& rig,
                          const ViewTarget& shape,
                          const NextViewOptions& options);

/// `ChooseNextViews` for a calibration that goes on: the candidates stay, with their information,
/// while parameters and noise hardly change, so that a new estimate takes a tenth of the time.
class NextViewChooser {
 public:
  NextViewChooser(ViewTarget shape, const NextViewOptions& options);
  NextViewChooser(NextViewChooser&&) noexcept;
  ~NextViewChooser();

  NextViews Choose(RigEstimate rig);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

/// "board in the lower left corner, 0.30 m away, its left side tilted away by 40 degrees: sigma
/// there 1.6 -> 0.4 px".
std::string NextViewText(const NextView& view, const RigEstimate& rig, const LoweredSigma& lowered);
/// "the best 9 frames possible would reach 0.021 px; the goal takes at least 2 more, 3 as
/// suggested"; empty while something is not determined.
std::string ViewBoundText(const NextViews& suggestions);
/// All suggestions for the terminal. `verdict`: of the calibration so far. `assumed_angle`: the
/// lens' angle is given where the images do not determine it.
std::string NextViewsText(const NextViews& suggestions,
                          const RigEstimate& rig,
                          const std::optional<Verdict>& verdict,
                          bool assumed_angle);

/// "lower left corner", "middle".
std::string RegionName(size_t region);

}  // namespace plenocal
