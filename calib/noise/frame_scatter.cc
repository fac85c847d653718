// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/frame_scatter.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "calib/adjust/rows.h"
#include "calib/base/linear_algebra.h"
#include "calib/noise/matrix_root.h"

namespace plenocal {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Number of combinations of unknowns that are looked at where a model has very many.
constexpr Eigen::Index kMostDirections = 32;

using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Indices of one camera's unknowns and of the poses of targets, which all cameras share.
std::vector<int> IndicesOf(const Uncertainty& uncertainty, size_t camera) {
  return internal::UnknownsOf({.params = uncertainty.param_index,
                               .extrinsics = uncertainty.extrinsics_index,
                               .targets = uncertainty.target_index},
                              camera);
}

// Sums over rows that share a pose, of their products with B = [J D with the directions D, 6
// columns of the pose, residual]: J' B, whose first part is the information J' J times D, and E' B
// by the pose.
struct PoseSums {
  Eigen::Index directions;
  MatrixXd J_B, E_B;

  PoseSums(Eigen::Index rows, Eigen::Index directions_count)
      : directions(directions_count),
        J_B(MatrixXd::Zero(rows, directions + 7)),
        E_B(MatrixXd::Zero(6, J_B.cols())) {}

  [[nodiscard]] auto Information() const { return J_B.leftCols(directions); }
  [[nodiscard]] auto Cross() const { return J_B.middleCols<6>(directions); }
  [[nodiscard]] auto Gradient() const { return J_B.col(directions + 6); }
  [[nodiscard]] Matrix6d PoseInformation() const { return E_B.middleCols<6>(directions); }

  // Eliminates the pose; returns the inverse of its information times E_B, or nothing for a pose
  // without information.
  std::optional<MatrixXd> EliminatePose() {
    std::optional<MatrixXd> solved = SolvePositive(PoseInformation(), E_B);
    if (solved) Subtract(*solved);
    return solved;
  }
  // Leaves the pose to the frame's other views, but for what is the view's own jitter `delta` with
  // the prior information Q.
  void EliminateJitter(const Matrix6d& Q, const Vector6d& delta) {
    MatrixXd right = E_B;
    right.col(directions + 6) += Q * delta;
    const Matrix6d own = PoseInformation() + Q;
    Subtract(own.llt().solve(right));
  }

 private:
  void Subtract(const MatrixXd& solved) {
    const MatrixXd cross = Cross();
    const Matrix6d pose = PoseInformation();
    J_B.noalias() -= cross * solved;
    E_B.noalias() -= pose * solved;
  }
};

// Matrices that the rows of all cameras share.
struct RowContext {
  const Bundle& bundle;
  const Uncertainty& uncertainty;
  const MatrixXd& D;       // directions in all unknowns
  MatrixXd marker_D = {};  // change of the best markers with these, its sign changed; empty: held
};

// Sums over the rows of one marker in all frames, of the derivatives b by the directions with poses
// and markers at their best: b' residual and, of each camera's directions, the lower triangle of
// b' b.
struct MarkerSums {
  VectorXd score;
  std::vector<MatrixXd> information;
};

// Derivatives of one camera's rows, view by view. They touch its own unknowns and, where markers
// are estimated, three coordinates, which follow all unknowns: these come in at the end, once a
// frame.
class CameraRows {
 public:
  CameraRows(const RowContext& context, size_t camera)
      : context_(context),
        own_(IndicesOf(context.uncertainty, camera)),
        D_(context.D(own_, Eigen::all)),
        camera_(camera),
        layout_(internal::MakeLayout(context.bundle)),
        column_(static_cast<size_t>(layout_.head)) {
    for (size_t i = 0; i < own_.size(); ++i) {
      column_[static_cast<size_t>(own_[i])] = static_cast<Eigen::Index>(i);
    }
  }

  // Indices of the camera's own unknowns.
  [[nodiscard]] const std::vector<int>& Own() const { return own_; }

  void Clear() { spans_.clear(); }
  // Adds the rows of one marker in the present view.
  void Add(const internal::MarkerRows& rows) {
    const Eigen::Index count = rows.Count(), first = Used();
    Reserve(first + count);
    auto J = J_.middleRows(first, count);
    J.setZero();
    internal::ForEachDerivative(
        context_.bundle, layout_, camera_, rows, [&](int unknown, const auto& by) {
          if (unknown >= layout_.head) return;
          J.middleCols(column_[static_cast<size_t>(unknown)], by.cols()) += by;
        });
    E_.middleRows(first, count) = rows.Pose();
    J_marker_.middleRows(first, count) = rows.Position();
    residuals_.segment(first, count) = rows.Residual();
    spans_.push_back({rows.Marker(), first, count});
  }

