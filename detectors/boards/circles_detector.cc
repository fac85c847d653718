// SPDX-License-Identifier: Apache-2.0
#include "detectors/boards/circles_detector.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calib/base/linear_algebra.h"
#include "calib/base/robust.h"
#include "detectors/boards/blob_grid.h"
#include "detectors/boards/grid_order.h"
#include "detectors/templates/board_templates.h"
#include "detectors/templates/pixel_fit.h"

// OpenCV finds the grid of blobs; each circle is then measured by a fit of a blurred ellipse to its
// gray values.
//
// The result is the image of the circle's centre. The ellipse's centre lies farther from the
// vanishing line of the board's plane, by about
//   r^2 sin(tilt) cos(tilt) f / Z^2   (r the circle's radius, Z its distance, f in px)
// which for a circle of 10 px radius at f = 1000 px tilted by 45 degrees is 0.05 px. A circle's
// centre is the pole of the line at infinity, so its image is the pole of the vanishing line by the
// ellipse; that line follows from the homography of the circles around.
//
// Lens distortion displaces it likewise. x = J q + (q' H_1 q, q' H_2 q) / 2 displaces the ellipse
// J q = A (cos t, sin t), along the normal in units of A, by terms of cos t and sin t, which move
// the centre, and of cos 3t and sin 3t, which no ellipse has.
//
// Numbering. An asymmetric grid's offset rows decide, when the number of rows is odd; otherwise a
// turn by 180 degrees changes nothing, nor does a turn by 90 of a square symmetric grid. Of the
// places that remain for circle 0 the one nearest the image's top left is taken (see NearestTopLeft
// for what that means for rigs).

namespace plenocal {
namespace {

using internal::GridOrder;
using internal::Pixel;
using Places = std::vector<cv::Point2f>;

/// A measured circle.
struct Circle {
  Eigen::Vector2d p;  ///< px, the ellipse's centre
  Eigen::Matrix2d M;  ///< px^-2, the ellipse is (x - p)^T M (x - p) = 1
  double sigma = 0;   ///< px
};

/// A blurred ellipse on a plane of brightness. With q = p - c and M = (m_xx m_xy; m_xy m_yy), the
/// ellipse is q^T M q = 1, and to first order the distance from it, positive inside, is
///   d = (1 - F) F / |M q|,   F = sqrt(q^T M q),   |grad F| = |M q| / F;
/// the gray value, S being the profile of a blurred edge from -1 to 1 and s its width,
///   gray = a + g q + b S(d / s).
class BlurredEllipse {
 public:
  enum { kX, kY, kMxx, kMxy, kMyy, kBlur, kA, kB, kGx, kGy, kSize };
  using Params = Eigen::Matrix<double, kSize, 1>;

  BlurredEllipse(const Eigen::Vector2d& guess, double reach) : guess_(guess), reach_(reach) {}

  static double Width(double e) { return std::hypot(e, kPixelSigma); }

  [[nodiscard]] auto At(const Params& params) const {
    return [params, s = Width(params[kBlur])](const Pixel& pixel, Params* J) {
      const Eigen::Vector2d q(pixel.x - params[kX], pixel.y - params[kY]);
      const Eigen::Vector2d Mq(params[kMxx] * q.x() + params[kMxy] * q.y(),
                               params[kMxy] * q.x() + params[kMyy] * q.y());
      // At the centre itself, where the edge is far, any direction will do.
      const double F = std::sqrt(std::max(q.dot(Mq), kTiny));
      const double per_gradient = F / std::max(Mq.norm(), kTiny);
      const double d = (1 - F) * per_gradient;
      const internal::EdgeProfile profile = internal::BlurredEdge(d / s);
      const double b = params[kB];
      // dF = q^T dM q / (2 F) - q^T M dc / F. The change of |grad F| is left out: it is multiplied
      // by d, which is small where the profile changes.
      const double slope = -b * profile.derivative / s * per_gradient / F;
      (*J)[kX] = -slope * Mq.x() - params[kGx];
      (*J)[kY] = -slope * Mq.y() - params[kGy];
      (*J)[kMxx] = 0.5 * slope * q.x() * q.x();
      (*J)[kMxy] = slope * q.x() * q.y();
      (*J)[kMyy] = 0.5 * slope * q.y() * q.y();
      (*J)[kBlur] = -b * profile.derivative * d / s * params[kBlur] / (s * s);
      (*J)[kA] = 1;
      (*J)[kB] = profile.value;
      (*J)[kGx] = q.x();
      (*J)[kGy] = q.y();
      return params[kA] + params[kGx] * q.x() + params[kGy] * q.y() + b * profile.value;
    };
  }

