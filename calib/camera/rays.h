// SPDX-License-Identifier: Apache-2.0
//
// Projection and rays of cameras that have `model`, `params` and `config`: calibrated ones, those
// of a bundle. Projection of many points.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <limits>
#include <optional>

#include "calib/camera/camera_model.h"

namespace plenocal {

/// As `CameraModel::Project` with the camera's parameters.
template <typename Camera>
bool Project(const Camera& camera,
             const double* values,
             const Eigen::Vector3d& p_cam,
             double* predicted) {
  return camera.model->Project(
      camera.params.data(), camera.config.data(), values, p_cam, predicted);
}

/// As `CameraModel::Unproject` with the camera's parameters.
template <typename Camera>
std::optional<Ray> Unproject(const Camera& camera, const double* values) {
  return camera.model->Unproject(camera.params.data(), camera.config.data(), values);
}

/// Rays of many image points; nothing where there is none. Much faster than calls for each point
/// where the model has `ModelFunctions::unproject_block`.
template <typename Camera>
std::vector<std::optional<Ray>> Unproject(
    const Camera& camera, std::span<const std::array<double, kMaxObservationSize>> values) {
  if (const auto block = camera.model->functions.unproject_block) {
    return block(*camera.model, camera.params.data(), camera.config.data(), values);
  }
  std::vector<std::optional<Ray>> rays;
  rays.reserve(values.size());
  for (const auto& own : values) rays.push_back(Unproject(camera, own.data()));
  return rays;
}

namespace internal::blocks {

using Transposed = Eigen::MatrixXd;  // a row each point, its columns lie together
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

inline Transposed Columns(const double* rows, size_t begin, size_t count, size_t width) {
  if (rows == nullptr) return {};
  return Eigen::Map<const RowMajor>(
      rows + begin * width, static_cast<Eigen::Index>(count), static_cast<Eigen::Index>(width));
}

// Numbers of a block's output, and the place of its first row.
class OutputColumns {
 public:
  OutputColumns(double* rows, size_t begin, size_t count, size_t width)
      : rows_(rows == nullptr ? nullptr : rows + begin * width) {
    if (rows_ == nullptr) return;
    columns_.resize(static_cast<Eigen::Index>(count), static_cast<Eigen::Index>(width));
  }
  double* Data() { return rows_ == nullptr ? nullptr : columns_.data(); }
  void Write() const {
    if (rows_ == nullptr) return;
    Eigen::Map<RowMajor>(rows_, columns_.rows(), columns_.cols()) = columns_;
  }

 private:
  double* rows_;
  Transposed columns_;
};

inline void ProjectInBlocks(const CameraModel& model,
                            const double* params,
                            const double* config,
                            const PointBlock& in,
                            const ProjectionOutput& out) {
  constexpr size_t kBlock = 256;  // fits into a processor's cache with derivatives
  const size_t rows = model.measured.size();
  for (size_t begin = 0; begin < in.count; begin += kBlock) {
    const size_t count = std::min(kBlock, in.count - begin);
    const Transposed p = Columns(in.p, begin, count, 3),
                     values = Columns(in.values, begin, count, kMaxObservationSize);
    OutputColumns predicted(out.predicted, begin, count, rows),
        J_params(out.J_params, begin, count, rows * model.params.size()),
        J_point(out.J_point, begin, count, rows * 3), J_h(out.J_h, begin, count, rows);
    model.functions.project_block(model,
                                  params,
                                  config,
                                  {count,
                                   p.data(),
                                   values.size() == 0 ? nullptr : values.data(),
                                   in.h == nullptr ? nullptr : in.h + begin},
                                  {.predicted = predicted.Data(),
                                   .J_params = J_params.Data(),
                                   .J_point = J_point.Data(),
                                   .J_h = J_h.Data()});
    for (const OutputColumns* columns : {&predicted, &J_params, &J_point, &J_h}) columns->Write();
  }
}

}  // namespace internal::blocks

/// Projects all points of `in`. All numbers of a point lie together, in `in` and in `out`; those of
/// a point outside the domain are NaN. Much faster than calls for each point where the model has
/// `ModelFunctions::project_block`.
inline void ProjectPoints(const CameraModel& model,
                          const double* params,
                          const double* config,
                          const PointBlock& in,
                          const ProjectionOutput& out) {
  if (model.functions.project_block != nullptr && out.support == nullptr) {
    return internal::blocks::ProjectInBlocks(model, params, config, in, out);
  }
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const size_t rows = model.measured.size(),
               width = out.support != nullptr && model.support_size > 0 ? model.support_size
                                                                        : model.params.size();
  const std::array<double, kMaxObservationSize> zeros{};
  const auto at = [](auto* numbers, size_t place) {
    return numbers == nullptr ? nullptr : numbers + place;
  };
  std::array<double, kMaxObservationSize * 3> J_unused{};
  for (size_t i = 0; i < in.count; ++i) {
    const double* const values =
        in.values == nullptr ? zeros.data() : in.values + i * kMaxObservationSize;
    const Eigen::Vector3d p(in.p + 3 * i);
    const double h = in.h == nullptr ? 1 : in.h[i];
    const ProjectionOutput own{
        .predicted = out.predicted + rows * i,
        .J_params = at(out.J_params, rows * width * i),
        .J_point = out.J_point == nullptr ? J_unused.data() : out.J_point + rows * 3 * i,
        .support = at(out.support, model.support_size * i),
        .J_h = at(out.J_h, rows * i)};
    const bool derive = out.J_params != nullptr || out.J_point != nullptr || out.J_h != nullptr;
    if (derive ? model.ProjectWithJacobian(params, config, values, p, own, h)
               : model.Project(params, config, values, p, own.predicted, h)) {
      continue;
    }
    std::fill_n(own.predicted, rows, kNan);
    if (own.J_params != nullptr) std::fill_n(own.J_params, rows * width, kNan);
    std::fill_n(own.J_point, rows * 3, kNan);
    if (own.J_h != nullptr) std::fill_n(own.J_h, rows, kNan);
  }
}

}  // namespace plenocal
