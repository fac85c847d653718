// SPDX-License-Identifier: Apache-2.0
#include "calib/io/result_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "calib/base/error.h"
#include "calib/base/quoted_text.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;

std::string MessageOf(const std::string& name, const std::string& content) {
  return testing::RefusalOf([&] { RefuseNan(name, content); }, ErrorKind::kJob);
}

TEST(ResultText, WithANumberThatIsNoneIsRefusedWithItsPlace) {
  EXPECT_THAT(MessageOf("a.yaml", "plenocal: 1\nmarkers:\n  3: [0, -nan, 0]\n"),
              HasSubstr("a.yaml:3: a result is no number: '  3: [0, -nan, 0]'"));
  EXPECT_THAT(MessageOf("a.yaml", "x: .nan"), HasSubstr("a.yaml:1: "));
  EXPECT_THAT(MessageOf("a.yaml", "{a: \"b\", x: nan}"), HasSubstr("a.yaml:1: "));
  EXPECT_THAT(MessageOf("a.csv", "frame,x\n0001,2\n0002,nan\n"), HasSubstr("a.csv:3: "));
  EXPECT_THAT(MessageOf("a.csv", "nan,1"), HasSubstr("a.csv:1: "));
  EXPECT_THAT(MessageOf("a.txt", "1.5 0 -nan 1\n"), HasSubstr("a.txt:1: "));
}

TEST(ResultText, WithInfiniteNumbersAndAnyNamesIsWritten) {
  for (const char* text :
       {"sigma: [.inf, -.inf]\n",
        "\"nan\": {what: \"the \\\"nan\\\" of a nan b\", name: banana, x: nano}\n",
        ""}) {
    EXPECT_EQ(MessageOf("a.yaml", text), "no refusal") << text;
  }
  EXPECT_EQ(MessageOf("a.csv", CsvCell("nan") + ",a nan b," + CsvCell("1,nan") + ",inf\n"),
            "no refusal");
  EXPECT_EQ(MessageOf("a.svg", "<path d=\"nan nan\"/>"), "no refusal");
}

}  // namespace TEST_FILE
}  // namespace plenocal
