// SPDX-License-Identifier: Apache-2.0
#include "calib/calibrate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "calib/error.h"
#include "calib/parallel.h"

namespace plenocal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kFalseRejections = 0.05;  // expected number of good observations rejected in all
constexpr int kMaxRounds = 10;
constexpr size_t kMinMarkersInFrame = 4;
// Exact (simulated) observations have no noise to estimate; below this they count as exact, px.
constexpr double kSmallestNoise = 1e-9;

// P(chi-square with k degrees of freedom > x), k >= 1: Q(k/2, x/2) by its recurrence in k.
double ChiSquareTail(int k, double x) {
  const double h = x / 2;
  double q = k % 2 == 1 ? std::erfc(std::sqrt(h)) : std::exp(-h);
  double a = k % 2 == 1 ? 0.5 : 1.0;
  for (; 2 * a < k; a += 1) q += std::exp(a * std::log(h) - h - std::lgamma(a + 1));
  return q;
}

// x with ChiSquareTail(k, x) = p.
double ChiSquareQuantile(int k, double p) {
  double low = 0, high = 1;
  while (ChiSquareTail(k, high) > p) high *= 2;
  for (int i = 0; i < 100; ++i) {
    const double middle = (low + high) / 2;
    (ChiSquareTail(k, middle) > p ? low : high) = middle;
  }
  return high;
}

class Calibrator {
 public:
  Calibrator(const CalibrationInput& input, const CalibrationOptions& options)
      : input_(input), options_(options) {}

  Calibration Run() {
    Stage("start values");
    Start();
    Stage("bundle adjustment");
    Solve();
    Stage("uncertainty");
    Report();
    return std::move(result_);
  }

 private:
  void Stage(const std::string& stage) const {
    if (options_.progress && !options_.progress(stage)) throw Stopped();
  }

  [[nodiscard]] size_t CameraCount() const { return input_.cameras.size(); }

  void Start() {
    std::vector<CameraStart> starts(CameraCount());
    ParallelFor(CameraCount(), options_.threads, [&](size_t c) {
      starts[c] = StartCamera(input_.cameras[c], input_.markers);
    });
    const std::vector<RigidTransform> T_camera_rig = StartRig(input_.cameras, starts);
    for (size_t c = 0; c < CameraCount(); ++c) {
      const CameraInput& camera = input_.cameras[c];
      result_.camera_names.push_back(camera.name);
      result_.image_sizes.push_back(camera.image_size);
      bundle().cameras.push_back({.model = camera.model,
                                  .config = camera.config,
                                  .params = starts[c].params,
                                  .fixed = camera.fixed,
                                  .T_camera_rig = T_camera_rig[c],
                                  .is_master = c == 0});
    }
    bundle().marker_sigma = input_.marker_sigma;
    CollectObservations(starts);
  }

  // Frames, markers and observations that take part, in their order.
  void CollectObservations(const std::vector<CameraStart>& starts) {
    struct InFrame {
      size_t camera, view;
    };
    std::map<std::string, std::vector<InFrame>> frames;
    for (size_t c = 0; c < CameraCount(); ++c) {
      for (size_t v = 0; v < input_.cameras[c].views.size(); ++v) {
        frames[input_.cameras[c].views[v].frame].push_back({c, v});
      }
    }
    std::set<int> seen_markers;
    for (const auto& [number, position] : input_.markers) seen_markers.insert(number);
    std::map<int, int> marker_index;
    for (const int number : seen_markers) {
      marker_index[number] = static_cast<int>(bundle().markers.size());
      const Eigen::Vector3d& position = input_.markers.at(number);
      bundle().markers.push_back({number, position, position});
    }

    for (const auto& [name, views] : frames) {
      const std::optional<RigidTransform> T_rig_target = FramePose(views, starts);
      if (!T_rig_target) {
        result_.left_out.push_back(
            {fmt::format("frame {}", name),
             fmt::format("no camera sees {} or more markers from which its pose follows",
                         kMinMarkersInFrame)});
        continue;
      }
      const int frame = static_cast<int>(result_.frames.size());
      result_.frames.push_back(name);
      bundle().T_rig_target.push_back(*T_rig_target);
      for (const InFrame& in_frame : views) AddView(in_frame.camera, in_frame.view, frame, marker_index);
    }
    FillSigmas();
    if (result_.frames.empty()) {
      throw Error(ErrorKind::kJob, "no frame from which the camera's pose follows; nothing to calibrate");
    }
  }