  // Sums over the rows of the view: rows of the own unknowns, then of all markers. The pose is that
  // which the camera saw.
  PoseSums SumView() {
    PoseSums sums(D_.rows() + context_.marker_D.rows(), D_.cols());
    const auto J = J_.topRows(Used()), E = E_.topRows(Used());
    B_.resize(Used(), sums.J_B.cols());
    B_.leftCols(D_.cols()).noalias() = J * D_;
    B_.middleCols<6>(D_.cols()) = E;
    B_.rightCols<1>() = residuals_.head(Used());
    for (const auto& [marker, first, count] : spans_) {
      if (context_.marker_D.size() == 0) break;  // no rows, or no unknowns that markers follow
      B_.block(first, 0, count, D_.cols()).noalias() -=
          J_marker_.middleRows(first, count) * context_.marker_D.middleRows<3>(3 * marker);
    }
    sums.J_B.topRows(D_.rows()).noalias() = J.transpose() * B_;
    for (const auto& [marker, first, count] : spans_) {
      if (context_.marker_D.rows() == 0) break;
      sums.J_B.middleRows<3>(D_.rows() + 3 * marker).noalias() =
          J_marker_.middleRows(first, count).transpose() * B_.middleRows(first, count);
    }
    sums.E_B.noalias() = E.transpose() * B_;
    return sums;
  }

  // Adds the rows of the last view to the sums of their markers. The first columns of `pose_D`: the
  // negative change of the best pose with each direction.
  void AddToMarkers(const MatrixXd& pose_D, std::vector<MarkerSums>* markers) const {
    const Eigen::Index count = D_.cols();
    if (count == 0) return;
    // By columns: one row's numbers follow each other.
    const MatrixXd b =
        (B_.leftCols(count) - B_.middleCols<6>(count) * pose_D.leftCols(count)).transpose();
    for (const Span& span : spans_) {
      MarkerSums& sums = (*markers)[static_cast<size_t>(span.marker)];
      for (Eigen::Index row = span.first; row < span.first + span.count; ++row) {
        sums.score += B_(row, count + 6) * b.col(row);
        Eigen::Index first = 0;
        for (MatrixXd& information : sums.information) {
          const auto own = b.col(row).segment(first, information.rows());
          information.selfadjointView<Eigen::Lower>().rankUpdate(own);
          first += own.size();
        }
      }
    }
  }

 private:
  // Rows of one marker.
  struct Span {
    Eigen::Index marker, first, count;
  };

  [[nodiscard]] Eigen::Index Used() const {
    return spans_.empty() ? 0 : spans_.back().first + spans_.back().count;
  }
  void Reserve(Eigen::Index rows) {
    if (rows <= J_.rows()) return;
    J_.conservativeResize(2 * rows, D_.rows());
    E_.conservativeResize(2 * rows, 6);
    J_marker_.conservativeResize(2 * rows, 3);
    residuals_.conservativeResize(2 * rows);
  }

  const RowContext& context_;
  std::vector<int> own_;  // indices of the camera's unknowns: the columns of J_
  MatrixXd D_;            // rows of the directions
  size_t camera_;
  internal::UnknownLayout layout_;
  std::vector<Eigen::Index> column_;  // of J_, per unknown
  RowMatrix J_, E_, J_marker_;        // of the view
  VectorXd residuals_;
  MatrixXd B_;
  std::vector<Span> spans_;
};

// Sums over the rows of one frame after the other: a visitor of rows. Calls `use` with the sums of
// each frame that has a pose, this eliminated, and with the unknowns that they depend on: rows of
// others are zero. With `markers`, adds the frame's rows to the sums of each marker. REQUIRES: no
// jitter, when `markers` are given.
class FrameScores {
 public:
  using Use = std::function<void(const std::vector<int>& touched, const PoseSums& sums)>;

  FrameScores(const RowContext& context, Use use, std::vector<MarkerSums>* markers)
      : context_(context), use_(std::move(use)), markers_(markers) {
    for (size_t c = 0; c < context.bundle.cameras.size(); ++c) rows_.emplace_back(context_, c);
  }

  void Marker(const internal::VisitedView& view, const internal::MarkerRows& rows) {
    if (view.camera != camera_ || !in_view_) rows_[view.camera].Clear();
    camera_ = view.camera;
    in_view_ = true;
    rows_[camera_].Add(rows);
  }

