// SPDX-License-Identifier: Apache-2.0
//
// Fits on a small camera against truth, and what they report against sums over all samples.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>

#include "apps/photometry/vignette_fit.h"
#include "apps/photometry/vignette_splines.h"
#include "apps/photometry/wall_model.h"
#include "calib/base/error.h"
#include "calib/base/statistics.h"
#include "tests/apps/photometry/small_wall.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

using namespace small_wall;
using ::testing::IsEmpty;

struct Measured {
  WallModel::Cell cell;
  WallSample sample;
  WallModel::Expected at;
};

std::vector<Measured> AllSamples(const WallModel& model) {
  std::vector<Measured> all;
  for (size_t r = 0; r < model.Rows().size(); ++r) {
    for (size_t column = 0; column < model.Brightness()[r].size(); ++column) {
      if (std::isnan(model.Brightness()[r][column])) continue;
      double total = 0;
      const size_t first = all.size();
      for (const WallSample& s : model.Rows()[r].Samples(column)) {
        all.push_back({{r, column}, s, model.Expect(s, {r, column})});
        total += all.back().at.weight;
      }
      for (size_t i = first; i < all.size(); ++i)
        all[i].at.freedom = std::max(1 - all[i].at.weight / total, 0.1);
    }
  }
  std::erase_if(all, [](const Measured& m) { return !(m.at.weight > 0); });
  return all;
}

double Ranked(std::vector<double> values, double share) {
  std::ranges::sort(values);
  return values[static_cast<size_t>(share * static_cast<double>(values.size() - 1))];
}

void ExpectSumsOfSamples(const VignetteEstimate& found, const WallModel& model) {
  constexpr int kBins = 179;
  const std::vector<Measured> all = AllSamples(model);
  double squares = 0, spreads = 0, robusts = 0, outliers = 0;
  std::vector<double> weights(kBins + 1), residuals(kBins + 1);
  std::map<std::pair<size_t, size_t>, Eigen::Array3d> blocks;
  for (const auto& [cell, s, at] : all) {
    const double square = at.residual * at.residual, noise = model.Noise(s, at.light);
    const double q = square / (36 * noise * at.freedom), robust = q < 1 ? (1 - q) * (1 - q) : 0;
    squares += robust * square, spreads += robust * noise * at.freedom, robusts += robust;
    if (square > 9 * noise * at.freedom) ++outliers;
    const RigidTransform& T = model.Wall().views[s.view].T_camera_wall;
    const Vector3d ray =
        T * model.Grid().At(static_cast<int>(cell.column), static_cast<int>(cell.row));
    const double angle = std::acos(std::abs(T.R.col(2).dot(ray.normalized())));
    const auto bin = static_cast<size_t>(angle / (kPi / 2) * kBins);
    weights[bin] += at.weight, residuals[bin] += at.weight * at.residual;
    const double texture = model.Texture(cell);
    if (std::isnan(texture)) continue;
    blocks.try_emplace({cell.row / 8, cell.column / 8}, Eigen::Array3d::Zero()).first->second +=
        Eigen::Array3d(square / at.freedom, noise, texture);
  }
  EXPECT_EQ(found.measurements, all.size());
  EXPECT_NEAR(found.residual, std::sqrt(squares / robusts), 1e-7);
  EXPECT_NEAR(found.expected, std::sqrt(spreads / robusts), 1e-7);
  EXPECT_NEAR(found.outliers, outliers / static_cast<double>(all.size()), 1e-9);
  EXPECT_GT(outliers, 0);
  // Fifths of the weight.
  double total = 0, passed = 0;
  for (const double weight : weights) total += weight;
  size_t bin = 0;
  EXPECT_EQ(found.angle_limits[0], 0);
  for (size_t fifth = 0; fifth < 5; ++fifth) {
    double weight = 0, residual = 0;
    for (; passed + weight < total * static_cast<double>(fifth + 1) / 5 * (1 - 1e-12); ++bin)
      weight += weights[bin], residual += residuals[bin];
    passed += weight;
    EXPECT_NEAR(found.by_angle[fifth], residual / weight, 1e-7);
    EXPECT_NEAR(found.angle_limits[fifth + 1], static_cast<double>(bin) * kPi / 2 / kBins, 1e-9);
  }
  std::vector<double> shares, ratios;
  for (const auto& [place, sums] : blocks)
    shares.push_back(std::max(sums[0] - sums[1], 0.0) / sums[2]);
  const double share = Median(shares);
  for (const auto& [place, sums] : blocks) ratios.push_back(sums[0] / (sums[1] + share * sums[2]));
  EXPECT_NEAR(found.unevenness, Ranked(ratios, 0.9) / Ranked(ratios, 0.2), 1e-6);
}

