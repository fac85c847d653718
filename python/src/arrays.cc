// SPDX-License-Identifier: Apache-2.0
//
// Arrays of numpy.
#include <algorithm>
#include <functional>
#include <numeric>

#include "python/src/bindings.h"

namespace plenocal::python {

using RowMajorMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Numbers NewArray(std::initializer_list<size_t> shape) {
  const size_t count =
      std::accumulate(shape.begin(), shape.end(), size_t{1}, std::multiplies<size_t>());
  auto* const data = new double[count];
  nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<double*>(p); });
  return Numbers(data, shape, owner);
}

Numbers ToArray(const std::vector<double>& values) {
  Numbers array = NewArray({values.size()});
  std::ranges::copy(values, array.data());
  return array;
}

Numbers ToArray(const Eigen::MatrixXd& matrix) {
  Numbers array =
      NewArray({static_cast<size_t>(matrix.rows()), static_cast<size_t>(matrix.cols())});
  Eigen::Map<RowMajorMatrix>(array.data(), matrix.rows(), matrix.cols()) = matrix;
  return array;
}

Numbers ToArray(const RigidTransform& transform) {
  Eigen::MatrixXd matrix = Eigen::MatrixXd::Identity(4, 4);
  matrix.topLeftCorner<3, 3>() = transform.R;
  matrix.topRightCorner<3, 1>() = transform.t;
  return ToArray(matrix);
}

RigidTransform ToTransform(const Rows& matrix) {
  const Eigen::Map<const RowMajorMatrix> values(matrix.data(), 4, 4);
  return {values.topLeftCorner<3, 3>(), values.topRightCorner<3, 1>()};
}

std::vector<std::string> ValueNames(const CameraModel& model) {
  std::vector<std::string> names(model.measured.begin(), model.measured.end());
  names.insert(names.end(), model.context.begin(), model.context.end());
  return names;
}

}  // namespace plenocal::python