  // The pose by one of the frame's cameras that explains all of them best.
  template <typename Views>
  std::optional<RigidTransform> FramePose(const Views& views, const std::vector<CameraStart>& starts) {
    std::optional<RigidTransform> best;
    double best_error = kInfinity;
    for (const auto& in_frame : views) {
      const auto& T_camera_target = starts[in_frame.camera].T_camera_target[in_frame.view];
      if (!T_camera_target) continue;
      const RigidTransform T_rig_target =
          bundle().cameras[in_frame.camera].T_camera_rig.Inverse() * *T_camera_target;
      if (views.size() == 1) return T_rig_target;
      double error = 0;
      for (const auto& other : views) {
        error += MedianError(other.camera,
                             input_.cameras[other.camera].views[other.view],
                             bundle().cameras[other.camera].T_camera_rig * T_rig_target);
      }
      if (!best || error < best_error) {
        best = T_rig_target;
        best_error = error;
      }
    }
    return best;
  }

  double MedianError(size_t camera, const View& view, const RigidTransform& T_camera_target) {
    constexpr size_t kSample = 20;
    const BundleCamera& c = bundle().cameras[camera];
    std::vector<double> errors;
    const size_t stride = view.observations.size() / kSample + 1;
    for (size_t i = 0; i < view.observations.size(); i += stride) {
      const Observation& observation = view.observations[i];
      const auto marker = input_.markers.find(observation.marker);
      if (marker == input_.markers.end()) continue;
      double predicted[kMaxObservationSize];
      double sum = 0;
      if (c.model->project(c.params.data(),
                           c.config.data(),
                           observation.values.data(),
                           T_camera_target * marker->second,
                           predicted)) {
        for (size_t r = 0; r < c.model->measured.size(); ++r) {
          sum += std::pow(observation.values[r] - predicted[r], 2);
        }
      } else {
        sum = 1e12;  // worse than any image is wide, but still a number to add
      }
      errors.push_back(std::sqrt(sum));
    }
    if (errors.empty()) return 0;
    const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
    std::nth_element(errors.begin(), middle, errors.end());
    return *middle;
  }

  void AddView(size_t c, size_t v, int frame, const std::map<int, int>& marker_index) {
    const View& view = input_.cameras[c].views[v];
    const size_t first = bundle().observations.size();
    for (const Observation& observation : view.observations) {
      const auto marker = marker_index.find(observation.marker);
      if (marker == marker_index.end()) {
        result_.left_out.push_back(
            {fmt::format("{} frame {} marker {}", input_.cameras[c].name, view.frame, observation.marker),
             "the target has no such marker"});
        continue;
      }
      bundle().observations.push_back(
          {static_cast<int>(c), frame, marker->second, observation, true});
    }
    std::stable_sort(bundle().observations.begin() + static_cast<std::ptrdiff_t>(first),
                     bundle().observations.end(),
                     [](const auto& a, const auto& b) { return a.marker < b.marker; });
  }

  // An observation without a sigma gets the median of its camera's others, or 1: then the noise that is
  // estimated from the residuals is the sigma.
  void FillSigmas() {
    for (size_t c = 0; c < CameraCount(); ++c) {
      std::vector<double> sigmas;
      for (const BundleObservation& observation : bundle().observations) {
        if (observation.camera == static_cast<int>(c) && observation.seen.sigma > 0) {
          sigmas.push_back(observation.seen.sigma);
        }
      }
      double typical = 1;
      if (!sigmas.empty()) {
        const auto middle = sigmas.begin() + static_cast<std::ptrdiff_t>(sigmas.size() / 2);
        std::nth_element(sigmas.begin(), middle, sigmas.end());
        typical = *middle;
      }
      typical_sigma_.push_back(typical);
      has_sigmas_.push_back(!sigmas.empty());
      for (BundleObservation& observation : bundle().observations) {
        if (observation.camera == static_cast<int>(c) && !(observation.seen.sigma > 0)) {
          observation.seen.sigma = typical;
        }
      }
    }
  }

