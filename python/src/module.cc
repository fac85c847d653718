// SPDX-License-Identifier: Apache-2.0
//
// The extension module, and errors of the engine as Python's exceptions.
#include <filesystem>
#include <string>

#include "calib/base/error.h"
#include "python/src/bindings.h"

namespace plenocal::python {
namespace {

const char* ClassOf(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::kInput:
      return "InputError";
    case ErrorKind::kJob:
      return "JobError";
    case ErrorKind::kGrade:
      return "GradeError";
  }
  return "Error";
}

void Raise(const char* name, const std::string& message) {
  const nb::object type = nb::module_::import_("plenocal.errors").attr(name);
  PyErr_SetObject(type.ptr(), type(message.c_str()).ptr());
}

void Translate(const std::exception_ptr& pointer, void*) {
  try {
    std::rethrow_exception(pointer);
  } catch (const Error& error) {
    SetPythonError(error);
  } catch (const std::filesystem::filesystem_error& error) {
    Raise("JobError", error.path1().string() + ": " + error.code().message());
  } catch (const Stopped&) {
    PyErr_SetString(PyExc_KeyboardInterrupt, "stopped");
  }
}

}  // namespace

void SetPythonError(const Error& error) { Raise(ClassOf(error.kind()), error.what()); }

}  // namespace plenocal::python

NB_MODULE(_core, module) {
  using namespace plenocal::python;
  // Objects that live until the interpreter ends are none of its users' business.
  nb::set_leak_warnings(false);
  module.attr("__version__") = PLENOCAL_VERSION;
  nb::register_exception_translator(&Translate);
  BindEngine(module);
  BindImages(module);
  BindProgram(module);
  BindCamera(module);
  BindCalibration(module);
  BindSpace(module);
  BindTarget(module);
  BindViews(module);
  BindModels(module);
}
