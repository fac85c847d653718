// SPDX-License-Identifier: Apache-2.0
//
// Choice of a camera model by cross-validation: all models are calibrated from the same
// observations and scored on held-out frames.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/calibrate.h"

namespace plenocal {

/// Fewer frames are too few to hold some out.
inline constexpr size_t kFewestTrialFrames = 4;

struct TrialOptions {
  int folds = 5;    ///< at most; as many as there are frames when these are fewer
  int threads = 0;  ///< 0: all cores
  /// Called with the present stage, one call at a time; false stops (`Stopped` is thrown).
  std::function<bool(const std::string& stage)> progress;
};

/// A point of a held-out frame with its residual under a model that was calibrated without it.
struct HeldOutPoint {
  size_t camera = 0;
  Observation seen;
  std::array<double, kMaxObservationSize> residual{};  ///< measured minus predicted, px
};

/// One model in place of the varied cameras' own.
struct ModelTrial {
  const CameraModel* model = nullptr;
  int free_parameters = 0;   ///< of all varied cameras
  std::string failure;       ///< why there is no calibration; then the rest is not set
  Calibration calibration;   ///< with all frames
  double seconds = 0;        ///< run time of the calibration
  double in_sample_rms = 0;  ///< of the varied cameras' used points, px
  double unseen = 0;         ///< part of the held-out points that the model does not image
  /// It images nearly all points that any of the models images; only then the figures below are
  /// set.
  bool comparable = false;
  double rms = 0, rms_sigma = 0;       ///< of the held-out points, and its standard error, px
  std::vector<HeldOutPoint> held_out;  ///< those that all comparable models image
  /// The smaller p-value of two tests of the hypothesis that no model is better (`TryModels`).
  double probability = 1;
};

struct ModelChoice {
  std::vector<size_t> varied;  ///< the cameras whose model was varied
  size_t frames = 0, folds = 0;
  size_t points = 0;    ///< held-out points that all comparable models image
  size_t outliers = 0;  ///< points that are excluded for all models
  /// Sorted: comparable ones by `rms`, then the others by `unseen`, failures last.
  std::vector<ModelTrial> trials;
  size_t recommended = 0;  ///< index into `trials`
};

/// Calibrates the session once with each model for the `varied` cameras (which keep the session's
/// initial guess and fixed parameters under their own model only), then K times without one K-th of
/// the frames (every K-th frame), starting from that calibration and with its outliers and noise.
/// Of a held-out frame only the pose is estimated; markers keep the positions of the training
/// frames.
///
/// Outliers are the same points for all models: those that the best model rejects, the one with the
/// smallest sum of squares, each cut off at the rejection threshold. Scores are sums over frames.
/// Since training sets overlap, scores of different frames correlate; the variance of a mean over n
/// frames is s^2 / n (1 + K / (K - 1)) (Nadeau and Bengio, Inference for the generalization error,
/// Machine Learning 52, 2003).
///
/// Recommended is the model with the fewest free parameters of those that are not worse than others
/// at the level of 5 % in one-sided t-tests over frames. One test, against the best, is of the
/// logarithms of the ratios of the mean squares, since the squares of a model that does not fit
/// have long tails. The others, against each model that predicts held-out points better, with
/// Bonferroni's correction for all, detect errors much smaller than the noise: they test whether a
/// model's residuals correlate with the difference between its predictions and the other's (Clark
/// and West, Approximately normal tests for equal predictive accuracy in nested models, Journal of
/// Econometrics 138, 2007). Mean squared errors are far less sensitive.
///
/// Throws `Error` of kind kJob when there are too few frames or no model can be calibrated.
ModelChoice TryModels(const CalibrationInput& input,
                      std::vector<size_t> varied,
                      std::span<const CameraModel* const> models,
                      const TrialOptions& options);

/// True when one model can replace the other: same measured coordinates, same context, same config
/// values.
bool OfOneKind(const CameraModel& a, const CameraModel& b);

}  // namespace plenocal
