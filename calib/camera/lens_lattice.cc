// SPDX-License-Identifier: Apache-2.0
#include "calib/camera/lens_lattice.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <limits>
#include <map>
#include <numbers>
#include <set>
#include <unordered_map>

#include "calib/base/format_error.h"
#include "calib/base/invert_map.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;

LatticeNode operator+(const LatticeNode& a, const LatticeNode& b) {
  return {a.column + b.column, a.row + b.row};
}

Vector2d Middle(ImageSize size) { return {(size[0] - 1) / 2.0, (size[1] - 1) / 2.0}; }

/// Nearest points by buckets of one size.
class PointIndex {
 public:
  PointIndex(std::span<const Vector2d> points, double cell) : points_(points), cell_(cell) {
    for (size_t i = 0; i < points.size(); ++i) buckets_[Key(Cell(points[i]))].push_back(i);
  }

  /// The point nearest to `place` within `radius` <= the size of a bucket.
  [[nodiscard]] std::optional<size_t> Nearest(const Vector2d& place, double radius) const {
    std::optional<size_t> nearest;
    double best = radius;
    const Eigen::Vector2i cell = Cell(place);
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        const auto bucket = buckets_.find(Key(cell + Eigen::Vector2i(dx, dy)));
        if (bucket == buckets_.end()) continue;
        for (const size_t i : bucket->second) {
          const double distance = (points_[i] - place).norm();
          if (distance <= best) {
            best = distance;
            nearest = i;
          }
        }
      }
    }
    return nearest;
  }

 private:
  [[nodiscard]] Eigen::Vector2i Cell(const Vector2d& p) const {
    return (p / cell_).array().floor().matrix().cast<int>();
  }
  static std::int64_t Key(const Eigen::Vector2i& cell) {
    return (static_cast<std::int64_t>(cell.x()) << 32) + cell.y();
  }

  std::span<const Vector2d> points_;
  double cell_;
  std::unordered_map<std::int64_t, std::vector<size_t>> buckets_;
};

// Width of Huber's weight in the first iteration, in the unit of Tukey's.
constexpr double kHuberWidth = 2.0;
// Measurements per coefficient that a degree must at least have.
constexpr double kPointsPerCoefficient = 2;
constexpr double kTukeyWidth = SmoothLattice::kTukeyWidth;
constexpr auto CountMonomials = SmoothLattice::CountMonomials;
constexpr int kRobustIterations = 20;
constexpr double kConverged = 1e-4;  // relative change of the scale

}  // namespace

bool IsInside(const Vector2d& position, ImageSize image_size, double margin) {
  const double low = -0.5 - margin;
  return position.x() >= low && position.y() >= low &&
         position.x() < image_size[0] + margin - 0.5 && position.y() < image_size[1] + margin - 0.5;
}

LatticeKind KindOfLattice(const Matrix2d& basis) {
  // Half-way between 60 and 90 degrees.
  const double limit = std::cos(75 * std::numbers::pi / 180);
  const double cosine =
      basis.col(0).dot(basis.col(1)) / (basis.col(0).norm() * basis.col(1).norm());
  return std::abs(cosine) < limit ? LatticeKind::kRectangular : LatticeKind::kHexagonal;
}

std::span<const LatticeNode> LatticeNeighbours(LatticeKind kind) {
  static constexpr std::array<LatticeNode, 6> kHexagonal{
      {{1, 0}, {0, 1}, {-1, 1}, {-1, 0}, {0, -1}, {1, -1}}};
  static constexpr std::array<LatticeNode, 8> kRectangular{
      {{1, 0}, {0, 1}, {-1, 0}, {0, -1}, {1, 1}, {-1, 1}, {-1, -1}, {1, -1}}};
  if (kind == LatticeKind::kHexagonal) return kHexagonal;
  return kRectangular;
}

int LensPattern::Set(const LatticeNode& node) const {
  const auto remainder = [](int a, int b) { return (a % b + b) % b; };
  const int row = remainder(node.row, rows);
  const int periods = (node.row - row) / rows;
  return columns * row + remainder(node.column - shift * periods, columns);
}

std::vector<LensPattern> LensPatterns(int sets) {
  std::vector<LensPattern> patterns;
  for (int columns = 1; columns <= sets; ++columns) {
    if (sets % columns != 0) continue;
    for (int shift = 0; shift < columns; ++shift) {
      patterns.push_back({.columns = columns, .rows = sets / columns, .shift = shift});
    }
  }
  return patterns;
}

