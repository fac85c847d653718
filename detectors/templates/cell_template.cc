// SPDX-License-Identifier: Apache-2.0
#include "detectors/templates/cell_template.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "calib/kernels/processors.h"

namespace plenocal::internal {

CellTemplate::CellTemplate(std::vector<float> cells, int n) : n_(n), cells_(std::move(cells)) {
  cells_.resize(2 * n * (n + 1), 0.f);
  for (Profile* profile : {&across_, &down_}) profile->cells.resize(n);
}

CellTemplate::CellTemplate(std::vector<float> cells, std::vector<float> lines)
    : CellTemplate(std::move(cells), static_cast<int>(lines.size()) - 1) {
  lines_ = std::move(lines);
}

void CellTemplate::SetBeyond(float value) {
  for (int i = 0; i < n_; ++i) {
    for (const int cell : {i, n_ * (n_ - 1) + i, n_ * i, n_ * i + n_ - 1}) cells_[cell] = value;
  }
}

PLENOCAL_LANES void CellTemplate::Profile::Fill(const Lanes& at,
                                                const Lanes& reach,
                                                const StepBlur& blur,
                                                int n,
                                                const std::vector<float>& lines) {
  // Boundary i is between cells i - 1 and i; the outermost cells have no end.
  const float last = static_cast<float>(n - 1);
  Lanes from = at - reach, to = at + reach;
  // Also for NaN.
  from = from > 1 ? from : Lanes{} + 1;
  from = from < last ? from : Lanes{} + last;
  to = to > 1 ? to : Lanes{} + 1;
  to = to < last ? to : Lanes{} + last;
  IntLanes low = __builtin_convertvector(from, IntLanes);
  low = __builtin_convertvector(low, Lanes) < from ? low + 1 : low;
  IntLanes boundaries = __builtin_convertvector(to, IntLanes) - low + 1;
  if (!lines.empty()) {
    const auto begin = lines.begin() + 1, end = lines.end() - 1;
    for (int l = 0; l < kLanes; ++l) {
      const auto lowest = std::lower_bound(begin, end - 1, at[l] - reach[l]);
      const auto highest = std::upper_bound(begin + 1, end, at[l] + reach[l]) - 1;
      low[l] = static_cast<int>(lowest - lines.begin());
      boundaries[l] = static_cast<int>(highest - lowest) + 1;
    }
  }
  int most = 0;
  for (int l = 0; l < kLanes; ++l) most = std::max(most, boundaries[l]);
  first = low - 1;
  Lanes boundary = __builtin_convertvector(low, Lanes);
  Lanes cumulative = Lanes{} + 1, density{}, bent{};
  for (int k = 0; k < most; ++k) {
    Lanes place = boundary;
    for (int l = 0; l < kLanes && !lines.empty(); ++l) {
      place[l] = lines[static_cast<size_t>(std::min(low[l] + k, n))];
    }
    Lanes next, next_density, next_bent;
    blur.At(at - place, &next, &next_density, &next_bent);
    const auto exists = boundary <= last;
    next = exists ? next : Lanes{};
    next_density = exists ? next_density : Lanes{};
    next_bent = exists ? next_bent : Lanes{};
    cells[k] = {cumulative - next, density - next_density, bent - next_bent};
    cumulative = next;
    density = next_density;
    bent = next_bent;
    boundary += 1;
  }
  cells[most] = {cumulative, density, bent};
  count = most + 1;
}

/// Adds the share of the cells that are not outermost ones.
PLENOCAL_LANES void CellTemplate::Profile::AddKnown(int n, Lanes* known) const {
  for (int k = 0; k < count; ++k) {
    const IntLanes cell = first + k;
    *known += ((cell > 0) & (cell < n - 1)) ? cells[k].share : Lanes{};
  }
}

PLENOCAL_LANES void CellTemplate::AddProduct(const BlurredPlace& at,
                                             const Lanes& weight,
                                             Drawn* drawn) {
  const auto& [u, v, blur_u, blur_v, r, across, down] = at;
  across_.Fill(u, kNormalReach * blur_u, across, n_, lines_);
  down_.Fill(v, kNormalReach * blur_v, down, n_, lines_);
  const float* const cells = cells_.data();
  const IntLanes corner = down_.first * n_ + across_.first;
  Lanes ss{}, sb{}, bs{}, dd{}, bb{}, ds{}, sd{}, bd{}, db{};
  for (int i = 0; i < down_.count; ++i) {
    Lanes share{}, slope{}, bend{};
    for (int j = 0; j < across_.count; ++j) {
      const IntLanes cell = corner + (i * n_ + j);
      Lanes value;
      for (int l = 0; l < kLanes; ++l) value[l] = cells[cell[l]];
      share += value * across_.cells[j].share;
      slope += value * across_.cells[j].slope;
      bend += value * across_.cells[j].bend;
    }
    const auto& [s, d, b] = down_.cells[i];
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
  Lanes known_u{}, known_v{};
  across_.AddKnown(n_, &known_u);
  down_.AddKnown(n_, &known_v);
  drawn->value += weight * (ss + r * (dd + 0.5f * r * bb));
  drawn->by_u += weight * (ds + r * bd) / blur_u;
  drawn->by_v += weight * (sd + r * db) / blur_v;
  drawn->bend += weight * (bs + sb);
  drawn->twist += weight * dd;
  drawn->by_beyond += weight * (1 - known_u * known_v);
}

PLENOCAL_FOR_EACH_PROCESSOR void CellTemplate::Draw(const Eigen::Matrix3f& G,
                                                    float blur,
                                                    float pixel,
                                                    const Lanes& x,
                                                    const Lanes& y,
                                                    Drawn* drawn) {
  *drawn = {};
  drawn->scale = G(2, 0) * x + G(2, 1) * y + 1;
  const Lanes inverse = 1 / drawn->scale;
  drawn->u = (G(0, 0) * x + G(0, 1) * y + G(0, 2)) * inverse;
  drawn->v = (G(1, 0) * x + G(1, 1) * y + G(1, 2)) * inverse;
  const Lanes u_x = (G(0, 0) - drawn->u * G(2, 0)) * inverse;
  const Lanes u_y = (G(0, 1) - drawn->u * G(2, 1)) * inverse;
  const Lanes v_x = (G(1, 0) - drawn->v * G(2, 0)) * inverse;
  const Lanes v_y = (G(1, 1) - drawn->v * G(2, 1)) * inverse;
  Lanes length_u = u_x * u_x + u_y * u_y, length_v = v_x * v_x + v_y * v_y;
  Sqrt(&length_u);
  Sqrt(&length_v);
  const Lanes r = (u_x * v_x + u_y * v_y) / (length_u * length_v);
  const Lanes blur_u = blur * length_u, blur_v = blur * length_v;
  constexpr float kSeries = 0.3f, kMostCommon = 0.97f;
  const Lanes size = r < 0 ? -r : r;
  Lanes common = size < kMostCommon ? size : Lanes{} + kMostCommon;
  common = size > kSeries ? common : Lanes{};
  float most_common = 0;
  for (int l = 0; l < kLanes; ++l) most_common = std::max(most_common, common[l]);
  Lanes rest = 1 - common;
  Sqrt(&rest);
  const Lanes rest_u = blur_u * rest, rest_v = blur_v * rest;
  StepBlur across(rest_u), down(rest_v);
  if (pixel > 0) {
    Lanes split_u, split_v;
    PixelSplit(u_x, u_y, pixel, &split_u);
    PixelSplit(v_x, v_y, pixel, &split_v);
    // Of a common part the pixel's share is not known by axis.
    split_u = common == 0 ? length_u * split_u : Lanes{};
    split_v = common == 0 ? length_v * split_v : Lanes{};
    across = StepBlur(rest_u, split_u);
    down = StepBlur(rest_v, split_v);
  }
  if (most_common == 0) {
    AddProduct({drawn->u, drawn->v, rest_u, rest_v, r, across, down}, Lanes{} + 1, drawn);
  } else {
    // The trapezoidal rule over the common part; with this step its error is below a thousandth.
    const Lanes step = 1.7f * rest;
    const int most = static_cast<int>(std::ceil(2.6f / (1.7f * std::sqrt(1 - most_common))));
    const Lanes part = common == 0 ? r : Lanes{};  // left to the series
    Lanes shift = common;
    Sqrt(&shift);
    const Lanes shift_u = blur_u * shift, shift_v = r < 0 ? -blur_v * shift : blur_v * shift;
    Lanes total{};
    for (int k = -most; k <= most; ++k) {
      Lanes distribution, density;
      Normal(static_cast<float>(k) * step, &distribution, &density);
      total += density;
    }
    for (int k = -most; k <= most; ++k) {
      const Lanes at = static_cast<float>(k) * step;
      Lanes distribution, density;
      Normal(at, &distribution, &density);
      AddProduct(
          {drawn->u + shift_u * at, drawn->v + shift_v * at, rest_u, rest_v, part, across, down},
          density / total,
          drawn);
    }
  }
  // The heat equation: dT/dw = w times T's Laplacian.
  drawn->by_blur = (drawn->bend + 2 * r * drawn->twist) / (blur * rest * rest);
}

}  // namespace plenocal::internal
