// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/rows.h"

#include <algorithm>
#include <cmath>

#include "calib/camera/rays.h"

namespace plenocal::internal {
namespace {

// Spreads rows of derivatives by the model's parameters so that each is followed by those by the
// nuisance parameters that displace measured coordinates; zeros for the others.
void AppendNuisances(const BundleCamera& camera,
                     const BundleObservation& observation,
                     double weight,
                     double* J_params) {
  const size_t rows = camera.model->measured.size(), own = camera.ModelParams();
  const size_t width = camera.params.size();
  for (size_t r = rows; r-- > 0;) {
    double* const row = J_params + r * width;
    if (r > 0) std::copy_backward(J_params + r * own, J_params + (r + 1) * own, row + own);
    std::fill(row + own, row + width, 0.0);
  }
  size_t index = 0;  // in the kind; counting is slow where there are many
  for (size_t k = 0; k < camera.nuisances.size(); ++k) {
    const bool same = k > 0 && camera.nuisances[k] == camera.nuisances[k - 1];
    index = same ? index + 1 : camera.IndexInKind(k);
    if (camera.nuisances[k]->displace == nullptr) continue;
    double displacement[kMaxObservationSize] = {};
    camera.nuisances[k]->displace(observation, index, rows, -weight, displacement);
    for (size_t r = 0; r < rows; ++r) J_params[r * width + own + k] = displacement[r];
  }
}

// Factor on a residual of length `s` (in sigmas), with its derivative to s^2.
struct RobustFactor {
  double factor = 1;
  double derivative = 0;  // d factor / d (s^2)
};

RobustFactor RobustFactorOf(const RobustLoss& robust, double s2) {
  const double width = robust.width;
  if (robust.loss == Loss::kHuber && s2 > width * width) {
    const double s = std::sqrt(s2);
    if (robust.reweights) return {std::sqrt(width / s), 0};
    // rho = 2 k s - k^2
    const double rho = 2 * width * s - width * width;
    const double factor = std::sqrt(rho / s2);
    return {factor, (width / (s * s2) - rho / (s2 * s2)) / (2 * factor)};
  }
  constexpr double kSmall = 1e-8;  // parts of k^2 below which Cauchy's loss is the square
  if (robust.loss == Loss::kCauchy && s2 > kSmall * width * width) {
    // rho = k^2 log(1 + s^2 / k^2)
    const double q = s2 / (width * width);
    const double factor = std::sqrt(std::log1p(q) / q);
    return {factor, (1 / (s2 * (1 + q)) - std::log1p(q) / (q * s2)) / (2 * factor)};
  }
  return {};
}

// A point in the frames on its way to the camera.
struct SeenPoint {
  SeenPoint(const LinearisedView& view, const Eigen::Vector3d& p_target)
      : rotated(view.T_rig_target.R * p_target),
        rotated_rig(view.T_camera_rig.R * (rotated + view.T_rig_target.t)),
        p_cam(rotated_rig + view.T_camera_rig.t) {}

