// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/link_targets.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"
#include "calib/camera/marker_id.h"
#include "calib/rig/rig_graph.h"

namespace plenocal {
namespace {

using ViewsByPart = std::map<size_t, View>;  // target or body

// A view's observations by the part that `part_of` gives their markers.
template <typename PartOf>
ViewsByPart Divide(const View& view, const PartOf& part_of) {
  ViewsByPart parts;
  for (size_t i = 0; i < view.observations.size(); ++i) {
    View& part = parts[part_of(view.observations[i].marker)];
    part.frame = view.frame;
    part.observations.push_back(view.observations[i]);
    if (!view.by_nuisance.empty()) part.by_nuisance.push_back(view.by_nuisance[i]);
  }
  return parts;
}

class TargetLinker {
 public:
  TargetLinker(const CalibrationInput& input,
               std::span<const CameraInput> split,
               std::span<const CameraGuess> guesses)
      : input_(input), split_(split), guesses_(guesses) {}

  LinkedInput Run() {
    CollectSightings();
    std::vector<GraphTarget> targets;
    for (const InputTarget& target : input_.targets) {
      targets.push_back({.moves = target.moves, .known = target.known});
    }
    graph_ = LinkRig(sightings_, split_.size(), targets, input_.earlier_T_camera_rig);
    CheckLinked();
    linked_.input = input_;
    linked_.input.targets.clear();
    for (auto& [number, position] : linked_.input.markers) {
      position = graph_.T_group_target[MarkerId::FromNumber(number).target] * position;
    }
    for (size_t c = 0; c < split_.size(); ++c) {
      linked_.T_camera_rig.push_back(graph_.T_camera_group[c] * graph_.T_camera_group[0].Inverse());
      MergeViews(c);
    }
    AddTargets();
    AddFindings();
    return std::move(linked_);
  }

 private:
  void CollectSightings() {
    std::map<std::string, int> frames;
    for (size_t c = 0; c < split_.size(); ++c) {
      for (size_t v = 0; v < split_[c].views.size(); ++v) {
        const auto& T_camera_target = guesses_[c].T_camera_target[v];
        if (!T_camera_target) continue;
        const View& view = split_[c].views[v];
        const auto frame = frames.try_emplace(view.frame, static_cast<int>(frames.size())).first;
        const size_t target = MarkerId::FromNumber(view.observations[0].marker).target;
        sightings_.push_back({frame->second, c, target, *T_camera_target});
        seen_.insert(target);
      }
    }
  }

  // Names of the cameras of each group; the rig's master's first.
  [[nodiscard]] std::map<size_t, std::vector<std::string>> CameraGroups() const {
    std::map<size_t, std::vector<std::string>> groups;
    for (size_t c = 0; c < split_.size(); ++c) {
      groups[graph_.camera_group[c]].push_back(split_[c].name);
    }
    return groups;
  }

  void CheckLinked() const {
    std::vector<std::string> groups;
    for (const auto& [group, names] : CameraGroups()) {
      groups.push_back(fmt::format("{}", fmt::join(names, " + ")));
    }
    if (groups.size() < 2) return;
    throw JobError(
        "nothing connects these cameras: {}. Record frames in which a camera of each "
        "sees one target at the same time; or, with two targets that stay where they "
        "are, 10 or more frames in which one sees one target while the other sees the "
        "other, and turn the rig between them about two axes by 15 degrees or more; or "
        "give an earlier calibration of both ('from')",
        fmt::join(groups, " | "));
  }

  [[nodiscard]] size_t BodyOf(int marker) const {
    return graph_.target_group[MarkerId::FromNumber(marker).target];
  }

  [[nodiscard]] std::string FrameName(const std::string& frame, size_t body) const {
    return body == 0 ? frame : frame + "@" + input_.targets[body].name;
  }

  // The views of one camera as those of bodies, each with the pose by its richest target.
  void MergeViews(size_t c) {
    std::map<std::pair<std::string, size_t>, std::pair<size_t, RigidTransform>> poses;
    for (size_t v = 0; v < split_[c].views.size(); ++v) {
      const auto& T_camera_target = guesses_[c].T_camera_target[v];
      if (!T_camera_target) continue;
      const View& view = split_[c].views[v];
      const int marker = view.observations[0].marker;
      auto& [points, pose] = poses[{view.frame, BodyOf(marker)}];
      if (view.observations.size() <= points) continue;
      points = view.observations.size();
      pose =
          *T_camera_target * graph_.T_group_target[MarkerId::FromNumber(marker).target].Inverse();
    }
    std::vector<View>& views = linked_.input.cameras[c].views;
    views.clear();
    CameraGuess guess = guesses_[c];
    guess.T_camera_target.clear();
    for (const View& view : input_.cameras[c].views) {
      for (auto& [body, part] : Divide(view, [&](int marker) { return BodyOf(marker); })) {
        const auto found = poses.find({view.frame, body});
        guess.T_camera_target.push_back(found == poses.end() ? std::nullopt
                                                             : std::optional(found->second.second));
        views.push_back(std::move(part));
        views.back().frame = FrameName(view.frame, body);
      }
    }
    linked_.guesses.push_back(std::move(guess));
  }

