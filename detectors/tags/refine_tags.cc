// SPDX-License-Identifier: Apache-2.0
#include "detectors/tags/refine_tags.h"

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "calib/base/statistics.h"
#include "detectors/images/distortion_field.h"
#include "detectors/tags/distortion_basis.h"
#include "detectors/tags/tag_template.h"
#include "detectors/templates/saddle.h"

namespace plenocal::internal {
namespace {

double Square(double x) { return x * x; }

constexpr double kUsualBlur = 0.8;  // px, of a lens in focus; where the fits start

/// The crossing of a tag's corner with the square that touches it, as far as both are free of other
/// edges. Unlike the tag's outline it stays where it is when black or white spreads: by the print,
/// the exposure or the camera's sharpening.
std::optional<RefinedCorner> CrossingAt(const cv::Mat& gray,
                                        const Quad& corners,
                                        std::size_t k,
                                        const TagBorder& border,
                                        const DistortionField& field,
                                        double blur) {
  const double free = std::min<double>(border.ring, border.outside) / border.width;
  SaddleGuess guess;
  guess.p = corners[k];
  guess.u = free * (corners[(k + 1) % 4] - corners[k]);
  guess.v = free * (corners[(k + 3) % 4] - corners[k]);
  const DistortionBasis basis(guess.p, Eigen::Vector2d(gray.cols, gray.rows));
  const LocalDistortion distortion = field.At(basis.p());
  const auto along = [&](const Eigen::Vector2d& direction) {
    const Eigen::Vector2d clockwise = Eigen::Vector2d(-direction.y(), direction.x()).normalized();
    return 2 * basis.EdgeCurvature(direction, clockwise).dot(distortion);
  };
  guess.curvature_u = along(guess.u);
  guess.curvature_v = along(guess.v);
  guess.blur = blur;
  const auto saddle = FitSaddle(gray, guess);
  // The tag's own black is where u and v have equal signs.
  if (!saddle || saddle->contrast > 0) return std::nullopt;
  // Lines whose curvature is alike on both sides of the crossing do not move it.
  return RefinedCorner{saddle->p, saddle->sigma, {{}, saddle->sigma}};
}

/// The tags of one image on their way to measured corners.
class TagRefiner {
 public:
  TagRefiner(const cv::Mat& gray, std::span<const SeenTag> tags, const TagBorder& border)
      : gray_(gray),
        image_size_(gray.cols, gray.rows),
        tags_(tags),
        border_(border),
        templates_(tags.size()) {
    result_.quads.resize(tags.size());
  }

  RefinedTags Refine() {
    for (std::size_t i = 0; i < tags_.size(); ++i) Approach(i);
    const DistortionField rough(measurements_);
    for (std::size_t i = 0; i < tags_.size(); ++i) Measure(i, rough);
    // All pixels measure the distortion better than the share of them that sufficed to come near.
    const DistortionField field(result_.measurements);
    UseDistortion(field);
    if (border_.corner_squares) {
      const double blur = Median(std::move(blurs_), kUsualBlur);
      for (std::size_t i = 0; i < tags_.size(); ++i) UseCrossings(i, field, blur);
    }
    return std::move(result_);
  }

 private:
  /// Fits the template of a tag roughly and measures the distortion.
  void Approach(std::size_t i);
  void Measure(std::size_t i, const DistortionField& field);
  /// One corner by the whole tag or by the quarter around it; `part`: the latter's fit, if made.
  [[nodiscard]] RefinedCorner MeasureCorner(const TagTemplate& tag,
                                            const TagFit& whole,
                                            std::size_t k,
                                            const DistortionField& field,
                                            std::optional<TagFit>* part) const;
  void UseDistortion(const DistortionField& field);
  /// Corners measured as crossings with the squares that touch them.
  void UseCrossings(std::size_t i, const DistortionField& field, double blur);

