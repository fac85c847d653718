// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <functional>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "detectors/grid_order.h"
#include "detectors/marker_detector.h"
#include "detectors/saddle.h"

// Which corner is number 0. The inner corners' lattice (columns x rows) is symmetric under a turn
// by 180 degrees, a square one by 90; the colours may tell the places apart. We ask that the outer
// square at corner 0 be black, as on OpenCV's printed pattern:
//
//   columns + rows odd              always decided: the squares at opposite ends differ in colour
//   columns = rows, both odd        decided up to 180 degrees
//   otherwise                       the colours are the same after every turn
//
// Where more than one place remains, the corner nearest the image's top left is 0. That is all one
// image tells: of a rig's cameras, or of frames, that see such a board turned by more than 90
// degrees against each other, each may begin at another end. A board with columns + rows odd avoids
// it.

namespace plenocal {
namespace {

using internal::CornerGrid;
using internal::GridOrder;
using internal::Saddle;
using Places = std::vector<cv::Point2f>;

/// An image scaled by `scale`, pixel centres at integers, so that x = (x_scaled + 0.5) / scale -
/// 0.5.
Places FindScaled(const cv::Mat& gray,
                  double scale,
                  const std::function<Places(const cv::Mat&)>& find) {
  if (scale == 1) return find(gray);
  cv::Mat scaled;
  cv::resize(gray, scaled, {}, scale, scale, scale < 1 ? cv::INTER_AREA : cv::INTER_CUBIC);
  Places places = find(scaled);
  for (cv::Point2f& p : places) {
    p.x = static_cast<float>((p.x + 0.5) / scale - 0.5);
    p.y = static_cast<float>((p.y + 0.5) / scale - 0.5);
  }
  return places;
}

class ChessboardDetector final : public MarkerDetector {
 public:
  explicit ChessboardDetector(const ChessboardLayout& layout)
      : columns_(layout.columns), rows_(layout.rows) {}

  MarkerDetections Detect(const cv::Mat& gray) override {
    MarkerDetections found;
    constexpr int kMinPixelsPerSquare = 3;
    if (std::max(gray.cols, gray.rows) < kMinPixelsPerSquare * std::max(columns_, rows_) ||
        std::min(gray.cols, gray.rows) < kMinPixelsPerSquare * std::min(columns_, rows_)) {
      found.failure = fmt::format("{} x {} pixels are too few for a {} x {} chessboard",
                                  gray.cols,
                                  gray.rows,
                                  columns_,
                                  rows_);
      return found;
    }
    found.failure = fmt::format(
        "no {} x {} chessboard found (inner corners): only part of it is visible, or it is too "
        "blurred, too small or unevenly lit",
        columns_,
        rows_);
    for (const auto& search : Searches(gray)) {
      const Places places = search();
      if (places.size() != static_cast<std::size_t>(columns_) * rows_) continue;
      MarkerDetections refined = Refine(gray, places);
      if (refined.failure.empty()) return refined;
      found.failure = refined.failure;
    }
    return found;
  }

 private:
  /// From the fastest to the last resort. The classic finder finds more boards in wide-angle images
  /// than SB and takes a tenth of its time; SB copes better with blur and noise.
  [[nodiscard]] std::vector<std::function<Places()>> Searches(const cv::Mat& gray) const {
    const auto classic = [this](const cv::Mat& image) {
      Places places;
      const bool all =
          cv::findChessboardCorners(image,
                                    {columns_, rows_},
                                    places,
                                    cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE);
      return all ? places : Places{};
    };
    const auto sector_based = [this](const cv::Mat& image) {
      Places places;
      const bool all = cv::findChessboardCornersSB(
          image, {columns_, rows_}, places, cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_EXHAUSTIVE);
      return all ? places : Places{};
    };
    const auto local_contrast = [](const cv::Mat& image) {
      cv::Mat equalized;
      cv::createCLAHE(4.0, {8, 8})->apply(image, equalized);
      return equalized;
    };
    // The finders' windows and morphology are in pixels, and an image without a board costs them
    // some 20 s at 24 megapixels. So large images are searched reduced, with a second look at twice
    // that size for small boards; the corners are measured in the full image all the same.
    constexpr double kWorkingSize = 1280;
    const double size = std::max(gray.cols, gray.rows);
    const double work = std::min(1.0, kWorkingSize / size);
    const double other = size > kWorkingSize / 2 ? 0.5 * work : 2;
    const auto scaled = [&gray](double scale, const std::function<Places(const cv::Mat&)>& find) {
      return std::function<Places()>([=] { return FindScaled(gray, scale, find); });
    };
    std::vector<std::function<Places()>> searches{scaled(work, classic)};
    if (work < 1) searches.push_back(scaled(std::min(1.0, 2 * work), classic));
    searches.push_back(scaled(other, classic));
    searches.push_back(
        scaled(work, [=](const cv::Mat& image) { return classic(local_contrast(image)); }));
    searches.push_back(scaled(work, sector_based));
    searches.push_back(scaled(other, sector_based));
    return searches;
  }

