// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/wall_samples.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/base/format_error.h"
#include "calib/base/parallel.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

constexpr float kNotSeen = std::numeric_limits<float>::quiet_NaN();
constexpr double kMostCells = 400000;
constexpr double kLeastCosine = 0.2;  // a wall seen at a smaller angle has no useful texture

}  // namespace

double Quantile(std::vector<double>* values, double share) {
  const auto at = values->begin() +
                  static_cast<std::ptrdiff_t>(share * static_cast<double>(values->size() - 1));
  std::nth_element(values->begin(), at, values->end());
  return *at;
}

WallProjector::WallProjector(const WallRecording& wall)
    : camera_(*wall.camera), reduction_(wall.reduction) {
  // The camera's resolution changes little over the image for what it is needed here.
  constexpr double kStep = 1e-3;
  std::array<double, kMaxObservationSize> middle{}, right{}, below{};
  const auto project = [&](const Eigen::Vector3d& p, double* out) {
    camera_.model->Project(camera_.params.data(), camera_.config.data(), out, p, out);
  };
  project({0, 0, 1}, middle.data());
  project({kStep, 0, 1}, right.data());
  project({0, kStep, 1}, below.data());
  pixels_ = std::abs((right[0] - middle[0]) * (below[1] - middle[1])) /
            (kStep * kStep * reduction_ * reduction_);
}

bool WallProjector::operator()(const WallView& view,
                               const Eigen::Vector3d& point,
                               WallProjection* out) const {
  const Eigen::Vector3d p = view.T_camera_wall * point;
  const Eigen::Vector3d normal = view.T_camera_wall.R.col(2);
  const double cosine = -normal.dot(p) / p.norm();
  if (!(p.z() > 0) || std::abs(cosine) < kLeastCosine) return false;
  std::array<double, kMaxObservationSize> u{};
  if (!camera_.model->Project(
          camera_.params.data(), camera_.config.data(), u.data(), p, u.data())) {
    return false;
  }
  out->x = Reduce(u[0]);
  out->y = Reduce(u[1]);
  if (out->x < 0 || out->y < 0 || out->x > view.light.cols - 1 || out->y > view.light.rows - 1) {
    return false;
  }
  out->area = pixels_ * std::abs(normal.dot(p)) / (p.z() * p.z() * p.z());
  return true;
}

float Interpolate(const cv::Mat& image, double x, double y) {
  if (!(x >= 0 && y >= 0 && x <= image.cols - 1 && y <= image.rows - 1)) return kNotSeen;
  const int column = std::min(static_cast<int>(x), image.cols - 2);
  const int row = std::min(static_cast<int>(y), image.rows - 2);
  const auto fx = static_cast<float>(x - column), fy = static_cast<float>(y - row);
  const float* top = image.ptr<float>(row) + column;
  const float* below = image.ptr<float>(row + 1) + column;
  return (1 - fy) * ((1 - fx) * top[0] + fx * top[1]) + fy * ((1 - fx) * below[0] + fx * below[1]);
}

WallGrid ChooseGrid(const WallRecording& wall, const std::string& where) {
  const CalibratedCamera& camera = *wall.camera;
  const WallProjector projector(wall);
  constexpr int kSteps = 12;
  std::vector<double> xs, ys, areas;
  for (const WallView& view : wall.views) {
    const RigidTransform T_wall_camera = view.T_camera_wall.Inverse();
    for (int j = 0; j <= kSteps; ++j) {
      for (int i = 0; i <= kSteps; ++i) {
        const std::array<double, kMaxObservationSize> u{
            static_cast<double>(i) / kSteps * (camera.image_size[0] - 1),
            static_cast<double>(j) / kSteps * (camera.image_size[1] - 1)};
        const auto ray =
            camera.model->Unproject(camera.params.data(), camera.config.data(), u.data());
        if (!ray) continue;
        const Eigen::Vector3d d = T_wall_camera.R * ray->direction;
        const double along = -T_wall_camera.t.z() / d.z();
        const Eigen::Vector3d point = T_wall_camera.t + along * d;
        WallProjection seen;
        if (!(along > 0) || !projector(view, point, &seen)) continue;
        xs.push_back(point.x());
        ys.push_back(point.y());
        areas.push_back(seen.area);
      }
    }
  }
  if (xs.empty()) {
    throw JobError(
        "{}: the wall is behind the cameras or seen from its edge; check the "
        "target's file and the calibration",
        where);
  }
  // The rim, which few views show, contributes nothing.
  constexpr double kRim = 0.01;
  WallGrid grid;
  grid.x = Quantile(&xs, kRim);
  grid.y = Quantile(&ys, kRim);
  const double width = Quantile(&xs, 1 - kRim) - grid.x, height = Quantile(&ys, 1 - kRim) - grid.y;
  grid.cell = std::max(1 / std::sqrt(Median(areas)), std::sqrt(width * height / kMostCells));
  grid.columns = static_cast<int>(width / grid.cell) + 1;
  grid.rows = static_cast<int>(height / grid.cell) + 1;
  return grid;
}

std::vector<WallRow> SampleWall(const WallRecording& wall, const WallGrid& grid, int threads) {
  const WallProjector projector(wall);
  std::vector<WallRow> rows(static_cast<size_t>(grid.rows));
  ParallelFor(rows.size(), threads, [&](size_t r) {
    WallRow& row = rows[r];
    row.begin.assign(static_cast<size_t>(grid.columns) + 1, 0);
    for (int column = 0; column < grid.columns; ++column) {
      const auto cell = static_cast<size_t>(column);
      row.begin[cell] = static_cast<std::uint32_t>(row.samples.size());
      const Eigen::Vector3d point = grid.At(column, static_cast<int>(r));
      const bool on_marker = point.x() > wall.marker[0] && point.y() > wall.marker[1] &&
                             point.x() < wall.marker[2] && point.y() < wall.marker[3];
      if (on_marker) continue;
      for (size_t v = 0; v < wall.views.size(); ++v) {
        const WallView& view = wall.views[v];
        WallProjection seen;
        if (!projector(view, point, &seen)) continue;
        const float brightness = Interpolate(view.brightness, seen.x, seen.y);
        if (std::isnan(brightness)) continue;
        row.samples.push_back(
            {.view = static_cast<std::uint16_t>(v),
             .x = static_cast<float>(seen.x),
             .y = static_cast<float>(seen.y),
             .brightness = brightness,
             .light = Interpolate(view.light, seen.x, seen.y),
             .density = static_cast<float>(1 / (seen.area * grid.cell * grid.cell))});
      }
      // A point that few views show does not compare them.
      constexpr size_t kFewest = 3;
      if (row.samples.size() < row.begin[cell] + kFewest) row.samples.resize(row.begin[cell]);
    }
    row.begin.back() = static_cast<std::uint32_t>(row.samples.size());
  });
  return rows;
}

}  // namespace plenocal
