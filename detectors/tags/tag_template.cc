// SPDX-License-Identifier: Apache-2.0
#include "detectors/tags/tag_template.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "calib/base/linear_algebra.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"
#include "calib/kernels/processors.h"
#include "detectors/templates/square_sums.h"

namespace plenocal::internal {
namespace {

struct Correlation {
  double n = 0, x = 0, y = 0, xx = 0, yy = 0, xy = 0;
  void Add(double a, double b) { n += 1, x += a, y += b, xx += a * a, yy += b * b, xy += a * b; }
  [[nodiscard]] double Coefficient() const {
    const double vx = n * xx - x * x, vy = n * yy - y * y;
    return vx > 0 && vy > 0 ? (n * xy - x * y) / std::sqrt(vx * vy) : 0;
  }
};

}  // namespace

double Area(const Quad& q) {
  const Eigen::Vector2d a = q[2] - q[0], b = q[3] - q[1];
  return std::abs(a.x() * b.y() - a.y() * b.x()) / 2;
}

CellTemplate DrawTag(const std::vector<bool>& bits, const TagBorder& border, int around) {
  const int n = border.width + 2 * around;
  std::vector<float> cells(static_cast<std::size_t>(n) * n, 1.f);
  for (int y = 0; y < border.width; ++y) {
    for (int x = 0; x < border.width; ++x) {
      cells[(y + around) * n + x + around] = bits[y * border.width + x] ? 1.f : -1.f;
    }
  }
  if (border.corner_squares) {
    const auto beside = [&](int at) { return at < around || at >= n - around; };
    for (int y = 0; y < n; ++y) {
      for (int x = 0; x < n; ++x) {
        if (beside(x) && beside(y)) cells[y * n + x] = -1;
      }
    }
  }
  return {std::move(cells), n};
}

Eigen::Matrix3d CellsByUnitSquare(const TagBorder& border, int around) {
  Eigen::Matrix3d cells;
  cells << border.width, 0, around, 0, -border.width, border.width + around, 0, 0, 1;
  return cells;
}

TagTemplate::TagTemplate(const cv::Mat& gray,
                         const SeenTag& tag,
                         const TagBorder& border,
                         double blur)
    : gray_(gray),
      border_(border),
      bits_(border.width + 2 * kAround),
      drawing_(DrawTag(tag.bits, border, kAround)) {
  // Farther off than half a bit from the tag, the unknown surroundings matter too much.
  constexpr double kMargin = kAround - 0.5;
  window_ = {Eigen::Vector2d::Constant(kMargin), Eigen::Vector2d::Constant(bits_ - kMargin)};
  state_.blur = blur;
  SetBeyond(0);
  SetCorners(tag.corners);
  ChoosePixels(StepToApproach());
  start_ = corners_;
}

void TagTemplate::SetCorners(const Quad& corners) {
  corners_ = corners;
  side_ = std::sqrt(Area(corners));
  const Eigen::Matrix3d image_by_bits =
      UnitSquareHomography(corners) * CellsByUnitSquare(border_, kAround).inverse();
  centre_ = (image_by_bits * window_.center().homogeneous()).hnormalized();
  basis_.emplace(centre_, Eigen::Vector2d(gray_.cols, gray_.rows));
  Quad straight;
  std::transform(corners.begin(), corners.end(), straight.begin(), [&](const auto& corner) {
    return Undistorted(corner);
  });
  state_.G = CellsByUnitSquare(border_, kAround) * UnitSquareHomography(straight).inverse();
  state_.G /= state_.G(2, 2);
}

Eigen::Vector2d TagTemplate::Undistorted(const Eigen::Vector2d& x) const {
  const Eigen::Vector2d d = x - centre_;
  return (d - basis_->At(d) * distortion_) / side_;
}

Eigen::Vector2d TagTemplate::Distorted(const Eigen::Vector2d& y) const {
  // The distortion within a tag is small, so a few steps suffice.
  const Eigen::Vector2d straight = side_ * y;
  Eigen::Vector2d d = straight;
  for (int i = 0; i < 4; ++i) d = straight + basis_->At(d) * distortion_;
  return d + centre_;
}

void TagTemplate::UpdateCorners() {
  const Eigen::Matrix3d inverse = state_.G.inverse();
  const double low = kAround, high = kAround + border_.width;
  const std::array<Eigen::Vector3d, 4> on_drawing{Eigen::Vector3d(low, high, 1),
                                                  Eigen::Vector3d(high, high, 1),
                                                  Eigen::Vector3d(high, low, 1),
                                                  Eigen::Vector3d(low, low, 1)};
  for (std::size_t k = 0; k < 4; ++k) {
    corners_[k] = Distorted((inverse * on_drawing[k]).hnormalized());
  }
}

PLENOCAL_LANES void TagTemplate::Place(const Lanes& d_x,
                                       const Lanes& d_y,
                                       Lanes* x,
                                       Lanes* y) const {
  *x = d_x;
  *y = d_y;
  if (!distortion_.isZero(0)) {  // as while tags are approached
    DistortionBasis::Displacements<Eight> displacement;
    basis_->At<Eight>(d_x, d_y, &displacement);
    for (int i = 0; i < kDistortionTerms; ++i) {
      *x -= static_cast<float>(distortion_[i]) * displacement.x[i];
      *y -= static_cast<float>(distortion_[i]) * displacement.y[i];
    }
  }
  *x *= 1 / static_cast<float>(side_);
  *y *= 1 / static_cast<float>(side_);
}

PLENOCAL_FOR_EACH_PROCESSOR void TagTemplate::ChoosePixels(int step, double reach) {
  pixels_.clear();
  if (!state_.G.allFinite()) return;
  const Eigen::Matrix3d inverse = state_.G.inverse();
  using Corner = Eigen::AlignedBox2d::CornerType;
  const auto seen = [&](Corner a, Corner b) {
    const Eigen::Vector2d middle = (window_.corner(a) + window_.corner(b)) / 2;
    return Distorted((inverse * middle.homogeneous()).hnormalized());
  };
  constexpr std::array kCorners{
      Corner::BottomLeft, Corner::BottomRight, Corner::TopRight, Corner::TopLeft};
  Eigen::AlignedBox2d box;
  double bend = 0;  // of the window's edges, px
  for (std::size_t k = 0; k < kCorners.size(); ++k) {
    const Corner here = kCorners[k], next = kCorners[(k + 1) % kCorners.size()];
    const Eigen::Vector2d from = seen(here, here), along = seen(next, next) - from;
    const Eigen::Vector2d middle = seen(here, next) - from;
    box.extend(from);
    bend = std::max(bend, std::abs(along.x() * middle.y() - along.y() * middle.x()) / along.norm());
  }
  if (!box.sizes().allFinite() || !std::isfinite(bend)) return;
  const double room = 1 + 2 * bend;
  const int x_first = std::max(0, static_cast<int>(std::floor(box.min().x() - room)));
  const int y_first = std::max(0, static_cast<int>(std::floor(box.min().y() - room)));
  const int x_last = std::min(gray_.cols - 1, static_cast<int>(std::ceil(box.max().x() + room)));
  const int y_last = std::min(gray_.rows - 1, static_cast<int>(std::ceil(box.max().y() + room)));
  if (x_first > x_last || y_first > y_last) return;
  double bit = side_ / border_.width;
  for (std::size_t k = 0; k < 4; ++k) {
    bit = std::min(bit, (corners_[(k + 1) % 4] - corners_[k]).norm() / border_.width);
  }
  const auto reach_cells = static_cast<float>(reach / bit);
  const bool thinned = reach_cells < 0.5f;
  const Eigen::Matrix3f G = state_.G.cast<float>();
  const Eigen::Vector2f low = window_.min().cast<float>(), high = window_.max().cast<float>();
  const Eigen::Vector2f centre = centre_.cast<float>();
  const Lanes lanes{0, 1, 2, 3, 4, 5, 6, 7};
  const auto rows = static_cast<std::size_t>((y_last - y_first) / step + 1);
  const auto strips = static_cast<std::size_t>((x_last - x_first) / (kLanes * step) + 1);
  pixels_.reserve(rows * strips * kLanes);
  for (int row = y_first; row <= y_last; row += step) {
    const auto* gray = gray_.ptr<unsigned char>(row);
    const Lanes d_y = Lanes{} + (static_cast<float>(row) - centre.y());
    for (int first = x_first; first <= x_last; first += kLanes * step) {
      const Lanes d_x = static_cast<float>(first) + lanes - centre.x();
      Lanes x, y;
      Place(d_x, d_y, &x, &y);
      const Lanes scale = G(2, 0) * x + G(2, 1) * y + G(2, 2);
      const Lanes u = G(0, 0) * x + G(0, 1) * y + G(0, 2), v = G(1, 0) * x + G(1, 1) * y + G(1, 2);
      IntLanes chosen = (scale > 0) & (u >= low.x() * scale) & (u <= high.x() * scale) &
                        (v >= low.y() * scale) & (v <= high.y() * scale);
      if (IsZero(chosen)) continue;
      if (thinned) {
        IntLanes flat;
        const Lanes inside = Lanes{} + low.x();  // for lanes that are not chosen
        drawing_.FindFlat(
            chosen ? u / scale : inside, chosen ? v / scale : inside, reach_cells, &flat);
        chosen &= ~flat;
      }
      std::array<Pixel, kLanes + 1> of_strip;
      int count = 0;
      for (int l = 0; l < kLanes && first + l <= x_last; ++l) {
        of_strip[count] = {first + l, row, x[l], y[l], static_cast<float>(gray[first + l])};
        count -= chosen[l];
      }
      pixels_.insert(pixels_.end(), of_strip.begin(), of_strip.begin() + count);
    }
  }
}

void TagTemplate::SetBeyond(double value) {
  state_.beyond = value;
  drawing_.SetBeyond(static_cast<float>(value));
}

TagTemplate::Strip TagTemplate::Draw(const State& state, std::size_t from, std::size_t stride) {
  Strip strip;
  for (std::size_t l = 0; l < kLanes && from + l * stride < pixels_.size(); ++l) {
    const Pixel& p = pixels_[from + l * stride];
    strip.d_x[l] = static_cast<float>(p.column - centre_.x());
    strip.d_y[l] = static_cast<float>(p.row - centre_.y());
    strip.x[l] = p.x;
    strip.y[l] = p.y;
    strip.gray[l] = p.gray;
    strip.known[l] = 1;
    ++strip.count;
  }
  drawing_.Draw(state.G.cast<float>(),
                static_cast<float>(state.blur / side_),
                0,
                strip.x,
                strip.y,
                &strip.drawn);
  return strip;
}

template <typename Use>
void TagTemplate::ForEachDrawn(std::size_t stride, const Use& use) {
  for (std::size_t i = 0; i < pixels_.size(); i += kLanes * stride) {
    const Strip strip = Draw(state_, i, stride);
    for (int l = 0; l < strip.count; ++l) use(strip, l);
  }
}

void TagTemplate::Search(int reach) {
  std::vector<float> values;
  values.reserve(pixels_.size());
  ForEachDrawn(1, [&](const Strip& strip, int l) { values.push_back(strip.drawn.value[l]); });
  double best = -1;
  Eigen::Vector2d best_shift(0, 0);
  for (int dy = -reach; dy <= reach; ++dy) {
    for (int dx = -reach; dx <= reach; ++dx) {
      Correlation all;
      for (std::size_t i = 0; i < pixels_.size(); ++i) {
        const int x = pixels_[i].column + dx, y = pixels_[i].row + dy;
        if (x < 0 || y < 0 || x >= gray_.cols || y >= gray_.rows) continue;
        all.Add(gray_.at<unsigned char>(y, x), values[i]);
      }
      const double r = all.Coefficient() * border_.outside_sign;
      if (r > best) {
        best = r;
        best_shift = {dx, dy};
      }
    }
  }
  Quad moved = corners_;
  for (auto& c : moved) c += best_shift;
  SetCorners(moved);
  ChoosePixels(1);
  start_ = corners_;
}

double TagTemplate::DataCorrelation() {
  Correlation data;
  const auto middle = static_cast<float>(bits_) / 2;
  const float inner = static_cast<float>(border_.width) / 2 - static_cast<float>(border_.ring);
  ForEachDrawn(1, [&](const Strip& strip, int l) {
    const float u = strip.drawn.u[l] - middle, v = strip.drawn.v[l] - middle;
    if (std::max(std::abs(u), std::abs(v)) < inner) data.Add(strip.gray[l], strip.drawn.value[l]);
  });
  return data.Coefficient() * border_.outside_sign;
}

PLENOCAL_FOR_EACH_PROCESSOR
void TagTemplate::Differentiate(const State& state,
                                const Strip& strip,
                                Columns columns,
                                Lanes* rows) const {
  const Eigen::Matrix3f G = state.G.cast<float>();
  const float m = static_cast<float>(state.level), k = static_cast<float>(state.contrast);
  const float g_x = static_cast<float>(state.gradient.x());
  const float g_y = static_cast<float>(state.gradient.y());
  const float by_px = 1 / static_cast<float>(side_);
  const CellTemplate::Drawn& drawn = strip.drawn;
  Lanes light = 1 + g_x * strip.x + g_y * strip.y, level = m + k * drawn.value;
  const Lanes residual = strip.gray - light * level;
  const Lanes counts = (residual < 0 ? -residual : residual) <= limit_ ? strip.known : Lanes{};
  light *= counts;
  level *= counts;
  const Lanes strength = light * k;
  const Lanes by_u = strength * drawn.by_u / drawn.scale;
  const Lanes by_v = strength * drawn.by_v / drawn.scale;
  const Lanes by_scale = -(by_u * drawn.u + by_v * drawn.v);
  int row = 0;
  const auto put = [&](const Lanes& lanes) { rows[kBlock * row++] = lanes; };
  put(by_u * strip.x);
  put(by_u * strip.y);
  put(by_u);
  put(by_v * strip.x);
  put(by_v * strip.y);
  put(by_v);
  put(by_scale * strip.x);
  put(by_scale * strip.y);
  put(light);
  put(light * drawn.value);
  put(level * strip.x);
  put(level * strip.y);
  put(by_px * strength * drawn.by_blur);
  put(strength * drawn.by_beyond);
  put(counts * residual);
  if (columns == Columns::kParameters) return;
  const Lanes by_x = by_u * (G(0, 0) - drawn.u * G(2, 0)) + by_v * (G(1, 0) - drawn.v * G(2, 0));
  const Lanes by_y = by_u * (G(0, 1) - drawn.u * G(2, 1)) + by_v * (G(1, 1) - drawn.v * G(2, 1));
  DistortionBasis::Displacements<Eight> displacement;
  basis_->At<Eight>(strip.d_x, strip.d_y, &displacement);
  for (int i = 0; i < kDistortionTerms; ++i) {
    put(-by_px * (displacement.x[i] * by_x + displacement.y[i] * by_y));
  }
  put(counts);
}

TagTemplate::Sums TagTemplate::Linearise(const State& state, std::size_t stride, Columns columns) {
  // Single precision within a block of pixels only.
  Lanes block[kWithDistortion * kBlock] = {};
  const int count = columns == Columns::kParameters ? kWithoutDistortion : kWithDistortion;
  Sums sums = Sums::Zero(count, count);
  int filled = 0;
  for (std::size_t i = 0; i < pixels_.size(); i += kLanes * stride) {
    Differentiate(state, Draw(state, i, stride), columns, block + filled++);
    if (filled == kBlock || i + kLanes * stride >= pixels_.size()) {
      AddSquares(block, count, kBlock, filled, sums.data());
      filled = 0;
    }
  }
  sums.triangularView<Eigen::StrictlyUpper>() = sums.transpose();
  // Prior of the brightness beyond: that of the tag, with the weight of one pixel of one gray level
  // of noise.
  sums(kBeyond, kBeyond) += 1;
  sums(kBeyond, kResidual) -= state.beyond;
  return sums;
}

Eigen::Matrix<double, 2, 8> TagTemplate::CornerByG(const Eigen::Vector2d& corner) const {
  // The corner stays where it is on the drawing: du = U_y dy + U_G dG = 0.
  // The distortion changes dy by little enough to be left out.
  const Eigen::Vector2d y = Undistorted(corner);
  const Eigen::Vector3d bits = state_.G * y.homogeneous();
  const Eigen::Vector2d u = bits.hnormalized();
  const Eigen::Matrix2d by_y =
      (state_.G.topLeftCorner<2, 2>() - u * state_.G.bottomLeftCorner<1, 2>()) / bits.z();
  Eigen::Matrix<double, 2, 8> by_G = Eigen::Matrix<double, 2, 8>::Zero();
  by_G.block<1, 3>(0, 0) = y.homogeneous().transpose();
  by_G.block<1, 3>(1, 3) = y.homogeneous().transpose();
  by_G.rightCols<2>() = -u * y.transpose();
  return -side_ / bits.z() * by_y.inverse() * by_G;
}

std::optional<double> TagTemplate::Step(const Sums& sums, double damping) {
  // px; more blurred tags cannot be read.
  const double most_blur = std::max(4.0, side_ / border_.width / 2);
  Eigen::Matrix<double, kParameters, kParameters> damped =
      sums.topLeftCorner<kParameters, kParameters>();
  damped.diagonal() *= 1 + damping;
  const Vector gradient = sums.col(kResidual).head<kParameters>();
  const Vector change = damped.ldlt().solve(gradient);
  if (!change.allFinite()) return std::nullopt;
  double largest = 0;
  for (const auto& corner : corners_) {
    largest = std::max(largest, (CornerByG(corner) * change.head<8>()).norm());
  }
  // Never more than half a bit a step: farther off the template is not informative.
  const double limit = side_ / border_.width / 2;
  const double scale = largest > limit ? limit / largest : 1;
  state_.G.row(0) += scale * change.segment<3>(0).transpose();
  state_.G.row(1) += scale * change.segment<3>(3).transpose();
  state_.G.row(2).head<2>() += scale * change.segment<2>(6).transpose();
  state_.level += change[8];
  state_.contrast += change[9];
  state_.gradient += change.segment<2>(10);
  state_.blur = std::clamp(state_.blur + scale * change[12], kPixelSigma, most_blur);
  SetBeyond(state_.beyond + scale * change[kBeyond]);
  return change.dot(gradient);
}

void TagTemplate::Return(const State& to) {
  state_ = to;
  SetBeyond(to.beyond);
}

TagTemplate::Minimum TagTemplate::MinimumBySums(Sums sums) const {
  const Matrix information = sums.topLeftCorner<kParameters, kParameters>();
  const double variance = sums(kResidual, kResidual) / (sums(kCount, kCount) - kParameters);
  return {std::move(sums), information.ldlt().solve(Matrix::Identity()), variance};
}

std::optional<TagTemplate::Minimum> TagTemplate::Descend(std::size_t stride) {
  constexpr int kSteps = 40;
  constexpr double kFirstDamping = 1e-3, kLeastDamping = 1e-7, kDampingStep = 10;
  // The square of a step in standard deviations that is near enough: a tenth of one; half of one,
  // where a step over all pixels follows.
  constexpr double kNear = 0.01, kNearBeforeFinish = 0.25;
  const double enough = stride == 1 ? kNear : kNearBeforeFinish;
  const std::size_t pixels = pixels_.size() / stride;
  const auto count = static_cast<double>(pixels);
  Sums now = Linearise(state_, stride, Columns::kParameters);
  double damping = kFirstDamping;
  for (int step = 0; step < kSteps; ++step) {
    const State before = state_;
    const double square_sum = now(kResidual, kResidual);
    const double promised = Step(now, damping).value_or(0);
    const bool far = promised * count >= enough * square_sum;
    const Sums next = far ? Linearise(state_, stride, Columns::kParameters) : now;
    const double gain = square_sum / next(kResidual, kResidual) - 1;
    if (gain > 0) {
      damping = std::max(damping / kDampingStep, kLeastDamping);
      now = next;
      UpdateCorners();
    } else {
      damping *= kDampingStep;
      Return(before);
    }
    if (!far || (gain > 0 && gain * count < enough)) {
      return MinimumBySums(Linearise(state_, stride, Columns::kAll));
    }
  }
  return std::nullopt;
}

std::size_t TagTemplate::Stride() const {
  constexpr std::size_t kMost = 16;
  return std::clamp<std::size_t>(pixels_.size() / kEnough, 1, kMost);
}

int TagTemplate::StepToApproach() const {
  constexpr double kRoom = 16;  // times what is enough: not all pixels are near an edge
  return std::max(1, static_cast<int>(side_ / std::sqrt(kRoom * kEnough)));
}

std::optional<TagTemplate::Minimum> TagTemplate::DescendSomehow() {
  const std::size_t stride = Stride();
  std::optional<Minimum> coarse = Descend(stride);
  return coarse || stride == 1 ? coarse : Descend(1);
}

std::optional<TagTemplate::Minimum> TagTemplate::Finish() {
  // The minimum over all pixels is some standard deviations away: so near that one step leads
  // there.
  Sums sums = Linearise(state_, 1, Columns::kAll);
  const State before = state_;
  const std::optional<double> gain = Step(sums, 0);
  const double variance = sums(kResidual, kResidual) / sums(kCount, kCount);
  constexpr double kUnlikely = 4;  // times the mean of chi^2
  if (!gain || !(*gain < kUnlikely * kParameters * static_cast<double>(Stride()) * variance)) {
    Return(before);
    LeaveOutBeyondLimit();
    return Descend(1);
  }
  UpdateCorners();
  sums(kResidual, kResidual) -= *gain;
  return MinimumBySums(std::move(sums));
}

float TagTemplate::ResidualOf(const Strip& strip, int lane) const {
  const double light = 1 + state_.gradient.dot(Eigen::Vector2d(strip.x[lane], strip.y[lane]));
  const double level = state_.level + state_.contrast * strip.drawn.value[lane];
  return std::abs(static_cast<float>(strip.gray[lane] - light * level));
}

float TagTemplate::LargestResidual() {
  std::vector<double> sizes;
  ForEachDrawn(Stride(), [&](const Strip& strip, int l) { sizes.push_back(ResidualOf(strip, l)); });
  constexpr double kOutlier = 4;  // sigmas; of normal noise one pixel in 16,000 is beyond
  const double unlikely = kOutlier * kSigmaPerMad * Median(std::move(sizes));
  // What covers a tag differs from one of its colours by half the step between them at least; it
  // may have displaced the levels. Errors of the template at its edges are a quarter of the step at
  // most.
  const double half_step = std::abs(state_.contrast);
  return static_cast<float>(std::clamp(unlikely, half_step / 2, half_step * 3 / 4));
}

void TagTemplate::LeaveOutBeyondLimit() {
  std::vector<Pixel> near;
  near.reserve(pixels_.size());
  std::size_t i = 0;
  ForEachDrawn(1, [&](const Strip& strip, int l) {
    if (ResidualOf(strip, l) <= limit_) near.push_back(pixels_[i]);
    ++i;
  });
  pixels_ = std::move(near);
  limit_ = std::numeric_limits<float>::infinity();
}

void TagTemplate::StartLevels() {
  Correlation all;
  ForEachDrawn(Stride(),
               [&](const Strip& strip, int l) { all.Add(strip.drawn.value[l], strip.gray[l]); });
  const double variance = all.n * all.xx - all.x * all.x;
  state_.contrast = variance > 0 ? (all.n * all.xy - all.x * all.y) / variance : 0;
  state_.level = (all.y - state_.contrast * all.x) / all.n;
}

std::vector<DistortionMeasurement> TagTemplate::MeasureDistortion(const Minimum& minimum) const {
  const auto& [sums, covariance, variance] = minimum;
  // The other parameters are eliminated.
  using Information = Eigen::Matrix<double, kDistortionTerms, kDistortionTerms>;
  const Eigen::Matrix<double, kParameters, kDistortionTerms> mixed =
      sums.block<kParameters, kDistortionTerms>(0, kDistortion);
  const Information information =
      sums.block<kDistortionTerms, kDistortionTerms>(kDistortion, kDistortion) -
      mixed.transpose() * covariance * mixed;
  const LocalDistortion gradient =
      sums.block<kDistortionTerms, 1>(kDistortion, kResidual) -
      mixed.transpose() * covariance * sums.block<kParameters, 1>(0, kResidual);
  const SymmetricEigen axes = DecomposeSymmetric(Eigen::MatrixXd(information));
  // Smaller ones are lost in the rounding of single precision.
  constexpr double kRounding = 1e-4;
  const double least = kRounding * axes.values[kDistortionTerms - 1];
  std::vector<DistortionMeasurement> measurements;
  for (int i = 0; i < kDistortionTerms; ++i) {
    const double about = axes.values[i];
    if (!(about > least)) continue;
    const LocalDistortion along = axes.vectors.col(i);
    measurements.push_back({basis_->p(),
                            along,
                            along.dot(distortion_) + along.dot(gradient) / about,
                            variance / about});
  }
  return measurements;
}

std::array<DistortionSensitivity, 4> TagTemplate::Sensitivities(const Minimum& minimum) const {
  const auto& [sums, covariance, variance] = minimum;
  const Eigen::Matrix<double, 8, kDistortionTerms> G_by_distortion =
      -covariance.topRows<8>() * sums.block<kParameters, kDistortionTerms>(0, kDistortion);
  std::array<DistortionSensitivity, 4> sensitivities;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Matrix<double, 2, 8> by_G = CornerByG(corners_[k]);
    const Eigen::Matrix2d of_corner =
        variance * by_G * covariance.topLeftCorner<8, 8>() * by_G.transpose();
    sensitivities[k] = {
        {{basis_->p(), distortion_, by_G * G_by_distortion + basis_->At(corners_[k] - centre_)}},
        std::sqrt(of_corner.trace() / 2)};
  }
  return sensitivities;
}

