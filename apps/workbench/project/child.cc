// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/project/child.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <sstream>
#include <string_view>

#include "calib/base/format_error.h"

extern char** environ;

namespace plenocal::workbench {
namespace {

constexpr size_t kMostOutput = 64 * 1024 * 1024;  // of a child's output that is kept
constexpr int kSignalled = 128;  // status of a child that signal 0 would have ended

struct Pipe {
  int read = -1, write = -1;

  Pipe() {
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) {
      throw JobError("cannot start a job: {}", std::strerror(errno));
    }
    read = ends[0];
    write = ends[1];
  }
  ~Pipe() {
    if (read >= 0) close(read);
    CloseWrite();
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  void CloseWrite() {
    if (write >= 0) close(write);
    write = -1;
  }
};

pid_t Spawn(const std::vector<std::string>& arguments,
            const std::string& folder,
            const Pipe& out,
            const Pipe& err,
            const Pipe& events) {
  const std::string program = std::filesystem::read_symlink("/proc/self/exe").string();
  std::vector<char*> argv{const_cast<char*>(program.c_str())};
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addchdir_np(&actions, folder.c_str());
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  // The ends are moved out of the way of the numbers that they get.
  posix_spawn_file_actions_adddup2(&actions, out.write, STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions, err.write, STDERR_FILENO);
  posix_spawn_file_actions_adddup2(&actions, events.write, kEventsFile);
  pid_t child = 0;
  const int error = posix_spawn(&child, program.c_str(), &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) {
    throw JobError("cannot start a job: {}", std::strerror(error));
  }
  return child;
}

}  // namespace

ChildResult RunChild(const std::vector<std::string>& arguments,
                     const std::string& folder,
                     const std::function<void(pid_t)>& on_start,
                     const std::function<void(const std::string&)>& on_event) {
  ChildResult result;
  Pipe out, err, events;
  // A file that has the number of the events would lose its close-on-exec flag to itself.
  if (events.write == kEventsFile) {
    events.write = fcntl(events.write, F_DUPFD_CLOEXEC, kEventsFile + 1);
    close(kEventsFile);
  }
  const pid_t child = Spawn(arguments, folder, out, err, events);
  for (Pipe* pipe : {&out, &err, &events}) pipe->CloseWrite();
  if (on_start) on_start(child);
  std::string line;
  std::array<pollfd, 3> files{
      {{out.read, POLLIN, 0}, {err.read, POLLIN, 0}, {events.read, POLLIN, 0}}};
  for (int open = 3; open > 0;) {
    if (poll(files.data(), files.size(), -1) < 0 && errno != EINTR) break;
    for (size_t i = 0; i < files.size(); ++i) {
      if (files[i].fd < 0 || (files[i].revents & (POLLIN | POLLHUP | POLLERR)) == 0) continue;
      char buffer[65536];
      const ssize_t count = read(files[i].fd, buffer, sizeof buffer);
      if (count < 0 && errno == EINTR) continue;
      if (count <= 0) {
        files[i].fd = -1;
        --open;
        continue;
      }
      if (i == 2) {
        line.append(buffer, static_cast<size_t>(count));
        for (size_t end = line.find('\n'); end != std::string::npos; end = line.find('\n')) {
          if (on_event) on_event(line.substr(0, end));
          line.erase(0, end + 1);
        }
      } else {
        std::string& text = i == 0 ? result.out : result.err;
        if (text.size() < kMostOutput) text.append(buffer, static_cast<size_t>(count));
      }
    }
  }
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) continue;
  result.status = WIFEXITED(status) ? WEXITSTATUS(status) : kSignalled + WTERMSIG(status);
  return result;
}

std::string FailureOf(const ChildResult& child) {
  constexpr std::string_view kName = "plenocal: ";
  std::string failure;
  std::istringstream lines(child.err);
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with(kName)) failure = line.substr(kName.size());
  }
  if (!failure.empty()) return failure;
  constexpr const char* kRemedy = "run the command in a terminal, and report this defect";
  if (child.status <= kSignalled) {
    return fmt::format(
        "the program failed without a message (exit status {}); {}", child.status, kRemedy);
  }
  const int signal = child.status - kSignalled;
  return fmt::format("the program was ended by signal {} ({}); {}",
                     signal,
                     strsignal(signal),
                     signal == SIGKILL ? "was the memory full?" : kRemedy);
}

std::string CommandLineText(const std::vector<std::string>& arguments) {
  std::string text = "plenocal";
  for (const std::string& argument : arguments) {
    const bool plain =
        !argument.empty() &&
        argument.find_first_not_of(
            "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-./:=,@%+") ==
            std::string::npos;
    text += ' ';
    if (plain) {
      text += argument;
      continue;
    }
    text += '\'';
    for (const char c : argument) text += c == '\'' ? "'\\''" : std::string(1, c);
    text += '\'';
  }
  return text;
}

}  // namespace plenocal::workbench
