// SPDX-License-Identifier: Apache-2.0
//
// Points of a plane in raw images of a plenoptic camera, beside an ordinary camera that sees the
// same picture.
#include "engine/scene/track/plenoptic_tracker.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <map>
#include <set>

#include "calib/base/error.h"
#include "engine/scene/locate_view.h"
#include "engine/scene/track/follow_points.h"
#include "models/registry.h"
#include "tests/detectors/plenoptic/plenoptic_scene.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::SizeIs;

const cv::Point kShift(
    4, 3);  // px, of the ordinary camera in the focused image, which has half as many pixels

// Frames a and b; c cannot be read, d has another size.
class PlenopticPoints : public ::testing::Test {
 protected:
  PlenopticPoints() {
    scene_.width = scene_.height = 200;
    scene_.detail = 14;
    optics_.array = scene_.Array();
    optics_.attenuation = scene_.Attenuation(optics_.array);
    cameras_.resize(2);
    cameras_[0].name = "wide";
    cameras_[1].name = "raw";
    cameras_[0].model = FindModel(CameraModels(), "pinhole");
    cameras_[1].model = FindModel(CameraModels(), "focused-plenoptic");
    raw_ = scene_.Raw(optics_.array);
    cv::RNG random(5);
    again_ = raw_.clone();
    cv::Mat noise(raw_.size(), CV_16U);
    random.fill(noise, cv::RNG::UNIFORM, 0, 200);
    again_ += noise;
  }

  FollowedPoints Follow(const std::vector<size_t>& frames) {
    const cv::Mat focused = FocusedImage(raw_, optics_, 1);
    RigImages images{.cameras = &cameras_,
                     .optics = {{1, optics_}},
                     .frames = {"a", "b", "c", "d"},
                     .read = [&](size_t camera, size_t frame) -> cv::Mat {
                       if (camera == 0) {
                         return focused(cv::Rect(kShift.x, kShift.y, 92, 92)).clone();
                       }
                       if (frame == 2) throw Error(ErrorKind::kInput, "is damaged");
                       if (frame == 3) return raw_(cv::Rect(0, 0, 180, 200)).clone();
                       return frame == 0 ? raw_ : again_;
                     },
                     .threads = 1};
    return FollowPoints(
        images, frames, {.wanted = 120, .calibrated = false}, 30, [&](size_t done, size_t total) {
          done_.emplace_back(done, total);
        });
  }

  PlenopticScene scene_;
  PlenopticCamera optics_;
  std::vector<BundleCamera> cameras_;
  cv::Mat raw_, again_;
  std::vector<std::pair<size_t, size_t>> done_;
};

TEST_F(PlenopticPoints, AreMeasuredInMicroImagesAndLookLikeThoseOfTheOrdinaryCamera) {
  const FollowedPoints found = Follow({0, 1, 2, 3});
  ASSERT_THAT(done_, SizeIs(8));
  for (size_t k = 0; k < 8; ++k) EXPECT_EQ(done_[k], std::pair(k, size_t{8}));
  ASSERT_THAT(found.left_out, SizeIs(2));
  EXPECT_EQ(found.left_out[0].where, "raw c");
  EXPECT_EQ(found.left_out[0].reason, "is damaged");
  EXPECT_EQ(found.left_out[1].where, "raw d");
  EXPECT_EQ(found.left_out[1].camera, "raw");
  EXPECT_TRUE(found.left_out[1].whole);

  // Rows of the first group, then of the second.
  ASSERT_EQ(static_cast<int>(found.group.size()), found.descriptors.rows);
  EXPECT_TRUE(std::ranges::is_sorted(found.group));
  const auto first = static_cast<int>(std::ranges::count(found.group, 0));
  EXPECT_EQ(std::ranges::count(found.group, 1), found.descriptors.rows - first);
  std::map<int, cv::Point2d> in_ordinary;
  for (const View& view : found.views[0]) {
    for (const Observation& seen : view.observations) {
      EXPECT_LT(seen.marker, 30 + first);
      in_ordinary[seen.marker] = {seen.values[0], seen.values[1]};
    }
  }
  // The virtual image of a point: x = q + (c - q) (1 - 1 / depth) by lens c.
  std::map<int, cv::Point2d> in_raw;
  std::map<int, std::set<std::pair<double, double>>> lenses;
  std::vector<std::string> frames;
  for (const View& view : found.views[1]) {
    frames.push_back(view.frame);
    for (const Observation& seen : view.observations) {
      EXPECT_GE(seen.marker, 30 + first);
      const Eigen::Vector2d x(seen.values[0], seen.values[1]), c(seen.values[2], seen.values[3]);
      EXPECT_LT((x - c).norm(), scene_.pitch / 2);
      const Eigen::Vector2d q = c + scene_.Depth(c) / (1 - scene_.slope.dot(x - c)) * (x - c);
      const auto [entry, is_new] = in_raw.emplace(seen.marker, cv::Point2d(q.x(), q.y()));
      EXPECT_LT(cv::norm(entry->second - cv::Point2d(q.x(), q.y())), 1.5) << seen.marker;
      lenses[seen.marker].emplace(c.x(), c.y());
    }
  }
  EXPECT_THAT(frames, ElementsAre("a", "b"));
  ASSERT_GT(in_raw.size(), 10U);
  EXPECT_GT(std::ranges::count_if(lenses, [](const auto& each) { return each.second.size() > 2; }),
            10);

  ASSERT_GT(found.alike.size(), 15U);
  // One geometry of all pairs keeps some that only look alike.
  size_t both = 0, same = 0;
  for (const auto& [second, of_first] : found.alike) {
    EXPECT_GE(second, 30 + first);
    EXPECT_LT(of_first, 30 + first);
    EXPECT_LT(cv::norm(found.descriptors.row(second - 30), found.descriptors.row(of_first - 30)),
              0.5);
    if (!in_raw.contains(second) || !in_ordinary.contains(of_first)) continue;
    ++both;
    const cv::Point2d expected = 2 * (in_ordinary.at(of_first) + cv::Point2d(kShift));
    same += cv::norm(in_raw.at(second) - expected) < 4 ? 1 : 0;
  }
  EXPECT_GT(same, 5U);
  EXPECT_GE(10 * same, 8 * both);
}

