// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/messages/ros_messages.h"

#include <gmock/gmock.h>

#include "detectors/images/image_header.h"
#include "tests/engine/recording/message_bytes.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

using Form = MessageWriter::Form;

MessageCoding CodingOf(Form form) {
  return form == Form::kRos1 ? MessageCoding::kRos1 : MessageCoding::kCdr;
}

StoredImage ReadImageOf(Form form,
                        const std::string& text,
                        MessageKind kind = MessageKind::kImage,
                        MessagePart part = MessagePart::kAll) {
  return ReadImageMessage(kind, CodingOf(form), BytesOf(text), "a.bag/left", part);
}

MessageWriter ImageOfSize(Form form, std::uint32_t height, std::uint32_t width) {
  MessageWriter writer(form);
  writer.Header(1, 2).Number(height).Number(width);
  return writer;
}

TEST(RosMessages, HaveKindsByTheNamesOfBothVersions) {
  EXPECT_EQ(KindOfType("sensor_msgs/Image"), MessageKind::kImage);
  EXPECT_EQ(KindOfType("sensor_msgs/msg/Image"), MessageKind::kImage);
  EXPECT_EQ(KindOfType("sensor_msgs/CompressedImage"), MessageKind::kCompressedImage);
  EXPECT_EQ(KindOfType("sensor_msgs/msg/CompressedImage"), MessageKind::kCompressedImage);
  EXPECT_EQ(KindOfType("sensor_msgs/CameraInfo"), MessageKind::kCameraInfo);
  EXPECT_EQ(KindOfType("sensor_msgs/msg/CameraInfo"), MessageKind::kCameraInfo);
  for (const char* other : {"", "Image", "sensor_msgs/msg/Imu", "sensor_msgs/Image2"}) {
    EXPECT_EQ(KindOfType(other), MessageKind::kOther) << other;
  }
  EXPECT_EQ(CodingOfName("ros1"), MessageCoding::kRos1);
  EXPECT_EQ(CodingOfName("cdr"), MessageCoding::kCdr);
  EXPECT_EQ(CodingOfName("json"), MessageCoding::kOther);
}

