// SPDX-License-Identifier: Apache-2.0
//
// Detections in a session's images as its observations, what is said about them, and refusals.
#include <gmock/gmock.h>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "engine/observe/session_observations.h"
#include "engine/session/memory_session.h"
#include "models/registry.h"
#include "tests/engine/observe/earlier_detections.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using ::testing::StartsWith;

constexpr const char* kBoard = "chessboard:4x3:40mm";

// The board's twelve points, from marker `first` on.
std::vector<Observation> Points(double x, int first = 0) {
  std::vector<Observation> points;
  for (int k = first; k < 12; ++k) points.push_back(PointAt(k, x + 5 * (k % 4), 10 + 5 * (k / 4)));
  return points;
}

FoundInImage In(std::vector<Observation> points) {
  return {.size = {96, 64}, .points = std::move(points)};
}

FoundInImage NotFound(const std::string& why) { return {.size = {96, 64}, .why = why}; }

class DetectedObservations : public ::testing::Test {
 protected:
  DetectedObservations() {
    for (const char* const name : {"left", "right"}) {
      SessionCamera& camera = session_.cameras.emplace_back();
      camera.name = name;
      camera.model = FindModel(CameraModels(), "pinhole");
      camera.initial.resize(4);
      camera.fixed.resize(4);
    }
    run_.threads = 1;
    run_.listener = {
        .message = [this](const std::string& line) { messages_.push_back(line); },
        .progress =
            [this](const std::string& stage, size_t done, size_t total) {
              stages_.push_back(fmt::format("{} {}/{}", stage, done, total));
            },
        .detection =
            [this](const std::string& camera,
                   const std::string& frame,
                   size_t points,
                   const std::string& why) {
              detections_.push_back(fmt::format("{} {} {} {}", camera, frame, points, why));
            }};
  }

  SessionObservations Collect(OutputFolder* pictures = nullptr) {
    return CollectObservations(
        session_, TargetOfWord(kBoard), run_, {.cache = &earlier_.cache, .pictures = pictures});
  }

  std::string Refused() {
    return Refusal([&] { Collect(); });
  }

  EarlierDetections earlier_;
  Session session_;
  plenocal::Run run_;
  std::vector<std::string> messages_, stages_, detections_;
};