// Values of the spline at the middles of cells by its coefficients.
Eigen::MatrixXd AtCells(const ImageSpline& spline, int columns, int rows, Eigen::MatrixXd* places) {
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(columns * rows, spline.Coefficients());
  *places = Eigen::MatrixXd(columns * rows, 2);
  for (int row = 0, i = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column, ++i) {
      const double x = (column + 0.5) / columns, y = (row + 0.5) / rows;
      places->row(i) << x - 0.5, y - 0.5;
      const ImageSpline::Basis basis = spline.At(x * kWidth - 0.5, y * kHeight - 0.5);
      for (size_t k = 0; k < 16; ++k) B(i, basis.index[k]) = basis.weight[k];
    }
  }
  return B;
}

void ExpectOpenModes(const VignetteEstimate& found,
                     const ImageSpline& spline,
                     const Eigen::MatrixXd& covariance) {
  Eigen::MatrixXd places;
  const Eigen::MatrixXd B = AtCells(spline, 12, 9, &places);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> modes(B * covariance * B.transpose());
  Eigen::MatrixXd shapes(108, 3);
  shapes << places, (places.rowwise().squaredNorm().array() - 1.0 / 6).matrix();
  shapes.colwise().normalize();
  size_t count = 0;
  for (int m = 107; m >= 0; --m) {
    const double sigma = std::sqrt(std::max(modes.eigenvalues()[m], 0.0) / 108);
    if (sigma < 0.005) break;
    ASSERT_LT(count, found.open.size());
    EXPECT_NEAR(found.open[count].sigma, sigma, 1e-6);
    Eigen::Index best = 0;
    const double alike =
        (shapes.transpose() * modes.eigenvectors().col(m)).cwiseAbs().maxCoeff(&best);
    const std::array<std::string, 3> names{
        "a tilt along x", "a tilt along y", "a fall-off towards the border"};
    EXPECT_EQ(found.open[count++].name,
              alike > 0.7 ? names[static_cast<size_t>(best)] : "a slowly varying pattern");
  }
  EXPECT_EQ(count, found.open.size());
}

// Views turned by a right angle are every second one.
void ExpectShading(const ShadingTest& found,
                   const WallModel& model,
                   const VignetteSplines& splines) {
  ASSERT_TRUE(found.tested);
  std::vector<bool> upright, turned;
  for (size_t i = 0; i < model.Wall().views.size(); ++i)
    upright.push_back(i % 2 == 0), turned.push_back(i % 2 == 1);
  const CoarseSystem a = splines.MakeCoarseSystem(upright), b = splines.MakeCoarseSystem(turned);
  const Eigen::Index nv = splines.Coarse().Coefficients();
  const Eigen::VectorXd difference = (a.S.ldlt().solve(a.b) - b.S.ldlt().solve(b.b)).head(nv);
  const Eigen::MatrixXd covariance =
      a.S.inverse().topLeftCorner(nv, nv) + b.S.inverse().topLeftCorner(nv, nv);
  Eigen::MatrixXd places;
  const Eigen::MatrixXd B = AtCells(splines.Coarse(), 8, 8, &places);
  Eigen::MatrixXd P(64, 6);
  for (int i = 0; i < 64; ++i) {
    const double x = places(i, 0), y = places(i, 1);
    P.row(i) << x, y, x * x, x * y, y * y, 1;
  }
  const Eigen::MatrixXd fit = P.householderQr().solve(B).topRows(5);
  const Eigen::VectorXd terms = fit * difference;
  const Eigen::MatrixXd of_terms = fit * covariance * fit.transpose();
  EXPECT_NEAR(found.chance, ChiSquareTail(5, terms.dot(of_terms.ldlt().solve(terms))), 1e-6);
  const Eigen::MatrixXd centred = P.leftCols(5).rowwise() - P.leftCols(5).colwise().mean();
  EXPECT_NEAR(found.difference, std::sqrt((centred * terms).squaredNorm() / 64), 1e-7);
  EXPECT_NEAR(found.sigma,
              std::sqrt((centred * of_terms * centred.transpose()).diagonal().sum() / 64),
              1e-7);
}

