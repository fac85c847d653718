// SPDX-License-Identifier: Apache-2.0
//
// Markers and tags that are not where the target's file puts them, tags of another size, whose
// corners have another order, or that exist twice.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "assess/causes/cause.h"
#include "assess/target/frame_choice.h"
#include "assess/target/plane_view.h"
#include "assess/views/projection_jacobian.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"
#include "calib/camera/corner_orders.h"

namespace plenocal {
namespace {

constexpr double kMovedFalseAlarm = 1e-4;  // of all markers of a session together
constexpr double kStandardErrors = 6;
constexpr double kNoises = 3;  // less cannot be seen in one image
// A pose takes the place of a target most of whose pieces have moved.
constexpr double kMostMoved = 0.5;

/// A marker in one view.
struct Offset {
  Eigen::Vector2d offset{0, 0};  ///< from its nominal position along the piece's axes, m
  double gain = 0;               ///< px per m
};

/// Index of a view (frame, camera) -> offset.
using Offsets = std::map<size_t, Offset>;

/// Axes in which a marker's offsets are measured.
using Axes = Eigen::Matrix<double, 3, 2>;

struct Sums {
  Eigen::Matrix2d square = Eigen::Matrix2d::Zero();
  Eigen::Vector2d right{0, 0};
  int count = 0;
};

// Of the residuals of each marker in each view of a camera, by its first observation, with their
// derivatives by a displacement along the axes.
std::map<size_t, Sums> SumsOfMarkers(const Bundle& bundle,
                                     size_t c,
                                     const std::map<int, Axes>& axes_of) {
  struct Place {
    size_t first;  // observation
    Axes axes;     // in the camera's frame
  };
  std::map<size_t, Sums> sums;
  const BundleCamera& camera = bundle.cameras[c];
  if (camera.model->measured.size() != 2) return sums;
  std::vector<ObservedPoint> points;
  std::vector<Place> places;
  const std::vector<BundleObservation>& observations = bundle.observations;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    end = EndOfMarker(observations, begin);
    const BundleObservation& first = observations[begin];
    const BundleMarker& marker = bundle.markers[static_cast<size_t>(first.marker)];
    const auto axes = axes_of.find(marker.number);
    if (first.camera != static_cast<int>(c) || axes == axes_of.end()) continue;
    const RigidTransform T =
        camera.T_camera_rig * bundle.SeenPose(static_cast<size_t>(first.frame), c);
    for (size_t i = begin; i < end; ++i) {
      points.push_back({observations[i].seen.values, T * marker.position});
      places.push_back({begin, T.R * axes->second});
    }
  }
  DifferentiateEach(camera, points, [&](size_t i, const ProjectionJacobian& projected) {
    const Eigen::Vector2d residual =
        Eigen::Map<const Eigen::Vector2d>(points[i].values.data()) - projected.predicted;
    const Eigen::Matrix2d J = projected.by_point * places[i].axes;
    Sums& of_marker = sums[places[i].first];
    of_marker.square += J.transpose() * J;
    of_marker.right += J.transpose() * residual;
    ++of_marker.count;
  });
  return sums;
}

// Offsets of the markers of `axes_of`, in all views.
std::map<int, Offsets> MeasureOffsets(const Bundle& bundle, const std::map<int, Axes>& axes_of) {
  std::map<int, Offsets> offsets;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    for (const auto& [place, sums] : SumsOfMarkers(bundle, c, axes_of)) {
      // A plane seen edge on.
      constexpr double kSteep = 1e-3;
      if (!(sums.square.determinant() > kSteep * std::pow(sums.square.trace(), 2))) continue;
      const BundleObservation& first = bundle.observations[place];
      const BundleMarker& marker = bundle.markers[static_cast<size_t>(first.marker)];
      Offset& offset = offsets[marker.number][bundle.View(static_cast<size_t>(first.frame), c)];
      offset.offset = sums.square.inverse() * sums.right +
                      axes_of.at(marker.number).transpose() * (marker.position - marker.nominal);
      offset.gain = std::sqrt(sums.square.trace() / 2 / sums.count);
    }
  }
  return offsets;
}

/// Median over the views and its standard error.
struct Typical {
  double value = 0, sigma = 0;
};

Typical TypicalOf(const std::vector<double>& values) {
  const double median = Median(values);
  std::vector<double> deviations;
  for (const double value : values) deviations.push_back(std::abs(value - median));
  // A median's standard error is that of the mean by sqrt(pi / 2).
  constexpr double kOfMedian = 1.2533;
  return {median,
          kOfMedian * kSigmaPerMad * Median(deviations) /
              std::sqrt(static_cast<double>(values.size()))};
}

