// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/reduced/elimination.h"

#include <limits>
#include <optional>
#include <utility>

#include "calib/adjust/reduced/view_products.h"

namespace plenocal::internal {
namespace {

double SquaresOfMarkerPriors(const Bundle& bundle) {
  double squares = 0;
  if (!bundle.marker_freedom.HasTolerance()) return squares;
  for (size_t m = 0; m < bundle.markers.size(); ++m) {
    squares += (bundle.markers[m].position - bundle.Expected(static_cast<int>(m))).squaredNorm() /
               bundle.marker_freedom.Variance();
  }
  return squares;
}

// A visitor of rows.
class Elimination {
 public:
  Elimination(const Bundle& bundle,
              const UnknownLayout& layout,
              const Objective& objective,
              double damping,
              const EliminationOptions& options)
      : bundle_(bundle),
        layout_(layout),
        objective_(objective),
        damping_(damping),
        keep_views_(options.keep_views),
        equations_{.S = Eigen::MatrixXd::Zero(layout.total + 1, layout.total + 1),
                   .diagonal = {},
                   .states = States(layout.total + 1, layout.head, options),
                   .order = {},
                   .views = {}},
        cross_(SixColumns::Zero(layout.total + 1, 6)) {
    for (size_t c = 0; c < bundle.cameras.size(); ++c) products_.emplace_back(bundle, layout, c);
  }

  ReducedEquations Run() {
    const RowColumns columns{.params = true, .extrinsics = true, .pose = true, .marker = true};
    equations_.complete = RowWalk(bundle_, objective_.loss, columns).Visit(*this);
    equations_.states.Flush(&equations_.S);
    const Eigen::VectorXd eliminated = equations_.S.diagonal();
    for (const ViewProducts& products : products_) {
      products.AddTo(&equations_.S);
      equations_.squares += products.Squares();
    }
    if (layout_.markers) AddMarkerPriors();
    equations_.squares += SquaresOfMarkerPriors(bundle_);
    equations_.diagonal = equations_.S.diagonal() - eliminated;
    return std::move(equations_);
  }

  void Marker(const VisitedView& view, const MarkerRows& rows) {
    products_[view.camera].Add(rows, &CrossOf(view), &equations_.S);
    if (keep_views_) means_ += rows.PoseInformationOfMean();
  }

  void EndView(const VisitedView& visited) {
    SixColumns& cross = CrossOf(visited);
    EliminatedView view{.frame = visited.frame,
                        .camera = visited.camera,
                        .information = products_[visited.camera].EndView(&cross),
                        .information_of_means = std::exchange(means_, Matrix6d::Zero()),
                        .pose = Pose(visited.frame)};
    if (Turns()) {
      AddTurnedView(&view);
      cross_.setZero();
    } else {
      equations_.states.Information(view.pose, view.pose) += view.information;
    }
    if (keep_views_) equations_.views.push_back(view);
  }

  void EndFrame(size_t frame) {
    equations_.states.Leave(Pose(frame), damping_, &equations_.S);
    pose_.reset();
  }

 private:
  // True where the poses that cameras see are not those of frames.
  [[nodiscard]] bool Turns() const { return bundle_.EstimatesJitter() || !bundle_.motion.empty(); }

  // Products of the view's other unknowns with the pose that its camera saw.
  SixColumns& CrossOf(const VisitedView& view) {
    return Turns() ? cross_ : equations_.states.Cross(Pose(view.frame));
  }

  States::Id Enter(const EliminatedState& state) {
    equations_.order.push_back(state);
    return equations_.states.Enter();
  }
  States::Id Pose(size_t frame) {
    if (!pose_) pose_ = Enter({.index = frame});
    return *pose_;
  }

