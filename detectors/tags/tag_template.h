// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "detectors/cell_drawing.h"
#include "detectors/lens_bend.h"
#include "detectors/tag_edges.h"

namespace plenocal::internal {

double Area(const Quad& q);

/// Maps (0, 0), (1, 0), (1, 1), (0, 1) to the corners; P. Heckbert, "Fundamentals of Texture
/// Mapping and Image Warping", 1989.
Eigen::Matrix3d UnitSquareHomography(const Quad& q);

/// A tag's bits and `around` bits on each side of it, the last of what is beyond: 1 in the colour
/// around the tag, -1 in the other.
CellDrawing DrawTag(const std::vector<bool>& bits, const TagBorder& border, int around);

/// Maps the unit square of `UnitSquareHomography`, whose y axis points up, to the drawing's cells.
Eigen::Matrix3d CellsByUnitSquare(const TagBorder& border, int around);

/// What a fit of a tag's drawing found.
struct TagFit {
  Quad corners;
  std::array<BentMarker, 4> bent;
  std::vector<LensReading> readings;  ///< what the tag itself says about the lens
};

/// A tag's drawing fitted to the image:
///
///   I(x) = (1 + g . y) (m + k T(G y, w)),   y = (d - S(d) c) / side,   d = x - centre,
///
/// c are the lens' bends and S its shifts about the tag's centre (see lens_bend.h), G the
/// homography from image to tag, T is 1 in the colour around the tag, -1 in the other, and some e
/// beyond the bit around the tag, blurred by a Gaussian of standard deviation w (px; the pixel's
/// own area is part of it). The homography is taken as affine within the blur; there the drawing is
/// a sum over its bits of products of steps along the tag's two axes, where the axes are at right
/// angles. Where they are not, the blurs along them are correlated by some r. For a small r the
/// tetrachoric series, cut after r^2, continues the sum; for a larger one both blurs are split into
/// a common part, which is integrated numerically, and independent rests.
class TagTemplate {
 public:
  /// Starts at `tag.corners` with a blur of `blur` px, as a lens without distortion would see it.
  TagTemplate(const cv::Mat& gray, const SeenTag& tag, const TagBorder& border, double blur);

  /// Moves the tag by whole pixels to where the image resembles it most, at most `reach` away.
  void Search(int reach);

  /// Levenberg-Marquardt over as many pixels as it takes to come near the minimum. Returns what
  /// they say about the lens; nothing when it does not converge.
  std::optional<std::vector<LensReading>> Approach();

  /// From there to the minimum over all pixels, with the bends of this lens. Nothing when it does
  /// not converge, or to something else than the tag.
  std::optional<TagFit> Fit(const LensCurvature& lens);

  [[nodiscard]] const Quad& corners() const { return corners_; }
  [[nodiscard]] double blur() const { return state_.blur; }  ///< px

  /// Correlation of image and drawing over the tag's data, without its border.
  [[nodiscard]] double DataCorrelation();

 private:
  static constexpr int kAround = 2;
  static constexpr int kParameters = 14;  // G without its last, m, k, g, w, e
  static constexpr int kBeyond = 13;
  static constexpr int kResidual = kParameters;
  static constexpr int kLens = kParameters + 1;            // its bends
  static constexpr int kWithLens = 24, kWithoutLens = 15;  // columns, padded for AddSquares
  static constexpr int kBlock = 32;                        // strips
  using Vector = Eigen::Matrix<double, kParameters, 1>;
  using Matrix = Eigen::Matrix<double, kParameters, kParameters>;
  using Sums =
      Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kWithLens, kWithLens>;

  struct Pixel {
    int column, row;
    float x, y;  ///< y of the model
    float gray;
    bool data;
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
    CellDrawing::Drawn drawn;
  };

  /// y of a point of the image, and back.
  [[nodiscard]] Eigen::Vector2d Straight(const Eigen::Vector2d& x) const;
  [[nodiscard]] Eigen::Vector2d Bent(const Eigen::Vector2d& y) const;
  /// The same of eight points at a distance from the centre, px.
  void Place(const Lanes& d_x, const Lanes& d_y, Lanes* x, Lanes* y) const;
  void ChoosePixels();
  /// Puts the pixels chosen where they are by the present centre and bends.
  void PlacePixels();
  void SetBeyond(double value);
  /// The pixels from number `from` on, `stride` apart, and the drawing there.
  Strip Draw(const State& state, std::size_t from, std::size_t stride);
  /// Calls use(pixel, value of the drawing) for every `stride`-th pixel.
  template <typename Use>
  void ForEachDrawn(std::size_t stride, const Use& use);
  /// The model's derivatives by its parameters, the residual and, where asked for, the derivatives
  /// by the bends, `kBlock` apart.
  void Differentiate(const State& state, const Strip& strip, bool by_bends, Lanes* rows) const;
  /// Of j j^T over every `stride`-th pixel, j being what `Differentiate` gives.
  Sums Linearise(const State& state, std::size_t stride, bool by_bends);
  /// Moves the state by a step of Levenberg-Marquardt and returns the descent of the sum of squares
  /// that it promises; nothing where there is no step.
  std::optional<double> Step(const Sums& sums, double damping);
  void Return(const State& to);
  /// Where a descent ended.
  struct Minimum {
    Sums sums;            ///< with the bends
    Matrix covariance;    ///< of the other parameters
    double variance = 0;  ///< of a pixel's noise
  };
  [[nodiscard]] Minimum MinimumBySums(Sums sums, std::size_t stride) const;
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
  /// How far the corners are from where the fit started, px.
  [[nodiscard]] double Moved() const;
  /// Whether the fit is still where it started, and black is black.
  [[nodiscard]] bool IsTag() const;
  /// What the tag says about the lens' bends, along independent axes.
  [[nodiscard]] std::vector<LensReading> ReadLens(const Minimum& minimum) const;
  [[nodiscard]] std::array<BentMarker, 4> Owed(const Minimum& minimum) const;
  /// Derivatives of a corner by G.
  [[nodiscard]] Eigen::Matrix<double, 2, 8> CornerByG(const Eigen::Vector2d& corner) const;
  void SetCorners(const Quad& corners);
  void UpdateCorners();

  const cv::Mat& gray_;
  TagBorder border_;
  int bits_ = 0;         ///< of the drawing: the tag and those around it
  CellDrawing drawing_;  ///< of -1, 1 and, the outermost, e
  State state_;
  Quad start_, corners_;
  Eigen::Vector2d centre_;
  std::optional<LensBend> bend_;  ///< about the centre
  double side_ = 0;
  LensBends bends_ = LensBends::Zero();
  std::array<BentMarker, 4> bent_;
  std::vector<Pixel> pixels_;
};

}  // namespace plenocal::internal