  void EndView(const internal::VisitedView& view) {
    const Bundle& bundle = context_.bundle;
    const Eigen::Index markers = context_.marker_D.rows();
    if (cameras_.empty()) {
      sums_ = PoseSums(context_.D.rows(), context_.D.cols());
      of_markers_ = MatrixXd::Zero(markers, sums_.J_B.cols());
    }
    cameras_.push_back(view.camera);
    in_view_ = false;
    PoseSums sums = rows_[view.camera].SumView();
    if (bundle.EstimatesJitter()) {
      // The charts of pose and jitter differ by rotations of the size of the jitter.
      const Matrix6d W = JitterWeight(bundle, view.frame, view.camera);
      sums.EliminateJitter(W.transpose() * W,
                           bundle.jitter.delta[bundle.View(view.frame, view.camera)]);
    }
    const std::vector<int>& own = rows_[view.camera].Own();
    sums_.J_B(own, Eigen::all) += sums.J_B.topRows(static_cast<Eigen::Index>(own.size()));
    of_markers_ += sums.J_B.bottomRows(markers);
    sums_.E_B += sums.E_B;
    touched_.insert(touched_.end(), own.begin(), own.end());
  }

  void EndFrame(size_t /*frame*/) {
    if (of_markers_.rows() > 0) {
      sums_.J_B.noalias() -= context_.uncertainty.marker_gain.transpose() * of_markers_;
      touched_.resize(static_cast<size_t>(context_.D.rows()));
      std::iota(touched_.begin(), touched_.end(), 0);
    }
    std::ranges::sort(touched_);
    // Not std::ranges::unique: Clang 14, which the fuzzer needs, has none with GCC's library.
    touched_.erase(std::unique(touched_.begin(), touched_.end()), touched_.end());
    if (const std::optional<MatrixXd> pose_D = sums_.EliminatePose()) {
      use_(touched_, sums_);
      for (const size_t c : cameras_) {
        if (markers_ != nullptr) rows_[c].AddToMarkers(*pose_D, markers_);
      }
    }
    cameras_.clear();
    touched_.clear();
  }

 private:
  const RowContext& context_;
  Use use_;
  std::vector<MarkerSums>* markers_;
  std::vector<CameraRows> rows_;
  size_t camera_ = 0;
  bool in_view_ = false;
  std::vector<size_t> cameras_;  // of the present frame
  std::vector<int> touched_;
  PoseSums sums_{0, 0};
  MatrixXd of_markers_;
};

// Directions in a space of `unknowns` dimensions: all, or combinations with signs drawn at random.
MatrixXd Directions(Eigen::Index unknowns) {
  if (unknowns <= kMostDirections) return MatrixXd::Identity(unknowns, unknowns);
  std::minstd_rand random;
  MatrixXd signs(unknowns, kMostDirections);
  for (double& sign : signs.reshaped()) sign = random() > random.max() / 2 ? 1 : -1;
  return signs;
}

// Directions in each camera's unknowns, in which these have unit covariance: columns [first[c],
// first[c + 1]) in all unknowns. A step of all unknowns by C g is one of D' g there.
struct CameraDirections {
  MatrixXd D;
  std::vector<Eigen::Index> first{0};
  std::vector<bool> at_random;  // per camera: combinations of the unknowns in place of all

  CameraDirections(const Bundle& bundle, const Uncertainty& uncertainty)
      : D(uncertainty.covariance.rows(), 0) {
    const MatrixXd& C = uncertainty.covariance;
    for (size_t c = 0; c < bundle.cameras.size(); ++c) {
      const std::vector<int> indices = IndicesOf(uncertainty, c);
      const MatrixXd root = InverseRoot(C(indices, indices));
      const MatrixXd directions = root * Directions(root.cols());
      D.conservativeResize(C.rows(), D.cols() + directions.cols());
      D.rightCols(directions.cols()) = C(Eigen::all, indices) * directions;
      first.push_back(D.cols());
      at_random.push_back(directions.cols() < root.cols());
    }
  }
  [[nodiscard]] auto Of(size_t camera) const {
    return Eigen::seq(first[camera], first[camera + 1] - 1);
  }
  // S' B^2 S of `own` = S' B S, an information B in the camera's unknowns with unit covariance. For
  // random signs S only the products of different columns are an unbiased estimate of it.
  [[nodiscard]] MatrixXd Square(size_t camera, MatrixXd own) const {
    if (!at_random[camera]) return own * own;
    own.diagonal().setZero();
    return own * own / static_cast<double>(own.cols() - 1);
  }
};

// Squares of the scores of clusters of rows, with what independent noise makes of them.
struct FoundScatter {
  double squares = 0, expected = 0, expected2 = 0;

  void Add(double square, const MatrixXd& spread) {
    squares += square;
    expected += spread.trace();
    expected2 += spread.squaredNorm();
  }
  [[nodiscard]] Scatter Result() const {
    if (!(expected > 0) || !(expected2 > 0)) return {};
    return {squares / expected, expected * expected / expected2};
  }
};

}  // namespace