  bool Plausible(const Params& params) const {
    const double determinant = params[kMxx] * params[kMyy] - params[kMxy] * params[kMxy];
    return params[kMxx] > 0 && determinant > 0 &&
           std::hypot(params[kX] - guess_.x(), params[kY] - guess_.y()) < reach_ &&
           Width(params[kBlur]) < reach_;
  }

 private:
  static constexpr double kTiny = 1e-12;

  Eigen::Vector2d guess_;
  double reach_;
};

/// Centre and second moments of the region around `guess` that is on the other side of the middle
/// between its gray value and its surroundings', within `radius`.
struct Region {
  Eigen::Vector2d centre;
  Eigen::Matrix2d covariance;
  double inside = 0, outside = 0;  ///< mean gray values
};

std::optional<Region> FindRegion(const cv::Mat& gray, const Eigen::Vector2d& guess, double radius) {
  const cv::Point centre(static_cast<int>(std::lround(guess.x())),
                         static_cast<int>(std::lround(guess.y())));
  const int r = static_cast<int>(std::ceil(radius));
  const cv::Rect window =
      cv::Rect(centre.x - r, centre.y - r, 2 * r + 1, 2 * r + 1) & cv::Rect({}, gray.size());
  if (!window.contains(centre)) return std::nullopt;
  const cv::Mat patch = gray(window);
  cv::Mat binary;
  const double threshold =
      cv::threshold(patch, binary, 0, 255, cv::THRESH_BINARY | cv::THRESH_OTSU);
  const cv::Point seed = centre - window.tl();
  const bool bright = patch.at<std::uint8_t>(seed) > threshold;
  if (!bright) binary = 255 - binary;
  cv::Mat labels;
  cv::connectedComponents(binary, labels, 8, CV_32S);
  const int label = labels.at<int>(seed);
  const cv::Mat mask = labels == label;
  const cv::Moments moments = cv::moments(mask, true);
  constexpr double kFewestPixels = 4;
  if (moments.m00 < kFewestPixels) return std::nullopt;
  Region region;
  region.centre = {window.x + moments.m10 / moments.m00, window.y + moments.m01 / moments.m00};
  const double unit = 1.0 / 12;  // a pixel's own second moment
  region.covariance << moments.mu20 / moments.m00 + unit, moments.mu11 / moments.m00,
      moments.mu11 / moments.m00, moments.mu02 / moments.m00 + unit;
  region.inside = cv::mean(patch, mask)[0];
  region.outside = cv::mean(patch, ~mask)[0];
  return region;
}

/// `spacing`: px to the nearest neighbour.
std::optional<Circle> FitCircle(const cv::Mat& gray, const Eigen::Vector2d& guess, double spacing) {
  const std::optional<Region> region = FindRegion(gray, guess, 0.5 * spacing);
  if (!region) return std::nullopt;
  // For a full ellipse the second moments are M^-1 / 4.
  const Eigen::Matrix2d M = (4 * region->covariance).inverse();
  const double semi_axis = 2 * std::sqrt(0.5 * region->covariance.trace());
  // Half-way to the next circle's edge, which is as far beyond the middle as this one's before it.
  const double gap = std::max(spacing - 2 * semi_axis, 2.0);
  constexpr double kLeastMargin = 1.5, kMostMargin = 6;  // px; six show any sensible blur's foot
  const double margin = std::clamp(0.5 * gap, kLeastMargin, kMostMargin);
  std::vector<Pixel> pixels;
  const int r = static_cast<int>(std::ceil(3 * semi_axis + margin));
  for (int y = static_cast<int>(region->centre.y()) - r; y <= region->centre.y() + r; ++y) {
    for (int x = static_cast<int>(region->centre.x()) - r; x <= region->centre.x() + r; ++x) {
      if (x < 0 || y < 0 || x >= gray.cols || y >= gray.rows) continue;
      const Eigen::Vector2d q = Eigen::Vector2d(x, y) - region->centre;
      const Eigen::Vector2d Mq = M * q;
      const double F = std::sqrt(q.dot(Mq));
      const double outward = Mq.norm() > 0 ? (F - 1) * F / Mq.norm() : -semi_axis;
      // The interior of a large circle holds no information on its edge.
      if (outward > margin || outward < -margin) continue;
      pixels.push_back({static_cast<double>(x),
                        static_cast<double>(y),
                        static_cast<double>(gray.at<std::uint8_t>(y, x))});
    }
  }
  using Model = BlurredEllipse;
  Model::Params start = Model::Params::Zero();
  start[Model::kX] = region->centre.x();
  start[Model::kY] = region->centre.y();
  start[Model::kMxx] = M(0, 0);
  start[Model::kMxy] = M(0, 1);
  start[Model::kMyy] = M(1, 1);
  start[Model::kBlur] = 0.8;  // px, of a lens in focus
  start[Model::kA] = 0.5 * (region->inside + region->outside);
  start[Model::kB] = 0.5 * (region->inside - region->outside);
  if (pixels.size() < 2 * Model::kSize) return std::nullopt;
  const double reach = std::max(0.5 * semi_axis, 1.5);
  const auto fit = internal::FitPixels<Model::kSize>(Model(region->centre, reach), pixels, start);
  if (!fit || fit->explained < internal::kMinExplained) return std::nullopt;
  Circle circle;
  circle.p = fit->params.head<2>();
  circle.M << fit->params[Model::kMxx], fit->params[Model::kMxy], fit->params[Model::kMxy],
      fit->params[Model::kMyy];
  circle.sigma = std::sqrt(0.5 * (fit->covariance(0, 0) + fit->covariance(1, 1)) +
                           internal::kModelError * internal::kModelError);
  // Beyond these nothing was measured.
  constexpr double kMaxSigma = 0.5;          // px
  constexpr double kMaxRelativeSigma = 0.1;  // of the spacing
  if (circle.sigma > std::min(kMaxSigma, kMaxRelativeSigma * spacing)) return std::nullopt;
  return circle;
}

class CirclesDetector final : public MarkerDetector {
 public:
  CirclesDetector(const CirclesLayout& layout, const OtherTargets& others)
      : columns_(layout.columns),
        rows_(layout.rows),
        larger_(internal::LargerGrids(layout, others)),
        asymmetric_(layout.asymmetric) {}

