// SPDX-License-Identifier: Apache-2.0
//
// The dependencies between rooms (docs/architecture.md). All libraries share one include root, so
// only the #include lines show them.
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

using Rooms = std::set<std::string>;

// A room is a folder with those below it that are no rooms themselves.
const std::map<std::string, Rooms> kAllowed = [] {
  std::map<std::string, Rooms> allowed;
  const auto add = [&](const std::string& room, const std::vector<std::string>& direct) {
    Rooms& rooms = allowed[room];
    rooms.insert(room);
    for (const std::string& below : direct)
      rooms.insert(allowed[below].begin(), allowed[below].end());
  };
  add("calib/kernels", {});
  add("calib/base", {"calib/kernels"});
  add("calib/io", {"calib/base"});
  add("calib/camera", {"calib/io"});
  add("calib/traits", {"calib/camera"});
  add("calib/files", {"calib/traits"});
  add("calib/adjust", {"calib/files"});
  add("calib/adjust/reduced", {"calib/adjust"});
  add("calib/adjust/all_unknowns", {"calib/adjust"});
  add("calib/adjust/solver", {"calib/adjust/reduced", "calib/adjust/all_unknowns"});
  add("calib/noise", {"calib/adjust/solver"});
  add("calib/start", {"calib/noise"});
  add("calib/rig", {"calib/start"});
  add("calib/prior", {"calib/start"});
  add("calib/scene", {"calib/noise"});
  add("calib/estimate", {"calib/rig", "calib/prior"});
  add("calib/space", {"calib/prior"});
  add("calib", {"calib/estimate", "calib/scene", "calib/space"});
  add("assess/views", {"calib/rig"});
  add("assess/frames", {"assess/views"});
  add("assess/space", {"calib/space", "assess/views"});
  add("assess", {"calib", "assess/frames", "assess/space"});
  add("assess/target", {"assess"});
  add("assess/causes", {"assess/target"});
  add("assess/missing", {"assess/causes"});
  add("targets", {"calib/files"});
  add("models", {"calib"});
  add("detectors/templates", {"targets"});
  add("detectors/images", {"detectors/templates"});
  add("detectors/tag_assignment", {"targets"});
  add("detectors/apriltag", {"calib/base"});
  const std::vector<std::string> of_tags{
      "detectors/images", "detectors/tag_assignment", "detectors/apriltag"};
  add("detectors/tags", of_tags);
  add("detectors/boards", of_tags);
  add("detectors/photometry", {"detectors/images"});
  add("detectors/plenoptic/white", {"detectors/photometry"});
  add("detectors/plenoptic/depth", {"detectors/plenoptic/white"});
  add("detectors/types", {"detectors/tags", "detectors/boards"});
  add("detectors/plenoptic/markers", {"detectors/plenoptic/depth", "detectors/types"});
  add("detectors/plenoptic", {"detectors/plenoptic/markers"});
  add("detectors", {"detectors/plenoptic"});
  add("engine/recording/messages", {"detectors"});
  add("engine/recording/video", {"engine/recording/messages"});
  add("engine/recording/stores", {"engine/recording/video"});
  add("engine/recording/frames", {"engine/recording/stores"});
  add("engine/recording", {"engine/recording/frames"});
  add("engine/resample", {"assess", "detectors", "models"});
  add("engine/formats", {"engine/resample"});
  add("engine/scene/track", {"detectors", "models"});
  add("engine/scene", {"engine/recording", "engine/scene/track", "models"});
  add("engine/session", {"engine/formats", "engine/recording"});
  add("engine/suggest", {"engine/session", "engine/scene"});
  add("engine/observe", {"assess/causes", "engine/suggest"});
  add("engine/json", {"assess"});
  add("engine/exchange", {"engine/session"});
  add("engine/images", {"engine/observe"});
  add("engine/plenoptic", {"engine/images"});
  add("engine/rigs", {"engine/json", "engine/observe"});
  add("engine",
      {"assess/missing", "engine/exchange", "engine/json", "engine/plenoptic", "engine/rigs"});
  add("apps/charts", {"detectors/templates"});
  add("apps/print", {"apps/charts", "detectors"});
  add("apps/evaluate", {"calib"});
  add("apps/report", {"engine"});
  add("apps/groundtruth", {"apps/evaluate", "apps/report"});
  add("apps/suggest", {"apps/charts", "engine"});
  add("apps/photometry/images", {"engine"});
  add("apps/photometry/response", {"engine"});
  add("apps/photometry", {"apps/report", "apps/photometry/images", "apps/photometry/response"});
  add("apps/simulate/spec", {"calib", "detectors/photometry"});
  add("apps/simulate/render", {"apps/simulate/spec", "targets"});
  add("apps/simulate/targets", {"apps/simulate/render", "apps/charts"});
  add("apps/simulate/scene", {"apps/simulate/render"});
  add("apps/simulate/photometry", {"apps/simulate/targets", "apps/simulate/scene"});
  add("apps/simulate", {"apps/simulate/photometry"});
  add("apps/workbench", {"apps/print", "apps/report", "apps/suggest"});
  add("apps/cli",
      {"apps/print", "apps/groundtruth", "apps/photometry", "apps/simulate", "apps/workbench"});
  add("apps", {"apps/cli"});
  add("python", {"apps/cli"});
  return allowed;
}();

