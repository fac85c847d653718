// SPDX-License-Identifier: Apache-2.0
//
// Priors of cameras' parameters and extrinsics and of targets' scales, and measured distances, as
// rows of the adjustment.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <limits>
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

/// Both, and those of the targets' scales.
std::vector<SparseRow> RowsOfPriors(const BundleState& bundle, const UnknownLayout& layout);

/// Adds J' J to the lower triangle of `information`, but not for pairs of unknowns of which both
/// are `left_out` or follow it.
void AddInformation(const std::vector<SparseRow>& rows,
                    Eigen::MatrixXd* information,
                    int left_out = std::numeric_limits<int>::max());

/// Distances between markers. `first`: index of the first of a marker's three unknowns, or -1 for
/// one that has none, whose distances are left out. Where two ends coincide residuals are not
/// finite.
/// `start`: the bundle whose targets' poses the markers follow from there on.
std::vector<SparseRow> RowsOfDistances(const BundleState& bundle,
                                       const UnknownLayout& layout,
                                       const std::function<int(int marker)>& first,
                                       const BundleState& start);
/// Those between the markers of `layout`; none where it has no markers.
std::vector<SparseRow> RowsOfDistances(const BundleState& bundle, const UnknownLayout& layout);

}  // namespace plenocal::internal