  MarkerDetections Detect(const cv::Mat& gray) override {
    MarkerDetections found;
    constexpr int kMinPixelsPerCircle = 4;
    if (std::max(gray.cols, gray.rows) < kMinPixelsPerCircle * std::max(columns_, rows_) ||
        std::min(gray.cols, gray.rows) < kMinPixelsPerCircle * std::min(columns_, rows_)) {
      found.failure = fmt::format(
          "{} x {} pixels are too few for {} x {} circles", gray.cols, gray.rows, columns_, rows_);
      return found;
    }
    found.failure = fmt::format(
        "no {} grid of {} x {} circles found: only part of it is visible, or it is too blurred, "
        "too small or unevenly lit",
        asymmetric_ ? "asymmetric" : "symmetric",
        columns_,
        rows_);
    // Enlarged, smaller circles are found. Of large images that would take time for circles that
    // nobody has there.
    constexpr int kLargestEnlarged = 640;  // px
    for (const double scale : {1.0, 2.0, 0.5}) {
      if (scale > 1 && std::max(gray.cols, gray.rows) > kLargestEnlarged) continue;
      cv::Mat image = gray;
      if (scale != 1) {
        cv::resize(gray, image, {}, scale, scale, scale < 1 ? cv::INTER_AREA : cv::INTER_CUBIC);
      }
      for (const bool white : {false, true}) {
        const Places blobs = Blobs(image, white);
        for (const int clustering : {0, static_cast<int>(cv::CALIB_CB_CLUSTERING)}) {
          Places places = FindOwnGrid(blobs, image.size(), clustering);
          if (places.empty()) continue;
          for (cv::Point2f& p : places) {
            p.x = static_cast<float>((p.x + 0.5) / scale - 0.5);
            p.y = static_cast<float>((p.y + 0.5) / scale - 0.5);
          }
          MarkerDetections refined = Refine(gray, places);
          if (refined.failure.empty()) return refined;
          found.failure = refined.failure;
        }
      }
    }
    return found;
  }

 private:
  /// Blobs that may be circles of the grid.
  [[nodiscard]] Places Blobs(const cv::Mat& image, bool white) const {
    // As large as the circles of a grid that fills the image; OpenCV's own limit is 5000 px.
    const float most_area =
        static_cast<float>(image.total()) / static_cast<float>(columns_ * rows_);
    const std::vector<cv::KeyPoint> blobs = internal::FindBlobs(image, white, most_area);
    Places places;
    cv::KeyPoint::convert(blobs, places);
    return places;
  }