double TagTemplate::Moved() const {
  double farthest = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    farthest = std::max(farthest, (corners_[k] - start_[k]).norm());
  }
  return farthest;
}

bool TagTemplate::IsTag() const {
  return Moved() < side_ / 2 && state_.contrast * border_.outside_sign > 0;
}

std::optional<std::vector<DistortionMeasurement>> TagTemplate::Approach() {
  if (pixels_.size() <= kParameters) return std::nullopt;
  StartLevels();
  std::optional<Minimum> minimum = DescendSomehow();
  // The pixels were chosen to half a bit around the start.
  if (Moved() > side_ / border_.width / 4) {
    ChoosePixels(StepToApproach());
    if (pixels_.size() <= kParameters) return std::nullopt;
    minimum = DescendSomehow();
  }
  if (!minimum || !IsTag()) return std::nullopt;
  sensitivities_ = Sensitivities(*minimum);
  return MeasureDistortion(*minimum);
}

std::optional<TagTemplate> TagTemplate::AtCorner(std::size_t k,
                                                 const DistortionField& field) const {
  TagTemplate part = *this;
  const Eigen::Vector2d middle = window_.center();
  const bool right = k == 1 || k == 2, lower = k < 2;
  (right ? part.window_.min() : part.window_.max()).x() = middle.x();
  (lower ? part.window_.min() : part.window_.max()).y() = middle.y();
  part.limit_ = std::numeric_limits<float>::infinity();
  part.SetCorners(corners_);
  part.distortion_ = field.At(part.basis_->p());
  part.SetCorners(corners_);
  part.ChoosePixels(StepToApproach());
  if (part.pixels_.size() <= kParameters) return std::nullopt;
  const std::optional<Minimum> minimum = part.DescendSomehow();
  if (!minimum || !part.IsTag()) return std::nullopt;
  part.sensitivities_ = part.Sensitivities(*minimum);
  return part;
}

