// SPDX-License-Identifier: Apache-2.0
//
// Starts, feeds and stops the worker, a process of the same program that stays from job to job.
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

/// For one thread.
class WorkerProcess {
 public:
  /// `program`: plenocal; `folder`: the worker's working folder. It is started with the first job,
  /// and again when it has ended.
  WorkerProcess(std::filesystem::path program, std::filesystem::path folder)
      : program_(std::move(program)), folder_(std::move(folder)) {}
  ~WorkerProcess();
  WorkerProcess(const WorkerProcess&) = delete;
  WorkerProcess& operator=(const WorkerProcess&) = delete;

  /// Runs a job (`RunJob`) and passes its events on; returns why it failed, or nothing. Once `stop`
  /// is true, the job is asked to stop, and a worker that does not do so within seconds is ended. A
  /// worker that ends fails this job alone. Throws `Error` of kind kJob where none can be started.
  std::string Run(const nlohmann::json& job,
                  const std::atomic<bool>& stop,
                  const std::function<void(const nlohmann::json& event)>& on_event);

 private:
  void Start();
  /// Closes the socket, which ends an idle worker, and waits; returns the status as a shell has it.
  int End();

  std::filesystem::path program_, folder_;
  std::unique_ptr<LineSocket> socket_;  // null: there is no worker
  pid_t process_ = 0;
};

/// Why a job failed whose worker ended with this status, in one line.
std::string FailureOf(int status);

}  // namespace plenocal::workbench