/// A piece of the target (a tag, a board's marker) with its displacement over the views.
struct Piece {
  int number = 0;                  ///< tag's id or marker's number
  double side = 0;                 ///< m; 0: a marker
  Eigen::Vector3d place{0, 0, 0};  ///< nominal, m
  Axes axes;                       ///< of `x` and `y`
  size_t views = 0;                ///< in which it was measured
  Typical x = {}, y = {};          ///< displacement, m
  Typical scale = {};              ///< 1: twice the size
  double shift = 0;  ///< length of the displacement beside what is smooth over the target, m
  double gain = 0;   ///< px per m
  size_t far = 0, near = 0;  ///< views with a displacement above half a side, below a fifth
  std::array<size_t, kCornerOrders.size()> orders{};  ///< views that show this order of the corners

  [[nodiscard]] double ShiftSigma() const { return std::max(x.sigma, y.sigma); }
  /// Of a displacement in one view, px.
  [[nodiscard]] double Scatter() const {
    return gain * std::hypot(x.sigma, y.sigma) * std::sqrt(static_cast<double>(views) / 2);
  }
};

void Summarise(const std::vector<Eigen::Vector3d>& motions,
               const std::vector<double>& gains,
               Piece* piece) {
  const auto column = [&](Eigen::Index k) {
    std::vector<double> values;
    for (const Eigen::Vector3d& motion : motions) values.push_back(motion[k]);
    return TypicalOf(values);
  };
  piece->views = motions.size();
  piece->x = column(0);
  piece->y = column(1);
  piece->scale = column(2);
  piece->gain = Median(gains);
  piece->shift = std::hypot(piece->x.value, piece->y.value);
}

constexpr size_t kLeastPieceViews = 3;  // of a piece

using Corners = std::array<Eigen::Vector2d, 4>;

// Least-squares similarity of a tag's seen corners: displacement and relative size.
Eigen::Vector3d Similarity(const Corners& corners, const std::array<const Offset*, 4>& seen) {
  Eigen::MatrixXd A(8, 4);
  Eigen::VectorXd b(8);
  Eigen::Index row = 0;
  for (size_t k = 0; k < 4; ++k) {
    if (seen[k] == nullptr) continue;
    A.row(row) << 1, 0, corners[k].x(), -corners[k].y();
    A.row(row + 1) << 0, 1, corners[k].y(), corners[k].x();
    b.segment<2>(row) = seen[k]->offset;
    row += 2;
  }
  const Eigen::VectorXd motion =
      LeastSquares(Eigen::MatrixXd(A.topRows(row)), Eigen::VectorXd(b.head(row)));
  return {motion[0], motion[1], motion[2]};
}

// The order of corners (index into `kCornerOrders`) that explains nearly all of the offsets.
std::optional<size_t> SeenOrder(const Corners& corners, const std::array<const Offset*, 4>& seen) {
  constexpr double kRemains = 0.05;  // of the squares
  std::optional<size_t> best;
  double least = 0;
  for (size_t k = 0; k < 4; ++k) least += kRemains * seen[k]->offset.squaredNorm();
  for (size_t i = 0; i < kCornerOrders.size(); ++i) {
    double sum = 0;
    for (size_t k = 0; k < 4; ++k) {
      const Eigen::Vector2d expected = corners[kCornerOrders[i][k]] - corners[k];
      sum += (seen[k]->offset - expected).squaredNorm();
    }
    if (sum < least) least = sum, best = i;
  }
  return best;
}

Piece TagPiece(const std::array<int, 4>& quad,
               const Corners& corners,
               const std::map<int, Offsets>& offsets) {
  Piece piece;
  piece.number = quad[0] / 4;
  piece.side = (corners[1] - corners[0]).norm();
  std::map<size_t, std::array<const Offset*, 4>> views;
  for (size_t k = 0; k < 4; ++k) {
    const auto found = offsets.find(quad[k]);
    if (found == offsets.end()) continue;
    for (const auto& [view, offset] : found->second) views[view][k] = &offset;
  }
  std::vector<Eigen::Vector3d> motions;
  std::vector<double> gains;
  for (const auto& [view, seen] : views) {
    const auto count = std::ranges::count_if(seen, [](const Offset* o) { return o != nullptr; });
    if (count < 3) continue;
    const Eigen::Vector3d motion = Similarity(corners, seen);
    const double shift = motion.head<2>().norm();
    if (shift > piece.side / 2) ++piece.far;
    if (shift < piece.side / 5) ++piece.near;
    if (count == 4) {
      if (const std::optional<size_t> order = SeenOrder(corners, seen)) ++piece.orders[*order];
    }
    motions.push_back(motion);
    gains.push_back(
        (*std::ranges::find_if(seen, [](const Offset* o) { return o != nullptr; }))->gain);
  }
  if (motions.size() >= kLeastPieceViews) Summarise(motions, gains, &piece);
  return piece;
}

