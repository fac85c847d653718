// SPDX-License-Identifier: Apache-2.0
//
// Fits splines of the attenuation to a wall's model: a coarse one together with the gains, with the
// brightness of the wall eliminated exactly, and a fine one with all else fixed.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "apps/photometry/images/image_spline.h"
#include "apps/photometry/wall_model.h"

namespace plenocal {

/// Normal equations of the coarse unknowns: coefficients of v, then gains.
struct CoarseSystem {
  Eigen::MatrixXd S;      ///< with the brightness of the wall eliminated
  Eigen::MatrixXd known;  ///< of v alone, with wall and gains known
  Eigen::VectorXd b;

  CoarseSystem& operator+=(const CoarseSystem& more);
  [[nodiscard]] Eigen::VectorXd Solve() const;
};

class VignetteSplines {
 public:
  /// `model` must outlive the object.
  explicit VignetteSplines(WallModel* model);

  /// One iteration: gains and coarse v with the wall, then fine v.
  void Round();

  [[nodiscard]] const ImageSpline& Coarse() const { return coarse_; }
  /// The equations from the views in `only`, or from all.
  [[nodiscard]] CoarseSystem MakeCoarseSystem(const std::vector<bool>& only = {}) const;
  /// Covariance of the coarse unknowns: the cluster-robust one, from the scatter of blocks of the
  /// wall with independent errors. It contains noise, and texture between the pixels.
  [[nodiscard]] Eigen::MatrixXd CoarseCovariance(const CoarseSystem& system) const;
  /// The attenuation by pixel, CV_32F; largest value 1.
  [[nodiscard]] cv::Mat FineAttenuation() const;
  /// Its relative standard deviation by pixel, CV_32F. `coarse`: covariance of the coarse v.
  [[nodiscard]] cv::Mat FineSigma(const CoarseSystem& system, const Eigen::MatrixXd& coarse) const;

 private:
  /// Rows: weight of the samples, and weight * (y - g - c); a column for each reduced pixel.
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
