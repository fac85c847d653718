// SPDX-License-Identifier: Apache-2.0
#include "detectors/templates/saddle.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "calib/base/robust.h"
#include "detectors/templates/pixel_fit.h"

namespace plenocal::internal {
namespace {

/// Pixels farther from the corner add less and less: the variance falls with 1/radius, the time
/// grows with its square.
constexpr double kMaxRadius = 12;
/// So many blur widths from an edge the gray value is flat to 0.3 %.
constexpr double kBlurReach = 3;

double Cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

/// Two crossing blurred edges on a plane of brightness. With q = p - c, t = (cos theta, sin theta)
/// the direction of an edge, n = (-sin theta, cos theta) and curvature k, the distance from it is
///   d = n q - k / 2 (t q)^2,
/// and the gray value, S being the profile of a blurred edge from -1 to 1 and s its width,
///   gray = a + g q + b S(d_u / s_u) S(-d_v / s_v).
/// The product is exact for perpendicular edges under Gaussian blur. The plane g stands for uneven
/// light: without it a gradient along an edge would move the corner. s = sqrt(e^2 + kPixelSigma^2)
/// with the parameter e: no edge is sharper than a pixel is wide.
class CrossingEdges {
 public:
  enum { kX, kY, kThetaU, kThetaV, kBlurU, kBlurV, kA, kB, kGx, kGy, kSize };
  using Params = Eigen::Matrix<double, kSize, 1>;

  /// `reach`: how far the corner may be from the guess.
  CrossingEdges(const SaddleGuess& guess, double reach) : guess_(guess), reach_(reach) {}

  static double Width(double e) { return std::hypot(e, kPixelSigma); }

  [[nodiscard]] auto At(const Params& params) const {
    return [params,
            edge_u = Edge(params[kThetaU], params[kBlurU], guess_.curvature_u, 1),
            edge_v = Edge(params[kThetaV], params[kBlurV], guess_.curvature_v, -1)](
               const Pixel& pixel, Params* J) {
      const Eigen::Vector2d q(pixel.x - params[kX], pixel.y - params[kY]);
      const EdgeValue u = edge_u.At(q), v = edge_v.At(q);
      const double b = params[kB];
      (*J)[kX] = -b * (u.d_q.x() * v.value + u.value * v.d_q.x()) - params[kGx];
      (*J)[kY] = -b * (u.d_q.y() * v.value + u.value * v.d_q.y()) - params[kGy];
      (*J)[kThetaU] = b * u.d_theta * v.value;
      (*J)[kThetaV] = b * v.d_theta * u.value;
      (*J)[kBlurU] = b * u.d_e * v.value;
      (*J)[kBlurV] = b * v.d_e * u.value;
      (*J)[kA] = 1;
      (*J)[kB] = u.value * v.value;
      (*J)[kGx] = q.x();
      (*J)[kGy] = q.y();
      return params[kA] + params[kGx] * q.x() + params[kGy] * q.y() + b * u.value * v.value;
    };
  }

  bool Plausible(const Params& params) const {
    constexpr double kMaxTurn = 0.6;  // rad; the neighbours give the directions better than this
    const double theta_u = std::atan2(guess_.u.y(), guess_.u.x());
    const double theta_v = std::atan2(guess_.v.y(), guess_.v.x());
    return std::hypot(params[kX] - guess_.p.x(), params[kY] - guess_.p.y()) < reach_ &&
           std::abs(params[kThetaU] - theta_u) < kMaxTurn &&
           std::abs(params[kThetaV] - theta_v) < kMaxTurn &&
           std::max(Width(params[kBlurU]), Width(params[kBlurV])) < reach_;
  }

 private:
  /// An edge's profile and its derivatives by q, theta and e.
  struct EdgeValue {
    double value = 0, d_theta = 0, d_e = 0;
    Eigen::Vector2d d_q;
  };

  class Edge {
   public:
    Edge(double theta, double e, double k, double sign)
        : t_(std::cos(theta), std::sin(theta)),
          n_(-t_.y(), t_.x()),
          e_(e),
          s_(Width(e)),
          k_(k),
          sign_(sign) {}

