// SPDX-License-Identifier: Apache-2.0
//
// The commands of the program inside of a Python process.
#include "apps/cli/program.h"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <mutex>
#include <optional>
#include <system_error>

#include "apps/cli/command_line.h"
#include "apps/cli/console.h"
#include "calib/base/error.h"
#include "models/registry.h"
#include "python/src/bindings.h"

namespace plenocal::python {
namespace {

/// What `argv` points to.
class Arguments {
 public:
  explicit Arguments(std::vector<std::string> texts) : texts_(std::move(texts)) {
    for (std::string& text : texts_) pointers_.push_back(text.data());
    pointers_.push_back(nullptr);
  }
  [[nodiscard]] int Count() const { return static_cast<int>(texts_.size()); }
  char** Pointers() { return pointers_.data(); }

 private:
  std::vector<std::string> texts_;
  std::vector<char*> pointers_;
};

/// Takes standard output's place for this process's C and C++ code; Python writes past it.
class CapturedOutput {
 public:
  CapturedOutput() : file_(open_memstream(&text_, &size_)), stdout_(stdout) {
    if (file_ == nullptr) throw std::bad_alloc();
    stdout = file_;
  }
  ~CapturedOutput() {
    stdout = stdout_;
    std::fclose(file_);
    std::free(text_);
  }
  CapturedOutput(const CapturedOutput&) = delete;
  CapturedOutput& operator=(const CapturedOutput&) = delete;

  std::string Text() {
    std::fflush(file_);
    return {text_, size_};
  }

 private:
  char* text_ = nullptr;
  size_t size_ = 0;
  FILE *file_, *stdout_;
};

// A command has the process's standard output, flag of interruption and table of models.
std::mutex one_command;
thread_local bool in_callback = false;

/// Gives progress and messages to Python functions; the first exception in one stops the command.
class PythonSink {
 public:
  PythonSink(nb::handle progress, nb::handle message)
      : sink_{.message = [this, message](const std::string& line,
                                         bool warning) { Call([&] { message(line, warning); }); },
              .progress =
                  [this, progress](const std::string& stage) {
                    if (!progress.is_none()) Call([&] { progress(stage); });
                  }} {
    UseConsoleSink(&sink_);
  }
  ~PythonSink() { UseConsoleSink(nullptr); }
  PythonSink(const PythonSink&) = delete;
  PythonSink& operator=(const PythonSink&) = delete;

  void Rethrow() {
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  template <typename Function>
  void Call(const Function& function) {
    const nb::gil_scoped_acquire acquire;
    if (failure_) return;
    in_callback = true;
    try {
      function();
    } catch (const nb::python_error&) {
      failure_ = std::current_exception();
      Interrupt();
    }
    in_callback = false;
  }

  ConsoleSink sink_;
  std::exception_ptr failure_;
};

/// A mutex that is waited for without the GIL.
std::unique_lock<std::mutex> WaitForOtherCommands() {
  const nb::gil_scoped_release release;
  return std::unique_lock(one_command);
}

/// Runs the command; true: stopped.
bool RunCommandLine(Arguments* arguments) {
  const nb::gil_scoped_release release;
  CommandLine command_line;
  const RunCommand run = command_line.Parse(arguments->Count(), arguments->Pointers());
  try {
    if (run) run();
  } catch (const Stopped&) {
    return true;
  }
  return false;
}

std::string RunInProcess(std::vector<std::string> texts,
                         const nb::object& progress,
                         const nb::object& message,
                         bool catch_ctrl_c) {
  if (in_callback) {
    throw Error(ErrorKind::kInput,
                "a command runs already: its callback cannot start another; start it afterwards");
  }
  texts.insert(texts.begin(), "plenocal");
  Arguments arguments(std::move(texts));
  const std::unique_lock lock = WaitForOtherCommands();
  const InterruptScope interrupts(catch_ctrl_c);
  PythonSink sink(progress, message);
  CapturedOutput output;
  bool stopped = false;
  try {
    stopped = RunCommandLine(&arguments);
  } catch (const Error& error) {
    sink.Rethrow();
    RethrowFromModel();
    SetPythonError(error, output.Text());
    throw nb::python_error();
  }
  sink.Rethrow();
  RethrowFromModel();
  if (stopped) {
    PyErr_SetString(PyExc_KeyboardInterrupt, kInterrupted);
    throw nb::python_error();
  }
  return output.Text();
}

int RunAsProgram(const std::vector<std::string>& texts) {
  const nb::gil_scoped_release release;
  Arguments arguments(texts);
  return RunProgram(arguments.Count(), arguments.Pointers());
}

void LoadPlugin(const std::string& path) {
  const std::unique_lock lock = WaitForOtherCommands();
  AddCameraModels(std::filesystem::path(path));
}

nb::list Models() {
  nb::list names;
  for (const CameraModel& model : CameraModels()) names.append(std::string(model.name));
  return names;
}

nb::dict ModelInfo(const std::string& name) {
  const CameraModel* const model = FindModel(CameraModels(), name);
  nb::dict info;
  if (model == nullptr) return info;
  nb::list params, measured, context;
  for (const Param& param : model->params) {
    params.append(nb::make_tuple(
        std::string(param.name), std::string(param.unit), param.lower, param.upper, param.scale));
  }
  for (const std::string_view text : model->measured) measured.append(std::string(text));
  for (const std::string_view text : model->context) context.append(std::string(text));
  info["source"] = std::string(model->source);
  info["params"] = params;
  info["measured"] = measured;
  info["context"] = context;
  info["example"] = ToArray(std::vector<double>(model->example.begin(), model->example.end()));
  info["example_config"] =
      ToArray(std::vector<double>(model->example_config.begin(), model->example_config.end()));
  info["example_size"] = nb::make_tuple(model->example_size[0], model->example_size[1]);
  info["central"] = model->central;
  info["plenoptic"] = model->plenoptic;
  return info;
}

}  // namespace

void BindProgram(nb::module_& module) {
  SilenceSolver();
  module.def("run",
             &RunInProcess,
             nb::arg("arguments"),
             nb::arg("progress").none(),
             nb::arg("message").none(),
             nb::arg("catch_ctrl_c"));
  module.def("run_as_program", &RunAsProgram, nb::arg("arguments"));
  module.def("load_plugin", &LoadPlugin, nb::arg("path"));
  module.def("models", &Models);
  module.def("model_info", &ModelInfo, nb::arg("name"));
}

}  // namespace plenocal::python
