// SPDX-License-Identifier: Apache-2.0
//
// White image -> micro-lens array (docs/plenoptic.md, "White images"): period by autocorrelation,
// one seed per cell, profile fit of each micro image, smooth lattice.
#include "detectors/plenoptic/white/micro_lens_grid.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <string>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/statistics.h"
#include "calib/camera/lens_lattice.h"
#include "detectors/images/attenuation.h"
#include "detectors/plenoptic/white/lattice_period.h"
#include "detectors/plenoptic/white/micro_images.h"

namespace plenocal {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;
using internal::MicroImages;

/// Micro images fill at least this part of the image: dirt and dark corners leave more of it.
constexpr double kCoverage = 0.5;
/// Profiles, centres and lattice improve one another: each turn reduces the remaining error by more
/// than ten.
constexpr int kTurns = 4;

/// Local maxima of the image smoothed to about a micro image's size, to a fraction of a pixel.
std::vector<Vector2d> FindSeeds(const cv::Mat& flat, double pitch) {
  constexpr double kPitchesPerSigma = 4;  // twice the sigma is the radius of a micro image
  cv::Mat smooth, highest;
  cv::GaussianBlur(flat, smooth, {}, pitch / kPitchesPerSigma);
  cv::dilate(smooth, highest, {});
  std::vector<Vector2d> seeds;
  for (int y = 1; y + 1 < flat.rows; ++y) {
    for (int x = 1; x + 1 < flat.cols; ++x) {
      const double here = smooth.at<float>(y, x);
      if (here < highest.at<float>(y, x)) continue;
      const auto offset = [&](double before, double after) {
        const double curvature = before - 2 * here + after;
        return curvature < 0 ? 0.5 * (before - after) / curvature : 0.0;
      };
      seeds.emplace_back(x + offset(smooth.at<float>(y, x - 1), smooth.at<float>(y, x + 1)),
                         y + offset(smooth.at<float>(y - 1, x), smooth.at<float>(y + 1, x)));
    }
  }
  return seeds;
}

/// The result with the micro lenses at `centres`.
MicroLensGrid MakeGrid(const MicroImages& images,
                       const std::vector<Vector2d>& centres,
                       const std::vector<int>& types) {
  MicroLensGrid grid;
  double sum = 0;
  int count = 0;
  for (size_t i = 0; i < centres.size(); ++i) {
    if (!images.IsInside(i)) continue;
    const LatticeNode& node = images.Nodes()[i];
    grid.array.lenses.push_back({.row = node.row,
                                 .column = node.column,
                                 .centre = centres[i],
                                 .type = types[i],
                                 .usable = images.IsUsable(i)});
    grid.gains.push_back(images.Images()[i].gain);
    if (images.IsUsable(i) && images.IsWhole(i)) {
      sum += (images.Images()[i].centre - centres[i]).squaredNorm() / 2;
      ++count;
    }
  }
  grid.centre_rms = std::sqrt(sum / std::max(1, count));
  grid.misfit = images.Misfit();
  grid.gain_spread = images.GainSpread();
  return grid;
}

std::vector<Vector2d> Positions(const SmoothLattice& lattice,
                                const std::vector<LatticeNode>& nodes) {
  std::vector<Vector2d> positions;
  positions.reserve(nodes.size());
  for (const LatticeNode& node : nodes)
    positions.push_back(lattice.Position(node.column, node.row));
  return positions;
}

/// The lattice of an image by its seeds.
SmoothLattice FirstLattice(const cv::Mat& flat,
                           const Matrix2d& basis,
                           std::vector<LatticeMeasurement>* measurements) {
  const std::vector<Vector2d> seeds = FindSeeds(flat, basis.colwise().norm().mean());
  const auto nodes = IndexLattice(seeds, basis, {flat.cols, flat.rows});
  for (size_t i = 0; i < seeds.size(); ++i) {
    if (nodes[i]) measurements->push_back({.node = *nodes[i], .position = seeds[i]});
  }
  const double cell = std::abs(basis.determinant());
  if (static_cast<double>(measurements->size()) * cell < kCoverage * flat.cols * flat.rows) {
    throw JobError(
        "micro images fill less than half of the white images; do they show a scene? Record an "
        "even white field");
  }
  return SmoothLattice::Fit(*measurements);
}

/// The distortion about each node by the lattice, relative to that in the middle: with the offset
/// w in nodes, x - c = J w + w' S w / 2, so that u = B w = B J^-1 (x - c - w' S w / 2), B of the
/// middle.
std::vector<internal::LocalMap> LocalMaps(const SmoothLattice& lattice,
                                          const Matrix2d& in_middle,
                                          const std::vector<LatticeNode>& nodes) {
  std::vector<internal::LocalMap> maps;
  maps.reserve(nodes.size());
  for (const LatticeNode& node : nodes) {
    const Matrix2d to_nodes = lattice.Basis(node.column, node.row).inverse();
    internal::LocalMap map = internal::LocalMap::Identity();
    const std::array<Matrix2d, 2> second = lattice.SecondDerivatives(node.column, node.row);
    for (int i = 0; i < 2; ++i) {
      const Matrix2d half = to_nodes.transpose() * second[static_cast<size_t>(i)] * to_nodes / 2;
      map.row(i).tail<3>() << -half(0, 0), -2 * half(0, 1), -half(1, 1);
    }
    maps.push_back(in_middle * to_nodes * map);
  }
  return maps;
}

std::vector<int> LensTypes(const MicroImages& images, const MicroImages::Types& types) {
  std::vector<int> of_images;
  of_images.reserve(images.Nodes().size());
  for (const LatticeNode& node : images.Nodes()) of_images.push_back(types.Of(node));
  return of_images;
}

/// The lattice's basis in the middle of an image.
Matrix2d BasisInMiddle(const SmoothLattice& lattice, ImageSize size) {
  const Vector2d middle = lattice.Coordinates({(size[0] - 1) / 2.0, (size[1] - 1) / 2.0});
  return lattice.Basis(middle.x(), middle.y());
}

/// Sets what the lattice determines.
void SetLattice(const SmoothLattice& lattice,
                const std::vector<LatticeMeasurement>& measurements,
                ImageSize size,
                MicroLensGrid* grid) {
  grid->degree = lattice.Degree();
  std::vector<double> sigmas;
  sigmas.reserve(measurements.size());
  for (const LatticeMeasurement& m : measurements) sigmas.push_back(m.sigma);
  grid->centre_sigma = lattice.Sigma() * Median(std::move(sigmas));
  grid->array.image_size = size;
  const Matrix2d there = BasisInMiddle(lattice, size);
  grid->array.e_column = there.col(0);
  grid->array.e_row = there.col(1);
  grid->array.errors = ErrorsOfFit(lattice, measurements, size);
}

}  // namespace

