// SPDX-License-Identifier: Apache-2.0
//
// The model of one edge. With s in [-1, 1] along the chord between the tag's two corners and t the
// distance from the chord (px), positive outside the tag, a pixel is
//
//   I(s, t) = (1 + g s) (m + k V(s, z)),   z = (t - a - b s - q s^2) / w,
//
// with the edge's curve a, b, q (px), mean level m, half contrast k, relative change of the
// illumination g, and blur w (px, standard deviation; the pixel's own area is part of it). V is 1
// outside, -1 inside the tag, and between them, with E(z) = erf(z / sqrt(2)),
//
//   V = E(z)                                              for a long edge with a wide ring,
//   otherwise V = 1 - (1 - E(z)) Q(s) - c (1 + E(z)) (1 - Q(s)) + (1 - E(z + r / w)) B(s).
//
// Q is the blurred extent of the edge (1 within, 1/2 at the corners), c is 1 if squares touch the
// corners, r is the width of the ring inside the tag (px) and B the blurred row of bits behind it,
// 1 where a bit has not the ring's colour.
//
// Raw pixels are compared with the model, so their noise is independent and the covariance of a
// least-squares fit is an honest one.
#include "detectors/tag_edges.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "calib/median.h"
#include "detectors/lanes.h"
#include "detectors/lens_bend.h"
#include "detectors/lens_curvature.h"
#include "detectors/processors.h"
#include "detectors/saddle.h"
#include "detectors/square_sums.h"
#include "detectors/tag_template.h"

namespace plenocal::internal {
namespace {

constexpr int kParameters = 7;
enum Parameter { kA, kB, kQ, kLevel, kContrast, kGradient, kBlur };
using ParameterVector = Eigen::Matrix<double, kParameters, 1>;
using ParameterMatrix = Eigen::Matrix<double, kParameters, kParameters>;

/// Pixels beside an edge, and room for what is computed for eight of them together.
struct Samples {
  std::size_t count = 0;
  std::vector<float> s, t, gray;

  void Clear() {
    count = 0;
    for (auto* values : {&s, &t, &gray}) values->clear();
  }
  void Add(double at_s, double at_t, float value) {
    s.push_back(static_cast<float>(at_s));
    t.push_back(static_cast<float>(at_t));
    gray.push_back(value);
    ++count;
  }
  void FillUp() {
    for (auto* values : {&s, &t, &gray}) values->resize((count + kLanes - 1) / kLanes * kLanes);
  }
};

struct Edge {
  Eigen::Vector2d middle, along, normal;  ///< of the chord; the normal points out of the tag
  double half_length = 0;                 ///< px
  double inside = 0, outside = 0;         ///< px, the least width of the rings of one colour
  double ring_mean = 0, ring_slope = 0;  ///< px, width of the ring inside: ring_mean + ring_slope s
  std::vector<double> bounds;            ///< s of the boundaries between the bits behind the ring
  std::vector<bool> bits;                ///< behind the ring: true where not of the ring's colour
  Eigen::Vector3d curve = Eigen::Vector3d::Zero();       ///< a, b, q
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< of a, b, q
  double odd = 0;                                        ///< px, the lens' bend in s^3
  Eigen::Vector2d p;                                     ///< the middle, as the lens counts places
  LensBends bends = LensBends::Zero();                   ///< assumed there
  Eigen::Matrix<double, 3, kBends> by_bends =            ///< of a, b, q by them, px
      Eigen::Matrix<double, 3, kBends>::Zero();
  double blur = 0;  ///< px
  bool fitted = false;

