// SPDX-License-Identifier: Apache-2.0
//
// Messages of ROS that have to do with images: sensor_msgs/Image, CompressedImage, CameraInfo, as
// ROS 1 and ROS 2 (CDR) write them.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "calib/files/image_store.h"
#include "engine/recording/messages/byte_range.h"

namespace plenocal {

enum class MessageKind { kImage, kCompressedImage, kCameraInfo, kOther };

/// How messages are written as bytes.
enum class MessageCoding { kRos1, kCdr, kOther };

/// The kind of a type such as "sensor_msgs/msg/Image".
MessageKind KindOfType(std::string_view type);
/// The coding of a name such as "ros1" or "cdr".
MessageCoding CodingOfName(std::string_view name);

/// Bytes of a message that `StampOf` needs at most.
inline constexpr std::size_t kStampBytes = 12;
/// The time in the header of a message of a kind above, ns; nothing when there are too few bytes.
std::optional<std::int64_t> StampOf(MessageCoding coding, ByteSpan start);

/// The part of a message that its bytes are: all, or only the first ones.
enum class MessagePart { kAll, kStart };

/// The image of a message of kind kImage or kCompressedImage, of its start with as many of its
/// bytes as there are. Throws `Error` of kind kInput, which
/// begins with `place`, for damaged messages.
StoredImage ReadImageMessage(MessageKind kind,
                             MessageCoding coding,
                             ByteSpan message,
                             const std::string& place,
                             MessagePart part = MessagePart::kAll);

/// A camera's intrinsics as a driver publishes them.
struct CameraInfo {
  ImageSize size{};
  std::string distortion_model;
  std::vector<double> distortion;  ///< D
  std::array<double, 9> camera{};  ///< K, row by row
  std::array<double, 9> rectification{};
  std::array<double, 12> projection{};
};

/// Throws as `ReadImageMessage` does.
CameraInfo ReadCameraInfo(MessageCoding coding, ByteSpan message, const std::string& place);

/// The same as the camera file of ROS, which `plenocal import --format ros` reads.
std::string RosCameraYaml(const CameraInfo& info, const std::string& name);

}  // namespace plenocal
