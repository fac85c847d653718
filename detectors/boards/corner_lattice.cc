// SPDX-License-Identifier: Apache-2.0
#include "detectors/boards/corner_lattice.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>

#include "calib/kernels/processors.h"
#include "detectors/templates/lanes.h"

// At each scale of a pyramid:
//
//   crossings   places where two edges cross
//   links       crossings that are next to each other on a line of a board: of opposite contrast,
//               joined by an edge, and in threes on a line, evenly spaced
//   lattices    crossings numbered along the links
//
// Noise and texture have crossings too, but few of them are linked. Measured against OpenCV's
// finders, which take 10 to 200 s a megapixel of noise: this takes 25 to 75 ms a megapixel of
// anything, and also finds boards with squares of 6 px, with corners hidden, and tilted by 80
// degrees.

namespace plenocal::internal {
namespace {

/// A place where the image looks like two crossing edges.
struct Crossing {
  Eigen::Vector2d p;  ///< px of the scale
  /// Gray levels: in direction t, as far as we look, the image is about
  ///   mean + quadrupole * (cos 2t, sin 2t).
  Eigen::Vector2d quadrupole;

  /// Of an edge in this direction: positive when it is brighter on its right (from x to y), that is
  /// 45 degrees on.
  [[nodiscard]] double Contrast(const Eigen::Vector2d& direction) const {
    const double t = 2 * (std::atan2(direction.y(), direction.x()) + M_PI / 4);
    return quadrupole.dot(Eigen::Vector2d(std::cos(t), std::sin(t)));
  }
};

constexpr int kRadius = 3;  // px; at one of the scales squares are 4 to 8 px wide
constexpr int kSide = 2 * kRadius + 1;

/// The pattern of crossing edges that the pixels around a place are compared with.
class Pattern {
 public:
  Pattern() {
    for (int row = 0; row < kSide; ++row) {
      for (int column = 0; column < kSide; ++column) {
        const int x = column - kRadius, y = row - kRadius;
        if (x * x + y * y > kRadius * kRadius) continue;
        // Of the weights r^n the one that suits sharp edges (n = 0) and blurred ones (n = 2).
        const double r = std::max(std::hypot(x, y), 1.0);
        rows_[row].used[column] = 1;
        rows_[row].cos[column] = static_cast<float>((x * x - y * y) / r);
        rows_[row].sin[column] = static_cast<float>(2 * x * y / r);
        count_ += 1;
        squares_ += rows_[row].cos[column] * rows_[row].cos[column];
      }
    }
  }

  /// Nothing where the pattern explains too little of the pixels around (x, y).
  PLENOCAL_LANES std::optional<Eigen::Vector2d> Quadrupole(const cv::Mat& image,
                                                           int x,
                                                           int y) const {
    // Edges that cross at 90 degrees give 0.7 when sharp and 0.95 when blurred, at 50 degrees 0.5;
    // of patches of 29 pixels of noise one in 10,000 does.
    constexpr float kMinExplained = 0.5;
    const float middle = image.at<float>(y, x);
    Lanes sums{}, squares{}, by_cos{}, by_sin{};
    for (int row = 0; row < kSide; ++row) {
      Lanes gray;
      std::memcpy(&gray, image.ptr<float>(y - kRadius + row) + x - kRadius, sizeof gray);
      gray = rows_[row].used * (gray - middle);
      sums += gray;
      squares += gray * gray;
      by_cos += rows_[row].cos * gray;
      by_sin += rows_[row].sin * gray;
    }
    const float sum = Sum(sums), cos = Sum(by_cos), sin = Sum(by_sin);
    const float variation = Sum(squares) - sum * sum / count_;
    const float explained = (cos * cos + sin * sin) / squares_;
    if (!(explained > kMinExplained * variation)) return std::nullopt;
    return Eigen::Vector2d(cos, sin) / (squares_ / kRadius);
  }

