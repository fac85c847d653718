// SPDX-License-Identifier: Apache-2.0
#include "assess/views/information_state.h"

#include <limits>
#include <utility>

namespace plenocal {

InformationState::InformationState(Eigen::MatrixXd information,
                                   Eigen::Index head,
                                   const ProjectionSigma& projection)
    : information_(std::move(information)), head_(head), projection_(&projection) {
  Update();
}

void InformationState::Add(const Eigen::MatrixXd& information) {
  information_ += information;
  Update();
}

bool InformationState::IsDetermined() const {
  constexpr double kPriors = 0.5;  // of an unknown, in units: above it is the prior's
  return covariance_.diagonal().head(head_).maxCoeff() < kPriors &&
         Sigma() < projection_->Words().determined;
}

double InformationState::SigmaOfImages() const {
  return IsDetermined() ? Sigma() : std::numeric_limits<double>::infinity();
}

double InformationState::Gain(const Eigen::MatrixXd& more) const {
  const Eigen::LLT<Eigen::MatrixXd> factor(information_ + more);
  if (factor.info() != Eigen::Success) return -std::numeric_limits<double>::infinity();
  if (Criterion() == ViewCriterion::kEntropy) {
    return 2 * factor.matrixLLT().diagonal().array().log().sum() - log_determinant_;
  }
  const Eigen::MatrixXd covariance =
      factor.solve(Eigen::MatrixXd::Identity(information_.rows(), information_.rows()));
  return Sigma() - projection_->Of(covariance);
}

void InformationState::Update() {
  const Eigen::LLT<Eigen::MatrixXd> factor(information_);
  covariance_ = factor.solve(Eigen::MatrixXd::Identity(information_.rows(), information_.rows()));
  log_determinant_ = 2 * factor.matrixLLT().diagonal().array().log().sum();
}

}  // namespace plenocal
