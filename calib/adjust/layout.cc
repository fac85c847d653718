// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/layout.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace plenocal::internal {

bool EstimatesLocalModel(const Bundle& bundle) {
  return std::ranges::any_of(bundle.cameras, [](const BundleCamera& camera) {
    return camera.model->support_size > 0 && std::ranges::count(camera.fixed, false) > 0;
  });
}

std::vector<bool> CamerasWithData(const Bundle& bundle) {
  std::vector<bool> has_data(bundle.cameras.size(), false);
  for (const BundleObservation& observation : bundle.observations) {
    if (observation.used) has_data[static_cast<size_t>(observation.camera)] = true;
  }
  return has_data;
}

UnknownLayout MakeLayout(const Bundle& bundle, bool of_prior) {
  std::vector<bool> estimated = CamerasWithData(bundle);
  if (of_prior && bundle.prior) {
    for (const CalibrationPrior::Unknown& unknown : bundle.prior->unknowns) {
      estimated[unknown.camera] = true;
    }
  }
  UnknownLayout layout;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const BundleCamera& camera = bundle.cameras[c];
    std::vector<int> indices;
    layout.first.push_back(layout.head);
    for (size_t k = 0; k < camera.params.size(); ++k) {
      const bool own = bundle.Root(c, k) == ParamIndex{c, k};
      const bool fixed = camera.fixed[k] || (!camera.at_bound.empty() && camera.at_bound[k]);
      indices.push_back(!own || fixed || !estimated[c] ? -1 : layout.head++);
    }
    layout.params.push_back(indices);
    const bool free = !camera.is_master && estimated[c];
    layout.extrinsics.push_back(free ? layout.head : -1);
    if (free) layout.head += 6;
  }
  layout.first.push_back(layout.head);
  for (const BundleTarget& target : bundle.targets) {
    layout.targets.push_back(target.is_fixed ? -1 : layout.head);
    if (!target.is_fixed) layout.head += 6;
  }
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    for (size_t k = 0; k < layout.params[c].size(); ++k) {
      const ParamIndex root = bundle.Root(c, k);
      layout.params[c][k] = layout.params[root.camera][root.param];
    }
  }
  layout.markers = bundle.EstimatesMarkers() && !bundle.HasLandmarks();
  if (layout.markers && !bundle.scales.empty()) {
    layout.scales = layout.head;
    layout.head += static_cast<int>(std::ssize(bundle.scales));
  }
  layout.total = layout.head;
  if (layout.markers) layout.total = layout.Marker(static_cast<int>(bundle.markers.size()));
  return layout;
}

std::vector<int> UnknownsOf(const UnknownLayout& layout, size_t camera) {
  std::vector<int> unknowns = layout.params[camera];
  for (int i = layout.scales; i >= 0 && i < layout.head; ++i) unknowns.push_back(i);
  const auto add = [&](int first) {
    for (int i = 0; first >= 0 && i < 6; ++i) unknowns.push_back(first + i);
  };
  add(layout.extrinsics[camera]);
  std::ranges::for_each(layout.targets, add);
  std::ranges::sort(unknowns);
  unknowns.erase(std::unique(unknowns.begin(), unknowns.end()), unknowns.end());
  std::erase(unknowns, -1);
  return unknowns;
}

Eigen::VectorXd Values(const UnknownLayout& layout, const BundleState& bundle) {
  Eigen::VectorXd values = Eigen::VectorXd::Zero(layout.head);
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    for (size_t k = 0; k < layout.params[c].size(); ++k) {
      if (layout.params[c][k] >= 0) values[layout.params[c][k]] = bundle.cameras[c].params[k];
    }
  }
  return values;
}

StepBounds BoundsOfStep(const UnknownLayout& layout, const BundleState& bundle) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  StepBounds bounds{Eigen::VectorXd::Constant(layout.head, -kInfinity),
                    Eigen::VectorXd::Constant(layout.head, kInfinity)};
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const BundleCamera& camera = bundle.cameras[c];
    for (size_t k = 0; k < camera.rules.size(); ++k) {
      const int i = layout.params[c][k];
      if (i < 0) continue;
      bounds.lower[i] = std::max(bounds.lower[i], camera.rules[k].lower - camera.params[k]);
      bounds.upper[i] = std::min(bounds.upper[i], camera.rules[k].upper - camera.params[k]);
    }
  }
  return bounds;
}

void Move(const UnknownLayout& layout, const Eigen::VectorXd& step, BundleState* bundle) {
  for (size_t m = 0; layout.markers && m < bundle->markers.size(); ++m) {
    bundle->markers[m].position += step.segment<3>(layout.Marker(static_cast<int>(m)));
  }
  for (size_t k = 0; layout.scales >= 0 && k < bundle->scales.size(); ++k) {
    const double change = step[layout.scales + static_cast<int>(k)];
    bundle->scales[k].value += change;
    for (size_t m = 0; m < bundle->markers.size(); ++m) {
      bundle->markers[m].position +=
          change * bundle->ByScale(bundle->scales[k], static_cast<int>(m));
    }
  }
  for (size_t c = 0; c < bundle->cameras.size(); ++c) {
    BundleCamera& camera = bundle->cameras[c];
    for (size_t k = 0; k < camera.params.size(); ++k) {
      if (layout.params[c][k] >= 0) camera.params[k] += step[layout.params[c][k]];
    }
    if (layout.extrinsics[c] < 0) continue;
    camera.T_camera_rig = Retract(camera.T_camera_rig, step.segment<6>(layout.extrinsics[c]));
  }
  for (size_t k = 0; k < bundle->targets.size(); ++k) {
    if (layout.targets[k] < 0) continue;
    const RigidTransform& T_target_own = bundle->targets[k].T_target_own;
    MoveTarget(k, Retract(T_target_own, step.segment<6>(layout.targets[k])), bundle);
  }
}

bool WithinDomain(const BundleState& bundle, const std::vector<bool>& cameras) {
  for (size_t c = 0; c < cameras.size(); ++c) {
    const BundleCamera& camera = bundle.cameras[c];
    if (cameras[c] && !WithinBounds(*camera.model, camera.params.data())) return false;
  }
  return true;
}

void SetAtBounds(Bundle* bundle) {
  constexpr double kRounding = 4 * std::numeric_limits<double>::epsilon();
  for (BundleCamera& camera : bundle->cameras) {
    camera.at_bound.assign(camera.rules.empty() ? 0 : camera.params.size(), false);
  }
  const auto for_each_rule = [&](const auto& visit) {
    for (size_t c = 0; c < bundle->cameras.size(); ++c) {
      for (size_t k = 0; k < bundle->cameras[c].at_bound.size(); ++k) {
        const ParamIndex root = bundle->Root(c, k);
        visit(bundle->cameras[c], k, bundle->cameras[root.camera], root.param);
      }
    }
  };
  for_each_rule([&](const BundleCamera& camera, size_t k, BundleCamera& root, size_t param) {
    double& value = root.params[param];
    for (const double bound : {camera.rules[k].lower, camera.rules[k].upper}) {
      if (root.fixed[param] || !std::isfinite(bound)) continue;
      if (std::abs(value - bound) > kRounding * std::abs(bound)) continue;
      value = bound;
      root.at_bound.resize(root.params.size());
      root.at_bound[param] = true;
    }
  });
  for_each_rule([&](BundleCamera& camera, size_t k, const BundleCamera& root, size_t param) {
    camera.params[k] = root.params[param];
    camera.at_bound[k] = param < root.at_bound.size() && root.at_bound[param];
  });
}

}  // namespace plenocal::internal
