// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/frame_scatter.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <random>
#include <type_traits>
#include <utility>
#include <vector>

#include "calib/adjust/rows.h"
#include "calib/base/linear_algebra.h"
#include "calib/kernels/row_products.h"
#include "calib/noise/matrix_root.h"

namespace plenocal {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Number of combinations of unknowns that are looked at where a model has very many.
constexpr Eigen::Index kMostDirections = 32;

// Indices of one camera's unknowns and of the poses of targets, which all cameras share.
std::vector<int> IndicesOf(const Uncertainty& uncertainty, size_t camera) {
  return internal::UnknownsOf({.params = uncertainty.param_index,
                               .extrinsics = uncertainty.extrinsics_index,
                               .targets = uncertainty.target_index},
                              camera);
}

// Sums over the rows of one marker in all frames, of the derivatives b by the directions with poses
// and markers at their best: b' residual and, of each camera's directions, the lower triangle of
// b' b.
struct MarkerSums {
  VectorXd score;
  std::vector<MatrixXd> information;
};

// Sums over the rows of one frame after the other: a visitor of rows. Calls use(V_D, g) for each
// frame that has a pose, with its information V on the unknowns before the markers (times the
// directions D) and half the gradient of its squares, pose and markers at their best. With
// `markers`, adds the frame's rows to the sums of each marker. REQUIRES: no jitter, when `markers`
// are given.
class FrameScores {
 public:
  using Use = std::function<void(const MatrixXd& V_D, const VectorXd& gradient)>;

  FrameScores(const Bundle& bundle,
              const Uncertainty& uncertainty,
              const MatrixXd& D,
              Use use,
              std::vector<MarkerSums>* markers)
      : bundle_(bundle),
        layout_(internal::MakeLayout(bundle)),
        gain_(uncertainty.marker_gain),
        use_(std::move(use)),
        markers_(markers),
        directions_(D.cols()),
        D_(layout_.total, directions_),
        B_(0, directions_ + 7),
        frame_(layout_.total, directions_ + 7),
        view_(frame_) {
    D_.topRows(layout_.head) = D;
    if (layout_.markers) D_.bottomRows(layout_.Markers()) = -gain_ * D;
  }

  void Marker(const internal::VisitedView& view, const internal::MarkerRows& rows) {
    const Eigen::Index first = std::ssize(marker_of_row_), count = rows.Count();
    marker_of_row_.resize(static_cast<size_t>(first + count), static_cast<size_t>(rows.Marker()));
    if (B_.rows() < first + count) B_.conservativeResize(2 * (first + count), Eigen::NoChange);
    auto B = B_.middleRows(first, count);
    auto along = B.leftCols(directions_);
    along.setZero();
    const auto for_each_derivative = [&](const auto& add) {
      internal::ForEachDerivative(
          bundle_, layout_, view.camera, rows, [&](int unknown, const auto& J) {
            if (!J.isZero(0)) add(unknown, J);  // of local models nearly all are zero
          });
    };
    for_each_derivative([&](int unknown, const auto& J) {
      along += J.lazyProduct(D_.middleRows<std::decay_t<decltype(J)>::ColsAtCompileTime>(unknown));
    });
    B.middleCols<6>(directions_) = rows.Pose();
    B.rightCols<1>() = rows.Residual();
    Sums& sums = bundle_.EstimatesJitter() ? view_ : frame_;
    for_each_derivative([&](int unknown, const auto& J) {
      sums.J_B.middleRows(unknown, J.cols()) += J.transpose().lazyProduct(B);
    });
    sums.E_B += rows.Pose().transpose().lazyProduct(B);
  }

  // Eliminates the view's jitter; what is left of its rows is of the frame's pose.
  void EndView(const internal::VisitedView& view) {
    if (!bundle_.EstimatesJitter()) return;
    // The charts of pose and jitter differ by rotations of the size of the jitter.
    const Matrix6d W = JitterWeight(bundle_, view.frame, view.camera), Q = W.transpose() * W;
    const Matrix6d information = view_.E_B.middleCols<6>(directions_);
    MatrixXd right = view_.E_B;
    right.rightCols<1>() += Q * bundle_.jitter.delta[bundle_.View(view.frame, view.camera)];
    const MatrixXd solved = Matrix6d(information + Q).llt().solve(right);
    frame_.J_B += view_.J_B - view_.J_B.middleCols<6>(directions_) * solved;
    frame_.E_B += view_.E_B - information * solved;
    view_.SetZero();
  }

