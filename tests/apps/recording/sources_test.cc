// SPDX-License-Identifier: Apache-2.0
//
// Images out of recordings that the Python packages of the formats' authors have written
// (tests/data/recordings, by bench/data/write_recordings.py): two cameras, six instants every
// 0.1 s, of which the second camera lacks the third.
#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "calib/base/error.h"
#include "detectors/images/image.h"
#include "engine/recording/frames/session_frames.h"
#include "engine/recording/frames/time_pairs.h"
#include "engine/recording/messages/ros_messages.h"
#include "engine/recording/recording.h"
#include "engine/recording/stores/image_lister.h"
#include "models/registry.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

namespace fs = std::filesystem;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const fs::path kRecordings = fs::path(PLENOCAL_TEST_DATA) / "recordings";
const std::vector<std::string> kMessages{"plain.mcap",
                                         "lz4.mcap",
                                         "zstd.mcap",
                                         "png.mcap",
                                         "ros2.mcap",
                                         "ros2_mcap",
                                         "db3",
                                         "db3_packed",
                                         "plain.bag",
                                         "lz4.bag",
                                         "bz2.bag"};

int GreyOf(int camera, int instant) { return 100 * camera + 10 * instant + 5; }

std::vector<int> GreysOf(const std::vector<FrameImage>& images) {
  std::vector<int> greys;
  for (const FrameImage& image : images) {
    const cv::Mat gray = ReadGray(image);
    EXPECT_EQ(gray.size(), cv::Size(16, 12));
    double least = 0, largest = 0;
    cv::minMaxLoc(gray, &least, &largest);
    EXPECT_EQ(least, largest);
    greys.push_back(static_cast<int>(least));
  }
  return greys;
}

std::string Content(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

class Sources : public Workspace {
 protected:
  [[nodiscard]] Session TwoCameras(const std::string& left,
                                   const std::string& right,
                                   const std::string& more = {}) const {
    return SessionOf(
        "'" + left + "', topic: /left/image_raw", "'" + right + "', topic: /right/image_raw", more);
  }

  [[nodiscard]] Session SessionOf(const std::string& left,
                                  const std::string& right,
                                  const std::string& more = {}) const {
    return ParseSession(fmt::format("plenocal: 1\ntarget: chessboard:9x6:25mm\n{}cameras:\n"
                                    "  left: {{model: pinhole, images: {}}}\n"
                                    "  right: {{model: pinhole, images: {}}}\n",
                                    more,
                                    left,
                                    right),
                        Path("session.yaml"),
                        CameraModels());
  }

  /// The message of the refusal to list these images.
  [[nodiscard]] static std::string Refusal(const fs::path& pattern) {
    try {
      ListImages({pattern.string()}, "left: images");
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kInput);
      return error.what();
    }
    ADD_FAILURE() << pattern << " was read";
    return {};
  }
};

TEST_F(Sources, OfAllFormatsHaveTheSameImagesAndTimes) {
  for (const std::string& name : kMessages) {
    SCOPED_TRACE(name);
    ImageLister lister;
    const auto left = lister.List({(kRecordings / name / "left/image_raw").string()}, "left");
    const auto right = lister.List({(kRecordings / name / "right/image_raw").string()}, "right");
    EXPECT_THAT(lister.Notes(), IsEmpty());
    EXPECT_THAT(GreysOf(left), ElementsAre(5, 15, 25, 35, 45, 55));
    EXPECT_THAT(GreysOf(right), ElementsAre(105, 115, 135, 145, 155));
    EXPECT_EQ(left[0].frame, "1700000000100644092");
    EXPECT_EQ(left[5].frame, "1700000000599281585");
    constexpr double kRounding = 1e-6;  // s: of nanoseconds since 1970 in a double
    EXPECT_NEAR(*left[0].time, 1700000000.100644092, kRounding);
    EXPECT_FALSE(HashImage(left[0]).empty());
    EXPECT_NE(HashImage(left[0]), HashImage(left[1]));
  }
}

TEST_F(Sources, VideosHaveFramesByNumber) {
  const auto frames = ListImages({(kRecordings / "left.avi").string()}, "left");
  EXPECT_THAT(GreysOf(frames), ElementsAre(5, 15, 25, 35, 45, 55));
  EXPECT_EQ(frames[5].frame, "000005");
  EXPECT_NEAR(*frames[5].time - *frames[0].time, 0.5, 1e-3);
  // In any order.
  EXPECT_EQ(ReadGray(frames[4]).at<uchar>(0, 0), 45);
  EXPECT_EQ(ReadGray(frames[1]).at<uchar>(0, 0), 15);
  EXPECT_EQ(ReadGray(frames[0]).at<uchar>(0, 0), 5);
}

