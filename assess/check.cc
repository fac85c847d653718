// SPDX-License-Identifier: Apache-2.0
#include "assess/check.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include "calib/adjust/solver/adjust.h"
#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"
#include "calib/estimate/describe.h"
#include "calib/estimate/fit.h"
#include "calib/noise/matrix_root.h"

namespace plenocal {
namespace {

constexpr double kCheckLevel = 0.01;

// Gives the input the old cameras; those parameters that were fixed then are fixed now.
void TakeCameras(const CalibrationRecord& old,
                 std::vector<const CalibratedCamera*>* cameras,
                 CalibrationInput* input) {
  for (CameraInput& camera : input->cameras) {
    const bool single = old.cameras.size() == 1 && input->cameras.size() == 1;
    const std::string name = single ? "" : camera.name;
    const CalibratedCamera& was = FindCamera(old, name);
    if (was.image_size != camera.image_size) {
      throw InputError("{}: {} is calibrated for images of {} x {} px, the new ones are {} x {}",
                       old.path.string(),
                       was.name,
                       was.image_size[0],
                       was.image_size[1],
                       camera.image_size[0],
                       camera.image_size[1]);
    }
    if (!std::ranges::equal(was.model->measured, camera.model->measured) ||
        !std::ranges::equal(was.model->context, camera.model->context)) {
      throw InputError(
          "{}: the session's model for {}, {}, does not measure in an image what the "
          "calibration's does ({})",
          old.path.string(),
          camera.name,
          camera.model->name,
          was.model->name);
    }
    const bool has_sigmas = was.covariance.diagonal().maxCoeff() > 0;
    camera.model = was.model;
    camera.config = was.config;
    camera.rules.clear();
    camera.initial.assign(was.params.begin(), was.params.end());
    camera.fixed.clear();
    for (Eigen::Index i = 0; i < was.covariance.rows(); ++i) {
      camera.fixed.push_back(has_sigmas && was.covariance(i, i) == 0);
    }
    cameras->push_back(&was);
  }
}

// The sum of squares at the least-squares optimum.
double SumOfSquares(Bundle* bundle) {
  AdjustOptions options;
  options.cost_tolerance = 1e-12;
  const AdjustSummary summary = Adjust(bundle, options);
  if (!summary.usable) throw Error(ErrorKind::kJob, "the check failed: " + summary.message);
  return 2 * summary.cost;
}

// The old covariance of what is estimated now, with large variances for infinite ones.
Eigen::MatrixXd OldCovariance(const CalibratedCamera& was, const std::vector<int>& free) {
  constexpr double kManySizes = 10;
  Eigen::MatrixXd C = was.covariance(free, free);
  for (Eigen::Index i = 0; i < C.rows(); ++i) {
    const auto k = static_cast<size_t>(free[static_cast<size_t>(i)]);
    const double size = std::max(std::abs(was.params[k]), was.model->params[k].scale);
    if (std::isinf(C(i, i))) C(i, i) = std::pow(kManySizes * size, 2);
  }
  return C;
}

void RefuseOpen(const Calibration& fresh) {
  std::vector<std::string> names;
  for (size_t c = 0; c < fresh.bundle.cameras.size(); ++c) {
    const BundleCamera& camera = fresh.bundle.cameras[c];
    for (size_t k = 0; k < fresh.uncertainty.param_std_errors[c].size(); ++k) {
      if (!std::isinf(fresh.uncertainty.param_std_errors[c][k])) continue;
      names.push_back(fmt::format("{}.{}", camera.name, camera.model->params[k].name));
    }
  }
  if (names.empty()) return;
  throw JobError(
      "the new images are too few to check a calibration: they tell nothing "
      "of {}; add images from other distances and at other tilts",
      fmt::join(names, ", "));
}

// Factor by which per-frame systematic errors increase variances over those of independent errors:
// jackknife over frames against covariance, mean over the parameters.
double Common(const std::vector<double>& sigma, const std::vector<double>& by_jackknife) {
  double sum = 0, count = 0;
  for (size_t k = 0; k < sigma.size(); ++k) {
    if (!(sigma[k] > 0) || !std::isfinite(by_jackknife[k])) continue;
    sum += std::pow(by_jackknife[k] / sigma[k], 2);
    count += 1;
  }
  return count > 0 ? std::max(1.0, sum / count) : 1;
}

// Weights of the chi-squares whose sum is the difference of the sums of squares in units of the
// noise. The old covariance includes per-frame systematic errors; the new one does not and is
// `common` times as large.
Eigen::VectorXd Weights(const Eigen::MatrixXd& C_new, const Eigen::MatrixXd& C_old, double common) {
  const Eigen::MatrixXd root = InverseRoot(C_new);
  const Eigen::MatrixXd M = root.transpose() * C_old * root;
  if (M.rows() == 0) return {};
  return DecomposeSymmetric(M).values.cwiseMax(0).array() + common;
}

// The old calibration against a new one of the same observations, with all its parts.
class Check {
 public:
  Check(const CalibrationRecord& old, CalibrationInput input, const CalibrationOptions& options)
      : old_(old), options_(options) {
    TakeCameras(old, &cameras_, &input);
    check_.fresh = Calibrate(input, options);
    check_.frames = static_cast<int>(check_.fresh.frames.size());
  }

