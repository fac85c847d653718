// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/photometry/wall_surface.h"

#include <algorithm>
#include <cmath>

namespace plenocal::simulate {
namespace {

constexpr float kPaint = 0.6f;  // mean brightness of the wall
// The lamp before the wall, m; z of the target's frame points out of the wall.
const Eigen::Vector3f kLamp(-0.4f, -0.3f, 2.f);

}  // namespace

WallSurface::WallSurface(const WallSpec& wall,
                         const SceneTexture& texture,
                         const PosedSurface& target,
                         const RigidTransform& T_camera_target)
    : wall_(wall), texture_(texture), target_(target) {
  const RigidTransform T_target_camera = T_camera_target.Inverse();
  R_ = T_target_camera.R.cast<float>();
  viewer_ = T_target_camera.t.cast<float>();
  const Eigen::Vector3f forward = R_.col(2);
  axis_ = (viewer_ - viewer_.z() / forward.z() * forward).head<2>();
}

WallSurface::Hit WallSurface::Meet(const Eigen::Vector3f& origin,
                                   const Eigen::Vector3f& direction) const {
  const Eigen::Vector3f o = R_ * origin + viewer_, d = R_ * direction;
  Hit hit;
  hit.distance = -o.z() / d.z();
  hit.point = o + hit.distance * d;
  hit.place = hit.point.head<2>();
  if (!wall_.fold || hit.point.x() < *wall_.fold) return hit;
  const auto fold = static_cast<float>(*wall_.fold);
  const auto sine = static_cast<float>(std::sin(wall_.fold_angle));
  const auto cosine = static_cast<float>(std::cos(wall_.fold_angle));
  hit.distance = ((fold - o.x()) * sine + o.z() * cosine) / (d.x() * sine - d.z() * cosine);
  hit.point = o + hit.distance * d;
  hit.place = {fold + (hit.point.x() - fold) / cosine, hit.point.y()};
  return hit;
}

float WallSurface::Light(const Hit& hit) const {
  const float square = (hit.point - kLamp).head<2>().squaredNorm();
  const auto lost = static_cast<float>(wall_.light);
  const float lamp = 1 / (1 + square * lost / (1 - lost));
  const float tangent = (hit.point.x() - axis_.x()) / std::max(viewer_.z(), 1e-3f);
  return lamp * (1 + static_cast<float>(wall_.shading) * tangent);
}

// Blinn's model: a lobe about the direction of reflection.
float WallSurface::Gloss(const Hit& hit) const {
  constexpr float kSharpness = 40;
  const Eigen::Vector3f to_lamp = (kLamp - hit.point).normalized();
  const Eigen::Vector3f to_viewer = (viewer_ - hit.point).normalized();
  const float cosine = std::max((to_lamp + to_viewer).normalized().z(), 0.f);
  return static_cast<float>(wall_.gloss) * std::pow(cosine, kSharpness);
}

float WallSurface::Radiance(const Eigen::Vector3f& origin,
                            const Eigen::Vector3f& direction,
                            const Spread& spread) const {
  const Hit hit = Meet(origin, direction);
  if (!(hit.distance > 0)) return kBackground;
  float paint = 0;
  if (target_.FaceOf(origin, direction).first >= 0) {
    paint = target_.Radiance(origin, direction, spread);
  } else {
    const float width = spread.at_origin + spread.by_distance * hit.distance;
    const float structure = texture_.At(hit.place.x(), hit.place.y(), width);
    paint = kPaint * (1 + static_cast<float>(wall_.contrast) / SceneTexture::kContrast *
                              (structure - SceneTexture::kMean));
  }
  const float gloss = wall_.gloss > 0 ? Gloss(hit) : 0.f;
  return (paint + gloss) * Light(hit);
}

std::pair<int, float> WallSurface::FaceOf(const Eigen::Vector3f& origin,
                                          const Eigen::Vector3f& direction) const {
  return {-1, Meet(origin, direction).distance};
}

}  // namespace plenocal::simulate