TEST_F(Sources, CamerasArePairedByTimeAndADroppedFrameShiftsNothing) {
  for (const std::string& name : kMessages) {
    SCOPED_TRACE(name);
    const std::string file = (kRecordings / name).string();
    std::vector<std::string> notes;
    const auto images = ListSessionImages(TwoCameras(file, file), &notes);
    EXPECT_THAT(notes, ElementsAre(HasSubstr("5 of 5 images are paired by time")));
    const auto names = [](const std::vector<FrameImage>& of) {
      std::vector<std::string> frames;
      for (const FrameImage& image : of) frames.push_back(image.frame);
      return frames;
    };
    std::vector<std::string> expected = names(images[0]);
    expected.erase(expected.begin() + 2);
    EXPECT_EQ(names(images[1]), expected);
  }
}

TEST_F(Sources, PairingByNameKeepsTheNames) {
  const std::string file = (kRecordings / "plain.mcap").string();
  std::vector<std::string> notes;
  const auto images = ListSessionImages(TwoCameras(file, file, "pairing: {by: name}\n"), &notes);
  EXPECT_THAT(notes, IsEmpty());
  EXPECT_NE(images[0][0].frame, images[1][0].frame);
}

TEST_F(Sources, ImageFilesMayBeCalledAfterTheirTimes) {
  // The second camera is 3 ms late; the fourth image of it is missing.
  for (int i = 0; i < 8; ++i) {
    for (int c = 0; c < 2; ++c) {
      if (c == 1 && i == 3) continue;
      const fs::path file = Path(
          fmt::format("cam{}/{}.png", c, 1403636579763555584 + 50000000LL * i + 3000000LL * c));
      fs::create_directories(file.parent_path());
      ASSERT_TRUE(cv::imwrite(file.string(), cv::Mat(12, 16, CV_8U, cv::Scalar(GreyOf(c, i)))));
    }
  }
  std::vector<std::string> notes;
  const auto images =
      ListSessionImages(SessionOf(Path("cam0").string(), Path("cam1").string()), &notes);
  EXPECT_THAT(notes, ElementsAre(HasSubstr("7 of 7 images are paired by time")));
  ASSERT_EQ(images[1].size(), 7U);
  EXPECT_EQ(images[1][3].frame, images[0][4].frame);
  EXPECT_NEAR(*images[1][3].time - *images[0][4].time, 0.003, 1e-6);
  // Other numbers are no times.
  for (int i = 0; i < 2; ++i) {
    const fs::path file = Path(fmt::format("numbers/{:06}.png", i));
    fs::create_directories(file.parent_path());
    ASSERT_TRUE(cv::imwrite(file.string(), cv::Mat(12, 16, CV_8U, cv::Scalar(i))));
  }
  const auto numbers =
      ListSessionImages(SessionOf(Path("numbers").string(), Path("numbers").string()), &notes);
  EXPECT_FALSE(numbers[0][0].time);
}

TEST_F(Sources, ToleranceFollowsTheJitter) {
  // The second camera is 4 ms late, with a jitter of 0.1 ms; one image has a wrong time.
  std::vector<std::vector<double>> times(2);
  for (int i = 0; i < 50; ++i) {
    times[0].push_back(0.1 * i);
    times[1].push_back(0.1 * i + 0.004 + 0.0001 * std::sin(i) + (i == 20 ? 0.03 : 0));
  }
  const TimePairs pairs = PairTimes(times, {});
  EXPECT_GT(pairs.tolerance, 0.0045);
  EXPECT_LT(pairs.tolerance, 0.006);
  size_t both = 0;
  for (const auto& frame : pairs.frames) both += frame[0] && frame[1] ? 1 : 0;
  EXPECT_EQ(both, 49U);
  EXPECT_EQ(PairTimes(times, 0.05).frames.size(), 50U);
}

TEST_F(Sources, ADamagedTailCostsOnlyWhatIsInIt) {
  for (const char* name : {"plain.mcap", "plain.bag", "db3/db3.db3"}) {
    SCOPED_TRACE(name);
    const std::string whole = Content(kRecordings / name);
    const fs::path cut = Path("cut" + fs::path(name).extension().string());
    size_t most = 0;
    for (size_t size = 0; size < whole.size(); size += 97) {
      Write(cut.filename().string(), whole.substr(0, size));
      ImageLister lister;
      std::vector<FrameImage> images;
      try {
        images = lister.List({(cut / "left/image_raw").string()}, "left");
      } catch (const Error& error) {
        EXPECT_THAT(error.what(), HasSubstr(cut.string()));
        EXPECT_EQ(most, 0U) << "after " << size << " bytes, where fewer held images";
        continue;
      }
      EXPECT_GE(images.size(), most);
      most = images.size();
      // The last image of a database can be cut off within, and pages of its first ones lie behind
      // those of others.
      const bool database = cut.extension() == ".db3";
      for (size_t i = 0; i + 1 < images.size() && !database; ++i) {
        EXPECT_EQ(ReadGray(images[i]).at<uchar>(0, 0), GreyOf(0, static_cast<int>(i)));
      }
    }
    EXPECT_EQ(most, 6U);
  }
}

