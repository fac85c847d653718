// SPDX-License-Identifier: Apache-2.0
//
// Splines of the attenuation of a wall's model: a coarse one with the gains in one system, from
// which the brightness of the wall is eliminated exactly, and a fine one with the rest fixed.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "apps/photometry/images/image_spline.h"
#include "apps/photometry/wall_model.h"

namespace plenocal {

/// Normal equations of the coarse unknowns: coefficients of v, then gains.
struct CoarseSystem {
  Eigen::MatrixXd S;      ///< the brightness of the wall eliminated
  Eigen::MatrixXd known;  ///< of v alone, as if wall and gains were known
  Eigen::VectorXd b;

  CoarseSystem& operator+=(const CoarseSystem& more);
  [[nodiscard]] Eigen::VectorXd Solve() const;
};

class VignetteSplines {
 public:
  /// `model` must outlive the object.
  explicit VignetteSplines(WallModel* model);

  /// One round: gains and coarse v with the wall, then fine v.
  void Round();

  [[nodiscard]] const ImageSpline& Coarse() const { return coarse_; }
  /// The equations by the views in `only`, or by all.
  [[nodiscard]] CoarseSystem MakeCoarseSystem(const std::vector<bool>& only = {}) const;
  /// Covariance of the coarse unknowns. That of their normal equations is what blocks of the wall,
  /// whose errors are independent, scatter by: noise, and texture between the pixels.
  [[nodiscard]] Eigen::MatrixXd CoarseCovariance(const CoarseSystem& system) const;
  /// The attenuation by pixel, CV_32F; largest value 1.
  [[nodiscard]] cv::Mat FineAttenuation() const;
  /// Its relative standard deviation by pixel, CV_32F. `coarse`: covariance of the coarse v.
  [[nodiscard]] cv::Mat FineSigma(const CoarseSystem& system, const Eigen::MatrixXd& coarse) const;

 private:
  /// Information of the samples, and information * (y - g - c); a column for each reduced pixel.
  using PixelSums = Eigen::Array2Xd;

  [[nodiscard]] ImageSpline::Basis CoarseAt(double x, double y) const;
  [[nodiscard]] double GainSigma() const;
  void AddPriors(CoarseSystem* system) const;
  [[nodiscard]] Eigen::VectorXd MeanOfCoarse() const;
  [[nodiscard]] PixelSums SumPixels() const;
  [[nodiscard]] SplineFit MakeFineFit() const;
  [[nodiscard]] double NoiseOfAllViews() const;
  [[nodiscard]] cv::Mat NoiseOfSingleViews() const;

  WallModel& model_;
  double longer_;  // px, side of the image
  ImageSpline fine_, coarse_;
  Eigen::VectorXd fine_coefficients_;
};

}  // namespace plenocal
