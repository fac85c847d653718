// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/reduced/states.h"

#include <Eigen/Cholesky>
#include <algorithm>

#include "calib/kernels/processors.h"

namespace plenocal::internal {
namespace {

// out = C L^-T, six numbers a row, with `stride` numbers from one row of `out` to the next.
// `inverse`: L^-1 by columns, so that its column k is what the k-th number of a row contributes.
PLENOCAL_FOR_EACH_PROCESSOR
void SolveRows(
    const double* C, Eigen::Index rows, const Matrix6d& inverse, double* out, Eigen::Index stride) {
  for (Eigen::Index i = 0; i < rows; ++i, C += 6, out += stride) {
    double sums[6] = {};
    for (Eigen::Index k = 0; k < 6; ++k) {
      for (Eigen::Index j = 0; j < 6; ++j) sums[j] += C[k] * inverse(j, k);
    }
    std::copy_n(sums, 6, out);
  }
}

// L'^-1 B
template <typename Derived>
typename Derived::PlainObject SolveTransposed(const Matrix6d& L,
                                              const Eigen::MatrixBase<Derived>& B) {
  return L.triangularView<Eigen::Lower>().transpose().solve(B.derived());
}

}  // namespace

Eigen::Index EliminatedColumns::Add(const SixColumns& C, const Matrix6d& L, Eigen::MatrixXd* S) {
  if (used_ == kColumns) Flush(S);
  if (used_ == 0 && (options_.keep_steps || batches_.empty())) {
    // Four more columns: rows that are apart by a power of two share few lines of the cache.
    batches_.push_back(ZeroRows(rows_, kColumns + 4));
  }
  const Matrix6d inverse = L.triangularView<Eigen::Lower>().solve(Matrix6d::Identity().eval());
  SolveRows(C.data(), rows_, inverse, batches_.back().data() + used_, batches_.back().cols());
  used_ += 6;
  return static_cast<Eigen::Index>(batches_.size() - 1) * kColumns + used_ - 6;
}

void EliminatedColumns::Flush(Eigen::MatrixXd* S) {
  if (used_ == 0) return;
  const Eigen::Index columns = RoundUpToFour(used_);
  batches_.back().middleCols(used_, columns - used_).setZero();
  if (options_.separate_markers) {
    const auto W = batches_.back().topLeftCorner(rows_, columns);
    S->leftCols(head_).noalias() -= W * W.topRows(head_).transpose();
    S->row(rows_ - 1).tail(rows_ - head_).noalias() -=
        W.row(rows_ - 1) * W.bottomRows(rows_ - head_).transpose();
  } else {
    AddRowProducts(-1, batches_.back(), columns, S);
  }
  last_ = used_;
  used_ = 0;
}

SixColumns EliminatedColumns::Six(Eigen::Index first) const {
  return batches_[static_cast<size_t>(first / kColumns)].block(0, first % kColumns, rows_, 6);
}

Eigen::MatrixXd EliminatedColumns::Rows(Eigen::Index first, Eigen::Index count) const {
  const auto batches = static_cast<Eigen::Index>(batches_.size());
  Eigen::MatrixXd rows(count, batches == 0 ? 0 : (batches - 1) * kColumns + last_);
  for (Eigen::Index b = 0; b < batches; ++b) {
    const Eigen::Index columns = b + 1 < batches ? kColumns : last_;
    rows.middleCols(b * kColumns, columns) =
        batches_[static_cast<size_t>(b)].block(first, 0, count, columns);
  }
  return rows;
}

Eigen::VectorXd EliminatedColumns::TimesTransposed(const Eigen::VectorXd& x) const {
  Eigen::VectorXd product(static_cast<Eigen::Index>(batches_.size()) * kColumns);
  for (size_t b = 0; b < batches_.size(); ++b) {
    product.segment<kColumns>(static_cast<Eigen::Index>(b) * kColumns).noalias() =
        batches_[b].topLeftCorner(rows_, kColumns).transpose() * x;
  }
  return product;
}

size_t States::IndexOf(Id state) const {
  size_t index = 0;
  while (!slots_[index].used || slots_[index].state != state) ++index;
  return index;
}

States::Id States::Enter() {
  auto free = std::ranges::find(slots_, false, &Slot::used);
  if (free == slots_.end()) {
    for (Slot& slot : slots_) slot.H.emplace_back();
    slots_.push_back({.C = SixColumns(rows_, 6), .H = std::vector<Matrix6d>(slots_.size() + 1)});
    free = slots_.end() - 1;
  }
  free->used = true;
  free->state = eliminated_.size();
  free->C.setZero();
  for (Matrix6d& H : free->H) H.setZero();
  eliminated_.emplace_back();
  return free->state;
}

Matrix6d& States::Information(Id a, Id b) { return SlotOf(a).H[IndexOf(b)]; }

void States::Leave(Id state, double damping, Eigen::MatrixXd* S) {
  const size_t index = IndexOf(state);
  Slot& own = slots_[index];
  own.used = false;
  Eliminated& record = eliminated_[state];
  record.turn = order_.size();
  order_.push_back(state);
  Matrix6d information = own.H[index];
  information.diagonal() *= 1 + damping;
  Eigen::LLT<Matrix6d> factor(information);
  if (factor.info() != Eigen::Success) {
    if (!keep_) return;
    constexpr double kLeast = 1e-6;
    information.diagonal() += kLeast * own.H[index].diagonal();
    information.diagonal().array() += kLeast * kLeast * own.H[index].diagonal().maxCoeff();
    factor.compute(information);
    if (factor.info() != Eigen::Success) return;
  }
  record.determined = true;
  record.L = factor.matrixL();
  record.column = columns_.Add(own.C, record.L, S);
  for (size_t i = 0; i < slots_.size(); ++i) {
    if (!slots_[i].used) continue;
    const bool later = slots_[i].state > state;
    const Matrix6d H = later ? slots_[i].H[index] : Matrix6d(own.H[i].transpose());
    record.V.emplace_back(slots_[i].state, factor.matrixL().solve(H.transpose()).transpose());
  }
  if (record.V.empty()) return;
  const SixColumns W = columns_.Six(record.column);
  for (const auto& [i, V_i] : record.V) {
    SlotOf(i).C.noalias() -= W * V_i.transpose();
    for (const auto& [k, V_k] : record.V) {
      if (i >= k) Information(i, k).noalias() -= V_i * V_k.transpose();
    }
  }
}

std::vector<Vector6d> States::Steps(const Eigen::VectorXd& step, double own_part) const {
  Eigen::VectorXd with_gradient(step.size() + 1);
  with_gradient << step, own_part;
  const Eigen::VectorXd product = columns_.TimesTransposed(with_gradient);
  std::vector<Vector6d> steps(eliminated_.size(), Vector6d::Zero());
  for (size_t turn = order_.size(); turn-- > 0;) {
    const Eliminated& record = eliminated_[order_[turn]];
    if (!record.determined) continue;
    Vector6d right = product.segment<6>(record.column);
    for (const auto& [other, V] : record.V) right += V.transpose() * steps[other];
    steps[order_[turn]] = -SolveTransposed(record.L, right);
  }
  return steps;
}

void States::ComputeCovariances() {
  for (size_t turn = order_.size(); turn-- > 0;) {
    Eliminated& record = eliminated_[order_[turn]];
    if (!record.determined) continue;
    Matrix6d inner = Matrix6d::Identity();
    for (const auto& [k, V_k] : record.V) {
      Matrix6d sum = Matrix6d::Zero();
      for (const auto& [l, V_l] : record.V) sum += V_l.transpose() * Covariance(l, k);
      inner += sum * V_k;
      record.with.emplace_back(-SolveTransposed(record.L, sum));
    }
    const Matrix6d half = SolveTransposed(record.L, inner);
    record.covariance = SolveTransposed(record.L, half.transpose());
  }
}

Matrix6d States::Covariance(Id a, Id b) const {
  if (a == b) return eliminated_[a].covariance;
  const bool swap = eliminated_[a].turn > eliminated_[b].turn;
  const Eliminated& first = eliminated_[swap ? b : a];
  for (size_t i = 0; i < first.with.size(); ++i) {
    if (first.V[i].first != (swap ? a : b)) continue;
    return swap ? Matrix6d(first.with[i].transpose()) : first.with[i];
  }
  return Matrix6d::Zero();
}

}  // namespace plenocal::internal
