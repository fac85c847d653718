// SPDX-License-Identifier: Apache-2.0
#include "calib/bundle.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <limits>
#include <map>
#include <memory>
#include <utility>

namespace plenocal {
namespace internal {

bool Linearise(const BundleCamera& camera,
               const double* params,
               const LinearisedView& view,
               const Eigen::Vector3d& p_target,
               const Observation& seen,
               const LinearisedRows& out) {
  const Eigen::Vector3d rotated = view.T_rig_target.R * p_target;
  const Eigen::Vector3d rotated_rig = view.T_camera_rig.R * (rotated + view.T_rig_target.t);
  const Eigen::Vector3d p_cam = rotated_rig + view.T_camera_rig.t;

  const CameraModel& model = *camera.model;
  const size_t rows = model.measured.size();
  double predicted[kMaxObservationSize];
  double J_point[kMaxObservationSize * 3];
  const bool inside =
      out.J_params == nullptr
          ? model.project(params, camera.config.data(), seen.values.data(), p_cam, predicted)
          : model.project_with_jacobian(params,
                                        camera.config.data(),
                                        seen.values.data(),
                                        p_cam,
                                        predicted,
                                        out.J_params,
                                        J_point);
  if (!inside) return false;
  const double weight = 1 / OwnNoiseSigma(camera, seen);
  for (size_t r = 0; r < rows; ++r) out.residual[r] = weight * (seen.values[r] - predicted[r]);
  if (out.J_params == nullptr) return true;

  // Residual = measured - predicted, so every derivative is minus that of the prediction. With a
  // rotation by w before the point: row (-Hat(a)) = (a x row)'.
  for (size_t i = 0; i < rows * model.params.size(); ++i) out.J_params[i] *= -weight;
  for (size_t r = 0; r < rows; ++r) {
    const Eigen::Vector3d J_cam = -weight * Eigen::Map<const Eigen::Vector3d>(J_point + 3 * r);
    const Eigen::Vector3d J_rig = view.T_camera_rig.R.transpose() * J_cam;
    if (out.J_mount != nullptr) {
      Eigen::Map<Eigen::Vector3d>(out.J_mount + 6 * r) = J_cam;
      Eigen::Map<Eigen::Vector3d>(out.J_mount + 6 * r + 3) =
          view.chart_mount.transpose() * rotated_rig.cross(J_cam);
    }
    if (out.J_pose != nullptr) {
      Eigen::Map<Eigen::Vector3d>(out.J_pose + 6 * r) = J_rig;
      Eigen::Map<Eigen::Vector3d>(out.J_pose + 6 * r + 3) =
          view.chart_pose.transpose() * rotated.cross(J_rig);
    }
    if (out.J_jitter != nullptr) {
      Eigen::Map<Eigen::Vector3d>(out.J_jitter + 6 * r) = J_rig;
      Eigen::Map<Eigen::Vector3d>(out.J_jitter + 6 * r + 3) =
          view.chart_jitter.transpose() * rotated.cross(J_rig);
    }
    if (out.J_marker != nullptr) {
      Eigen::Map<Eigen::Vector3d>(out.J_marker + 3 * r) = view.T_rig_target.R.transpose() * J_rig;
    }
  }
  return true;
}

}  // namespace internal

namespace {

using internal::LinearisedRows;
using internal::LinearisedView;

// Markers are estimated in blocks: fewer, larger blocks cost Ceres less bookkeeping
// (shared/PERFORMANCE.md, "Where the time hides").
constexpr int kMarkersPerBlock = 4;
constexpr int kMarkerBlockSize = 3 * kMarkersPerBlock;

// A pose in the chart around its place before the solve; `delta` points to its six unknowns.
struct ChartedPose {
  RigidTransform origin;
  double* delta = nullptr;

  [[nodiscard]] RigidTransform Value() const {
    return Retract(origin, Eigen::Map<const Vector6d>(delta));
  }
};

// Factor on the residual of length `s` (in sigmas) so that half its square is the loss, with its
// derivative to s^2. Applied to the residual itself, not by ceres::LossFunction, because that acts
// on whole residual blocks and one block holds several observations.
struct RobustFactor {
  double factor = 1;
  double derivative = 0;  // d factor / d (s^2)
};

RobustFactor Robustify(Loss loss, double width, double s2) {
  if (loss == Loss::kHuber && s2 > width * width) {
    // rho = 2 k s - k^2
    const double s = std::sqrt(s2);
    const double rho = 2 * width * s - width * width;
    const double factor = std::sqrt(rho / s2);
    return {factor, (width / (s * s2) - rho / (s2 * s2)) / (2 * factor)};
  }
  if (loss == Loss::kCauchy && s2 > 0) {
    // rho = k^2 log(1 + s^2 / k^2)
    const double k2 = width * width, q = s2 / k2;
    const double factor = std::sqrt(std::log1p(q) / q);
    if (q < 1e-8) return {1, -0.25 / k2};
    return {factor, (1 / (s2 * (1 + q)) - std::log1p(q) / (q * s2)) / (2 * factor)};
  }
  return {};
}

// The parameters of one camera, or of several that have some in common: each value once.
struct IntrinsicsBlock {
  std::vector<double> values;  // before the solve
  std::vector<bool> fixed;
  std::vector<double> lower, upper;      // the rules'
  std::vector<ParamRule::Prior> priors;  // with the slots that they belong to
  std::vector<size_t> prior_slots;
  std::vector<bool> at_bound;  // held there during one solve
  double* place = nullptr;     // among the unknowns

