// SPDX-License-Identifier: Apache-2.0
#include "assess/model_trial.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <map>
#include <mutex>
#include <numeric>
#include <set>
#include <tuple>

#include "assess/held_out/confidence_set.h"
#include "assess/held_out/held_out_frames.h"
#include "assess/held_out/held_out_scores.h"
#include "assess/projection.h"
#include "assess/projection_map.h"
#include "calib/adjust/solver/adjust.h"
#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/base/parallel.h"
#include "calib/base/statistics.h"
#include "calib/estimate/describe.h"
#include "calib/estimate/weak_unknowns.h"
#include "calib/files/session.h"

namespace plenocal {
namespace {

constexpr double kFalseRejections = 0.05;  // expected number of good points rejected in all
constexpr double kMostUnseen = 0.01;       // part of the points beyond the most complete model
constexpr double kExactRms = 1e-6;         // px; smaller noise is rounding

using PointName = std::tuple<size_t, std::string, int, std::array<double, kMaxObservationSize>>;

// OpenCV's five coefficients before the other common models.
int Rarity(const ModelTrial& trial) {
  return trial.model->name == kUsualModel ? -1 : static_cast<int>(trial.model->usage);
}

bool HasLessFreedom(const ModelTrial& a, const ModelTrial& b) {
  const auto size = [](const ModelTrial& trial) {
    return std::pair(!trial.marker_freedom.IsRigid(), trial.free_parameters);
  };
  return size(a) < size(b);
}

bool IsSimpler(const ModelTrial& a, const ModelTrial& b) {
  return HasLessFreedom(a, b) && Rarity(a) <= Rarity(b);
}

std::vector<std::string> UndeterminedOf(const Calibration& calibration) {
  std::vector<std::string> names;
  for (const WeakUnknowns& weak : FindWeakUnknowns(calibration.bundle, calibration.uncertainty)) {
    for (const std::string& name : weak.names) {
      if (weak.open && std::ranges::find(names, name) == names.end()) names.push_back(name);
    }
  }
  return names;
}

// `ProjectionMap::Most` at the target's median distance, of the worst camera, px.
double MostSigma(const Calibration& calibration, const std::vector<size_t>& cameras) {
  const CalibrationRecord record = Describe(calibration);
  double most = 0;
  for (const size_t c : cameras) {
    const std::vector<ProjectionMap> maps = ProjectionMaps(record, c);
    most = std::max(most, maps.empty() ? std::numeric_limits<double>::infinity() : maps[1].Most());
  }
  return most;
}

/// What is tried: a model of the varied cameras, and how far the target may differ from its
/// description.
struct ModelCandidate {
  const CameraModel* model = nullptr;
  MarkerFreedom marker_freedom = {};
  std::string name;  ///< in progress and messages
};

class Trials {
 public:
  Trials(const CalibrationInput& input,
         std::vector<size_t> varied,
         std::vector<ModelCandidate> candidates,
         const TrialOptions& options)
      : input_(input), options_(options), candidates_(std::move(candidates)) {
    choice_.varied = std::move(varied);
    for (const ModelCandidate& candidate : candidates_) {
      choice_.trials.emplace_back();
      choice_.trials.back().model = candidate.model;
      choice_.trials.back().marker_freedom = candidate.marker_freedom;
    }
    CollectPoints();
  }

  ModelChoice Run() {
    ParallelFor(choice_.trials.size(), options_.threads, [&](size_t m) { CalibrateAll(m); });
    trained_.assign(choice_.trials.size(), std::vector<Bundle>(choice_.folds));
    ForEachFold([&](size_t m, size_t fold) { return Train(m, fold); });
    PredictWithCommonOutliers();
    Score();
    Sort();
    FindConfidenceSet();
    Recommend();
    return std::move(choice_);
  }

 private:
  // `done`: calibrations that have ended since the last call.
  void Stage(const std::string& stage, size_t done = 0) {
    const std::lock_guard lock(mutex_);
    done_ += done;
    const size_t all = candidates_.size() * (1 + choice_.folds);
    if (options_.progress && !options_.progress(stage, done_, all)) throw Stopped();
  }