  CalibrationCheck Run() {
    for (size_t c = 0; c < cameras_.size(); ++c) with_old_.push_back(WithOldParameters(c));
    for (size_t c = 0; c < cameras_.size(); ++c) DropWhatTheOldDoesNotImage(c);
    squares_free_ = SumOfSquares(&Free());
    check_.fresh.uncertainty = EstimateUncertainty(Free());
    RefuseOpen(check_.fresh);
    const std::vector<double>& redundancy = check_.fresh.uncertainty.redundancy;
    noise_variance_ = squares_free_ / std::accumulate(redundancy.begin(), redundancy.end(), 0.0);
    jackknife_ = EstimateByJackknife(
        Free(), {.loss = Loss::kNone, .threads = options_.threads, .progress = [&](size_t, size_t) {
                   return !options_.progress || options_.progress("jackknife over the new frames");
                 }});
    // Parameters of each camera, extrinsics of all but the master.
    const size_t tests = 2 * cameras_.size() - 1;
    const double limit = check_.level = kCheckLevel / static_cast<double>(tests);
    for (size_t c = 0; c < cameras_.size(); ++c) {
      CameraCheck camera = CheckCamera(c);
      camera.valid = camera.probability >= limit && camera.extrinsics_probability >= limit;
      check_.valid = check_.valid && camera.valid;
      check_.cameras.push_back(camera);
    }
    return std::move(check_);
  }

 private:
  // The new calibration, with all parameters free.
  Bundle& Free() { return check_.fresh.bundle; }

  // The same with the old parameters of one camera.
  Bundle WithOldParameters(size_t c) {
    Bundle bundle = Free();
    bundle.cameras[c].params = cameras_[c]->params;
    bundle.cameras[c].fixed.assign(cameras_[c]->params.size(), true);
    return bundle;
  }

  // Points that the old parameters do not image count for neither calibration.
  void DropWhatTheOldDoesNotImage(size_t c) {
    int unseen = 0, seen = 0;
    for (BundleObservation& observation : Free().observations) {
      if (observation.camera != static_cast<int>(c) || !observation.used) continue;
      double residual[kMaxObservationSize];
      observation.used = Residual(with_old_[c], observation, residual);
      ++(observation.used ? seen : unseen);
    }
    if (unseen <= seen) return;
    throw JobError(
        "{}: {} of {} points are outside what the calibration of {} images; it "
        "is of another camera",
        old_.path.string(),
        unseen,
        unseen + seen,
        cameras_[c]->name);
  }

  CameraCheck CheckCamera(size_t c) {
    Bundle& fixed = with_old_[c];
    for (size_t i = 0; i < fixed.observations.size(); ++i) {
      fixed.observations[i].used = Free().observations[i].used;
    }
    const double squares_fixed = SumOfSquares(&fixed);
    const double common =
        Common(check_.fresh.uncertainty.param_std_errors[c], jackknife_.param_std_errors[c]);
    CameraCheck camera;
    camera.name = cameras_[c]->name;
    const CameraFit free = MeasureFit(Free(), c, {});
    camera.points = free.points;
    camera.rms_free = free.rms;
    camera.rms_held = MeasureFit(fixed, c, {}).rms;
    TestParameters(c, std::max(0.0, squares_fixed - squares_free_), common, &camera);
    if (c > 0) TestExtrinsics(c, fixed, common, &camera);
    return camera;
  }

