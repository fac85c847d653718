// SPDX-License-Identifier: Apache-2.0
//
// The workbench's worker as a process: what it keeps from job to job, and what it must not.
#include "apps/workbench/worker/worker.h"

#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <thread>

#include "apps/workbench/project/command_text.h"
#include "apps/workbench/project/jobs.h"
#include "apps/workbench/run_json.h"
#include "apps/workbench/worker/line_socket.h"
#include "apps/workbench/worker/worker_process.h"
#include "engine/compare_files.h"
#include "tests/apps/calibration_schema.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using workbench::WorkerProcess;
using Json = nlohmann::json;

// The processes that this one has started and not yet waited for.
std::vector<pid_t> Children() {
  std::vector<pid_t> children;
  for (const auto& entry : fs::directory_iterator("/proc")) {
    const std::string name = entry.path().filename().string();
    if (name.find_first_not_of("0123456789") != std::string::npos) continue;
    std::ifstream file(entry.path() / "stat");
    std::string text{std::istreambuf_iterator<char>(file), {}};
    if (text.find(')') == std::string::npos) continue;
    std::istringstream rest(text.substr(text.rfind(')') + 1));
    std::string state;
    pid_t parent = 0;
    rest >> state >> parent;
    if (parent == getpid()) children.push_back(std::stoi(name));
  }
  return children;
}

class Worker : public Workspace {
 protected:
  static Json Calibration(const std::string& session, const std::string& out) {
    return {{"kind", "calibrate"}, {"input", session}, {"out", out}, {"cache", "cache"}};
  }
  std::string RunJob(const Json& job, const std::function<void(const Json&)>& on_event = {}) {
    return worker_.Run(job, stop_, [&](const Json& event) {
      if (on_event) on_event(event);
    });
  }

  std::atomic<bool> stop_{false};
  WorkerProcess worker_{PLENOCAL_PROGRAM, Path("")};
};

// Seconds of work.
SyntheticProblem LongProblem() {
  return MakeProblem(3, {.cameras = 4, .frames = 400, .noise = 0.1, .marker_tolerance = 5e-4});
}

TEST_F(Worker, GivesTheFilesOfTheCommandLineInRunAfterRun) {
  WriteProblem(EasyProblem(2, 2e-4));
  Write("other.yaml", Replaced(Read("session.yaml"), "loss: huber", "loss: none"));
  const std::vector<std::string> sessions{"session.yaml", "other.yaml", "session.yaml"};
  std::vector<std::map<std::string, std::string>> results;
  std::vector<pid_t> worker;
  for (const std::string& session : sessions) {
    EXPECT_EQ(RunJob(Calibration(session, "out")), "");
    results.push_back(Files("out"));
    fs::remove_all(Path("out"));
    if (worker.empty()) worker = Children();
    EXPECT_EQ(Children(), worker) << "it stays";
  }
  EXPECT_EQ(worker.size(), 1u);
  EXPECT_NE(results[0].at("calibration.yaml"), results[1].at("calibration.yaml"));
  for (size_t i = 0; i < sessions.size(); ++i) {
    const Outcome outcome =
        Run({"calibrate", sessions[i], "-o", "out", "--cache", "cache", "--quiet"});
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
    const std::map<std::string, std::string> files = Files("out");
    EXPECT_TRUE(files.contains("report.html"));
    ASSERT_EQ(files.size(), results[i].size());
    for (const auto& [name, text] : files) EXPECT_TRUE(results[i].at(name) == text) << name;
    fs::remove_all(Path("out"));
  }
}

TEST_F(Worker, FailsOneJobWhenItIsKilled) {
  WriteProblem(LongProblem());
  const std::string error = RunJob(Calibration("session.yaml", "out"), [](const Json& /*event*/) {
    for (const pid_t child : Children()) kill(child, SIGKILL);
  });
  EXPECT_EQ(error, "the program was ended by signal 9 (Killed); was the memory full?");
  EXPECT_FALSE(fs::exists(Path("out/calibration.yaml")));
  WriteProblem(EasyProblem());
  EXPECT_EQ(RunJob(Calibration("session.yaml", "out")), "");
  EXPECT_TRUE(fs::exists(Path("out/calibration.yaml")));
  // While it is idle, nobody notices.
  for (const pid_t child : Children()) {
    kill(child, SIGKILL);
    siginfo_t ended;
    waitid(P_PID, static_cast<id_t>(child), &ended, WEXITED | WNOWAIT);
  }
  EXPECT_EQ(RunJob(Calibration("session.yaml", "again")), "");
  EXPECT_TRUE(fs::exists(Path("again/calibration.yaml")));
}

TEST_F(Worker, StaysWhenAJobIsStopped) {
  WriteProblem(LongProblem());
  std::vector<pid_t> worker;
  const std::string error = RunJob(Calibration("session.yaml", "out"), [&](const Json& event) {
    if (event["event"] != "progress" || stop_) return;
    worker = Children();
    stop_ = true;
  });
  EXPECT_EQ(error, "stopped");
  EXPECT_FALSE(fs::exists(Path("out"))) << "no results, and no folder for them";
  EXPECT_EQ(worker.size(), 1u);
  EXPECT_EQ(Children(), worker);
  stop_ = false;
  WriteProblem(EasyProblem());
  EXPECT_EQ(RunJob(Calibration("session.yaml", "out")), "");
  EXPECT_EQ(Children(), worker);
}

