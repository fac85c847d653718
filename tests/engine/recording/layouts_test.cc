// SPDX-License-Identifier: Apache-2.0
//
// The parts of recordings by their layouts, and cameras by the topics of messages.
#include "engine/recording/layouts.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "engine/recording/recorded_topics.h"
#include "engine/recording/stores/message_log.h"
#include "tests/engine/recording/message_bytes.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

class Layouts : public InTemporaryFolder {
 protected:
  void Make(const std::vector<std::string>& files) const {
    for (const std::string& file : files) Write(file, "");
  }
  [[nodiscard]] std::string Relative(const std::filesystem::path& path) const {
    return path.empty() ? "-" : path.lexically_relative(folder_).string();
  }
  /// The layout, then "name: images times" of each camera.
  [[nodiscard]] std::vector<std::string> Shown(const std::string& name) const {
    const RecordingFile file = FindRecordingFile(Path(name));
    std::vector<std::string> shown{file.layout};
    for (const RecordedFiles& camera : file.cameras) {
      EXPECT_EQ(camera.where, camera.images[0]);
      shown.push_back(camera.name + ": " + Relative(camera.images[0]) + " " +
                      Relative(camera.times));
    }
    return shown;
  }
  /// "path format" of the calibrations of other programs.
  [[nodiscard]] std::vector<std::string> Foreign(const std::string& name) const {
    std::vector<std::string> shown;
    for (const ForeignCalibration& each : FindRecordingFile(Path(name)).foreign) {
      shown.push_back(Relative(each.path) + " " + each.format);
    }
    return shown;
  }
};

TEST_F(Layouts, OfEurocHaveFoldersWithTables) {
  Make({"e/mav0/cam0/data/1.png",
        "e/mav0/cam0/data.csv",
        "e/mav0/cam0/sensor.yaml",
        "e/mav0/cam1/data.zip",
        "e/mav0/cam1/data.csv",
        "e/mav0/cam2/data/1.png",
        "e/mav0/imu0/data/1.png",
        "e/mav0/imu0/data.csv",
        "e/calibration.yaml"});
  EXPECT_THAT(Shown("e"),
              ElementsAre("EuRoC",
                          "cam0: e/mav0/cam0/data e/mav0/cam0/data.csv",
                          "cam1: e/mav0/cam1/data.zip e/mav0/cam1/data.csv"));
  EXPECT_THAT(Foreign("e"), ElementsAre("e/mav0/cam0/sensor.yaml "));
  EXPECT_EQ(Relative(FindRecordingFile(Path("e")).calibration), "e/calibration.yaml");
  EXPECT_EQ(Shown("e/mav0").size(), 3U);
  EXPECT_EQ(FindRecordingFile(Path("e/mav0")).calibration, "");
}

TEST_F(Layouts, OfKittiHaveNumberedFolders) {
  Make({"k/image_0/1.png",
        "k/image_1.zip",
        "k/image_3/1.png",
        "k/image_4/1.png",
        "k/times.txt",
        "k/calib.txt"});
  EXPECT_THAT(Shown("k"),
              ElementsAre("KITTI",
                          "image_0: k/image_0 k/times.txt",
                          "image_1: k/image_1.zip k/times.txt",
                          "image_3: k/image_3 k/times.txt"));
  EXPECT_THAT(Foreign("k"), ElementsAre("k/calib.txt "));
}

TEST_F(Layouts, OfTumHaveImagesAndTimes) {
  Make({"t/images/1.png", "t/times.txt"});
  EXPECT_THAT(Shown("t"), ElementsAre("TUM monoVO", "cam: t/images t/times.txt"));
  RecordingFile file = FindRecordingFile(Path("t"));
  EXPECT_EQ(file.cameras[0].response, "");
  EXPECT_EQ(file.cameras[0].vignetting, "");
  EXPECT_THAT(file.foreign, IsEmpty());
  Make({"t/pcalib.txt", "t/vignette.png", "t/camera.txt"});
  file = FindRecordingFile(Path("t"));
  EXPECT_EQ(Relative(file.cameras[0].response), "t/pcalib.txt");
  EXPECT_EQ(Relative(file.cameras[0].vignetting), "t/vignette.png");
  EXPECT_THAT(Foreign("t"), ElementsAre("t/camera.txt dso"));
  Make({"z/images.zip", "z/times.txt"});
  EXPECT_THAT(Shown("z"), ElementsAre("TUM monoVO", "cam: z/images.zip z/times.txt"));
}

