// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/image_circle.h"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace plenocal::internal {
namespace {

constexpr int kCells = 24;
// A cell is lit that is lighter, above black, than this part of the lightest quarter: the target's
// dark fields, and the corners of an ordinary lens, are.
constexpr double kLit = 0.2;
// RMS of the rim about the ellipse, cells: an even distribution within a cell.
const double kRimError = 1 / std::sqrt(12.0);
// An ellipse has four unknowns; the rim shall show that it is one.
constexpr size_t kFewestOnRim = 16;

}  // namespace

std::vector<std::uint8_t> CellLevels(const cv::Mat& gray) {
  const ImageGrid grid({gray.cols, gray.rows}, kCells);
  cv::Mat cells;
  cv::resize(gray, cells, {grid.Columns(), grid.Rows()}, 0, 0, cv::INTER_AREA);
  return {cells.begin<std::uint8_t>(), cells.end<std::uint8_t>()};
}

ImageCircleFit::ImageCircleFit(ImageSize image_size)
    : grid_(image_size, kCells), lightest_(grid_.Cells(), 0) {}

void ImageCircleFit::Add(const std::vector<std::uint8_t>& levels) {
  for (size_t cell = 0; cell < std::min(levels.size(), lightest_.size()); ++cell) {
    lightest_[cell] = std::max<double>(lightest_[cell], levels[cell]);
    black_ = std::min<double>(black_, levels[cell]);
  }
}

// Places between a lit cell and a dark one, in cells from the image's corner.
std::vector<Eigen::Vector2d> ImageCircleFit::Rim(double limit) const {
  std::vector<Eigen::Vector2d> rim;
  const int columns = grid_.Columns();
  for (int row = 0; row < grid_.Rows(); ++row) {
    for (int column = 0; column < columns; ++column) {
      const double here = lightest_[static_cast<size_t>(row * columns + column)];
      for (const auto& [x, y] : {std::pair(1, 0), std::pair(0, 1)}) {
        if (column + x >= columns || row + y >= grid_.Rows()) continue;
        const double next = lightest_[static_cast<size_t>((row + y) * columns + column + x)];
        if ((here > limit) == (next > limit)) continue;
        const double part = (limit - here) / (next - here);
        rim.emplace_back(column + 0.5 + part * x, row + 0.5 + part * y);
      }
    }
  }
  return rim;
}

std::optional<ImageCircle> ImageCircleFit::Fit() const {
  std::vector<double> sorted = lightest_;
  const auto quarter = sorted.begin() + std::ssize(sorted) * 3 / 4;
  std::ranges::nth_element(sorted, quarter);
  const double limit = black_ + kLit * (*quarter - black_);
  const std::vector<Eigen::Vector2d> rim = Rim(limit);
  if (rim.size() < kFewestOnRim) return std::nullopt;

  // a x^2 + b y^2 + c x + d y = 1, from the image's middle.
  const Eigen::Vector2d half(grid_.Columns() / 2.0, grid_.Rows() / 2.0);
  Eigen::MatrixX4d rows(std::ssize(rim), 4);
  for (Eigen::Index i = 0; i < rows.rows(); ++i) {
    const Eigen::Vector2d q = (rim[static_cast<size_t>(i)] - half).cwiseQuotient(half);
    rows.row(i) << q.x() * q.x(), q.y() * q.y(), q.x(), q.y();
  }
  const Eigen::Vector4d k =
      rows.colPivHouseholderQr().solve(Eigen::VectorXd::Ones(rows.rows()).eval());
  if (!(k[0] > 0 && k[1] > 0)) return std::nullopt;
  const Eigen::Vector2d middle = -k.tail<2>().cwiseQuotient(2 * k.head<2>());
  const double square = 1 + k.head<2>().dot(middle.cwiseAbs2());
  const ImageCircle cells{half + middle.cwiseProduct(half),
                          (square * k.head<2>().cwiseInverse()).cwiseSqrt().cwiseProduct(half)};

  const Eigen::Vector2d cell_size = 2 * (grid_.Middle(0).array() + 0.5);  // px

  // Distance from the ellipse, cells, to first order.
  const double radius = std::sqrt(cells.radii.prod());
  const auto beyond = [&](const Eigen::Vector2d& place) {
    return radius * ((place - cells.centre).cwiseQuotient(cells.radii).norm() - 1);
  };
  double squares = 0;
  for (const Eigen::Vector2d& place : rim) squares += beyond(place) * beyond(place);
  if (squares > kRimError * kRimError * static_cast<double>(rim.size())) return std::nullopt;
  for (size_t cell = 0; cell < lightest_.size(); ++cell) {
    const double outside =
        beyond((grid_.Middle(cell).array() + 0.5).matrix().cwiseQuotient(cell_size));
    if (std::abs(outside) > 1 && (outside < 0) != (lightest_[cell] > limit)) return std::nullopt;
  }
  // A rim cell has `kLit` of its mean level where the rim leaves it that part of its area.
  const Eigen::Vector2d radii = cells.radii.array() - (0.5 - kLit);
  return ImageCircle{cells.centre.cwiseProduct(cell_size).array() - 0.5,
                     radii.cwiseProduct(cell_size)};
}

}  // namespace plenocal::internal
