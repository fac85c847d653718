// SPDX-License-Identifier: Apache-2.0
//
// measure COMMAND...: runs it and adds a last line to standard output: wall s, CPU s, peak memory
// in kB. A small program, because the peak that the system reports for a child starts at its
// parent's size.
#include <fmt/core.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>

int main(int argc, char** argv) {
  if (argc < 2) {
    fmt::print(stderr, "usage: measure COMMAND...\n");
    return 2;
  }
  const auto start = std::chrono::steady_clock::now();
  const pid_t child = fork();
  if (child == 0) {
    execv(argv[1], argv + 1);
    _exit(127);
  }
  int status = 0;
  rusage usage;
  if (child < 0 || wait4(child, &status, 0, &usage) != child) return 1;
  const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - start;
  fmt::print("\n{:.6f} {:.6f} {}\n",
             wall.count(),
             static_cast<double>(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
                 1e-6 * static_cast<double>(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec),
             usage.ru_maxrss);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}
