// SPDX-License-Identifier: Apache-2.0
#include "calib/judge/model_trial.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <mutex>
#include <set>
#include <tuple>

#include "calib/adjust/problem.h"
#include "calib/base/error.h"
#include "calib/base/parallel.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

constexpr double kFalseRejections = 0.05;  // expected number of good points rejected in all
constexpr double kMostUnseen = 0.01;       // part of the points beyond the most complete model
constexpr double kSignificant = 0.05;
constexpr double kExact = 1e-6;  // px; smaller residuals are rounding

double Square(const double* residual, size_t count) {
  double square = 0;
  for (size_t r = 0; r < count; ++r) square += residual[r] * residual[r];
  return square;
}

// One observation of a varied camera.
struct Point {
  size_t camera = 0, view = 0, frame = 0;
  const Observation* seen = nullptr;
  bool outlier = false;
};

using PointName = std::tuple<size_t, std::string, int, std::array<double, kMaxObservationSize>>;

class Trials {
 public:
  Trials(const CalibrationInput& input,
         std::vector<size_t> varied,
         std::span<const CameraModel* const> models,
         const TrialOptions& options)
      : input_(input), options_(options) {
    choice_.varied = std::move(varied);
    for (const CameraModel* model : models) {
      choice_.trials.emplace_back();
      choice_.trials.back().model = model;
    }
    CollectPoints();
  }

  ModelChoice Run() {
    auto& trials = choice_.trials;
    ParallelFor(trials.size(), options_.threads, [&](size_t m) { CalibrateAll(&trials[m]); });
    FindOutliers();
    residuals_.assign(trials.size(), std::vector<Residuals>(points_.size()));
    std::vector<std::string> failures(trials.size() * choice_.folds);
    ParallelFor(failures.size(), options_.threads, [&](size_t i) {
      const size_t m = i / choice_.folds, fold = i % choice_.folds;
      if (trials[m].failure.empty()) failures[i] = HoldOut(m, fold);
    });
    for (size_t i = 0; i < failures.size(); ++i) {
      ModelTrial& trial = trials[i / choice_.folds];
      if (trial.failure.empty()) trial.failure = failures[i];
    }
    Score();
    Recommend();
    return std::move(choice_);
  }

 private:
  struct Residuals {
    bool imaged = false;
    std::array<double, kMaxObservationSize> values{};
  };

  void Stage(const std::string& stage) {
    const std::lock_guard lock(mutex_);
    if (options_.progress && !options_.progress(stage)) throw Stopped();
  }