  [[nodiscard]] double Offset(double s) const {
    // Where all s are alike, a fit of a parabola takes s^3 for 3/5 s.
    return curve.dot(Eigen::Vector3d(1, s, s * s)) + odd * s * (s * s - 0.6);
  }
  [[nodiscard]] LensBends OffsetByBends(double s) const {
    return by_bends.transpose() * Eigen::Vector3d(1, s, s * s);
  }
  [[nodiscard]] double OffsetVariance(double s) const {
    const Eigen::Vector3d j(1, s, s * s);
    return j.dot(covariance * j);
  }
};

/// Samples within the band -inside < t - curve < outside and |s| < s_max.
void CollectSamples(const cv::Mat& gray,
                    const Edge& edge,
                    double inside,
                    double outside,
                    double s_max,
                    Samples* samples) {
  samples->Clear();
  const double l = edge.half_length;
  double low = edge.Offset(0), high = low;
  for (const double s : {-s_max, s_max}) {
    low = std::min(low, edge.Offset(s));
    high = std::max(high, edge.Offset(s));
  }
  low -= inside;
  high += outside;
  Eigen::Vector2d box_min(1e9, 1e9), box_max(-1e9, -1e9);
  for (const double s : {-s_max, s_max}) {
    for (const double t : {low, high}) {
      const Eigen::Vector2d p = edge.middle + s * l * edge.along + t * edge.normal;
      box_min = box_min.cwiseMin(p);
      box_max = box_max.cwiseMax(p);
    }
  }
  const int y_first = std::max(0, static_cast<int>(std::ceil(box_min.y())));
  const int y_last = std::min(gray.rows - 1, static_cast<int>(std::floor(box_max.y())));
  for (int y = y_first; y <= y_last; ++y) {
    // The row's part with |s| <= s_max and low <= t <= high.
    double x_first = std::max(0.0, box_min.x()), x_last = std::min(gray.cols - 1.0, box_max.x());
    const auto clip = [&](double slope, double at_zero, double from, double to) {
      if (std::abs(slope) < 1e-9) return;
      double x_0 = (from - at_zero) / slope, x_1 = (to - at_zero) / slope;
      if (x_0 > x_1) std::swap(x_0, x_1);
      x_first = std::max(x_first, x_0);
      x_last = std::min(x_last, x_1);
    };
    const Eigen::Vector2d from_middle(-edge.middle.x(), y - edge.middle.y());
    const double s_at_zero = from_middle.dot(edge.along) / l, s_slope = edge.along.x() / l;
    const double t_at_zero = from_middle.dot(edge.normal), t_slope = edge.normal.x();
    clip(s_slope, s_at_zero, -s_max, s_max);
    clip(t_slope, t_at_zero, low, high);
    const auto* row = gray.ptr<unsigned char>(y);
    for (int x = static_cast<int>(std::ceil(x_first)); x <= x_last; ++x) {
      const double s = s_at_zero + s_slope * x, t = t_at_zero + t_slope * x;
      const double from_curve = t - edge.Offset(s);
      if (std::abs(s) > s_max || from_curve < -inside || from_curve > outside) continue;
      samples->Add(s, t, row[x]);
    }
  }
  samples->FillUp();
}

/// Q(s) and B(s) of the model.
class Surroundings {
 public:
  /// `bounds`: s of the boundaries between the bits behind the ring; `bits`: of the row behind it.
  Surroundings(const std::vector<double>& bounds, const std::vector<bool>& bits, double blur_s) {
    for (int i = 0; i <= kSize; ++i) {
      const double s = 2.0 * i / kSize - 1;
      extent_[i] = static_cast<float>(Between(s, -1, 1, blur_s));
      double behind = 0;
      for (std::size_t j = 0; j < bits.size(); ++j) {
        if (bits[j]) behind += Between(s, bounds[j], bounds[j + 1], blur_s);
      }
      behind_[i] = static_cast<float>(behind);
    }
  }
  PLENOCAL_LANES void At(const Lanes& s, Lanes* extent, Lanes* behind) const {
    Lanes at = (s + 1) * kMiddle;
    at = at > 0 ? at : Lanes{};
    at = at < kSize - 1 ? at : Lanes{} + (kSize - 1);
    const IntLanes i = __builtin_convertvector(at, IntLanes);
    Lanes extent_next, behind_next;
    for (int l = 0; l < kLanes; ++l) {
      (*extent)[l] = extent_[i[l]];
      (*behind)[l] = behind_[i[l]];
      extent_next[l] = extent_[i[l] + 1];
      behind_next[l] = behind_[i[l] + 1];
    }
    const Lanes f = at - __builtin_convertvector(i, Lanes);
    *extent += f * (extent_next - *extent);
    *behind += f * (behind_next - *behind);
  }

