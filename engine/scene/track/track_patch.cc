// SPDX-License-Identifier: Apache-2.0
#include "engine/scene/track/track_patch.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cmath>

namespace plenocal {
namespace {

constexpr int kPatchSide = 2 * kPatchRadius + 1;
constexpr int kPatchPixels = kPatchSide * kPatchSide;
// Translation 0 and 1, affine 2 to 5, perspective 6 and 7, gain, offset.
constexpr int kGain = 8, kOffset = 9, kPatchUnknowns = 10;
constexpr float kFarthest = 2;       // px
constexpr double kLeastAlike = 0.8;  // correlation
constexpr float kMostStretch = 2;    // of the patch, in any direction, at any of its pixels
using PatchVector = Eigen::Matrix<float, kPatchUnknowns, 1>;
using PatchMatrix = Eigen::Matrix<float, kPatchUnknowns, kPatchUnknowns>;
using PatchRows = Eigen::Matrix<float, kPatchPixels, 1>;

// Bilinear value of an 8-bit image. REQUIRES: within it by a pixel.
float ValueAt(const cv::Mat& image, float x, float y) {
  const int i = static_cast<int>(x), j = static_cast<int>(y);
  const float fx = x - static_cast<float>(i), fy = y - static_cast<float>(j);
  const unsigned char* const upper = image.ptr(j) + i;
  const unsigned char* const lower = image.ptr(j + 1) + i;
  const auto mix = [&](const unsigned char* row) {
    return (1 - fx) * static_cast<float>(row[0]) + fx * static_cast<float>(row[1]);
  };
  return (1 - fy) * mix(upper) + fy * mix(lower);
}

bool IsInside(const cv::Mat& image, const cv::Point2f& p, float margin) {
  return p.x >= margin && p.y >= margin && p.x < static_cast<float>(image.cols - 1) - margin &&
         p.y < static_cast<float>(image.rows - 1) - margin;
}

// The patch in the key image: values and derivatives.
struct KeyPatch {
  PatchRows value, by_x, by_y;
  Eigen::Matrix<float, kPatchPixels, 2> away;
};

KeyPatch ReadKeyPatch(const cv::Mat& key, const cv::Point2f& at) {
  KeyPatch patch;
  int row = 0;
  for (int y = -kPatchRadius; y <= kPatchRadius; ++y) {
    for (int x = -kPatchRadius; x <= kPatchRadius; ++x, ++row) {
      const float u = at.x + static_cast<float>(x), v = at.y + static_cast<float>(y);
      patch.value[row] = ValueAt(key, u, v);
      patch.by_x[row] = (ValueAt(key, u + 1, v) - ValueAt(key, u - 1, v)) / 2;
      patch.by_y[row] = (ValueAt(key, u, v + 1) - ValueAt(key, u, v - 1)) / 2;
      patch.away.row(row) << static_cast<float>(x), static_cast<float>(y);
    }
  }
  return patch;
}

class PatchFitter {
 public:
  PatchFitter(const cv::Mat& key, const cv::Point2f& in_key, const cv::Mat& image)
      : patch_(ReadKeyPatch(key, in_key)), image_(image) {
    jacobian_.col(0) = patch_.by_x;
    jacobian_.col(1) = patch_.by_y;
    jacobian_.col(2) = patch_.by_x.cwiseProduct(patch_.away.col(0));
    jacobian_.col(3) = patch_.by_x.cwiseProduct(patch_.away.col(1));
    jacobian_.col(4) = patch_.by_y.cwiseProduct(patch_.away.col(0));
    jacobian_.col(5) = patch_.by_y.cwiseProduct(patch_.away.col(1));
    const PatchRows along = jacobian_.col(2) + jacobian_.col(5);
    jacobian_.col(6) = -along.cwiseProduct(patch_.away.col(0));
    jacobian_.col(7) = -along.cwiseProduct(patch_.away.col(1));
    jacobian_.col(kGain) = patch_.value;
    jacobian_.col(kOffset).setOnes();
    normal_ = jacobian_.transpose() * jacobian_;
  }

