// SPDX-License-Identifier: Apache-2.0
//
// Rendering of a blurred raster of cells with its derivatives.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "detectors/templates/lanes.h"

namespace plenocal::internal {

/// A square drawing of n x n cells of one size, or between given lines, seen through a homography G
/// and blurred by a Gaussian, or by one and the area of a pixel.
///
/// The homography is taken as affine within the blur; there the drawing is a sum over its cells of
/// products of steps along its two axes, where the axes are at right angles. Where they are not,
/// the blurs along them are correlated by some r. For a small r the tetrachoric series, cut after
/// r^2, continues the sum; for a larger one both blurs are split into a common part, which is
/// integrated numerically, and independent rests.
class CellTemplate {
 public:
  /// `cells`: n x n values by rows, the first row at the top. Those of the outermost cells go on
  /// without end.
  CellTemplate(std::vector<float> cells, int n);
  /// Cell i of either axis lies between lines[i] and lines[i + 1], ascending; "cells" as a unit of
  /// length is that of the lines.
  CellTemplate(std::vector<float> cells, std::vector<float> lines);

  /// Gives all outermost cells one value, which `Drawn::by_beyond` belongs to.
  void SetBeyond(float value);

  /// Of eight places at once.
  struct Drawn {
    Lanes value{}, by_u{}, by_v{}, by_blur{}, by_beyond{};
    Lanes bend{}, twist{};    ///< T_aa + T_bb and T_ab, with a, b = place / blur
    Lanes u{}, v{}, scale{};  ///< place in cells, third homogeneous coordinate
  };
  /// The drawing at eight (x, y) with derivatives by its place (u, v) in cells, counted from the
  /// upper left corner, and by the blur. G maps (x, y, 1) to cells, G(2, 2) = 1; `blur` is in the
  /// unit of x and y. `pixel`: side of the pixel whose area makes a part of the blur; 0: the blur
  /// is a Gaussian.
  void Draw(const Eigen::Matrix3f& G,
            float blur,
            float pixel,
            const Lanes& x,
            const Lanes& y,
            Drawn* drawn);

  [[nodiscard]] int size() const { return n_; }
  /// -1 where the drawing is of one value all around (u, v), in cells, to a distance of `reach` in
  /// both directions, which must end within the drawing; else 0.
  PLENOCAL_LANES void FindFlat(const Lanes& u, const Lanes& v, float reach, IntLanes* flat) const {
    const IntLanes left = __builtin_convertvector(u - reach, IntLanes);
    const IntLanes right = __builtin_convertvector(u + reach, IntLanes);
    const IntLanes above = n_ * __builtin_convertvector(v - reach, IntLanes);
    const IntLanes below = n_ * __builtin_convertvector(v + reach, IntLanes);
    const float* const cells = cells_.data();
    for (int l = 0; l < kLanes; ++l) {
      const float value = cells[above[l] + left[l]];
      // All at once: branches would be predicted wrongly half of the time.
      (*flat)[l] = -(static_cast<int>(value == cells[above[l] + right[l]]) &
                     static_cast<int>(value == cells[below[l] + left[l]]) &
                     static_cast<int>(value == cells[below[l] + right[l]]));
    }
  }

 private:
  /// Along one axis at a place: the share of each of some neighbouring cells, and its first two
  /// derivatives by the place / blur.
  struct Profile {
    struct Cell {
      Lanes share, slope, bend;
    };
    IntLanes first{};
    int count = 0;
    std::vector<Cell> cells;
    void Fill(const Lanes& at,
              const Lanes& reach,
              const StepBlur& blur,
              int n,
              const std::vector<float>& lines);
    void AddKnown(int n, Lanes* known) const;
  };
  /// A place and the blurs along the two axes, cells, which are correlated by a small `r`.
  struct BlurredPlace {
    Lanes u, v, blur_u, blur_v, r;
    StepBlur across, down;
  };
  /// Adds `weight` times the drawing there.
  void AddProduct(const BlurredPlace& at, const Lanes& weight, Drawn* drawn);

  int n_;
  std::vector<float> cells_;  ///< and zeros, for profiles that end beyond
  std::vector<float> lines_;  ///< n + 1; empty: at the integers
  Profile across_, down_;
};

}  // namespace plenocal::internal
