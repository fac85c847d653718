// SPDX-License-Identifier: Apache-2.0
//
// Keeps events for the pages that listen.
#pragma once

#include <cstddef>
#include <deque>
#include <mutex>
#include <string>

namespace plenocal::workbench {

/// What happened, for pages that listen: the last `kKept` events, numbered from 1.
class EventLog {
 public:
  static constexpr size_t kKept = 4096;

  /// `json` without line breaks.
  void Add(const std::string& name, const std::string& json);
  [[nodiscard]] size_t Last() const;
  /// The events after number `*seen` as server-sent events, and `*seen` set to the last; of one
  /// that is no longer kept, a single event `reset`.
  std::string After(size_t* seen) const;

 private:
  struct Event {
    std::string name, json;
  };
  mutable std::mutex mutex_;
  std::deque<Event> events_;
  size_t last_ = 0;
};

}  // namespace plenocal::workbench
