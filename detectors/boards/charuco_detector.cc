// SPDX-License-Identifier: Apache-2.0
#include "detectors/boards/charuco_detector.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <opencv2/aruco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "calib/base/format_error.h"
#include "detectors/tag_assignment/assign_tags.h"
#include "detectors/templates/saddle.h"

// OpenCV finds and reads the ArUco markers; their positions on the board, the corners between them
// and the positions of these in the image are computed here, because OpenCV has drawn the board in
// two ways (see CharucoLayout). Coordinates on the board are in squares, from its top left corner,
// x right, y down.

namespace plenocal {
namespace {

using internal::CornerGrid;

/// A marker of the board as seen in the image.
struct SeenMarker {
  Eigen::Vector2i square;                   ///< column, row on the board
  std::array<cv::Point2f, 4> board, image;  ///< corners: squares, px
  [[nodiscard]] Eigen::Vector2d Centre() const { return square.cast<double>().array() + 0.5; }
};

/// Which squares hold which markers.
class Layout {
 public:
  Layout(const CharucoLayout& board, bool legacy)
      : legacy_(legacy),
        gap_(0.5 * (1 - board.marker / board.square)),
        squares_(internal::MarkedSquares(board, legacy)) {}

  [[nodiscard]] std::string Name() const { return legacy_ ? "legacy layout" : "new layout"; }
  /// Share of a square between its border and its marker.
  [[nodiscard]] double gap() const { return gap_; }
  /// Of column + row of the white squares.
  [[nodiscard]] int white_parity() const { return squares_.front().sum() % 2; }
  [[nodiscard]] const Eigen::Vector2i& square(int id) const {
    return squares_[static_cast<std::size_t>(id)];
  }
  [[nodiscard]] int marker_count() const { return static_cast<int>(squares_.size()); }
  /// All markers, in squares.
  [[nodiscard]] internal::TagPositions Markers() const {
    internal::TagPositions markers;
    for (int id = 0; id < marker_count(); ++id) {
      const SeenMarker marker = Place(id, std::vector<cv::Point2f>(4));
      for (std::size_t k = 0; k < 4; ++k) {
        markers[id][k] = {marker.board[k].x, marker.board[k].y, 0};
      }
    }
    return markers;
  }

  [[nodiscard]] SeenMarker Place(int id, const std::vector<cv::Point2f>& corners) const {
    SeenMarker marker;
    marker.square = squares_[id];
    const auto x = static_cast<float>(marker.square.x()), y = static_cast<float>(marker.square.y());
    const auto lo = static_cast<float>(gap_), hi = static_cast<float>(1 - gap_);
    marker.board = {
        cv::Point2f{x + lo, y + lo}, {x + hi, y + lo}, {x + hi, y + hi}, {x + lo, y + hi}};
    std::copy_n(corners.begin(), 4, marker.image.begin());
    return marker;
  }