  // All observations of varied cameras, in the order of their frames.
  void CollectPoints() {
    std::map<std::string, std::vector<std::pair<size_t, size_t>>> views;
    for (size_t c = 0; c < input_.cameras.size(); ++c) {
      for (size_t v = 0; v < input_.cameras[c].views.size(); ++v) {
        views[input_.cameras[c].views[v].frame].emplace_back(c, v);
      }
    }
    for (const auto& [name, in_frame] : views) {
      const size_t frame = frames_.size();
      frames_[name] = frame;
      for (const auto& [c, v] : in_frame) {
        if (std::find(choice_.varied.begin(), choice_.varied.end(), c) == choice_.varied.end()) {
          continue;
        }
        const View& view = input_.cameras[c].views[v];
        for (size_t i = 0; i < view.observations.size(); ++i) {
          const Observation& seen = view.observations[i];
          if (!input_.markers.contains(seen.marker)) continue;
          points_.push_back({c, v, frame, &seen, {}});
          if (!view.by_nuisance.empty()) points_.back().by_nuisance = view.by_nuisance[i];
        }
      }
    }
    choice_.frames = frames_.size();
    if (choice_.frames < kFewestTrialFrames) {
      throw JobError("{}: too few to hold some out; models can be judged from {} frames on",
                     Counted(choice_.frames, "frame"),
                     kFewestTrialFrames);
    }
    choice_.folds = std::min(choice_.frames, static_cast<size_t>(options_.folds));
  }

  void CalibrateAll(size_t m) {
    ModelTrial* const trial = &choice_.trials[m];
    const auto start = std::chrono::steady_clock::now();
    try {
      const std::string& stage = candidates_[m].name;
      Stage(stage);
      CalibrationInput input = WithModel(input_, choice_.varied, *trial->model);
      input.marker_freedom = trial->marker_freedom;
      trial->calibration = Calibrate(input, {.threads = 1, .progress = [&](const std::string&) {
                                               Stage(stage);
                                               return true;
                                             }});
      Stage(stage, 1);
    } catch (const Error& error) {
      trial->failure = error.what();
      return;
    }
    trial->seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    double squares = 0, count = 0;
    std::set<int> estimated;
    for (const size_t c : choice_.varied) {
      const CameraFit& fit = trial->calibration.fits[c];
      squares += fit.points * fit.rms * fit.rms;
      count += fit.points;
      const std::vector<int>& places = trial->calibration.uncertainty.param_index[c];
      estimated.insert(places.begin(), places.end());
    }
    estimated.erase(-1);
    trial->free_parameters = static_cast<int>(estimated.size());
    trial->undetermined = UndeterminedOf(trial->calibration);
    trial->in_sample_rms = std::sqrt(squares / count);
  }

  // Adjusts without a fold, from the calibration with all frames. Returns why it cannot.
  std::string Train(size_t m, size_t fold) {
    const Calibration& calibration = choice_.trials[m].calibration;
    const std::string stage =
        fmt::format("{}, fold {} of {}", candidates_[m].name, fold + 1, choice_.folds);
    Bundle trained = calibration.bundle;
    std::set<int> seen_by;  // cameras
    for (BundleObservation& observation : trained.observations) {
      const std::string& frame = calibration.frames[static_cast<size_t>(observation.frame)];
      if (frames_.at(frame) % choice_.folds == fold) observation.used = false;
      if (observation.used) seen_by.insert(observation.camera);
    }
    try {
      for (const size_t c : choice_.varied) {
        if (seen_by.contains(static_cast<int>(c))) continue;
        throw Error(ErrorKind::kJob, input_.cameras[c].name + " has no observations left");
      }
      const AdjustSummary summary = Adjust(
          &trained, {.loss = input_.loss, .cost_tolerance = 1e-9, .on_iteration = [&](int, double) {
                       Stage(stage);
                       return true;
                     }});
      if (!summary.usable) throw Error(ErrorKind::kJob, summary.message);
      Stage(stage, 1);
    } catch (const Error& error) {
      return fmt::format("without fold {}: {}", fold + 1, error.what());
    }
    Bundle& kept = trained_[m][fold];
    kept.cameras = std::move(trained.cameras);
    kept.markers = std::move(trained.markers);
    kept.jitter.translation_sigma = trained.jitter.translation_sigma;
    return {};
  }

