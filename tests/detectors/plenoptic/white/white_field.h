// SPDX-License-Identifier: Apache-2.0
//
// A synthetic white image of a plenoptic camera with known centres.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>
#include <optional>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "calib/camera/lens_lattice.h"
#include "calib/camera/observation.h"

namespace plenocal::testing {

struct WhiteField {
  ImageSize size{640, 480};
  double pitch = 20;  // px
  double rotation_deg = 3;
  Eigen::Vector2d offset{0.37, -0.21};  // of one micro image from the middle, px
  int types = 3;                        // in the usual pattern
  std::optional<LensPattern> pattern = {};
  std::vector<int> type_of_set = {};  // empty: each its own
  double distortion = 0;  // displacement at the corner over the distance from the middle
  double fill = 1;        // size of the micro images; from 1.1 on they overlap
  double level = 3000;    // electrons where nothing is lost
  int images = 10;
  double tilt = 0;  // relative change of brightness within a micro image, per px
  double gain_scatter = 0.01;
  std::set<std::pair<int, int>> dead = {};  // column, row
  bool bayer = false;
  unsigned seed = 1;
  LatticeKind lattice = LatticeKind::kHexagonal;
  double aspect = 1;  ///< of a rectangular lattice: distance of rows over `pitch`

  [[nodiscard]] LensPattern Pattern() const {
    if (pattern) return *pattern;
    if (types == 1) return {};
    if (lattice == LatticeKind::kHexagonal) return kThreeInterleaved;
    return {.columns = 2, .rows = 2};
  }
  [[nodiscard]] int Type(const LatticeNode& node) const {
    const int set = Pattern().Set(node);
    return type_of_set.empty() ? set : type_of_set[static_cast<size_t>(set)];
  }
  [[nodiscard]] int Types() const {
    return type_of_set.empty() ? Pattern().Sets() : 1 + *std::ranges::max_element(type_of_set);
  }
};

struct TrueLens {
  LatticeNode node;
  Eigen::Vector2d centre;
};

/// Undistorted micro images are discs with a soft edge; radius and softness depend on the type. In
/// electrons.
struct RenderedField {
  cv::Mat white;                 // CV_32F, mean of the images
  std::vector<TrueLens> lenses;  // with the centre on the sensor
};

inline RenderedField Render(const WhiteField& field) {
  const double w = field.size[0], h = field.size[1];
  const Eigen::Vector2d middle((w - 1) / 2, (h - 1) / 2);
  const double corner = middle.norm();
  const auto distort = [&](const Eigen::Vector2d& p) {
    const Eigen::Vector2d d = p - middle;
    return Eigen::Vector2d(middle +
                           d * (1 + field.distortion * d.squaredNorm() / (corner * corner)));
  };
  const auto undistort = [&](const Eigen::Vector2d& p) {
    Eigen::Vector2d u = p;
    for (int i = 0; i < 20; ++i) u += p - distort(u);
    return u;
  };
  // Distortion bends the micro images, too.
  std::vector<Eigen::Vector2d> undistorted;
  for (int y = 0; y < field.size[1]; ++y) {
    for (int x = 0; x < field.size[0]; ++x) undistorted.push_back(undistort({x, y}));
  }
  Eigen::Matrix2d basis;
  const double angle = field.rotation_deg * std::numbers::pi / 180;
  const bool hexagonal = field.lattice == LatticeKind::kHexagonal;
  basis << Eigen::Rotation2Dd(angle) * Eigen::Vector2d(field.pitch, 0),
      Eigen::Rotation2Dd(angle + std::numbers::pi / (hexagonal ? 3 : 2)) *
          Eigen::Vector2d(field.pitch * field.aspect, 0);

  RenderedField out{.white = cv::Mat::zeros(field.size[1], field.size[0], CV_32F), .lenses = {}};
  std::mt19937 random(field.seed);
  std::normal_distribution<double> normal;
  const int reach = static_cast<int>(2 * (w + h) / field.pitch);
  // Edges: blur of about the pixel, and defocus that differs by type.
  const std::array<double, 4> radii{0.46, 0.44, 0.47, 0.42}, blurs{0.03, 0.09, 0.05, 0.12};
  for (int row = -reach; row <= reach; ++row) {
    for (int column = -reach; column <= reach; ++column) {
      const Eigen::Vector2d regular = middle + field.offset + basis * Eigen::Vector2d(column, row);
      // Far outside the polynomial folds back.
      if ((regular - middle).norm() > 1.5 * corner) continue;
      const Eigen::Vector2d c = distort(regular);
      const double margin = 0.8 * field.pitch;
      if (c.x() < -margin || c.y() < -margin || c.x() > w + margin || c.y() > h + margin) continue;
      const LatticeNode node{column, row};
      if (IsInside(c, field.size)) out.lenses.push_back({node, c});
      const int type = field.Type(node);
      const double gain =
          field.dead.contains({column, row}) ? 0.05 : 1 + field.gain_scatter * normal(random);
      const double radius = radii[type] * field.pitch * field.fill;
      const double blur = std::hypot(0.5, blurs[type] * field.pitch);
      for (int y = std::max(0.0, std::ceil(c.y() - margin)); y <= std::min(h - 1, c.y() + margin);
           ++y) {
        for (int x = std::max(0.0, std::ceil(c.x() - margin)); x <= std::min(w - 1, c.x() + margin);
             ++x) {
          const Eigen::Vector2d d = undistorted[y * field.size[0] + x] - regular;
          const double disc = 0.5 * std::erfc((d.norm() - radius) / (std::sqrt(2.0) * blur));
          const double fall_off =
              1 / std::pow(1 + 0.2 * (c - middle).squaredNorm() / (corner * corner), 2);
          out.white.at<float>(y, x) +=
              static_cast<float>(disc * gain * fall_off * (1 + field.tilt * d.x()));
        }
      }
    }
  }
  const std::array<double, 4> colours{0.5, 1, 1, 0.6};  // RGGB under a warm light
  for (int y = 0; y < field.size[1]; ++y) {
    for (int x = 0; x < field.size[0]; ++x) {
      const double colour = field.bayer ? colours[2 * (y % 2) + x % 2] : 1;
      const double electrons = field.level * colour * (out.white.at<float>(y, x) + 0.02);
      const double sigma = std::sqrt((electrons + 100) / field.images);
      out.white.at<float>(y, x) = static_cast<float>(electrons + sigma * normal(random));
    }
  }
  return out;
}

}  // namespace plenocal::testing
