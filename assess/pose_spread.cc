// SPDX-License-Identifier: Apache-2.0
#include "assess/pose_spread.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "assess/residual_field.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

constexpr double kDegreesPerRad = 180 / std::numbers::pi;
// Without the few farthest out, which may be mistakes.
constexpr double kTail = 0.01;

using ByFrame = std::map<int, std::vector<double>>;

// Least and greatest median.
std::pair<double, double> RangeOfMedians(const ByFrame& images) {
  std::vector<double> medians;
  medians.reserve(images.size());
  for (const auto& [frame, values] : images) medians.push_back(Median(values));
  const auto [least, greatest] = std::minmax_element(medians.begin(), medians.end());
  return {*least, *greatest};
}

// One depth all over the image is one distance too: a parallel target shows nothing else.
void MeasureDistances(const ByFrame& distances, const ByFrame& depths, PoseSpread* spread) {
  const auto [near, far] = RangeOfMedians(distances);
  const auto [near_depth, far_depth] = RangeOfMedians(depths);
  const bool by_depth = near_depth > 0 && far_depth / near_depth < far / near;
  spread->nearest = by_depth ? near_depth : near;
  spread->farthest = by_depth ? far_depth : far;
}

void MeasureTilt(const CalibrationRecord& calibration,
                 const std::map<int, RigidTransform>& poses,
                 PoseSpread* spread) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const auto& [number, marker] : calibration.markers) mean += marker.position;
  mean /= static_cast<double>(calibration.markers.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const auto& [number, marker] : calibration.markers) {
    const Eigen::Vector3d d = marker.position - mean;
    scatter += d * d.transpose();
  }
  const SymmetricEigen3 axes = DecomposeSymmetric(scatter);
  constexpr double kThin = 0.05;  // thickness over width of what still counts as a plane
  spread->is_plane = std::sqrt(std::max(0.0, axes.values[0])) <= kThin * std::sqrt(axes.values[1]);
  const Eigen::Vector3d normal = axes.vectors.col(0);
  std::vector<Eigen::Vector3d> turned;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const auto& [frame, T] : poses) {
    turned.emplace_back(spread->is_plane ? Eigen::Vector3d(T.R * normal) : T.R.row(2).transpose());
    // The same face in every image.
    if (spread->is_plane && turned.back().dot(T * mean) < 0) turned.back() = -turned.back();
    sum += turned.back();
  }
  double least_cosine = 1;
  for (const Eigen::Vector3d& a : turned) {
    for (const Eigen::Vector3d& b : turned) least_cosine = std::min(least_cosine, a.dot(b));
  }
  spread->tilt = kDegreesPerRad * std::acos(std::max(least_cosine, -1.0));
  spread->lean = kDegreesPerRad * std::acos(std::clamp(sum.normalized().z(), -1.0, 1.0));
}

void FindEmptyParts(const ImageGrid& grid, const std::vector<bool>& seen, PoseSpread* spread) {
  constexpr std::array kNames{"upper left corner",
                              "upper edge",
                              "upper right corner",
                              "left edge",
                              "middle",
                              "right edge",
                              "lower left corner",
                              "lower edge",
                              "lower right corner"};
  const auto columns = static_cast<size_t>(grid.Columns()), rows = static_cast<size_t>(grid.Rows());
  std::array<bool, kNames.size()> any_seen{};
  for (size_t cell = 0; cell < seen.size(); ++cell) {
    const size_t row = cell / columns, column = cell % columns;
    if (seen[cell]) any_seen[3 * (3 * row / rows) + 3 * column / columns] = true;
  }
  for (size_t part = 0; part < kNames.size(); ++part) {
    if (!any_seen[part]) spread->empty.emplace_back(kNames[part]);
  }
}

}  // namespace

std::string PoseSpread::Region() const {
  constexpr double kMiddle = 0.55;
  const char* across = right < kMiddle ? "left" : left > 1 - kMiddle ? "right" : "";
  const char* along = bottom < kMiddle ? "upper" : top > 1 - kMiddle ? "lower" : "";
  if (*across != 0 && *along != 0) return fmt::format("the {} {} corner", along, across);
  if (*across != 0) return fmt::format("the {} half", across);
  if (*along != 0) return fmt::format("the {} half", along);
  constexpr double kRim = 0.2;
  if (left > kRim && right < 1 - kRim && top > kRim && bottom < 1 - kRim) return "the middle";
  return {};
}

double PoseSpread::Margin() const { return std::max({left, 1 - right, top, 1 - bottom}); }

PoseSpread MeasurePoseSpread(const CalibrationRecord& calibration, size_t c) {
  const CalibratedCamera& camera = calibration.cameras[c];
  std::vector<double> x, y;
  ByFrame distances, depths;
  std::map<int, RigidTransform> poses;
  constexpr int kCells = 10;  // along the image's longer side
  const ImageGrid grid(camera.image_size, kCells);
  std::vector<bool> seen(grid.Cells(), false), lit(grid.Cells(), true);
  for (size_t cell = 0; camera.image_circle && cell < grid.Cells(); ++cell) {
    lit[cell] = camera.image_circle->Has(grid.Middle(cell));
  }
  for (const ResidualRow& row : camera.residuals) {
    if (!row.used) continue;
    x.push_back((row.values[0] + 0.5) / camera.image_size[0]);
    y.push_back((row.values[1] + 0.5) / camera.image_size[1]);
    seen[grid.Cell(row.values[0], row.values[1])] = true;
    auto pose = poses.find(row.frame);
    if (pose == poses.end()) {
      pose = poses.emplace(row.frame, calibration.CameraFromTarget(c, row.frame)).first;
    }
    const Eigen::Vector3d place = pose->second * calibration.markers.at(row.marker).position;
    distances[row.frame].push_back(place.norm());
    depths[row.frame].push_back(place.z());
  }
  PoseSpread spread;
  if (x.empty()) return spread;
  spread.any = true;
  double seen_and_lit = 0;
  for (size_t cell = 0; cell < grid.Cells(); ++cell) {
    seen_and_lit += seen[cell] && lit[cell] ? 1 : 0;
    if (!lit[cell]) seen[cell] = true;
  }
  spread.coverage = seen_and_lit /
                    static_cast<double>(std::max(std::ranges::count(lit, true), std::ptrdiff_t{1}));
  spread.left = Quantile(x, kTail);
  spread.right = Quantile(x, 1 - kTail);
  spread.top = Quantile(y, kTail);
  spread.bottom = Quantile(y, 1 - kTail);
  MeasureDistances(distances, depths, &spread);
  MeasureTilt(calibration, poses, &spread);
  FindEmptyParts(grid, seen, &spread);
  return spread;
}

}  // namespace plenocal
