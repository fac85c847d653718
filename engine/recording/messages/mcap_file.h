// SPDX-License-Identifier: Apache-2.0
//
// MCAP files.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "engine/recording/messages/chunked_file.h"

namespace plenocal {

inline constexpr std::string_view kMcapMagic = "\x89MCAP0\r\n";

/// A recording in the format of https://mcap.dev/spec (major version 0). Its records are read from
/// the beginning, so that a file whose end is missing has all that is before.
class McapFile final : public ChunkedFile {
 public:
  explicit McapFile(const std::filesystem::path& path);

 private:
  struct Record {
    std::uint8_t opcode;
    std::uint64_t at, size;  // of its content in the range
  };
  void Scan(ByteRange* range, const Place& place) override;
  /// False after the record that ends the data.
  bool Take(ByteRange* range, const Record& record, const Place& place);
  void TakeSchema(ByteSpan content);
  void TakeChannel(ByteSpan content);
  void TakeMessage(ByteRange* range, const Record& record, const Place& place);
  void TakeChunk(ByteRange* range, const Record& record);

  std::map<std::uint16_t, std::string> schemas_;  // names
  std::map<std::uint16_t, std::uint32_t> topic_of_channel_;
};

}  // namespace plenocal
