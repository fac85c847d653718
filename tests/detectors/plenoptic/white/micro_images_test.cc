// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/micro_images.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

#include "tests/detectors/plenoptic/white/white_field.h"

namespace plenocal::internal {
namespace TEST_FILE {

using plenocal::testing::Render;
using plenocal::testing::RenderedField;
using plenocal::testing::TrueLens;
using plenocal::testing::WhiteField;

// The micro images of a field, placed `off` px beside their centres, and measured.
struct Measured {
  RenderedField rendered;
  MicroImages images;

  Measured(const WhiteField& field, const std::vector<int>& types, int type_count)
      : rendered(Render(field)), images(rendered.white, Basis(field), 2) {
    std::vector<LatticeNode> nodes;
    std::vector<Eigen::Vector2d> centres;
    for (const TrueLens& lens : rendered.lenses) {
      nodes.push_back(lens.node);
      centres.push_back(lens.centre + Eigen::Vector2d(0.3, -0.2));
    }
    const std::vector<LocalMap> maps(nodes.size(), LocalMap::Identity());
    std::vector<int> all = types;
    if (all.empty()) all.assign(nodes.size(), 0);
    // The profiles first fit to micro images that are a little beside their places.
    for (int round = 0; round < 3; ++round) {
      images.Place(nodes, centres, maps);
      images.Measure(all, type_count);
    }
  }

