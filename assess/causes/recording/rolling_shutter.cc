// SPDX-License-Identifier: Apache-2.0
//
// A rolling shutter while camera or target moved.
#include <fmt/format.h>

#include <cmath>

#include "assess/causes/cause.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

constexpr double kShutterLevel = 1e-3;  // false alarms, a camera

// The pose's derivatives times the row: motion of the target while rows are exposed one after the
// other.
Eigen::MatrixXd MotionByRow(const ViewRows& view, int height) {
  Eigen::MatrixXd X = view.pose;
  for (Eigen::Index i = 0; i < view.noise.size(); ++i) {
    X.middleRows<2>(2 * i) *= (view.position(i, 1) - (height - 1) / 2.0) / height;
  }
  return X;
}

std::vector<Finding> FindRollingShutter(const CauseEvidence& evidence) {
  const Calibration& calibration = *evidence.calibration;
  const BundleCamera& camera = calibration.bundle.cameras[evidence.camera];
  double gain = 0, rest = 0, degrees = 0, squares = 0;
  int all = 0;
  for (const ViewRows& view : evidence.views) squares += view.residual.squaredNorm();
  // A bent board and a lens that the model does not describe are the same in all views.
  for (const ViewRows& view : WithoutCommonPart(evidence.views, camera.image_size)) {
    if (view.residual.size() < 36) continue;  // pose, motion and twice as many degrees again
    const Regression motion = Regress(view, MotionByRow(view, camera.image_size[1]));
    gain += motion.gain;
    rest += motion.rest;
    degrees += motion.degrees;
    ++all;
  }
  constexpr int kLeastViews = 4;
  if (all < kLeastViews || !(rest > 0)) return {};
  const double F = gain / (6.0 * all) / (rest / degrees);
  if (FTail(F, 6.0 * all, degrees) > kShutterLevel) return {};
  constexpr double kExplains = 0.5;  // part of all squares
  const double by_noise = 6.0 * all * rest / degrees;
  if (gain - by_noise < kExplains * squares) return {};
  const double moved =
      std::sqrt((gain - by_noise) / squares) * calibration.fits[evidence.camera].rms;
  return {{.code = "rolling_shutter",
           .role = FindingRole::kImageDistortion,
           .grade = Grade::kUsable,
           .value = moved,
           .limit = 0,
           .what = fmt::format("in each frame the residuals depend on the image row as by a motion "
                               "during the readout ({:.2g} px RMS): a rolling shutter and a camera "
                               "or target that moved.",
                               moved),
           .remedy = "Hold camera and target still while an image is taken, or use a camera with a "
                     "global shutter."}};
}

}  // namespace

Cause RollingShutterCause() { return {CauseStage::kMotion, FindRollingShutter}; }

}  // namespace plenocal
