// SPDX-License-Identifier: Apache-2.0
//
// Databases of messages, as ROS 2 writes them.
#pragma once

#include <memory>
#include <mutex>
#include <string_view>

#include "engine/recording/messages/message_file.h"

struct sqlite3;
struct sqlite3_blob;

namespace plenocal {

inline constexpr std::string_view kDb3Magic{"SQLite format 3\0", 16};

/// A database of ROS 2 (rosbag2_storage_sqlite3), read by SQLite. Messages that rosbag2 has packed
/// one by one with zstd are unpacked.
class Db3File : public MessageFile {
 public:
  explicit Db3File(const std::filesystem::path& path);
  ~Db3File() override;
  Db3File(const Db3File&) = delete;
  Db3File& operator=(const Db3File&) = delete;
  [[nodiscard]] SharedBytes Read(const MessageRef& message, size_t most) const override;

 private:
  struct CloseDatabase {
    void operator()(sqlite3* database) const;
  };
  struct CloseBlob {
    void operator()(sqlite3_blob* blob) const;
  };
  void ReadTopics();
  void ReadMessages();
  /// The bytes of a row, at most `most`; nothing when the row is damaged.
  [[nodiscard]] std::optional<ByteVector> Content(std::int64_t row, std::size_t most) const;
  [[nodiscard]] std::string Reason() const;

  std::filesystem::path path_;
  std::unique_ptr<sqlite3, CloseDatabase> database_;
  mutable std::unique_ptr<sqlite3_blob, CloseBlob> blob_;  // of one row after the other
  mutable std::mutex mutex_;                               // the database reads for one at a time
  std::vector<std::pair<std::int64_t, std::uint32_t>> topic_of_id_;
};

}  // namespace plenocal
