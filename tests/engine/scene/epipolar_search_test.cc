// SPDX-License-Identifier: Apache-2.0
//
// The same texture in two images of a rectified pair, by its known disparity; points followed
// through images that shift.
#include "engine/scene/track/epipolar_search.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <map>
#include <opencv2/core.hpp>

#include "calib/base/error.h"
#include "engine/scene/track/follow_points.h"
#include "models/registry.h"
#include "tests/engine/scene/texture.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr double kFocal = 300, kBase = 0.1;  // px, m

BundleCamera Camera(const std::string& name, double x) {
  BundleCamera camera{.name = name,
                      .image_size = {320, 120},
                      .model = FindModel(CameraModels(), "pinhole"),
                      .config = {},
                      .params = {kFocal, kFocal, 159.5, 59.5},
                      .fixed = std::vector<bool>(4, true),
                      .T_camera_rig = {Eigen::Matrix3d::Identity(), {-x, 0, 0}}};
  camera.is_master = true;
  return camera;
}

// What the second camera shows of the first one's place (160, 60) when all is `disparity` px to the
// left and `down` px lower there.
std::optional<cv::Point2f> Found(int disparity,
                                 int down,
                                 const cv::Point2f& point,
                                 double nearest = 4,
                                 const cv::Mat& texture = Texture(3, 600, 200, 1)) {
  const BundleCamera left = Camera("left", 0), right = Camera("right", kBase);
  const cv::Mat first = texture(cv::Rect(100, 40, 320, 120)).clone(),
                second = texture(cv::Rect(100 + disparity, 40 - down, 320, 120)).clone();
  return SearchEpipolarCurve({&left, &first}, point, {&right, &second}, nearest);
}

TEST(EpipolarSearch, FindsThePlaceByItsDisparity) {
  for (const int disparity : {0, 20, 74}) {
    for (const int down : {-1, 0, 1}) {
      const auto found = Found(disparity, down, {160, 60});
      ASSERT_TRUE(found) << disparity << " " << down;
      EXPECT_EQ(found->x, 160 - disparity);
      EXPECT_EQ(found->y, 60 + down);
    }
  }
  // The part of a pixel stays.
  const auto found = Found(20, 0, {160.25F, 59.625F});
  ASSERT_TRUE(found);
  EXPECT_EQ(found->x, 140.25F);
  EXPECT_EQ(found->y, 59.625F);
}

TEST(EpipolarSearch, RefusesPlacesOffTheCurve) {
  EXPECT_FALSE(Found(20, 3, {160, 60}));
  EXPECT_FALSE(Found(20, -3, {160, 60}));
  EXPECT_FALSE(Found(20, 2, {160, 60}));
  EXPECT_FALSE(Found(20, -2, {160, 60}));
  EXPECT_FALSE(Found(-5, 0, {160, 60}));  // behind infinity
}

// Four baselines away the disparity is a quarter of the focal length, 75 px.
TEST(EpipolarSearch, EndsAtTheNearestDistance) {
  EXPECT_FALSE(Found(80, 0, {160, 60}));
  EXPECT_TRUE(Found(80, 0, {160, 60}, 3.5));
  EXPECT_FALSE(Found(40, 0, {160, 60}, 8));
  EXPECT_TRUE(Found(36, 0, {160, 60}, 8));
}

TEST(EpipolarSearch, KeepsAPatchInsideOfTheImages) {
  EXPECT_TRUE(Found(0, 0, {5, 60}));
  EXPECT_FALSE(Found(0, 0, {4, 60}));
  EXPECT_TRUE(Found(10, 0, {314, 60}));
  EXPECT_FALSE(Found(10, 0, {315, 60}));
  EXPECT_TRUE(Found(10, 0, {160, 5}));
  EXPECT_FALSE(Found(10, 0, {160, 4}));
  EXPECT_TRUE(Found(10, 0, {160, 114}));
  EXPECT_FALSE(Found(10, 0, {160, 115}));
}

TEST(EpipolarSearch, NeedsTextureThatIsClearlyTheBest) {
  EXPECT_FALSE(Found(20, 0, {160, 60}, 4, cv::Mat(200, 600, CV_8U, cv::Scalar(90))));
  cv::Mat faint;
  Texture(3, 600, 200, 1).convertTo(faint, CV_8U, 0.02, 100);
  EXPECT_FALSE(Found(20, 0, {160, 60}, 4, faint));
  const BundleCamera left = Camera("left", 0), right = Camera("right", kBase);
  // Equal every 30 px but for noise.
  cv::Mat repeated(200, 600, CV_8U);
  const cv::Mat tile = Texture(5, 30, 200, 1);
  for (int x = 0; x < 600; x += 30) tile.copyTo(repeated(cv::Rect(x, 0, 30, 200)));
  cv::Mat noisy(120, 320, CV_8U);
  cv::RNG(9).fill(noisy, cv::RNG::UNIFORM, 0, 9);
  noisy += repeated(cv::Rect(0, 40, 320, 120));
  const cv::Mat clean = repeated(cv::Rect(0, 40, 320, 120)).clone();
  EXPECT_FALSE(SearchEpipolarCurve({&left, &clean}, {160, 60}, {&right, &noisy}));
  // Other contrast and brightness are no matter.
  const cv::Mat first = Texture(3, 320, 120, 1);
  cv::Mat second;
  first.convertTo(second, CV_8U, 0.5, 30);
  const auto found = SearchEpipolarCurve({&left, &first}, {160, 60}, {&right, &second});
  ASSERT_TRUE(found);
  EXPECT_EQ(found->x, 160);
}

