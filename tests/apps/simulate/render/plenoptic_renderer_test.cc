// SPDX-License-Identifier: Apache-2.0
//
// Micro lenses and their rays against the model's own, over all places of the lattice.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>

#include "apps/simulate/render/micro_lens_optics.h"
#include "apps/simulate/render/renderer.h"
#include "apps/simulate/render/surface.h"
#include "tests/apps/simulate/small_scene.h"
#include "tests/refusal.h"

namespace plenocal::simulate {
namespace TEST_FILE {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::Vector3f;

CameraSpec Plenoptic(bool distorted) {
  CameraSpec camera;
  camera.name = "raw";
  camera.model = FindModel(CameraModels(), "focused-plenoptic");
  camera.image_size = {130, 110};
  camera.config = {7.4e-6};
  camera.params = {0.0125, 0.012, 0.00026, 66, 52, 0, 0, 0, 0};
  if (distorted) camera.params = {0.0125, 0.012, 0.00026, 66, 52, -2000, 0, 0.3, -0.2};
  camera.sensor.blur = 0.3;
  camera.micro_lenses =
      MicroLensSpec{.pitch = 16, .rotation = 0.2, .offset = {1, -2}, .focus = {2.5}};
  return camera;
}

// Where distances and rows of the lattice lead, without distortion.
Vector2d Place(const MicroLensSpec& spec, const Vector2d& principal, int row, int column) {
  const bool hexagonal = spec.lattice == LatticeKind::kHexagonal;
  const double pitch = hexagonal ? spec.pitch : spec.row_pitch;
  const double angle = spec.rotation + (hexagonal ? std::numbers::pi / 3 : std::numbers::pi / 2);
  return principal + spec.offset +
         spec.pitch * column * Vector2d(std::cos(spec.rotation), std::sin(spec.rotation)) +
         pitch * row * Vector2d(std::cos(angle), std::sin(angle));
}

bool Within(const Vector2d& u, const ImageSize& size, double margin) {
  return u.x() >= -margin - 0.5 && u.y() >= -margin - 0.5 && u.x() <= size[0] - 0.5 + margin &&
         u.y() <= size[1] - 0.5 + margin;
}

TEST(MicroLensOptics, HasALensAtEachPlaceOfTheLatticeAndAPitchBeyondTheSensor) {
  for (const bool rectangular : {false, true}) {
    for (const bool raw : {false, true}) {
      CameraSpec camera =
          Plenoptic(raw);  // with distortion too where centres are regular in raw images
      MicroLensSpec& spec = *camera.micro_lenses;
      spec.regular_in_raw = raw;
      spec.focus = {2.5, 3, 4};
      spec.pattern = (Eigen::MatrixXi(2, 3) << 0, 1, 2, 2, 2, 1).finished();
      if (rectangular) spec.lattice = LatticeKind::kRectangular, spec.row_pitch = 13;
      const MicroLensOptics optics(camera);
      std::map<std::pair<int, int>, MicroLens> found;
      for (const MicroLens& lens : optics.Lenses()) found[{lens.row, lens.column}] = lens;
      EXPECT_EQ(found.size(), optics.Lenses().size());
      size_t expected = 0, inside = 0;
      for (int row = -30; row <= 30; ++row) {
        for (int column = -30; column <= 30; ++column) {
          const Vector2d place = Place(spec, {66, 52}, row, column);
          const bool near = Within(place, camera.image_size, 16);
          ASSERT_EQ(found.contains({row, column}), near)
              << row << ' ' << column << ' ' << place.transpose();
          if (!near) continue;
          ++expected;
          inside += Within(place, camera.image_size, 0) ? 1 : 0;
          EXPECT_LT(((found[{row, column}].centre) - place).norm(), 1e-6);
          EXPECT_EQ((found[{row, column}].type), spec.pattern((row + 60) % 2, (column + 60) % 3));
        }
      }
      EXPECT_EQ(found.size(), expected);
      const MicroLensArray array = optics.Array();
      EXPECT_EQ(array.lenses.size(), inside);
      EXPECT_EQ(array.types, 3);
      EXPECT_EQ(array.image_size, camera.image_size);
      EXPECT_NEAR(array.e_column.norm(), 16, 1e-6);
      EXPECT_NEAR(array.e_row.norm(), rectangular ? 13 : 16, 1e-6);
      for (const MicroLens& lens : array.lenses)
        EXPECT_TRUE(Within(lens.centre, camera.image_size, 0));
    }
  }
}

TEST(MicroLensOptics, HasSlopesInALatticeAndRaysThroughOnePupil) {
  const CameraSpec camera = Plenoptic(true);
  const MicroLensOptics optics(camera);
  const auto slope = [&](const Vector2d& c) -> Vector2d {
    const auto ray = optics.RayThrough(c, c);
    return ray->direction.head<2>() / ray->direction.z();
  };
  // The principal point is where the ray is parallel to the axis; B_0 and B_1 hardly move it.
  Vector2d principal(66, 52);
  Eigen::Matrix2d by_px;
  for (int i = 0; i < 5; ++i) {
    for (int k = 0; k < 2; ++k)
      by_px.col(k) =
          (slope(principal + Vector2d::Unit(k)) - slope(principal - Vector2d::Unit(k))) / 2;
    principal -= by_px.inverse() * slope(principal);
  }
  EXPECT_GT((slope({130, 60}) - by_px * (Vector2d(130, 60) - principal)).norm(),
            1e-6);  // distortion
  for (const MicroLens& lens : optics.Lenses()) {
    const Vector2d place = Place(*camera.micro_lenses, principal, lens.row, lens.column);
    EXPECT_LT((slope(lens.centre) - by_px * (place - principal)).norm(), 1e-9);
    const auto ray = optics.RayThrough(lens.centre, lens.centre);
    EXPECT_LT((optics.Pupil() - ray->origin).cross(ray->direction).norm(), 1e-6);
    const Vector3d p = optics.Pupil() + 3 * ray->direction;
    const auto image = optics.CentralImage(p);
    ASSERT_TRUE(image);
    EXPECT_LT((*image - lens.centre).norm(), 0.05);
    EXPECT_FALSE(optics.CentralImage(optics.Pupil() - ray->direction));
  }
  EXPECT_FALSE(optics.CentralImage(optics.Pupil()));
}

TEST(MicroLensOptics, ObservesAPointThroughAllLensesWhoseMicroImageHoldsIt) {
  for (const bool raw : {false, true}) {
    CameraSpec camera = Plenoptic(true);
    camera.micro_lenses->regular_in_raw = raw;
    camera.micro_lenses->fill = 0.9;
    const MicroLensOptics optics(camera);
    const double radius = 0.9 * 16 / 2 - 1;
    size_t most = 0;
    for (const Vector3d& p : {Vector3d(0, 0, 0.3),
                              Vector3d(0.004, -0.003, 0.28),
                              Vector3d(-0.012, 0.01, 0.5),
                              Vector3d(0.015, 0.012, 0.4),
                              Vector3d(0, 0, 2),
                              Vector3d(0.5, 0, 0.5)}) {
      std::vector<Observation> expected;
      for (const MicroLens& lens : optics.Lenses()) {
        const std::array<double, kMaxObservationSize> values{
            0, 0, lens.centre.x(), lens.centre.y()};
        Vector2d x;
        if (!camera.model->Project(
                camera.params.data(), camera.config.data(), values.data(), p, x.data()))
          continue;
        if ((x - lens.centre).norm() > radius || !Within(lens.centre, camera.image_size, 0) ||
            !Within(x, camera.image_size, 0)) {
          continue;
        }
        expected.push_back(
            {.marker = 7, .values = {x.x(), x.y(), lens.centre.x(), lens.centre.y()}});
      }
      const std::vector<Observation> seen = optics.Observe(7, p);
      most = std::max(most, seen.size());
      ASSERT_EQ(seen.size(), expected.size()) << p.transpose();
      const auto by_centre = [](const Observation& o) {
        return std::pair(o.values[3], o.values[2]);
      };
      auto sorted = seen;
      std::ranges::sort(sorted, {}, by_centre);
      std::ranges::sort(expected, {}, by_centre);
      for (size_t i = 0; i < seen.size(); ++i) {
        EXPECT_EQ(sorted[i].marker, 7);
        EXPECT_EQ(sorted[i].values, expected[i].values);
        const Eigen::Map<const Eigen::Vector4d> v(sorted[i].values.data());
        const auto ray = optics.RayThrough(v.head<2>(), v.tail<2>());
        EXPECT_LT((p - ray->origin).cross(ray->direction).norm(), 1e-6);
      }
    }
    EXPECT_GT(most, 3u);
    EXPECT_TRUE(optics.Observe(7, {0, 0, -0.5}).empty());
  }
}

TEST(MicroLensOptics, RefusesAnArrayOfFewLenses) {
  CameraSpec camera = Plenoptic(false);
  camera.micro_lenses->pitch = 60;
  EXPECT_THAT(testing::RefusalOf([&] { const MicroLensOptics optics(camera); }),
              ::testing::MatchesRegex("cameras.raw: only 9 micro lenses fit on the sensor"));
}

// A plane z = 0.4 m whose brightness is given.
class Plane : public Surface {
 public:
  explicit Plane(std::function<double(double x, double y)> value) : value_(std::move(value)) {}
  [[nodiscard]] float Radiance(const Vector3f& origin,
                               const Vector3f& direction,
                               const Spread&) const override {
    const Vector3f p = origin + (0.4f - origin.z()) / direction.z() * direction;
    return static_cast<float>(value_(p.x(), p.y()));
  }
  [[nodiscard]] std::pair<int, float> FaceOf(const Vector3f& origin,
                                             const Vector3f& direction) const override {
    return {0, (0.4f - origin.z()) / direction.z()};
  }

