// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <string>

#include "tests/apps/workspace.h"

namespace plenocal::testing {

/// Inputs of every command that writes files: a session, `given` with its calibration, an image of
/// its camera and a specification of `simulate`.
class SmallInputs : public Workspace {
 protected:
  SmallInputs() {
    const SyntheticProblem problem = EasyProblem();
    WriteProblem(problem);
    Write("session.yaml", Replaced(Read("session.yaml"), "pinhole-radial3", "pinhole-radtan4"));
    EXPECT_EQ(Run({"calibrate", "session.yaml", "-o", "given", "--quiet"}).status, kDone);
    const auto [width, height] = problem.input.cameras[0].image_size;
    Write("image.pgm",
          fmt::format("P5 {} {} 255\n", width, height) +
              std::string(static_cast<size_t>(width) * static_cast<size_t>(height), 'x'));
    Write("spec.yaml",
          "plenocal: 1\ntarget: target.yaml\nposes: {frames: 3, distance: [0.4, 0.6]}\n"
          "cameras:\n  cam:\n    model: pinhole\n    image_size: [160, 120]\n"
          "    parameters: {f_x: 130, f_y: 130, c_x: 80, c_y: 60}\n");
  }
};

}  // namespace plenocal::testing
