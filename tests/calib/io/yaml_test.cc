// SPDX-License-Identifier: Apache-2.0
#include "calib/io/yaml.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <locale>
#include <string>
#include <string_view>
#include <vector>

#include "calib/base/error.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

// The message of the Error that `job` throws; it must be one line and blame the input.
template <typename Job>
std::string MessageOf(const Job& job) {
  const std::string message = testing::RefusalOf([&] { (void)job(); });
  EXPECT_THAT(message, ::testing::Not(::testing::HasSubstr("\n")));
  return message;
}

std::string ParseError(const std::string& text) {
  return MessageOf([&] { return YamlNode::Parse(text, "t.yaml"); });
}

// The message about `key: value` when it is read as a number.
std::string NumberError(const std::string& value) {
  return MessageOf(
      [&] { return YamlNode::Parse("size: " + value, "t.yaml").At("size").AsNumber(); });
}

double Number(const std::string& value) {
  return YamlNode::Parse("size: " + value, "t.yaml").At("size").AsNumber();
}

TEST(NearestName, FindsMisspeltNamesWhateverTheirCase) {
  constexpr std::string_view kKnown[] = {"chessboard", "charuco", "circles"};
  EXPECT_EQ(NearestName("chesboard", kKnown), "chessboard");
  EXPECT_EQ(NearestName("CHARUCO", kKnown), "charuco");
  EXPECT_EQ(NearestName("cricle", kKnown), "circles");
  EXPECT_EQ(NearestName("xyzzy", kKnown), "");
  EXPECT_EQ(NearestName("", kKnown), "");
  EXPECT_EQ(NearestName(std::string(100000, 'c'), kKnown), "");
}

TEST(NearestName, CountsSwappedLettersAsOneEdit) {
  constexpr std::string_view kKnown[] = {"ab"};
  EXPECT_EQ(NearestName("ba", kKnown), "ab");
}

TEST(NearestName, PrefersTheSameBeginningOfEquallyNearNames) {
  constexpr std::string_view kKnown[] = {"tagSize", "tagSpacing"};
  EXPECT_EQ(NearestName("tagSpace", kKnown), "tagSpacing");
}

TEST(SuggestName, GivesTheNearestNameOrAllOfThem) {
  constexpr std::string_view kKnown[] = {"huber", "cauchy"};
  EXPECT_EQ(SuggestName("hubert", kKnown), "; did you mean 'huber'?");
  EXPECT_EQ(SuggestName("l2", kKnown), "; known: huber, cauchy");
  EXPECT_EQ(SuggestName("l2", {}), "");
}

TEST(Yaml, ReadsNumbersInEveryUsualNotation) {
  EXPECT_EQ(Number("0.088"), 0.088);
  EXPECT_EQ(Number("+5.5e-6"), 5.5e-6);
  EXPECT_EQ(Number("-7"), -7);
  EXPECT_EQ(Number(".5"), 0.5);
  EXPECT_EQ(Number("1E3"), 1000);
  EXPECT_EQ(Number("'0.25'"), 0.25);
}

TEST(Yaml, ReadsNumbersInALocaleWithDecimalComma) {
  // A locale of our own, since the machine may have none but "C".
  struct DecimalComma : std::numpunct<char> {
    [[nodiscard]] char do_decimal_point() const override { return ','; }
  };
  const std::locale before = std::locale::global(std::locale(std::locale(), new DecimalComma));
  EXPECT_EQ(Number("0.088"), 0.088);
  EXPECT_THAT(NumberError("88mm"), HasSubstr("write 0.088 "));
  std::locale::global(before);
}

