// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/messages/unpack.h"

#include <gmock/gmock.h>

#include "tests/engine/recording/message_bytes.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

struct Packer {
  Packing packing;
  std::string (*pack)(const std::string& text);
};
const Packer kPackers[] = {{Packing::kZstd, &Zstd},
                           {Packing::kLz4, &Lz4},
                           {Packing::kBz2, [](const std::string& text) { return Bz2(text); }}};

/// The unpacked text; "-" when it is refused.
std::string UnpackedText(Packing packing,
                         const std::string& packed,
                         size_t most,
                         PackedEnd end = PackedEnd::kNeeded) {
  const auto bytes = Unpack(packing, BytesOf(packed), most, end);
  return bytes ? TextOfBytes(*bytes) : "-";
}

TEST(Unpack, HasTheNamesOfMcapAndBags) {
  EXPECT_EQ(PackingOf(""), Packing::kNone);
  EXPECT_EQ(PackingOf("none"), Packing::kNone);
  EXPECT_EQ(PackingOf("zstd"), Packing::kZstd);
  EXPECT_EQ(PackingOf("lz4"), Packing::kLz4);
  EXPECT_EQ(PackingOf("bz2"), Packing::kBz2);
  EXPECT_EQ(PackingOf("gzip"), std::nullopt);
}

TEST(Unpack, GivesWhatWasPackedAndNoMoreThanAllowed) {
  constexpr size_t kStep = 1 << 18;  // of memory
  for (const auto& [packing, pack] : kPackers) {
    for (const size_t size : {size_t{1}, size_t{1000}, kStep, 2 * kStep + 9}) {
      const std::string text = Noisy(size / 30) + std::string(size - size / 30, 'x');
      const std::string packed = pack(text);
      EXPECT_TRUE(UnpackedText(packing, packed, size) == text) << size;
      EXPECT_TRUE(UnpackedText(packing, packed, 3 * size) == text) << size;
      EXPECT_TRUE(UnpackedText(packing, packed, size - 1) == "-") << size;
    }
    EXPECT_EQ(UnpackedText(packing, "no packed bytes at all", 1000), "-");
    EXPECT_EQ(UnpackedText(packing, "no packed bytes at all", 1000, PackedEnd::kMissing), "-");
  }
  EXPECT_EQ(UnpackedText(Packing::kNone, "abc", 3), "abc");
  EXPECT_EQ(UnpackedText(Packing::kNone, "abc", 2), "-");
}

TEST(Unpack, OfAMissingEndGivesThePartBeforeWhereThatIsAsked) {
  std::string text;
  for (int block = 0; block < 3; ++block) text += Noisy(100'000);
  for (const auto& [packing, pack] : kPackers) {
    const std::string packed = pack(text);
    for (const double part : {0.4, 0.8}) {
      const std::string cut =
          packed.substr(0, static_cast<size_t>(part * static_cast<double>(packed.size())));
      EXPECT_TRUE(UnpackedText(packing, cut, text.size()) == "-");
      const std::string found = UnpackedText(packing, cut, text.size(), PackedEnd::kMissing);
      EXPECT_TRUE(text.starts_with(found));
      EXPECT_LT(found.size(), text.size());
      // Blocks of bz2 have 100 kB here, those of the others 128 or 64 kB; zstd finds repetitions.
      const bool is_found = found.size() > text.size() / 4;
      EXPECT_TRUE(is_found || part < 0.5 || packing == Packing::kZstd);
    }
    EXPECT_EQ(UnpackedText(packing, "", 10), "-");
    EXPECT_EQ(UnpackedText(packing, "", 10, PackedEnd::kMissing), "");
  }
}

TEST(Unpack, GivesAllWhereOnlyTheMarkOfTheEndIsMissing) {
  const std::string text = Noisy(1000);
  for (const auto& [packing, pack] : kPackers) {
    const std::string packed = pack(text);
    // Zstd's last block has no mark of its own: it is lost with its last byte. That of bz2 has ten.
    const size_t mark = packing == Packing::kLz4 ? 4 : packing == Packing::kBz2 ? 9 : 0;
    const std::string cut = packed.substr(0, packed.size() - mark);
    for (const size_t most : {text.size(), text.size() + 1}) {
      EXPECT_TRUE(UnpackedText(packing, cut, most, PackedEnd::kMissing) == text)
          << static_cast<int>(packing);
      EXPECT_EQ(UnpackedText(packing, cut, most) == "-", mark > 0);
    }
  }
}

TEST(Unpack, OfZstdTakesFramesThatFollowEachOther) {
  EXPECT_EQ(UnpackedText(Packing::kZstd, Zstd("one ") + Zstd("two"), 7), "one two");
  EXPECT_EQ(UnpackedText(Packing::kZstd, Zstd("one ") + Zstd("two"), 6), "-");
}

TEST(Unpack, KnowsZstdByItsFirstFourBytes) {
  EXPECT_TRUE(IsZstd(BytesOf(Zstd("text"))));
  EXPECT_TRUE(IsZstd(BytesOf(Zstd("text").substr(0, 4))));
  EXPECT_FALSE(IsZstd(BytesOf(Zstd("text").substr(0, 3))));
  EXPECT_FALSE(IsZstd(BytesOf(Lz4("text"))));
}

class InputBytesOfFiles : public InTemporaryFolder {};

TEST_F(InputBytesOfFiles, AreReadAnywhere) {
  const std::string text = Noisy(20'000);
  const InputBytes file(Write("some.bin", text));
  EXPECT_EQ(file.Path(), Path("some.bin"));
  EXPECT_EQ(file.Size(), text.size());
  constexpr size_t kFrom = 100, kSize = 19'000;
  ByteRange range(file, kFrom, kSize);
  EXPECT_EQ(range.Size(), kSize);
  const ByteVector bytes = BytesOf(text.substr(kFrom, kSize));
  ByteRange memory{ByteSpan(bytes)};
  EXPECT_EQ(memory.Size(), kSize);
  struct Part {
    size_t at, size;
  };
  for (const auto& [at, size] : {Part{0, 4},
                                 {4092, 4},
                                 {4093, 4},
                                 {10, 1},
                                 {8000, 4096},
                                 {8001, 4096},
                                 {7999, 2},
                                 {12'000, 7000},
                                 {18'990, 10},
                                 {0, kSize}}) {
    const std::string expected = text.substr(kFrom + at, size);
    EXPECT_TRUE(TextOfBytes(range.Get(at, size)) == expected) << at;
    EXPECT_TRUE(TextOfBytes(memory.Get(at, size)) == expected) << at;
  }
  ByteVector last(10);
  EXPECT_EQ(
      RefusalOf([&] { file.Read(19'995, last); }),
      Path("some.bin").string() + ": cannot be read at byte 20000 (it ends there); copy it again");
  EXPECT_EQ(LittleEndianAt<std::uint32_t>(BytesOf("x\x01\x02\x03\x84"), 1), 0x84030201U);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