TEST_F(Layouts, OfFoldersHaveTimesInsideOrBeside) {
  Make({"f/left/1.png", "f/right/1.png", "f/top/1.png", "f/left/times.txt", "f/times_right.txt"});
  EXPECT_THAT(Shown("f"),
              ElementsAre("folders",
                          "left: f/left f/left/times.txt",
                          "right: f/right f/times_right.txt",
                          "top: f/top -"));
  Make({"f/times.txt", "f/top_white/1.png", "f/calibration.yaml"});
  EXPECT_THAT(Shown("f"),
              ElementsAre("folders",
                          "left: f/left f/left/times.txt",
                          "right: f/right f/times_right.txt",
                          "top: f/top f/times.txt"));
  const RecordingFile file = FindRecordingFile(Path("f"));
  ASSERT_EQ(file.cameras[2].white_images.size(), 1U);
  EXPECT_EQ(Relative(file.calibration), "f/calibration.yaml");
}

TEST_F(Layouts, OfArchivesAndVideosHaveACameraOfEach) {
  Make({"a/left.zip", "a/right.mp4", "a/notes.txt", "a/times_left.txt"});
  EXPECT_THAT(Shown("a"),
              ElementsAre("folders", "left: a/left.zip a/times_left.txt", "right: a/right.mp4 -"));
  EXPECT_THAT(Shown("a/right.mp4"), ElementsAre("video", "right: a/right.mp4 -"));
  Make({"n/notes.txt"});
  EXPECT_NE(RefusalOf([&] { FindRecordingFile(Path("n")); }), "no refusal");
  EXPECT_EQ(RefusalOf([&] { FindRecordingFile(Path("none")); }),
            Path("none").string() + ": no such file or folder; check the path");
}

TEST_F(Layouts, OfRecordingYamlGoFirst) {
  Make({"y/images/1.png", "y/times.txt"});
  Write("y/recording.yaml", "plenocal: 1\ncameras: {own: {images: images}}\n");
  EXPECT_EQ(FindRecordingFile(Path("y")).layout, "recording.yaml");
  EXPECT_EQ(FindRecordingFile(Path("y/recording.yaml")).cameras[0].name, "own");
}

// ---- messages

class Topics : public InTemporaryFolder {
 protected:
  using Form = MessageWriter::Form;
  struct Topic {
    std::string name;
    std::string type = "sensor_msgs/Image";
    std::vector<std::string> messages = {ImageMessage(Form::kRos1, 1, 0, 'a')};
  };
  static std::string BagOf(const std::vector<Topic>& topics) {
    std::string bag(kBagStart);
    int connection = 0;
    for (const Topic& topic : topics) {
      bag += BagConnection(++connection, topic.name, topic.type);
      std::uint32_t logged = 100;
      for (const std::string& message : topic.messages) {
        bag += BagMessage(connection, logged, 0, message);
        logged += 2;
      }
    }
    return bag;
  }
  static std::string Encoded(const std::string& encoding) {
    return MessageWriter(Form::kRos1)
        .Header(1, 0)
        .Number(std::uint32_t{2})
        .Number(std::uint32_t{2})
        .Text(encoding)
        .Number(std::uint8_t{0})
        .Number(std::uint32_t{2})
        .Bytes("abcd")
        .Done();
  }
  static std::string Compressed(const std::string& bytes) {
    return MessageWriter(Form::kRos1).Header(1, 0).Text("jpeg").Bytes(bytes).Done();
  }
  [[nodiscard]] std::shared_ptr<const MessageLog> Log(const std::vector<Topic>& topics) const {
    return std::make_shared<const MessageLog>(Write("a.bag", BagOf(topics)));
  }
  [[nodiscard]] std::vector<std::string> Names(const std::vector<std::string>& topics) const {
    std::vector<Topic> all;
    for (const std::string& topic : topics) all.push_back({topic});
    std::vector<std::string> names;
    for (const RecordedFiles& camera : FindInMessages(Write("a.bag", BagOf(all))).cameras) {
      names.push_back(camera.name);
    }
    return names;
  }
  static constexpr const char* kBagStart = "#ROSBAG V2.0\n";
};

