// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/find_cameras.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/base/number_text.h"
#include "calib/files/frame_images.h"
#include "engine/recording/image_names.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

/// A file's name in parts: "cam0_007" is "cam", "0", "_", "007".
struct NameParts {
  FrameImage file;
  std::string text;                  ///< with # for each number: "cam#_#"
  std::vector<std::string> numbers;  ///< "0", "007"
};

NameParts PartsOf(const FrameImage& file) {
  NameParts parts{.file = file, .text = {}, .numbers = {}};
  bool in_number = false;
  for (const char c : file.path.stem().string()) {
    const bool digit = std::isdigit(static_cast<unsigned char>(c)) != 0;
    if (digit && !in_number) {
      parts.text += '#';
      parts.numbers.emplace_back();
    }
    if (digit) {
      parts.numbers.back() += c;
    } else {
      parts.text += c;
    }
    in_number = digit;
  }
  return parts;
}

/// Files of one camera by a key of their names.
using Groups = std::map<std::string, std::vector<NameParts>>;

/// Names of the frames: the numbers in the file names without that of the camera.
std::set<std::vector<std::string>> FramesOf(const std::vector<NameParts>& files,
                                            std::optional<size_t> camera_number) {
  std::set<std::vector<std::string>> frames;
  for (const NameParts& file : files) {
    std::vector<std::string> numbers = file.numbers;
    if (camera_number) numbers.erase(numbers.begin() + static_cast<std::ptrdiff_t>(*camera_number));
    frames.insert(numbers);
  }
  return frames;
}

// Groups are cameras if they are few and most of their frames are the same.
bool AreCameras(const Groups& groups, std::optional<size_t> camera_number) {
  constexpr size_t kMostCameras = 16, kFewestImages = 2;
  if (groups.size() < 2 || groups.size() > kMostCameras) return false;
  const auto first = FramesOf(groups.begin()->second, camera_number);
  return std::ranges::all_of(groups, [&](const auto& group) {
    const auto frames = FramesOf(group.second, camera_number);
    size_t common = 0;
    for (const auto& frame : frames) common += first.contains(frame) ? 1 : 0;
    return frames.size() >= kFewestImages && 2 * common >= std::min(frames.size(), first.size());
  });
}

// The files whose names have one text, if the others are few; else none.
std::vector<NameParts> MostAlike(const std::vector<NameParts>& files) {
  Groups groups;
  for (const NameParts& file : files) groups[file.text].push_back(file);
  const auto largest =
      std::ranges::max_element(groups, {}, [](const auto& group) { return group.second.size(); });
  constexpr size_t kOthers = 4;
  return kOthers * (files.size() - largest->second.size()) <= files.size()
             ? largest->second
             : std::vector<NameParts>();
}

// left01, right01: the names' texts differ. A few other images may be among them.
std::optional<Groups> ByText(const std::vector<NameParts>& files) {
  Groups groups;
  for (const NameParts& file : files) groups[file.text].push_back(file);
  size_t largest = 0;
  for (const auto& [text, group] : groups) largest = std::max(largest, group.size());
  constexpr size_t kOthers = 4;  // as few as a quarter of a camera's
  std::erase_if(groups, [&](const auto& group) { return kOthers * group.second.size() < largest; });
  return AreCameras(groups, std::nullopt) ? std::optional(groups) : std::nullopt;
}

// img_1_01, img_2_01: groups by the first number alone, a digit, are cameras if they are two to
// four with the same frames, or nearly.
bool ArePlainlyNumbered(const Groups& groups) {
  constexpr size_t kMost = 4, kFewest = 5;
  constexpr double kSame = 0.9;
  if (groups.size() < 2 || groups.size() > kMost) return false;
  const auto first = FramesOf(groups.begin()->second, 0);
  int number = ParseInt(groups.begin()->first).value_or(-1);
  if (number > 1) return false;
  return std::ranges::all_of(groups, [&](const auto& group) {
    const auto frames = FramesOf(group.second, 0);
    size_t common = 0;
    for (const auto& frame : frames) common += first.contains(frame) ? 1 : 0;
    return group.first == std::to_string(number++) && frames.size() >= kFewest &&
           static_cast<double>(common) >=
               kSame * static_cast<double>(std::max(frames.size(), first.size()));
  });
}

