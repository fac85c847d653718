// SPDX-License-Identifier: Apache-2.0
#include "calib/start.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "calib/error.h"
#include "calib/median.h"
#include "calib/resection.h"

namespace plenocal {
namespace {

// Enough views and points for start values; more add time and no certainty.
constexpr size_t kStartViews = 12;
constexpr size_t kStartPoints = 40;
constexpr size_t kMinPoints = 4;  // a pose has six unknowns, and three points leave four solutions
constexpr size_t kAdjustedCandidates = 4;
constexpr double kAsGood = 1.5;  // times the median residual: twice that of the selection's scatter
constexpr double kInfinity = std::numeric_limits<double>::infinity();

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

std::optional<Resection> ResectView(const CameraModel& model,
                                    std::span<const double> config,
                                    std::span<const double> params,
                                    const View& view,
                                    const std::map<int, Eigen::Vector3d>& markers) {
  std::vector<Ray> rays;
  std::vector<Eigen::Vector3d> points;
  for (const Observation& observation : view.observations) {
    const std::optional<Ray> ray =
        model.unproject(params.data(), config.data(), observation.values.data());
    if (!ray) continue;
    rays.push_back(*ray);
    points.push_back(markers.at(observation.marker));
  }
  return Resect(rays, points);
}

// Lengths of all residuals of a bundle, infinite where a point does not project.
std::vector<double> ResidualLengths(const Bundle& bundle) {
  std::vector<double> lengths;
  lengths.reserve(bundle.observations.size());
  for (const BundleObservation& observation : bundle.observations) {
    double residual[kMaxObservationSize];
    lengths.push_back(Residual(bundle, observation, residual)
                          ? WeightedLength(bundle, observation, residual)
                          : kInfinity);
  }
  return lengths;
}

struct Trial {
  Bundle bundle;
  double median = kInfinity;
};

// Parameters that obey the rules: those that are one have their mean, all are within bounds.
std::vector<double> Ruled(std::vector<double> params, const std::vector<ParamRule>& rules) {
  for (size_t k = 0; k < rules.size(); ++k) {
    double sum = params[k], count = 1;
    for (size_t other = 0; other < rules.size(); ++other) {
      if (rules[other].same_as != ParamPlace{0, k}) continue;
      sum += params[other];
      count += 1;
    }
    params[k] = std::clamp(sum / count, rules[k].lower, rules[k].upper);
  }
  for (size_t k = 0; k < rules.size(); ++k) {
    if (rules[k].same_as) params[k] = params[rules[k].same_as->param];
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
    const std::optional<Resection> resection =
        ResectView(*camera.model, camera.config, params, view, markers);
    if (!resection) {
      without_pose += view.observations.size();
      continue;
    }
    const int frame = static_cast<int>(bundle.T_rig_target.size());
    bundle.T_rig_target.push_back(resection->T_camera_target);
    std::vector<BundleObservation> in_view;
    for (const Observation& observation : view.observations) {
      Observation seen = observation;
      seen.sigma = 1;
      in_view.push_back({0, frame, index.at(observation.marker), seen, true});
    }
    std::stable_sort(in_view.begin(), in_view.end(), [](const auto& a, const auto& b) {
      return a.marker < b.marker;
    });
    bundle.observations.insert(bundle.observations.end(), in_view.begin(), in_view.end());
  }
  std::vector<double> lengths = ResidualLengths(bundle);
  lengths.resize(lengths.size() + without_pose, kInfinity);
  trial.median = Median(lengths, kInfinity);
  return trial;
}

enum class Until { kNear, kConverged };

void AdjustTrial(Trial* trial, Until until) {
  // Twice: the width of the loss follows the residuals down.
  for (int pass = 0; pass < 2; ++pass) {
    Bundle& bundle = trial->bundle;
    bundle.cameras[0].noise_scale = 1;
    const std::vector<double> lengths = ResidualLengths(bundle);
    for (size_t i = 0; i < lengths.size(); ++i) {
      bundle.observations[i].used = std::isfinite(lengths[i]);
    }
    bundle.cameras[0].noise_scale = std::max(trial->median, 1e-9);
    AdjustOptions options;
    options.loss = Loss::kHuber;
    if (until == Until::kNear) {
      options.loss = Loss::kCauchy;
      options.max_iterations = 25;
      options.cost_tolerance = 1e-4;
    }
    if (!Adjust(&bundle, options).usable) return;
    bundle.cameras[0].noise_scale = 1;
    trial->median = Median(ResidualLengths(bundle), kInfinity);
    if (!std::isfinite(trial->median)) return;
  }
}

// Whether two sets of parameters are one camera, as far as start values go.
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

// Sum of Huber's loss for residuals of typical length `scale`; what is not imaged counts as a
// coarse mistake.
double RobustCost(const Bundle& bundle, double scale) {
  constexpr double kMistake = 100;  // in units of `scale`
  const double width = AdjustOptions().loss_width;
  double cost = 0;
  for (const double length : ResidualLengths(bundle)) {
    const double part = std::min(length / scale, kMistake);
    cost += part <= width ? part * part : 2 * width * part - width * width;
  }
  return cost;
}

// Of several minima that explain a selection of the views about as well the one that explains all
// views best.
Trial* BestOnAllViews(const CameraInput& camera,
                      const std::map<int, Eigen::Vector3d>& markers,
                      const std::vector<Trial*>& minima) {
  std::vector<View> views;
  for (const View& view : camera.views) {
    View known = Thinned(view, markers, markers.size());
    if (known.observations.size() >= kMinPoints) views.push_back(std::move(known));
  }
  const double scale = std::max(minima[0]->median, 1e-9);
  Trial* best = nullptr;
  double best_cost = kInfinity;
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

// The candidate that explains the views best, adjusted; with an infinite median when none does.
Trial BestTrial(const CameraInput& camera,
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
  if (adjusted.empty()) return {};
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
  return std::move(minima.size() > 1 ? *BestOnAllViews(camera, markers, minima) : *minima[0]);
}

}  // namespace

BundleCamera MakeBundleCamera(const CameraInput& camera, std::vector<double> params) {
  BundleCamera made{.model = camera.model,
                    .config = camera.config,
                    .params = std::move(params),
                    .fixed = camera.fixed,
                    .rules = camera.rules,
                    .T_camera_rig = {}};
  for (size_t k = 0; k < made.params.size(); ++k) {
    const Param& param = camera.model->params[k];
    if (param.held != Held::kNever) made.fixed[k] = true;
    if (!(param.prior_sigma > 0) || made.fixed[k]) continue;
    made.rules.resize(made.params.size());
    ParamRule& rule = made.rules[k];
    if (!rule.prior && !rule.same_as) rule.prior = {.value = 0, .sigma = param.prior_sigma};
  }
  return made;
}

std::optional<RigidTransform> StartPose(const CameraModel& model,
                                        std::span<const double> config,
                                        std::span<const double> params,
                                        const View& view,
                                        const std::map<int, Eigen::Vector3d>& markers) {
  const View thinned = Thinned(view, markers, kStartPoints);
  if (thinned.observations.size() < kMinPoints) return std::nullopt;
  const std::optional<Resection> resection = ResectView(model, config, params, thinned, markers);
  if (!resection) return std::nullopt;
  return resection->T_camera_target;
}

CameraStart StartCamera(const CameraInput& camera, const std::map<int, Eigen::Vector3d>& markers) {
  const std::vector<View> views = Selection(camera, markers, kStartViews);
  if (views.empty()) {
    throw Error(
        ErrorKind::kJob,
        fmt::format("{}: no image shows {} or more markers of the target; nothing to start from",
                    camera.name,
                    kMinPoints));
  }
  // A prior's value is as good a start as the user's.
  std::vector<std::optional<double>> given = camera.initial;
  for (size_t k = 0; k < camera.rules.size(); ++k) {
    const ParamRule& rule = camera.rules[k];
    if (!given[k] && rule.prior) given[k] = std::clamp(rule.prior->value, rule.lower, rule.upper);
  }
  const StartProblem problem{.views = views,
                             .markers = &markers,
                             .image_size = camera.image_size,
                             .config = camera.config,
                             .given = given,
                             .fixed = &camera.fixed};
  if (camera.model->refusal != nullptr) {
    const std::string reason = camera.model->refusal(problem);
    if (!reason.empty()) {
      throw Error(ErrorKind::kInput,
                  fmt::format("{}: {}: {}", camera.name, camera.model->name, reason));
    }
  }
  const std::vector<StartCandidate> candidates = camera.model->start(problem);
  const Trial best = BestTrial(camera, markers, views, candidates);
  if (!std::isfinite(best.median)) {
    throw Error(
        ErrorKind::kJob,
        fmt::format("{}: no start values for model {} explain the detections; does the target "
                    "file describe the target in the images, and does the model suit the lens?",
                    camera.name,
                    camera.model->name));
  }

  CameraStart start;
  if (camera.model->misfit != nullptr) {
    const Misfit misfit =
        camera.model->misfit(*camera.model, problem, best.bundle.cameras[0].params, best.median);
    if (!misfit.reason.empty()) {
      start.misfit = fmt::format("{}: {} {}", camera.name, camera.model->name, misfit.reason);
    }
    if (misfit.impossible) throw Error(ErrorKind::kJob, start.misfit);
  }
  start.params = best.bundle.cameras[0].params;
  start.median_error = best.median;
  for (const View& view : camera.views) {
    start.T_camera_target.push_back(
        StartPose(*camera.model, camera.config, start.params, view, markers));
  }
  return start;
}

std::vector<RigidTransform> StartRig(std::span<const CameraInput> cameras,
                                     std::span<const CameraStart> starts) {
  const size_t count = cameras.size();
  std::vector<std::map<std::string_view, const RigidTransform*>> poses(count);
  for (size_t c = 0; c < count; ++c) {
    for (size_t v = 0; v < cameras[c].views.size(); ++v) {
      const auto& pose = starts[c].T_camera_target[v];
      if (pose) poses[c].emplace(cameras[c].views[v].frame, &*pose);
    }
  }
  // T_a_b from every common frame.
  const auto relative = [&](size_t a, size_t b) {
    std::vector<RigidTransform> transforms;
    for (const auto& [frame, T_a_target] : poses[a]) {
      const auto other = poses[b].find(frame);
      if (other != poses[b].end()) transforms.push_back(*T_a_target * other->second->Inverse());
    }
    return transforms;
  };
  // The one that agrees best with the others: the smallest sum of distances, of at most 100 tried.
  const auto medoid = [](const std::vector<RigidTransform>& transforms) {
    const size_t stride = transforms.size() / 100 + 1;
    double size = 0;
    for (const RigidTransform& T : transforms)
      size += T.t.norm() / static_cast<double>(transforms.size());
    const RigidTransform* best = &transforms[0];
    double best_sum = kInfinity;
    for (size_t i = 0; i < transforms.size(); i += stride) {
      double sum = 0;
      for (size_t j = 0; j < transforms.size(); j += stride) {
        const RigidTransform difference = transforms[i].Inverse() * transforms[j];
        sum += LogRotation(difference.R).norm() +
               difference.t.norm() / std::max(size, std::numeric_limits<double>::min());
      }
      if (sum < best_sum) {
        best_sum = sum;
        best = &transforms[i];
      }
    }
    return *best;
  };

  std::vector<RigidTransform> T_camera_rig(count);
  std::vector<bool> linked(count, false);
  linked[0] = true;
  for (size_t step = 1; step < count; ++step) {
    size_t best_from = 0, best_to = 0;
    std::vector<RigidTransform> best;
    for (size_t from = 0; from < count; ++from) {
      if (!linked[from]) continue;
      for (size_t to = 0; to < count; ++to) {
        if (linked[to]) continue;
        std::vector<RigidTransform> transforms = relative(to, from);
        if (transforms.size() > best.size()) {
          best = std::move(transforms);
          best_from = from;
          best_to = to;
        }
      }
    }
    if (best.empty()) {
      std::string open, reached;
      for (size_t c = 0; c < count; ++c) {
        std::string& list = linked[c] ? reached : open;
        list += (list.empty() ? "" : ", ") + cameras[c].name;
      }
      throw Error(
          ErrorKind::kJob,
          fmt::format("no frame in which {} sees the target together with {}: their mutual pose "
                      "cannot be determined. Frames are matched by name (what the last '*' of "
                      "the glob stands for); check the names, or add frames that both see",
                      open,
                      reached));
    }
    T_camera_rig[best_to] = medoid(best) * T_camera_rig[best_from];
    linked[best_to] = true;
  }
  return T_camera_rig;
}

}  // namespace plenocal
