// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/elimination/view_products.h"

#include <algorithm>
#include <cmath>

namespace plenocal::internal {

ViewProducts::ViewProducts(const Bundle& bundle, const UnknownLayout& layout, size_t camera)
    : bundle_(bundle),
      layout_(layout),
      camera_(bundle.cameras[camera]),
      rows_(static_cast<Eigen::Index>(camera_.model->measured.size())),
      sparse_(camera_.model->support_size > 0 || bundle.targets.size() > 1),
      extrinsics_(layout.extrinsics[camera] >= 0),
      M_sum_(decltype(M_sum_)::Zero()),
      marker_square_(Eigen::Matrix3d::Zero()) {
  const std::vector<int>& params = layout.params[camera];
  J_params_.resize(static_cast<size_t>(rows_) * params.size());
  for (size_t k = 0; k < params.size(); ++k) {
    if (params[k] < 0) continue;
    const auto column = std::find(columns_.begin(), columns_.end(), params[k]);
    free_.emplace_back(static_cast<Eigen::Index>(k), column - columns_.begin());
    if (column == columns_.end()) columns_.push_back(params[k]);
  }
  own_params_ = static_cast<Eigen::Index>(columns_.size());
  for (int i = 0; extrinsics_ && i < 6; ++i) columns_.push_back(layout.extrinsics[camera] + i);
  for (const int target : layout.targets) {
    target_columns_.push_back(static_cast<Eigen::Index>(columns_.size()));
    for (int i = 0; target >= 0 && i < 6; ++i) columns_.push_back(target + i);
  }
  columns_.push_back(layout.total);
  own_ = static_cast<Eigen::Index>(columns_.size());
  row_.resize(rows_, own_ + 6);
  row_sum_ = RowMajorMatrix::Zero(rows_, own_ + 6);
  if (sparse_) {
    product_ = Eigen::MatrixXd::Zero(6, own_ + 6);
  } else {
    plus_.rows = minus_.rows = ZeroRows(own_ + 6, kPanelColumns);
    minus_.sign = -1;
    product_ = Eigen::MatrixXd::Zero(own_ + 6, own_ + 6);
  }
  marker_ = Eigen::MatrixXd::Zero(own_ + 6, 3);
  square_ = Eigen::MatrixXd::Zero(own_, own_);
  marker_cross_ = Eigen::MatrixXd::Zero(own_, layout.total - layout.head);
}

bool ViewProducts::Load(const LinearisedView& view,
                        const BundleObservation& observation,
                        const RobustLoss& loss) {
  const Eigen::Vector3d& p_target =
      bundle_.markers[static_cast<size_t>(observation.marker)].position;
  double residual[kMaxObservationSize];
  const LinearisedRows out{.residual = residual,
                           .J_params = J_params_.data(),
                           .J_extrinsics = extrinsics_ ? J_extrinsics_ : nullptr,
                           .J_pose = J_pose_,
                           .J_marker = M_.data()};
  if (!Linearise(camera_, camera_.params.data(), view, p_target, observation, out)) {
    // Within rounding of the edge of the domain, where a step has ended, derivatives may not exist
    // although the residual does; the point then does not count for the next step.
    const LinearisedRows edge{.residual = residual};
    if (!Linearise(camera_, camera_.params.data(), view, p_target, observation, edge)) return false;
    ClearDerivatives(camera_, out);
  }
  Robustify(loss, camera_, observation.assumed_sigma, out);
  SetRows(p_target, observation.marker);
  for (Eigen::Index r = 0; r < rows_; ++r) row_(r, own_ - 1) = residual[r];
  return true;
}

void ViewProducts::SetRows(const Eigen::Vector3d& p_target, int marker) {
  const size_t params = camera_.params.size();
  for (Eigen::Index r = 0; r < rows_; ++r) {
    double* const row = row_.row(r).data();
    std::fill_n(row, own_, 0.0);
    const double* const J_params = J_params_.data() + static_cast<size_t>(r) * params;
    for (const auto& [param, column] : free_) row[column] += J_params[param];
    if (extrinsics_) std::copy_n(J_extrinsics_ + 6 * r, 6, row + own_params_);
    std::copy_n(J_pose_ + 6 * r, 6, row + own_);
  }
  const std::optional<size_t> target = bundle_.FreeTarget(marker);
  if (!target) return;
  row_.middleCols<6>(target_columns_[*target]) =
      M_.topRows(rows_) * PointByTargetPose(bundle_.targets[*target].T_target_own, p_target);
}

void ViewProducts::AddToMean(double own_sigma) {
  information_ += 1 / (own_sigma * own_sigma);
  row_sum_ += row_ / own_sigma;
  M_sum_.topRows(rows_) += M_.topRows(rows_) / own_sigma;
}

double ViewProducts::LoadMean(double common_sigma) {
  const double root = std::sqrt(information_);
  row_ = row_sum_ / root;
  M_.topRows(rows_) = M_sum_.topRows(rows_) / root;
  const double taken = CommonShare(common_sigma, information_) * information_;
  information_ = 0;
  row_sum_.setZero();
  M_sum_.setZero();
  return taken;
}

Matrix6d ViewProducts::PoseSquare() const {
  const auto E = row_.rightCols<6>();
  return E.transpose().lazyProduct(E);
}

void ViewProducts::AddRows(double weight) {
  if (sparse_) {
    AddSparse(weight);
  } else {
    AddToPanel(weight);
  }
  if (!layout_.markers) return;
  for (Eigen::Index r = 0; r < rows_; ++r) {
    for (Eigen::Index k = 0; k < 3; ++k) {
      marker_.col(k).noalias() += (weight * M_(r, k)) * row_.row(r).transpose();
    }
  }
  marker_square_.noalias() += weight * M_.topRows(rows_).transpose().lazyProduct(M_.topRows(rows_));
}

void ViewProducts::AddToPanel(double weight) {
  Panel& panel = weight > 0 ? plus_ : minus_;
  const double root = std::sqrt(std::abs(weight));
  if (panel.used + rows_ > kPanelColumns) Flush(&panel);
  for (Eigen::Index r = 0; r < rows_; ++r) {
    double* const column = panel.rows.data() + panel.used + r;
    const double* const row = row_.row(r).data();
    for (Eigen::Index i = 0; i < row_.cols(); ++i) column[i * panel.rows.cols()] = root * row[i];
  }
  panel.used += rows_;
}

void ViewProducts::Flush(Panel* panel) {
  if (panel->used == 0) return;
  const Eigen::Index columns = RoundUpToFour(panel->used);
  panel->rows.middleCols(panel->used, columns - panel->used).setZero();
  AddRowProducts(panel->sign, panel->rows, columns, &product_);
  panel->used = 0;
}

void ViewProducts::AddSparse(double weight) {
  for (Eigen::Index r = 0; r < rows_; ++r) {
    touched_.clear();
    for (Eigen::Index i = 0; i < own_; ++i) {
      if (row_(r, i) != 0) touched_.push_back(i);
    }
    const auto E = row_.row(r).tail<6>();
    for (const Eigen::Index i : touched_) {
      const double j = weight * row_(r, i);
      for (const Eigen::Index k : touched_) square_(k, i) += j * row_(r, k);
      product_.col(i) += j * E.transpose();
    }
    product_.rightCols<6>().noalias() += weight * E.transpose() * E;
  }
}

void ViewProducts::EndMarker(int marker, SixColumns* cross, Eigen::MatrixXd* S) {
  if (!layout_.markers) return;
  const int m = layout_.Marker(marker);
  marker_cross_.middleCols<3>(3 * marker) += marker_.topRows(own_);
  cross->middleRows<3>(m) += marker_.bottomRows<6>().transpose();
  S->block<3, 3>(m, m) += marker_square_;
  marker_.setZero();
  marker_square_.setZero();
}

Matrix6d ViewProducts::EndView(SixColumns* cross) {
  if (!sparse_) {
    Flush(&plus_);
    Flush(&minus_);
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