  /// Measures the corners and numbers them; `failure` when they are not a chessboard's.
  [[nodiscard]] MarkerDetections Refine(const cv::Mat& gray, const Places& places) const {
    std::vector<Eigen::Vector2d> points;
    for (const cv::Point2f& p : places) points.emplace_back(p.x, p.y);
    const std::vector<std::optional<Eigen::Vector2d>> guesses(points.begin(), points.end());
    const CornerGrid grid = internal::RefineGrid(gray, columns_, rows_, guesses);

    // On a chessboard the contrast alternates from corner to corner.
    int refined = 0, even_bright = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (!grid.corners[i]) continue;
      ++refined;
      even_bright += IsEven(i) == (grid.corners[i]->contrast > 0) ? 1 : 0;
    }
    MarkerDetections found;
    const auto count = static_cast<int>(points.size());
    const bool bright = 2 * even_bright > refined;
    const int agreeing = bright ? even_bright : refined - even_bright;
    if (agreeing < refined || 2 * refined < count) {
      found.failure = fmt::format(
          "a pattern of {} x {} places was found, but only {} of them look like corners of a "
          "chessboard: the board is too blurred, too small or partly hidden",
          columns_,
          rows_,
          agreeing);
      return found;
    }

    const GridOrder order = Canonical(points, bright);
    for (int marker = 0; marker < count; ++marker) {
      const std::optional<Saddle>& corner = grid.corners[order[marker]];
      if (!corner) {
        found.left_out.push_back(fmt::format(
            "corner {}: no clear crossing of edges there (hidden, blurred or a reflection)",
            marker));
        continue;
      }
      Observation observation;
      observation.marker = marker;
      observation.values = {corner->p.x(), corner->p.y()};
      observation.sigma = corner->sigma;
      found.markers.push_back(observation);
    }
    return found;
  }

  [[nodiscard]] bool IsEven(std::size_t index) const {
    return (index / columns_ + index % columns_) % 2 == 0;
  }

  /// `bright`: the outer square at the first point found is bright. (Mirroring a row swaps the
  /// quadrants and, with an even number of columns, the parity.)
  [[nodiscard]] GridOrder Canonical(const std::vector<Eigen::Vector2d>& points, bool bright) const {
    GridOrder found = internal::FoundOrder(columns_, rows_);
    bool first_bright = bright;
    if (internal::Handedness(points, found, columns_) < 0) {
      found = internal::RowsReversed(found, columns_);
      if (columns_ % 2 != 0) first_bright = !first_bright;
    }
    struct Turn {
      GridOrder order;
      bool bright;
    };
    const bool other_end_differs = (columns_ + rows_) % 2 != 0;
    std::vector<Turn> turns{{found, first_bright},
                            {internal::Rotated180(found), first_bright != other_end_differs}};
    if (columns_ == rows_) {
      // A quarter turn swaps the quadrants, and with an even size the parity too.
      const bool turned_bright = first_bright != (rows_ % 2 != 0);
      const GridOrder turned = internal::Rotated90(found, rows_);
      turns.push_back({turned, turned_bright});
      turns.push_back({internal::Rotated180(turned), turned_bright});
    }
    std::vector<GridOrder> black, any;
    for (const Turn& turn : turns) {
      any.push_back(turn.order);
      if (!turn.bright) black.push_back(turn.order);
    }
    return internal::NearestTopLeft(points, black.empty() ? any : black);
  }

  int columns_, rows_;
};

}  // namespace

std::unique_ptr<MarkerDetector> MakeChessboardDetector(const Target& target) {
  return std::make_unique<ChessboardDetector>(std::get<ChessboardLayout>(target.layout));
}

}  // namespace plenocal
