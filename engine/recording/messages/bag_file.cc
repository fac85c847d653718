// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/messages/bag_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

namespace plenocal {
namespace {

// Operations of records.
enum : std::uint8_t { kMessageData = 2, kChunkRecord = 5, kConnection = 7 };

constexpr std::size_t kLength = sizeof(std::uint32_t);
constexpr std::size_t kMostOfHeader = std::size_t{1} << 20;
constexpr std::size_t kMostOfConnection = std::size_t{16} << 20;

std::string TextOf(ByteSpan bytes) { return {bytes.begin(), bytes.end()}; }

/// The number of a field of the right length.
template <typename T>
std::optional<T> NumberOf(const std::map<std::string, ByteSpan>& fields, const char* name) {
  const auto found = fields.find(name);
  if (found == fields.end() || found->second.size() != sizeof(T)) return std::nullopt;
  return LittleEndianAt<T>(found->second);
}

std::string FieldText(const std::map<std::string, ByteSpan>& fields, const char* name) {
  const auto found = fields.find(name);
  return found == fields.end() ? std::string() : TextOf(found->second);
}

}  // namespace

BagFile::BagFile(const std::filesystem::path& path) : ChunkedFile(path) {
  ScanFile(kBagMagic.size());
}

BagFile::Fields BagFile::FieldsOf(ByteSpan header) {
  Fields fields;
  while (header.size() >= kLength) {
    const auto length = LittleEndianAt<std::uint32_t>(header);
    header = header.subspan(kLength);
    if (length > header.size()) break;
    const ByteSpan field = header.first(length);
    header = header.subspan(length);
    const auto equal = std::ranges::find(field, '=');
    if (equal == field.end()) break;
    const auto name = static_cast<std::size_t>(equal - field.begin());
    fields[TextOf(field.first(name))] = field.subspan(name + 1);
  }
  return fields;
}

void BagFile::Scan(ByteRange* range, const Place& place) {
  std::uint64_t at = 0;
  const auto note = [&] {
    AddDamage(place.in_chunk
                  ? "a chunk is damaged; its later messages are lost"
                  : fmt::format("is cut off or damaged at byte {} of {}; what was after that is "
                                "lost",
                                place.offset + at,
                                File().Size()));
  };
  while (at < range->Size()) {
    if (range->Size() - at < kLength) return note();
    const auto header_size = LittleEndianAt<std::uint32_t>(range->Get(at, kLength));
    const std::uint64_t data_length = at + kLength + header_size;
    if (header_size > kMostOfHeader || data_length + kLength > range->Size()) return note();
    const auto size = LittleEndianAt<std::uint32_t>(range->Get(data_length, kLength));
    const std::uint64_t data = data_length + kLength;
    const Record record{data, std::min<std::uint64_t>(size, range->Size() - data), size};
    const ByteSpan view = range->Get(at + kLength, header_size);
    const ByteVector header(view.begin(), view.end());
    Take(range, header, record, place);
    if (record.size < record.stated) return note();
    at = record.data + record.size;
  }
}

void BagFile::Take(ByteRange* range, ByteSpan header, const Record& record, const Place& place) {
  const Fields fields = FieldsOf(header);
  const std::optional<std::uint8_t> op = NumberOf<std::uint8_t>(fields, "op");
  if (record.size < record.stated && op != kChunkRecord) return;
  if (op == kConnection) {
    TakeConnection(
        fields, range->Get(record.data, std::min<std::uint64_t>(record.size, kMostOfConnection)));
  } else if (op == kMessageData) {
    TakeMessage(range, fields, record, place);
  } else if (op == kChunkRecord && !place.in_chunk) {
    TakeChunk(fields, record, place);
  }
}

void BagFile::TakeConnection(const Fields& fields, ByteSpan data) {
  const auto connection = NumberOf<std::uint32_t>(fields, "conn");
  if (!connection) return;
  topic_of_connection_[*connection] = TopicIndex(
      FieldText(fields, "topic"), FieldText(FieldsOf(data), "type"), MessageCoding::kRos1);
}

void BagFile::TakeMessage(ByteRange* range,
                          const Fields& fields,
                          const Record& record,
                          const Place& place) {
  const auto connection = NumberOf<std::uint32_t>(fields, "conn");
  const auto time = NumberOf<std::uint64_t>(fields, "time");
  if (!connection || !time) return;
  const auto topic = topic_of_connection_.find(*connection);
  if (topic == topic_of_connection_.end()) return;
  constexpr std::int64_t kSecond = 1'000'000'000;
  const auto seconds = static_cast<std::int64_t>(*time & 0xffffffff);
  const auto nanoseconds = static_cast<std::int64_t>(*time >> 32);
  AddMessage({.topic = topic->second,
              .logged = kSecond * seconds + nanoseconds,
              .block = place.block,
              .offset = place.OffsetOf(record.data),
              .size = record.size},
             range->Get(record.data, std::min<std::uint64_t>(record.size, kStampBytes)));
}

void BagFile::TakeChunk(const Fields& fields, const Record& record, const Place& place) {
  const std::string name = FieldText(fields, "compression");
  const std::optional<Packing> packing = PackingOf(name);
  const auto unpacked = NumberOf<std::uint32_t>(fields, "size");
  if (!packing || !unpacked) {
    AddDamage(
        fmt::format("the chunk at byte {} is packed by '{}', which cannot be unpacked; its "
                    "messages are lost",
                    place.offset + record.data,
                    name.substr(0, 16)));
    return;
  }
  ScanChunk({.offset = place.offset + record.data,
             .size = record.size,
             .unpacked = *unpacked,
             .packing = *packing,
             .end = record.size < record.stated ? PackedEnd::kMissing : PackedEnd::kNeeded});
}

}  // namespace plenocal
