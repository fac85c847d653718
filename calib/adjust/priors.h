// SPDX-License-Identifier: Apache-2.0
//
// Priors of cameras' parameters and extrinsics, and measured distances, as rows of the adjustment.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <map>
#include <vector>

#include "calib/adjust/layout.h"

namespace plenocal::internal {

/// A prior's residual in standard deviations at the bundle's present values, with its derivatives
/// by unknowns of a layout, in the charts about these values.
struct SparseRow {
  std::map<int, double> J;  ///< by the index of an unknown
  double residual = 0;
};

/// Priors of parameters (`ParamPriors`) of which one at least is in `layout`.
std::vector<SparseRow> RowsOfParamPriors(const BundleState& bundle, const UnknownLayout& layout);
/// The earlier calibration (`CalibrationPrior`), if there is one.
std::vector<SparseRow> RowsOfCalibrationPrior(const BundleState& bundle,
                                              const UnknownLayout& layout);

/// Both.
std::vector<SparseRow> RowsOfPriors(const BundleState& bundle, const UnknownLayout& layout);

/// Adds J' J to the lower triangle of `information`.
void AddInformation(const std::vector<SparseRow>& rows, Eigen::MatrixXd* information);

/// Distances between landmarks. `first`: index of the first of a landmark's three unknowns, or -1
/// for one that has none, whose distances are left out. Where two ends coincide residuals are not
/// finite.
std::vector<SparseRow> RowsOfDistances(const BundleState& bundle,
                                       const std::function<int(int marker)>& first);

}  // namespace plenocal::internal