// The first camera's patch at (160, 60) at these columns of the second, each with noise.
std::optional<cv::Point2f> FoundAmong(const std::vector<std::pair<int, double>>& column_noise) {
  const BundleCamera left = Camera("left", 0), right = Camera("right", kBase);
  const cv::Mat first = Texture(3, 320, 120, 1);
  cv::Mat second = Texture(11, 320, 120, 1);
  for (const auto& [column, noise] : column_noise) {
    cv::Mat patch, errors(21, 21, CV_32F);
    first(cv::Rect(150, 50, 21, 21)).convertTo(patch, CV_32F);
    cv::RNG(5).fill(errors, cv::RNG::NORMAL, 0, noise);
    patch += errors;
    patch.convertTo(second(cv::Rect(column - 10, 50, 21, 21)), CV_8U);
  }
  return SearchEpipolarCurve({&left, &first}, {160, 60}, {&right, &second});
}

TEST(EpipolarSearch, ComparesThePeaksInEitherOrder) {
  for (const int column : {150, 110}) {
    const auto found = FoundAmong({{column, 8}});
    ASSERT_TRUE(found);
    EXPECT_EQ(found->x, column);
    EXPECT_EQ(found->y, 60);
    const int other = 260 - column;
    EXPECT_FALSE(FoundAmong({{column, 8}, {other, 9}}));
    EXPECT_TRUE(FoundAmong({{column, 8}, {other, 30}}));
  }
}

// A camera that shifts by two pixels a frame, and a second one at a disparity of 12 px.
struct Shifting {
  cv::Mat texture = Texture(7, 400, 120, 2);
  std::vector<BundleCamera> cameras{Camera("left", 0), Camera("right", kBase)};
  RigImages images;

  Shifting() {
    images.cameras = &cameras;
    images.frames = {"a", "b", "c", "d"};
    images.threads = 1;
    images.read = [this](size_t camera, size_t frame) -> cv::Mat {
      if (camera == 1 && frame == 1) throw Error(ErrorKind::kInput, "is damaged");
      const int at = 2 * static_cast<int>(frame) + 12 * static_cast<int>(camera);
      return texture(cv::Rect(at, 0, 320, 120)).clone();
    };
  }
};

TEST(FollowedPoints, MoveAsTheImagesDo) {
  Shifting shifting;
  std::vector<std::pair<size_t, size_t>> reported;
  const FollowedPoints found =
      FollowPoints(shifting.images,
                   {0, 1, 3},
                   {.wanted = 40, .calibrated = true},
                   100,
                   [&](size_t done, size_t total) { reported.emplace_back(done, total); });
  using Pair = std::pair<size_t, size_t>;
  EXPECT_THAT(reported, ElementsAre(Pair{0, 3}, Pair{1, 3}, Pair{2, 3}));
  ASSERT_EQ(found.left_out.size(), 1U);
  EXPECT_EQ(found.left_out[0].where, "right b");
  EXPECT_EQ(found.left_out[0].reason, "is damaged");
  EXPECT_TRUE(found.left_out[0].whole);
  EXPECT_EQ(found.left_out[0].camera, "right");
  EXPECT_EQ(found.left_out[0].frame, "b");
  EXPECT_THAT(found.alike, IsEmpty());
  EXPECT_EQ(found.group, std::vector<int>(static_cast<size_t>(found.descriptors.rows), 0));
  ASSERT_EQ(found.views.size(), 2U);
  // Positions in the texture are the same in all images.
  const std::map<std::string, int> shifts{{"a", 0}, {"b", 2}, {"d", 6}};
  std::map<int, cv::Point2d> places;
  std::map<int, int> counts;
  for (size_t c = 0; c < 2; ++c) {
    for (const View& view : found.views[c]) {
      ASSERT_TRUE(shifts.contains(view.frame));
      EXPECT_FALSE(c == 1 && view.frame == "b" && !view.observations.empty());
      for (const Observation& seen : view.observations) {
        EXPECT_GE(seen.marker, 100);
        EXPECT_LT(seen.marker, 100 + found.descriptors.rows);
        const cv::Point2d place(seen.values[0] + shifts.at(view.frame) + 12.0 * c, seen.values[1]);
        const auto [entry, is_new] = places.emplace(seen.marker, place);
        EXPECT_LT(cv::norm(place - entry->second), 0.2) << seen.marker;
        ++counts[seen.marker];
      }
    }
  }
  EXPECT_GT(std::ranges::count_if(counts, [](const auto& each) { return each.second >= 4; }), 15);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
