// SPDX-License-Identifier: Apache-2.0
#include "detectors/tag_template.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "detectors/tag_step.h"

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

double Area(const Quad& q) {
  const Eigen::Vector2d a = q[2] - q[0], b = q[3] - q[1];
  return std::abs(a.x() * b.y() - a.y() * b.x()) / 2;
}

}  // namespace

Eigen::Matrix3d UnitSquareHomography(const Quad& q) {
  const Eigen::Vector2d sum = q[0] - q[1] + q[2] - q[3];
  Eigen::Matrix2d d;
  d << q[1] - q[2], q[3] - q[2];
  const Eigen::Vector2d g = d.inverse() * sum;
  Eigen::Matrix3d h;
  h << q[1] - q[0] + g[0] * q[1], q[3] - q[0] + g[1] * q[3], q[0], g[0], g[1], 1;
  return h;
}

TagTemplate::TagTemplate(const cv::Mat& gray,
                         const SeenTag& tag,
                         const TagBorder& border,
                         double blur)
    : gray_(gray), border_(border), bits_(border.width + 2 * kAround) {
  const int n = bits_;
  cells_.assign(static_cast<std::size_t>(n) * n, 1.f);
  for (int y = 0; y < border.width; ++y) {
    for (int x = 0; x < border.width; ++x) {
      cells_[(y + kAround) * n + x + kAround] = tag.bits[y * border.width + x] ? 1.f : -1.f;
    }
  }
  if (border.corner_squares) {
    for (const int y : {1, n - 2}) {
      for (const int x : {1, n - 2}) cells_[y * n + x] = -1;
    }
  }
  for (Profile* profile : {&across_, &down_}) {
    for (auto* values : {&profile->share, &profile->slope, &profile->bend}) values->resize(n);
  }
  state_.blur = blur;
  SetBeyond(0);
  SetCorners(tag.corners);
  ChoosePixels();
}

void TagTemplate::SetCorners(const Quad& corners) {
  corners_ = corners;
  side_ = std::sqrt(Area(corners));
  centre_ = (corners[0] + corners[1] + corners[2] + corners[3]) / 4;
  // The unit square's y axis points up, the drawing's down.
  Eigen::Matrix3d to_bits, to_image;
  to_bits << border_.width, 0, kAround, 0, -border_.width, border_.width + kAround, 0, 0, 1;
  to_image << side_, 0, centre_.x(), 0, side_, centre_.y(), 0, 0, 1;
  const Eigen::Matrix3d h = UnitSquareHomography(corners);
  state_.G = to_bits * h.inverse() * to_image;
  state_.G /= state_.G(2, 2);
}

void TagTemplate::UpdateCorners() {
  const Eigen::Matrix3d inverse = state_.G.inverse();
  const double low = kAround, high = kAround + border_.width;
  const std::array<Eigen::Vector3d, 4> on_drawing{Eigen::Vector3d(low, high, 1),
                                                  Eigen::Vector3d(high, high, 1),
                                                  Eigen::Vector3d(high, low, 1),
                                                  Eigen::Vector3d(low, low, 1)};
  for (std::size_t k = 0; k < 4; ++k) {
    corners_[k] = (inverse * on_drawing[k]).hnormalized() * side_ + centre_;
  }
}

/// Those on the tag and half a bit around it: farther off, what is beyond the bits known matters
/// too much.
void TagTemplate::ChoosePixels() {
  pixels_.clear();
  if (!state_.G.allFinite()) return;
  const double outer = 0.5 * border_.width + 0.5, inner = 0.5 * border_.width - border_.ring;
  Eigen::AlignedBox2d box;
  for (const auto& c : corners_) box.extend(c);
  const double room = 2 + side_ / border_.width;
  const int x_first = std::max(0, static_cast<int>(std::floor(box.min().x() - room)));
  const int y_first = std::max(0, static_cast<int>(std::floor(box.min().y() - room)));
  const int x_last = std::min(gray_.cols - 1, static_cast<int>(std::ceil(box.max().x() + room)));
  const int y_last = std::min(gray_.rows - 1, static_cast<int>(std::ceil(box.max().y() + room)));
  for (int y = y_first; y <= y_last; ++y) {
    for (int x = x_first; x <= x_last; ++x) {
      const Eigen::Vector2d at = (Eigen::Vector2d(x, y) - centre_) / side_;
      const Eigen::Vector3d bits = state_.G * at.homogeneous();
      if (bits.z() <= 0) continue;
      const double from_middle = (bits.hnormalized().array() - 0.5 * bits_).abs().maxCoeff();
      if (from_middle > outer) continue;
      pixels_.push_back(
          {x, y, static_cast<float>(at.x()), static_cast<float>(at.y()), from_middle < inner});
    }
  }
}

