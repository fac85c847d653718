// SPDX-License-Identifier: Apache-2.0
#include "calib/base/output_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <system_error>
#include <utility>

#include "calib/base/error.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

// Announces that the files beside it are complete and belong one folder up; lists what goes from
// there.
constexpr const char* kComplete = "complete";

[[noreturn]] void Fail(const fs::path& path, const std::string& what) {
  throw Error(ErrorKind::kJob, fmt::format("{}: {}", path.string(), what));
}

// The files in `partial`, relative to it; the one that says "calibration" last, so that who waits
// for it finds the others.
std::vector<fs::path> FilesIn(const fs::path& partial) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(partial)) {
    if (entry.is_directory() || entry.path() == partial / kComplete) continue;
    files.push_back(fs::relative(entry.path(), partial));
  }
  std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    return std::pair(a == "calibration.yaml", a) < std::pair(b == "calibration.yaml", b);
  });
  return files;
}

// Moves the files of a complete `partial` to their places; 0 or the error's number. In a child
// process, which a signal to this one (or to its terminal) does not reach.
int MoveAll(const fs::path& partial, const fs::path& folder) {
  std::vector<std::pair<std::string, std::string>> moves;
  for (const fs::path& file : FilesIn(partial)) {
    fs::create_directories((folder / file).parent_path());
    moves.emplace_back((partial / file).string(), (folder / file).string());
  }
  std::vector<std::string> removed;
  std::ifstream list(partial / kComplete);
  for (std::string name; std::getline(list, name);) removed.push_back((folder / name).string());
  const pid_t child = fork();
  if (child == 0) {
    // Other threads do not exist here and may have held locks: system calls only.
    setsid();
    for (const std::string& path : removed) {
      if (unlink(path.c_str()) != 0 && errno != ENOENT) _exit(std::min(errno, 255));
    }
    for (const auto& [from, to] : moves) {
      if (std::rename(from.c_str(), to.c_str()) != 0) _exit(std::min(errno, 255));
    }
    _exit(0);
  }
  if (child < 0) return errno;
  int status = 0;
  while (waitpid(child, &status, 0) < 0) {
    if (errno != EINTR) return errno;
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : EINTR;
}

}  // namespace

OutputFolder::OutputFolder(fs::path folder) : folder_(std::move(folder)) {
  std::error_code error;
  for (fs::path p = fs::absolute(folder_, error).lexically_normal();
       !p.empty() && !fs::exists(p, error) && p != p.parent_path();
       p = p.parent_path()) {
    if (p.has_filename()) made_.push_back(p);
  }
  fs::create_directories(folder_, error);
  if (error) Fail(folder_, "cannot make this output folder: " + error.message());
  if (access(folder_.c_str(), W_OK | X_OK) != 0) {
    Fail(folder_, fmt::format("cannot write into this output folder: {}", std::strerror(errno)));
  }
  lock_ = open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  // File systems without locks do without. The moves of a run that was just killed take a moment.
  constexpr int kTries = 20, kPause = 50000;  // us
  int tries = 1;
  while (flock(lock_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK && tries++ < kTries) {
    usleep(kPause);
  }
  if (tries > kTries) {
    close(lock_);
    Fail(folder_,
         "another run of plenocal writes into this output folder; wait for it or give another -o");
  }
  if (fs::exists(Partial() / kComplete, error)) MoveAll(Partial(), folder_);
  fs::remove_all(Partial(), error);
}

OutputFolder::~OutputFolder() {
  std::error_code error;
  fs::remove_all(Partial(), error);
  close(lock_);
  // Removes empty folders only.
  for (const auto& made : made_) fs::remove(made, error);
}

void OutputFolder::Write(const std::string& name, const std::string& content) {
  const fs::path path = Partial() / name;
  std::error_code error;
  fs::create_directories(path.parent_path(), error);
  if (error) Fail(path.parent_path(), "this folder cannot be made: " + error.message());
  const int file = open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (file < 0) Fail(path, fmt::format("cannot be written: {}", std::strerror(errno)));
  size_t written = 0;
  bool good = true;
  while (good && written < content.size()) {
    const ssize_t count = write(file, content.data() + written, content.size() - written);
    if (count < 0 && errno == EINTR) continue;
    good = count > 0;
    if (good) written += static_cast<size_t>(count);
  }
  const int write_error = errno;
  // Some file systems report a full disk only here.
  const bool closed = close(file) == 0;
  if (!good || !closed) {
    Fail(path,
         fmt::format("cannot be written: {}; nothing was changed in the output folder",
                     std::strerror(good ? errno : write_error)));
  }
}

void OutputFolder::Commit() {
  // Before the first is replaced, so that it is all or none.
  std::error_code error;
  if (!fs::exists(Partial(), error)) return;
  for (const fs::path& file : FilesIn(Partial())) {
    if (fs::is_directory(folder_ / file, error)) {
      Fail(folder_ / file, "is a folder where a result file belongs; move it or give another -o");
    }
    for (fs::path parent = file.parent_path(); !parent.empty(); parent = parent.parent_path()) {
      if (fs::exists(folder_ / parent, error) && !fs::is_directory(folder_ / parent, error)) {
        Fail(folder_ / parent, "is a file where a folder of results belongs; move it");
      }
    }
  }
  std::string removed;
  for (const std::string& name : removed_) {
    // Rename replaces a file that was written again; whoever completes these moves once more must
    // not remove the new one.
    if (!fs::exists(Partial() / name, error)) removed += name + "\n";
  }
  Write(kComplete, removed);
  if (const int failure = MoveAll(Partial(), folder_); failure != 0) {
    Fail(folder_, fmt::format("cannot replace its files: {}", std::strerror(failure)));
  }
  fs::remove_all(Partial(), error);
  made_.clear();
}

}  // namespace plenocal