  // Extra-sum-of-squares test of the old parameters.
  void TestParameters(size_t c, double gap, double common, CameraCheck* camera) const {
    std::vector<int> estimated;
    for (size_t k = 0; k < cameras_[c]->params.size(); ++k) {
      if (check_.fresh.uncertainty.param_index[c][k] >= 0) estimated.push_back(static_cast<int>(k));
    }
    const Eigen::MatrixXd C_new = DescribeCamera(check_.fresh, c).covariance(estimated, estimated);
    const Eigen::VectorXd weights = Weights(C_new, OldCovariance(*cameras_[c], estimated), common);
    if (weights.size() == 0 || !(noise_variance_ > 0)) return;
    const double sum = weights.sum();
    camera->probability = FTail(
        gap / sum / noise_variance_, sum * sum / weights.squaredNorm(), jackknife_.groups - 1);
    // The squares of this camera's residuals, in px, are as many times the noise as all are.
    camera->expected = camera->rms_free * std::sqrt(1 + sum * noise_variance_ / squares_free_);
  }

  // Both poses of the camera in the rig belong to the old parameters.
  void TestExtrinsics(size_t c, const Bundle& fixed, double common, CameraCheck* camera) const {
    const Uncertainty of_fixed = EstimateUncertainty(fixed);
    const Vector6d d = LocalCoordinates(cameras_[c]->T_camera_rig, fixed.cameras[c].T_camera_rig);
    Matrix6d covariance = common * noise_variance_ * of_fixed.extrinsics_covariance[c];
    covariance.diagonal() += cameras_[c]->sigma_xi.cwiseAbs2();
    camera->rotation = d.tail<3>().norm();
    camera->translation = d.head<3>().norm();
    if (!covariance.allFinite()) return;
    camera->extrinsics_probability =
        FTail(d.dot(SolveSymmetric(covariance, d)) / 6, 6, jackknife_.groups - 1);
  }

  const CalibrationRecord& old_;
  const CalibrationOptions& options_;
  std::vector<const CalibratedCamera*> cameras_;  // of the old calibration
  CalibrationCheck check_;
  std::vector<Bundle> with_old_;  // per camera: the new calibration with its old parameters
  double squares_free_ = 0;       // weighted, with all parameters free
  double noise_variance_ = 0;     // of a weighted residual
  Jackknife jackknife_;
};

}  // namespace

CalibrationCheck CheckCalibration(const CalibrationRecord& old,
                                  CalibrationInput input,
                                  const CalibrationOptions& options) {
  return Check(old, std::move(input), options).Run();
}

Verdict JudgeCheck(const CalibrationCheck& check) {
  Verdict verdict;
  const auto add = [&](Finding finding, double probability) {
    finding.grade = probability < check.level ? Grade::kBad : Grade::kGood;
    finding.value = probability;
    finding.limit = check.level;
    if (finding.grade == Grade::kGood) finding.remedy.clear();
    verdict.grade = std::max(verdict.grade, finding.grade);
    verdict.findings.push_back(std::move(finding));
  };
  for (const CameraCheck& camera : check.cameras) {
    add({.code = "parameters_changed",
         .cameras = {camera.name},
         .what = fmt::format("{}: the old parameters leave {:.3g} px RMS in the new images, those "
                             "of the new images' own {:.3g} px; without a change of the camera a "
                             "difference at least as large has a probability of {:.2g}.",
                             camera.name,
                             camera.rms_held,
                             camera.rms_free,
                             camera.probability),
         .remedy = "Calibrate again: lens, focus or zoom have changed, or the images are of "
                   "another camera."},
        camera.probability);
    if (&camera == &check.cameras.front()) continue;
    add({.code = "mount_changed",
         .cameras = {camera.name},
         .what = fmt::format("{}: on the rig turned by {:.4f} degrees and shifted by {:.3f} mm; "
                             "without a change of the rig a difference at least as large has a "
                             "probability of {:.2g}.",
                             camera.name,
                             camera.rotation * 180 / std::numbers::pi,
                             1e3 * camera.translation,
                             camera.extrinsics_probability),
         .remedy = "Fasten the cameras and calibrate again."},
        camera.extrinsics_probability);
  }
  std::ranges::stable_sort(verdict.findings, std::ranges::greater(), &Finding::grade);
  return verdict;
}

}  // namespace plenocal
