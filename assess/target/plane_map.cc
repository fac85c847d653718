// SPDX-License-Identifier: Apache-2.0
#include "assess/target/plane_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "calib/base/linear_algebra.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"
#include "calib/kernels/row_products.h"

namespace plenocal {
namespace {

constexpr int kMaxOrder = 3;
constexpr int kMaxTerms = (kMaxOrder + 1) * (kMaxOrder + 2) / 2;
// D is 1 in the middle of the points; nearer to zero than this the plane vanishes.
constexpr double kLeastDenominator = 0.02;

int Terms(int order) { return (order + 1) * (order + 2) / 2; }

// 1, x, y, x^2, xy, y^2, ...
std::array<double, kMaxTerms> Monomials(const Eigen::Vector2d& at, int order) {
  std::array<double, kMaxTerms> terms{1};
  size_t k = 1, before = 0;  // `before`: the first term of one degree less
  for (size_t degree = 1; degree <= static_cast<size_t>(order); ++degree) {
    for (size_t j = 0; j < degree; ++j) terms[k + j] = terms[before + j] * at.x();
    terms[k + degree] = terms[before + degree - 1] * at.y();
    before = k;
    k += degree + 1;
  }
  return terms;
}

// Middle of the points and their largest distance from it.
double Frame(const std::vector<Eigen::Vector2d>& points, Eigen::Vector2d* middle) {
  middle->setZero();
  for (const Eigen::Vector2d& p : points) *middle += p / static_cast<double>(points.size());
  double scale = 0;
  for (const Eigen::Vector2d& p : points) scale = std::max(scale, (p - *middle).norm());
  return scale > 0 ? scale : 1;
}

}  // namespace

int PlaneMap::Unknowns(int order) { return 2 * Terms(order) + 2; }

int PlaneMap::OrderFor(size_t points) {
  for (int order = kMaxOrder; order > 1; --order) {
    if (static_cast<int>(points) >= Unknowns(order)) return order;
  }
  return 1;
}

std::optional<PlaneMap> PlaneMap::Fit(const Pairs& pairs,
                                      const std::vector<double>& weights,
                                      int order) {
  const size_t count = pairs.plane.size();
  if (2 * count < static_cast<size_t>(Unknowns(order))) return std::nullopt;
  PlaneMap map;
  map.order_ = order;
  map.plane_scale_ = Frame(pairs.plane, &map.plane_middle_);
  map.image_scale_ = Frame(pairs.image, &map.image_middle_);
  const int terms = Terms(order), unknowns = Unknowns(order);
  // The equations are multiplied by D, so they are weighted by the last D.
  constexpr int kRounds = 3;
  // Of each point the monomials m, at x, at y, x and y: the equations of x are (m, 0, -at x), those
  // of y (0, m, -at y), so that all sums of products are among theirs.
  const int at_x = terms, at_y = terms + 2, x = terms + 4, y = terms + 5;
  RowMajorMatrix points = ZeroRows(terms + 6, static_cast<Eigen::Index>(count));
  for (size_t i = 0; i < count; ++i) {
    const Eigen::Vector2d at = (pairs.plane[i] - map.plane_middle_) / map.plane_scale_;
    const Eigen::Vector2d seen = (pairs.image[i] - map.image_middle_) / map.image_scale_;
    const auto monomials = Monomials(at, order);
    auto point = points.col(static_cast<Eigen::Index>(i));
    for (int k = 0; k < terms; ++k) point[k] = monomials[static_cast<size_t>(k)];
    point.segment<2>(at_x) = seen.x() * at;
    point.segment<2>(at_y) = seen.y() * at;
    point.segment<2>(x) = seen;
  }
  Eigen::ArrayXd weight = Eigen::ArrayXd::Zero(points.cols());
  for (size_t i = 0; i < count; ++i) {
    weight[static_cast<Eigen::Index>(i)] = pairs.scale[i] * std::sqrt(weights[i]);
  }
  RowMajorMatrix columns = points;
  for (int round = 0; round < kRounds; ++round) {
    Eigen::ArrayXd by_denominator = weight;
    if (round > 0) {
      const Eigen::ArrayXd denominator =
          1 + (points.middleRows<2>(1).transpose() * map.coefficients_.tail<2>()).array();
      by_denominator /= denominator.max(kLeastDenominator);
    }
    columns = points * by_denominator.matrix().asDiagonal();
    Eigen::MatrixXd sums = Eigen::MatrixXd::Zero(terms + 6, terms + 6);  // lower triangle
    AddRowProducts(1, columns, &sums);
    Eigen::MatrixXd square = Eigen::MatrixXd::Zero(unknowns, unknowns);  // its lower triangle
    square.topLeftCorner(terms, terms) = sums.topLeftCorner(terms, terms);
    square.block(terms, terms, terms, terms) = sums.topLeftCorner(terms, terms);
    square.block(2 * terms, 0, 2, terms) = -sums.block(at_x, 0, 2, terms);
    square.block(2 * terms, terms, 2, terms) = -sums.block(at_y, 0, 2, terms);
    square.bottomRightCorner<2, 2>() = sums.block<2, 2>(at_x, at_x) + sums.block<2, 2>(at_y, at_y);
    Eigen::VectorXd right(unknowns);
    right << sums.row(x).head(terms).transpose(), sums.row(y).head(terms).transpose(),
        -(sums.block<1, 2>(x, at_x) + sums.block<1, 2>(y, at_y)).transpose();
    // Keeps a direction that the points leave open at zero, far below what they determine.
    constexpr double kRidge = 1e-12;
    square.diagonal().array() += kRidge * square.diagonal().maxCoeff();
    map.coefficients_ = SolveSymmetric(square, right);
    if (!map.coefficients_.allFinite()) return std::nullopt;
  }
  return map;
}

std::optional<PlaneMap> PlaneMap::FitRobustly(const Pairs& pairs, int order) {
  constexpr int kRounds = 4;
  constexpr double kSmallest = 1e-9;  // px; keeps weights finite where residuals are zero
  std::vector<double> weights(pairs.plane.size(), 1.0);
  std::optional<PlaneMap> map;
  for (int now = 1; now <= order; ++now) {
    for (int round = 0; round < kRounds; ++round) {
      map = Fit(pairs, weights, now);
      if (!map) return std::nullopt;
      const std::vector<double> lengths = map->Lengths(pairs);
      const double width =
          kCauchyWidth<> * std::max(kSmallest, kSigmaPerMedianLength2d * Median(lengths));
      for (size_t i = 0; i < weights.size(); ++i) {
        weights[i] = CauchyWeight(lengths[i] * lengths[i] / (width * width));
      }
    }
  }
  return map;
}

Eigen::Vector2d PlaneMap::operator()(const Eigen::Vector2d& plane) const {
  const Eigen::Vector2d at = (plane - plane_middle_) / plane_scale_;
  const double denominator = 1 + coefficients_.tail<2>().dot(at);
  if (denominator < kLeastDenominator) {
    return Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity());
  }
  const int terms = Terms(order_);
  const auto monomials = Monomials(at, order_);
  const Eigen::Map<const Eigen::VectorXd> m(monomials.data(), terms);
  const Eigen::Vector2d image(coefficients_.head(terms).dot(m),
                              coefficients_.segment(terms, terms).dot(m));
  return image_middle_ + image_scale_ / denominator * image;
}

std::vector<double> PlaneMap::Lengths(const Pairs& pairs) const {
  std::vector<double> lengths;
  for (size_t i = 0; i < pairs.plane.size(); ++i) {
    lengths.push_back(pairs.scale[i] * ((*this)(pairs.plane[i]) - pairs.image[i]).norm());
  }
  return lengths;
}

}  // namespace plenocal
