// SPDX-License-Identifier: Apache-2.0
#include "calib/check.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "calib/error.h"
#include "calib/matrix_root.h"
#include "calib/result_files.h"
#include "calib/statistics.h"

namespace plenocal {
namespace {

constexpr double kFalseAlarm = 0.01;

// Gives the input the old cameras; those parameters that were held then are held now.
void TakeCameras(const CalibrationFile& old,
                 std::vector<const CalibratedCamera*>* cameras,
                 CalibrationInput* input) {
  for (CameraInput& camera : input->cameras) {
    const bool single = old.cameras.size() == 1 && input->cameras.size() == 1;
    const CalibratedCamera& was = FindCamera(old, single ? "" : camera.name);
    if (was.image_size != camera.image_size) {
      throw Error(
          ErrorKind::kInput,
          fmt::format("{}: {} is calibrated for images of {} x {} px, the new ones are {} x "
                      "{}",
                      old.path.string(),
                      was.name,
                      was.image_size[0],
                      was.image_size[1],
                      camera.image_size[0],
                      camera.image_size[1]));
    }
    if (!std::ranges::equal(was.model->measured, camera.model->measured) ||
        !std::ranges::equal(was.model->context, camera.model->context)) {
      throw Error(
          ErrorKind::kInput,
          fmt::format("{}: the session's model for {}, {}, does not measure in an image what "
                      "the calibration's does ({})",
                      old.path.string(),
                      camera.name,
                      camera.model->name,
                      was.model->name));
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

// An optimum in the least-squares sense, of which the sum of squares is one of the tested two.
double SumOfSquares(Bundle* bundle) {
  AdjustOptions options;
  options.cost_tolerance = 1e-12;
  const AdjustSummary summary = Adjust(bundle, options);
  if (!summary.usable) throw Error(ErrorKind::kJob, "the check failed: " + summary.message);
  return 2 * summary.cost;
}

double Rms(const Bundle& bundle, size_t camera) {
  double squares = 0, count = 0;
  for (const BundleObservation& observation : bundle.observations) {
    double residual[kMaxObservationSize];
    if (observation.camera != static_cast<int>(camera) || !observation.used ||
        !Residual(bundle, observation, residual)) {
      continue;
    }
    for (size_t r = 0; r < bundle.cameras[camera].model->measured.size(); ++r) {
      squares += residual[r] * residual[r];
    }
    ++count;
  }
  return std::sqrt(squares / std::max(1.0, count));
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
  std::string names;
  for (size_t c = 0; c < fresh.camera_names.size(); ++c) {
    for (size_t k = 0; k < fresh.uncertainty.params[c].size(); ++k) {
      if (!std::isinf(fresh.uncertainty.params[c][k])) continue;
      names += fmt::format("{}{}.{}",
                           names.empty() ? "" : ", ",
                           fresh.camera_names[c],
                           fresh.bundle.cameras[c].model->params[k].name);
    }
  }
  if (names.empty()) return;
  throw Error(ErrorKind::kJob,
              fmt::format("the new images are too few to check a calibration: they tell nothing of "
                          "{}; add images from other distances and at other tilts",
                          names));
}

// By what factor errors that the points of a frame have in common make variances larger than
// independent ones would: the mean over the parameters of jackknife over frames against covariance.
double Common(const std::vector<double>& sigma, const std::vector<double>& by_jackknife) {
  double sum = 0, count = 0;
  for (size_t k = 0; k < sigma.size(); ++k) {
    if (!(sigma[k] > 0) || !std::isfinite(by_jackknife[k])) continue;
    sum += std::pow(by_jackknife[k] / sigma[k], 2);
    count += 1;
  }
  return count > 0 ? std::max(1.0, sum / count) : 1;
}

// Weights of the chi-squares whose sum is the gap in units of the noise. The old covariance counts
// what the points of its frames had in common; the new one, of independent errors, is `common`
// times as large.
Eigen::VectorXd Weights(const Eigen::MatrixXd& C_new, const Eigen::MatrixXd& C_old, double common) {
  const Eigen::MatrixXd root = InverseRoot(C_new);
  const Eigen::MatrixXd M = root.transpose() * C_old * root;
  if (M.rows() == 0) return {};
  return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(M).eigenvalues().cwiseMax(0).array() +
         common;
}

}  // namespace

CalibrationCheck CheckCalibration(const CalibrationFile& old,
                                  CalibrationInput input,
                                  const CalibrationOptions& options) {
  std::vector<const CalibratedCamera*> cameras;
  TakeCameras(old, &cameras, &input);
  CalibrationCheck check;
  check.fresh = Calibrate(input, options);
  Bundle& free = check.fresh.bundle;
  check.frames = static_cast<int>(check.fresh.frames.size());

  // What either set of parameters does not image counts for neither.
  std::vector<Bundle> held(cameras.size(), free);
  for (size_t c = 0; c < cameras.size(); ++c) {
    held[c].cameras[c].params = cameras[c]->params;
    held[c].cameras[c].fixed.assign(cameras[c]->params.size(), true);
    int unseen = 0, seen = 0;
    for (BundleObservation& observation : free.observations) {
      if (observation.camera != static_cast<int>(c) || !observation.used) continue;
      double residual[kMaxObservationSize];
      observation.used = Residual(held[c], observation, residual);
      ++(observation.used ? seen : unseen);
    }
    if (unseen > seen) {
      throw Error(
          ErrorKind::kJob,
          fmt::format("{}: {} of {} points lie where the calibration of {} images nothing; it "
                      "is of another camera",
                      old.path.string(),
                      unseen,
                      unseen + seen,
                      cameras[c]->name));
    }
  }
  const double squares_free = SumOfSquares(&free);
  check.fresh.uncertainty = EstimateUncertainty(free, check.fresh.camera_names);
  RefuseOpen(check.fresh);
  double redundancy = 0;
  for (const double each : check.fresh.uncertainty.redundancy) redundancy += each;
  const Jackknife jackknife = EstimateByJackknife(
      free, {.loss = Loss::kNone, .threads = options.threads, .progress = [&](size_t, size_t) {
               return !options.progress || options.progress("jackknife over the new frames");
             }});
  const size_t tests = 2 * cameras.size() - 1;  // parameters, and mounts of all but the master
  const double limit = kFalseAlarm / static_cast<double>(tests);

  for (size_t c = 0; c < cameras.size(); ++c) {
    for (size_t i = 0; i < free.observations.size(); ++i) {
      held[c].observations[i].used = free.observations[i].used;
    }
    const double squares_held = SumOfSquares(&held[c]);
    std::vector<int> estimated;
    for (size_t k = 0; k < cameras[c]->params.size(); ++k) {
      if (check.fresh.uncertainty.places[c][k] >= 0) estimated.push_back(static_cast<int>(k));
    }
    const Eigen::MatrixXd C_new = CameraOf(check.fresh, c).covariance(estimated, estimated);
    const double common = Common(check.fresh.uncertainty.params[c], jackknife.params[c]);
    const Eigen::VectorXd weights = Weights(C_new, OldCovariance(*cameras[c], estimated), common);
    CameraCheck camera;
    camera.name = cameras[c]->name;
    camera.points = static_cast<int>(std::count_if(
        free.observations.begin(), free.observations.end(), [&](const BundleObservation& o) {
          return o.used && o.camera == static_cast<int>(c);
        }));
    camera.rms_free = Rms(free, c);
    camera.rms_held = Rms(held[c], c);
    const double gap = std::max(0.0, squares_held - squares_free);
    const double noise2 = squares_free / redundancy;
    if (weights.size() > 0 && noise2 > 0) {
      const double sum = weights.sum();
      camera.probability =
          FTail(gap / sum / noise2, sum * sum / weights.squaredNorm(), jackknife.groups - 1);
      // The squares of this camera's residuals, in px, are as many times the noise as all are.
      camera.expected = camera.rms_free * std::sqrt(1 + sum * noise2 / squares_free);
    }
    if (c > 0) {
      // Both places on the rig belong to the old parameters.
      const Uncertainty of_held = EstimateUncertainty(held[c], check.fresh.camera_names);
      const RigidTransform& was = cameras[c]->T_camera_rig;
      const RigidTransform& is = held[c].cameras[c].T_camera_rig;
      Vector6d d;
      d << is.t - was.t, LogRotation(is.R * was.R.transpose());
      Matrix6d covariance = common * noise2 * of_held.mount[c];
      covariance.diagonal() += cameras[c]->sigma_xi.cwiseAbs2();
      camera.mount_turn = d.tail<3>().norm();
      camera.mount_shift = d.head<3>().norm();
      if (covariance.allFinite()) {
        camera.mount_probability =
            FTail(d.dot(covariance.ldlt().solve(d)) / 6, 6, jackknife.groups - 1);
      }
    }
    camera.valid = camera.probability >= limit && camera.mount_probability >= limit;
    check.valid = check.valid && camera.valid;
    check.cameras.push_back(camera);
  }
  return check;
}

}  // namespace plenocal
