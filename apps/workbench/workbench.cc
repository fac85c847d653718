// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/workbench.h"

#include <fmt/format.h>

#include <string_view>

#include "apps/workbench/api.h"
#include "apps/workbench/http/server.h"
#include "apps/workbench/project/jobs.h"
#include "apps/workbench/project/project.h"

namespace plenocal {

// Files of the page, made by the build from web/ (cmake/embed.cmake).
std::string_view WorkbenchHtml();
std::string_view WorkbenchJs();
std::string_view WorkbenchCss();

}  // namespace plenocal

namespace plenocal::workbench {
namespace {

Answer PageAnswer(const Request& request) {
  const std::string name = request.path.empty() ? "index.html" : request.path[0];
  if (request.method != "GET" || request.path.size() > 1) {
    return ErrorAnswer(404, "the workbench has no such address");
  }
  if (name == "favicon.ico") return {.status = 204, .type = "image/x-icon"};
  const auto file = [](const char* type, std::string_view content) {
    return Answer{.type = fmt::format("text/{}; charset=utf-8", type),
                  .body = std::string(content)};
  };
  if (name == "index.html") return file("html", WorkbenchHtml());
  if (name == "workbench.js") return file("javascript", WorkbenchJs());
  if (name == "workbench.css") return file("css", WorkbenchCss());
  return ErrorAnswer(404, "the workbench has no such address");
}

}  // namespace

void RunWorkbench(const WorkbenchOptions& options,
                  const std::function<void(const std::string& address)>& on_open,
                  const std::function<bool()>& go_on) {
  EventLog events;
  Project project(options.place);
  Jobs jobs("/proc/self/exe", project.Root(), &events);
  Api api(&project, &jobs, &events);
  const std::string token = MakeToken();
  Server server({.port = options.port,
                 .token = token,
                 .handler =
                     [&](const Request& request) {
                       const bool is_api = !request.path.empty() && request.path[0] == "api";
                       // The stream of events is the server's own.
                       if (is_api && request.path.size() == 2 && request.path[1] == "events") {
                         return Answer{};
                       }
                       return is_api ? api.Handle(request) : PageAnswer(request);
                     },
                 .events = &events});
  on_open(fmt::format("http://127.0.0.1:{}/#token={}", server.Port(), token));
  // Changes by an editor are seen by their time.
  std::filesystem::file_time_type last{};
  server.Run([&] {
    std::error_code error;
    const auto time = std::filesystem::last_write_time(project.SessionFile(), error);
    if (!error && time != last) {
      if (last != std::filesystem::file_time_type{}) events.Add("session", "{}");
      last = time;
    }
    api.CalibrateArrivals();
    return go_on();
  });
}

}  // namespace plenocal::workbench
