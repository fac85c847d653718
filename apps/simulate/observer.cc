// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/observer.h"

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <set>
#include <variant>

#include "apps/simulate/random.h"
#include "calib/hexagonal_lattice.h"

namespace plenocal::simulate {
namespace {

using Corners = std::array<Eigen::Vector3d, 4>;

Corners CornersOf(const std::map<int, Eigen::Vector3d>& markers, int tag) {
  return {markers.at(4 * tag),
          markers.at(4 * tag + 1),
          markers.at(4 * tag + 2),
          markers.at(4 * tag + 3)};
}

// Towards the viewer of a tag whose corners are lower left, lower right, upper right, upper left.
Eigen::Vector3d Normal(const Corners& corners) {
  return (corners[2] - corners[0]).cross(corners[3] - corners[1]).normalized();
}

}  // namespace

TrueTarget MakeTarget(const Target& nominal, double sigma, int seed) {
  TrueTarget target{.nominal = &nominal, .markers = nominal.markers, .normals = {}};
  Random random(seed, "target");
  for (auto& [number, position] : target.markers) {
    for (int i = 0; i < 3; ++i) position[i] += random.Gaussian(sigma);
  }
  if (const auto* tags = std::get_if<TagLayout>(&nominal.layout)) {
    for (const int tag : tags->ids) {
      const Eigen::Vector3d normal = Normal(CornersOf(nominal.markers, tag));
      // Of the four errors out of the plane one, the twist, would bend the tag. The other three
      // are made larger, so that the coordinates keep their variance.
      constexpr std::array kTwist{1, -1, 1, -1};
      std::array<double, 4> height{};
      double twist = 0;
      for (int k = 0; k < 4; ++k) {
        height[k] = normal.dot(target.markers[4 * tag + k] - nominal.markers.at(4 * tag + k));
        twist += kTwist[k] * height[k] / 4;
      }
      for (int k = 0; k < 4; ++k) {
        const double flat = (height[k] - kTwist[k] * twist) * std::sqrt(4.0 / 3.0);
        target.markers[4 * tag + k] += (flat - height[k]) * normal;
      }
      for (int k = 0; k < 4; ++k) target.normals[4 * tag + k] = normal;
    }
  } else {
    // z = 0, x right and y down as seen from the printed side.
    const bool is_board = !std::holds_alternative<MarkersLayout>(nominal.layout);
    for (const auto& [number, position] : target.markers) {
      target.normals[number] = is_board ? Eigen::Vector3d(0, 0, -1) : Eigen::Vector3d(0, 0, 0);
    }
  }
  return target;
}

Observer::Observer(const SimulationSpec& spec) : spec_(spec) {
  for (const CameraSpec& camera : spec.cameras) {
    optics_.push_back(camera.IsPlenoptic() ? std::make_unique<MicroLensOptics>(camera) : nullptr);
  }
}

std::vector<Observation> Observer::Observe(std::size_t c,
                                           const TrueTarget& target,
                                           const RigidTransform& T_rig_target) const {
  const CameraSpec& camera = spec_.cameras[c];
  const RigidTransform T_camera_target = camera.T_camera_rig * T_rig_target;
  std::vector<Observation> seen;
  for (const auto& [number, position] : target.markers) {
    const Eigen::Vector3d p_cam = T_camera_target * position;
    const Eigen::Vector3d& normal = target.normals.at(number);
    if (!normal.isZero() && !((T_camera_target.R * normal).dot(p_cam) < 0)) continue;
    if (optics_[c]) {
      const std::vector<Observation> through = optics_[c]->Observe(number, p_cam);
      seen.insert(seen.end(), through.begin(), through.end());
      continue;
    }
    Observation observation{.marker = number};
    if (camera.model->project(camera.params.data(),
                              camera.config.data(),
                              nullptr,
                              p_cam,
                              observation.values.data()) &&
        IsInside({observation.values[0], observation.values[1]}, camera.image_size)) {
      seen.push_back(observation);
    }
  }
  return seen;
}

std::optional<Ray> Observer::CentralRay(std::size_t c, const Eigen::Vector2d& u) const {
  if (optics_[c]) return optics_[c]->RayThrough(u, u);
  const CameraSpec& camera = spec_.cameras[c];
  return camera.model->unproject(camera.params.data(), camera.config.data(), u.data());
}

int CountMarkers(const std::vector<Observation>& observations) {
  std::set<int> markers;
  for (const Observation& observation : observations) markers.insert(observation.marker);
  return static_cast<int>(markers.size());
}

}  // namespace plenocal::simulate
