// SPDX-License-Identifier: Apache-2.0
//
// Names from outside come back from the files that they are written into: through our readers, and
// through those of Python.
#include "calib/base/quoted_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "calib/io/csv.h"
#include "calib/io/yaml.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;

// Names that a reader of YAML or CSV would take for something else, and random ones.
std::vector<std::string> HostileNames() {
  std::vector<std::string> names{
      "{a}",   "[left]",     "&a",  "@a",    "\"", "null",  "true",   "No",    "y",    "1",
      "1e3",   "0x1F",       "0o7", "1_000", "~",  ".inf",  ".nan",   "=",     "<<",   "- a",
      "a: b",  "a,b",        "#a",  "a #b",  " a", "a ",    "a\"b",   "\"a\"", "'a'",  "\\",
      "a\\n",  "%TAG",       "!x",  "*a",    "|",  ">",     "?",      "é",     "相机", "a'b,c",
      "12:30", "2026-11-22", "---", "...",   "`",  "$(ls)", "a\tb\"", "😀",     "007"};
  static constexpr const char* kCharacters[] = {
      "a", "Z", "0", "9", ".", ",", "\"", "'", "#", ":", "-", " ", "{", "}",  "[", "]", "&", "*",
      "!", "|", ">", "%", "@", "`", "\\", "/", "?", "=", "~", "_", "é", "相", "😀", "+", "e"};
  std::mt19937 random(1);
  for (int i = 0; i < 2000; ++i) {
    std::string name;
    for (size_t length = 1 + random() % 8; length > 0; --length) {
      name += kCharacters[random() % std::size(kCharacters)];
    }
    names.push_back(name);
  }
  return names;
}

std::string YamlOf(const std::vector<std::string>& names) {
  std::string text = "plenocal: 1\nflow: [";
  for (const std::string& name : names) text += YamlText(name) + ", ";
  text += "]\nblock:\n";
  for (const std::string& name : names) text += "  - " + YamlText(name) + "\n";
  text += "keys:\n";
  for (const std::string& name : names) text += "  - {" + YamlText(name) + ": 1}\n";
  return text;
}

std::string CsvOf(const std::vector<std::string>& names) {
  std::string text = "first,number,last\n";
  for (const std::string& name : names) text += CsvCell(name) + ",1," + CsvCell(name) + "\n";
  return text;
}

TEST(QuotedText, ComesBackFromYaml) {
  const std::vector<std::string> names = HostileNames();
  const YamlNode root = YamlNode::Parse(YamlOf(names), "names.yaml");
  for (const char* key : {"flow", "block", "keys"}) {
    const std::vector<YamlNode> elements = root.At(key).Elements();
    ASSERT_EQ(elements.size(), names.size());
    for (size_t i = 0; i < names.size(); ++i) {
      EXPECT_EQ(elements[i].IsMap() ? elements[i].Entries()[0].first : elements[i].AsString(),
                names[i]);
    }
  }
}

TEST(QuotedText, ComesBackFromCsv) {
  std::vector<std::string> names = HostileNames();
  const std::string text = CsvOf(names);
  CsvReader table(text, "names.csv");
  for (const std::string& name : names) {
    ASSERT_TRUE(table.Next());
    EXPECT_EQ(table.Text(0), name);
    EXPECT_EQ(table.Integer(1), 1);
    EXPECT_EQ(table.Text(2), name);
  }
  EXPECT_FALSE(table.Next());
}

TEST(QuotedText, IsReadByPythonAsItWas) {
  const std::string python = "/usr/bin/python3";
  if (std::system((python + " -c 'import yaml' 2>/dev/null").c_str()) != 0) {
    GTEST_SKIP() << "needs " << python << " with PyYAML";
  }
  const testing::TemporaryFolder folder;
  const std::vector<std::string> names = HostileNames();
  folder.Write("names.yaml", YamlOf(names));
  folder.Write("names.csv", CsvOf(names));
  std::string lines;
  for (const std::string& name : names) lines += name + "\n";
  folder.Write("names.txt", lines);
  folder.Write("compare.py",
               "import csv, yaml\n"
               "names = open('names.txt', encoding='utf-8', newline='').read().split('\\n')[:-1]\n"
               "root = yaml.safe_load(open('names.yaml', encoding='utf-8'))\n"
               "assert root['flow'] == names\n"
               "assert root['block'] == names\n"
               "assert [list(m)[0] for m in root['keys']] == names\n"
               "rows = list(csv.reader(open('names.csv', encoding='utf-8', newline='')))[1:]\n"
               "assert [r[0] for r in rows] == names and [r[2] for r in rows] == names\n");
  EXPECT_EQ(
      std::system(("cd '" + folder.Path().string() + "' && " + python + " compare.py").c_str()), 0);
}