  [[nodiscard]] bool IsHeld(size_t slot) const { return fixed[slot] || at_bound[slot]; }
};

// The place of a parameter that is held outside of the block.
constexpr size_t kNoSlot = std::numeric_limits<size_t>::max();

// Where one camera's parameters are.
struct Intrinsics {
  IntrinsicsBlock* block = nullptr;
  std::vector<size_t> slots;  // per parameter; empty when the block is the camera's alone, in order
};

// Held parameters in a block cost Ceres a dense product for each residual block. Many that are free
// beside some that are not have a block without these.
bool LeavesOutHeld(const BundleCamera& camera) {
  const auto held = std::count(camera.fixed.begin(), camera.fixed.end(), true);
  return camera.model->local && held > 0 && held < std::ssize(camera.fixed);
}

// Blocks of all cameras; two that have a parameter in common have one.
std::vector<Intrinsics> MakeIntrinsics(const Bundle& bundle, std::deque<IntrinsicsBlock>* blocks) {
  const size_t count = bundle.cameras.size();
  std::vector<size_t> first(count);  // camera -> the first camera of its block
  for (size_t c = 0; c < count; ++c) first[c] = c;
  std::vector<bool> tied(count, false);
  for (size_t c = 0; c < count; ++c) {
    for (size_t k = 0; k < bundle.cameras[c].params.size(); ++k) {
      const ParamPlace root = bundle.Root(c, k);
      if (root == ParamPlace{c, k}) continue;
      tied[c] = tied[root.camera] = true;
      const size_t from = std::max(first[c], first[root.camera]);
      const size_t to = std::min(first[c], first[root.camera]);
      std::replace(first.begin(), first.end(), from, to);
    }
  }
  std::vector<Intrinsics> all(count);
  std::vector<std::vector<size_t>> slots(count);
  const auto add = [&](size_t c, bool roots) {
    const BundleCamera& camera = bundle.cameras[c];
    IntrinsicsBlock& block = *all[c].block;
    slots[c].resize(camera.params.size());
    for (size_t k = 0; k < camera.params.size(); ++k) {
      const ParamPlace root = bundle.Root(c, k);
      const bool is_root = root == ParamPlace{c, k};
      if (is_root != roots) continue;
      if (!tied[c] && camera.fixed[k] && LeavesOutHeld(camera)) {
        slots[c][k] = kNoSlot;
      } else if (is_root) {
        slots[c][k] = block.values.size();
        block.values.push_back(camera.params[k]);
        block.fixed.push_back(camera.fixed[k]);
        block.lower.push_back(-std::numeric_limits<double>::infinity());
        block.upper.push_back(std::numeric_limits<double>::infinity());
        block.at_bound.push_back(false);
      } else {
        slots[c][k] = slots[root.camera][root.param];
      }
      const size_t slot = slots[c][k];
      if (camera.rules.empty() || slot == kNoSlot) continue;
      const ParamRule& rule = camera.rules[k];
      block.lower[slot] = std::max(block.lower[slot], rule.lower);
      block.upper[slot] = std::min(block.upper[slot], rule.upper);
      if (rule.prior) {
        block.priors.push_back(*rule.prior);
        block.prior_slots.push_back(slot);
      }
    }
  };
  for (size_t c = 0; c < count; ++c) {
    if (first[c] == c) blocks->emplace_back();
    all[c].block = first[c] == c ? &blocks->back() : all[first[c]].block;
    add(c, true);
  }
  for (size_t c = 0; c < count; ++c) add(c, false);
  for (size_t c = 0; c < count; ++c) {
    if (tied[c] || LeavesOutHeld(bundle.cameras[c])) all[c].slots = slots[c];
  }
  return all;
}

// All observations of one camera in one frame that fall into one block of markers.
// Parameter blocks: intrinsics, [mount,] pose[, jitter][, markers].
class ViewCost : public ceres::CostFunction {
 public:
  ViewCost(const BundleCamera& camera,
           const Intrinsics& intrinsics,
           const ChartedPose* mount,
           const ChartedPose& pose,
           bool free_jitter,
           std::span<const BundleObservation* const> observations,
           const Bundle& bundle,
           bool free_markers,
           const AdjustOptions& options)
      : camera_(camera),
        slots_(intrinsics.slots),
        mount_(mount),
        pose_(pose),
        free_jitter_(free_jitter),
        observations_(observations.begin(), observations.end()),
        bundle_(bundle),
        free_markers_(free_markers),
        options_(options) {
    set_num_residuals(static_cast<int>(observations_.size() * camera.model->measured.size()));
    auto& sizes = *mutable_parameter_block_sizes();
    sizes.push_back(static_cast<int>(intrinsics.block->values.size()));
    if (mount_ != nullptr) sizes.push_back(6);
    sizes.push_back(6);
    if (free_jitter_) sizes.push_back(6);
    if (free_markers_) sizes.push_back(kMarkerBlockSize);
  }

  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override {
    const int pose_index = mount_ != nullptr ? 2 : 1;
    std::vector<double> gathered;
    const double* const params = Gather(parameters[0], &gathered);
    // Limits are part of the model's domain; Ceres' own bounds would add a line search a step.
    if (!WithinBounds(*camera_.model, params)) return false;
    LinearisedView view;
    view.T_camera_rig = camera_.T_camera_rig;
    if (mount_ != nullptr) {
      const Eigen::Map<const Vector6d> delta(parameters[1]);
      view.T_camera_rig = Retract(mount_->origin, delta);
      view.chart_mount = LeftJacobian(delta.tail<3>());
    }
    const Eigen::Map<const Vector6d> delta(parameters[pose_index]);
    view.T_rig_target = Retract(pose_.origin, delta);
    view.chart_pose = LeftJacobian(delta.tail<3>());
    const int jitter_index = pose_index + 1;
    const int marker_index = jitter_index + (free_jitter_ ? 1 : 0);
    // R = Exp(w_jitter) Exp(w_pose) R_0: a change of w_pose turns with Exp(w_jitter).
    if (free_jitter_) {
      const Eigen::Map<const Vector6d> jitter(parameters[jitter_index]);
      view.T_rig_target = Retract(view.T_rig_target, jitter);
      view.chart_pose = ExpRotation(jitter.tail<3>()) * view.chart_pose;
      view.chart_jitter = LeftJacobian(jitter.tail<3>());
    }

    const size_t rows = camera_.model->measured.size();
    const size_t count = camera_.params.size();
    const auto block = [&](int index) { return jacobians == nullptr ? nullptr : jacobians[index]; };
    double* const J_intrinsics = block(0);
    double* const J_mount = mount_ != nullptr ? block(1) : nullptr;
    double* const J_pose = block(pose_index);
    double* const J_jitter = free_jitter_ ? block(jitter_index) : nullptr;
    double* const J_markers = free_markers_ ? block(marker_index) : nullptr;
    // Ceres may ask for some blocks only; the model's own derivatives are needed for any of them.
    const bool direct = J_intrinsics != nullptr && slots_.empty();
    std::vector<double> own(jacobians != nullptr && !direct ? rows * count : 0);
    const size_t width = static_cast<size_t>(parameter_block_sizes()[0]);
    if (J_intrinsics != nullptr && !direct) {
      std::fill_n(J_intrinsics, observations_.size() * rows * width, 0.0);
    }
    for (size_t i = 0; i < observations_.size(); ++i) {
      const BundleObservation& observation = *observations_[i];
      const size_t slot = static_cast<size_t>(observation.marker) % kMarkersPerBlock;
      const Eigen::Vector3d p_target =
          free_markers_ ? Eigen::Vector3d(Eigen::Map<const Eigen::Vector3d>(
                              parameters[marker_index] + 3 * slot))
                        : bundle_.markers[static_cast<size_t>(observation.marker)].position;
      const size_t row = i * rows;
      double J_marker[kMaxObservationSize * 3];
      LinearisedRows out{.residual = residuals + row};
      if (jacobians != nullptr) {
        out.J_params = direct ? J_intrinsics + row * count : own.data();
        if (J_mount != nullptr) out.J_mount = J_mount + row * 6;
        if (J_pose != nullptr) out.J_pose = J_pose + row * 6;
        if (J_jitter != nullptr) out.J_jitter = J_jitter + row * 6;
        if (J_markers != nullptr) out.J_marker = J_marker;
      }
      if (!internal::Linearise(camera_, params, view, p_target, observation.seen, out)) {
        return false;
      }
      Robustify(observation.seen, out);
      for (size_t r = 0; r < rows && J_intrinsics != nullptr && !direct; ++r) {
        for (size_t k = 0; k < count; ++k) {
          if (slots_[k] == kNoSlot) continue;
          J_intrinsics[(row + r) * width + slots_[k]] += own[r * count + k];
        }
      }
      if (J_markers == nullptr) continue;
      std::fill_n(J_markers + row * kMarkerBlockSize, rows * kMarkerBlockSize, 0.0);
      for (size_t r = 0; r < rows; ++r) {
        std::copy_n(J_marker + 3 * r, 3, J_markers + (row + r) * kMarkerBlockSize + 3 * slot);
      }
    }
    if (camera_.common_noise > 0) {
      Decorrelate(residuals, 1);
      const std::vector<int>& sizes = parameter_block_sizes();
      for (size_t b = 0; jacobians != nullptr && b < sizes.size(); ++b) {
        if (jacobians[b] != nullptr) Decorrelate(jacobians[b], static_cast<size_t>(sizes[b]));
      }
    }
    return true;
  }

