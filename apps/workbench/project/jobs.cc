// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/project/jobs.h"

#include <algorithm>
#include <utility>

#include "apps/workbench/project/command_text.h"
#include "calib/base/error.h"
#include "calib/base/json_text.h"

namespace plenocal::workbench {

using Json = nlohmann::json;

Jobs::Jobs(const std::filesystem::path& program,
           const std::filesystem::path& folder,
           EventLog* events)
    : events_(events), worker_(program, folder), thread_([this] { Work(); }) {}

Jobs::~Jobs() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
    for (Job& job : jobs_) job.stop = true;
  }
  changed_.notify_all();
  thread_.join();
}

bool Jobs::Job::HasEnded() const {
  const std::string& state = shown.at("state").get_ref<const std::string&>();
  return state != "waiting" && state != "running";
}

Json Jobs::Add(Json job, Json extra) {
  Json shown = std::move(extra);
  {
    const std::lock_guard lock(mutex_);
    Job& added = jobs_.emplace_back();
    shown.update({{"id", jobs_.size()},
                  {"kind", job.at("kind")},
                  {"command", JobCommand(job)},
                  {"state", "waiting"}});
    added.request = std::move(job);
    added.shown = shown;
    events_->Add("job", JsonText(shown, -1));
  }
  changed_.notify_all();
  return shown;
}

bool Jobs::Stop(int id) {
  const std::lock_guard lock(mutex_);
  if (id < 1 || id > static_cast<int>(jobs_.size())) return false;
  Job& job = jobs_[static_cast<size_t>(id - 1)];
  if (job.HasEnded()) return false;
  job.stop = true;
  if (job.shown["state"] == "waiting") {
    job.shown["state"] = "stopped";
    events_->Add("job", JsonText(job.shown, -1));
  }
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
  return !std::ranges::all_of(jobs_, &Job::HasEnded);
}

void Jobs::Change(Job* job, const Json& change) {
  const std::lock_guard lock(mutex_);
  job->shown.update(change);
  events_->Add("job", JsonText(job->shown, -1));
}

void Jobs::Run(Job* job) {
  Change(job, {{"state", "running"}});
  std::string error;
  try {
    error = worker_.Run(job->request, job->stop, [&](const Json& event) {
      if (event.at("event") == "detection") events_->Add("detection", JsonText(event, -1));
      if (event.at("event") != "progress") return;
      Change(job,
             {{"stage", event.at("stage")},
              {"done", event.value("done", 0)},
              {"total", event.value("total", 0)}});
    });
  } catch (const Error& failure) {
    error = failure.what();
  }
  if (job->stop) {
    Change(job, {{"state", "stopped"}});
  } else if (error.empty()) {
    Change(job, {{"state", "done"}});
  } else {
    Change(job, {{"state", "failed"}, {"error", error}});
  }
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