  // Calls `work` for each model and fold without a failure so far.
  void ForEachFold(const std::function<std::string(size_t m, size_t fold)>& work) {
    std::vector<std::string> failures(choice_.trials.size() * choice_.folds);
    ParallelFor(failures.size(), options_.threads, [&](size_t i) {
      const size_t m = i / choice_.folds;
      if (choice_.trials[m].failure.empty()) failures[i] = work(m, i % choice_.folds);
    });
    for (size_t i = 0; i < failures.size(); ++i) {
      ModelTrial& trial = choice_.trials[i / choice_.folds];
      if (trial.failure.empty()) trial.failure = failures[i];
    }
  }

  // Fills `residuals_`; `outliers_of` are those of a model.
  void Predict(const std::function<const std::vector<bool>&(size_t m)>& outliers_of) {
    residuals_.assign(choice_.trials.size(), std::vector<HeldOutResidual>(points_.size()));
    ForEachFold([&](size_t m, size_t fold) -> std::string {
      try {
        PredictHeldOut(
            trained_[m][fold], {points_, choice_.folds}, fold, outliers_of(m), &residuals_[m]);
        return {};
      } catch (const Error& error) {
        return fmt::format("without fold {}: {}", fold + 1, error.what());
      }
    });
  }

  // The points that a model's calibration with all frames rejects.
  [[nodiscard]] std::vector<bool> RejectedBy(const Calibration& calibration) const {
    std::set<PointName> used;
    for (const BundleObservation& observation : calibration.bundle.observations) {
      if (!observation.used) continue;
      used.emplace(static_cast<size_t>(observation.camera),
                   calibration.frames[static_cast<size_t>(observation.frame)],
                   observation.seen.marker,
                   observation.seen.values);
    }
    std::vector<bool> rejected;
    for (const TrialPoint& point : points_) {
      const std::string& frame = input_.cameras[point.camera].views[point.view].frame;
      rejected.push_back(
          !used.contains({point.camera, frame, point.seen->marker, point.seen->values}));
    }
    return rejected;
  }

  // A candidate for reference and recommendation, whose outliers count: a common model; any where
  // no common one can be compared. Rarer models in the trial change neither.
  [[nodiscard]] bool IsCandidate(size_t m) const {
    const auto can = [&](const ModelTrial& trial) {
      return trial.model->usage == Usage::kCommon && trial.failure.empty() &&
             (!scored_ || trial.comparable);
    };
    return can(choice_.trials[m]) || std::ranges::none_of(choice_.trials, can);
  }

  [[nodiscard]] size_t Rows() const { return choice_.trials[0].model->measured.size(); }

  [[nodiscard]] double SquareOf(size_t m, size_t p) const {
    const HeldOutResidual& residual = residuals_[m][p];
    if (!residual.imaged) return std::numeric_limits<double>::infinity();
    double square = 0;
    for (size_t r = 0; r < Rows(); ++r) square += residual.values[r] * residual.values[r];
    return square;
  }

  // Noise of a camera's coordinates, px: the smallest that any model shows on held-out frames, from
  // the median of their squares. A model that follows noise shows a larger one.
  [[nodiscard]] double HeldOutNoise(size_t camera) const {
    double least = std::numeric_limits<double>::infinity();
    for (size_t m = 0; m < choice_.trials.size(); ++m) {
      if (!choice_.trials[m].failure.empty() || !IsCandidate(m)) continue;
      std::vector<double> squares;
      for (size_t p = 0; p < points_.size(); ++p) {
        if (points_[p].camera == camera) squares.push_back(SquareOf(m, p));
      }
      least = std::min(least, Median(std::move(squares)));
    }
    return std::max(kExactRms, std::sqrt(least / ChiSquareQuantile(static_cast<int>(Rows()), 0.5)));
  }

