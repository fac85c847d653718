// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/project/beneath.h"

#include <fcntl.h>
#include <linux/openat2.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "calib/base/format_error.h"

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
  throw InputError("{}: {}", file.string(), why);
}

// A file or folder beneath an open folder. `refused_links`: kinds of links that must not lead
// there.
int OpenBeneath(int folder,
                const char* path,
                std::uint64_t flags,
                std::uint64_t mode = 0,
                std::uint64_t refused_links = RESOLVE_NO_SYMLINKS) {
  open_how how{};
  how.flags = flags | O_CLOEXEC;
  how.mode = mode;
  how.resolve = RESOLVE_BENEATH | refused_links;
  return static_cast<int>(syscall(SYS_openat2, folder, path, &how, sizeof how));
}

std::string WhyNotOpen() {
  if (errno == ENOSYS) return "needs openat2: Linux 5.6, and a container engine that permits it";
  return std::strerror(errno);
}

bool WriteAll(int file, std::string_view content) {
  while (!content.empty()) {
    const ssize_t count = write(file, content.data(), content.size());
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return false;
    content.remove_prefix(static_cast<size_t>(count));
  }
  return fsync(file) == 0;
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
  // A pipe would else wait for a writer.
  const OpenFile opened(OpenBeneath(
      folder.Number(), relative.c_str(), O_RDONLY | O_NONBLOCK, 0, RESOLVE_NO_MAGICLINKS));
  if (opened.Number() < 0) RefuseFile(file, WhyNotOpen());
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

std::string TextBeneath(const fs::path& root, const fs::path& file, size_t most) {
  const std::vector<std::uint8_t> content = ReadBeneath(root, file, most);
  return {content.begin(), content.end()};
}

void AddBeneath(const fs::path& root,
                const std::string& folder,
                const std::string& name,
                std::string_view content) {
  const fs::path file = root / folder / name;
  const OpenFile top(open(root.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC));
  if (!folder.empty()) (void)mkdirat(top.Number(), folder.c_str(), 0777);
  const OpenFile place(
      OpenBeneath(top.Number(), folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY));
  if (place.Number() < 0) RefuseFile(root / folder, WhyNotOpen());
  // A name that the images of a session do not have, so that nobody reads half a file.
  const std::string partial = "." + name + ".partial";
  (void)unlinkat(place.Number(), partial.c_str(), 0);  // of a server that was killed
  const OpenFile written(
      OpenBeneath(place.Number(), partial.c_str(), O_WRONLY | O_CREAT | O_EXCL, 0666));
  const bool complete = written.Number() >= 0 && WriteAll(written.Number(), content);
  const int moved =
      complete
          ? renameat2(
                place.Number(), partial.c_str(), place.Number(), name.c_str(), RENAME_NOREPLACE)
          : -1;
  if (moved == 0) return;
  const int why = errno;
  (void)unlinkat(place.Number(), partial.c_str(), 0);
  if (complete && why == EEXIST) RefuseFile(file, "is there already; it is not replaced");
  throw JobError("{}: cannot be written: {}", file.string(), std::strerror(why));
}

}  // namespace plenocal::workbench
