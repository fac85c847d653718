// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/wall_model.h"

#include <algorithm>
#include <limits>
#include <numbers>

#include "apps/photometry/response/noise_line.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/parallel.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

constexpr float kNoBrightness = std::numeric_limits<float>::quiet_NaN();

// Variance of a value between four pixels, by that of one.
double Mixing(const WallSample& s) {
  const double fx = s.x - std::floor(s.x), fy = s.y - std::floor(s.y);
  return (fx * fx + (1 - fx) * (1 - fx)) * (fy * fy + (1 - fy) * (1 - fy));
}

}  // namespace

WallModel::WallModel(WallRecording wall, const std::string& where, int threads)
    : wall_(std::move(wall)),
      threads_(threads),
      grid_(ChooseGrid(wall_, where)),
      projector_(wall_),
      g_(Eigen::VectorXd::Zero(static_cast<Eigen::Index>(wall_.views.size()))),
      used_(Eigen::VectorXd::Ones(g_.size())),
      v_(wall_.views[0].light.size(), CV_32F, cv::Scalar(0)) {
  TabulateNoise();
  Sample();
}

void WallModel::Sample() {
  rows_ = SampleWall(wall_, grid_, threads_);
  c_.assign(rows_.size(), std::vector<float>(static_cast<size_t>(grid_.columns), kNoBrightness));
  around_ = c_;
  contrast_.assign(c_.size(), std::vector<float>(c_.front().size()));
}

size_t WallModel::Measurements() const {
  size_t count = 0;
  for (const WallRow& row : rows_) count += row.samples.size();
  return count;
}

// Variance of rounding to grey values, of one pixel's light.
double WallModel::Rounding(double light) const {
  const ResponseCurve::Table& values = wall_.response.Values();
  const auto above = std::ranges::upper_bound(values, light);
  const auto k = std::clamp<size_t>(
      static_cast<size_t>(above - values.begin()), 1, ResponseCurve::kValues - 1);
  return Square(values[k] - values[k - 1]) / 12;
}

void WallModel::TabulateNoise() {
  for (size_t i = 0; i < log_variances_.size(); ++i) {
    const double light =
        256 * (static_cast<double>(i) + 0.5) / static_cast<double>(log_variances_.size());
    log_variances_[i] = static_cast<float>((noise_gain_ * light + noise_read_ + Rounding(light)) /
                                           Square(light * wall_.reduction));
  }
}

// Variance of the logarithm of a reduced pixel's light.
double WallModel::LogVariance(double light) const {
  const auto i = static_cast<size_t>(light / 256 * static_cast<double>(log_variances_.size()));
  return log_variances_[std::min(i, log_variances_.size() - 1)];
}

double WallModel::Noise(const WallSample& s, double light) const {
  return LogVariance(light) * Mixing(s);
}

// Residuals are linear in the light and relative to that mean: views that see the texture blurred
// have the same mean of the light, but not of its logarithm, nor of its ratio to sharper light.
WallModel::Expected WallModel::Expect(const WallSample& s, const Cell& cell) const {
  // Smallest effective number of samples per pixel: of samples far apart, each the mean of up to
  // four pixels, the mean variance is (2/3)^2 of a pixel's.
  constexpr double kLeastDensity = 4.0 / 9;
  const float c = c_[cell.row][cell.column], around = around_[cell.row][cell.column];
  const double scale = std::exp(Predicted(s)) * wall_.views[s.view].exposure;
  const double light = scale * std::exp(c);
  Expected at{.light = std::isnan(around) ? light : scale * std::exp(around)};
  at.residual = robust_ ? (s.light - light) / at.light : std::log(s.light / light);
  at.weight = 1 / (LogVariance(at.light) * std::max<double>(s.density, kLeastDensity));
  if (robust_) {
    // Values between pixels are off by the contrast of these, which is no reason to leave out.
    const double spread = Noise(s, at.light) + contrast_[cell.row][cell.column];
    at.weight *= TukeyWeight(Square(at.residual) / (Square(kTukeyWidth) * spread));
  }
  return at;
}

