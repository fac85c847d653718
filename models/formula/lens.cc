// SPDX-License-Identifier: Apache-2.0
#include "models/formula/lens.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <utility>

#include "calib/base/invert_map.h"
#include "models/formula/derivative.h"

namespace plenocal::formula {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kLastStep = 1e-9;  // its square, the error after it, is rounding

std::vector<int> Joined(std::initializer_list<std::vector<int>> lists) {
  std::vector<int> all;
  for (const std::vector<int>& list : lists) all.insert(all.end(), list.begin(), list.end());
  return all;
}

// Remembers, in each thread, how far the domain reaches for the last parameters.
class DomainEdge {
 public:
  template <typename Find>
  double Get(const double* k, size_t count, const Find& find) const {
    constexpr size_t kKept = 8;  // cameras of a rig take turns
    struct Known {
      size_t lens = 0;
      std::vector<double> k;
      double edge = 0;
    };
    thread_local std::array<Known, kKept> known;
    thread_local size_t next = 0;
    for (const Known& one : known) {
      if (one.lens == lens_ && std::equal(k, k + count, one.k.begin(), one.k.end()))
        return one.edge;
    }
    const double edge = find();
    known[next] = {lens_, {k, k + count}, edge};
    next = (next + 1) % kKept;
    return edge;
  }

