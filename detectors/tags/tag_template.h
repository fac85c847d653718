// SPDX-License-Identifier: Apache-2.0
//
// The template of a tag and its fit to an image.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <limits>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "detectors/tags/distortion_basis.h"
#include "detectors/tags/seen_tag.h"
#include "detectors/templates/cell_template.h"
#include "targets/tags/quad.h"

namespace plenocal::internal {

double Area(const Quad& q);

/// A tag's bits and `around` bits on each side of it, the last of what is beyond: 1 in the colour
/// around the tag, -1 in the other.
CellTemplate DrawTag(const std::vector<bool>& bits, const TagBorder& border, int around);

/// Maps the unit square of `UnitSquareHomography`, whose y axis points up, to the drawing's cells.
Eigen::Matrix3d CellsByUnitSquare(const TagBorder& border, int around);

/// Result of a fit of a tag's template.
struct TagFit {
  Quad corners;
  std::array<DistortionSensitivity, 4> sensitivities;
  std::vector<DistortionMeasurement> measurements;  ///< of the distortion by the tag itself
};

/// A tag's template fitted to the image:
///
///   I(x) = (1 + g . y) (m + k T(G y, w)),   y = (d - S(d) c) / side,   d = x - centre,
///
/// c is the local distortion and S c its displacements about the tag's centre (see
/// distortion_basis.h), G the homography from image to tag, T is 1 in the colour around the tag, -1
/// in the other, and some e beyond the bit around the tag, blurred by a Gaussian of standard
/// deviation w (px; the pixel's own area is part of it). The homography is taken as affine within
/// the blur; there the drawing is a sum over its bits of products of steps along the tag's two
/// axes, where the axes are at right angles. Where they are not, the blurs along them are
/// correlated by some r. For a small r the tetrachoric series, cut after r^2, continues the sum;
/// for a larger one both blurs are split into a common part, which is integrated numerically, and
/// independent rests.
class TagTemplate {
 public:
  /// Starts at `tag.corners` with a blur of `blur` px and without distortion.
  TagTemplate(const cv::Mat& gray, const SeenTag& tag, const TagBorder& border, double blur);

  /// Moves the tag by whole pixels to where the image resembles it most, at most `reach` away.
  void Search(int reach);

  /// Levenberg-Marquardt over as many pixels as it takes to come near the minimum. Returns the
  /// measurements of the distortion; nothing when it does not converge.
  std::optional<std::vector<DistortionMeasurement>> Approach();

  /// From there to the minimum over all pixels, with this distortion. Nothing when it does
  /// not converge, or to something else than the tag.
  std::optional<TagFit> Fit(const DistortionField& field);

  /// The same tag from its present state on, fitted to the quarter of its pixels around corner `k`
  /// alone, where the third order describes the distortion better than on the whole tag. Only this
  /// corner is of use. Nothing when it does not converge.
  [[nodiscard]] std::optional<TagTemplate> AtCorner(std::size_t k,
                                                    const DistortionField& field) const;

  [[nodiscard]] const Quad& corners() const { return corners_; }
  [[nodiscard]] double blur() const { return state_.blur; }  ///< px

  /// Correlation of image and drawing over the tag's data, without its border.
  [[nodiscard]] double DataCorrelation();

 private:
  static constexpr int kAround = 2;
  static constexpr double kReach = 3;     // blurs: all but 0.3 % of a step between two bits
  static constexpr int kParameters = 14;  // G without its last, m, k, g, w, e
  static constexpr std::size_t kEnough = 10 * kParameters;  ///< pixels to come near the minimum
  static constexpr int kBeyond = 13;
  static constexpr int kResidual = kParameters;
  static constexpr int kDistortion = kParameters + 1;            // the terms of the distortion
  static constexpr int kCount = kDistortion + kDistortionTerms;  // 1 where the pixel counts
  static constexpr int kWithDistortion = kCount + 1,
                       kWithoutDistortion = 15;  // columns, padded for AddSquares
  static constexpr int kBlock = 32;              // strips
  using Vector = Eigen::Matrix<double, kParameters, 1>;
  using Matrix = Eigen::Matrix<double, kParameters, kParameters>;
  using Sums = Eigen::Matrix<double,
                             Eigen::Dynamic,
                             Eigen::Dynamic,
                             Eigen::ColMajor,
                             kWithDistortion,
                             kWithDistortion>;

  struct Pixel {
    int column, row;
    float x, y;  ///< y of the model
    float gray;
  };
  struct State {
    Eigen::Matrix3d G;  ///< y to bits, from the drawing's upper left corner; G(2, 2) is 1
    double level = 0, contrast = 0, blur = 0, beyond = 0;
    Eigen::Vector2d gradient{0, 0};
  };
  /// Pixels that are computed together; of those beyond the last all is zero.
  struct Strip {
    int count = 0;
    Lanes d_x{}, d_y{}, x{}, y{}, gray{}, known{};
    CellTemplate::Drawn drawn;
  };