MicroLensGrid FindMicroLensGrid(const cv::Mat& white, int threads) {
  const ImageSize size{white.cols, white.rows};
  const cv::Mat flat = white / LargeScaleMean(white) - 1;
  const std::optional<Matrix2d> basis = internal::FindLatticePeriod(flat);
  if (!basis) {
    throw JobError(
        "the white images show no hexagonal or rectangular lattice of micro images; are they of a plenoptic "
        "camera, in focus and lit all over?");
  }
  const double pitch = basis->colwise().norm().mean();
  std::vector<LatticeMeasurement> measurements;
  SmoothLattice lattice = FirstLattice(flat, *basis, &measurements);

  MicroImages images(white, *basis, threads);
  MicroImages::Types types;
  const auto place = [&] {
    const std::vector<LatticeNode> inside =
        lattice.NodesInside(measurements, size, pitch, std::abs(basis->determinant()));
    std::vector<Vector2d> centres = Positions(lattice, inside);
    images.Place(inside, centres, LocalMaps(lattice, BasisInMiddle(lattice, size), inside));
    return centres;
  };
  for (int turn = 0; turn < kTurns; ++turn) {
    place();
    images.Measure(LensTypes(images, types), types.Count());
    // A profile per type once one common profile has found the positions.
    if (turn == 1) types = images.FindTypes();
    measurements = images.Measurements();
    lattice = SmoothLattice::Fit(measurements);
  }
  const std::vector<Vector2d> centres = place();
  const std::vector<int> lens_types = LensTypes(images, types);
  images.Measure(lens_types, types.Count());
  MicroLensGrid grid = MakeGrid(images, centres, lens_types);
  grid.array.types = types.Count();
  SetLattice(lattice, measurements, size, &grid);
  return grid;
}

std::string MisplacedCells(const cv::Mat& white, const MicroLensArray& array) {
  constexpr int kCorners = 6;
  constexpr double kLeastShare = 0.75;  // half-way between both cases
  const double radius = array.Pitch() / std::numbers::sqrt3;
  const double turn =
      std::atan2(array.e_column.y(), array.e_column.x()) + std::numbers::pi / kCorners;
  double brighter = 0, all = 0;
  for (const MicroLens& lens : array.lenses) {
    const auto at = [&](const Vector2d& p) {
      return white.at<float>(static_cast<int>(std::lround(p.y())),
                             static_cast<int>(std::lround(p.x())));
    };
    if (!IsInside(lens.centre, {white.cols, white.rows}, -radius - 1)) continue;
    double corners = 0;
    for (int k = 0; k < kCorners; ++k) {
      const double angle = turn + 2 * std::numbers::pi * k / kCorners;
      corners += at(lens.centre + radius * Vector2d(std::cos(angle), std::sin(angle)));
    }
    const double centre = at(lens.centre);
    brighter += centre > corners / kCorners ? 1 : 0;
    all += centre != corners / kCorners ? 1 : 0;
  }
  if (brighter >= kLeastShare * all) return "";
  return fmt::format(
      "only {:.0f} % of its {} cells are brighter in the middle than at their corners; it is of "
      "another camera or setting, or for images that are turned",
      100 * brighter / all,
      all);
}

MicroLensGrid MeasureMicroLensGrid(const cv::Mat& white, MicroLensArray array, int threads) {
  if (const std::string reason = MisplacedCells(white, array); !reason.empty()) {
    throw JobError("the grid does not fit the white images: {}", reason);
  }
  std::vector<LatticeNode> nodes;
  std::vector<Vector2d> centres;
  std::vector<int> types;
  for (const MicroLens& lens : array.lenses) {
    nodes.push_back({lens.column, lens.row});
    centres.push_back(lens.centre);
    types.push_back(lens.type);
  }
  Matrix2d basis;
  basis << array.e_column, array.e_row;
  MicroImages images(white, basis, threads);
  images.Place(nodes,
               centres,
               std::vector<internal::LocalMap>(nodes.size(), internal::LocalMap::Identity()));
  images.Measure(types, array.types);
  MicroLensGrid grid = MakeGrid(images, centres, types);
  grid.centre_sigma = grid.centre_rms;
  std::vector<MicroLens> lenses = std::move(grid.array.lenses);
  grid.array = std::move(array);
  grid.array.lenses = std::move(lenses);
  return grid;
}

}  // namespace plenocal
