// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/reduced/view_products.h"

#include <algorithm>
#include <optional>

namespace plenocal::internal {

ViewProducts::ViewProducts(const Bundle& bundle, const UnknownLayout& layout, size_t camera)
    : bundle_(bundle),
      layout_(layout),
      sparse_(bundle.cameras[camera].model->support_size > 0 || bundle.targets.size() > 1),
      extrinsics_(layout.extrinsics[camera] >= 0) {
  const std::vector<int>& params = layout.params[camera];
  for (size_t k = 0; k < params.size(); ++k) {
    if (params[k] < 0) continue;
    const auto column = std::find(columns_.begin(), columns_.end(), params[k]);
    free_.emplace_back(static_cast<Eigen::Index>(k), column - columns_.begin());
    if (column == columns_.end()) columns_.push_back(params[k]);
  }
  own_params_ = std::ssize(columns_);
  for (int i = 0; extrinsics_ && i < 6; ++i) columns_.push_back(layout.extrinsics[camera] + i);
  for (const int target : layout.targets) {
    target_columns_.push_back(std::ssize(columns_));
    for (int i = 0; target >= 0 && i < 6; ++i) columns_.push_back(target + i);
  }
  columns_.push_back(layout.total);
  own_ = std::ssize(columns_);
  row_.resize(own_ + 6);
  if (!sparse_) panel_ = ZeroRows(own_ + 6, kPanelColumns);
  product_ = Eigen::MatrixXd::Zero(sparse_ ? 6 : own_ + 6, own_ + 6);
  marker_.resize(own_ + 6, UnknownLayout::kOfMarker);
  square_ = Eigen::MatrixXd::Zero(own_, own_);
  marker_cross_ = Eigen::MatrixXd::Zero(own_, layout.Markers());
}

void ViewProducts::SetRow(const MarkerRows& rows, Eigen::Index r) {
  row_.setZero();
  const auto params = rows.Params().row(r);
  for (const auto& [param, column] : free_) row_[column] += params[param];
  if (extrinsics_) row_.segment<6>(own_params_) = rows.Extrinsics().row(r);
  row_[own_ - 1] = rows.Residual()[r];
  row_.tail<6>() = rows.Pose().row(r);
  const std::optional<size_t> target = bundle_.FreeTarget(rows.Marker());
  if (!target) return;
  row_.segment<6>(target_columns_[*target]) =
      rows.Position().row(r) *
      PointByTargetPose(bundle_.targets[*target].T_target_own,
                        bundle_.markers[static_cast<size_t>(rows.Marker())].position);
}

void ViewProducts::Add(const MarkerRows& rows, SixColumns* cross, Eigen::MatrixXd* S) {
  constexpr int kOfMarker = UnknownLayout::kOfMarker;
  marker_.setZero();
  for (Eigen::Index r = 0; r < rows.Count(); ++r) {
    SetRow(rows, r);
    if (sparse_) {
      AddSparse();
    } else {
      AddToPanel();
    }
    if (!layout_.markers) continue;
    for (int k = 0; k < kOfMarker; ++k) {
      marker_.col(k).noalias() += rows.Position()(r, k) * row_.transpose();
    }
  }
  if (!layout_.markers) return;
  const int m = layout_.Marker(rows.Marker());
  marker_cross_.middleCols<kOfMarker>(m - layout_.head) += marker_.topRows(own_);
  cross->middleRows<kOfMarker>(m) += marker_.bottomRows<6>().transpose();
  S->block<kOfMarker, kOfMarker>(m, m) += rows.Position().transpose().lazyProduct(rows.Position());
}

void ViewProducts::AddToPanel() {
  if (used_ == kPanelColumns) Flush();
  double* const column = panel_.data() + used_++;
  for (Eigen::Index i = 0; i < row_.size(); ++i) column[i * panel_.cols()] = row_[i];
}

void ViewProducts::Flush() {
  if (used_ == 0) return;
  const Eigen::Index columns = RoundUpToFour(used_);
  panel_.middleCols(used_, columns - used_).setZero();
  AddRowProducts(1, panel_, columns, &product_);
  used_ = 0;
}

void ViewProducts::AddSparse() {
  touched_.clear();
  for (Eigen::Index i = 0; i < own_; ++i) {
    if (row_[i] != 0) touched_.push_back(i);
  }
  const auto E = row_.tail<6>();
  for (const Eigen::Index i : touched_) {
    for (const Eigen::Index k : touched_) square_(k, i) += row_[i] * row_[k];
    product_.col(i) += row_[i] * E.transpose();
  }
  product_.rightCols<6>().noalias() += E.transpose() * E;
}

Matrix6d ViewProducts::EndView(SixColumns* cross) {
  if (!sparse_) {
    Flush();
    square_.triangularView<Eigen::Lower>() += product_.topLeftCorner(own_, own_);
  }
  const auto by_pose = product_.bottomRows<6>();
  for (Eigen::Index i = 0; i < own_; ++i) {
    cross->row(columns_[static_cast<size_t>(i)]) += by_pose.col(i).transpose();
  }
  const Matrix6d square = Matrix6d(by_pose.rightCols<6>()).selfadjointView<Eigen::Lower>();
  product_.setZero();
  return square;
}

void ViewProducts::AddTo(Eigen::MatrixXd* S) const {
  for (Eigen::Index i = 0; i < own_; ++i) {
    for (Eigen::Index j = 0; j <= i; ++j) {
      const auto [column, row] =
          std::minmax(columns_[static_cast<size_t>(i)], columns_[static_cast<size_t>(j)]);
      (*S)(row, column) += square_(i, j);
    }
  }
  // A row of a matrix without columns is an offset of a null pointer.
  if (marker_cross_.cols() == 0) return;
  for (Eigen::Index i = 0; i < own_ - 1; ++i) {
    S->col(columns_[static_cast<size_t>(i)]).segment(layout_.head, marker_cross_.cols()) +=
        marker_cross_.row(i).transpose();
  }
  S->row(layout_.total).segment(layout_.head, marker_cross_.cols()) += marker_cross_.row(own_ - 1);
}

}  // namespace plenocal::internal