double WallModel::Texture(const Cell& cell) const {
  const auto [row, column] = cell;
  if (row == 0 || column == 0 || row + 1 >= c_.size() || column + 1 >= c_[row].size()) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  const float c = c_[row][column];
  return (Square(c_[row - 1][column] - c) + Square(c_[row + 1][column] - c) +
          Square(c_[row][column - 1] - c) + Square(c_[row][column + 1] - c)) /
         4;
}

void WallModel::EstimateWall() {
  for (const auto estimate : {&WallModel::EstimateCell, &WallModel::EstimateAround}) {
    ParallelFor(rows_.size(), threads_, [&](size_t r) {
      for (size_t column = 0; column < c_[r].size(); ++column) (this->*estimate)({r, column});
    });
  }
}

void WallModel::EstimateCell(const Cell& cell) {
  float& c = c_[cell.row][cell.column];
  const auto samples = rows_[cell.row].Samples(cell.column);
  if (std::isnan(c) && !samples.empty()) {
    double sum = 0;
    for (const WallSample& s : samples) sum += s.brightness - Predicted(s);
    c = static_cast<float>(sum / static_cast<double>(samples.size()));
  }
  double sum = 0, weight = 0;
  for (const WallSample& s : samples) {
    const Expected at = Expect(s, cell);
    sum += at.weight * at.residual;
    weight += at.weight;
  }
  // Residuals are relative to the brightness around the cell once weights are robust.
  const float around = around_[cell.row][cell.column];
  const double base = robust_ && !std::isnan(around) ? around : c;
  c = weight > 0 ? static_cast<float>(c + std::log1p(std::exp(base - c) * sum / weight))
                 : kNoBrightness;
}

void WallModel::EstimateAround(const Cell& cell) {
  constexpr size_t kReach = kBlockCells / 2;
  const auto [row, column] = cell;
  double sum = 0, count = 0;
  for (size_t y = row - std::min(row, kReach); y < std::min(row + kReach + 1, rows_.size()); ++y) {
    const size_t end = std::min(column + kReach + 1, c_[y].size());
    for (size_t x = column - std::min(column, kReach); x < end; ++x) {
      if (std::isnan(c_[y][x])) continue;
      sum += std::exp(c_[y][x]);
      count += 1;
    }
  }
  around_[row][column] = static_cast<float>(std::log(sum / count));
  const double contrast = Texture(cell);
  contrast_[row][column] = std::isnan(contrast) ? 0 : static_cast<float>(contrast);
}

void WallModel::EstimateNoise() {
  EstimateWall();
  constexpr Eigen::Index kBins = 64;
  using Sums = Eigen::Array3Xd;  // weight, light, square / what was assumed; by light
  const Sums sums = SumSamples(
      Sums(Sums::Zero(3, kBins)),
      [&](const Cell&, const WallSample& s, const Expected& at, Sums* sum) {
        const double spread = Noise(s, at.light) * at.freedom;
        const double robust = TukeyWeight(Square(at.residual) / (Square(kTukeyWidth) * spread));
        if (robust_ && !(robust > 0)) return;
        const auto bin = std::min(static_cast<Eigen::Index>(at.light / 256 * kBins), kBins - 1);
        const double w = robust_ ? robust : 1;
        sum->col(bin) += Eigen::Array3d(w, w * at.light, w * Square(at.residual) / spread);
      });
  NoiseLine line;
  for (const auto& bin : sums.colwise()) {
    if (bin[0] < 100) continue;
    const double u = bin[1] / bin[0];
    const double assumed = noise_gain_ * u + noise_read_ + Rounding(u);
    const double variance = assumed * bin[2] / bin[0] - Rounding(u);
    line.Add(bin[0] / Square(assumed), u, variance);
  }
  const double gain = line.IsDetermined() ? line.Gain() : 0;
  const double read = line.IsDetermined() ? line.ReadVariance() : 0;
  noise_gain_ = read > 0 && gain > 0 ? gain : std::max(line.GainAlone(), 1e-6);
  noise_read_ = gain > 0 ? std::max(read, 0.0) : 0;
  robust_ = true;
  TabulateNoise();
}

