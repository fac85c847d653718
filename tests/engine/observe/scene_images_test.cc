// SPDX-License-Identifier: Apache-2.0
//
// Points followed through the images of a session without a target, its tags, and refusals.
#include "engine/observe/scene_images.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <map>
#include <set>

#include "calib/files/scene_keys.h"
#include "engine/session/memory_session.h"
#include "models/registry.h"
#include "targets/tags/tag_family.h"
#include "tests/engine/scene/texture.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using ::testing::StartsWith;

class SceneImages : public ::testing::Test {
 protected:
  SceneImages() {
    session_.path = "s.yaml";
    session_.scene.emplace();
    session_.scene->points = 60;
    run_.threads = 1;
    run_.listener = {.message = [this](const std::string& line) { messages_.push_back(line); },
                     .progress =
                         [this](const std::string& stage, size_t done, size_t total) {
                           stages_.push_back(fmt::format("{} {}/{}", stage, done, total));
                         }};
  }

  SessionCamera& Add(const std::string& name, const char* model = "pinhole") {
    SessionCamera& camera = session_.cameras.emplace_back();
    camera.name = name;
    camera.model = FindModel(CameraModels(), model);
    camera.initial.resize(camera.model->params.size());
    camera.fixed.resize(camera.initial.size());
    return camera;
  }

  // Images of frames; the pixels stay here.
  void Give(const std::vector<std::pair<std::string, cv::Mat>>& images, SessionCamera* camera) {
    MemoryImages given;
    for (const auto& [frame, image] : images) {
      kept_.push_back(image);
      given.emplace_back(frame,
                         PixelView{.data = image.data,
                                   .size = {image.cols, image.rows},
                                   .stride = image.step,
                                   .channels = image.channels()});
    }
    camera->given_images = ImagesInMemory(camera->name, given);
  }

  SceneObservations Follow() { return FollowSceneImages(session_, run_); }
  std::string Refused() {
    return Refusal([&] { Follow(); });
  }

  Session session_;
  plenocal::Run run_;
  std::vector<std::string> messages_, stages_;
  std::vector<cv::Mat> kept_;
};

cv::Mat Window(int at) {
  static const cv::Mat texture = Texture(7, 600, 120, 2);
  return texture(cv::Rect(at, 0, 240, 120)).clone();
}

TEST_F(SceneImages, GiveTracksOfAllCameras) {
  // Frame 10 follows frame 9; one is of another size, one excluded.
  Give({{"10", Window(104)},
        {"8", Window(100)},
        {"9", Window(102)},
        {"11", cv::Mat(60, 240, CV_8U, cv::Scalar(0))},
        {"12", Window(99)}},
       &Add("left"));
  SessionCamera& right = Add("right");
  cv::Mat colour;
  cv::cvtColor(Window(128), colour, cv::COLOR_GRAY2BGR);
  Give({{"9", Window(126)}, {"10", colour}, {"8", Window(124)}}, &right);
  session_.exclude = {{.camera = "left", .frame = "12"}, {.frame = "none"}};
  const SceneObservations made = Follow();
  EXPECT_THAT(made.alike, IsEmpty());
  const SessionObservations& found = made.session;
  ASSERT_THAT(found.cameras, SizeIs(2));
  EXPECT_EQ(found.cameras[0].name, "left");
  EXPECT_EQ(found.cameras[1].name, "right");
  EXPECT_EQ(found.cameras[1].image_size, (ImageSize{240, 120}));
  EXPECT_THAT(found.sample_frames, ElementsAre("", ""));
  EXPECT_THAT(found.traits, SizeIs(2));
  EXPECT_THAT(found.blurs, SizeIs(2));
  EXPECT_THAT(found.files, IsEmpty());
  const std::map<std::string, int> shifts{{"8", 100}, {"9", 102}, {"10", 104}};
  std::map<int, double> columns;
  size_t observations[2] = {};
  for (size_t c = 0; c < 2; ++c) {
    std::vector<std::string> frames;
    for (const View& view : found.cameras[c].views) {
      frames.push_back(view.frame);
      for (const Observation& seen : view.observations) {
        const double column =
            seen.values[0] + shifts.at(view.frame) + 24.0 * static_cast<double>(c);
        EXPECT_NEAR(columns.emplace(seen.marker, column).first->second, column, 0.2);
        ++observations[c];
      }
    }
    EXPECT_THAT(frames, ElementsAre("8", "9", "10"));
  }
  EXPECT_GT(columns.size(), 30U);
  EXPECT_GT(observations[1], 40U);  // by descriptors
  ASSERT_THAT(found.left_out, SizeIs(2));
  EXPECT_EQ(found.left_out[0].frame, "12");
  EXPECT_EQ(found.left_out[1].where, "left 11");
  EXPECT_EQ(found.left_out[1].reason,
            "is 240 x 60 pixels, while the camera's images are 240 x 120");
  ASSERT_THAT(messages_, SizeIs(5));
  EXPECT_EQ(messages_[0],
            fmt::format("left: 4 images, points followed in 3, {} observations", observations[0]));
  EXPECT_EQ(messages_[1],
            fmt::format("right: 3 images, points followed in 3, {} observations", observations[1]));
  EXPECT_THAT(messages_[2], StartsWith("  left out "));
  EXPECT_EQ(messages_[3],
            "  left out left 11: is 240 x 60 pixels, while the camera's images are 240 x 120");
  EXPECT_THAT(messages_[4], StartsWith("exclude[1] (frame: none) leaves out nothing"));
  EXPECT_THAT(stages_,
              ElementsAre("follow points: images 0/4",
                          "follow points: images 1/4",
                          "follow points: images 2/4",
                          "follow points: images 3/4"));
}