  // Lengths of all residuals in sigmas; infinite outside the model's domain.
  [[nodiscard]] std::vector<double> Lengths() const {
    std::vector<double> lengths(result_.bundle.observations.size());
    for (size_t i = 0; i < lengths.size(); ++i) {
      const BundleObservation& observation = result_.bundle.observations[i];
      double residual[kMaxObservationSize];
      lengths[i] = Residual(result_.bundle, observation, residual)
                       ? WeightedLength(result_.bundle, observation, residual)
                       : kInfinity;
    }
    return lengths;
  }

  // Noise of each camera from the median length of its residuals: not moved by outliers.
  void EstimateNoiseRobustly() {
    const std::vector<double> lengths = Lengths();
    for (size_t c = 0; c < CameraCount(); ++c) {
      BundleCamera& camera = bundle().cameras[c];
      std::vector<double> own;
      for (size_t i = 0; i < lengths.size(); ++i) {
        if (bundle().observations[i].camera == static_cast<int>(c)) own.push_back(lengths[i]);
      }
      if (own.empty()) continue;
      const auto middle = own.begin() + static_cast<std::ptrdiff_t>(own.size() / 2);
      std::nth_element(own.begin(), middle, own.end());
      if (!std::isfinite(*middle)) {
        throw Error(ErrorKind::kJob,
                    fmt::format("{}: most observations lie outside the domain of model {}; does the model "
                                "suit the lens?",
                                input_.cameras[c].name,
                                camera.model->name));
      }
      const int k = static_cast<int>(camera.model->measured.size());
      SetNoise(c, camera.noise * *middle / std::sqrt(ChiSquareQuantile(k, 0.5)));
    }
  }

  void SetNoise(size_t c, double noise) {
    bundle().cameras[c].noise = std::max(noise, kSmallestNoise / typical_sigma_[c]);
  }

  // Noise of each camera from the sum of squares of its used residuals over their redundancy.
  // Returns the largest relative change.
  double EstimateNoise(const std::vector<double>& lengths) {
    std::vector<double> squares(CameraCount(), 0.0);
    for (size_t i = 0; i < lengths.size(); ++i) {
      const BundleObservation& observation = bundle().observations[i];
      if (observation.used) {
        squares[static_cast<size_t>(observation.camera)] += lengths[i] * lengths[i];
      }
    }
    double change = 0;
    for (size_t c = 0; c < CameraCount(); ++c) {
      const double redundancy = result_.uncertainty.redundancy[c];
      if (!(redundancy > 0)) continue;
      const double factor = std::sqrt(squares[c] / redundancy);
      const double before = bundle().cameras[c].noise;
      SetNoise(c, before * factor);
      change = std::max(change, std::abs(bundle().cameras[c].noise / before - 1));
    }
    return change;
  }

  // Applies the rejection rule; true when the set of used observations changed.
  bool Reject(const std::vector<double>& lengths) {
    bool changed = false;
    const double p = kFalseRejections / static_cast<double>(std::max<size_t>(1, lengths.size()));
    std::map<std::pair<int, int>, std::pair<int, int>> views;  // (frame, camera) -> (good, all)
    std::vector<bool> good(lengths.size());
    std::vector<double> thresholds;
    for (const BundleCamera& camera : bundle().cameras) {
      thresholds.push_back(
          std::sqrt(ChiSquareQuantile(static_cast<int>(camera.model->measured.size()), p)));
    }
    result_.rejection_threshold = *std::max_element(thresholds.begin(), thresholds.end());
    for (size_t i = 0; i < lengths.size(); ++i) {
      const BundleObservation& observation = bundle().observations[i];
      good[i] = lengths[i] <= thresholds[static_cast<size_t>(observation.camera)];
      auto& [good_count, all] = views[{observation.frame, observation.camera}];
      good_count += good[i] ? 1 : 0;
      ++all;
    }
    for (size_t i = 0; i < lengths.size(); ++i) {
      BundleObservation& observation = bundle().observations[i];
      const auto& [good_count, all] = views.at({observation.frame, observation.camera});
      // A view most of whose points disagree is wrong as a whole (a moved target, a false pose).
      const bool used = good[i] && 2 * good_count >= all;
      changed = changed || used != observation.used;
      observation.used = used;
    }
    return changed;
  }

