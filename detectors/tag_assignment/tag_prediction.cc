// SPDX-License-Identifier: Apache-2.0
#include "detectors/tag_assignment/tag_prediction.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "calib/base/linear_algebra.h"

namespace plenocal {
namespace {

using internal::CentreOf;
using internal::Prediction;
using internal::Quad;
using internal::QuadPoints;
using internal::Side;

/// A square's own plane, in sides from its centre.
class SquarePlane {
 public:
  explicit SquarePlane(const QuadPoints& square)
      : centre_((square[0] + square[1] + square[2] + square[3]) / 4),
        side_((square[1] - square[0]).norm()),
        e_x_((square[1] - square[0]) / side_),
        normal_((square[1] - square[0]).cross(square[3] - square[0]).normalized()),
        e_y_(normal_.cross(e_x_)) {}

  Eigen::Vector2d operator()(const Eigen::Vector3d& p) const {
    return Eigen::Vector2d(e_x_.dot(p - centre_), e_y_.dot(p - centre_)) / side_;
  }
  /// From this square to another one, in sides; nothing when that is not in its plane.
  [[nodiscard]] std::optional<double> DistanceTo(const QuadPoints& other) const {
    double off_plane = 0;
    for (const auto& p : other) {
      off_plane = std::max(off_plane, std::abs(normal_.dot(p - centre_)));
    }
    const double away = (other[0] + other[2] - 2 * centre_).norm() / 2 / side_;
    // A tenth of the way, so that a bent board still counts as one plane.
    if (off_plane / side_ < 0.25 + 0.1 * away) return away;
    return std::nullopt;
  }

 private:
  Eigen::Vector3d centre_;
  double side_;
  Eigen::Vector3d e_x_, normal_, e_y_;
};

using Neighbour = std::pair<double, int>;  // distance, id

/// Up to four, in the square's plane, the nearest first.
std::vector<Neighbour> FindNeighbours(const std::map<int, QuadPoints>& target,
                                      int id,
                                      const std::map<int, Quad>& found) {
  // Few and near, so that lens distortion and a bent target matter little.
  constexpr std::size_t kNeighbours = 4;
  const SquarePlane plane(target.at(id));
  std::vector<Neighbour> neighbours;
  for (const auto& [other, corners] : found) {
    if (other == id) continue;
    if (const auto away = plane.DistanceTo(target.at(other))) neighbours.emplace_back(*away, other);
  }
  std::sort(neighbours.begin(), neighbours.end());
  neighbours.resize(std::min(neighbours.size(), kNeighbours));
  return neighbours;
}

/// By the homography of these squares.
std::optional<Prediction> PredictBy(const std::map<int, QuadPoints>& target,
                                    int id,
                                    const std::map<int, Quad>& found,
                                    const std::vector<Neighbour>& neighbours) {
  const SquarePlane on_plane(target.at(id));
  Eigen::Vector2d middle(0, 0);
  for (const auto& [away, other] : neighbours) {
    middle += CentreOf(found.at(other)) / static_cast<double>(neighbours.size());
  }
  const double scale = Side(found.at(neighbours[0].second));
  Eigen::MatrixXd rows(8 * neighbours.size(), 9);
  int row = 0;
  for (const auto& [away, other] : neighbours) {
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::RowVector3d x = on_plane(target.at(other)[k]).homogeneous().transpose();
      const Eigen::Vector2d u = (found.at(other)[k] - middle) / scale;
      rows.row(row++) << x, Eigen::RowVector3d::Zero(), -u.x() * x;
      rows.row(row++) << Eigen::RowVector3d::Zero(), x, -u.y() * x;
    }
  }
  const Eigen::MatrixXd square = rows.transpose() * rows;
  const Eigen::VectorXd h = DecomposeSymmetric(square).vectors.col(0);
  const Eigen::Matrix3d H =
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(h.data());
  const double front = H.row(2) * on_plane(target.at(neighbours[0].second)[0]).homogeneous();
  Prediction prediction;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d at = H * on_plane(target.at(id)[k]).homogeneous();
    if (at.z() * front <= 0) return std::nullopt;
    prediction.corners[k] = at.hnormalized() * scale + middle;
  }
  prediction.distance = neighbours[0].first;
  prediction.neighbours = neighbours.size();
  return prediction;
}

}  // namespace

Eigen::Vector2d internal::CentreOf(const Quad& q) { return (q[0] + q[1] + q[2] + q[3]) / 4; }

double internal::Side(const Quad& q) {
  double sum = 0;
  for (std::size_t k = 0; k < 4; ++k) sum += (q[(k + 1) % 4] - q[k]).norm();
  return sum / 4;
}

bool internal::Convex(const Quad& q) {
  int left = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector2d a = q[(k + 1) % 4] - q[k], b = q[(k + 2) % 4] - q[(k + 1) % 4];
    left += a.x() * b.y() > a.y() * b.x();
  }
  return left == 0 || left == 4;
}

std::optional<internal::Prediction> internal::Predict(const std::map<int, QuadPoints>& target,
                                                      int id,
                                                      const std::map<int, Quad>& found,
                                                      Neighbours which) {
  constexpr double kAsNear = 1.6;  // the next squares of a grid, across its corners too
  std::vector<Neighbour> neighbours = FindNeighbours(target, id, found);
  if (neighbours.empty()) return std::nullopt;
  if (which == Neighbours::kNearest) {
    const double limit = kAsNear * neighbours[0].first;
    std::erase_if(neighbours, [&](const auto& neighbour) { return neighbour.first > limit; });
  }
  return PredictBy(target, id, found, neighbours);
}

std::optional<internal::Prediction> internal::Smooth(const std::map<int, QuadPoints>& target,
                                                     int id,
                                                     const std::map<int, Quad>& found) {
  std::vector<Neighbour> squares = FindNeighbours(target, id, found);
  squares.insert(squares.begin(), {0.0, id});
  return PredictBy(target, id, found, squares);
}

}  // namespace plenocal
