// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <cmath>
#include <memory>

#include "apps/cli/options.h"
#include "calib/base/format_error.h"
#include "engine/session/open_session.h"
#include "models/check/model_properties.h"
#include "models/formula/model.h"
#include "models/registry.h"
#include "models/start/lens_with_parts.h"

namespace plenocal {
namespace {

std::string Limits(const Param& param) {
  if (std::isinf(param.lower) && std::isinf(param.upper)) return "";
  if (std::isinf(param.upper)) return fmt::format(" > {}", param.lower);
  if (std::isinf(param.lower)) return fmt::format(" < {}", param.upper);
  return fmt::format(" in ({}, {})", param.lower, param.upper);
}

void PrintModel(const CameraModel& model) {
  std::vector<std::string> params;
  std::vector<std::string_view> coefficients;  // of a field, too many to list
  for (const Param& param : model.params) {
    if (param.prior_sigma > 0) {
      coefficients.push_back(param.name);
    } else {
      params.push_back(fmt::format("{} [{}]{}", param.name, param.unit, Limits(param)));
    }
  }
  fmt::print("{}\n  source      {}\n", model.name, model.source);
  constexpr const char* kKinds[]{"central: all rays meet in one point",
                                 "axial: all rays meet the optical axis",
                                 "non-central: rays have no common point"};  // as in `Centre`
  fmt::print("  kind        {}\n", kKinds[static_cast<size_t>(model.centre)]);
  fmt::print("  parameters  {}", fmt::join(params, ", "));
  if (!coefficients.empty()) {
    fmt::print(", {} ... {}: {} coefficients",
               coefficients.front(),
               coefficients.back(),
               coefficients.size());
  }
  fmt::print("\n");
  if (!model.config.empty()) {
    fmt::print("  given      ");
    for (const Param& param : model.config) fmt::print(" {} [{}]", param.name, param.unit);
    fmt::print("  (in the session, never estimated)\n");
  }
  fmt::print("  observes    {}", fmt::join(model.measured, ", "));
  if (!model.context.empty()) fmt::print(" seen through {}", fmt::join(model.context, ", "));
  fmt::print("\n\n");
}

void PrintParts() {
  fmt::print(
      "Parts of any central lens above without knots, in the order in which they act, as ucm+radtan+tilt:\n");
  for (const LensPart& part : LensParts()) {
    std::vector<std::string> params;
    for (const Param& param : part.params) {
      params.push_back(fmt::format("{} [{}]{}", param.name, param.unit, Limits(param)));
    }
    fmt::print("+{}\n  source      {}\n  parameters  {}\n",
               part.name,
               part.source,
               fmt::join(params, ", "));
  }
}

void RunModelCheck(const std::string& name) {
  const CameraModel& model = *ModelNamed("models check", name);
  size_t violated = 0;
  fmt::print("{}", CheckModel(model, &violated));
  if (violated > 0) {
    throw JobError("camera model {} violates {} of {} properties",
                   model.name,
                   violated,
                   ModelProperties().size());
  }
}

constexpr const char* kModelsHelp =
    "List the camera models and the parts of lenses, their parameters, units and source.";
constexpr const char* kCheckHelp =
    "Whether a model's projection, inverse and derivatives agree with each other.\n\n"
    "  plenocal --plugin ./libmine.so models check NAME\n\n"
    "runs the tests of the models of this project on any model, at its example parameters.";

RunCommand DeclareModels(CLI::App* app, ConsoleOptions* /*shared*/) {
  const auto checked = std::make_shared<std::string>(), header = std::make_shared<std::string>();
  app->require_subcommand(0, 1);
  app->add_option("--header", *header, "print a C++ header of the model of a formula");
  CLI::App* const check = app->add_subcommand("check", kCheckHelp);
  check->add_option("name", *checked, "camera model")->required();
  return [checked, header, check] {
    if (check->parsed()) {
      RunModelCheck(*checked);
    } else if (!header->empty()) {
      fmt::print("{}", FormulaHeader(*ModelNamed("models --header", *header)));
    } else {
      for (const CameraModel& model : CameraModels()) PrintModel(model);
      PrintParts();
    }
  };
}

}  // namespace

Command ModelsCommand() { return {"models", kModelsHelp, DeclareModels}; }

}  // namespace plenocal