  /// A grid that is no part of a larger target's; empty: there is none.
  [[nodiscard]] Places FindOwnGrid(Places blobs, cv::Size size, int clustering) const {
    bool may_be_part = false;  // of one that is not in view as a whole
    for (const cv::Size& larger : larger_) {
      const Places places = FindGrid(blobs, larger, clustering);
      may_be_part = may_be_part || places.empty();
      Remove(places, &blobs);
    }
    for (;;) {
      Places places = FindGrid(blobs, {columns_, rows_}, clustering);
      if (places.empty() || !may_be_part || !MayBePart(places, blobs, size)) return places;
      Remove(places, &blobs);
    }
  }

  static void Remove(const Places& places, Places* blobs) {
    std::erase_if(*blobs, [&](const cv::Point2f& blob) {
      return std::ranges::find(places, blob) != places.end();
    });
  }

  /// Whether the grid goes on, or may do so beyond the image's border.
  [[nodiscard]] bool MayBePart(const Places& places, const Places& blobs, cv::Size size) const {
    std::vector<Eigen::Vector2d> points;
    for (const cv::Point2f& p : places) points.emplace_back(p.x, p.y);
    const auto sides = internal::NextPlaces(points, columns_);
    if (internal::MayGoOnOutside(sides, size.width, size.height)) return true;
    constexpr double kAtPlace =
        0.3;  // of the spacing; perspective from one circle to the next is less
    const double near = kAtPlace * (points[1] - points[0]).norm();
    return std::ranges::any_of(sides, [&](const std::vector<Eigen::Vector2d>& side) {
      const auto hits = std::ranges::count_if(side, [&](const Eigen::Vector2d& p) {
        return std::ranges::any_of(blobs, [&](const cv::Point2f& blob) {
          return (Eigen::Vector2d(blob.x, blob.y) - p).norm() < near;
        });
      });
      return 2 * hits > std::ssize(side);
    });
  }

  /// Empty: there is none of this size.
  [[nodiscard]] Places FindGrid(const Places& blobs, cv::Size grid, int clustering) const {
    // The search takes time with the cube of their number, and texture gives hundreds. Real images
    // of grids have shown at most two thirds more blobs than circles.
    const auto count = static_cast<std::size_t>(grid.area());
    const std::size_t most = 2 * count + 200;
    if (blobs.size() < count || blobs.size() > most) return {};
    const int kind = asymmetric_ ? cv::CALIB_CB_ASYMMETRIC_GRID : cv::CALIB_CB_SYMMETRIC_GRID;
    Places places;
    const bool all =
        cv::findCirclesGrid(blobs, grid, places, kind | clustering, cv::Ptr<cv::FeatureDetector>());
    return all && places.size() == count ? places : Places{};
  }

  [[nodiscard]] MarkerDetections Refine(const cv::Mat& gray, const Places& places) const {
    std::vector<Eigen::Vector2d> points;
    for (const cv::Point2f& p : places) points.emplace_back(p.x, p.y);
    const auto count = static_cast<int>(points.size());
    std::vector<std::optional<Circle>> circles;
    int refined = 0;
    for (const Eigen::Vector2d& p : points) {
      double spacing = std::numeric_limits<double>::max();
      for (const Eigen::Vector2d& other : points) {
        if (&other != &p) spacing = std::min(spacing, (other - p).norm());
      }
      circles.push_back(FitCircle(gray, p, spacing));
      refined += circles.back() ? 1 : 0;
    }
    MarkerDetections found;
    const std::optional<GridOrder> order = Canonical(points);
    if (2 * refined < count || !order) {
      found.failure = fmt::format(
          "a pattern of {} x {} places was found, but only {} of them look like circles of the "
          "grid: it is too blurred, too small or partly hidden",
          columns_,
          rows_,
          order ? refined : 0);
      return found;
    }
    for (int marker = 0; marker < count; ++marker) {
      const std::optional<Circle>& circle = circles[(*order)[marker]];
      if (!circle) {
        found.left_out.push_back(fmt::format(
            "circle {}: its edge is not an ellipse's (hidden, blurred or a reflection)", marker));
        continue;
      }
      const Eigen::Vector2d centre = ImageOfCentre(marker, circles, *order);
      found.markers.push_back(
          {.marker = marker, .values = {centre.x(), centre.y()}, .detector_sigma = circle->sigma});
    }
    return found;
  }