TEST_F(Worker, StopsItsJobWhenTheWorkbenchHasDied) {
  WriteProblem(LongProblem());
  int ends[2];
  ASSERT_EQ(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends), 0);
  std::jthread worker([&] { workbench::ServeJobs(ends[1]); });
  {
    workbench::LineSocket workbench(ends[0]);
    workbench.Send(Calibration(Path("session.yaml"), Path("out")));
    (void)workbench.Receive(std::chrono::minutes(1));
  }
  worker.join();
  EXPECT_FALSE(fs::exists(Path("out")));
}

TEST_F(Worker, SaysWhyAJobFailedAsTheCommandLineDoes) {
  const Outcome outcome = Run({"calibrate", "nowhere.yaml", "-o", "out"});
  EXPECT_EQ("plenocal: " + RunJob(Calibration("nowhere.yaml", "out")) + "\n", outcome.err);
  WorkerProcess nothing(Path("no program"), Path(""));
  EXPECT_THROW(nothing.Run(Calibration("session.yaml", "out"), stop_, {}), Error);
}

TEST_F(Worker, LeavesRunsWhoseAnswersFitTheSchema) {
  WriteProblem(EasyProblem(2, 2e-4));
  Write("exclude.yaml", Read("session.yaml") + "exclude:\n  - {camera: cam0, markers: [3]}\n");
  ASSERT_EQ(RunJob(Calibration("session.yaml", "a")), "");
  ASSERT_EQ(RunJob(Calibration("exclude.yaml", "b")), "");
  const CalibrationSchema schema(PLENOCAL_DOCS);
  const auto expect = [&](const Json& json, const std::string& name) {
    EXPECT_THAT(schema.Violations(json, name), IsEmpty());
  };
  const Json run = workbench::RunJson(Path("a"), 1);
  expect(run, "Run");
  expect(workbench::SpaceJson(Path("a")), "Space");
  for (const auto& [camera, of_camera] : run["cameras"].items()) {
    EXPECT_EQ(of_camera["frames"]["frame"].size(), of_camera["views"]);
    expect(workbench::ResidualsJson(Path("a"), camera), "Residuals");
    const Json maps = workbench::MapsJson(Path("a"), camera);
    EXPECT_EQ(maps.size(), 4u);
    for (const Json& map : maps) expect(map, "SigmaMap");
  }
  const Json differences = workbench::DifferenceJson(
      CompareFiles(Path("a/calibration.yaml"), Path("b/calibration.yaml"), {}));
  EXPECT_EQ(differences.size(), 4u);
  for (const Json& difference : differences) expect(difference, "Difference");
}

// The plug-in may be another one when the next job begins.
TEST_F(Worker, EndsAfterASessionWithAPlugin) {
  WriteProblem(EasyProblem());
  const std::string plugin = fs::path(PLENOCAL_PLUGINS) / "libstereographic.so";
  Write("session.yaml", "plugins: [" + plugin + "]\n" + Read("session.yaml"));
  EXPECT_EQ(RunJob(Calibration("session.yaml", "out")), "");
  EXPECT_THAT(Children(), IsEmpty());
  EXPECT_EQ(RunJob(Calibration("session.yaml", "out")), "");
}

class JobsOfAFolder : public Workspace {
 protected:
  // The states of all jobs when they have ended.
  std::vector<std::string> EndOf(const workbench::Jobs& jobs) const {
    while (jobs.Busy()) std::this_thread::sleep_for(std::chrono::milliseconds(20));
    std::vector<std::string> states;
    for (const Json& job : jobs.All()) states.push_back(job["state"]);
    return states;
  }
};

TEST_F(JobsOfAFolder, RunOneAfterTheOtherAndAreStoppedOneByOne) {
  WriteProblem(LongProblem());
  workbench::EventLog events;
  workbench::Jobs jobs(PLENOCAL_PROGRAM, Path(""), &events);
  const auto add = [&](const std::string& session, const std::string& out) {
    return jobs.Add({{"kind", "calibrate"}, {"input", session}, {"out", out}, {"cache", "cache"}},
                    {{"run", 7}});
  };
  const Json job = add("session.yaml", "long");
  EXPECT_EQ(job["command"], "plenocal calibrate session.yaml --cache cache -o long");
  EXPECT_EQ(job["state"], "waiting");
  EXPECT_EQ(job["run"], 7);
  add("nowhere.yaml", "out");
  add("session.yaml", "never");
  EXPECT_TRUE(jobs.Stop(3));
  while (!jobs.All()[0].contains("stage")) std::this_thread::yield();
  EXPECT_TRUE(jobs.Stop(1));
  EXPECT_THAT(EndOf(jobs), ElementsAre("stopped", "failed", "stopped"));
  EXPECT_THAT(jobs.All()[1]["error"], HasSubstr("nowhere.yaml"));
  EXPECT_FALSE(jobs.Stop(1));
  EXPECT_FALSE(jobs.Stop(9));
  WriteProblem(EasyProblem());
  add("session.yaml", "out");
  EXPECT_EQ(EndOf(jobs).back(), "done");
  EXPECT_TRUE(fs::exists(Path("out/report.html")));
  EXPECT_FALSE(fs::exists(Path("never")));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
