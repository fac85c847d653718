// SPDX-License-Identifier: Apache-2.0
//
// Sums of products of one camera's rows.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "calib/adjust/layout.h"
#include "calib/adjust/reduced/states.h"
#include "calib/adjust/rows.h"
#include "calib/kernels/row_products.h"

namespace plenocal::internal {

/// Rows of one camera: J by its own columns (parameters, extrinsics and the poses of targets; the
/// last column is the residual r), E by the pose that it saw and M by the marker. Sums of J' J and
/// J' M go over all views, those of J' E and E' E over one view, M' E and M' M over the rows of one
/// marker in one view.
class ViewProducts {
 public:
  ViewProducts(const Bundle& bundle, const UnknownLayout& layout, size_t camera);

  /// Adds the rows of one marker: M' E to `cross`, whose rows are unknowns, and M' M to `S`.
  void Add(const MarkerRows& rows, SixColumns* cross, Eigen::MatrixXd* S);
  /// Adds J' E of the view to `cross`; returns E' E.
  Matrix6d EndView(SixColumns* cross);

  /// Adds the sums over all views to the lower triangle of `S`, whose last row belongs to r.
  void AddTo(Eigen::MatrixXd* S) const;
  /// r' r over all views.
  [[nodiscard]] double Squares() const { return square_(own_ - 1, own_ - 1); }

 private:
  static constexpr Eigen::Index kPanelColumns = 132;

  // Of `rows_`.
  using Row = Eigen::Ref<const Eigen::RowVectorXd>;
  void AddToPanel(const Row& row);
  void Flush();
  // For rows that are zero nearly everywhere.
  void AddSparse(const Row& row);

  const Bundle& bundle_;
  const UnknownLayout& layout_;
  size_t camera_;
  bool sparse_;
  std::vector<int> columns_;             // index of each own column in the reduced system
  std::vector<Eigen::Index> column_of_;  // own column of each unknown before the markers
  Eigen::Index own_ = 0;                 // columns of J
  std::vector<Eigen::Index> touched_;    // columns of J that differ from zero in a row

  RowMajorMatrix rows_;           // [J E] of one marker
  RowMajorMatrix panel_;          // rows of the view, one column each
  Eigen::Index used_ = 0;         // columns of it
  Eigen::MatrixXd product_;       // [J E]' [J E] of the view, or of sparse rows E' [J E]
  Eigen::MatrixXd square_;        // J' J over all views
  Eigen::MatrixXd marker_cross_;  // J' M over all views, three columns a marker
};

}  // namespace plenocal::internal