 private:
  bool legacy_;
  double gap_;
  std::vector<Eigen::Vector2i> squares_;
};

/// Markers close enough on the board to be compared: the diagonal neighbours and the next in the
/// same row or column.
constexpr double kNear = 2.3;

/// Where `other`'s centre is expected by the affine map of `marker`, in squares from where it is.
double Misplaced(const SeenMarker& marker, const SeenMarker& other) {
  const auto vector = [](cv::Point2f p) { return Eigen::Vector2d(p.x, p.y); };
  const auto& q = marker.image;
  Eigen::Matrix2d A;  // px per square
  const double side = marker.board[1].x - marker.board[0].x;
  A.col(0) = 0.5 / side * (vector(q[1]) - vector(q[0]) + vector(q[2]) - vector(q[3]));
  A.col(1) = 0.5 / side * (vector(q[3]) - vector(q[0]) + vector(q[2]) - vector(q[1]));
  const auto centre = [&](const SeenMarker& m) {
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    for (const cv::Point2f& p : m.image) sum += vector(p);
    return Eigen::Vector2d(0.25 * sum);
  };
  const Eigen::Vector2d expected = centre(marker) + A * (other.Centre() - marker.Centre());
  return (expected - centre(other)).norm() / std::sqrt(std::abs(A.determinant()));
}

/// The markers that agree with their neighbours on the board, and how many such agreements there
/// are. A wrong layout puts diagonal neighbours two squares from where they are.
struct Consistent {
  std::vector<SeenMarker> markers;
  int agreements = 0;
};

Consistent FindConsistent(const std::vector<SeenMarker>& markers) {
  constexpr double kTolerance = 0.7;  // squares: perspective and distortion over two squares
  Consistent consistent;
  for (const SeenMarker& marker : markers) {
    int agree = 0, disagree = 0;
    for (const SeenMarker& other : markers) {
      const double distance = (other.Centre() - marker.Centre()).norm();
      if (&other == &marker || distance > kNear) continue;
      const bool fits = Misplaced(marker, other) < kTolerance &&
                        Misplaced(other, marker) < kTolerance && distance > 0;
      ++(fits ? agree : disagree);
    }
    if (agree == 0 || disagree > agree) continue;
    consistent.markers.push_back(marker);
    consistent.agreements += agree;
  }
  return consistent;
}

/// Place of an inner corner (in squares) by the markers around it.
std::optional<Eigen::Vector2d> Predict(const std::vector<SeenMarker>& markers,
                                       const Eigen::Vector2d& corner) {
  constexpr double kAdjacent = 0.8;  // squares, centre to corner: 0.71
  constexpr double kAround = 1.7;    // the next ones: 1.58
  std::vector<const SeenMarker*> adjacent, around;
  for (const SeenMarker& marker : markers) {
    const double distance = (marker.Centre() - corner).norm();
    if (distance < kAdjacent) adjacent.push_back(&marker);
    if (distance < kAround) around.push_back(&marker);
  }
  if (adjacent.empty() && around.size() < 2) return std::nullopt;
  // Between two the corner is interpolated; farther markers would only add the lens's distortion.
  const auto& used = adjacent.size() == 2 ? adjacent : around;
  std::vector<cv::Point2f> board, image;
  for (const SeenMarker* marker : used) {
    board.insert(board.end(), marker->board.begin(), marker->board.end());
    image.insert(image.end(), marker->image.begin(), marker->image.end());
  }
  const cv::Mat H = cv::findHomography(board, image);
  if (H.empty()) return std::nullopt;
  std::vector<cv::Point2f> place;
  cv::perspectiveTransform(
      std::vector<cv::Point2f>{{static_cast<float>(corner.x()), static_cast<float>(corner.y())}},
      place,
      H);
  return Eigen::Vector2d(place[0].x, place[0].y);
}

/// Those that the board may have.
std::vector<Layout> LayoutsOf(const CharucoLayout& board) {
  if (board.rows % 2 != 0) return {Layout(board, false)};  // `legacy` changes nothing
  if (board.legacy) return {Layout(board, *board.legacy)};
  return {Layout(board, false), Layout(board, true)};
}

/// Markers as OpenCV reads them.
struct ReadMarkers {
  std::vector<int> ids;
  std::vector<std::vector<cv::Point2f>> corners;  ///< px
};

class CharucoDetector final : public MarkerDetector {
 public:
  CharucoDetector(const CharucoLayout& board, const OtherTargets& others)
      : board_(board),
        dictionary_(cv::makePtr<cv::aruco::Dictionary>(
            cv::aruco::getPredefinedDictionary(internal::ArucoDictionaryIndex(board.dictionary)))),
        layouts_(LayoutsOf(board)) {
    const int available = dictionary_->bytesList.rows;
    for (const Layout& layout : layouts_) {
      if (layout.marker_count() <= available) continue;
      throw InputError(
          "dictionary: {} has {} markers, but a board of {} x {} squares "
          "needs {}; choose a larger one",
          board.dictionary,
          available,
          board.columns,
          board.rows,
          layout.marker_count());
    }
    if (others.targets.empty()) return;
    for (const Layout& layout : layouts_) targets_.push_back(layout.Markers());
    for (const Target& other : others.targets) {
      for (const Layout& layout : LayoutsOf(std::get<CharucoLayout>(other.layout))) {
        targets_.push_back(layout.Markers());
      }
    }
  }

  MarkerDetections Detect(const cv::Mat& gray) override {
    MarkerDetections found;
    constexpr int kMinSize = 32;  // px; a board of two squares with markers of 4 x 4 bits
    if (std::min(gray.cols, gray.rows) < kMinSize) {
      found.failure =
          fmt::format("{} x {} pixels are too few for a ChArUco board", gray.cols, gray.rows);
      return found;
    }
    found = DetectOneWay(gray);
    if (!found.failure.empty()) {
      // Printed white on black.
      MarkerDetections inverted = DetectOneWay(255 - gray);
      if (inverted.failure.empty() || !inverted.by_layout.empty()) return inverted;
    }
    return found;
  }

