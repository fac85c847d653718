// SPDX-License-Identifier: Apache-2.0
#include "calib/calibrate.h"

#include <cmath>
#include <utility>

#include "calib/base/statistics.h"
#include "calib/noise/camera_noise.h"
#include "calib/noise/common_errors.h"
#include "calib/noise/repeated_pose.h"
#include "calib/rig_test.h"
#include "calib/solve.h"
#include "calib/start_bundle.h"
#include "calib/warnings.h"

namespace plenocal {
namespace {

// A rig is taken as rigid and its frames as synchronous unless its frames disagree.
void SolveRig(const CalibrationInput& input,
              const BundleGuess& guess,
              const SolveOptions& options,
              Calibration* calibration) {
  const auto solve = [&] {
    Solution solution = Solve(options, &calibration->bundle);
    calibration->uncertainty = std::move(solution.uncertainty);
    calibration->converged = solution.converged;
    calibration->iterations += solution.iterations;
    calibration->rejection_threshold = solution.rejection_threshold;
  };
  solve();
  if (FramesAgree(calibration->bundle, calibration->uncertainty, options.typical_sigmas)) return;
  calibration->bundle = guess.bundle;
  StartJitter(input.cameras, guess.cameras, calibration->frames, &calibration->bundle);
  solve();
}

// Scales the standard errors of cameras whose frames disagree by more than noise explains, and adds
// errors that all of a camera's points share.
void AddSystematicErrors(const SolveOptions& options, Calibration* calibration) {
  const CommonErrors errors = EstimateCommonErrors(calibration->bundle, calibration->uncertainty);
  std::vector<double> factors;
  for (size_t c = 0; c < errors.scatter.size(); ++c) {
    const auto& [factor, degrees] = errors.scatter[c];
    const double noise = calibration->bundle.cameras[c].noise.Sigma(options.typical_sigmas[c]);
    const bool disagree =
        noise > kRoundingNoise && factor > 1 && degrees >= 1 &&
        FTail(factor, degrees, calibration->uncertainty.redundancy[c]) < kFalseAlarm;
    factors.push_back(disagree ? factor : 1);
    if (!disagree) continue;
    calibration->findings.push_back(
        FindingOfSystematicErrors(calibration->bundle.cameras[c].name, std::sqrt(factor)));
  }
  AddCommonErrors(factors, errors.shared, &calibration->uncertainty);
}

void AddFindings(const BundleGuess& guess, Calibration* calibration) {
  std::vector<Finding>& findings = calibration->findings;
  const auto add = [&](const std::vector<Finding>& more) {
    findings.insert(findings.end(), more.begin(), more.end());
  };
  for (size_t c = 0; c < guess.cameras.size(); ++c) {
    const std::string& misfit = guess.cameras[c].misfit;
    if (!misfit.empty()) {
      findings.push_back(FindingOfMisfit(calibration->bundle.cameras[c].name, misfit));
    }
  }
  add(FindingsOfJitter(calibration->bundle));
  add(FindingsOfRules(*calibration));
}

}  // namespace

Calibration Calibrate(const CalibrationInput& input, const CalibrationOptions& options) {
  if (input.cameras.empty()) throw Error(ErrorKind::kInput, "no camera to calibrate");
  const auto go_on = [&](const char* stage) {
    return !options.progress || options.progress(stage);
  };
  const auto enter = [&](const char* stage) {
    if (!go_on(stage)) throw Stopped();
  };
  enter("initial guess");
  const BundleGuess guess = GuessBundle(input, options.threads);
  Calibration calibration;
  calibration.frames = guess.frames;
  calibration.bundle = guess.bundle;
  calibration.left_out = guess.left_out;
  SolveOptions solve;
  solve.loss = input.loss;
  solve.go_on = [&] { return go_on("bundle adjustment"); };
  for (const AssumedSigmas& sigmas : guess.sigmas) solve.typical_sigmas.push_back(sigmas.typical);

  enter("bundle adjustment");
  SolveRig(input, guess, solve, &calibration);

  enter("uncertainty");
  AddSystematicErrors(solve, &calibration);
  if (ShowsOnePose(calibration.bundle, solve.typical_sigmas)) {
    calibration.uncertainty = UncertaintyOfOnePose(calibration.bundle);
    calibration.findings.push_back(FindingOfOnePose(calibration.frames.size()));
  }
  for (size_t c = 0; c < input.cameras.size(); ++c) {
    calibration.fits.push_back(MeasureFit(calibration.bundle, c, guess.sigmas[c]));
  }
  AddFindings(guess, &calibration);
  return calibration;
}

}  // namespace plenocal
