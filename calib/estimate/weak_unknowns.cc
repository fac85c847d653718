// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/weak_unknowns.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace plenocal {
namespace {

constexpr double kCorrelated = 0.99;
constexpr double kLarge = 0.1;    // standard error over a parameter's size
constexpr double kByPrior = 0.7;  // of the priors' sigma: half of the information is theirs

constexpr const char* kGeneralRemedy =
    "Add images from other distances and at other tilts, over the whole field of view, or fix "
    "these parameters ('fixed').";

// The models' advice is about targets.
constexpr const char* kSceneRemedy =
    "Add frames with points at half and at twice the distance, turn the camera about both image "
    "axes and roll it, or fix these parameters ('fixed').";

constexpr const char* kScaleRemedy =
    "no scale: give the stereo pair, a distance, tags of known size or B.";

DepthRange DepthRangeOf(const Bundle& bundle, size_t c) {
  DepthRange range{std::numeric_limits<double>::infinity(), 0};
  for (const BundleObservation& observation : bundle.observations) {
    if (!observation.used || observation.camera != static_cast<int>(c)) continue;
    const RigidTransform T_camera_target =
        bundle.cameras[c].T_camera_rig * bundle.SeenPose(static_cast<size_t>(observation.frame), c);
    const double z =
        (T_camera_target * bundle.markers[static_cast<size_t>(observation.marker)].position).z();
    range.nearest = std::min(range.nearest, z);
    range.farthest = std::max(range.farthest, z);
  }
  return range;
}

bool Contains(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

class WeakUnknownsFinder {
 public:
  WeakUnknownsFinder(const Bundle& bundle, const Uncertainty& uncertainty)
      : bundle_(bundle), uncertainty_(uncertainty) {}

  std::vector<WeakUnknowns> Find() {
    AddOpenDirections();
    for (size_t c = 0; c < bundle_.cameras.size(); ++c) {
      AddCorrelated(c);
      AddUncertain(c);
    }
    return std::move(found_);
  }

 private:
  [[nodiscard]] std::string Prefix(size_t c) const { return bundle_.cameras[c].name + "."; }

  [[nodiscard]] bool IsOpen(const std::string& name) const { return Contains(open_, name); }

  void Add(bool open, std::vector<std::string> names, std::string what) {
    std::string remedy = Remedy(names);
    found_.push_back({open, std::move(names), std::move(what), std::move(remedy)});
  }

  void AddOpenDirections() {
    for (const OpenDirection& direction : uncertainty_.open) {
      std::vector<std::string> names;
      for (const auto& [name, share] : direction.parts) names.push_back(name);
      open_.insert(open_.end(), names.begin(), names.end());
      Add(true,
          names,
          std::isinf(direction.sigma)
              ? std::string("nothing in the data separates them")
              : fmt::format("their standard error is {:.1f} times their value", direction.sigma));
      if (!bundle_.scale_distance || !std::isinf(direction.sigma)) continue;
      found_.back().what = "nothing gives the scale";
      found_.back().remedy = kScaleRemedy;
    }
  }

  // Groups of correlated parameters of one camera; neighbours in a field always correlate.
  void AddCorrelated(size_t c) {
    const std::string prefix = Prefix(c);
    std::vector<std::string> of_field;
    for (const Param& param : bundle_.cameras[c].model->params) {
      if (param.prior_sigma > 0) of_field.push_back(prefix + std::string(param.name));
    }
    const auto of_camera = [&](size_t i) {
      const std::string& name = uncertainty_.names[i];
      return name.starts_with(prefix) && !name.starts_with(prefix + "T_camera_rig") &&
             !IsOpen(name) && !Contains(of_field, name) && !name.starts_with(prefix + "shared_");
    };
    std::vector<std::string> names;
    double strongest = 0;
    for (Eigen::Index i = 0; i < uncertainty_.correlation.rows(); ++i) {
      for (Eigen::Index j = 0; j < i; ++j) {
        const double correlation = std::abs(uncertainty_.correlation(i, j));
        const auto a = static_cast<size_t>(j), b = static_cast<size_t>(i);
        if (!(correlation > kCorrelated) || !of_camera(a) || !of_camera(b)) continue;
        strongest = std::max(strongest, correlation);
        for (const size_t k : {a, b}) {
          if (!Contains(names, uncertainty_.names[k])) names.push_back(uncertainty_.names[k]);
        }
      }
    }
    if (names.empty()) return;
    Add(false,
        names,
        fmt::format("changes of one are nearly made up for by the others (correlation {:.4f})",
                    strongest));
  }

  // On each parameter of one camera, were the others known.
  [[nodiscard]] std::vector<double> InformationOfPriors(size_t c) const {
    std::vector<double> information(bundle_.cameras[c].params.size(), 0.0);
    for (const ParamPrior& prior : ParamPriors(bundle_)) {
      for (const auto& [param, weight] : prior.terms) {
        const double root = weight / prior.sigma;
        if (param.camera == c) information[param.param] += root * root;
      }
    }
    return information;
  }

  // Single parameters of one camera with a large standard error.
  void AddUncertain(size_t c) {
    const BundleCamera& camera = bundle_.cameras[c];
    const std::vector<double> of_priors = InformationOfPriors(c);
    std::vector<std::string> large, by_prior;
    size_t of_field = 0;
    for (size_t k = 0; k < camera.ModelParams(); ++k) {
      const Param& param = camera.model->params[k];
      if (param.prior_sigma > 0) ++of_field;
      const std::string name = Prefix(c) + std::string(param.name);
      if (bundle_.Root(c, k) != ParamIndex{c, k} || IsOpen(name)) continue;
      const double std_error = uncertainty_.param_std_errors[c][k];
      if (param.prior_sigma > 0) {
        if (std_error * std::sqrt(of_priors[k]) > kByPrior) by_prior.push_back(name);
      } else if (std_error > kLarge * std::max(std::abs(camera.params[k]), param.scale)) {
        large.push_back(name);
      }
    }
    if (!large.empty()) {
      const char* whose = large.size() == 1 ? "its" : "their";
      Add(false,
          large,
          fmt::format("standard error above {:.0f} % of {} size", 100 * kLarge, whose));
    }
    if (by_prior.empty()) return;
    const size_t count = by_prior.size();
    found_.push_back({false,
                      std::move(by_prior),
                      fmt::format("{} of {} coefficients, determined by the model's prior rather "
                                  "than by these images",
                                  count,
                                  of_field),
                      "Their part of the image has no points: add images with the target there."});
  }

  // Advice of the models of the cameras concerned.
  [[nodiscard]] std::string Remedy(const std::vector<std::string>& names) const {
    if (bundle_.HasLandmarks()) return kSceneRemedy;
    std::string text;
    const auto add = [&](const std::string& sentence) {
      if (!sentence.empty() && text.find(sentence) == std::string::npos) {
        text += (text.empty() ? "" : " ") + sentence;
      }
    };
    const auto any = [&](const std::string& part) {
      return std::ranges::any_of(
          names, [&](const std::string& name) { return name.find(part) != std::string::npos; });
    };
    const bool several = any(".T_target."), extrinsics = any(".T_camera_rig.");
    for (size_t c = 0; c < bundle_.cameras.size(); ++c) {
      const CameraModel& model = *bundle_.cameras[c].model;
      std::vector<size_t> weak;
      for (size_t k = 0; k < model.params.size(); ++k) {
        if (Contains(names, Prefix(c) + std::string(model.params[k].name))) weak.push_back(k);
      }
      if (!weak.empty()) add(model.Remedy(weak, DepthRangeOf(bundle_, c)));
    }
    if (several) {
      add("Cameras and targets that share no view are placed by motion: add frames between which "
          "the rig is turned about another axis by 15 degrees or more.");
    }
    if (text.empty()) add(kGeneralRemedy);
    if (extrinsics && !several) {
      add("The extrinsics of a camera follow from frames that it shares with others: add frames in "
          "which both see the target, at other positions and tilts.");
    }
    return text;
  }

  const Bundle& bundle_;
  const Uncertainty& uncertainty_;
  std::vector<WeakUnknowns> found_;
  std::vector<std::string> open_;  // unknowns of open directions
};

}  // namespace

std::string Listed(const std::vector<std::string>& names) {
  constexpr size_t kShown = 12;
  if (names.size() <= kShown + 1) return fmt::format("{}", fmt::join(names, ", "));
  return fmt::format("{} and {} more",
                     fmt::join(names.begin(), names.begin() + kShown, ", "),
                     names.size() - kShown);
}

std::vector<WeakUnknowns> FindWeakUnknowns(const Bundle& bundle, const Uncertainty& uncertainty) {
  return WeakUnknownsFinder(bundle, uncertainty).Find();
}

}  // namespace plenocal
