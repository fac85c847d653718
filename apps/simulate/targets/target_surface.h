// SPDX-License-Identifier: Apache-2.0
//
// The brightness of a target with its errors of manufacture where a ray meets it.
//
// Each flat part of the target has one picture of its nominal shapes. Their true positions are
// given by small maps from space to that picture, one for each tag (a homography from the tag's
// true corners), each half of a square between corners of a chessboard (affine, so that neighbours
// meet) or each circle (a translation).
#pragma once

#include <Eigen/Core>
#include <array>
#include <opencv2/core/mat.hpp>
#include <utility>
#include <vector>

#include "apps/simulate/render/observer.h"
#include "apps/simulate/render/surface.h"
#include "targets/target_drawing.h"

namespace plenocal::simulate {

/// A plane of which a piece is seen, and the map from its points p to picture coordinates (m):
/// (u, v) = (h_0, h_1) / h_2 with h = M (p, 1).
struct PictureMap {
  Eigen::Vector3f normal{0, 0, 0};
  float offset = 0;  ///< the plane is normal . p = offset
  Eigen::Matrix<float, 3, 4> M;
};

/// The target, independent of its pose.
class TargetSurface {
 public:
  /// `nominal`: the target without its refinement, as printed.
  TargetSurface(const Target& nominal, const TrueTarget& made, int seed);
  /// Adds the boards of another target at a pose.
  void Append(const TargetSurface& other, const RigidTransform& T_this_other);

 private:
  friend class PosedSurface;
  struct Board {
    std::vector<cv::Mat> picture;  // CV_8U, each half as fine as the one before
    Eigen::Vector2f corner{0, 0};  // m, of the picture
    float texel = 0;               // m, of the finest
    Eigen::Vector2f size{0, 0};    // m
    cv::Mat which;                 // CV_32S, map of each cell of the picture; -1: the board's own
    float which_cell = 0;          // m
    RigidTransform T_target_board;
    struct Map {
      RigidTransform T_target_plane;
      Eigen::Matrix3d picture_by_plane;
    };
    std::vector<Map> maps;  // true positions of the shapes

    // Sets the map of each cell: choose(position in the picture, m).
    template <typename Choose>
    void ChooseMaps(const Choose& choose);
  };
  void Draw(const TargetPart& part, int seed, Board* board);
  static void MapTags(const TargetPart& part, const TrueTarget& made, Board* board);
  static void MapSquares(const SquareGrid& grid,
                         const Target& nominal,
                         const TrueTarget& made,
                         Board* board);
  static void MapDiscs(const TargetPart& part,
                       const Target& nominal,
                       const TrueTarget& made,
                       Board* board);

  std::vector<Board> boards_;
};

/// The target at a pose before a camera.
class PosedSurface : public Surface {
 public:
  PosedSurface(const TargetSurface& surface, const RigidTransform& T_camera_target);

  [[nodiscard]] float Radiance(const Eigen::Vector3f& origin,
                               const Eigen::Vector3f& direction,
                               const Spread& spread) const override;
  /// Faces are the fronts of boards.
  void Radiances(const RayBundle& rays,
                 const Spread& spread,
                 int board,
                 std::array<float, RayBundle::kMost>* radiances) const override;
  [[nodiscard]] std::pair<int, float> FaceOf(const Eigen::Vector3f& origin,
                                             const Eigen::Vector3f& direction) const override;

  static constexpr float kInk = 0.04f;
  static constexpr float kBack = 0.3f;  ///< a board's back

 private:
  struct Board {
    const TargetSurface::Board* of;
    PictureMap own;
    std::vector<PictureMap> maps;
  };
  /// The point at which a ray first meets the target.
  struct Hit {
    const Board* board = nullptr;  ///< null: nowhere
    float distance = 0;
    Eigen::Vector2f at{0, 0};  ///< picture coordinates from the picture's corner, m
  };
  [[nodiscard]] Hit FindHit(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction) const;
  [[nodiscard]] static int MapAt(const TargetSurface::Board& board, float u, float v);
  [[nodiscard]] static float Sample(const TargetSurface::Board& board, int level, float u, float v);
  [[nodiscard]] static int LevelOf(const TargetSurface::Board& board,
                                   const Spread& spread,
                                   float distance);

  std::vector<Board> boards_;
};

}  // namespace plenocal::simulate
