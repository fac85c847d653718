// SPDX-License-Identifier: Apache-2.0
//
// plenoptic_solve FRAMES: a simulated plenoptic camera before a board of 16 x 13 markers, 0.2 px
// noise, markers free. Prints the number of micro-image points, the CPU seconds of a whole
// calibration without start values (sigmas and floor too), and the iterations and CPU seconds of
// one bundle adjustment that starts 1 % off.
#include <fmt/core.h>

#include <cstdlib>

#include "bench/speed/usage_seconds.h"
#include "calib/adjust/solver/problem.h"
