// SPDX-License-Identifier: Apache-2.0
//
// Sums of products of one camera's residuals and their derivatives.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <utility>
#include <vector>

#include "calib/adjust/elimination/unknown_layout.h"
#include "calib/adjust/robust_rows.h"
#include "calib/kernels/row_products.h"

namespace plenocal::internal {

/// Six numbers a row.
using SixColumns = Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::RowMajor>;

/// Residuals r of one camera with their derivatives: J by its own columns (parameters, extrinsics
/// and the poses of targets; the last column is r itself), E by the pose that it saw and M by the
/// marker. Observations are loaded one by one and added to sums: J' J and J' M over all views, J' E
/// and E' E over one view, M' E and M' M over the observations of one marker in one view.
class ViewProducts {
 public:
  ViewProducts(const Bundle& bundle, const UnknownLayout& layout, size_t camera);

  /// Loads the rows of one observation, weighted by `loss`; false where it does not project.
  bool Load(const LinearisedView& view,
            const BundleObservation& observation,
            const RobustLoss& loss);

  /// Adds the loaded rows to the sums of their marker and view.
  void Add() { AddRows(1); }

  /// Adds the loaded rows to their mean over one marker, by their own standard deviations.
  void AddToMean(double own_sigma);
  /// Loads the mean's rows in its standard deviations and starts the next mean. Returns the part of
  /// their products that common noise takes away (`CommonShare`).
  double LoadMean(double common_sigma);
  void Subtract(double part) { AddRows(-part); }
  /// E' E of the loaded rows.
  [[nodiscard]] Matrix6d PoseSquare() const;

  /// Adds the sums of one marker: M' E to `cross`, whose rows are unknowns, and M' M to `S`.
  void EndMarker(int marker, SixColumns* cross, Eigen::MatrixXd* S);
  /// Adds J' E of one view to `cross`; returns E' E.
  Matrix6d EndView(SixColumns* cross);

  /// Adds the sums over all views to the lower triangle of `S`, whose last row belongs to r.
  void AddTo(Eigen::MatrixXd* S) const;
  /// r' r over all views.
  [[nodiscard]] double Squares() const { return square_(own_ - 1, own_ - 1); }

 private:
  static constexpr Eigen::Index kPanelColumns = 132;

  // Rows that are summed with one sign at once, one column each.
  struct Panel {
    RowMajorMatrix rows;
    Eigen::Index used = 0;
    double sign = 1;
  };

  void SetRows(const Eigen::Vector3d& p_target, int marker);
  void AddRows(double weight);
  void AddToPanel(double weight);
  void Flush(Panel* panel);
  // For rows that are zero nearly everywhere.
  void AddSparse(double weight);

  const Bundle& bundle_;
  const UnknownLayout& layout_;
  const BundleCamera& camera_;
  Eigen::Index rows_;  // of one observation
  bool sparse_;
  bool extrinsics_;
  // Parameters that are estimated, each with its column; tied ones have the same.
  std::vector<std::pair<Eigen::Index, Eigen::Index>> free_;
  Eigen::Index own_params_ = 0;               // columns of parameters
  std::vector<Eigen::Index> target_columns_;  // per target: first of its six columns
  std::vector<int> columns_;                  // index of each own column in the reduced system
  Eigen::Index own_ = 0;                      // columns of J
  std::vector<Eigen::Index> touched_;         // columns of J that differ from zero in a row

  std::vector<double> J_params_;
  double J_extrinsics_[kMaxObservationSize * 6], J_pose_[kMaxObservationSize * 6];
  RowMajorMatrix row_, row_sum_;  // [J E] of the loaded rows and of the present mean
  Eigen::Matrix<double, kMaxObservationSize, 3, Eigen::RowMajor> M_, M_sum_;
  double information_ = 0;  // of the mean
  Panel plus_, minus_;
  Eigen::MatrixXd product_;        // [J E]' [J E] of the view, or of sparse rows E' [J E]
  Eigen::MatrixXd marker_;         // [J E]' M of the marker, three columns
  Eigen::Matrix3d marker_square_;  // M' M
  Eigen::MatrixXd square_;         // J' J over all views
  Eigen::MatrixXd marker_cross_;   // J' M over all views, three columns a marker
};

}  // namespace plenocal::internal
