// SPDX-License-Identifier: Apache-2.0
//
// Each system call that changes files fails once, in every command that writes: the results are
// the old or the new ones, a failure has a message and an exit status, and the next run mends all.
#include <fmt/format.h>

#include <iostream>

#include "tests/apps/files/small_inputs.h"

namespace plenocal::testing {
namespace TEST_FILE {

namespace fs = std::filesystem;
using Arguments = std::vector<std::string>;
using Contents = std::map<std::string, std::string>;

// A command that writes `out`, and what is prepared before it.
struct Writer {
  std::string name;
  Arguments arguments;
};

class Fault : public SmallInputs, public ::testing::WithParamInterface<Writer> {
 protected:
  // The results alone: without the folders that the program keeps for itself.
  [[nodiscard]] Contents Out() const {
    Contents files = Files("out");
    std::erase_if(files, [](const auto& file) { return file.first.starts_with(".cache/"); });
    return files;
  }
  // The run with the n-th call failing; whether there was such a call.
  bool RunFailing(int n, Outcome* outcome) const {
    fs::remove(Path("mark"));
    *outcome = Run(GetParam().arguments,
                   {.environment = {{"LD_PRELOAD", PLENOCAL_FAILING_CALLS},
                                    {"ASAN_OPTIONS", "verify_asan_link_order=0"},
                                    {"PLENOCAL_FAIL_CALL", std::to_string(n)},
                                    {"PLENOCAL_FAIL_MARK", Path("mark").string()}}});
    return fs::exists(Path("mark"));
  }
};

TEST_P(Fault, LeavesOldOrNewResults) {
  const Arguments& arguments = GetParam().arguments;
  const Outcome good = Run(arguments);
  ASSERT_EQ(good.status, kDone) << good.err;
  const Contents reference = Out();
  ASSERT_FALSE(reference.empty());
  Contents old;
  for (const auto& [name, text] : reference) old[name] = "old " + name;
  int n = 1, failures = 0;
  for (Outcome outcome;; ++n) {
    fs::remove_all(Path("out"));
    for (const auto& [name, text] : old) Write("out/" + name, text);
    const bool failed = RunFailing(n, &outcome);
    if (!failed) break;
    SCOPED_TRACE(fmt::format("call {}: status {}: {}", n, outcome.status, outcome.err));
    if (outcome.status == kDone) {
      EXPECT_EQ(Out(), reference);  // the call was not needed
    } else {
      ++failures;
      EXPECT_EQ(outcome.status, kJobFailed);
      EXPECT_NE(outcome.err.find("plenocal: "), std::string::npos);
      // Half moved, until the next run that reads or writes there.
      if (!fs::exists(Path("out/.partial/complete"))) {
        EXPECT_EQ(Out(), old);
      }
    }
    const Outcome next = Run(arguments);
    EXPECT_EQ(next.status, kDone) << next.err;
    EXPECT_EQ(Out(), reference);
    if (HasFailure()) return;
  }
  EXPECT_GT(failures, 5);
  std::cout << fmt::format("{}: {} of {} passed, {} of the calls end the run\n",
                           GetParam().name,
                           n - 1,
                           n - 1,
                           failures);
}

// One thread: calls come in one order.
INSTANTIATE_TEST_SUITE_P(
    Each,
    Fault,
    ::testing::Values(
        Writer{"calibrate", {"calibrate", "session.yaml", "--threads", "1", "-o", "out"}},
        Writer{"detect", {"detect", "session.yaml", "--threads", "1", "-o", "out"}},
        Writer{"simulate", {"simulate", "spec.yaml", "--points", "--threads", "1", "-o", "out"}},
        Writer{"convert", {"convert", "given/calibration.yaml", "--to", "pinhole", "-o", "out"}},
        Writer{"export",
               {"export", "given/calibration.yaml", "--format", "kalibr", "-o", "out/chain.yaml"}},
        Writer{"map", {"map", "given/calibration.yaml", "--size", "64x48", "-o", "out/map.yml"}},
        Writer{"target", {"target", "target.yaml", "--paper", "a4", "-o", "out/target.pdf"}},
        Writer{
            "undistort",
            {"undistort", "given/calibration.yaml", "image.pgm", "--threads", "1", "-o", "out"}}),
    [](const auto& writer) { return writer.param.name; });

}  // namespace TEST_FILE
}  // namespace plenocal::testing