// The rounds of the fit again, and all that it reports, from the model that they leave.
void ExpectEstimateOfItsModel(const WallRecording& recording,
                              const VignetteEstimate& found,
                              bool shading) {
  WallModel model(recording, "here", 1);
  VignetteSplines splines(&model);
  const auto rounds = [&](int count) {
    for (int i = 0; i < count; ++i) splines.Round();
  };
  rounds(2);
  for (int i = 0; i < 3; ++i) model.RefinePoses(), rounds(1);
  while (model.LeaveOutMisplaced()) rounds(1);
  model.EstimateNoise();
  model.RefinePoses();
  rounds(1);
  model.EstimateNoise();
  rounds(3);
  model.EstimateNoise();
  rounds(1);
  model.EstimateWall();
  ExpectSumsOfSamples(found, model);
  const CoarseSystem system = splines.MakeCoarseSystem();
  const Eigen::Index nv = splines.Coarse().Coefficients();
  const Eigen::MatrixXd all = splines.CoarseCovariance(system);
  const Eigen::MatrixXd covariance = all.topLeftCorner(nv, nv);
  EXPECT_LT(cv::norm(found.attenuation, splines.FineAttenuation(), cv::NORM_INF), 1e-6);
  EXPECT_LT(cv::norm(found.sigma, splines.FineSigma(system, covariance), cv::NORM_INF), 1e-7);
  ExpectOpenModes(found, splines.Coarse(), covariance);
  const auto views = static_cast<Eigen::Index>(recording.views.size());
  ASSERT_EQ(found.gains.size(), recording.views.size());
  ASSERT_EQ(found.gain_sigma.size(), recording.views.size());
  for (Eigen::Index i = 0; i < views; ++i) {
    EXPECT_NEAR(found.gains[static_cast<size_t>(i)], std::exp(model.Gains()[i]), 1e-7);
    Eigen::VectorXd contrast = Eigen::VectorXd::Zero(nv + views);
    contrast.tail(views) = -model.Used() / model.Used().sum();
    contrast[nv + i] += 1;
    EXPECT_NEAR(
        found.gain_sigma[static_cast<size_t>(i)], std::sqrt(contrast.dot(all * contrast)), 1e-7);
  }
  EXPECT_EQ(found.wall_cell, model.Grid().cell);
  ASSERT_EQ(found.wall.size(), cv::Size(model.Grid().columns, model.Grid().rows));
  float most = -1e9F;
  for (const auto& row : model.Brightness()) {
    for (const float c : row) most = std::fmax(most, c);
  }
  for (int y = 0; y < found.wall.rows; y += 3) {
    for (int x = 0; x < found.wall.cols; ++x) {
      const float c = model.Brightness()[static_cast<size_t>(y)][static_cast<size_t>(x)];
      if (std::isnan(c)) {
        EXPECT_TRUE(std::isnan(found.wall.at<float>(y, x)));
      } else {
        EXPECT_NEAR(found.wall.at<float>(y, x), std::exp(c - most), 1e-5);
      }
    }
  }
  if (shading) {
    ExpectShading(found.shading, model, splines);
  } else {
    EXPECT_FALSE(found.shading.tested);
    EXPECT_EQ(found.shading.chance, 1);
  }
}

VignetteEstimate FitSmall(const WallChanges& changes, int threads = 2) {
  const SmallWall wall = MakeSmallWall(changes);
  return FitVignette(Recorded(wall), "here", threads, [](const std::string&) { return true; });
}