  /// y of a point of the image, and back.
  [[nodiscard]] Eigen::Vector2d Undistorted(const Eigen::Vector2d& x) const;
  [[nodiscard]] Eigen::Vector2d Distorted(const Eigen::Vector2d& y) const;
  /// The same of eight points at a distance from the centre, px.
  void Place(const Lanes& d_x, const Lanes& d_y, Lanes* x, Lanes* y) const;
  /// The pixels of the window, of every `step`-th row and every `step`-th eight of it; without
  /// those farther than `reach` (px) from where the drawing changes, which do not measure the tag.
  void ChoosePixels(int step, double reach = std::numeric_limits<double>::infinity());
  /// The step by which enough pixels are chosen to come near the minimum.
  [[nodiscard]] int StepToApproach() const;
  void SetBeyond(double value);
  /// Size of a pixel's residual.
  [[nodiscard]] float ResidualOf(const Strip& strip, int lane) const;
  /// Largest residual of a pixel that shows the tag and not a hand or a cable before it.
  float LargestResidual();
  void LeaveOutBeyondLimit();
  /// The pixels from number `from` on, `stride` apart, and the drawing there.
  Strip Draw(const State& state, std::size_t from, std::size_t stride);
  /// Calls use(strip, lane) for every `stride`-th pixel, drawn.
  template <typename Use>
  void ForEachDrawn(std::size_t stride, const Use& use);
  /// Columns of the normal equations beside the residual.
  enum class Columns { kParameters, kAll };  ///< all: with the terms of the distortion
  /// The model's derivatives by its parameters, the residual and, with all columns, the derivatives
  /// by the distortion, `kBlock` apart.
  void Differentiate(const State& state, const Strip& strip, Columns columns, Lanes* rows) const;
  /// Of j j^T over every `stride`-th pixel, j being what `Differentiate` gives.
  Sums Linearise(const State& state, std::size_t stride, Columns columns);
  /// Moves the state by a step of Levenberg-Marquardt and returns the descent of the sum of squares
  /// that it promises; nothing where there is no step.
  std::optional<double> Step(const Sums& sums, double damping);
  void Return(const State& to);
  /// End of a descent.
  struct Minimum {
    Sums sums;            ///< with the distortion
    Matrix covariance;    ///< of the other parameters
    double variance = 0;  ///< of a pixel's noise
  };
  [[nodiscard]] Minimum MinimumBySums(Sums sums) const;
  /// To the minimum over every `stride`-th of the pixels chosen; nothing when it does not get
  /// there.
  std::optional<Minimum> Descend(std::size_t stride);
  /// Which share of the pixels, 1 / stride, is enough to come near the minimum.
  [[nodiscard]] std::size_t Stride() const;
  /// To the minimum over some of the pixels, or else over all.
  std::optional<Minimum> DescendSomehow();
  /// To the minimum over all pixels from one that is near. What is returned may be one short step
  /// old.
  std::optional<Minimum> Finish();
  void StartLevels();
  /// Largest distance of a corner from its start, px.
  [[nodiscard]] double Moved() const;
  /// The fit has stayed near its start, and black is black.
  [[nodiscard]] bool IsTag() const;
  /// Measurements of the distortion by the tag, along independent axes.
  [[nodiscard]] std::vector<DistortionMeasurement> MeasureDistortion(const Minimum& minimum) const;
  [[nodiscard]] std::array<DistortionSensitivity, 4> Sensitivities(const Minimum& minimum) const;
  /// Derivatives of a corner by G.
  [[nodiscard]] Eigen::Matrix<double, 2, 8> CornerByG(const Eigen::Vector2d& corner) const;
  void SetCorners(const Quad& corners);
  void UpdateCorners();

  const cv::Mat& gray_;
  TagBorder border_;
  int bits_ = 0;                ///< of the drawing: the tag and those around it
  Eigen::AlignedBox2d window_;  ///< of the drawing, bits: what is fitted
  CellTemplate drawing_;        ///< of -1, 1 and, the outermost, e
  State state_;
  Quad start_, corners_;
  Eigen::Vector2d centre_;
  std::optional<DistortionBasis> basis_;  ///< about the centre
  double side_ = 0;
  LocalDistortion distortion_ = LocalDistortion::Zero();
  std::array<DistortionSensitivity, 4> sensitivities_;
  std::vector<Pixel> pixels_;
  float limit_ = std::numeric_limits<float>::infinity();  ///< residuals beyond are left out
};

}  // namespace plenocal::internal
