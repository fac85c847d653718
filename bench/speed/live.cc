// SPDX-License-Identifier: Apache-2.0
//
// A calibration that goes on with each picture (docs/suggest.md): time of a renewal, wall and CPU.
// Usage: live [FRAMES], one camera, 1280 x 1024 px, 70 markers; exact and bent boards.
#include <fmt/core.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <vector>

#include "assess/views/view_information.h"
#include "bench/speed/usage_seconds.h"
#include "calib/estimate/calibrate.h"
#include "calib/estimate/describe.h"
#include "engine/suggest/live_calibration.h"
#include "engine/suggest/view_target.h"
#include "targets/target.h"
#include "tests/calib/synthetic.h"

namespace plenocal {
namespace {

// Runs with the last frames one by one.
void Renew(const char* board, int frames, double tolerance) {
  constexpr int kMore = 11;
  const testing::SyntheticProblem problem = testing::MakeProblem(
      1, {.cameras = 1, .frames = frames + kMore, .noise = 0.2, .marker_tolerance = tolerance});
  const Target target = TargetOfWord("chessboard:10x7:30mm");
  CalibrationInput input = problem.input;
  std::vector<View> more(input.cameras[0].views.end() - kMore, input.cameras[0].views.end());
  input.cameras[0].views.resize(static_cast<size_t>(frames));
  CalibrationRecord record = Describe(Calibrate(input, {}));
  RigEstimate rig = MakeRigEstimate(record);
  SetFactors(record, MakeViewTarget(target), &rig);
  LiveCalibration live(std::move(record), target, std::move(rig), {.count = 1});
  std::vector<double> wall, cpu;
  for (const View& view : more) {
    const double before = bench::CpuSeconds();
    const auto start = std::chrono::steady_clock::now();
    live.Add(view.frame, {view});
    wall.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    cpu.push_back(bench::CpuSeconds() - before);
  }
  std::ranges::sort(wall);
  std::ranges::sort(cpu);
  fmt::print("{} board, {} frames and one more: {:.0f} ms wall ({:.0f} to {:.0f}), {:.0f} ms CPU\n",
             board,
             frames,
             1e3 * wall[kMore / 2],
             1e3 * wall.front(),
             1e3 * wall.back(),
             1e3 * cpu[kMore / 2]);
}

}  // namespace
}  // namespace plenocal

int main(int argc, char** argv) {
  const int frames = argc > 1 ? std::atoi(argv[1]) : 200;
  plenocal::Renew("exact", frames, 0);
  plenocal::Renew("bent", frames, 0.0005);
  return 0;
}
