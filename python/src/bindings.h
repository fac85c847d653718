// SPDX-License-Identifier: Apache-2.0
//
// The parts of the extension module plenocal._core. Each adds its functions and classes; the
// package's Python files check arguments, so that here arrays have the right type and shape.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <Eigen/Core>
#include <initializer_list>
#include <string>
#include <vector>

#include "calib/base/error.h"
#include "calib/files/calibration_record.h"

namespace plenocal::python {

namespace nb = nanobind;

void BindEngine(nb::module_& module);
void BindImages(nb::module_& module);
void BindProgram(nb::module_& module);
void BindCamera(nb::module_& module);
void BindCalibration(nb::module_& module);
void BindSpace(nb::module_& module);
void BindTarget(nb::module_& module);
void BindViews(nb::module_& module);
void BindModels(nb::module_& module);

/// "point", "axis" or "none".
inline const char* NameOf(Centre centre) {
  constexpr const char* kNames[]{"point", "axis", "none"};
  return kNames[static_cast<size_t>(centre)];
}

/// Rows of numbers that numpy owns.
using Rows = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Numbers = nb::ndarray<nb::numpy, double>;

/// A new array of this shape, whose content the caller writes.
Numbers NewArray(std::initializer_list<size_t> shape);
/// A copy of numbers and matrices.
Numbers ToArray(const std::vector<double>& values);
Numbers ToArray(const Eigen::MatrixXd& matrix);
/// 4 x 4, row by row.
Numbers ToArray(const RigidTransform& transform);
RigidTransform ToTransform(const Rows& matrix);

/// An array of this shape that has taken over the values.
template <typename T>
nb::ndarray<nb::numpy, T> Kept(std::vector<T> values, std::initializer_list<size_t> shape) {
  auto* const kept = new std::vector<T>(std::move(values));
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return nb::ndarray<nb::numpy, T>(kept->data(), shape, owner);
}
/// Column of a table.
template <typename T>
nb::ndarray<nb::numpy, T> ToColumn(std::vector<T> values) {
  const size_t count = values.size();
  return Kept(std::move(values), {count});
}
/// Column of a table: `value` of each of `items`.
template <typename Items, typename Value>
auto ToColumn(const Items& items, const Value& value) {
  std::vector<std::decay_t<decltype(value(*items.begin()))>> column;
  for (const auto& item : items) column.push_back(value(item));
  return ToColumn(std::move(column));
}

/// Names of the numbers of an observation: measured coordinates, then context.
std::vector<std::string> ValueNames(const CameraModel& model);

/// The same of vectors: (N, 3).
template <typename Items, typename Value>
auto ToRows(const Items& items, const Value& value) {
  std::vector<double> rows;
  for (const auto& item : items) {
    const Eigen::Vector3d row = value(item);
    rows.insert(rows.end(), row.begin(), row.end());
  }
  return Kept(std::move(rows), {items.size(), 3});
}

/// Sets the exception of an error (plenocal/errors.py: a class each kind).
void SetPythonError(const Error& error);

}  // namespace plenocal::python
