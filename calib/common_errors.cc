// SPDX-License-Identifier: Apache-2.0
#include "calib/common_errors.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace plenocal {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Gradient of half the sum of squares by all cameras' unknowns, its change with each error that
// observations share, and its covariance by noise: of one frame, markers at their best for the
// unknowns, poses eliminated.
struct Score {
  MatrixXd gradient;  // a first column, and one each shared error
  MatrixXd covariance;

  Score(Eigen::Index unknowns, Eigen::Index columns)
      : gradient(MatrixXd::Zero(unknowns, columns)),
        covariance(MatrixXd::Zero(unknowns, unknowns)) {}
};

// Sums over observations that share a pose: information and gradient of the pose, mixed with the
// unknowns.
struct PoseSums {
  Matrix6d information = Matrix6d::Zero();
  MatrixXd gradient;  // 6 x columns
  MatrixXd cross;     // unknowns x 6

  explicit PoseSums(const Score& score)
      : gradient(MatrixXd::Zero(6, score.gradient.cols())),
        cross(MatrixXd::Zero(score.gradient.rows(), 6)) {}
  // Takes out the pose (or jitter), whose information has the given factor.
  void Eliminate(const Eigen::LLT<Matrix6d>& factor, Score* score) const {
    score->gradient -= cross * factor.solve(gradient);
    score->covariance -= cross * factor.solve(cross.transpose());
  }
};

// Derivatives of one camera's rows by all unknowns.
class Rows {
 public:
  // The camera's shared errors are columns [first, first + count) of all.
  Rows(const Bundle& bundle,
       const Uncertainty& uncertainty,
       size_t camera,
       Eigen::Index first,
       Eigen::Index count,
       Eigen::Index columns)
      : camera_(bundle.cameras[camera]),
        places_(uncertainty.places[camera]),
        mount_(uncertainty.mount_places[camera]),
        gain_(uncertainty.marker_gain),
        J_params_(camera_.model->measured.size() * camera_.params.size()),
        J_(static_cast<Eigen::Index>(camera_.model->measured.size()),
           uncertainty.covariance.rows()),
        J_sum_(J_),
        first_(first),
        count_(count),
        residual_(MatrixXd::Zero(J_.rows(), columns)),
        residual_sum_(residual_) {
    J_pose_.setZero();
  }

  // The observations [begin, end), of one marker in one view.
  void Add(const internal::LinearisedView& view,
           const Bundle& bundle,
           size_t begin,
           size_t end,
           Score* score,
           PoseSums* pose) {
    double information = 0;
    J_sum_.setZero();
    pose_sum_.setZero();
    residual_sum_.setZero();
    for (size_t i = begin; i < end; ++i) {
      const BundleObservation& observation = bundle.observations[i];
      if (!observation.used || !Linearise(view, bundle, observation)) continue;
      const double own = OwnNoiseSigma(camera_, observation.seen);
      if (observation.shared_errors.empty()) {
        residual_.middleCols(first_, count_).setZero();
      } else {
        residual_.middleCols(first_, count_) =
            Eigen::Map<
                const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
                observation.shared_errors.data(), residual_.rows(), count_) /
            own;
      }
      Accumulate(1, score, pose);
      information += 1 / (own * own);
      J_sum_ += J_ / own;
      pose_sum_ += J_pose_ / own;
      residual_sum_ += residual_ / own;
    }
    if (camera_.common_noise == 0) return;
    J_ = J_sum_;
    J_pose_ = pose_sum_;
    residual_ = residual_sum_;
    Accumulate(-internal::CommonShare(camera_.common_noise, information), score, pose);
  }

 private:
  bool Linearise(const internal::LinearisedView& view,
                 const Bundle& bundle,
                 const BundleObservation& observation) {
    Eigen::Matrix<double, kMaxObservationSize, 6, Eigen::RowMajor> J_mount;
    Eigen::Matrix<double, kMaxObservationSize, 3, Eigen::RowMajor> J_marker;
    double residual[kMaxObservationSize];
    const bool inside =
        internal::Linearise(camera_,
                            camera_.params.data(),
                            view,
                            bundle.markers[static_cast<size_t>(observation.marker)].position,
                            observation.seen,
                            {.residual = residual,
                             .J_params = J_params_.data(),
                             .J_mount = mount_ >= 0 ? J_mount.data() : nullptr,
                             .J_pose = J_pose_.data(),
                             .J_marker = J_marker.data()});
    if (!inside) return false;
    const Eigen::Index rows = J_.rows();
    residual_.col(0) = Eigen::Map<const VectorXd>(residual, rows);
    J_.setZero();
    for (size_t k = 0; k < places_.size(); ++k) {
      for (Eigen::Index r = 0; r < rows && places_[k] >= 0; ++r) {
        J_(r, places_[k]) += J_params_[static_cast<size_t>(r) * places_.size() + k];
      }
    }
    if (mount_ >= 0) J_.middleCols<6>(mount_) = J_mount.topRows(rows);
    if (gain_.size() > 0) {
      J_.noalias() -= J_marker.topRows(rows) * gain_.middleRows<3>(3 * observation.marker);
    }
    return true;
  }

  void Accumulate(double weight, Score* score, PoseSums* pose) const {
    const auto E = J_pose_.topRows(J_.rows());
    score->gradient.noalias() += weight * J_.transpose().lazyProduct(residual_);
    score->covariance.noalias() += weight * J_.transpose().lazyProduct(J_);
    pose->information.noalias() += weight * E.transpose().lazyProduct(E);
    pose->gradient.noalias() += weight * E.transpose().lazyProduct(residual_);
    pose->cross.noalias() += weight * J_.transpose().lazyProduct(E);
  }

  const BundleCamera& camera_;
  const std::vector<int>& places_;
  int mount_;
  const MatrixXd& gain_;
  std::vector<double> J_params_;
  MatrixXd J_, J_sum_;
  Eigen::Matrix<double, kMaxObservationSize, 6, Eigen::RowMajor> J_pose_, pose_sum_;
  Eigen::Index first_, count_;
  MatrixXd residual_, residual_sum_;  // a first column, and one each shared error
};

