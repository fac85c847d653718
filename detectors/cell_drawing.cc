// SPDX-License-Identifier: Apache-2.0
#include "detectors/cell_drawing.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "detectors/processors.h"
#include "detectors/tag_step.h"

namespace plenocal::internal {

CellDrawing::CellDrawing(std::vector<float> cells, int n) : n_(n), cells_(std::move(cells)) {
  for (Profile* profile : {&across_, &down_}) {
    for (auto* values : {&profile->share, &profile->slope, &profile->bend}) values->resize(n);
  }
}

void CellDrawing::SetBeyond(float value) {
  for (int i = 0; i < n_; ++i) {
    for (const int cell : {i, n_ * (n_ - 1) + i, n_ * i, n_ * i + n_ - 1}) cells_[cell] = value;
  }
}

[[gnu::always_inline]] inline void CellDrawing::Profile::Fill(float at, float blur, int n) {
  const StepTable& step = StepTable::Get();
  const float reach = StepTable::kReach * blur;
  // The boundary between bits i - 1 and i is at i; the outermost bits have no end.
  const float last = static_cast<float>(n - 1);
  const float from = std::clamp(at - reach, 1.f, last);
  const int before = static_cast<int>(from);
  const int low = before + (static_cast<float>(before) < from ? 1 : 0);
  const int high = static_cast<int>(std::clamp(at + reach, 1.f, last));
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

/// The share of the bits that are known: all but the outermost.
[[gnu::always_inline]] inline float CellDrawing::Profile::Known(int n) const {
  float known = 0;
  for (int i = 0; i < count; ++i) {
    if (first + i > 0 && first + i < n - 1) known += share[i];
  }
  return known;
}

[[gnu::always_inline]] inline void CellDrawing::AddProduct(
    float u, float v, float blur_u, float blur_v, float r, float weight, Drawn* drawn) {
  across_.Fill(u, blur_u, n_);
  down_.Fill(v, blur_v, n_);
  float ss = 0, sb = 0, bs = 0, dd = 0, bb = 0, ds = 0, sd = 0, bd = 0, db = 0;
  for (int i = 0; i < down_.count; ++i) {
    const float* row = &cells_[(down_.first + i) * n_ + across_.first];
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
  drawn->by_beyond += weight * (1 - across_.Known(n_) * down_.Known(n_));
}

PLENOCAL_FOR_EACH_PROCESSOR CellDrawing::Drawn CellDrawing::Draw(const Eigen::Matrix3f& G,
                                                                 float blur,
                                                                 float x,
                                                                 float y) {
  Drawn drawn;
  drawn.scale = G(2, 0) * x + G(2, 1) * y + 1;
  const float inverse = 1 / drawn.scale;
  drawn.u = (G(0, 0) * x + G(0, 1) * y + G(0, 2)) * inverse;
  drawn.v = (G(1, 0) * x + G(1, 1) * y + G(1, 2)) * inverse;
  const float u_x = (G(0, 0) - drawn.u * G(2, 0)) * inverse;
  const float u_y = (G(0, 1) - drawn.u * G(2, 1)) * inverse;
  const float v_x = (G(1, 0) - drawn.v * G(2, 0)) * inverse;
  const float v_y = (G(1, 1) - drawn.v * G(2, 1)) * inverse;
  const float length_u = std::sqrt(u_x * u_x + u_y * u_y);
  const float length_v = std::sqrt(v_x * v_x + v_y * v_y);
  const float r = (u_x * v_x + u_y * v_y) / (length_u * length_v);
  const float blur_u = blur * length_u, blur_v = blur * length_v;
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

}  // namespace plenocal::internal
