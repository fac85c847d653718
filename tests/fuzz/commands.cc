// SPDX-License-Identifier: Apache-2.0
#include "tests/fuzz/commands.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <map>
#include <sstream>
#include <stdexcept>

#include "apps/cli/command_line.h"
#include "apps/cli/program.h"
#include "calib/base/error.h"
#include "calib/io/input_file.h"
#include "engine/formats/camera_format.h"
#include "tests/fuzz/mutate.h"

namespace plenocal::fuzz {
namespace {

namespace fs = std::filesystem;

using Words = std::vector<std::string>;

// Standard output and error lead into a file while the object lives.
class CapturedStreams {
 public:
  explicit CapturedStreams(const fs::path& path) {
    const int file = open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    for (const int stream : {STDOUT_FILENO, STDERR_FILENO}) {
      std::fflush(stdout);
      kept_[stream] = fcntl(stream, F_DUPFD_CLOEXEC, 0);
      dup2(file, stream);
    }
    close(file);
  }
  ~CapturedStreams() {
    std::fflush(stdout);
    for (const auto& [stream, kept] : kept_) {
      dup2(kept, stream);
      close(kept);
    }
  }
  CapturedStreams(const CapturedStreams&) = delete;
  CapturedStreams& operator=(const CapturedStreams&) = delete;