TEST_F(PlenopticPoints, LookAlikeInAnyFrame) {
  const FollowedPoints found = Follow({2, 0, 1});  // the first cannot be read
  EXPECT_GT(found.alike.size(), 15U);
  EXPECT_THAT(done_, SizeIs(6));
  EXPECT_EQ(done_.back(), std::pair(size_t{5}, size_t{6}));
}

TEST_F(PlenopticPoints, OfAPlenopticCameraAloneAreOneGroup) {
  cameras_.erase(cameras_.begin());
  RigImages images;
  images.cameras = &cameras_;
  images.optics = {{0, optics_}};
  images.frames = {"a"};
  images.read = [](size_t, size_t) -> cv::Mat { throw Error(ErrorKind::kInput, "is damaged"); };
  const FollowedPoints found = FollowPoints(
      images, {0}, {}, 30, [&](size_t done, size_t total) { done_.emplace_back(done, total); });
  EXPECT_THAT(done_, ElementsAre(std::pair(0, 1)));
  ASSERT_THAT(found.left_out, SizeIs(1));
  EXPECT_EQ(found.left_out[0].where, "raw a");
  EXPECT_THAT(found.alike, SizeIs(0));
}

TEST_F(PlenopticPoints, OfAMapAreFoundAgainInARawImage) {
  PlenopticTracker tracker(cameras_[1], optics_, {.wanted = 3000}, 0, 1);
  tracker.AddFrame("a", raw_);
  LandmarkMap map;
  map.descriptors = tracker.Descriptors();
  // Each third point is not part of the map.
  cv::Mat kept;
  for (int row = 0; row < map.descriptors.rows; ++row) {
    if (row % 3 == 0) continue;
    kept.push_back(map.descriptors.row(row));
    map.numbers.push_back(1000 - row);
  }
  map.descriptors = kept;
  CalibratedCamera camera;
  camera.model = cameras_[1].model;
  const View found = MatchLandmarks(again_, camera, optics_, map, 1);
  // Several measurements of a point in micro images, where the first image shows it.
  std::map<int, std::map<std::pair<double, double>, cv::Point2d>> first;
  tracker.AddFrame("b", again_);
  const std::vector<View> views = tracker.Views();
  for (const Observation& seen : views.at(0).observations) {
    first[1000 - seen.marker][{seen.values[2], seen.values[3]}] = {seen.values[0], seen.values[1]};
  }
  std::set<int> numbers;
  size_t compared = 0, same = 0;
  for (const Observation& seen : found.observations) {
    EXPECT_NE((1000 - seen.marker) % 3, 0);
    numbers.insert(seen.marker);
    const auto& places = first[seen.marker];
    const auto place = places.find({seen.values[2], seen.values[3]});
    if (place == places.end()) continue;
    ++compared;
    same += cv::norm(place->second - cv::Point2d(seen.values[0], seen.values[1])) < 0.3 ? 1 : 0;
  }
  EXPECT_GT(numbers.size(), 10U);
  EXPECT_GT(compared, 3 * numbers.size());
  EXPECT_GE(10 * same, 9 * compared);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
