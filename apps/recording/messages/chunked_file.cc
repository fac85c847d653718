// SPDX-License-Identifier: Apache-2.0
#include "apps/recording/messages/chunked_file.h"

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>

#include "calib/base/error.h"

namespace plenocal {

std::shared_ptr<const ByteVector> ChunkedFile::Unpacked(const Chunk& chunk) const {
  // Writers make chunks of some MB; of one image more, where it is larger than that.
  constexpr std::uint64_t kMost = std::uint64_t{1} << 30;
  if (chunk.unpacked > kMost || chunk.size > kMost) return nullptr;
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
    throw Error(ErrorKind::kInput,
                fmt::format("{}: the chunk at byte {} has changed while it was read",
                            file_.Path().string(),
                            chunks_[block].offset));
  }
  kept_.emplace_front(block, bytes);
  if (kept_.size() > kMostKept) kept_.pop_back();
  return bytes;
}

ByteVector ChunkedFile::Read(const MessageRef& message, size_t most) const {
  ByteVector bytes(std::min<std::uint64_t>(message.size, most));
  if (message.block == kInFile) {
    file_.Read(message.offset, bytes);
    return bytes;
  }
  const std::shared_ptr<const ByteVector> chunk = KeptChunk(message.block);
  std::ranges::copy(ByteSpan(*chunk).subspan(message.offset, bytes.size()), bytes.begin());
  return bytes;
}

}  // namespace plenocal