TEST(Yaml, TellsTheBareNumberForOneWithAUnit) {
  EXPECT_THAT(NumberError("0.088m"),
              StartsWith("t.yaml:1:7: size: expected a finite number, got '0.088m'; write 0.088 "));
  EXPECT_THAT(NumberError("88mm"), HasSubstr("got '88mm'; write 0.088 (metres)"));
  EXPECT_THAT(NumberError("8.8 cm"), HasSubstr("write 0.088 (metres)"));
  EXPECT_THAT(NumberError("5.5µm"), HasSubstr("write 5.5e-06 (metres)"));
  EXPECT_THAT(NumberError("30deg"), HasSubstr("write 0.523598776 (radians)"));
  EXPECT_THAT(NumberError("30°"), HasSubstr("write 0.523598776 (radians)"));
  EXPECT_THAT(NumberError("0,088"), HasSubstr("got '0,088'; write 0.088"));
}

TEST(Yaml, RefusesWhatIsNoFiniteNumber) {
  for (const char* value : {".nan",
                            ".inf",
                            "-.inf",
                            "nan",
                            "inf",
                            "infinity",
                            "1e999",
                            "0x10",
                            "1_000",
                            "+-5",
                            "++5",
                            "5 5",
                            "five",
                            "''",
                            "[1]",
                            "{a: 1}",
                            ""}) {
    EXPECT_THAT(NumberError(value), HasSubstr("size: expected a finite number, got ")) << value;
  }
  EXPECT_THAT(NumberError(""), HasSubstr("got nothing; write one such as 0.05"));
}

TEST(Yaml, RefusesLengthsThatAreNotPositive) {
  const YamlNode node = YamlNode::Parse("a: 0\nb: -0.1\nc: 3 ft\nd: 0.1", "t.yaml");
  EXPECT_THAT(
      MessageOf([&] { return node.At("a").AsPositive(); }),
      HasSubstr("t.yaml:1:4: a: expected a positive number, got '0'; write a number above"));
  EXPECT_THAT(MessageOf([&] { return node.At("b").AsLength(); }),
              HasSubstr("t.yaml:2:4: b: expected a length in metres or with its unit, got '-0.1'"));
  EXPECT_THAT(MessageOf([&] { return node.At("c").AsLength(); }),
              HasSubstr("got '3 ft'; write one such as 0.05 or 50 mm"));
  EXPECT_EQ(node.At("d").AsLength(), 0.1);
}

TEST(Yaml, ReadsLengthsWithTheirUnits) {
  const YamlNode node = YamlNode::Parse(
      "[36 mm, 36mm, 2.5cm, 1 in, 1 inch, 5.5 um, 5.5\u00b5m, 0.5 m, 550 nm, 0.036]", "t.yaml");
  std::vector<double> lengths;
  for (const YamlNode& each : node.Elements()) lengths.push_back(each.AsLength());
  EXPECT_EQ(lengths,
            (std::vector{0.036, 0.036, 0.025, 0.0254, 0.0254, 5.5e-6, 5.5e-6, 0.5, 5.5e-7, 0.036}));
  EXPECT_EQ(YamlNode::Parse("[-1 mm, 0, 0.2]", "t.yaml").AsSignedLengths(3),
            (std::vector{-0.001, 0.0, 0.2}));
  EXPECT_THAT(MessageOf([] { (void)YamlNode::Parse("[1, 2]", "t.yaml").AsSignedLengths(3); }),
              HasSubstr("expected 3 lengths, got a list of 2"));
}

TEST(Yaml, ReadsWholeNumbersOnly) {
  const YamlNode node = YamlNode::Parse("[6, +6, 6.4, 3000000000, six, -2]", "t.yaml");
  const std::vector<YamlNode> values = node.Elements();
  EXPECT_EQ(values[0].AsInteger(), 6);
  EXPECT_EQ(values[1].AsInteger(), 6);
  EXPECT_EQ(values[5].AsInteger(), -2);
  EXPECT_THAT(MessageOf([&] { return values[2].AsInteger(); }),
              HasSubstr("[2]: expected a whole number, got '6.4'; write 6"));
  EXPECT_THAT(MessageOf([&] { return values[3].AsInteger(); }), HasSubstr("at most 2147483647"));
  EXPECT_THAT(MessageOf([&] { return values[4].AsInteger(); }),
              HasSubstr("got 'six'; write one such as"));
}