  // The outliers are the points that the best model rejects: the one with the smallest sum of
  // squares on held-out frames, each at most what the rejection rule allows.
  [[nodiscard]] const std::vector<bool>& CommonOutliers(
      const std::vector<std::vector<bool>>& rejected) const {
    std::map<size_t, double> noise;
    for (const size_t c : choice_.varied) noise[c] = HeldOutNoise(c);
    const double limit = ChiSquareQuantile(static_cast<int>(Rows()),
                                           kFalseRejections / static_cast<double>(points_.size()));
    std::optional<size_t> best;
    double least = 0;
    for (size_t m = 0; m < choice_.trials.size(); ++m) {
      if (!choice_.trials[m].failure.empty() || !IsCandidate(m)) continue;
      double sum = 0;
      for (size_t p = 0; p < points_.size(); ++p) {
        sum += std::min(limit, SquareOf(m, p) / std::pow(noise.at(points_[p].camera), 2));
      }
      if (best && sum >= least) continue;
      best = m;
      least = sum;
    }
    if (best) return rejected[*best];
    throw JobError("no model can be calibrated; {}: {}",
                   choice_.trials[0].model->name,
                   choice_.trials[0].failure);
  }

  void PredictWithCommonOutliers() {
    std::vector<std::vector<bool>> rejected;
    for (const ModelTrial& trial : choice_.trials) {
      rejected.push_back(trial.failure.empty() ? RejectedBy(trial.calibration)
                                               : std::vector<bool>());
    }
    Predict([&](size_t m) -> const std::vector<bool>& { return rejected[m]; });
    outliers_ = CommonOutliers(rejected);
    Predict([&](size_t) -> const std::vector<bool>& { return outliers_; });
  }

  // RMS of each model's held-out points, and which models image as many of them as others.
  void Score() {
    auto& trials = choice_.trials;
    std::vector<size_t> frame_of;
    std::vector<bool> good;
    for (size_t p = 0; p < points_.size(); ++p) {
      frame_of.push_back(points_[p].frame);
      good.push_back(!outliers_[p]);
      ++(outliers_[p] ? choice_.outliers : choice_.points);
    }
    scores_.emplace(std::move(frame_of), choice_.frames, choice_.folds, Rows());
    scores_->SetGood(std::move(good));
    double most = 0;
    for (size_t m = 0; m < trials.size(); ++m) {
      if (!trials[m].failure.empty()) continue;
      trials[m].unseen = 1 - scores_->Imaged(residuals_[m]);
      most = std::max(most, 1 - trials[m].unseen);
    }
    if (most == 0) {
      throw JobError(
          "no model can be judged; {}: {}",
          trials[0].model->name,
          trials[0].failure.empty() ? "images no point of held-out frames" : trials[0].failure);
    }
    ParallelFor(trials.size(), options_.threads, [&](size_t m) {
      ModelTrial& trial = trials[m];
      trial.comparable = trial.failure.empty() && trial.unseen <= 1 - most + kMostUnseen;
      if (trial.comparable) ScoreComparable(m);
    });
    scored_ = true;
  }

  void ScoreComparable(size_t m) {
    ModelTrial& trial = choice_.trials[m];
    const HeldOutScores::Rms rms = scores_->Score(residuals_[m]);
    trial.rms = rms.value;
    trial.rms_sigma = rms.sigma;
    for (size_t p = 0; p < points_.size(); ++p) {
      if (!scores_->Counts(p, residuals_[m])) continue;
      trial.held_out.push_back({points_[p].camera, *points_[p].seen, residuals_[m][p].values});
    }
    try {
      trial.image_sigma = TypicalImageSigma(trial.calibration, choice_.varied);
      trial.sigma = SupportedSigma(trial.calibration, choice_.varied);
      trial.projection = MostSigma(trial.calibration, choice_.varied);
    } catch (const Error&) {
      trial.image_sigma = trial.sigma = trial.projection = std::numeric_limits<double>::infinity();
    }
  }