TEST_F(Topics, NameTheirCameras) {
  EXPECT_THAT(Names({"/left/image_raw", "/right/image_raw/compressed"}),
              ElementsAre("left", "right"));
  EXPECT_THAT(Names({"/rig/left/image_color"}), ElementsAre("left"));
  EXPECT_THAT(Names({"/image_raw"}), ElementsAre("cam"));
  EXPECT_THAT(Names({"/a/cam.0/image_mono", "/b/image_rect_color/raw/theora", "c/image"}),
              ElementsAre("cam_0", "b", "c"));
  // A second one of a name has that of the whole topic, then numbers.
  EXPECT_THAT(Names({"/a/cam/image", "/b/cam/image", "/b/cam:image"}),
              ElementsAre("cam", "b_cam_image", "cam_image"));
  EXPECT_THAT(Names({"/a/image", "/a/image/raw", "/a/image_raw"}),
              ElementsAre("a", "a_image_raw", "a_image_raw_2"));
}

TEST_F(Topics, GiveTheImagesAndTheirMosaic) {
  const RecordingFile file =
      FindInMessages(Write("a.bag",
                           BagOf({{"/l/image", "sensor_msgs/Image", {Encoded("bayer_grbg8")}},
                                  {"r/image", "sensor_msgs/Image", {Encoded("mono8")}},
                                  {"/x/image", "sensor_msgs/Image", {Encoded("bayer_xxxx8")}},
                                  {"/z/image", "sensor_msgs/Image", {"cut"}},
                                  {"/imu", "sensor_msgs/Imu", {"1", "2"}}})));
  EXPECT_EQ(file.layout, "ROS 1 bag");
  ASSERT_EQ(file.cameras.size(), 3U);
  EXPECT_EQ(file.cameras[0].bayer, BayerOrder::kGrbg);
  EXPECT_THAT(file.cameras[0].images, ElementsAre(Path("a.bag/l/image").string()));
  EXPECT_EQ(file.cameras[0].where, file.cameras[0].images[0]);
  for (const RecordedFiles& camera : file.cameras)
    EXPECT_EQ(camera.bayer.has_value(), camera.name == "l");
  ASSERT_EQ(file.topics.size(), 4U);
  EXPECT_EQ(file.topics[0].camera, "l");
  EXPECT_EQ(file.other_topics.size(), 1U);
  EXPECT_EQ(file.other_topics[0].count, 2U);
}

TEST_F(Topics, WithoutImagesAreRefusedWithAll) {
  const auto refusal = [&](const std::vector<Topic>& topics) {
    return RefusalOf([&] { FindInMessages(Write("a.bag", BagOf(topics))); });
  };
  const std::string file = Path("a.bag").string();
  const std::string none = file +
                           ": has no topic with images, which sensor_msgs/Image or "
                           "sensor_msgs/CompressedImage of ROS 1 or ROS 2 are; its topics: ";
  EXPECT_EQ(refusal({{"/imu", "sensor_msgs/Imu", {"1", "2"}}, {"/odo", "nav/Odometry", {}}}),
            none + "/imu (sensor_msgs/Imu, 2 messages), /odo (nav/Odometry, 0 messages)");
  EXPECT_EQ(refusal({}), none + "none");
  EXPECT_EQ(refusal({{"/l/image", "sensor_msgs/Image", {"cut"}}}),
            file + "/l/image: the message is cut off; exclude it, or record again");
}

