// SPDX-License-Identifier: Apache-2.0
//
// Samples of a wall, and predictions of its model, by formulas.
#include "apps/photometry/wall_model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <opencv2/core.hpp>

#include "apps/photometry/vignette_splines.h"
#include "calib/base/error.h"
#include "tests/apps/photometry/small_wall.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

using namespace small_wall;

TEST(WallSamples, AreProjectedIntoTheReducedImage) {
  SmallWall wall = MakeSmallWall({.views = 1});
  wall.recording.reduction = 2;
  const WallRecording recording = Recorded(wall);
  const WallProjector projector(recording);
  EXPECT_EQ(projector.Reduce(0.5), 0);
  EXPECT_EQ(projector.Reduce(4.5), 2);
  EXPECT_EQ(projector.Enlarge(2), 4.5);
  WallView view = recording.views[0];
  view.T_camera_wall = {ExpRotation({0.4, 0.3, 0.2}) * Vector3d(1, -1, -1).asDiagonal(),
                        {0.02, 0.01, 0.8}};
  const Vector3d point(0.03, -0.02, 0);
  const auto place = [&](const Vector3d& p) {
    const Vector3d q = view.T_camera_wall * p;
    return Eigen::Vector2d(projector.Reduce(kFocal * q.x() / q.z() + kCentreX),
                           projector.Reduce(kFocal * q.y() / q.z() + kCentreY));
  };
  WallProjection seen;
  ASSERT_TRUE(projector(view, point, &seen));
  EXPECT_NEAR(seen.x, place(point).x(), 1e-9);
  EXPECT_NEAR(seen.y, place(point).y(), 1e-9);
  // The area by the Jacobian's determinant.
  constexpr double kStep = 1e-5;
  Eigen::Matrix2d J;
  J << (place(point + Vector3d(kStep, 0, 0)) - place(point)) / kStep,
      (place(point + Vector3d(0, kStep, 0)) - place(point)) / kStep;
  EXPECT_NEAR(seen.area / std::abs(J.determinant()), 1, 1e-3);
  // The reduced image of these tests has the size of the whole one.
  EXPECT_FALSE(projector(view, {3, 0, 0}, &seen));
  const RigidTransform T = view.T_camera_wall;
  view.T_camera_wall.t.z() = -0.8;
  EXPECT_FALSE(projector(view, point, &seen));
  // From the edge: at most cos 0.2 from the normal, whatever the side.
  for (const double sign : {1.0, -1.0}) {
    for (const double cosine : {0.19, 0.21}) {
      view.T_camera_wall.R =
          ExpRotation({sign * std::acos(cosine), 0, 0}) * Vector3d(1, -1, -1).asDiagonal();
      view.T_camera_wall.t = {0, 0, 0.8};
      EXPECT_EQ(projector(view, Vector3d::Zero(), &seen), cosine > 0.2);
    }
  }
  view.T_camera_wall = T;
  for (const auto& [x, y, inside] : {std::tuple{0.01, 0.01, true},
                                     {-0.01, 5, false},
                                     {5, -0.01, false},
                                     {158.99, 5, true},
                                     {159.01, 5, false},
                                     {5, 26.99, true},
                                     {5, 27.01, false}}) {
    const Vector3d ray = T.Inverse().R * Vector3d((projector.Enlarge(x) - kCentreX) / kFocal,
                                                  (projector.Enlarge(y) - kCentreY) / kFocal,
                                                  1);
    const Vector3d at = T.Inverse().t - T.Inverse().t.z() / ray.z() * ray;
    EXPECT_EQ(projector(view, at, &seen), inside) << x << ' ' << y;
  }
}

