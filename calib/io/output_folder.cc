// SPDX-License-Identifier: Apache-2.0
#include "calib/io/output_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <mutex>
#include <optional>
#include <set>
#include <system_error>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/quoted_text.h"
#include "calib/io/announced_moves.h"
#include "calib/io/input_file.h"
#include "calib/io/result_text.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

constexpr const char* kIncomplete = "incomplete";  // name of `kComplete` until it is on the disk

[[noreturn]] void Fail(const fs::path& path, const std::string& what) {
  throw JobError("{}: {}", path.string(), what);
}

// A file descriptor; `Fail`s for what cannot be opened.
class Descriptor {
 public:
  Descriptor(const fs::path& path, int flags)
      : Descriptor(path, open(path.c_str(), flags | O_CLOEXEC, 0666), kNothingChanged) {}
  // Takes an open file; `consequence` ends the message of a write that fails.
  Descriptor(fs::path path, int number, const char* consequence)
      : path_(std::move(path)), number_(number), consequence_(consequence) {
    if (number_ < 0) Fail(path_, fmt::format("cannot be written: {}", std::strerror(errno)));
  }
  ~Descriptor() {
    if (number_ >= 0) close(number_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;

  // Reports no result; throws what would be lost.
  void WriteAll(const std::string& content) const {
    for (size_t written = 0; written < content.size();) {
      const ssize_t count = write(number_, content.data() + written, content.size() - written);
      if (count < 0 && errno == EINTR) continue;
      if (count <= 0) FailToWrite(count < 0 ? errno : ENOSPC);
      written += static_cast<size_t>(count);
    }
  }
  // Has the content written to the disk without waiting; errors show in `Sync`.
  void StartSync() const { sync_file_range(number_, 0, 0, SYNC_FILE_RANGE_WRITE); }
  // Waits until the content is on the disk. Some file systems cannot tell, and some report a full
  // disk only here or in `Close`.
  void Sync() const {
    if (fsync(number_) != 0 && errno != EINVAL && errno != ENOTSUP) FailToWrite(errno);
  }
  void Close() {
    if (close(std::exchange(number_, -1)) != 0) FailToWrite(errno);
  }

 private:
  static constexpr const char* kNothingChanged = "; nothing was changed in the output folder";

  [[noreturn]] void FailToWrite(int error) const {
    Fail(path_, fmt::format("cannot be written: {}{}", std::strerror(error), consequence_));
  }

  fs::path path_;
  int number_;
  const char* consequence_;
};

// Refuses to replace anything but a regular file by a result.
void RefuseIrregular(const fs::path& place) {
  struct stat status {};
  if (lstat(place.c_str(), &status) != 0 || S_ISREG(status.st_mode)) return;
  Fail(place,
       fmt::format("is a {} where a result file belongs; move it or give another -o",
                   S_ISDIR(status.st_mode)   ? "folder"
                   : S_ISLNK(status.st_mode) ? "symbolic link"
                                             : "device, pipe or socket"));
}

[[noreturn]] void RefuseOutput(const fs::path& path, const std::string& what) {
  throw InputError("{}: {}", path.string(), what);
}

// True for what stands for an open file of this process, such as /proc/self/fd/1.
bool IsOpenFile(const fs::path& path) {
  std::error_code error;
  return fs::is_symlink(path, error) && fs::equivalent(path.parent_path(), "/proc/self/fd", error);
}

// The end of a chain of symbolic links, which need not be there.
fs::path EndOfLinks(const fs::path& file) {
  constexpr int kMostLinks = 40;  // as the system's
  fs::path end = file;
  std::error_code error;
  for (int links = 0; fs::is_symlink(end, error) && !IsOpenFile(end); ++links) {
    if (links == kMostLinks) RefuseOutput(file, "is a symbolic link that leads to itself");
    end = end.parent_path() / fs::read_symlink(end);
  }
  return end;
}

// True for what is written to and never replaced; refuses what can be neither.
bool IsWrittenDirectly(const fs::path& file) {
  struct stat status {};
  if (IsOpenFile(file)) return true;
  if (stat(file.c_str(), &status) != 0 || S_ISREG(status.st_mode)) return false;
  if (S_ISFIFO(status.st_mode) || S_ISCHR(status.st_mode)) return true;
  RefuseOutput(file,
               fmt::format("is a {}; name a file to write",
                           S_ISDIR(status.st_mode) ? "folder" : "block device or socket"));
}

int OpenDirectly(const fs::path& file) {
  // Opened anew, an open file would lose its offset, behind which others may have written.
  if (IsOpenFile(file)) return fcntl(std::stoi(file.filename()), F_DUPFD_CLOEXEC, 0);
  while (true) {
    // A FIFO waits for its reader.
    const int number = open(file.c_str(), O_WRONLY | O_NOCTTY | O_CLOEXEC);
    if (number >= 0 || errno != EINTR) return number;
  }
}

// A folder that may be entered but not read cannot be waited for.
void SyncFolder(const fs::path& folder) {
  if (access(folder.c_str(), R_OK) == 0) Descriptor(folder, O_RDONLY | O_DIRECTORY).Sync();
}

// The place of a result: `folder` / `name`. Names come from files as well: a place outside of the
// folder, also by a symbolic link, is refused.
fs::path PlaceOf(const fs::path& folder, const fs::path& name) {
  const auto refuse = [&](const char* reason) {
    Fail(folder, fmt::format("'{}' {}", Escaped(name.string()), reason));
  };
  if (name.empty() || name.is_absolute() || !name.has_filename()) refuse("is no name of a result");
  fs::path place = folder;
  for (const fs::path& part : name) {
    if (part == "..") refuse("leads out of the output folder; give cameras and frames other names");
    std::error_code error;
    if (place != folder && fs::is_symlink(place, error)) {
      refuse("lies behind a symbolic link; remove the link or give another -o");
    }
    place /= part;
  }
  return place;
}

// The files in `partial`, relative to it; calibration.yaml last, so that who waits
// for it finds the others.
std::vector<fs::path> FilesIn(const fs::path& partial) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(partial)) {
    if (!entry.is_regular_file() || entry.is_symlink() || entry.path() == partial / kComplete) {
      continue;
    }
    files.push_back(entry.path().lexically_relative(partial));
  }
  std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    return std::pair(a == "calibration.yaml", a) < std::pair(b == "calibration.yaml", b);
  });
  return files;
}