 private:
  /// `gray`: markers black on white.
  MarkerDetections DetectOneWay(const cv::Mat& gray) {
    ReadMarkers read;
    cv::aruco::detectMarkers(gray, dictionary_, read.corners, read.ids, parameters_);

    MarkerDetections found;
    if (!targets_.empty()) read = OwnOf(read, &found.left_out);
    const auto& [ids, corners] = read;
    std::vector<Consistent> consistent;  // by layout
    for (const Layout& layout : layouts_) {
      std::vector<SeenMarker> markers;
      for (std::size_t k = 0; k < ids.size(); ++k) {
        if (ids[k] < layout.marker_count()) markers.push_back(layout.Place(ids[k], corners[k]));
      }
      consistent.push_back(FindConsistent(markers));
    }
    const int first = consistent.front().agreements, last = consistent.back().agreements;
    if (std::max(first, last) == 0) {
      found.failure = fmt::format(
          "no ChArUco board found: {} of its {} markers ({}) were read, and at least two "
          "neighbours must be",
          ids.size(),
          layouts_.front().marker_count(),
          board_.dictionary);
      return found;
    }
    const auto measure = [&](std::size_t k) {
      MarkerDetections measured = found;
      if (layouts_.size() > 1) measured.layout = layouts_[k].Name();
      Measure(gray, layouts_[k], consistent[k].markers, &measured);
      return measured;
    };
    if (layouts_.size() > 1 && first == last) {
      found.by_layout = {measure(0), measure(1)};
      found.failure =
          "the few markers in view fit both layouts of OpenCV's ChArUco boards; state legacy: "
          "true or false in the target file";
      return found;
    }
    MarkerDetections decided = measure(last > first ? 1 : 0);
    decided.layout_evidence = std::abs(last - first);
    return decided;
  }

  /// Those of this board, where others with the same markers may be in the image.
  [[nodiscard]] ReadMarkers OwnOf(const ReadMarkers& all,
                                  std::vector<std::string>* left_out) const {
    std::vector<internal::ReadTag> read;
    for (std::size_t i = 0; i < all.ids.size(); ++i) {
      internal::ReadTag& quad = read.emplace_back();
      quad.id = all.ids[i];
      for (std::size_t k = 0; k < 4; ++k)
        quad.corners[k] = {all.corners[i][k].x, all.corners[i][k].y};
    }
    const std::vector<internal::TagOwner> owners = internal::AssignTags(read, targets_);
    ReadMarkers own;
    std::set<int> undecided;
    for (std::size_t i = 0; i < owners.size(); ++i) {
      if (owners[i].target && *owners[i].target < layouts_.size()) {
        own.ids.push_back(all.ids[i]);
        own.corners.push_back(all.corners[i]);
      } else if (owners[i].fits_several) {
        undecided.insert(all.ids[i]);
      }
    }
    for (const int id : undecided) left_out->push_back(internal::FitsSeveral("marker", id));
    return own;
  }

  void Measure(const cv::Mat& gray,
               const Layout& layout,
               const std::vector<SeenMarker>& markers,
               MarkerDetections* found) const {
    const int columns = board_.columns - 1, rows = board_.rows - 1;
    std::vector<std::optional<Eigen::Vector2d>> guesses;
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        guesses.push_back(Predict(markers, {column + 1.0, row + 1.0}));
      }
    }
    // Corner 0 has the squares (0, 0) and (1, 1) in the quadrants of equal signs.
    const int first_marked = layout.white_parity() == 0 ? 1 : -1;
    const CornerGrid grid =
        internal::RefineGrid(gray, columns, rows, guesses, layout.gap(), first_marked);
    for (int corner = 0; corner < columns * rows; ++corner) {
      if (!guesses[corner]) continue;
      const bool inside = guesses[corner]->x() >= 0 && guesses[corner]->x() <= gray.cols - 1 &&
                          guesses[corner]->y() >= 0 && guesses[corner]->y() <= gray.rows - 1;
      const auto& saddle = grid.corners[corner];
      const int marked =
          (corner / columns + corner % columns) % 2 == 0 ? first_marked : -first_marked;
      if (!saddle || (saddle->contrast > 0) != (marked > 0)) {
        if (inside) {
          found->left_out.push_back(
              fmt::format("corner {}: no clear crossing of edges where the markers place it "
                          "(hidden, blurred or a reflection)",
                          corner));
        }
        continue;
      }
      found->markers.push_back({.marker = corner,
                                .values = {saddle->p.x(), saddle->p.y()},
                                .detector_sigma = saddle->sigma});
    }
    if (found->markers.empty()) {
      found->failure = fmt::format(
          "{} markers of the ChArUco board were read, but no corner between them is clear: the "
          "image is too blurred or the board too small in it",
          markers.size());
    }
  }

  CharucoLayout board_;
  cv::Ptr<cv::aruco::Dictionary> dictionary_;
  const cv::Ptr<cv::aruco::DetectorParameters> parameters_ =
      cv::makePtr<cv::aruco::DetectorParameters>();
  std::vector<Layout> layouts_;
  std::vector<internal::TagPositions> targets_;  // its own layouts, then its others'; empty: none
};

}  // namespace

std::unique_ptr<MarkerDetector> MakeDetector(const CharucoLayout& layout,
                                             const Target& /*target*/,
                                             const OtherTargets& others) {
  return std::make_unique<CharucoDetector>(layout, others);
}

}  // namespace plenocal