TEST(SmallVignette, IsFoundWithItsGainsAndStandardDeviations) {
  const SmallWall wall = MakeSmallWall();
  std::vector<std::string> stages;
  const VignetteEstimate found =
      FitVignette(Recorded(wall), "here", 2, [&](const std::string& stage) {
        return stages.push_back(stage), true;
      });
  EXPECT_THAT(stages,
              ::testing::ElementsAre("wall: points in all images",
                                     "wall: first rounds",
                                     "wall: poses by its texture",
                                     "wall: poses by its texture",
                                     "wall: poses by its texture",
                                     "wall: poses by its texture",
                                     "wall: last rounds",
                                     "wall: standard deviations"));
  EXPECT_THAT(found.misplaced, IsEmpty());
  double mean = 0, squares = 0, chi_square = 0;
  for (int i = 0; i < kWidth * kHeight; ++i) {
    mean += std::log(found.attenuation.at<float>(i / kWidth, i % kWidth) /
                     TrueAttenuation(i % kWidth, i / kWidth)) /
            (kWidth * kHeight);
  }
  for (int i = 0; i < kWidth * kHeight; ++i) {
    const double error = std::log(found.attenuation.at<float>(i / kWidth, i % kWidth) /
                                  TrueAttenuation(i % kWidth, i / kWidth)) -
                         mean;
    squares += error * error / (kWidth * kHeight);
    chi_square +=
        std::pow(error / found.sigma.at<float>(i / kWidth, i % kWidth), 2) / (kWidth * kHeight);
  }
  EXPECT_LT(std::sqrt(squares), 0.004);
  EXPECT_TRUE(chi_square > 0.2 && chi_square < 4) << chi_square;
  double mean_error = 0, gains = 0;
  for (size_t i = 0; i < 18; ++i) mean_error += (std::log(found.gains[i]) - wall.errors[i]) / 18;
  for (size_t i = 0; i < 18; ++i)
    gains +=
        std::pow((std::log(found.gains[i]) - wall.errors[i] - mean_error) / found.gain_sigma[i],
                 2) /
        18;
  EXPECT_TRUE(gains > 0.2 && gains < 4) << gains;
  EXPECT_NEAR(found.residual, found.expected, 0.15 * found.expected);
  EXPECT_LT(found.outliers, 0.02);
  EXPECT_TRUE(found.unevenness > 1 && found.unevenness < 4) << found.unevenness;
  for (const double residual : found.by_angle) EXPECT_NEAR(residual, 0, 0.003);
  EXPECT_EQ(found.angle_limits[0], 0);
  for (size_t i = 1; i < 6; ++i) EXPECT_GT(found.angle_limits[i], found.angle_limits[i - 1]);
  EXPECT_TRUE(found.shading.tested);
  EXPECT_GT(found.shading.chance, 1e-3);
}

TEST(SmallVignette, TellsWhatIsWrongWithTheWall) {
  // 9 upright views, and as many turned ones as the test of the shading needs.
  const WallChanges changes{.views = 17, .shading = 0.1, .misplaced = 4};
  const VignetteEstimate shaded = FitSmall(changes);
  ExpectEstimateOfItsModel(Recorded(MakeSmallWall(changes)), shaded, true);
  EXPECT_THAT(shaded.misplaced, ::testing::ElementsAre("4"));
  EXPECT_LT(shaded.shading.chance, 1e-3);
  EXPECT_GT(shaded.shading.difference, 0.003);
}

TEST(SmallVignette, NeedsMeasurements) {
  SmallWall few = MakeSmallWall({.views = 7});
  EXPECT_THAT(
      RefusalOf(
          [&] { FitVignette(Recorded(few), "here", 1, [](const std::string&) { return true; }); },
          ErrorKind::kJob),
      ::testing::MatchesRegex(
          "here: the images have only [0-9]+ measurements of points that at least three of them show; move the camera less "
          "between images, avoid saturation"));
  EXPECT_THROW(FitVignette(Recorded(few), "here", 1, [](const std::string&) { return false; }),
               Stopped);
}

TEST(SmallVignette, TellsWhatTheViewsLeaveOpen) {
  // Views of one roll: tilts are open without exposures, and nothing tests the shading.
  SmallWall unknown = MakeSmallWall({.noise = 12});
  std::vector<WallView> upright;
  for (size_t i = 0; i < 18; i += 2)
    upright.push_back(unknown.recording.views[i]), upright.push_back(unknown.recording.views[i]);
  unknown.recording.views = upright;
  unknown.recording.exposures_known = false;
  const VignetteEstimate open =
      FitVignette(Recorded(unknown), "here", 1, [](const std::string&) { return true; });
  ExpectEstimateOfItsModel(Recorded(unknown), open, false);
  ASSERT_FALSE(open.open.empty()) << ::testing::PrintToString(open.gain_sigma);
  EXPECT_EQ(open.open[0].name, "a tilt along x");
  EXPECT_GT(open.open[0].sigma, 0.005);
}

