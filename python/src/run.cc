// SPDX-License-Identifier: Apache-2.0
#include "python/src/run.h"

#include <nanobind/stl/string.h>

#include <string>
#include <utility>

#include "calib/base/parallel.h"

namespace plenocal::python {

EngineCall::EngineCall(std::stop_source stop)
    : stop_(std::move(stop)),
      outer_(std::exchange(run_of_thread, nullptr)),
      scope_(std::in_place, this) {}

EngineCall::~EngineCall() {
  scope_.reset();
  run_of_thread = outer_;
}

void EngineCall::KeepException() {
  auto* const call = static_cast<EngineCall*>(RunScope::Owner());
  if (call == nullptr) return;
  const std::lock_guard lock(call->lock_);
  if (!call->from_model_) call->from_model_ = std::current_exception();
  call->stop_.request_stop();
}

void EngineCall::RethrowFromModel() {
  const std::lock_guard lock(lock_);
  if (from_model_) std::rethrow_exception(from_model_);
}

Listener MakeListener(const Caller& caller) {
  const auto message = [&caller](const std::string& line, bool warning) {
    const nb::gil_scoped_acquire acquire;
    std::get<2>(caller)(line, warning);
  };
  Listener listener{.message = [message](const std::string& line) { message(line, false); },
                    .warning = [message](const std::string& line) { message(line, true); }};
  if (!std::get<1>(caller).is_none()) {
    listener.progress = [&caller](const std::string& stage, size_t done, size_t total) {
      const nb::gil_scoped_acquire acquire;
      const std::string text = std::to_string(done) + " of " + std::to_string(total);
      std::get<1>(caller)(total > 0 ? stage + ": " + text : stage);
    };
  }
  return listener;
}

}  // namespace plenocal::python
