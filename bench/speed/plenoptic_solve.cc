// SPDX-License-Identifier: Apache-2.0
//
// plenoptic_solve FRAMES: a simulated plenoptic camera before a board of 16 x 13 markers, 0.2 px
// noise, markers free. Prints the number of micro-image points, the CPU seconds of a whole
// calibration without start values (sigmas and floor too), and the iterations and CPU seconds of
// one bundle adjustment that starts 1 % off.
#include <fmt/core.h>

#include <cstdlib>

#include "bench/speed/usage_seconds.h"
#include "calib/adjust/solver/adjust.h"
#include "calib/estimate/calibrate.h"
#include "tests/calib/plenoptic_synthetic.h"

int main(int argc, char** argv) {
  if (argc != 2) {
    fmt::print(stderr, "usage: plenoptic_solve FRAMES\n");
    return 2;
  }
  const auto problem = plenocal::testing::MakePlenopticProblem(1,
                                                               {.noise = 0.2,
                                                                .marker_tolerance = 0.0002,
                                                                .frames = std::atoi(argv[1]),
                                                                .columns = 16,
                                                                .rows = 13,
                                                                .virtual_depth = 4.0});
  plenocal::CalibrationOptions one_thread;
  one_thread.threads = 1;
  double begin = plenocal::bench::CpuSeconds();
  const plenocal::Calibration calibration = plenocal::Calibrate(problem.input, one_thread);
  const double whole = plenocal::bench::CpuSeconds() - begin;

  plenocal::Bundle bundle = calibration.bundle;
  for (size_t i = 0; i < 3; ++i) bundle.cameras[0].params[i] *= i % 2 == 0 ? 1.01 : 0.99;
  plenocal::AdjustOptions options;
  options.cost_tolerance = 1e-9;
  begin = plenocal::bench::CpuSeconds();
  const plenocal::AdjustSummary summary = plenocal::Adjust(&bundle, options);
  fmt::print("{} {} {} {}\n",
             bundle.observations.size(),
             whole,
             summary.iterations,
             plenocal::bench::CpuSeconds() - begin);
  return summary.converged ? 0 : 1;
}