TEST_F(Sources, WithoutTheTopicNameThoseThatAreThere) {
  EXPECT_THAT(Refusal(kRecordings / "zstd.mcap"),
              HasSubstr("has several topics with images; name one of them"));
  EXPECT_THAT(Refusal(kRecordings / "zstd.mcap/centre"),
              HasSubstr("has no topic 'centre'; name one of them"));
  EXPECT_THAT(Refusal(kRecordings / "plain.bag/imu"),
              HasSubstr("topic '/imu' has no images but sensor_msgs/Imu"));
}

TEST_F(Sources, RefuseWhatIsNoRecording) {
  Write("no.mcap", "not at all");
  EXPECT_THAT(Refusal(Path("no.mcap/left")), HasSubstr("is no MCAP file"));
  Write("old.bag", "#ROSBAG V1.2\n");
  EXPECT_THAT(Refusal(Path("old.bag/left")), HasSubstr("rosbag migrate"));
  Write("empty.db3", "");
  EXPECT_THAT(Refusal(Path("empty.db3/left")), HasSubstr("is empty"));
  Write("no.mp4", "not at all");
  EXPECT_THAT(Refusal(Path("no.mp4")), HasSubstr("ffmpeg -i"));
  const fs::path topic = kRecordings / "left.avi/left";
  EXPECT_THAT(Refusal(topic), HasSubstr("a video has no parts"));
}

TEST_F(Sources, RecordingListsTopicsAndCameras) {
  for (const std::string& name : kMessages) {
    SCOPED_TRACE(name);
    const Recording recording = ReadRecording(kRecordings / name);
    ASSERT_EQ(recording.cameras.size(), 2U);
    EXPECT_EQ(recording.cameras[0].name, "left");
    EXPECT_EQ(recording.cameras[1].images.size(), 5U);
    EXPECT_EQ(recording.frames.size(), 6U);
    EXPECT_EQ(recording.topics[0].name, "/left/image_raw");
    if (name == "ros2.mcap") continue;  // has images alone
    EXPECT_EQ(recording.topics[0].camera_info, "/left/camera_info");
    ASSERT_EQ(recording.other_topics.size(), 1U);
    EXPECT_EQ(recording.other_topics[0].count, 11U);
    const std::optional<CameraInfo> info = recording.log->ReadInfo("/right/camera_info");
    ASSERT_TRUE(info);
    EXPECT_EQ(info->size, (ImageSize{16, 12}));
    EXPECT_DOUBLE_EQ(info->camera[0], 1.1 * 16);
    EXPECT_EQ(info->distortion.size(), 5U);
  }
}

// ---- pixels

