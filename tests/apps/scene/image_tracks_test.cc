// SPDX-License-Identifier: Apache-2.0
#include "apps/groundtruth/image_tracks.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "models/registry.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;

constexpr int kWidth = 300, kHeight = 240;

cv::Mat Texture(int seed) {
  cv::theRNG().state = static_cast<std::uint64_t>(seed);
  cv::Mat texture(kHeight, kWidth + 150, CV_32F);
  cv::randn(texture, 0, 1);
  cv::GaussianBlur(texture, texture, {}, 3);
  return 128 + 250 * texture;
}

/// The part of a texture in view after a movement to the right, px.
cv::Mat Image(const cv::Mat& texture, int shift) {
  cv::Mat grey;
  texture(cv::Rect(shift, 0, kWidth, kHeight)).convertTo(grey, CV_8U);
  return grey;
}

class ImageTracks : public testing::InTemporaryFolder {
 protected:
  ImageTracks() {
    camera_.name = "left";
    camera_.image_size = {kWidth, kHeight};
    camera_.model = FindModel(CameraModels(), "pinhole-radial3");
    recording_.path = folder_;
    recording_.cameras.resize(1);
    recording_.cameras[0].name = "left";
    recording_.cameras[0].image_size = {kWidth, kHeight};
  }
  void Add(const cv::Mat& image) {
    RecordedCamera& camera = recording_.cameras[0];
    const std::string name = fmt::format("{:02}", camera.images.size());
    RecordedImage recorded;
    recorded.frame = name;
    recorded.path = folder_ / (name + ".png");
    cv::imwrite(recorded.path.string(), image);
    recording_.frames.push_back({.name = name,
                                 .time = std::numeric_limits<double>::quiet_NaN(),
                                 .image = {camera.images.size()}});
    camera.images.push_back(recorded);
  }
  [[nodiscard]] LoopTracks Track(const SegmentChoice& segments) const {
    return TrackLoop(
        recording_,
        {camera_},
        {.segments = segments, .features = {.wanted = 60}, .threads = 1, .progress = {}});
  }

  Recording recording_;
  BundleCamera camera_;
};

/// Places of the tracks in one frame, by number.
std::map<int, cv::Point2d> PlacesIn(const std::vector<View>& views, const std::string& frame) {
  std::map<int, cv::Point2d> places;
  for (const View& view : views) {
    if (view.frame != frame) continue;
    for (const Observation& seen : view.observations) {
      places[seen.marker] = {seen.values[0], seen.values[1]};
    }
  }
  return places;
}

TEST_F(ImageTracks, OfStartAndEndMatchWhereTheyShowTheSamePoint) {
  const cv::Mat texture = Texture(7);
  for (const int shift : {0, 3, 6, 20, 23, 26}) Add(Image(texture, shift));
  const LoopTracks loop = Track({":02", "03:"});
  EXPECT_EQ(loop.segments.start, (std::vector<size_t>{0, 1, 2}));
  EXPECT_EQ(loop.segments.end, (std::vector<size_t>{3, 4, 5}));
  ASSERT_GT(loop.tracks.matches.size(), 20U);
  const auto start = PlacesIn(loop.tracks.views[0], "00"),
             end = PlacesIn(loop.tracks.views[0], "03");
  int compared = 0, same = 0;
  for (const auto& [of_end, of_start] : loop.tracks.matches) {
    ASSERT_LT(of_start, of_end);
    if (!start.contains(of_start) || !end.contains(of_end)) continue;
    ++compared;
    const cv::Point2d moved = start.at(of_start) - end.at(of_end);
    same += cv::norm(moved - cv::Point2d(20, 0)) < 0.5 ? 1 : 0;
  }
  EXPECT_GT(compared, 20);
  EXPECT_GE(same, 0.9 * compared);
  for (const View& view : loop.tracks.views[0]) {
    for (const Observation& seen : view.observations) EXPECT_LT(seen.marker, loop.descriptors.rows);
  }
}

TEST_F(ImageTracks, OfSixteenBitsAreThoseOfTheirBrightestEight) {
  std::vector<View> of_eight;
  for (const double factor : {1.0, 257.0, 16.0}) {
    recording_.frames.clear();
    recording_.cameras[0].images.clear();
    const cv::Mat texture = Texture(7);
    for (const int shift : {0, 3, 6, 3}) {
      cv::Mat image = Image(texture, shift);
      image.at<std::uint8_t>(0, 0) = 255;  // so that the scale is the same in all of them
      if (factor > 1) image.convertTo(image, CV_16U, factor);
      Add(image);
    }
    const LoopTracks loop = Track({":01", "02:"});
    if (of_eight.empty()) of_eight = loop.tracks.views[0];
    ASSERT_EQ(loop.tracks.views[0].size(), of_eight.size());
    for (size_t v = 0; v < of_eight.size(); ++v) {
      ASSERT_EQ(loop.tracks.views[0][v].observations.size(), of_eight[v].observations.size());
      ASSERT_GT(of_eight[v].observations.size(), 30U);
      for (size_t i = 0; i < of_eight[v].observations.size(); ++i) {
        EXPECT_EQ(loop.tracks.views[0][v].observations[i].values,
                  of_eight[v].observations[i].values);
      }
    }
  }
}

TEST_F(ImageTracks, EndBeginsWhereTwoImagesInARowShowTheStart) {
  const cv::Mat home = Texture(7), away = Texture(8);
  for (int i = 0; i < 40; ++i) {
    // Image 24 shows the start by chance, once.
    const bool at_home = i < 12 || i == 24 || i >= 31;
    Add(Image(at_home ? home : away, at_home ? i % 12 * 2 : i));
  }
  const LoopTracks loop = Track({});
  EXPECT_EQ(loop.segments.start.size(), 7U);
  ASSERT_EQ(loop.segments.end.size(), 9U);
  EXPECT_EQ(loop.segments.end[0], 31U);
}

TEST_F(ImageTracks, AreRefusedOfAnEndThatIsElsewhere) {
  const cv::Mat home = Texture(7), away = Texture(8);
  for (int i = 0; i < 24; ++i) Add(Image(i < 12 ? home : away, i));
  EXPECT_THAT(testing::RefusalOf([&] { (void)Track({}); }, ErrorKind::kJob),
              HasSubstr("start and end do not see the same scene"));
}

TEST_F(ImageTracks, AreRefusedOfACameraThatIsMissingOrHasAnotherSize) {
  Add(Image(Texture(7), 0));
  camera_.image_size[1] += 1;
  EXPECT_THAT(
      testing::RefusalOf([&] {
        (void)Track({":00", "00:"});
      }),
      HasSubstr("images of camera 'left' have 300 x 240 px, the calibration is for 300 x 241"));
  camera_.name = "right";
  EXPECT_THAT(testing::RefusalOf([&] {
                (void)Track({":00", "00:"});
              }),
              HasSubstr("has no camera 'right' of the calibration"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