 private:
  struct Row {
    Lanes used, cos, sin;  // 1 and the pattern within the radius, else 0
  };
  std::array<Row, kSide> rows_{};
  float count_ = 0, squares_ = 0;
};

/// Adds the crossings at the peaks of `saddle` in these rows. `highest`: of the pixels around.
PLENOCAL_FOR_EACH_PROCESSOR
void AddCrossingsAtPeaks(const Pattern& pattern,
                         const cv::Mat& image,
                         const cv::Mat& saddle,
                         const cv::Mat& highest,
                         const cv::Range& rows,
                         std::vector<Crossing>* crossings) {
  std::vector<int> peaks(image.cols);
  for (int y = rows.start; y < rows.end; ++y) {
    const auto *values = saddle.ptr<float>(y), *limits = highest.ptr<float>(y);
    // Collected first and without a branch, which one in ten pixels would take. Eight pixels of
    // each row are read around a peak.
    int count = 0;
    for (int x = kRadius; x + kLanes - kRadius <= image.cols; ++x) {
      peaks[count] = x;
      count += ((values[x] > 0) & (values[x] >= limits[x])) ? 1 : 0;
    }
    for (int i = 0; i < count; ++i) {
      if (const auto quadrupole = pattern.Quadrupole(image, peaks[i], y)) {
        crossings->push_back({Eigen::Vector2d(peaks[i], y), *quadrupole});
      }
    }
  }
}

/// In the order of their rows. In bands of rows, whose images stay in the processor's cache.
std::vector<Crossing> FindCrossings(const cv::Mat& gray) {
  constexpr int kBand = 32, kAround = 4;  // rows; those that the filters need beyond a band
  static_assert(kAround > kRadius);
  const Pattern pattern;
  std::vector<Crossing> crossings;
  cv::Mat image, smooth, xx, xy, yy, highest;
  for (int first = kRadius; first < gray.rows - kRadius; first += kBand) {
    const int last = std::min(first + kBand, gray.rows - kRadius);
    const int from = std::max(0, first - kAround), to = std::min(gray.rows, last + kAround);
    gray.rowRange(from, to).convertTo(image, CV_32F);
    cv::GaussianBlur(image, smooth, {5, 5}, 1);
    cv::Sobel(smooth, xx, CV_32F, 2, 0);
    cv::Sobel(smooth, xy, CV_32F, 1, 1);
    cv::Sobel(smooth, yy, CV_32F, 0, 2);
    cv::Mat& saddle = xy;  // xy^2 - xx yy, without further images
    cv::multiply(xy, xy, xy);
    cv::multiply(xx, yy, xx);
    cv::subtract(xy, xx, saddle);
    cv::dilate(saddle, highest, {});
    const size_t before = crossings.size();
    AddCrossingsAtPeaks(pattern, image, saddle, highest, {first - from, last - from}, &crossings);
    for (size_t i = before; i < crossings.size(); ++i) crossings[i].p.y() += from;
  }
  return crossings;
}

/// The crossings next to each, by index.
using Links = std::vector<std::vector<std::size_t>>;

class Linker {
 public:
  Linker(const cv::Mat& image, const std::vector<Crossing>& crossings)
      : image_(image), crossings_(crossings) {}

  [[nodiscard]] Links Find() const {
    Links links(crossings_.size());
    const auto link = [&links](std::size_t i, std::size_t j) {
      if (std::find(links[i].begin(), links[i].end(), j) != links[i].end()) return;
      links[i].push_back(j);
      links[j].push_back(i);
    };
    for (std::size_t i = 0; i < crossings_.size(); ++i) {
      const std::vector<std::size_t> next = Joined(i);
      for (std::size_t k = 0; k < next.size(); ++k) {
        for (std::size_t l = 0; l < k; ++l) {
          if (!EvenlySpaced(next[k], i, next[l])) continue;
          link(i, next[k]);
          link(i, next[l]);
        }
      }
    }
    return links;
  }

 private:
  [[nodiscard]] const Eigen::Vector2d& P(std::size_t i) const { return crossings_[i].p; }