// The top folders of the source code.
const std::vector<std::string> kTop{
    "calib", "assess", "targets", "models", "detectors", "engine", "apps", "python"};

std::string RoomOf(std::string folder) {
  while (!folder.empty() && !kAllowed.contains(folder)) {
    folder = fs::path(folder).parent_path().string();
  }
  return folder;
}

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

TEST(Includes, PointOnlyToRoomsBelow) {
  std::map<std::string, int> count;
  for (const std::string& top : kTop) {
    ForEachInclude(top, [&](const fs::path& file, const std::string& included) {
      const std::string room = RoomOf(file.parent_path().string());
      // "file.h" without its folder would escape this test.
      EXPECT_FALSE(fs::path(included).parent_path().empty() &&
                   fs::exists(fs::path(PLENOCAL_SOURCE) / file.parent_path() / included))
          << file << ": write the folder before " << included;
      if (!fs::exists(fs::path(PLENOCAL_SOURCE) / included)) return;
      EXPECT_TRUE(kAllowed.at(room).contains(RoomOf(fs::path(included).parent_path().string())))
          << file << " must not include " << included;
      ++count[room];
    });
  }
  for (const auto& [room, allowed] : kAllowed) {
    if (room != "apps" && room != "detectors" && room != "calib") {
      EXPECT_GT(count[room], 0) << "nothing found in " << room;
    }
  }
}

// Headers and their sources, by the path without the extension, that include each other in a circle
// cannot be understood one by one.
TEST(Includes, FormNoCircles) {
  std::map<std::string, std::set<std::string>> included_by;
  const auto component = [](const fs::path& file) {
    return fs::path(file).replace_extension().string();
  };
  for (const std::string folder : {"targets", "models", "detectors", "engine", "apps/cli"}) {
    ForEachInclude(folder, [&](const fs::path& file, const std::string& included) {
      if (component(included) != component(file) && included.starts_with(folder)) {
        included_by[component(file)].insert(component(included));
      }
    });
  }
  // Components without includes are taken away until none is left, or circles alone.
  for (bool taken = true; taken;) {
    taken = std::erase_if(included_by, [&](const auto& each) {
              return std::ranges::none_of(each.second, [&](const std::string& other) {
                return included_by.contains(other);
              });
            }) > 0;
  }
  for (const auto& [name, others] : included_by) {
    ADD_FAILURE() << name << " is in a circle of includes, or includes one";
  }
}

TEST(Folders, HoldNoMoreFilesThanAReaderOverlooks) {
  constexpr int kMost = 24;
  for (const char* top :
       {"calib", "assess", "targets", "models", "detectors", "engine", "apps", "python", "tests"}) {
    std::map<std::string, int> files;
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(PLENOCAL_SOURCE) / top)) {
      const std::string extension = entry.path().extension().string();
      if (extension == ".h" || extension == ".cc") ++files[entry.path().parent_path().string()];
    }
    for (const auto& [folder, count] : files) EXPECT_LE(count, kMost) << folder;
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
  for (const std::string& top : kTop) {
    ForEachInclude(top, [&](const fs::path& file, const std::string& included) {
      EXPECT_TRUE(!included.starts_with("yaml-cpp") || file == "calib/io/yaml.cc")
          << file << " includes " << included;
    });
  }
}

}  // namespace TEST_FILE
