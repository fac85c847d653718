// SPDX-License-Identifier: Apache-2.0
//
// Derivatives of a camera's projection by its parameters and by the point.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <span>
#include <vector>

#include "calib/camera/rays.h"

namespace plenocal {

struct ProjectionJacobian {
  void Resize(size_t measured, size_t params) {
    const auto rows = static_cast<Eigen::Index>(measured);
    predicted.resize(rows);
    by_params.resize(rows, static_cast<Eigen::Index>(params));
    by_point.resize(rows, 3);
  }
  [[nodiscard]] bool IsFinite() const {
    return predicted.allFinite() && by_params.allFinite() && by_point.allFinite();
  }

  Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMaxObservationSize, 1> predicted;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> by_params;
  Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor, kMaxObservationSize, 3> by_point;
};

/// False outside the domain of the model, and where a result is not finite. `Camera` has model,
/// params and config; `values`: measured coordinates (not used) and context.
template <typename Camera>
[[nodiscard]] bool Differentiate(const Camera& camera,
                                 const double* values,
                                 const Eigen::Vector3d& p_cam,
                                 ProjectionJacobian* out) {
  out->Resize(camera.model->measured.size(), camera.model->params.size());
  return camera.model->ProjectWithJacobian(
             camera.params.data(),
             camera.config.data(),
             values,
             p_cam,
             {out->predicted.data(), out->by_params.data(), out->by_point.data()}) &&
         out->IsFinite();
}

/// A point in the camera's frame, m, with the values of an observation of it.
struct ObservedPoint {
  std::array<double, kMaxObservationSize> values = {};
  Eigen::Vector3d p = Eigen::Vector3d::Zero();
};

/// `Differentiate` for many points, in blocks: calls use(i, jacobian) for those of which it is
/// true.
template <typename Camera, typename Use>
void DifferentiateEach(const Camera& camera,
                       std::span<const ObservedPoint> points,
                       const Use& use) {
  constexpr size_t kBlock = 256;
  const size_t rows = camera.model->measured.size(), params = camera.model->params.size();
  std::vector<double> p(3 * kBlock), values(kMaxObservationSize * kBlock), predicted(rows * kBlock),
      by_params(rows * params * kBlock), by_point(rows * 3 * kBlock);
  ProjectionJacobian of_point;
  of_point.Resize(rows, params);
  for (size_t begin = 0; begin < points.size(); begin += kBlock) {
    const size_t count = std::min(kBlock, points.size() - begin);
    for (size_t i = 0; i < count; ++i) {
      std::ranges::copy(points[begin + i].p, p.begin() + static_cast<std::ptrdiff_t>(3 * i));
      std::ranges::copy(points[begin + i].values,
                        values.begin() + static_cast<std::ptrdiff_t>(kMaxObservationSize * i));
    }
    ProjectPoints(
        *camera.model,
        camera.params.data(),
        camera.config.data(),
        {.count = count, .p = p.data(), .values = values.data()},
        {.predicted = predicted.data(), .J_params = by_params.data(), .J_point = by_point.data()});
    for (size_t i = 0; i < count; ++i) {
      std::copy_n(&predicted[rows * i], rows, of_point.predicted.data());
      std::copy_n(by_params.data() + rows * params * i, rows * params, of_point.by_params.data());
      std::copy_n(&by_point[3 * rows * i], 3 * rows, of_point.by_point.data());
      if (of_point.IsFinite()) use(begin + i, of_point);
    }
  }
}

}  // namespace plenocal