  /// Of the nearest few of like contrast, those that may be the next corner.
  [[nodiscard]] std::vector<std::size_t> Joined(std::size_t i) const {
    // More would hold some that are a knight's move away; and where squares look three times as
    // long as wide these hold the next in each direction.
    constexpr std::size_t kNearest = 12;
    std::vector<std::pair<double, std::size_t>> nearest;  // a heap, the farthest on top
    // False when j and all beyond are too far.
    const auto look_at = [&](std::size_t j) {
      const double dy = P(j).y() - P(i).y();
      const bool full = nearest.size() == kNearest;
      if (full && dy * dy >= nearest.front().first) return false;
      const double squared_distance = (P(j) - P(i)).squaredNorm();
      if ((full && squared_distance >= nearest.front().first) || !Alike(i, j)) return true;
      if (full) {
        std::pop_heap(nearest.begin(), nearest.end());
        nearest.pop_back();
      }
      nearest.emplace_back(squared_distance, j);
      std::push_heap(nearest.begin(), nearest.end());
      return true;
    };
    for (std::size_t j = i; j > 0 && look_at(j - 1); --j) {
    }
    for (std::size_t j = i + 1; j < crossings_.size() && look_at(j); ++j) {
    }
    std::vector<std::size_t> joined;
    for (const auto& [squared_distance, j] : nearest) {
      if (Opposite(i, j) && EdgeBetween(i, j)) joined.push_back(j);
    }
    return joined;
  }

  /// In uneven light the contrast changes along a board; noise and shading differ more from it.
  [[nodiscard]] bool Alike(std::size_t i, std::size_t j) const {
    constexpr double kMinRatio = 0.4;
    const double a = crossings_[i].quadrupole.norm(), b = crossings_[j].quadrupole.norm();
    return std::min(a, b) > kMinRatio * std::max(a, b);
  }

  /// The next corner has the same edges with black and white exchanged.
  [[nodiscard]] bool Opposite(std::size_t i, std::size_t j) const {
    constexpr double kMinCosine = 0.8;  // of twice the angle between them: 18 degrees
    const Eigen::Vector2d &a = crossings_[i].quadrupole, &b = crossings_[j].quadrupole;
    return -a.dot(b) > kMinCosine * a.norm() * b.norm();
  }

  /// All along the line from i to j the gray value changes as it does at i.
  [[nodiscard]] bool EdgeBetween(std::size_t i, std::size_t j) const {
    constexpr double kAside = 1.5;  // px: beyond the edge's blur, within the squares
    constexpr double kMinContrast = 0.4;
    const Eigen::Vector2d along = P(j) - P(i);
    const Eigen::Vector2d aside = kAside * Eigen::Vector2d(-along.y(), along.x()).normalized();
    const double sign = crossings_[i].Contrast(along) > 0 ? 1 : -1;
    const double least = kMinContrast * crossings_[i].quadrupole.norm();
    for (const double share : {0.25, 0.5, 0.75}) {
      const Eigen::Vector2d middle = P(i) + share * along;
      if (sign * 0.5 * (Gray(middle + aside) - Gray(middle - aside)) < least) return false;
    }
    return true;
  }

  [[nodiscard]] double Gray(const Eigen::Vector2d& p) const {
    const auto x = static_cast<int>(std::lround(p.x())), y = static_cast<int>(std::lround(p.y()));
    return image_.at<std::uint8_t>(std::clamp(y, 0, image_.rows - 1),
                                   std::clamp(x, 0, image_.cols - 1));
  }

  /// i is in the middle, but for perspective and distortion, which may make a square half as large
  /// again as the next.
  [[nodiscard]] bool EvenlySpaced(std::size_t before, std::size_t i, std::size_t after) const {
    constexpr double kTolerance = 0.2;
    return (P(before) + P(after) - 2 * P(i)).norm() < kTolerance * (P(after) - P(before)).norm();
  }

