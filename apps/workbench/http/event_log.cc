// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/http/event_log.h"

#include <fmt/format.h>

namespace plenocal::workbench {

void EventLog::Add(const std::string& name, const std::string& json) {
  const std::lock_guard lock(mutex_);
  events_.push_back({name, json});
  ++last_;
  if (events_.size() > kKept) events_.pop_front();
}

size_t EventLog::Last() const {
  const std::lock_guard lock(mutex_);
  return last_;
}

std::string EventLog::After(size_t* seen) const {
  const std::lock_guard lock(mutex_);
  const size_t first = last_ - events_.size();  // number before the oldest that is kept
  if (*seen > last_ || *seen < first) {
    *seen = last_;
    return fmt::format("id: {}\nevent: reset\ndata: {{}}\n\n", last_);
  }
  std::string text;
  for (size_t number = *seen + 1; number <= last_; ++number) {
    const Event& event = events_[number - first - 1];
    text += fmt::format("id: {}\nevent: {}\ndata: {}\n\n", number, event.name, event.json);
  }
  *seen = last_;
  return text;
}

}  // namespace plenocal::workbench
