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

#include "calib/estimate/calibrate.h"

namespace plenocal {

/// Fewer frames are too few to hold some out.
inline constexpr size_t kFewestTrialFrames = 4;

struct TrialOptions {
  int folds = 5;    ///< at most; as many as there are frames when these are fewer
  int threads = 0;  ///< 0: all cores
  /// Called with the present stage and how many of all calibrations are done, one call at a time;
  /// false stops (`Stopped` is thrown).
  std::function<bool(const std::string& stage, size_t done, size_t total)> progress;
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
  MarkerFreedom marker_freedom = {};
  int free_parameters = 0;                ///< of all varied cameras
  std::vector<std::string> undetermined;  ///< names of parameters that the images leave open
  std::string failure;                    ///< why there is no calibration; then the rest is not set
  Calibration calibration;                ///< with all frames
  double seconds = 0;                     ///< run time of the calibration
  double in_sample_rms = 0;               ///< of the varied cameras' used points, px
  double unseen = 0;  ///< part of the held-out points that the model does not image
  /// It images nearly all points that any of the models images; only then the figures below are
  /// set.
  bool comparable = false;
  double rms = 0, rms_sigma = 0;       ///< of the held-out points, and its standard error, px
  std::vector<HeldOutPoint> held_out;  ///< those that the model images
  /// Standard error of the projection over the image at the target's distance, px RMS; infinite
  /// when a parameter is not determined.
  double image_sigma = 0;
  /// The figure that the verdict judges (`ProjectionMap::Most`), of the worst varied camera, px.
  double projection = 0;
  /// The same over the supported image (`SupportedSigma`).
  double sigma = 0;
  /// A simpler model of no rarer use, an index into the trials, over which this one gains less in
  /// held-out RMS than its `sigma` is larger (both as differences of squares); or a common one, of
  /// which the same holds for `projection` and this one leaves parameters open or gains less than
  /// the noise. `gain`: the root of the difference, px.
  std::optional<size_t> outweighed_by;
  double gain = 0;
  /// Of residuals as bad as these, if the model were as good as the reference: the smaller p-value
  /// of two tests (`HeldOutScores`).
  double probability = 1;
  /// Of the projection from the reference's over the supported image, px RMS
  /// (`SupportedDifference`).
  double difference = 0;
  bool practically_equal = false;  ///< `difference` is less than matters
};

/// Level of the tests whether a model is worse than the reference.
inline constexpr double kSignificant = 0.05;
/// Differences between projections below these parts of the noise and of the standard error of the
/// reference's projection do not matter.
inline constexpr double kPartOfNoise = 0.5;
inline constexpr double kPartOfSigma = 1;

struct ModelChoice {
  std::vector<size_t> varied;  ///< the cameras whose model was varied
  size_t frames = 0, folds = 0;
  size_t points = 0;    ///< held-out points that count
  size_t outliers = 0;  ///< points that are excluded for all models
  /// Sorted: comparable ones by `rms`, then the others by `unseen`, failures last.
  std::vector<ModelTrial> trials;
  /// Index into `trials`: the best whose gain is worth its uncertainty. All others are compared
  /// with it.
  size_t reference = 0;
  double noise = 0;        ///< RMS length of the points' noise under the reference, px
  double sigma = 0;        ///< standard error of its projection over the supported image, px RMS
  size_t recommended = 0;  ///< index into `trials`
  /// Indices of the models among which the best one is with 90 % (`ConfidenceSetProbabilities`).
  std::vector<size_t> confidence_set;
  /// Error of the recommended model that the others show: the largest `UnexplainedDifference` from
  /// one that predicts as well and leaves no parameter open, px.
  double disagreement = 0;
};

/// Calibrates the session once with each model for the `varied` cameras (which keep the session's
/// initial guess and fixed parameters under their own model only), then K times without one K-th of
/// the frames (every K-th frame), starting from that calibration and with its outliers and noise.
/// Of a held-out frame only the pose is estimated; markers keep the positions of the training
/// frames.
///
/// Outliers are the same points for all models: those that the best model rejects, the one with the
/// smallest sum of squares on held-out frames, each cut off at the rejection threshold. Each model
/// is scored over the points that it images.
///
/// Common models alone are the best, the reference and recommended; a rarer one takes the place of
/// the recommended one that is clearly worse. A model is acceptable when it has no more parameters
/// than the reference, or is pinhole-radtan, and is not worse (at the level of 5 %, nor by more
/// than the noise), or when both are practically equal, unless it is outweighed by a simpler one.
/// Recommended is, of the acceptable ones, pinhole-radtan, then the one with the fewest parameters.
///
/// Throws `Error` of kind kJob when there are too few frames or no model can be calibrated.
ModelChoice TryModels(const CalibrationInput& input,
                      std::vector<size_t> varied,
                      std::span<const CameraModel* const> models,
                      const TrialOptions& options);

/// Likewise two assumptions about the target, with the models of `input`: it is rigid as described,
/// or its markers are `refined`. The rigid one is the simpler.
ModelChoice TryTargets(const CalibrationInput& input,
                       std::vector<size_t> varied,
                       MarkerFreedom refined,
                       const TrialOptions& options);

/// Models, and the target with the recommended one.
struct ModelAndTarget {
  ModelChoice models, targets;  ///< without trials: not asked for
};
enum class TargetQuestion { kNone, kJudge, kChoose };

/// Tries the models (none: those of `input` stay) and judges the target. To be chosen, the target
/// is judged with the recommended one of the common models, and all models are tried with the
/// target as chosen: of a bent target that is held rigid every model is to blame for the bend.
ModelAndTarget TryModelsAndTarget(CalibrationInput input,
                                  const std::vector<size_t>& varied,
                                  const std::vector<const CameraModel*>& models,
                                  MarkerFreedom refined,
                                  TargetQuestion question,
                                  const TrialOptions& options);

/// The session with another model of the `varied` cameras; what it states about the parameters of
/// their own models is left out.
CalibrationInput WithModel(const CalibrationInput& session,
                           std::span<const size_t> varied,
                           const CameraModel& model);

/// True when one model can replace the other: same measured coordinates, same context, same config
/// values.
bool OfOneKind(const CameraModel& a, const CameraModel& b);

}  // namespace plenocal
