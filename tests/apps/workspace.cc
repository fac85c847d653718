// SPDX-License-Identifier: Apache-2.0
#include "tests/apps/workspace.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/capability.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <sstream>

namespace plenocal::testing {
namespace {

namespace fs = std::filesystem;

std::string ReadText(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return std::move(text).str();
}

std::vector<std::string> Split(const std::string& line, char separator) {
  std::vector<std::string> parts;
  std::istringstream stream(line);
  for (std::string part; std::getline(stream, part, separator);) parts.push_back(part);
  if (line.ends_with(separator)) parts.emplace_back();
  return parts;
}

// In the child: never returns.
[[noreturn]] void Execute(const fs::path& folder,
                          const std::vector<std::string>& arguments,
                          const std::string& out,
                          const std::string& err,
                          const RunOptions& options) {
  const int out_file = open(out.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  const int err_file = open(err.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  if (dup2(out_file, STDOUT_FILENO) < 0 || dup2(err_file, STDERR_FILENO) < 0) _exit(126);
  if (chdir(folder.c_str()) != 0) _exit(126);
  if (options.close_streams) {
    for (const int file : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) close(file);
  }
  if (options.no_environment) clearenv();
  for (const auto& [name, value] : options.environment) setenv(name.c_str(), value.c_str(), 1);
  if (options.file_size_limit > 0) {
    const rlimit limit{options.file_size_limit, options.file_size_limit};
    if (setrlimit(RLIMIT_FSIZE, &limit) != 0) _exit(126);
  }
  if (options.open_files_limit > 0) {
    const rlimit limit{options.open_files_limit, options.open_files_limit};
    if (setrlimit(RLIMIT_NOFILE, &limit) != 0) _exit(126);
  }
  // Root obeys the permissions of files as other users do, who have nothing to drop.
  prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE);
  std::vector<char*> argv{const_cast<char*>("plenocal")};
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  execv(PLENOCAL_PROGRAM, argv.data());
  _exit(127);
}

}  // namespace

Table::Table(const std::string& text) {
  for (const std::string& line : Lines(text)) {
    if (header_.empty()) {
      header_ = Split(line, ',');
    } else {
      rows_.push_back(Split(line, ','));
      EXPECT_EQ(rows_.back().size(), header_.size()) << line;
    }
  }
}

std::vector<std::string> Table::Column(const std::string& name) const {
  const auto column = std::find(header_.begin(), header_.end(), name) - header_.begin();
  std::vector<std::string> cells;
  for (const auto& row : rows_) cells.push_back(row.at(static_cast<std::size_t>(column)));
  return cells;
}

std::vector<double> Table::Numbers(const std::string& name) const {
  std::vector<double> numbers;
  for (const std::string& cell : Column(name)) {
    numbers.push_back(cell.empty() ? std::nan("") : std::stod(cell));
  }
  return numbers;
}

Workspace::Workspace() {
  std::string name = (fs::temp_directory_path() / "plenocal_test_XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("cannot make " + name);
  folder_ = name;
}

Workspace::~Workspace() {
  std::error_code error;
  fs::remove_all(folder_, error);
}

void Workspace::Write(const std::string& name, const std::string& text) const {
  fs::create_directories(Path(name).parent_path());
  std::ofstream(Path(name), std::ios::binary) << text;
}

std::string Workspace::Read(const std::string& name) const {
  EXPECT_TRUE(fs::exists(Path(name))) << name;
  return ReadText(Path(name));
}

std::map<std::string, std::string> Workspace::Files(const std::string& folder) const {
  std::map<std::string, std::string> files;
  if (!fs::is_directory(Path(folder))) return files;
  for (const auto& entry : fs::recursive_directory_iterator(Path(folder))) {
    if (entry.is_regular_file()) {
      files[fs::relative(entry.path(), Path(folder)).string()] = ReadText(entry.path());
    }
  }
  return files;
}

std::vector<std::string> Workspace::Results(const std::string& folder) const {
  std::vector<std::string> names;
  for (const auto& [name, text] : Files(folder)) {
    if (!name.starts_with(".cache/")) names.push_back(name);
  }
  return names;
}

Outcome Workspace::Run(const std::vector<std::string>& arguments, const RunOptions& options) const {
  // Beside the folder, so that tests can list what the program wrote.
  const std::string own_err = folder_.string() + ".stderr";
  const std::string err = options.stderr_path.empty() ? own_err : options.stderr_path;
  const std::string own_out = folder_.string() + ".stdout";
  const std::string out = options.stdout_path.empty() ? own_out : options.stdout_path;
  const pid_t child = fork();
  if (child == 0) Execute(folder_, arguments, out, err, options);
  bool interrupted = false;
  int status = 0;
  while (waitpid(child, &status, options.interrupt_when && !interrupted ? WNOHANG : 0) == 0) {
    if (options.interrupt_when()) {
      kill(child, options.signal);
      interrupted = true;
    }
    usleep(200);
  }
  Outcome outcome;
  outcome.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  if (options.stderr_path.empty()) outcome.err = ReadText(own_err);
  if (options.stdout_path.empty()) outcome.out = ReadText(own_out);
  std::error_code error;
  fs::remove(own_err, error);
  fs::remove(own_out, error);
  return outcome;
}

Outcome Workspace::Calibrate(const std::string& out) const {
  Outcome outcome = Run({"calibrate", "session.yaml", "-o", out});
  EXPECT_EQ(outcome.status, kDone) << outcome.err;
  return outcome;
}

void Workspace::ExpectFailure(int status,
                              const std::vector<std::string>& parts,
                              const std::string& command) const {
  const Outcome outcome = Run({command, "session.yaml", "-o", "out", "--quiet"});
  EXPECT_EQ(outcome.status, status) << outcome.err;
  EXPECT_EQ(Lines(outcome.err).size(), 1U) << outcome.err;
  EXPECT_THAT(outcome.err, ::testing::StartsWith("plenocal: "));
  for (const std::string& part : parts) EXPECT_THAT(outcome.err, ::testing::HasSubstr(part));
  EXPECT_EQ(outcome.out, "");
  EXPECT_THAT(Results("out"), ::testing::IsEmpty());
}

void Workspace::WriteProblem(const SyntheticProblem& problem) const {
  std::string target = "plenocal: 1\ntype: chessboard\ncolumns: 10\nrows: 7\nsquare: 0.03\n";
  if (!problem.input.marker_freedom.IsRigid()) {
    target += fmt::format("tolerance: {}\n", problem.input.marker_freedom.Sigma());
  }
  Write("target.yaml", target);
  Write("session.yaml", SessionText(problem));
  for (const CameraInput& camera : problem.input.cameras) {
    Write(camera.name + ".csv", DetectionsText(camera));
  }
}

YAML::Node Workspace::Result(const std::string& out) const {
  return YAML::Load(Read(out + "/calibration.yaml"));
}

SyntheticProblem EasyProblem(int cameras, double marker_tolerance) {
  return MakeProblem(
      3, {.cameras = cameras, .frames = 10, .noise = 0.1, .marker_tolerance = marker_tolerance});
}

std::string DetectionsText(const CameraInput& camera) {
  std::string text = "frame,marker,x,y,sigma\n";
  for (const View& view : camera.views) {
    for (const Observation& o : view.observations) {
      text += fmt::format("{},{},{:.6f},{:.6f},", view.frame, o.marker, o.values[0], o.values[1]);
      text += o.detector_sigma > 0 ? fmt::format("{}\n", o.detector_sigma) : "\n";
    }
  }
  return text;
}

std::string SessionText(const SyntheticProblem& problem) {
  std::string text = "plenocal: 1\ntarget: target.yaml\ncameras:\n";
  for (const CameraInput& camera : problem.input.cameras) {
    text += fmt::format(
        "  {0}:\n    model: pinhole-radial3\n    detections: {0}.csv\n    image_size: [{1}, {2}]\n",
        camera.name,
        camera.image_size[0],
        camera.image_size[1]);
  }
  return text + "options:\n  loss: huber\n";
}

std::string Replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t place = text.find(from);
  EXPECT_NE(place, std::string::npos) << from;
  return place == std::string::npos ? text : text.replace(place, from.size(), to);
}

std::vector<std::string> Lines(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

void ExpectNoNan(const YAML::Node& node, const std::string& path) {
  if (node.IsMap()) {
    for (const auto& entry : node) ExpectNoNan(entry.second, path + "." + entry.first.Scalar());
  } else if (node.IsSequence()) {
    for (const auto& element : node) ExpectNoNan(element, path + "[]");
  } else if (node.IsScalar()) {
    EXPECT_THAT(node.Scalar(),
                ::testing::Not(::testing::MatchesRegex("[-+]?[.]?[nN][aA][nN]|[-+]?inf")))
        << path;
    EXPECT_THAT(node.Scalar(), ::testing::Not(::testing::HasSubstr("nan px"))) << path;
  }
}

Eigen::Matrix4d Matrix(const YAML::Node& node) {
  Eigen::Matrix4d T;
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 4; ++c) T(r, c) = node[r][c].as<double>();
  }
  return T;
}

}  // namespace plenocal::testing
