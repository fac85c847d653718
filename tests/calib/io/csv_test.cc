// SPDX-License-Identifier: Apache-2.0
#include "calib/io/csv.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>

#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::StartsWith;

TEST(Csv, FindsColumnsByNameInAnyOrder) {
  CsvReader table("y,note,x\n2,hello,1.5\n4,,-3e2\n", "t.csv");
  EXPECT_THAT(table.Header(), ElementsAre("y", "note", "x"));
  EXPECT_FALSE(table.Find("z"));
  const size_t x = table.Column("x"), y = table.Column("y"), note = table.Column("note");
  ASSERT_TRUE(table.Next());
  EXPECT_EQ(table.Number(x), 1.5);
  EXPECT_EQ(table.Integer(y), 2);
  EXPECT_EQ(table.Text(note), "hello");
  ASSERT_TRUE(table.Next());
  EXPECT_EQ(table.Number(x), -300);
  EXPECT_EQ(table.Text(note), "");
  EXPECT_FALSE(table.Next());
  EXPECT_FALSE(table.Next()) << "the end stays the end";
}

TEST(Csv, SkipsEmptyLinesCommentsBlanksAndTheByteOrderMark) {
  CsvReader table("\xEF\xBB\xBF# made by hand\r\n\r\na , b\r\n\n 1\t, 2 \r\n#3,4\r\n5,6", "t.csv");
  ASSERT_TRUE(table.Next());
  EXPECT_EQ(table.Line(), 5);
  EXPECT_EQ(table.Integer(0), 1);
  EXPECT_EQ(table.Integer(1), 2);
  ASSERT_TRUE(table.Next()) << "a last line without its end";
  EXPECT_EQ(table.Line(), 7);
  EXPECT_EQ(table.Integer(1), 6);
  EXPECT_FALSE(table.Next());
}

TEST(Csv, ReadsCellsInQuotationMarks) {
  const std::string text = "\"a\", b\n\"1,5\" , \"say \"\"hi\"\"\"\n\" x \",\"\"\n";
  CsvReader table(text, "t.csv");
  EXPECT_THAT(table.Header(), ElementsAre("a", "b"));
  ASSERT_TRUE(table.Next());
  EXPECT_EQ(table.Text(0), "1,5");
  EXPECT_EQ(table.Text(1), "say \"hi\"");
  EXPECT_EQ(testing::RefusalOf([&] { (void)table.Number(0); }),
            "t.csv:2:2: a: expected a number, found '1,5'");
  EXPECT_THAT(testing::RefusalOf([&] { (void)table.Number(1); }),
              StartsWith("t.csv:2:1: b: expected a number"));
  ASSERT_TRUE(table.Next());
  EXPECT_EQ(table.Text(0), " x ");
  EXPECT_EQ(table.Text(1), "");
  for (const char* bad : {"\"1,2\n", "\"1\"x,2\n", "\"1\"\",2\n"}) {
    const std::string broken = std::string("a,b\n") + bad;
    EXPECT_THAT(testing::RefusalOf([&] {
                  CsvReader reader(broken, "t.csv");
                  reader.Next();
                }),
                StartsWith("t.csv:2: a cell in quotation marks does not end with one"));
  }
}

TEST(Csv, NamesFileLineAndColumnOfABadCell) {
  const std::string text = "a,b\n1,2\n 3, four\n";
  CsvReader table(text, "d/t.csv");
  ASSERT_TRUE(table.Next());
  ASSERT_TRUE(table.Next());
  EXPECT_EQ(testing::RefusalOf([&] { (void)table.Number(1); }),
            "d/t.csv:3:5: b: expected a number, found 'four'");
  EXPECT_EQ(testing::RefusalOf([&] { (void)table.Integer(1); }),
            "d/t.csv:3:5: b: expected a whole number, found 'four'");
  EXPECT_EQ(testing::RefusalOf([&] { table.FailAt(0, "too small"); }), "d/t.csv:3:2: a: too small");
  EXPECT_EQ(testing::RefusalOf([&] { table.Fail("is wrong"); }), "d/t.csv:3: is wrong");
  EXPECT_EQ(testing::RefusalOf([&] { table.FailAtLine(2, "is wrong"); }), "d/t.csv:2: is wrong");
}

TEST(Csv, RefusesWhatIsNoFiniteNumber) {
  for (const char* cell : {"nan", "inf", "1e999", "3px", "1 2", "0x10", "", "+1"}) {
    const std::string text = std::string("a,b\n0,") + cell + "\n";
    CsvReader table(text, "t.csv");
    ASSERT_TRUE(table.Next());
    EXPECT_THAT(testing::RefusalOf([&] { (void)table.Number(1); }),
                StartsWith("t.csv:2:3: b: expected a"))
        << cell;
  }
}

