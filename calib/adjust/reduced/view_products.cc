// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/reduced/view_products.h"

#include <type_traits>

namespace plenocal::internal {

ViewProducts::ViewProducts(const Bundle& bundle, const UnknownLayout& layout, size_t camera)
    : bundle_(bundle),
      layout_(layout),
      camera_(camera),
      sparse_(bundle.cameras[camera].model->support_size > 0 || bundle.targets.size() > 1),
      columns_(UnknownsOf(layout, camera)),
      column_of_(static_cast<size_t>(layout.head)) {
  for (size_t i = 0; i < columns_.size(); ++i) {
    column_of_[static_cast<size_t>(columns_[i])] = static_cast<Eigen::Index>(i);
  }
  columns_.push_back(layout.total);
  own_ = std::ssize(columns_);
  if (!sparse_) panel_ = ZeroRows(own_ + 6, kPanelColumns);
  product_ = Eigen::MatrixXd::Zero(sparse_ ? 6 : own_ + 6, own_ + 6);
  square_ = Eigen::MatrixXd::Zero(own_, own_);
  marker_cross_ = Eigen::MatrixXd::Zero(own_, layout.Markers());
}

void ViewProducts::Add(const MarkerRows& rows, SixColumns* cross, Eigen::MatrixXd* S) {
  constexpr int kOfMarker = UnknownLayout::kOfMarker;
  rows_.setZero(rows.Count(), own_ + 6);
  ForEachDerivative(bundle_, layout_, camera_, rows, [&](int unknown, const auto& by) {
    if (unknown >= layout_.head) return;
    constexpr int kColumns = std::decay_t<decltype(by)>::ColsAtCompileTime;
    rows_.middleCols<kColumns>(column_of_[static_cast<size_t>(unknown)]) += by;
  });
  rows_.col(own_ - 1) = rows.Residual();
  rows_.rightCols<6>() = rows.Pose();
  for (Eigen::Index r = 0; r < rows_.rows(); ++r) {
    if (sparse_) {
      AddSparse(rows_.row(r));
    } else {
      AddToPanel(rows_.row(r));
    }
  }
  if (!layout_.markers) return;
  const int m = layout_.Marker(rows.Marker());
  const auto of_marker = rows_.transpose().lazyProduct(rows.Position()).eval();
  marker_cross_.middleCols<kOfMarker>(m - layout_.head) += of_marker.topRows(own_);
  cross->middleRows<kOfMarker>(m) += of_marker.bottomRows<6>().transpose();
  S->block<kOfMarker, kOfMarker>(m, m) += rows.Position().transpose().lazyProduct(rows.Position());
}

void ViewProducts::AddToPanel(const Row& row) {
  if (used_ == kPanelColumns) Flush();
  double* const column = panel_.data() + used_++;
  for (Eigen::Index i = 0; i < row.size(); ++i) column[i * panel_.cols()] = row[i];
}

void ViewProducts::Flush() {
  if (used_ == 0) return;
  const Eigen::Index columns = RoundUpToFour(used_);
  panel_.middleCols(used_, columns - used_).setZero();
  AddRowProducts(1, panel_, columns, &product_);
  used_ = 0;
}

void ViewProducts::AddSparse(const Row& row) {
  touched_.clear();
  for (Eigen::Index i = 0; i < own_; ++i) {
    if (row[i] != 0) touched_.push_back(i);
  }
  const auto E = row.tail<6>();
  for (const Eigen::Index i : touched_) {
    for (const Eigen::Index k : touched_) square_(k, i) += row[i] * row[k];
    product_.col(i) += row[i] * E.transpose();
  }
  product_.rightCols<6>().noalias() += E.transpose() * E;
}

Matrix6d ViewProducts::EndView(SixColumns* cross) {
  if (!sparse_) {
    Flush();
    square_.triangularView<Eigen::Lower>() += product_.topLeftCorner(own_, own_);
  }
  const auto by_pose = product_.bottomRows<6>();
  (*cross)(columns_, Eigen::all) += by_pose.leftCols(own_).transpose();
  const Matrix6d square = Matrix6d(by_pose.rightCols<6>()).selfadjointView<Eigen::Lower>();
  product_.setZero();
  return square;
}

void ViewProducts::AddTo(Eigen::MatrixXd* S) const {
  (*S)(columns_, columns_) += square_;
  // A row of a matrix without columns is an offset of a null pointer.
  if (!layout_.markers) return;
  const auto markers = Eigen::seqN(layout_.head, layout_.Markers());
  (*S)(markers, columns_) += marker_cross_.transpose();
  S->row(layout_.total)(markers) += marker_cross_.row(own_ - 1);
}

}  // namespace plenocal::internal