TEST_F(Topics, HaveEncodingRateAndIntrinsics) {
  const std::vector<ImageTopic> topics =
      Log({{"/a/b/image", "sensor_msgs/Image", std::vector<std::string>(3, Encoded("mono8"))},
           {"/a/camera_info", "sensor_msgs/CameraInfo", {"x"}},
           {"/j/image/compressed", "sensor_msgs/CompressedImage", {Compressed("\xff\xd8...")}},
           {"/j/image/camera_info", "sensor_msgs/CameraInfo", {}},
           {"/k/image", "sensor_msgs/CompressedImage", {Compressed("BM")}},
           {"/p/image", "sensor_msgs/CompressedImage", {Compressed("\x89PNG....")}},
           {"/q/image", "sensor_msgs/Image", {}}})
          ->ImageTopics();
  std::vector<std::string> shown;
  for (const ImageTopic& topic : topics) {
    shown.push_back(fmt::format("{} {} {} {} {} [{}]",
                                topic.name,
                                topic.count,
                                topic.encoding,
                                topic.size[0],
                                topic.rate,
                                topic.camera_info));
  }
  EXPECT_THAT(shown,
              ElementsAre("/a/b/image 3 mono8 2 0.5 [/a/camera_info]",
                          "/j/image/compressed 1 jpeg 0 0 []",
                          "/k/image 1 image file 0 0 []",
                          "/p/image 1 png 0 0 []"));
}

TEST_F(Topics, AreChosenByNameOrAsTheOnlyOne) {
  std::vector<std::string> notes;
  const auto refusal = [&](const std::vector<Topic>& topics, const std::string& topic) {
    return RefusalOf([&] { static_cast<void>(Log(topics)->Images(topic, &notes)); });
  };
  const Topic left{"/left/image"}, right{"/right/image"}, imu{"/imu", "sensor_msgs/Imu", {"1"}};
  EXPECT_EQ(refusal({left, imu}, ""), "no refusal");
  EXPECT_EQ(refusal({left, right}, "right/image"), "no refusal");
  EXPECT_EQ(refusal({left, right}, "/right/image"), "no refusal");
  const std::string file = Path("a.bag").string();
  const std::string end =
      "; name one of them, such as '" + file + "/left/image': /left/image, /right/image";
  EXPECT_EQ(refusal({left, right}, ""), file + ": has several topics with images" + end);
  EXPECT_EQ(refusal({left, right}, "up"), file + ": has no topic 'up'" + end);
  EXPECT_EQ(refusal({left, right, imu}, "imu"),
            file + ": topic '/imu' has no images but sensor_msgs/Imu" + end);
  EXPECT_EQ(refusal({left, right, {"/up", "sensor_msgs/Image", {}}}, "up"),
            file + ": topic '/up' has no message" + end);
  EXPECT_EQ(refusal({imu}, "imu"),
            file +
                ": has no topic with images (sensor_msgs/Image or CompressedImage of ROS 1 or ROS "
                "2); 'plenocal recording " +
                file + "' lists its topics");
}

TEST_F(Topics, GiveImagesByTime) {
  const auto image = [](std::uint32_t seconds, char grey) {
    return ImageMessage(Form::kRos1, seconds, 5, grey);
  };
  std::vector<std::string> notes;
  const auto log = Log({{"/l/image",
                         "sensor_msgs/Image",
                         {image(3, 'a'), image(1, 'b'), image(2, 'c'), image(2, 'd')}}});
  const std::vector<FrameImage> images = log->Images("", &notes);
  ASSERT_EQ(images.size(), 3U);
  EXPECT_EQ(images[0].frame, "0000000001000000005");
  EXPECT_EQ(images[0].path, Path("a.bag/l/image/0000000001000000005"));
  EXPECT_NEAR(*images[0].time, 1.000000005, 1e-12);
  std::string greys;
  for (const FrameImage& each : images) {
    greys += static_cast<char>(each.store->Read(each.index).bytes[0]);
    EXPECT_EQ(each.store->Start(each.index, 60).size, (ImageSize{3, 2}));
    EXPECT_FALSE(each.store->Hash(each.index).empty());
  }
  EXPECT_EQ(greys, "bca");
  const std::string place = Path("a.bag/l/image").string();
  EXPECT_THAT(
      notes,
      ElementsAre(place +
                      ": its times jump backwards 1 times; images are taken in the order of their "
                      "times. Was the clock set while recording?",
                  place + ": 1 images have the time of another one and are left out"));
  notes.clear();
  const auto unstamped =
      Log({{"/l/image",
            "sensor_msgs/Image",
            {ImageMessage(Form::kRos1, 0, 0, 'a'), ImageMessage(Form::kRos1, 0, 0, 'b')}}});
  const std::vector<FrameImage> logged = unstamped->Images("", &notes);
  ASSERT_EQ(logged.size(), 2U);
  EXPECT_EQ(*logged[1].time, 102);
  EXPECT_THAT(
      notes,
      ElementsAre(place + ": the headers have no times; those of the log are taken, which are "
                          "later by the transport of the images"));
}

