// SPDX-License-Identifier: Apache-2.0
//
// Preloaded into the program (LD_PRELOAD), lets one system call fail that changes files: the n-th
// of PLENOCAL_FAIL_CALL, counted from 1, as on a full or broken disk. Makes the file
// PLENOCAL_FAIL_MARK when it does. With PLENOCAL_STOP_AT_CALL the process waits there instead, to
// be killed (bench/kills).
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <new>

namespace {

bool Fails() {
  // Of this process and those that it forks.
  static auto* const count = new (mmap(nullptr,
                                       sizeof(std::atomic<long>),
                                       PROT_READ | PROT_WRITE,
                                       MAP_SHARED | MAP_ANONYMOUS,
                                       -1,
                                       0)) std::atomic<long>{0};
  static const char* const kNumber = std::getenv("PLENOCAL_FAIL_CALL");
  static const char* const kMark = std::getenv("PLENOCAL_FAIL_MARK");
  if (kNumber == nullptr || ++*count != std::atol(kNumber)) return false;
  // Other programs that are started count on their own; one call of all fails.
  if (syscall(SYS_faccessat, AT_FDCWD, kMark, F_OK) == 0) return false;
  syscall(SYS_close, syscall(SYS_openat, AT_FDCWD, kMark, O_CREAT | O_WRONLY, 0600));
  while (std::getenv("PLENOCAL_STOP_AT_CALL") != nullptr) pause();
  errno = ENOSPC;
  return true;
}

template <typename Function>
Function* Next(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

using Open = int(const char*, int, ...);

int OpenUnlessItFails(const char* name, const char* path, int flags, mode_t mode) {
  const bool writes = (flags & (O_WRONLY | O_RDWR | O_CREAT)) != 0;
  if (writes && Fails()) return -1;
  return Next<Open>(name)(path, flags, mode);
}

using OpenStream = FILE*(const char*, const char*);

FILE* OpenUnlessItFails(const char* name, const char* path, const char* mode) {
  const bool writes = std::strpbrk(mode, "wa+") != nullptr;
  if (writes && Fails()) return nullptr;
  return Next<OpenStream>(name)(path, mode);
}

// What goes to standard streams, also by another number, is no result file.
bool IsMessage(int file) {
  struct stat status {
  }, error{};
  return file <= STDERR_FILENO || (fstat(file, &status) == 0 && fstat(STDERR_FILENO, &error) == 0 &&
                                   status.st_dev == error.st_dev && status.st_ino == error.st_ino);
}

}  // namespace

extern "C" {

int open(const char* path, int flags, ...) {
  va_list rest;
  va_start(rest, flags);
  const mode_t mode = (flags & O_CREAT) != 0 ? va_arg(rest, mode_t) : 0;
  va_end(rest);
  return OpenUnlessItFails("open", path, flags, mode);
}

int open64(const char* path, int flags, ...) {
  va_list rest;
  va_start(rest, flags);
  const mode_t mode = (flags & O_CREAT) != 0 ? va_arg(rest, mode_t) : 0;
  va_end(rest);
  return OpenUnlessItFails("open64", path, flags, mode);
}

FILE* fopen(const char* path, const char* mode) { return OpenUnlessItFails("fopen", path, mode); }

FILE* fopen64(const char* path, const char* mode) {
  return OpenUnlessItFails("fopen64", path, mode);
}

ssize_t write(int file, const void* data, size_t size) {
  if (!IsMessage(file) && Fails()) return -1;
  return Next<ssize_t(int, const void*, size_t)>("write")(file, data, size);
}

ssize_t writev(int file, const iovec* parts, int count) {
  if (!IsMessage(file) && Fails()) return -1;
  return Next<ssize_t(int, const iovec*, int)>("writev")(file, parts, count);
}

int fsync(int file) { return Fails() ? -1 : Next<int(int)>("fsync")(file); }

int rename(const char* from, const char* to) {
  return Fails() ? -1 : Next<int(const char*, const char*)>("rename")(from, to);
}

int mkdir(const char* path, mode_t mode) {
  return Fails() ? -1 : Next<int(const char*, mode_t)>("mkdir")(path, mode);
}

int unlink(const char* path) { return Fails() ? -1 : Next<int(const char*)>("unlink")(path); }

int unlinkat(int folder, const char* name, int flags) {
  return Fails() ? -1 : Next<int(int, const char*, int)>("unlinkat")(folder, name, flags);
}

// Calls unlink or rmdir within the C library.
int remove(const char* path) { return Fails() ? -1 : Next<int(const char*)>("remove")(path); }

}  // extern "C"