  const cv::Mat& image_;
  const std::vector<Crossing>& crossings_;
};

/// A crossing with its place on a board.
struct Numbered {
  std::size_t crossing = 0;
  Eigen::Vector2i at;     ///< column, row
  Eigen::Matrix2d steps;  ///< px, to the next column and to the next row
};

/// Numbers all crossings that are linked to `seed`, directly or not, and marks them in `done`.
/// Nothing when `seed` has links along one line only.
std::vector<Numbered> Number(const std::vector<Crossing>& crossings,
                             const Links& links,
                             std::size_t seed,
                             std::vector<bool>* done) {
  // The edges along the columns are brighter on their right at every other corner, where those
  // along the rows are darker, whatever perspective and distortion do to the directions.
  const auto axis_of = [&](const Numbered& corner, const Eigen::Vector2d& step) {
    const bool even = corner.at.sum() % 2 == 0;
    return (crossings[corner.crossing].Contrast(step) > 0) == even ? 0 : 1;
  };
  const auto step_to = [&](const Numbered& corner, std::size_t next) {
    return Eigen::Vector2d(crossings[next].p - crossings[corner.crossing].p);
  };
  Numbered first{seed, Eigen::Vector2i::Zero(), Eigen::Matrix2d::Zero()};
  for (const std::size_t next : links[seed]) {
    const Eigen::Vector2d step = step_to(first, next);
    first.steps.col(axis_of(first, step)) = step;
  }
  if (first.steps.col(0).isZero() || first.steps.col(1).isZero()) return {};
  (*done)[seed] = true;
  std::vector<Numbered> numbered{first};
  for (std::size_t k = 0; k < numbered.size(); ++k) {
    // From corner to corner the steps change little; each brings them up to date.
    Numbered corner = numbered[k];
    std::vector<std::pair<std::size_t, Eigen::Vector2i>> neighbours;
    for (const std::size_t next : links[corner.crossing]) {
      const Eigen::Vector2d step = step_to(corner, next);
      const int axis = axis_of(corner, step);
      const int sign = step.dot(corner.steps.col(axis)) > 0 ? 1 : -1;
      corner.steps.col(axis) = sign * step;
      neighbours.emplace_back(next, corner.at + sign * Eigen::Vector2i::Unit(axis));
    }
    for (const auto& [next, at] : neighbours) {
      if ((*done)[next]) continue;
      (*done)[next] = true;
      numbered.push_back({next, at, corner.steps});
    }
  }
  return numbered;
}

/// Takes border lines of which less than half is there away. The rest begins at (0, 0); returns its
/// columns and rows.
Eigen::Vector2i Trim(std::vector<Numbered>* corners) {
  while (true) {
    Eigen::Vector2i low = corners->front().at, high = low;
    for (const Numbered& corner : *corners) {
      low = low.cwiseMin(corner.at);
      high = high.cwiseMax(corner.at);
    }
    Eigen::Vector2i size = high - low + Eigen::Vector2i::Ones();
    bool trimmed = false;
    for (const int axis : {0, 1}) {
      for (const int border : {low[axis], high[axis]}) {
        const auto on_border = [=](const Numbered& corner) { return corner.at[axis] == border; };
        if (2 * std::count_if(corners->begin(), corners->end(), on_border) >= size[1 - axis]) {
          continue;
        }
        std::erase_if(*corners, on_border);
        trimmed = true;
        break;
      }
      if (trimmed) break;
    }
    if (corners->empty()) return {0, 0};
    if (trimmed) continue;
    for (Numbered& corner : *corners) corner.at -= low;
    return size;
  }
}

/// Places of the corners that are not seen, from those around; nothing where they do not suffice.
std::optional<std::vector<Eigen::Vector2d>> Complete(
    int columns, int rows, std::vector<std::optional<Eigen::Vector2d>> places) {
  const auto at = [&](int column, int row) {
    const bool inside = column >= 0 && row >= 0 && column < columns && row < rows;
    return inside ? places[static_cast<std::size_t>(row) * columns + column] : std::nullopt;
  };
  bool grows = true;
  while (grows) {
    grows = false;
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        if (at(column, row)) continue;
        Eigen::Vector2d sum(0, 0);
        int count = 0;
        for (const auto& [dx, dy] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
          const auto near = at(column + dx, row + dy), far = at(column + 2 * dx, row + 2 * dy);
          if (!near || !far) continue;
          sum += 2 * *near - *far;
          ++count;
        }
        if (count == 0) continue;
        places[static_cast<std::size_t>(row) * columns + column] = sum / count;
        grows = true;
      }
    }
  }
  std::vector<Eigen::Vector2d> all;
  for (const auto& place : places) {
    if (!place) return std::nullopt;
    all.push_back(*place);
  }
  return all;
}