  // Adds a view whose pose is that of the frame after a change of its own: motion and jitter, which
  // is eliminated.
  void AddTurnedView(EliminatedView* view) {
    States& states = equations_.states;
    view->charts = ChartsOf(bundle_, view->frame, view->camera);
    const auto& [by_pose, by_jitter] = view->charts;
    const Matrix6d of_pose = by_pose.transpose() * view->information;
    states.Information(view->pose, view->pose) += of_pose * by_pose;
    states.Cross(view->pose) += cross_ * by_pose;
    if (!bundle_.EstimatesJitter()) return;
    const size_t index = bundle_.View(view->frame, view->camera);
    const Matrix6d& W = objective_.jitter_weights[index];
    const Vector6d residual = W * bundle_.jitter.delta[index];
    equations_.squares += residual.squaredNorm();
    view->jitter = Enter({.is_jitter = true, .index = index});
    states.Information(view->jitter, view->jitter) =
        by_jitter.transpose() * view->information * by_jitter + W.transpose() * W;
    states.Information(view->jitter, view->pose) = (of_pose * by_jitter).transpose();
    states.Cross(view->jitter) = cross_ * by_jitter;
    states.Cross(view->jitter).row(layout_.total) += residual.transpose() * W;
    states.Leave(view->jitter, damping_, &equations_.S);
  }

  void AddMarkerPriors() {
    const double information = 1 / bundle_.marker_freedom.Variance();
    for (size_t m = 0; m < bundle_.markers.size(); ++m) {
      const Eigen::Vector3d moved =
          bundle_.markers[m].position - bundle_.Expected(static_cast<int>(m));
      const int first = layout_.Marker(static_cast<int>(m));
      equations_.S.diagonal().segment<3>(first).array() += information;
      equations_.S.row(layout_.total).segment<3>(first) += information * moved.transpose();
    }
  }

  const Bundle& bundle_;
  const UnknownLayout& layout_;
  const Objective& objective_;
  double damping_;
  bool keep_views_;
  ReducedEquations equations_;
  SixColumns cross_;  // of one view whose pose is not the frame's
  Matrix6d means_ = Matrix6d::Zero();
  std::optional<States::Id> pose_;      // of the present frame
  std::vector<ViewProducts> products_;  // per camera
};

}  // namespace

Objective ObjectiveOf(const Bundle& bundle, const RobustLoss& loss) {
  Objective objective{loss, {}};
  for (size_t frame = 0; bundle.EstimatesJitter() && frame < bundle.T_rig_target.size(); ++frame) {
    for (size_t c = 0; c < bundle.cameras.size(); ++c) {
      objective.jitter_weights.push_back(JitterWeight(bundle, frame, c));
    }
  }
  return objective;
}

void ReducedEquations::MoveStates(const Eigen::VectorXd& step,
                                  double own_part,
                                  Bundle* bundle) const {
  const std::vector<Vector6d> steps = states.Steps(step, own_part);
  for (size_t i = 0; i < steps.size(); ++i) {
    if (order[i].is_jitter) {
      bundle->jitter.delta[order[i].index] += steps[i];
    } else {
      RigidTransform& T_rig_target = bundle->T_rig_target[order[i].index];
      T_rig_target = Retract(T_rig_target, steps[i]);
    }
  }
}

ReducedEquations EliminateFrames(const Bundle& bundle,
                                 const UnknownLayout& layout,
                                 const Objective& objective,
                                 double damping,
                                 const EliminationOptions& options) {
  return Elimination(bundle, layout, objective, damping, options).Run();
}

double SumOfSquares(const Bundle& bundle, const Objective& objective) {
  struct {
    const Bundle& bundle;
    const Objective& objective;
    double squares = 0;

    void Marker(const VisitedView& /*view*/, const MarkerRows& rows) {
      squares += rows.Residual().squaredNorm();
    }
    void EndView(const VisitedView& view) {
      if (!bundle.EstimatesJitter()) return;
      const size_t index = bundle.View(view.frame, view.camera);
      squares += (objective.jitter_weights[index] * bundle.jitter.delta[index]).squaredNorm();
    }
    void EndFrame(size_t /*frame*/) {}
  } sum{bundle, objective};
  if (!RowWalk(bundle, objective.loss, {}).Visit(sum)) {
    return std::numeric_limits<double>::infinity();
  }
  return sum.squares + SquaresOfMarkerPriors(bundle);
}

}  // namespace plenocal::internal
