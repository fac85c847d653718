// SPDX-License-Identifier: Apache-2.0
//
// The part of a run that its caller gives: a listener, a token that stops it, threads.
#pragma once

#include <cstddef>
#include <functional>
#include <stop_token>
#include <string>

namespace plenocal {

/// Takes what a run reports, from any of its threads. Functions may be empty. An exception in one
/// ends the run and is passed on.
struct Listener {
  std::function<void(const std::string& line)> message = {};
  std::function<void(const std::string& line)> warning = {};
  /// `done` of `total` items of a stage; `total` is 0 where they are not counted.
  std::function<void(const std::string& stage, size_t done, size_t total)> progress = {};
  /// Points found in one image; `why`: the reason where there are none.
  std::function<void(
      const std::string& camera, const std::string& frame, size_t points, const std::string& why)>
      detection = {};
};

/// One run. Runs of several threads are independent of each other.
struct Run {
  Listener listener = {};
  std::stop_token stop = {};
  int threads = 0;  ///< 0: all cores

  void Message(const std::string& line) const {
    if (listener.message) listener.message(line);
  }
  void Warning(const std::string& line) const {
    if (listener.warning) listener.warning(line);
  }
  void Detection(const std::string& camera,
                 const std::string& frame,
                 size_t points,
                 const std::string& why) const {
    if (listener.detection) listener.detection(camera, frame, points, why);
  }
  /// False when the run is stopped: the work that reports throws `Stopped` then.
  bool Progress(const std::string& stage, size_t done = 0, size_t total = 0) const {
    if (listener.progress) listener.progress(stage, done, total);
    return !stop.stop_requested();
  }

  /// A part of this run that reports nothing.
  [[nodiscard]] Run Silent() const { return {.stop = stop, .threads = threads}; }
};

}  // namespace plenocal