    [[nodiscard]] EdgeValue At(const Eigen::Vector2d& q) const {
      const double along = t_.dot(q), across = n_.dot(q);
      const double d = across - 0.5 * k_ * along * along;
      const EdgeProfile profile = BlurredEdge(sign_ * d / s_);
      const double slope = sign_ * profile.derivative / s_;
      return {.value = profile.value,
              .d_theta = slope * (-along - k_ * along * across),
              .d_e = -slope * d / s_ * (e_ / s_),
              .d_q = slope * (n_ - k_ * along * t_)};
    }

   private:
    Eigen::Vector2d t_, n_;
    double e_, s_, k_, sign_;
  };

  const SaddleGuess& guess_;
  double reach_;
};

/// The pixels between the neighbouring corners' edges and outside of printed markers.
std::vector<Pixel> CornerPixels(const cv::Mat& gray, const SaddleGuess& guess) {
  const double area = std::abs(Cross(guess.u, guess.v));
  // Distances from one line of the board to the next.
  const double h_u = area / guess.v.norm(), h_v = area / guess.u.norm();
  const auto limit = [&](double h) {
    // Blurred edges of neighbours stay out. On the smallest boards their feet must be borne.
    constexpr double kLeast = 0.5, kMost = 0.8;  // of the distance
    return std::clamp(h - kBlurReach * guess.blur, kLeast * h, kMost * h) / h;
  };
  const double max_u = limit(h_u), max_v = limit(h_v);
  const auto strip = [&](double h) {
    constexpr double kLeast = 0.4;  // of the clear strip, on the smallest boards
    return std::max(guess.clear - kBlurReach * guess.blur / h, kLeast * guess.clear);
  };
  const double strip_u = strip(h_u), strip_v = strip(h_v);
  Eigen::Matrix2d basis;
  basis << guess.u, guess.v;
  const Eigen::Matrix2d to_squares = basis.inverse();
  const int x_min = std::max(0, static_cast<int>(std::ceil(guess.p.x() - kMaxRadius)));
  const int y_min = std::max(0, static_cast<int>(std::ceil(guess.p.y() - kMaxRadius)));
  const int x_max = std::min(gray.cols - 1, static_cast<int>(guess.p.x() + kMaxRadius));
  const int y_max = std::min(gray.rows - 1, static_cast<int>(guess.p.y() + kMaxRadius));
  std::vector<Pixel> pixels;
  for (int y = y_min; y <= y_max; ++y) {
    for (int x = x_min; x <= x_max; ++x) {
      const Eigen::Vector2d q = Eigen::Vector2d(x, y) - guess.p;
      const Eigen::Vector2d s = to_squares * q;
      if (q.norm() > kMaxRadius || std::abs(s.x()) > max_u || std::abs(s.y()) > max_v) continue;
      const bool marked = (s.x() * s.y() > 0) == (guess.marked_quadrants > 0);
      if (marked && std::abs(s.x()) > strip_u && std::abs(s.y()) > strip_v) continue;
      pixels.push_back({static_cast<double>(x),
                        static_cast<double>(y),
                        static_cast<double>(gray.at<std::uint8_t>(y, x))});
    }
  }
  return pixels;
}

/// Places on a line of the board through `at`: the corners before and after it, where known.
struct LineNeighbours {
  const Eigen::Vector2d *before = nullptr, *at = nullptr, *after = nullptr;
};

/// To the next corner: the mean direction and the shorter of the distances, so that a patch of this
/// size ends before the nearer neighbour.
std::optional<Eigen::Vector2d> Step(const LineNeighbours& n) {
  if (n.before != nullptr && n.after != nullptr) {
    const Eigen::Vector2d chord = *n.after - *n.before;
    const double length = std::min((*n.after - *n.at).norm(), (*n.at - *n.before).norm());
    if (chord.norm() == 0) return std::nullopt;
    return chord.normalized() * length;
  }
  if (n.after != nullptr) return *n.after - *n.at;
  if (n.before != nullptr) return *n.at - *n.before;
  return std::nullopt;
}

/// Curvature of the parabola through three corners; nothing unless there are all.
std::optional<double> Curvature(const LineNeighbours& neighbours) {
  if (neighbours.before == nullptr || neighbours.after == nullptr) return std::nullopt;
  const Eigen::Vector2d t = (*neighbours.after - *neighbours.before).normalized();
  const Eigen::Vector2d n(-t.y(), t.x());
  const Eigen::Vector2d after = *neighbours.after - *neighbours.at;
  const Eigen::Vector2d before = *neighbours.before - *neighbours.at;
  const double t_after = t.dot(after), t_before = t.dot(before);
  if (t_after <= 0 || t_before >= 0) return std::nullopt;
  return 2 * (n.dot(after) / t_after - n.dot(before) / t_before) / (t_after - t_before);
}

/// Access to points of a grid by row and column; outside there are none.
class Points {
 public:
  Points(int columns, int rows, const std::vector<std::optional<Eigen::Vector2d>>& points)
      : columns_(columns), rows_(rows), points_(points) {}