  void EndFrame(size_t /*frame*/) {
    MatrixXd J_B = frame_.J_B.topRows(layout_.head);
    if (layout_.markers) {
      J_B.noalias() -= gain_.transpose() * frame_.J_B.bottomRows(layout_.Markers());
    }
    const Matrix6d information = frame_.E_B.middleCols<6>(directions_);
    if (const std::optional<MatrixXd> pose_D = SolvePositive(information, frame_.E_B)) {
      const MatrixXd cross = J_B.middleCols<6>(directions_);
      J_B.noalias() -= cross * *pose_D;
      use_(J_B.leftCols(directions_), J_B.rightCols<1>());
      if (markers_ != nullptr) AddToMarkers(*pose_D);
    }
    frame_.SetZero();
    marker_of_row_.clear();
  }

 private:
  // Sums of products of rows with B = [J D, E, residual]: J by all unknowns, E by the pose that the
  // camera saw.
  struct Sums {
    RowMajorMatrix J_B;
    MatrixXd E_B;

    Sums(Eigen::Index unknowns, Eigen::Index columns)
        : J_B(RowMajorMatrix::Zero(unknowns, columns)), E_B(MatrixXd::Zero(6, columns)) {}
    void SetZero() {
      J_B.setZero();
      E_B.setZero();
    }
  };

  // The first columns of `pose_D`: the negative change of the best pose with each direction.
  void AddToMarkers(const MatrixXd& pose_D) {
    const auto B = B_.topRows(std::ssize(marker_of_row_));
    // By columns: one row's numbers follow each other.
    const MatrixXd b =
        (B.leftCols(directions_) - B.middleCols<6>(directions_) * pose_D.leftCols(directions_))
            .transpose();
    for (Eigen::Index row = 0; row < B.rows(); ++row) {
      MarkerSums& sums = (*markers_)[marker_of_row_[static_cast<size_t>(row)]];
      sums.score += B(row, directions_ + 6) * b.col(row);
      Eigen::Index first = 0;
      for (MatrixXd& information : sums.information) {
        const auto own = b.col(row).segment(first, information.rows());
        information.selfadjointView<Eigen::Lower>().rankUpdate(own);
        first += own.size();
      }
    }
  }

  const Bundle& bundle_;
  internal::UnknownLayout layout_;
  const MatrixXd& gain_;
  Use use_;
  std::vector<MarkerSums>* markers_;
  Eigen::Index directions_;
  RowMajorMatrix D_;                   // in all unknowns, the markers at their best
  RowMajorMatrix B_;                   // of the frame's rows
  std::vector<size_t> marker_of_row_;  // of those
  Sums frame_, view_;                  // `view_` where there is jitter
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
  const auto add_frame = [&](const MatrixXd& V_D, const VectorXd& gradient) {
    // Step of the unknowns by this frame, and its variance by the noise of its points, less the
    // part that the optimum contains: the frame's share of the information of all frames.
    const VectorXd moved = D.transpose() * gradient - V_D.transpose() * by_priors;
    const MatrixXd own_root = frames_root.transpose() * V_D;
    for (size_t c = 0; c < of_frames.size(); ++c) {
      const auto of_camera = directions.Of(c);
      const auto own = own_root(Eigen::all, of_camera);
      of_frames[c].Add(moved(of_camera).squaredNorm(),
                       D(Eigen::all, of_camera).transpose() * V_D(Eigen::all, of_camera) -
                           own.transpose() * own);
    }
  };
  FrameScores scores(bundle, uncertainty, D, add_frame, markers.empty() ? nullptr : &markers);
  internal::RowWalk(bundle, {}, {.params = true, .extrinsics = true, .pose = true, .marker = true})
      .Visit(scores);
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
  VectorXd scale = VectorXd::Ones(uncertainty->covariance.rows());  // of each unknown's variance
  for (size_t c = 0; c < factors.size(); ++c) {
    for (const int index : IndicesOf(*uncertainty, c)) {
      scale[index] = std::max(scale[index], factors[c]);
    }
  }
  const VectorXd root = scale.cwiseSqrt();
  SetCovariance(root.asDiagonal() * uncertainty->covariance * root.asDiagonal(), uncertainty);
}

}  // namespace plenocal