  /// Place of circle k of the grid on the board, in distances of its rows.
  [[nodiscard]] Eigen::Vector2d OnBoard(int k) const {
    const int row = k / columns_, column = k % columns_;
    return asymmetric_ ? Eigen::Vector2d(2 * column + row % 2, row) : Eigen::Vector2d(column, row);
  }

  /// From the ellipse's centre, by the homography from the circles around to the board and what it
  /// leaves of them, a polynomial: of third order, of second where there are few.
  [[nodiscard]] Eigen::Vector2d ImageOfCentre(int marker,
                                              const std::vector<std::optional<Circle>>& circles,
                                              const GridOrder& order) const {
    constexpr std::ptrdiff_t kAround = 20;
    std::vector<std::pair<double, int>> near;
    for (int k = 0; k < columns_ * rows_; ++k) {
      if (circles[order[k]]) near.emplace_back((OnBoard(k) - OnBoard(marker)).norm(), k);
    }
    std::sort(near.begin(), near.end());
    const bool third = std::min(columns_, rows_) > 3 && std::ssize(near) >= kAround;
    near.resize(static_cast<std::size_t>(std::min(std::ssize(near), kAround)));
    const Circle& circle = *circles[order[marker]];
    std::vector<cv::Point2d> board, image, ideal;
    for (const auto& [distance, k] : near) {
      const Eigen::Vector2d place = OnBoard(k) - OnBoard(marker);
      const Eigen::Vector2d seen = circles[order[k]]->p - circle.p;
      board.emplace_back(place.x(), place.y());
      image.emplace_back(seen.x(), seen.y());
    }
    const cv::Mat back = cv::findHomography(image, board);  // to the board
    if (back.empty()) return circle.p;
    cv::perspectiveTransform(board, ideal, back.inv());
    // The vanishing line, x . line + back_22 = 0 about the ellipse's centre.
    const Eigen::Vector2d line(back.at<double>(2, 0), back.at<double>(2, 1));
    return circle.p - circle.M.inverse() * line / back.at<double>(2, 2) -
           ShiftByDistortion(circle.M, ideal, image, third);
  }

  /// Displacement of the centre of an ellipse at the origin by the polynomial from `ideal` to
  /// `image`.
  static Eigen::Vector2d ShiftByDistortion(const Eigen::Matrix2d& M,
                                           const std::vector<cv::Point2d>& ideal,
                                           const std::vector<cv::Point2d>& image,
                                           bool third) {
    const std::ptrdiff_t count = std::ssize(ideal);
    Eigen::MatrixX3d linear(count, 3);
    Eigen::MatrixXd higher(count, third ? 7 : 3);
    Eigen::MatrixX2d shift(count, 2);
    const double unit = cv::norm(ideal.back());
    for (std::ptrdiff_t i = 0; i < count; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const double x = ideal[k].x / unit, y = ideal[k].y / unit;
      linear.row(i) << 1, x, y;
      higher.row(i).head<3>() << x * x / 2, x * y, y * y / 2;
      if (third) higher.row(i).tail<4>() << x * x * x, x * x * y, x * y * y, y * y * y;
      shift.row(i) << image[k].x - ideal[k].x, image[k].y - ideal[k].y;
    }
    // What is linear first: of two rows a curvature across them is zero.
    const Eigen::MatrixXd fit = PseudoInverse(linear);
    const Eigen::MatrixXd H =
        PseudoInverse(higher - linear * (fit * higher)) * (shift - linear * (fit * shift));
    const Eigen::Matrix2d J = Eigen::Matrix2d::Identity() +
                              (fit * (shift - higher * H)).bottomRows<2>().transpose() / unit;
    // The ellipse is A (cos t, sin t), its ideal image J^-1 of that.
    const Eigen::Matrix2d A = Eigen::Matrix2d(M.inverse()).llt().matrixL();
    const Eigen::Matrix2d of_circle = J.inverse() * A / unit;
    Eigen::Matrix2d by_coordinate[2];
    for (int j = 0; j < 2; ++j) {
      Eigen::Matrix2d second;
      second << H(0, j), H(1, j), H(1, j), H(2, j);
      by_coordinate[j] = of_circle.transpose() * second * of_circle;
    }
    const Eigen::Matrix2d B = A.inverse();
    const Eigen::Matrix2d K = B(0, 0) * by_coordinate[0] + B(0, 1) * by_coordinate[1];
    const Eigen::Matrix2d L = B(1, 0) * by_coordinate[0] + B(1, 1) * by_coordinate[1];
    const Eigen::Vector2d moved =
        A *
        Eigen::Vector2d(3 * K(0, 0) + K(1, 1) + 2 * L(0, 1), 3 * L(1, 1) + L(0, 0) + 2 * K(0, 1)) /
        8;
    return moved.allFinite() ? moved : Eigen::Vector2d::Zero();
  }