  // Best models first.
  void Sort() {
    const auto& trials = choice_.trials;
    std::vector<size_t> order(trials.size());
    std::iota(order.begin(), order.end(), size_t{0});
    const auto rank = [&](size_t m) {
      const ModelTrial& trial = trials[m];
      return std::tuple(
          !trial.failure.empty(), !trial.comparable, trial.comparable ? trial.rms : trial.unseen);
    };
    std::ranges::stable_sort(order, [&](size_t a, size_t b) { return rank(a) < rank(b); });
    std::vector<ModelTrial> sorted_trials;
    std::vector<std::vector<HeldOutResidual>> sorted_residuals;
    for (const size_t m : order) {
      sorted_trials.push_back(std::move(choice_.trials[m]));
      sorted_residuals.push_back(std::move(residuals_[m]));
    }
    choice_.trials = std::move(sorted_trials);
    residuals_ = std::move(sorted_residuals);
  }

  void FindConfidenceSet() {
    std::vector<size_t> comparable;
    std::vector<std::span<const HeldOutResidual>> residuals;
    for (size_t m = 0; m < choice_.trials.size(); ++m) {
      if (!choice_.trials[m].comparable) continue;
      comparable.push_back(m);
      residuals.emplace_back(residuals_[m]);
    }
    const Eigen::MatrixXd losses = scores_->LogSquares(residuals);
    if (losses.rows() < 2) return;
    const std::vector<double> probabilities = ConfidenceSetProbabilities(losses, choice_.folds);
    for (size_t i = 0; i < comparable.size(); ++i) {
      if (probabilities[i] >= kOutsideConfidenceSet)
        choice_.confidence_set.push_back(comparable[i]);
    }
  }

  // A model's uncertainty exceeds that of a simpler one, of no rarer use, by more than its gain.
  void FindOutweighed() {
    auto& trials = choice_.trials;
    for (size_t m = 0; m < trials.size(); ++m) {
      for (size_t s = 0; s < trials.size() && trials[m].comparable; ++s) {
        if (!trials[s].comparable || !IsSimpler(trials[s], trials[m])) continue;
        const double gain = scores_->Excess(residuals_[s], residuals_[m]);
        const double root = std::sqrt(std::max(0.0, gain));
        const double cost = std::pow(trials[m].sigma, 2) - std::pow(trials[s].sigma, 2);
        // Without a finite sigma of either, the simpler one is as good a choice.
        if (cost <= gain) continue;
        if (std::isnan(cost) && gain > 0) continue;
        if (trials[m].outweighed_by && trials[m].gain <= root) continue;
        trials[m].outweighed_by = s;
        trials[m].gain = root;
      }
    }
  }

  // RMS length of the points' noise under a model, px.
  [[nodiscard]] double NoiseOf(const ModelTrial& trial) const {
    double squares = 0;
    for (const size_t c : choice_.varied) {
      const double sigma = trial.calibration.fits[c].noise_sigma;
      squares += sigma * sigma * static_cast<double>(trial.model->measured.size());
    }
    return std::sqrt(squares / static_cast<double>(choice_.varied.size()));
  }

  // Significantly over all pairs, or by more than the noise.
  [[nodiscard]] bool IsClearlyWorse(size_t m, size_t than) const {
    const double p = scores_->ProbabilityOfEqual(residuals_[m], residuals_[than]);
    if (p >= kSignificant) return false;
    double comparable = 0;
    for (size_t i = 0; i < choice_.trials.size(); ++i) {
      comparable += choice_.trials[i].comparable && IsCandidate(i) ? 1 : 0;
    }
    return p * (comparable - 1) < kSignificant || scores_->Excess(residuals_[m], residuals_[than]) >
                                                      std::pow(NoiseOf(choice_.trials[than]), 2);
  }

  // A model that leaves parameters open is outweighed by one with fewer that is common, or no
  // rarer, and predicts as well or is more certain over the whole image by more than it loses on
  // held-out frames; a rarer model by a common one that loses less than the noise there and gains
  // more.
  [[nodiscard]] bool IsOutweighed(size_t m, size_t to) const {
    const ModelTrial &trial = choice_.trials[m], &other = choice_.trials[to];
    constexpr int kCommon = static_cast<int>(Usage::kCommon);
    if (!other.comparable || !other.undetermined.empty() || !HasLessFreedom(other, trial)) {
      return false;
    }
    const double gain = scores_->Excess(residuals_[to], residuals_[m]);
    const double cost = std::pow(trial.projection, 2) - std::pow(other.projection, 2);
    if (!trial.undetermined.empty()) {
      return Rarity(other) <= std::max(Rarity(trial), kCommon) &&
             (!IsClearlyWorse(to, m) || cost > gain);
    }
    const double noise = std::pow(NoiseOf(other), 2);
    return Rarity(other) <= kCommon && Rarity(trial) > kCommon && gain < noise && cost > noise;
  }

