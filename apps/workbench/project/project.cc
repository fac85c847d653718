// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/project/project.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "calib/base/format_error.h"
#include "calib/io/detection_cache.h"
#include "models/registry.h"

namespace plenocal::workbench {
namespace {

namespace fs = std::filesystem;

std::string ContentOf(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  std::ostringstream text;
  text << stream.rdbuf();
  return text.str();
}

// An editor that writes in place leaves a file empty for a moment, which is no version of it.
std::string WrittenContentOf(const fs::path& file) {
  constexpr int kTries = 20;
  std::string text = ContentOf(file);
  for (int i = 0; i < kTries && text.empty(); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    text = ContentOf(file);
  }
  return text;
}

// All or nothing, so that a killed server leaves one of the two texts. A symbolic link stays.
void ReplaceFile(const fs::path& named, const std::string& text) {
  std::error_code error;
  const fs::path file = fs::is_symlink(named, error) ? fs::canonical(named) : named;
  const fs::path partial = file.string() + ".partial";
  {
    std::ofstream stream(partial, std::ios::binary | std::ios::trunc);
    stream << text;
    stream.flush();
    if (!stream) {
      const std::string reason = std::strerror(errno);
      fs::remove(partial, error);
      throw JobError("{}: cannot be written: {}", file.string(), reason);
    }
  }
  fs::rename(partial, file);
}

}  // namespace

Project::Project(const fs::path& place) {
  std::error_code error;
  if (!fs::exists(place, error)) {
    throw InputError("{}: no such file or folder; check the path", place.string());
  }
  const bool is_folder = fs::is_directory(place);
  root_ = fs::canonical(is_folder ? place : fs::absolute(place).parent_path());
  session_ = root_ / (is_folder ? fs::path("session.yaml") : place.filename());
  history_ = root_ / ".plenocal" / "history";
  fs::create_directories(history_, error);
  if (error) {
    throw JobError("{}: cannot be written: {}", history_.string(), error.message());
  }
  lock_ = open((root_ / ".plenocal" / "lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  if (lock_ < 0 || flock(lock_, LOCK_EX | LOCK_NB) != 0) {
    if (lock_ >= 0) close(lock_);
    throw JobError("{}: another workbench has this folder; use its page, or end it first",
                   root_.string());
  }
  ReadHistory();
}

Project::~Project() { close(lock_); }

std::string Project::Relative(std::string message) const {
  const std::string root = root_.string() + "/";
  for (size_t at = message.find(root); at != std::string::npos; at = message.find(root, at)) {
    message.erase(at, root.size());
  }
  return message;
}

bool Project::HasSession() const {
  std::error_code error;
  return fs::is_regular_file(session_, error);
}

std::string Project::VersionText(int number) const {
  return ContentOf(history_ / fmt::format("{:04}.yaml", number));
}

// log.jsonl has a line for each version; undo and redo follow from it.
void Project::ReadHistory() {
  std::ifstream log(history_ / "log.jsonl");
  for (std::string line; std::getline(log, line);) {
    const nlohmann::json entry = nlohmann::json::parse(line, nullptr, false);
    if (!entry.is_object() || !entry.contains("number")) continue;
    const std::string kind = entry.value("kind", "edit");
    const int number = entry.value("number", 0);
    if (kind == "undo" && !undo_.empty()) {
      redo_.push_back(current_);
      undo_.pop_back();
    } else if (kind == "redo" && !redo_.empty()) {
      undo_.push_back(current_);
      redo_.pop_back();
    } else if (current_ > 0) {
      undo_.push_back(current_);
      redo_.clear();
    }
    current_ = number;
    last_ = std::max(last_, number);
  }
}

void Project::Record(const std::string& kind, const std::string& text) {
  ++last_;
  ReplaceFile(history_ / fmt::format("{:04}.yaml", last_), text);
  const fs::path log = history_ / "log.jsonl";
  const nlohmann::json entry{{"number", last_}, {"kind", kind}, {"time", std::time(nullptr)}};
  ReplaceFile(log, ContentOf(log) + entry.dump() + "\n");
  current_ = last_;
}

SessionVersion Project::Now() {
  if (!HasSession()) return {};
  SessionVersion version;
  version.text = WrittenContentOf(session_);
  version.hash = HashFile(session_);
  if (current_ == 0 || VersionText(current_) != version.text) {
    if (current_ > 0) undo_.push_back(current_);
    redo_.clear();
    Record("edit", version.text);
  }
  version.undo = !undo_.empty();
  version.redo = !redo_.empty();
  return version;
}

SessionVersion Project::ReadVersion() {
  const std::lock_guard lock(mutex_);
  return Now();
}

Session Project::Parsed() {
  const SessionVersion version = ReadVersion();
  return ParseSession(version.text, session_, CameraModels());
}

std::optional<SessionVersion> Project::Write(const std::string& text, const std::string& hash) {
  const std::lock_guard lock(mutex_);
  const SessionVersion now = Now();
  if (!hash.empty() && hash != now.hash) return std::nullopt;
  if (text != now.text) {
    ReplaceFile(session_, text);
    if (current_ > 0) undo_.push_back(current_);
    redo_.clear();
    Record("edit", text);
  }
  return Now();
}

void Project::WriteFile(const fs::path& file, const std::string& text) {
  const std::lock_guard lock(mutex_);
  ReplaceFile(file, text);
}

std::optional<SessionVersion> Project::Step(std::vector<int>* from, const char* kind) {
  const std::lock_guard lock(mutex_);
  Now();
  if (from->empty()) return std::nullopt;
  const std::string text = VersionText(from->back());
  from->pop_back();
  (from == &undo_ ? redo_ : undo_).push_back(current_);
  ReplaceFile(session_, text);
  Record(kind, text);
  return Now();
}

std::optional<SessionVersion> Project::Undo() { return Step(&undo_, "undo"); }

std::optional<SessionVersion> Project::Redo() { return Step(&redo_, "redo"); }

std::vector<int> Project::Runs() const {
  std::vector<int> runs;
  std::error_code error;
  if (fs::is_regular_file(root_ / "calibration.yaml", error)) runs.push_back(0);
  for (const auto& entry : fs::directory_iterator(root_ / "runs", error)) {
    const std::string name = entry.path().filename().string();
    int number = 0;
    const auto parsed = std::from_chars(name.data(), name.data() + name.size(), number);
    if (parsed.ec != std::errc() || parsed.ptr != name.data() + name.size() || number < 1) continue;
    if (fs::is_regular_file(entry.path() / "calibration.yaml", error)) runs.push_back(number);
  }
  std::ranges::sort(runs);
  return runs;
}

fs::path Project::RunFolder(int run) const {
  return run == 0 ? root_ : root_ / "runs" / std::to_string(run);
}

int Project::NextRun() const {
  int next = 1;
  std::error_code error;
  while (fs::exists(RunFolder(next), error)) ++next;
  return next;
}

}  // namespace plenocal::workbench
