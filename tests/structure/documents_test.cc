// SPDX-License-Identifier: Apache-2.0
//
// The documents' links resolve, and no file of the repository points outside of it.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

namespace TEST_FILE {

namespace fs = std::filesystem;

std::vector<std::string> LinesOf(const fs::path& path) {
  std::ifstream file(path);
  std::vector<std::string> lines;
  for (std::string line; std::getline(file, line);) lines.push_back(line);
  return lines;
}

// The files of the repository: all but what builds and tools leave behind (.gitignore).
std::vector<fs::path> Files() {
  std::vector<fs::path> files;
  const fs::path root = PLENOCAL_SOURCE;
  for (auto it = fs::recursive_directory_iterator(root); it != fs::end(it); ++it) {
    const std::string name = it->path().filename().string();
    const bool is_left_behind =
        name == ".git" || name == ".cache" || name == "build" || name == "__pycache__";
    if (it->is_directory() && is_left_behind) it.disable_recursion_pending();
    if (it->is_regular_file()) files.push_back(it->path());
  }
  return files;
}

std::string Shown(const fs::path& path) { return fs::relative(path, PLENOCAL_SOURCE).string(); }

// Lines outside of ``` blocks.
void ForEachLineOfText(const fs::path& document,
                       const std::function<void(const std::string&)>& visit) {
  bool in_block = false;
  for (const std::string& line : LinesOf(document)) {
    const size_t first = line.find_first_not_of(' ');
    if (first != std::string::npos && line.compare(first, 3, "```") == 0) {
      in_block = !in_block;
    } else if (!in_block) {
      visit(line);
    }
  }
}

// The name under which a heading is linked: small letters, digits, '-' and '_', '-' for a blank.
std::string Anchor(const std::string& heading) {
  std::string anchor;
  for (const char c : heading) {
    if (std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '-' || c == '_') {
      anchor += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    } else if (c == ' ') {
      anchor += '-';
    }
  }
  return anchor;
}

std::set<std::string> Anchors(const fs::path& document) {
  std::set<std::string> anchors;
  ForEachLineOfText(document, [&](const std::string& line) {
    if (line.starts_with("#")) anchors.insert(Anchor(line.substr(line.find_first_not_of("# "))));
  });
  return anchors;
}

TEST(Documents, HaveLinksThatResolve) {
  const std::regex link(R"(\]\(([^)\s]+)\))");
  int checked = 0;
  for (const fs::path& document : Files()) {
    if (document.extension() != ".md") continue;
    ForEachLineOfText(document, [&](const std::string& line) {
      for (std::sregex_iterator it(line.begin(), line.end(), link), end; it != end; ++it) {
        const std::string target = (*it)[1].str();
        if (target.find("://") != std::string::npos) continue;
        const size_t hash = target.find('#');
        const std::string file = target.substr(0, hash);
        const fs::path path = file.empty() ? document : document.parent_path() / file;
        EXPECT_TRUE(fs::exists(path)) << Shown(document) << ": " << target;
        if (hash != std::string::npos && fs::exists(path)) {
          EXPECT_TRUE(Anchors(path).contains(target.substr(hash + 1)))
              << Shown(document) << ": " << target << " names no heading";
        }
        ++checked;
      }
    });
  }
  EXPECT_GT(checked, 50);
}

TEST(Documents, AreNamedWhereTheyAre) {
  const std::regex document(R"((docs/[a-z_]+\.md))");
  int checked = 0;
  for (const fs::path& path : Files()) {
    const std::string extension = path.extension().string();
    if (extension == ".jpg" || extension == ".png") continue;
    for (const std::string& line : LinesOf(path)) {
      for (std::sregex_iterator it(line.begin(), line.end(), document), end; it != end; ++it) {
        EXPECT_TRUE(fs::exists(fs::path(PLENOCAL_SOURCE) / (*it)[1].str()))
            << Shown(path) << ": " << line;
        ++checked;
      }
    }
  }
  EXPECT_GT(checked, 20);
}

TEST(Documents, StandInTheMenuOfTheSite) {
  std::set<std::string> in_menu;
  for (const std::string& line : LinesOf(fs::path(PLENOCAL_SOURCE) / "docs/site/mkdocs.yml")) {
    if (line.ends_with(".md")) in_menu.insert(line.substr(line.rfind(' ') + 1));
  }
  for (const auto& entry : fs::directory_iterator(fs::path(PLENOCAL_SOURCE) / "docs")) {
    const std::string name = entry.path().filename().string();
    EXPECT_TRUE(!name.ends_with(".md") || in_menu.contains(name)) << name;
  }
}

TEST(Documents, NameFilesThatExist) {
  // `bench/net compare`: what follows a blank is no part of the file.
  const std::regex file(
      "`((calib|models|targets|detectors|apps|tests|bench|scripts|examples)/[a-z0-9_./]+)[` ]");
  int checked = 0;
  for (const fs::path& document : Files()) {
    if (document.extension() != ".md") continue;
    ForEachLineOfText(document, [&](const std::string& line) {
      for (std::sregex_iterator it(line.begin(), line.end(), file), end; it != end; ++it) {
        EXPECT_TRUE(fs::exists(fs::path(PLENOCAL_SOURCE) / (*it)[1].str()))
            << Shown(document) << ": " << (*it)[1];
        ++checked;
      }
    });
  }
  EXPECT_GT(checked, 30);
}

TEST(Documents, StateOneVersion) {
  const std::map<std::string, std::string> statements{
      {"CMakeLists.txt", R"(  VERSION (\d+\.\d+\.\d+))"},
      {"CITATION.cff", R"(version: (\d+\.\d+\.\d+))"},
      {"package.xml", R"( *<version>(\d+\.\d+\.\d+)</version>)"},
      {"CHANGELOG.md", R"(## \[(\d+\.\d+\.\d+)\] - (unreleased|\d{4}-\d\d-\d\d))"}};
  std::set<std::string> versions;
  for (const auto& [file, statement] : statements) {
    std::string first;  // the newest of CHANGELOG.md
    for (const std::string& line : LinesOf(fs::path(PLENOCAL_SOURCE) / file)) {
      std::smatch match;
      if (first.empty() && std::regex_match(line, match, std::regex(statement))) first = match[1];
    }
    EXPECT_FALSE(first.empty()) << file;
    versions.insert(first);
  }
  EXPECT_EQ(versions.size(), 1U);
}

// What stands between backticks in a cell of a table's row, with the heading of its section.
using HeadedName = std::pair<std::string, std::string>;

std::vector<std::string> Cells(const std::string& row) {
  std::vector<std::string> cells;
  for (size_t begin = 1; begin < row.size();) {
    const size_t end = std::min(row.find('|', begin), row.size());
    cells.push_back(std::regex_replace(row.substr(begin, end - begin), std::regex("^ +| +$"), ""));
    begin = end + 1;
  }
  return cells;
}

std::vector<std::string> Quoted(const std::string& cell) {
  static const std::regex kQuoted("`([^`]+)`");
  std::vector<std::string> names;
  for (std::sregex_iterator it(cell.begin(), cell.end(), kQuoted), end; it != end; ++it) {
    names.push_back((*it)[1].str());
  }
  return names;
}

// The rows that bench/honest has written into docs/uncertainty.md: "heading: `name`, `name`" in the
// first cell.
std::set<HeadedName> TestedStandardErrors() {
  std::set<HeadedName> tested;
  bool is_inside = false;
  for (const std::string& line : LinesOf(fs::path(PLENOCAL_SOURCE) / "docs/uncertainty.md")) {
    if (line.starts_with("<!-- bench/honest:")) is_inside = !is_inside;
    if (!is_inside || !line.starts_with("|")) continue;
    const std::string cell = Cells(line).at(0);
    const size_t end = cell.rfind(": `");
    if (end == std::string::npos) continue;
    for (const std::string& name : Quoted(cell.substr(end)))
      tested.emplace(cell.substr(0, end), name);
  }
  return tested;
}

TEST(Documents, HaveAMonteCarloRowForEachStandardErrorThatIsWritten) {
  const std::regex name_of_one(R"((^|_)(sigmas?|std_error)(_|\.|$))");
  const std::regex meaning_of_one("standard (error|deviation)|covariance");
  const std::set<HeadedName> tested = TestedStandardErrors();
  EXPECT_GT(tested.size(), 30);
  std::string heading;
  bool is_written = false;  // by the program: what people write comes before and after that
  for (const std::string& line : LinesOf(fs::path(PLENOCAL_SOURCE) / "docs/formats.md")) {
    if (line == "## Detections") is_written = true;
    if (line.starts_with("## Specification of")) is_written = false;
    if (line.starts_with("#")) {
      heading = std::regex_replace(line, std::regex("^#+ (Keys of |Columns of )?"), "");
    }
    if (!is_written || !line.starts_with("|")) continue;
    const std::vector<std::string> names = Quoted(Cells(line).at(0));
    const auto is_tested = [&](const std::string& name) {
      return tested.contains({heading, name});
    };
    const std::string remedy =
        heading +
        ": a standard error without a case: add one to "
        "bench/accuracy/honest_cases.py (or a line to OTHERS), run bench/honest "
        "--write docs/uncertainty.md: " +
        line;
    for (const std::string& name : names) {
      EXPECT_TRUE(!std::regex_search(name, name_of_one) || is_tested(name)) << remedy;
    }
    if (!names.empty() && std::regex_search(line, meaning_of_one)) {
      EXPECT_TRUE(std::ranges::any_of(names, is_tested)) << remedy;
    }
  }
}

// A reader of the repository has nothing else.
// Codes of findings in the product's sources.
std::set<std::string> CodesOfFindings() {
  const std::regex entry(R"(\.code = ([^,]*)[,;])"), code(R"re("([A-Za-z_]+)")re");
  std::set<std::string> codes;
  for (const char* top : {"calib", "assess", "targets", "engine"}) {
    for (const auto& file : fs::recursive_directory_iterator(fs::path(PLENOCAL_SOURCE) / top)) {
      const std::string extension = file.path().extension().string();
      if (extension != ".cc" && extension != ".h") continue;
      std::string text;
      for (const std::string& line : LinesOf(file.path())) text += line + " ";
      for (std::sregex_iterator at(text.begin(), text.end(), entry), end; at != end; ++at) {
        const std::string words = (*at)[1];
        for (std::sregex_iterator word(words.begin(), words.end(), code); word != end; ++word) {
          codes.insert((*word)[1]);
        }
      }
    }
  }
  codes.erase("code");     // read from a file
  codes.erase("warning");  // of results that were written before findings had codes
  return codes;
}

TEST(Documents, NameTheCodesOfAllFindings) {
  // A note that has no row of its own.
  std::set<std::string> documented{"orientation_tag"};
  bool is_code = false;
  for (const std::string& line : LinesOf(fs::path(PLENOCAL_SOURCE) / "docs/diagnosis.md")) {
    if (!line.starts_with("|")) {
      is_code = false;
    } else if (line.starts_with("| code |")) {
      is_code = true;
    } else if (is_code) {
      for (const std::string& name : Quoted(Cells(line).at(0))) documented.insert(name);
    }
  }
  documented.erase("target_border_bits");  // of an error, which is no finding
  EXPECT_EQ(CodesOfFindings(), documented);
}

TEST(Repository, PointsToNothingOutsideOfIt) {
  const std::regex outside(
      R"((^|[^a-zA-Z_])shared/)"
      R"(|\b(FORMATS|PLENOPTIC|PERFORMANCE|HOUSE|STYLE|WORKBENCH|SCENE|BRIEF)\.md)"
      R"(|\b[Ii]ssues? #?[0-9]+)"
      R"(|(^|[^.\w])/(work|w)/)");
  int files = 0;
  for (const fs::path& path : Files()) {
    const std::string extension = path.extension().string();
    if (extension == ".jpg" || extension == ".png" || path.filename() == "documents_test.cc")
      continue;
    ++files;
    int number = 0;
    for (const std::string& line : LinesOf(path)) {
      ++number;
      EXPECT_FALSE(std::regex_search(line, outside))
          << Shown(path) << ":" << number << " points outside of the repository: " << line;
    }
  }
  EXPECT_GT(files, 300);
}

}  // namespace TEST_FILE
