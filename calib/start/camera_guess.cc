// SPDX-License-Identifier: Apache-2.0
#include "calib/start/camera_guess.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <utility>

#include "calib/adjust/solver/adjust.h"
#include "calib/base/format_error.h"
#include "calib/base/statistics.h"
#include "calib/camera/rays.h"
#include "calib/camera/resection.h"
#include "calib/noise/camera_noise.h"

namespace plenocal {
namespace {

// Enough views and points for an initial guess; more add time and no certainty.
constexpr size_t kStartViews = 12;
constexpr size_t kStartPoints = 40;
constexpr size_t kMinPoints = 4;  // a pose has six unknowns, and three points leave four solutions
constexpr size_t kAdjustedCandidates = 4;
// Candidates whose median residual is at most this factor larger than the best are kept: twice the
// scatter that the selection of views causes.
constexpr double kAsGood = 1.5;
constexpr double kSmallestScale = 1e-9;  // px; keeps weights finite where residuals are zero
// Residuals larger than this, px, beyond what the markers' errors explain: the guess may have ended
// in a wrong minimum.
constexpr double kSuspiciousMedian = 1;
constexpr double kNoResidual = std::numeric_limits<double>::infinity();

// All observations of at most `limit` known markers, spread evenly over the view.
View Thinned(const View& view, const std::map<int, Eigen::Vector3d>& markers, size_t limit) {
  std::vector<int> seen;
  for (const Observation& observation : view.observations) {
    if (markers.contains(observation.marker)) seen.push_back(observation.marker);
  }
  std::sort(seen.begin(), seen.end());
  seen.erase(std::unique(seen.begin(), seen.end()), seen.end());
  std::set<int> kept;
  const size_t count = std::min(limit, seen.size());
  for (size_t i = 0; i < count; ++i) kept.insert(seen[i * seen.size() / count]);
  View thinned{view.frame, {}};
  for (const Observation& observation : view.observations) {
    if (kept.contains(observation.marker)) thinned.observations.push_back(observation);
  }
  return thinned;
}

// The views with most observations, at most `limit`, in their order.
std::vector<View> Selection(const CameraInput& camera,
                            const std::map<int, Eigen::Vector3d>& markers,
                            size_t limit) {
  size_t most = 0;
  for (const View& view : camera.views) most = std::max(most, view.observations.size());
  std::vector<size_t> rich;
  for (size_t i = 0; i < camera.views.size(); ++i) {
    // Views with at least half of the richest count; among them those spread over the recording
    // differ more in pose than neighbours in time.
    if (2 * camera.views[i].observations.size() >= most) rich.push_back(i);
  }
  if (rich.size() < limit) {
    rich.clear();
    for (size_t i = 0; i < camera.views.size(); ++i) rich.push_back(i);
    std::stable_sort(rich.begin(), rich.end(), [&](size_t a, size_t b) {
      return camera.views[a].observations.size() > camera.views[b].observations.size();
    });
    rich.resize(std::min(rich.size(), limit));
    std::sort(rich.begin(), rich.end());
  }
  std::vector<View> selection;
  const size_t count = std::min(limit, rich.size());
  for (size_t i = 0; i < count; ++i) {
    View view = Thinned(camera.views[rich[i * rich.size() / count]], markers, kStartPoints);
    if (view.observations.size() >= kMinPoints) selection.push_back(std::move(view));
  }
  return selection;
}

std::optional<Resection> ResectView(const BundleCamera& camera,
                                    const View& view,
                                    const std::map<int, Eigen::Vector3d>& markers) {
  std::vector<std::array<double, kMaxObservationSize>> values;
  for (const Observation& observation : view.observations) values.push_back(observation.values);
  const std::vector<std::optional<Ray>> found = Unproject(camera, values);
  std::vector<Ray> rays;
  std::vector<Eigen::Vector3d> points;
  for (size_t i = 0; i < found.size(); ++i) {
    if (!found[i]) continue;
    rays.push_back(*found[i]);
    points.push_back(markers.at(view.observations[i].marker));
  }
  return Resect(rays, points);
}

// A candidate with its poses.
struct Trial {
  Bundle bundle;
  double median = kNoResidual;  // of the residuals' lengths, px
};

// Parameters that obey the rules: those tied together have their mean, all are within bounds.
std::vector<double> Ruled(std::vector<double> params, const std::vector<ParamRule>& rules) {
  for (size_t k = 0; k < rules.size(); ++k) {
    double sum = params[k], count = 1;
    for (size_t other = 0; other < rules.size(); ++other) {
      if (rules[other].tied_to != ParamIndex{0, k}) continue;
      sum += params[other];
      count += 1;
    }
    params[k] = std::clamp(sum / count, rules[k].lower, rules[k].upper);
  }
  for (size_t k = 0; k < rules.size(); ++k) {
    if (rules[k].tied_to) params[k] = params[rules[k].tied_to->param];
  }
  return params;
}

// A candidate with poses from resection.
Trial MakeTrial(const CameraInput& camera,
                const std::vector<double>& params,
                const std::vector<View>& views,
                const std::map<int, Eigen::Vector3d>& markers) {
  Trial trial;
  Bundle& bundle = trial.bundle;
  bundle.cameras.push_back(MakeBundleCamera(camera, params));
  bundle.cameras[0].is_master = true;
  std::map<int, int> index;
  for (const auto& [number, position] : markers) {
    index[number] = static_cast<int>(bundle.markers.size());
    bundle.markers.push_back({number, position, position});
  }
  size_t without_pose = 0;
  for (const View& view : views) {
    const std::optional<Resection> resection = ResectView(bundle.cameras[0], view, markers);
    if (!resection) {
      without_pose += view.observations.size();
      continue;
    }
    const int frame = static_cast<int>(bundle.T_rig_target.size());
    bundle.T_rig_target.push_back(resection->T_camera_target);
    std::vector<BundleObservation> in_view;
    for (const Observation& observation : view.observations) {
      in_view.push_back({0, frame, index.at(observation.marker), observation, true});
    }
    std::stable_sort(in_view.begin(), in_view.end(), [](const auto& a, const auto& b) {
      return a.marker < b.marker;
    });
    bundle.observations.insert(bundle.observations.end(), in_view.begin(), in_view.end());
  }
  std::vector<double> lengths = WeightedLengths(bundle);
  lengths.resize(lengths.size() + without_pose, kNoResidual);
  trial.median = Median(lengths, kNoResidual);
  return trial;
}

// Median over the observations of the length, px, by which errors of the markers' tolerance in each
// of a marker's coordinates move its image.
double LengthOfMarkerErrors(const Bundle& bundle, MarkerFreedom markers) {
  if (!markers.HasTolerance()) return 0;
  return std::sqrt(Median(SquaresOfMarkerErrors(bundle, markers.Sigma()), 0.0));
}

enum class Until { kNear, kConverged };

// Enough to compare candidates.
constexpr int kNearIterations = 25;
constexpr double kNearTolerance = 1e-4;

void AdjustTrial(Trial* trial, Until until) {
  // Twice: the width of the loss follows the residuals down.
  for (int pass = 0; pass < 2; ++pass) {
    Bundle& bundle = trial->bundle;
    bundle.cameras[0].noise.detector_scale = 1;
    const std::vector<double> lengths = WeightedLengths(bundle);
    for (size_t i = 0; i < lengths.size(); ++i) {
      bundle.observations[i].used = std::isfinite(lengths[i]);
    }
    bundle.cameras[0].noise.detector_scale = std::max(trial->median, kSmallestScale);
    AdjustOptions options;
    options.loss = Loss::kHuber;
    if (until == Until::kNear) {
      options.loss = Loss::kCauchy;
      options.max_iterations = kNearIterations;
      options.cost_tolerance = kNearTolerance;
    }
    if (!Adjust(&bundle, options).usable) return;
    bundle.cameras[0].noise.detector_scale = 1;
    trial->median = Median(WeightedLengths(bundle), kNoResidual);
    if (!std::isfinite(trial->median)) return;
  }
}

// True when two sets of parameters are the same initial guess.
bool Alike(const CameraModel& model, std::span<const double> a, std::span<const double> b) {
  constexpr double kPart = 0.02;
  for (size_t k = 0; k < a.size(); ++k) {
    if (model.params[k].prior_sigma > 0) continue;  // open where there are no points
    const double size = std::max(model.params[k].scale, std::abs(a[k]));
    if (!(std::abs(a[k] - b[k]) <= kPart * size)) return false;
  }
  return true;
}

bool IsAnother(const Trial& trial, const std::vector<Trial*>& others) {
  const BundleCamera& camera = trial.bundle.cameras[0];
  return std::none_of(others.begin(), others.end(), [&](const Trial* other) {
    return Alike(*camera.model, camera.params, other->bundle.cameras[0].params);
  });
}

// Sum of Huber's loss for residuals of typical length `scale`; points that are not imaged count as
// gross outliers.
double RobustCost(const Bundle& bundle, double scale) {
  constexpr double kOutlier = 100;  // in units of `scale`
  const double width = AdjustOptions().loss_width;
  double cost = 0;
  for (const double length : WeightedLengths(bundle)) {
    const double part = std::min(length / scale, kOutlier);
    cost += part <= width ? part * part : 2 * width * part - width * width;
  }
  return cost;
}

// The minimum that explains all views best, of several that explain a selection about equally well.
Trial* BestOnAllViews(const CameraInput& camera,
                      const std::map<int, Eigen::Vector3d>& markers,
                      const std::vector<Trial*>& minima) {
  std::vector<View> views;
  for (const View& view : camera.views) {
    View known = Thinned(view, markers, markers.size());
    if (known.observations.size() >= kMinPoints) views.push_back(std::move(known));
  }
  const double scale = std::max(minima[0]->median, kSmallestScale);
  Trial* best = nullptr;
  double best_cost = kNoResidual;
  for (Trial* minimum : minima) {
    *minimum = MakeTrial(camera, minimum->bundle.cameras[0].params, views, markers);
    // Valleys between minima are flat.
    AdjustTrial(minimum, Until::kConverged);
    const double cost = RobustCost(minimum->bundle, scale);
    if (best != nullptr && !(cost < best_cost)) continue;
    best = minimum;
    best_cost = cost;
  }
  return best;
}

// The candidate that explains the views best, adjusted; nothing when none does.
std::optional<Trial> BestTrial(const CameraInput& camera,
                               const std::map<int, Eigen::Vector3d>& markers,
                               const std::vector<View>& views,
                               const std::vector<StartCandidate>& candidates) {
  std::vector<Trial> trials;
  trials.reserve(candidates.size());
  for (const StartCandidate& candidate : candidates) {
    trials.push_back(MakeTrial(camera, Ruled(candidate.params, camera.rules), views, markers));
  }
  const auto better = [](const Trial* a, const Trial* b) { return a->median < b->median; };
  std::vector<Trial*> ranked;
  ranked.reserve(trials.size());
  for (Trial& trial : trials) ranked.push_back(&trial);
  std::stable_sort(ranked.begin(), ranked.end(), better);
  std::vector<Trial*> adjusted;
  for (Trial* trial : ranked) {
    if (adjusted.size() == kAdjustedCandidates || !std::isfinite(trial->median)) break;
    if (IsAnother(*trial, adjusted)) adjusted.push_back(trial);
  }
  if (adjusted.empty()) return std::nullopt;
  for (Trial* trial : adjusted) AdjustTrial(trial, Until::kNear);
  std::stable_sort(adjusted.begin(), adjusted.end(), better);
  std::vector<Trial*> near;
  for (Trial* trial : adjusted) {
    if (trial->median > kAsGood * adjusted[0]->median) break;
    if (IsAnother(*trial, near)) near.push_back(trial);
  }
  // Valleys are flat: those that differ on the way down may meet at the bottom.
  std::vector<Trial*> minima;
  for (Trial* trial : near) {
    if (near.size() > 1) AdjustTrial(trial, Until::kConverged);
    if (IsAnother(*trial, minima)) minima.push_back(trial);
  }
  Trial& best = minima.size() > 1 ? *BestOnAllViews(camera, markers, minima) : *minima[0];
  if (!std::isfinite(best.median)) return std::nullopt;
  return std::move(best);
}

// The user's initial values; a prior's value serves as well.
std::vector<std::optional<double>> InitialValues(const CameraInput& camera) {
  std::vector<std::optional<double>> given = camera.initial;
  for (size_t k = 0; k < camera.rules.size(); ++k) {
    const ParamRule& rule = camera.rules[k];
    if (!given[k] && rule.prior) given[k] = std::clamp(rule.prior->value, rule.lower, rule.upper);
  }
  return given;
}

// `BestTrial` from candidates without distortion: where views are few or noisy, coefficients that
// are fitted before the adjustment may lead to another minimum.
std::optional<Trial> PlainTrial(const CameraInput& camera,
                                const std::map<int, Eigen::Vector3d>& markers,
                                const StartProblem& problem) {
  std::vector<std::optional<double>> given(problem.given.begin(), problem.given.end());
  for (size_t k = 0; k < given.size(); ++k) {
    if (!given[k]) given[k] = camera.model->params[k].neutral;
  }
  const StartProblem plain{.views = problem.views,
                           .markers = problem.markers,
                           .image_size = problem.image_size,
                           .config = problem.config,
                           .given = given,
                           .fixed = problem.fixed,
                           .rules = problem.rules};
  return BestTrial(
      camera, markers, {problem.views.begin(), problem.views.end()}, camera.model->Start(plain));
}

void CheckNotRefused(const CameraInput& camera, const StartProblem& problem) {
  const std::string reason = camera.model->Refusal(problem);
  if (reason.empty()) return;
  throw InputError("{}: {}: {}", camera.name, camera.model->name, reason);
}

}  // namespace

BundleCamera MakeBundleCamera(const CameraInput& camera, std::vector<double> params) {
  BundleCamera made{.name = camera.name,
                    .image_size = camera.image_size,
                    .image_circle = camera.image_circle,
                    .model = camera.model,
                    .config = camera.config,
                    .params = std::move(params),
                    .fixed = camera.fixed,
                    .rules = camera.rules,
                    .T_camera_rig = {}};
  const std::vector<double> sigmas = camera.model->PriorSigmas({.views = camera.views,
                                                                .image_size = camera.image_size,
                                                                .config = camera.config,
                                                                .given = camera.initial});
  for (size_t k = 0; k < made.params.size(); ++k) {
    const Param& param = camera.model->params[k];
    if (param.fixed != Fixed::kNever) made.fixed[k] = true;
    if (made.fixed[k]) continue;
    const bool has_prior = !made.rules.empty() && made.rules[k].prior;
    if (param.by_others != nullptr && !camera.initial[k] && !has_prior) {
      made.params[k] = kByOthers;
      made.fixed[k] = true;
    }
    if (!(sigmas[k] > 0)) continue;
    made.rules.resize(made.params.size());
    ParamRule& rule = made.rules[k];
    if (!rule.prior && !rule.tied_to) rule.prior = {.value = 0, .sigma = sigmas[k]};
  }
  return made;
}

void SetByOthers(BundleState* bundle) {
  for (BundleCamera& camera : bundle->cameras) {
    for (size_t k = 0; k < camera.ModelParams(); ++k) {
      if (camera.params[k] != kByOthers) continue;
      camera.params[k] = camera.model->params[k].by_others(camera.params.data());
    }
  }
}

std::optional<RigidTransform> GuessPose(const BundleCamera& camera,
                                        const View& view,
                                        const std::map<int, Eigen::Vector3d>& markers) {
  const View thinned = Thinned(view, markers, kStartPoints);
  if (thinned.observations.size() < kMinPoints) return std::nullopt;
  const std::optional<Resection> resection = ResectView(camera, thinned, markers);
  if (!resection) return std::nullopt;
  return resection->T_camera_target;
}

CameraGuess GuessCamera(const CameraInput& camera,
                        const std::map<int, Eigen::Vector3d>& markers,
                        MarkerFreedom marker_freedom) {
  const std::vector<View> views = Selection(camera, markers, kStartViews);
  if (views.empty()) {
    throw JobError("{}: no image shows {} or more markers of the target; nothing to start from",
                   camera.name,
                   kMinPoints);
  }
  const std::vector<std::optional<double>> given = InitialValues(camera);
  const StartProblem problem{.views = views,
                             .markers = &markers,
                             .image_size = camera.image_size,
                             .config = camera.config,
                             .given = given,
                             .fixed = &camera.fixed,
                             .rules = camera.rules};
  CheckNotRefused(camera, problem);
  const std::vector<StartCandidate> candidates = camera.model->Start(problem);
  std::optional<Trial> best = BestTrial(camera, markers, views, candidates);
  const bool suspicious =
      !best ||
      best->median > kSuspiciousMedian + LengthOfMarkerErrors(best->bundle, marker_freedom);
  if (suspicious) {
    std::optional<Trial> plain = PlainTrial(camera, markers, problem);
    if (plain && (!best || plain->median < best->median)) best = std::move(plain);
  }
  if (!best) {
    throw JobError(
        "{}: no initial guess of model {} explains the detections; does the target "
        "file describe the target in the images, and does the model suit the lens?",
        camera.name,
        camera.model->name);
  }

  CameraGuess guess;
  if (suspicious) {
    const Misfit misfit =
        camera.model->JudgeFit(problem, best->bundle.cameras[0].params, best->median);
    if (!misfit.reason.empty()) {
      guess.misfit = fmt::format("{}: {} {}", camera.name, camera.model->name, misfit.reason);
    }
    if (misfit.impossible) throw Error(ErrorKind::kJob, guess.misfit + " (model_misfit)");
  }
  guess.params = best->bundle.cameras[0].params;
  guess.median_error = best->median;
  const BundleCamera camera_of_guess = MakeBundleCamera(camera, guess.params);
  for (const View& view : camera.views) {
    guess.T_camera_target.push_back(GuessPose(camera_of_guess, view, markers));
  }
  return guess;
}

}  // namespace plenocal