/// `scaled`: the image reduced by `scale`.
void FindAtScale(const cv::Mat& scaled,
                 double scale,
                 int min_found,
                 std::vector<CornerLattice>* lattices) {
  const std::vector<Crossing> crossings = FindCrossings(scaled);
  const Links links = Linker(scaled, crossings).Find();
  std::vector<bool> done(crossings.size());
  for (std::size_t seed = 0; seed < crossings.size(); ++seed) {
    if (done[seed] || links[seed].empty()) continue;
    std::vector<Numbered> corners = Number(crossings, links, seed, &done);
    if (static_cast<int>(corners.size()) < min_found) continue;
    const Eigen::Vector2i size = Trim(&corners);
    const auto found = static_cast<int>(corners.size());
    if (found < min_found || 2 * found < size.prod()) continue;
    std::vector<std::optional<Eigen::Vector2d>> places(size.prod());
    for (const Numbered& corner : corners) {
      places[corner.at.y() * size.x() + corner.at.x()] =
          (crossings[corner.crossing].p.array() + 0.5) / scale - 0.5;
    }
    if (auto all = Complete(size.x(), size.y(), std::move(places))) {
      lattices->push_back({size.x(), size.y(), std::move(*all)});
    }
  }
}

constexpr int kSmallestSize = 16;  // px; holds three by three corners

cv::Mat Half(const cv::Mat& image) {
  cv::Mat half;
  cv::resize(image, half, {}, 0.5, 0.5, cv::INTER_AREA);
  return half;
}

/// Halves the image until it is of this size at most, as long as it may hold a board. Returns the
/// scale.
double HalveTo(double size, cv::Mat* image) {
  double scale = 1;
  for (; std::max(image->cols, image->rows) > size &&
         std::min(image->cols, image->rows) >= kSmallestSize;
       scale /= 2) {
    *image = Half(*image);
  }
  return scale;
}

/// In an image reduced by `scale`, its half, and so on.
std::vector<CornerLattice> FindFrom(cv::Mat scaled, double scale, int min_found) {
  std::vector<CornerLattice> lattices;
  while (std::min(scaled.cols, scaled.rows) >= kSmallestSize) {
    FindAtScale(scaled, scale, min_found, &lattices);
    scaled = Half(scaled);
    scale /= 2;
  }
  return lattices;
}

// Squares of 5 px in an image reduced to this size are as small as can be measured in a full one of
// this size, and the largest images take no longer.
constexpr double kLargestSize = 2560;

}  // namespace

CornerLattice Transposed(const CornerLattice& lattice) {
  CornerLattice transposed{lattice.rows, lattice.columns, {}};
  for (int column = 0; column < lattice.columns; ++column) {
    for (int row = 0; row < lattice.rows; ++row) {
      transposed.corners.push_back(lattice.corners[row * lattice.columns + column]);
    }
  }
  return transposed;
}

std::vector<CornerLattice> FindCornerLattices(const cv::Mat& gray, int min_found) {
  cv::Mat scaled = gray;
  double scale = HalveTo(2 * kLargestSize, &scaled);
  const double rest = kLargestSize / std::max(scaled.cols, scaled.rows);
  if (rest < 1 && std::min(scaled.cols, scaled.rows) >= kSmallestSize) {
    cv::resize(scaled, scaled, {}, rest, rest, cv::INTER_LINEAR);
    scale *= rest;
  }
  return FindFrom(scaled, scale, min_found);
}

std::vector<CornerLattice> FindLargeCornerLattices(const cv::Mat& gray, int min_found) {
  if (std::max(gray.cols, gray.rows) <= kLargestSize) return {};
  cv::Mat scaled = gray;
  const double scale = HalveTo(kLargestSize / 2, &scaled);
  return FindFrom(scaled, scale, min_found);
}

}  // namespace plenocal::internal