// cam0_001, cam1_001: one of the numbers, after a word for a camera, is the camera's. A few other
// images may be among them.
std::optional<Groups> ByNumber(const std::vector<NameParts>& all) {
  const std::vector<NameParts> files = MostAlike(all);
  if (files.empty()) return std::nullopt;
  const std::string& text = files.front().text;
  const std::string lower = LowerCase(text);
  size_t at = 0;
  for (size_t n = 0; n < files.front().numbers.size(); ++n) {
    const size_t hash = lower.find('#', at);
    std::string word = lower.substr(at, hash - at);
    at = hash + 1;
    while (!word.empty() && std::isalpha(static_cast<unsigned char>(word.back())) == 0) {
      word.pop_back();
    }
    const bool camera = word.ends_with("cam") || word.ends_with("camera") ||
                        word.ends_with("view") || word.ends_with("sensor");
    if (!camera && n > 0) continue;
    Groups groups;
    for (const NameParts& file : files) groups[file.numbers[n]].push_back(file);
    if (camera ? AreCameras(groups, n) : ArePlainlyNumbered(groups)) {
      Groups named;
      for (auto& [number, group] : groups) named["cam" + number] = std::move(group);
      return named;
    }
  }
  return std::nullopt;
}

// Names of the parts in which the keys differ.
std::map<std::string, std::string> NamesOfKeys(const Groups& groups) {
  std::vector<std::string> keys;
  for (const auto& [key, group] : groups) keys.push_back(key);
  const auto common = [&](const std::vector<std::string>& texts) {
    size_t n = 0;
    while (std::ranges::all_of(texts, [&](const std::string& text) {
      return n < text.size() && text[n] == texts[0][n];
    })) {
      ++n;
    }
    return n;
  };
  const size_t begin = common(keys);
  std::vector<std::string> rests;
  for (const std::string& key : keys)
    rests.emplace_back(key.rbegin(), key.rend() - static_cast<std::ptrdiff_t>(begin));
  const size_t end = common(rests);
  std::map<std::string, std::string> names;
  for (const std::string& key : keys) {
    // Whole words: "left" and "right" end alike.
    const auto is_letter = [&](size_t i) {
      return i < key.size() && std::isalpha(static_cast<unsigned char>(key[i])) != 0;
    };
    size_t from = begin, to = key.size() - end;
    while (from > 0 && is_letter(from - 1)) --from;
    while (is_letter(to)) ++to;
    names[key] = key.substr(from, to - from);
  }
  return names;
}

// Letters, digits, '_' and '-', as a camera's name must be.
std::string CleanName(const std::string& text) {
  std::string name;
  for (const char c : text) {
    const bool good = std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '-';
    if (good) name += c;
  }
  while (!name.empty() && (name.back() == '_' || name.back() == '-')) name.pop_back();
  while (!name.empty() && (name.front() == '_' || name.front() == '-')) name.erase(0, 1);
  return name;
}

std::vector<std::string> PatternsOf(const std::vector<NameParts>& group, const Groups& groups) {
  std::vector<FrameImage> files;
  std::set<fs::path> grouped;
  std::vector<std::string> paths;
  for (const NameParts& file : group) {
    files.push_back(file.file);
    paths.push_back(file.file.path.string());
  }
  for (const auto& [key, others] : groups) {
    for (const NameParts& file : others) grouped.insert(file.file.path);
  }
  // Images of no camera are left out by what they show.
  const std::string glob = GlobOf(
      files, [&](const fs::path& path) { return HasImageName(path) && !grouped.contains(path); });
  return glob.empty() ? paths : std::vector{glob};
}

bool IsWhiteName(const std::string& folder) {
  const std::string name = LowerCase(folder);
  for (const std::string_view end : {"white", "whites", "white_images", "white-images"}) {
    if (!name.ends_with(end)) continue;
    const size_t before = name.size() - end.size();
    if (before == 0 || name[before - 1] == '_' || name[before - 1] == '-') return true;
  }
  return false;
}

// True for names of folders that any camera may have.
bool IsGeneral(const std::string& name) {
  constexpr std::array kGeneral{"data", "images", "image", "imgs", "img", "frames", "raw"};
  return std::ranges::find(kGeneral, name) != kGeneral.end();
}

// Whose white images a folder has: plenoptic_white of plenoptic, left/white of left.
fs::path OwnerOf(const fs::path& white) {
  const std::string name = white.filename().string();
  const size_t word = LowerCase(name).rfind("white");
  return word < 2 ? white.parent_path() : white.parent_path() / name.substr(0, word - 1);
}