// Length that one of `count` displacements exceeds by chance once in 1 / kMovedFalseAlarm sessions.
double ChanceLimit(double sigma, size_t count) {
  return sigma * std::sqrt(-2 * std::log(kMovedFalseAlarm / static_cast<double>(count)));
}

/// Pieces with one defect, as one finding.
struct Defect {
  Finding finding;                 ///< `what` lacks the list of the pieces
  std::vector<std::string> parts;  ///< "tag 7 by 2.1 mm"

  void Add(std::string part, double value) {
    parts.push_back(std::move(part));
    finding.value = std::max(finding.value.value_or(0), value);
  }
  void AddTo(std::vector<Finding>* findings) {
    if (parts.empty()) return;
    constexpr size_t kMost = 5;
    const auto shown = std::span(parts).first(std::min(kMost, parts.size()));
    finding.what +=
        fmt::format(": {}{}",
                    fmt::join(shown, ", "),
                    parts.size() > kMost ? fmt::format(" and {} more", parts.size() - kMost) : "");
    findings->push_back(std::move(finding));
  }
};

// Sorts the pieces that stand out by their defects.
class Sorting {
 public:
  // `tolerance`: standard deviation that the target states for its coordinates, m; 0: none.
  Sorting(const std::vector<Piece>& pieces, double tolerance)
      : pieces_(pieces), tolerance_(tolerance) {
    std::vector<double> shifts, scales, scatters;
    for (const Piece& piece : pieces) {
      shifts.push_back(piece.shift);
      scatters.push_back(piece.Scatter());
      scales.push_back(std::abs(piece.scale.value));
    }
    moved_.finding.limit = ChanceLimit(kSigmaPerMedianLength2d * Median(shifts), pieces.size());
    size_.finding.limit = ChanceLimit(kSigmaPerMad * Median(scales), pieces.size());
    noise_ = Median(scatters);
    for (const Piece& piece : pieces) Sort(piece);
  }

  std::vector<Finding> Findings() {
    const std::array defects{&twice_, &order_, &size_, &moved_};
    size_t all = 0;
    for (const Defect* defect : defects) all += defect->parts.size();
    std::vector<Finding> findings;
    if (static_cast<double>(all) > kMostMoved * static_cast<double>(pieces_.size())) return {};
    for (Defect* defect : defects) defect->AddTo(&findings);
    return findings;
  }

 private:
  void Sort(const Piece& piece) {
    const bool tag = piece.side > 0;
    const std::string name = fmt::format("{} {}", tag ? "tag" : "marker", piece.number);
    if (tag && SortSpecialTag(piece, name)) return;
    const double shift = piece.shift, change = piece.scale.value * piece.side;
    const auto counts = [&](double length, double sigma, double limit) {
      return length > limit && length > kStandardErrors * std::hypot(sigma, tolerance_) &&
             length * piece.gain > kNoises * noise_;
    };
    if (tag && std::abs(change) > shift &&
        counts(
            std::abs(change), piece.scale.sigma * piece.side, *size_.finding.limit * piece.side)) {
      size_.Add(fmt::format("{} has sides of {:.4g} mm in place of {:.4g}",
                            name,
                            1e3 * (piece.side + change),
                            1e3 * piece.side),
                std::abs(piece.scale.value));
    } else if (counts(shift, piece.ShiftSigma(), *moved_.finding.limit)) {
      moved_.Add(fmt::format("{} by {:.3g} mm", name, 1e3 * shift), shift);
    }
  }

