// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/render/observer.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <array>
#include <cmath>
#include <set>
#include <variant>

#include "calib/camera/lens_lattice.h"

namespace plenocal::simulate {
namespace {

using Corners = std::array<Eigen::Vector3d, 4>;

Corners CornersOf(const MarkerPositions& markers, const MarkerQuad& quad) {
  return {markers.at(quad[0]), markers.at(quad[1]), markers.at(quad[2]), markers.at(quad[3])};
}

// Towards the viewer of a tag whose corners are lower left, lower right, upper right, upper left.
Eigen::Vector3d Normal(const Corners& corners) {
  return (corners[2] - corners[0]).cross(corners[3] - corners[1]).normalized();
}

// Some of the twelve errors of a tag's coordinates would change its shape. They are taken out; the
// others are made larger, so that the coordinates keep their variance.
Corners KeepFlat(const Corners& nominal, Corners errors) {
  const Eigen::Vector3d normal = Normal(nominal);
  constexpr std::array kTwist{1, -1, 1, -1};  // out of the plane
  double twist = 0;
  for (size_t k = 0; k < 4; ++k) twist += kTwist[k] * normal.dot(errors[k]) / 4;
  for (size_t k = 0; k < 4; ++k) {
    const double height = normal.dot(errors[k]);
    errors[k] += ((height - kTwist[k] * twist) * std::sqrt(4.0 / 3.0) - height) * normal;
  }
  return errors;
}

Corners KeepShape(const Corners& nominal, const Corners& errors) {
  const Eigen::Vector3d middle = (nominal[0] + nominal[1] + nominal[2] + nominal[3]) / 4;
  Eigen::Vector3d shift(0, 0, 0), moment(0, 0, 0);
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();
  double stretch = 0, squares = 0;
  for (size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d r = nominal[k] - middle;
    shift += errors[k] / 4;
    moment += r.cross(errors[k]);
    inertia += r.squaredNorm() * Eigen::Matrix3d::Identity() - r * r.transpose();
    stretch += r.dot(errors[k]);
    squares += r.squaredNorm();
  }
  const Eigen::Vector3d turn = inertia.inverse() * moment;
  const double larger =
      std::sqrt(12.0 / 7);  // translation, rotation and scale have 7 of 12 degrees of freedom
  const Eigen::Matrix3d R = (1 + larger * stretch / squares) * ExpRotation(larger * turn);
  Corners kept;
  for (size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d r = nominal[k] - middle;
    kept[k] = larger * shift + R * r - r;
  }
  return kept;
}

}  // namespace

TrueTarget MakeTarget(const Target& nominal, double sigma, TagErrors tag_errors, int seed) {
  TrueTarget target{.markers = nominal.markers, .normals = {}};
  Random random(seed, "target");
  for (auto& [number, position] : target.markers) {
    for (int i = 0; i < 3; ++i) position[i] += random.Gaussian(sigma);
  }
  std::visit(
      [&](const auto& layout) {
        for (const auto& [number, position] : nominal.markers) {
          target.normals[number] = layout.Normal(nominal.markers, number);
        }
        for (const MarkerQuad& quad : layout.Quads()) {
          const Corners meant = CornersOf(nominal.markers, quad);
          Corners errors = CornersOf(target.markers, quad);
          for (size_t k = 0; k < 4; ++k) errors[k] -= meant[k];
          errors =
              tag_errors == TagErrors::kRigid ? KeepShape(meant, errors) : KeepFlat(meant, errors);
          for (size_t k = 0; k < 4; ++k) target.markers[quad[k]] = meant[k] + errors[k];
          // Flat to first order only: exactly so by a move of one corner, far below its error.
          Eigen::Vector3d& last = target.markers[quad[2]];
          const Eigen::Vector3d& origin = target.markers[quad[0]];
          const Eigen::Vector3d normal =
              (target.markers[quad[1]] - origin).cross(target.markers[quad[3]] - origin);
          last -= normal.dot(last - origin) / normal.dot(Normal(meant)) * Normal(meant);
        }
      },
      nominal.layout);
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
    const std::vector<Observation> of_marker = ObservePoint(c, number, p_cam);
    seen.insert(seen.end(), of_marker.begin(), of_marker.end());
  }
  return seen;
}

std::vector<Observation> Observer::ObservePoint(std::size_t c,
                                                int marker,
                                                const Eigen::Vector3d& p_cam) const {
  if (optics_[c]) return optics_[c]->Observe(marker, p_cam);
  const CameraSpec& camera = spec_.cameras[c];
  Observation observation{.marker = marker};
  if (camera.model->Project(
          camera.params.data(), camera.config.data(), nullptr, p_cam, observation.values.data()) &&
      IsInside({observation.values[0], observation.values[1]}, camera.image_size)) {
    return {observation};
  }
  return {};
}

std::optional<Ray> Observer::CentralRay(std::size_t c, const Eigen::Vector2d& u) const {
  if (optics_[c]) return optics_[c]->RayThrough(u, u);
  const CameraSpec& camera = spec_.cameras[c];
  return camera.model->Unproject(camera.params.data(), camera.config.data(), u.data());
}

void AddNoise(const CameraSpec& camera, Random* random, Observation* observation) {
  for (size_t i = 0; i < camera.model->measured.size(); ++i) {
    observation->values[i] += random->Gaussian(camera.detection_sigma);
  }
  observation->detector_sigma = camera.detection_sigma;
}

int CountMarkers(const std::vector<Observation>& observations) {
  std::set<int> markers;
  for (const Observation& observation : observations) markers.insert(observation.marker);
  return static_cast<int>(markers.size());
}

}  // namespace plenocal::simulate
