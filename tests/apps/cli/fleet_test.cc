// SPDX-License-Identifier: Apache-2.0
//
// The workflow of many rigs and the page on them. bench/install/fleet.py runs the workflow by
// Snakemake.
#include <filesystem>
#include <string>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

constexpr const char* kPlan =
    "plenocal: 1\n"
    "shards: 2\n"
    "models: [pinhole-radtan]\n"
    "rigs:\n"
    "  able: {sessions: sets/able/*/session.yaml}\n"
    "  baker: {sessions: sets/baker/*/session.yaml}\n"
    "  charlie: {sessions: sets/charlie/*/session.yaml}\n";

class Fleet : public Workspace {
 protected:
  // Three rigs at one date.
  Fleet() {
    WriteProblem(MakeProblem(701, {.frames = 30, .noise = 0.1}));
    for (const char* rig : {"able", "baker", "charlie"}) {
      const fs::path folder = Path("sets") / rig / "2026-01";
      fs::create_directories(folder);
      for (const auto& file : fs::directory_iterator(Path(""))) {
        if (file.is_regular_file()) fs::copy_file(file, folder / file.path().filename());
      }
    }
    Write("plan.yaml", kPlan);
  }
};

TEST_F(Fleet, WorkflowNamesEverySessionAndDetectsOnceForAllSteps) {
  const Outcome written = Run({"fleet", "plan.yaml", "-o", "R"});
  ASSERT_EQ(written.status, kDone) << written.err;
  EXPECT_THAT(written.out, AllOf(HasSubstr("3 rigs, 3 calibrations"), HasSubstr("snakemake")));
  const std::string workflow = Read("R/Snakefile");
  for (const char* rig : {"able", "baker", "charlie"}) {
    EXPECT_THAT(workflow, HasSubstr(Path("sets") / rig / "2026-01/session.yaml"));
  }
  std::size_t with_cache = 0;
  const std::string cache = "--cache {wildcards.rig}/{wildcards.date}/cache";
  for (std::size_t at = workflow.find(cache); at != std::string::npos;
       at = workflow.find(cache, at + 1)) {
    ++with_cache;
  }
  EXPECT_EQ(with_cache, 3U) << "detect, calibrate and try share the detections";
}

TEST_F(Fleet, OverviewListsFirstWhatIsToBeActedOn) {
  const Outcome calibrated = Run({"calibrate",
                                  "sets/able/2026-01/session.yaml",
                                  "-o",
                                  "R/able/2026-01/result",
                                  "--no-report"});
  ASSERT_EQ(calibrated.status, kDone) << calibrated.err;
  Write("R/able/2026-01/status.txt", "0\n");
  fs::create_directories(Path("R/baker/2026-01"));
  Write("R/baker/2026-01/status.txt", "1\n");
  Write("R/baker/2026-01/calibrate.log", "reading\nplenocal: no <target> found\n");

  const Outcome page = Run({"fleet", "plan.yaml", "-o", "R", "--overview"});
  ASSERT_EQ(page.status, kDone) << page.err;
  const std::string html = Read("R/overview.html");
  EXPECT_THAT(html, HasSubstr("3 rigs, 3 calibrations"));
  EXPECT_THAT(html, HasSubstr("1 failed, 1 open. <b>2 to act on</b>"));
  EXPECT_THAT(html, AllOf(HasSubstr("no &lt;target&gt; found"), Not(HasSubstr("<target>"))));
  EXPECT_THAT(html, HasSubstr("able/2026-01/result/report.html"));
  const auto row = [&](const char* rig) { return html.find("<td>" + std::string(rig) + "</td>"); };
  EXPECT_LT(row("baker"), row("able"));
  EXPECT_LT(row("charlie"), row("able"));
}

