// SPDX-License-Identifier: Apache-2.0
//
// Light and grey values of ordinary cameras from fields whose mean over a pixel is known, and what
// a rig's cameras observe.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <opencv2/core.hpp>

#include "apps/simulate/render/image_set.h"
#include "apps/simulate/render/observer.h"
#include "apps/simulate/render/renderer.h"
#include "apps/simulate/render/sensor.h"
#include "apps/simulate/spec/random.h"
#include "detectors/images/image.h"
#include "tests/apps/simulate/small_scene.h"
#include "tests/apps/workspace.h"
#include "tests/refusal.h"

namespace plenocal::simulate {
namespace TEST_FILE {

using Eigen::Vector3d;
using Eigen::Vector3f;
using ::plenocal::testing::Workspace;

// A surface all around, by the slope of rays.
class Field : public Surface {
 public:
  explicit Field(std::function<double(double x, double y)> value) : value_(std::move(value)) {}
  [[nodiscard]] float Radiance(const Vector3f& origin,
                               const Vector3f& direction,
                               const Spread& spread) const override {
    EXPECT_TRUE(origin.isZero());
    EXPECT_EQ(spread.at_origin, 0);
    least = std::min(least, spread.by_distance), most = std::max(most, spread.by_distance);
    return static_cast<float>(value_(direction.x() / direction.z(), direction.y() / direction.z()));
  }
  [[nodiscard]] std::pair<int, float> FaceOf(const Vector3f&, const Vector3f&) const override {
    return {-1, 0};
  }

  mutable float least = 1e9f, most = 0;