// Per frame; frames without used observations have none.
std::vector<Score> FrameScores(const Bundle& bundle, const Uncertainty& uncertainty) {
  const Eigen::Index unknowns = uncertainty.covariance.rows();
  const bool has_jitter = bundle.jitter.translation_sigma > 0;
  std::vector<Eigen::Index> errors(bundle.cameras.size(), 0);  // shared by each camera's points
  for (const BundleObservation& observation : bundle.observations) {
    const auto c = static_cast<size_t>(observation.camera);
    errors[c] = static_cast<Eigen::Index>(observation.shared_errors.size() /
                                          bundle.cameras[c].model->measured.size());
  }
  const Eigen::Index columns = std::accumulate(errors.begin(), errors.end(), Eigen::Index{1});
  std::vector<Rows> rows;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const auto place = errors.begin() + static_cast<std::ptrdiff_t>(c);
    const Eigen::Index first = std::accumulate(errors.begin(), place, Eigen::Index{1});
    rows.emplace_back(bundle, uncertainty, c, first, errors[c], columns);
  }
  std::vector<Score> scores;
  const auto& observations = bundle.observations;
  for (size_t begin = 0; begin < observations.size();) {
    const auto frame = static_cast<size_t>(observations[begin].frame);
    Score score(unknowns, columns);
    PoseSums pose(score);
    while (begin < observations.size() && observations[begin].frame == static_cast<int>(frame)) {
      const auto c = static_cast<size_t>(observations[begin].camera);
      const internal::LinearisedView seen{.T_camera_rig = bundle.cameras[c].T_camera_rig,
                                          .T_rig_target = bundle.SeenPose(frame, c)};
      PoseSums view(score);
      while (begin < observations.size() && observations[begin].frame == static_cast<int>(frame) &&
             observations[begin].camera == static_cast<int>(c)) {
        const size_t end = EndOfMarker(observations, begin);
        rows[c].Add(seen, bundle, begin, end, &score, has_jitter ? &view : &pose);
        begin = end;
      }
      if (!has_jitter) continue;
      const Matrix6d W = JitterWeight(bundle, frame, c);
      const Matrix6d Q = W.transpose() * W;
      PoseSums jitter = view;
      jitter.information += Q;
      jitter.gradient.col(0) += Q * bundle.jitter.delta[bundle.View(frame, c)];
      const Eigen::LLT<Matrix6d> factor(jitter.information);
      jitter.Eliminate(factor, &score);
      const Matrix6d passed = factor.solve(Q);
      pose.information += view.information * passed;
      pose.cross += view.cross * passed;
      pose.gradient += view.gradient - view.information * factor.solve(jitter.gradient);
    }
    const Eigen::LLT<Matrix6d> factor(pose.information);
    if (factor.info() != Eigen::Success) continue;
    pose.Eliminate(factor, &score);
    scores.push_back(std::move(score));
  }
  return scores;
}

// Inverse of a positive semidefinite matrix where it has one.
MatrixXd PseudoInverse(const MatrixXd& V) {
  constexpr double kRankTolerance = 1e-10;  // of the matrix with unit diagonal
  if (V.rows() == 0) return V;
  const VectorXd diagonal = V.diagonal();
  const VectorXd scale = (diagonal.array() > 0).select(diagonal.cwiseSqrt().cwiseInverse(), 0);
  const Eigen::SelfAdjointEigenSolver<MatrixXd> spectrum(scale.asDiagonal() * V *
                                                         scale.asDiagonal());
  const VectorXd values = spectrum.eigenvalues();
  const VectorXd inverse = (values.array() > kRankTolerance).select(values.cwiseInverse(), 0);
  const MatrixXd directions = scale.asDiagonal() * spectrum.eigenvectors();
  return directions * inverse.asDiagonal() * directions.transpose();
}