SystematicScatter EstimateScatter(const Bundle& bundle, const Uncertainty& uncertainty) {
  const CameraDirections directions(bundle, uncertainty);
  const MatrixXd& D = directions.D;
  // Step from the optimum to that of the frames alone, without priors.
  const MatrixXd frames_root = InverseRoot(uncertainty.frames_information);
  const VectorXd by_priors = frames_root * (frames_root.transpose() * uncertainty.frames_gradient);
  std::vector<FoundScatter> of_frames(bundle.cameras.size()), of_markers(bundle.cameras.size());
  std::vector<MarkerSums> markers;
  if (!bundle.EstimatesJitter() && !bundle.HasLandmarks()) {
    MarkerSums none{VectorXd::Zero(D.cols()), {}};
    for (size_t c = 0; c < bundle.cameras.size(); ++c) {
      const Eigen::Index own = directions.first[c + 1] - directions.first[c];
      none.information.emplace_back(MatrixXd::Zero(own, own));
    }
    markers.assign(bundle.markers.size(), none);
  }
  const auto add_frame = [&](const std::vector<int>& touched, const PoseSums& sums) {
    // Information and gradient of the frame in the directions.
    const MatrixXd V_D = sums.Information()(touched, Eigen::all);
    const VectorXd D_g = D.transpose() * sums.Gradient();
    // Step of the unknowns by this frame, and its variance by the noise of its points. The optimum
    // has taken a part of it: the frame's share of the information of all frames.
    const VectorXd moved = D_g - V_D.transpose() * by_priors(touched);
    const MatrixXd own_root = frames_root(touched, Eigen::all).transpose() * V_D;
    for (size_t c = 0; c < of_frames.size(); ++c) {
      const auto of_camera = directions.Of(c);
      const auto own = own_root(Eigen::all, of_camera);
      of_frames[c].Add(
          moved(of_camera).squaredNorm(),
          D(touched, of_camera).transpose() * V_D(Eigen::all, of_camera) - own.transpose() * own);
    }
  };
  RowContext context{.bundle = bundle, .uncertainty = uncertainty, .D = D};
  if (uncertainty.marker_gain.size() > 0) context.marker_D = uncertainty.marker_gain * D;
  internal::RowWalk(bundle, {}, {.params = true, .extrinsics = true, .pose = true, .marker = true})
      .Visit(FrameScores(context, add_frame, markers.empty() ? nullptr : &markers));
  for (const MarkerSums& marker : markers) {
    for (size_t c = 0; c < of_markers.size(); ++c) {
      const auto of_camera = directions.Of(c);
      const MatrixXd own = marker.information[c].selfadjointView<Eigen::Lower>();
      of_markers[c].Add(marker.score(of_camera).squaredNorm(), own - directions.Square(c, own));
    }
  }
  SystematicScatter scatter;
  for (const FoundScatter& found : of_frames) scatter.of_frames.push_back(found.Result());
  for (const FoundScatter& found : of_markers) scatter.of_markers.push_back(found.Result());
  return scatter;
}

void ScaleByScatter(const std::vector<double>& factors, Uncertainty* uncertainty) {
  MatrixXd& C = uncertainty->covariance;
  VectorXd scale = VectorXd::Ones(C.rows());  // of each unknown's variance
  for (size_t c = 0; c < factors.size(); ++c) {
    for (const int index : IndicesOf(*uncertainty, c)) {
      scale[index] = std::max(scale[index], factors[c]);
    }
  }
  const VectorXd root = scale.cwiseSqrt(), before = C.diagonal();
  C = root.asDiagonal() * C * root.asDiagonal();
  for (size_t c = 0; c < factors.size(); ++c) {
    for (size_t k = 0; k < uncertainty->param_std_errors[c].size(); ++k) {
      const int index = uncertainty->param_index[c][k];
      if (index < 0 || !(before[index] > 0)) continue;
      uncertainty->param_std_errors[c][k] *= std::sqrt(C(index, index) / before[index]);
    }
    const int first = uncertainty->extrinsics_index[c];
    // An unknown without any information stays infinite.
    for (int i = 0; first >= 0 && i < 6; ++i) {
      for (int j = 0; j < 6; ++j) {
        double& entry = uncertainty->extrinsics_covariance[c](i, j);
        if (std::isfinite(entry)) entry = C(first + i, first + j);
      }
    }
  }
  const VectorXd sigma = C.diagonal().cwiseMax(1e-300).cwiseSqrt();
  uncertainty->correlation =
      sigma.cwiseInverse().asDiagonal() * C * sigma.cwiseInverse().asDiagonal();
}

}  // namespace plenocal