TEST_F(Fleet, OverviewNamesARigThatHasDrifted) {
  fs::copy(Path("sets/able/2026-01"), Path("sets/able/2026-02"));
  const auto calibrate = [&](const std::string& date) {
    const std::string run = "R/able/" + date;
    const Outcome calibrated = Run(
        {"calibrate", "sets/able/" + date + "/session.yaml", "-o", run + "/result", "--no-report"});
    ASSERT_EQ(calibrated.status, kDone) << calibrated.err;
    Write(run + "/status.txt", "0\n");
  };
  calibrate("2026-01");
  calibrate("2026-02");
  const std::string before = "R/able/2026-01/result/calibration.yaml",
                    after = "R/able/2026-02/result/calibration.yaml";
  const auto page = [&] {
    EXPECT_EQ(Run({"compare", before, after, "-o", "R/able/2026-02/compare"}).status, kDone);
    EXPECT_EQ(Run({"fleet", "plan.yaml", "-o", "R", "--overview"}).status, kDone);
    return Read("R/overview.html");
  };
  EXPECT_THAT(page(), Not(HasSubstr("use the new calibration")));

  YAML::Node moved = Result("R/able/2026-02/result");
  YAML::Node parameters = moved["cameras"]["cam0"]["parameters"];
  for (const char* name : {"f_x", "f_y"}) {
    parameters[name] = 1.02 * parameters[name].as<double>();
  }
  Write(after, YAML::Dump(moved));
  EXPECT_THAT(page(), HasSubstr("use the new calibration: it differs from the one before by"));
}

TEST_F(Fleet, OverviewDrawsTheDriftOfEachDate) {
  const fs::path first = "R/able/2026-01";
  ASSERT_EQ(Run({"calibrate",
                 "sets/able/2026-01/session.yaml",
                 "-o",
                 (first / "result").string(),
                 "--no-report"})
                .status,
            kDone);
  Write((first / "status.txt").string(), "0\n");
  const auto add = [&](const std::string& date, const std::string& compared) {
    fs::copy(Path("sets/able/2026-01"), Path("sets/able/" + date));
    fs::copy(Path(first.string()), Path("R/able/" + date), fs::copy_options::recursive);
    fs::create_directories(Path("R/able/" + date + "/compare"));
    Write("R/able/" + date + "/compare/compare.csv", "part,rms,differs\n" + compared);
  };
  add("2026-02", "all,0.1,\nmiddle,9,0\nall,0.2,\n");  // of two cameras
  add("2026-03", "all,0.4,\nmiddle,0.5,1\n");
  for (const auto& [date, grade] :
       {std::pair("2026-01", "good"), {"2026-02", "usable"}, {"2026-03", "usable"}}) {
    const std::string run = "R/able/" + std::string(date) + "/result";
    YAML::Node result = Result(run);
    result["verdict"]["grade"] = grade;
    Write(run + "/calibration.yaml", YAML::Dump(result));
  }
  ASSERT_EQ(Run({"fleet", "plan.yaml", "-o", "R", "--overview"}).status, kDone);
  const std::string html = Read("R/overview.html");
  EXPECT_THAT(html, HasSubstr("0.400 <svg width=\"42\" height=\"36\">"));
  EXPECT_THAT(html,
              HasSubstr("<rect x=\"14\" y=\"18.0\" width=\"12\" height=\"18.0\" class=\"within\">"
                        "<title>2026-02: 0.200 px</title>"));
  EXPECT_THAT(html,
              HasSubstr("<rect x=\"28\" y=\"0.0\" width=\"12\" height=\"36.0\" class=\"beyond\">"
                        "<title>2026-03: 0.400 px</title>"));
  EXPECT_THAT(html, HasSubstr("use the new calibration: it differs from the one before by 0.4 px"));
  EXPECT_THAT(html, HasSubstr("3 rigs, 5 calibrations"));
  EXPECT_THAT(html, HasSubstr("1 good, 2 usable, 0 bad, 0 failed, 2 open"));
}

TEST_F(Fleet, AMistakeInThePlanIsNamed) {
  const auto refuse = [&](const std::string& from, const std::string& to, const char* part) {
    Write("wrong.yaml", Replaced(kPlan, from, to));
    const Outcome outcome = Run({"fleet", "wrong.yaml", "-o", "R"});
    EXPECT_EQ(outcome.status, kWrongInput);
    EXPECT_THAT(outcome.err, AllOf(HasSubstr("wrong.yaml:"), HasSubstr(part)));
    EXPECT_FALSE(fs::exists(Path("R/Snakefile")));
  };
  refuse("shards: 2", "shards: 0", "shards");
  refuse("sets/baker/*", "sets/nobody/*", "nobody");
  refuse("rigs:", "rig:", "rigs");
  refuse("able:", "../able:", "../able");
  // What a shell would execute.
  refuse("able:", "able&reboot:", "able&reboot");
  refuse("[pinhole-radtan]", "[pinhole-radtan; reboot]", "pinhole-radtan; reboot");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
