// SPDX-License-Identifier: Apache-2.0
//
// Micro images of a plenoptic camera that show a scene point.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/camera/micro_lens_array.h"

namespace plenocal {

class MicroLensVisibility {
 public:
  MicroLensVisibility() = default;
  /// `array`: of at least one micro lens.
  explicit MicroLensVisibility(const MicroLensArray& array);

  /// `centres` of micro images, px, at least one; `pitch`: distance of neighbours, px.
  MicroLensVisibility(ImageSize image_size, double pitch, std::vector<Eigen::Vector2d> centres);

  [[nodiscard]] bool HasLenses() const { return !centres_.empty(); }
  /// Centre of the micro image nearest to a place in the raw image, px.
  [[nodiscard]] Eigen::Vector2d Nearest(const Eigen::Vector2d& u_px) const;
  /// Centres of the micro images that show p_cam, at most `most` of them evenly chosen, and how
  /// many there are. Empty outside the model's domain.
  struct Seen {
    std::vector<Eigen::Vector2d> centres;
    size_t all = 0;
    Eigen::Vector2d image{0, 0};  ///< the virtual image point, px
  };
  [[nodiscard]] Seen LensesShowing(const BundleCamera& camera,
                                   const Eigen::Vector3d& p_cam,
                                   size_t most) const;

 private:
  [[nodiscard]] size_t Bucket(const Eigen::Vector2d& u_px) const;

  double pitch_ = 1;
  int columns_ = 0, rows_ = 0;
  std::vector<Eigen::Vector2d> centres_;
  std::vector<std::vector<size_t>> buckets_;  // of squares as wide as the pitch
};

}  // namespace plenocal