/// One image of pixels.
TEST_F(Sources, InitProposesTheirTopicsAsCameras) {
  for (const std::string& name : kMessages) {
    const Outcome outcome = Run({"init", (kRecordings / name).string(), "-o", name + ".yaml"});
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
    const YAML::Node cameras = YAML::Load(Read(name + ".yaml"))["cameras"];
    ASSERT_EQ(cameras.size(), 2U) << name;
    for (const char* camera : {"left", "right"}) {
      EXPECT_THAT(cameras[camera]["images"].as<std::string>(), HasSubstr(name)) << name;
    }
    EXPECT_THAT(outcome.out, HasSubstr("right: 5 images"));
  }
  // Those in a folder without images; not the same images twice.
  fs::create_directories(Path("day"));
  fs::copy_file(kRecordings / "plain.mcap", Path("day/a.mcap"));
  const Outcome outcome = Run({"init", "day", "-o", "day.yaml"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(Read("day.yaml"), HasSubstr("images: day/a.mcap/left/image_raw"));
  fs::copy_file(kRecordings / "lz4.mcap", Path("day/b.mcap"));
  EXPECT_THAT(Run({"init", "day", "-o", "twice.yaml"}).err, HasSubstr("name one of them"));

  Write("notes.txt", "no recording");
  EXPECT_THAT(Run({"init", "notes.txt", "-o", "notes.yaml"}).err, HasSubstr("notes.txt: is no"));
}

class OneImage : public ImageStore {
 public:
  explicit OneImage(StoredImage image) : image_(std::move(image)) {}
  [[nodiscard]] StoredImage Read(size_t) const override { return image_; }
  [[nodiscard]] StoredImage Start(size_t, size_t) const override { return image_; }
  [[nodiscard]] std::string Hash(size_t) const override { return "1"; }

 private:
  StoredImage image_;
};

FrameImage Stored(const cv::Mat& pixels, const std::string& encoding) {
  StoredImage image{.bytes = {},
                    .encoding = encoding,
                    .size = {pixels.cols, pixels.rows},
                    .step = pixels.step[0]};
  image.bytes.assign(pixels.data, pixels.data + pixels.step[0] * pixels.rows);
  return {.frame = "1", .path = "drive.bag/image/1", .store = std::make_shared<OneImage>(image)};
}

cv::Mat Noise(int type) {
  cv::Mat image(37, 50, type);
  cv::theRNG().state = 5;
  cv::randu(image, 0, image.depth() == CV_8U ? 256 : 65536);
  return image;
}

TEST_F(Sources, PixelsAndAPngFileOfThemAreOneImage) {
  struct Case {
    const char* encoding;
    int type;
  };
  for (const Case& each : {Case{"mono8", CV_8UC1},
                           Case{"mono16", CV_16UC1},
                           Case{"bayer_rggb8", CV_8UC1},
                           Case{"bgr8", CV_8UC3},
                           Case{"bgr16", CV_16UC3}}) {
    SCOPED_TRACE(each.encoding);
    const cv::Mat pixels = Noise(each.type);
    const std::string png = Path("image.png");
    ASSERT_TRUE(cv::imwrite(png, pixels));
    const FrameImage stored = Stored(pixels, each.encoding);
    EXPECT_EQ(cv::norm(ReadGray(stored), ReadGray(png), cv::NORM_INF), 0);
    EXPECT_EQ(cv::norm(ReadImage(stored), ReadImage(png), cv::NORM_INF), 0);
  }
}

TEST_F(Sources, UnknownOrDamagedPixelsAreRefusedWithTheMend) {
  const auto refusal = [](const FrameImage& image) -> std::string {
    try {
      ReadGray(image);
    } catch (const Error& error) {
      return error.what();
    }
    return "was read";
  };
  EXPECT_THAT(refusal(Stored(Noise(CV_8UC1), "h264")), HasSubstr("encoding 'h264'"));
  EXPECT_THAT(refusal(Stored(Noise(CV_8UC1), "bgr8")), HasSubstr("do not fit"));
}

// A message of ROS 1 with the header of such an image.
TEST_F(Sources, HaveNoMorePixelsThanTheLargestCameras) {
  const auto number = [](std::uint32_t value) {
    std::array<std::uint8_t, 4> bytes{};
    for (int i = 0; i < 4; ++i) bytes[i] = static_cast<std::uint8_t>(value >> (8 * i));
    return bytes;
  };
  ByteVector message;
  constexpr std::uint32_t kSide = 20000;
  // Sequence, time, name of the frame, height and width.
  for (const std::uint32_t value : {1U, 1U, 0U, 0U, kSide, kSide}) {
    const auto bytes = number(value);
    message.insert(message.end(), bytes.begin(), bytes.end());
  }
  try {
    ReadImageMessage(MessageKind::kImage, MessageCoding::kRos1, message, "drive.bag/image");
    FAIL() << "was read";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("drive.bag/image"));
    EXPECT_THAT(error.what(), HasSubstr("20000 x 20000 pixels; at most 268 million are read"));
  }
}

// Chunks that state 2 GB.
TEST_F(Sources, HaveNoChunksUnpackedThatAreTooLarge) {
  const auto damage = [&](const char* name, size_t place) {
    std::string bytes = Content(kRecordings / name);
    bytes.replace(place, 4, "\xff\xff\xff\x7f");
    Write(name, bytes);
    return Run({"recording", name}).err;
  };
  const std::string message = "has 2047 MB, of which at most 960 are read; its messages are lost";
  const std::string field = "size=";
  EXPECT_THAT(damage("bz2.bag", Content(kRecordings / "bz2.bag").find(field) + field.size()),
              HasSubstr(message));
  // Of the first chunk, behind its two times: records have an opcode and a length.
  const std::string mcap = Content(kRecordings / "zstd.mcap");
  constexpr size_t kMagic = 8, kLength = 9, kTimes = 16;
  size_t at = kMagic;
  constexpr char kChunk = 6;
  while (mcap[at] != kChunk) {
    std::uint64_t length = 0;
    std::memcpy(&length, mcap.data() + at + 1, sizeof length);
    at += kLength + length;
  }
  EXPECT_THAT(damage("zstd.mcap", at + kLength + kTimes), HasSubstr(message));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
