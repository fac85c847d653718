// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/messages/unpack.h"

#include <bzlib.h>
#include <lz4frame.h>
#include <zstd.h>

#include <algorithm>
#include <memory>

namespace plenocal {
namespace {

/// Unpacked bytes, for which memory grows with what is really there: sizes in files may be wrong.
class Growing {
 public:
  explicit Growing(std::size_t most) : most_(most) {}

  /// Room for more bytes; empty when there are as many as there may be.
  std::span<std::uint8_t> Room() {
    constexpr std::size_t kStep = 1 << 18;
    const std::size_t room = std::min(most_ - used_, std::max(used_, kStep));
    bytes_.reserve(used_ + room);  // before `resize`, which would fill the new bytes beside the old
    if (bytes_.size() < used_ + room) bytes_.resize(used_ + room);
    return std::span(bytes_).subspan(used_, room);
  }
  void Add(std::size_t count) { used_ += count; }
  ByteVector Take() {
    bytes_.resize(used_);
    return std::move(bytes_);
  }

 private:
  ByteVector bytes_;
  std::size_t used_ = 0, most_;
};

/// The result where the packed bytes end before they should.
std::optional<ByteVector> AtEnd(PackedEnd end, Growing* out) {
  if (end == PackedEnd::kNeeded) return std::nullopt;
  return out->Take();
}

std::optional<ByteVector> UnpackZstd(ByteSpan packed, std::size_t most, PackedEnd end) {
  const std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context(ZSTD_createDCtx(),
                                                                     ZSTD_freeDCtx);
  Growing out(most);
  ZSTD_inBuffer in{packed.data(), packed.size(), 0};
  for (;;) {
    const std::span<std::uint8_t> room = out.Room();
    ZSTD_outBuffer to{room.data(), room.size(), 0};
    const std::size_t left = ZSTD_decompressStream(context.get(), &to, &in);
    if (ZSTD_isError(left) != 0U) return std::nullopt;
    out.Add(to.pos);
    if (left == 0 && in.pos == in.size) return out.Take();
    const bool is_idle = to.pos < to.size || room.empty();
    if (is_idle && in.pos == in.size) return AtEnd(end, &out);
    if (room.empty()) return std::nullopt;
  }
}

std::optional<ByteVector> UnpackLz4(ByteSpan packed, std::size_t most, PackedEnd end) {
  LZ4F_dctx* created = nullptr;
  if (LZ4F_isError(LZ4F_createDecompressionContext(&created, LZ4F_VERSION)) != 0U) {
    return std::nullopt;
  }
  const std::unique_ptr<LZ4F_dctx, decltype(&LZ4F_freeDecompressionContext)> context(
      created, LZ4F_freeDecompressionContext);
  Growing out(most);
  for (;;) {
    const std::span<std::uint8_t> room = out.Room();
    std::size_t written = room.size(), taken = packed.size();
    const std::size_t left =
        LZ4F_decompress(context.get(), room.data(), &written, packed.data(), &taken, nullptr);
    if (LZ4F_isError(left) != 0U) return std::nullopt;
    out.Add(written);
    packed = packed.subspan(taken);
    if (left == 0) return out.Take();
    const bool is_idle = written < room.size() || room.empty();
    if (is_idle && packed.empty()) return AtEnd(end, &out);
    if (written == 0 && taken == 0) return std::nullopt;  // more than there may be
  }
}

std::optional<ByteVector> UnpackBz2(ByteSpan packed, std::size_t most, PackedEnd end) {
  bz_stream stream{};
  if (BZ2_bzDecompressInit(&stream, 0, 0) != BZ_OK) return std::nullopt;
  const std::unique_ptr<bz_stream, decltype(&BZ2_bzDecompressEnd)> ended(&stream,
                                                                         BZ2_bzDecompressEnd);
  stream.next_in = const_cast<char*>(reinterpret_cast<const char*>(packed.data()));
  stream.avail_in = static_cast<unsigned>(packed.size());
  Growing out(most);
  for (;;) {
    const std::span<std::uint8_t> room = out.Room();
    stream.next_out = reinterpret_cast<char*>(room.data());
    stream.avail_out = static_cast<unsigned>(room.size());
    const int status = BZ2_bzDecompress(&stream);
    const std::size_t written = room.size() - stream.avail_out;
    out.Add(written);
    if (status == BZ_STREAM_END) return out.Take();
    if (status != BZ_OK) return std::nullopt;
    const bool is_idle = written < room.size() || room.empty();
    if (is_idle && stream.avail_in == 0) return AtEnd(end, &out);
    if (room.empty()) return std::nullopt;
  }
}

}  // namespace

std::optional<Packing> PackingOf(std::string_view name) {
  if (name.empty() || name == "none") return Packing::kNone;
  if (name == "zstd") return Packing::kZstd;
  if (name == "lz4") return Packing::kLz4;
  if (name == "bz2") return Packing::kBz2;
  return std::nullopt;
}

std::optional<ByteVector> Unpack(Packing packing,
                                 ByteSpan packed,
                                 std::size_t most,
                                 PackedEnd end) {
  switch (packing) {
    case Packing::kZstd:
      return UnpackZstd(packed, most, end);
    case Packing::kLz4:
      return UnpackLz4(packed, most, end);
    case Packing::kBz2:
      return UnpackBz2(packed, most, end);
    case Packing::kNone:
      break;
  }
  if (packed.size() > most) return std::nullopt;
  return ByteVector(packed.begin(), packed.end());
}

bool IsZstd(ByteSpan bytes) {
  return bytes.size() >= sizeof(std::uint32_t) &&
         LittleEndianAt<std::uint32_t>(bytes) == ZSTD_MAGICNUMBER;
}

}  // namespace plenocal
