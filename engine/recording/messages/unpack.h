// SPDX-License-Identifier: Apache-2.0
//
// Unpacking of chunks and messages: zstd, lz4, bz2.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "engine/recording/messages/byte_range.h"

namespace plenocal {

/// How parts of recordings are packed.
enum class Packing { kNone, kZstd, kLz4, kBz2 };

/// By its name in MCAP and bags: "", "none", "zstd", "lz4", "bz2"; nothing for another name.
std::optional<Packing> PackingOf(std::string_view name);

/// Treatment of packed bytes whose end is missing: they are refused, or the part before is taken.
enum class PackedEnd { kNeeded, kMissing };

/// The unpacked bytes, at most `most`; nothing when they are damaged or more than that.
std::optional<ByteVector> Unpack(Packing packing,
                                 ByteSpan packed,
                                 std::size_t most,
                                 PackedEnd end = PackedEnd::kNeeded);

/// True for bytes that begin as zstd's do.
bool IsZstd(ByteSpan bytes);

}  // namespace plenocal