TEST(WallSamples, AreInterpolatedBetweenPixels) {
  cv::Mat image(3, 4, CV_32F);
  for (int i = 0; i < 12; ++i)
    image.at<float>(i / 4, i % 4) = static_cast<float>(i % 4 + 10 * (i / 4) + (i % 4) * (i / 4));
  const auto truth = [](double x, double y) { return x + 10 * y + x * y; };
  for (const auto& [x, y] :
       {std::pair{0.0, 0.0}, {0.3, 0.6}, {2.9, 1.1}, {3.0, 2.0}, {3.0, 0.5}, {1.5, 2.0}}) {
    EXPECT_NEAR(Interpolate(image, x, y), truth(x, y), 1e-5);
  }
  for (const auto& [x, y] : {std::pair{-0.01, 0.0}, {0.0, -0.01}, {3.01, 0.0}, {0.0, 2.01}}) {
    EXPECT_TRUE(std::isnan(Interpolate(image, x, y)));
  }
  image.at<float>(1, 1) = std::nanf("");
  EXPECT_TRUE(std::isnan(Interpolate(image, 0.5, 0.5)));
  EXPECT_FALSE(std::isnan(Interpolate(image, 2.5, 0.5)));
  std::vector<double> values{5, 1, 4, 2, 3};
  EXPECT_EQ(Quantile(&values, 0), 1);
  EXPECT_EQ(Quantile(&values, 0.49), 2);
  EXPECT_EQ(Quantile(&values, 0.5), 3);
  EXPECT_EQ(Quantile(&values, 1), 5);
}

TEST(WallSamples, AreOfAGridOfPixelsOverWhatViewsShow) {
  const SmallWall wall = MakeSmallWall();
  const WallRecording recording = Recorded(wall);
  const WallGrid grid = ChooseGrid(recording, "here");
  const WallProjector projector(recording);
  // Positions of 13 x 13 pixels of all views on the wall.
  std::vector<double> xs, ys, areas;
  for (const WallView& view : recording.views) {
    const RigidTransform back = view.T_camera_wall.Inverse();
    for (int j = 0; j <= 12; ++j) {
      for (int i = 0; i <= 12; ++i) {
        const Vector3d ray = back.R * Vector3d((i / 12.0 * (kWidth - 1) - kCentreX) / kFocal,
                                               (j / 12.0 * (kHeight - 1) - kCentreY) / kFocal,
                                               1);
        const Vector3d p = back.t - back.t.z() / ray.z() * ray;
        WallProjection seen;
        if (!projector(view, p, &seen)) continue;
        xs.push_back(p.x()), ys.push_back(p.y()), areas.push_back(seen.area);
      }
    }
  }
  std::ranges::sort(xs), std::ranges::sort(ys), std::ranges::sort(areas);
  const auto at = [](const std::vector<double>& sorted, double share) {
    return sorted[static_cast<size_t>(share * static_cast<double>(sorted.size() - 1))];
  };
  // Rounding decides which pixels of the border count.
  EXPECT_TRUE(grid.x >= at(xs, 0.005) && grid.x <= at(xs, 0.02)) << grid.x;
  EXPECT_TRUE(grid.y >= at(ys, 0.005) && grid.y <= at(ys, 0.02)) << grid.y;
  EXPECT_NEAR(grid.cell, 1 / std::sqrt(areas[areas.size() / 2]), 1e-4);
  EXPECT_NEAR(grid.columns, (at(xs, 0.99) - grid.x) / grid.cell + 1, 8);
  EXPECT_NEAR(grid.rows, (at(ys, 0.99) - grid.y) / grid.cell + 1, 8);
  EXPECT_EQ(grid.At(3, 2), Vector3d(grid.x + 3 * grid.cell, grid.y + 2 * grid.cell, 0));

  const std::vector<WallRow> rows = SampleWall(recording, grid, 2);
  ASSERT_EQ(rows.size(), static_cast<size_t>(grid.rows));
  size_t total = 0;
  for (int r = 0; r < grid.rows; ++r) {
    const WallRow& row = rows[static_cast<size_t>(r)];
    ASSERT_EQ(row.begin.size(), static_cast<size_t>(grid.columns) + 1);
    for (int column = 0; column < grid.columns; ++column) {
      const Vector3d point = grid.At(column, r);
      std::vector<WallSample> expected;
      const bool marker = std::abs(point.x()) < 0.05 && std::abs(point.y()) < 0.04;
      for (size_t v = 0; v < recording.views.size() && !marker; ++v) {
        const Vector3d p = recording.views[v].T_camera_wall * point;
        const double x = kFocal * p.x() / p.z() + kCentreX, y = kFocal * p.y() / p.z() + kCentreY;
        WallProjection seen;
        if (!projector(recording.views[v], point, &seen)) continue;
        expected.push_back(
            {.view = static_cast<std::uint16_t>(v),
             .x = static_cast<float>(x),
             .y = static_cast<float>(y),
             .brightness = Interpolate(recording.views[v].brightness, seen.x, seen.y),
             .light = Interpolate(recording.views[v].light, seen.x, seen.y),
             .density = static_cast<float>(1 / (seen.area * grid.cell * grid.cell))});
      }
      if (expected.size() < 3) expected.clear();
      const auto found = row.Samples(static_cast<size_t>(column));
      ASSERT_EQ(found.size(), expected.size());
      total += found.size();
      for (size_t k = 0; k < found.size(); ++k) {
        EXPECT_EQ(found[k].view, expected[k].view);
        EXPECT_NEAR(found[k].x, expected[k].x, 1e-3);
        EXPECT_NEAR(found[k].y, expected[k].y, 1e-3);
        EXPECT_EQ(found[k].brightness, expected[k].brightness);
        EXPECT_EQ(found[k].light, expected[k].light);
        EXPECT_EQ(found[k].density, expected[k].density);
      }
    }
  }
  EXPECT_GT(total, 20000u);
  EXPECT_EQ(WallModel(Recorded(wall), "here", 1).Measurements(), total);
  // Of views from the edge there is no grid.
  WallRecording edge = Recorded(wall);
  for (WallView& view : edge.views) view.T_camera_wall.R = ExpRotation({kPi / 2, 0, 0});
  EXPECT_EQ(
      RefusalOf([&] { ChooseGrid(edge, "here"); }, ErrorKind::kJob),
      "here: the wall is behind the cameras or seen from its edge; check the target's file and the calibration");
}

