// SPDX-License-Identifier: Apache-2.0
#include "calib/calibrate.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>

#include "calib/camera_noise.h"
#include "calib/common_errors.h"
#include "calib/error.h"
#include "calib/median.h"
#include "calib/parallel.h"
#include "calib/statistics.h"

namespace plenocal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kFalseRejections = 0.05;  // expected number of good observations rejected in all
constexpr double kFalseAlarm = 1e-3;       // of rigid, synchronous rigs that are not taken as such
constexpr int kMaxRounds = 10;
// The optimum moves with the square of a small change of the weights, the sigmas in proportion.
constexpr double kNoiseTolerance = 5e-3;
constexpr size_t kMinMarkersInFrame = 4;
// Exact (simulated) observations have no noise to estimate; below this they count as exact, px.
constexpr double kSmallestNoise = 1e-9;
constexpr double kExact = 1e-6;            // of observations whose noise is rounding, px
constexpr double kSmallestJitter = 1e-12;  // m and rad, likewise

class Calibrator {
 public:
  Calibrator(const CalibrationInput& input, const CalibrationOptions& options)
      : input_(input), options_(options) {}

  Calibration Run() {
    if (input_.cameras.empty()) throw Error(ErrorKind::kInput, "no camera to calibrate");
    Stage("start values");
    Start();
    Stage("bundle adjustment");
    Solve();
    Stage("uncertainty");
    TakeCommonErrors();
    JudgeOnePose();
    Report();
    return std::move(result_);
  }

 private:
  void Stage(const std::string& stage) const {
    if (options_.progress && !options_.progress(stage)) throw Stopped();
  }

  [[nodiscard]] size_t CameraCount() const { return input_.cameras.size(); }

  void Start() {
    starts_.resize(CameraCount());
    ParallelFor(CameraCount(), options_.threads, [&](size_t c) {
      starts_[c] = StartCamera(Alone(c), input_.markers);
    });
    const std::vector<RigidTransform> T_camera_rig = StartRig(input_.cameras, starts_);
    for (size_t c = 0; c < CameraCount(); ++c) {
      const CameraInput& camera = input_.cameras[c];
      result_.camera_names.push_back(camera.name);
      result_.image_sizes.push_back(camera.image_size);
      bundle().cameras.push_back(MakeBundleCamera(camera, starts_[c].params));
      bundle().cameras.back().T_camera_rig = T_camera_rig[c];
      bundle().cameras.back().is_master = c == 0;
    }
    for (size_t c = 0; c < CameraCount(); ++c) {
      for (size_t k = 0; k < bundle().cameras[c].params.size(); ++k) {
        const ParamPlace root = bundle().Root(c, k);
        bundle().cameras[c].params[k] = starts_[root.camera].params[root.param];
      }
    }
    bundle().marker_sigma = input_.marker_sigma;
    CollectObservations();
  }

  // A camera without what it has in common with others.
  [[nodiscard]] CameraInput Alone(size_t c) const {
    CameraInput camera = input_.cameras[c];
    for (ParamRule& rule : camera.rules) {
      if (!rule.same_as) continue;
      if (rule.same_as->camera == c) {
        rule.same_as->camera = 0;
      } else {
        rule.same_as.reset();
      }
    }
    return camera;
  }

