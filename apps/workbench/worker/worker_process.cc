// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/worker/worker_process.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <optional>

#include "apps/workbench/worker/worker.h"
#include "calib/base/format_error.h"

extern char** environ;

namespace plenocal::workbench {
namespace {

using namespace std::chrono_literals;

constexpr int kSignalled = 128;  // status of a process that signal 0 would have ended

}  // namespace

WorkerProcess::~WorkerProcess() {
  if (socket_) End();
}

void WorkerProcess::Start() {
  int ends[2];
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) {
    throw JobError("cannot start a job: {}", std::strerror(errno));
  }
  socket_ = std::make_unique<LineSocket>(ends[0]);
  std::array<std::string, 3> words{"plenocal", "workbench", "--worker"};
  char* const arguments[] = {words[0].data(), words[1].data(), words[2].data(), nullptr};
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addchdir_np(&actions, folder_.c_str());
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_adddup2(&actions, ends[1], kWorkerSocket);
  // Ctrl-C in a terminal goes to the workbench, which stops the job.
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
  const int error =
      posix_spawn(&process_, program_.c_str(), &actions, &attributes, arguments, environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  close(ends[1]);
  if (error == 0) return;
  socket_.reset();
  throw JobError("cannot start a job: {}", std::strerror(error));
}

int WorkerProcess::End() {
  socket_.reset();
  int status = 0;
  while (waitpid(process_, &status, 0) < 0 && errno == EINTR) continue;
  return WIFEXITED(status) ? WEXITSTATUS(status) : kSignalled + WTERMSIG(status);
}

std::string WorkerProcess::Run(const nlohmann::json& job,
                               const std::atomic<bool>& stop,
                               const std::function<void(const nlohmann::json& event)>& on_event) {
  if (socket_ && !socket_->Receive(0ms)) End();  // it was killed while it was idle
  if (!socket_) Start();
  socket_->Send(job);
  // What is done so long after the wish to stop; signal 0 is the message.
  constexpr std::array<std::pair<std::chrono::milliseconds, int>, 3> kSteps{
      {{0ms, 0}, {5s, SIGTERM}, {8s, SIGKILL}}};
  size_t step = 0;
  auto unstopped = std::chrono::steady_clock::now();
  for (;;) {
    const std::optional<nlohmann::json> event = socket_->Receive(100ms);
    if (!event) return FailureOf(End());
    if (event->is_object() && event->at("event") == "end") {
      if (event->at("last")) End();
      return event->at("error");
    }
    if (event->is_object()) on_event(*event);
    const auto now = std::chrono::steady_clock::now();
    if (!stop) {
      unstopped = now;
    } else if (step < kSteps.size() && now - unstopped >= kSteps[step].first) {
      const int signal = kSteps[step++].second;
      if (signal == 0) {
        socket_->Send({{"stop", true}});
      } else {
        kill(process_, signal);
      }
    }
  }
}

std::string FailureOf(int status) {
  constexpr const char* kRemedy = "run the command in a terminal, and report this defect";
  if (status <= kSignalled) {
    return fmt::format(
        "the program failed without a message (exit status {}); {}", status, kRemedy);
  }
  const int signal = status - kSignalled;
  return fmt::format("the program was ended by signal {} ({}); {}",
                     signal,
                     strsignal(signal),
                     signal == SIGKILL ? "was the memory full?" : kRemedy);
}

}  // namespace plenocal::workbench