Matrix2d CanonicalLatticeBasis(const Matrix2d& basis) {
  // The second vector may be 60, 90 or 120 degrees from the first, on either side.
  const Vector2d a = basis.col(0), b = basis.col(1);
  std::vector<Vector2d> ring{a, b, -a, -b};
  if (KindOfLattice(basis) == LatticeKind::kHexagonal) {
    const Vector2d c = a.dot(b) > 0 ? Vector2d(b - a) : Vector2d(a + b);
    ring.insert(ring.end(), {c, -c});
  }
  const auto angle = [](const Vector2d& v) { return std::atan2(v.y(), v.x()); };
  std::sort(ring.begin(), ring.end(), [&](const Vector2d& p, const Vector2d& q) {
    return angle(p) < angle(q);
  });
  size_t first = 0;
  for (size_t k = 0; k < ring.size(); ++k) {
    if (std::abs(angle(ring[k])) < std::abs(angle(ring[first]))) first = k;
  }
  Matrix2d canonical;
  canonical << ring[first], ring[(first + 1) % ring.size()];
  return canonical;
}

namespace {

/// Two vectors from a point to its neighbours, if these lie on all sides of it: `near` has the
/// point itself and then the others, nearest first.
std::optional<Matrix2d> BasisAround(std::span<const Vector2d> points,
                                    const std::vector<size_t>& near) {
  // A miss of half of 60 degrees is one of half a pitch.
  constexpr double kTolerance = 0.25;
  const Vector2d& centre = points[near[0]];
  const auto neighbour = [&](const Vector2d& at, double tolerance) -> std::optional<Vector2d> {
    for (size_t i = 1; i < near.size(); ++i) {
      const Vector2d seen = points[near[i]] - centre;
      if ((seen - at).norm() <= tolerance) return seen;
    }
    return std::nullopt;
  };
  const Vector2d a = points[near[1]] - centre;
  if (!(a.norm() > 1)) return std::nullopt;  // px: two micro images do not share a pixel
  Matrix2d basis;
  const auto turned = [&](int sixths) -> Vector2d {
    return Eigen::Rotation2Dd(sixths * std::numbers::pi / 3) * a;
  };
  const double tolerance = kTolerance * a.norm();
  bool hexagonal = true;
  for (int step = 0; step < 6; ++step) {
    hexagonal = hexagonal && neighbour(turned(step), tolerance).has_value();
  }
  if (hexagonal) {
    basis << a, *neighbour(turned(1), tolerance);
    return basis;
  }
  // The nearest point across, however far, and the corners of the cell.
  for (size_t i = 1; i < near.size(); ++i) {
    const Vector2d b = points[near[i]] - centre;
    if (std::abs(a.dot(b)) > kTolerance * a.norm() * b.norm()) continue;
    for (const Vector2d& corner : {Vector2d(-a), Vector2d(-b), Vector2d(a + b), Vector2d(a - b)}) {
      if (!neighbour(corner, tolerance)) return std::nullopt;
    }
    // In a hexagonal lattice with a hole, which may be in the middle of one of these cells.
    for (const Vector2d& diagonal : {Vector2d(a + b), Vector2d(a - b)}) {
      if (neighbour(diagonal / 2, tolerance)) return std::nullopt;
    }
    basis << a, b;
    return basis;
  }
  return std::nullopt;
}

}  // namespace

