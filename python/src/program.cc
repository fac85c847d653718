// SPDX-License-Identifier: Apache-2.0
//
// The program, and the table of camera models.
#include "apps/cli/program.h"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <filesystem>

#include "engine/session/open_session.h"
#include "models/check/model_properties.h"
#include "models/registry.h"
#include "python/src/run.h"

namespace plenocal::python {
namespace {

int RunAsProgram(std::vector<std::string> texts) {
  const nb::gil_scoped_release release;
  std::vector<char*> arguments;
  for (std::string& text : texts) arguments.push_back(text.data());
  arguments.push_back(nullptr);
  return RunProgram(static_cast<int>(texts.size()), arguments.data());
}

void LoadPlugin(const std::string& path) { AddCameraModels(std::filesystem::path(path)); }

std::string CheckNamedModel(const std::string& name) {
  size_t violated = 0;
  return Call([&] { return CheckModel(*ModelNamed("check_model", name), &violated); });
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
  info["centre"] = NameOf(model->centre);
  info["plenoptic"] = model->plenoptic;
  return info;
}

}  // namespace

void BindProgram(nb::module_& module) {
  SilenceSolver();
  module.def("run_as_program", &RunAsProgram);
  module.def("load_plugin", &LoadPlugin);
  module.def("models", &Models);
  module.def("check_model", &CheckNamedModel);
  module.def("model_info", &ModelInfo);
}

}  // namespace plenocal::python