  /// Root mean square distance of the places from the nearest plane image of the grid, px.
  [[nodiscard]] double Misfit(const std::vector<Eigen::Vector2d>& points,
                              const GridOrder& order) const {
    std::vector<cv::Point2f> board, image, projected;
    for (int k = 0; k < columns_ * rows_; ++k) {
      const Eigen::Vector2d place = OnBoard(k);
      board.emplace_back(static_cast<float>(place.x()), static_cast<float>(place.y()));
      const Eigen::Vector2d& p = points[order[k]];
      image.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()));
    }
    const cv::Mat H = cv::findHomography(board, image);
    if (H.empty()) return std::numeric_limits<double>::max();
    cv::perspectiveTransform(board, projected, H);
    return cv::norm(projected, image) / std::sqrt(static_cast<double>(board.size()));
  }

  /// OpenCV's order of an asymmetric grid may begin at any corner, and with an even number of rows
  /// it has come with the rows of each pair exchanged. The order is the one that the offsets of the
  /// rows agree with.
  [[nodiscard]] std::optional<GridOrder> CanonicalAsymmetric(
      const std::vector<Eigen::Vector2d>& points, const GridOrder& found) const {
    std::vector<GridOrder> bases{found};
    if (rows_ % 2 == 0) {
      GridOrder exchanged(found.size());
      for (std::size_t k = 0; k < found.size(); ++k) {
        const std::size_t row = k / columns_;
        exchanged[k] = found[(row ^ 1) * columns_ + k % columns_];
      }
      bases.push_back(exchanged);
    }
    struct Candidate {
      GridOrder order;
      double misfit;
    };
    std::vector<Candidate> candidates;
    for (const GridOrder& base : bases) {
      for (const GridOrder& order : {base,
                                     internal::Rotated180(base),
                                     internal::RowsReversed(base, columns_),
                                     internal::ColumnsReversed(base, columns_)}) {
        if (internal::Handedness(points, order, columns_) > 0) {
          candidates.push_back({order, Misfit(points, order)});
        }
      }
    }
    if (candidates.empty()) return std::nullopt;
    const double best =
        std::min_element(candidates.begin(), candidates.end(), [](const auto& a, const auto& b) {
          return a.misfit < b.misfit;
        })->misfit;
    std::vector<GridOrder> fitting;
    for (const Candidate& candidate : candidates) {
      // A wrong order misses by about a circle's distance, a right one by the lens's distortion,
      // which is the same from either end.
      constexpr double kSameFit = 1.1, kRounding = 0.1;  // of the best misfit, px
      if (candidate.misfit < kSameFit * best + kRounding) fitting.push_back(candidate.order);
    }
    return internal::NearestTopLeft(points, fitting);
  }

  /// Nothing when the places cannot be the grid seen from its front.
  [[nodiscard]] std::optional<GridOrder> Canonical(
      const std::vector<Eigen::Vector2d>& points) const {
    GridOrder first = internal::FoundOrder(columns_, rows_);
    if (asymmetric_) return CanonicalAsymmetric(points, first);
    const bool mirrored = internal::Handedness(points, first, columns_) < 0;
    if (mirrored) first = internal::RowsReversed(first, columns_);
    std::vector<GridOrder> orders{first, internal::Rotated180(first)};
    if (columns_ == rows_) {
      orders.push_back(internal::Rotated90(first, rows_));
      orders.push_back(internal::Rotated180(orders.back()));
    }
    return internal::NearestTopLeft(points, orders);
  }

  int columns_, rows_;
  std::vector<cv::Size> larger_;  // others of which this grid may be a part
  bool asymmetric_;
};

}  // namespace

std::unique_ptr<MarkerDetector> MakeDetector(const CirclesLayout& layout,
                                             const Target& /*target*/,
                                             const OtherTargets& others) {
  return std::make_unique<CirclesDetector>(layout, others);
}

std::vector<internal::MarkerTemplate> internal::MakeTemplates(
    const CirclesLayout& layout, const Target& target, const std::vector<Observation>& found) {
  return DiscTemplates(
      {.nearest = layout.NearestDistance(), .radius = layout.DrawnRadius()}, target, found);
}

}  // namespace plenocal