  const cv::Mat& gray_;
  Eigen::Vector2d image_size_;
  std::span<const SeenTag> tags_;
  const TagBorder& border_;
  std::vector<std::optional<TagTemplate>> templates_;  ///< those that came near
  std::vector<DistortionMeasurement> measurements_;
  std::vector<double> blurs_;
  RefinedTags result_;
};

void TagRefiner::Approach(std::size_t i) {
  // The first guess may be off by more than the template can follow.
  constexpr int kReach = 2;  // px, beyond which the library's corners never are
  for (const int reach : {0, kReach}) {
    std::optional<TagTemplate>& tag = templates_[i];
    tag.emplace(gray_, tags_[i], border_, blurs_.empty() ? kUsualBlur : blurs_.back());
    if (reach > 0) tag->Search(reach);
    if (const auto of_tag = tag->Approach()) {
      blurs_.push_back(tag->blur());
      measurements_.insert(measurements_.end(), of_tag->begin(), of_tag->end());
      return;
    }
    tag.reset();
  }
}

void TagRefiner::Measure(std::size_t i, const DistortionField& field) {
  if (!templates_[i]) return;
  TagTemplate& tag = *templates_[i];
  const std::optional<TagFit> whole = tag.Fit(field);
  if (!whole) return;
  std::vector<DistortionMeasurement> of_parts;
  for (std::size_t k = 0; k < 4; ++k) {
    std::optional<TagFit> part;
    result_.quads[i][k] = MeasureCorner(tag, *whole, k, field, &part);
    if (part) of_parts.insert(of_parts.end(), part->measurements.begin(), part->measurements.end());
  }
  const auto& measurements = of_parts.empty() ? whole->measurements : of_parts;
  result_.measurements.insert(result_.measurements.end(), measurements.begin(), measurements.end());
}

RefinedCorner TagRefiner::MeasureCorner(const TagTemplate& tag,
                                        const TagFit& whole,
                                        std::size_t k,
                                        const DistortionField& field,
                                        std::optional<TagFit>* part) const {
  const auto corner_of = [k](const TagFit& fit, double higher_orders) {
    DistortionSensitivity sensitivity = fit.sensitivities[k];
    sensitivity.sigma = std::hypot(sensitivity.sigma, higher_orders);
    return RefinedCorner{fit.corners[k], sensitivity.sigma, sensitivity};
  };
  // px, of each coordinate
  const auto per_coordinate = [](const Eigen::Vector2d& v) { return v.norm() * M_SQRT1_2; };
  const DistortionSensitivity& of_whole = whole.sensitivities[k];
  const double guess =
      per_coordinate(field.HigherOrders(of_whole, PlaceOfPixel(whole.corners[k], image_size_)));
  constexpr double kNegligible = 0.5;  // of the noise
  if (guess < kNegligible * of_whole.sigma) return corner_of(whole, guess);
  if (std::optional<TagTemplate> quarter = tag.AtCorner(k, field)) *part = quarter->Fit(field);
  if (!*part) return corner_of(whole, guess);
  // Mean square of the displacement by higher orders, a priori of the size of the guess, where both
  // fits are `apart` by it and by noise.
  const double apart = per_coordinate((*part)->corners[k] - whole.corners[k]);
  const double noise = Square((*part)->sensitivities[k].sigma) - Square(of_whole.sigma);
  const double share = Square(guess) / (Square(guess) + std::max(0.0, noise));
  const double displaced = std::sqrt(Square(share * apart) + (1 - share) * Square(guess));
  // Of fourth order, it is a sixteenth within half the length.
  constexpr double kHalved = 1.0 / 16;
  const RefinedCorner by_whole = corner_of(whole, displaced);
  const RefinedCorner by_part = corner_of(**part, kHalved * displaced);
  return by_whole.sigma < by_part.sigma ? by_whole : by_part;
}

void TagRefiner::UseDistortion(const DistortionField& field) {
  for (RefinedQuad& quad : result_.quads) {
    for (auto& corner : quad) {
      if (!corner) continue;
      corner->point += field.Change(corner->sensitivity);
      corner->sigma = field.Sigma(corner->sensitivity);
      for (SensitivityPiece& piece : corner->sensitivity.pieces) piece.assumed = field.At(piece.p);
    }
  }
}

void TagRefiner::UseCrossings(std::size_t i, const DistortionField& field, double blur) {
  Quad corners = tags_[i].corners;
  for (std::size_t k = 0; k < 4; ++k) {
    if (result_.quads[i][k]) corners[k] = result_.quads[i][k]->point;
  }
  for (std::size_t k = 0; k < 4; ++k) {
    if (const auto crossing = CrossingAt(gray_, corners, k, border_, field, blur)) {
      result_.quads[i][k] = crossing;
    }
  }
}

}  // namespace

RefinedTags RefineTags(const cv::Mat& gray,
                       std::span<const SeenTag> tags,
                       const TagBorder& border) {
  return TagRefiner(gray, tags, border).Refine();
}

std::optional<Quad> FindTag(const cv::Mat& gray,
                            const SeenTag& expected,
                            const TagBorder& border,
                            double reach) {
  constexpr double kBitPixels = 3;  // suffice to recognise a tag; larger ones are reduced
  // Around the place expected: bits that the template covers, and px for its blur.
  constexpr double kAroundBits = 2, kAroundPixels = 2;
  Eigen::AlignedBox2d box;
  double side = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    box.extend(expected.corners[k]);
    side += (expected.corners[(k + 1) % 4] - expected.corners[k]).norm() / 4;
  }
  const int reduced = std::max(1, static_cast<int>(side / (kBitPixels * border.width)));
  const double room = reach + kAroundBits * side / border.width + kAroundPixels;
  const cv::Point from(static_cast<int>(std::floor(box.min().x() - room)),
                       static_cast<int>(std::floor(box.min().y() - room)));
  const cv::Point to(static_cast<int>(std::ceil(box.max().x() + room)),
                     static_cast<int>(std::ceil(box.max().y() + room)));
  cv::Rect region = cv::Rect(from, to) & cv::Rect(0, 0, gray.cols, gray.rows);
  region.width -= region.width % reduced;
  region.height -= region.height % reduced;
  if (region.empty()) return std::nullopt;
  cv::Mat part = gray(region);
  if (reduced > 1) cv::resize(part, part, region.size() / reduced, 0, 0, cv::INTER_AREA);
  const Eigen::Vector2d origin(region.x - 0.5, region.y - 0.5), half(0.5, 0.5);
  SeenTag there = expected;
  for (auto& c : there.corners) c = (c - origin) / reduced - half;

  TagTemplate drawing(part, there, border, kUsualBlur);
  drawing.Search(static_cast<int>(std::ceil(reach / reduced)));
  if (!drawing.Approach() || !drawing.Fit(DistortionField({}))) return std::nullopt;
  // Standard deviations of Fisher's transform from no correlation: one chance in three million.
  constexpr double kSure = 5;
  const int data = border.width - 2 * border.ring;
  const double least = std::tanh(kSure / std::sqrt(data * data - 3.0));
  if (drawing.DataCorrelation() < least) return std::nullopt;
  Quad found = drawing.corners();
  for (auto& c : found) {
    c = (c + half) * reduced + origin;
    if (c.x() < 0 || c.y() < 0 || c.x() > gray.cols - 1 || c.y() > gray.rows - 1)
      return std::nullopt;
  }
  return found;
}

}  // namespace plenocal::internal
