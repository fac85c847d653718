// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/messages/mcap_file.h"

#include <fmt/format.h>

#include <algorithm>

namespace plenocal {
namespace {

// Opcodes of records.
enum : std::uint8_t { kSchema = 3, kChannel = 4, kMessage = 5, kChunk = 6, kDataEnd = 15 };

constexpr std::size_t kRecordHeader = 9;    // opcode and size of the content
constexpr std::size_t kMessageHeader = 22;  // channel, sequence, times of log and publication
constexpr std::size_t kMostOfSchema = std::size_t{16} << 20;

/// Takes the fields of a record; after its end they are empty, and `good` is false.
struct Fields {
  ByteSpan rest;
  bool good = true;

  ByteSpan Bytes(std::uint64_t count) {
    if (count > rest.size()) good = false;
    const ByteSpan taken = rest.first(good ? count : 0);
    rest = rest.subspan(taken.size());
    return taken;
  }
  template <typename T>
  T Number() {
    const ByteSpan bytes = Bytes(sizeof(T));
    return good ? LittleEndianAt<T>(bytes) : T(0);
  }
  std::string Text() {
    const ByteSpan bytes = Bytes(Number<std::uint32_t>());
    return {bytes.begin(), bytes.end()};
  }
};

}  // namespace

McapFile::McapFile(const std::filesystem::path& path) : ChunkedFile(path) {
  ScanFile(kMcapMagic.size());
}

void McapFile::Scan(ByteRange* range, const Place& place) {
  std::uint64_t at = 0;
  const auto note = [&](const char* what) {
    AddDamage(place.in_chunk ? fmt::format("{} in a chunk; its later messages are lost", what)
                             : fmt::format("{} at byte {} of {}; what was after that is lost",
                                           what,
                                           place.offset + at,
                                           File().Size()));
  };
  while (at < range->Size()) {
    if (range->Size() - at < kRecordHeader) return note("is cut off");
    const ByteSpan header = range->Get(at, kRecordHeader);
    const Record record{header[0], at + kRecordHeader, LittleEndianAt<std::uint64_t>(header, 1)};
    if (record.opcode == 0) return note("is damaged");
    if (record.size > range->Size() - record.at) {
      if (record.opcode == kChunk && !place.in_chunk) TakeChunk(range, record);
      return note("is cut off");
    }
    if (!Take(range, record, place)) return;
    at = record.at + record.size;
  }
  if (!place.in_chunk) note("ends without an end of data");
}

bool McapFile::Take(ByteRange* range, const Record& record, const Place& place) {
  switch (record.opcode) {
    case kSchema:
      TakeSchema(range->Get(record.at, std::min<std::uint64_t>(record.size, kMostOfSchema)));
      break;
    case kChannel:
      TakeChannel(range->Get(record.at, std::min<std::uint64_t>(record.size, kMostOfSchema)));
      break;
    case kMessage:
      TakeMessage(range, record, place);
      break;
    case kChunk:
      if (!place.in_chunk) TakeChunk(range, record);
      break;
    case kDataEnd:
      return place.in_chunk;
    default:
      break;
  }
  return true;
}

void McapFile::TakeSchema(ByteSpan content) {
  Fields fields{content};
  const auto id = fields.Number<std::uint16_t>();
  std::string name = fields.Text();
  if (fields.good) schemas_[id] = std::move(name);
}

void McapFile::TakeChannel(ByteSpan content) {
  Fields fields{content};
  const auto id = fields.Number<std::uint16_t>(), schema = fields.Number<std::uint16_t>();
  const std::string topic = fields.Text(), encoding = fields.Text();
  if (!fields.good) return;
  topic_of_channel_[id] = TopicIndex(topic, schemas_[schema], CodingOfName(encoding));
}

void McapFile::TakeMessage(ByteRange* range, const Record& record, const Place& place) {
  if (record.size < kMessageHeader) return;
  const std::uint64_t start = std::min<std::uint64_t>(record.size, kMessageHeader + kStampBytes);
  Fields fields{range->Get(record.at, start)};
  const auto channel = fields.Number<std::uint16_t>();
  fields.Number<std::uint32_t>();  // sequence
  const auto logged = fields.Number<std::uint64_t>();
  fields.Number<std::uint64_t>();  // time of publication
  const auto topic = topic_of_channel_.find(channel);
  if (topic == topic_of_channel_.end()) return;
  AddMessage({.topic = topic->second,
              .logged = static_cast<std::int64_t>(logged),
              .block = place.block,
              .offset = place.OffsetOf(record.at + kMessageHeader),
              .size = record.size - kMessageHeader},
             fields.rest);
}

void McapFile::TakeChunk(ByteRange* range, const Record& record) {
  // Times, sizes, checksum, the packing's name, the size of the packed records.
  constexpr std::size_t kMostOfHeader = 64;
  const std::uint64_t there = std::min(record.size, range->Size() - record.at);
  Fields fields{range->Get(record.at, std::min<std::uint64_t>(there, kMostOfHeader))};
  const std::size_t all = fields.rest.size();
  fields.Number<std::uint64_t>();
  fields.Number<std::uint64_t>();
  Chunk chunk;
  chunk.unpacked = fields.Number<std::uint64_t>();
  chunk.crc = fields.Number<std::uint32_t>();
  const std::string name = fields.Text();
  chunk.size = fields.Number<std::uint64_t>();
  const std::uint64_t header = all - fields.rest.size();
  const std::uint64_t place = kMcapMagic.size() + record.at;  // in the file
  chunk.offset = place + header;
  const std::optional<Packing> packing = PackingOf(name);
  if (there < record.size && fields.good) {
    chunk.size = std::min(chunk.size, there - header);
    chunk.end = PackedEnd::kMissing;
  }
  if (!fields.good || chunk.size > record.size - header) {
    AddDamage(fmt::format("the chunk at byte {} is damaged; its messages are lost", place));
    return;
  }
  if (!packing) {
    AddDamage(
        fmt::format("the chunk at byte {} is packed by '{}', which cannot be unpacked; "
                    "record with zstd, lz4 or none",
                    place,
                    name.substr(0, 16)));
    return;
  }
  chunk.packing = *packing;
  ScanChunk(chunk);
}

}  // namespace plenocal
