// SPDX-License-Identifier: Apache-2.0
//
// Calls from Python into the engine. Each runs without the GIL, passes on exceptions of Python
// functions and can be stopped without effect on other calls.
#pragma once

#include <chrono>
#include <exception>
#include <future>
#include <mutex>
#include <optional>
#include <stop_token>
#include <tuple>
#include <type_traits>

#include "calib/base/run.h"
#include "calib/io/input_file.h"
#include "python/src/bindings.h"

namespace plenocal::python {

/// One call. An exception of a camera model in Python, in any thread of the call, makes the
/// evaluation fail and stops this call alone.
class EngineCall {
 public:
  /// `stop`: stops the run of this call.
  explicit EngineCall(std::stop_source stop = std::stop_source(std::nostopstate));
  ~EngineCall();
  EngineCall(const EngineCall&) = delete;
  EngineCall& operator=(const EngineCall&) = delete;

  /// Returns the result of `work`. Throws the first exception of a model, else that of `work`.
  template <typename Work>
  auto Do(const Work& work) {
    try {
      if constexpr (std::is_void_v<decltype(work())>) {
        work();
        RethrowFromModel();
      } else {
        auto result = work();
        RethrowFromModel();
        return result;
      }
    } catch (...) {
      RethrowFromModel();
      throw;
    }
  }

  /// Stores the current exception of a camera model in the call to which this thread belongs.
  static void KeepException();

 private:
  void RethrowFromModel();

  std::stop_source stop_;
  std::mutex lock_;
  std::exception_ptr from_model_;
  void* const outer_;  // `run_of_thread` around this call, which a model in Python may make
  std::optional<RunScope> scope_;
};

/// Runs a short piece of work without the GIL.
template <typename Work>
auto Call(const Work& work) {
  const nb::gil_scoped_release release;
  return EngineCall().Do(work);
}

/// Settings of a run by its Python caller: number of threads, function for progress (None: not
/// reported), function for messages.
using Caller = std::tuple<int, nb::object, nb::object>;

/// A listener that calls the caller's Python functions from the threads of a run.
Listener MakeListener(const Caller& caller);

/// Runs `work(run)` in a thread of its own, while this thread checks for Ctrl-C. Throws exceptions
/// of the caller's functions and of camera models in Python, errors of the engine, and
/// KeyboardInterrupt.
template <typename Work>
auto RunEngine(const Caller& caller, const Work& work) {
  std::stop_source stop;
  const Run run{
      .listener = MakeListener(caller), .stop = stop.get_token(), .threads = std::get<int>(caller)};
  auto result = std::async(std::launch::async,
                           [&] { return EngineCall(stop).Do([&] { return work(run); }); });
  std::exception_ptr interrupted;
  const auto is_over = [&] {
    const nb::gil_scoped_release release;
    constexpr auto kPause = std::chrono::milliseconds(20);
    return result.wait_for(kPause) == std::future_status::ready;
  };
  while (!is_over()) {
    if (interrupted || PyErr_CheckSignals() == 0) continue;
    interrupted = std::make_exception_ptr(nb::python_error());
    stop.request_stop();
  }
  if (interrupted) std::rethrow_exception(interrupted);
  return result.get();
}

}  // namespace plenocal::python