TEST(WallModel, PredictsTheLightOfSamplesWithTheirNoise) {
  const SmallWall wall = MakeSmallWall();
  WallModel model(Recorded(wall), "here", 2);
  EXPECT_EQ(model.Gains(), Eigen::VectorXd::Zero(18));
  EXPECT_EQ(model.Used(), Eigen::VectorXd::Ones(18));
  cv::Mat v(kHeight, kWidth, CV_32F);
  for (int i = 0; i < kWidth * kHeight; ++i)
    v.at<float>(i / kWidth, i % kWidth) = static_cast<float>(-0.002 * (i % kWidth));
  model.SetAttenuation(v);
  model.ChangeGains(Eigen::VectorXd::LinSpaced(18, -0.05, 0.05));
  model.EstimateWall();
  size_t checked = 0;
  for (size_t r = 1; r + 1 < model.Rows().size(); r += 3) {
    for (size_t column = 1; column + 1 < model.Brightness()[r].size(); column += 3) {
      const auto samples = model.Rows()[r].Samples(column);
      const auto& c = model.Brightness();
      if (samples.empty()) {
        EXPECT_TRUE(std::isnan(c[r][column]));
        continue;
      }
      // The weighted mean residual is zero there.
      double sum = 0, weights = 0;
      // The mean brightness of the cells at most four away.
      double around = 0, count = 0;
      for (size_t y = r < 4 ? 0 : r - 4; y < std::min(r + 5, c.size()); ++y) {
        for (size_t x = column < 4 ? 0 : column - 4; x < std::min(column + 5, c[y].size()); ++x) {
          if (!std::isnan(c[y][x])) around += std::exp(c[y][x]), count += 1;
        }
      }
      const double differences = (std::pow(c[r - 1][column] - c[r][column], 2) +
                                  std::pow(c[r + 1][column] - c[r][column], 2) +
                                  std::pow(c[r][column - 1] - c[r][column], 2) +
                                  std::pow(c[r][column + 1] - c[r][column], 2)) /
                                 4;
      const double texture = model.Texture({r, column});
      if (std::isnan(differences)) {
        EXPECT_TRUE(std::isnan(texture));
      } else {
        EXPECT_NEAR(texture, differences, 1e-6 + 1e-4 * differences);
      }
      for (const WallSample& s : samples) {
        const WallModel::Expected at = model.Expect(s, {r, column});
        const double predicted = -0.05 + 0.1 * s.view / 17 - 0.002 * s.x;
        const double scale = std::exp(predicted) * wall.recording.views[s.view].exposure;
        EXPECT_NEAR(at.light, scale * around / count, 1e-3);
        EXPECT_NEAR(at.residual, std::log(s.light / (scale * std::exp(c[r][column]))), 1e-4);
        // Shot noise of 10000 electrons and rounding of a linear response, relative.
        const double variance = (255 / 1e4 * at.light + 1.0 / 12) / std::pow(at.light, 2);
        EXPECT_NEAR(at.weight * variance * std::max<double>(s.density, 4.0 / 9), 1, 0.01);
        const double fx = s.x - std::floor(s.x), fy = s.y - std::floor(s.y);
        const double mixing = (fx * fx + (1 - fx) * (1 - fx)) * (fy * fy + (1 - fy) * (1 - fy));
        EXPECT_NEAR(model.Noise(s, at.light) / (variance * mixing), 1, 0.01);
        sum += at.weight * at.residual, weights += at.weight;
      }
      EXPECT_NEAR(sum / weights, 0, 0.01);
      ++checked;
    }
  }
  EXPECT_GT(checked, 100u);
  const size_t last = model.Rows().size() - 1, end = model.Brightness()[0].size() - 1;
  for (const WallModel::Cell& cell : {WallModel::Cell{0, 5}, {5, 0}, {last, 5}, {5, end}})
    EXPECT_TRUE(std::isnan(model.Texture(cell)));
}

