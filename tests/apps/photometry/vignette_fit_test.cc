// SPDX-License-Identifier: Apache-2.0
//
// Exposures from views of a wall whose brightness is known at every point.
#include "apps/photometry/vignette_fit.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <random>

#include "models/registry.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr int kWidth = 128, kHeight = 96;
constexpr double kFocal = 84, kCentreX = 63, kCentreY = 49;
constexpr double kElectrons = 10000, kReadElectrons = 8;

struct WallScene {
  double structure = 0.01;  // m, side of the cells of the finest texture; a pixel sees 11 to 19 mm
  double full = 230;        // light of the brightest pixel
  bool noise = true;
  int flipped = -1;  // view whose pose has the mirrored tilt
  unsigned seed = 1;
};

double TrueAttenuation(double x, double y) {
  const double r = std::hypot(x / kWidth - 0.52, 1.05 * (y / kWidth - 0.38));
  return 1 / std::pow(1 + 0.9 * r * r, 2);
}

// Octaves of noise on lattices.
class Texture {
 public:
  Texture(double structure, std::mt19937_64* engine) {
    std::normal_distribution<double> normal;
    for (double cell = structure; cell < 1; cell *= 2) {
      Octave octave{cell, {}};
      for (double& value : octave.values) value = normal(*engine);
      octaves_.push_back(octave);
    }
  }
  double operator()(double x, double y) const {
    double sum = 0;
    for (const Octave& octave : octaves_) {
      const double u = x / octave.cell + 1000, v = y / octave.cell + 1000;
      const int i = static_cast<int>(u), j = static_cast<int>(v);
      const double a = u - i, b = v - j;
      sum += (1 - b) * ((1 - a) * octave.At(i, j) + a * octave.At(i + 1, j)) +
             b * ((1 - a) * octave.At(i, j + 1) + a * octave.At(i + 1, j + 1));
    }
    const double contrast = 0.2 * sum / std::sqrt(static_cast<double>(octaves_.size()));
    return std::exp(contrast - 0.15 * x + 0.1 * y - 0.1 * (x * x + y * y));
  }

 private:
  struct Octave {
    double cell;
    std::array<double, 127 * 127> values;
    [[nodiscard]] double At(int i, int j) const {
      return values[static_cast<size_t>(j % 127 * 127 + i % 127)];
    }
  };
  std::vector<Octave> octaves_;
};

RigidTransform RandomPose(std::mt19937_64* engine) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::uniform_int_distribution<int> quarter(0, 3);
  const double roll = std::numbers::pi / 2 * quarter(*engine) + 0.2 * uniform(*engine);
  const Eigen::Vector3d tilt(0.4 * uniform(*engine), 0.4 * uniform(*engine), 0);
  const double distance = 1.25 + 0.35 * uniform(*engine);
  RigidTransform T;
  T.R = (Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ()) *
         Eigen::AngleAxisd(tilt.norm(), tilt.normalized()))
            .toRotationMatrix() *
        Eigen::Vector3d(1, -1, -1).asDiagonal();
  T.t = distance * Eigen::Vector3d(0.6 * uniform(*engine), 0.5 * uniform(*engine), 1);
  return T;
}

// Necker's reversal: the same image of a small marker at the origin.
RigidTransform Mirrored(const RigidTransform& T) {
  const Eigen::Vector3d d = T.t.normalized();
  return {(Eigen::Matrix3d::Identity() - 2 * d * d.transpose()) * T.R *
              Eigen::Vector3d(1, 1, -1).asDiagonal(),
          T.t};
}

struct SimulatedWall {
  CalibratedCamera camera;
  WallRecording recording;
  std::vector<double> errors;  // ln(true / recorded exposure)
};

