// SPDX-License-Identifier: Apache-2.0
#include "calib/weak_directions.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace plenocal {
namespace {

constexpr double kCorrelated = 0.99;
constexpr double kLarge = 0.1;   // part of a parameter's size
constexpr double kUntold = 0.7;  // of a prior's sigma: half of the information is the prior's

constexpr const char* kGeneralRemedy =
    "Add images from other distances and at other tilts, over the whole field of view, or hold "
    "these parameters ('fixed').";

SeenSpan SpanOf(const Bundle& bundle, size_t c) {
  SeenSpan span{std::numeric_limits<double>::infinity(), 0};
  for (const BundleObservation& observation : bundle.observations) {
    if (!observation.used || observation.camera != static_cast<int>(c)) continue;
    const RigidTransform T_camera_target =
        bundle.cameras[c].T_camera_rig * bundle.SeenPose(static_cast<size_t>(observation.frame), c);
    const double z =
        (T_camera_target * bundle.markers[static_cast<size_t>(observation.marker)].position).z();
    span.nearest = std::min(span.nearest, z);
    span.farthest = std::max(span.farthest, z);
  }
  return span;
}

bool Holds(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

// What the models of the cameras concerned say about these unknowns.
std::string Remedy(const Calibration& calibration, const std::vector<std::string>& names) {
  std::string text;
  const auto add = [&](const std::string& sentence) {
    if (!sentence.empty() && text.find(sentence) == std::string::npos) {
      text += (text.empty() ? "" : " ") + sentence;
    }
  };
  bool mounts = false;
  for (size_t c = 0; c < calibration.camera_names.size(); ++c) {
    const CameraModel& model = *calibration.bundle.cameras[c].model;
    const std::string prefix = calibration.camera_names[c] + ".";
    std::vector<size_t> weak;
    for (size_t k = 0; k < model.params.size(); ++k) {
      if (Holds(names, prefix + std::string(model.params[k].name))) weak.push_back(k);
    }
    mounts = mounts || std::any_of(names.begin(), names.end(), [&](const std::string& name) {
               return name.starts_with(prefix + "T_camera_rig");
             });
    if (weak.empty()) continue;
    add(model.remedy != nullptr ? model.remedy(weak, SpanOf(calibration.bundle, c))
                                : std::string());
  }
  if (text.empty()) add(kGeneralRemedy);
  if (mounts) {
    add("Where a camera stands in the rig follows from frames that it shares with others: add "
        "frames in which both see the target, at other places and tilts.");
  }
  return text;
}

}  // namespace

std::string Listed(const std::vector<std::string>& names) {
  constexpr size_t kShown = 12;
  if (names.size() <= kShown + 1) return fmt::format("{}", fmt::join(names, ", "));
  return fmt::format("{} and {} more",
                     fmt::join(names.begin(), names.begin() + kShown, ", "),
                     names.size() - kShown);
}

std::vector<WeakUnknowns> FindWeakUnknowns(const Calibration& calibration) {
  std::vector<WeakUnknowns> found;
  const Uncertainty& uncertainty = calibration.uncertainty;
  std::vector<std::string> open;
  const auto add = [&](bool is_open, std::vector<std::string> names, std::string what) {
    std::string remedy = Remedy(calibration, names);
    found.push_back({is_open, std::move(names), std::move(what), std::move(remedy)});
  };
  for (const OpenDirection& direction : uncertainty.open) {
    std::vector<std::string> names;
    for (const auto& [name, share] : direction.parts) names.push_back(name);
    open.insert(open.end(), names.begin(), names.end());
    add(true,
        names,
        std::isinf(direction.sigma)
            ? std::string("nothing in the data tells them apart")
            : fmt::format("uncertain by {:.1f} times their own size", direction.sigma));
  }

  for (size_t c = 0; c < calibration.camera_names.size(); ++c) {
    const BundleCamera& camera = calibration.bundle.cameras[c];
    const std::string prefix = calibration.camera_names[c] + ".";
    // Parameters that correlate hang together in groups.
    std::vector<std::string> names;
    double strongest = 0;
    // Neighbours in a field correlate by their nature.
    std::vector<std::string> of_field;
    for (const Param& param : camera.model->params) {
      if (param.prior_sigma > 0) of_field.push_back(prefix + std::string(param.name));
    }
    const auto of_camera = [&](size_t i) {
      const std::string& name = uncertainty.names[i];
      return name.starts_with(prefix) && !name.starts_with(prefix + "T_camera_rig") &&
             !Holds(open, name) && !Holds(of_field, name);
    };
    for (Eigen::Index i = 0; i < uncertainty.correlation.rows(); ++i) {
      for (Eigen::Index j = 0; j < i; ++j) {
        const double correlation = std::abs(uncertainty.correlation(i, j));
        const auto a = static_cast<size_t>(j), b = static_cast<size_t>(i);
        if (!(correlation > kCorrelated) || !of_camera(a) || !of_camera(b)) continue;
        strongest = std::max(strongest, correlation);
        for (const size_t k : {a, b}) {
          if (!Holds(names, uncertainty.names[k])) names.push_back(uncertainty.names[k]);
        }
      }
    }
    if (!names.empty()) {
      add(false,
          names,
          fmt::format("known together far better than one by one (correlation {:.4f})", strongest));
    }
    std::vector<std::string> large, untold;
    for (size_t k = 0; k < camera.params.size(); ++k) {
      const ParamPlace place{c, k};
      if (calibration.bundle.Root(c, k) != place) continue;
      const Param& param = camera.model->params[k];
      const double sigma = uncertainty.params[c][k];
      const std::string name = prefix + std::string(param.name);
      const double size = std::max(std::abs(camera.params[k]), param.scale);
      if (Holds(open, name)) continue;
      if (param.prior_sigma > 0) {
        if (sigma > kUntold * param.prior_sigma) untold.push_back(name);
      } else if (sigma > kLarge * size) {
        large.push_back(name);
      }
    }
    if (!large.empty()) {
      add(false, large, fmt::format("sigma above {:.0f} % of their size", 100 * kLarge));
    }
    if (!untold.empty()) {
      const size_t count = untold.size();
      found.push_back({false,
                       std::move(untold),
                       fmt::format("{} of {} coefficients, told by the model's prior rather than "
                                   "by these images",
                                   count,
                                   of_field.size()),
                       "Their part of the image has no points: add images with the target there."});
    }
  }
  return found;
}

}  // namespace plenocal