 private:
  std::function<double(double, double)> value_;
};

TEST(PlenopticRenderer, TracesThePixelsRaysThroughTheMicroLenses) {
  CameraSpec camera = Plenoptic(true);
  camera.image_size = {70, 60};
  camera.params[3] = 36, camera.params[4] = 27;
  camera.micro_lenses->pitch = 14;
  camera.micro_lenses->aperture = 0.3;
  camera.micro_lenses->gain_sigma = 0.1;
  camera.micro_lenses->dull = 9;
  camera.micro_lenses->focus = {2.5, 4};
  camera.micro_lenses->pattern = (Eigen::MatrixXi(1, 2) << 0, 1).finished();
  const MicroLensOptics optics(camera);
  const auto renderer = MakePlenopticRenderer(camera, optics, 3, 2);
  const cv::Mat& white = renderer->White();
  ASSERT_EQ(white.size(), cv::Size(70, 60));
  const cv::Mat uniform = renderer->Render(Plane([](double, double) { return 0.5; }), 1);
  // At the stop's edge no ray of an image may pass, of the many of the white one some.
  int exact = 0;
  for (int y = 0; y < 60; ++y) {
    for (int x = 0; x < 70; ++x) {
      const double half = 0.5 * white.at<float>(y, x), found = uniform.at<float>(y, x);
      EXPECT_TRUE(found < half + 1e-6 && found > half - 0.03) << x << ' ' << y;
      exact += found > half - 1e-6 ? 1 : 0;
    }
  }
  EXPECT_GT(exact, 3500);
  // Brightness that is linear over the plane has at a pixel that of its own ray.
  const auto linear = [](double x, double y) { return 0.5 + 20 * x - 12 * y; };
  const cv::Mat light = renderer->Render(Plane(linear), 1);
  int compared = 0;
  double error = 0, largest = 0;
  std::vector<double> gains;
  for (const MicroLens& lens : optics.Lenses()) {
    const cv::Point middle(cvRound(lens.centre.x()), cvRound(lens.centre.y()));
    if (!cv::Rect(2, 2, 66, 56).contains(middle)) continue;
    const auto chief = optics.RayThrough(lens.centre, lens.centre);
    const double fall_off = std::pow(chief->direction.z(), 4);
    gains.push_back(white.at<float>(middle) / fall_off);
    for (int dy = -2; dy <= 2; ++dy) {
      for (int dx = -2; dx <= 2; ++dx) {
        const cv::Point at = middle + cv::Point(dx, dy);
        const auto ray = optics.RayThrough({at.x, at.y}, lens.centre);
        const Vector3d p =
            ray->origin + (0.4 - ray->origin.z()) / ray->direction.z() * ray->direction;
        const double difference = light.at<float>(at) / white.at<float>(at) - linear(p.x(), p.y());
        error += difference;
        largest = std::max(largest, std::abs(difference));
        ++compared;
      }
    }
  }
  ASSERT_GT(compared, 300);
  EXPECT_LT(std::abs(error / compared), 1e-3);
  EXPECT_LT(largest, 0.02);
  // Gains scatter about 1, but for dull lenses.
  std::ranges::sort(gains);
  EXPECT_NEAR(gains[gains.size() / 2], 1, 0.08);
  EXPECT_TRUE(gains[0] > 0.25 && gains[0] < 0.75);
  EXPECT_LT(gains.back(), 1.4);
  // A sharp edge: more rays. Existing sets keep their images.
  const cv::Mat edge = renderer->Render(
      Plane([](double x, double y) { return x + 0.3 * y < 0.0005 ? 0.9 : 0.1; }), 1);
  Digest of_white, of_edge;
  for (int y = 0; y < 60; ++y) {
    for (int x = 0; x < 70; ++x) {
      of_white.Add(white.at<float>(y, x));
      of_edge.Add(edge.at<float>(y, x));
    }
  }
  EXPECT_NEAR(of_white.Sum(), 25.5052, 0.01);
  EXPECT_NEAR(of_edge.Sum(), 7.3725, 0.02);
  const cv::Mat other = renderer->Render(
      Plane([](double x, double y) { return x + 0.3 * y < 0.0005 ? 0.9 : 0.1; }), 2);
  EXPECT_GT(cv::norm(edge, other, cv::NORM_INF), 0);
}

}  // namespace TEST_FILE
}  // namespace plenocal::simulate