SimulatedWall MakeWall(const WallScene& options) {
  std::mt19937_64 engine(options.seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(2, 5);
  SimulatedWall wall;
  wall.camera.model = FindModel(CameraModels(), "pinhole-radial3");
  wall.camera.image_size = {kWidth, kHeight};
  wall.camera.params = {kFocal, kFocal, kCentreX, kCentreY, 0, 0, 0};
  const Texture texture(options.structure, &engine);
  double brightest = 0;
  constexpr int kViews = 20;
  constexpr double kExposureError = 0.02;
  for (int i = 0; i < kViews; ++i) {
    const RigidTransform T = RandomPose(&engine), back = T.Inverse();
    const double exposure = uniform(engine), error = kExposureError * normal(engine);
    wall.errors.push_back(error);
    cv::Mat light(kHeight, kWidth, CV_32F);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        constexpr int kSteps = 3;  // of a pixel, in both directions
        double sum = 0;
        for (int k = 0; k < kSteps * kSteps; ++k) {
          const double u = x + (k % kSteps + 0.5) / kSteps - 0.5;
          const double v = y + (k / kSteps + 0.5) / kSteps - 0.5;
          const Eigen::Vector3d ray =
              back.R * Eigen::Vector3d((u - kCentreX) / kFocal, (v - kCentreY) / kFocal, 1);
          const Eigen::Vector3d p = back.t - back.t.z() / ray.z() * ray;
          sum += texture(p.x(), p.y());
        }
        light.at<float>(y, x) = static_cast<float>(sum / (kSteps * kSteps) * TrueAttenuation(x, y) *
                                                   exposure * std::exp(error));
      }
    }
    double largest = 0;
    cv::minMaxLoc(light, nullptr, &largest);
    brightest = std::max(brightest, largest);
    wall.recording.views.push_back({.frame = std::to_string(i),
                                    .exposure = exposure,
                                    .T_camera_wall = i == options.flipped ? Mirrored(T) : T,
                                    .brightness = {},
                                    .light = light});
  }
  for (WallView& view : wall.recording.views) {
    view.light *= options.full / brightest;
    for (float& light : cv::Mat_<float>(view.light)) {
      if (!options.noise) break;
      std::poisson_distribution<int> photons(light / 255 * kElectrons);
      const double electrons = photons(engine) + kReadElectrons * normal(engine);
      light =
          std::clamp(static_cast<float>(std::round(electrons / kElectrons * 255)), 0.0F, 255.0F);
    }
    cv::Mat saturated;
    cv::dilate(view.light >= 255, saturated, cv::Mat::ones(5, 5, CV_8U));
    cv::log(view.light / view.exposure, view.brightness);
    view.brightness.setTo(std::numeric_limits<float>::quiet_NaN(), saturated);
  }
  wall.recording.camera = &wall.camera;
  return wall;
}

VignetteEstimate Fit(const SimulatedWall& wall) {
  WallRecording recording = wall.recording;
  recording.camera = &wall.camera;
  return FitVignette(std::move(recording), "here", 2, [](const std::string&) { return true; });
}

// Mean (error / standard deviation)^2 of exposures against their mean.
double ExposureChiSquare(const VignetteEstimate& estimate, const SimulatedWall& wall) {
  std::vector<double> errors, sigmas;
  for (size_t i = 0; i < wall.errors.size(); ++i) {
    if (std::ranges::count(estimate.misplaced, wall.recording.views[i].frame) > 0) continue;
    errors.push_back(std::log(estimate.gains[i]) - wall.errors[i]);
    sigmas.push_back(estimate.gain_sigma[i]);
  }
  const auto count = static_cast<double>(errors.size());
  const double mean = std::accumulate(errors.begin(), errors.end(), 0.0) / count;
  double sum = 0;
  for (size_t i = 0; i < errors.size(); ++i) sum += std::pow((errors[i] - mean) / sigmas[i], 2);
  return sum / count;
}

// Of a flat wall, residuals of the worst parts are near those of the best ones.
constexpr double kEven = 4;

TEST(VignetteFit, ExposuresHaveTrueStandardDeviationsOnFineTexture) {
  double sum = 0;
  constexpr unsigned kSeeds = 2;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const SimulatedWall wall = MakeWall({.seed = seed});
    const VignetteEstimate estimate = Fit(wall);
    EXPECT_THAT(estimate.misplaced, IsEmpty());
    EXPECT_LT(estimate.unevenness, kEven);
    sum += ExposureChiSquare(estimate, wall);
  }
  EXPECT_GT(sum / kSeeds, 0.4);
  EXPECT_LT(sum / kSeeds, 2.2);
}

TEST(VignetteFit, TextureAloneIsNeitherUnevennessNorAnErrorOfExposures) {
  const SimulatedWall wall = MakeWall({.noise = false});
  const VignetteEstimate estimate = Fit(wall);
  EXPECT_LT(estimate.unevenness, kEven);
  const double chi_square = ExposureChiSquare(estimate, wall);
  EXPECT_GT(chi_square, 0.3);
  EXPECT_LT(chi_square, 2.5);
}

TEST(VignetteFit, SaturatedPartsLeaveExposuresWithoutABias) {
  const SimulatedWall wall = MakeWall({.full = 400});
  EXPECT_LT(ExposureChiSquare(Fit(wall), wall), 2.5);
}

TEST(VignetteFit, LeavesOutAViewWhosePoseIsMirrored) {
  const SimulatedWall wall = MakeWall({.structure = 0.03, .flipped = 3});
  const VignetteEstimate estimate = Fit(wall);
  EXPECT_THAT(estimate.misplaced, ElementsAre("3"));
  EXPECT_LT(estimate.unevenness, kEven);
  EXPECT_LT(ExposureChiSquare(estimate, wall), 2.5);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
