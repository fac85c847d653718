// SPDX-License-Identifier: Apache-2.0
#include "apps/formats/corners_vnl.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <map>
#include <sstream>
#include <vector>

#include "calib/error.h"
#include "calib/text_file.h"

namespace plenocal {
namespace {

std::vector<std::string> Words(const std::string& line) {
  std::istringstream stream(line);
  std::vector<std::string> words;
  for (std::string word; stream >> word;) words.push_back(word);
  return words;
}

}  // namespace

std::string DetectionsFromCornersVnl(const std::filesystem::path& path) {
  std::istringstream text(ReadTextFile(path));
  int number = 0;
  const auto fail = [&](const std::string& message) {
    throw Error(ErrorKind::kInput, fmt::format("{}:{}: {}", path.string(), number, message));
  };
  const auto parse = [&](const std::string& word) {
    double value = 0;
    const char* const end = word.data() + word.size();
    const auto [after, error] = std::from_chars(word.data(), end, value);
    if (error != std::errc() || after != end || !std::isfinite(value)) {
      fail(fmt::format("expected a number, found '{}'", word));
    }
    return value;
  };
  std::map<std::string, size_t> column;
  std::map<std::string, int> next;  // marker of the next line of a frame
  std::string csv = "frame,marker,x,y,sigma\n";
  for (std::string line; std::getline(text, line);) {
    ++number;
    std::vector<std::string> words = Words(line);
    if (words.empty() || words[0].starts_with("##") || words[0].starts_with("#!")) continue;
    if (words[0].starts_with('#')) {
      // The first single '#' names the columns, as in all vnlog files; a comment does not.
      words[0].erase(0, 1);
      if (words[0].empty()) words.erase(words.begin());
      if (!column.empty() || words.empty() || words[0] != "filename") continue;
      for (size_t i = 0; i < words.size(); ++i) column[words[i]] = i;
      for (const char* needed : {"x", "y"}) {
        if (!column.contains(needed)) fail(fmt::format("column '{}' is missing", needed));
      }
      continue;
    }
    if (column.empty()) fail("expected the line '# filename x y level' first");
    if (words.size() != column.size()) {
      fail(fmt::format("expected {} columns, found {}", column.size(), words.size()));
    }
    const std::string& file = words[column["filename"]];
    const std::string &x = words[column["x"]], &y = words[column["y"]];
    // mrcal writes one line "file - - -" for an image without target.
    if (x == "-" || y == "-") {
      ++next[file];
      continue;
    }
    double weight = 1;
    if (column.contains("level")) {
      const std::string& level = words[column["level"]];
      weight = level == "-" ? 0 : std::exp2(-parse(level));
    } else if (column.contains("weight")) {
      const std::string& given = words[column["weight"]];
      weight = given == "-" ? 0 : parse(given);
    }
    const int marker = next[file]++;
    if (!(weight > 0)) continue;
    parse(x);
    parse(y);
    csv += fmt::format(
        "{},{},{},{},{}\n", std::filesystem::path(file).stem().string(), marker, x, y, 1 / weight);
  }
  if (next.empty()) fail("holds no corners");
  return csv;
}

}  // namespace plenocal
