// SPDX-License-Identifier: Apache-2.0
//
// State and data of the one bundle adjustment that all cameras of a session share.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/adjust/nuisance.h"
#include "calib/camera/camera_model.h"
#include "calib/camera/image_circle.h"
#include "calib/camera/marker_freedom.h"
#include "calib/camera/noise_model.h"
#include "calib/camera/observation.h"
#include "calib/camera/param_rule.h"
#include "calib/camera/rigid_transform.h"

namespace plenocal {

struct BundleCamera {
  std::string name = {};
  ImageSize image_size{};
  std::optional<ImageCircle> image_circle = {};
  const CameraModel* model = nullptr;
  std::vector<double> config;
  std::vector<double> params;         ///< the model's, then the nuisance parameters
  std::vector<bool> fixed;            ///< per parameter: not estimated
  std::vector<ParamRule> rules = {};  ///< per parameter, or empty
  std::vector<bool> at_bound = {};    ///< per parameter: `Adjust` left it at a bound; or empty
  RigidTransform T_camera_rig;        ///< extrinsics; identity for the rig's master
  /// T_camera_rig is not estimated: its frame is the rig's, or the extrinsics are given.
  bool is_master = false;
  NoiseModel noise = {};
  /// Kinds of the nuisance parameters, which follow the model's in `params`.
  std::vector<const NuisanceKind*> nuisances = {};

  [[nodiscard]] size_t ModelParams() const { return params.size() - nuisances.size(); }
  /// The number of nuisances of the same kind before one.
  [[nodiscard]] size_t IndexInKind(size_t nuisance) const {
    return static_cast<size_t>(std::count(nuisances.begin(),
                                          nuisances.begin() + static_cast<std::ptrdiff_t>(nuisance),
                                          nuisances[nuisance]));
  }
  /// Index into `params` of the first nuisance of a kind.
  [[nodiscard]] std::optional<size_t> Find(const NuisanceKind& kind) const {
    const auto found = std::ranges::find(nuisances, &kind);
    if (found == nuisances.end()) return std::nullopt;
    return ModelParams() + static_cast<size_t>(found - nuisances.begin());
  }
};

struct BundleMarker {
  int number = 0;
  Eigen::Vector3d position;  ///< in the frame of the first target
  Eigen::Vector3d nominal;   ///< likewise; moves with the marker's target
  int target = 0;            ///< index into Bundle::targets, where there are several
};

/// One of several targets that stay where they are with respect to each other.
struct BundleTarget {
  std::string name;
  RigidTransform T_target_own;  ///< from its own frame to that of the first target
  bool is_fixed = true;         ///< the first target, or one of known pose
};

struct BundleObservation {
  int camera = 0;
  int frame = 0;
  int marker = 0;  ///< index into Bundle::markers
  Observation seen;
  bool used = true;
  /// Derivatives by the camera's shared errors as in `View`; empty: zeros.
  std::vector<double> by_nuisance = {};
  /// Standard deviation of each measured coordinate before the camera's `NoiseModel` corrects it,
  /// px: the detector's where it states one, else an estimate, or 1 where nothing is known.
  double assumed_sigma = 1;
};

/// Deviation of each view's target pose from the pose that all cameras of a frame share: images of
/// one frame that were not taken at quite the same time, or extrinsics that change. All points of a
/// view share this error, so it is estimated, with Gaussian priors whose sigmas are estimated too.
struct Jitter {
  /// Standard deviation of each coordinate of the target's centre, m, and of its rotation about
  /// each axis, rad; zeros for a rigid, synchronous rig.
  double translation_sigma = 0, rotation_sigma = 0;
  /// Per frame and camera (frame * cameras + camera): change of T_rig_target in its chart. Empty
  /// for a rigid, synchronous rig.
  std::vector<Vector6d> delta;
  /// Parallel to `delta`: deviates more than these sigmas allow. Such a view does not contribute to
  /// the frame's pose and counts for its own camera only.
  std::vector<bool> misplaced;
};

/// The rig's motion from a frame's pose to that at which one of its views was taken: a change of
/// T_rig_target in its chart, linear in the camera's nuisances that have a `pose_rate`.
struct ViewMotion {
  Vector6d at_zero_shift = Vector6d::Zero();  ///< where these are zero; m, rad
  Vector6d velocity = Vector6d::Zero();       ///< m/s, rad/s
};

/// A measured distance between two markers, or between the centres of several, as of tags.
struct MarkerDistance {
  std::vector<int> markers_a, markers_b;  ///< indices into Bundle::markers
  double length = 0, sigma = 0;           ///< m
  /// Standard deviation of an error that all distances with one share, as tags printed at a wrong
  /// scale do, m; beside `sigma`.
  double common_sigma = 0;
  std::string name = {};  ///< "tag 3 to tag 7"
};

/// The prior from an earlier calibration: Gaussian, on parameters and extrinsics together.
struct CalibrationPrior {
  /// One number: a parameter of a camera or a component of its extrinsics.
  struct Unknown {
    size_t camera = 0;
    std::optional<size_t> param = {};  ///< not set: a component of T_camera_rig
    Eigen::Index component = 0;        ///< in the chart about `T_camera_rig` below (`Retract`)
    double value = 0;                  ///< of a parameter
  };
  std::vector<Unknown> unknowns;
  std::vector<RigidTransform> T_camera_rig;  ///< per camera of the bundle
  Eigen::MatrixXd weight;                    ///< W; W' W is the inverse covariance of `unknowns`
};

/// All of a bundle but its observations.
struct BundleState {
  std::vector<BundleCamera> cameras;
  std::vector<RigidTransform> T_rig_target;  ///< per frame
  std::vector<BundleMarker> markers;
  /// Several targets, of which the markers are parts; empty: one.
  std::vector<BundleTarget> targets = {};
  MarkerFreedom marker_freedom = {};
  std::vector<TargetScale> scales = {};        ///< where markers have a tolerance
  std::vector<MarkerDistance> distances = {};  ///< where markers are estimated
  std::optional<CalibrationPrior> prior = {};
  /// The frame whose pose is fixed: without nominal positions nothing else places the landmarks'
  /// frame.
  std::optional<size_t> fixed_frame = {};
  /// The distance that fixes the landmarks' scale where nothing measures it; its sigma is small
  /// against all others.
  std::optional<MarkerDistance> scale_distance = {};
  Jitter jitter;
  /// Per view as `Jitter::delta`; empty where the images of a frame were taken at one time.
  std::vector<ViewMotion> motion = {};

