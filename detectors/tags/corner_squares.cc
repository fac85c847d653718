// SPDX-License-Identifier: Apache-2.0
#include "detectors/tags/corner_squares.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace plenocal::internal {
namespace {

/// Gray level at a place in tag coordinates, x and y in bits from corner `k`, positive into the
/// tag; nothing beside the image.
class CornerView {
 public:
  CornerView(const cv::Mat& gray, const SeenTag& tag, const TagBorder& border)
      : gray_(gray), H_(UnitSquareHomography(tag.corners)), bit_(1.0 / border.width) {}

  [[nodiscard]] std::optional<double> At(std::size_t k, double x, double y) const {
    const bool right = k == 1 || k == 2, upper = k > 1;
    const Eigen::Vector3d on_tag(
        right ? 1 - x * bit_ : x * bit_, upper ? 1 - y * bit_ : y * bit_, 1);
    const Eigen::Vector2d p = (H_ * on_tag).hnormalized();
    if (!(p.x() >= 0 && p.y() >= 0 && p.x() <= gray_.cols - 1 && p.y() <= gray_.rows - 1)) {
      return std::nullopt;
    }
    return gray_.at<unsigned char>(static_cast<int>(std::lround(p.y())),
                                   static_cast<int>(std::lround(p.x())));
  }

 private:
  const cv::Mat& gray_;
  Eigen::Matrix3d H_;
  double bit_;
};

}  // namespace

std::optional<bool> ShowsCornerSquares(const cv::Mat& gray,
                                       std::span<const SeenTag> tags,
                                       const TagBorder& border) {
  constexpr double kLeastBit = 2.5;            // px: below, the blur joins what is to be told apart
  constexpr double kHalf = 0.5, kAside = 1.5;  // bits
  constexpr int kFewest = 4;
  constexpr double kMost = 0.75;  // of the corners
  int black = 0, all = 0;
  for (const SeenTag& tag : tags) {
    double shortest = (tag.corners[0] - tag.corners[3]).norm();
    for (std::size_t k = 0; k < 3; ++k) {
      shortest = std::min(shortest, (tag.corners[k + 1] - tag.corners[k]).norm());
    }
    if (shortest < kLeastBit * border.width) continue;
    const CornerView view(gray, tag, border);
    for (std::size_t k = 0; k < 4; ++k) {
      const auto inside = view.At(k, kHalf, kHalf), outside = view.At(k, -kHalf, -kHalf);
      const auto beside = view.At(k, kAside, -kHalf), below = view.At(k, -kHalf, kAside);
      if (!inside || !outside || !beside || !below) continue;
      const double light = (*beside + *below) / 2, step = light - *inside;
      // Both sides of the corner are of the other colour.
      if (step * border.outside_sign <= 0 || std::abs(*beside - *below) > std::abs(step) / 2)
        continue;
      ++all;
      black += std::abs(*outside - *inside) < std::abs(*outside - light);
    }
  }
  if (all < kFewest) return std::nullopt;
  if (black >= kMost * all) return true;
  if (black <= (1 - kMost) * all) return false;
  return std::nullopt;
}

}  // namespace plenocal::internal