TEST(Yaml, ReadsTrueAndFalseOnly) {
  const YamlNode node = YamlNode::Parse("[true, False, yes, 0, maybe]", "t.yaml");
  const std::vector<YamlNode> values = node.Elements();
  EXPECT_TRUE(values[0].AsBool());
  EXPECT_FALSE(values[1].AsBool());
  EXPECT_THAT(MessageOf([&] { return values[2].AsBool(); }),
              HasSubstr("expected true or false, got 'yes'; write true"));
  EXPECT_THAT(MessageOf([&] { return values[3].AsBool(); }), HasSubstr("write false"));
  EXPECT_THAT(MessageOf([&] { return values[4].AsBool(); }), HasSubstr("write one"));
}

TEST(Yaml, ReadsListsOfNumbersOfTheRightLength) {
  const YamlNode node = YamlNode::Parse("a: [1, 2, 3]\nb: [1, x]\nc: 5\nd: []", "t.yaml");
  EXPECT_EQ(node.At("a").AsNumbers(3), (std::vector<double>{1, 2, 3}));
  EXPECT_EQ(node.At("a").AsNumbers(0).size(), 3u);
  EXPECT_TRUE(node.At("d").AsNumbers(0).empty());
  EXPECT_THAT(MessageOf([&] { return node.At("a").AsNumbers(2); }),
              HasSubstr("t.yaml:1:4: a: expected 2 numbers, got a list of 3; write ["));
  EXPECT_THAT(MessageOf([&] { return node.At("b").AsNumbers(2); }),
              HasSubstr("t.yaml:2:8: b[1]: expected a finite number, got 'x'"));
  EXPECT_THAT(MessageOf([&] { return node.At("c").AsNumbers(0); }),
              HasSubstr("c: expected a list of numbers, got '5'"));
}

TEST(Yaml, KeepsTheOrderOfTheFile) {
  const auto entries = YamlNode::Parse("z: 1\na: 2\nm: 3", "t.yaml").Entries();
  ASSERT_EQ(entries.size(), 3u);
  EXPECT_EQ(entries[0].first, "z");
  EXPECT_EQ(entries[2].second.AsInteger(), 3);
}

TEST(Yaml, RefusesAValueOfAnotherKind) {
  const YamlNode node = YamlNode::Parse("number: 1\nlist: [1, 2]\nmap: {a: 1}", "t.yaml");
  const auto refused = [](const auto& read) { return MessageOf([&] { (void)read(); }); };
  for (const char* key : {"number", "list"}) {
    EXPECT_THAT(refused([&] { return node.At(key).Entries(); }),
                HasSubstr(std::string(key) + ": expected a map"));
  }
  for (const char* key : {"number", "map"}) {
    EXPECT_THAT(refused([&] { return node.At(key).Elements(); }),
                HasSubstr(std::string(key) + ": expected a list"));
  }
  for (const char* key : {"list", "map"}) {
    EXPECT_THAT(refused([&] { return node.At(key).AsString(); }),
                HasSubstr(std::string(key) + ": expected a name or text"));
  }
}

TEST(Yaml, RefusesEqualKeysAndNamesBothLines) {
  EXPECT_THAT(ParseError("a: 1\nb: 2\na: 3"),
              StartsWith("t.yaml:3:1: a: this key stands in line 1 already; remove one"));
  EXPECT_THAT(ParseError("cameras:\n  - {x: 1}\n  - {x: 1, y: 2,\n     x: 3}"),
              StartsWith("t.yaml:4:6: cameras[1].x: this key stands in line 3 already"));
}

TEST(Yaml, RefusesUnknownKeysAndNamesTheNearest) {
  const YamlNode node = YamlNode::Parse("cam:\n  sqare: 1\n", "t.yaml");
  EXPECT_THAT(MessageOf([&] {
                node.At("cam").CheckKeys({"square", "rows"});
              }),
              StartsWith("t.yaml:2:3: cam.sqare: unknown key; did you mean 'square'?"));
  EXPECT_THAT(MessageOf([&] { return node.CheckKeys({"xyzzy"}); }), HasSubstr("known: xyzzy"));
  node.CheckKeys({"cam"});
}

