// SPDX-License-Identifier: Apache-2.0
//
// Information of the frames so far as the state of a greedy choice of views.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include "assess/views/next_views.h"
#include "assess/views/projection_sigma.h"

namespace plenocal {

/// Information of the views so far, the criterion by which the next one is chosen, and the gain by
/// a further one.
class InformationState {
 public:
  /// `information` of the unknowns in units; `head`: number of those that images have to determine.
  /// `projection` must outlive it.
  InformationState(Eigen::MatrixXd information,
                   Eigen::Index head,
                   const ProjectionSigma& projection);

  void Add(const Eigen::MatrixXd& information);
  [[nodiscard]] const Eigen::MatrixXd& Information() const { return information_; }
  [[nodiscard]] const Eigen::MatrixXd& Covariance() const { return covariance_; }
  [[nodiscard]] double Sigma() const { return projection_->Of(covariance_); }
  /// Infinite while something is not determined.
  [[nodiscard]] double SigmaOfImages() const;
  /// False while a sigma is the prior's and not the images'.
  [[nodiscard]] bool IsDetermined() const;
  [[nodiscard]] ViewCriterion Criterion() const {
    return IsDetermined() ? ViewCriterion::kSigma : ViewCriterion::kEntropy;
  }
  /// Larger is better; minus infinity where the information is not positive.
  [[nodiscard]] double Gain(const Eigen::MatrixXd& more) const;

 private:
  void Update();

  Eigen::MatrixXd information_, covariance_;
  double log_determinant_ = 0;
  Eigen::Index head_;
  const ProjectionSigma* projection_;
};

}  // namespace plenocal