 private:
  static size_t NewNumber() {
    static std::atomic<size_t> last = 0;
    return ++last;
  }
  size_t lens_ = NewNumber();
};

// The place in `starts`, nearest first, from which `solve` succeeds.
template <typename Solve>
auto SolveFromNearest(const std::vector<std::pair<double, Eigen::Vector2d>>& starts,
                      const Solve& solve) -> decltype(solve(Eigen::Vector2d())) {
  constexpr size_t kTried = 6;
  std::vector<size_t> order(starts.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::ranges::sort(order, {}, [&](size_t i) { return starts[i].first; });
  for (size_t i = 0; i < std::min(kTried, order.size()); ++i) {
    if (auto solved = solve(starts[order[i]].second)) return solved;
  }
  return std::nullopt;
}

// 8 x 8 places of the plane, denser in the middle; their radii are 2 tan(angle / 2).
Eigen::Vector2d StartPlace(size_t i, double azimuth) {
  const double part = static_cast<double>(i / 8) / 8;
  const double radius = 2 * std::tan(0.475 * kPi * part * part);
  azimuth += static_cast<double>(i % 8) * kPi / 4;
  return {radius * std::cos(azimuth), radius * std::sin(azimuth)};
}

// Of `kBlock` steps from the axis the number that are inside at all azimuths, less a margin.
template <typename StepsAt>
size_t ClearSteps(const StepsAt& steps_at) {
  constexpr int kAzimuths = 16;
  constexpr size_t kMargin = 2;
  size_t steps = kBlock;
  for (int i = 0; i < kAzimuths; ++i) steps = std::min(steps, steps_at(2 * kPi * i / kAzimuths));
  return steps > kMargin ? steps - kMargin : 0;
}

class RadiusLens : public LensFormula {
 public:
  explicit RadiusLens(LensNodes nodes) : count_(nodes.param_count), of_angle_(nodes.of_angle) {
    const auto by = [&](size_t begin, size_t end) {
      return DerivativesBy(&nodes.graph, nodes.outputs, begin, end);
    };
    const std::vector<int> radius = Joined({nodes.outputs, by(0, 1)});
    radius_ = Tape(nodes.graph, nodes.outputs, 1);
    value_ = Tape(nodes.graph, radius, 1);
    domain_ = Tape(nodes.graph, Joined({radius, nodes.conditions}), 1);
    conditions_ = nodes.conditions.size();
    all_ = Tape(nodes.graph, Joined({radius, by(1, 1 + count_)}), 1);
  }

  void Map(const double* k, Need need, LensBlock* block) const override {
    const double *const X = block->p.data(), *const Y = X + kBlock, *const Z = Y + kBlock;
    constexpr double kOnAxis = 1e-140;  // its square has few digits
    const double edge = Edge(k);
    std::array<double, kBlock> variable, r;
    bool slopes = need != Need::kValue;
    for (size_t i = 0; i < block->count; ++i) {
      r[i] = std::sqrt(X[i] * X[i] + Y[i] * Y[i]);
      slopes = slopes || r[i] < kOnAxis;
      variable[i] = of_angle_ ? std::atan2(r[i], Z[i]) : r[i] / Z[i];
      block->inside[i] = (Z[i] > 0 || (of_angle_ && r[i] >= kOnAxis)) && variable[i] < edge;
    }
    const Tape& tape = need == Need::kAll ? all_ : slopes ? value_ : radius_;
    const auto values = tape.Evaluate(variable.data(), k, block->count);
    for (size_t i = 0; i < block->count; ++i) {
      const double slope = slopes ? values[1][i] : 0;
      const bool on_axis = r[i] < kOnAxis;
      const double gain = on_axis ? slope / Z[i] : values[0][i] / r[i];
      block->m[i] = X[i] * gain;
      block->m[kBlock + i] = Y[i] * gain;
      if (need == Need::kValue) continue;
      const double d2 = r[i] * r[i] + Z[i] * Z[i];
      const double by_r = slope * (of_angle_ ? Z[i] / d2 : 1 / Z[i]);
      const double by_z = -slope * (of_angle_ ? r[i] / d2 : r[i] / (Z[i] * Z[i]));
      const double c = on_axis ? 1 : X[i] / r[i], s = on_axis ? 0 : Y[i] / r[i];
      double* const J = block->by_p.data() + i;
      J[0] = by_r * c * c + gain * s * s;
      J[kBlock] = J[3 * kBlock] = (by_r - gain) * c * s;
      J[2 * kBlock] = by_z * c;
      J[4 * kBlock] = by_r * s * s + gain * c * c;
      J[5 * kBlock] = by_z * s;
      if (need == Need::kPoint) continue;
      for (size_t j = 0; j < count_; ++j) {
        block->by_k[j * kBlock + i] = values[2 + j][i] * c;
        block->by_k[(count_ + j) * kBlock + i] = values[2 + j][i] * s;
      }
    }
  }

  [[nodiscard]] std::optional<Eigen::Vector3d> Unmap(const double* k,
                                                     const Eigen::Vector2d& m) const override {
    const double radius = m.norm();
    if (radius == 0) return Eigen::Vector3d::UnitZ();
    const std::optional<double> variable = Invert(k, radius);
    if (!variable) return std::nullopt;
    const Eigen::Vector2d sides = m / radius * (of_angle_ ? std::sin(*variable) : *variable);
    return Eigen::Vector3d(sides.x(), sides.y(), of_angle_ ? std::cos(*variable) : 1);
  }

 private:
  [[nodiscard]] double Variable(double angle) const { return of_angle_ ? angle : std::tan(angle); }

  // The first of up to `kBlock` values at which the radius does not grow, or their number.
  size_t FirstOutside(const double* k, const double* variables, size_t count) const {
    const auto values = domain_.Evaluate(variables, k, count);
    for (size_t i = 0; i < count; ++i) {
      bool inside = std::isfinite(values[0][i]) && values[1][i] > 0;
      for (size_t j = 0; j < conditions_; ++j) inside = inside && values[2 + j][i] != 0;
      if (!inside) return i;
    }
    return count;
  }

  double Edge(const double* k) const {
    return edge_.Get(k, count_, [&] { return FindEdge(k); });
  }
  // The smallest value at which the radius does not grow.
  double FindEdge(const double* k) const {
    constexpr size_t kScan = 4 * kBlock;
    std::array<double, kBlock> places{};
    if (FirstOutside(k, places.data(), 1) == 0) return 0;
    double inside = 0, outside = kInfinity;
    for (size_t block = 0; block < kScan / kBlock && outside == kInfinity; ++block) {
      for (size_t i = 0; i < kBlock; ++i) {
        const auto part = static_cast<double>(block * kBlock + i + 1);
        places[i] = of_angle_ ? kPi * part / kScan : std::tan(kPi / 2 * part / (kScan + 0.5));
      }
      const size_t first = FirstOutside(k, places.data(), kBlock);
      if (first > 0) inside = places[first - 1];
      if (first < kBlock) outside = places[first];
    }
    if (outside == kInfinity) return outside;
    constexpr int kRounds = 12;  // 64^12 is beyond a number's digits
    for (int round = 0; round < kRounds && std::nextafter(inside, outside) < outside; ++round) {
      for (size_t i = 0; i < kBlock; ++i) {
        places[i] = inside + (outside - inside) * static_cast<double>(i + 1) / (kBlock + 1);
      }
      const size_t first = FirstOutside(k, places.data(), kBlock);
      if (first > 0) inside = places[first - 1];
      if (first < kBlock) outside = places[first];
    }
    return outside;
  }

  // Values between 0 and the edge bracket the solution, then Newton's method.
  std::optional<double> Invert(const double* k, double radius) const {
    constexpr double kLargest = 1e4;  // 89.99 degrees off the axis
    double last = Edge(k);
    if (last == kInfinity) last = of_angle_ ? kPi : kLargest;
    const double top = of_angle_ ? last : std::atan(last);
    std::array<double, kBlock> places;
    for (size_t i = 0; i < kBlock; ++i) {
      places[i] = Variable(top * static_cast<double>(i + 1) / kBlock);
    }
    places.back() = last;
    const auto values = value_.Evaluate(places.data(), k, kBlock);
    const size_t next = static_cast<size_t>(
        std::find_if(values[0], values[0] + kBlock, [&](double r) { return r >= radius; }) -
        values[0]);
    if (next == kBlock) return std::nullopt;
    double low = next == 0 ? 0 : places[next - 1], high = places[next],
           at = std::midpoint(low, high);
    constexpr int kSteps = 200;
    for (int i = 0; i < kSteps; ++i) {
      const auto here = value_.Evaluate(&at, k, 1);
      const double step = (radius - here[0][0]) / here[1][0];
      (here[0][0] < radius ? low : high) = at;
      if (std::abs(step) <= kLastStep * at) return std::clamp(at + step, low, high);
      at = at + step > low && at + step < high ? at + step : std::midpoint(low, high);
      if (!(high - low > std::numeric_limits<double>::epsilon() * high)) return at;
    }
    return std::nullopt;
  }

  size_t count_ = 0, conditions_ = 0;
  bool of_angle_ = true;
  Tape radius_, value_, domain_, all_;
  DomainEdge edge_;
};

class MapLens : public LensFormula {
 public:
  explicit MapLens(LensNodes nodes)
      : count_(nodes.param_count),
        conditions_(nodes.conditions.size()),
        has_unmap_(!nodes.unmap.empty()) {
    const auto by = [&](size_t begin, size_t end) {
      return DerivativesBy(&nodes.graph, nodes.outputs, begin, end);
    };
    const std::vector<int> by_p = by(0, 3), by_k = by(3, 3 + count_);
    value_ = Tape(nodes.graph, Joined({nodes.outputs, nodes.conditions}), 3);
    point_ = Tape(nodes.graph, Joined({nodes.outputs, nodes.conditions, by_p}), 3);
    all_ = Tape(nodes.graph, Joined({nodes.outputs, nodes.conditions, by_p, by_k}), 3);
    if (has_unmap_) unmap_ = Tape(nodes.graph, nodes.unmap, 3);
  }

  void Map(const double* k, Need need, LensBlock* block) const override {
    const double reach = conditions_ > 0 ? -1 : std::cos(Reach(k));
    Evaluate(k, need, /*tests_turn=*/false, block);
    for (size_t i = 0; conditions_ == 0 && i < block->count; ++i) {
      const Eigen::Vector3d p(block->p[i], block->p[kBlock + i], block->p[2 * kBlock + i]);
      // The values have been copied.
      if (block->inside[i] && p.z() < reach * p.norm()) block->inside[i] = IsClearTo(k, p);
    }
  }

  [[nodiscard]] std::optional<Eigen::Vector3d> Unmap(const double* k,
                                                     const Eigen::Vector2d& m) const override {
    if (!m.allFinite()) return std::nullopt;
    if (has_unmap_) return ByFormula(k, m);
    if (auto direction = SolveFrom(k, m, m)) return direction;
    LensBlock block;
    block.count = kBlock;
    const double azimuth = std::atan2(m.y(), m.x());
    for (size_t i = 0; i < kBlock; ++i) Put(FromPlane(StartPlace(i, azimuth)), i, &block);
    Map(k, Need::kValue, &block);
    std::vector<std::pair<double, Eigen::Vector2d>> starts;
    for (size_t i = 0; i < kBlock; ++i) {
      if (!block.inside[i]) continue;
      starts.emplace_back((Eigen::Vector2d(block.m[i], block.m[kBlock + i]) - m).norm(),
                          StartPlace(i, azimuth));
    }
    return SolveFromNearest(starts, [&](const Eigen::Vector2d& u) { return SolveFrom(k, m, u); });
  }

 private:
  // Stereographic coordinates reach all directions but straight behind.
  static Eigen::Vector3d FromPlane(const Eigen::Vector2d& u) {
    return {u.x(), u.y(), 1 - u.squaredNorm() / 4};
  }
  static double Put(const Eigen::Vector3d& p, size_t i, LensBlock* block) {
    const double size = p.cwiseAbs().maxCoeff();
    for (Eigen::Index j = 0; j < 3; ++j)
      block->p[static_cast<size_t>(j) * kBlock + i] = p[j] / size;
    return size;
  }

  // m and its derivatives; inside are points with finite values that obey the conditions and, with
  // `tests_turn`, where the map keeps its orientation.
  void Evaluate(const double* k, Need need, bool tests_turn, LensBlock* block) const {
    const bool slopes = need != Need::kValue || tests_turn;
    const Tape& tape = need == Need::kAll ? all_ : slopes ? point_ : value_;
    const auto values = tape.Evaluate(block->p.data(), k, block->count);
    const size_t first = 2 + conditions_;
    for (size_t i = 0; i < block->count; ++i) {
      bool inside = std::isfinite(values[0][i]) && std::isfinite(values[1][i]);
      for (size_t j = 0; j < conditions_; ++j) inside = inside && values[2 + j][i] != 0;
      if (tests_turn) {
        const auto by_p = [&](size_t row) {
          return Eigen::Vector3d(values[first + 3 * row][i],
                                 values[first + 3 * row + 1][i],
                                 values[first + 3 * row + 2][i]);
        };
        const Eigen::Vector3d p(block->p[i], block->p[kBlock + i], block->p[2 * kBlock + i]);
        inside = inside && by_p(0).cross(by_p(1)).dot(p) > 0;
      }
      block->inside[i] = inside;
    }
    for (size_t j = 0; j < 2; ++j) {
      std::copy_n(values[j], block->count, block->m.data() + j * kBlock);
    }
    if (need == Need::kValue) return;
    for (size_t j = 0; j < 6; ++j) {
      std::copy_n(values[first + j], block->count, block->by_p.data() + j * kBlock);
    }
    if (need == Need::kPoint) return;
    for (size_t j = 0; j < 2 * count_; ++j) {
      std::copy_n(values[first + 6 + j], block->count, block->by_k + j * kBlock);
    }
  }

  // The number of steps from the axis that are inside.
  size_t StepsInside(const double* k, double angle, double azimuth) const {
    LensBlock block;
    block.count = kBlock;
    for (size_t i = 0; i < kBlock; ++i) {
      const double theta = angle * static_cast<double>(i + 1) / kBlock;
      Put({std::sin(theta) * std::cos(azimuth),
           std::sin(theta) * std::sin(azimuth),
           std::cos(theta)},
          i,
          &block);
    }
    Evaluate(k, Need::kValue, /*tests_turn=*/true, &block);
    return static_cast<size_t>(std::ranges::find(block.inside, false) - block.inside.begin());
  }
  bool IsClearTo(const double* k, const Eigen::Vector3d& p) const {
    const double angle = std::atan2(std::hypot(p.x(), p.y()), p.z());
    return StepsInside(k, angle, std::atan2(p.y(), p.x())) == kBlock;
  }
  // The angle up to which all directions are inside, whatever their azimuth.
  double Reach(const double* k) const {
    return edge_.Get(k, count_, [&] {
      return kPi / kBlock * static_cast<double>(ClearSteps([&](double azimuth) {
               return StepsInside(k, kPi, azimuth);
             }));
    });
  }

  std::optional<Eigen::Vector3d> ByFormula(const double* k, const Eigen::Vector2d& m) const {
    std::array<double, 3 * kBlock> inputs;
    inputs[0] = m.x();
    inputs[kBlock] = m.y();
    inputs[2 * kBlock] = 0;
    const auto values = unmap_.Evaluate(inputs.data(), k, 1);
    const Eigen::Vector3d p(values[0][0], values[1][0], values[2][0]);
    if (!p.allFinite() || !(p.norm() > 0)) return std::nullopt;
    LensBlock block;
    block.count = 1;
    Put(p, 0, &block);
    Map(k, Need::kValue, &block);
    constexpr double kSame = 1e-6;  // another root of the equations lies elsewhere
    const bool same =
        (Eigen::Vector2d(block.m[0], block.m[kBlock]) - m).norm() <= kSame * (1 + m.norm());
    if (!block.inside[0] || !same) return std::nullopt;
    return p;
  }

  std::optional<Eigen::Vector3d> SolveFrom(const double* k,
                                           const Eigen::Vector2d& m,
                                           const Eigen::Vector2d& start) const {
    LensBlock block;
    block.count = 1;
    const auto map = [&](const Eigen::Vector2d& u, Eigen::Vector2d* image, Eigen::Matrix2d* slope) {
      const double size = Put(FromPlane(u), 0, &block);
      Map(k, Need::kPoint, &block);
      *image = {block.m[0], block.m[kBlock]};
      for (Eigen::Index row = 0; row < 2; ++row) {
        const double* const J = block.by_p.data() + 3 * static_cast<size_t>(row) * kBlock;
        for (Eigen::Index i = 0; i < 2; ++i) {
          (*slope)(row, i) = (J[static_cast<size_t>(i) * kBlock] - u[i] / 2 * J[2 * kBlock]) / size;
        }
      }
      return block.inside[0];
    };
    const auto u = InvertMap(map, m, start, kLastStep * (1 + start.norm()));
    if (!u) return std::nullopt;
    return FromPlane(*u);
  }

  size_t count_ = 0, conditions_ = 0;
  bool has_unmap_ = false;
  Tape value_, point_, all_, unmap_;
  DomainEdge edge_;
};

class RayLens : public LensFormula {
 public:
  explicit RayLens(LensNodes nodes)
      : count_(nodes.param_count), conditions_(nodes.conditions.size()) {
    const auto by = [&](size_t begin, size_t end) {
      return DerivativesBy(&nodes.graph, nodes.outputs, begin, end);
    };
    const std::vector<int> ray = Joined({nodes.outputs, by(0, 2), nodes.conditions});
    value_ = Tape(nodes.graph, ray, 2);
    all_ = Tape(nodes.graph, Joined({ray, by(2, 2 + count_)}), 2);
  }

  // Point by point, since each is solved for.
  void Map(const double* k, Need need, LensBlock* block) const override {
    for (size_t i = 0; i < block->count; ++i) {
      const Eigen::Vector3d p(block->p[i], block->p[kBlock + i], block->p[2 * kBlock + i]);
      const std::optional<Eigen::Vector2d> m = Solve(k, p);
      block->inside[i] = m && IsInside(k, *m);
      if (!block->inside[i]) continue;
      for (size_t j = 0; j < 2; ++j) {
        block->m[j * kBlock + i] = (*m)[static_cast<Eigen::Index>(j)];
      }
      if (need != Need::kValue) Differentiate(k, p, *m, need, i, block);
    }
  }

  [[nodiscard]] std::optional<Eigen::Vector3d> Unmap(const double* k,
                                                     const Eigen::Vector2d& m) const override {
    if (!m.allFinite() || !IsInside(k, m)) return std::nullopt;
    return At(k, m).ray;
  }

 private:
  struct Place {
    Eigen::Vector3d ray;
    Eigen::Matrix<double, 3, 2> by_m;
    bool inside = false;  // the map keeps its orientation, and the conditions hold
  };
  Place PlaceOf(const Tape::Values& values, size_t i) const {
    Place place;
    for (Eigen::Index j = 0; j < 3; ++j) {
      const auto row = static_cast<size_t>(j);
      place.ray[j] = values[row][i];
      place.by_m(j, 0) = values[3 + 2 * row][i];
      place.by_m(j, 1) = values[4 + 2 * row][i];
    }
    const double turn = place.by_m.col(0).cross(place.by_m.col(1)).dot(place.ray);
    place.inside = place.ray.allFinite() && turn > 0;
    for (size_t j = 0; j < conditions_; ++j) place.inside = place.inside && values[9 + j][i] != 0;
    return place;
  }
  static Tape::Values Evaluate(const Tape& tape, const double* k, const Eigen::Vector2d& m) {
    std::array<double, kBlock + 1> inputs;
    inputs[0] = m.x();
    inputs[kBlock] = m.y();
    return tape.Evaluate(inputs.data(), k, 1);
  }
  Place At(const double* k, const Eigen::Vector2d& m) const {
    return PlaceOf(Evaluate(value_, k, m), 0);
  }

  // Of radii[0] < radii[1] < ... at one azimuth, the number before the first outside.
  size_t StepsInside(const double* k,
                     const std::array<double, kBlock>& radii,
                     double azimuth) const {
    std::array<double, 2 * kBlock> inputs;
    for (size_t i = 0; i < kBlock; ++i) {
      inputs[i] = radii[i] * std::cos(azimuth);
      inputs[kBlock + i] = radii[i] * std::sin(azimuth);
    }
    const auto values = value_.Evaluate(inputs.data(), k, kBlock);
    size_t steps = 0;
    while (steps < kBlock && PlaceOf(values, steps).inside) ++steps;
    return steps;
  }
  bool IsInside(const double* k, const Eigen::Vector2d& m) const {
    if (!At(k, m).inside) return false;
    if (m.norm() < Reach(k)) return true;
    std::array<double, kBlock> radii;
    for (size_t i = 0; i < kBlock; ++i) radii[i] = m.norm() * static_cast<double>(i + 1) / kBlock;
    return StepsInside(k, radii, std::atan2(m.y(), m.x())) >= kBlock - 1;
  }
  // The radius up to which all of the plane is inside.
  double Reach(const double* k) const {
    return edge_.Get(k, count_, [&] {
      std::array<double, kBlock> radii;
      for (size_t i = 0; i < kBlock; ++i) {
        radii[i] = 2 * std::tan(kPi / 2 * static_cast<double>(i + 1) / (kBlock + 1));
      }
      const size_t steps =
          ClearSteps([&](double azimuth) { return StepsInside(k, radii, azimuth); });
      return steps > 0 ? radii[steps - 1] : 0;
    });
  }

  // Two directions across p.
  static Eigen::Matrix<double, 2, 3> Across(const Eigen::Vector3d& p) {
    const Eigen::Vector3d first = p.unitOrthogonal();
    Eigen::Matrix<double, 2, 3> across;
    across << first.transpose(), p.normalized().cross(first).transpose();
    return across;
  }

  std::optional<Eigen::Vector2d> Solve(const double* k, const Eigen::Vector3d& p) const {
    const Eigen::Vector3d along = p.normalized();
    const Eigen::Matrix<double, 2, 3> across = Across(p);
    const auto solve = [&](const Eigen::Vector2d& start) {
      const auto map = [&](const Eigen::Vector2d& m, Eigen::Vector2d* off, Eigen::Matrix2d* slope) {
        const Place place = At(k, m);
        const double forward = along.dot(place.ray);
        *off = across * place.ray / forward;
        *slope = (across * place.by_m - *off * (along.transpose() * place.by_m)) / forward;
        return place.inside && forward > 0;
      };
      return InvertMap<2>(map, Eigen::Vector2d::Zero(), start, kLastStep * (1 + start.norm()));
    };
    const double scale = 2 / (1 + std::max(along.z(), -0.9));
    if (const auto m = solve(along.head<2>() * scale)) return m;
    std::vector<std::pair<double, Eigen::Vector2d>> starts;
    for (size_t i = 0; i < kBlock; ++i) {
      const Eigen::Vector2d start = StartPlace(i, std::atan2(p.y(), p.x()));
      const Place place = At(k, start);
      if (place.inside) starts.emplace_back(-along.dot(place.ray.normalized()), start);
    }
    return SolveFromNearest(starts, solve);
  }

  // lambda p = ray(m, k) for all p and k.
  void Differentiate(const double* k,
                     const Eigen::Vector3d& p,
                     const Eigen::Vector2d& m,
                     Need need,
                     size_t i,
                     LensBlock* block) const {
    const Eigen::Matrix<double, 2, 3> across = Across(p);
    const auto values = Evaluate(need == Need::kAll ? all_ : value_, k, m);
    const Place place = PlaceOf(values, 0);
    const Eigen::Matrix<double, 2, 3> inverse = (across * place.by_m).inverse() * across;
    const double lambda = place.ray.dot(p) / p.squaredNorm();
    for (Eigen::Index row = 0; row < 2; ++row) {
      for (Eigen::Index j = 0; j < 3; ++j) {
        block->by_p[static_cast<size_t>(3 * row + j) * kBlock + i] = lambda * inverse(row, j);
      }
    }
    if (need != Need::kAll) return;
    for (size_t j = 0; j < count_; ++j) {
      const auto of = [&](size_t row) { return values[9 + conditions_ + row * count_ + j][0]; };
      const Eigen::Vector2d by_k = -inverse * Eigen::Vector3d(of(0), of(1), of(2));
      block->by_k[j * kBlock + i] = by_k.x();
      block->by_k[(count_ + j) * kBlock + i] = by_k.y();
    }
  }

  size_t count_ = 0, conditions_ = 0;
  Tape value_, all_;
  DomainEdge edge_;
};

}  // namespace

std::vector<int> DerivativesBy(Graph* graph,
                               const std::vector<int>& outputs,
                               size_t begin,
                               size_t end) {
  std::vector<int> all(outputs.size() * (end - begin));
  for (size_t input = begin; input < end; ++input) {
    const std::vector<int> one = Derivatives(graph, outputs, static_cast<int>(input));
    for (size_t i = 0; i < one.size(); ++i) all[i * (end - begin) + input - begin] = one[i];
  }
  return all;
}

std::unique_ptr<LensFormula> MakeLens(LensNodes nodes) {
  switch (nodes.form) {
    case Form::kMap:
      return std::make_unique<MapLens>(std::move(nodes));
    case Form::kRadius:
      return std::make_unique<RadiusLens>(std::move(nodes));
    case Form::kRay:
      return std::make_unique<RayLens>(std::move(nodes));
  }
  return nullptr;
}

}  // namespace plenocal::formula