// Waits until these files in `partial` and all folders on the way to them are on the disk.
void SyncFiles(const fs::path& partial, const std::vector<fs::path>& files) {
  // All are under way before the first is waited for: a journal then takes them together.
  for (const fs::path& file : files) Descriptor(partial / file, O_RDONLY).StartSync();
  std::set<fs::path> folders{partial};
  for (const fs::path& file : files) {
    Descriptor(partial / file, O_RDONLY).Sync();
    for (fs::path part = (partial / file).parent_path(); part != partial;
         part = part.parent_path()) {
      folders.insert(part);
    }
  }
  for (const fs::path& folder : folders) SyncFolder(folder);
}

// The moves of the files of a complete ".partial" to their places.
struct Moves {
  std::vector<std::string> removed;
  std::vector<std::pair<std::string, std::string>> renamed;
  std::set<fs::path> folders;  // of the places
};

Moves ListMoves(const fs::path& partial, const fs::path& folder) {
  Moves moves{{}, {}, {folder}};
  for (const fs::path& file : FilesIn(partial)) {
    const fs::path place = PlaceOf(folder, file);
    for (fs::path part = place.parent_path(); part != folder; part = part.parent_path()) {
      moves.folders.insert(part);
    }
    moves.renamed.emplace_back((partial / file).string(), place.string());
  }
  std::ifstream list(partial / kComplete);
  for (std::string name; std::getline(list, name);) {
    moves.removed.push_back(PlaceOf(folder, name).string());
  }
  return moves;
}

