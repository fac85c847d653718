// SPDX-License-Identifier: Apache-2.0
#include "calib/camera/project_points.h"

#include <algorithm>
#include <array>

namespace plenocal {
namespace {

using Transposed = Eigen::MatrixXd;  // a row each point, its columns lie together
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Transposed Columns(const double* rows, size_t begin, size_t count, size_t width) {
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

void ProjectInBlocks(const CameraModel& model,
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

}  // namespace

void ProjectPoints(const CameraModel& model,
                   const double* params,
                   const double* config,
                   const PointBlock& in,
                   const ProjectionOutput& out) {
  if (model.functions.project_block != nullptr && out.support == nullptr) {
    return ProjectInBlocks(model, params, config, in, out);
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