std::optional<TagFit> TagTemplate::Fit(const DistortionField& field) {
  Quad moved = corners_;
  for (std::size_t k = 0; k < 4; ++k) moved[k] += field.Change(sensitivities_[k]);
  distortion_ = field.At(basis_->p());
  SetCorners(moved);
  std::optional<Minimum> minimum;
  // Again where pixels are covered: what they have displaced must not decide which ones those are.
  constexpr int kRounds = 3;
  for (int round = 0; round < kRounds; ++round) {
    ChoosePixels(1, kReach * state_.blur);
    const std::size_t chosen = pixels_.size();
    if (chosen <= kParameters) return std::nullopt;
    limit_ = LargestResidual();
    minimum = Finish();
    if (!minimum || minimum->sums(kCount, kCount) == static_cast<double>(chosen)) break;
  }
  if (!minimum || !IsTag()) return std::nullopt;
  TagFit fit;
  fit.corners = corners_;
  fit.sensitivities = Sensitivities(*minimum);
  fit.measurements = MeasureDistortion(*minimum);
  for (const DistortionSensitivity& sensitivity : fit.sensitivities) {
    // Also false for NaN.
    if (!(sensitivity.sigma < side_ / 4)) return std::nullopt;
  }
  return fit;
}

}  // namespace plenocal::internal
