// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

namespace plenocal::internal {

/// A square drawing of n x n cells seen through a homography G and blurred by a Gaussian.
///
/// The homography is taken as affine within the blur; there the drawing is a sum over its cells of
/// products of steps along its two axes, where the axes are at right angles. Where they are not,
/// the blurs along them are correlated by some r. For a small r the tetrachoric series, cut after
/// r^2, continues the sum; for a larger one both blurs are split into a common part, which is
/// integrated numerically, and independent rests.
class CellDrawing {
 public:
  /// `cells`: n x n values by rows, the first row at the top. Those of the outermost cells go on
  /// without end.
  CellDrawing(std::vector<float> cells, int n);

  /// Gives all outermost cells one value, which `Drawn::by_beyond` belongs to.
  void SetBeyond(float value);

  struct Drawn {
    float value = 0, by_u = 0, by_v = 0, by_blur = 0, by_beyond = 0;
    float bend = 0, twist = 0;      ///< T_aa + T_bb and T_ab, with a, b = place / blur
    float u = 0, v = 0, scale = 0;  ///< place in cells, third homogeneous coordinate
  };
  /// The drawing at (x, y) with derivatives by its place (u, v) in cells, counted from the upper
  /// left corner, and by the blur. G maps (x, y, 1) to cells, G(2, 2) = 1; `blur` is in the unit of
  /// x and y.
  Drawn Draw(const Eigen::Matrix3f& G, float blur, float x, float y);

  [[nodiscard]] int size() const { return n_; }

 private:
  /// Along one axis at a place: the share of each of some neighbouring cells, and its first two
  /// derivatives by the place / blur.
  struct Profile {
    int first = 0, count = 0;
    std::vector<float> share, slope, bend;
    void Fill(float at, float blur, int n);
    [[nodiscard]] float Known(int n) const;
  };
  /// Adds `weight` times a drawing whose blurs (cells) are correlated by a small `r`.
  void AddProduct(
      float u, float v, float blur_u, float blur_v, float r, float weight, Drawn* drawn);

  int n_;
  std::vector<float> cells_;
  Profile across_, down_;
};

}  // namespace plenocal::internal
