// SPDX-License-Identifier: Apache-2.0
//
// The scene with a random texture, as a camera's rays meet it.
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "apps/simulate/render/surface.h"
#include "apps/simulate/scene/scene_shape.h"

namespace plenocal::simulate {

/// Random brightness over a plane. Its structures are from half a pixel to 64 pixels wide at the
/// scene's middle depth, all with the same contrast; without visible period.
class SceneTexture {
 public:
  /// `texel`: m, the finest structure.
  SceneTexture(double texel, int seed);

  /// Mean brightness, 1: white paper, of a spot of some width around (u, v), all m.
  [[nodiscard]] float At(float u, float v, float width) const;

  static constexpr float kMean = 0.45f;     ///< brightness
  static constexpr float kContrast = 0.2f;  ///< standard deviation of the brightness of one point

 private:
  [[nodiscard]] float Sample(int level, float u, float v) const;

  float texel_;
  std::vector<cv::Mat> tiles_;  // CV_32F, periodic, mean 0; each half as fine as the one before
};

/// The texture that suits the cameras and depths of a specification.
SceneTexture MakeSceneTexture(const SimulationSpec& spec, const Observer& observer);

/// A part of a scene in a camera's frame.
class PosedScene : public Surface {
 public:
  /// `texture` must outlive the object.
  PosedScene(const SceneShape& shape,
             const RigidTransform& T_camera_world,
             const SceneTexture& texture);

  [[nodiscard]] float Radiance(const Eigen::Vector3f& origin,
                               const Eigen::Vector3f& direction,
                               const Spread& spread) const override;
  /// Faces are walls, then six a box.
  void Radiances(const RayBundle& rays,
                 const Spread& spread,
                 int face,
                 std::array<float, RayBundle::kMost>* radiances) const override;
  [[nodiscard]] std::pair<int, float> FaceOf(const Eigen::Vector3f& origin,
                                             const Eigen::Vector3f& direction) const override;

 private:
  /// A plane normal . p = offset with texture coordinates (u, v) = axes p + shift.
  struct Face {
    Eigen::Vector3f normal;
    float offset = 0;
    Eigen::Matrix<float, 2, 3> axes;
    Eigen::Vector2f shift;
  };
  struct PosedBox {
    Eigen::Matrix3f R;  // box by camera
    Eigen::Vector3f t, half, centre;
    float radius = 0;  // m, of the sphere around it
  };
  void AddFace(const Eigen::Matrix3d& axes,
               const Eigen::Vector3d& point,
               const RigidTransform& T_camera_frame);
  [[nodiscard]] float Brightness(const Face& face,
                                 const Eigen::Vector3f& point,
                                 const Spread& spread,
                                 float distance) const;

  const SceneTexture& texture_;
  std::vector<Face> faces_;
  size_t walls_ = 0;
  std::vector<PosedBox> boxes_;
};

}  // namespace plenocal::simulate