// Of reduced images: all sums over the samples again.
TEST(VignetteSplines, HaveTheCovarianceOfBlocksAndPixels) {
  SmallWall wall = MakeSmallWall({.views = 12});
  wall.camera.image_size = {2 * kWidth, 2 * kHeight};
  wall.camera.params = {2 * kFocal, 2 * kFocal, 2 * kCentreX + 0.5, 2 * kCentreY + 0.5, 0, 0, 0};
  wall.recording.reduction = 2;
  WallModel model(Recorded(wall), "here", 2), same(Recorded(wall), "here", 1);
  VignetteSplines splines(&model);
  const VignetteSplines of_same(&same);
  splines.Round();
  const auto enlarge = [](double x) { return 2 * x + 0.5; };
  const ImageSpline fine = MakeAttenuationSpline(wall.camera.image_size);
  const ImageSpline& coarse = splines.Coarse();
  const auto at = [&](const ImageSpline& spline, double x, double y) {
    return spline.At(enlarge(x), enlarge(y));
  };
  const auto sum_pixels = [&](const WallModel& of) {
    Eigen::ArrayXXd sums = Eigen::ArrayXXd::Zero(2, kWidth * kHeight);
    for (const auto& [cell, s, expected] : AllSamples(of)) {
      const double value = expected.residual + Interpolate(of.Attenuation(), s.x, s.y);
      const long i = std::lrint(s.y) * kWidth + std::lrint(s.x);
      sums(0, i) += expected.weight, sums(1, i) += expected.weight * value;
    }
    return sums;
  };
  const auto fit_of = [&](const Eigen::ArrayXXd& sums) {
    SplineFit fit(fine);
    for (int i = 0; i < kWidth * kHeight; ++i) {
      if (sums(0, i) > 0)
        fit.Add(enlarge(i % kWidth), enlarge(i / kWidth), sums(1, i) / sums(0, i), sums(0, i));
    }
    return fit;
  };
  const auto image_of = [&](const ImageSpline& spline, const Eigen::VectorXd& coefficients) {
    cv::Mat image(kHeight, kWidth, CV_32F);
    for (int i = 0; i < kWidth * kHeight; ++i)
      image.at<float>(i / kWidth, i % kWidth) = static_cast<float>(
          spline.Evaluate(coefficients, enlarge(i % kWidth), enlarge(i / kWidth)));
    return image;
  };
  // A round: gains and the coarse spline, then the fine one.
  same.EstimateWall();
  const Eigen::VectorXd step = of_same.MakeCoarseSystem().Solve();
  const Eigen::Index nv = coarse.Coefficients(), n = nv + 12;
  same.SetAttenuation(image_of(coarse, step.head(nv)));
  same.ChangeGains(step.tail(12));
  same.EstimateWall();
  const Eigen::VectorXd fine_coefficients = fit_of(sum_pixels(same)).Solve();
  same.SetAttenuation(image_of(fine, fine_coefficients));
  EXPECT_LT((model.Gains() - same.Gains()).norm(), 1e-9);
  EXPECT_LT(cv::norm(model.Attenuation(), same.Attenuation(), cv::NORM_INF), 1e-5);
  const cv::Mat attenuation = splines.FineAttenuation();
  ASSERT_EQ(attenuation.size(), cv::Size(2 * kWidth, 2 * kHeight));
  double most = 0;
  cv::minMaxLoc(attenuation, nullptr, &most);
  EXPECT_EQ(most, 1);
  const auto ratio = [&](int x, int y) {
    return attenuation.at<float>(y, x) / std::exp(fine.Evaluate(fine_coefficients, x, y));
  };
  EXPECT_NEAR(ratio(3, 40) / ratio(250, 7), 1, 1e-4);

  // Scatter of the scores of blocks of 8 x 8 cells.
  model.EstimateWall();
  std::map<std::pair<size_t, size_t>, Eigen::VectorXd> scores;
  for (const auto& [cell, s, expected] : AllSamples(model)) {
    Eigen::VectorXd& score =
        scores.try_emplace({cell.row / 8, cell.column / 8}, Eigen::VectorXd::Zero(n)).first->second;
    const ImageSpline::Basis basis = at(coarse, s.x, s.y);
    for (size_t k = 0; k < 16; ++k)
      score[basis.index[k]] += expected.weight * expected.residual * basis.weight[k];
    score[nv + s.view] += expected.weight * expected.residual;
  }
  Eigen::MatrixXd M = Eigen::MatrixXd::Zero(n, n);
  for (const auto& [block, score] : scores) M += score * score.transpose();
  const auto count = static_cast<double>(scores.size());
  ASSERT_GT(count, static_cast<double>(n) + 5);
  M *= count / (count - static_cast<double>(n));
  M.diagonal().tail(12).array() += 1 / 0.0004;
  const CoarseSystem system = splines.MakeCoarseSystem();
  const Eigen::MatrixXd expected_all = system.S.inverse() * M * system.S.inverse();
  const Eigen::MatrixXd all = splines.CoarseCovariance(system);
  EXPECT_LT((all - expected_all).norm(), 1e-6 * expected_all.norm());

  // What is left of blocks: of all views by 2 px, of single ones by 16 px.
  const Eigen::ArrayXXd sums = sum_pixels(model);
  double chi_square = 0, blocks = 0;
  for (int top = 0; top < kHeight; top += 2) {
    for (int left = 0; left < kWidth; left += 2) {
      double weight = 0, sum = 0;
      for (const int i : {0, 1, kWidth, kWidth + 1}) {
        const int pixel = top * kWidth + left + i;
        weight += sums(0, pixel);
        sum += sums(1, pixel) -
               sums(0, pixel) * model.Attenuation().at<float>(pixel / kWidth, pixel % kWidth);
      }
      if (weight > 0) chi_square += sum * sum / weight, ++blocks;
    }
  }
  const double of_all = chi_square / (blocks - fine.Coefficients());
  Eigen::ArrayXXd of_views = Eigen::ArrayXXd::Zero(12, 20), weights = of_views;
  for (const auto& [cell, s, expected] : AllSamples(model)) {
    const auto block = static_cast<int>(s.y / 16) * 10 + static_cast<int>(s.x / 16);
    weights(s.view, block) += expected.weight;
    of_views(s.view, block) += expected.weight * expected.residual;
  }
  cv::Mat single(2, 10, CV_32F);
  for (int i = 0; i < 20; ++i)
    single.at<float>(i / 10, i % 10) =
        static_cast<float>(of_views.col(i).square().sum() / weights.col(i).sum());
  cv::resize(single, single, {kWidth, kHeight}, 0, 0, cv::INTER_LINEAR);
  const Eigen::MatrixXd of_fine = fit_of(sums).Covariance(), known = system.known.inverse(),
                        of_coarse = all.topLeftCorner(nv, nv);
  const auto sigma_at = [&](int x, int y) {
    const ImageSpline::Basis basis = at(coarse, x, y);
    const double more = VarianceAt(at(fine, x, y), of_fine) - VarianceAt(basis, known);
    return std::sqrt(std::max<double>(single.at<float>(y, x), of_all) * std::max(more, 0.0) +
                     VarianceAt(basis, of_coarse));
  };
  cv::Mat expected_sigma(kHeight, kWidth, CV_32F), sigma;
  for (int i = 0; i < kWidth * kHeight; ++i)
    expected_sigma.at<float>(i / kWidth, i % kWidth) =
        static_cast<float>(sigma_at(i % kWidth, i / kWidth));
  cv::resize(expected_sigma, sigma, {2 * kWidth, 2 * kHeight}, 0, 0, cv::INTER_LINEAR);
  const cv::Mat found = splines.FineSigma(system, of_coarse);
  ASSERT_EQ(found.size(), sigma.size());
  EXPECT_LT(cv::norm(found, sigma, cv::NORM_INF), 1e-6);
}

