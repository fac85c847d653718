// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/reconstruction.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <span>
#include <vector>

#include "calib/base/error.h"
#include "tests/detectors/plenoptic/plenoptic_scene.h"
#include "tests/digest.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;

/// Distance from the border of the image within which fewer micro images see a point, px.
constexpr int kBorder = 50;

float Quantile(std::vector<float> values, double share) {
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

struct Case {
  const char* name;
  PlenopticScene scene;
  double digest = 0;  ///< of depth, its sigma and the focused image
};

void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

class FocusedScene : public ::testing::TestWithParam<Case> {
 protected:
  static Reconstruction FocusScene(const PlenopticScene& scene) {
    PlenopticCamera camera;
    camera.array = scene.Array();
    camera.attenuation = scene.Attenuation(camera.array);
    camera.bayer = scene.bayer;
    return Reconstruct(scene.Raw(camera.array), camera, {.colour = true, .find_flat_parts = {}});
  }
};

TEST_P(FocusedScene, HasItsDepthWithHonestSigma) {
  const PlenopticScene& scene = GetParam().scene;
  const Reconstruction view = FocusScene(scene);
  EXPECT_EQ(view.keplerian, scene.depth < 0);
  std::vector<float> relative, signed_error, pull;
  size_t inside = 0;
  for (int y = 0; y < view.depth.inverse.rows; ++y) {
    for (int x = 0; x < view.depth.inverse.cols; ++x) {
      const Eigen::Vector2d q(x * view.depth.scale, y * view.depth.scale);
      if (q.x() < kBorder || q.y() < kBorder || q.x() > scene.width - kBorder ||
          q.y() > scene.height - kBorder) {
        continue;
      }
      ++inside;
      if (view.depth.known.at<uchar>(y, x) == 0) continue;
      const auto truth = static_cast<float>(1 / scene.Depth(q));
      const float z = view.depth.inverse.at<float>(y, x);
      signed_error.push_back(truth / z - 1);
      relative.push_back(std::abs(signed_error.back()));
      pull.push_back((z - truth) / view.depth.sigma.at<float>(y, x));
    }
  }
  EXPECT_GT(static_cast<double>(relative.size()), 0.9 * static_cast<double>(inside));
  const float spread = (Quantile(pull, 0.8413) - Quantile(pull, 0.1587)) / 2;
  RecordProperty("bias", std::to_string(Quantile(signed_error, 0.5)));
  RecordProperty("median_error", std::to_string(Quantile(relative, 0.5)));
  RecordProperty("spread", std::to_string(spread));
  // As on tags: an even field of texture of this contrast is no harder.
  EXPECT_LT(Quantile(relative, 0.5), 0.01);
  EXPECT_LT(std::abs(Quantile(signed_error, 0.5)), 0.001);
  EXPECT_GT(spread, 0.6);
  EXPECT_LT(spread, 1.5);
  testing::Digest digest;
  for (int y = 0; y < view.image.rows; y += 2) {
    for (int x = 0; x < view.image.cols; x += 2) {
      digest.Add(view.depth.inverse.at<float>(y, x));
      digest.Add(view.depth.sigma.at<float>(y, x));
      digest.Add(view.depth.known.at<uchar>(y, x) / 255);
      digest.Add(view.image.at<float>(y, x) / scene.brightness);
    }
  }
  EXPECT_NEAR(digest.Sum(), GetParam().digest, 1e-2);
}

TEST_P(FocusedScene, LooksLikeTheScene) {
  const PlenopticScene& scene = GetParam().scene;
  const Reconstruction view = FocusScene(scene);
  // Relative to what a least-squares gain makes of the true texture.
  double st = 0, tt = 0, ss = 0, s1 = 0, t1 = 0, n = 0;
  for (int y = 0; y < view.image.rows; ++y) {
    for (int x = 0; x < view.image.cols; ++x) {
      const Eigen::Vector2d q(x * view.depth.scale, y * view.depth.scale);
      ASSERT_FALSE(std::isnan(view.image.at<float>(y, x)));
      if (q.x() < kBorder || q.y() < kBorder || q.x() > scene.width - kBorder ||
          q.y() > scene.height - kBorder) {
        continue;
      }
      const double s = view.image.at<float>(y, x), t = scene.Texture(q);
      n += 1, s1 += s, t1 += t, st += s * t, ss += s * s, tt += t * t;
    }
  }
  const double correlation =
      (n * st - s1 * t1) / std::sqrt((n * ss - s1 * s1) * (n * tt - t1 * t1));
  RecordProperty("correlation", std::to_string(correlation));
  EXPECT_GT(correlation, 0.97);
}

INSTANTIATE_TEST_SUITE_P(
    Cameras,
    FocusedScene,
    ::testing::Values(
        Case{"Galilean", {}, -32.398},
        Case{"Turned", {.rotation = std::numbers::pi / 2 + 0.01}, -60.211},
        Case{"OneType", {.types = 1}, -32.407},
        Case{"Keplerian", {.depth = -3.5}, -125.069},
        Case{"SmallPitch", {.pitch = 10, .depth = 3.2, .detail = 14}, -203.230},
        Case{"LargePitch", {.width = 600, .height = 600, .pitch = 36, .detail = 40}, -107.010},
        Case{"BlurredWithItsEdges", {.types = 1, .blur = 0.8}, -10.811},
        Case{"Dark", {.brightness = 75}, 21.153},
        Case{"Bayer", {.pitch = 24, .detail = 36, .bayer = BayerOrder::kRggb}, -89.820}),
    [](const auto& param) { return param.param.name; });

using ColouredScene = FocusedScene;

TEST_P(ColouredScene, HasItsColours) {
  const PlenopticScene& scene = GetParam().scene;
  const Reconstruction view = FocusScene(scene);
  ASSERT_EQ(view.colour.type(), CV_32FC3);
  ASSERT_EQ(view.colour.size(), view.image.size());
  std::vector<float> errors, bands;
  for (int y = 0; y < view.colour.rows; ++y) {
    for (int x = 0; x < view.colour.cols; ++x) {
      const Eigen::Vector2d q(x * view.depth.scale, y * view.depth.scale);
      if (q.x() < kBorder || q.y() < kBorder || q.x() > scene.width - kBorder ||
          q.y() > scene.height - kBorder) {
        continue;
      }
      // Blue and red over green: the texture cancels, also where it is blurred.
      const auto& colour = view.colour.at<cv::Vec3f>(y, x);
      for (const int c : {0, 2}) {
        const double truth = scene.Tint(c, q) / scene.Tint(1, q);
        errors.push_back(static_cast<float>(std::abs(colour[c] / colour[1] / truth - 1)));
        bands.push_back(static_cast<float>(truth));
      }
    }
  }
  const float error = Quantile(errors, 0.5), worse = Quantile(errors, 0.95);
  RecordProperty("error", std::to_string(error));
  RecordProperty("worse", std::to_string(worse));
  ASSERT_GT(Quantile(bands, 0.9) / Quantile(bands, 0.1), 2) << "the scene has colours";
  EXPECT_LT(error, 0.02);
  EXPECT_LT(worse, 0.08);
}

INSTANTIATE_TEST_SUITE_P(
    Cameras,
    ColouredScene,
    ::testing::Values(
        Case{"Channels", {.colour = true, .hue = 0.3}},
        Case{"Rggb", {.pitch = 24, .detail = 36, .bayer = BayerOrder::kRggb, .hue = 0.3}},
        Case{"Gbrg", {.pitch = 24, .detail = 36, .bayer = BayerOrder::kGbrg, .hue = 0.3}}),
    [](const auto& param) { return param.param.name; });

TEST(FocusedColours, AreNotMadeOfGrey) {
  const PlenopticScene scene;
  PlenopticCamera camera{scene.Array(), {}};
  camera.attenuation = scene.Attenuation(camera.array);
  EXPECT_TRUE(Reconstruct(scene.Raw(camera.array), camera, {.colour = true, .find_flat_parts = {}})
                  .colour.empty());
}

TEST(GreyPatches, AreTheSameUnderAnyLight) {
  // Light that is not white: each colour of the mosaic has another contrast.
  PlenopticScene scene{.read_noise = 0, .shot = 0};
  PlenopticCamera camera{scene.Array(), {}, BayerOrder::kRggb};
  camera.attenuation = scene.Attenuation(camera.array);
  const internal::LensPatches white = GreyPatches(scene.Raw(camera.array), camera, 1);
  scene.bayer = camera.bayer;
  const internal::LensPatches tinted = GreyPatches(scene.Raw(camera.array), camera, 1);
  EXPECT_EQ(white.filter_radius, 1);
  std::vector<float> ratios;
  for (size_t i = 0; i < white.value.size(); ++i) {
    if (!std::isnan(white.value[i])) ratios.push_back(tinted.value[i] / white.value[i]);
  }
  ASSERT_FALSE(ratios.empty());
  const auto [lowest, highest] = std::minmax_element(ratios.begin(), ratios.end());
  EXPECT_LT(*highest / *lowest, 1.02);
}

std::string Refusal(const cv::Mat& raw,
                    const PlenopticCamera& camera,
                    ErrorKind kind = ErrorKind::kJob) {
  return testing::RefusalOf([&] { Reconstruct(raw, camera, {}); }, kind);
}

class FocusRefuses : public ::testing::Test {
 protected:
  void SetUp() override {
    camera_.array = scene_.Array();
    camera_.attenuation = scene_.Attenuation(camera_.array);
  }
  PlenopticScene scene_;
  PlenopticCamera camera_;
};

TEST_F(FocusRefuses, AnImageOfAnotherCamera) {
  PlenopticScene other = scene_;
  for (const auto& [pitch, rotation] : {std::pair{18.3, 0.01}, {18.0, 0.05}, {15.0, 0.3}}) {
    other.pitch = pitch;
    other.rotation = rotation;
    const MicroLensArray array = other.Array();
    EXPECT_THAT(Refusal(other.Raw(array), camera_),
                HasSubstr("does not show micro images where the grid has them"));
  }
}

TEST_F(FocusRefuses, ABlackImage) {
  EXPECT_THAT(Refusal(cv::Mat::zeros(400, 400, CV_8U), camera_), HasSubstr("is black"));
}

TEST_F(FocusRefuses, AnImageWithoutMicroImages) {
  cv::Mat raw(400, 400, CV_8U);
  cv::randu(raw, 90, 110);
  EXPECT_THAT(Refusal(raw, camera_), HasSubstr("does not show micro images"));
}

TEST_F(FocusRefuses, AnImageOfAnotherSize) {
  EXPECT_THAT(Refusal(cv::Mat::zeros(300, 400, CV_8U), camera_, ErrorKind::kInput),
              HasSubstr("is 400 x 300 pixels"));
}

/// Of the micro images of a scene through an array `scale` times as wide, `shift` px aside, by the
/// white images of the scene.
LatticeShift ShiftOf(PlenopticScene scene, double scale, const Eigen::Vector2d& shift) {
  PlenopticCamera camera{scene.Array(), {}, scene.bayer};
  camera.attenuation = scene.Attenuation(camera.array);
  MicroLensArray array = camera.array;
  const Eigen::Vector2d middle(scene.width / 2.0, scene.height / 2.0);
  for (MicroLens& lens : array.lenses) {
    lens.centre = middle + shift + scale * (lens.centre - middle);
  }
  return Reconstruct(scene.Raw(array), camera, {}).lattice;
}

TEST(LatticeShift, IsMeasuredInTheRawImage) {
  constexpr double kScale = 1e-3;
  for (const auto bayer : {std::optional<BayerOrder>(), std::optional(BayerOrder::kRggb)}) {
    const PlenopticScene scene{.pitch = 22, .detail = 30, .bayer = bayer, .blur = 0.8};
    const LatticeShift none = ShiftOf(scene, 1, {0, 0});
    EXPECT_NEAR(none.corner, 283, 1);
    EXPECT_LT(none.Largest(), 0.05);
    EXPECT_LT(none.sigma.maxCoeff(), 0.03);
    EXPECT_FALSE(SignificantShift(std::span(&none, 1)));
    const LatticeShift shift = ShiftOf(scene, 1 + kScale, {0.2, -0.1});
    const Eigen::Vector4d truth(0.2, -0.1, kScale * shift.corner, 0);
    EXPECT_LT((shift.value - truth).cwiseAbs().maxCoeff(), 0.04) << shift.value.transpose();
    ASSERT_TRUE(SignificantShift(std::span(&shift, 1)));
    EXPECT_THAT(ShiftText(shift), HasSubstr("of another focus or zoom"));
  }
}

TEST(LatticeShift, IsNotMeasuredWithoutMicroImages) {
  PlenopticScene scene;
  PlenopticCamera camera{scene.Array(), {}};
  camera.attenuation = cv::Mat(scene.height, scene.width, CV_32F, cv::Scalar(1));
  const LatticeShift shift = Reconstruct(scene.Raw(camera.array), camera, {}).lattice;
  EXPECT_EQ(shift.corner, 0);
  EXPECT_FALSE(SignificantShift(std::span(&shift, 1)));
}

TEST(LatticeShift, OfAllImagesIsTestedByTheirScatter) {
  std::vector<LatticeShift> images;
  for (int i = 0; i < 12; ++i) {
    LatticeShift& image = images.emplace_back();
    image.value = {0.01, 0, 0.07 + 0.02 * (i % 2), 0};
    image.sigma.setConstant(0.003);
    image.corner = 500;
  }
  ASSERT_TRUE(SignificantShift(images));
  EXPECT_NEAR(SignificantShift(images)->value[2], 0.08, 1e-9);
  for (size_t i = 0; i < images.size(); i += 2) images[i].value[2] = -0.1;
  EXPECT_FALSE(SignificantShift(images));
}

}  // namespace TEST_FILE
}  // namespace plenocal