std::optional<Matrix2d> FindLatticeBasis(std::span<const Vector2d> points, ImageSize image_size) {
  std::vector<size_t> order(points.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = i;
  const Vector2d middle = Middle(image_size);
  const auto nearer = [&](const Vector2d& from) {
    return [&points, from](size_t a, size_t b) {
      return (points[a] - from).squaredNorm() < (points[b] - from).squaredNorm();
    };
  };
  // A few centres are tried: a lattice may have holes. Of a rectangle twice as long as wide, the
  // neighbours across and at the corners are among the next sixteen.
  constexpr size_t kCentres = 20, kRing = 16, kFewest = 6;
  if (points.size() <= kFewest) return std::nullopt;
  const size_t centres = std::min(kCentres, points.size());
  const size_t ring = std::min(kRing, points.size() - 1);
  std::partial_sort(order.begin(), order.begin() + centres, order.end(), nearer(middle));
  for (size_t k = 0; k < centres; ++k) {
    std::vector<size_t> near(points.size());
    for (size_t i = 0; i < near.size(); ++i) near[i] = i;
    std::partial_sort(near.begin(), near.begin() + ring + 1, near.end(), nearer(points[order[k]]));
    near.resize(ring + 1);
    if (const auto basis = BasisAround(points, near)) return CanonicalLatticeBasis(*basis);
  }
  return std::nullopt;
}

namespace {

// Grows a lattice from one node to its neighbours.
class LatticeGrowth {
 public:
  LatticeGrowth(std::span<const Vector2d> points, const Matrix2d& basis, ImageSize image_size)
      : points_(points),
        basis_(basis),
        neighbours_(LatticeNeighbours(KindOfLattice(basis))),
        image_size_(image_size),
        pitch_(basis.colwise().norm().minCoeff()),
        index_(points, pitch_),
        taken_(points.size(), false) {}

  std::vector<std::optional<LatticeNode>> Run() {
    std::vector<std::optional<LatticeNode>> nodes(points_.size());
    const std::optional<size_t> start = FindStart();
    if (!start) return nodes;
    Take({0, 0}, *start);
    while (!front_.empty()) {
      const LatticeNode node = front_.front();
      front_.pop_front();
      for (const LatticeNode& step : neighbours_) {
        const LatticeNode next = node + step;
        if (positions_.contains(next)) continue;
        const std::optional<size_t> found = index_.Nearest(Predict(next), Reach());
        // Around a hole the lattice grows through its neighbours.
        if (found && !taken_[*found]) Take(next, *found);
      }
    }
    for (const auto& [node, point] : points_of_) nodes[point] = node;
    return nodes;
  }

 private:
  // A point nearer than this to the prediction is the node: half-way to a neighbour is pitch / 2.
  [[nodiscard]] double Reach() const { return 0.3 * pitch_; }

  // The point nearest to the middle that has all neighbours.
  [[nodiscard]] std::optional<size_t> FindStart() const {
    const Vector2d middle = Middle(image_size_);
    std::optional<size_t> start;
    for (size_t i = 0; i < points_.size(); ++i) {
      if (start && (points_[i] - middle).norm() >= (points_[*start] - middle).norm()) continue;
      const bool surrounded =
          std::all_of(neighbours_.begin(), neighbours_.end(), [&](const LatticeNode& step) {
            const Vector2d there = points_[i] + basis_ * Vector2d(step.column, step.row);
            return index_.Nearest(there, Reach()).has_value();
          });
      if (surrounded) start = i;
    }
    return start;
  }

  void Take(const LatticeNode& node, size_t point) {
    taken_[point] = true;
    points_of_[node] = point;
    positions_[node] = points_[point];
    front_.push_back(node);
  }

  // From each pair of nodes in a line the next one, averaged over the directions; from a single
  // neighbour by the basis.
  [[nodiscard]] Vector2d Predict(const LatticeNode& node) const {
    Vector2d by_pairs(0, 0), by_basis(0, 0);
    int pairs = 0, singles = 0;
    for (const LatticeNode& step : neighbours_) {
      const auto one = positions_.find(node + step);
      if (one == positions_.end()) continue;
      const Vector2d there(step.column, step.row);
      by_basis += one->second - basis_ * there;
      ++singles;
      const auto two = positions_.find(node + step + step);
      if (two == positions_.end()) continue;
      by_pairs += 2 * one->second - two->second;
      ++pairs;
    }
    return pairs > 0 ? Vector2d(by_pairs / pairs) : Vector2d(by_basis / singles);
  }

  std::span<const Vector2d> points_;
  const Matrix2d& basis_;
  std::span<const LatticeNode> neighbours_;
  ImageSize image_size_;
  double pitch_;
  PointIndex index_;
  std::vector<bool> taken_;
  std::map<LatticeNode, Vector2d> positions_;
  std::map<LatticeNode, size_t> points_of_;
  std::deque<LatticeNode> front_;
};

}  // namespace

std::vector<std::optional<LatticeNode>> IndexLattice(std::span<const Vector2d> points,
                                                     const Matrix2d& basis,
                                                     ImageSize image_size) {
  return LatticeGrowth(points, basis, image_size).Run();
}

Eigen::VectorXd SmoothLattice::Monomials(const Vector2d& place, int degree) {
  std::array<Vector2d, kMaxDegree + 1> powers{Vector2d(1, 1)};
  for (int power = 1; power <= degree; ++power) {
    powers[power] = powers[power - 1].cwiseProduct(place);
  }
  Eigen::VectorXd terms(CountMonomials(degree));
  int k = 0;
  for (int total = 0; total <= degree; ++total) {
    for (int power = 0; power <= total; ++power) {
      terms[k++] = powers[total - power].x() * powers[power].y();
    }
  }
  return terms;
}

namespace {

// Least squares of the measured positions by polynomials of the lattice coordinates.
struct LatticeEquations {
  Eigen::MatrixXd A;  // terms by degree
  Eigen::MatrixX2d positions;
  Eigen::VectorXd precision;  // 1 / sigma^2

  struct Solution {
    Eigen::Matrix2Xd coefficients;
    Eigen::VectorXd residuals;  // lengths over sigma
  };
  [[nodiscard]] Solution Solve(int degree, const Eigen::VectorXd& weights) const {
    const auto B = A.leftCols(CountMonomials(degree));
    const Eigen::MatrixXd N = B.transpose() * weights.asDiagonal() * B;
    const Eigen::MatrixXd right = B.transpose() * weights.asDiagonal() * positions;
    const Eigen::MatrixXd solution = SolveSymmetric(N, right);
    return {
        solution.transpose(),
        ((positions - B * solution).rowwise().norm().array() * precision.array().sqrt()).matrix()};
  }

  // Residuals below it are rounding, which high degrees would follow: files have 1e-5 px.
  [[nodiscard]] double Resolution() const {
    constexpr double kResolution = 1e-4;  // px
    return kResolution * std::sqrt(precision.maxCoeff());
  }

  struct RobustSolution {
    Eigen::Matrix2Xd coefficients;
    Eigen::VectorXd weights;
    double sigma = 0;
  };
  // Tukey's biweight from a start by Huber's weights, which has no second minimum.
  [[nodiscard]] RobustSolution SolveRobustly(int degree) const {
    RobustSolution robust{{}, precision, 0};
    Solution solution = Solve(degree, robust.weights);
    for (int iteration = 0; iteration < kRobustIterations; ++iteration) {
      const Eigen::VectorXd& residuals = solution.residuals;
      const double last = robust.sigma;
      robust.sigma =
          kSigmaPerMedianLength2d * Median(std::vector<double>(residuals.begin(), residuals.end()));
      robust.sigma = std::max(robust.sigma, Resolution());
      if (std::abs(robust.sigma - last) <= kConverged * robust.sigma && iteration > 1) break;
      for (Eigen::Index i = 0; i < precision.size(); ++i) {
        const double t = residuals[i] / robust.sigma;
        robust.weights[i] =
            precision[i] * (iteration == 0 ? HuberWeight(t / kHuberWidth)
                                           : TukeyWeight(t * t / (kTukeyWidth * kTukeyWidth)));
      }
      solution = Solve(degree, robust.weights);
    }
    robust.coefficients = solution.coefficients;
    return robust;
  }

  // The degree by the Bayesian information criterion with the same weights for all, so that all are
  // judged on the same data.
  [[nodiscard]] int BestDegree(int most, const Eigen::VectorXd& weights) const {
    const double samples = 2 * (weights.array() / precision.array()).sum();
    double best = std::numeric_limits<double>::infinity();
    int best_degree = 1;
    for (int degree = 1; degree <= most; ++degree) {
      const Eigen::VectorXd residuals = Solve(degree, weights).residuals;
      const double sum =
          (residuals.array().square() * weights.array() / precision.array()).sum() / samples;
      const double criterion = samples * std::log(std::max(sum, Resolution() * Resolution())) +
                               2 * CountMonomials(degree) * std::log(samples);
      if (criterion < best) {
        best = criterion;
        best_degree = degree;
      }
    }
    return best_degree;
  }
};

}  // namespace

SmoothLattice SmoothLattice::Fit(std::span<const LatticeMeasurement> measurements) {
  const auto count = static_cast<Eigen::Index>(measurements.size());
  if (count < kPointsPerCoefficient * CountMonomials(1)) {
    throw JobError("too few micro images look alike for a lattice; record an even white field");
  }
  SmoothLattice lattice;
  Vector2d low(1e9, 1e9), high = -low;
  for (const LatticeMeasurement& m : measurements) {
    const Vector2d at(m.node.column, m.node.row);
    low = low.cwiseMin(at);
    high = high.cwiseMax(at);
  }
  lattice.middle_ = (low + high) / 2;
  lattice.scale_ = std::max(1.0, (high - low).maxCoeff() / 2);

  int most = 1;
  while (most < kMaxDegree && count >= kPointsPerCoefficient * CountMonomials(most + 1)) ++most;
  LatticeEquations equations{Eigen::MatrixXd(count, CountMonomials(most)),
                             Eigen::MatrixX2d(count, 2),
                             Eigen::VectorXd(count)};
  for (Eigen::Index i = 0; i < count; ++i) {
    const LatticeMeasurement& m = measurements[i];
    equations.A.row(i) = lattice.TermsAt(Vector2d(m.node.column, m.node.row), most);
    equations.positions.row(i) = m.position;
    equations.precision[i] = 1 / (m.sigma * m.sigma);
  }
  lattice.degree_ = equations.BestDegree(most, equations.SolveRobustly(most).weights);
  const LatticeEquations::RobustSolution fit = equations.SolveRobustly(lattice.degree_);
  lattice.coefficients_ = fit.coefficients;
  lattice.sigma_ = fit.sigma;
  return lattice;
}

Vector2d SmoothLattice::Position(double column, double row) const {
  return coefficients_ * TermsAt({column, row}, degree_);
}

Matrix2d SmoothLattice::Basis(double column, double row) const {
  const Vector2d s = (Vector2d(column, row) - middle_) / scale_;
  Matrix2d basis = Matrix2d::Zero();
  int k = 0;
  for (int total = 0; total <= degree_; ++total) {
    for (int power = 0; power <= total; ++power, ++k) {
      const int p = total - power, q = power;
      const double dx = p == 0 ? 0 : p * std::pow(s.x(), p - 1) * std::pow(s.y(), q);
      const double dy = q == 0 ? 0 : q * std::pow(s.x(), p) * std::pow(s.y(), q - 1);
      basis += coefficients_.col(k) * Vector2d(dx, dy).transpose() / scale_;
    }
  }
  return basis;
}

std::array<Matrix2d, 2> SmoothLattice::SecondDerivatives(double column, double row) const {
  const Vector2d s = (Vector2d(column, row) - middle_) / scale_;
  std::array<Matrix2d, 2> second{Matrix2d::Zero(), Matrix2d::Zero()};
  const auto power = [](double x, int exponent) {
    return exponent < 0 ? 0 : std::pow(x, exponent);
  };
  int k = 0;
  for (int total = 0; total <= degree_; ++total) {
    for (int q = 0; q <= total; ++q, ++k) {
      const int p = total - q;
      const double xx = p * (p - 1) * power(s.x(), p - 2) * power(s.y(), q);
      const double xy = p * q * power(s.x(), p - 1) * power(s.y(), q - 1);
      const double yy = q * (q - 1) * power(s.x(), p) * power(s.y(), q - 2);
      const Matrix2d of_term = (Matrix2d() << xx, xy, xy, yy).finished() / (scale_ * scale_);
      for (int i = 0; i < 2; ++i) second[i] += coefficients_(i, k) * of_term;
    }
  }
  return second;
}

Vector2d SmoothLattice::Coordinates(const Vector2d& position) const {
  constexpr double kLastStep = 1e-9;  // of a pitch
  const auto map = [&](const Vector2d& at, Vector2d* image, Matrix2d* slope) {
    *image = Position(at.x(), at.y());
    *slope = Basis(at.x(), at.y());
    return true;
  };
  return InvertMap(map, position, middle_, kLastStep).value_or(middle_);
}

std::vector<LatticeNode> SmoothLattice::NodesInside(std::span<const LatticeMeasurement> measured,
                                                    ImageSize image_size,
                                                    double margin,
                                                    double cell) const {
  constexpr double kMostPerCell = 4;
  const double most =
      kMostPerCell * (image_size[0] + 2 * margin) * (image_size[1] + 2 * margin) / cell;
  // Outward from what was measured, so that a polynomial that folds back far outside does no harm.
  std::set<LatticeNode> inside, seen;
  std::deque<LatticeNode> front;
  for (const LatticeMeasurement& m : measured) {
    if (seen.insert(m.node).second) front.push_back(m.node);
  }
  while (!front.empty()) {
    const LatticeNode node = front.front();
    front.pop_front();
    if (!IsInside(Position(node.column, node.row), image_size, margin)) continue;
    inside.insert(node);
    if (!(static_cast<double>(inside.size()) <= most)) {
      throw JobError("the micro images found make no lattice; record an even white field");
    }
    for (const LatticeNode& step : LatticeNeighbours(LatticeKind::kHexagonal)) {
      if (seen.insert(node + step).second) front.push_back(node + step);
    }
  }
  std::vector<LatticeNode> nodes(inside.begin(), inside.end());
  std::sort(nodes.begin(), nodes.end(), [](const LatticeNode& a, const LatticeNode& b) {
    return std::pair(a.row, a.column) < std::pair(b.row, b.column);
  });
  return nodes;
}

}  // namespace plenocal
