// SPDX-License-Identifier: Apache-2.0
//
// Residuals of single views with their derivatives, on which tests for causes regress.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "calib/adjust/bundle.h"

namespace plenocal {

/// The observations of one view, linearised at the optimum, in standard deviations of their
/// noise.
struct ViewRows {
  int frame = 0;
  Eigen::VectorXd residual;  ///< two rows (x, y) an observation
  Eigen::MatrixXd pose;      ///< rows x 6: derivatives by the target's pose
  /// Observations x 2: the image point as predicted, px. By the measured one regressors would
  /// contain the noise of the residuals.
  Eigen::MatrixXd position;
  Eigen::VectorXd noise;     ///< per observation: sigma of a coordinate, px
  std::vector<int> markers;  ///< per observation: index into Bundle::markers
  Eigen::MatrixXd marker;    ///< rows x 3: derivatives by the position of the row's marker
};

/// The views of one camera with used observations enough for a pose, in the order of the frames; of
/// very many observations every k-th. Only models that measure x and y.
std::vector<ViewRows> RowsOfViews(const Bundle& bundle, size_t camera);

/// Least-squares fit of regressors to the residuals of one view beside its pose.
struct Regression {
  Eigen::VectorXd estimate;     ///< per regressor
  Eigen::MatrixXd information;  ///< of the estimate, sigma^-2
  double gain = 0;              ///< by how much the sum of squares falls
  double rest = 0;              ///< sum of squares that is left
  double degrees = 0;           ///< rows less pose and regressors
};

/// Residuals without what is the same in all views: displacements of the markers, and the mean over
/// the views in each part of the image.
std::vector<ViewRows> WithoutCommonPart(std::vector<ViewRows> views, ImageSize image_size);

/// `regressors`: rows x k. Regressors that the pose can replace get the estimate 0.
Regression Regress(const ViewRows& view, const Eigen::MatrixXd& regressors);

}  // namespace plenocal