  // The session with one model.
  CalibrationInput InputWith(const CameraModel& model) const {
    CalibrationInput input = input_;
    for (const size_t c : choice_.varied) {
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
        for (const Observation& seen : input_.cameras[c].views[v].observations) {
          if (input_.markers.contains(seen.marker)) points_.push_back({c, v, frame, &seen});
        }
      }
    }
    choice_.frames = frames_.size();
    if (choice_.frames < kFewestTrialFrames) {
      throw Error(ErrorKind::kJob,
                  fmt::format("{} frames are too few to hold some out; models can be judged from "
                              "{} frames on",
                              choice_.frames,
                              kFewestTrialFrames));
    }
    choice_.folds = std::min(choice_.frames, static_cast<size_t>(options_.folds));
  }

  void CalibrateAll(ModelTrial* trial) {
    const auto start = std::chrono::steady_clock::now();
    try {
      const std::string stage(trial->model->name);
      Stage(stage);
      trial->calibration =
          Calibrate(InputWith(*trial->model), {.threads = 1, .progress = [&](const std::string&) {
                                                 Stage(stage);
                                                 return true;
                                               }});
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
    trial->in_sample_rms = std::sqrt(squares / count);
  }

  // Sum of squares, each at most what the rejection rule allows, in the smallest noise that any
  // model shows.
  double CutOffSquares(const ModelTrial& trial, const std::map<size_t, double>& noise) const {
    const Bundle& bundle = trial.calibration.bundle;
    double sum = 0;
    for (const BundleObservation& observation : bundle.observations) {
      const auto c = noise.find(static_cast<size_t>(observation.camera));
      if (c == noise.end()) continue;
      const size_t count = bundle.cameras[c->first].model->measured.size();
      const double limit =
          ChiSquareQuantile(static_cast<int>(count),
                            kFalseRejections / static_cast<double>(bundle.observations.size()));
      double residual[kMaxObservationSize];
      sum += Residual(bundle, observation, residual)
                 ? std::min(limit, Square(residual, count) / (c->second * c->second))
                 : limit;
    }
    return sum;
  }

  void FindOutliers() {
    std::map<size_t, double> noise;
    for (const ModelTrial& trial : choice_.trials) {
      if (!trial.failure.empty()) continue;
      for (const size_t c : choice_.varied) {
        const double sigma = std::max(kExact, trial.calibration.fits[c].noise_sigma);
        const auto [place, is_new] = noise.emplace(c, sigma);
        place->second = std::min(place->second, sigma);
      }
    }
    const ModelTrial* sharpest = nullptr;
    double least = 0;
    for (const ModelTrial& trial : choice_.trials) {
      if (!trial.failure.empty()) continue;
      const double squares = CutOffSquares(trial, noise);
      if (sharpest == nullptr || squares < least) {
        sharpest = &trial;
        least = squares;
      }
    }
    if (sharpest == nullptr) {
      throw Error(ErrorKind::kJob,
                  fmt::format("no model can be calibrated; {}: {}",
                              choice_.trials[0].model->name,
                              choice_.trials[0].failure));
    }
    const Calibration& calibration = sharpest->calibration;
    std::set<PointName> used;
    for (const BundleObservation& observation : calibration.bundle.observations) {
      if (!observation.used) continue;
      used.emplace(static_cast<size_t>(observation.camera),
                   calibration.frames[static_cast<size_t>(observation.frame)],
                   observation.seen.marker,
                   observation.seen.values);
    }
    for (Point& point : points_) {
      const std::string& frame = input_.cameras[point.camera].views[point.view].frame;
      point.outlier = !used.contains({point.camera, frame, point.seen->marker, point.seen->values});
      choice_.outliers += point.outlier ? 1 : 0;
    }
  }

  // Adjusts without a fold, from the calibration with all frames, and fills `residuals_` of that
  // fold's points. Returns why it cannot.
  std::string HoldOut(size_t m, size_t fold) {
    const Calibration& calibration = choice_.trials[m].calibration;
    const std::string stage =
        fmt::format("{}: fold {} of {}", choice_.trials[m].model->name, fold + 1, choice_.folds);
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
      HeldOutPoses(trained, fold, &residuals_[m]);
      return {};
    } catch (const Error& error) {
      return fmt::format("without fold {}: {}", fold + 1, error.what());
    }
  }

  // Gives the frames of a fold the poses that fit best with all else held. Of a rig that is not
  // rigid each view gets its own.
  void HeldOutPoses(const Bundle& trained, size_t fold, std::vector<Residuals>* residuals) const {
    Bundle bundle;
    bundle.cameras = trained.cameras;
    for (BundleCamera& camera : bundle.cameras) {
      camera.fixed.assign(camera.params.size(), true);
      camera.rules.clear();
      camera.is_master = true;  // holds its place on the rig
    }
    bundle.markers = trained.markers;
    std::map<int, int> marker_index;
    for (size_t i = 0; i < bundle.markers.size(); ++i) {
      marker_index[bundle.markers[i].number] = static_cast<int>(i);
    }
    const bool own_poses = trained.jitter.translation_sigma > 0;
    std::vector<size_t> point_of;  // per observation
    for (size_t begin = 0; begin < points_.size();) {
      const auto together = [&](const Point& point) {
        return point.frame == points_[begin].frame &&
               (!own_poses || point.camera == points_[begin].camera);
      };
      size_t end = begin;
      while (end < points_.size() && together(points_[end])) ++end;
      if (points_[begin].frame % choice_.folds == fold) {
        AddFrame(begin, end, marker_index, &bundle, &point_of);
      }
      begin = end;
    }
    AdjustOptions adjust;
    adjust.cost_tolerance = 1e-12;
    const AdjustSummary summary = Adjust(&bundle, adjust);
    if (!summary.usable) throw Error(ErrorKind::kJob, "poses cannot be found: " + summary.message);
    for (size_t i = 0; i < point_of.size(); ++i) {
      Residuals& result = (*residuals)[point_of[i]];
      result.imaged = Residual(bundle, bundle.observations[i], result.values.data());
    }
  }

  // Points [begin, end) of one frame with a pose from resection; without one they stay unimaged.
  void AddFrame(size_t begin,
                size_t end,
                const std::map<int, int>& marker_index,
                Bundle* bundle,
                std::vector<size_t>* point_of) const {
    std::map<std::pair<size_t, size_t>, View> views;  // by camera and view: the good points
    for (size_t p = begin; p < end; ++p) {
      const Point& point = points_[p];
      if (!point.outlier) views[{point.camera, point.view}].observations.push_back(*point.seen);
    }
    std::map<int, Eigen::Vector3d> markers;
    for (const BundleMarker& marker : bundle->markers) markers[marker.number] = marker.position;
    const int frame = static_cast<int>(bundle->T_rig_target.size());
    const size_t first = bundle->observations.size();
    std::vector<size_t> order;
    for (size_t p = begin; p < end; ++p) order.push_back(p);
    std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
      return std::pair(points_[a].camera, marker_index.at(points_[a].seen->marker)) <
             std::pair(points_[b].camera, marker_index.at(points_[b].seen->marker));
    });
    for (const size_t p : order) {
      const Point& point = points_[p];
      bundle->observations.push_back({static_cast<int>(point.camera),
                                      frame,
                                      marker_index.at(point.seen->marker),
                                      *point.seen,
                                      !point.outlier});
      if (point.seen->detector_sigma > 0) {
        bundle->observations.back().assumed_sigma = point.seen->detector_sigma;
      }
    }
    bundle->T_rig_target.emplace_back();
    std::optional<RigidTransform> best;
    double least = 0;
    for (const auto& [place, view] : views) {
      const BundleCamera& camera = bundle->cameras[place.first];
      const auto T_camera_target = GuessPose(camera, view, markers);
      if (!T_camera_target) continue;
      bundle->T_rig_target.back() = camera.T_camera_rig.Inverse() * *T_camera_target;
      const double error = MedianLength(*bundle, first);
      if (best && error >= least) continue;
      best = bundle->T_rig_target.back();
      least = error;
    }
    if (!best) {
      bundle->observations.resize(first);
      bundle->T_rig_target.pop_back();
      return;
    }
    bundle->T_rig_target.back() = *best;
    for (size_t i = first; i < bundle->observations.size(); ++i) {
      BundleObservation& observation = bundle->observations[i];
      double residual[kMaxObservationSize];
      observation.used = observation.used && Residual(*bundle, observation, residual);
    }
    point_of->insert(point_of->end(), order.begin(), order.end());
  }

  static double MedianLength(const Bundle& bundle, size_t first) {
    std::vector<double> lengths;
    for (size_t i = first; i < bundle.observations.size(); ++i) {
      const BundleObservation& observation = bundle.observations[i];
      double residual[kMaxObservationSize];
      lengths.push_back(Residual(bundle, observation, residual)
                            ? WeightedLength(bundle, observation, residual)
                            : std::numeric_limits<double>::infinity());
    }
    return Median(std::move(lengths));
  }

  [[nodiscard]] double SquareOf(size_t m, size_t p) const {
    return Square(residuals_[m][p].values.data(), choice_.trials[m].model->measured.size());
  }

  // Sum of a model's squares in each frame over the points that count.
  [[nodiscard]] std::vector<double> FrameSquares(size_t m) const {
    std::vector<double> sums(choice_.frames, 0.0);
    for (size_t p = 0; p < points_.size(); ++p) {
      if (counts_[p]) sums[points_[p].frame] += SquareOf(m, p);
    }
    return sums;
  }

  // Mean a point of what frames sum up to, and its sigma.
  struct Mean {
    double value = 0, sigma = 0;
  };
  [[nodiscard]] Mean OverFrames(const std::vector<double>& sums) const {
    double sum = 0, count = 0;
    for (size_t f = 0; f < choice_.frames; ++f) {
      sum += sums[f];
      count += frame_points_[f];
    }
    Mean mean{.value = sum / count};
    double squares = 0;
    for (size_t f = 0; f < choice_.frames; ++f) {
      squares += std::pow(sums[f] - mean.value * frame_points_[f], 2);
    }
    const auto n = static_cast<double>(choice_.frames), k = static_cast<double>(choice_.folds);
    mean.sigma = std::sqrt(squares * n / (n - 1) * (1 + k / (k - 1))) / count;
    return mean;
  }

  // Of how much larger a model's squares are, frame by frame, if both were equally good.
  [[nodiscard]] double ProbabilityOfExcess(const std::vector<double>& squares,
                                           const std::vector<double>& of_best) const {
    std::vector<double> ratios(choice_.frames, 0.0);
    for (size_t f = 0; f < choice_.frames; ++f) {
      const double rounding = frame_points_[f] * kExact * kExact;
      if (rounding == 0) continue;
      ratios[f] = frame_points_[f] * std::log((squares[f] + rounding) / (of_best[f] + rounding));
    }
    const Mean mean = OverFrames(ratios);
    if (!(mean.value > 0)) return 1;
    return StudentTail(mean.value / mean.sigma, static_cast<double>(choice_.frames - 1));
  }

  // Of residuals that go along with the difference between this model's and another's predictions
  // as much as these do, if the other knew nothing that this one does not. Then the terms of frames
  // have no mean and do not correlate, since predictions of a frame do not know its noise.
  [[nodiscard]] double ProbabilityOfAgreement(size_t m, size_t other) const {
    std::vector<double> sums(choice_.frames, 0.0);
    const size_t rows = choice_.trials[m].model->measured.size();
    for (size_t p = 0; p < points_.size(); ++p) {
      if (!counts_[p]) continue;
      const auto& own = residuals_[m][p].values;
      const auto& of_other = residuals_[other][p].values;
      for (size_t r = 0; r < rows; ++r) {
        if (std::abs(own[r] - of_other[r]) < kExact) continue;
        sums[points_[p].frame] += own[r] * (own[r] - of_other[r]);
      }
    }
    double sum = 0, squares = 0;
    const auto n = static_cast<double>(choice_.frames);
    for (const double each : sums) sum += each;
    for (const double each : sums) squares += std::pow(each - sum / n, 2);
    if (!(sum > 0)) return 1;
    return StudentTail(sum / std::sqrt(squares * n / (n - 1)), n - 1);
  }

  void Score() {
    auto& trials = choice_.trials;
    double good = 0, most = 0;
    for (const Point& point : points_) good += point.outlier ? 0 : 1;
    for (size_t m = 0; m < trials.size(); ++m) {
      if (!trials[m].failure.empty()) continue;
      double imaged = 0;
      for (size_t p = 0; p < points_.size(); ++p) {
        imaged += !points_[p].outlier && residuals_[m][p].imaged ? 1 : 0;
      }
      trials[m].unseen = 1 - imaged / good;
      most = std::max(most, imaged);
    }
    if (most == 0) {
      throw Error(ErrorKind::kJob,
                  fmt::format("no model can be judged; {}: {}",
                              trials[0].model->name,
                              trials[0].failure.empty() ? "images no point of held-out frames"
                                                        : trials[0].failure));
    }
    counts_.resize(points_.size());
    for (size_t p = 0; p < points_.size(); ++p) counts_[p] = !points_[p].outlier;
    for (size_t m = 0; m < trials.size(); ++m) {
      trials[m].comparable =
          trials[m].failure.empty() && trials[m].unseen <= 1 - most / good + kMostUnseen;
      if (!trials[m].comparable) continue;
      for (size_t p = 0; p < points_.size(); ++p) {
        counts_[p] = counts_[p] && residuals_[m][p].imaged;
      }
    }
    frame_points_.assign(choice_.frames, 0.0);
    for (size_t p = 0; p < points_.size(); ++p) {
      if (!counts_[p]) continue;
      ++choice_.points;
      frame_points_[points_[p].frame] += 1;
    }
    std::vector<std::vector<double>> squares(trials.size());
    size_t best = trials.size();
    for (size_t m = 0; m < trials.size(); ++m) {
      ModelTrial& trial = trials[m];
      if (!trial.comparable) continue;
      squares[m] = FrameSquares(m);
      const Mean mean = OverFrames(squares[m]);
      trial.rms = std::sqrt(mean.value);
      trial.rms_sigma = mean.value > 0 ? mean.sigma / (2 * trial.rms) : 0;
      if (best == trials.size() || trial.rms < trials[best].rms) best = m;
      for (size_t p = 0; p < points_.size(); ++p) {
        if (!counts_[p]) continue;
        trial.held_out.push_back({points_[p].camera, *points_[p].seen, residuals_[m][p].values});
      }
    }
    for (size_t m = 0; m < trials.size(); ++m) {
      if (!trials[m].comparable) continue;
      double rivals = 0, least = 1;
      for (size_t other = 0; other < trials.size(); ++other) {
        if (!trials[other].comparable || other == m) continue;
        ++rivals;
        // One that predicts worse is no reason to choose another, whatever it knows.
        if (trials[other].rms < trials[m].rms) {
          least = std::min(least, ProbabilityOfAgreement(m, other));
        }
      }
      // Of so many tests one in twenty must not fail by chance.
      trials[m].probability = std::min(1.0, rivals * least);
      if (m == best) continue;
      trials[m].probability =
          std::min(trials[m].probability, ProbabilityOfExcess(squares[m], squares[best]));
    }
  }

  void Recommend() {
    auto& trials = choice_.trials;
    std::stable_sort(trials.begin(), trials.end(), [](const ModelTrial& a, const ModelTrial& b) {
      return std::tuple(!a.failure.empty(), !a.comparable, a.comparable ? a.rms : a.unseen) <
             std::tuple(!b.failure.empty(), !b.comparable, b.comparable ? b.rms : b.unseen);
    });
    // The best has probability 1.
    for (size_t m = 1; m < trials.size(); ++m) {
      if (trials[m].comparable && trials[m].probability >= kSignificant &&
          trials[m].free_parameters < trials[choice_.recommended].free_parameters) {
        choice_.recommended = m;
      }
    }
  }

  const CalibrationInput& input_;
  const TrialOptions& options_;
  ModelChoice choice_;
  std::map<std::string, size_t> frames_;  // name -> place in the order of names
  std::vector<Point> points_;
  std::vector<std::vector<Residuals>> residuals_;  // per model and point, of the held-out frame
  std::vector<bool> counts_;                       // per point: it is part of the scores
  std::vector<double> frame_points_;               // how many of these each frame has
  std::mutex mutex_;
};

}  // namespace

bool OfOneKind(const CameraModel& a, const CameraModel& b) {
  return std::ranges::equal(a.measured, b.measured) && std::ranges::equal(a.context, b.context) &&
         std::ranges::equal(a.config, b.config, {}, &Param::name, &Param::name);
}

ModelChoice TryModels(const CalibrationInput& input,
                      std::vector<size_t> varied,
                      std::span<const CameraModel* const> models,
                      const TrialOptions& options) {
  return Trials(input, std::move(varied), models, options).Run();
}

}  // namespace plenocal