void TagTemplate::Profile::Fill(float at, float blur, int n) {
  const StepTable& step = StepTable::Get();
  const float reach = StepTable::kReach * blur;
  // The boundary between bits i - 1 and i is at i; the outermost bits have no end.
  const float last = static_cast<float>(n - 1);
  const int low = static_cast<int>(std::ceil(std::clamp(at - reach, 1.f, last)));
  const int high = static_cast<int>(std::floor(std::clamp(at + reach, 1.f, last)));
  first = low - 1;
  count = 0;
  const float inverse = 1 / blur;
  float cumulative = 1, density = 0, bent = 0;
  for (int boundary = low; boundary <= high; ++boundary) {
    const float z = (at - static_cast<float>(boundary)) * inverse;
    float value, twice_density;
    step(z, &value, &twice_density);
    const float next = (1 + value) / 2, next_density = twice_density / 2;
    const float next_bent = -z * next_density;
    share[count] = cumulative - next;
    slope[count] = density - next_density;
    bend[count] = bent - next_bent;
    ++count;
    cumulative = next;
    density = next_density;
    bent = next_bent;
  }
  share[count] = cumulative;
  slope[count] = density;
  bend[count] = bent;
  ++count;
}

void TagTemplate::SetBeyond(double value) {
  state_.beyond = value;
  const int n = bits_;
  for (int i = 0; i < n; ++i) {
    for (const int cell : {i, n * (n - 1) + i, n * i, n * i + n - 1}) {
      cells_[cell] = static_cast<float>(value);
    }
  }
}

TagTemplate::Drawn TagTemplate::Draw(const Eigen::Matrix3f& G, float blur, float x, float y) {
  Drawn drawn;
  drawn.scale = G(2, 0) * x + G(2, 1) * y + 1;
  const float inverse = 1 / drawn.scale;
  drawn.u = (G(0, 0) * x + G(0, 1) * y + G(0, 2)) * inverse;
  drawn.v = (G(1, 0) * x + G(1, 1) * y + G(1, 2)) * inverse;
  const float u_x = (G(0, 0) - drawn.u * G(2, 0)) * inverse;
  const float u_y = (G(0, 1) - drawn.u * G(2, 1)) * inverse;
  const float v_x = (G(1, 0) - drawn.v * G(2, 0)) * inverse;
  const float v_y = (G(1, 1) - drawn.v * G(2, 1)) * inverse;
  const float blur_y = blur / static_cast<float>(side_);
  const float length_u = std::sqrt(u_x * u_x + u_y * u_y);
  const float length_v = std::sqrt(v_x * v_x + v_y * v_y);
  const float r = (u_x * v_x + u_y * v_y) / (length_u * length_v);
  const float blur_u = blur_y * length_u, blur_v = blur_y * length_v;
  constexpr float kSeries = 0.3f, kMostCommon = 0.97f;
  const float common = std::abs(r) > kSeries ? std::min(std::abs(r), kMostCommon) : 0;
  const float rest = std::sqrt(1 - common);
  if (common == 0) {
    AddProduct(drawn.u, drawn.v, blur_u, blur_v, r, 1, &drawn);
  } else {
    // The trapezoidal rule over the common part; with this step its error is below a thousandth.
    const float step = 1.7f * rest;
    const int most = static_cast<int>(std::ceil(2.6f / step));
    const float shift_u = blur_u * std::sqrt(common);
    const float shift_v = std::copysign(blur_v * std::sqrt(common), r);
    float total = 0;
    for (int k = -most; k <= most; ++k) total += std::exp(-k * k * step * step / 2);
    for (int k = -most; k <= most; ++k) {
      const float at = k * step, weight = std::exp(-at * at / 2) / total;
      AddProduct(drawn.u + shift_u * at,
                 drawn.v + shift_v * at,
                 blur_u * rest,
                 blur_v * rest,
                 0,
                 weight,
                 &drawn);
    }
  }
  // The heat equation: dT/dw = w times T's Laplacian.
  drawn.by_blur = (drawn.bend + 2 * r * drawn.twist) / (blur * rest * rest);
  return drawn;
}

