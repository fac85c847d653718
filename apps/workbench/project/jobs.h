// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "apps/workbench/http/event_log.h"

namespace plenocal::workbench {

/// Long work, one after the other, each a run of the program.
class Jobs {
 public:
  Jobs(std::string folder, EventLog* events);
  /// Stops the running job and waits for it.
  ~Jobs();
  Jobs(const Jobs&) = delete;
  Jobs& operator=(const Jobs&) = delete;

  /// Returns the job as JSON: id, kind, command, state (waiting, running, done, failed, stopped),
  /// stage, done, total, error, and what `extra` has. `arguments` begin with the command.
  nlohmann::json Add(const std::string& kind,
                     std::vector<std::string> arguments,
                     nlohmann::json extra = nlohmann::json::object());
  /// False when there is none of this number that could be stopped.
  bool Stop(int id);
  [[nodiscard]] nlohmann::json All() const;
  /// Whether one waits or runs.
  [[nodiscard]] bool Busy() const;

 private:
  struct Job {
    int id = 0;
    std::vector<std::string> arguments;
    nlohmann::json shown;
    pid_t child = 0;
    bool stop = false;
  };
  void Work();
  void Run(Job* job);
  /// Changes what is shown of a job and reports it.
  void Change(Job* job, const std::function<void(nlohmann::json*)>& change);
  void OnEvent(Job* job, const std::string& line);

  std::string folder_;
  EventLog* events_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Job> jobs_;  // all; references stay valid
  size_t next_ = 0;
  bool ending_ = false;
  std::thread worker_;
};

}  // namespace plenocal::workbench
