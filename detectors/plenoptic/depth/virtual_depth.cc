// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/virtual_depth.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <utility>

#include "calib/base/parallel.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"
#include "detectors/plenoptic/depth/fill_holes.h"

namespace plenocal::internal {
namespace {

constexpr int kStripRows = 64;
/// Micro images that must agree on a depth in sum of their covers: more than one.
constexpr float kConfirmed = 1;
/// Neighbouring depths of one surface differ by up to this many standard deviations.
constexpr float kSameSurface = 3;

/// One estimate in the virtual image; units are pixels of the map.
struct Hit {
  float x, y, half;  // centre and half the side of the square that the raw pixel covers
  float z, variance, information;
};

/// Sums over the hits that cover one pixel.
struct PixelSums {
  float cover = 0, agreeing = 0, weight = 0, off = 0, square = 0;
};

struct Fused {
  // CV_32F, NaN where nothing is known
  cv::Mat inverse, variance;
  cv::Mat scatter;  // variance among the micro images over the one expected by `variance`, where
                    // there are two or more
  cv::Mat cover;    // number of those micro images
};

/// Calls use(x, y, share) for each map pixel in rows [y0, y1) that the hit covers; share in (0, 1]
/// is how much of it.
template <typename Use>
void ForEachCovered(const Hit& hit, int columns, int y0, int y1, const Use& use) {
  const int left = std::max(0, static_cast<int>(std::ceil(hit.x - hit.half - 0.5f)));
  const int right = std::min(columns - 1, static_cast<int>(std::floor(hit.x + hit.half + 0.5f)));
  const int top = std::max(y0, static_cast<int>(std::ceil(hit.y - hit.half - 0.5f)));
  const int bottom = std::min(y1 - 1, static_cast<int>(std::floor(hit.y + hit.half + 0.5f)));
  const auto overlap = [&](float middle, int at) {
    const auto centre = static_cast<float>(at);
    return std::min(middle + hit.half, centre + 0.5f) - std::max(middle - hit.half, centre - 0.5f);
  };
  for (int y = top; y <= bottom; ++y) {
    const float share_y = overlap(hit.y, y);
    if (share_y <= 0) continue;
    for (int x = left; x <= right; ++x) {
      const float share = share_y * overlap(hit.x, x);
      if (share > 0) use(x, y, share);
    }
  }
}

/// Fuses the hits of one strip of rows: a mean, then once more with robust weights about it.
void FuseStrip(const std::vector<Hit>& hits, int y0, int y1, Fused* fused) {
  constexpr int kPasses = 2;
  const int columns = fused->inverse.cols;
  std::vector<PixelSums> sums(static_cast<size_t>(y1 - y0) * columns);
  std::vector<float> mean(sums.size()), spread(sums.size());
  for (int pass = 0; pass < kPasses; ++pass) {
    std::fill(sums.begin(), sums.end(), PixelSums());
    for (const Hit& hit : hits) {
      ForEachCovered(hit, columns, y0, y1, [&](int x, int y, float share) {
        const size_t at = static_cast<size_t>(y - y0) * columns + x;
        PixelSums& s = sums[at];
        // Sums about a value nearby: the spread is small beside the square of z.
        if (pass == 0 && s.cover == 0) mean[at] = hit.z;
        const float off = hit.z - mean[at];
        float robust = 1;
        if (pass > 0) {
          const float scale = kCauchyWidthSquared<float> * (hit.variance + spread[at]);
          robust = scale / (scale + off * off);
        }
        const float weight = share * robust * hit.information;
        s.cover += share;
        s.agreeing += share * robust;
        s.weight += weight;
        s.off += weight * off;
        s.square += weight * off * off;
      });
    }
    for (size_t i = 0; i < sums.size(); ++i) {
      if (sums[i].weight <= 0) continue;
      const float off = sums[i].off / sums[i].weight;
      mean[i] += off;
      spread[i] = std::max(0.f, sums[i].square / sums[i].weight - off * off);
    }
  }
  for (int y = y0; y < y1; ++y) {
    for (int x = 0; x < columns; ++x) {
      const size_t at = static_cast<size_t>(y - y0) * columns + x;
      const PixelSums& s = sums[at];
      // Unknown where no second micro image confirms the depth or most contradict it.
      if (s.agreeing <= kConfirmed || s.agreeing < s.cover / 2) continue;
      fused->inverse.at<float>(y, x) = mean[at];
      // The N micro images that see a point share their pixels. With white noise in each the
      // optimum over all of them has the mean information of the N estimates, and their variance
      // about it is (N - 1) / 4 times its.
      fused->variance.at<float>(y, x) = s.cover / s.weight;
      if (s.cover >= 2) {
        fused->scatter.at<float>(y, x) = 4 * spread[at] * s.weight / (s.cover * (s.cover - 1));
        fused->cover.at<float>(y, x) = s.cover;
      }
    }
  }
}

/// Map rows that the estimates of one micro image cover.
struct Rows {
  float first = std::numeric_limits<float>::infinity();
  float last = -std::numeric_limits<float>::infinity();
};

Fused Fuse(std::vector<LensDepth> depths, const MicroLensArray& array, double scale, int threads) {
  const int columns = static_cast<int>(std::lround(std::ceil(array.image_size[0] / scale)));
  const int rows = static_cast<int>(std::lround(std::ceil(array.image_size[1] / scale)));
  const auto to_map = static_cast<float>(1 / scale);
  const auto hit_of = [&](const Eigen::Vector2d& centre, const PixelDepth& p) {
    return Hit{(static_cast<float>(centre.x()) + p.x / p.z) * to_map,
               (static_cast<float>(centre.y()) + p.y / p.z) * to_map,
               std::abs(to_map / p.z) / 2,
               p.z,
               p.variance,
               1 / p.variance};
  };
  // A strip skips the micro images that do not reach it.
  std::vector<Rows> reach(depths.size());
  for (size_t lens = 0; lens < depths.size(); ++lens) {
    for (const PixelDepth& p : depths[lens]) {
      const Hit hit = hit_of(array.lenses[lens].centre, p);
      reach[lens].first = std::min(reach[lens].first, hit.y - hit.half - 0.5f);
      reach[lens].last = std::max(reach[lens].last, hit.y + hit.half + 0.5f);
    }
  }
  Fused fused;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  fused.inverse = cv::Mat(rows, columns, CV_32F, cv::Scalar(nan));
  fused.variance = fused.inverse.clone();
  fused.scatter = fused.inverse.clone();
  fused.cover = fused.inverse.clone();
  ParallelFor((rows + kStripRows - 1) / kStripRows, threads, [&](size_t strip) {
    const int y0 = static_cast<int>(strip) * kStripRows, y1 = std::min(rows, y0 + kStripRows);
    const auto top = static_cast<float>(y0), bottom = static_cast<float>(y1 - 1);
    std::vector<Hit> hits;
    for (size_t lens = 0; lens < depths.size(); ++lens) {
      if (reach[lens].last < top || reach[lens].first > bottom) continue;
      for (const PixelDepth& p : depths[lens]) {
        const Hit hit = hit_of(array.lenses[lens].centre, p);
        if (hit.y + hit.half + 0.5f < top || hit.y - hit.half - 0.5f > bottom) continue;
        hits.push_back(hit);
      }
    }
    FuseStrip(hits, y0, y1, &fused);
  });
  return fused;
}

/// Removes surfaces too small to be real: an estimate is the mean over a window of raw pixels, so a
/// group of neighbours that agree, but cover less than the window does in the virtual image, is a
/// chance match.
void RemoveSpeckles(double scale, Fused* fused) {
  const int rows = fused->inverse.rows, columns = fused->inverse.cols;
  const auto* z = fused->inverse.ptr<float>();
  const auto* variance = fused->variance.ptr<float>();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::vector<char> seen(fused->inverse.total(), 0);
  std::vector<int> group;
  for (int start = 0; start < rows * columns; ++start) {
    if (seen[start] != 0 || std::isnan(z[start])) continue;
    group.assign(1, start);
    seen[start] = 1;
    for (size_t k = 0; k < group.size(); ++k) {
      const int at = group[k], x = at % columns, y = at / columns;
      const auto visit = [&](int next) {
        if (seen[next] != 0 || std::isnan(z[next])) return;
        const float off = z[next] - z[at];
        if (off * off > kSameSurface * kSameSurface * (variance[next] + variance[at])) return;
        seen[next] = 1;
        group.push_back(next);
      };
      if (x > 0) visit(at - 1);
      if (x + 1 < columns) visit(at + 1);
      if (y > 0) visit(at - columns);
      if (y + 1 < rows) visit(at + columns);
    }
    const double side = kDepthWindow / std::abs(z[start]) / scale;
    if (static_cast<double>(group.size()) >= side * side) continue;
    for (const int at : group) {
      fused->inverse.ptr<float>()[at] = nan;
      fused->variance.ptr<float>()[at] = nan;
    }
  }
}

/// Median of the known values; `fallback` when there is none.
float MedianOfKnown(const cv::Mat& values, float fallback) {
  std::vector<float> known;
  for (int y = 0; y < values.rows; ++y) {
    for (int x = 0; x < values.cols; ++x) {
      if (!std::isnan(values.at<float>(y, x))) known.push_back(values.at<float>(y, x));
    }
  }
  return Median(std::move(known), fallback);
}

/// Ratio of the true variances to those of the single estimates, from the scatter between micro
/// images: the errors that neighbouring estimates share, through a window or blur, are in none of
/// the single variances.
float VarianceFactor(const Fused& fused) {
  const float freedom = MedianOfKnown(fused.cover, 2) - 1;
  // Median of chi-square over its mean (Wilson and Hilferty).
  const float median = std::pow(1 - 2 / (9 * freedom), 3.f);
  return MedianOfKnown(fused.scatter, median) / median;
}

}  // namespace

std::vector<float> KnownInverse(const VirtualDepth& depth) {
  std::vector<float> known;
  for (int y = 0; y < depth.inverse.rows; ++y) {
    for (int x = 0; x < depth.inverse.cols; ++x) {
      if (depth.known.at<uchar>(y, x) != 0) known.push_back(depth.inverse.at<float>(y, x));
    }
  }
  return known;
}

VirtualDepth FuseDepth(std::vector<LensDepth> depths,
                       const MicroLensArray& array,
                       float radius_px,
                       double scale,
                       int threads) {
  Fused fused = Fuse(std::move(depths), array, scale, threads);
  fused.variance *= VarianceFactor(fused);
  fused.scatter.release();
  fused.cover.release();
  RemoveSpeckles(scale, &fused);
  const Filled filled = FillHoles(fused.inverse, fused.variance);
  VirtualDepth depth;
  depth.scale = scale;
  depth.inverse = filled.value;
  cv::sqrt(filled.variance, depth.sigma);
  // A micro image of radius r reaches r / z in the virtual image.
  depth.known = filled.reach.mul(cv::abs(filled.value)) * scale <= radius_px;
  return depth;
}

}  // namespace plenocal::internal
