// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/scene/scene_surface.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "apps/simulate/spec/random.h"

namespace plenocal::simulate {
namespace {

constexpr int kTile = 1024;     // texels, of a tile's side
constexpr int kOctaves = 8;     // structures of 1, 2, 4, ..., 128 texels
constexpr int kTileLevels = 9;  // of the tile, each half as fine

// Periodic noise with structures of `size` texels.
cv::Mat Octave(int size, Random* random) {
  const int count = kTile / size;
  // Two more around, so that the interpolation goes over the rim.
  cv::Mat coarse(count, count, CV_32F), padded, fine;
  for (int y = 0; y < count; ++y) {
    for (int x = 0; x < count; ++x) {
      coarse.at<float>(y, x) = static_cast<float>(random->Gaussian(1));
    }
  }
  if (size == 1) return coarse;
  cv::copyMakeBorder(coarse, padded, 2, 2, 2, 2, cv::BORDER_WRAP);
  cv::resize(padded, fine, {}, size, size, cv::INTER_CUBIC);
  return fine(cv::Rect(2 * size, 2 * size, kTile, kTile)).clone();
}

// Angle between the rays of neighbouring pixels in the middle of the image, rad.
double PixelAngle(const CameraSpec& camera, const Observer& observer, size_t c) {
  const Eigen::Vector2d middle(camera.image_size[0] / 2.0, camera.image_size[1] / 2.0);
  const auto a = observer.CentralRay(c, middle);
  const auto b = observer.CentralRay(c, middle + Eigen::Vector2d(1, 0));
  if (!a || !b) return std::numeric_limits<double>::infinity();
  return a->direction.cross(b->direction).norm();
}

// Two directions across `normal`, as rows, then the normal.
Eigen::Matrix3d MakeAxes(const Eigen::Vector3d& normal) {
  const Eigen::Vector3d aside =
      std::abs(normal.z()) < 0.9 ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitX();
  Eigen::Matrix3d axes;
  axes.row(0) = aside.cross(normal).normalized();
  axes.row(1) = normal.cross(Eigen::Vector3d(axes.row(0)));
  axes.row(2) = normal;
  return axes;
}

}  // namespace

SceneTexture::SceneTexture(double texel, int seed) : texel_(static_cast<float>(texel)) {
  Random random(seed, "texture");
  cv::Mat tile(kTile, kTile, CV_32F, cv::Scalar(0));
  for (int octave = 0; octave < kOctaves; ++octave) tile += Octave(1 << octave, &random);
  cv::Scalar mean, deviation;
  cv::meanStdDev(tile, mean, deviation);
  // Two samples of the tile are added.
  tile = (tile - mean[0]) * (kContrast / std::sqrt(2.0) / deviation[0]);
  for (int level = 0; level < kTileLevels; ++level) {
    tiles_.push_back(tile.clone());
    cv::resize(tile, tile, {}, 0.5, 0.5, cv::INTER_AREA);
  }
}

float SceneTexture::Sample(int level, float u, float v) const {
  const cv::Mat& tile = tiles_[static_cast<size_t>(level)];
  const int mask = tile.cols - 1;
  const float floor_u = std::floor(u), floor_v = std::floor(v);
  const float fu = u - floor_u, fv = v - floor_v;
  const int x = static_cast<int>(floor_u) & mask, y = static_cast<int>(floor_v) & mask;
  const float* top = tile.ptr<float>(y);
  const float* below = tile.ptr<float>((y + 1) & mask);
  const int next = (x + 1) & mask;
  return (1 - fv) * ((1 - fu) * top[x] + fu * top[next]) +
         fv * ((1 - fu) * below[x] + fu * below[next]);
}

float SceneTexture::At(float u, float v, float width) const {
  // A second sample of the tile, rotated and coarser, hides the period of the first.
  constexpr float kCos = 0.8f, kSin = 0.6f, kCoarser = 1.3719f;
  int level = 0;
  float texel = texel_;
  for (; 2 * texel < width && level + 1 < kTileLevels; texel *= 2) ++level;
  const float scale = 1 / texel, second = 1 / (kCoarser * texel);
  const float noise = Sample(level, u * scale, v * scale) +
                      Sample(level, (kCos * u - kSin * v) * second, (kSin * u + kCos * v) * second);
  return std::clamp(kMean + noise, 0.02f, 1.f);
}

SceneTexture MakeSceneTexture(const SimulationSpec& spec, const Observer& observer) {
  double angle = std::numeric_limits<double>::infinity();
  for (size_t c = 0; c < spec.cameras.size(); ++c) {
    angle = std::min(angle, PixelAngle(spec.cameras[c], observer, c));
  }
  const SceneSpec& scene = spec.scenery->scene;
  return {0.5 * angle * std::sqrt(scene.nearest * scene.farthest), spec.seed};
}

PosedScene::PosedScene(const SceneShape& shape,
                       const RigidTransform& T_camera_world,
                       const SceneTexture& texture)
    : texture_(texture), walls_(shape.walls.size()) {
  for (const Wall& wall : shape.walls) {
    AddFace(MakeAxes(wall.normal), wall.offset * wall.normal, T_camera_world);
  }
  for (const Box& box : shape.boxes) {
    const RigidTransform T_camera_box = T_camera_world * box.T_world_box;
    const RigidTransform T_box_camera = T_camera_box.Inverse();
    boxes_.push_back({.R = T_box_camera.R.cast<float>(),
                      .t = T_box_camera.t.cast<float>(),
                      .half = box.half.cast<float>(),
                      .centre = T_camera_box.t.cast<float>(),
                      .radius = static_cast<float>(box.half.norm())});
    for (int axis = 0; axis < 3; ++axis) {
      for (const double side : {-1.0, 1.0}) {
        const Eigen::Vector3d normal = side * Eigen::Vector3d::Unit(axis);
        AddFace(MakeAxes(normal), box.half[axis] * normal, T_camera_box);
      }
    }
  }
}

// `axes` and `point` in the frame of the wall or box that moves with the texture.
void PosedScene::AddFace(const Eigen::Matrix3d& axes,
                         const Eigen::Vector3d& point,
                         const RigidTransform& T_camera_frame) {
  const RigidTransform T_frame_camera = T_camera_frame.Inverse();
  const Eigen::Matrix3d by_camera = axes * T_frame_camera.R;
  const Eigen::Vector3d shift = axes * T_frame_camera.t;
  // Faces of equal orientation differ in their texture by where they are.
  const Eigen::Vector3d start = 7.13 * Eigen::Vector3d(axes.row(2)) + 3.71 * point;
  faces_.push_back(
      {.normal = by_camera.row(2).cast<float>(),
       .offset = static_cast<float>(axes.row(2).dot(point) - shift.z()),
       .axes = by_camera.topRows<2>().cast<float>(),
       .shift =
           (shift.head<2>() + Eigen::Vector2d(start.sum(), start.x() - start.y())).cast<float>()});
}

std::pair<int, float> PosedScene::FaceOf(const Eigen::Vector3f& origin,
                                         const Eigen::Vector3f& direction) const {
  int face = -1;
  float nearest = std::numeric_limits<float>::infinity();
  for (size_t i = 0; i < walls_; ++i) {
    const float towards = faces_[i].normal.dot(direction);
    const float gap = faces_[i].offset - faces_[i].normal.dot(origin);
    if (towards > 0 && gap < nearest * towards) nearest = gap / towards, face = static_cast<int>(i);
  }
  const float squared = direction.squaredNorm();
  for (size_t k = 0; k < boxes_.size(); ++k) {
    const PosedBox& box = boxes_[k];
    const Eigen::Vector3f to = box.centre - origin;
    const float along = to.dot(direction);
    if (along < 0 ||
        to.squaredNorm() * squared - along * along > box.radius * box.radius * squared) {
      continue;
    }
    const Eigen::Vector3f o = box.R * origin + box.t, d = box.R * direction;
    float enter = 0, leave = nearest;
    int side = -1;
    for (int i = 0; i < 3; ++i) {
      const float inverse = 1 / d[i];
      const float low = (-box.half[i] - o[i]) * inverse, high = (box.half[i] - o[i]) * inverse;
      if (std::min(low, high) > enter)
        enter = std::min(low, high), side = 2 * i + (d[i] < 0 ? 1 : 0);
      leave = std::min(leave, std::max(low, high));
    }
    if (side < 0 || !(enter < leave)) continue;
    nearest = enter;
    face = static_cast<int>(walls_ + 6 * k) + side;
  }
  return {face, face < 0 ? 0 : nearest};
}

float PosedScene::Brightness(const Face& face,
                             const Eigen::Vector3f& point,
                             const Spread& spread,
                             float distance) const {
  const Eigen::Vector2f at = face.axes * point + face.shift;
  return texture_.At(at.x(), at.y(), std::abs(spread.at_origin + spread.by_distance * distance));
}

float PosedScene::Radiance(const Eigen::Vector3f& origin,
                           const Eigen::Vector3f& direction,
                           const Spread& spread) const {
  const auto [face, distance] = FaceOf(origin, direction);
  if (face < 0) return kBackground;
  return Brightness(
      faces_[static_cast<size_t>(face)], origin + distance * direction, spread, distance);
}

void PosedScene::Radiances(const RayBundle& rays,
                           const Spread& spread,
                           int face_index,
                           std::array<float, RayBundle::kMost>* radiances) const {
  if (face_index < 0) return Surface::Radiances(rays, spread, face_index, radiances);
  const Face& face = faces_[static_cast<size_t>(face_index)];
  for (size_t k = 0; k < static_cast<size_t>(rays.count); ++k) {
    const Eigen::Vector3f origin = rays.Origin(k), direction = rays.Direction(k);
    const float distance = (face.offset - face.normal.dot(origin)) / face.normal.dot(direction);
    (*radiances)[k] = Brightness(face, origin + distance * direction, spread, distance);
  }
}

}  // namespace plenocal::simulate