TEST_F(DetectedObservations, AreThoseOfEachCamerasImages) {
  FoundInImage partly = In(Points(20, 2));
  partly.left_out = {"marker 0: is hidden", "marker 1: is hidden"};
  partly.blur = 1.25;
  partly.orientation = 6;
  session_.cameras[0].given_images = earlier_.Images(
      "left", {{"a", In(Points(10))}, {"b", NotFound("shows no board")}, {"c", partly}});
  session_.cameras[1].given_images = earlier_.Images(
      "right", {{"a", In(Points(30))}, {"c", In(Points(40))}, {"d", In(Points(50))}});
  session_.cameras[0].given_images[2].time = 2.5;
  session_.exclude = {{.camera = "right", .frame = "d"},
                      {.camera = "right", .frame = "a", .markers = {3}},
                      {.camera = "left", .frame = "zz"}};
  const SessionObservations made = Collect();
  ASSERT_THAT(made.cameras, SizeIs(2));
  const CameraInput &left = made.cameras[0], &right = made.cameras[1];
  EXPECT_EQ(left.name, "left");
  EXPECT_EQ(left.image_size, (ImageSize{96, 64}));
  ASSERT_THAT(left.views, SizeIs(2));
  EXPECT_EQ(left.views[0].frame, "a");
  EXPECT_EQ(left.views[0].observations[11].values[0], 10 + 15);
  EXPECT_EQ(left.views[1].frame, "c");
  EXPECT_THAT(left.views[1].observations, SizeIs(10));
  EXPECT_EQ(left.times, (std::map<std::string, double>{{"c", 2.5}}));
  ASSERT_THAT(right.views, SizeIs(2));
  EXPECT_THAT(right.views[0].observations, SizeIs(11));
  EXPECT_THAT(right.views[1].observations, SizeIs(12));
  EXPECT_THAT(right.times, IsEmpty());
  EXPECT_FALSE(left.image_circle);

  ASSERT_THAT(made.left_out, SizeIs(5));
  struct Row {
    const char *where, *camera, *frame;
    bool whole = false;
  };
  const Row rows[] = {{"left/b", "left", "b", true},
                      {"left/c", "left", "c"},
                      {"left/c", "left", "c"},
                      {"right/d", "right", "d", true},
                      {"right/a", "right", "a"}};
  for (size_t k = 0; k < 5; ++k) {
    const LeftOut& item = made.left_out[k];
    EXPECT_THAT(item.where, StartsWith(rows[k].where)) << k;
    EXPECT_EQ(item.camera, rows[k].camera) << k;
    EXPECT_EQ(item.frame, rows[k].frame) << k;
    EXPECT_EQ(item.whole, rows[k].whole) << k;
  }
  EXPECT_EQ(made.left_out[0].reason, "shows no board");
  EXPECT_EQ(made.left_out[1].reason, "marker 0: is hidden");

  EXPECT_THAT(made.sample_frames, ElementsAre("a", "a"));
  ASSERT_THAT(made.traits, SizeIs(2));
  EXPECT_EQ(made.traits[0].at("c").blur, 1.25);
  EXPECT_THAT(made.blurs, ElementsAre(IsEmpty(), IsEmpty()));
  ASSERT_THAT(made.files, SizeIs(2));
  EXPECT_EQ(made.files[0].camera, 0U);
  EXPECT_EQ(made.files[0].key, "sample");
  EXPECT_EQ(made.files[0].name, "sample_left.jpg");
  EXPECT_THAT(made.files[0].content, StartsWith("\xFF\xD8"));
  EXPECT_EQ(made.files[1].camera, 1U);
  EXPECT_EQ(made.files[1].name, "sample_right.jpg");

  ASSERT_THAT(messages_, SizeIs(10));
  EXPECT_EQ(messages_[0], "left: 3 images, target found in 2, 22 points");
  EXPECT_EQ(messages_[1], "left: detections of 3 images reused");
  EXPECT_THAT(messages_[2],
              StartsWith("left: one image has an orientation tag (EXIF), by which viewers "));
  EXPECT_THAT(messages_[2],
              ::testing::EndsWith("sensor recorded them. Let other programs that use "
                                  "this calibration ignore the tag as well (OpenCV: "
                                  "IMREAD_IGNORE_ORIENTATION)."));
  EXPECT_EQ(messages_[3], "  left out left/b: shows no board");
  EXPECT_EQ(messages_[4], "  left out 2 times in 1 image, the first left/c: marker 0: is hidden");
  EXPECT_EQ(messages_[5], "right: 2 images, target found in 2, 23 points");
  EXPECT_EQ(messages_[6], "right: detections of 2 images reused");
  EXPECT_THAT(messages_[7], StartsWith("  left out right/d: "));
  EXPECT_THAT(messages_[8], StartsWith("  left out right/a"));
  EXPECT_THAT(messages_[9], StartsWith("exclude[2] (camera: left, frame: zz) leaves out nothing"));
  EXPECT_THAT(stages_,
              ElementsAre("left: images 1/3",
                          "left: images 2/3",
                          "left: images 3/3",
                          "right: images 1/2",
                          "right: images 2/2"));
  EXPECT_THAT(
      detections_,
      ElementsAre(
          "left a 12 ", "left b 0 shows no board", "left c 10 ", "right a 12 ", "right c 12 "));
}

TEST_F(DetectedObservations, ArePicturesOnDemand) {
  session_.cameras.pop_back();
  session_.cameras[0].given_images = earlier_.Images("left", {{"a", In(Points(10))}});
  const testing::TemporaryFolder folder;
  {
    OutputFolder out(folder.Path());
    Collect(&out);
    out.Commit();
  }
  EXPECT_TRUE(exists(folder / "images/left/a.png"));
}

TEST_F(DetectedObservations, StandBesideThoseOfMemoryAndAChoiceOfFrames) {
  std::vector<std::pair<std::string, FoundInImage>> found;
  for (int k = 0; k < 4; ++k) {
    std::vector<Observation> points = Points(10 + k);
    for (Observation& point : points) point.marker += 1000;  // no calibration
    found.emplace_back(std::to_string(k), In(points));
  }
  session_.cameras[0].given_images = earlier_.Images("left", found);
  session_.cameras[1].given_views = {{"7", Points(1)}};
  session_.frames = 3;
  const SessionObservations made = Collect();
  EXPECT_THAT(made.cameras[0].views, SizeIs(3));
  EXPECT_THAT(made.cameras[1].views, SizeIs(1));
  EXPECT_THAT(made.sample_frames, ElementsAre("0", ""));
  ASSERT_THAT(made.files, SizeIs(2));
  EXPECT_EQ(made.files[1].camera, 0U);
  EXPECT_EQ(made.files[1].key, "frames");
  EXPECT_EQ(made.files[1].name, "chosen_frames.csv");
  EXPECT_THAT(made.files[1].content, StartsWith("frame,chosen,"));
  ASSERT_THAT(made.left_out, SizeIs(1));
  EXPECT_EQ(made.left_out[0].reason, "looks like frames that are chosen");
  EXPECT_EQ(messages_.back(), "right: 1 frame, 12 points from memory");
}