// Between no pixels: the variance of one.
double LogVariance(const WallModel& model, double light) { return model.Noise({}, light); }

TEST(WallModel, EstimatesNoiseAsALineOverTheLight) {
  const SmallWall wall = MakeSmallWall({.views = 12, .noise = 2});
  WallModel model(Recorded(wall), "here", 2), before(Recorded(wall), "here", 1);
  before.EstimateWall();
  std::map<int, Eigen::Array3d> bins;
  for (const auto& [cell, s, at] : AllSamples(before)) {
    bins.try_emplace(static_cast<int>(at.light / 4), Eigen::Array3d::Zero()).first->second +=
        Eigen::Array3d(
            1, at.light, at.residual * at.residual / (before.Noise(s, at.light) * at.freedom));
  }
  Eigen::Matrix2d N = Eigen::Matrix2d::Zero();
  Eigen::Vector2d b = Eigen::Vector2d::Zero();
  for (const auto& [bin, sums] : bins) {
    if (sums[0] < 100) continue;
    const double u = sums[1] / sums[0], assumed = 0.0255 * u + 1.0 / 12;
    const double weight = sums[0] / (assumed * assumed);
    const Eigen::Vector2d J(u, 1);
    N += weight * J * J.transpose();
    b += weight * J * (assumed * sums[2] / sums[0] - 1.0 / 12);
  }
  const Eigen::Vector2d line = N.inverse() * b;
  const bool both = line[0] > 0 && line[1] > 0;
  const double gain = both ? line[0] : b[0] / N(0, 0), read = std::max(line[1], 0.0);
  model.EstimateNoise();
  for (const double light : {60.125, 200.125}) {
    EXPECT_NEAR(
        LogVariance(model, light) * light * light / (gain * light + read + 1.0 / 12), 1, 1e-5);
  }
  // Light beyond the table has the variance of its end.
  EXPECT_EQ(LogVariance(model, 300), LogVariance(model, 255.9));
}