 private:
  // The camera's parameters among those of its block.
  const double* Gather(const double* block, std::vector<double>* buffer) const {
    if (slots_.empty()) return block;
    *buffer = camera_.params;
    for (size_t k = 0; k < slots_.size(); ++k) {
      if (slots_[k] != kNoSlot) (*buffer)[k] = block[slots_[k]];
    }
    return buffer->data();
  }

  // Multiplies rows of `columns` numbers by the inverse root of their covariance under common
  // noise, marker by marker: with u_i = 1 / sigma_i it is I - (1 - 1 / sqrt(1 + t^2 |u|^2)) u u' /
  // |u|^2.
  void Decorrelate(double* data, size_t columns) const {
    const size_t rows = camera_.model->measured.size();
    std::vector<double> u, sum(rows * columns);
    for (size_t begin = 0, end = 0; begin < observations_.size(); begin = end) {
      u.clear();
      double information = 0;
      for (;
           end < observations_.size() && observations_[end]->marker == observations_[begin]->marker;
           ++end) {
        u.push_back(1 / OwnNoiseSigma(camera_, observations_[end]->seen));
        information += u.back() * u.back();
      }
      const double left =
          1 / std::sqrt(1 + camera_.common_noise * camera_.common_noise * information);
      std::fill(sum.begin(), sum.end(), 0.0);
      double* const first = data + begin * rows * columns;
      for (size_t i = 0; i < u.size(); ++i) {
        for (size_t k = 0; k < sum.size(); ++k) sum[k] += u[i] * first[i * sum.size() + k];
      }
      for (size_t i = 0; i < u.size(); ++i) {
        const double part = (1 - left) * u[i] / information;
        for (size_t k = 0; k < sum.size(); ++k) first[i * sum.size() + k] -= part * sum[k];
      }
    }
  }

