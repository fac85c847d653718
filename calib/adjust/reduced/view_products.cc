// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/reduced/view_products.h"

#include <algorithm>
#include <type_traits>

namespace plenocal::internal {

ViewProducts::ViewProducts(const Bundle& bundle, const UnknownLayout& layout, size_t camera)
    : bundle_(bundle),
      layout_(layout),
      camera_(camera),
      sparse_(bundle.cameras[camera].model->support_size > 0 || bundle.targets.size() > 1),
      columns_(UnknownsOf(layout, camera)),
      own_column_(static_cast<size_t>(layout.head)) {
  for (size_t i = 0; i < columns_.size(); ++i) {
    own_column_[static_cast<size_t>(columns_[i])] = static_cast<Eigen::Index>(i);
  }
  columns_.push_back(layout.total);
  own_ = std::ssize(columns_);
  panel_ = ZeroRows(own_ + 6, sparse_ ? 4 : kPanelColumns);
  product_ = Eigen::MatrixXd::Zero(sparse_ ? 6 : own_ + 6, own_ + 6);
  marker_.resize(own_ + 6, UnknownLayout::kOfMarker);
  square_ = Eigen::MatrixXd::Zero(own_, own_);
  marker_cross_ = Eigen::MatrixXd::Zero(own_, layout.Markers());
}

void ViewProducts::Add(const MarkerRows& rows, SixColumns* cross, Eigen::MatrixXd* S) {
  const Eigen::Index count = rows.Count();
  if (used_ + count > panel_.cols()) Flush();
  if (count > panel_.cols()) panel_ = ZeroRows(own_ + 6, RoundUpToFour(count));
  auto J = panel_.block(0, used_, own_ + 6, count);
  J.setZero();
  ForEachDerivative(bundle_, layout_, camera_, rows, [&](int first, const auto& by) {
    if (first >= layout_.head) return;
    constexpr int kColumns = std::decay_t<decltype(by)>::ColsAtCompileTime;
    J.template middleRows<kColumns>(own_column_[static_cast<size_t>(first)]) += by.transpose();
  });
  J.row(own_ - 1) = rows.Residual().transpose();
  J.template bottomRows<6>() = rows.Pose().transpose();
  if (layout_.markers) {
    constexpr int kOfMarker = UnknownLayout::kOfMarker;
    const int m = layout_.Marker(rows.Marker());
    marker_.noalias() = J.lazyProduct(rows.Position());
    marker_cross_.middleCols<kOfMarker>(m - layout_.head) += marker_.topRows(own_);
    cross->middleRows<kOfMarker>(m) += marker_.bottomRows<6>().transpose();
    S->block<kOfMarker, kOfMarker>(m, m) +=
        rows.Position().transpose().lazyProduct(rows.Position());
  }
  if (sparse_) {
    AddSparse(count);
  } else {
    used_ += count;
  }
}

void ViewProducts::Flush() {
  if (used_ == 0) return;
  const Eigen::Index columns = RoundUpToFour(used_);
  panel_.middleCols(used_, columns - used_).setZero();
  AddRowProducts(1, panel_, columns, &product_);
  used_ = 0;
}

void ViewProducts::AddSparse(Eigen::Index rows) {
  for (Eigen::Index r = 0; r < rows; ++r) {
    touched_.clear();
    for (Eigen::Index i = 0; i < own_; ++i) {
      if (panel_(i, r) != 0) touched_.push_back(i);
    }
    const Vector6d E = panel_.col(r).segment<6>(own_);
    for (const Eigen::Index i : touched_) {
      for (const Eigen::Index k : touched_) square_(k, i) += panel_(i, r) * panel_(k, r);
      product_.col(i) += panel_(i, r) * E;
    }
    product_.rightCols<6>().noalias() += E * E.transpose();
  }
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
