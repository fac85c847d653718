// SPDX-License-Identifier: Apache-2.0
#include "assess/causes/lens_cause.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "assess/model_trial.h"
#include "calib/base/error.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"
#include "calib/start/camera_guess.h"

namespace plenocal {
namespace {

/// A model with the median residual that it leaves, px.
struct LensCandidate {
  const CameraModel* model = nullptr;
  double median = 0;
};

std::optional<double> MedianUnder(const CameraModel& model,
                                  CameraInput camera,
                                  const std::map<int, Eigen::Vector3d>& markers) {
  camera.model = &model;
  camera.initial.assign(model.params.size(), std::nullopt);
  camera.fixed.assign(model.params.size(), false);
  camera.rules.clear();
  try {
    return GuessCamera(camera, markers).median_error;
  } catch (const Error&) {
    return std::nullopt;  // it cannot describe these points at all
  }
}

bool HasDistortion(const CameraModel& model) {
  constexpr size_t kLinear = 4;  // f_x, f_y, c_x, c_y
  return model.params.size() > kLinear;
}

}  // namespace

std::optional<LensCause> FindLensCause(const CalibrationInput& input,
                                       size_t c,
                                       std::span<const CameraModel> models) {
  const CameraInput& camera = input.cameras[c];
  const std::optional<double> own = MedianUnder(*camera.model, camera, input.markers);
  std::vector<LensCandidate> candidates;
  double least = own.value_or(std::numeric_limits<double>::infinity());
  for (const CameraModel& model : models) {
    // A model of local coefficients describes any lens: it explains nothing.
    // One that was made at run time can be slow: `try` compares it, where the user asks.
    if (&model == camera.model || model.support_size > 0 || model.self != nullptr ||
        !OfOneKind(model, *camera.model)) {
      continue;
    }
    const std::optional<double> median = MedianUnder(model, camera, input.markers);
    if (!median) continue;
    candidates.push_back({&model, *median});
    least = std::min(least, *median);
  }
  // Half of the residuals' length is more than one more term gains on a lens that fits.
  constexpr double kDecisive = 0.5, kAsGood = 1.1;
  if (!(least < kDecisive * own.value_or(std::numeric_limits<double>::infinity()))) {
    return std::nullopt;
  }
  // Of those that are as good as the best, the one with the fewest parameters.
  const LensCandidate* best = nullptr;
  for (const LensCandidate& candidate : candidates) {
    if (candidate.median > kAsGood * least) continue;
    if (best == nullptr || candidate.model->params.size() < best->model->params.size()) {
      best = &candidate;
    }
  }
  const bool linear = !HasDistortion(*camera.model);
  return LensCause{
      {.code = linear ? "strong_distortion_pinhole" : "model_misfit",
       .role = FindingRole::kCause,
       .grade = Grade::kUsable,
       .cameras = {camera.name},
       .value = own,
       .limit = best->median,
       .what = fmt::format("{}: {} does not describe this lens{}: median residual {} px at the "
                           "initial guess, {:.2g} px with {}.",
                           camera.name,
                           camera.model->name,
                           linear ? ", which has distortion" : "",
                           own ? fmt::format("{:.2g}", *own) : "beyond measure",
                           best->median,
                           best->model->name),
       .remedy =
           fmt::format("Set model: {}, or compare models with 'plenocal try'.", best->model->name)},
      kSigmaPerMedianLength2d * best->median};
}

}  // namespace plenocal