TEST_F(SceneImages, LosePointsThatAreExcluded) {
  Give({{"1", Window(100)}, {"2", Window(102)}}, &Add("left"));
  const SceneObservations all = Follow();
  ASSERT_THAT(all.session.cameras[0].views, SizeIs(2));
  const int number = all.session.cameras[0].views[0].observations[3].marker;
  session_.exclude = {{.camera = "left", .frame = "2", .markers = {number}}};
  const SceneObservations made = Follow();
  const auto shows = [&](const View& view) {
    return std::ranges::count(view.observations, number, &Observation::marker);
  };
  EXPECT_EQ(shows(made.session.cameras[0].views[0]), 1);
  EXPECT_EQ(shows(made.session.cameras[0].views[1]), 0);
  EXPECT_THAT(made.session.left_out, SizeIs(1));
}

// Tags 5 and 11 on a plain wall.
cv::Mat Tags(const std::vector<std::pair<int, int>>& id_at) {
  constexpr int kBit = 8;  // px
  const internal::TagFamily family("tag36h11", 1);
  cv::Mat image(120, 240, CV_8U, cv::Scalar(220));
  for (const auto& [id, x] : id_at) {
    const std::vector<bool> bits = family.Bits(id);
    const int side = family.width_at_border();
    for (int k = 0; k < side * side; ++k) {
      image(cv::Rect(x + kBit * (k % side), 30 + kBit * (k / side), kBit, kBit))
          .setTo(bits[static_cast<size_t>(k)] ? 220 : 25);
    }
  }
  return image;
}