  // r' = f(s^2) r, J' = (f I + 2 f' r r') J, where s is in sigmas of all noise.
  void Robustify(const Observation& seen, const LinearisedRows& out) const {
    if (options_.loss == Loss::kNone) return;
    const size_t rows = camera_.model->measured.size();
    const double part = OwnNoiseSigma(camera_, seen) / NoiseSigma(camera_, seen);
    double s2 = 0;
    for (size_t r = 0; r < rows; ++r) s2 += out.residual[r] * out.residual[r];
    RobustFactor robust = plenocal::Robustify(options_.loss, options_.loss_width, part * part * s2);
    robust.derivative *= part * part;
    if (robust.factor == 1 && robust.derivative == 0) return;
    const auto scale = [&](double* J, size_t columns) {
      if (J == nullptr) return;
      for (size_t c = 0; c < columns; ++c) {
        double along = 0;
        for (size_t r = 0; r < rows; ++r) along += out.residual[r] * J[r * columns + c];
        for (size_t r = 0; r < rows; ++r) {
          double& entry = J[r * columns + c];
          entry = robust.factor * entry + 2 * robust.derivative * along * out.residual[r];
        }
      }
    };
    scale(out.J_params, camera_.params.size());
    scale(out.J_mount, 6);
    scale(out.J_pose, 6);
    scale(out.J_jitter, 6);
    scale(out.J_marker, 3);
    for (size_t r = 0; r < rows; ++r) out.residual[r] *= robust.factor;
  }

  const BundleCamera& camera_;
  const std::vector<size_t>& slots_;
  const ChartedPose* mount_;
  const ChartedPose& pose_;
  bool free_jitter_;
  std::vector<const BundleObservation*> observations_;
  const Bundle& bundle_;
  bool free_markers_;
  const AdjustOptions& options_;
};

// (marker - nominal) / sigma for one block of markers.
class MarkerPrior : public ceres::CostFunction {
 public:
  MarkerPrior(const double* nominal, int size, double sigma)
      : nominal_(nominal, nominal + size), sigma_(sigma) {
    set_num_residuals(size);
    mutable_parameter_block_sizes()->push_back(kMarkerBlockSize);
  }

  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override {
    const size_t size = nominal_.size();
    for (size_t i = 0; i < size; ++i) residuals[i] = (parameters[0][i] - nominal_[i]) / sigma_;
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      std::fill_n(jacobians[0], size * kMarkerBlockSize, 0.0);
      for (size_t i = 0; i < size; ++i) jacobians[0][i * kMarkerBlockSize + i] = 1 / sigma_;
    }
    return true;
  }

 private:
  std::vector<double> nominal_;
  double sigma_;
};

// (parameter - value) / sigma.
class ParamPriorCost : public ceres::CostFunction {
 public:
  ParamPriorCost(int size, size_t slot, ParamRule::Prior prior)
      : size_(size), slot_(slot), prior_(prior) {
    set_num_residuals(1);
    mutable_parameter_block_sizes()->push_back(size);
  }

  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override {
    residuals[0] = (parameters[0][slot_] - prior_.value) / prior_.sigma;
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      std::fill_n(jacobians[0], size_, 0.0);
      jacobians[0][slot_] = 1 / prior_.sigma;
    }
    return true;
  }

 private:
  int size_;
  size_t slot_;
  ParamRule::Prior prior_;
};

// W delta of one view's jitter.
class JitterPrior : public ceres::CostFunction {
 public:
  explicit JitterPrior(const Matrix6d& weight) : weight_(weight) {
    set_num_residuals(6);
    mutable_parameter_block_sizes()->push_back(6);
  }

  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override {
    Eigen::Map<Vector6d> residual(residuals);
    residual = weight_ * Eigen::Map<const Vector6d>(parameters[0]);
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>> J(jacobians[0]);
      J = weight_;
    }
    return true;
  }

 private:
  Matrix6d weight_;
};

class IterationReport : public ceres::IterationCallback {
 public:
  explicit IterationReport(const AdjustOptions& options) : options_(options) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    if (!options_.on_iteration) return ceres::SOLVER_CONTINUE;
    return options_.on_iteration(summary.iteration, summary.cost) ? ceres::SOLVER_CONTINUE
                                                                  : ceres::SOLVER_ABORT;
  }

 private:
  const AdjustOptions& options_;
};

// Above this many unknowns beside the poses a dense reduced system costs more than a sparse one.
constexpr size_t kMaxDenseUnknowns = 3000;

}  // namespace