  // Frames, markers and observations that take part, in their order.
  void CollectObservations() {
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
      const std::optional<RigidTransform> T_rig_target = FramePose(views);
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
      for (const InFrame& in_frame : views)
        AddView(in_frame.camera, in_frame.view, frame, marker_index);
    }
    FillSigmas();
    if (result_.frames.empty()) {
      throw Error(ErrorKind::kJob,
                  "no frame from which the camera's pose follows; nothing to calibrate");
    }
  }

  // The pose by one of the frame's cameras that explains all of them best.
  template <typename Views>
  std::optional<RigidTransform> FramePose(const Views& views) {
    std::optional<RigidTransform> best;
    double best_error = kInfinity;
    for (const auto& in_frame : views) {
      const auto& T_camera_target = starts_[in_frame.camera].T_camera_target[in_frame.view];
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
    return Median(std::move(errors));
  }

  void AddView(size_t c, size_t v, int frame, const std::map<int, int>& marker_index) {
    const View& view = input_.cameras[c].views[v];
    const size_t first = bundle().observations.size();
    for (size_t i = 0; i < view.observations.size(); ++i) {
      const Observation& observation = view.observations[i];
      const auto marker = marker_index.find(observation.marker);
      if (marker == marker_index.end()) {
        result_.left_out.push_back(
            {fmt::format(
                 "{} frame {} marker {}", input_.cameras[c].name, view.frame, observation.marker),
             "the target has no such marker"});
        continue;
      }
      bundle().observations.push_back(
          {static_cast<int>(c), frame, marker->second, observation, true});
      if (!view.shared_errors.empty()) {
        bundle().observations.back().shared_errors = view.shared_errors[i];
      }
    }
    std::stable_sort(bundle().observations.begin() + static_cast<std::ptrdiff_t>(first),
                     bundle().observations.end(),
                     [](const auto& a, const auto& b) { return a.marker < b.marker; });
  }

  static bool StatesSigmas(const CameraInput& camera) {
    for (const View& view : camera.views) {
      for (const Observation& seen : view.observations) {
        if (seen.sigma > 0) return true;
      }
    }
    return false;
  }

  // Sigmas of a camera whose observations came without, from these themselves.
  void TakeOwnNoise(size_t c) {
    const OwnFit fit = bundle().cameras[c].model->own_fit;
    if (fit == nullptr || StatesSigmas(input_.cameras[c])) return;
    std::vector<SeenPoint> points;
    for (const View& view : input_.cameras[c].views) AddPoints(view.observations, &points);
    const std::map<int, KindNoise> noise = NoiseByKind(points, fit);
    for (BundleObservation& observation : bundle().observations) {
      const auto own = noise.find(observation.seen.kind);
      if (observation.camera != static_cast<int>(c) || own == noise.end()) continue;
      observation.seen.sigma = std::max(own->second.sigma, kSmallestNoise);
    }
  }

  // An observation without a sigma gets the median of its camera's others, or 1: then the noise
  // that is estimated from the residuals is the sigma.
  void FillSigmas() {
    for (size_t c = 0; c < CameraCount(); ++c) {
      TakeOwnNoise(c);
      std::vector<double> sigmas;
      for (const BundleObservation& observation : bundle().observations) {
        if (observation.camera == static_cast<int>(c) && observation.seen.sigma > 0) {
          sigmas.push_back(observation.seen.sigma);
        }
      }
      const double typical = Median(sigmas, 1.0);
      typical_sigma_.push_back(typical);
      has_sigmas_.push_back(StatesSigmas(input_.cameras[c]));
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

  // Length of an observation's residual, px; infinite outside the model's domain.
  [[nodiscard]] double RawLength(size_t i, double weighted_length) const {
    const BundleObservation& observation = result_.bundle.observations[i];
    return weighted_length *
           NoiseSigma(result_.bundle.cameras[static_cast<size_t>(observation.camera)],
                      observation.seen);
  }

  // Noise of each camera from the median length of the residuals in some frames: not moved by
  // outliers.
  void EstimateNoiseRobustly(const std::vector<bool>& frames) {
    const std::vector<double> lengths = Lengths();
    std::vector<std::vector<double>> own(CameraCount());
    double coordinates = 0;
    for (size_t i = 0; i < lengths.size(); ++i) {
      const BundleObservation& observation = bundle().observations[i];
      if (!frames[static_cast<size_t>(observation.frame)]) continue;
      const auto c = static_cast<size_t>(observation.camera);
      own[c].push_back(RawLength(i, lengths[i]));
      coordinates += static_cast<double>(bundle().cameras[c].model->measured.size());
    }
    // The unknowns take up a part of the errors.
    double unknowns = 6.0 * static_cast<double>(std::count(frames.begin(), frames.end(), true));
    for (const BundleCamera& camera : bundle().cameras) {
      unknowns += static_cast<double>(camera.params.size());
    }
    if (bundle().marker_sigma > 0) unknowns += 3.0 * static_cast<double>(bundle().markers.size());
    const double left_over = std::sqrt(std::max(0.1, 1 - unknowns / coordinates));
    for (size_t c = 0; c < CameraCount(); ++c) {
      if (own[c].empty()) continue;
      const CameraModel& model = *bundle().cameras[c].model;
      const double median = Median(std::move(own[c]));
      if (!std::isfinite(median)) {
        throw Error(
            ErrorKind::kJob,
            fmt::format("{}: most observations lie outside the domain of model {}; does the model "
                        "suit the lens?",
                        input_.cameras[c].name,
                        model.name));
      }
      const int k = static_cast<int>(model.measured.size());
      SetNoise(c, median / std::sqrt(ChiSquareQuantile(k, 0.5)) / left_over);
    }
  }

  // Noise whose typical sigma is `sigma`: the stated sigmas scaled down where they are too large,
  // and a floor beside them where they are too small.
  void SetNoise(size_t c, double sigma) {
    BundleCamera& camera = bundle().cameras[c];
    const double stated = typical_sigma_[c];
    camera.noise_scale = std::clamp(sigma / stated, kSmallestNoise / stated, 1.0);
    camera.noise_floor = std::sqrt(std::max(0.0, sigma * sigma - stated * stated));
    camera.common_noise = 0;
  }

  [[nodiscard]] double TypicalNoise(size_t c) const {
    return NoiseSigma(result_.bundle.cameras[c], {.sigma = typical_sigma_[c]});
  }

  // Noise of each camera by the residuals that its used observations leave. Returns the largest
  // relative change.
  double EstimateNoise() {
    double change = 0;
    const std::vector<double> coordinates = UsedCoordinates();
    for (size_t c = 0; c < CameraCount(); ++c) {
      if (!(coordinates[c] > paid_coordinates_[c].all)) continue;
      BundleCamera& camera = bundle().cameras[c];
      const double before = TypicalNoise(c), common_before = camera.common_noise;
      const CameraNoise noise = EstimateCameraNoise(bundle(), c, paid_coordinates_[c]);
      camera.noise_scale = noise.scale;
      camera.noise_floor = noise.floor;
      camera.common_noise = noise.common;
      if (TypicalNoise(c) < kSmallestNoise) SetNoise(c, kSmallestNoise);
      change = std::max({change,
                         std::abs(TypicalNoise(c) / before - 1),
                         std::abs(camera.common_noise - common_before) / before});
    }
    return change;
  }

  // Applies the rejection rule; the number of observations that it takes out or back.
  size_t Reject(const std::vector<double>& lengths) {
    const double p = kFalseRejections / static_cast<double>(std::max<size_t>(1, lengths.size()));
    std::vector<double> thresholds;
    for (const BundleCamera& camera : bundle().cameras) {
      thresholds.push_back(
          std::sqrt(ChiSquareQuantile(static_cast<int>(camera.model->measured.size()), p)));
    }
    result_.rejection_threshold = *std::max_element(thresholds.begin(), thresholds.end());
    size_t changed = 0;
    std::vector<BundleObservation>& observations = bundle().observations;
    for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
      end = EndOfView(observations, begin);
      const double threshold = thresholds[static_cast<size_t>(observations[begin].camera)];
      size_t good = 0;
      for (size_t i = begin; i < end; ++i) good += lengths[i] <= threshold ? 1 : 0;
      // A view most of whose points disagree is wrong as a whole (a moved target, a false pose).
      const bool view_is_good = 2 * good >= end - begin;
      for (size_t i = begin; i < end; ++i) {
        const bool used = view_is_good && lengths[i] <= threshold;
        changed += used != observations[i].used ? 1 : 0;
        observations[i].used = used;
      }
    }
    return changed;
  }

  // Frames that rejection left with too few markers cannot hold a pose.
  void DropWeakFrames() {
    std::vector<size_t> markers(result_.frames.size(), 0);
    std::vector<int> last_frame(bundle().markers.size(), -1);  // that has counted the marker
    for (const BundleObservation& observation : bundle().observations) {
      int& last = last_frame[static_cast<size_t>(observation.marker)];
      if (!observation.used || last == observation.frame) continue;
      last = observation.frame;
      ++markers[static_cast<size_t>(observation.frame)];
    }
    for (BundleObservation& observation : bundle().observations) {
      if (markers[static_cast<size_t>(observation.frame)] < kMinMarkersInFrame) {
        observation.used = false;
      }
    }
  }

  // Returns the part by which the cost fell.
  double Adjust(double cost_tolerance) {
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
    return summary.cost < summary.cost_before ? 1 - summary.cost / summary.cost_before : 0;
  }

  // Up to `limit` frames of each camera, spread over the recording.
  [[nodiscard]] std::vector<bool> SelectFrames(size_t limit) const {
    std::vector<std::vector<int>> seen(CameraCount());
    for (const BundleObservation& observation : result_.bundle.observations) {
      auto& frames = seen[static_cast<size_t>(observation.camera)];
      if (frames.empty() || frames.back() != observation.frame) frames.push_back(observation.frame);
    }
    std::vector<bool> selected(result_.frames.size(), false);
    for (const auto& frames : seen) {
      const size_t count = std::min(limit, frames.size());
      for (size_t i = 0; i < count; ++i) {
        selected[static_cast<size_t>(frames[i * frames.size() / count])] = true;
      }
    }
    return selected;
  }

  void UseProjecting(const std::vector<bool>& frames) {
    const std::vector<double> lengths = Lengths();
    for (size_t i = 0; i < lengths.size(); ++i) {
      BundleObservation& observation = bundle().observations[i];
      observation.used =
          std::isfinite(lengths[i]) && frames[static_cast<size_t>(observation.frame)];
    }
  }

  // A rig is taken as rigid and its frames as synchronous until they show otherwise.
  void Solve() {
    const std::vector<BundleCamera> cameras = bundle().cameras;
    const std::vector<RigidTransform> T_rig_target = bundle().T_rig_target;
    const std::vector<BundleMarker> markers = bundle().markers;
    SolveRounds();
    if (FramesAgree()) return;
    bundle().cameras = cameras;
    bundle().T_rig_target = T_rig_target;
    bundle().markers = markers;
    StartJitter();
    SolveRounds();
  }

  // Whether the views of a frame see the target at one pose as well as their noise lets them: an
  // F-test of what poses of their own would gain, where that is more than half of some camera's
  // residuals (less is no worse than other errors of the model). Otherwise the noise of some
  // cameras stands for the frames' disagreement, and the others have taken all the weight.
  [[nodiscard]] bool FramesAgree() const {
    double noise = 0;
    for (size_t c = 0; c < CameraCount(); ++c) noise = std::max(noise, TypicalNoise(c));
    if (CameraCount() == 1 || noise < kExact) return true;
    const std::vector<PoseStep> steps = OwnPoseSteps(result_.bundle);
    const std::vector<double> coordinates = UsedCoordinates();
    std::set<int> frames;
    std::vector<double> gain(CameraCount(), 0.0), own_unknowns(CameraCount(), 0.0);
    for (const PoseStep& step : steps) {
      frames.insert(step.frame);
      gain[static_cast<size_t>(step.camera)] += step.gain;
      own_unknowns[static_cast<size_t>(step.camera)] += 6;
    }
    double all_gain = 0, squares = 0;
    bool dominates = false;  // the disagreement, over what the camera shows by itself
    for (size_t c = 0; c < CameraCount(); ++c) {
      // The noise is such that a camera's sum of squares equals its redundancy.
      const double own_squares = result_.uncertainty.redundancy[c];
      const double own_redundancy = coordinates[c] - own_unknowns[c] -
                                    static_cast<double>(result_.bundle.cameras[c].params.size());
      dominates = dominates || (own_squares - gain[c]) / own_redundancy < 0.5;
      all_gain += gain[c];
      squares += own_squares;
    }
    // The poses of the frames and the mounts have taken their part.
    const double unknowns = 6.0 * (static_cast<double>(steps.size()) -
                                   static_cast<double>(frames.size() + CameraCount() - 1));
    const double rest = squares - unknowns;
    if (!dominates || unknowns <= 0 || rest <= 0) return true;
    return FTail(all_gain / unknowns / ((squares - all_gain) / rest), unknowns, rest) > kFalseAlarm;
  }

  // Starts from what each camera sees alone.
  void StartJitter() {
    std::map<std::string, size_t> frames;
    for (size_t f = 0; f < result_.frames.size(); ++f) frames[result_.frames[f]] = f;
    Jitter& jitter = bundle().jitter;
    jitter.translation_sigma = jitter.rotation_sigma = 1;
    jitter.delta.assign(result_.frames.size() * CameraCount(), Vector6d::Zero());
    jitter.misplaced.assign(jitter.delta.size(), false);
    std::vector<double> displacements, turns;
    for (size_t c = 0; c < CameraCount(); ++c) {
      const RigidTransform T_rig_camera = bundle().cameras[c].T_camera_rig.Inverse();
      for (size_t v = 0; v < input_.cameras[c].views.size(); ++v) {
        const auto frame = frames.find(input_.cameras[c].views[v].frame);
        const auto& T_camera_target = starts_[c].T_camera_target[v];
        if (frame == frames.end() || !T_camera_target) continue;
        const RigidTransform seen = T_rig_camera * *T_camera_target;
        const RigidTransform& shared = bundle().T_rig_target[frame->second];
        Vector6d& delta = jitter.delta[bundle().View(frame->second, c)];
        delta << seen.t - shared.t, LogRotation(seen.R * shared.R.transpose());
        const Vector6d error = JitterWeight(bundle(), frame->second) * delta;
        if (error.norm() < kSmallestJitter) continue;  // the view that gave the frame its pose
        displacements.push_back(error.head<3>().norm());
        turns.push_back(error.tail<3>().norm());
      }
    }
    const double median = std::sqrt(ChiSquareQuantile(3, 0.5));
    jitter.translation_sigma = std::max(Median(displacements) / median, kSmallestJitter);
    jitter.rotation_sigma = std::max(Median(turns) / median, kSmallestJitter);
  }

  // As EstimateNoise, for the jitter; also judges which views are misplaced.
  double EstimateJitter() {
    Jitter& jitter = bundle().jitter;
    if (!(jitter.translation_sigma > 0)) return 0;
    std::set<std::pair<int, int>> used;  // (frame, camera)
    for (const BundleObservation& observation : bundle().observations) {
      if (observation.used) used.emplace(observation.frame, observation.camera);
    }
    double displacements = 0, turns = 0;  // sums of squares in sigmas
    std::vector<Vector6d> errors;         // parallel to `used`
    for (const auto& [frame, camera] : used) {
      const auto f = static_cast<size_t>(frame);
      const size_t view = bundle().View(f, static_cast<size_t>(camera));
      const Vector6d error = JitterWeight(bundle(), f) * jitter.delta[view];
      errors.push_back(error);
      if (jitter.misplaced[view]) continue;
      displacements += error.head<3>().squaredNorm();
      turns += error.tail<3>().squaredNorm();
    }
    const auto factor = [](double squares, double redundancy) {
      return redundancy > 0 ? std::sqrt(squares / redundancy) : 1;
    };
    const Uncertainty& uncertainty = result_.uncertainty;
    const double displacement = factor(displacements, uncertainty.jitter_translation_redundancy);
    const double turn = factor(turns, uncertainty.jitter_rotation_redundancy);
    jitter.translation_sigma = std::max(displacement * jitter.translation_sigma, kSmallestJitter);
    jitter.rotation_sigma = std::max(turn * jitter.rotation_sigma, kSmallestJitter);

    const double limit = ChiSquareQuantile(6, kFalseRejections / static_cast<double>(used.size()));
    auto error = errors.begin();
    for (const auto& [frame, camera] : used) {
      const size_t view = bundle().View(static_cast<size_t>(frame), static_cast<size_t>(camera));
      jitter.misplaced[view] = error->head<3>().squaredNorm() / (displacement * displacement) +
                                   error->tail<3>().squaredNorm() / (turn * turn) >
                               limit;
      ++error;
    }
    return std::max(std::abs(displacement - 1), std::abs(turn - 1));
  }

  void SolveRounds() {
    // First a part of the frames: it takes the long steps at a part of the cost.
    constexpr size_t kFirstFrames = 40;
    const std::vector<bool> first = SelectFrames(kFirstFrames);
    const bool has_jitter = bundle().jitter.translation_sigma > 0;
    EstimateNoiseRobustly(first);
    UseProjecting(first);
    Adjust(1e-3);
    EstimateNoiseRobustly(first);
    std::vector<bool> others = first;
    others.flip();
    UseProjecting(std::vector<bool>(first.size(), true));
    AdjustPoses(&bundle(), others);
    UseProjecting(std::vector<bool>(first.size(), true));
    DropWeakFrames();
    // Who is rejected and how large the noise is do not depend on the last digits of the optimum:
    // these wait until few are rejected any more. A fine solve that then lowers the cost by little
    // changes neither.
    constexpr double kCoarse = 1e-4;
    Settling settling;
    for (int round = 0;; ++round) {
      CheckEnough();
      const bool last = settling.at_once || round == kMaxRounds;
      const double gain = Adjust(settling.calm || last ? FineTolerance() : kCoarse);
      if (last || (settling.calm && gain < kCoarse)) break;
      if (round == 0 || has_jitter) CountPaidCoordinates();
      const double jitter_change = EstimateJitter();
      settling = SettleNoise(round == 0);
      if (jitter_change >= kNoiseTolerance) settling = {};
      DropWeakFrames();
    }
    result_.uncertainty = EstimateUncertainty(result_.bundle, result_.camera_names);
  }

  // How noise and rejections came to rest.
  struct Settling {
    bool at_once = false;  // the solve before has changed neither
    bool calm = false;     // with few rejections in all
  };

  // Noise and rejection follow from each other, without a solve between them once the worst are
  // out: not where those of the first round were in its solve.
  Settling SettleNoise(bool first_round) {
    // One observation in a thousand moves the optimum by less than a tenth of a sigma.
    constexpr double kFewChange = 1e-3;
    const double few = kFewChange * static_cast<double>(bundle().observations.size());
    double changed = 0;
    for (int settling = 0; settling < kMaxRounds; ++settling) {
      const double noise_change = EstimateNoise();
      const auto changed_now = static_cast<double>(Reject(Lengths()));
      changed += changed_now;
      if (changed_now <= few && noise_change < kNoiseTolerance) {
        return {.at_once = settling == 0, .calm = changed <= few};
      }
      if (first_round && changed_now > few) break;
    }
    return {};
  }

  [[nodiscard]] std::vector<double> UsedCoordinates() const {
    std::vector<double> coordinates(CameraCount(), 0.0);
    for (const BundleObservation& observation : result_.bundle.observations) {
      if (!observation.used) continue;
      const auto c = static_cast<size_t>(observation.camera);
      coordinates[c] += static_cast<double>(result_.bundle.cameras[c].model->measured.size());
    }
    return coordinates;
  }

  // How many of each camera's coordinates the unknowns take; a rejection changes it little.
  void CountPaidCoordinates() {
    const std::vector<double> coordinates = UsedCoordinates();
    paid_coordinates_.assign(CameraCount(), {});
    result_.uncertainty = EstimateUncertainty(result_.bundle, result_.camera_names);
    for (size_t c = 0; c < CameraCount(); ++c) {
      paid_coordinates_[c] = {coordinates[c] - result_.uncertainty.redundancy[c],
                              result_.uncertainty.paid_by_means[c]};
    }
  }

  // A step that lowers half the sum of squares (in sigmas) by d moves the unknowns by about
  // sqrt(2 d) sigma. The solver does not take the last one, which is a hundredth of a sigma at
  // most.
  [[nodiscard]] double FineTolerance() const {
    constexpr double kLastStep = 0.01;
    return std::clamp(
        kLastStep * kLastStep / 2 / static_cast<double>(result_.bundle.observations.size() + 1),
        1e-14,
        1e-7);
  }

  // Into the sigmas; those of frames where these disagree by more than noise explains.
  void TakeCommonErrors() {
    const CommonErrors errors = EstimateCommonErrors(result_.bundle, result_.uncertainty);
    std::vector<double> factors;
    for (const FrameScatter& scatter : errors.scatter) {
      const size_t c = factors.size();
      const double rest = result_.uncertainty.redundancy[c];
      const bool disagree = TypicalNoise(c) > kExact && scatter.factor > 1 &&
                            scatter.degrees >= 1 &&
                            FTail(scatter.factor, scatter.degrees, rest) < kFalseAlarm;
      factors.push_back(disagree ? scatter.factor : 1);
      if (!disagree) continue;
      result_.warnings.push_back(fmt::format(
          "{}: single frames ask for parameters that scatter {:.1f} times as far as the noise of "
          "their points explains: errors that the points of a frame share. The camera's sigmas are "
          "larger by this factor",
          result_.camera_names[c],
          std::sqrt(scatter.factor)));
    }
    AddCommonErrors(factors, errors.shared, &result_.uncertainty);
  }

  // Whether every camera has each marker at the same place in all frames, up to noise. The small
  // differences between the estimated poses are then noise as well.
  [[nodiscard]] bool ShowsOnePose() const {
    if (result_.frames.size() < 2) return false;
    struct Sums {
      double count = 0;
      std::array<double, kMaxObservationSize> sum{}, square{}, first{};
    };
    std::map<std::pair<int, int>, Sums> markers;  // (camera, marker)
    double degrees = 0, chi2 = 0;
    for (const BundleObservation& observation : result_.bundle.observations) {
      if (!observation.used) continue;
      Sums& sums = markers[{observation.camera, observation.marker}];
      if (sums.count++ == 0) sums.first = observation.seen.values;
      for (size_t r = 0; r < kMaxObservationSize; ++r) {
        const double value = observation.seen.values[r] - sums.first[r];
        sums.sum[r] += value;
        sums.square[r] += value * value;
      }
    }
    for (const auto& [key, sums] : markers) {
      const auto c = static_cast<size_t>(key.first);
      const double noise = TypicalNoise(c);
      for (size_t r = 0; r < result_.bundle.cameras[c].model->measured.size(); ++r) {
        degrees += sums.count - 1;
        chi2 += (sums.square[r] - sums.sum[r] * sums.sum[r] / sums.count) / (noise * noise);
      }
    }
    // Real movement exceeds noise by orders of magnitude; three sigma of vibration does not count.
    constexpr double kStill = 3;
    return degrees > 0 && chi2 < kStill * kStill * degrees;
  }

  // Frames from one pose say no more than one of them, so their information is that at one common
  // pose: there the directions that they leave open show as such.
  void JudgeOnePose() {
    if (!ShowsOnePose()) return;
    Bundle still = result_.bundle;
    for (RigidTransform& T : still.T_rig_target) T = still.T_rig_target[0];
    result_.uncertainty = EstimateUncertainty(still, result_.camera_names);
    NameOpenParameters();
    result_.warnings.push_back(fmt::format(
        "all {} frames show the target from one pose; they count as one. Move the target or the "
        "camera between images",
        result_.frames.size()));
  }

  // One view fixes few of a camera's parameters (a flat target's homography: two), and what seems
  // to fix the others is noise that the distortion has followed. Those worse than a hundredth of
  // their own size are named as open.
  void NameOpenParameters() {
    constexpr double kKnown = 0.01;
    Uncertainty& uncertainty = result_.uncertainty;
    for (size_t c = 0; c < CameraCount(); ++c) {
      const BundleCamera& camera = bundle().cameras[c];
      OpenDirection open{{}, kInfinity};
      for (size_t k = 0; k < camera.params.size(); ++k) {
        const Param& param = camera.model->params[k];
        double& sigma = uncertainty.params[c][k];
        if (sigma <= kKnown * std::max(std::abs(camera.params[k]), param.scale)) continue;
        sigma = kInfinity;
        open.parts.emplace_back(fmt::format("{}.{}", result_.camera_names[c], param.name), 1.0);
      }
      if (!open.parts.empty()) uncertainty.open.push_back(open);
    }
  }

  void CheckEnough() const {
    const std::vector<double> coordinates = UsedCoordinates();
    for (size_t c = 0; c < CameraCount(); ++c) {
      if (coordinates[c] == 0) {
        throw Error(
            ErrorKind::kJob,
            fmt::format("{}: no observation is left that agrees with the others; check that the "
                        "target file describes the target in the images",
                        input_.cameras[c].name));
      }
    }
  }

  void Report() {
    for (size_t c = 0; c < CameraCount(); ++c) {
      CameraFit fit;
      double sum = 0, sum_all = 0, count_all = 0;
      std::set<int> views;
      for (const BundleObservation& observation : bundle().observations) {
        if (observation.camera != static_cast<int>(c)) continue;
        double squared = 0;
        double residual[kMaxObservationSize];
        if (Residual(bundle(), observation, residual)) {
          for (size_t r = 0; r < bundle().cameras[c].model->measured.size(); ++r) {
            squared += residual[r] * residual[r];
          }
          sum_all += squared;
          ++count_all;
        }
        if (!observation.used) {
          ++fit.rejected;
          continue;
        }
        ++fit.points;
        views.insert(observation.frame);
        sum += squared;
        CameraFit::Kind& kind = fit.kinds[observation.seen.kind];
        ++kind.points;
        kind.rms += squared;  // its sum until the end
      }
      fit.views = static_cast<int>(views.size());
      fit.rms = std::sqrt(sum / std::max(1, fit.points));
      fit.rms_all = std::sqrt(sum_all / std::max(1.0, count_all));
      if (fit.kinds.size() < 2) fit.kinds.clear();
      for (auto& [number, kind] : fit.kinds) kind.rms = std::sqrt(kind.rms / kind.points);
      const Floor used = FloorOf(bundle(), c, [](const auto& o) { return o.used; });
      if (used.redundancy > 0) {
        fit.floor = used;
        fit.floor_all = FloorOf(bundle(), c, [&](const BundleObservation& o) {
          double residual[kMaxObservationSize];
          return Residual(bundle(), o, residual);
        });
      }
      fit.sigma = TypicalNoise(c);
      fit.stated_sigma = has_sigmas_[c] ? typical_sigma_[c] : 0;
      result_.fits.push_back(fit);
    }
    for (const CameraStart& start : starts_) {
      if (!start.misfit.empty()) result_.warnings.push_back(start.misfit);
    }
    WarnOfJitter();
    WarnOfRules();
    if (!result_.converged) {
      result_.warnings.emplace_back(
          "the bundle adjustment did not converge: the values may still be moving");
    }
  }

  // Bounds that hold an estimate, and priors that the images contradict: of a prior that is right,
  // estimate - value has the variance sigma^2 - (variance of the estimate).
  void WarnOfRules() {
    constexpr double kContradiction = 4;  // sigmas
    for (size_t c = 0; c < CameraCount(); ++c) {
      const BundleCamera& camera = bundle().cameras[c];
      for (size_t k = 0; k < camera.rules.size(); ++k) {
        const std::string name =
            fmt::format("{}.{}", result_.camera_names[c], camera.model->params[k].name);
        if (camera.at_bound[k] && !camera.rules[k].same_as) {
          result_.warnings.push_back(
              fmt::format("{} is held at its bound, {:.9g}: the images ask for a value beyond. It "
                          "has no sigma, and those of others are too small if the bound is wrong",
                          name,
                          camera.params[k]));
        }
        const auto& prior = camera.rules[k].prior;
        const double sigma = result_.uncertainty.params[c][k];
        if (!prior || !(sigma > 0) || !(sigma < prior->sigma)) continue;
        const double expected = std::sqrt(prior->sigma * prior->sigma - sigma * sigma);
        const double away = std::abs(camera.params[k] - prior->value) / expected;
        if (away < kContradiction) continue;
        result_.warnings.push_back(
            fmt::format("{}: images and prior disagree by {:.1f} sigma (prior {:.6g} +- {:.2g}, "
                        "with the images "
                        "{:.6g}); one of them is wrong",
                        name,
                        away,
                        prior->value,
                        prior->sigma,
                        camera.params[k]));
      }
    }
  }

  void WarnOfJitter() {
    const Jitter& jitter = bundle().jitter;
    if (!(jitter.translation_sigma > 0)) return;
    const auto misplaced = std::count(jitter.misplaced.begin(), jitter.misplaced.end(), true);
    result_.warnings.push_back(fmt::format(
        "the rig is not rigid or its frames are not synchronous: within a frame each camera sees "
        "the "
        "target displaced by {:.2g} mm along and turned by {:.2g} degrees about each axis "
        "(sigma){}. "
        "Images of a frame that were not taken at the same time, a mount that moves, frames with "
        "wrong names, or a model that does not suit the lens. The sigmas allow for it",
        1e3 * jitter.translation_sigma,
        jitter.rotation_sigma * 180 / std::numbers::pi,
        misplaced == 0 ? ""
                       : fmt::format("; {} images that are farther off count for their camera only",
                                     misplaced)));
  }

  Bundle& bundle() { return result_.bundle; }

  const CalibrationInput& input_;
  const CalibrationOptions& options_;
  Calibration result_;
  std::vector<CameraStart> starts_;
  std::vector<double> typical_sigma_;
  std::vector<bool> has_sigmas_;
  std::vector<PaidCoordinates> paid_coordinates_;  // per camera
};

}  // namespace

Calibration Calibrate(const CalibrationInput& input, const CalibrationOptions& options) {
  return Calibrator(input, options).Run();
}

}  // namespace plenocal
