// SPDX-License-Identifier: Apache-2.0
//
// Bytes of messages of ROS and of the files that hold them, written by the rules of their formats.
#pragma once

#include <bzlib.h>
#include <lz4frame.h>
#include <zstd.h>

#include <bit>
#include <cstdint>
#include <string>
#include <vector>

#include "engine/recording/messages/byte_range.h"

namespace plenocal::testing {

/// A number, the lowest byte first.
template <typename T>
std::string Little(T value) {
  std::string bytes;
  for (std::size_t i = 0; i < sizeof(T); ++i) {
    bytes += static_cast<char>(static_cast<std::uint64_t>(value) >> (8 * i));
  }
  return bytes;
}
inline std::string U32(std::size_t value) { return Little(static_cast<std::uint32_t>(value)); }
/// A text behind its length.
inline std::string Counted32(const std::string& text) { return U32(text.size()) + text; }

inline ByteVector BytesOf(const std::string& text) { return {text.begin(), text.end()}; }
inline std::string TextOfBytes(ByteSpan bytes) { return {bytes.begin(), bytes.end()}; }

/// Bytes that are hard to pack and differ from place to place.
inline std::string Noisy(std::size_t size) {
  std::string text;
  std::uint32_t state = 12345;
  for (std::size_t i = 0; i < size; ++i) {
    state = state * 1664525 + 1013904223;
    text += static_cast<char>(state >> 24);
  }
  return text;
}

inline std::string Zstd(const std::string& text) {
  std::string packed(ZSTD_compressBound(text.size()), '\0');
  packed.resize(ZSTD_compress(packed.data(), packed.size(), text.data(), text.size(), 1));
  return packed;
}
inline std::string Lz4(const std::string& text) {
  std::string packed(LZ4F_compressFrameBound(text.size(), nullptr), '\0');
  packed.resize(
      LZ4F_compressFrame(packed.data(), packed.size(), text.data(), text.size(), nullptr));
  return packed;
}
inline std::string Bz2(std::string text) {
  auto size = static_cast<unsigned>(text.size() + text.size() / 50 + 1000);
  std::string packed(size, '\0');
  BZ2_bzBuffToBuffCompress(
      packed.data(), &size, text.data(), static_cast<unsigned>(text.size()), 1, 0, 0);
  packed.resize(size);
  return packed;
}

/// The values of a message: as ROS 1 writes them, or as CDR does with either order of bytes.
class MessageWriter {
 public:
  enum class Form { kRos1, kCdr, kCdrHighestFirst };
  explicit MessageWriter(Form form) : form_(form) {
    if (form == Form::kCdr) head_ = {0, 1, 0, 0};
    if (form == Form::kCdrHighestFirst) head_ = {0, 0, 0, 0};
  }
  template <typename T>
  MessageWriter& Number(T value) {
    while (form_ != Form::kRos1 && body_.size() % sizeof(T) != 0) body_ += '\x55';
    std::string bytes = Little(value);
    if (form_ == Form::kCdrHighestFirst) bytes = {bytes.rbegin(), bytes.rend()};
    body_ += bytes;
    return *this;
  }
  MessageWriter& Double(double value) { return Number(std::bit_cast<std::uint64_t>(value)); }
  MessageWriter& Text(const std::string& text) {
    const std::string end(form_ == Form::kRos1 ? 0 : 1, '\0');
    return Bytes(text + end);
  }
  MessageWriter& Bytes(const std::string& bytes) {
    Number(static_cast<std::uint32_t>(bytes.size()));
    body_ += bytes;
    return *this;
  }
  MessageWriter& Header(std::uint32_t seconds, std::uint32_t nanoseconds) {
    if (form_ == Form::kRos1) Number(std::uint32_t{77});
    return Number(seconds).Number(nanoseconds).Text("lens");
  }
  [[nodiscard]] std::string Done() const { return head_ + body_; }

 private:
  Form form_;
  std::string head_ = {}, body_ = {};
};

inline constexpr MessageWriter::Form kForms[] = {
    MessageWriter::Form::kRos1, MessageWriter::Form::kCdr, MessageWriter::Form::kCdrHighestFirst};

/// A grey image of 3 x 2 px, all of this value.
inline std::string ImageMessage(MessageWriter::Form form,
                                std::uint32_t seconds,
                                std::uint32_t nanoseconds,
                                char grey) {
  return MessageWriter(form)
      .Header(seconds, nanoseconds)
      .Number(std::uint32_t{2})
      .Number(std::uint32_t{3})
      .Text("mono8")
      .Number(std::uint8_t{0})
      .Number(std::uint32_t{3})
      .Bytes(std::string(6, grey))
      .Done();
}

// ---- bags of ROS 1

inline std::string BagField(const std::string& name, const std::string& value) {
  return Counted32(name + "=" + value);
}
inline std::string BagRecord(const std::string& header, const std::string& data) {
  return Counted32(header) + Counted32(data);
}
inline std::string BagOperation(int op) {
  return BagField("op", std::string(1, static_cast<char>(op)));
}
inline std::string BagConnection(int number, const std::string& topic, const std::string& type) {
  return BagRecord(BagOperation(7) + BagField("conn", U32(number)) + BagField("topic", topic),
                   BagField("topic", topic) + BagField("type", type));
}
inline std::string BagMessage(int connection,
                              std::uint32_t seconds,
                              std::uint32_t nanoseconds,
                              const std::string& data) {
  return BagRecord(BagOperation(2) + BagField("conn", U32(connection)) +
                       BagField("time", U32(seconds) + U32(nanoseconds)),
                   data);
}
inline std::string BagChunk(const std::string& packing,
                            const std::string& packed,
                            std::size_t unpacked) {
  return BagRecord(
      BagOperation(5) + BagField("compression", packing) + BagField("size", U32(unpacked)), packed);
}

// ---- MCAP files

inline std::string McapRecord(int opcode, const std::string& content) {
  return std::string(1, static_cast<char>(opcode)) + Little(std::uint64_t{content.size()}) +
         content;
}
inline std::string McapSchema(std::uint16_t id, const std::string& name) {
  return McapRecord(3, Little(id) + Counted32(name) + Counted32("ros2msg") + Counted32("text"));
}
inline std::string McapChannel(std::uint16_t id,
                               std::uint16_t schema,
                               const std::string& topic,
                               const std::string& encoding) {
  return McapRecord(4,
                    Little(id) + Little(schema) + Counted32(topic) + Counted32(encoding) + U32(0));
}
inline std::string McapMessage(std::uint16_t channel,
                               std::uint64_t logged,
                               const std::string& data) {
  return McapRecord(5, Little(channel) + U32(9) + Little(logged) + Little(logged + 5) + data);
}
inline std::string McapChunk(const std::string& packing,
                             const std::string& packed,
                             std::size_t unpacked,
                             std::uint32_t crc = 0) {
  return McapRecord(6,
                    Little(std::uint64_t{1}) + Little(std::uint64_t{2}) +
                        Little(std::uint64_t{unpacked}) + Little(crc) + Counted32(packing) +
                        Little(std::uint64_t{packed.size()}) + packed);
}
inline std::string McapDataEnd() { return McapRecord(15, U32(0)); }

}  // namespace plenocal::testing
