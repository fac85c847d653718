// SPDX-License-Identifier: Apache-2.0
#include "calib/output_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

#include "calib/error.h"

namespace plenocal {
namespace {

[[noreturn]] void Fail(const std::filesystem::path& path, const std::string& what) {
  throw Error(ErrorKind::kJob, fmt::format("{}: {}", path.string(), what));
}

}  // namespace

OutputFolder::OutputFolder(std::filesystem::path folder) : folder_(std::move(folder)) {
  MakeFolder(folder_);
  if (access(folder_.c_str(), W_OK | X_OK) != 0) {
    Fail(folder_, fmt::format("cannot write into this output folder: {}", std::strerror(errno)));
  }
}

void OutputFolder::MakeFolder(const std::filesystem::path& folder) {
  std::error_code error;
  std::vector<std::filesystem::path> missing;
  for (std::filesystem::path p = std::filesystem::absolute(folder, error).lexically_normal();
       !p.empty() && !std::filesystem::exists(p, error) && p != p.parent_path();
       p = p.parent_path()) {
    if (p.has_filename()) missing.push_back(p);
  }
  made_.insert(made_.begin(), missing.begin(), missing.end());
  std::filesystem::create_directories(folder, error);
  if (error) Fail(folder, "cannot make this output folder: " + error.message());
}

OutputFolder::~OutputFolder() {
  if (committed_) return;
  std::error_code error;
  for (const std::string& name : names_) std::filesystem::remove(PartialPath(name), error);
  // Removes empty folders only.
  for (const auto& made : made_) std::filesystem::remove(made, error);
}

std::filesystem::path OutputFolder::PartialPath(const std::string& name) const {
  return folder_ / (name + ".partial");
}

void OutputFolder::Write(const std::string& name, const std::string& content) {
  const std::filesystem::path path = PartialPath(name);
  MakeFolder(path.parent_path());
  names_.push_back(name);
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
  for (const std::string& name : names_) {
    std::error_code error;
    if (std::filesystem::is_directory(folder_ / name, error)) {
      Fail(folder_ / name, "is a folder where a result file belongs; move it or give another -o");
    }
  }
  for (const std::string& name : names_) {
    std::error_code error;
    std::filesystem::rename(PartialPath(name), folder_ / name, error);
    if (error) Fail(folder_ / name, "cannot be replaced: " + error.message());
  }
  committed_ = true;
}

}  // namespace plenocal
