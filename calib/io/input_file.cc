// SPDX-License-Identifier: Apache-2.0
#include "calib/io/input_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <map>
#include <mutex>
#include <system_error>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/parallel.h"
#include "calib/io/announced_moves.h"

namespace plenocal {

// By device and number of the file.
class RunScope::Inputs {
 public:
  void Add(const struct stat& file, const std::filesystem::path& path) {
    const std::lock_guard lock(mutex_);
    paths_.emplace(Key(file), path);
  }

  std::optional<std::filesystem::path> Find(const struct stat& file) {
    const std::lock_guard lock(mutex_);
    const auto found = paths_.find(Key(file));
    // The number of a file that was removed may be that of a new one.
    struct stat now {};
    if (found == paths_.end() || stat(found->second.c_str(), &now) != 0 || Key(now) != Key(file)) {
      return std::nullopt;
    }
    return found->second;
  }

 private:
  static std::pair<dev_t, ino_t> Key(const struct stat& file) { return {file.st_dev, file.st_ino}; }

  std::mutex mutex_;
  std::map<std::pair<dev_t, ino_t>, std::filesystem::path> paths_;
};

namespace {

namespace fs = std::filesystem;

[[noreturn]] void RefuseInput(const fs::path& path, const std::string& reason) {
  throw InputError("{}: {}", path.string(), reason);
}

// A file descriptor that is closed with its scope.
class OpenFile {
 public:
  // Without O_NONBLOCK a pipe that nobody writes would be waited for.
  explicit OpenFile(const fs::path& path)
      : number_(open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC)) {}
  ~OpenFile() {
    if (number_ >= 0) close(number_);
  }
  OpenFile(OpenFile&& other) noexcept : number_(other.Release()) {}
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;
  [[nodiscard]] int Number() const { return number_; }
  /// The number, which the caller closes.
  [[nodiscard]] int Release() { return std::exchange(number_, -1); }

 private:
  int number_;
};

struct stat StatusOf(const OpenFile& file, const fs::path& path) {
  const int opening = errno;
  struct stat status {};
  if (file.Number() < 0 || fstat(file.Number(), &status) != 0) {
    if (opening == ENOENT || opening == ENOTDIR) RefuseInput(path, "no such file; check the path");
    RefuseInput(path, fmt::format("cannot be read: {}", std::strerror(opening)));
  }
  if (S_ISDIR(status.st_mode)) RefuseInput(path, "is a directory; name the file in it");
  if (!S_ISREG(status.st_mode)) {
    RefuseInput(path, "is a device, pipe or socket; copy what it gives into a file");
  }
  return status;
}

// The number of bytes read into `content` from `at` on; 0 at the end of the file.
size_t ReadSome(const OpenFile& file, const fs::path& path, size_t at, std::string* content) {
  while (true) {
    const ssize_t count = read(file.Number(), content->data() + at, content->size() - at);
    if (count >= 0) return static_cast<size_t>(count);
    if (errno != EINTR) {
      RefuseInput(path, fmt::format("cannot be read: {}", std::strerror(errno)));
    }
  }
}

std::string ReadAll(const OpenFile& file, const fs::path& path, size_t size, size_t limit) {
  const auto refuse_large = [&] {
    RefuseInput(path, fmt::format("larger than {} MB; is it the right file?", limit >> 20));
  };
  if (size > limit) refuse_large();
  // One byte more than expected shows the end; files of /proc have size 0.
  constexpr size_t kLeast = 1 << 16;
  std::string content(std::max(size + 1, kLeast), '\0');
  size_t length = 0;
  while (const size_t count = ReadSome(file, path, length, &content)) {
    length += count;
    if (length > limit) refuse_large();
    if (length == content.size()) content.resize(2 * length);
  }
  content.resize(length);
  return content;
}

// A file that was checked, and its size in bytes.
struct CheckedFile {
  OpenFile file;
  size_t size;
};

CheckedFile OpenChecked(const fs::path& path, bool is_input) {
  RefuseHalfMoved(path);
  OpenFile file(path);
  const struct stat status = StatusOf(file, path);
  if (RunScope* const run = RunScope::Current(); run != nullptr && is_input) {
    run->inputs().Add(status, path);
  }
  return {std::move(file), static_cast<size_t>(status.st_size)};
}

std::string ReadFileAt(const fs::path& path, InputLimit limit, bool is_input) {
  const CheckedFile opened = OpenChecked(path, is_input);
  return ReadAll(opened.file, path, opened.size, static_cast<size_t>(limit));
}

std::string Text(std::string content, const fs::path& path) {
  if (content.find('\0') == std::string::npos) return content;
  RefuseInput(path, "expected text in UTF-8, found binary data; is it the right file?");
}

}  // namespace

RunScope::RunScope(void* owner) : owner_(owner) {
  if (run_of_thread != nullptr) return;
  inputs_ = std::make_unique<Inputs>();
  run_of_thread = this;
}

RunScope::~RunScope() {
  if (inputs_) run_of_thread = nullptr;
}

RunScope* RunScope::Current() { return static_cast<RunScope*>(run_of_thread); }

void* RunScope::Owner() { return Current() != nullptr ? Current()->owner_ : nullptr; }

std::string ReadInput(const fs::path& path, InputLimit limit) {
  return ReadFileAt(path, limit, true);
}

std::string ReadTextFile(const fs::path& path, InputLimit limit) {
  return Text(ReadFileAt(path, limit, true), path);
}

std::string ReadInputStart(const fs::path& path, size_t size) {
  const CheckedFile opened = OpenChecked(path, true);
  std::string content(std::min(size, opened.size), '\0');
  size_t length = 0;
  while (length < content.size()) {
    const size_t count = ReadSome(opened.file, path, length, &content);
    if (count == 0) break;
    length += count;
  }
  content.resize(length);
  return content;
}

int OpenInput(const fs::path& path) { return OpenChecked(path, true).file.Release(); }

std::string ReadEarlierResult(const fs::path& path) {
  return ReadFileAt(path, InputLimit::kTable, false);
}

void UseAsInput(const fs::path& path) {
  RunScope* const run = RunScope::Current();
  struct stat status {};
  if (run != nullptr && stat(path.c_str(), &status) == 0) run->inputs().Add(status, path);
}

std::optional<fs::path> InputAt(const fs::path& path) {
  struct stat status {};
  if (stat(path.c_str(), &status) != 0) return std::nullopt;
  return RunScope::Current() != nullptr ? RunScope::Current()->inputs().Find(status) : std::nullopt;
}

bool IsThere(const std::filesystem::path& path) {
  std::error_code error;
  return std::filesystem::exists(path, error);
}

}  // namespace plenocal