  const Eigen::Vector2d* At(int row, int column) const {
    if (row < 0 || row >= rows_ || column < 0 || column >= columns_) return nullptr;
    const auto& point = points_[static_cast<std::size_t>(row) * columns_ + column];
    return point ? &*point : nullptr;
  }
  /// Along a row of the grid (from column to column) or along a column.
  enum class Line { kRow, kColumn };
  LineNeighbours Along(int row, int column, Line line) const {
    const int dr = line == Line::kRow ? 0 : 1, dc = 1 - dr;
    return {At(row - dr, column - dc), At(row, column), At(row + dr, column + dc)};
  }
  /// At the border, the next corner's inside it.
  double CurvatureAt(int row, int column, Line line) const {
    const int dr = line == Line::kRow ? 0 : 1, dc = 1 - dr;
    for (const int shift : {0, 1, -1}) {
      const int r = row + shift * dr, c = column + shift * dc;
      if (At(r, c) == nullptr) continue;
      if (const auto k = Curvature(Along(r, c, line))) return *k;
    }
    return 0;
  }

 private:
  int columns_, rows_;
  const std::vector<std::optional<Eigen::Vector2d>>& points_;
};

}  // namespace

std::optional<Saddle> FitSaddle(const cv::Mat& gray, const SaddleGuess& guess) {
  constexpr double kMinSpacing = 3;  // px; below, the pixels are fewer than the parameters need
  const double area = std::abs(Cross(guess.u, guess.v));
  const double spacing = area / std::max(guess.u.norm(), guess.v.norm());
  if (!(spacing >= kMinSpacing)) return std::nullopt;
  const std::vector<Pixel> pixels = CornerPixels(gray, guess);
  if (pixels.size() < 2 * CrossingEdges::kSize) return std::nullopt;

  // The linear parameters' start: mean gray, and the contrast between the two pairs of quadrants.
  Eigen::Matrix2d basis;
  basis << guess.u, guess.v;
  const Eigen::Matrix2d to_squares = basis.inverse();
  double mean = 0, equal = 0, unequal = 0;
  int equal_count = 0, unequal_count = 0;
  for (const Pixel& pixel : pixels) {
    const Eigen::Vector2d s = to_squares * (Eigen::Vector2d(pixel.x, pixel.y) - guess.p);
    mean += pixel.gray;
    (s.x() * s.y() > 0 ? equal : unequal) += pixel.gray;
    ++(s.x() * s.y() > 0 ? equal_count : unequal_count);
  }
  if (equal_count == 0 || unequal_count == 0) return std::nullopt;
  CrossingEdges::Params start = CrossingEdges::Params::Zero();
  start[CrossingEdges::kX] = guess.p.x();
  start[CrossingEdges::kY] = guess.p.y();
  start[CrossingEdges::kThetaU] = std::atan2(guess.u.y(), guess.u.x());
  start[CrossingEdges::kThetaV] = std::atan2(guess.v.y(), guess.v.x());
  start[CrossingEdges::kBlurU] = start[CrossingEdges::kBlurV] = guess.blur;
  start[CrossingEdges::kA] = mean / static_cast<double>(pixels.size());
  start[CrossingEdges::kB] = 0.5 * (equal / equal_count - unequal / unequal_count);

  // A third of a square is nearer to this corner than to any other.
  constexpr double kReach = 0.35;      // of a square
  constexpr double kLeastReach = 1.5;  // px: so good is a detector's first place
  const double reach = std::min(kReach * spacing, kMaxRadius / 2);
  const auto fit = FitPixels<CrossingEdges::kSize>(
      CrossingEdges(guess, std::max(reach, kLeastReach)), pixels, start);
  if (!fit) return std::nullopt;
  if (fit->explained < kMinExplained) return std::nullopt;
  Saddle saddle;
  saddle.p = fit->params.head<2>();
  if (saddle.p.minCoeff() < 0 || saddle.p.x() > gray.cols - 1 || saddle.p.y() > gray.rows - 1) {
    return std::nullopt;
  }
  saddle.sigma =
      std::sqrt(0.5 * (fit->covariance(0, 0) + fit->covariance(1, 1)) + kModelError * kModelError);
  saddle.contrast = fit->params[CrossingEdges::kB];
  saddle.blur = std::sqrt(CrossingEdges::Width(fit->params[CrossingEdges::kBlurU]) *
                          CrossingEdges::Width(fit->params[CrossingEdges::kBlurV]));
  // Beyond these nothing was measured.
  constexpr double kMaxSigma = 0.5;          // px
  constexpr double kMaxRelativeSigma = 0.1;  // of a square
  if (!(saddle.sigma > 0)) return std::nullopt;
  if (saddle.sigma > std::min(kMaxSigma, kMaxRelativeSigma * spacing)) return std::nullopt;
  return saddle;
}

CornerGrid RefineGrid(const cv::Mat& gray,
                      int columns,
                      int rows,
                      const std::vector<std::optional<Eigen::Vector2d>>& guesses,
                      double clear,
                      int first_marked_quadrants) {
  const std::size_t count = static_cast<std::size_t>(columns) * rows;
  CornerGrid grid{columns, rows, std::vector<std::optional<Saddle>>(count)};
  std::vector<std::optional<Eigen::Vector2d>> places = guesses;
  for (const bool curved : {false, true}) {
    // A guess that the first pass could not measure stays, as a neighbour.
    const Points points(columns, rows, places);
    std::vector<std::optional<Eigen::Vector2d>> measured_places(count);
    for (std::size_t i = 0; i < count; ++i) {
      if (grid.corners[i]) measured_places[i] = grid.corners[i]->p;
    }
    const Points measured(columns, rows, measured_places);
    std::vector<std::optional<Saddle>> next(count);
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        const std::size_t i = static_cast<std::size_t>(row) * columns + column;
        if (!places[i] || (curved && !grid.corners[i])) continue;
        const auto u = Step(points.Along(row, column, Points::Line::kRow));
        const auto v = Step(points.Along(row, column, Points::Line::kColumn));
        if (!u || !v) continue;
        SaddleGuess guess;
        guess.p = *places[i];
        guess.u = *u;
        guess.v = *v;
        guess.clear = clear;
        guess.marked_quadrants =
            (row + column) % 2 == 0 ? first_marked_quadrants : -first_marked_quadrants;
        if (curved) {
          guess.curvature_u = measured.CurvatureAt(row, column, Points::Line::kRow);
          guess.curvature_v = measured.CurvatureAt(row, column, Points::Line::kColumn);
          guess.blur = grid.corners[i]->blur;
        }
        next[i] = FitSaddle(gray, guess);
      }
    }
    grid.corners = std::move(next);
    for (std::size_t i = 0; i < count; ++i) {
      if (grid.corners[i]) places[i] = grid.corners[i]->p;
    }
  }
  return grid;
}

}  // namespace plenocal::internal
