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
#include "detectors/tags/tag_edges.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "calib/base/robust.h"
#include "calib/base/statistics.h"
#include "detectors/images/distortion_field.h"
#include "detectors/tags/distortion_basis.h"
#include "detectors/tags/tag_template.h"
#include "detectors/templates/lanes.h"
#include "detectors/templates/processors.h"
#include "detectors/templates/saddle.h"
#include "detectors/templates/square_sums.h"

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
  float squares = 0;                     ///< c of the model
  Eigen::Vector3d curve = Eigen::Vector3d::Zero();       ///< a, b, q
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< of a, b, q
  double odd = 0;     ///< px, displacement by the distortion in s^3
  Eigen::Vector2d p;  ///< the middle, as in `LocalDistortion`
  LocalDistortion distortion = LocalDistortion::Zero();       ///< assumed there
  Eigen::Matrix<double, 3, kDistortionTerms> by_distortion =  ///< of a, b, q by them, px
      Eigen::Matrix<double, 3, kDistortionTerms>::Zero();
  double blur = 0;  ///< px
  bool fitted = false;

  [[nodiscard]] double Offset(double s) const {
    // Where all s are alike, a fit of a parabola takes s^3 for 3/5 s.
    return curve.dot(Eigen::Vector3d(1, s, s * s)) + odd * s * (s * s - 0.6);
  }
  [[nodiscard]] LocalDistortion OffsetByDistortion(double s) const {
    return by_distortion.transpose() * Eigen::Vector3d(1, s, s * s);
  }
  [[nodiscard]] double OffsetVariance(double s) const {
    const Eigen::Vector3d j(1, s, s * s);
    return j.dot(covariance * j);
  }
};

/// The pixels beside an edge that its model is compared with: -inside < t - curve < outside and
/// |s| < s_max.
struct Band {
  double inside = 0, outside = 0;  ///< px
  double s_max = 0;
  bool isolated = false;  ///< neither the corners nor the bits behind the ring matter there
};

/// The band for an edge of this blur (px).
Band BandFor(const Edge& edge, double blur) {
  constexpr double kStep = 3;         // blurs: on either side of an edge, all but 0.3 % of the step
  constexpr double kHalfPixel = 0.5;  // px
  constexpr double kForeignFoot = 2;  // blurs: beyond, 98 % of the next tag's edge is over
  constexpr double kLeastOutside = 0.4;  // of the ring outside, where its edges' feet fill it
  constexpr double kCorner = 2.5;        // blurs: beyond, a corner changes less than 1 %
  constexpr double kMostOfEnds = 0.25;   // of the edge, that is left out at either end
  const double reach = kStep * blur + kHalfPixel;
  Band band;
  band.inside = std::min(edge.inside, reach);
  band.outside =
      std::min(std::max(edge.outside - kForeignFoot * blur, kLeastOutside * edge.outside), reach);
  const double ends = std::min(kCorner * blur, kMostOfEnds * edge.half_length * 2);
  band.s_max = 1 - ends / edge.half_length;
  band.isolated = !(edge.inside - band.inside < kStep * blur || ends < kCorner * blur);
  return band;
}

