// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/messages/ros_messages.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <cstring>

#include "calib/base/format_error.h"
#include "detectors/images/image_header.h"

namespace plenocal {
namespace {

constexpr std::size_t kCdrHeader = 4;  // bytes before the first value, from which CDR aligns

/// Takes the values of a message one after the other.
class MessageReader {
 public:
  MessageReader(MessageCoding coding, ByteSpan message, const std::string& place)
      : rest_(message), place_(place), aligned_(coding == MessageCoding::kCdr) {
    if (!aligned_) return;
    // Representation identifiers of plain CDR: 0 has the highest byte first, 1 the lowest.
    if (message.size() < kCdrHeader || message[0] != 0 || message[1] > 1) {
      Refuse("is no message in CDR");
    }
    highest_first_ = message[1] == 0;
    Skip(kCdrHeader);
    taken_ = 0;
  }

  template <typename T>
  T Number() {
    Align(sizeof(T));
    const ByteSpan bytes = Take(sizeof(T));
    std::array<std::uint8_t, sizeof(T)> own{};
    std::ranges::copy(bytes, own.begin());
    if (highest_first_ != (std::endian::native == std::endian::big)) std::ranges::reverse(own);
    return std::bit_cast<T>(own);
  }
  ByteSpan Bytes() { return Take(Number<std::uint32_t>()); }
  /// The same, or all that there is of it.
  ByteSpan BytesAtStart() {
    const auto count = Number<std::uint32_t>();
    return Take(std::min<std::size_t>(count, rest_.size()));
  }
  std::string Text() {
    const ByteSpan bytes = Bytes();
    std::string text(bytes.begin(), bytes.end());
    if (const std::size_t end = text.find('\0'); end != std::string::npos) text.resize(end);
    return text;
  }
  /// Header: of ROS 1 with a sequence number.
  void Header() {
    if (!aligned_) Number<std::uint32_t>();
    Number<std::uint32_t>();
    Number<std::uint32_t>();
    Text();
  }
  template <std::size_t count>
  std::array<double, count> Numbers() {
    std::array<double, count> numbers{};
    for (double& number : numbers) number = Number<double>();
    return numbers;
  }
  std::vector<double> List() {
    const auto count = Number<std::uint32_t>();
    if (count > rest_.size() / sizeof(double)) Refuse("is cut off");
    std::vector<double> numbers;
    for (std::uint32_t i = 0; i < count; ++i) numbers.push_back(Number<double>());
    return numbers;
  }
  ImageSize Size() {
    const std::uint64_t height = Number<std::uint32_t>(), width = Number<std::uint32_t>();
    if (std::max({width, height, width * height}) > kMostPixels) {
      Refuse("states " + PixelsText(width, height));
    }
    return {static_cast<int>(width), static_cast<int>(height)};
  }

 private:
  [[noreturn]] void Refuse(const std::string& reason) const {
    throw InputError("{}: the message {}; exclude it, or record again", place_, reason);
  }
  void Align(std::size_t size) {
    if (aligned_) Skip((size - taken_ % size) % size);
  }
  void Skip(std::size_t count) { Take(count); }
  ByteSpan Take(std::size_t count) {
    if (count > rest_.size()) Refuse("is cut off");
    const ByteSpan taken = rest_.first(count);
    rest_ = rest_.subspan(count);
    taken_ += count;
    return taken;
  }

