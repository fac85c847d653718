// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/calibrate.h"

#include <cmath>
#include <set>
#include <string>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/statistics.h"
#include "calib/estimate/common_errors.h"
#include "calib/estimate/estimation_findings.h"
#include "calib/estimate/rig_rigidity.h"
#include "calib/estimate/solve.h"
#include "calib/estimate/start_bundle.h"
#include "calib/files/checks/transform_keys.h"
#include "calib/noise/camera_noise.h"
#include "calib/noise/frame_scatter.h"
#include "calib/noise/repeated_pose.h"
#include "calib/prior/prior_agreement.h"
#include "calib/rig/link_targets.h"
#include "calib/rig/time_shift.h"
#include "calib/start/camera_guess.h"

namespace plenocal {
namespace {

// A distortion coefficient: without effect at 0.
bool IsCoefficient(const Param& param) { return param.unit == "1" && param.neutral == 0.0; }

// True when coefficients replace each other without any effect on the images, while all else is
// determined.
bool LeavesOnlyCoefficientsOpen(const Bundle& bundle, const Uncertainty& uncertainty) {
  std::set<std::string> coefficients;
  for (const BundleCamera& camera : bundle.cameras) {
    for (const Param& param : camera.model->params) {
      if (IsCoefficient(param)) coefficients.insert(camera.name + "." + std::string(param.name));
    }
  }
  bool any = false;
  for (const OpenDirection& direction : uncertainty.open) {
    if (!std::isinf(direction.sigma)) continue;
    any = true;
    for (const auto& [name, share] : direction.parts) {
      if (!coefficients.contains(name)) return false;
    }
  }
  return any;
}

// Weak priors around "no effect" on the coefficients that are open. Without them the adjustment
// runs along the open direction to where numerator and denominator of a rational model vanish
// together, in the middle of the image.
void AddPriorsOfOpenCoefficients(const Uncertainty& uncertainty,
                                 std::vector<CameraInput>* cameras) {
  constexpr double kSizes = 1;  // prior's sigma; lenses have coefficients of about one `scale`
  for (size_t c = 0; c < cameras->size(); ++c) {
    CameraInput& camera = (*cameras)[c];
    camera.rules.resize(camera.model->params.size());
    for (size_t k = 0; k < camera.rules.size(); ++k) {
      const Param& param = camera.model->params[k];
      ParamRule& rule = camera.rules[k];
      if (!IsCoefficient(param) || !std::isinf(uncertainty.param_std_errors[c][k])) continue;
      if (!rule.prior && !rule.tied_to) rule.prior = {.value = 0, .sigma = kSizes * param.scale};
    }
  }
}

// Estimates the time shifts of the cameras of a rig whose frames disagree, where the images have
// times and show how the rig moved. `calibration` is solved with jitter, and stays so when neither
// the times nor a shift explain any of it.
void SolveTimeShifts(const std::vector<CameraInput>& cameras,
                     const std::vector<CameraGuess>& guesses,
                     const SolveOptions& options,
                     const std::function<void()>& solve,
                     Calibration* calibration) {
  constexpr double kSignificant = 4;  // sigmas
  constexpr int kLinearisations = 2;  // of the motion at the time shifts
  Bundle& bundle = calibration->bundle;
  const std::optional<RigTimes> times = TimesOf(cameras, calibration->frames);
  if (!times || !ShowsMotion(bundle, *times)) return;
  const Calibration with_jitter = *calibration;
  bundle.jitter = {};
  AddTimeShifts(*times, &bundle);
  for (int i = 0; i < kLinearisations; ++i) {
    solve();
    UpdateMotion(*times, &bundle);
  }
  solve();
  // The rest that the motion does not explain is jitter.
  if (!FramesAgree(bundle, calibration->uncertainty, options.typical_sigmas)) {
    StartJitter(cameras, guesses, calibration->frames, &bundle);
    solve();
  }
  constexpr double kExplained = 0.5;  // of the jitter is left at most
  bool explains =
      bundle.jitter.translation_sigma < kExplained * with_jitter.bundle.jitter.translation_sigma;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const std::optional<size_t> shift = bundle.cameras[c].Find(nuisances::kTimeShift);
    if (!shift) continue;
    const double sigma = calibration->uncertainty.param_std_errors[c][*shift];
    explains = explains || std::abs(bundle.cameras[c].params[*shift]) > kSignificant * sigma;
  }
  if (!explains) *calibration = with_jitter;
}

// Brings a bundle back to its initial guess, which holds no observations.
void StartAgain(const BundleState& guess, Bundle* bundle) {
  static_cast<BundleState&>(*bundle) = guess;
  for (BundleObservation& observation : bundle->observations) observation.used = true;
}

// Makes an initial guess the calibration's; another guess may have poses of other frames.
void TakeGuess(BundleGuess* guess, Calibration* calibration) {
  calibration->frames = guess->frames;
  calibration->bundle.observations = std::move(guess->bundle.observations);
  StartAgain(guess->bundle, &calibration->bundle);
  calibration->left_out = guess->left_out;
}

// A prior that fixes one camera's position along each undetermined direction, nearest to the rig's
// origin: far from it, rotation noise of the poses displaces targets and cameras as much as the
// motion does.
CalibrationPrior FixDirections(const Eigen::MatrixXd& undetermined,
                               const std::vector<int>& extrinsics_index,
                               const Bundle& bundle) {
  constexpr double kSigma = 1e-3;  // of the direction's natural length
  CalibrationPrior prior;
  for (const BundleCamera& camera : bundle.cameras) {
    prior.T_camera_rig.push_back(camera.T_camera_rig);
  }
  prior.weight.setZero(undetermined.cols(), 0);
  for (Eigen::Index k = 0; k < undetermined.cols(); ++k) {
    const auto part = [&](size_t c) -> Eigen::Vector3d {
      const int place = extrinsics_index[c];
      if (place < 0) return Eigen::Vector3d::Zero();
      return undetermined.block<3, 1>(place, k);
    };
    size_t moved = 0;
    for (size_t c = 1; c < bundle.cameras.size(); ++c) {
      if (part(c).norm() > part(moved).norm()) moved = c;
    }
    if (part(moved).isZero()) continue;
    const Eigen::Vector3d axis = part(moved).normalized();
    Eigen::Vector3d& t = prior.T_camera_rig[moved].t;
    t -= axis.dot(t) * axis;
    for (Eigen::Index i = 0; i < 3; ++i)
      prior.unknowns.push_back({.camera = moved, .component = i});
    prior.weight.conservativeResizeLike(
        Eigen::MatrixXd::Zero(undetermined.cols(), prior.weight.cols() + 3));
    prior.weight.block<1, 3>(k, prior.weight.cols() - 3) =
        part(moved).transpose() / (kSigma * part(moved).squaredNorm());
  }
  return prior;
}

// Solves for a rig whose cameras were placed by motion. Along directions that the motion leaves
// open noise carries the estimate away, by metres, to where it determines the rest badly: these are
// fixed.
void JudgeMotion(const BundleState& guess,
                 const std::function<void()>& solve,
                 Calibration* calibration) {
  Bundle& bundle = calibration->bundle;
  calibration->uncertainty = EstimateUncertaintyByMotion(bundle);
  const Uncertainty& uncertainty = calibration->uncertainty;
  const bool is_open = uncertainty.undetermined.cols() > 0;
  if (!is_open || bundle.prior || bundle.EstimatesJitter() || !bundle.motion.empty()) return;
  const Calibration carried_away = *calibration;
  StartAgain(guess, &bundle);
  bundle.prior = FixDirections(uncertainty.undetermined, uncertainty.extrinsics_index, bundle);
  solve();
  bundle.prior.reset();
  calibration->uncertainty = EstimateUncertaintyByMotion(bundle);
  if (uncertainty.undetermined.cols() == 0) *calibration = carried_away;
}

// A rig is taken as rigid and its frames as synchronous unless its frames disagree.
void SolveRig(const CalibrationInput& input,
              const SolveOptions& options,
              int threads,
              BundleGuess* guess,
              Calibration* calibration) {
  const auto solve = [&] {
    Solution solution = Solve(options, &calibration->bundle);
    calibration->uncertainty = std::move(solution.uncertainty);
    calibration->converged = solution.converged;
    calibration->iterations += solution.iterations;
    calibration->rejection_threshold = solution.rejection_threshold;
  };
  solve();
  if (LeavesOnlyCoefficientsOpen(calibration->bundle, calibration->uncertainty)) {
    CalibrationInput with_priors = input;
    AddPriorsOfOpenCoefficients(calibration->uncertainty, &with_priors.cameras);
    *guess = GuessBundle(with_priors, threads);
    TakeGuess(guess, calibration);
    solve();
  }
  if (FramesAgree(calibration->bundle, calibration->uncertainty, options.typical_sigmas)) {
    if (!guess->findings.empty()) JudgeMotion(guess->bundle, solve, calibration);
    return;
  }
  StartAgain(guess->bundle, &calibration->bundle);
  const std::vector<CameraInput>& cameras = guess->linked ? guess->linked->cameras : input.cameras;
  StartJitter(cameras, guess->cameras, calibration->frames, &calibration->bundle);
  solve();
  SolveTimeShifts(cameras, guess->cameras, options, solve, calibration);
  if (!guess->findings.empty()) JudgeMotion(guess->bundle, solve, calibration);
}

// Scales the standard errors of cameras whose frames, or whose markers, disagree by more than noise
// explains. Errors that a marker shares in all frames are no finding: each camera may show a
// marker's edges a little differently.
void AddSystematicErrors(const SolveOptions& options, Calibration* calibration) {
  const auto [of_frames, of_markers] =
      EstimateScatter(calibration->bundle, calibration->uncertainty);
  std::vector<double> factors;
  for (size_t c = 0; c < of_frames.size(); ++c) {
    const double noise = calibration->bundle.cameras[c].noise.Sigma(options.typical_sigmas[c]);
    // Part of the variance that noise does not explain.
    const auto excess = [&](const Scatter& scatter) {
      const bool disagree =
          noise > kRoundingNoise && scatter.factor > 1 && scatter.degrees >= 1 &&
          FTail(scatter.factor, scatter.degrees, calibration->uncertainty.redundancy[c]) <
              kFalseAlarm;
      return disagree ? scatter.factor - 1 : 0;
    };
    const double by_frames = excess(of_frames[c]);
    factors.push_back(1 + by_frames + excess(of_markers[c]));
    if (by_frames == 0) continue;
    calibration->findings.push_back(
        FindingOfSystematicErrors(calibration->bundle.cameras[c].name, std::sqrt(1 + by_frames)));
  }
  ScaleByScatter(factors, &calibration->uncertainty);
}

// Throws where a camera has left the rig, so that its result could not be read again.
void RequireCamerasOnRig(const Bundle& bundle) {
  for (const BundleCamera& camera : bundle.cameras) {
    const double distance = camera.T_camera_rig.t.cwiseAbs().maxCoeff();
    if (distance < kFarthestPart) continue;
    throw JobError(
        "camera '{}' would be {:.1g} m from the rig: its points do not determine its place",
        camera.name,
        distance);
  }
}

void AddFindings(const BundleGuess& guess, Calibration* calibration) {
  std::vector<Finding>& findings = calibration->findings;
  for (size_t c = 0; c < guess.cameras.size(); ++c) {
    const std::string& misfit = guess.cameras[c].misfit;
    if (!misfit.empty()) {
      findings.push_back(FindingOfMisfit(calibration->bundle.cameras[c].name, misfit));
    }
  }
  Append(FindingsOfJitter(calibration->bundle), &findings);
  Append(FindingsOfTimeShifts(calibration->bundle, calibration->uncertainty), &findings);
  Append(FindingsOfTargetScale(calibration->bundle, calibration->uncertainty), &findings);
  Append(FindingsOfRules(calibration->bundle, calibration->uncertainty), &findings);
}

}  // namespace

