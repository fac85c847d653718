// SPDX-License-Identifier: Apache-2.0
//
// What the page asks for (docs/workbench.md lists it): parse, call, answer.
#pragma once

#include <nlohmann/json.hpp>

#include "apps/workbench/http/guard.h"
#include "apps/workbench/project/jobs.h"
#include "apps/workbench/project/project.h"

namespace plenocal::workbench {

class Api {
 public:
  Api(Project* project, Jobs* jobs, EventLog* events);

  /// Throws `Error` for what the request has wrong.
  Answer Handle(const Request& request);

 private:
  Answer State();
  Answer Files(const Request& request) const;
  Answer SessionRequest(const Request& request);
  Answer SessionAnswer(const SessionVersion& version);
  Answer Changed(const std::optional<SessionVersion>& version);
  Answer Exclude(const Request& request);
  Answer AddJob(const Request& request);
  Answer Image(const Request& request);
  Answer Run(const Request& request);
  Answer Suggest(const Request& request) const;
  Answer Compare(const Request& request) const;
  Answer Export(const Request& request) const;
  Answer TargetDrawing() const;
  [[nodiscard]] nlohmann::json CamerasJson(const Session& session) const;

  Project* project_;
  Jobs* jobs_;
  EventLog* events_;
};

}  // namespace plenocal::workbench