 private:
  std::function<double(double, double)> value_;
};

CameraSpec Narrow(double blur, int width = 20, int height = 150) {
  CameraSpec camera = SmallCamera("left");
  camera.image_size = {width, height};
  camera.params = {4000, 4100, 9, 60, 0, 0, 0};
  camera.sensor.blur = blur;
  camera.sensor.vignetting = {.polynomial = {-0.4, 0.1, 0}};
  return camera;
}

TEST(OrdinaryRenderer, GivesEachPixelTheMeanOverItsPointSpread) {
  for (const double blur : {0.0, 0.8}) {
    const CameraSpec camera = Narrow(blur);
    const auto renderer = MakeOrdinaryRenderer(camera);
    // A pixel of 4 x 4 samples has the variance (1 - 1 / 16) / 12.
    const double variance = 15.0 / 16 / 12 + blur * blur;
    const Field field([&](double x, double y) {
      const double u = 4000 * x, v = 4100 * y;
      return 0.5 + 0.02 * u - 0.003 * v + 0.001 * u * u + 1e-5 * v * v;
    });
    const cv::Mat light = renderer->Render(field, 1);
    ASSERT_EQ(light.size(), cv::Size(20, 150));
    for (const int y : {0, 1, 63, 64, 65, 127, 128, 149}) {  // 64 rows at a time
      for (const int x : {0, 1, 10, 19}) {
        const double u = x - 9, v = y - 60;
        const double mean =
            0.5 + 0.02 * u - 0.003 * v + 0.001 * (u * u + variance) + 1e-5 * (v * v + variance);
        const double attenuation = camera.sensor.vignetting.At(x, y, camera.image_size);
        EXPECT_NEAR(renderer->White().at<float>(y, x), attenuation, 1e-6);
        EXPECT_NEAR(light.at<float>(y, x), mean * attenuation, 1e-4) << x << ' ' << y;
      }
    }
    // A quarter of a pixel.
    EXPECT_NEAR(field.least * 4 * 4000, 1, 0.01);
    EXPECT_NEAR(field.most * 4 * 4000, 1, 0.01);
  }
}

TEST(OrdinaryRenderer, BlursAcrossTheImagesBorderAndFillsWhereTheLensSeesNothing) {
  // Bright in the first column and beyond.
  const CameraSpec camera = Narrow(1, 20, 24);
  const cv::Mat light = MakeOrdinaryRenderer(camera)->Render(
      Field([](double x, double) { return 4000 * x < -9 + 0.5 ? 1.0 : 0.0; }), 1);
  for (const int x : {0, 1, 2}) {
    const double share = 0.5 * std::erfc((x - 0.5) / std::sqrt(2 * (1 + 1 / 12.0)));
    EXPECT_NEAR(
        light.at<float>(12, x) / camera.sensor.vignetting.At(x, 12, camera.image_size), share, 0.02)
        << x;
  }
  // The image circle of a lens whose distortion turns back.
  CameraSpec wide = SmallCamera("left");
  wide.params = {30, 30, 31, 24, -0.5, 0, 0};
  wide.sensor.blur = 0;
  const cv::Mat dark =
      MakeOrdinaryRenderer(wide)->Render(Field([](double, double) { return 1.0; }), 1);
  int background = 0;
  for (int y = 0; y < 48; ++y) {
    for (int x = 0; x < 64; ++x) {
      bool seen = true, all_unseen = true;
      for (const auto& [dx, dy] : {std::pair{-0.5, -0.5}, {0.5, -0.5}, {-0.5, 0.5}, {0.5, 0.5}}) {
        const Eigen::Vector2d u(x + dx, y + dy);
        const bool has = wide.model->Unproject(wide.params.data(), nullptr, u.data()).has_value();
        seen = seen && has, all_unseen = all_unseen && !has;
      }
      const double value = dark.at<float>(y, x) / wide.sensor.vignetting.At(x, y, wide.image_size);
      EXPECT_NEAR(value, seen ? 1 : Surface::kBackground, 1e-5);
      background += seen ? 0 : 1;
    }
  }
  EXPECT_TRUE(background > 100 && background < 2500) << background;
}

// The share of a box convolved with a Gaussian that is below x.
double Below(double x, double blur) {
  constexpr int kSteps = 2000;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double at = x - ((i + 0.5) / kSteps - 0.5);
    sum += (blur > 0 ? 0.5 * std::erfc(-at / blur / std::sqrt(2)) : at > 0 ? 1 : 0) / kSteps;
  }
  return sum;
}

TEST(SimulatedSensor, HasQuantilesOfThePointSpread) {
  for (const double blur : {0.0, 0.2, 1.5}) {
    for (const int count : {1, 4, 64}) {
      const std::vector<float> quantiles = PixelQuantiles(count, blur);
      ASSERT_EQ(quantiles.size(), static_cast<size_t>(count));
      for (int i = 0; i < count; ++i) {
        EXPECT_NEAR(Below(quantiles[static_cast<size_t>(i)], blur), (i + 0.5) / count, 1e-3);
      }
    }
  }
}

TEST(SimulatedSensor, CountsElectronsWithTheirNoise) {
  cv::Mat light(6, 40, CV_32F);
  for (int i = 0; i < 240; ++i) light.at<float>(i / 40, i % 40) = static_cast<float>(i) / 200;
  for (const int bits : {8, 10, 12, 16}) {
    for (const std::optional<BayerOrder>& bayer :
         {std::optional<BayerOrder>(), {BayerOrder::kGrbg}}) {
      SensorSpec sensor{.bits = bits,
                        .full_well = 900,
                        .read_noise = 12,
                        .exposure = 0.9,
                        .vignetting = {},
                        .bayer = bayer};
      Random random(1, "expose"), again(1, "expose");
      const cv::Mat image = Expose(light, sensor, &random);
      EXPECT_EQ(image.type(), bits == 8 ? CV_8U : CV_16U);
      const double largest = std::exp2(bits) - 1;
      int clipped = 0;
      for (int i = 0; i < 240; ++i) {
        const int x = i % 40, y = i / 40;
        // G R above B G.
        const double filter = !bayer || (x + y) % 2 == 0 ? 1 : y % 2 == 0 ? 0.6 : 0.7;
        const double mean = 900 * 0.9 * filter * light.at<float>(y, x),
                     sigma = std::sqrt(mean + 144);
        const double z = again.Gaussian(1);
        // Cornish and Fisher's expansion by the skewness of counts.
        const double counted = mean + sigma * z + mean / (sigma * sigma) / 6 * (z * z - 1);
        const double grey = std::clamp(std::round(counted / 900 * largest), 0.0, largest);
        clipped += grey == 0 || grey == largest ? 1 : 0;
        EXPECT_EQ(bits == 8 ? image.at<std::uint8_t>(y, x) : image.at<std::uint16_t>(y, x), grey);
      }
      EXPECT_GT(clipped, 3);
    }
  }
}

TEST(SimulatedSensor, HasGreyValuesBetweenTheBordersOfItsResponse) {
  ToneSpec tone;
  for (size_t k = 0; k < tone.borders.size(); ++k)
    tone.borders[k] = std::pow(static_cast<double>(k) + 0.5, 2) / 255;
  SensorSpec sensor{
      .full_well = 1e9, .read_noise = 0, .exposure = 1, .vignetting = {}, .response = tone};
  cv::Mat light(1, 256, CV_32F);
  for (int k = 0; k < 256; ++k) light.at<float>(0, k) = static_cast<float>(k * k) / 255 / 255;
  Random random(1, "expose");
  const cv::Mat image = Expose(light, sensor, &random);
  for (int k = 0; k < 256; ++k)
    EXPECT_EQ(image.at<std::uint8_t>(0, k), k);  // 0: no light, no noise
}

TEST(SimulatedImageList, HasTheFramesAndWhiteImagesOfACamera) {
  SimulationSpec spec = SmallScene();
  spec.cameras[1].sensor.blur = 0;
  EXPECT_EQ(SamplingSeed(spec, 0, 0), 5000015u);
  EXPECT_EQ(SamplingSeed(spec, 2, 7), 5000015u + 2 * 65537 + 7);
  const Observer observer(spec);
  const Renderers renderers = MakeRenderers(spec, observer, 1);
  ASSERT_EQ(renderers.size(), 2u);
  EXPECT_EQ(renderers[1]->White().size(), cv::Size(64, 48));
  const auto light = [](size_t frame) {
    return cv::Mat(48, 64, CV_32F, cv::Scalar(0.2 + 0.3 * static_cast<double>(frame)));
  };
  const auto tasks = ListCameraImages(spec, 1, *renderers[1], {"a", "b"}, light, 2);
  std::vector<std::string> names;
  for (const ImageTask& task : tasks) {
    names.push_back(task.name);
    EXPECT_FALSE(task.slow);
  }
  EXPECT_THAT(
      names,
      ::testing::ElementsAre(
          "right/a.png", "right/b.png", "right_white/white_00.png", "right_white/white_01.png"));
  const auto equal = [](const cv::Mat& a, const cv::Mat& b) {
    return cv::norm(a, b, cv::NORM_INF) == 0;
  };
  for (const size_t i : {0, 1}) {
    Random image(5, "image", {1, i}), white(5, "white", {1, i});
    EXPECT_TRUE(equal(tasks[i].make(), Expose(light(i), spec.cameras[1].sensor, &image)));
    const double lamp = 1 + white.Gaussian(0.01);
    EXPECT_TRUE(equal(tasks[2 + i].make(),
                      Expose(renderers[1]->White() * lamp, spec.cameras[1].sensor, &white)));
  }
}

using SimulatedImageFiles = Workspace;

TEST_F(SimulatedImageFiles, AreMadeSlowOnesFirstAndRefusedBesideOthers) {
  std::vector<std::string> made;
  std::vector<ImageTask> tasks;
  for (const auto& [name, slow] :
       {std::pair{"a/1.png", false}, {"b/2.png", true}, {"a/3.png", false}, {"b/4.png", true}}) {
    tasks.push_back({name, slow, [&made, name = std::string(name)] {
                       made.push_back(name);
                       return cv::Mat(2, 3, CV_8U, cv::Scalar(name[2]));
                     }});
  }
  std::vector<std::string> stages;
  const Progress progress = [&](const std::string& stage, size_t done, size_t total) {
    stages.push_back(fmt::format("{} {} {}", stage, done, total));
  };
  {
    OutputFolder out(Path("out"));
    WriteImages(tasks, Path("out"), 1, progress, &out);
    out.Commit();
  }
  EXPECT_THAT(made, ::testing::ElementsAre("b/2.png", "b/4.png", "a/1.png", "a/3.png"));
  EXPECT_THAT(stages,
              ::testing::ElementsAre("images 1 4", "images 2 4", "images 3 4", "images 4 4"));
  const cv::Mat image = ReadImage(Path("out/b/4.png"));
  EXPECT_EQ(image.size(), cv::Size(3, 2));
  EXPECT_EQ(image.at<std::uint8_t>(1, 2), '4');
  // Again over its own images and other files, but not beside another image.
  Write("out/a/notes.txt", "");
  {
    OutputFolder out(Path("out"));
    WriteImages(tasks, Path("out"), 1, progress, &out);
  }
  Write("out/a/5.png", "");
  EXPECT_EQ(testing::RefusalOf([&] {
              OutputFolder out(Path("out"));
              WriteImages(tasks, Path("out"), 1, progress, &out);
            }),
            Path("out/a/5.png").string() +
                ": is no image of this session but would be taken for one; remove it or give "
                "another folder with -o");
}

TEST(SimulatedObserver, SeesMarkersThatFaceTheCameraWithinItsImage) {
  SimulationSpec spec = SmallScene();
  const Observer observer(spec);
  EXPECT_EQ(observer.Optics(0), nullptr);
  TrueTarget target;
  target.markers = {{1, {0, 0, 0}}, {2, {0.1, 0, 0}}, {3, {-0.1, 0, 0}}, {4, {5, 0, 0}}};
  target.normals = {{1, {0, 0, -1}}, {2, {0, 0, 1}}, {3, {0, 0, 0}}, {4, {0, 0, -1}}};
  const auto markers = [](const std::vector<Observation>& seen) {
    std::vector<int> numbers;
    for (const Observation& o : seen) numbers.push_back(o.marker);
    return numbers;
  };
  const RigidTransform T{Eigen::Matrix3d::Identity(), {0.02, 0.03, 1}};
  for (const size_t c : {0, 1}) {
    const CameraSpec& camera = spec.cameras[c];
    const std::vector<Observation> seen = observer.Observe(c, target, T);
    EXPECT_THAT(markers(seen), ::testing::ElementsAre(1, 3));
    for (const Observation& o : seen) {
      const Vector3d p = camera.T_camera_rig * (T * target.markers.at(o.marker));
      Eigen::Vector2d u;
      ASSERT_TRUE(camera.model->Project(camera.params.data(), nullptr, nullptr, p, u.data()));
      EXPECT_EQ(Eigen::Vector2d(o.values[0], o.values[1]), u);
      const auto ray = observer.CentralRay(c, u);
      EXPECT_LT((ray->direction - p.normalized()).norm(), 1e-9);
    }
  }
  // From the other side.
  const RigidTransform back{Vector3d(-1, 1, -1).asDiagonal(), {0, 0, 1}};
  EXPECT_THAT(markers(observer.Observe(0, target, back)), ::testing::ElementsAre(2, 3));
  EXPECT_TRUE(observer.ObservePoint(0, 1, {0, 0, -1}).empty());
  EXPECT_EQ(CountMarkers({{.marker = 3}, {.marker = 1}, {.marker = 3}}), 2);
  EXPECT_EQ(CountMarkers({}), 0);
  spec.cameras[0].detection_sigma = 0.5;
  Observation o{.marker = 1, .values = {10, 20, 30}};
  Random random(1, "noise"), again(1, "noise");
  AddNoise(spec.cameras[0], &random, &o);
  EXPECT_EQ(o.values[0], 10 + again.Gaussian(0.5));
  EXPECT_EQ(o.values[1], 20 + again.Gaussian(0.5));
  EXPECT_EQ(o.values[2], 30);
  EXPECT_EQ(o.detector_sigma, 0.5);
}

}  // namespace TEST_FILE
}  // namespace plenocal::simulate