TEST_F(SceneImages, ShowTheCornersOfTags) {
  Give({{"1", Tags({{5, 20}, {11, 140}})}, {"3", Tags({})}}, &Add("left"));
  Give({{"2", Tags({{11, 100}})}}, &Add("right"));
  session_.scene->tags = SceneTags{
      .ids = {5, 11, 12},
      .node = YamlNode::Parse("ids: [5, 11, 12]\nfamily: tag36h11\nsize: 0.1\n", "s.yaml")};
  const SceneObservations made = Follow();
  EXPECT_EQ(messages_[0], "2 of 3 tags found");
  std::vector<std::string> expected_stages;
  for (int image = 0; image < 3; ++image) {
    expected_stages.push_back(fmt::format("follow points: images {}/3", image));
  }
  for (const int id : {5, 11, 12}) {
    for (const char* const done : {"1/2", "2/2", "1/1"}) {
      expected_stages.push_back(fmt::format("find tag {}: images {}", id, done));
    }
  }
  EXPECT_EQ(stages_, expected_stages);
  // One image has tracks of nothing else.
  const std::vector<CameraInput>& cameras = made.session.cameras;
  ASSERT_THAT(cameras[0].views, SizeIs(1));
  ASSERT_THAT(cameras[1].views, SizeIs(1));
  EXPECT_EQ(cameras[0].views[0].frame, "1");
  EXPECT_EQ(cameras[1].views[0].frame, "2");
  std::map<int, double> columns;
  for (const Observation& seen : cameras[0].views[0].observations) {
    columns[seen.marker] = seen.values[0];
  }
  ASSERT_THAT(columns, SizeIs(8));
  std::set<int> expected;
  for (const int id : {5, 11}) {
    for (int corner = 0; corner < 4; ++corner) expected.insert(TagPoint(id, corner));
  }
  for (const auto& [number, column] : columns) EXPECT_TRUE(expected.contains(number));
  for (int corner = 0; corner < 4; ++corner) {
    EXPECT_NEAR(columns[TagPoint(11, corner)] - columns[TagPoint(5, corner)], 120, 0.5);
  }
  ASSERT_THAT(cameras[1].views[0].observations, SizeIs(4));
  EXPECT_NEAR(cameras[1].views[0].observations[2].values[0],
              columns[cameras[1].views[0].observations[2].marker] - 40,
              0.5);
}

TEST_F(SceneImages, AddTagsToTheTracksOfTheirFrame) {
  cv::Mat first = Window(100), second = Window(102);
  for (cv::Mat* image : {&first, &second}) {
    Tags({{5, 20}})(cv::Rect(10, 20, 84, 84)).copyTo((*image)(cv::Rect(10, 20, 84, 84)));
  }
  Give({{"1", first}, {"2", second}}, &Add("left"));
  session_.scene->tags =
      SceneTags{.ids = {5}, .node = YamlNode::Parse("ids: [5]\nfamily: tag36h11\n", "s.yaml")};
  const SceneObservations made = Follow();
  EXPECT_EQ(messages_[0], "1 of 1 tag found");
  const std::vector<View>& views = made.session.cameras[0].views;
  ASSERT_THAT(views, SizeIs(2));
  for (const View& view : views) {
    EXPECT_GT(view.observations.size(), 14U);
    EXPECT_EQ(std::ranges::count_if(
                  view.observations,
                  [](const Observation& seen) { return seen.marker >= TagPoint(5, 0); }),
              4);
  }
}

TEST_F(SceneImages, AreRefusedWithoutAUsableOne) {
  SessionCamera& left = Add("left");
  Give({{"1", Window(100)}, {"2", Window(102)}}, &left);
  session_.exclude = {{.frame = "1"}, {.frame = "2"}};
  EXPECT_EQ(Refused(),
            "input: left: the session's 'exclude' leaves out all images; take back a rule");
  session_.exclude.clear();
  left.image_size = {240, 121};
  EXPECT_THAT(Refused(), HasSubstr("240 x 121"));
  left.image_size = {};
  const TemporaryFolder folder;
  left.given_images.clear();
  for (const char* const name : {"1.png", "2.png"}) {
    left.given_images.push_back({.frame = name, .path = folder.Write(name, "no image")});
  }
  EXPECT_THAT(Refused(), StartsWith("input: left: " + (folder / "1.png").string()));
  // The second can be read.
  const FrameImage bad = left.given_images[0];
  Give({{"2", Window(102)}, {"3", Window(104)}}, &left);
  left.given_images.insert(left.given_images.begin(), bad);
  const SceneObservations made = Follow();
  EXPECT_EQ(made.session.cameras[0].image_size, (ImageSize{240, 120}));
  EXPECT_THAT(made.session.cameras[0].views, SizeIs(2));
  EXPECT_THAT(made.session.left_out, SizeIs(1));
  std::stop_source stop;
  stop.request_stop();
  run_.stop = stop.get_token();
  EXPECT_THROW(Follow(), Stopped);
}

TEST_F(SceneImages, OfPlenopticCamerasNeedWhiteOnes) {
  Give({{"1", Window(100)}}, &Add("raw", "focused-plenoptic"));
  EXPECT_EQ(Refused(),
            "input: s.yaml: cameras.raw: a plenoptic camera needs white_images: the micro-image "
            "centres come from them");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