TEST(Csv, TakesWholeNumbersHoweverTheyAreWritten) {
  CsvReader table("a,b,c,d\n7,7.0,7e0,7.5\n", "t.csv");
  ASSERT_TRUE(table.Next());
  for (const size_t column : {0, 1, 2}) EXPECT_EQ(table.Integer(column), 7);
  EXPECT_THAT(testing::RefusalOf([&] { (void)table.Integer(3); }), StartsWith("t.csv:2:11: d: "));
}

TEST(Csv, TellsAnEmptyCellFromAZero) {
  CsvReader table("a,b\n0,\n", "t.csv");
  ASSERT_TRUE(table.Next());
  EXPECT_EQ(table.NumberIfAny(0), 0.0);
  EXPECT_EQ(table.NumberIfAny(1), std::nullopt);
}

TEST(Csv, RefusesTablesThatAreCutOffOrAmbiguous) {
  EXPECT_EQ(testing::RefusalOf([] { CsvReader("\n# a comment\n", "t.csv"); }),
            "t.csv:1: expected a header line with the names of the columns, found nothing");
  EXPECT_THAT(testing::RefusalOf([] { CsvReader("a,b,a\n", "t.csv"); }),
              StartsWith("t.csv:1: column 'a' stands in the header twice"));
  EXPECT_EQ(testing::RefusalOf([] { (void)CsvReader("\na,b\n", "t.csv").Column("c"); }),
            "t.csv:2: column 'c' is missing; the header has a,b");
  CsvReader table("a,b\n1,2\n3\n", "t.csv");
  EXPECT_TRUE(table.Next());
  EXPECT_THAT(testing::RefusalOf([&] { table.Next(); }),
              StartsWith("t.csv:3: expected 2 columns as in the header, found 1"));
}

TEST(Csv, ReadsTextWithoutHeaderIntoGivenColumns) {
  CsvReader table("a title\n7 1.5 0.1\n# note\n8 2\n9\n",
                  "t.txt",
                  CsvSyntax::kVnlog,
                  {.names = {"id", "time", "exposure"}, .optional = 1, .skip = 1});
  ASSERT_TRUE(table.Next());
  EXPECT_EQ(table.Line(), 2);
  EXPECT_EQ(table.Number(table.Column("exposure")), 0.1);
  ASSERT_TRUE(table.Next());
  EXPECT_EQ(table.Number(table.Column("time")), 2);
  EXPECT_FALSE(table.NumberIfAny(table.Column("exposure")));
  EXPECT_THAT(testing::RefusalOf([&] { table.Next(); }),
              StartsWith("t.txt:5: expected 3 columns (id,time,exposure), found 1"));
}

TEST(Vnlog, SplitsAtBlanksBelowALegend) {
  CsvReader table(
      "## generated\n#! more\n# filename  x y\nleft/01.png 1.5\t-2\n## note\nb.png - -\n",
      "c.vnl",
      CsvSyntax::kVnlog);
  EXPECT_THAT(table.Header(), ElementsAre("filename", "x", "y"));
  ASSERT_TRUE(table.Next());
  EXPECT_EQ(table.Line(), 4);
  EXPECT_EQ(table.Text(0), "left/01.png");
  EXPECT_EQ(table.Number(2), -2);
  ASSERT_TRUE(table.Next());
  EXPECT_EQ(table.Text(1), "-");
  EXPECT_FALSE(table.Next());
}

TEST(Vnlog, NeedsItsLegendBeforeTheFirstRow) {
  EXPECT_THAT(testing::RefusalOf([] { CsvReader("a.png 1 2\n", "c.vnl", CsvSyntax::kVnlog); }),
              StartsWith("c.vnl:1: expected the header line"));
  EXPECT_THAT(testing::RefusalOf(
                  [] { CsvReader("# a comment\n", "c.vnl", CsvSyntax::kVnlog, "filename"); }),
              StartsWith("c.vnl:1: expected a header line"));
}

TEST(Vnlog, SkipsCommentsBeforeTheLegendOfAKnownFirstColumn) {
  CsvReader table("# made by hand\n# filename x\na 1\n", "c.vnl", CsvSyntax::kVnlog, "filename");
  EXPECT_THAT(table.Header(), ElementsAre("filename", "x"));
  ASSERT_TRUE(table.Next());
  EXPECT_EQ(table.Integer(1), 1);
}

}  // namespace TEST_FILE
}  // namespace plenocal
