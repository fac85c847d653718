// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/common_errors.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <vector>

#include "calib/adjust/linearise.h"
#include "calib/base/linear_algebra.h"
#include "calib/noise/matrix_root.h"

namespace plenocal {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Of a model with very many unknowns so many of their combinations are looked at in place of all.
constexpr Eigen::Index kMostDirections = 32;

using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// ViewSums over rows that share a pose, with their products with B = [basis, 6 columns of the pose,
// residual, its change with each error that observations share]: J' B by the unknowns (markers at
// their best), whose first part is the information J' J times a basis, and E' B by the pose.
struct ViewSums {
  Eigen::Index basis;
  MatrixXd J_B, E_B;

  ViewSums(Eigen::Index unknowns, Eigen::Index basis_columns, Eigen::Index residuals)
      : basis(basis_columns),
        J_B(MatrixXd::Zero(unknowns, basis + 6 + residuals)),
        E_B(MatrixXd::Zero(6, J_B.cols())) {}

  [[nodiscard]] auto Information() const { return J_B.leftCols(basis); }
  [[nodiscard]] auto Cross() const { return J_B.middleCols<6>(basis); }
  [[nodiscard]] auto Gradient() const { return J_B.rightCols(J_B.cols() - basis - 6); }
  [[nodiscard]] Matrix6d PoseInformation() const { return E_B.middleCols<6>(basis); }

