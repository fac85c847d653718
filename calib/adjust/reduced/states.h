// SPDX-License-Identifier: Apache-2.0
//
// Elimination of states, six numbers each, from normal equations as soon as no further rows depend
// on them.
#pragma once

#include <Eigen/Core>
#include <utility>
#include <vector>

#include "calib/camera/rigid_transform.h"
#include "calib/kernels/row_products.h"

namespace plenocal::internal {

/// Six numbers a row.
using SixColumns = Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::RowMajor>;

struct EliminationOptions {
  /// Keeps what steps of the states need: 48 bytes a state and unknown.
  bool keep_steps = false;
  /// Leaves the markers' part of `S` as it is before states are eliminated: blocks on its diagonal.
  /// What the elimination takes away from it follows from `States::RowsOfColumns`. REQUIRES:
  /// keep_steps.
  bool separate_markers = false;
  bool keep_views = false;  ///< `ReducedEquations::views`
};

/// Columns W = C L^-T of eliminated states, whose W W' is taken away from the normal matrix S: many
/// at once, since one large product is faster than many small ones.
class EliminatedColumns {
 public:
  /// `rows` of S, of which the first `head` do not belong to markers.
  EliminatedColumns(Eigen::Index rows, Eigen::Index head, const EliminationOptions& options)
      : rows_(rows), head_(head), options_(options) {}

  /// Returns the index of the first column.
  Eigen::Index Add(const SixColumns& C, const Matrix6d& L, Eigen::MatrixXd* S);
  /// S -= W W' of the columns since the last time.
  void Flush(Eigen::MatrixXd* S);
  /// Six columns that are kept or were not flushed yet.
  [[nodiscard]] SixColumns Six(Eigen::Index first) const;
  /// W of rows that start at `first`, when all has been flushed.
  [[nodiscard]] Eigen::MatrixXd Rows(Eigen::Index first, Eigen::Index count) const;
  /// W' x
  [[nodiscard]] Eigen::VectorXd TimesTransposed(const Eigen::VectorXd& x) const;

 private:
  static constexpr Eigen::Index kColumns = 6 * 32;

  Eigen::Index rows_, head_;
  EliminationOptions options_;
  std::vector<RowMajorMatrix> batches_;
  Eigen::Index used_ = 0, last_ = 0;  // columns of the last batch: not flushed, and flushed
};

/// States in the order in which they are eliminated. Their normal equations are H (states), C
/// (other unknowns x states, the last row the gradient) and S (other unknowns). A state j leaves by
///   L L' = H_jj,  V_i = H_ij L^-T,  W = C_j L^-T;  H_ik -= V_i V_k',  C_i -= W V_i',  S -= W W'
/// for all i, k that are in the system then. Poses of frames leave when their frame ends; the knots
/// of a trajectory, which successive frames share, would leave after their last frame.
class States {
 public:
  /// The number of a state, from 0 on as they enter.
  using Id = size_t;

  States(Eigen::Index rows, Eigen::Index head, const EliminationOptions& options)
      : rows_(rows), keep_(options.keep_steps), columns_(rows, head, options) {}

  /// A state joins the system, without information.
  Id Enter();
  /// H of two states that are in the system, `a` not before `b`; C of one. To be added to.
  Matrix6d& Information(Id a, Id b);
  SixColumns& Cross(Id state) { return SlotOf(state).C; }
  /// Eliminates a state; `damping` is added to its information as a part of its diagonal. Without
  /// information enough it changes nothing else; where steps are kept, its step is held small.
  void Leave(Id state, double damping, Eigen::MatrixXd* S);
  void Flush(Eigen::MatrixXd* S) { columns_.Flush(S); }

  /// Steps of all states to the optimum of the linearised residuals when the other unknowns change
  /// by `step`. `own_part`: factor on the part that does not depend on `step`. REQUIRES:
  /// keep_steps.
  [[nodiscard]] std::vector<Vector6d> Steps(const Eigen::VectorXd& step, double own_part) const;
  /// W of `count` rows from `first` on: the elimination takes W W' away from their block.
  [[nodiscard]] Eigen::MatrixXd RowsOfColumns(Eigen::Index first, Eigen::Index count) const {
    return columns_.Rows(first, count);
  }
  /// Computes the covariance of each state, and of those that were in the system together, all
  /// other unknowns fixed (Takahashi et al. 1973).
  void ComputeCovariances();
  /// E[a b'] of two states; zero where they were not in the system together or have no information.
  [[nodiscard]] Matrix6d Covariance(Id a, Id b) const;
  [[nodiscard]] bool IsDetermined(Id state) const { return eliminated_[state].determined; }

 private:
  struct Slot {
    bool used = false;
    Id state = 0;
    SixColumns C;
    std::vector<Matrix6d> H;  // with the state of each slot; of pairs one is valid (`Information`)
  };
  struct Eliminated {
    bool determined = false;
    Eigen::Index column = 0;  // of W
    Matrix6d L = Matrix6d::Zero();
    std::vector<std::pair<Id, Matrix6d>> V;
    size_t turn = 0;                         // of leaving
    Matrix6d covariance = Matrix6d::Zero();  // of itself
    std::vector<Matrix6d> with;              // its covariance with each of V
  };

  size_t IndexOf(Id state) const;
  Slot& SlotOf(Id state) { return slots_[IndexOf(state)]; }

  Eigen::Index rows_;
  bool keep_;
  EliminatedColumns columns_;
  std::vector<Slot> slots_;  // of the states in the system, used again and again
  std::vector<Eliminated> eliminated_;
  std::vector<Id> order_;  // of leaving
};

}  // namespace plenocal::internal
