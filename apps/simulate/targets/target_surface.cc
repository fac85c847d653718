// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/targets/target_surface.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "apps/charts/cairo_handles.h"
#include "apps/charts/cairo_path.h"
#include "apps/simulate/spec/random.h"
#include "calib/base/format_error.h"
#include "targets/tags/quad.h"
#include "targets/target.h"

namespace plenocal::simulate {
namespace {

constexpr int kLevels = 7;  // of the picture, each half as fine

// The map from space that sends a plane's points to the picture.
PictureMap MakeMap(const RigidTransform& T_camera_plane, const Eigen::Matrix3d& picture_by_plane) {
  PictureMap map;
  map.normal = T_camera_plane.R.col(2).cast<float>();
  map.offset = static_cast<float>(T_camera_plane.R.col(2).dot(T_camera_plane.t));
  const RigidTransform inverse = T_camera_plane.Inverse();
  Eigen::Matrix<double, 3, 4> plane_by_space;
  plane_by_space << inverse.R.topRows<2>(), inverse.t.head<2>(), Eigen::RowVector4d(0, 0, 0, 1);
  map.M = (picture_by_plane * plane_by_space).cast<float>();
  return map;
}

// Gray with soft spots, as a wooden board has them; CV_8U.
cv::Mat Spots(cv::Size size, double spot, int seed, size_t index) {
  Random random(seed, "board", {index});
  cv::Mat sum(size, CV_32F, cv::Scalar(0.34));
  for (const double share : {1.0, 0.35}) {
    const int columns = std::max(4, static_cast<int>(size.width / (spot * share)));
    const int rows = std::max(4, static_cast<int>(size.height / (spot * share)));
    cv::Mat coarse(rows, columns, CV_32F), fine;
    for (int y = 0; y < rows; ++y) {
      for (int x = 0; x < columns; ++x) {
        coarse.at<float>(y, x) = static_cast<float>(random.Uniform(-0.12, 0.12) * std::sqrt(share));
      }
    }
    cv::resize(coarse, fine, size, 0, 0, cv::INTER_CUBIC);
    sum += fine;
  }
  cv::Mat gray;
  sum.convertTo(gray, CV_8U, 255);
  return gray;
}

// A frame with its x axis along a - o and b in its plane.
RigidTransform MakeFrame(const Eigen::Vector3d& o,
                         const Eigen::Vector3d& a,
                         const Eigen::Vector3d& b) {
  RigidTransform T;
  T.R.col(0) = (a - o).normalized();
  T.R.col(2) = T.R.col(0).cross(b - o).normalized();
  T.R.col(1) = T.R.col(2).cross(T.R.col(0));
  T.t = o;
  return T;
}

// The rectangle of a part's plane that its picture covers, m.
Eigen::AlignedBox2d PictureBox(const TargetPart& part) {
  Eigen::AlignedBox2d box = part.paper;
  if (part.one_sheet) return box;
  // Tags are glued to a board that is larger than they need.
  const double rim = 0.5 * (part.tags[0].outline[1] - part.tags[0].outline[0]).norm();
  box.extend(Eigen::Vector2d(box.min().array() - rim));
  box.extend(Eigen::Vector2d(box.max().array() + rim));
  return box;
}

// Size of a texel of the picture, m.
double ChooseTexel(const TargetPart& part, const Eigen::AlignedBox2d& box) {
  constexpr double kTexels = 96;        // across the finest shape: several a pixel in close views
  constexpr double kMostTexels = 6000;  // along a side
  return std::max(part.finest / kTexels, box.sizes().maxCoeff() / kMostTexels);
}

// Draws a part over the background in `canvas`, whose first texel is at `corner`.
void DrawPart(const TargetPart& part,
              const Eigen::Vector2f& corner,
              double texel,
              cairo_surface_t* canvas) {
  constexpr double kTolerance = 0.02;  // texels, of curves drawn as polygons
  const print::Context context(cairo_create(canvas));
  cairo_set_antialias(context.get(), CAIRO_ANTIALIAS_BEST);
  cairo_set_operator(context.get(), CAIRO_OPERATOR_SOURCE);
  cairo_set_tolerance(context.get(), kTolerance);
  cairo_scale(context.get(), 1 / texel, 1 / texel);
  cairo_translate(context.get(), -corner.x(), -corner.y());
  cairo_set_source_rgba(context.get(), 0, 0, 0, 1);
  for (const DrawnTag& tag : part.tags) print::AddPolygon(context.get(), tag.paper);
  cairo_fill(context.get());
  cairo_set_source_rgba(context.get(), 0, 0, 0, PosedSurface::kInk);
  print::FillBlack(context.get(), part);
}

// The picture and coarser ones, each half as fine as the one before.
std::vector<cv::Mat> Pyramid(const cv::Mat& picture) {
  std::vector<cv::Mat> pyramid{picture};
  for (int level = 1; level < kLevels; ++level) {
    cv::Mat half;
    cv::resize(pyramid.back(), half, {}, 0.5, 0.5, cv::INTER_AREA);
    pyramid.push_back(half);
  }
  return pyramid;
}

}  // namespace

TargetSurface::TargetSurface(const Target& nominal, const TrueTarget& made, int seed) {
  for (const TargetPart& part : DrawTarget(nominal)) {
    Board board;
    board.T_target_board = part.T_target_part;
    Draw(part, seed, &board);
    if (!part.tags.empty()) MapTags(part, made, &board);
    if (part.squares) MapSquares(*part.squares, nominal, made, &board);
    if (!part.black_discs.empty()) MapDiscs(part, nominal, made, &board);
    boards_.push_back(std::move(board));
  }
}

void TargetSurface::Draw(const TargetPart& part, int seed, Board* board) {
  const Eigen::AlignedBox2d box = PictureBox(part);
  const double texel = ChooseTexel(part, box);
  constexpr int kMultiple = 1 << (kLevels - 1);
  const auto whole = [&](double length) {
    return (static_cast<int>(std::ceil(length / texel)) + kMultiple) / kMultiple * kMultiple;
  };
  const cv::Size size(whole(box.sizes().x()), whole(box.sizes().y()));
  board->corner = box.min().cast<float>();
  board->texel = static_cast<float>(texel);
  board->size = box.sizes().cast<float>();

  const print::Surface surface(
      cairo_image_surface_create(CAIRO_FORMAT_A8, size.width, size.height));
  if (cairo_surface_status(surface.get()) != CAIRO_STATUS_SUCCESS) {
    throw JobError("out of memory for the picture of the target");
  }
  cv::Mat canvas(size,
                 CV_8U,
                 cairo_image_surface_get_data(surface.get()),
                 static_cast<size_t>(cairo_image_surface_get_stride(surface.get())));
  if (part.one_sheet) {
    canvas.setTo(255);
  } else {
    constexpr double kSpot = 0.012;  // m
    Spots(size, kSpot / texel, seed, boards_.size()).copyTo(canvas);
  }
  cairo_surface_mark_dirty(surface.get());
  DrawPart(part, board->corner, texel, surface.get());
  cairo_surface_flush(surface.get());
  board->picture = Pyramid(canvas.clone());
  // Fine enough to tell shapes apart.
  board->which_cell = static_cast<float>(part.finest / 4);
  board->which = cv::Mat(static_cast<int>(box.sizes().y() / board->which_cell) + 1,
                         static_cast<int>(box.sizes().x() / board->which_cell) + 1,
                         CV_32S,
                         cv::Scalar(-1));
}

template <typename Choose>
void TargetSurface::Board::ChooseMaps(const Choose& choose) {
  for (int y = 0; y < which.rows; ++y) {
    for (int x = 0; x < which.cols; ++x) {
      const Eigen::Vector2d at(corner.x() + (x + 0.5) * which_cell,
                               corner.y() + (y + 0.5) * which_cell);
      which.at<std::int32_t>(y, x) = static_cast<std::int32_t>(choose(at));
    }
  }
}

void TargetSurface::MapTags(const TargetPart& part, const TrueTarget& made, Board* board) {
  for (const DrawnTag& tag : part.tags) {
    std::array<Eigen::Vector3d, 4> corners;
    for (int k = 0; k < 4; ++k) corners[static_cast<size_t>(k)] = made.markers.at(4 * tag.id + k);
    Board::Map map;
    map.T_target_plane = MakeFrame(corners[0], corners[1], corners[3]);
    const RigidTransform T_plane_target = map.T_target_plane.Inverse();
    internal::Quad seen, drawn;
    for (size_t k = 0; k < 4; ++k) {
      seen[k] = (T_plane_target * corners[k]).head<2>();
      drawn[k] = tag.outline[k];
    }
    map.picture_by_plane =
        internal::UnitSquareHomography(drawn) * internal::UnitSquareHomography(seen).inverse();
    std::vector<cv::Point> cells;
    constexpr int kShift = 4;
    for (const Eigen::Vector2d& p : tag.paper) {
      const double scale = (1 << kShift) / static_cast<double>(board->which_cell);
      cells.emplace_back(static_cast<int>((p.x() - board->corner.x()) * scale) - (1 << kShift) / 2,
                         static_cast<int>((p.y() - board->corner.y()) * scale) - (1 << kShift) / 2);
    }
    cv::fillConvexPoly(board->which,
                       cells,
                       cv::Scalar(static_cast<double>(board->maps.size())),
                       cv::LINE_8,
                       kShift);
    board->maps.push_back(map);
  }
}

void TargetSurface::MapSquares(const SquareGrid& grid,
                               const Target& nominal,
                               const TrueTarget& made,
                               Board* board) {
  // Nodes: the markers and one more all around, which moves with its neighbour.
  const int columns = grid.columns, rows = grid.rows;
  const double square = grid.pitch, first = grid.first;
  const auto meant = [&](int column, int row) {
    return Eigen::Vector2d(first + column * square, first + row * square);
  };
  const auto is = [&](int column, int row) -> Eigen::Vector3d {
    const int marker = std::clamp(row, 0, rows - 1) * columns + std::clamp(column, 0, columns - 1);
    const Eigen::Vector3d moved = made.markers.at(marker) - nominal.markers.at(marker);
    return Eigen::Vector3d(meant(column, row).x(), meant(column, row).y(), 0) + moved;
  };
  const int across = columns + 1;
  for (int row = -1; row < rows; ++row) {
    for (int column = -1; column < columns; ++column) {
      for (int half = 0; half < 2; ++half) {
        // Upper left and lower right half.
        const int at = half, to = 1 - half;
        const Eigen::Vector3d o = is(column + at, row + at), a = is(column + to, row + at),
                              b = is(column + at, row + to);
        Board::Map map;
        map.T_target_plane = MakeFrame(o, a, b);
        const RigidTransform T_plane_target = map.T_target_plane.Inverse();
        Eigen::Matrix3d plane, picture;
        plane << (T_plane_target * o).head<2>().homogeneous(),
            (T_plane_target * a).head<2>().homogeneous(),
            (T_plane_target * b).head<2>().homogeneous();
        picture << meant(column + at, row + at).homogeneous(),
            meant(column + to, row + at).homogeneous(), meant(column + at, row + to).homogeneous();
        map.picture_by_plane = picture * plane.inverse();
        board->maps.push_back(map);
      }
    }
  }
  board->ChooseMaps([&](const Eigen::Vector2d& at) {
    const double u = (at.x() - first) / square, v = (at.y() - first) / square;
    const int column = std::clamp(static_cast<int>(std::floor(u)), -1, columns - 1);
    const int row = std::clamp(static_cast<int>(std::floor(v)), -1, rows - 1);
    const int half = (u - column) + (v - row) > 1 ? 1 : 0;
    return 2 * ((row + 1) * across + column + 1) + half;
  });
}

void TargetSurface::MapDiscs(const TargetPart& part,
                             const Target& nominal,
                             const TrueTarget& made,
                             Board* board) {
  std::vector<Eigen::Vector2d> centres;
  for (const Disc& disc : part.black_discs) {
    const Eigen::Vector3d moved = made.markers.at(disc.marker) - nominal.markers.at(disc.marker);
    board->maps.push_back({.T_target_plane = {Eigen::Matrix3d::Identity(), moved},
                           .picture_by_plane = Eigen::Matrix3d::Identity()});
    centres.push_back(disc.centre);
  }
  board->ChooseMaps([&](const Eigen::Vector2d& at) {
    const auto distance = [&](const Eigen::Vector2d& centre) {
      return (centre - at).squaredNorm();
    };
    return std::ranges::min_element(centres, {}, distance) - centres.begin();
  });
}

void TargetSurface::Append(const TargetSurface& other, const RigidTransform& T_this_other) {
  for (Board board : other.boards_) {
    board.T_target_board = T_this_other * board.T_target_board;
    for (Board::Map& map : board.maps) map.T_target_plane = T_this_other * map.T_target_plane;
    boards_.push_back(std::move(board));
  }
}

PosedSurface::PosedSurface(const TargetSurface& surface, const RigidTransform& T_camera_target) {
  for (const TargetSurface::Board& board : surface.boards_) {
    Board posed{.of = &board,
                .own = MakeMap(T_camera_target * board.T_target_board, Eigen::Matrix3d::Identity()),
                .maps = {}};
    for (const TargetSurface::Board::Map& map : board.maps) {
      posed.maps.push_back(MakeMap(T_camera_target * map.T_target_plane, map.picture_by_plane));
    }
    boards_.push_back(std::move(posed));
  }
}

namespace {

float Distance(const PictureMap& map,
               const Eigen::Vector3f& origin,
               const Eigen::Vector3f& direction) {
  return (map.offset - map.normal.dot(origin)) / map.normal.dot(direction);
}

Eigen::Vector2f InPicture(const PictureMap& map, const Eigen::Vector3f& p) {
  const Eigen::Vector3f h = map.M.leftCols<3>() * p + map.M.col(3);
  return h.head<2>() / h.z();
}

}  // namespace

PosedSurface::Hit PosedSurface::FindHit(const Eigen::Vector3f& origin,
                                        const Eigen::Vector3f& direction) const {
  Hit hit;
  for (const Board& board : boards_) {
    const float distance = Distance(board.own, origin, direction);
    if (!(distance > 0) || (hit.board != nullptr && distance > hit.distance)) continue;
    const Eigen::Vector2f at =
        InPicture(board.own, origin + distance * direction) - board.of->corner;
    if (at.minCoeff() >= 0 && at.x() < board.of->size.x() && at.y() < board.of->size.y()) {
      hit = {&board, distance, at};
    }
  }
  return hit;
}

std::pair<int, float> PosedSurface::FaceOf(const Eigen::Vector3f& origin,
                                           const Eigen::Vector3f& direction) const {
  const Hit hit = FindHit(origin, direction);
  if (hit.board == nullptr || hit.board->own.normal.dot(direction) < 0) return {-1, 0};
  return {static_cast<int>(hit.board - boards_.data()), hit.distance};
}

int PosedSurface::MapAt(const TargetSurface::Board& board, float u, float v) {
  const float x = u / board.which_cell, y = v / board.which_cell;
  if (!(x >= 0 && y >= 0 && x < static_cast<float>(board.which.cols) &&
        y < static_cast<float>(board.which.rows))) {
    return -1;
  }
  return board.which.ptr<std::int32_t>(static_cast<int>(y))[static_cast<int>(x)];
}

int PosedSurface::LevelOf(const TargetSurface::Board& board, const Spread& spread, float distance) {
  const float width = std::abs(spread.at_origin + spread.by_distance * distance);
  int level = 0;
  for (float texel = 2 * board.texel; texel < width && level + 1 < kLevels; texel *= 2) ++level;
  return level;
}

float PosedSurface::Sample(const TargetSurface::Board& board, int level, float u, float v) {
  const cv::Mat& picture = board.picture[static_cast<size_t>(level)];
  const float scale = 1 / (board.texel * static_cast<float>(1 << level));
  const float x = std::clamp(u * scale - 0.5f, 0.f, static_cast<float>(picture.cols) - 1.001f);
  const float y = std::clamp(v * scale - 0.5f, 0.f, static_cast<float>(picture.rows) - 1.001f);
  const int column = static_cast<int>(x), row = static_cast<int>(y);
  const float fx = x - static_cast<float>(column), fy = y - static_cast<float>(row);
  const std::uint8_t* top = picture.ptr<std::uint8_t>(row) + column;
  const std::uint8_t* below = picture.ptr<std::uint8_t>(row + 1) + column;
  return ((1 - fy) * ((1 - fx) * top[0] + fx * top[1]) +
          fy * ((1 - fx) * below[0] + fx * below[1])) /
         255.f;
}

float PosedSurface::Radiance(const Eigen::Vector3f& origin,
                             const Eigen::Vector3f& direction,
                             const Spread& spread) const {
  const Hit hit = FindHit(origin, direction);
  if (hit.board == nullptr) return kBackground;
  // z of a part points away from the viewer.
  if (hit.board->own.normal.dot(direction) < 0) return kBack;
  const TargetSurface::Board& board = *hit.board->of;
  // The shapes are beside their nominal positions: only the map of a shape shows whether it is met.
  constexpr int kTries = 3;
  Eigen::Vector2f at = hit.at;
  int map = -1;
  for (int i = 0; i < kTries; ++i) {
    const int found = MapAt(board, at.x(), at.y());
    if (found == map || found < 0) break;
    map = found;
    const PictureMap& piece = hit.board->maps[static_cast<size_t>(map)];
    at = InPicture(piece, origin + Distance(piece, origin, direction) * direction) - board.corner;
  }
  return Sample(board, LevelOf(board, spread, hit.distance), at.x(), at.y());
}

void PosedSurface::Radiances(const RayBundle& rays,
                             const Spread& spread,
                             int board_index,
                             std::array<float, RayBundle::kMost>* radiances) const {
  if (board_index < 0 || rays.count == 0) {
    return Surface::Radiances(rays, spread, board_index, radiances);
  }
  const Board& posed = boards_[static_cast<size_t>(board_index)];
  const TargetSurface::Board& board = *posed.of;
  // Most rays meet the shape that the first one meets.
  const Eigen::Vector3f origin = rays.Origin(0), direction = rays.Direction(0);
  const float distance = Distance(posed.own, origin, direction);
  const Eigen::Vector2f first = InPicture(posed.own, origin + distance * direction) - board.corner;
  const int map = MapAt(board, first.x(), first.y());
  const PictureMap& piece = map < 0 ? posed.own : posed.maps[static_cast<size_t>(map)];
  const int level = LevelOf(board, spread, distance);

  std::array<float, RayBundle::kMost> u, v;
  const float nx = piece.normal.x(), ny = piece.normal.y(), nz = piece.normal.z();
  const float rest = piece.offset - nz * rays.z;
  const Eigen::Matrix<float, 3, 4>& M = piece.M;
  for (size_t i = 0; i < static_cast<size_t>(rays.count); ++i) {
    const float along =
        (rest - nx * rays.x[i] - ny * rays.y[i]) / (nx * rays.dx[i] + ny * rays.dy[i] + nz);
    const float x = rays.x[i] + along * rays.dx[i], y = rays.y[i] + along * rays.dy[i];
    const float z = rays.z + along;
    const float h = 1 / (M(2, 0) * x + M(2, 1) * y + M(2, 2) * z + M(2, 3));
    u[i] = (M(0, 0) * x + M(0, 1) * y + M(0, 2) * z + M(0, 3)) * h - board.corner.x();
    v[i] = (M(1, 0) * x + M(1, 1) * y + M(1, 2) * z + M(1, 3)) * h - board.corner.y();
  }
  for (size_t i = 0; i < static_cast<size_t>(rays.count); ++i) {
    (*radiances)[i] = MapAt(board, u[i], v[i]) == map
                          ? Sample(board, level, u[i], v[i])
                          : Radiance(rays.Origin(i), rays.Direction(i), spread);
  }
}

}  // namespace plenocal::simulate
