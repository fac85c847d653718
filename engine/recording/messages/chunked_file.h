// SPDX-License-Identifier: Apache-2.0
//
// Files of messages in chunks: what MCAP files and bags of ROS 1 have in common.
#pragma once

#include <cstdint>
#include <filesystem>
#include <list>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "calib/io/input_file.h"
#include "engine/recording/messages/message_file.h"
#include "engine/recording/messages/unpack.h"

namespace plenocal {

/// A file whose messages lie in chunks that may be packed. A few unpacked chunks are kept, so that
/// messages in the order of the file cost one unpacking each.
class ChunkedFile : public MessageFile {
 public:
  explicit ChunkedFile(const std::filesystem::path& path) : file_(path) {}
  [[nodiscard]] SharedBytes Read(const MessageRef& message, size_t most) const override;

 protected:
  struct Chunk {
    std::uint64_t offset = 0, size = 0;  ///< of its packed bytes in the file
    std::uint64_t unpacked = 0;          ///< bytes, by the header of the chunk
    Packing packing{};
    std::uint32_t crc = 0;  ///< of the unpacked bytes; 0: not given
    PackedEnd end = PackedEnd::kNeeded;
  };
  /// `MessageRef::block` of messages outside of chunks or in chunks that are not packed: `offset`
  /// is that in the file.
  static constexpr std::uint64_t kInFile = ~std::uint64_t{0};

  [[nodiscard]] const InputBytes& File() const { return file_; }
  /// A range of records: all of the file, or a chunk.
  struct Place {
    bool in_chunk;
    std::uint64_t block, offset;  ///< of the range
    /// `MessageRef::offset` of what is at `at` in the range.
    [[nodiscard]] std::uint64_t OffsetOf(std::uint64_t at) const {
      return (block == kInFile ? offset : 0) + at;
    }
  };
  /// Reads all records of a range.
  virtual void Scan(ByteRange* range, const Place& place) = 0;
  /// Scans the file behind its first bytes.
  void ScanFile(std::size_t magic);
  /// Scans the records of a chunk, unless it is damaged or unpacks to more than a chunk can be;
  /// then that is noted.
  void ScanChunk(const Chunk& chunk);

 private:
  /// Limit of a message and of a packed chunk: writers make chunks of some MB, one image more where
  /// it is larger than that.
  static constexpr auto kMostBytes = static_cast<std::uint64_t>(InputLimit::kImage);

  [[nodiscard]] std::shared_ptr<const ByteVector> Unpacked(const Chunk& chunk) const;
  [[nodiscard]] std::shared_ptr<const ByteVector> KeptChunk(std::uint64_t block) const;

  InputBytes file_;
  std::vector<Chunk> chunks_;
  mutable std::mutex mutex_;
  /// The latest first.
  mutable std::list<std::pair<std::uint64_t, std::shared_ptr<const ByteVector>>> kept_;
};

}  // namespace plenocal