  void FindOutweighedByCertainty() {
    auto& trials = choice_.trials;
    for (size_t m = 0; m < trials.size(); ++m) {
      if (!trials[m].comparable || trials[m].outweighed_by) continue;
      for (size_t to = 0; to < trials.size() && !trials[m].outweighed_by; ++to) {
        if (!IsOutweighed(m, to)) continue;
        trials[m].outweighed_by = to;
        trials[m].gain = std::sqrt(std::max(0.0, scores_->Excess(residuals_[to], residuals_[m])));
      }
    }
  }

  void CompareWithReference() {
    auto& trials = choice_.trials;
    const ModelTrial& reference = trials[choice_.reference];
    ParallelFor(trials.size(), options_.threads, [&](size_t m) {
      ModelTrial& trial = trials[m];
      if (!trial.comparable || m == choice_.reference) return;
      trial.probability = scores_->ProbabilityOfEqual(residuals_[m], residuals_[choice_.reference]);
      trial.difference =
          SupportedDifference(reference.calibration, trial.calibration, choice_.varied);
    });
    choice_.noise = NoiseOf(reference);
    for (ModelTrial& trial : trials) {
      trial.practically_equal = trial.comparable &&
                                trial.difference < kPartOfNoise * choice_.noise &&
                                trial.difference < kPartOfSigma * reference.sigma;
    }
  }

  void Recommend() {
    auto& trials = choice_.trials;
    FindOutweighed();
    FindOutweighedByCertainty();
    for (size_t m = trials.size(); m-- > 0;) {
      if (trials[m].comparable && !trials[m].outweighed_by && IsCandidate(m)) choice_.reference = m;
    }
    CompareWithReference();
    choice_.recommended = choice_.reference;
    for (size_t m = 0; m < trials.size(); ++m) {
      const ModelTrial& trial = trials[m];
      if (!trial.comparable || trial.outweighed_by || !IsCandidate(m)) continue;
      // What few frames cannot decide is no reason for more parameters.
      const bool is_richer =
          Rarity(trial) >= 0 && trial.free_parameters > trials[choice_.reference].free_parameters;
      // Neither is what extrapolates so badly that the frames' scatter leaves it undecided.
      const bool is_far = scores_->Excess(residuals_[m], residuals_[choice_.reference]) >
                          choice_.noise * choice_.noise;
      if (!trial.practically_equal && (trial.probability < kSignificant || is_richer || is_far)) {
        continue;
      }
      const auto rank = [](const ModelTrial& each) {
        return std::tuple(
            !each.marker_freedom.IsRigid(), Rarity(each), each.free_parameters, each.rms);
      };
      if (rank(trial) < rank(trials[choice_.recommended])) choice_.recommended = m;
    }
    RecommendARarerModel();
    FindDisagreement();
  }

  // A rarer model that is clearly better than the recommended one takes its place.
  void RecommendARarerModel() {
    for (size_t m = 0; m < choice_.trials.size(); ++m) {
      const ModelTrial& trial = choice_.trials[m];
      if (IsCandidate(m) || !trial.comparable || trial.outweighed_by) continue;
      if (!IsClearlyWorse(choice_.recommended, m)) continue;
      choice_.recommended = choice_.reference = m;
      return CompareWithReference();
    }
  }

  void FindDisagreement() {
    const ModelTrial& recommended = choice_.trials[choice_.recommended];
    for (const ModelTrial& trial : choice_.trials) {
      if (!trial.comparable || trial.outweighed_by || !trial.undetermined.empty()) continue;
      if (trial.probability < kSignificant && !trial.practically_equal) continue;
      if (!std::isfinite(trial.difference)) continue;  // no pixel in common
      choice_.disagreement = std::max(
          choice_.disagreement,
          UnexplainedDifference(recommended.calibration, trial.calibration, choice_.varied));
    }
  }

