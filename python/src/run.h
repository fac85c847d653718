// SPDX-License-Identifier: Apache-2.0
//
// Calls of Python into the engine: they work without the GIL, pass on what Python functions throw,
// and are stopped each by itself.
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

/// One call. An exception of a camera model in Python makes the evaluation fail and stops this call
/// alone, in whichever of its threads it happens.
class EngineCall {
 public:
  /// `stop`: stops the run that this call makes.
  explicit EngineCall(std::stop_source stop = std::stop_source(std::nostopstate));
  ~EngineCall();
  EngineCall(const EngineCall&) = delete;
  EngineCall& operator=(const EngineCall&) = delete;

  /// The result of `work`. Throws the first exception of a model, else what `work` throws.
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

  /// Keeps the present exception, of a model, for the call that this thread works for.
  static void KeepException();

 private:
  void RethrowFromModel();

  std::stop_source stop_;
  std::mutex lock_;
  std::exception_ptr from_model_;
  void* const outer_;  // the run in which a model calls Python
  std::optional<RunScope> scope_;
};

/// Does short work without the GIL.
template <typename Work>
auto Call(const Work& work) {
  const nb::gil_scoped_release release;
  return EngineCall().Do(work);
}

/// What a run has of its caller: number of threads; functions that take progress (None: it is not
/// wanted) and messages.
using Caller = std::tuple<int, nb::object, nb::object>;

/// Calls Python functions from the threads of a run.
Listener MakeListener(const Caller& caller);

/// Does `work(run)` in a thread of its own, while this one looks for Ctrl-C. Throws what functions
/// of the caller and camera models in Python raise, errors of the engine, KeyboardInterrupt.
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
