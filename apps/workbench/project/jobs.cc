// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/project/jobs.h"

#include <fmt/format.h>

#include <algorithm>
#include <csignal>
#include <utility>

#include "apps/workbench/project/child.h"
#include "calib/base/error.h"

namespace plenocal::workbench {
namespace {

using Json = nlohmann::json;

std::string Dump(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace

Jobs::Jobs(std::string folder, EventLog* events)
    : folder_(std::move(folder)), events_(events), worker_([this] { Work(); }) {}

Jobs::~Jobs() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
    for (Job& job : jobs_) {
      job.stop = true;
      if (job.child > 0) kill(job.child, SIGTERM);
    }
  }
  changed_.notify_all();
  worker_.join();
}

Json Jobs::Add(const std::string& kind, std::vector<std::string> arguments, Json extra) {
  Json shown = std::move(extra);
  {
    const std::lock_guard lock(mutex_);
    Job& job = jobs_.emplace_back();
    job.id = static_cast<int>(jobs_.size());
    job.arguments = std::move(arguments);
    shown["id"] = job.id;
    shown["kind"] = kind;
    shown["command"] = CommandLineText(job.arguments);
    shown["state"] = "waiting";
    job.shown = shown;
    events_->Add("job", Dump(shown));
  }
  changed_.notify_all();
  return shown;
}

bool Jobs::Stop(int id) {
  Job* waiting = nullptr;
  {
    const std::lock_guard lock(mutex_);
    if (id < 1 || id > static_cast<int>(jobs_.size())) return false;
    Job& job = jobs_[static_cast<size_t>(id - 1)];
    const std::string state = job.shown["state"];
    if (state != "waiting" && state != "running") return false;
    job.stop = true;
    if (job.child > 0) kill(job.child, SIGTERM);
    if (state == "waiting") waiting = &job;
  }
  if (waiting != nullptr) Change(waiting, [](Json* shown) { (*shown)["state"] = "stopped"; });
  return true;
}

Json Jobs::All() const {
  const std::lock_guard lock(mutex_);
  Json all = Json::array();
  for (const Job& job : jobs_) all.push_back(job.shown);
  return all;
}

bool Jobs::Busy() const {
  const std::lock_guard lock(mutex_);
  return std::ranges::any_of(jobs_, [](const Job& job) {
    const std::string state = job.shown["state"];
    return state == "waiting" || state == "running";
  });
}

void Jobs::Change(Job* job, const std::function<void(Json*)>& change) {
  const std::lock_guard lock(mutex_);
  change(&job->shown);
  events_->Add("job", Dump(job->shown));
}

void Jobs::OnEvent(Job* job, const std::string& line) {
  const Json event = Json::parse(line, nullptr, false);
  if (!event.is_object()) return;
  const std::string kind = event.value("event", "");
  if (kind == "detection") {
    events_->Add("detection", Dump(event));
  } else if (kind == "progress") {
    Change(job, [&](Json* shown) {
      (*shown)["stage"] = event.value("stage", "");
      (*shown)["done"] = event.value("done", 0);
      (*shown)["total"] = event.value("total", 0);
    });
  }
}

void Jobs::Run(Job* job) {
  Change(job, [](Json* shown) { (*shown)["state"] = "running"; });
  ChildResult result;
  try {
    result = RunChild(
        job->arguments,
        folder_,
        [&](pid_t child) {
          const std::lock_guard lock(mutex_);
          job->child = child;
          if (job->stop) kill(child, SIGTERM);
        },
        [&](const std::string& line) { OnEvent(job, line); });
  } catch (const Error& error) {
    result.err = fmt::format("plenocal: {}\n", error.what());
  }
  bool stopped = false;
  {
    const std::lock_guard lock(mutex_);
    job->child = 0;
    stopped = job->stop;
  }
  Change(job, [&](Json* shown) {
    (*shown)["state"] = stopped ? "stopped" : result.status == 0 ? "done" : "failed";
    if (result.status != 0 && !stopped) (*shown)["error"] = FailureOf(result);
  });
}

void Jobs::Work() {
  for (;;) {
    Job* job = nullptr;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return ending_ || next_ < jobs_.size(); });
      if (ending_) return;
      job = &jobs_[next_++];
      if (job->stop) continue;
    }
    Run(job);
  }
}

}  // namespace plenocal::workbench