TEST(RosMessages, HaveTheTimeOfTheirHeader) {
  for (const Form form : kForms) {
    const auto stamp = [&](std::uint32_t seconds, std::uint32_t nanoseconds, size_t size) {
      ByteVector bytes = BytesOf(ImageMessage(form, seconds, nanoseconds, 'a'));
      bytes.resize(size);
      return StampOf(CodingOf(form), bytes);
    };
    EXPECT_EQ(stamp(0x01020304, 0x05060708, 12), 0x01020304 * 1'000'000'000LL + 0x05060708);
    EXPECT_EQ(stamp(3000000000U, 999'999'999, 40), 3'000'000'000'999'999'999LL);
    EXPECT_EQ(stamp(1, 1'000'000'000, 40), std::nullopt);
    EXPECT_EQ(stamp(1, 2, 11), std::nullopt);
  }
  EXPECT_EQ(StampOf(MessageCoding::kOther, BytesOf(ImageMessage(Form::kRos1, 1, 2, 'a'))),
            std::nullopt);
  // Of ROS 1 the second byte belongs to the sequence number.
  EXPECT_EQ(StampOf(MessageCoding::kRos1, BytesOf(U32(0) + U32(5) + U32(6))), 5'000'000'006LL);
}

TEST(RosMessages, OfImagesHaveTheirPixels) {
  for (const Form form : kForms) {
    const std::string text = ImageOfSize(form, 2, 5)
                                 .Text("mono16")
                                 .Number(std::uint8_t{1})
                                 .Number(std::uint32_t{12})
                                 .Bytes("abcdefghijklmnopqrstuvwx")
                                 .Done();
    const StoredImage image = ReadImageOf(form, text);
    EXPECT_EQ(image.size, (ImageSize{5, 2}));
    EXPECT_EQ(image.encoding, "mono16");
    EXPECT_TRUE(image.big_endian);
    EXPECT_EQ(image.step, 12U);
    EXPECT_EQ(TextOfBytes(image.bytes), "abcdefghijklmnopqrstuvwx");
    for (size_t size = 0; size < text.size(); ++size) {
      const std::string why = RefusalOf([&] { ReadImageOf(form, text.substr(0, size)); });
      const bool has_head = form == Form::kRos1 || size >= 4;
      EXPECT_EQ(why,
                std::string("a.bag/left: the message ") +
                    (has_head ? "is cut off" : "is no message in CDR") +
                    "; exclude it, or record again");
    }
    const std::string start = text.substr(0, text.size() - 20);
    EXPECT_EQ(TextOfBytes(ReadImageOf(form, start, MessageKind::kImage, MessagePart::kStart).bytes),
              "abcd");
    EXPECT_EQ(
        ReadImageOf(form, text + "more", MessageKind::kImage, MessagePart::kStart).bytes.size(),
        24U);
  }
  EXPECT_FALSE(ReadImageOf(Form::kCdr, ImageMessage(Form::kCdr, 1, 2, 'a')).big_endian);
}

TEST(RosMessages, OfImagesWithoutAnEncodingHaveOneThatIsNoFile) {
  const std::string text = ImageOfSize(Form::kRos1, 1, 1)
                               .Text("")
                               .Number(std::uint8_t{0})
                               .Number(std::uint32_t{1})
                               .Bytes("a")
                               .Done();
  EXPECT_EQ(ReadImageOf(Form::kRos1, text).encoding, "''");
}

TEST(RosMessages, OfTextsEndAtTheFirstZero) {
  const std::string text = ImageOfSize(Form::kRos1, 1, 1)
                               .Text(std::string("mono8\0junk", 10))
                               .Number(std::uint8_t{0})
                               .Number(std::uint32_t{1})
                               .Bytes("a")
                               .Done();
  EXPECT_EQ(ReadImageOf(Form::kRos1, text).encoding, "mono8");
}

TEST(RosMessages, InCdrBeginWithItsHeader) {
  std::string text = ImageMessage(Form::kCdr, 1, 2, 'a');
  const auto with = [&](int place, char value) {
    std::string other = text;
    other[place] = value;
    return RefusalOf([&] { ReadImageOf(Form::kCdr, other); });
  };
  EXPECT_THAT(with(0, 1), HasSubstr("is no message in CDR"));
  EXPECT_THAT(with(1, 2), HasSubstr("is no message in CDR"));
  EXPECT_EQ(with(2, 9), "no refusal");
}

TEST(RosMessages, HaveNoMorePixelsThanAreRead) {
  const auto refusal = [](std::uint32_t height, std::uint32_t width) {
    return RefusalOf(
        [&] { ReadImageOf(Form::kRos1, ImageOfSize(Form::kRos1, height, width).Done()); });
  };
  // The size passes; then the message is cut off.
  constexpr std::uint32_t kSide = 1U << 14;
  static_assert(std::uint64_t{kSide} * kSide == kMostPixels);
  EXPECT_THAT(refusal(kSide, kSide), HasSubstr("is cut off"));
  EXPECT_THAT(refusal(kSide, kSide + 1), HasSubstr("states " + PixelsText(kSide + 1, kSide)));
  EXPECT_THAT(refusal(0, 1U << 28), HasSubstr("is cut off"));
  EXPECT_THAT(refusal(0, (1U << 28) + 1), HasSubstr("states "));
  EXPECT_THAT(refusal((1U << 28) + 1, 0), HasSubstr("states "));
}

TEST(RosMessages, OfCompressedImagesHaveTheFile) {
  for (const Form form : kForms) {
    const auto message = [&](const std::string& format) {
      return MessageWriter(form).Header(1, 2).Text(format).Bytes("\x89PNG...").Done();
    };
    const auto read = [&](const std::string& text, MessagePart part = MessagePart::kAll) {
      return ReadImageOf(form, text, MessageKind::kCompressedImage, part);
    };
    const StoredImage image = read(message("bgr8; jpeg compressed bgr8"));
    EXPECT_EQ(TextOfBytes(image.bytes), "\x89PNG...");
    EXPECT_EQ(image.encoding, "");
    EXPECT_EQ(image.size, ImageSize{});
    const std::string whole = message("png");
    const std::string start = whole.substr(0, whole.size() - 3);
    EXPECT_EQ(TextOfBytes(read(start, MessagePart::kStart).bytes), "\x89PNG");
    EXPECT_THAT(RefusalOf([&] { read(start); }), HasSubstr("is cut off"));
    EXPECT_EQ(RefusalOf([&] { read(message("16UC1; compressedDepth")); }),
              "a.bag/left: is a depth image (16UC1; compressedDepth), which shows no target; "
              "choose a topic of images");
    for (const std::string codec : {"h264", "h265", "hevc", "av1", "vp9"}) {
      EXPECT_EQ(RefusalOf([&] { read(message("x " + codec)); }),
                "a.bag/left: is packed as video (x " + codec +
                    "); export the topic as a video file or as single images");
    }
  }
}

TEST(RosMessages, OfCameraInfoHaveTheIntrinsics) {
  for (const Form form : kForms) {
    MessageWriter writer = ImageOfSize(form, 480, 640);
    writer.Text("plumb_bob").Number(std::uint32_t{3});
    for (int i = 0; i < 3 + 9 + 9 + 12; ++i) writer.Double(i + 0.5);
    const std::string text = writer.Done();
    const auto read = [&](const std::string& bytes) {
      return ReadCameraInfo(CodingOf(form), BytesOf(bytes), "a.bag/info");
    };
    const CameraInfo info = read(text);
    EXPECT_EQ(info.size, (ImageSize{640, 480}));
    EXPECT_EQ(info.distortion_model, "plumb_bob");
    EXPECT_THAT(info.distortion, ElementsAre(0.5, 1.5, 2.5));
    EXPECT_EQ(info.camera.front(), 3.5);
    EXPECT_EQ(info.camera.back(), 11.5);
    EXPECT_EQ(info.rectification.front(), 12.5);
    EXPECT_EQ(info.projection.front(), 21.5);
    EXPECT_EQ(info.projection.back(), 32.5);
    EXPECT_EQ(RefusalOf([&] { read(text.substr(0, text.size() - 1)); }),
              "a.bag/info: the message is cut off; exclude it, or record again");
  }
}

TEST(RosMessages, OfCameraInfoHaveListsThatFitIntoThem) {
  // Two coefficients of 8 bytes are there, and three are stated.
  for (const std::uint32_t count : {3U, 0x80000000U}) {
    const std::string text =
        ImageOfSize(Form::kRos1, 1, 1).Text("").Number(count).Double(1).Double(2).Done();
    EXPECT_THAT(RefusalOf([&] { ReadCameraInfo(MessageCoding::kRos1, BytesOf(text), "a"); }),
                HasSubstr("is cut off"));
  }
}

TEST(RosMessages, OfCameraInfoAreWrittenAsACameraFile) {
  CameraInfo info{.size = {640, 480}, .distortion_model = "plumb_bob", .distortion = {0.25, -1}};
  info.camera = {1, 2, 3, 4, 5, 6, 7, 8, 9};
  info.rectification = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  info.projection = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12};
  EXPECT_EQ(RosCameraYaml(info, "left"),
            "image_width: 640\nimage_height: 480\ncamera_name: left\n"
            "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [1, 2, 3, 4, 5, 6, 7, 8, 9]\n"
            "distortion_model: plumb_bob\n"
            "distortion_coefficients:\n  rows: 1\n  cols: 2\n  data: [0.25, -1]\n"
            "rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n"
            "projection_matrix:\n  rows: 3\n  cols: 4\n"
            "  data: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]\n");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
