// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/messages/chunked_file.h"

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <optional>

#include "calib/base/format_error.h"

namespace plenocal {

void ChunkedFile::ScanFile(std::size_t magic) {
  ByteRange range(file_, magic, file_.Size() - magic);
  Scan(&range, {false, kInFile, magic});
}

void ChunkedFile::ScanChunk(const Chunk& chunk) {
  if (chunk.packing == Packing::kNone) {
    ByteRange range(file_, chunk.offset, chunk.size);
    return Scan(&range, {true, kInFile, chunk.offset});
  }
  if (std::max(chunk.unpacked, chunk.size) > kMostBytes) {
    AddDamage(
        fmt::format("the chunk at byte {} has {} MB, of which at most {} are read; its "
                    "messages are lost",
                    chunk.offset,
                    std::max(chunk.unpacked, chunk.size) >> 20,
                    kMostBytes >> 20));
    return;
  }
  const std::shared_ptr<const ByteVector> bytes = Unpacked(chunk);
  if (!bytes) {
    AddDamage(fmt::format("the chunk at byte {} is damaged; its messages are lost", chunk.offset));
    return;
  }
  chunks_.push_back(chunk);
  ByteRange range{ByteSpan(*bytes)};
  Scan(&range, {true, chunks_.size() - 1, 0});
}

std::shared_ptr<const ByteVector> ChunkedFile::Unpacked(const Chunk& chunk) const {
  ByteVector packed(chunk.size);
  file_.Read(chunk.offset, packed);
  std::optional<ByteVector> bytes = Unpack(chunk.packing, packed, chunk.unpacked, chunk.end);
  if (!bytes) return nullptr;
  if (chunk.end == PackedEnd::kMissing) {
    return std::make_shared<const ByteVector>(std::move(*bytes));
  }
  if (bytes->size() != chunk.unpacked) return nullptr;
  if (chunk.crc != 0 && crc32_z(0, bytes->data(), bytes->size()) != chunk.crc) {
    return nullptr;
  }
  return std::make_shared<const ByteVector>(std::move(*bytes));
}

std::shared_ptr<const ByteVector> ChunkedFile::KeptChunk(std::uint64_t block) const {
  // Threads read images that follow each other: most of them lie in one chunk or two.
  constexpr std::size_t kMostKept = 4;
  const std::lock_guard lock(mutex_);
  const auto found = std::ranges::find(kept_, block, [](const auto& entry) { return entry.first; });
  if (found != kept_.end()) {
    kept_.splice(kept_.begin(), kept_, found);
    return kept_.front().second;
  }
  std::shared_ptr<const ByteVector> bytes = Unpacked(chunks_[block]);
  if (!bytes) {
    throw InputError("{}: the chunk at byte {} has changed while it was read",
                     file_.Path().string(),
                     chunks_[block].offset);
  }
  kept_.emplace_front(block, bytes);
  const auto size = [&] {
    std::uint64_t sum = 0;
    for (const auto& [number, kept] : kept_) sum += kept->size();
    return sum;
  };
  while (kept_.size() > kMostKept || (kept_.size() > 1 && size() > kMostBytes)) kept_.pop_back();
  return bytes;
}

SharedBytes ChunkedFile::Read(const MessageRef& message, size_t most) const {
  const auto size = std::min<std::uint64_t>(message.size, most);
  if (size > kMostBytes) {
    throw InputError("{}: the message at byte {} has {} MB; at most {} are read",
                     file_.Path().string(),
                     message.offset,
                     message.size >> 20,
                     kMostBytes >> 20);
  }
  if (message.block != kInFile) return {KeptChunk(message.block), message.offset, size};
  ByteVector bytes(size);
  file_.Read(message.offset, bytes);
  return SharedBytes(std::move(bytes));
}

}  // namespace plenocal