TEST(Yaml, NamesAMissingKey) {
  EXPECT_THAT(MessageOf([] { return YamlNode::Parse("a:\n  b: 1", "t.yaml").At("a").At("size"); }),
              StartsWith("t.yaml:2:3: a.size: this key is missing; add 'size: ...'"));
  EXPECT_THAT(
      MessageOf([] { return YamlNode::Parse("a:\n  sise: 1", "t.yaml").At("a").At("size"); }),
      StartsWith(
          "t.yaml:2:3: a.size: this key is missing; add 'size: ...' (is 'sise' meant for it?)"));
  EXPECT_THAT(MessageOf([] { return YamlNode::Parse("just text", "t.yaml").At("size"); }),
              HasSubstr("expected a map with the key 'size', got 'just text'"));
}

TEST(Yaml, NamesAllMissingKeysWithAnExample) {
  const YamlNode node = YamlNode::Parse("cam:\n  b: 1", "t.yaml").At("cam");
  constexpr std::array<std::string_view, 3> kKeys{"a", "b", "c"};
  EXPECT_THAT(MessageOf([&] { node.RequireKeys(kKeys, "a: 7\nc: x.png\n"); }),
              StartsWith("t.yaml:2:3: cam: these keys are missing: a, c; add, for example, 'a: 7', "
                         "'c: x.png'"));
  constexpr std::array<std::string_view, 2> kOne{"b", "c"};
  EXPECT_THAT(MessageOf([&] { node.RequireKeys(kOne, "c: x.png\n"); }),
              StartsWith("t.yaml:2:3: cam.c: this key is missing; add, for example, 'c: x.png'"));
  constexpr std::array<std::string_view, 1> kNone{"b"};
  node.RequireKeys(kNone, "");
}

TEST(Yaml, SuggestsAKeyThatResemblesAMissingOne) {
  const YamlNode node = YamlNode::Parse("modle: pinhole", "t.yaml");
  const std::array<std::string_view, 2> keys{"model", "images"};
  EXPECT_THAT(MessageOf([&] { node.RequireKeys(keys, ""); }),
              HasSubstr("model (is 'modle' meant for it?), images"));
  EXPECT_THAT(
      MessageOf([&] { node.RequireKeys(std::span(keys).first(1), ""); }),
      HasSubstr(
          "model: this key is missing; add, for example, 'model: ...' (is 'modle' meant for it?)"));
}

TEST(Yaml, PlacesAnEmptyValueAtItsKey) {
  const YamlNode node = YamlNode::Parse("a: 1\nsize:\n\n\nb: 2", "t.yaml");
  EXPECT_THAT(
      MessageOf([&] { return node.At("size").AsLength(); }),
      StartsWith("t.yaml:2:1: size: expected a length in metres or with its unit, got nothing"));
}

TEST(Yaml, ChecksTheVersion) {
  YamlNode::Parse("plenocal: 1", "t.yaml").CheckVersion();
  EXPECT_THAT(MessageOf([] { return YamlNode::Parse("a: 1", "t.yaml").CheckVersion(); }),
              HasSubstr("start it with 'plenocal: 1'"));
  EXPECT_THAT(MessageOf([] { return YamlNode::Parse("plenocal: 2", "t.yaml").CheckVersion(); }),
              StartsWith("t.yaml:1:11: plenocal: expected format version 1, got '2'"));
}

TEST(Yaml, PlacesErrorsOfSyntax) {
  EXPECT_THAT(ParseError("a: 1\nb: [1, 2\n"), StartsWith("t.yaml:3:1: not valid YAML: end of"));
  EXPECT_THAT(ParseError("a: 1\n\tb: 2\n"), HasSubstr("t.yaml:2:"));
  EXPECT_THAT(ParseError("a: b: c"), StartsWith("t.yaml:1:5: not valid YAML: "));
  EXPECT_THAT(ParseError("a: 'open"), HasSubstr("not valid YAML: "));
}