TEST(WallModel, RefinesPosesByTheTextureNearThoseOfTheMarker) {
  SmallWall wall = MakeSmallWall({.views = 12});
  Vector6d off;
  off << 0.001, -0.002, 0.001, 0.001, 0.002, -0.002;
  RigidTransform& moved = wall.recording.views[5].T_camera_wall;
  moved = Retract(moved, off);
  const WallRecording recording = Recorded(wall);
  WallModel model(recording, "here", 2);
  cv::Mat v(kHeight, kWidth, CV_32F);
  for (int i = 0; i < kWidth * kHeight; ++i)
    v.at<float>(i / kWidth, i % kWidth) = static_cast<float>(-0.001 * (i % kWidth));
  model.SetAttenuation(v);
  model.ChangeGains(Eigen::VectorXd::LinSpaced(12, -0.02, 0.03));
  model.EstimateWall();
  const WallProjector projector(recording);
  const WallView& view = recording.views[5];
  Matrix6d N = 1e6 * Matrix6d::Identity();  // 1 mm, 1 mrad
  Vector6d b = Vector6d::Zero();
  for (int row = 0; row < model.Grid().rows; row += 3) {
    for (int column = 0; column < model.Grid().columns; column += 3) {
      const double c = model.Brightness()[static_cast<size_t>(row)][static_cast<size_t>(column)];
      const Vector3d point = model.Grid().At(column, row);
      WallProjection seen;
      if (std::isnan(c) || !projector(view, point, &seen)) continue;
      const auto at = [&](double dx, double dy) -> double {
        return Interpolate(view.brightness, seen.x + dx, seen.y + dy);
      };
      const double residual = at(0, 0) - model.Gains()[5] - Interpolate(v, seen.x, seen.y) - c;
      const Eigen::Vector2d gradient(at(0.5, 0) - at(-0.5, 0), at(0, 0.5) - at(0, -0.5));
      if (!std::isfinite(residual + gradient.sum())) continue;
      Vector6d J;
      for (int k = 0; k < 6; ++k) {
        const auto place = [&](double step) {
          const Vector3d p = Retract(view.T_camera_wall, step * Vector6d::Unit(k)) * point;
          return Eigen::Vector2d(kFocal * p.x() / p.z(), kFocal * p.y() / p.z());
        };
        J[k] = gradient.dot(place(1e-6) - place(-1e-6)) / 2e-6;
      }
      const double variance = LogVariance(model, Interpolate(view.light, seen.x, seen.y));
      const double weight = 1 / (variance * (1 + residual * residual / (2.385 * 2.385 * variance)));
      N += weight * J * J.transpose();
      b -= weight * residual * J;
    }
  }
  const Vector6d step = N.inverse() * b;
  model.RefinePoses();
  const RigidTransform& refined = model.Wall().views[5].T_camera_wall;
  EXPECT_LT((LocalCoordinates(view.T_camera_wall, refined) - step).norm(), 1e-4 * step.norm());
  EXPECT_GT(step.norm(), 1e-3);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
