// SPDX-License-Identifier: Apache-2.0
#include "detectors/boards/blob_grid.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <set>
#include <utility>
#include <vector>

namespace plenocal::internal {
namespace {

struct Blob {
  Eigen::Vector2d p;  ///< px
  double size = 0;    ///< px, diameter
};

std::vector<Blob> FindManyBlobs(const cv::Mat& gray, bool bright) {
  constexpr std::size_t kMost = 2000;  // texture
  constexpr float kFewestInImage = 9;
  const std::vector<cv::KeyPoint> points =
      FindBlobs(gray, bright, static_cast<float>(gray.total()) / kFewestInImage);
  if (points.size() > kMost) return {};
  std::vector<Blob> blobs;
  for (const cv::KeyPoint& point : points) {
    blobs.push_back({{point.pt.x, point.pt.y}, point.size});
  }
  return blobs;
}

/// A blob between two others that are as large and evenly spaced.
struct Between {
  std::size_t before = 0, after = 0;
};

/// Of each blob the two shortest rows of three that it is in the middle of, if they cross.
using Crosses = std::vector<std::vector<Between>>;

std::vector<std::size_t> Nearest(const std::vector<Blob>& blobs, std::size_t i) {
  constexpr std::size_t kNearest = 10;
  constexpr double kLeastRatio = 0.6;  // of sizes: a grid is tilted, too
  std::vector<std::pair<double, std::size_t>> near;
  for (std::size_t j = 0; j < blobs.size(); ++j) {
    const double a = blobs[i].size, b = blobs[j].size;
    if (j == i || std::min(a, b) < kLeastRatio * std::max(a, b)) continue;
    near.emplace_back((blobs[j].p - blobs[i].p).norm(), j);
  }
  std::sort(near.begin(), near.end());
  near.resize(std::min(near.size(), kNearest));
  std::vector<std::size_t> indices;
  for (const auto& [distance, j] : near) indices.push_back(j);
  return indices;
}

Crosses FindCrosses(const std::vector<Blob>& blobs) {
  constexpr double kEven = 0.12;      // of the row's length
  constexpr double kLeastSine = 0.4;  // of the angle between the rows
  constexpr double kLongest = 1.9;    // the longer row / the shorter: the grid may be tilted
  Crosses crosses(blobs.size());
  for (std::size_t i = 0; i < blobs.size(); ++i) {
    const std::vector<std::size_t> near = Nearest(blobs, i);
    std::vector<std::pair<double, Between>> rows;
    for (std::size_t k = 0; k < near.size(); ++k) {
      for (std::size_t l = 0; l < k; ++l) {
        const Eigen::Vector2d &a = blobs[near[l]].p, &b = blobs[near[k]].p;
        const double length = (b - a).norm();
        if ((a + b - 2 * blobs[i].p).norm() > kEven * length) continue;
        rows.emplace_back(length, Between{near[l], near[k]});
      }
    }
    std::sort(
        rows.begin(), rows.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    for (std::size_t k = 1; k < rows.size() && rows[k].first < kLongest * rows[0].first; ++k) {
      const auto along = [&](const Between& row) -> Eigen::Vector2d {
        return (blobs[row.after].p - blobs[row.before].p).normalized();
      };
      const Eigen::Vector2d u = along(rows[0].second), v = along(rows[k].second);
      if (std::abs(u.x() * v.y() - u.y() * v.x()) < kLeastSine) continue;
      crosses[i] = {rows[0].second, rows[k].second};
      break;
    }
  }
  return crosses;
}

/// Links in both directions, of all crosses.
std::vector<std::set<std::size_t>> LinksOf(const Crosses& crosses) {
  std::vector<std::set<std::size_t>> links(crosses.size());
  for (std::size_t i = 0; i < crosses.size(); ++i) {
    for (const Between& row : crosses[i]) {
      for (const std::size_t j : {row.before, row.after}) {
        links[i].insert(j);
        links[j].insert(i);
      }
    }
  }
  return links;
}

using Place = std::pair<int, int>;

/// Places on the lattice of all blobs that are linked to `seed`, directly or not.
std::set<Place> NumberFrom(const std::vector<Blob>& blobs,
                           const Crosses& crosses,
                           const std::vector<std::set<std::size_t>>& links,
                           std::size_t seed,
                           std::vector<bool>* done) {
  struct Numbered {
    std::size_t blob;
    Eigen::Vector2i at;
    Eigen::Matrix2d steps;  ///< px, along both rows
  };
  const auto half = [&](const Between& row) -> Eigen::Vector2d {
    return (blobs[row.after].p - blobs[row.before].p) / 2;
  };
  Numbered first{seed, Eigen::Vector2i::Zero(), Eigen::Matrix2d::Zero()};
  first.steps << half(crosses[seed][0]), half(crosses[seed][1]);
  std::vector<Numbered> numbered{first};
  (*done)[seed] = true;
  std::set<Place> places;
  for (std::size_t k = 0; k < numbered.size(); ++k) {
    const Numbered at = numbered[k];
    places.insert({at.at.x(), at.at.y()});
    for (const std::size_t next : links[at.blob]) {
      if ((*done)[next]) continue;
      const Eigen::Vector2d way = at.steps.inverse() * (blobs[next].p - blobs[at.blob].p);
      const Eigen::Vector2i step = way.array().round().cast<int>();
      constexpr double kOff = 0.35;  // steps
      if (step.cwiseAbs().sum() != 1 || (way - step.cast<double>()).norm() > kOff) continue;
      (*done)[next] = true;
      Numbered entry{next, at.at + step, at.steps};
      const int axis = step.x() != 0 ? 0 : 1;
      entry.steps.col(axis) = (blobs[next].p - blobs[at.blob].p) * step[axis];
      numbered.push_back(entry);
    }
  }
  return places;
}

/// Width and height of the places' bounding box.
Eigen::Vector2i Extent(const std::set<Place>& places) {
  Eigen::Vector2i low(places.begin()->first, places.begin()->second), high = low;
  for (const auto& [x, y] : places) {
    low = low.cwiseMin(Eigen::Vector2i(x, y));
    high = high.cwiseMax(Eigen::Vector2i(x, y));
  }
  return high - low + Eigen::Vector2i::Ones();
}

std::optional<BlobGrid> ShapeOf(const std::set<Place>& places) {
  constexpr double kFull = 0.85;
  constexpr int kFewest = 9;
  const auto count = static_cast<double>(places.size());
  if (count < kFewest) return std::nullopt;
  const Eigen::Vector2i square = Extent(places);
  if (count >= kFull * square.prod()) {
    if (square.minCoeff() < 3) return std::nullopt;
    return BlobGrid{square.maxCoeff(), square.minCoeff(), false};
  }
  // The nearest circles of an asymmetric grid are those of the next row.
  std::set<Place> turned;
  for (const auto& [x, y] : places) turned.insert({x + y, x - y});
  const Eigen::Vector2i size = Extent(turned);
  if (2 * count < kFull * size.prod() || size.minCoeff() < 3) return std::nullopt;
  int twice_columns = size.minCoeff(), rows = size.maxCoeff();
  if (twice_columns % 2 != 0) std::swap(twice_columns, rows);
  if (twice_columns % 2 != 0) return std::nullopt;  // seen in part
  return BlobGrid{twice_columns / 2, rows, true};
}

}  // namespace

std::vector<cv::KeyPoint> FindBlobs(const cv::Mat& gray, bool bright, float most_area) {
  cv::SimpleBlobDetector::Params params;
  params.filterByColor = true;
  params.blobColor = bright ? 255 : 0;
  params.minArea = 12;
  if (most_area < params.minArea) return {};
  params.maxArea = most_area;
  params.minDistBetweenBlobs = 3;  // px
  std::vector<cv::KeyPoint> points;
  cv::SimpleBlobDetector::create(params)->detect(gray, points);
  return points;
}

std::optional<BlobGrid> FindBlobGrid(const cv::Mat& gray) {
  std::set<Place> largest;
  for (const bool bright : {false, true}) {
    const std::vector<Blob> blobs = FindManyBlobs(gray, bright);
    const Crosses crosses = FindCrosses(blobs);
    const auto links = LinksOf(crosses);
    std::vector<bool> done(blobs.size());
    for (std::size_t seed = 0; seed < blobs.size(); ++seed) {
      if (done[seed] || crosses[seed].size() < 2) continue;
      std::set<Place> places = NumberFrom(blobs, crosses, links, seed, &done);
      if (places.size() > largest.size()) largest = std::move(places);
    }
  }
  return largest.empty() ? std::nullopt : ShapeOf(largest);
}

}  // namespace plenocal::internal