TEST(Yaml, RefusesWhatItDoesNotRead) {
  EXPECT_THAT(ParseError("a: &x 1\nb: 2"), HasSubstr("t.yaml:1:4: anchors"));
  EXPECT_THAT(ParseError("a: 1\n---\nb: 2"), HasSubstr("a second document starts here"));
  EXPECT_THAT(ParseError("[1, 2]: 3"), HasSubstr("expected a name as key, got a list of 2"));
}

TEST(Yaml, SurvivesGarbage) {
  EXPECT_THAT(ParseError(""), HasSubstr("t.yaml: the file is empty"));
  EXPECT_THAT(ParseError("# only a comment\n"), HasSubstr("the file is empty"));
  EXPECT_THAT(ParseError(std::string("\x89PNG\r\n\x1a\n\0\0", 10)), HasSubstr("binary data"));
  for (const char* open : {"[", "{", "- ", "? ", "{a: "}) {
    std::string text;
    for (int i = 0; i < 100000; ++i) text += open;
    EXPECT_THAT(ParseError(text), HasSubstr("nested too deeply")) << open;
  }
  // Whatever the bytes: an Error or a tree, never a crash. The sequence is fixed.
  constexpr std::string_view kBytes = "abc:[]{}-?&*!|>'\"%@` \n\t,#0.~\\\x80\xff";
  unsigned state = 1;
  for (int i = 0; i < 2000; ++i) {
    std::string text;
    for (int k = 0; k < 40; ++k) {
      state = state * 1664525u + 1013904223u;
      text += kBytes[(state >> 16) % kBytes.size()];
    }
    try {
      (void)YamlNode::Parse(text, "t.yaml").Dump();
    } catch (const Error&) {
    }
  }
}

TEST(Yaml, SaysWhatIsWrongWithAFile) {
  const testing::TemporaryFolder folder;
  EXPECT_THAT(MessageOf([&] { return YamlNode::ReadFile(folder / "absent.yaml"); }),
              HasSubstr("absent.yaml: no such file; check the path"));
  EXPECT_THAT(MessageOf([&] { return YamlNode::ReadFile(folder.Path()); }),
              HasSubstr("is a directory"));
  folder.Write("good.yaml", "plenocal: 1\r\nsize: 0.088q\r\n");
  EXPECT_THAT(
      MessageOf([&] { return YamlNode::ReadFile(folder / "good.yaml").At("size").AsLength(); }),
      HasSubstr("good.yaml:2:7: size: expected a length in metres or with its unit, got '0.088q'"));
}

TEST(Yaml, DumpsWhatReadsEqual) {
  const std::string text =
      "{a: 1, quoted: '1', list: [1, {b: c}], block: [], none: ~, 'odd: key': \"x # y\"}";
  const YamlNode node = YamlNode::Parse(text, "t.yaml");
  const std::string dump = node.Dump({"a"});
  EXPECT_THAT(dump, StartsWith("quoted: \"1\"\n"));
  const YamlNode again = YamlNode::Parse(dump, "dump");
  EXPECT_FALSE(again.Has("a"));
  EXPECT_EQ(again.At("odd: key").AsString(), "x # y");
  EXPECT_EQ(again.At("list").Elements()[1].At("b").AsString(), "c");
  EXPECT_EQ(again.Dump(), dump);
}

TEST(Yaml, ReadsAFileOfManyMarkersFast) {
  std::string text = "markers:\n";
  for (int i = 0; i < 20000; ++i) {
    text += "  " + std::to_string(i) + ": [0.0123456789012, -0.123456789012, 1.23456789012]\n";
  }
  const auto start = std::chrono::steady_clock::now();
  size_t count = 0;
  const YamlNode node = YamlNode::Parse(text, "t.yaml");
  for (const auto& [key, value] : node.At("markers").Entries()) count += value.AsNumbers(3).size();
  EXPECT_EQ(count, 60000u);
  // Some 0.3 s; a reader of quadratic cost takes minutes. Wide, since machines are shared.
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(20));
}

}  // namespace TEST_FILE
}  // namespace plenocal