TEST_F(DetectedObservations, NeedAnImageWithTheTarget) {
  session_.cameras.pop_back();
  SessionCamera& camera = session_.cameras[0];
  camera.given_images =
      earlier_.Images("left", {{"a", NotFound("is black")}, {"b", NotFound("is white")}});
  EXPECT_EQ(Refused(),
            "job: left: none of its 2 images shows the target; the first: left/a: is black");
  EXPECT_EQ(messages_[0], "left: 2 images, target found in 0, 0 points");
  session_.exclude = {{.frame = "a"}, {.frame = "b"}};
  EXPECT_EQ(Refused(),
            "input: left: the session's 'exclude' leaves out all images; take back a rule");
  session_.exclude.clear();
  camera.given_images = earlier_.Images("left", {{"a", In(Points(1))}});
  camera.image_size = {96, 65};
  EXPECT_THAT(Refused(), StartsWith("input: "));
  camera.image_size = {96, 64};
  EXPECT_EQ(Refused(), "");
  camera.given_images = earlier_.Images("bad", {{"a", {}}, {"b", {}}}, {0, 1});
  EXPECT_EQ(Refused(), "job: left: no image can be read; the first: is damaged");
  camera.given_images = earlier_.Images("left", {{"a", In(Points(1))}});
  std::stop_source stop;
  stop.request_stop();
  run_.stop = stop.get_token();
  EXPECT_THROW(Collect(), Stopped);
}

// A chessboard seen from the front, its first square at (x, 20).
void Draw(int columns, int rows, int x, cv::Mat* image) {
  constexpr int kSide = 14;
  for (int row = 0; row <= rows; ++row) {
    for (int column = 0; column <= columns; ++column) {
      if ((row + column) % 2 == 1) continue;
      cv::rectangle(
          *image, {x + column * kSide, 20 + row * kSide, kSide, kSide}, cv::Scalar(25), cv::FILLED);
    }
  }
  cv::GaussianBlur(*image, *image, {}, 0.6);
}

TEST_F(DetectedObservations, OfSeveralTargetsAreThoseOfAll) {
  SessionTargets targets;
  for (const char* const word : {"chessboard:5x4:30mm", "chessboard:4x3:30mm"}) {
    targets.several.push_back(TargetOfWord(word));
  }
  std::vector<cv::Mat> drawn;
  for (int k = 0; k < 4; ++k) {
    cv::Mat& image = drawn.emplace_back(120, 240, CV_8U, cv::Scalar(200));
    if (k == 0 || k == 3) Draw(5, 4, 20, &image);
    if (k == 1 || k == 3) Draw(4, 3, 140, &image);
  }
  MemoryImages images;
  for (size_t k = 0; k < drawn.size(); ++k) {
    images.emplace_back(std::to_string(k),
                        PixelView{.data = drawn[k].data, .size = {240, 120}, .stride = 240});
  }
  session_.cameras.pop_back();
  session_.cameras[0].given_images = ImagesInMemory("left", images);
  session_.frames = 1;  // no frames are chosen
  for (const bool again : {false, true}) {
    messages_.clear();
    const SessionObservations made =
        CollectObservations(session_, targets, run_, {.cache = &earlier_.cache});
    ASSERT_THAT(made.cameras[0].views, SizeIs(3)) << again;
    const size_t counts[] = {20, 12, 32};
    const int first[] = {0, 100'000, 0};
    for (size_t k = 0; k < 3; ++k) {
      EXPECT_EQ(made.cameras[0].views[k].frame, std::to_string(k == 2 ? 3 : k));
      EXPECT_THAT(made.cameras[0].views[k].observations, SizeIs(counts[k]));
      EXPECT_EQ(made.cameras[0].views[k].observations[0].marker, first[k]);
    }
    ASSERT_THAT(made.left_out, SizeIs(1));
    EXPECT_THAT(made.left_out[0].where, ::testing::HasSubstr("2"));
    EXPECT_EQ(made.left_out[0].frame, "2");
    EXPECT_TRUE(made.left_out[0].whole);
    // Not kept for later runs.
    ASSERT_THAT(messages_, SizeIs(2));
    EXPECT_EQ(messages_[0], "left: 4 images, target found in 3, 64 points");
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