  const CalibrationInput& input_;
  const TrialOptions& options_;
  std::vector<ModelCandidate> candidates_;  // in the order of the trials until these are sorted
  ModelChoice choice_;
  std::map<std::string, size_t> frames_;  // name -> place in the order of names
  std::vector<TrialPoint> points_;
  std::vector<bool> outliers_;                           // per point
  std::vector<std::vector<Bundle>> trained_;             // per trial and fold, without observations
  std::vector<std::vector<HeldOutResidual>> residuals_;  // per trial and point
  std::optional<HeldOutScores> scores_;
  bool scored_ = false;  // `comparable` of the trials is set
  std::mutex mutex_;
  size_t done_ = 0;  // calibrations
};

}  // namespace

bool OfOneKind(const CameraModel& a, const CameraModel& b) {
  return std::ranges::equal(a.measured, b.measured) && std::ranges::equal(a.context, b.context) &&
         std::ranges::equal(a.config, b.config, {}, &Param::name, &Param::name);
}

CalibrationInput WithModel(const CalibrationInput& session,
                           std::span<const size_t> varied,
                           const CameraModel& model) {
  CalibrationInput input = session;
  for (const size_t c : varied) {
    CameraInput& camera = input.cameras[c];
    if (camera.model == &model) continue;
    camera.model = &model;
    camera.initial.assign(model.params.size(), std::nullopt);
    camera.fixed.assign(model.params.size(), false);
    camera.rules.clear();
    for (CameraInput& other : input.cameras) {
      for (ParamRule& rule : other.rules) {
        if (rule.tied_to && rule.tied_to->camera == c) rule.tied_to.reset();
      }
    }
  }
  return input;
}

ModelChoice TryModels(const CalibrationInput& input,
                      std::vector<size_t> varied,
                      std::span<const CameraModel* const> models,
                      const TrialOptions& options) {
  std::vector<ModelCandidate> candidates;
  for (const CameraModel* model : models) {
    candidates.push_back(
        {model,
         input.marker_freedom,
         fmt::format("model {} of {} {}", candidates.size() + 1, models.size(), model->name)});
  }
  return Trials(input, std::move(varied), std::move(candidates), options).Run();
}

ModelChoice TryTargets(const CalibrationInput& input,
                       std::vector<size_t> varied,
                       MarkerFreedom refined,
                       const TrialOptions& options) {
  const CameraModel* const model = input.cameras[varied[0]].model;
  std::vector<ModelCandidate> candidates{
      {model, MarkerFreedom::Rigid(), "target 1 of 2 held rigid"},
      {model, refined, "target 2 of 2 refined"}};
  return Trials(input, std::move(varied), std::move(candidates), options).Run();
}

ModelAndTarget TryModelsAndTarget(CalibrationInput input,
                                  const std::vector<size_t>& varied,
                                  const std::vector<const CameraModel*>& models,
                                  MarkerFreedom refined,
                                  TargetQuestion question,
                                  const TrialOptions& options) {
  ModelAndTarget tried;
  const auto try_models = [&](std::span<const CameraModel* const> some) {
    if (some.empty()) return;
    tried.models = TryModels(input, varied, some, options);
    input = WithModel(input, varied, *tried.models.trials[tried.models.recommended].model);
  };
  std::vector<const CameraModel*> first = models;
  if (question == TargetQuestion::kChoose) {
    std::erase_if(first, [](const CameraModel* model) { return model->usage != Usage::kCommon; });
  }
  try_models(first.empty() ? models : first);
  if (question == TargetQuestion::kNone) return tried;
  tried.targets = TryTargets(input, varied, refined, options);
  if (question == TargetQuestion::kJudge) return tried;
  input.marker_freedom = tried.targets.trials[tried.targets.recommended].marker_freedom;
  if (!input.marker_freedom.IsRigid() || first.size() < models.size()) try_models(models);
  return tried;
}

}  // namespace plenocal