 private:
  static double Between(double s, double from, double to, double blur) {
    return (std::erf((s - from) / blur * M_SQRT1_2) - std::erf((s - to) / blur * M_SQRT1_2)) / 2;
  }
  static constexpr int kSize = 128, kMiddle = kSize / 2;
  std::array<float, kSize + 1> extent_, behind_;
};

/// The sum of j j^T over the samples within `limit`, j being the derivatives of the model by its
/// parameters, then the residual.
constexpr int kResidual = kParameters;
constexpr int kPadded = 9;  // for AddSquares
using Sums = Eigen::Matrix<double, kPadded, kPadded>;

/// What the model is at the samples beside its parameters.
struct Setting {
  float ring_mean = 0, ring_slope = 0;
  float squares = 0;  ///< c of the model
  const Surroundings* around = nullptr;
};

constexpr int kBlock = 32;  // of eight samples

/// The columns j, `kBlock` apart, zero beyond `limit`, and the residuals of 8 * `count` samples
/// from number `from` on.
PLENOCAL_FOR_EACH_PROCESSOR
void Differentiate(const Eigen::Matrix<float, kParameters, 1>& p,
                   const Setting& setting,
                   float limit,
                   const Samples& samples,
                   std::size_t from,
                   int count,
                   Lanes* rows,
                   float* residuals) {
  const float inverse_blur = 1 / p[kBlur];
  for (int i = 0; i < count; ++i) {
    const std::size_t first = from + static_cast<std::size_t>(kLanes * i);
    Lanes s, t, gray, known;
    for (int l = 0; l < kLanes; ++l) {
      s[l] = samples.s[first + l];
      t[l] = samples.t[first + l];
      gray[l] = samples.gray[first + l];
      known[l] = first + l < samples.count ? 1.f : 0.f;
    }
    const Lanes z = (t - p[kA] - s * (p[kB] + s * p[kQ])) * inverse_blur;
    Lanes below, density;
    Normal(z, &below, &density);
    Lanes value = 2 * below - 1, slope = 2 * density;
    Lanes slope_z = slope * z;
    if (setting.around != nullptr) {
      Lanes extent, behind;
      setting.around->At(s, &extent, &behind);
      const Lanes z_behind = z + (setting.ring_mean + s * setting.ring_slope) * inverse_blur;
      Normal(z_behind, &below, &density);
      value = 1 - (1 - value) * extent - setting.squares * (1 + value) * (1 - extent) +
              2 * (1 - below) * behind;
      const Lanes own = extent - setting.squares * (1 - extent);
      slope_z = slope_z * own - 2 * density * z_behind * behind;
      slope = slope * own - 2 * density * behind;
    }
    const Lanes light = 1 + p[kGradient] * s;
    const Lanes level = p[kLevel] + p[kContrast] * value;
    const Lanes residual = gray - light * level;
    const Lanes size = residual < 0 ? -residual : residual;
    for (int l = 0; l < kLanes; ++l) residuals[kLanes * i + l] = size[l];
    const Lanes counts = size <= limit ? known : Lanes{};
    const Lanes d = -counts * light * p[kContrast] * inverse_blur;
    Lanes* j = rows + i;
    j[kA * kBlock] = d * slope;
    j[kB * kBlock] = d * slope * s;
    j[kQ * kBlock] = d * slope * s * s;
    j[kLevel * kBlock] = counts * light;
    j[kContrast * kBlock] = counts * light * value;
    j[kGradient * kBlock] = counts * s * level;
    j[kBlur * kBlock] = d * slope_z;
    j[kResidual * kBlock] = counts * residual;
  }
}

Sums Linearise(const ParameterVector& p,
               const Setting& setting,
               float limit,
               const Samples& samples,
               std::vector<float>* residuals) {
  Lanes block[kPadded * kBlock] = {};
  Sums sums = Sums::Zero();
  residuals->resize(samples.s.size());
  for (std::size_t from = 0; from < samples.count; from += kLanes * kBlock) {
    const auto count =
        static_cast<int>(std::min<std::size_t>((samples.s.size() - from) / kLanes, kBlock));
    Differentiate(
        p.cast<float>(), setting, limit, samples, from, count, block, residuals->data() + from);
    AddSquares(block, kPadded, kBlock, count, sums.data());
  }
  residuals->resize(samples.count);
  sums.triangularView<Eigen::StrictlyUpper>() = sums.transpose();
  return sums;
}

double MedianAbsolute(std::vector<float>* values) {
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

/// Where a ring is narrower than this many blurs, an edge cannot be told from the next one.
constexpr double kNarrow = 3.5;
/// px; the outer edges of a larger tag measure it well enough, all its edges would take long.
constexpr double kSmall = 64;
constexpr double kUsualBlur = 0.8;  // px, of a lens in focus; where the fits start

struct Workspace {
  Samples samples;
  std::vector<float> residuals;
};

void FitEdge(const cv::Mat& gray, bool corner_squares, Edge* edge, Workspace* work) {
  constexpr double kMinimalBlur = 0.29;  // of the pixel's own area: 1 / sqrt(12)
  double blur = kUsualBlur;
  ParameterVector p = ParameterVector::Zero();
  float limit = std::numeric_limits<float>::infinity();
  for (int round = 0; round < 2; ++round) {
    // Three standard deviations of the blur show the whole step.
    const double reach = 3 * blur + 0.5;
    const double inside = std::min(edge->inside, reach);
    const double outside = std::min(std::max(edge->outside - 2 * blur, 0.4 * edge->outside), reach);
    const double ends = std::min(2.5 * blur, 0.25 * edge->half_length * 2);
    const double s_max = 1 - ends / edge->half_length;
    CollectSamples(gray, *edge, inside, outside, s_max, &work->samples);
    const Samples& samples = work->samples;
    if (samples.count < 3 * kParameters) return;
    if (round == 0) {
      double sum[2] = {0, 0};
      int count[2] = {0, 0};
      for (std::size_t i = 0; i < samples.count; ++i) {
        const int side = samples.t[i] > 0;
        sum[side] += samples.gray[i];
        ++count[side];
      }
      if (count[0] == 0 || count[1] == 0) return;
      const double in = sum[0] / count[0], out = sum[1] / count[1];
      p[kLevel] = (in + out) / 2;
      p[kContrast] = (out - in) / 2;
      p[kBlur] = blur;
    }
    // What the long edge with a wide ring leaves out counts when it is within three blurs.
    std::optional<Surroundings> around;
    if (edge->inside - inside < 3 * blur || ends < 2.5 * blur) {
      around.emplace(edge->bounds, edge->bits, blur / edge->half_length);
    }
    const Setting setting{static_cast<float>(edge->ring_mean),
                          static_cast<float>(edge->ring_slope),
                          corner_squares ? 1.f : 0.f,
                          around ? &*around : nullptr};
    Sums sums;
    ParameterMatrix information;
    for (int iteration = 0; iteration < 6; ++iteration) {
      sums = Linearise(p, setting, limit, samples, &work->residuals);
      information = sums.topLeftCorner<kParameters, kParameters>();
      ParameterMatrix damped = information;
      damped.diagonal() *= 1 + 1e-6;
      const ParameterVector step = damped.ldlt().solve(sums.col(kResidual).head<kParameters>());
      if (!step.allFinite()) return;
      p += step;
      p[kBlur] = std::clamp(p[kBlur], kMinimalBlur, 5.0);
      // Farther off, it may be the ring's other edge.
      if (p.head<3>().cwiseAbs().maxCoeff() > std::max(edge->inside, 1.0)) return;
      // Gauss-Newton's next step would be of the order of this one's square.
      if (step.head<3>().cwiseAbs().maxCoeff() < 0.02) break;
    }
    const auto used = std::count_if(
        work->residuals.begin(), work->residuals.end(), [&](float r) { return r <= limit; });
    if (used <= 2 * kParameters) return;
    const double variance = sums(kResidual, kResidual) / static_cast<double>(used - kParameters);
    // Of normal noise one sample in 16,000 is beyond four standard deviations.
    constexpr double kSigmaPerMedian = 1.4826;
    const float largest = *std::max_element(work->residuals.begin(), work->residuals.end());
    limit = static_cast<float>(4 * kSigmaPerMedian * MedianAbsolute(&work->residuals));
    const Eigen::LDLT<ParameterMatrix> solver(information);
    const ParameterMatrix inverse = solver.solve(ParameterMatrix::Identity());
    edge->curve = p.head<3>();
    edge->covariance = variance * inverse.topLeftCorner<3, 3>();
    edge->blur = p[kBlur];
    // The samples for this blur would be nearly the same.
    constexpr double kSameBlur = 0.25;
    if (largest <= limit && std::abs(edge->blur - blur) < kSameBlur * blur) break;
    blur = edge->blur;
  }
  edge->fitted = edge->covariance.allFinite() && edge->covariance(0, 0) > 0;
}

/// Given the curve's estimate with q free, the estimate with the lens' bend.
void BendByLens(const LensCurvature& lens, const Eigen::Vector2d& image_size, Edge* edge) {
  const Eigen::Vector2d half = edge->half_length * edge->along;
  const LensBend bend(edge->middle, image_size);
  const LensBends of_edge = half.squaredNorm() * bend.OfEdge(half, edge->normal);  // at s = 1
  const Eigen::Vector3d gain =
      edge->covariance.col(2) / (edge->covariance(2, 2) + lens.Variance(bend.p(), of_edge));
  edge->p = bend.p();
  edge->bends = lens.At(edge->p);
  edge->curve += gain * (of_edge.dot(edge->bends) - edge->curve[2]);
  edge->covariance -= gain * edge->covariance.row(2).eval();
  edge->by_bends = gain * of_edge.transpose();
  edge->odd = edge->normal.dot((bend.At(half) - bend.At(-half)) * edge->bends) / 2;
}

/// What edges say about the lens.
void ReadEdges(std::span<const Edge> edges,
               const Eigen::Vector2d& image_size,
               std::vector<LensReading>* readings) {
  for (const Edge& edge : edges) {
    if (!edge.fitted) continue;
    const Eigen::Vector2d half = edge.half_length * edge.along;
    const LensBend bend(edge.middle, image_size);
    const LensBends of_edge = half.squaredNorm() * bend.OfEdge(half, edge.normal);
    const double size = of_edge.norm();
    readings->push_back(
        {bend.p(), of_edge / size, edge.curve[2] / size, edge.covariance(2, 2) / (size * size)});
  }
}

/// The edge from corner `side` to the next one, before it is fitted.
Edge MakeEdge(const SeenTag& tag, int side, const TagBorder& border) {
  const Eigen::Matrix3d h = UnitSquareHomography(tag.corners);
  // The image of a point `along` the edge and `depth` inside the tag, both from 0 to 1.
  const auto point = [&](double along, double depth) -> Eigen::Vector2d {
    const std::array<Eigen::Vector3d, 4> on_tag{Eigen::Vector3d(along, depth, 1),
                                                Eigen::Vector3d(1 - depth, along, 1),
                                                Eigen::Vector3d(1 - along, 1 - depth, 1),
                                                Eigen::Vector3d(depth, 1 - along, 1)};
    return (h * on_tag[static_cast<std::size_t>(side)]).hnormalized();
  };
  const Eigen::Vector2d from = point(0, 0), to = point(1, 0);
  const double bit = 1.0 / border.width, outside = bit * border.outside, ring = border.ring * bit;
  Edge edge;
  edge.middle = (from + to) / 2;
  edge.half_length = (to - from).norm() / 2;
  edge.along = (to - from).normalized();
  edge.normal = {edge.along.y(), -edge.along.x()};
  if (edge.normal.dot(point(.5, .5) - edge.middle) > 0) edge.normal = -edge.normal;
  const auto distance = [&](double along, double depth) {
    return std::abs(edge.normal.dot(point(along, depth) - edge.middle));
  };
  const double ring_from = distance(0, ring), ring_to = distance(1, ring);
  edge.inside = std::min(ring_from, ring_to);
  edge.outside = std::min(distance(0, -outside), distance(1, -outside));
  edge.ring_mean = (ring_from + ring_to) / 2;
  edge.ring_slope = (ring_to - ring_from) / 2;
  for (int i = 0; i <= border.width; ++i) {
    edge.bounds.push_back((point(i * bit, ring) - edge.middle).dot(edge.along) / edge.half_length);
  }
  for (int i = 0; i < border.width; ++i) {
    const int last = border.width - 1;
    const std::array<int, 4> rows{last - border.ring, last - i, border.ring, i};
    const std::array<int, 4> columns{i, last - border.ring, last - i, border.ring};
    edge.bits.push_back(tag.bits[rows[side] * border.width + columns[side]]);
  }
  return edge;
}

std::optional<RefinedCorner> Intersect(const Edge& before, const Edge& after) {
  if (!before.fitted || !after.fitted) return std::nullopt;
  // The end (s = 1) of the edge that arrives and the beginning (s = -1) of the one that leaves.
  Eigen::Matrix2d normals;
  normals << before.normal.transpose(), after.normal.transpose();
  if (std::abs(normals.determinant()) < 1e-2) return std::nullopt;
  const Eigen::Matrix2d inverse = normals.inverse();
  double s_before = 1, s_after = -1;
  Eigen::Vector2d point;
  for (int iteration = 0; iteration < 3; ++iteration) {
    const Eigen::Vector2d offsets(before.normal.dot(before.middle) + before.Offset(s_before),
                                  after.normal.dot(after.middle) + after.Offset(s_after));
    point = inverse * offsets;
    s_before = (point - before.middle).dot(before.along) / before.half_length;
    s_after = (point - after.middle).dot(after.along) / after.half_length;
  }
  const Eigen::Vector2d variances(before.OffsetVariance(s_before), after.OffsetVariance(s_after));
  const Eigen::Matrix2d covariance = inverse * variances.asDiagonal() * inverse.transpose();
  const double sigma = std::sqrt(covariance.trace() / 2);
  const BentMarker bent{
      {{before.p, before.bends, inverse.col(0) * before.OffsetByBends(s_before).transpose()},
       {after.p, after.bends, inverse.col(1) * after.OffsetByBends(s_after).transpose()}},
      sigma};
  return RefinedCorner{point, sigma, bent};
}

/// Where and how a fit of a tag's drawing starts.
struct Attempt {
  SeenTag from;
  double blur;
  int reach;  ///< px, to look around first
};

/// The whole drawing of a tag: the first attempt that succeeds.
std::optional<TagFit> FitDrawing(const cv::Mat& gray,
                                 const TagBorder& border,
                                 std::initializer_list<Attempt> attempts,
                                 const LensCurvature& lens) {
  for (const Attempt& attempt : attempts) {
    TagTemplate drawing(gray, attempt.from, border, attempt.blur);
    if (attempt.reach > 0) drawing.Search(attempt.reach);
    if (!drawing.Approach()) continue;
    if (auto fit = drawing.Fit(lens)) return fit;
  }
  return std::nullopt;
}

/// The crossing of a tag's corner with the square that touches it, as far as both are free of other
/// edges. Unlike the tag's outline it stays where it is when black or white spreads: by the print,
/// the exposure or the camera's sharpening.
std::optional<RefinedCorner> CrossingAt(const cv::Mat& gray,
                                        const Quad& corners,
                                        std::size_t k,
                                        const TagBorder& border,
                                        const LensCurvature& lens,
                                        double blur) {
  const double free = std::min<double>(border.ring, border.outside) / border.width;
  SaddleGuess guess;
  guess.p = corners[k];
  guess.u = free * (corners[(k + 1) % 4] - corners[k]);
  guess.v = free * (corners[(k + 3) % 4] - corners[k]);
  const LensBend bend(guess.p, Eigen::Vector2d(gray.cols, gray.rows));
  const LensBends bends = lens.At(bend.p());
  const auto along = [&](const Eigen::Vector2d& direction) {
    const Eigen::Vector2d clockwise = Eigen::Vector2d(-direction.y(), direction.x()).normalized();
    return 2 * bend.OfEdge(direction, clockwise).dot(bends);
  };
  guess.curvature_u = along(guess.u);
  guess.curvature_v = along(guess.v);
  guess.blur = blur;
  const auto saddle = FitSaddle(gray, guess);
  // The tag's own black is where u and v have equal signs.
  if (!saddle || saddle->contrast > 0) return std::nullopt;
  // Lines that bend alike on both sides cross where straight ones would.
  return RefinedCorner{saddle->p, saddle->sigma, {{}, saddle->sigma}};
}

}  // namespace

RefinedTags RefineTags(const cv::Mat& gray,
                       std::span<const SeenTag> tags,
                       const TagBorder& border) {
  std::vector<std::optional<TagTemplate>> near(tags.size());
  std::vector<std::array<Edge, 4>> edges(tags.size());
  const Eigen::Vector2d image_size(gray.cols, gray.rows);
  std::vector<LensReading> readings;
  std::vector<double> blurs;
  Workspace work;
  const auto small = [](const SeenTag& tag) { return Area(tag.corners) < kSmall * kSmall; };
  for (std::size_t i = 0; i < tags.size(); ++i) {
    if (small(tags[i])) {
      near[i].emplace(gray, tags[i], border, blurs.empty() ? kUsualBlur : blurs.back());
      if (const auto of_tag = near[i]->Approach()) {
        blurs.push_back(near[i]->blur());
        readings.insert(readings.end(), of_tag->begin(), of_tag->end());
        continue;
      }
      near[i].reset();
    }
    for (int side = 0; side < 4; ++side) {
      Edge& edge = edges[i][static_cast<std::size_t>(side)];
      edge = MakeEdge(tags[i], side, border);
      FitEdge(gray, border.corner_squares, &edge, &work);
      if (edge.fitted) blurs.push_back(edge.blur);
    }
    ReadEdges(edges[i], image_size, &readings);
  }
  const LensCurvature lens(readings);
  const double blur = Median(std::move(blurs), kUsualBlur);
  RefinedTags result;
  std::vector<RefinedQuad>& refined = result.quads;
  refined.resize(tags.size());
  for (std::size_t i = 0; i < tags.size(); ++i) {
    std::optional<TagFit> drawing;
    std::vector<LensReading> of_edges;
    if (near[i]) {
      drawing = near[i]->Fit(lens);
    } else {
      ReadEdges(edges[i], image_size, &of_edges);
      for (Edge& edge : edges[i]) {
        if (edge.fitted) BendByLens(lens, image_size, &edge);
      }
      for (std::size_t k = 0; k < 4; ++k) {
        refined[i][k] = Intersect(edges[i][(k + 3) % 4], edges[i][k]);
        // No better than what was known before.
        if (refined[i][k] && refined[i][k]->sigma > edges[i][k].inside) refined[i][k].reset();
      }
    }
    const bool narrow = std::any_of(edges[i].begin(), edges[i].end(), [&](const Edge& edge) {
      return std::min(edge.inside, edge.outside) < kNarrow * blur;
    });
    const bool missing = std::any_of(
        refined[i].begin(), refined[i].end(), [](const auto& corner) { return !corner; });
    if (!drawing && (narrow || missing || small(tags[i]))) {
      SeenTag start = tags[i];
      for (std::size_t k = 0; k < 4; ++k) {
        if (refined[i][k]) start.corners[k] = refined[i][k]->point;
      }
      // Edges may mislead; the first guess may be off by more than the drawing can follow.
      drawing = FitDrawing(gray,
                           border,
                           {{start, blur, 0}, {tags[i], kUsualBlur, 0}, {tags[i], kUsualBlur, 2}},
                           lens);
    }
    for (std::size_t k = 0; k < 4; ++k) {
      if (!drawing || (refined[i][k] && refined[i][k]->sigma < drawing->bent[k].sigma)) continue;
      refined[i][k] = RefinedCorner{drawing->corners[k], drawing->bent[k].sigma, drawing->bent[k]};
    }
    const std::vector<LensReading>& of_tag = drawing ? drawing->readings : of_edges;
    result.readings.insert(result.readings.end(), of_tag.begin(), of_tag.end());
  }
  // All pixels know the lens better than the share of them that was enough to come near.
  const LensCurvature known(result.readings);
  for (RefinedQuad& quad : refined) {
    for (auto& corner : quad) {
      if (!corner) continue;
      corner->point += known.Change(corner->bent);
      corner->sigma = known.Sigma(corner->bent);
      for (BentPiece& piece : corner->bent.pieces) piece.bends = known.At(piece.p);
    }
  }
  if (border.corner_squares) {
    for (std::size_t i = 0; i < tags.size(); ++i) {
      Quad corners = tags[i].corners;
      for (std::size_t k = 0; k < 4; ++k) {
        if (refined[i][k]) corners[k] = refined[i][k]->point;
      }
      for (std::size_t k = 0; k < 4; ++k) {
        const auto crossing = CrossingAt(gray, corners, k, border, known, blur);
        if (crossing) refined[i][k] = crossing;
      }
    }
  }
  return result;
}

std::optional<Quad> FindTag(const cv::Mat& gray,
                            const SeenTag& expected,
                            const TagBorder& border,
                            double reach) {
  // Three pixels a bit are enough to know a tag by; larger ones are looked for in a reduced image.
  Eigen::AlignedBox2d box;
  double side = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    box.extend(expected.corners[k]);
    side += (expected.corners[(k + 1) % 4] - expected.corners[k]).norm() / 4;
  }
  const int reduced = std::max(1, static_cast<int>(side / (3 * border.width)));
  const double room = reach + 2 * side / border.width + 2;
  const cv::Point from(static_cast<int>(std::floor(box.min().x() - room)),
                       static_cast<int>(std::floor(box.min().y() - room)));
  const cv::Point to(static_cast<int>(std::ceil(box.max().x() + room)),
                     static_cast<int>(std::ceil(box.max().y() + room)));
  cv::Rect region = cv::Rect(from, to) & cv::Rect(0, 0, gray.cols, gray.rows);
  region.width -= region.width % reduced;
  region.height -= region.height % reduced;
  if (region.empty()) return std::nullopt;
  cv::Mat part = gray(region);
  if (reduced > 1) cv::resize(part, part, region.size() / reduced, 0, 0, cv::INTER_AREA);
  const Eigen::Vector2d origin(region.x - 0.5, region.y - 0.5), half(0.5, 0.5);
  SeenTag there = expected;
  for (auto& c : there.corners) c = (c - origin) / reduced - half;

  TagTemplate drawing(part, there, border, kUsualBlur);
  drawing.Search(static_cast<int>(std::ceil(reach / reduced)));
  if (!drawing.Approach() || !drawing.Fit(LensCurvature({}))) return std::nullopt;
  // Fisher's transform: five standard deviations from no correlation, one chance in three million.
  const int data = border.width - 2 * border.ring;
  const double least = std::tanh(5 / std::sqrt(data * data - 3.0));
  if (drawing.DataCorrelation() < least) return std::nullopt;
  Quad found = drawing.corners();
  for (auto& c : found) {
    c = (c + half) * reduced + origin;
    if (c.x() < 0 || c.y() < 0 || c.x() > gray.cols - 1 || c.y() > gray.rows - 1)
      return std::nullopt;
  }
  return found;
}

}  // namespace plenocal::internal