  // Tags that exist twice or whose corners have another order.
  bool SortSpecialTag(const Piece& piece, const std::string& name) {
    constexpr double kPart = 0.2, kMost = 0.6;  // of the views
    const auto views = static_cast<double>(piece.views);
    for (size_t i = 0; i < kCornerOrders.size(); ++i) {
      if (static_cast<double>(piece.orders[i]) < kMost * views) continue;
      order_.parts.push_back(fmt::format("{} ({})", name, CornerOrderText(i)));
      return true;
    }
    if (piece.far < 2 || piece.near < 2 || static_cast<double>(piece.far) < kPart * views ||
        static_cast<double>(piece.near) < kPart * views) {
      return false;
    }
    twice_.Add(fmt::format("{} (elsewhere in {} of {} images)", name, piece.far, piece.views),
               static_cast<double>(piece.far));
    return true;
  }

  const std::vector<Piece>& pieces_;
  double tolerance_;
  double noise_ = 0;  // of a piece in one view, px
  Defect twice_{.finding = {.code = "target_ids_twice",
                            .role = FindingRole::kTargetResiduals,
                            .grade = Grade::kBad,
                            .limit = 2,
                            .what = "now in one place, now in another",
                            .remedy = "remove or cover the second tag with the same id, or give it "
                                      "another"},
                .parts = {}};
  Defect order_{.finding = {.code = "target_corner_order",
                            .role = FindingRole::kTargetCause,
                            .grade = Grade::kBad,
                            .what = "corners in another order than the target's file states",
                            .remedy = "write the corners of these tags in the order lower left, "
                                      "lower right, upper right, upper left of the upright tag"},
                .parts = {}};
  Defect size_{
      .finding = {.code = "target_tag_size",
                  .role = FindingRole::kTargetResiduals,
                  .grade = Grade::kBad,
                  .what = "other sizes than the target's file states, relative to the other "
                          "tags",
                  .remedy = "set the corners of these tags (type apriltag), print them in "
                            "the stated size, or leave them out"},
      .parts = {}};
  Defect moved_{.finding = {.code = "target_marker_moved",
                            .role = FindingRole::kTargetResiduals,
                            .grade = Grade::kUsable,
                            .what = "not where the target's file states, relative to all others",
                            .remedy = "measure and correct these positions in the target's file, "
                                      "give the target a 'tolerance' of this size, or leave them "
                                      "out"},
                .parts = {}};
};

// 1, x, y, x^2, ...: as many terms as half of the points determine.
Eigen::MatrixXd Polynomials(const std::vector<Eigen::Vector2d>& at) {
  constexpr Eigen::Index kLinear = 3, kQuadratic = 6, kCubic = 10;
  const auto count = static_cast<Eigen::Index>(at.size());
  const Eigen::Index terms = count >= 2 * kCubic       ? kCubic
                             : count >= 2 * kQuadratic ? kQuadratic
                                                       : kLinear;
  Eigen::MatrixXd A(count, kCubic);
  for (Eigen::Index i = 0; i < count; ++i) {
    const double x = at[static_cast<size_t>(i)].x(), y = at[static_cast<size_t>(i)].y();
    A.row(i) << 1, x, y, x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y;
  }
  return A.leftCols(terms);
}

// Rows of `values` less a robust fit of the columns of `A`.
Eigen::MatrixXd LessSmooth(const Eigen::MatrixXd& A, const Eigen::MatrixXd& values) {
  return values - A * RobustLeastSquares(A, values, kCauchyWidth<> * kSigmaPerMedianLength2d);
}

// A bent board, a stretched print and an imperfect camera model displace the pieces smoothly: what
// is left beside a polynomial over the plane is what single pieces do.
void TakeOffSmoothPart(std::vector<Piece>* pieces) {
  constexpr size_t kLeastPieces = 6;  // for a linear one
  std::map<int, Eigen::Vector3d> places;
  for (const Piece& piece : *pieces) places[piece.number] = piece.place;
  const std::optional<MarkerPlane> plane = FindPlane(places);
  if (!plane || pieces->size() < kLeastPieces) return;
  const auto count = static_cast<Eigen::Index>(pieces->size());
  std::vector<Eigen::Vector2d> at;
  Eigen::MatrixXd motions(count, 2), scales(count, 1);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Piece& piece = (*pieces)[static_cast<size_t>(i)];
    const Eigen::Vector3d motion = piece.axes * Eigen::Vector2d(piece.x.value, piece.y.value);
    at.emplace_back((*plane)(piece.place) / plane->extent);
    motions.row(i) << plane->x.dot(motion), plane->y.dot(motion);
    scales(i, 0) = piece.scale.value;
  }
  const Eigen::MatrixXd A = Polynomials(at);
  motions = LessSmooth(A, motions);
  scales = LessSmooth(A, scales);
  for (Eigen::Index i = 0; i < count; ++i) {
    Piece& piece = (*pieces)[static_cast<size_t>(i)];
    piece.shift = motions.row(i).norm();
    piece.scale.value = scales(i, 0);
  }
}

