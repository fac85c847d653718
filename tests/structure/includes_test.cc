// SPDX-License-Identifier: Apache-2.0
//
// Which way the folders depend (README.md, "Structure"): the libraries share one include root, so
// that only their #include lines can be checked.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <regex>
#include <set>
#include <string>

namespace {

namespace fs = std::filesystem;

const std::map<std::string, std::set<std::string>> kAllowed{
    {"calib", {"calib"}},
    {"targets", {"targets", "calib"}},
    {"models", {"models", "calib"}},
    {"detectors", {"detectors", "targets", "calib"}},
    {"apps", {"apps", "detectors", "models", "targets", "calib"}}};

// Calls `check` with the path (relative to the project) and what it includes, for each #include
// line of the folder; returns how many there were.
int ForEachInclude(const std::string& folder,
                   const std::function<void(const fs::path&, const std::string&)>& check) {
  const std::regex include(R"(^\s*#\s*include\s*[<"]([^>"]+)[>"].*)");
  int count = 0;
  for (const auto& entry : fs::recursive_directory_iterator(fs::path(PLENOCAL_SOURCE) / folder)) {
    const std::string name = entry.path().filename().string();
    if (!std::regex_match(name, std::regex(R"(.*\.(h|cc|cc\.in))"))) continue;
    std::ifstream file(entry.path());
    std::smatch match;
    for (std::string line; std::getline(file, line);) {
      if (!std::regex_match(line, match, include)) continue;
      check(fs::relative(entry.path(), PLENOCAL_SOURCE), match[1].str());
      ++count;
    }
  }
  return count;
}

TEST(Includes, PointOnlyToFoldersBelow) {
  for (const auto& [folder, allowed] : kAllowed) {
    const int count = ForEachInclude(
        folder, [&allowed = allowed](const fs::path& file, const std::string& included) {
          const std::string to = included.substr(0, included.find('/'));
          const bool is_ours = fs::is_directory(fs::path(PLENOCAL_SOURCE) / to) && to != included;
          EXPECT_TRUE(!is_ours || allowed.contains(to)) << file << " must not include " << included;
          // "file.h" without its folder would escape this test.
          EXPECT_FALSE(to == included &&
                       fs::exists(fs::path(PLENOCAL_SOURCE) / file.parent_path() / to))
              << file << ": write the folder before " << included;
        });
    EXPECT_GT(count, 0) << "nothing found in " << folder;
  }
}

TEST(Includes, KeepOpenCvOutOfTheHeadersOfTheLibraries) {
  for (const char* folder : {"calib", "models", "targets"}) {
    ForEachInclude(folder, [&](const fs::path& file, const std::string& included) {
      if (file.extension() != ".h") return;
      EXPECT_FALSE(included.starts_with("opencv")) << file << " includes " << included;
    });
  }
}

TEST(Includes, KeepYamlCppInOneFile) {
  for (const auto& [folder, allowed] : kAllowed) {
    ForEachInclude(folder, [&](const fs::path& file, const std::string& included) {
      EXPECT_TRUE(!included.starts_with("yaml-cpp") || file == "calib/yaml.cc")
          << file << " includes " << included;
    });
  }
}

}  // namespace
