// SPDX-License-Identifier: Apache-2.0
//
// The one bundle adjustment that all cameras of a session share.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "calib/camera_model.h"
#include "calib/observation.h"
#include "calib/param_rule.h"
#include "calib/rigid_transform.h"

namespace plenocal {

struct BundleCamera {
  const CameraModel* model = nullptr;
  std::vector<double> config;
  std::vector<double> params;
  std::vector<bool> fixed;            ///< per parameter: hold it
  std::vector<ParamRule> rules = {};  ///< per parameter, or empty
  std::vector<bool> at_bound = {};    ///< per parameter: `Adjust` left it at a bound; or empty
  RigidTransform T_camera_rig;        ///< identity for the rig's master
  bool is_master = false;             ///< its T_camera_rig is the rig's frame and never estimated
  /// Sigma of a residual: sqrt((noise_scale sigma)^2 + noise_floor^2) with the observation's own
  /// sigma. The scale says how right the stated sigmas are; the floor stands for errors that the
  /// detector cannot know of (model, target, motion).
  double noise_scale = 1;
  double noise_floor = 0;
  /// Sigma of each coordinate of the error that all observations of one marker in one view have in
  /// common, beside their own. Where a camera sees a marker once, it cannot be told apart.
  double common_noise = 0;
};

struct BundleMarker {
  int number = 0;
  Eigen::Vector3d position;
  Eigen::Vector3d nominal;
};

struct BundleObservation {
  int camera = 0;
  int frame = 0;
  int marker = 0;  ///< index into Bundle::markers
  Observation seen;
  bool used = true;
  std::vector<double> shared_errors = {};  ///< as in `View`
};

/// What each image's target pose has for itself, beside the pose that all cameras of a frame share:
/// images of one frame that were not taken at quite the same time, or mounts that move. Errors that
/// all points of a view share, and hence unknowns, with Gaussian priors whose sigmas are estimated.
struct Jitter {
  /// Sigma of each coordinate of the target's centre, m, and of its rotation about each axis, rad;
  /// zeros for a rigid, synchronous rig.
  double translation_sigma = 0, rotation_sigma = 0;
  /// Per frame and camera (frame * cameras + camera): change of T_rig_target in its chart. Empty
  /// for a rigid, synchronous rig.
  std::vector<Vector6d> delta;
  /// Parallel to `delta`: farther off than these sigmas allow. Such a view has no say in the
  /// frame's pose and counts for its own camera only.
  std::vector<bool> misplaced;
};

/// State and data of the adjustment. `observations` are sorted by frame, then camera, then marker.
struct Bundle {
  std::vector<BundleCamera> cameras;
  std::vector<RigidTransform> T_rig_target;  ///< per frame
  std::vector<BundleMarker> markers;
  /// Sigma of each nominal marker coordinate; 0 holds the markers at their positions.
  double marker_sigma = 0;
  std::vector<BundleObservation> observations;
  Jitter jitter;

