// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <cmath>

#include "apps/commands.h"
#include "models/registry.h"

namespace plenocal {
namespace {

std::string Limits(const Param& param) {
  if (std::isinf(param.lower) && std::isinf(param.upper)) return "";
  if (std::isinf(param.upper)) return fmt::format(" > {}", param.lower);
  if (std::isinf(param.lower)) return fmt::format(" < {}", param.upper);
  return fmt::format(" in ({}, {})", param.lower, param.upper);
}

}  // namespace

void RunModels() {
  for (const CameraModel& model : CameraModels()) {
    fmt::print("{}\n", model.name);
    fmt::print("  source      {}\n", model.source);
    fmt::print("  kind        {}\n",
               model.central ? "central: all rays meet in one point"
                             : "non-central: rays have no common point");
    fmt::print("  parameters ");
    for (const Param& param : model.params) {
      fmt::print(" {} [{}]{}", param.name, param.unit, Limits(param));
      fmt::print("{}", &param == &model.params.back() ? "\n" : ",");
    }
    if (!model.config.empty()) {
      fmt::print("  given      ");
      for (const Param& param : model.config) fmt::print(" {} [{}]", param.name, param.unit);
      fmt::print("  (in the session, never estimated)\n");
    }
    fmt::print("  observes    {}", fmt::join(model.measured, ", "));
    if (!model.context.empty()) fmt::print(" seen through {}", fmt::join(model.context, ", "));
    fmt::print("\n\n");
  }
}

}  // namespace plenocal
