// SPDX-License-Identifier: Apache-2.0
//
// Keeps the workbench's jobs, which wait, run or have ended.
#pragma once

#include <atomic>
#include <condition_variable>
#include <deque>
#include <filesystem>
#include <functional>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "apps/workbench/http/event_log.h"
#include "apps/workbench/worker/worker_process.h"

namespace plenocal::workbench {

/// One after the other, all in one worker.
class Jobs {
 public:
  /// `program`: plenocal; `folder`: that of the workbench.
  Jobs(const std::filesystem::path& program, const std::filesystem::path& folder, EventLog* events);
  /// Stops the running job and waits for it.
  ~Jobs();
  Jobs(const Jobs&) = delete;
  Jobs& operator=(const Jobs&) = delete;

  /// `job`: as `RunJob` takes it. Returns it as the page has it: id, kind, command, state (waiting,
  /// running, done, failed, stopped), stage, done, total, error, and what `extra` has.
  nlohmann::json Add(nlohmann::json job, nlohmann::json extra = nlohmann::json::object());
  /// False when there is none of this number that could be stopped.
  bool Stop(int id);
  [[nodiscard]] nlohmann::json All() const;
  /// Whether one waits or runs.
  [[nodiscard]] bool Busy() const;

 private:
  struct Job {
    nlohmann::json request, shown;
    std::atomic<bool> stop{false};

    [[nodiscard]] bool HasEnded() const;
  };
  void Work();
  void Run(Job* job);
  /// Changes what is shown of a job and reports it.
  void Change(Job* job, const nlohmann::json& change);

  EventLog* events_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Job> jobs_;  // all; references stay valid
  size_t next_ = 0;
  bool ending_ = false;
  WorkerProcess worker_;
  std::thread thread_;
};

}  // namespace plenocal::workbench