  void AddTargets() {
    for (size_t k = 0; k < input_.targets.size(); ++k) {
      const bool is_first = graph_.target_group[k] == k;
      linked_.targets.push_back(
          {.name = input_.targets[k].name,
           .T_target_own = graph_.T_group_target[k],
           .is_fixed = is_first || input_.targets[k].known.has_value() || !seen_.contains(k)});
    }
  }

  void AddFindings() {
    for (const RigLink& link : graph_.links) {
      if (link.by != RigLink::By::kMotion) continue;
      std::vector<std::string> names;
      for (const size_t c : link.cameras) names.push_back(split_[c].name);
      linked_.findings.push_back(
          {.code = "placed_by_motion",
           .grade = Grade::kGood,
           .cameras = names,
           .what = fmt::format("{}: no view of a target in common with the others; placed by the "
                               "motion of {} frames in which each side sees a target of its own.",
                               fmt::join(names, ", "),
                               link.frames),
           .remedy = "The standard errors include it."});
    }
  }

  const CalibrationInput& input_;
  std::span<const CameraInput> split_;
  std::span<const CameraGuess> guesses_;
  std::vector<Sighting> sightings_;
  std::set<size_t> seen_;  // targets
  RigGraph graph_;
  LinkedInput linked_;
};

// A translation of extrinsics that is not known to this part of the targets' distance is open.
constexpr double kOpenTranslation = 0.03;

struct OpenTranslation {
  std::string camera;
  double sigma = 0, part = 0;  // m; of the distance
  Eigen::Vector3d direction{0, 0, 0};
};

double MedianDistance(const Bundle& bundle) {
  std::vector<double> distances;
  for (const RigidTransform& T : bundle.T_rig_target) distances.push_back(T.t.norm());
  return Median(std::move(distances), 1.0);
}

// The one of the named cameras whose translation is known worst.
std::optional<OpenTranslation> LeastCertain(const std::vector<std::string>& names,
                                            const Bundle& bundle,
                                            const Uncertainty& uncertainty) {
  const double distance = MedianDistance(bundle);
  std::optional<OpenTranslation> worst;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const std::string& name = bundle.cameras[c].name;
    if (std::ranges::find(names, name) == names.end()) continue;
    const Eigen::Matrix3d covariance = uncertainty.extrinsics_covariance[c].topLeftCorner<3, 3>();
    OpenTranslation open{.camera = name, .sigma = std::numeric_limits<double>::infinity()};
    if (covariance.allFinite()) {
      const SymmetricEigen3 spectrum = DecomposeSymmetric(covariance);
      open.sigma = std::sqrt(std::max(0.0, spectrum.values[2]));
      open.direction = spectrum.vectors.col(2);
    } else {
      const Eigen::MatrixXd translations =
          uncertainty.undetermined.middleRows<3>(uncertainty.extrinsics_index[c]);
      open.direction = DecomposeSymmetric(Eigen::Matrix3d(translations * translations.transpose()))
                           .vectors.col(2);
    }
    open.part = open.sigma / distance;
    if (!worst || open.part > worst->part) worst = open;
  }
  return worst;
}

}  // namespace

std::vector<CameraInput> SplitViews(const CalibrationInput& input) {
  std::vector<CameraInput> split = input.cameras;
  for (CameraInput& camera : split) {
    std::vector<View> views;
    for (const View& view : camera.views) {
      for (auto& [target, part] :
           Divide(view, [](int marker) { return MarkerId::FromNumber(marker).target; }))
        views.push_back(std::move(part));
    }
    camera.views = std::move(views);
  }
  return split;
}

std::vector<Finding> JudgeLinks(const std::vector<Finding>& links,
                                const Bundle& bundle,
                                const Uncertainty& uncertainty) {
  std::vector<Finding> judged;
  for (const Finding& link : links) {
    const std::optional<OpenTranslation> open = LeastCertain(link.cameras, bundle, uncertainty);
    if (!open || open->part < kOpenTranslation) {
      judged.push_back(link);
      continue;
    }
    const std::string sigma =
        std::isfinite(open->sigma) ? fmt::format("known to {:.2g} m", open->sigma) : "open";
    judged.push_back(
        {.code = "one_rotation_axis",
         .grade = Grade::kBad,
         .cameras = link.cameras,
         .value = open->part,
         .limit = kOpenTranslation,
         .what =
             fmt::format("{}: placed by motion, but the rig turned about one axis only or hardly "
                         "at all: its translation along ({:.2f}) of its own axes "
                         "is {}; all else is determined to within its standard errors.",
                         open->camera,
                         fmt::join(open->direction, ", "),
                         sigma),
         .remedy = "Record frames between which the rig is turned about another axis by 15 degrees "
                   "or more, each side with its target in view."});
  }
  return judged;
}

LinkedInput LinkTargets(const CalibrationInput& input,
                        std::span<const CameraInput> split,
                        std::span<const CameraGuess> guesses) {
  return TargetLinker(input, split, guesses).Run();
}

}  // namespace plenocal