 private:
  std::map<int, int> kept_;
};

// As RunProgram, but exceptions are passed on.
void RunWords(const Words& words) {
  Words program{"plenocal"};
  program.insert(program.end(), words.begin(), words.end());
  std::vector<char*> arguments;
  for (std::string& word : program) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  CommandLine command_line;
  command_line.Parse(static_cast<int>(program.size()), arguments.data())();
}

// ---- the sessions

// What the commands of one session start from: the files of a specification in tests/fuzz/sessions,
// simulated, and results of a calibration of them (OUT) or others.
struct Setup {
  const char* name;
  bool points;               // in place of images
  std::vector<Words> steps;  // more commands; "@" in words is the folder
  Files more = {};           // beside the simulated files
};

const std::vector<Setup>& Setups() {
  static const Words calibrate{"calibrate", "@/session.yaml", "-o", "@/out", "--no-report"};
  static const auto convert = [](const char* model, const char* out) {
    return Words{"convert", "@/truth/calibration.yaml", "--to", model, "-o", out};
  };
  static const std::vector<Setup> setups{
      {"ordinary",
       true,
       {calibrate, convert("pinhole", "@/cahvor"), convert("scaramuzza+skew", "@/ocamcalib")}},
      {"fisheye", true, {calibrate}},
      {"stereo",
       true,
       {calibrate,
        {"calibrate", "@/session.yaml", "-o", "@/second", "--exclude", "frame: '000100'"}},
       {{"bars.yaml",
         "plenocal: 1\nlimit: {constant: 2 mm, per_metre: 1 mm}\nlines:\n  - name: row\n    bars:\n"
         "      - {between: [0, 1], length: 0.03, sigma: 3 um}\n"
         "      - {between: [0, 4], length: 0.12, sigma: 3 um}\n"}}},
      {"plenoptic", true, {calibrate}},
      {"scene", true, {}},
      {"loop", true, {{"groundtruth", "@/recording.yaml", "-o", "@/out"}}},
      {"images",
       false,
       {calibrate},
       {{"times.txt",
         "000100 5.00 3.0\n000105 5.25 3.1\n000110 5.50 2.9\n000115 5.75 3.0\n000120 6.00 3.0\n"},
        {"recording.yaml",
         "plenocal: 1\ncameras:\n  left: {images: left, times: times.txt}\n"
         "  right: {images: right, times: times.txt}\n"},
        {"recorded.yaml",
         "plenocal: 1\ntarget: target.yaml\noptions: {frames: 4}\ncameras:\n"
         "  left: {model: pinhole-radtan, images: left/*.png, times: times.txt}\n"
         "  right: {model: pinhole-radtan, images: right/*.png, times: times.txt}\n"}}},
      {"raw", false, {calibrate}}};
  return setups;
}

Words In(const fs::path& folder, Words words) {
  for (std::string& word : words) {
    for (size_t at = 0; (at = word.find('@', at)) != std::string::npos;) {
      word.replace(at, 1, folder.string());
    }
  }
  return words;
}

Files FilesIn(const fs::path& folder) {
  Files files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    const std::string name = fs::relative(entry.path(), folder).string();
    if (entry.is_regular_file()) files[name] = ContentOf(entry.path());
  }
  return files;
}

void WriteFiles(const Files& files, const fs::path& folder) {
  for (const auto& [name, content] : files) {
    fs::create_directories((folder / name).parent_path());
    std::ofstream(folder / name, std::ios::binary) << content;
  }
}

Files MakeSession(const Setup& setup, const fs::path& folder) {
  fs::remove_all(folder);
  fs::create_directories(folder);
  const CapturedStreams streams(folder / "console");
  for (const char* board : {"board_20mm.yaml", "board_30mm.yaml"}) {
    fs::copy_file(fs::path(PLENOCAL_FUZZ_SESSIONS) / board, folder / board);
  }
  fs::copy_file(fmt::format("{}/{}.yaml", PLENOCAL_FUZZ_SESSIONS, setup.name),
                folder / "spec.yaml");
  Words simulate{"simulate", "@/spec.yaml", "-o", "@", "--threads", "1"};
  if (setup.points) simulate.emplace_back("--points");
  const RunScope scope;
  RunWords(In(folder, simulate));
  for (const Words& step : setup.steps) RunWords(In(folder, step));
  WriteFiles(setup.more, folder);
  Files files = FilesIn(folder);
  std::erase_if(files, [](const auto& file) {
    return file.first == "console" || file.first.find("report.html") != std::string::npos ||
           file.first.find(".cache") != std::string::npos;
  });
  return files;
}

const Files& SessionFiles(const std::string& name, const fs::path& folder) {
  static std::map<std::string, Files> made;
  if (const auto found = made.find(name); found != made.end()) return found->second;
  const auto setup = std::ranges::find(Setups(), name, &Setup::name);
  return made[name] = MakeSession(*setup, folder);
}

// ---- what results must be

// NaN is never allowed. Infinity is allowed where docs/formats.md declares it: standard errors that
// are not determined, points and distances at infinity, differences of lenses without a common
// pixel; not in JSON, SVG and pages.
bool MayBeInfinite(const std::string& name, std::string_view line, std::string_view column) {
  constexpr std::string_view kDeclared[] = {
      "difference", "distance", "nearest", "farthest", "projection", "x", "y", "z"};
  if (name.ends_with(".csv")) {
    return column.find("sigma") != std::string_view::npos || column.starts_with("cov_") ||
           column.starts_with("noise_") ||
           std::ranges::find(kDeclared, column) != std::end(kDeclared);
  }
  const std::string_view key = line.substr(0, line.find(':'));
  return name.ends_with(".yaml") && (line.find("sigma") != std::string_view::npos ||
                                     key.ends_with("difference") || key.ends_with("projection"));
}

std::string_view WordOf(std::string_view text, size_t begin) {
  size_t end = begin;
  while (end < text.size() &&
         (std::isalnum(static_cast<unsigned char>(text[end])) != 0 || text[end] == '_')) {
    ++end;
  }
  return text.substr(begin, end - begin);
}

// Without the program of a page and its pictures, whose letters may be "nan".
std::string WithoutProgramAndPictures(std::string text) {
  const size_t begin = text.find("<script>\"use strict\"");
  if (begin != std::string::npos) text.erase(begin, text.find("</script>", begin) - begin);
  for (size_t at = 0; (at = text.find("base64,", at)) != std::string::npos;) {
    text.erase(at, text.find('"', at) - at);
  }
  return text;
}

// Whether a word is not a number of the program's: a name in quotes, or YAML's .nan in a text that
// a page has from a file.
bool IsOfInput(std::string_view name, std::string_view line, size_t at, size_t size) {
  if (at == 0) return false;
  return (line[at - 1] == '\'' && line.substr(at + size).starts_with('\'')) ||
         (line[at - 1] == '.' && name.ends_with(".html"));
}

void RequireNumbers(const std::string& name, const std::string& text) {
  std::istringstream lines(WithoutProgramAndPictures(text));
  std::vector<std::string> header;
  bool in_sigmas = false;  // of YAML: lines below "sigma:"
  for (std::string line; std::getline(lines, line);) {
    // Messages of readers quote the input, which may be 'nan'.
    if (name == "console" && line.find("expected ") != std::string::npos) continue;
    std::istringstream cells(line);
    if (header.empty()) {
      for (std::string cell; std::getline(cells, cell, ',');) header.push_back(cell);
    }
    if (line.find(':') != std::string::npos) in_sigmas = line.find("sigma") != std::string::npos;
    size_t column = 0;
    for (size_t at = 0; at < line.size(); ++at) {
      if (line[at] == ',') ++column;
      const std::string_view word = WordOf(line, at);
      if (word.empty()) continue;
      if (IsOfInput(name, line, at, word.size())) {
        at += word.size() - 1;
        continue;
      }
      const bool infinite = word == "inf" || word == "Infinity";
      if (word == "nan" || word == "NaN" ||
          (infinite && name != "console" && !(in_sigmas && name.ends_with(".yaml")) &&
           !MayBeInfinite(name, line, column < header.size() ? header[column] : ""))) {
        throw std::logic_error(fmt::format(
            "{} has '{}': {}", name, word, line.substr(at - std::min<size_t>(at, 250), 500)));
      }
      at += word.size() - 1;
    }
  }
}

// Results are read again, but for the target file of `init`, which the user completes.
void RequireReadableResult(const fs::path& path) {
  static const std::map<std::string, std::string> readers{{"calibration.yaml", "calibration"},
                                                          {"target.yaml", "target"},
                                                          {"session.yaml", "session"},
                                                          {"poses.csv", "poses"},
                                                          {"correlations.csv", "correlations"},
                                                          {"groundtruth.yaml", "groundtruth"}};
  const auto found = readers.find(path.filename().string());
  if (found == readers.end() || path.parent_path().filename() == "initial") return;
  try {
    FindReader(found->second).read(path);
  } catch (const Error& error) {
    throw std::logic_error(fmt::format("a result is refused: {}", error.what()));
  }
}

void CheckResults(const fs::path& folder, const Files& given) {
  constexpr std::string_view kText[] = {
      ".yaml", ".csv", ".json", ".txt", ".ply", ".html", ".svg", ".xml"};
  for (const auto& [name, content] : FilesIn(folder)) {
    const auto was = given.find(name);
    if (was != given.end() && was->second == content) continue;
    const std::string extension = fs::path(name).extension().string();
    if (name != "console" && std::ranges::find(kText, extension) == std::end(kText)) continue;
    RequireNumbers(name, content);
    RequireReadableResult(folder / name);
  }
}

// A refusal of an input names a file or a camera; one of the job is about all that it was given.
void RequirePlace(const Error& error, const fs::path& folder) {
  if (error.kind() != ErrorKind::kInput) return;
  const std::string_view message = error.what();
  for (const std::string& place : Words{folder.string(), "left", "right", "plenoptic"}) {
    if (message.find(place) != std::string_view::npos) return;
  }
  throw std::logic_error(fmt::format("a refusal that names no file: {}", message));
}

// ---- the commands

struct FuzzedCommand {
  std::string name;
  const char* session;
  Words words;
};

// The names of the session's files that a command reads.
using Inputs = std::map<std::string, std::vector<std::string>>;

void RunCommandOn(const FuzzedCommand& command, const fs::path& choices_file) {
  SilenceSolver();
  static Inputs inputs_of;
  const fs::path folder = choices_file.parent_path() / "session";
  Files files = SessionFiles(command.session, folder);
  const std::string input = ContentOf(choices_file);
  Choices choices(input);
  if (!choices.Empty() && !inputs_of.contains(command.name)) {
    const fs::path empty = choices_file.parent_path() / "none";
    std::ofstream(empty).close();
    RunCommandOn(command, empty);
  }
  if (!choices.Empty()) Mutate(inputs_of.at(command.name), &choices, &files);
  fs::remove_all(folder);
  WriteFiles(files, folder);
  try {
    const CapturedStreams streams(folder / "console");
    const RunScope scope;
    RunWords(In(folder, command.words));
    if (!inputs_of.contains(command.name)) {
      for (const auto& [name, content] : files) {
        if (InputAt(folder / name)) inputs_of[command.name].push_back(name);
      }
    }
  } catch (const Error& error) {
    RequirePlace(error, folder);
    throw;
  }
  CheckResults(folder, files);
}

std::vector<FuzzedCommand> AllCommands() {
  std::vector<FuzzedCommand> commands;
  const auto add = [&](const char* name, const char* session, const std::string& line) {
    std::istringstream text(line);
    Words words{std::istream_iterator<std::string>(text), {}};
    commands.push_back({name, session, words});
  };
  const std::string calibrate = "calibrate @/session.yaml -o @/result --threads 1";
  for (const char* session : {"ordinary", "fisheye", "stereo", "plenoptic", "scene", "images"}) {
    add(session, session, calibrate);
    commands.back().name = fmt::format("calibrate_{}", session);
  }
  add("calibrate_jackknife", "ordinary", calibrate + " --jackknife --json");
  add("detect", "images", "detect @/session.yaml -o @/result --threads 1");
  add("try",
      "ordinary",
      "try @/session.yaml --models pinhole,pinhole-radtan4 --folds 2 -o @/result --threads 1");
  add("locate",
      "ordinary",
      "locate @/out/calibration.yaml @/target.yaml @/detections_left.csv --camera left --json --threads 1");
  add("locate_images",
      "images",
      "locate @/out/calibration.yaml @/target.yaml @/left/000100.png --camera left -o @/located.csv --threads 1");
  add("compare",
      "stereo",
      "compare @/out/calibration.yaml @/second/calibration.yaml --space --distance 0.5 inf -o @/result --threads 1");
  add("compare_check",
      "stereo",
      "compare @/out/calibration.yaml --check @/session.yaml --threads 1");
  add("compare_truths",
      "loop",
      "compare @/out/groundtruth.yaml @/out/groundtruth.yaml -o @/result --threads 1");
  add("suggest", "ordinary", "suggest @/out --count 1 --picture @/next.svg --json --threads 1");
  add("suggest_session", "fisheye", "suggest @/session.yaml --count 1 --threads 1");
  add("rectify",
      "images",
      "rectify @/out/calibration.yaml @/left @/right -o @/result --maps --mask --threads 1");
  add("undistort",
      "images",
      "undistort @/out/calibration.yaml --camera left @/left/000100.png -o @/result --mask --threads 1");
  add("map", "images", "map @/out/calibration.yaml --camera left -o @/result --threads 1");
  add("convert", "ordinary", "convert @/out/calibration.yaml --to kannala-brandt4 -o @/result");
  add("convert_fisheye",
      "fisheye",
      "convert @/out/calibration.yaml --to pinhole-radtan8 -o @/result");
  add("evaluate",
      "loop",
      "evaluate --estimate @/truth/segments_left.txt --truth @/out/segments_left.txt --json");
  add("groundtruth", "loop", "groundtruth @/recording.yaml -o @/result --threads 1");
  add("recording", "images", "recording @/recording.yaml --exposures -o @/result --threads 1");
  add("calibrate_recording", "images", "calibrate @/recorded.yaml -o @/result --threads 1");
  add("init", "images", "init @/left -o @/initial/session.yaml --threads 1");
  add("triangulate",
      "stereo",
      "triangulate @/out left=@/detections_left.csv right=@/detections_right.csv --length 0,1 --angle 0,1,6 --plane 0,1,6,7 -o @/result --threads 1");
  add("triangulate_adjusted",
      "stereo",
      "triangulate @/out left=@/detections_left.csv right=@/detections_right.csv --adjust --json --threads 1");
  add("triangulate_plenoptic",
      "plenoptic",
      "triangulate @/out plenoptic=@/detections_plenoptic.csv --length 0,1 -o @/result --threads 1");
  add("accept",
      "stereo",
      "accept @/out @/bars.yaml left=@/detections_left.csv right=@/detections_right.csv -o @/result --threads 1");
  add("accuracy", "stereo", "accuracy @/out -o @/result --threads 1");
  add("handeye", "stereo", "handeye @/out --poses @/second/poses.csv -o @/handeye.yaml");
  add("merge", "stereo", "merge @/out @/second -o @/result");
  add("report", "stereo", "report @/out");
  add("white", "raw", "white @/session.yaml -o @/result --threads 1");
  add("calibrate_raw", "raw", calibrate);
  add("focus",
      "raw",
      "focus @/plenoptic/000100.png --grid @/out/micro_lenses_plenoptic.csv -o @/result --threads 1");
  add("views",
      "raw",
      "views @/plenoptic/000100.png --white @/plenoptic_white --views 2 -o @/result --threads 1");
  for (const char* session : {"ordinary", "plenoptic"}) {
    add(session, session, "simulate @/spec.yaml --points -o @/result --threads 1");
    commands.back().name = fmt::format("simulate_{}", session);
  }
  // What holds their cameras.
  static const std::map<std::string_view, std::pair<const char*, const char*>> special{
      {"aria", {"fisheye", "out"}},
      {"lifcal", {"plenoptic", "out"}},
      {"dso", {"ordinary", "out"}},
      {"metashape", {"ordinary", "out"}},
      {"openmvg", {"ordinary", "truth"}},
      {"cahvor", {"ordinary", "cahvor"}},
      {"ocamcalib", {"ordinary", "ocamcalib"}}};
  for (const CameraFormat& format : CameraFormats()) {
    const auto found = special.find(format.name);
    const auto [session, from] =
        found == special.end() ? std::pair{"stereo", "out"} : found->second;
    add("",
        session,
        fmt::format("export @/{}/calibration.yaml --format {} -o @/result/file",
                    from,
                    format.variant_of.empty() ? format.name : format.variant_of));
    // The folder of openmvg needs the images' poses, which a truth has not.
    commands.back().words.back() += format.name == "openmvg" ? ".json" : format.extension;
    commands.back().name = fmt::format("export_{}", format.name);
  }
  return commands;
}

}  // namespace

std::vector<Reader> Commands() {
  std::vector<Reader> commands;
  for (const FuzzedCommand& command : AllCommands()) {
    commands.push_back({.name = "run_" + command.name,
                        .file = "choices",
                        .read = [command](const fs::path& path) { RunCommandOn(command, path); },
                        .names_file = false,
                        .is_command = true});
  }
  return commands;
}

}  // namespace plenocal::fuzz