TEST(QuotedText, ThatIsPlainStaysPlain) {
  for (const char* name : {"cam0", "left.f_x", "micro_lenses_cam.csv", "/cam0/image_raw"}) {
    EXPECT_EQ(YamlText(name), name);
    EXPECT_EQ(CsvCell(name), name);
  }
}

// Of two, three and four bytes, the first and the last of each length besides.
TEST(QuotedText, OfOtherScriptsIsNotEscaped) {
  for (const char* name : {"Kamera_böse",
                           "कैमरा",
                           "相机",
                           "a\u00a1",
                           "a\u07ca",
                           "a\u0904",
                           "a\uffe6",
                           "a\U00010000",
                           "a\U0001f600"}) {
    EXPECT_EQ(YamlText(name), "\"" + std::string(name) + "\"");
    EXPECT_EQ(CsvCell(name), name);
  }
}

TEST(QuotedText, OfAWordOfYamlIsQuotedInAnyCase) {
  for (const std::string word :
       {"null", "true", "false", "yes", "no", "on", "off", "nan", "y", "n"}) {
    std::string upper = word, first = word;
    for (char& c : upper) c = static_cast<char>(c - 'a' + 'A');
    first[0] = upper[0];
    for (const std::string& text : {word, upper, first}) {
      EXPECT_EQ(YamlText(text), "\"" + text + "\"");
    }
  }
}

TEST(QuotedText, WithControlCharactersIsEscaped) {
  EXPECT_EQ(Escaped("a\x1b[2J\nb\x7f\xff"), "a\\u001b[2J\\nb\\u007f\\xff");
  EXPECT_EQ(Escaped("a\nb\x1b", "\n"), "a\nb\\u001b");
  EXPECT_EQ(Escaped("größe 相机"), "größe 相机");
  EXPECT_EQ(Escaped("\xe2\x80\xae"), "\\u202e") << "turns the direction of writing";
  EXPECT_EQ(Escaped("\xc0\xaf \xed\xa0\x80"), "\\xc0\\xaf \\xed\\xa0\\x80") << "no UTF-8";
  EXPECT_EQ(YamlQuoted("a\n\x1b\xff"), "\"a\\n\\u001b\\ufffd\"");
}

TEST(QuotedText, OfNamesIsChecked) {
  for (const char* good : {"cam0", "{a}", "[left]", "null", "1", "相机", "a.b", "&a"}) {
    EXPECT_FALSE(CameraNameDefect(good)) << good;
  }
  for (const char* bad : {"",
                          "..",
                          ".a",
                          "-o",
                          "a/b",
                          "/a",
                          "a\\b",
                          "a b",
                          "a,b",
                          "a\"",
                          "a\n",
                          "a\x1b",
                          "\xff",
                          "a\xc2\xa0"}) {
    ASSERT_TRUE(CameraNameDefect(bad)) << bad;
    EXPECT_THAT(*CameraNameDefect(bad), HasSubstr("use letters"));
  }
  EXPECT_TRUE(CameraNameDefect(std::string(200, 'a')));
  for (const char* good : {"01", "a b", "a,b", "a\"b", "#1", "cam0/1.png"}) {
    EXPECT_FALSE(FrameNameDefect(good)) << good;
  }
  for (const char* bad : {"", "a\nb", "a\x1b", "\xff"}) EXPECT_TRUE(FrameNameDefect(bad)) << bad;
}

}  // namespace TEST_FILE
}  // namespace plenocal