  // Frames that rejection left with too few markers cannot hold a pose.
  void DropWeakFrames() {
    std::vector<std::set<int>> markers(result_.frames.size());
    for (const BundleObservation& observation : bundle().observations) {
      if (observation.used) {
        markers[static_cast<size_t>(observation.frame)].insert(observation.marker);
      }
    }
    for (BundleObservation& observation : bundle().observations) {
      if (markers[static_cast<size_t>(observation.frame)].size() < kMinMarkersInFrame) {
        observation.used = false;
      }
    }
  }

  void Adjust(double cost_tolerance) {
    AdjustOptions options;
    options.loss = input_.loss;
    options.cost_tolerance = cost_tolerance;
    options.on_iteration = [&](int, double) {
      return !options_.progress || options_.progress("bundle adjustment");
    };
    const AdjustSummary summary = plenocal::Adjust(&bundle(), options);
    result_.iterations += summary.iterations;
    result_.converged = summary.converged;
    if (summary.stopped) throw Stopped();
    if (!summary.usable) {
      throw Error(ErrorKind::kJob, "the bundle adjustment failed: " + summary.message);
    }
  }

  void Solve() {
    EstimateNoiseRobustly();
    const std::vector<double> lengths = Lengths();
    for (size_t i = 0; i < lengths.size(); ++i) {
      bundle().observations[i].used = std::isfinite(lengths[i]);
    }
    Adjust(1e-3);
    EstimateNoiseRobustly();
    Reject(Lengths());
    DropWeakFrames();
    CheckEnough();
    Adjust(1e-6);
    for (int round = 0; round < kMaxRounds; ++round) {
      result_.uncertainty = EstimateUncertainty(result_.bundle, result_.camera_names);
      const double noise_change = EstimateNoise(Lengths());
      const bool set_changed = Reject(Lengths());
      if (set_changed) {
        DropWeakFrames();
        CheckEnough();
      }
      // The optimum moves with the square of a small change of the weights.
      constexpr double kNoiseTolerance = 1e-2;
      const bool settled = !set_changed && noise_change < kNoiseTolerance;
      Adjust(1e-11);
      if (settled) break;
    }
    result_.uncertainty = EstimateUncertainty(result_.bundle, result_.camera_names);
  }

  void CheckEnough() const {
    std::vector<double> coordinates(CameraCount(), 0.0);
    std::set<int> frames;
    for (const BundleObservation& observation : result_.bundle.observations) {
      if (!observation.used) continue;
      const auto c = static_cast<size_t>(observation.camera);
      coordinates[c] += static_cast<double>(result_.bundle.cameras[c].model->measured.size());
      frames.insert(observation.frame);
    }
    for (size_t c = 0; c < CameraCount(); ++c) {
      if (coordinates[c] == 0) {
        throw Error(ErrorKind::kJob,
                    fmt::format("{}: no observation is left that agrees with the others; check that the "
                                "target file describes the target in the images",
                                input_.cameras[c].name));
      }
    }
  }

  void Report() {
    for (size_t c = 0; c < CameraCount(); ++c) {
      CameraFit fit;
      double sum = 0;
      std::set<int> views;
      for (const BundleObservation& observation : bundle().observations) {
        if (observation.camera != static_cast<int>(c)) continue;
        if (!observation.used) {
          ++fit.rejected;
          continue;
        }
        ++fit.points;
        views.insert(observation.frame);
        double residual[kMaxObservationSize];
        if (!Residual(bundle(), observation, residual)) continue;
        for (size_t r = 0; r < bundle().cameras[c].model->measured.size(); ++r) {
          sum += residual[r] * residual[r];
        }
      }
      fit.views = static_cast<int>(views.size());
      fit.rms = std::sqrt(sum / std::max(1, fit.points));
      fit.sigma = bundle().cameras[c].noise * typical_sigma_[c];
      fit.noise_factor = has_sigmas_[c] ? bundle().cameras[c].noise : 0;
      result_.fits.push_back(fit);
    }
    if (!result_.converged) {
      result_.warnings.emplace_back(
          "the bundle adjustment did not converge: the values may still be moving");
    }
  }

  Bundle& bundle() { return result_.bundle; }

  const CalibrationInput& input_;
  const CalibrationOptions& options_;
  Calibration result_;
  std::vector<double> typical_sigma_;
  std::vector<bool> has_sigmas_;
};

}  // namespace

Calibration Calibrate(const CalibrationInput& input, const CalibrationOptions& options) {
  return Calibrator(input, options).Run();
}

}  // namespace plenocal