  ViewSums& operator+=(const ViewSums& other) {
    J_B += other.J_B;
    E_B += other.E_B;
    return *this;
  }
  // Eliminates the pose; false for one without information.
  bool EliminatePose() {
    const std::optional<MatrixXd> solved = SolvePositive(PoseInformation(), E_B);
    if (!solved) return false;
    Subtract(*solved);
    return true;
  }
  // Leaves the pose to the frame's other views, but for what is the view's own jitter `delta` with
  // the prior information Q.
  void EliminateJitter(const Matrix6d& Q, const Vector6d& delta) {
    MatrixXd right = E_B;
    right.col(basis + 6) += Q * delta;
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

// Derivatives of one camera's rows by all unknowns, view by view.
class Rows {
 public:
  // The camera's shared errors are columns [first, first + count) of all residuals.
  Rows(const Bundle& bundle,
       const Uncertainty& uncertainty,
       size_t camera,
       Eigen::Index first,
       Eigen::Index count,
       Eigen::Index residuals)
      : bundle_(bundle),
        camera_(bundle.cameras[camera]),
        params_(uncertainty.param_index[camera]),
        extrinsics_(uncertainty.extrinsics_index[camera]),
        gain_(uncertainty.marker_gain),
        dimension_(static_cast<Eigen::Index>(camera_.model->measured.size())),
        J_params_(camera_.model->measured.size() * camera_.params.size()),
        J_(0, uncertainty.covariance.rows()),
        E_(0, 6),
        residuals_(0, residuals),
        first_(first),
        count_(count) {}

  // Of the observations [begin, end) of one view; the basis is the identity without `basis`.
  void AddView(const internal::LinearisedView& view,
               size_t begin,
               size_t end,
               const MatrixXd* basis,
               ViewSums* sums) {
    const bool has_common = camera_.noise.common_sigma > 0;
    const auto most = static_cast<Eigen::Index>(end - begin) * dimension_ * (has_common ? 2 : 1);
    if (most > J_.rows()) {
      J_.resize(most, J_.cols());
      E_.resize(most, 6);
      residuals_.resize(most, residuals_.cols());
      weight_.resize(most);
    }
    used_ = 0;
    for (size_t of_marker = begin; begin < end; begin = of_marker) {
      of_marker = EndOfMarker(bundle_.observations, begin);
      AddMarker(view, begin, of_marker);
    }
    const auto J = J_.topRows(used_), E = E_.topRows(used_);
    MatrixXd B(used_, sums->J_B.cols());
    if (basis != nullptr) {
      B.leftCols(sums->basis).noalias() = J * *basis;
    } else {
      B.leftCols(sums->basis) = J;
    }
    B.middleCols<6>(sums->basis) = E;
    B.rightCols(residuals_.cols()) = residuals_.topRows(used_);
    if (has_common) B = weight_.head(used_).asDiagonal() * B;
    sums->J_B.noalias() += J.transpose() * B;
    sums->E_B.noalias() += E.transpose() * B;
  }

 private:
  // Rows of one marker in one view; where they have common noise, their sum with a negative weight.
  void AddMarker(const internal::LinearisedView& view, size_t begin, size_t end) {
    const Eigen::Index first_row = used_;
    double information = 0;
    std::vector<double> own_sigmas;
    for (size_t i = begin; i < end; ++i) {
      const BundleObservation& observation = bundle_.observations[i];
      if (!observation.used || !Linearise(view, observation)) continue;
      const double own = camera_.noise.OwnSigma(observation.assumed_sigma);
      auto shared = residuals_.block(used_, first_, dimension_, count_);
      if (observation.shared_errors.empty()) {
        shared.setZero();
      } else {
        shared =
            Eigen::Map<const RowMatrix>(observation.shared_errors.data(), dimension_, count_) / own;
      }
      weight_.segment(used_, dimension_).setOnes();
      used_ += dimension_;
      if (camera_.noise.common_sigma == 0) continue;
      information += 1 / (own * own);
      own_sigmas.push_back(own);
    }
    if (own_sigmas.empty()) return;
    const auto sum = [&](auto& rows) {
      auto target = rows.middleRows(used_, dimension_);
      target.setZero();
      Eigen::Index row = first_row;
      for (const double own : own_sigmas) {
        target += rows.middleRows(row, dimension_) / own;
        row += dimension_;
      }
    };
    sum(J_);
    sum(E_);
    sum(residuals_);
    weight_.segment(used_, dimension_)
        .setConstant(-internal::CommonShare(camera_.noise.common_sigma, information));
    used_ += dimension_;
  }

  // Writes the next rows.
  bool Linearise(const internal::LinearisedView& view, const BundleObservation& observation) {
    Eigen::Matrix<double, kMaxObservationSize, 6, Eigen::RowMajor> J_extrinsics;
    Eigen::Matrix<double, kMaxObservationSize, 3, Eigen::RowMajor> J_marker;
    double residual[kMaxObservationSize];
    const bool inside =
        internal::Linearise(camera_,
                            camera_.params.data(),
                            view,
                            bundle_.markers[static_cast<size_t>(observation.marker)].position,
                            observation,
                            {.residual = residual,
                             .J_params = J_params_.data(),
                             .J_extrinsics = extrinsics_ >= 0 ? J_extrinsics.data() : nullptr,
                             .J_pose = E_.row(used_).data(),
                             .J_marker = J_marker.data()});
    if (!inside) return false;
    auto J = J_.middleRows(used_, dimension_);
    auto residuals = residuals_.middleRows(used_, dimension_);
    residuals.setZero();
    residuals.col(0) = Eigen::Map<const VectorXd>(residual, dimension_);
    if (gain_.size() > 0) {
      J.noalias() =
          -J_marker.topRows(dimension_).lazyProduct(gain_.middleRows<3>(3 * observation.marker));
    } else {
      J.setZero();
    }
    for (size_t k = 0; k < params_.size(); ++k) {
      for (Eigen::Index r = 0; r < dimension_ && params_[k] >= 0; ++r) {
        J(r, params_[k]) += J_params_[static_cast<size_t>(r) * params_.size() + k];
      }
    }
    if (extrinsics_ >= 0) J.middleCols<6>(extrinsics_) += J_extrinsics.topRows(dimension_);
    return true;
  }

  const Bundle& bundle_;
  const BundleCamera& camera_;
  const std::vector<int>& params_;
  int extrinsics_;
  const MatrixXd& gain_;
  Eigen::Index dimension_;
  std::vector<double> J_params_;
  RowMatrix J_, E_, residuals_;  // `used_` rows count
  VectorXd weight_;
  Eigen::Index used_ = 0, first_, count_;
};

// Information and gradient of one frame, its pose eliminated, in directions D: V D and D' g, with
// the information V on all unknowns and the gradient g of half the sum of squares.
struct Score {
  MatrixXd V_D;
  VectorXd D_g;
};

struct Scores {
  std::vector<Score> frames;  // those with used observations
  MatrixXd gradient;  // of all, and a column of its change with each error that points share
};

Scores FrameScores(const Bundle& bundle, const Uncertainty& uncertainty, const MatrixXd& D) {
  const Eigen::Index unknowns = uncertainty.covariance.rows();
  const bool has_jitter = bundle.EstimatesJitter();
  std::vector<Eigen::Index> errors(bundle.cameras.size(), 0);  // shared by each camera's points
  for (const BundleObservation& observation : bundle.observations) {
    const auto c = static_cast<size_t>(observation.camera);
    errors[c] = std::max(errors[c],
                         static_cast<Eigen::Index>(observation.shared_errors.size() /
                                                   bundle.cameras[c].model->measured.size()));
  }
  const Eigen::Index residuals = std::accumulate(errors.begin(), errors.end(), Eigen::Index{1});
  std::vector<Rows> rows;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const auto end_of_others = errors.begin() + static_cast<std::ptrdiff_t>(c);
    const Eigen::Index first = std::accumulate(errors.begin(), end_of_others, Eigen::Index{1});
    rows.emplace_back(bundle, uncertainty, c, first, errors[c], residuals);
  }
  // The cheaper order of J' J D.
  const MatrixXd* const basis = D.cols() < unknowns ? &D : nullptr;
  const Eigen::Index basis_columns = std::min(D.cols(), unknowns);
  Scores scores{{}, MatrixXd::Zero(unknowns, residuals)};
  const auto& observations = bundle.observations;
  for (size_t begin = 0, end = 0; begin < observations.size();) {
    const auto frame = static_cast<size_t>(observations[begin].frame);
    ViewSums sums(unknowns, basis_columns, residuals);
    for (; begin < observations.size() && observations[begin].frame == static_cast<int>(frame);
         begin = end) {
      const auto c = static_cast<size_t>(observations[begin].camera);
      end = EndOfView(observations, begin);
      const internal::LinearisedView seen{.T_camera_rig = bundle.cameras[c].T_camera_rig,
                                          .T_rig_target = bundle.SeenPose(frame, c)};
      if (!has_jitter) {
        rows[c].AddView(seen, begin, end, basis, &sums);
        continue;
      }
      ViewSums view(unknowns, basis_columns, residuals);
      rows[c].AddView(seen, begin, end, basis, &view);
      const Matrix6d W = JitterWeight(bundle, frame, c);
      view.EliminateJitter(W.transpose() * W, bundle.jitter.delta[bundle.View(frame, c)]);
      sums += view;
    }
    if (!sums.EliminatePose()) continue;
    scores.gradient += sums.Gradient();
    scores.frames.push_back(
        {basis != nullptr ? MatrixXd(sums.Information()) : MatrixXd(sums.Information() * D),
         D.transpose() * sums.Gradient().col(0)});
  }
  return scores;
}

// Directions in a space of `unknowns` dimensions: all, or combinations with signs drawn at random.
MatrixXd Directions(Eigen::Index unknowns) {
  if (unknowns <= kMostDirections) return MatrixXd::Identity(unknowns, unknowns);
  std::minstd_rand random;
  MatrixXd signs(unknowns, kMostDirections);
  for (double& sign : signs.reshaped()) sign = random() > random.max() / 2 ? 1 : -1;
  return signs;
}

// Indices of one camera's unknowns.
std::vector<int> IndicesOf(const Uncertainty& uncertainty, size_t camera) {
  std::vector<int> indices;
  for (const int index : uncertainty.param_index[camera]) {
    if (index >= 0) indices.push_back(index);
  }
  std::sort(indices.begin(), indices.end());
  indices.erase(std::unique(indices.begin(), indices.end()), indices.end());
  for (int i = 0; i < 6 && uncertainty.extrinsics_index[camera] >= 0; ++i) {
    indices.push_back(uncertainty.extrinsics_index[camera] + i);
  }
  return indices;
}

}  // namespace

CommonErrors EstimateCommonErrors(const Bundle& bundle, const Uncertainty& uncertainty) {
  const MatrixXd& C = uncertainty.covariance;
  // Directions in each camera's unknowns, in which these have unit covariance; and what they are of
  // the score: a step of all unknowns by C g is one of D' g there.
  std::vector<Eigen::Index> first{0};
  MatrixXd D(C.rows(), 0);
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const std::vector<int> indices = IndicesOf(uncertainty, c);
    const MatrixXd root = InverseRoot(C(indices, indices));
    const MatrixXd directions = root * Directions(root.cols());
    D.conservativeResize(C.rows(), D.cols() + directions.cols());
    D.rightCols(directions.cols()) = C(Eigen::all, indices) * directions;
    first.push_back(D.cols());
  }
  const Scores scores = FrameScores(bundle, uncertainty, D);
  // Change of the unknowns by each shared error.
  const MatrixXd by_shared = C * scores.gradient.rightCols(scores.gradient.cols() - 1);
  CommonErrors errors{std::vector<FrameScatter>(bundle.cameras.size()),
                      by_shared * by_shared.transpose()};
  // Step from the optimum to that of the frames alone, without priors.
  const MatrixXd frames_root = InverseRoot(uncertainty.frames_information);
  const VectorXd by_priors = frames_root * (frames_root.transpose() * scores.gradient.col(0));
  struct Found {
    double squares = 0, expected = 0, expected2 = 0;
  };
  std::vector<Found> found(bundle.cameras.size());
  for (const auto& [V_D, D_g] : scores.frames) {
    // Step of the unknowns by this frame, and its variance by the noise of its points. The optimum
    // has taken a part of it: the frame's own share of what all frames know.
    const VectorXd moved = D_g - V_D.transpose() * by_priors;
    const MatrixXd own_root = frames_root.transpose() * V_D;
    for (size_t c = 0; c < found.size(); ++c) {
      const auto of_camera = Eigen::seq(first[c], first[c + 1] - 1);
      const auto own = own_root(Eigen::all, of_camera);
      const MatrixXd spread =
          D(Eigen::all, of_camera).transpose() * V_D(Eigen::all, of_camera) - own.transpose() * own;
      found[c].squares += moved(of_camera).squaredNorm();
      found[c].expected += spread.trace();
      found[c].expected2 += spread.squaredNorm();
    }
  }
  for (size_t c = 0; c < found.size(); ++c) {
    const auto& [squares, expected, expected2] = found[c];
    if (!(expected > 0) || !(expected2 > 0)) continue;
    errors.scatter[c] = {squares / expected, expected * expected / expected2};
  }
  return errors;
}

void AddCommonErrors(const std::vector<double>& factors,
                     const MatrixXd& shared,
                     Uncertainty* uncertainty) {
  MatrixXd& C = uncertainty->covariance;
  VectorXd scale = VectorXd::Ones(C.rows());  // of each unknown's variance
  for (size_t c = 0; c < factors.size(); ++c) {
    for (const int index : IndicesOf(*uncertainty, c)) {
      scale[index] = std::max(scale[index], factors[c]);
    }
  }
  const VectorXd root = scale.cwiseSqrt(), before = C.diagonal();
  C = root.asDiagonal() * C * root.asDiagonal();
  if (shared.size() > 0) C += shared;
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
