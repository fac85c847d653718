// SPDX-License-Identifier: Apache-2.0
//
// Features at known places, matches of made descriptors, and tracks through images that shift.
#include "engine/scene/track/feature_tracker.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "models/registry.h"
#include "tests/calib/random.h"
#include "tests/engine/scene/texture.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

struct Blob {
  cv::Point2f at;
  double height = 100;
};

cv::Mat Blobs(const std::vector<Blob>& blobs, const cv::Size& size = {100, 100}) {
  cv::Mat image(size, CV_8U);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      double value = 60;
      for (const Blob& blob : blobs) {
        value +=
            blob.height * std::exp(-(std::pow(x - blob.at.x, 2) + std::pow(y - blob.at.y, 2)) / 32);
      }
      image.at<unsigned char>(y, x) = cv::saturate_cast<unsigned char>(value);
    }
  }
  return image;
}

// Whether a blob is among the features.
std::vector<bool> Shown(const ImageFeatures& features, const std::vector<Blob>& blobs) {
  std::vector<bool> shown;
  for (const Blob& blob : blobs) {
    shown.push_back(std::ranges::any_of(
        features.points, [&](const cv::Point2f& p) { return cv::norm(p - blob.at) < 0.15; }));
  }
  return shown;
}

TEST(ImageFeatures, LieAtTheMiddleOfBlobsWithDescriptorsOfLengthOne) {
  const std::vector<Blob> blobs{{{25.3F, 30.6F}}, {{75, 30}}, {{45.5F, 75.25F}}};
  const ImageFeatures features = FindFeatures(Blobs(blobs), 1000, {}, 0);
  EXPECT_THAT(Shown(features, blobs), Each(true));
  ASSERT_EQ(features.descriptors.rows, static_cast<int>(features.points.size()));
  EXPECT_EQ(features.descriptors.cols, 128);
  for (int row = 0; row < features.descriptors.rows; ++row) {
    EXPECT_NEAR(cv::norm(features.descriptors.row(row)), 1, 1e-4);
  }
  EXPECT_THAT(FindFeatures(cv::Mat(50, 50, CV_8U, cv::Scalar(9)), 10, {}, 0).points, IsEmpty());
}

TEST(ImageFeatures, AreTheStrongestOfEachCell) {
  // 120 x 60 px: of two wanted each has 60 x 60 px.
  const std::vector<Blob> blobs{{{18, 25}, 60}, {{46, 36}, 120}, {{78, 20}, 110}, {{104, 40}, 50}};
  const cv::Mat image = Blobs(blobs, {120, 60});
  EXPECT_THAT(Shown(FindFeatures(image, 1000, {}, 0), blobs), Each(true));
  const ImageFeatures two = FindFeatures(image, 2, {}, 0);
  EXPECT_THAT(two.points, SizeIs(2));
  EXPECT_THAT(Shown(two, blobs), ElementsAre(false, true, true, false));
  // Two cells of 85 px for one wanted, and for none.
  for (const int wanted : {0, 1}) {
    EXPECT_THAT(Shown(FindFeatures(image, wanted, {}, 0), blobs),
                ElementsAre(false, true, false, true));
  }
  // Upright: rows in place of columns.
  std::vector<Blob> upright = blobs;
  for (Blob& blob : upright) std::swap(blob.at.x, blob.at.y);
  EXPECT_THAT(Shown(FindFeatures(image.t(), 2, {}, 0), upright),
              ElementsAre(false, true, true, false));
}

TEST(ImageFeatures, KeepAwayFromTakenPoints) {
  const std::vector<Blob> blobs{{{25, 30}}, {{75, 30}}, {{45, 75}}};
  const cv::Mat image = Blobs(blobs);
  const std::vector<cv::Point2f> beside{{32, 30}, {75, 36}};
  // Cells of 1 px: the distance decides.
  EXPECT_THAT(Shown(FindFeatures(image, 10000, beside, 4), blobs), Each(true));
  EXPECT_THAT(Shown(FindFeatures(image, 10000, beside, 6.5), blobs),
              ElementsAre(true, false, true));
  EXPECT_THAT(Shown(FindFeatures(image, 10000, beside, 8), blobs), ElementsAre(false, false, true));
  // Cells of 50 px: each has one.
  const std::vector<cv::Point2f> far{{48, 48}, {52, 5}};
  EXPECT_THAT(Shown(FindFeatures(image, 4, far, 0), blobs), ElementsAre(false, false, true));
  // Points outside count for the cells at the border.
  const std::vector<cv::Point2f> outside{{-3, 20}, {130, 20}, {20, 130}};
  EXPECT_THAT(Shown(FindFeatures(image, 4, outside, 0), blobs), Each(false));
}