  static Eigen::Matrix2d Basis(const WhiteField& field) {
    const double angle = field.rotation_deg * std::numbers::pi / 180;
    Eigen::Matrix2d basis;
    basis << Eigen::Rotation2Dd(angle) * Eigen::Vector2d(field.pitch, 0),
        Eigen::Rotation2Dd(angle + std::numbers::pi / 3) * Eigen::Vector2d(field.pitch, 0);
    return basis;
  }
};

TEST(MicroImages, AreMeasuredAtTheirCentres) {
  const Measured field({.size = {320, 240}, .types = 1, .gain_scatter = 0.02}, {}, 1);
  double squares = 0;
  int usable = 0, whole = 0, both = 0;
  for (size_t i = 0; i < field.rendered.lenses.size(); ++i) {
    const MicroImage& image = field.images.Images()[i];
    EXPECT_EQ(field.images.Nodes()[i], field.rendered.lenses[i].node);
    usable += field.images.IsUsable(i) ? 1 : 0;
    both += field.images.IsUsable(i) && field.images.IsWhole(i) ? 1 : 0;
    // Whole ones are half a pitch of 20 px within the image.
    const Eigen::Vector2d& c = field.rendered.lenses[i].centre;
    const double margin = std::min({c.x(), c.y(), 319 - c.x(), 239 - c.y()});
    EXPECT_TRUE(margin <= 11 || field.images.IsWhole(i));
    EXPECT_FALSE(margin < 9 && field.images.IsWhole(i));
    if (!field.images.IsWhole(i)) continue;
    ++whole;
    const double error = (image.centre - c).norm();
    squares += error * error;
    EXPECT_LT(error, 0.1) << i;
    EXPECT_NEAR(image.scale, 1, 0.02);
    EXPECT_GT(image.centre_sigma, 0);
    EXPECT_LT(image.residual / image.gain, 0.02);
  }
  EXPECT_GT(whole, 100);
  EXPECT_GT(usable, 0.95 * static_cast<double>(field.rendered.lenses.size()));
  EXPECT_LT(std::sqrt(squares / whole), 0.03);
  EXPECT_EQ(field.images.Measurements().size(), static_cast<size_t>(both));
  EXPECT_NEAR(field.images.GainSpread(), 0.02, 0.006);
  EXPECT_LT(field.images.Misfit(), 0.02);
}

TEST(MicroImages, OfDeadMicroLensesAreNotUsable) {
  const std::set<std::pair<int, int>> dead{{0, 0}, {2, 1}, {-3, 2}};
  const Measured field({.size = {320, 240}, .types = 1, .dead = dead}, {}, 1);
  int found = 0, others = 0;
  for (size_t i = 0; i < field.rendered.lenses.size(); ++i) {
    const LatticeNode& node = field.rendered.lenses[i].node;
    if (!field.images.IsWhole(i)) continue;
    if (dead.contains({node.column, node.row})) {
      EXPECT_FALSE(field.images.IsUsable(i));
      ++found;
    } else {
      others += field.images.IsUsable(i) ? 0 : 1;
    }
  }
  EXPECT_EQ(found, 3);
  EXPECT_LE(others, 2);
  for (const LatticeMeasurement& each : field.images.Measurements()) {
    EXPECT_FALSE(dead.contains({each.node.column, each.node.row}));
  }
}

// They send light onto the sensor but are not measured.
TEST(MicroImages, BesideTheSensorHaveTheMeansOfTheirNeighboursOnIt) {
  const WhiteField field{.size = {200, 160}, .types = 1, .tilt = 0.004, .gain_scatter = 0.05};
  const RenderedField rendered = Render(field);
  const Eigen::Matrix2d basis = Measured::Basis(field);
  const Eigen::Vector2d first =
      rendered.lenses[0].centre -
      basis * Eigen::Vector2d(rendered.lenses[0].node.column, rendered.lenses[0].node.row);
  std::vector<LatticeNode> nodes;
  std::vector<Eigen::Vector2d> centres;
  for (int row = -9; row <= 9; ++row) {
    for (int column = -14; column <= 14; ++column) {
      nodes.push_back({column, row});
      centres.emplace_back(first + basis * Eigen::Vector2d(column, row));
    }
  }
  MicroImages images(rendered.white, basis, 1);
  for (int round = 0; round < 2; ++round) {
    images.Place(nodes, centres, std::vector<LocalMap>(nodes.size(), LocalMap::Identity()));
    images.Measure(std::vector<int>(nodes.size(), 0), 1);
  }
  int beside = 0, far = 0, with_size = 0;
  for (size_t i = 0; i < nodes.size(); ++i) {
    if (images.IsInside(i)) continue;
    double gain = 0, scale = 0, count = 0, whole = 0;
    Eigen::Vector2d gradient(0, 0);
    for (size_t j = 0; j < nodes.size(); ++j) {
      const double distance = (centres[j] - centres[i]).norm();
      if (!images.IsInside(j) || distance > 1.1 * field.pitch) continue;
      gain += images.Images()[j].gain;
      gradient += images.Images()[j].gradient;
      ++count;
      if (!images.IsWhole(j)) continue;
      scale += images.Images()[j].scale;
      ++whole;
    }
    const MicroImage& image = images.Images()[i];
    ++(count > 0 ? beside : far);
    EXPECT_NEAR(image.gain, count > 0 ? gain / count : 0, 1e-6);
    EXPECT_LT((image.gradient - gradient / std::max(count, 1.0)).norm(), 1e-6);
    if (whole == 0) continue;
    ++with_size;
    EXPECT_NEAR(image.scale, scale / whole, 1e-9);
  }
  EXPECT_GT(beside, 20);
  EXPECT_GT(far, 20);
  EXPECT_GT(with_size, 10);
}

TEST(MicroImages, ShowTheirTypes) {
  for (const int types : {1, 3}) {
    const WhiteField with{.size = {400, 300}, .types = types};
    Measured field(with, {}, 1);
    const MicroImages::Types found = field.images.FindTypes();
    EXPECT_EQ(found.Count(), types);
    if (types == 1) {
      EXPECT_LT(found.share, 0.5);
      continue;
    }
    EXPECT_GT(found.share, 0.9);
    // The same up to their names.
    std::map<int, std::set<int>> names;
    for (const TrueLens& lens : field.rendered.lenses) {
      names[with.Type(lens.node)].insert(found.Of(lens.node));
    }
    EXPECT_EQ(names.size(), 3);
    for (const auto& [type, of_type] : names) EXPECT_EQ(of_type.size(), 1) << type;
  }
}

TEST(RobustSpread, IsMedianAndScatterWithoutOutliers) {
  std::vector<double> values;
  for (int i = -50; i <= 50; ++i) values.push_back(3 + 0.01 * i);
  values.push_back(1e6);
  values.push_back(1e6);
  const Spread spread = RobustSpread(values);
  EXPECT_NEAR(spread.middle, 3, 0.02);
  // Of uniform values from -0.5 to 0.5 half lie within 0.25, of normal ones within 0.6745 sigma.
  EXPECT_NEAR(spread.sigma, 0.25 / 0.6745, 0.02);
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