// Places of one camera's unknowns.
std::vector<int> PlacesOf(const Uncertainty& uncertainty, size_t camera) {
  std::vector<int> places;
  for (const int place : uncertainty.places[camera]) {
    if (place >= 0) places.push_back(place);
  }
  std::sort(places.begin(), places.end());
  places.erase(std::unique(places.begin(), places.end()), places.end());
  for (int i = 0; i < 6 && uncertainty.mount_places[camera] >= 0; ++i) {
    places.push_back(uncertainty.mount_places[camera] + i);
  }
  return places;
}

}  // namespace

CommonErrors EstimateCommonErrors(const Bundle& bundle, const Uncertainty& uncertainty) {
  const MatrixXd& C = uncertainty.covariance;
  struct Sums {
    double found = 0, expected = 0, expected2 = 0;
  };
  std::vector<Sums> sums(bundle.cameras.size());
  std::vector<std::vector<int>> places;
  std::vector<Eigen::LDLT<MatrixXd>> factors;
  for (size_t c = 0; c < sums.size(); ++c) {
    places.push_back(PlacesOf(uncertainty, c));
    factors.emplace_back(MatrixXd(C(places[c], places[c])));
  }
  const std::vector<Score> scores = FrameScores(bundle, uncertainty);
  if (scores.empty()) return {std::vector<FrameScatter>(sums.size()), {}};
  Score total(C.rows(), scores[0].gradient.cols());
  for (const Score& score : scores) {
    total.gradient += score.gradient;
    total.covariance += score.covariance;
  }
  // What each shared error moves the unknowns by.
  const MatrixXd by_shared = C * total.gradient.rightCols(total.gradient.cols() - 1);
  // Where the frames alone would have the unknowns: priors may hold them elsewhere.
  const MatrixXd frames_covariance = PseudoInverse(total.covariance);
  const VectorXd by_priors = frames_covariance * total.gradient.col(0);
  for (const Score& score : scores) {
    // What the frame moves the unknowns by, beside what its points' errors make of that. The
    // optimum has taken a part of it: the frame's own share of what all frames know.
    const VectorXd moved = C * (score.gradient.col(0) - score.covariance * by_priors);
    const MatrixXd own_share = score.covariance * frames_covariance * score.covariance;
    const MatrixXd spread = C * (score.covariance - own_share) * C;
    for (size_t c = 0; c < sums.size(); ++c) {
      if (places[c].empty()) continue;
      const VectorXd own = moved(places[c]);
      const MatrixXd relative = factors[c].solve(MatrixXd(spread(places[c], places[c])));
      sums[c].found += own.dot(factors[c].solve(own));
      sums[c].expected += relative.trace();
      sums[c].expected2 += (relative * relative).trace();
    }
  }
  CommonErrors errors{std::vector<FrameScatter>(sums.size()), by_shared * by_shared.transpose()};
  for (size_t c = 0; c < sums.size(); ++c) {
    const auto& [found, expected, expected2] = sums[c];
    if (!(expected > 0) || !(expected2 > 0)) continue;
    errors.scatter[c] = {found / expected, expected * expected / expected2};
  }
  return errors;
}

void AddCommonErrors(const std::vector<double>& factors,
                     const MatrixXd& shared,
                     Uncertainty* uncertainty) {
  MatrixXd& C = uncertainty->covariance;
  VectorXd scale = VectorXd::Ones(C.rows());  // of each unknown's variance
  for (size_t c = 0; c < factors.size(); ++c) {
    for (const int place : PlacesOf(*uncertainty, c)) {
      scale[place] = std::max(scale[place], factors[c]);
    }
  }
  const VectorXd root = scale.cwiseSqrt(), before = C.diagonal();
  C = root.asDiagonal() * C * root.asDiagonal();
  if (shared.size() > 0) C += shared;
  for (size_t c = 0; c < factors.size(); ++c) {
    for (size_t k = 0; k < uncertainty->params[c].size(); ++k) {
      const int place = uncertainty->places[c][k];
      if (place < 0 || !(before[place] > 0)) continue;
      uncertainty->params[c][k] *= std::sqrt(C(place, place) / before[place]);
    }
    const int mount = uncertainty->mount_places[c];
    // An unknown without any information stays infinite.
    for (int i = 0; mount >= 0 && i < 6; ++i) {
      for (int j = 0; j < 6; ++j) {
        double& entry = uncertainty->mount[c](i, j);
        if (std::isfinite(entry)) entry = C(mount + i, mount + j);
      }
    }
  }
  const VectorXd sigma = C.diagonal().cwiseMax(1e-300).cwiseSqrt();
  uncertainty->correlation =
      sigma.cwiseInverse().asDiagonal() * C * sigma.cwiseInverse().asDiagonal();
}

}  // namespace plenocal
