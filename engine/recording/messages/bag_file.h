// SPDX-License-Identifier: Apache-2.0
//
// Bags of ROS 1.
#pragma once

#include <map>
#include <string>
#include <string_view>

#include "engine/recording/messages/chunked_file.h"

namespace plenocal {

inline constexpr std::string_view kBagMagic = "#ROSBAG V2.0\n";

/// A bag of ROS 1 (http://wiki.ros.org/Bags/Format/2.0). Its records are read from the beginning
/// and not by its index, so that a bag whose recording was interrupted has all that was written.
///
/// Debian's librosbag-storage is not used: it opens no bag without an index, and needs 16 shared
/// libraries (ROS, TLS, GPG).
class BagFile final : public ChunkedFile {
 public:
  explicit BagFile(const std::filesystem::path& path);

 private:
  using Fields = std::map<std::string, ByteSpan>;
  struct Record {
    std::uint64_t data, size;  // of its data in the range, as far as they are there
    std::uint64_t stated;      // the size that it should have
  };
  void Scan(ByteRange* range, const Place& place) override;
  /// `header` are the bytes that the fields of `Take` point into.
  void Take(ByteRange* range, ByteSpan header, const Record& record, const Place& place);
  void TakeConnection(const Fields& fields, ByteSpan data);
  void TakeMessage(ByteRange* range,
                   const Fields& fields,
                   const Record& record,
                   const Place& place);
  void TakeChunk(const Fields& fields, const Record& record, const Place& place);
  /// The fields of a header; those before its damage.
  static Fields FieldsOf(ByteSpan header);

  std::map<std::uint32_t, std::uint32_t> topic_of_connection_;
};

}  // namespace plenocal