  [[nodiscard]] bool EstimatesMarkers() const { return !marker_freedom.IsRigid(); }
  [[nodiscard]] bool HasLandmarks() const { return marker_freedom.IsLandmarks(); }
  /// Index of the target whose pose a marker follows; nothing where that is not estimated.
  [[nodiscard]] std::optional<size_t> FreeTarget(int marker) const {
    if (targets.empty()) return std::nullopt;
    const auto target = static_cast<size_t>(markers[static_cast<size_t>(marker)].target);
    return targets[target].is_fixed ? std::nullopt : std::optional(target);
  }
  /// Change of a marker's place with a scale; zero where that is another target's.
  [[nodiscard]] Eigen::Vector3d ByScale(const TargetScale& scale, int marker) const;
  /// A marker's place by its nominal one and the scales.
  [[nodiscard]] Eigen::Vector3d Expected(int marker) const;
  [[nodiscard]] bool EstimatesJitter() const { return jitter.translation_sigma > 0; }
  /// The parameter whose value a parameter has: itself or the one that it is tied to.
  [[nodiscard]] ParamIndex Root(size_t camera, size_t param) const {
    const std::vector<ParamRule>& rules = cameras[camera].rules;
    return rules.empty() ? ParamIndex{camera, param}
                         : rules[param].tied_to.value_or(ParamIndex{camera, param});
  }
  [[nodiscard]] size_t View(size_t frame, size_t camera) const {
    return frame * cameras.size() + camera;
  }
  /// Increment of T_rig_target in its chart by `ViewMotion`.
  [[nodiscard]] Vector6d MotionIncrement(size_t frame, size_t camera) const;
  /// T_rig_target at the time at which a camera took its image of a frame.
  [[nodiscard]] RigidTransform PoseAtView(size_t frame, size_t camera) const {
    return motion.empty() ? T_rig_target[frame]
                          : Retract(T_rig_target[frame], MotionIncrement(frame, camera));
  }
  /// `PoseAtView` with the jitter of the view.
  [[nodiscard]] RigidTransform SeenPose(size_t frame, size_t camera) const {
    const RigidTransform pose = PoseAtView(frame, camera);
    return jitter.delta.empty() ? pose : Retract(pose, jitter.delta[View(frame, camera)]);
  }
};

struct Bundle : BundleState {
  std::vector<BundleObservation> observations;  ///< sorted by frame, then camera, then marker
};

/// Gives a camera one more unknown of a kind, of value 0 and with a prior about it of standard
/// deviation `prior_sigma`.
void AddNuisance(const NuisanceKind& kind, double prior_sigma, BundleCamera* camera);
/// Gives a camera as many shared errors as its views state. Those that it has already keep their
/// values.
void AddSharedErrors(std::span<const View> views, BundleCamera* camera);

/// "left.shared_1", "right.time_shift": of the parameter at `index` of `camera.params`.
std::string NuisanceName(const BundleCamera& camera, size_t index);

/// The observation with its measured coordinates as they are without systematic displacements.
Observation WithoutDisplacement(const BundleObservation& observation, const BundleCamera& camera);

/// The points of a view's observations for `ProjectPoints`.
class ViewPoints {
 public:
  void Set(const BundleCamera& camera,
           const RigidTransform& T_camera_target,
           std::span<const BundleObservation> of_view,
           std::span<const BundleMarker> markers);
  [[nodiscard]] PointBlock Block() const {
    return {.count = p_.size() / 3, .p = p_.data(), .values = values_.data()};
  }
  /// Measured without displacement, of observation `i`.
  [[nodiscard]] const double* Values(size_t i) const { return &values_[kMaxObservationSize * i]; }