void TagTemplate::AddProduct(
    float u, float v, float blur_u, float blur_v, float r, float weight, Drawn* drawn) {
  across_.Fill(u, blur_u, bits_);
  down_.Fill(v, blur_v, bits_);
  float ss = 0, sb = 0, bs = 0, dd = 0, bb = 0, ds = 0, sd = 0, bd = 0, db = 0;
  for (int i = 0; i < down_.count; ++i) {
    const float* row = &cells_[(down_.first + i) * bits_ + across_.first];
    float share = 0, slope = 0, bend = 0;
    for (int j = 0; j < across_.count; ++j) {
      share += row[j] * across_.share[j];
      slope += row[j] * across_.slope[j];
      bend += row[j] * across_.bend[j];
    }
    const float s = down_.share[i], d = down_.slope[i], b = down_.bend[i];
    ss += share * s;
    sb += share * b;
    sd += share * d;
    bs += bend * s;
    bd += bend * d;
    bb += bend * b;
    ds += slope * s;
    dd += slope * d;
    db += slope * b;
  }
  drawn->value += weight * (ss + r * (dd + r / 2 * bb));
  drawn->by_u += weight * (ds + r * bd) / blur_u;
  drawn->by_v += weight * (sd + r * db) / blur_v;
  drawn->bend += weight * (bs + sb);
  drawn->twist += weight * dd;
  drawn->by_beyond += weight * (1 - across_.Known(bits_) * down_.Known(bits_));
}

/// The share of the bits that are known: all but the outermost.
float TagTemplate::Profile::Known(int n) const {
  float known = 0;
  for (int i = 0; i < count; ++i) {
    if (first + i > 0 && first + i < n - 1) known += share[i];
  }
  return known;
}

void TagTemplate::Search(int reach) {
  const Eigen::Matrix3f G = state_.G.cast<float>();
  const auto blur = static_cast<float>(state_.blur);
  std::vector<float> values;
  values.reserve(pixels_.size());
  for (const Pixel& p : pixels_) values.push_back(Draw(G, blur, p.x, p.y).value);
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
  ChoosePixels();
}

double TagTemplate::DataCorrelation() {
  const Eigen::Matrix3f G = state_.G.cast<float>();
  const auto blur = static_cast<float>(state_.blur);
  Correlation data;
  for (const Pixel& p : pixels_) {
    if (p.data) data.Add(gray_.at<unsigned char>(p.row, p.column), Draw(G, blur, p.x, p.y).value);
  }
  return data.Coefficient() * border_.outside_sign;
}

TagTemplate::Sums TagTemplate::Linearise(const State& state) {
  const Eigen::Matrix3f G = state.G.cast<float>();
  const auto blur = static_cast<float>(state.blur);
  // Single precision within a row of pixels only.
  Sums sums = Sums::Zero();
  Eigen::Matrix<float, kPadded, kPadded> row = Eigen::Matrix<float, kPadded, kPadded>::Zero();
  Eigen::Matrix<float, kPadded, 1> j = Eigen::Matrix<float, kPadded, 1>::Zero();
  const Eigen::Vector2f gradient = state.gradient.cast<float>();
  const float m = static_cast<float>(state.level), k = static_cast<float>(state.contrast);
  for (std::size_t i = 0; i < pixels_.size(); ++i) {
    const Pixel& p = pixels_[i];
    const Drawn drawn = Draw(G, blur, p.x, p.y);
    const float light = 1 + gradient.x() * p.x + gradient.y() * p.y;
    const float level = m + k * drawn.value, strength = light * k;
    const float by_u = strength * drawn.by_u / drawn.scale;
    const float by_v = strength * drawn.by_v / drawn.scale;
    const float by_scale = -(by_u * drawn.u + by_v * drawn.v);
    const float residual = gray_.at<unsigned char>(p.row, p.column) - light * level;
    j.head<kParameters + 1>() << by_u * p.x, by_u * p.y, by_u, by_v * p.x, by_v * p.y, by_v,
        by_scale * p.x, by_scale * p.y, light, light * drawn.value, level * p.x, level * p.y,
        strength * drawn.by_blur, strength * drawn.by_beyond, residual;
    row.noalias() += j * j.transpose();
    if (i + 1 == pixels_.size() || pixels_[i + 1].row != p.row) {
      sums += row.cast<double>();
      row.setZero();
    }
  }
  // What is beyond is about as bright as the tag, as if one pixel of one gray level's noise said
  // so.
  sums(kBeyond, kBeyond) += 1;
  sums(kBeyond, kResidual) -= state.beyond;
  return sums;
}