// Tags by their corners.
std::vector<Piece> TagPieces(const Bundle& bundle, const TargetDoubts& doubts) {
  std::map<int, Eigen::Vector3d> nominal;
  for (const BundleMarker& marker : bundle.markers) nominal[marker.number] = marker.nominal;
  std::map<int, Axes> axes_of;
  std::vector<std::pair<std::array<int, 4>, Corners>> tags;
  for (const std::array<int, 4>& quad : doubts.quads) {
    if (!std::ranges::all_of(quad, [&](int number) { return nominal.contains(number); })) continue;
    const Eigen::Vector3d origin = nominal[quad[0]];
    Axes axes;
    axes.col(0) = (nominal[quad[1]] - origin).normalized();
    const Eigen::Vector3d up = nominal[quad[3]] - origin;
    axes.col(1) = (up - up.dot(axes.col(0)) * axes.col(0)).normalized();
    Corners corners;
    Eigen::Vector2d middle(0, 0);
    for (size_t k = 0; k < 4; ++k) {
      axes_of[quad[k]] = axes;
      corners[k] = axes.transpose() * (nominal[quad[k]] - origin);
      middle += corners[k] / 4;
    }
    for (Eigen::Vector2d& corner : corners) corner -= middle;
    tags.emplace_back(quad, corners);
  }
  const std::map<int, Offsets> offsets = MeasureOffsets(bundle, axes_of);
  std::vector<Piece> pieces;
  for (const auto& [quad, corners] : tags) {
    Piece piece = TagPiece(quad, corners, offsets);
    piece.axes = axes_of.at(quad[0]);
    for (const int number : quad) piece.place += nominal.at(number) / 4;
    if (piece.views > 0) pieces.push_back(piece);
  }
  return pieces;
}

// The markers of a board by themselves.
std::vector<Piece> BoardPieces(const Bundle& bundle) {
  std::map<int, Eigen::Vector3d> nominal;
  for (const BundleMarker& marker : bundle.markers) nominal[marker.number] = marker.nominal;
  const std::optional<MarkerPlane> plane = FindPlane(nominal);
  if (!plane) return {};
  Axes axes;
  axes << plane->x, plane->y;
  std::map<int, Axes> axes_of;
  for (const auto& [number, position] : nominal) axes_of[number] = axes;
  std::vector<Piece> pieces;
  for (const auto& [number, by_view] : MeasureOffsets(bundle, axes_of)) {
    if (by_view.size() < kLeastPieceViews) continue;
    std::vector<Eigen::Vector3d> motions;
    std::vector<double> gains;
    for (const auto& [view, offset] : by_view) {
      motions.emplace_back(offset.offset.x(), offset.offset.y(), 0);
      gains.push_back(offset.gain);
    }
    Piece piece{.number = number, .place = nominal.at(number), .axes = axes};
    Summarise(motions, gains, &piece);
    pieces.push_back(piece);
  }
  return pieces;
}

// The residuals of each marker, rejected ones too, carried back to the target's plane in each view
// and compared over the views. A displacement counts when it is six standard errors (from its
// scatter over the views) long, stands out among the displacements of all others beside a smooth
// field (one false alarm in ten thousand sessions, Rayleigh's distribution), and exceeds three
// times the scatter in one image. Of targets in one plane and of tags anywhere.
std::vector<Finding> FindMovedMarkers(const CauseEvidence& evidence) {
  constexpr size_t kLeastPieces = 3;  // one cannot disagree with all others otherwise
  const Calibration calibration = ChooseFrames(*evidence.calibration);
  const Bundle& bundle = calibration.bundle;
  std::vector<Piece> pieces =
      evidence.doubts->quads.empty() ? BoardPieces(bundle) : TagPieces(bundle, *evidence.doubts);
  if (pieces.size() < kLeastPieces) return {};
  TakeOffSmoothPart(&pieces);
  return Sorting(pieces, bundle.marker_freedom.Sigma()).Findings();
}

}  // namespace

Cause MarkerOffsetsCause() { return {CauseStage::kTarget, FindMovedMarkers}; }

}  // namespace plenocal