bool Residual(const Bundle& bundle, const BundleObservation& observation, double* residual) {
  const BundleCamera& camera = bundle.cameras[static_cast<size_t>(observation.camera)];
  const RigidTransform T_camera_target =
      camera.T_camera_rig * bundle.SeenPose(static_cast<size_t>(observation.frame),
                                            static_cast<size_t>(observation.camera));
  double predicted[kMaxObservationSize];
  if (!camera.model->project(
          camera.params.data(),
          camera.config.data(),
          observation.seen.values.data(),
          T_camera_target * bundle.markers[static_cast<size_t>(observation.marker)].position,
          predicted)) {
    return false;
  }
  for (size_t r = 0; r < camera.model->measured.size(); ++r) {
    residual[r] = observation.seen.values[r] - predicted[r];
    if (!std::isfinite(residual[r])) return false;
  }
  return true;
}

size_t EndOfMarker(const std::vector<BundleObservation>& observations, size_t begin) {
  const BundleObservation& first = observations[begin];
  size_t end = begin + 1;
  while (end < observations.size() && observations[end].frame == first.frame &&
         observations[end].camera == first.camera && observations[end].marker == first.marker) {
    ++end;
  }
  return end;
}

size_t EndOfView(const std::vector<BundleObservation>& observations, size_t begin) {
  const BundleObservation& first = observations[begin];
  size_t end = begin + 1;
  while (end < observations.size() && observations[end].frame == first.frame &&
         observations[end].camera == first.camera) {
    ++end;
  }
  return end;
}

double WeightedLength(const Bundle& bundle,
                      const BundleObservation& observation,
                      const double* residual) {
  const BundleCamera& camera = bundle.cameras[static_cast<size_t>(observation.camera)];
  double sum = 0;
  for (size_t r = 0; r < camera.model->measured.size(); ++r) sum += residual[r] * residual[r];
  return std::sqrt(sum) / NoiseSigma(camera, observation.seen);
}

namespace {

// Normal equations H delta = -g of a target pose, from observations in [begin, end). `width` is
// that of Huber's loss.
struct PoseEquations {
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
};

PoseEquations LinearisePose(const Bundle& bundle, size_t begin, size_t end, double width) {
  PoseEquations equations;
  std::vector<double> J_params;
  using J6 = Eigen::Matrix<double, kMaxObservationSize, 6, Eigen::RowMajor>;
  using Residual = Eigen::Matrix<double, kMaxObservationSize, 1>;
  for (size_t i = begin, of_marker = begin; i < end;) {
    const BundleCamera& camera = bundle.cameras[static_cast<size_t>(bundle.observations[i].camera)];
    const auto rows = static_cast<Eigen::Index>(camera.model->measured.size());
    J_params.resize(kMaxObservationSize * camera.params.size());
    J6 J, J_sum = J6::Zero();  // in own sigmas
    Residual r, r_sum = Residual::Zero();
    double information = 0;
    for (of_marker = EndOfMarker(bundle.observations, i); i < of_marker; ++i) {
      const BundleObservation& observation = bundle.observations[i];
      if (!observation.used) continue;
      if (!internal::Linearise(
              camera,
              camera.params.data(),
              {.T_camera_rig = camera.T_camera_rig,
               .T_rig_target = bundle.SeenPose(static_cast<size_t>(observation.frame),
                                               static_cast<size_t>(observation.camera))},
              bundle.markers[static_cast<size_t>(observation.marker)].position,
              observation.seen,
              {.residual = r.data(), .J_params = J_params.data(), .J_pose = J.data()})) {
        continue;
      }
      const double own = OwnNoiseSigma(camera, observation.seen);
      const double length = r.head(rows).norm() * own / NoiseSigma(camera, observation.seen);
      const double root = std::sqrt(width / std::max(length, width));
      J.topRows(rows) *= root;
      r.head(rows) *= root;
      equations.H.noalias() += J.topRows(rows).transpose().lazyProduct(J.topRows(rows));
      equations.g.noalias() += J.topRows(rows).transpose().lazyProduct(r.head(rows));
      J_sum.topRows(rows) += J.topRows(rows) * (root / own);
      r_sum.head(rows) += r.head(rows) * (root / own);
      information += root * root / (own * own);
    }
    const double common = internal::CommonShare(camera.common_noise, information);
    equations.H.noalias() -=
        common * J_sum.topRows(rows).transpose().lazyProduct(J_sum.topRows(rows));
    equations.g.noalias() -= common * J_sum.topRows(rows).transpose().lazyProduct(r_sum.head(rows));
  }
  return equations;
}

}  // namespace

void AdjustPoses(Bundle* bundle, const std::vector<bool>& frames) {
  constexpr int kSteps = 4;
  constexpr double kWidth = 3;
  const auto& observations = bundle->observations;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    const auto frame = static_cast<size_t>(observations[begin].frame);
    while (end < observations.size() && observations[end].frame == observations[begin].frame) ++end;
    if (!frames[frame]) continue;
    RigidTransform& T_rig_target = bundle->T_rig_target[frame];
    for (int step = 0; step < kSteps; ++step) {
      const PoseEquations equations = LinearisePose(*bundle, begin, end, kWidth);
      const Vector6d delta = -equations.H.ldlt().solve(equations.g);
      if (!delta.allFinite()) break;
      T_rig_target = Retract(T_rig_target, delta);
      if (delta.dot(equations.H * delta) < 1) break;  // less than a sigma; the adjustment goes on
    }
  }
}