Eigen::Matrix<double, 2, 8> TagTemplate::CornerByG(const Eigen::Vector2d& corner) const {
  // The corner stays where it is on the drawing: du = U_y dy + U_G dG = 0.
  const Eigen::Vector2d y = (corner - centre_) / side_;
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

TagTemplate::Sums TagTemplate::Descend() {
  constexpr int kSteps = 40;
  constexpr double kNear = 0.01;
  constexpr double kLeastBlur = 0.29;  // of the pixel's own area, 1 / sqrt(12)
  constexpr double kMostBlur = 4;
  const auto count = static_cast<double>(pixels_.size());
  Sums now = Linearise(state_);
  double damping = 1e-3;
  for (int step = 0; step < kSteps && damping < 1; ++step) {
    Eigen::Matrix<double, kParameters, kParameters> damped =
        now.topLeftCorner<kParameters, kParameters>();
    damped.diagonal() *= 1 + damping;
    const Vector gradient = now.col(kResidual).head<kParameters>();
    const Vector change = damped.ldlt().solve(gradient);
    const double square_sum = now(kResidual, kResidual);
    // The square of the step in standard deviations; a tenth of one is near enough.
    if (!change.allFinite() || change.dot(gradient) * count < kNear * square_sum) break;
    double largest = 0;
    for (const auto& corner : corners_) {
      largest = std::max(largest, (CornerByG(corner) * change.head<8>()).norm());
    }
    // Never more than half a bit a step: farther off the drawing says nothing.
    const double limit = side_ / border_.width / 2;
    const double scale = largest > limit ? limit / largest : 1;
    const State before = state_;
    state_.G.row(0) += scale * change.segment<3>(0).transpose();
    state_.G.row(1) += scale * change.segment<3>(3).transpose();
    state_.G.row(2).head<2>() += scale * change.segment<2>(6).transpose();
    state_.level += change[8];
    state_.contrast += change[9];
    state_.gradient += change.segment<2>(10);
    state_.blur = std::clamp(state_.blur + scale * change[12], kLeastBlur, kMostBlur);
    SetBeyond(state_.beyond + scale * change[kBeyond]);
    const Sums next = Linearise(state_);
    if (next(kResidual, kResidual) < square_sum) {
      damping = std::max(damping / 10, 1e-7);
      const double gain = square_sum / next(kResidual, kResidual) - 1;
      now = next;
      UpdateCorners();
      if (gain * count < kNear) break;
    } else {
      state_ = before;
      SetBeyond(state_.beyond);
      damping *= 10;
    }
  }
  return now;
}

void TagTemplate::StartLevels() {
  const Eigen::Matrix3f G = state_.G.cast<float>();
  const auto blur = static_cast<float>(state_.blur);
  Correlation all;
  for (const Pixel& p : pixels_) {
    all.Add(Draw(G, blur, p.x, p.y).value, gray_.at<unsigned char>(p.row, p.column));
  }
  const double variance = all.n * all.xx - all.x * all.x;
  state_.contrast = variance > 0 ? (all.n * all.xy - all.x * all.y) / variance : 0;
  state_.level = (all.y - state_.contrast * all.x) / all.n;
}

bool TagTemplate::Fit() {
  if (pixels_.size() <= kParameters) return false;
  const Quad start = corners_;
  const auto moved = [&] {
    double farthest = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      farthest = std::max(farthest, (corners_[k] - start[k]).norm());
    }
    return farthest;
  };
  StartLevels();
  Sums sums = Descend();
  // The pixels were chosen to half a bit around the start.
  if (moved() > side_ / border_.width / 4) {
    ChoosePixels();
    if (pixels_.size() <= kParameters) return false;
    sums = Descend();
  }
  using Matrix = Eigen::Matrix<double, kParameters, kParameters>;
  const double variance =
      sums(kResidual, kResidual) / static_cast<double>(pixels_.size() - kParameters);
  const Matrix information = sums.topLeftCorner<kParameters, kParameters>();
  const Matrix covariance = variance * information.ldlt().solve(Matrix::Identity());
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Matrix<double, 2, 8> by_G = CornerByG(corners_[k]);
    const Eigen::Matrix2d of_corner = by_G * covariance.topLeftCorner<8, 8>() * by_G.transpose();
    sigma_[k] = std::sqrt(of_corner.trace() / 2);
    // Also false for NaN.
    if (!(sigma_[k] < side_ / 4)) return false;
  }
  return moved() < side_ / 2 && state_.contrast * border_.outside_sign > 0;
}

}  // namespace plenocal::internal
