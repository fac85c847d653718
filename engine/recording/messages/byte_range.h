// SPDX-License-Identifier: Apache-2.0
//
// Bytes of a file or of the memory, read part by part.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <utility>
#include <vector>

namespace plenocal {

using ByteSpan = std::span<const std::uint8_t>;
using ByteVector = std::vector<std::uint8_t>;

/// Bytes and what holds them: a chunk of many messages is not copied for one.
struct SharedBytes {
  explicit SharedBytes(ByteVector own)
      : owner(std::make_shared<const ByteVector>(std::move(own))), bytes(*owner) {}
  SharedBytes(std::shared_ptr<const ByteVector> all, std::size_t offset, std::size_t size)
      : owner(std::move(all)), bytes(ByteSpan(*owner).subspan(offset, size)) {}

  std::shared_ptr<const ByteVector> owner;
  ByteSpan bytes;
};

/// An input file of any size. Its functions may be called from several threads.
class InputBytes {
 public:
  /// Throws `Error` of kind kInput.
  explicit InputBytes(const std::filesystem::path& path);
  ~InputBytes();
  InputBytes(const InputBytes&) = delete;
  InputBytes& operator=(const InputBytes&) = delete;

  [[nodiscard]] const std::filesystem::path& Path() const { return path_; }
  [[nodiscard]] std::uint64_t Size() const { return size_; }
  /// Fills `out` with the bytes from `offset` on. Throws `Error` where the file ends before.
  void Read(std::uint64_t offset, std::span<std::uint8_t> out) const;

 private:
  std::filesystem::path path_;
  int descriptor_;
  std::uint64_t size_ = 0;
};

/// Part of a file, or bytes in memory.
class ByteRange {
 public:
  explicit ByteRange(ByteSpan memory) : memory_(memory), size_(memory.size()) {}
  ByteRange(const InputBytes& file, std::uint64_t offset, std::uint64_t size)
      : file_(&file), offset_(offset), size_(size) {}

  [[nodiscard]] std::uint64_t Size() const { return size_; }
  /// Bytes [at, at + size), which must lie in the range; they stay until the next call.
  ByteSpan Get(std::uint64_t at, std::size_t size);

 private:
  const InputBytes* file_ = nullptr;  // null: of the memory
  ByteSpan memory_;
  std::uint64_t offset_ = 0, size_ = 0;
  ByteVector buffer_;  // of the file, from buffer_at_ of the range on
  std::uint64_t buffer_at_ = 0;
};

/// The number in the first bytes, the lowest first.
template <typename T>
T LittleEndianAt(ByteSpan bytes, std::size_t at = 0) {
  T value = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i) {
    value = static_cast<T>(value | static_cast<T>(bytes[at + i]) << (8 * i));
  }
  return value;
}

}  // namespace plenocal