TEST(WallModel, HasNormalEquationsWithTheWallEliminated) {
  const SmallWall wall = MakeSmallWall({.views = 12});
  WallModel model(Recorded(wall), "here", 2);
  const VignetteSplines splines(&model);
  model.EstimateWall();
  const ImageSpline& spline = splines.Coarse();
  EXPECT_EQ(spline.Columns(), 8 + 3);  // eight cells along the longer side
  const Eigen::Index nv = spline.Coefficients(), n = nv + 12;
  for (const bool some : {false, true}) {
    std::vector<bool> only(12, true);
    if (some) only[2] = only[7] = false;
    const CoarseSystem found = splines.MakeCoarseSystem(some ? only : std::vector<bool>());
    Eigen::MatrixXd S = Eigen::MatrixXd::Zero(n, n), known = Eigen::MatrixXd::Zero(nv, nv);
    Eigen::VectorXd b = Eigen::VectorXd::Zero(n);
    for (size_t r = 0; r < model.Rows().size(); ++r) {
      for (size_t cell = 0; cell < model.Brightness()[r].size(); ++cell) {
        Eigen::VectorXd by_wall = Eigen::VectorXd::Zero(n);
        double weight = 0, score = 0;
        for (const WallSample& s : model.Rows()[r].Samples(cell)) {
          if (!only[s.view]) continue;
          const WallModel::Expected at = model.Expect(s, {r, cell});
          const ImageSpline::Basis basis = spline.At(s.x, s.y);
          Eigen::VectorXd J = Eigen::VectorXd::Zero(n);
          for (size_t k = 0; k < 16; ++k) J[basis.index[k]] = basis.weight[k];
          J[nv + s.view] = 1;
          // Few of the entries are not zero.
          for (size_t k = 0; k < 17; ++k) {
            const Eigen::Index i = k < 16 ? basis.index[k] : nv + s.view;
            for (size_t l = 0; l < 17; ++l) {
              const Eigen::Index j = l < 16 ? basis.index[l] : nv + s.view;
              S(i, j) += at.weight * J[i] * J[j];
              if (k < 16 && l < 16) known(i, j) += at.weight * J[i] * J[j];
            }
            by_wall[i] += at.weight * J[i];
            b[i] += at.weight * at.residual * J[i];
          }
          weight += at.weight, score += at.weight * at.residual;
        }
        if (weight == 0) continue;
        S -= by_wall * by_wall.transpose() / weight;
        b -= by_wall * score / weight;
      }
    }
    // Priors: gains to 2 %, the mean of v, hardly any curvature.
    S.diagonal().tail(12).array() += 1 / 0.0004;
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(nv);
    for (int i = 0; i < kWidth * kHeight; ++i) {
      const ImageSpline::Basis basis = spline.At(i % kWidth, i / kWidth);
      for (size_t k = 0; k < 16; ++k) mean[basis.index[k]] += basis.weight[k] / (kWidth * kHeight);
    }
    const double scale = known.diagonal().mean();
    S.topLeftCorner(nv, nv) += scale * static_cast<double>(nv) * mean * mean.transpose();
    S.topLeftCorner(nv, nv).diagonal().array() += 1e-6 * scale;
    known.diagonal().array() += 1e-6 * scale;
    EXPECT_LT((found.S - S).norm(), 1e-6 * S.norm());
    EXPECT_LT((found.known - known).norm(), 1e-6 * known.norm());
    EXPECT_LT((found.b - b).norm(), 1e-5 * b.norm());
    EXPECT_LT((S * found.Solve() - b).norm(), 1e-5 * b.norm());
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