  ByteSpan rest_;
  const std::string& place_;
  bool aligned_, highest_first_ = false;
  std::size_t taken_ = 0;  // since the place that values are aligned to
};

}  // namespace

MessageKind KindOfType(std::string_view type) {
  if (type == "sensor_msgs/Image" || type == "sensor_msgs/msg/Image") return MessageKind::kImage;
  if (type == "sensor_msgs/CompressedImage" || type == "sensor_msgs/msg/CompressedImage") {
    return MessageKind::kCompressedImage;
  }
  if (type == "sensor_msgs/CameraInfo" || type == "sensor_msgs/msg/CameraInfo") {
    return MessageKind::kCameraInfo;
  }
  return MessageKind::kOther;
}

MessageCoding CodingOfName(std::string_view name) {
  if (name == "ros1") return MessageCoding::kRos1;
  return name == "cdr" ? MessageCoding::kCdr : MessageCoding::kOther;
}

std::optional<std::int64_t> StampOf(MessageCoding coding, ByteSpan start) {
  if (start.size() < kStampBytes || coding == MessageCoding::kOther) return std::nullopt;
  std::uint32_t seconds = LittleEndianAt<std::uint32_t>(start, 4);
  std::uint32_t nanoseconds = LittleEndianAt<std::uint32_t>(start, 8);
  if (coding == MessageCoding::kCdr && start[1] == 0) {
    seconds = __builtin_bswap32(seconds);
    nanoseconds = __builtin_bswap32(nanoseconds);
  }
  constexpr std::int64_t kSecond = 1'000'000'000;
  if (nanoseconds >= kSecond) return std::nullopt;
  return kSecond * seconds + nanoseconds;
}

StoredImage ReadImageMessage(MessageKind kind,
                             MessageCoding coding,
                             ByteSpan message,
                             const std::string& place,
                             MessagePart part) {
  MessageReader reader(coding, message, place);
  reader.Header();
  StoredImage image;
  ByteSpan content;
  if (kind == MessageKind::kCompressedImage) {
    const std::string format = reader.Text();
    content = part == MessagePart::kAll ? reader.Bytes() : reader.BytesAtStart();
    if (format.find("compressedDepth") != std::string::npos) {
      throw InputError(
          "{}: is a depth image ({}), which shows no target; choose a topic "
          "of images",
          place,
          format);
    }
    for (const char* codec : {"h264", "h265", "hevc", "av1", "vp9"}) {
      if (format.find(codec) == std::string::npos) continue;
      throw InputError(
          "{}: is packed as video ({}); export the topic as a video file or "
          "as single images",
          place,
          format);
    }
  } else {
    image.size = reader.Size();
    image.encoding = reader.Text();
    if (image.encoding.empty()) image.encoding = "''";
    image.big_endian = reader.Number<std::uint8_t>() != 0;
    image.step = reader.Number<std::uint32_t>();
    content = part == MessagePart::kAll ? reader.Bytes() : reader.BytesAtStart();
  }
  image.bytes.assign(content.begin(), content.end());
  return image;
}

CameraInfo ReadCameraInfo(MessageCoding coding, ByteSpan message, const std::string& place) {
  MessageReader reader(coding, message, place);
  reader.Header();
  CameraInfo info;
  info.size = reader.Size();
  info.distortion_model = reader.Text();
  info.distortion = reader.List();
  info.camera = reader.Numbers<9>();
  info.rectification = reader.Numbers<9>();
  info.projection = reader.Numbers<12>();
  return info;
}

std::string RosCameraYaml(const CameraInfo& info, const std::string& name) {
  const auto matrix = [](const char* key, int rows, int columns, const auto& values) {
    return fmt::format(
        "{}:\n  rows: {}\n  cols: {}\n  data: [{}]\n", key, rows, columns, fmt::join(values, ", "));
  };
  return fmt::format("image_width: {}\nimage_height: {}\ncamera_name: {}\n",
                     info.size[0],
                     info.size[1],
                     name) +
         matrix("camera_matrix", 3, 3, info.camera) +
         fmt::format("distortion_model: {}\n", info.distortion_model) +
         matrix("distortion_coefficients",
                1,
                static_cast<int>(info.distortion.size()),
                info.distortion) +
         matrix("rectification_matrix", 3, 3, info.rectification) +
         matrix("projection_matrix", 3, 4, info.projection);
}

}  // namespace plenocal