  std::optional<PatchPlace> Fit(const PatchPlace& start) {
    constexpr int kIterations = 20;
    constexpr float kConverged = 2e-3F;  // px
    const Eigen::LDLT<PatchMatrix> factor(normal_);
    PatchPlace place = start;
    for (int iteration = 0; iteration < kIterations; ++iteration) {
      PatchRows seen;
      if (!Read(place, &seen)) return std::nullopt;
      // seen = gain (T + grad T . (t + B d - d h . d)) + offset: linear in gain, gain t, B and h.
      const PatchVector solution = factor.solve(jacobian_.transpose() * seen);
      const float gain = solution[kGain];
      if (!solution.allFinite() || !(gain > 0)) return std::nullopt;
      const PatchVector by = solution / gain;
      const cv::Matx33f change(1 + by[2], by[3], by[0], by[4], 1 + by[5], by[1], by[6], by[7], 1);
      if (!(std::abs(cv::determinant(change)) > 1 / kMostStretch)) return std::nullopt;
      const cv::Point2f before = place.point;
      if (!Compose(change.inv(), &place)) return std::nullopt;
      if (cv::norm(place.point - start.point) > kFarthest || !IsUsual(place)) {
        return std::nullopt;
      }
      if (cv::norm(place.point - before) > kConverged) continue;
      return Judge(place, solution, seen);
    }
    return std::nullopt;
  }

 private:
  // The place of a patch that `change` has displaced in the key image; false at infinity.
  static bool Compose(const cv::Matx33f& change, PatchPlace* place) {
    const cv::Vec2f h = place->perspective;
    const cv::Matx33f old(
        place->A(0, 0), place->A(0, 1), 0, place->A(1, 0), place->A(1, 1), 0, h[0], h[1], 1);
    const cv::Matx33f H = old * change;
    if (!(H(2, 2) > 1 / kMostStretch)) return false;
    const cv::Vec2f step(H(0, 2) / H(2, 2), H(1, 2) / H(2, 2));
    place->point += cv::Point2f(step[0], step[1]);
    place->perspective = {H(2, 0) / H(2, 2), H(2, 1) / H(2, 2)};
    place->A = H.get_minor<2, 2>(0, 0) * (1 / H(2, 2)) - step * place->perspective.t();
    return true;
  }

  // Least of 1 + perspective . d in the patch.
  static float LeastDepth(const PatchPlace& place) {
    return 1 - static_cast<float>(kPatchRadius) *
                   (std::abs(place.perspective[0]) + std::abs(place.perspective[1]));
  }

  static bool IsUsual(const PatchPlace& place) {
    const double area = std::abs(cv::determinant(place.A));
    return area > 1 / kMostStretch && area < kMostStretch && cv::norm(place.A) < 2 * kMostStretch &&
           LeastDepth(place) > 1 / kMostStretch;
  }

  bool Read(const PatchPlace& place, PatchRows* seen) const {
    const float reach = static_cast<float>(kPatchRadius) *
                        std::max(std::abs(place.A(0, 0)) + std::abs(place.A(0, 1)),
                                 std::abs(place.A(1, 0)) + std::abs(place.A(1, 1))) /
                        LeastDepth(place);
    if (!IsInside(image_, place.point, reach + 1)) return false;
    for (int row = 0; row < kPatchPixels; ++row) {
      const float x = patch_.away(row, 0), y = patch_.away(row, 1);
      const float depth = 1 + place.perspective[0] * x + place.perspective[1] * y;
      (*seen)[row] = ValueAt(image_,
                             place.point.x + (place.A(0, 0) * x + place.A(0, 1) * y) / depth,
                             place.point.y + (place.A(1, 0) * x + place.A(1, 1) * y) / depth);
    }
    return true;
  }

  std::optional<PatchPlace> Judge(PatchPlace place,
                                  const PatchVector& solution,
                                  const PatchRows& seen) const {
    const double chi2 = (seen - jacobian_ * solution).squaredNorm();
    const double variance = (seen.array() - seen.mean()).matrix().squaredNorm();
    if (!(chi2 < (1 - kLeastAlike * kLeastAlike) * variance)) return std::nullopt;
    const Eigen::Matrix<double, kPatchUnknowns, kPatchUnknowns> covariance =
        (normal_.cast<double>() * (solution[kGain] * solution[kGain])).inverse();
    place.sigma = std::sqrt(covariance.topLeftCorner<2, 2>().trace() / 2 * chi2 /
                            (kPatchPixels - kPatchUnknowns));
    if (!(place.sigma <= kFarthest)) return std::nullopt;
    return place;
  }

  KeyPatch patch_;
  const cv::Mat& image_;
  Eigen::Matrix<float, kPatchPixels, kPatchUnknowns> jacobian_;
  PatchMatrix normal_;
};

}  // namespace

std::optional<PatchPlace> FitPatch(const cv::Mat& key,
                                   const cv::Point2f& in_key,
                                   const cv::Mat& image,
                                   const PatchPlace& start) {
  if (!IsInside(key, in_key, kPatchRadius + 2)) return std::nullopt;
  return PatchFitter(key, in_key, image).Fit(start);
}

}  // namespace plenocal