void AddImageFolders(const fs::path& folder, int depth, std::vector<fs::path>* folders) {
  std::vector<fs::path> below;
  bool any = false;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().filename().string().starts_with('.')) continue;
    if (entry.is_directory()) {
      const bool of_results = fs::exists(entry.path() / "calibration.yaml");
      if (!of_results) below.push_back(entry.path());
    } else {
      any = any || HasImageName(entry.path());
    }
  }
  if (any) folders->push_back(folder);
  std::ranges::sort(below);
  if (depth == 0) return;
  for (const fs::path& each : below) AddImageFolders(each, depth - 1, folders);
}

// The parts of the folders' paths in which they differ: cam0 of cam0/data, beside cam1/data.
std::string NameOfFolder(const fs::path& folder,
                         const fs::path& top,
                         const std::vector<fs::path>& all) {
  for (fs::path part = folder; part != top && part.has_relative_path(); part = part.parent_path()) {
    const std::string name = part.filename().string();
    const bool unique = std::ranges::none_of(all, [&](const fs::path& other) {
      return other != folder && std::ranges::find(other, fs::path(name)) != other.end();
    });
    if (unique && !IsGeneral(name)) return CleanName(name);
  }
  return all.size() == 1 ? "cam" : CleanName(folder.filename().string());
}

void MakeNamesUnique(std::vector<FoundCamera>* cameras) {
  std::set<std::string> names;
  for (FoundCamera& camera : *cameras) {
    if (camera.name.empty()) camera.name = "cam";
    const std::string base = camera.name;
    for (int n = 2; !names.insert(camera.name).second; ++n) {
      camera.name = fmt::format("{}{}", base, n);
    }
  }
}

}  // namespace

std::vector<FoundCamera> CamerasInFolder(const fs::path& folder) {
  std::vector<NameParts> files;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (HasImageName(entry.path())) files.push_back(PartsOf({{}, entry.path()}));
  }
  if (files.empty()) {
    throw InputError(
        "{}: no images (png, tiff, jpeg, bmp, pgm) in this folder; give a "
        "folder below it, or find the cameras by 'plenocal init'",
        folder.string());
  }
  std::ranges::sort(files, {}, [](const NameParts& parts) { return parts.file.path; });
  std::optional<Groups> groups = ByText(files);
  if (!groups) groups = ByNumber(files);
  if (!groups)
    return {{.name = "cam", .images = {folder.string()}, .white = {}, .count = files.size()}};
  std::vector<FoundCamera> cameras;
  const std::map<std::string, std::string> names = NamesOfKeys(*groups);
  for (const auto& [key, group] : *groups) {
    cameras.push_back({.name = CleanName(names.at(key)),
                       .images = PatternsOf(group, *groups),
                       .white = {},
                       .count = group.size()});
  }
  MakeNamesUnique(&cameras);
  return cameras;
}

std::vector<FoundCamera> FindCameras(const fs::path& given) {
  constexpr int kDepth = 3;
  std::vector<fs::path> folders, white;
  const fs::path folder = given.has_filename() ? given : given.parent_path();
  AddImageFolders(folder, kDepth, &folders);
  std::erase_if(folders, [&](const fs::path& each) {
    if (each == folder || !IsWhiteName(each.filename().string())) return false;
    white.push_back(each);
    return true;
  });
  if (folders.empty()) {
    throw InputError("{}: no images (png, tiff, jpeg, bmp, pgm) in this folder or below",
                     folder.string());
  }
  std::vector<FoundCamera> cameras;
  for (const fs::path& each : folders) {
    std::vector<FoundCamera> here = CamerasInFolder(each);
    if (here.size() == 1 && each != folder) here[0].name = NameOfFolder(each, folder, folders);
    for (FoundCamera& camera : here) {
      for (const fs::path& of : white) {
        const bool only = folders.size() == 1 && here.size() == 1;
        const fs::path owner = OwnerOf(of);
        const bool above = IsGeneral(each.filename().string()) && each.parent_path() == owner;
        if (owner != each && !above && !only) continue;
        camera.white = {of.string()};
        camera.white_count = ExpandImages(camera.white, "white images").size();
      }
      cameras.push_back(std::move(camera));
    }
  }
  MakeNamesUnique(&cameras);
  return cameras;
}

}  // namespace plenocal
