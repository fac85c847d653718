// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/word_lines.h"

#include <gmock/gmock.h>

#include <string>
#include <vector>

#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::IsEmpty;

class WordLines : public testing::InTemporaryFolder {
 protected:
  [[nodiscard]] std::vector<WordLine> Lines(const std::string& text) const {
    return ReadWordLines(Write("cameras.txt", text));
  }
};

TEST_F(WordLines, AreThoseWithWordsBeforeAComment) {
  const std::vector<WordLine> lines = Lines("# list\n\n 1 PINHOLE\t640 # px\n2 FOV#480\n   #\n");
  ASSERT_EQ(lines.size(), 2U);
  EXPECT_THAT(lines[0].words, ElementsAre("1", "PINHOLE", "640"));
  EXPECT_THAT(lines[0].where, EndsWith("cameras.txt:3"));
  EXPECT_THAT(lines[1].words, ElementsAre("2", "FOV"));
  EXPECT_THAT(lines[1].where, EndsWith("cameras.txt:4"));
  EXPECT_THAT(testing::RefusalOf([&] { (void)Lines("# none\n"); }),
              EndsWith("cameras.txt: holds no cameras"));
  const std::vector<WordLine> all = ReadAllLines(Write("points.txt", "a # b\n\nc"));
  ASSERT_EQ(all.size(), 3U);
  EXPECT_THAT(all[0].words, ElementsAre("a", "#", "b"));
  EXPECT_THAT(all[1].words, IsEmpty());
  EXPECT_THAT(all[2].where, EndsWith("points.txt:3"));
}

TEST(WordLine, HasNumbersWithinTheirLimits) {
  const WordLine line{"f:2", {"1", "0.5", "-3", "1e3", "nan", "7x", "1000000", "1000001", "inf"}};
  EXPECT_EQ(line.Number(1), 0.5);
  EXPECT_EQ(line.Number(3), 1000);
  EXPECT_EQ(line.Count(0), 1U);
  EXPECT_EQ(line.Pixels(0), 1);
  EXPECT_EQ(line.Pixels(3), 1000);
  EXPECT_EQ(line.Pixels(6), 1'000'000);
  const auto refused = [](const auto& read) { return testing::RefusalOf(read); };
  for (const size_t i : {4, 5, 8}) {
    EXPECT_EQ(refused([&] { (void)line.Number(i); }),
              "f:2: expected a number, found '" + line.words[i] + "'");
  }
  for (const size_t i : {1, 2, 3, 5}) {
    EXPECT_EQ(refused([&] { (void)line.Count(i); }),
              "f:2: expected a whole number, found '" + line.words[i] + "'");
  }
  for (const size_t i : {1, 2, 7}) {
    EXPECT_EQ(refused([&] { (void)line.Pixels(i); }),
              "f:2: expected a number of pixels, found '" + line.words[i] + "'");
  }
  EXPECT_EQ(refused([&] { (void)line.Number(9); }), "f:2: expected more than 9 words");
  const WordLine numbers{"f:1", {"name", "1", "2.5"}};
  EXPECT_THAT(numbers.NumbersFrom(1), ElementsAre(1, 2.5));
  EXPECT_THAT(numbers.NumbersFrom(3), IsEmpty());
}

TEST(BlankSeparated, HasAllDigits) {
  EXPECT_EQ(BlankSeparated(std::vector{1.0, 0.1, -2.5e-7}), "1.0 0.1 -2.5e-07");
}

}  // namespace TEST_FILE
}  // namespace plenocal