  /// The parameter whose value a parameter takes: itself or another that it is one with.
  [[nodiscard]] ParamPlace Root(size_t camera, size_t param) const {
    const std::vector<ParamRule>& rules = cameras[camera].rules;
    return rules.empty() ? ParamPlace{camera, param}
                         : rules[param].same_as.value_or(ParamPlace{camera, param});
  }
  [[nodiscard]] size_t View(size_t frame, size_t camera) const {
    return frame * cameras.size() + camera;
  }
  /// T_rig_target of a frame as one of its cameras sees it.
  [[nodiscard]] RigidTransform SeenPose(size_t frame, size_t camera) const {
    return jitter.delta.empty() ? T_rig_target[frame]
                                : Retract(T_rig_target[frame], jitter.delta[View(frame, camera)]);
  }
};

enum class Loss { kNone, kHuber, kCauchy };

struct AdjustOptions {
  Loss loss = Loss::kNone;
  /// Width of the loss in sigmas of one observation (length of its weighted residual vector).
  double loss_width = 3;
  int max_iterations = 100;
  /// The solve has converged when a step lowers the cost by less than this part of it.
  double cost_tolerance = 1e-10;
  bool hold_intrinsics = false;
  /// Called after every iteration with its number and cost; false stops the solve.
  std::function<bool(int iteration, double cost)> on_iteration;
};

struct AdjustSummary {
  bool usable = false;     ///< the state is at least as good as before
  bool converged = false;  ///< no further improvement was possible
  bool stopped = false;    ///< `on_iteration` asked for it
  int iterations = 0;
  double cost_before = 0;  ///< at the start, half the (robustified) sum of squares
  double cost = 0;         ///< at the end
  std::string message;
};

/// Minimises over intrinsics (with their rules; the start must be within their bounds),
/// T_camera_rig, T_rig_target, jitter (where its sigmas are not zero) and markers. Every used
/// observation must project at the start. Runs Ceres on one thread: its parallel sums depend on the
/// schedule, and the same input must give the same bytes.
AdjustSummary Adjust(Bundle* bundle, const AdjustOptions& options);

/// Moves T_rig_target of the chosen frames to the optimum of their used observations while all else
/// stays: a few robust Gauss-Newton steps from a pose that is nearly right. Much cheaper than
/// `Adjust`.
void AdjustPoses(Bundle* bundle, const std::vector<bool>& frames);

/// One view's say on the target's pose.
struct PoseStep {
  int frame = 0, camera = 0;
  Vector6d delta;   ///< step in the chart of its seen pose to the optimum of its own observations
  double gain = 0;  ///< by how much the step lowers the sum of their squares, sigma^2
};
/// Of every view that has used observations enough for a pose, in their order.
std::vector<PoseStep> OwnPoseSteps(const Bundle& bundle);

/// Square root W of the prior's information on the jitter in one frame: its residual is W delta,
/// first the displacement of the target's centre, then its rotation.
Matrix6d JitterWeight(const Bundle& bundle, size_t frame);
/// The same for one view, which may be misplaced.
Matrix6d JitterWeight(const Bundle& bundle, size_t frame, size_t camera);

/// Residual of one observation, measured minus predicted; false outside the model's domain.
bool Residual(const Bundle& bundle, const BundleObservation& observation, double* residual);

/// Standard deviation of each coordinate of an observation under its camera's noise: that which it
/// has for itself, or all of it.
inline double OwnNoiseSigma(const BundleCamera& camera, const Observation& seen) {
  const double own = camera.noise_scale * seen.sigma;
  return std::sqrt(own * own + camera.noise_floor * camera.noise_floor);
}
inline double NoiseSigma(const BundleCamera& camera, const Observation& seen) {
  const double own = OwnNoiseSigma(camera, seen);
  return std::sqrt(own * own + camera.common_noise * camera.common_noise);
}

/// End of the run of observations of one marker in one view, or of one view, that starts at
/// `begin`.
size_t EndOfMarker(const std::vector<BundleObservation>& observations, size_t begin);
size_t EndOfView(const std::vector<BundleObservation>& observations, size_t begin);

/// Length of the residual in sigmas.
double WeightedLength(const Bundle& bundle,
                      const BundleObservation& observation,
                      const double* residual);

namespace internal {

/// Poses that one view's observations share, with the Jacobian of each chart at its present place.
struct LinearisedView {
  RigidTransform T_camera_rig, T_rig_target;
  Eigen::Matrix3d chart_mount = Eigen::Matrix3d::Identity();  ///< left Jacobian at the chart's w
  Eigen::Matrix3d chart_pose = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d chart_jitter = Eigen::Matrix3d::Identity();
};

/// Where one observation's weighted residual and derivatives go; row-major, one row a measured
/// coordinate. Null pointers are not written.
struct LinearisedRows {
  double* residual = nullptr;
  double* J_params = nullptr;  ///< rows x params
  double* J_mount = nullptr;   ///< rows x 6, chart of T_camera_rig
  double* J_pose = nullptr;    ///< rows x 6, chart of T_rig_target
  double* J_jitter = nullptr;  ///< rows x 6, chart of Jitter::delta
  double* J_marker = nullptr;  ///< rows x 3
};

/// Residual of one observation in sigmas of its own noise with its derivatives; false outside the
/// model's domain. Common noise is the affair of `CommonShare`. Shared by the solver's cost
/// function and by the covariance, so that both mean the same. J_params is needed for any
/// derivative; without it only the residual is computed.
bool Linearise(const BundleCamera& camera,
               const double* params,
               const LinearisedView& view,
               const Eigen::Vector3d& p_target,
               const Observation& seen,
               const LinearisedRows& out);

/// With rows y_i of one marker in one view in their own sigmas sigma_i, common noise t takes
/// CommonShare(t, sum 1 / sigma_i^2) times the square of sum y_i / sigma_i from the sum of y_i^2
/// (the inverse of diag(sigma_i^2) + t^2 1 1', by Sherman and Morrison).
inline double CommonShare(double common_noise, double information) {
  const double variance = common_noise * common_noise;
  return variance / (1 + variance * information);
}

}  // namespace internal
}  // namespace plenocal