// Makes the moves; 0 or the error's number. In a child process, which a signal to this one (or to
// its terminal) does not reach.
int MakeInChild(const Moves& moves) {
  const pid_t child = fork();
  if (child == 0) {
    // Other threads do not exist here and may have held locks: system calls only.
    setsid();
    for (const std::string& path : moves.removed) {
      if (unlink(path.c_str()) != 0 && errno != ENOENT) _exit(std::min(errno, 255));
    }
    for (const auto& [from, to] : moves.renamed) {
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

// Moves the files of a complete `partial` to their places and waits until that is on the disk. A
// part of the moves is left to the next run when it fails.
void MoveAll(const fs::path& partial, const fs::path& folder) {
  const Moves moves = ListMoves(partial, folder);
  for (const fs::path& place : moves.folders) {
    std::error_code error;
    fs::create_directories(place, error);
    if (error) Fail(place, "this folder cannot be made: " + error.message());
  }
  if (const int failure = MakeInChild(moves); failure != 0) {
    Fail(folder,
         fmt::format("some of its files are replaced and others cannot be: {}; mend this, and the "
                     "next run that uses this folder completes it",
                     std::strerror(failure)));
  }
  for (const fs::path& place : moves.folders) SyncFolder(place);
}

// The folders of this process, and the right to write and commit.
struct OpenFolders {
  std::mutex mutex;
  std::set<OutputFolder*> folders;
};

OpenFolders& AllOpenFolders() {
  static OpenFolders all;
  return all;
}

}  // namespace

std::unique_ptr<OutputFolder> OpenOutput(const fs::path& folder) {
  return folder.empty() ? nullptr : std::make_unique<OutputFolder>(folder);
}

OutputFolder::OutputFolder(const fs::path& folder)
    : folder_(folder.has_filename() ? folder : folder.parent_path()) {
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
  Lock();
  try {
    if (IsAnnounced(folder_)) MoveAll(Partial(), folder_);
  } catch (...) {
    close(lock_);
    throw;
  }
  fs::remove_all(Partial(), error);
  const std::lock_guard lock(AllOpenFolders().mutex);
  AllOpenFolders().folders.insert(this);
}

void OutputFolder::Lock() {
  lock_ = open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  // File systems without locks do without.
  int tries = 1;
  while (flock(lock_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK && tries++ < kTries) {
    usleep(kPause);
  }
  if (tries > kTries) {
    close(lock_);
    Fail(folder_,
         "another run of plenocal writes into this output folder; wait for it or give another -o");
  }
}

OutputFolder::~OutputFolder() {
  const std::lock_guard lock(AllOpenFolders().mutex);
  AllOpenFolders().folders.erase(this);
  Discard();
  close(lock_);
}

void OutputFolder::Discard() {
  std::error_code error;
  // Announced files are moved by the next run.
  if (!announced_) fs::remove_all(Partial(), error);
  // Removes empty folders only.
  for (const auto& made : made_) fs::remove(made, error);
}

void OutputFolder::RefuseInputs(const std::vector<std::string>& names) const {
  for (const std::string& name : names) {
    const fs::path place = PlaceOf(folder_, name);
    RefuseIrregular(place);
    const std::optional<fs::path> input = InputAt(place);
    if (!input) continue;
    throw InputError("{}: the results would replace this input; give another place with -o",
                     input->string());
  }
}

void OutputFolder::Write(const std::string& name, const std::string& content) {
  RefuseNan(name, content);
  const std::lock_guard lock(AllOpenFolders().mutex);
  RefuseInputs({name});
  const fs::path path = Partial() / name;
  std::error_code error;
  fs::create_directories(path.parent_path(), error);
  if (error) Fail(path.parent_path(), "this folder cannot be made: " + error.message());
  try {
    Descriptor file(path, O_WRONLY | O_CREAT | O_TRUNC);
    file.WriteAll(content);
    file.Close();
  } catch (const Error&) {
    // A part of a file must not be committed by whoever goes on without it.
    fs::remove(path, error);
    throw;
  }
}

void OutputFolder::Commit() {
  const std::lock_guard lock(AllOpenFolders().mutex);
  // Before the first is replaced, so that it is all or none.
  std::error_code error;
  if (!fs::exists(Partial(), error)) return;
  const std::vector<fs::path> files = FilesIn(Partial());
  for (const fs::path& file : files) {
    RefuseInputs({file.string()});
    for (fs::path parent = file.parent_path(); !parent.empty(); parent = parent.parent_path()) {
      if (fs::exists(folder_ / parent, error) && !fs::is_directory(folder_ / parent, error)) {
        Fail(folder_ / parent, "is a file where a folder of results belongs; move it");
      }
    }
  }
  for (const std::string& name : removed_) RefuseIrregular(PlaceOf(folder_, name));
  Descriptor list(Partial() / kIncomplete, O_WRONLY | O_CREAT | O_TRUNC);
  for (const std::string& name : removed_) {
    // Rename replaces a file that was written again; whoever completes these moves once more must
    // not remove the new one.
    if (!fs::exists(Partial() / name, error)) list.WriteAll(name + "\n");
  }
  list.Close();
  SyncFiles(Partial(), FilesIn(Partial()));
  for (const fs::path& made : made_) SyncFolder(made.parent_path());
  fs::rename(Partial() / kIncomplete, Partial() / kComplete, error);
  if (error) Fail(Partial() / kComplete, "cannot be written: " + error.message());
  announced_ = true;
  SyncFolder(Partial());
  SyncFolder(folder_);
  MoveAll(Partial(), folder_);
  announced_ = false;
  made_.clear();
  fs::remove_all(Partial(), error);
}

void WriteOutput(const fs::path& file, std::string content) {
  OutputContents one;
  one.emplace_back(file.filename().string(), std::move(content));
  WriteOutputs(file, std::move(one));
}

std::vector<fs::path> WriteOutputs(const fs::path& file, OutputContents contents) {
  if (!file.has_filename()) RefuseOutput(file, "names no file; name a file to write");
  const fs::path end = EndOfLinks(file);
  if (IsWrittenDirectly(end)) {
    if (contents.size() != 1) {
      RefuseOutput(file, "is a device or pipe, and there are several files to write; name a file");
    }
    Descriptor direct(file, OpenDirectly(end), "");
    direct.WriteAll(contents[0].second);
    direct.Close();
    return {file};
  }
  for (auto& [name, content] : contents) {
    if (name == file.filename()) name = end.filename();
  }
  return WriteInto(end.parent_path(), contents);
}

std::vector<fs::path> WriteInto(const fs::path& folder, const OutputContents& contents) {
  OutputFolder out(folder.empty() ? "." : folder);
  std::vector<fs::path> written;
  for (const auto& [name, content] : contents) {
    out.Write(name, content);
    written.push_back(folder / name);
  }
  out.Commit();
  return written;
}

void CompleteResults(const fs::path& path) {
  for (const fs::path& folder : AnnouncedAround(path)) {
    try {
      const OutputFolder completed(folder);
    } catch (const Error& failure) {
      if (!IsAnnounced(folder)) continue;  // another process has completed them
      throw JobError(
          "{}: a killed run left its results half moved, and they cannot be "
          "completed: {}",
          folder.string(),
          failure.what());
    }
  }
}

void AbandonOutput() {
  // Kept for good: other threads may still be at work.
  AllOpenFolders().mutex.lock();
  for (OutputFolder* const folder : AllOpenFolders().folders) folder->Discard();
}

}  // namespace plenocal