void CollectSamples(const cv::Mat& gray, const Edge& edge, const Band& band, Samples* samples) {
  const auto& [inside, outside, s_max, isolated] = band;
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
using EdgeSums = Eigen::Matrix<double, kPadded, kPadded>;

/// Inputs of the model beside its parameters.
struct Setting {
  float ring_mean = 0, ring_slope = 0;
  float squares = 0;  ///< c of the model
  const Surroundings* around = nullptr;
  float limit = std::numeric_limits<float>::infinity();  ///< residuals beyond are left out
};

/// 8 * `count` samples from number `from` on.
struct SampleRange {
  std::size_t from = 0;
  int count = 0;
};

constexpr int kBlock = 32;  // of eight samples

/// The columns j, `kBlock` apart, zero beyond the limit, and the residuals of some samples.
PLENOCAL_FOR_EACH_PROCESSOR
void Differentiate(const Eigen::Matrix<float, kParameters, 1>& p,
                   const Setting& setting,
                   const Samples& samples,
                   const SampleRange& range,
                   Lanes* rows,
                   float* residuals) {
  const auto [from, count] = range;
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
    const Lanes counts = size <= setting.limit ? known : Lanes{};
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

EdgeSums Linearise(const ParameterVector& p,
                   const Setting& setting,
                   const Samples& samples,
                   std::vector<float>* residuals) {
  Lanes block[kPadded * kBlock] = {};
  EdgeSums sums = EdgeSums::Zero();
  residuals->resize(samples.s.size());
  for (std::size_t from = 0; from < samples.count; from += kLanes * kBlock) {
    const auto count =
        static_cast<int>(std::min<std::size_t>((samples.s.size() - from) / kLanes, kBlock));
    Differentiate(
        p.cast<float>(), setting, samples, {from, count}, block, residuals->data() + from);
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

/// In blurs: where a ring is narrower, its two edges merge.
constexpr double kNarrow = 3.5;
/// px; the outer edges of a larger tag measure it well enough, all its edges would take long.
constexpr double kSmall = 64;
constexpr double kUsualBlur = 0.8;  // px, of a lens in focus; where the fits start

struct Workspace {
  Samples samples;
  std::vector<float> residuals;
};

/// Level, contrast and blur before the first step; false when an edge has samples on one side only.
bool StartLevels(const Samples& samples, double blur, ParameterVector* p) {
  double sum[2] = {0, 0};
  int count[2] = {0, 0};
  for (std::size_t i = 0; i < samples.count; ++i) {
    const int side = samples.t[i] > 0;
    sum[side] += samples.gray[i];
    ++count[side];
  }
  if (count[0] == 0 || count[1] == 0) return false;
  const double in = sum[0] / count[0], out = sum[1] / count[1];
  (*p)[kLevel] = (in + out) / 2;
  (*p)[kContrast] = (out - in) / 2;
  (*p)[kBlur] = blur;
  return true;
}

/// Gauss-Newton steps to the minimum near `p`. Returns the sums before the last step; nothing when
/// it leaves the edge.
std::optional<EdgeSums> Descend(const Edge& edge,
                                const Setting& setting,
                                Workspace* work,
                                ParameterVector* p) {
  constexpr int kSteps = 6;
  constexpr double kDamping = 1e-6;    // of the diagonal: for parameters that are not determined
  constexpr double kMostBlur = 5;      // px; more blurred tags cannot be read
  constexpr double kSmallStep = 0.02;  // px: the next one is of the order of its square
  EdgeSums sums;
  for (int i = 0; i < kSteps; ++i) {
    sums = Linearise(*p, setting, work->samples, &work->residuals);
    ParameterMatrix damped = sums.topLeftCorner<kParameters, kParameters>();
    damped.diagonal() *= 1 + kDamping;
    const ParameterVector step = damped.ldlt().solve(sums.col(kResidual).head<kParameters>());
    if (!step.allFinite()) return std::nullopt;
    *p += step;
    (*p)[kBlur] = std::clamp((*p)[kBlur], kPixelSigma, kMostBlur);
    // Farther off, it may be the ring's other edge.
    if (p->head<3>().cwiseAbs().maxCoeff() > std::max(edge.inside, 1.0)) return std::nullopt;
    if (step.head<3>().cwiseAbs().maxCoeff() < kSmallStep) break;
  }
  return sums;
}

void FitEdge(const cv::Mat& gray, Edge* edge, Workspace* work) {
  constexpr int kRounds = 2;          // the second one with the first one's blur and outliers
  constexpr double kOutlier = 4;      // sigmas; of normal noise one sample in 16,000 is beyond
  constexpr double kSameBlur = 0.25;  // relative: the samples for it would be nearly the same
  double blur = kUsualBlur;
  ParameterVector p = ParameterVector::Zero();
  float limit = std::numeric_limits<float>::infinity();
  for (int round = 0; round < kRounds; ++round) {
    const Band band = BandFor(*edge, blur);
    CollectSamples(gray, *edge, band, &work->samples);
    if (work->samples.count < 3 * kParameters) return;
    if (round == 0 && !StartLevels(work->samples, blur, &p)) return;
    std::optional<Surroundings> around;
    if (!band.isolated) around.emplace(edge->bounds, edge->bits, blur / edge->half_length);
    const Setting setting{static_cast<float>(edge->ring_mean),
                          static_cast<float>(edge->ring_slope),
                          edge->squares,
                          around ? &*around : nullptr,
                          limit};
    const std::optional<EdgeSums> sums = Descend(*edge, setting, work, &p);
    if (!sums) return;
    const auto used = std::count_if(
        work->residuals.begin(), work->residuals.end(), [&](float r) { return r <= limit; });
    if (used <= 2 * kParameters) return;
    const double variance = (*sums)(kResidual, kResidual) / static_cast<double>(used - kParameters);
    const float largest = *std::max_element(work->residuals.begin(), work->residuals.end());
    limit = static_cast<float>(kOutlier * kSigmaPerMad * MedianAbsolute(&work->residuals));
    const ParameterMatrix information = sums->topLeftCorner<kParameters, kParameters>();
    const Eigen::LDLT<ParameterMatrix> solver(information);
    const ParameterMatrix inverse = solver.solve(ParameterMatrix::Identity());
    edge->curve = p.head<3>();
    edge->covariance = variance * inverse.topLeftCorner<3, 3>();
    edge->blur = p[kBlur];
    if (largest <= limit && std::abs(edge->blur - blur) < kSameBlur * blur) break;
    blur = edge->blur;
  }
  edge->fitted = edge->covariance.allFinite() && edge->covariance(0, 0) > 0;
}

/// From the curve's estimate with q free to the estimate with the distortion as a prior of q.
void ApplyDistortion(const DistortionField& field, const Eigen::Vector2d& image_size, Edge* edge) {
  const Eigen::Vector2d half = edge->half_length * edge->along;
  const DistortionBasis basis(edge->middle, image_size);
  const LocalDistortion of_edge =
      half.squaredNorm() * basis.EdgeCurvature(half, edge->normal);  // at s = 1
  const Eigen::Vector3d gain =
      edge->covariance.col(2) / (edge->covariance(2, 2) + field.Variance(basis.p(), of_edge));
  edge->p = basis.p();
  edge->distortion = field.At(edge->p);
  edge->curve += gain * (of_edge.dot(edge->distortion) - edge->curve[2]);
  edge->covariance -= gain * edge->covariance.row(2).eval();
  edge->by_distortion = gain * of_edge.transpose();
  edge->odd = edge->normal.dot((basis.At(half) - basis.At(-half)) * edge->distortion) / 2;
}

/// Measurements of the distortion by edges.
void MeasureDistortion(std::span<const Edge> edges,
                       const Eigen::Vector2d& image_size,
                       std::vector<DistortionMeasurement>* measurements) {
  for (const Edge& edge : edges) {
    if (!edge.fitted) continue;
    const Eigen::Vector2d half = edge.half_length * edge.along;
    const DistortionBasis basis(edge.middle, image_size);
    const LocalDistortion of_edge = half.squaredNorm() * basis.EdgeCurvature(half, edge.normal);
    const double size = of_edge.norm();
    measurements->push_back(
        {basis.p(), of_edge / size, edge.curve[2] / size, edge.covariance(2, 2) / (size * size)});
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
  edge.squares = border.corner_squares ? 1.f : 0.f;
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
  constexpr double kParallel = 1e-2;  // sine of the angle between the edges
  if (std::abs(normals.determinant()) < kParallel) return std::nullopt;
  const Eigen::Matrix2d inverse = normals.inverse();
  double s_before = 1, s_after = -1;
  Eigen::Vector2d point;
  constexpr int kSteps = 3;  // the curves are nearly straight
  for (int step = 0; step < kSteps; ++step) {
    const Eigen::Vector2d offsets(before.normal.dot(before.middle) + before.Offset(s_before),
                                  after.normal.dot(after.middle) + after.Offset(s_after));
    point = inverse * offsets;
    s_before = (point - before.middle).dot(before.along) / before.half_length;
    s_after = (point - after.middle).dot(after.along) / after.half_length;
  }
  const Eigen::Vector2d variances(before.OffsetVariance(s_before), after.OffsetVariance(s_after));
  const Eigen::Matrix2d covariance = inverse * variances.asDiagonal() * inverse.transpose();
  const double sigma = std::sqrt(covariance.trace() / 2);
  const DistortionSensitivity sensitivity{
      {{before.p,
        before.distortion,
        inverse.col(0) * before.OffsetByDistortion(s_before).transpose()},
       {after.p, after.distortion, inverse.col(1) * after.OffsetByDistortion(s_after).transpose()}},
      sigma};
  return RefinedCorner{point, sigma, sensitivity};
}

/// Start of a fit of a tag's template.
struct Attempt {
  SeenTag from;
  double blur;
  int reach;  ///< px, to look around first
};

/// The template of a tag: the first attempt that succeeds.
std::optional<TagFit> FitTemplate(const cv::Mat& gray,
                                  const TagBorder& border,
                                  std::initializer_list<Attempt> attempts,
                                  const DistortionField& field) {
  for (const Attempt& attempt : attempts) {
    TagTemplate tag(gray, attempt.from, border, attempt.blur);
    if (attempt.reach > 0) tag.Search(attempt.reach);
    if (!tag.Approach()) continue;
    if (auto fit = tag.Fit(field)) return fit;
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
                                        const DistortionField& field,
                                        double blur) {
  const double free = std::min<double>(border.ring, border.outside) / border.width;
  SaddleGuess guess;
  guess.p = corners[k];
  guess.u = free * (corners[(k + 1) % 4] - corners[k]);
  guess.v = free * (corners[(k + 3) % 4] - corners[k]);
  const DistortionBasis basis(guess.p, Eigen::Vector2d(gray.cols, gray.rows));
  const LocalDistortion distortion = field.At(basis.p());
  const auto along = [&](const Eigen::Vector2d& direction) {
    const Eigen::Vector2d clockwise = Eigen::Vector2d(-direction.y(), direction.x()).normalized();
    return 2 * basis.EdgeCurvature(direction, clockwise).dot(distortion);
  };
  guess.curvature_u = along(guess.u);
  guess.curvature_v = along(guess.v);
  guess.blur = blur;
  const auto saddle = FitSaddle(gray, guess);
  // The tag's own black is where u and v have equal signs.
  if (!saddle || saddle->contrast > 0) return std::nullopt;
  // Lines whose curvature is alike on both sides of the crossing do not move it.
  return RefinedCorner{saddle->p, saddle->sigma, {{}, saddle->sigma}};
}

/// The tags of one image on their way to measured corners.
class TagRefiner {
 public:
  TagRefiner(const cv::Mat& gray, std::span<const SeenTag> tags, const TagBorder& border)
      : gray_(gray),
        image_size_(gray.cols, gray.rows),
        tags_(tags),
        border_(border),
        templates_(tags.size()),
        edges_(tags.size()) {
    result_.quads.resize(tags.size());
  }

  RefinedTags Refine() {
    for (std::size_t i = 0; i < tags_.size(); ++i) Approach(i);
    const DistortionField rough(measurements_);
    blur_ = Median(std::move(blurs_), kUsualBlur);
    for (std::size_t i = 0; i < tags_.size(); ++i) Measure(i, rough);
    // All pixels measure the distortion better than the share of them that sufficed to come near.
    const DistortionField field(result_.measurements);
    UseDistortion(field);
    if (border_.corner_squares) {
      for (std::size_t i = 0; i < tags_.size(); ++i) UseCrossings(i, field);
    }
    return std::move(result_);
  }

 private:
  [[nodiscard]] bool IsSmall(std::size_t i) const {
    return Area(tags_[i].corners) < kSmall * kSmall;
  }
  /// The corners measured so far, and those seen where there are none.
  [[nodiscard]] Quad BestCorners(std::size_t i) const;

  /// Fits the template of a small tag roughly, else the edges, and measures the distortion.
  void Approach(std::size_t i);
  /// Measures the corners of a tag by its edges or its template, whichever is better.
  void Measure(std::size_t i, const DistortionField& field);
  /// Corners where the edges intersect.
  void Intersect(std::size_t i, const DistortionField& field);
  /// The template of a tag whose edges do not suffice: nothing for others.
  [[nodiscard]] std::optional<TagFit> FitTemplateWhereNeeded(std::size_t i,
                                                             const DistortionField& field) const;
  void UseDistortion(const DistortionField& field);
  /// Corners measured as crossings with the squares that touch them.
  void UseCrossings(std::size_t i, const DistortionField& field);

  const cv::Mat& gray_;
  Eigen::Vector2d image_size_;
  std::span<const SeenTag> tags_;
  const TagBorder& border_;
  std::vector<std::optional<TagTemplate>> templates_;
  std::vector<std::array<Edge, 4>> edges_;
  std::vector<DistortionMeasurement> measurements_;
  std::vector<double> blurs_;
  double blur_ = 0;  ///< px, of the image
  Workspace work_;
  RefinedTags result_;
};

void TagRefiner::Approach(std::size_t i) {
  if (IsSmall(i)) {
    std::optional<TagTemplate>& tag = templates_[i];
    tag.emplace(gray_, tags_[i], border_, blurs_.empty() ? kUsualBlur : blurs_.back());
    if (const auto of_tag = tag->Approach()) {
      blurs_.push_back(tag->blur());
      measurements_.insert(measurements_.end(), of_tag->begin(), of_tag->end());
      return;
    }
    tag.reset();
  }
  for (int side = 0; side < 4; ++side) {
    Edge& edge = edges_[i][static_cast<std::size_t>(side)];
    edge = MakeEdge(tags_[i], side, border_);
    FitEdge(gray_, &edge, &work_);
    if (edge.fitted) blurs_.push_back(edge.blur);
  }
  MeasureDistortion(edges_[i], image_size_, &measurements_);
}

void TagRefiner::Intersect(std::size_t i, const DistortionField& field) {
  for (Edge& edge : edges_[i]) {
    if (edge.fitted) ApplyDistortion(field, image_size_, &edge);
  }
  RefinedQuad& refined = result_.quads[i];
  for (std::size_t k = 0; k < 4; ++k) {
    refined[k] = internal::Intersect(edges_[i][(k + 3) % 4], edges_[i][k]);
    // No better than the corner that was detected.
    if (refined[k] && refined[k]->sigma > edges_[i][k].inside) refined[k].reset();
  }
}

Quad TagRefiner::BestCorners(std::size_t i) const {
  Quad corners = tags_[i].corners;
  for (std::size_t k = 0; k < 4; ++k) {
    if (result_.quads[i][k]) corners[k] = result_.quads[i][k]->point;
  }
  return corners;
}

std::optional<TagFit> TagRefiner::FitTemplateWhereNeeded(std::size_t i,
                                                         const DistortionField& field) const {
  const bool narrow = std::any_of(edges_[i].begin(), edges_[i].end(), [&](const Edge& edge) {
    return std::min(edge.inside, edge.outside) < kNarrow * blur_;
  });
  const RefinedQuad& refined = result_.quads[i];
  const bool missing =
      std::any_of(refined.begin(), refined.end(), [](const auto& corner) { return !corner; });
  if (!narrow && !missing && !IsSmall(i)) return std::nullopt;
  // Edges may mislead; the first guess may be off by more than the template can follow.
  constexpr int kReach = 2;  // px, beyond which the library's corners never are
  return FitTemplate(gray_,
                     border_,
                     {{{BestCorners(i), tags_[i].bits}, blur_, 0},
                      {tags_[i], kUsualBlur, 0},
                      {tags_[i], kUsualBlur, kReach}},
                     field);
}

void TagRefiner::Measure(std::size_t i, const DistortionField& field) {
  std::optional<TagFit> fit;
  std::vector<DistortionMeasurement> of_edges;
  if (templates_[i]) {
    fit = templates_[i]->Fit(field);
  } else {
    MeasureDistortion(edges_[i], image_size_, &of_edges);
    Intersect(i, field);
  }
  if (!fit) fit = FitTemplateWhereNeeded(i, field);
  RefinedQuad& refined = result_.quads[i];
  for (std::size_t k = 0; k < 4; ++k) {
    if (!fit || (refined[k] && refined[k]->sigma < fit->sensitivities[k].sigma)) continue;
    refined[k] = RefinedCorner{fit->corners[k], fit->sensitivities[k].sigma, fit->sensitivities[k]};
  }
  const std::vector<DistortionMeasurement>& of_tag = fit ? fit->measurements : of_edges;
  result_.measurements.insert(result_.measurements.end(), of_tag.begin(), of_tag.end());
}

void TagRefiner::UseDistortion(const DistortionField& field) {
  for (RefinedQuad& quad : result_.quads) {
    for (auto& corner : quad) {
      if (!corner) continue;
      corner->point += field.Change(corner->sensitivity);
      corner->sigma = field.Sigma(corner->sensitivity, PlaceOfPixel(corner->point, image_size_));
      for (SensitivityPiece& piece : corner->sensitivity.pieces) piece.assumed = field.At(piece.p);
    }
  }
}

void TagRefiner::UseCrossings(std::size_t i, const DistortionField& field) {
  const Quad corners = BestCorners(i);
  for (std::size_t k = 0; k < 4; ++k) {
    if (const auto crossing = CrossingAt(gray_, corners, k, border_, field, blur_)) {
      result_.quads[i][k] = crossing;
    }
  }
}

}  // namespace

RefinedTags RefineTags(const cv::Mat& gray,
                       std::span<const SeenTag> tags,
                       const TagBorder& border) {
  return TagRefiner(gray, tags, border).Refine();
}

std::optional<Quad> FindTag(const cv::Mat& gray,
                            const SeenTag& expected,
                            const TagBorder& border,
                            double reach) {
  constexpr double kBitPixels = 3;  // suffice to recognise a tag; larger ones are reduced
  // Around the place expected: bits that the template covers, and px for its blur.
  constexpr double kAroundBits = 2, kAroundPixels = 2;
  Eigen::AlignedBox2d box;
  double side = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    box.extend(expected.corners[k]);
    side += (expected.corners[(k + 1) % 4] - expected.corners[k]).norm() / 4;
  }
  const int reduced = std::max(1, static_cast<int>(side / (kBitPixels * border.width)));
  const double room = reach + kAroundBits * side / border.width + kAroundPixels;
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
  if (!drawing.Approach() || !drawing.Fit(DistortionField({}))) return std::nullopt;
  // Standard deviations of Fisher's transform from no correlation: one chance in three million.
  constexpr double kSure = 5;
  const int data = border.width - 2 * border.ring;
  const double least = std::tanh(kSure / std::sqrt(data * data - 3.0));
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