bool WallModel::LeaveOutMisplaced() {
  EstimateWall();
  using Sums = Eigen::Array2Xd;  // square, count; by view
  const Sums sums =
      SumSamples(Sums(Sums::Zero(2, g_.size())),
                 [&](const Cell& cell, const WallSample& s, const Expected& at, Sums* sum) {
                   const double spread = Noise(s, at.light) + contrast_[cell.row][cell.column];
                   sum->col(s.view) += Eigen::Array2d(Square(at.residual) / spread, 1);
                 });
  std::vector<double> sizes, distances;  // logarithms of the RMS
  for (const auto& view : sums.colwise()) {
    sizes.push_back(std::log((view[0] + 1e-12) / std::max(view[1], 1.0)) / 2);
  }
  const double usual = Median(sizes);
  for (const double size : sizes) distances.push_back(std::abs(size - usual));
  constexpr double kFarOff = 5;
  const double limit = std::max(kFarOff * kSigmaPerMad * Median(distances), std::numbers::ln2);
  const auto worst = std::ranges::max_element(sizes);
  if (*worst - usual < limit) return false;
  const std::ptrdiff_t view = worst - sizes.begin();
  wall_.views[static_cast<size_t>(view)].brightness.setTo(kNoBrightness);
  used_[view] = 0;
  Sample();
  return true;
}

void WallModel::RefinePoses() {
  ParallelFor(wall_.views.size(), threads_, [&](size_t v) { RefinePose(v); });
  Sample();
}

void WallModel::RefinePose(size_t v) {
  constexpr int kEvery = 3;  // cells, in both directions
  WallView& view = wall_.views[v];
  const CalibratedCamera& camera = *wall_.camera;
  Matrix6d N = Matrix6d::Zero();
  Vector6d b = Vector6d::Zero();
  for (int r = 0; r < grid_.rows; r += kEvery) {
    for (int column = 0; column < grid_.columns; column += kEvery) {
      const float c = c_[static_cast<size_t>(r)][static_cast<size_t>(column)];
      if (std::isnan(c)) continue;
      const Eigen::Vector3d point = grid_.At(column, r);
      WallProjection seen;
      if (!projector_(view, point, &seen)) continue;
      const float y = Interpolate(view.brightness, seen.x, seen.y);
      const float right = Interpolate(view.brightness, seen.x + 0.5, seen.y);
      const float left = Interpolate(view.brightness, seen.x - 0.5, seen.y);
      const float below = Interpolate(view.brightness, seen.x, seen.y + 0.5);
      const float above = Interpolate(view.brightness, seen.x, seen.y - 0.5);
      const double residual =
          y - g_[static_cast<Eigen::Index>(v)] - Interpolate(v_, seen.x, seen.y) - c;
      if (!std::isfinite(residual + right - left + below - above)) continue;
      const Eigen::Vector3d p = view.T_camera_wall * point;
      std::array<double, kMaxObservationSize> u{};
      std::array<double, 6> J_point{};
      if (!camera.model->ProjectWithJacobian(camera.params.data(),
                                             camera.config.data(),
                                             u.data(),
                                             p,
                                             {.predicted = u.data(), .J_point = J_point.data()})) {
        continue;
      }
      const Eigen::RowVector2d gradient =
          Eigen::RowVector2d(right - left, below - above) / wall_.reduction;
      const Eigen::RowVector3d by_point =
          gradient * Eigen::Map<const Eigen::Matrix<double, 2, 3, Eigen::RowMajor>>(J_point.data());
      // Retract: R' = Exp(w) R, t' = t + v.
      Vector6d J;
      J << by_point.transpose(), (-by_point * Hat(p - view.T_camera_wall.t)).transpose();
      const double variance = LogVariance(Interpolate(view.light, seen.x, seen.y));
      const double w =
          CauchyWeight(Square(residual) / (kCauchyWidthSquared<> * variance)) / variance;
      N += w * J * J.transpose();
      b -= w * J * residual;
    }
  }
  // The prior: the pose from the marker.
  constexpr double kMarkerPosition = 1e-3, kMarkerAngle = 1e-3;  // m, rad
  N.diagonal().head<3>().array() += 1 / Square(kMarkerPosition);
  N.diagonal().tail<3>().array() += 1 / Square(kMarkerAngle);
  view.T_camera_wall = Retract(view.T_camera_wall, SolveSymmetric(N, b));
}

}  // namespace plenocal
