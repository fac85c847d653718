// SPDX-License-Identifier: Apache-2.0
#include "engine/json/run_events.h"

namespace plenocal {

Listener EventListener(const std::function<void(const nlohmann::json& event)>& write) {
  const auto text = [write](const char* kind) {
    return [write, kind](const std::string& line) { write({{"event", kind}, {"text", line}}); };
  };
  return {.message = text("message"),
          .warning = text("warning"),
          .progress =
              [write](const std::string& stage, size_t done, size_t total) {
                nlohmann::json event{{"event", "progress"}, {"stage", stage}};
                if (total > 0) event.update({{"done", done}, {"total", total}});
                write(event);
              },
          .detection =
              [write](const std::string& camera,
                      const std::string& frame,
                      size_t points,
                      const std::string& why) {
                write({{"event", "detection"},
                       {"camera", camera},
                       {"frame", frame},
                       {"points", points},
                       {"why", why}});
              }};
}

}  // namespace plenocal
