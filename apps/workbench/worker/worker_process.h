// SPDX-License-Identifier: Apache-2.0
//
// Starts and stops the worker, a process of the same program that runs one job after the other.
#pragma once

#include <sys/types.h>

#include <atomic>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "apps/workbench/worker/line_socket.h"

namespace plenocal::workbench {

/// The worker as its parent process has it. Not thread-safe.
class WorkerProcess {
 public:
  /// `program`: plenocal; `folder`: the worker's working folder. The worker is started with the
  /// first job, and again with the next job after it has ended.
  WorkerProcess(std::filesystem::path program, std::filesystem::path folder)
      : program_(std::move(program)), folder_(std::move(folder)) {}
  ~WorkerProcess();
  WorkerProcess(const WorkerProcess&) = delete;
  WorkerProcess& operator=(const WorkerProcess&) = delete;

  /// Runs a job (`RunJob`) and passes its events on. Returns the reason of a failure, or an empty
  /// text. Once `stop` is true, the job gets a request to stop; a worker that has not stopped it
  /// after some seconds is killed. If the worker ends, only this job fails. Throws `Error` of kind
  /// kJob if no worker can be started.
  std::string Run(const nlohmann::json& job,
                  const std::atomic<bool>& stop,
                  const std::function<void(const nlohmann::json& event)>& on_event);

 private:
  void Start();
  /// Closes the socket, which ends an idle worker, and waits. Returns the exit status, or 128 plus
  /// the number of the signal that ended the worker.
  int End();

  std::filesystem::path program_, folder_;
  std::unique_ptr<LineSocket> socket_;  // null: no worker runs
  pid_t process_ = 0;
};

/// The reason, in one line, of the failure of a job whose worker ended with this status.
std::string FailureOf(int status);

}  // namespace plenocal::workbench