cv::Mat Rows(const std::vector<std::pair<float, float>>& rows) {
  cv::Mat made(static_cast<int>(rows.size()), 2, CV_32F);
  for (int i = 0; i < made.rows; ++i) {
    made.at<float>(i, 0) = rows[static_cast<size_t>(i)].first;
    made.at<float>(i, 1) = rows[static_cast<size_t>(i)].second;
  }
  return made;
}

using Pairs = std::vector<std::pair<int, int>>;

TEST(DescriptorMatches, AreEachOthersBestAndClearlyBetterThanTheSecond) {
  const cv::Mat a = Rows({{0, 0}, {10, 0}, {0, 10}});
  EXPECT_EQ(MatchDescriptors(a, Rows({{0, 9}, {1, 0}, {10, 1}})), (Pairs{{0, 1}, {1, 2}, {2, 0}}));
  // 0.8 of the second's distance, less and more.
  EXPECT_EQ(MatchDescriptors(Rows({{0, 0}, {99, 99}}), Rows({{7.9F, 0}, {0, 10}})),
            (Pairs{{0, 0}}));
  EXPECT_EQ(MatchDescriptors(Rows({{0, 0}, {99, 99}}), Rows({{8.1F, 0}, {0, 10}})), Pairs{});
  // Rows 0 and 1 both want row 1, which prefers row 1.
  EXPECT_EQ(MatchDescriptors(Rows({{0, 0}, {2, 0}}), Rows({{50, 50}, {3, 0}})), (Pairs{{1, 1}}));
  EXPECT_EQ(MatchDescriptors(Rows({{0, 0}}), a), Pairs{});
  EXPECT_EQ(MatchDescriptors(a, Rows({{0, 0}})), Pairs{});
  EXPECT_EQ(MatchDescriptors(a, cv::Mat()), Pairs{});
}

// Which of `count` points of a scene in two views agree; the first `wrong` are `off` px away.
std::vector<bool> Agree(size_t count, size_t wrong, float off) {
  Random random(3);
  std::vector<cv::Point2f> a, b;
  const RigidTransform T{ExpRotation({0.02, -0.1, 0.03}), {-0.4, 0.05, 0.1}};
  for (size_t k = 0; k < count; ++k) {
    const Eigen::Vector3d p(random.Uniform(-1, 1), random.Uniform(-1, 1), random.Uniform(2, 5));
    const Eigen::Vector3d q = T * p;
    a.emplace_back(320 + 500 * p.x() / p.z(), 240 + 500 * p.y() / p.z());
    b.emplace_back(320 + 500 * q.x() / q.z(), 240 + 500 * q.y() / q.z() + (k < wrong ? off : 0));
  }
  return OnOneEpipolarGeometry(a, b);
}

TEST(EpipolarGeometry, IsThatOfAtLeastFifteenPairs) {
  EXPECT_EQ(Agree(15, 0, 0), std::vector<bool>(15, true));
  EXPECT_EQ(Agree(14, 0, 0), std::vector<bool>(14, false));
  EXPECT_THAT(Agree(0, 0, 0), IsEmpty());
  std::vector<bool> expected(40, true);
  for (size_t k = 0; k < 4; ++k) expected[k] = false;
  EXPECT_EQ(Agree(40, 4, 9), expected);
  EXPECT_EQ(Agree(40, 4, 0.5), std::vector<bool>(40, true));
}

BundleCamera Camera(double x) {
  BundleCamera camera{.name = "c",
                      .image_size = {240, 120},
                      .model = FindModel(CameraModels(), "pinhole"),
                      .config = {},
                      .params = {300, 300, 119.5, 59.5},
                      .fixed = std::vector<bool>(4, true),
                      .T_camera_rig = {Eigen::Matrix3d::Identity(), {-x, 0, 0}}};
  camera.is_master = true;
  return camera;
}

// A window of one texture, from column `at` on.
cv::Mat Window(int at) {
  static const cv::Mat texture = Texture(7, 600, 120, 2);
  return texture(cv::Rect(at, 0, 240, 120)).clone();
}

// Columns of the texture of each point, less that of the window.
std::map<int, double> Columns(const FeatureTracker& tracker, int at) {
  std::map<int, double> columns;
  for (const FeatureTracker::Followed& each : tracker.FollowedNow()) {
    columns[each.number] = each.now.point.x + at;
  }
  return columns;
}