std::vector<PoseStep> OwnPoseSteps(const Bundle& bundle) {
  constexpr double kNoLoss = 1e300;
  std::vector<PoseStep> steps;
  const auto& observations = bundle.observations;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    const BundleObservation& first = observations[begin];
    end = EndOfView(observations, begin);
    const PoseEquations equations = LinearisePose(bundle, begin, end, kNoLoss);
    const Eigen::LLT<Matrix6d> factor(equations.H);
    if (factor.info() != Eigen::Success) continue;
    const Vector6d delta = -factor.solve(equations.g);
    steps.push_back({first.frame, first.camera, delta, -delta.dot(equations.g)});
  }
  return steps;
}

Matrix6d JitterWeight(const Bundle& bundle, size_t frame) {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const BundleMarker& marker : bundle.markers) centre += marker.nominal;
  centre /= std::max(1.0, static_cast<double>(bundle.markers.size()));
  // The target's centre c moves by v + w x (R c).
  Matrix6d weight = Matrix6d::Zero();
  weight.topLeftCorner<3, 3>().setIdentity();
  weight.topRightCorner<3, 3>() = -Hat(bundle.T_rig_target[frame].R * centre);
  weight.topRows<3>() /= bundle.jitter.translation_sigma;
  weight.bottomRightCorner<3, 3>() = Eigen::Matrix3d::Identity() / bundle.jitter.rotation_sigma;
  return weight;
}

Matrix6d JitterWeight(const Bundle& bundle, size_t frame, size_t camera) {
  constexpr double kNoSay = 1e-3;  // of the weight; zero would leave a frame of one such view open
  return (bundle.jitter.misplaced[bundle.View(frame, camera)] ? kNoSay : 1.0) *
         JitterWeight(bundle, frame);
}

namespace {

// Holds the parameters of a block that are not to be estimated now.
void Hold(const IntrinsicsBlock& block, bool all, ceres::Problem* problem) {
  std::vector<int> held;
  for (size_t slot = 0; slot < block.values.size(); ++slot) {
    if (block.IsHeld(slot)) held.push_back(static_cast<int>(slot));
  }
  if (all || held.size() == block.values.size()) {
    problem->SetParameterBlockConstant(block.place);
    return;
  }
  problem->SetParameterBlockVariable(block.place);
  problem->SetManifold(
      block.place,
      held.empty() ? nullptr
                   : new ceres::SubsetManifold(static_cast<int>(block.values.size()), held));
}

// Active set of the bounds. When parameters have left them, goes back from `unknowns` towards
// `feasible` until the first of them is at its bound, and holds it there. Otherwise releases those
// held at bounds that would rather go inside. False when nothing remains to be done.
bool TakeBounds(const std::vector<IntrinsicsBlock*>& blocks,
                int pass,
                const std::vector<double>& feasible,
                std::vector<double>* unknowns,
                ceres::Problem* problem) {
  constexpr double kAll = 1;
  double part = kAll;
  IntrinsicsBlock* leaver = nullptr;
  size_t leaver_slot = 0, bounded = 0;
  for (IntrinsicsBlock* block : blocks) {
    for (size_t slot = 0; slot < block->values.size(); ++slot) {
      const double value = block->place[slot];
      if (std::isfinite(block->lower[slot]) || std::isfinite(block->upper[slot])) ++bounded;
      if (block->IsHeld(slot) || (value >= block->lower[slot] && value <= block->upper[slot])) {
        continue;
      }
      const double before = feasible[static_cast<size_t>(block->place - unknowns->data()) + slot];
      const double bound = std::clamp(value, block->lower[slot], block->upper[slot]);
      const double until = (bound - before) / (value - before);
      if (leaver != nullptr && until >= part) continue;
      part = until;
      leaver = block;
      leaver_slot = slot;
    }
  }
  if (leaver != nullptr) {
    const double bound = std::clamp(
        leaver->place[leaver_slot], leaver->lower[leaver_slot], leaver->upper[leaver_slot]);
    for (size_t i = 0; i < unknowns->size(); ++i) {
      (*unknowns)[i] = feasible[i] + part * ((*unknowns)[i] - feasible[i]);
    }
    leaver->place[leaver_slot] = bound;
    leaver->at_bound[leaver_slot] = true;
    return true;
  }
  // Each bound is taken and given up a few times at most; rounding could go on for ever.
  if (pass > 2 * static_cast<int>(bounded)) return false;
  bool released = false;
  for (IntrinsicsBlock* block : blocks) {
    if (std::find(block->at_bound.begin(), block->at_bound.end(), true) == block->at_bound.end()) {
      continue;
    }
    problem->SetParameterBlockVariable(block->place);
    problem->SetManifold(block->place, nullptr);
    ceres::Problem::EvaluateOptions evaluate;
    evaluate.parameter_blocks = {block->place};
    std::vector<double> gradient;
    problem->Evaluate(evaluate, nullptr, nullptr, &gradient, nullptr);
    for (size_t slot = 0; slot < block->values.size(); ++slot) {
      if (!block->at_bound[slot]) continue;
      const bool at_lower = block->place[slot] == block->lower[slot];
      if (at_lower ? gradient[slot] < 0 : gradient[slot] > 0) {
        block->at_bound[slot] = false;
        released = true;
      }
    }
  }
  return released;
}

}  // namespace

