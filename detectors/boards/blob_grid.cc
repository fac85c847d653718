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

constexpr double kOff = 0.35;  // of a step between blobs: farther off its place it is another one

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

/// Blobs by their place on the lattice.
using Places = std::map<std::pair<int, int>, std::size_t>;

/// Adds blobs that complete a parallelogram of three: those at the corners of a grid are in no
/// cross.
void AddCorners(const std::vector<Blob>& blobs, Places* places, std::vector<bool>* done) {
  const Places linked = *places;
  for (const auto& [place, blob] : linked) {
    for (const auto& [dx, dy] : {std::pair(-1, -1), {-1, 1}, {1, -1}, {1, 1}}) {
      const auto beside = linked.find({place.first + dx, place.second}),
                 below = linked.find({place.first, place.second + dy});
      const std::pair corner(place.first + dx, place.second + dy);
      if (beside == linked.end() || below == linked.end() || places->contains(corner)) continue;
      const Eigen::Vector2d u = blobs[beside->second].p - blobs[blob].p,
                            v = blobs[below->second].p - blobs[blob].p;
      for (std::size_t j = 0; j < blobs.size(); ++j) {
        const double off = (blobs[j].p - blobs[blob].p - u - v).norm();
        if ((*done)[j] || off > kOff * std::min(u.norm(), v.norm())) continue;
        (*done)[j] = true;
        places->emplace(corner, j);
        break;
      }
    }
  }
}

/// Places of all blobs that are linked to `seed`, directly or not.
Places NumberFrom(const std::vector<Blob>& blobs,
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
  Places places;
  for (std::size_t k = 0; k < numbered.size(); ++k) {
    const Numbered at = numbered[k];
    places.emplace(std::pair(at.at.x(), at.at.y()), at.blob);
    for (const std::size_t next : links[at.blob]) {
      if ((*done)[next]) continue;
      const Eigen::Vector2d way = at.steps.inverse() * (blobs[next].p - blobs[at.blob].p);
      const Eigen::Vector2i step = way.array().round().cast<int>();
      if (step.cwiseAbs().sum() != 1 || (way - step.cast<double>()).norm() > kOff) continue;
      (*done)[next] = true;
      Numbered entry{next, at.at + step, at.steps};
      const int axis = step.x() != 0 ? 0 : 1;
      entry.steps.col(axis) = (blobs[next].p - blobs[at.blob].p) * step[axis];
      numbered.push_back(entry);
    }
  }
  AddCorners(blobs, &places, done);
  return places;
}

/// Width and height of the bounding box; REQUIRES: a place.
Eigen::Vector2i Extent(const std::vector<Eigen::Vector2i>& places) {
  Eigen::Vector2i low = places.front(), high = low;
  for (const Eigen::Vector2i& place : places) {
    low = low.cwiseMin(place);
    high = high.cwiseMax(place);
  }
  return high - low + Eigen::Vector2i::Ones();
}

std::optional<BlobGrid> ShapeOf(const Places& places) {
  constexpr double kFull = 0.85;
  constexpr int kFewest = 9;
  const auto count = static_cast<double>(places.size());
  if (count < kFewest) return std::nullopt;
  // The nearest circles of an asymmetric grid are those of the next row.
  std::vector<Eigen::Vector2i> straight, turned;
  for (const auto& [place, blob] : places) {
    const auto [x, y] = place;
    straight.emplace_back(x, y);
    turned.emplace_back(x + y, x - y);
  }
  const Eigen::Vector2i square = Extent(straight);
  if (count >= kFull * square.prod()) {
    if (square.minCoeff() < 3) return std::nullopt;
    return BlobGrid{square.maxCoeff(), square.minCoeff(), false};
  }
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
  Places largest;
  for (const bool bright : {false, true}) {
    const std::vector<Blob> blobs = FindManyBlobs(gray, bright);
    const Crosses crosses = FindCrosses(blobs);
    const auto links = LinksOf(crosses);
    std::vector<bool> done(blobs.size());
    for (std::size_t seed = 0; seed < blobs.size(); ++seed) {
      if (done[seed] || crosses[seed].size() < 2) continue;
      Places places = NumberFrom(blobs, crosses, links, seed, &done);
      if (places.size() > largest.size()) largest = std::move(places);
    }
  }
  return largest.empty() ? std::nullopt : ShapeOf(largest);
}

}  // namespace plenocal::internal