// Tracks of both that are at the same column of the texture; all that both have must be.
size_t Same(const std::map<int, double>& a, const std::map<int, double>& b) {
  size_t same = 0;
  for (const auto& [number, column] : b) {
    if (!a.contains(number)) continue;
    EXPECT_NEAR(a.at(number), column, 0.1) << number;
    ++same;
  }
  return same;
}

class Tracks : public ::testing::Test {
 protected:
  FeatureTracker Tracker(const FeatureOptions& options) { return {cameras_, options, 50}; }

  std::vector<BundleCamera> cameras_{Camera(0)};
};

TEST_F(Tracks, AreFoundOnceAndKeepTheirImage) {
  FeatureTracker tracker = Tracker({.wanted = 30, .threads = 1});
  const cv::Mat first = Window(100);
  tracker.AddFrame("a", {first});
  const std::map<int, double> found = Columns(tracker, 100);
  ASSERT_GT(found.size(), 21U);
  EXPECT_GE(found.begin()->first, 50);
  EXPECT_LT(found.rbegin()->first, 50 + tracker.Descriptors().rows);
  for (const FeatureTracker::Followed& each : tracker.FollowedNow()) {
    EXPECT_LT(cv::norm(each.in_key - each.now.point), 1e-3);
    EXPECT_EQ(each.now.sigma, 0);
    EXPECT_EQ(cv::norm(*each.key_image, first), 0);
  }
  // One image shows no place of a point but by its own noise.
  EXPECT_THAT(tracker.Views(), ElementsAre(IsEmpty()));
  const int descriptors = tracker.Descriptors().rows;
  tracker.AddFrame("b", {Window(103)});
  EXPECT_GT(Same(found, Columns(tracker, 103)), 20U);
  // Enough are left: no new ones.
  EXPECT_EQ(tracker.Descriptors().rows, descriptors);
  for (const FeatureTracker::Followed& each : tracker.FollowedNow()) {
    EXPECT_NEAR(each.in_key.x - 3, each.now.point.x, 0.1);
    EXPECT_EQ(cv::norm(*each.key_image, first), 0);
  }
  const std::vector<View> views = tracker.Views()[0];
  ASSERT_THAT(views, SizeIs(2));
  EXPECT_EQ(views[0].frame, "a");
  EXPECT_EQ(views[1].frame, "b");
  EXPECT_EQ(views[0].observations.size(), views[1].observations.size());
  for (const View& view : views) {
    for (const Observation& seen : view.observations) {
      EXPECT_NEAR(seen.values[0] + (view.frame == "a" ? 100 : 103), found.at(seen.marker), 0.1);
      EXPECT_GT(seen.detector_sigma, 0);
    }
  }
}

// A fit has the noise of two images, half of it for each; the first image has the mean of all fits.
TEST_F(Tracks, ShareTheNoiseOfFitsBetweenTwoImages) {
  FeatureTracker tracker = Tracker({.wanted = 30, .threads = 1});
  tracker.AddFrame("a", {Window(100)});
  std::map<std::string, std::map<int, double>> fits;
  for (const auto& [frame, noise] : {std::pair("b", 4), std::pair("c", 12)}) {
    cv::Mat errors(120, 240, CV_16S), sum;
    cv::RNG(5).fill(errors, cv::RNG::NORMAL, 0, noise);
    cv::add(Window(100), errors, sum, cv::noArray(), CV_8U);
    tracker.AddFrame(frame, {sum});
    for (const FeatureTracker::Followed& each : tracker.FollowedNow()) {
      fits[frame][each.number] = each.now.sigma;
    }
  }
  ASSERT_GT(fits["c"].size(), 10U);
  const std::vector<View> views = tracker.Views()[0];
  ASSERT_THAT(views, SizeIs(3));
  for (const View& view : views) {
    for (const Observation& seen : view.observations) {
      if (!fits["c"].contains(seen.marker)) continue;
      const double b = fits["b"].at(seen.marker), c = fits["c"].at(seen.marker);
      EXPECT_GT(c, b);
      const double sigma = view.frame == "a"   ? std::sqrt((b * b + c * c) / 4)
                           : view.frame == "b" ? b / std::sqrt(2)
                                               : c / std::sqrt(2);
      EXPECT_NEAR(seen.detector_sigma, sigma, 1e-9) << view.frame;
    }
  }
}