TEST_F(Topics, OfAFolderAreThoseOfItsFiles) {
  Write("day/metadata.yaml", "");
  EXPECT_FALSE(IsMessageFolder(Path("day")));
  Write("day/x_0.db3.zstd", "");
  EXPECT_TRUE(IsMessageFolder(Path("day")));
  EXPECT_EQ(RefusalOf([&] { MessageLog log(Path("day")); }),
            Path("day").string() + ": its files are packed as a whole; unpack them by 'zstd -d " +
                Path("day/*.zstd").string() + "'");
  Write("day/x_10.bag", BagOf({{"/l/image"}, {"/imu", "sensor_msgs/Imu", {"1"}}}) + "cut");
  EXPECT_TRUE(IsMessageFolder(Path("day")));
  EXPECT_FALSE(IsMessageFolder(Path("day/x_10.bag")));
  Write("day/x_9.bag",
        BagOf({{"/l/image", "sensor_msgs/Image", {ImageMessage(Form::kRos1, 7, 0, 'b')}},
               {"/imu", "sensor_msgs/Imu", {"1", "2"}}}));
  Write("day/x_11.bag", "no bag");
  const auto log = std::make_shared<const MessageLog>(Path("day"));
  EXPECT_EQ(log->ImageTopics()[0].count, 2U);
  EXPECT_EQ(log->OtherTopics()[0].count, 3U);
  ASSERT_EQ(log->Damage().size(), 2U);
  EXPECT_THAT(log->Damage()[0],
              StartsWith(Path("day/x_10.bag").string() + ": is cut off or damaged at byte"));
  EXPECT_THAT(log->Damage()[1], StartsWith(Path("day/x_11.bag").string() + ": is no MCAP file"));
  EXPECT_EQ(log->DamageText(), ". Damage: " + log->Damage()[0]);
  EXPECT_EQ(FindInMessages(Path("day")).layout, "ROS 2 bag");
  std::vector<std::string> notes;
  EXPECT_EQ(log->Images("l/image", &notes)[1].frame, "0000000007000000000");
  std::filesystem::remove(Path("day/metadata.yaml"));
  EXPECT_FALSE(IsMessageFolder(Path("day")));
  EXPECT_THAT(RefusalOf([&] { MessageLog one(Path("day/x_11.bag")); }),
              HasSubstr("is no MCAP file"));
}

TEST_F(Topics, HaveIntrinsicsInTheFirstMessage) {
  MessageWriter writer(Form::kRos1);
  writer.Header(1, 0)
      .Number(std::uint32_t{480})
      .Number(std::uint32_t{640})
      .Text("plumb_bob")
      .Number(std::uint32_t{0});
  for (int i = 0; i < 30; ++i) writer.Double(i);
  const auto log = Log({{"/l/camera_info", "sensor_msgs/CameraInfo", {writer.Done(), "cut"}},
                        {"/m/camera_info", "sensor_msgs/CameraInfo", {"cut"}}});
  EXPECT_EQ(log->ReadInfo("/l/camera_info")->size, (ImageSize{640, 480}));
  EXPECT_FALSE(log->ReadInfo("/none"));
  EXPECT_THAT(RefusalOf([&] { static_cast<void>(log->ReadInfo("/m/camera_info")); }),
              StartsWith(Path("a.bag/m/camera_info").string() + ": the message is cut off"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
