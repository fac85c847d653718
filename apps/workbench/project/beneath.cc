// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/project/beneath.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/openat2.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "calib/base/error.h"

namespace plenocal::workbench {
namespace {

namespace fs = std::filesystem;

class OpenFile {
 public:
  explicit OpenFile(int file) : file_(file) {}
  ~OpenFile() {
    if (file_ >= 0) close(file_);
  }
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;
  [[nodiscard]] int Number() const { return file_; }

 private:
  int file_;
};

[[noreturn]] void RefuseFile(const fs::path& file, const std::string& why) {
  throw Error(ErrorKind::kInput, fmt::format("{}: {}", file.string(), why));
}

}  // namespace

bool IsBeneath(const fs::path& root, const fs::path& file) {
  if (file.empty()) return false;
  const fs::path relative = fs::absolute(file).lexically_normal().lexically_relative(
      fs::absolute(root).lexically_normal());
  return !relative.empty() && *relative.begin() != "..";
}

fs::path RelativeTo(const fs::path& root, const fs::path& file) {
  if (!IsBeneath(root, file)) RefuseFile(file, "lies outside of the folder of this workbench");
  return fs::absolute(file).lexically_normal().lexically_relative(
      fs::absolute(root).lexically_normal());
}

std::vector<std::uint8_t> ReadBeneath(const fs::path& root, const fs::path& file, size_t most) {
  const fs::path relative = RelativeTo(root, file);
  const OpenFile folder(open(root.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC));
  open_how how{};
  // A pipe would else wait for a writer.
  how.flags = O_RDONLY | O_CLOEXEC | O_NONBLOCK;
  how.resolve = RESOLVE_BENEATH | RESOLVE_NO_MAGICLINKS;
  const OpenFile opened(
      static_cast<int>(syscall(SYS_openat2, folder.Number(), relative.c_str(), &how, sizeof how)));
  if (opened.Number() < 0) RefuseFile(file, std::strerror(errno));
  struct stat about {};
  if (fstat(opened.Number(), &about) != 0 || !S_ISREG(about.st_mode)) {
    RefuseFile(file, "is no regular file");
  }
  if (static_cast<size_t>(about.st_size) > most) RefuseFile(file, "is too long");
  std::vector<std::uint8_t> content(static_cast<size_t>(about.st_size));
  size_t done = 0;
  while (done < content.size()) {
    const ssize_t count = read(opened.Number(), content.data() + done, content.size() - done);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) break;
    done += static_cast<size_t>(count);
  }
  content.resize(done);
  return content;
}

}  // namespace plenocal::workbench