TEST_F(Tracks, AreRefilledWhenTooFewAreLeft) {
  FeatureTracker tracker = Tracker({.wanted = 30, .threads = 1});
  tracker.AddFrame("0", {Window(0)});
  const std::map<int, double> first = Columns(tracker, 0);
  const auto least = static_cast<size_t>(21);
  int descriptors = tracker.Descriptors().rows;
  for (int k = 1; k <= 20; ++k) {
    tracker.AddFrame(std::to_string(k), {Window(8 * k)});
    const std::map<int, double> now = Columns(tracker, 8 * k);
    EXPECT_GE(now.size(), least) << k;
    const size_t old = Same(first, now);
    if (tracker.Descriptors().rows == descriptors) continue;
    // New tracks are numbered on and lie away from the old ones.
    EXPECT_GE(now.rbegin()->first, 50 + descriptors);
    EXPECT_LT(now.rbegin()->first, 50 + tracker.Descriptors().rows);
    EXPECT_LT(old, least);
    const auto places = tracker.FollowedNow();
    for (size_t i = 0; i < places.size(); ++i) {
      for (size_t j = 0; j < i; ++j) {
        EXPECT_GT(cv::norm(places[i].now.point - places[j].now.point), 2);
      }
    }
    return;
  }
  FAIL() << "never refilled";
}

TEST_F(Tracks, AreFoundAgainByDescriptorsAfterAJerk) {
  FeatureTracker tracker = Tracker({.wanted = 60, .threads = 1});
  tracker.AddFrame("a", {Window(100)});
  const std::map<int, double> found = Columns(tracker, 100);
  tracker.AddFrame("b", {Window(190)});
  const std::map<int, double> after = Columns(tracker, 190);
  EXPECT_GT(Same(found, after), 15U);
  EXPECT_GT(after.rbegin()->first, found.rbegin()->first);  // refilled
  for (const FeatureTracker::Followed& each : tracker.FollowedNow()) {
    EXPECT_EQ(each.now.sigma > 0, found.contains(each.number)) << each.number;
  }
}

TEST_F(Tracks, AreFoundAgainAfterAFrameWithoutAnImage) {
  FeatureTracker tracker = Tracker({.wanted = 60, .threads = 1});
  tracker.AddFrame("a", {Window(100)});
  const std::map<int, double> found = Columns(tracker, 100);
  tracker.AddFrame("b", {cv::Mat()});
  EXPECT_THAT(tracker.FollowedNow(), IsEmpty());
  tracker.AddFrame("c", {Window(102)});
  EXPECT_GT(Same(found, Columns(tracker, 102)), found.size() / 2);
  const std::vector<View> views = tracker.Views()[0];
  ASSERT_THAT(views, SizeIs(2));
  EXPECT_EQ(views[1].frame, "c");
}

// Tracks of the second camera, by their columns in the texture.
size_t InSecond(const FeatureTracker& tracker, const std::string& frame, int at, int column) {
  std::map<int, double> first;
  size_t same = 0;
  const std::vector<std::vector<View>> views = tracker.Views();
  for (const View& view : views[0]) {
    if (view.frame != frame) continue;
    for (const Observation& seen : view.observations) first[seen.marker] = seen.values[0] + at;
  }
  for (const View& view : views[1]) {
    if (view.frame != frame) continue;
    for (const Observation& seen : view.observations) {
      EXPECT_TRUE(first.contains(seen.marker));
      EXPECT_NEAR(seen.values[0] + column, first[seen.marker], 0.1);
      EXPECT_GT(seen.detector_sigma, 0);
      ++same;
    }
  }
  return same;
}

TEST_F(Tracks, OfTheFirstCameraAreFoundInTheSecond) {
  cameras_.push_back(Camera(0.1));
  struct Case {
    bool calibrated = true;
    int disparity = 0;
    size_t least = 0, most = 0;
  };
  // Curves end at four baselines, 75 px: descriptors alone find what is nearer.
  for (const Case& each : {Case{true, 24, 15, 999}, {true, 90, 0, 0}, {false, 90, 10, 999}}) {
    FeatureTracker tracker = Tracker({.wanted = 60, .calibrated = each.calibrated, .threads = 1});
    tracker.AddFrame("a", {Window(100), cv::Mat()});
    EXPECT_THAT(tracker.Views()[1], IsEmpty());
    const auto add = [&](const char* frame, int at) {
      tracker.AddFrame(frame, {Window(at), Window(at + each.disparity)});
      return InSecond(tracker, frame, at, at + each.disparity);
    };
    // New tracks alone are searched there, and all of them after a jerk.
    EXPECT_EQ(add("b", 104), 0U);
    const size_t found = add("c", 210);
    EXPECT_GE(found, each.least);
    EXPECT_LE(found, each.most);
    EXPECT_GE(2 * add("d", 212), found);
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