  Eigen::Vector3d rotated, rotated_rig, p_cam;
};

struct ProjectedPoint {
  const double* predicted = nullptr;
  const double* J_point = nullptr;
};

// Turns a projection into a residual with derivatives in sigmas; `out.J_params` has those of the
// projection by the model's parameters.
void SetRows(const BundleCamera& camera,
             const LinearisedView& view,
             const SeenPoint& point,
             const BundleObservation& observation,
             const ProjectedPoint& projected,
             const LinearisedRows& out) {
  const CameraModel& model = *camera.model;
  const Observation seen = WithoutDisplacement(observation, camera);
  const size_t rows = model.measured.size();
  const double weight = 1 / camera.noise.OwnSigma(observation.assumed_sigma);
  for (size_t r = 0; r < rows; ++r)
    out.residual[r] = weight * (seen.values[r] - projected.predicted[r]);
  if (!out.HasDerivatives()) return;

  // Residual = measured - predicted, so every derivative is minus that of the prediction. With a
  // rotation by w before the point: row (-Hat(a)) = (a x row)'.
  if (out.J_params != nullptr) {
    for (size_t i = 0; i < rows * model.params.size(); ++i) out.J_params[i] *= -weight;
    if (!camera.nuisances.empty()) AppendNuisances(camera, observation, weight, out.J_params);
  }
  for (size_t r = 0; r < rows; ++r) {
    const Eigen::Vector3d J_cam =
        -weight * Eigen::Map<const Eigen::Vector3d>(projected.J_point + 3 * r);
    const Eigen::Vector3d J_rig = view.T_camera_rig.R.transpose() * J_cam;
    Vector6d J_pose;
    J_pose << J_rig, point.rotated.cross(J_rig);
    if (out.J_extrinsics != nullptr) {
      Eigen::Map<Eigen::Vector3d>(out.J_extrinsics + 6 * r) = J_cam;
      Eigen::Map<Eigen::Vector3d>(out.J_extrinsics + 6 * r + 3) = point.rotated_rig.cross(J_cam);
    }
    if (out.J_pose != nullptr) Eigen::Map<Vector6d>(out.J_pose + 6 * r) = J_pose;
    if (out.J_marker != nullptr) {
      Eigen::Map<Eigen::Vector3d>(out.J_marker + 3 * r) = view.T_rig_target.R.transpose() * J_rig;
    }
    if (out.J_params == nullptr) continue;
    for (size_t k = 0; k < view.by_nuisance.size(); ++k) {
      out.J_params[r * camera.params.size() + model.params.size() + k] +=
          J_pose.dot(view.by_nuisance[k]);
    }
  }
}

}  // namespace

// R = Exp(w_jitter) Exp(w_motion) Exp(w_pose) R_0: a change of w_pose is rotated by what is left of
// it.
ViewCharts ChartsOf(const BundleState& bundle, size_t frame, size_t camera) {
  ViewCharts charts;
  auto pose = charts.pose.bottomRightCorner<3, 3>();
  if (!bundle.motion.empty()) {
    pose = ExpRotation(bundle.MotionIncrement(frame, camera).tail<3>());
  }
  if (!bundle.jitter.delta.empty()) {
    const Vector6d& jitter = bundle.jitter.delta[bundle.View(frame, camera)];
    pose = (ExpRotation(jitter.tail<3>()) * pose).eval();
    charts.jitter.bottomRightCorner<3, 3>() = LeftJacobian(jitter.tail<3>());
  }
  return charts;
}

LinearisedView ViewOf(const BundleState& bundle, size_t frame, size_t camera) {
  const BundleCamera& of = bundle.cameras[camera];
  LinearisedView view{.T_camera_rig = of.T_camera_rig,
                      .T_rig_target = bundle.SeenPose(frame, camera)};
  if (bundle.motion.empty()) return view;
  Eigen::Matrix3d chart = LeftJacobian(bundle.MotionIncrement(frame, camera).tail<3>());
  if (!bundle.jitter.delta.empty()) {
    chart = ExpRotation(bundle.jitter.delta[bundle.View(frame, camera)].tail<3>()) * chart;
  }
  for (const NuisanceKind* kind : of.nuisances) {
    Vector6d rate = Vector6d::Zero();
    if (kind->pose_rate != nullptr)
      rate = kind->pose_rate(bundle.motion[bundle.View(frame, camera)]);
    rate.tail<3>() = (chart * rate.tail<3>()).eval();
    view.by_nuisance.push_back(rate);
  }
  return view;
}

bool Linearise(const BundleCamera& camera,
               const LinearisedView& view,
               const Eigen::Vector3d& p_target,
               const BundleObservation& observation,
               const LinearisedRows& out) {
  const SeenPoint point(view, p_target);
  const CameraModel& model = *camera.model;
  const Observation seen = WithoutDisplacement(observation, camera);
  double predicted[kMaxObservationSize];
  double J_point[kMaxObservationSize * 3];
  const bool inside =
      out.HasDerivatives()
          ? model.ProjectWithJacobian(
                camera.params.data(),
                camera.config.data(),
                seen.values.data(),
                point.p_cam,
                {.predicted = predicted, .J_params = out.J_params, .J_point = J_point})
          : model.Project(camera.params.data(),
                          camera.config.data(),
                          seen.values.data(),
                          point.p_cam,
                          predicted);
  if (inside) SetRows(camera, view, point, observation, {predicted, J_point}, out);
  return inside;
}

MarkerRows::MarkerRows(const BundleCamera& camera, const RowColumns& columns)
    : camera_(camera),
      columns_(columns),
      rows_(static_cast<Eigen::Index>(camera.model->measured.size())),
      width_(static_cast<Eigen::Index>(camera.params.size())) {}

LinearisedRows MarkerRows::Next() {
  const auto next = [&](bool wanted, Eigen::Index width, std::vector<double>* data) -> double* {
    const auto size = static_cast<size_t>((count_ + rows_) * width);
    if (!wanted) return nullptr;
    if (data->size() < size) data->resize(2 * size);
    return data->data() + count_ * width;
  };
  return {.residual = next(true, 1, &residual_),
          .J_params = next(columns_.params, width_, &params_),
          .J_extrinsics = next(columns_.extrinsics, 6, &extrinsics_),
          .J_pose = next(columns_.pose, 6, &pose_),
          .J_marker = next(columns_.marker, 3, &position_)};
}

void MarkerRows::Prepare(const LinearisedView& view,
                         std::span<const BundleObservation> of_view,
                         std::span<const BundleMarker> markers) {
  const CameraModel& model = *camera_.model;
  if (model.functions.project_block == nullptr) return;
  prepared_ = of_view;
  const size_t count = of_view.size(), rows = model.measured.size();
  points_.Set(camera_, view.T_camera_rig * view.T_rig_target, of_view, markers);
  predicted_.resize(rows * count);
  J_params_.resize(columns_.params ? rows * model.params.size() * count : 0);
  J_point_.resize(columns_.Any() ? 3 * rows * count : 0);
  const auto wanted = [](std::vector<double>& J) { return J.empty() ? nullptr : J.data(); };
  ProjectPoints(
      model,
      camera_.params.data(),
      camera_.config.data(),
      points_.Block(),
      {.predicted = predicted_.data(), .J_params = wanted(J_params_), .J_point = wanted(J_point_)});
}

bool MarkerRows::Linearise(const LinearisedView& view,
                           const Eigen::Vector3d& p_target,
                           const BundleObservation& observation,
                           const LinearisedRows& out) const {
  if (prepared_.empty()) return internal::Linearise(camera_, view, p_target, observation, out);
  const auto place = static_cast<size_t>(&observation - prepared_.data());
  const size_t rows = camera_.model->measured.size(), width = rows * camera_.model->params.size();
  const double* const predicted = predicted_.data() + rows * place;
  if (!std::isfinite(*predicted)) return false;
  if (out.J_params != nullptr) {
    std::copy_n(J_params_.data() + width * place, width, out.J_params);
  }
  const double* const J_point = J_point_.empty() ? nullptr : J_point_.data() + 3 * rows * place;
  SetRows(camera_, view, SeenPoint(view, p_target), observation, {predicted, J_point}, out);
  return true;
}

bool MarkerRows::Load(const LinearisedView& view,
                      const Eigen::Vector3d& p_target,
                      std::span<const BundleObservation> of_marker,
                      const RobustLoss& loss) {
  marker_ = of_marker.front().marker;
  count_ = 0;
  inverse_sigma_.clear();
  bool complete = true;
  for (const BundleObservation& observation : of_marker) {
    if (!observation.used) continue;
    const LinearisedRows out = Next();
    if (!Linearise(view, p_target, observation, out)) {
      // Within rounding of the edge of the domain, where a step has ended, derivatives may not
      // exist although the residual does; the point then does not count for the next step.
      if (!out.HasDerivatives() ||
          !internal::Linearise(camera_, view, p_target, observation, {.residual = out.residual})) {
        complete = false;
        continue;
      }
      if (out.J_params != nullptr) std::fill_n(out.J_params, rows_ * width_, 0.0);
      if (out.J_extrinsics != nullptr) std::fill_n(out.J_extrinsics, rows_ * 6, 0.0);
      if (out.J_pose != nullptr) std::fill_n(out.J_pose, rows_ * 6, 0.0);
      if (out.J_marker != nullptr) std::fill_n(out.J_marker, rows_ * 3, 0.0);
    }
    const double weight =
        loss.loss == Loss::kNone ? 1 : Robustify(loss, observation.assumed_sigma, out);
    inverse_sigma_.push_back(weight / camera_.noise.OwnSigma(observation.assumed_sigma));
    count_ += rows_;
  }
  if (camera_.noise.common_sigma > 0 && count_ > 0) Whiten();
  return complete;
}

// Scales an observation's residual r so that half its square is the loss, r' = f(s^2) r, and its
// derivatives accordingly: J' = (f I + 2 f' r r') J, where s is the length of r in sigmas of all
// noise. Applied to the residual itself, not by ceres::LossFunction, because that acts on whole
// residual blocks and one block holds several observations.
double MarkerRows::Robustify(const RobustLoss& loss,
                             double assumed_sigma,
                             const LinearisedRows& rows) const {
  Eigen::Map<Eigen::VectorXd> r(rows.residual, rows_);
  const double part = camera_.noise.OwnSigma(assumed_sigma) / camera_.noise.Sigma(assumed_sigma);
  RobustFactor robust = RobustFactorOf(loss, part * part * r.squaredNorm());
  robust.derivative *= part * part;
  if (robust.factor == 1 && robust.derivative == 0) return 1;
  const auto scale = [&](double* J, Eigen::Index columns) {
    for (Eigen::Index c = 0; J != nullptr && c < columns; ++c) {
      Eigen::Map<Eigen::VectorXd, 0, Eigen::InnerStride<>> column(
          J + c, rows_, Eigen::InnerStride<>(columns));
      const double along = r.dot(column);
      column = robust.factor * column + 2 * robust.derivative * along * r;
    }
  };
  scale(rows.J_params, width_);
  scale(rows.J_extrinsics, 6);
  scale(rows.J_pose, 6);
  scale(rows.J_marker, 3);
  r *= robust.factor;
  return loss.reweights ? robust.factor : 1;
}

// Multiplies the rows by the inverse root of their covariance under common noise t: with
// u_i = 1 / sigma_i it is I - (1 - 1 / sqrt(1 + t^2 |u|^2)) u u' / |u|^2 (from Sherman, Morrison).
void MarkerRows::Whiten() {
  const Eigen::Map<const Eigen::VectorXd> u(inverse_sigma_.data(), std::ssize(inverse_sigma_));
  const double information = u.squaredNorm(), common = camera_.noise.common_sigma;
  const double part = (1 - 1 / std::sqrt(1 + common * common * information)) / information;
  const auto whiten = [&](std::vector<double>* data, Eigen::Index width) {
    // One row an observation: its rows side by side.
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> rows(
        data->data(), u.size(), rows_ * width);
    const Eigen::RowVectorXd along = u.transpose() * rows;
    rows.noalias() -= part * u * along;
  };
  whiten(&residual_, 1);
  if (columns_.params) whiten(&params_, width_);
  if (columns_.extrinsics) whiten(&extrinsics_, 6);
  if (columns_.pose) whiten(&pose_, 6);
  if (columns_.marker) whiten(&position_, 3);
}

Matrix6d MarkerRows::PoseInformationOfMean() const {
  const Eigen::Map<const Eigen::VectorXd> u(inverse_sigma_.data(), std::ssize(inverse_sigma_));
  Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::RowMajor> sum(rows_, 6);
  sum.setZero();
  for (Eigen::Index i = 0; i < u.size(); ++i) sum += u[i] * Pose().middleRows(i * rows_, rows_);
  return sum.transpose().lazyProduct(sum) / u.squaredNorm();
}

}  // namespace plenocal::internal