 private:
  std::vector<double> p_, values_;
};

/// Residual of one observation, measured without displacement minus predicted; false outside the
/// model's domain.
bool Residual(const Bundle& bundle, const BundleObservation& observation, double* residual);

/// Residuals of all observations of a camera, or of all cameras, computed together view by view;
/// NaN for those of others and outside the model's domain.
std::vector<std::array<double, kMaxObservationSize>> Residuals(const Bundle& bundle,
                                                               std::optional<size_t> camera = {});

/// Length of the residual in standard deviations of the camera's noise.
double WeightedLength(const Bundle& bundle,
                      const BundleObservation& observation,
                      const double* residual);

/// `WeightedLength` of all observations; infinite outside the model's domain.
std::vector<double> WeightedLengths(const Bundle& bundle);

/// End of the run of observations of one marker in one view, of one view, or of one frame, that
/// starts at `begin`.
size_t EndOfMarker(const std::vector<BundleObservation>& observations, size_t begin);
size_t EndOfView(const std::vector<BundleObservation>& observations, size_t begin);
size_t EndOfFrame(const std::vector<BundleObservation>& observations, size_t begin);

/// Gives a target another pose; its markers and their nominal places move with it.
void MoveTarget(size_t target, const RigidTransform& T_target_own, BundleState* bundle);

/// Gaussian prior on a weighted sum of parameters: a rule's or the model's (`PriorRow`).
struct ParamPrior {
  struct Term {
    ParamIndex param;  ///< never one that is tied to another
    double weight = 1;
  };
  std::vector<Term> terms;
  double value = 0, sigma = 0;  ///< of the sum
};
/// All of them; those of one camera follow each other.
std::vector<ParamPrior> ParamPriors(const BundleState& bundle);

/// Present values of the prior's unknowns less those of the prior. REQUIRES: `bundle.prior`.
Eigen::VectorXd DeviationFromPrior(const BundleState& bundle);
/// "target.scale", or "wall.scale_x" of one of several targets and along its x axis.
std::string NameOfScale(const BundleState& bundle, const TargetScale& scale);
/// "left.f_x", "right.T_camera_rig.w_y".
std::string NameOfPriorUnknown(const Bundle& bundle, size_t unknown);

/// Square root W of the prior's information on the jitter in one frame: its residual is W delta,
/// first the displacement of the target's centre, then its rotation.
Matrix6d JitterWeight(const BundleState& bundle, size_t frame);
/// `JitterWeight` of one view, which may be misplaced.
Matrix6d JitterWeight(const BundleState& bundle, size_t frame, size_t camera);

}  // namespace plenocal