CalibrationStart StartFrom(const Calibration& calibration) {
  CalibrationStart start;
  for (const BundleCamera& camera : calibration.bundle.cameras) {
    start.params.emplace_back(
        camera.params.begin(),
        camera.params.begin() + static_cast<std::ptrdiff_t>(camera.ModelParams()));
    start.T_camera_rig.push_back(camera.T_camera_rig);
  }
  for (size_t f = 0; f < calibration.frames.size(); ++f) {
    start.T_rig_target[calibration.frames[f]] = calibration.bundle.T_rig_target[f];
  }
  for (const BundleMarker& marker : calibration.bundle.markers) {
    start.markers[marker.number] = marker.position;
  }
  return start;
}

Calibration Calibrate(const CalibrationInput& input, const CalibrationOptions& options) {
  if (input.cameras.empty()) throw InputError("no camera to calibrate");
  const auto go_on = [&](const char* stage) {
    return !options.progress || options.progress(stage);
  };
  const auto enter = [&](const char* stage) {
    if (!go_on(stage)) throw Stopped();
  };
  enter("initial guess");
  BundleGuess guess = GuessBundle(input, options.threads);
  Calibration calibration;
  TakeGuess(&guess, &calibration);
  SolveOptions solve;
  solve.loss = input.loss;
  solve.go_on = [&] { return go_on("bundle adjustment"); };
  for (const AssumedSigmas& sigmas : guess.sigmas) solve.typical_sigmas.push_back(sigmas.typical);

  enter("bundle adjustment");
  SolveRig(input, solve, options.threads, &guess, &calibration);
  SetByOthers(&calibration.bundle);
  RequireCamerasOnRig(calibration.bundle);

  enter("uncertainty");
  calibration.findings = JudgeLinks(guess.findings, calibration.bundle, calibration.uncertainty);
  Append(FindingsOfPrior(calibration.bundle, calibration.uncertainty), &calibration.findings);
  AddSystematicErrors(solve, &calibration);
  if (ShowsOnePose(calibration.bundle, solve.typical_sigmas)) {
    calibration.uncertainty = UncertaintyOfOnePose(calibration.bundle);
    calibration.findings.push_back(FindingOfOnePose(calibration.frames.size()));
  } else {
    AddLatticeErrors(input.cameras, calibration.bundle, &calibration.uncertainty);
  }
  for (size_t c = 0; c < input.cameras.size(); ++c) {
    calibration.fits.push_back(MeasureFit(calibration.bundle, c, guess.sigmas[c]));
  }
  AddFindings(guess, &calibration);
  return calibration;
}

}  // namespace plenocal