AdjustSummary Adjust(Bundle* bundle, const AdjustOptions& options) {
  const bool free_markers = bundle->marker_sigma > 0;
  const bool free_jitter = bundle->jitter.translation_sigma > 0;

  // All unknowns in one array: Ceres orders the blocks of a group by their addresses, and the same
  // input must give the same order.
  const size_t block_count = (bundle->markers.size() + kMarkersPerBlock - 1) / kMarkersPerBlock;
  size_t size =
      6 * (bundle->T_rig_target.size() + bundle->cameras.size() + bundle->jitter.delta.size()) +
      kMarkerBlockSize * block_count;  // the last block may have a spare marker
  std::deque<IntrinsicsBlock> blocks;
  const std::vector<Intrinsics> intrinsics = MakeIntrinsics(*bundle, &blocks);
  for (const IntrinsicsBlock& block : blocks) size += block.values.size();
  std::vector<double> unknowns(size, 0.0);
  double* free_place = unknowns.data();
  const auto take = [&](size_t count) { return std::exchange(free_place, free_place + count); };

  std::vector<ChartedPose> poses, mounts;
  for (const RigidTransform& T : bundle->T_rig_target) poses.push_back({T, take(6)});
  for (size_t c = 0; c < bundle->cameras.size(); ++c) {
    mounts.push_back({bundle->cameras[c].T_camera_rig, take(6)});
    IntrinsicsBlock& block = *intrinsics[c].block;
    if (block.place != nullptr) continue;
    block.place = take(block.values.size());
    std::copy(block.values.begin(), block.values.end(), block.place);
  }
  double* const jitter = take(6 * bundle->jitter.delta.size());
  for (size_t i = 0; i < bundle->jitter.delta.size(); ++i) {
    Eigen::Map<Vector6d>(jitter + 6 * i) = bundle->jitter.delta[i];
  }
  double* const markers = take(kMarkerBlockSize * block_count);
  std::vector<double> nominal(kMarkerBlockSize * block_count, 0.0);
  for (size_t i = 0; i < bundle->markers.size(); ++i) {
    Eigen::Map<Eigen::Vector3d>(markers + 3 * i) = bundle->markers[i].position;
    Eigen::Map<Eigen::Vector3d>(nominal.data() + 3 * i) = bundle->markers[i].nominal;
  }

  ceres::Problem::Options problem_options;
  problem_options.enable_fast_removal = false;
  problem_options.disable_all_safety_checks = true;
  ceres::Problem problem(problem_options);
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();

  std::vector<bool> block_used(block_count, false);
  std::vector<bool> camera_used(bundle->cameras.size(), false);
  std::vector<bool> view_used(bundle->jitter.delta.size(), false);
  std::vector<bool> frame_used(bundle->T_rig_target.size(), false);
  const auto& observations = bundle->observations;
  std::vector<const BundleObservation*> group;
  for (size_t begin = 0; begin < observations.size();) {
    const BundleObservation& first = observations[begin];
    const auto block = static_cast<size_t>(first.marker / kMarkersPerBlock);
    group.clear();
    size_t end = begin;
    for (; end < observations.size(); ++end) {
      const BundleObservation& next = observations[end];
      if (next.frame != first.frame || next.camera != first.camera ||
          static_cast<size_t>(next.marker / kMarkersPerBlock) != block) {
        break;
      }
      if (next.used) group.push_back(&next);
    }
    begin = end;
    if (group.empty()) continue;

    const auto camera_index = static_cast<size_t>(first.camera);
    const BundleCamera& camera = bundle->cameras[camera_index];
    ChartedPose& pose = poses[static_cast<size_t>(first.frame)];
    ChartedPose* mount = camera.is_master ? nullptr : &mounts[camera_index];
    std::vector<double*> places{intrinsics[camera_index].block->place};
    if (mount != nullptr) places.push_back(mount->delta);
    places.push_back(pose.delta);
    if (free_jitter) {
      const size_t view = bundle->View(static_cast<size_t>(first.frame), camera_index);
      places.push_back(jitter + 6 * view);
      view_used[view] = true;
    }
    if (free_markers) places.push_back(markers + block * kMarkerBlockSize);
    problem.AddResidualBlock(new ViewCost(camera,
                                          intrinsics[camera_index],
                                          mount,
                                          pose,
                                          free_jitter,
                                          group,
                                          *bundle,
                                          free_markers,
                                          options),
                             nullptr,
                             places);
    frame_used[static_cast<size_t>(first.frame)] = true;
    camera_used[camera_index] = true;
    if (free_markers) block_used[block] = true;
  }

  // What is eliminated first must not share residuals: the jitter of the views when there is any,
  // else the poses; or the markers, where they are more unknowns. The rest is small and dense.
  const auto count = [](const std::vector<bool>& used) {
    return static_cast<size_t>(std::count(used.begin(), used.end(), true));
  };
  const size_t pose_unknowns = 6 * count(frame_used), jitter_unknowns = 6 * count(view_used);
  const size_t marker_unknowns = kMarkerBlockSize * count(block_used);
  const size_t many_unknowns = free_jitter ? jitter_unknowns : pose_unknowns;
  const bool markers_first = marker_unknowns > many_unknowns;
  size_t dense_unknowns = pose_unknowns + jitter_unknowns + marker_unknowns -
                          (markers_first ? marker_unknowns : many_unknowns);
  for (size_t frame = 0; frame < poses.size(); ++frame) {
    if (!frame_used[frame]) continue;
    ordering->AddElementToGroup(poses[frame].delta, free_jitter || markers_first ? 1 : 0);
    for (size_t c = 0; free_jitter && c < bundle->cameras.size(); ++c) {
      const size_t view = bundle->View(frame, c);
      if (!view_used[view]) continue;
      problem.AddResidualBlock(
          new JitterPrior(JitterWeight(*bundle, frame, c)), nullptr, jitter + 6 * view);
      ordering->AddElementToGroup(jitter + 6 * view, markers_first ? 1 : 0);
    }
  }
  std::vector<IntrinsicsBlock*> used_blocks;
  for (size_t i = 0; i < bundle->cameras.size(); ++i) {
    if (!camera_used[i]) continue;
    IntrinsicsBlock& block = *intrinsics[i].block;
    if (std::find(used_blocks.begin(), used_blocks.end(), &block) == used_blocks.end()) {
      used_blocks.push_back(&block);
      ordering->AddElementToGroup(block.place, 1);
      dense_unknowns += block.values.size();
      for (size_t p = 0; p < block.priors.size(); ++p) {
        problem.AddResidualBlock(
            new ParamPriorCost(
                static_cast<int>(block.values.size()), block.prior_slots[p], block.priors[p]),
            nullptr,
            block.place);
      }
    }
    if (!bundle->cameras[i].is_master) ordering->AddElementToGroup(mounts[i].delta, 1);
    dense_unknowns += 6;
  }
  for (size_t block = 0; block < block_count; ++block) {
    if (!block_used[block]) continue;
    double* data = markers + block * kMarkerBlockSize;
    const size_t first = block * kMarkersPerBlock;
    const size_t in_block = std::min<size_t>(kMarkersPerBlock, bundle->markers.size() - first);
    problem.AddResidualBlock(new MarkerPrior(nominal.data() + block * kMarkerBlockSize,
                                             static_cast<int>(3 * in_block),
                                             bundle->marker_sigma),
                             nullptr,
                             data);
    if (in_block < kMarkersPerBlock) {
      std::vector<int> spare;
      for (int i = static_cast<int>(3 * in_block); i < kMarkerBlockSize; ++i) spare.push_back(i);
      problem.SetManifold(data, new ceres::SubsetManifold(kMarkerBlockSize, spare));
    }
    ordering->AddElementToGroup(data, markers_first ? 0 : 1);
  }

  ceres::Solver::Options solver;
  solver.linear_solver_type =
      dense_unknowns <= kMaxDenseUnknowns ? ceres::DENSE_SCHUR : ceres::SPARSE_SCHUR;
  // Which parameters of a local model a point depends on changes on the way, so that no blocks of
  // unknowns can state it.
  const bool local = std::any_of(bundle->cameras.begin(), bundle->cameras.end(), [](const auto& c) {
    return c.model->local && std::find(c.fixed.begin(), c.fixed.end(), false) != c.fixed.end();
  });
  if (local && !options.hold_intrinsics) {
    solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    solver.dynamic_sparsity = true;
  }
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  solver.max_num_iterations = options.max_iterations;
  solver.function_tolerance = options.cost_tolerance;
  solver.gradient_tolerance = 1e-14;
  solver.parameter_tolerance = 1e-13;
  solver.initial_trust_region_radius = 1e6;
  IterationReport report(options);
  solver.callbacks.push_back(&report);

  AdjustSummary summary;
  std::vector<double> feasible = unknowns;
  for (int pass = 0;; ++pass) {
    for (IntrinsicsBlock* block : used_blocks) Hold(*block, options.hold_intrinsics, &problem);
    // The solver takes blocks that are held out of the ordering that it is given.
    solver.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>(*ordering);
    ceres::Solver::Summary solved;
    ceres::Solve(solver, &problem, &solved);
    summary.usable = solved.IsSolutionUsable();
    summary.converged = solved.termination_type == ceres::CONVERGENCE;
    summary.stopped = solved.termination_type == ceres::USER_FAILURE;
    summary.iterations += static_cast<int>(solved.iterations.size());
    if (pass == 0) summary.cost_before = solved.initial_cost;
    summary.cost = solved.final_cost;
    summary.message = solved.message;
    if (!summary.usable) return summary;
    if (!TakeBounds(used_blocks, pass, feasible, &unknowns, &problem)) break;
    feasible = unknowns;
  }

  for (size_t i = 0; i < bundle->cameras.size(); ++i) {
    BundleCamera& camera = bundle->cameras[i];
    camera.at_bound.assign(camera.rules.empty() ? 0 : camera.params.size(), false);
    for (size_t k = 0; k < camera.params.size(); ++k) {
      const size_t slot = intrinsics[i].slots.empty() ? k : intrinsics[i].slots[k];
      if (slot == kNoSlot) continue;
      camera.params[k] = intrinsics[i].block->place[slot];
      if (!camera.rules.empty()) camera.at_bound[k] = intrinsics[i].block->at_bound[slot];
    }
    camera.T_camera_rig = mounts[i].Value();
  }
  for (size_t i = 0; i < poses.size(); ++i) bundle->T_rig_target[i] = poses[i].Value();
  for (size_t i = 0; i < bundle->jitter.delta.size(); ++i) {
    bundle->jitter.delta[i] = Eigen::Map<const Vector6d>(jitter + 6 * i);
  }
  if (free_markers) {
    for (size_t i = 0; i < bundle->markers.size(); ++i) {
      bundle->markers[i].position = Eigen::Map<const Eigen::Vector3d>(markers + 3 * i);
    }
  }
  return summary;
}

}  // namespace plenocal
