// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/fleet/fleet_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "calib/base/error.h"
#include "calib/files/frame_images.h"
#include "calib/files/image_keys.h"
#include "calib/io/yaml.h"

namespace plenocal {
namespace {

/// Names of rigs, dates and models stand in folders and in the shell commands of the workflow.
void CheckPlainName(const std::string& what, const std::string& name, const YamlNode& node) {
  const auto allowed = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' ||
           c == '_' || c == '.';
  };
  constexpr size_t kLongest = 100;  // file names have up to 255 bytes
  if (!name.empty() && name.size() <= kLongest && std::ranges::all_of(name, allowed) &&
      name[0] != '.' && name[0] != '-') {
    return;
  }
  node.Fail(
      fmt::format("{} '{}' becomes part of folders and commands: use up to {} letters, digits, "
                  "'-', '_' and '.', with a letter, digit or '_' first",
                  what,
                  name,
                  kLongest));
}

FleetRig ReadRig(const std::string& name, const YamlNode& node, const std::filesystem::path& plan) {
  CheckPlainName("the rig", name, node);
  node.CheckKeys({"sessions"});
  node.RequireKeys(std::array<std::string_view, 1>{"sessions"}, "sessions: rig01/*/session.yaml\n");
  FleetRig rig{.name = name, .runs = {}};
  const std::string what = fmt::format("{}:{}: rigs.{}.sessions", plan.string(), node.Line(), name);
  for (FrameImage& found : ExpandImages(PathsBeside(plan, node.At("sessions")), what)) {
    CheckPlainName("the date (what the last '*' of 'sessions' stands for)", found.frame, node);
    rig.runs.push_back({found.frame, std::filesystem::absolute(found.path).lexically_normal()});
  }
  std::ranges::sort(rig.runs, {}, &FleetRun::date);
  return rig;
}

// The rules read the plan from `SESSIONS`; a status file holds the exit status of `calibrate`, so
// that a rig that cannot be calibrated is a result and stops no other. A process that was killed
// (status above 127) leaves none and is run again.
constexpr const char* kRules = R"PY(
DATES = [(rig, date) for rig in SESSIONS for date in SESSIONS[rig]]

def earlier(rig, date):
    """The date before, or none."""
    dates = sorted(SESSIONS[rig])
    at = dates.index(date)
    return dates[at - 1] if at else None

def needed(rig, date, name):
    return f"{rig}/{date}/{name}"

RUN = "code=0; {command} > {log} 2>&1 || code=$?; [ $code -lt 128 ] || exit $code; echo $code > {output}"

def with_status(command):
    return RUN.replace("{command}", command)

wildcard_constraints:
    rig="[^/]+", date="[^/]+", shard="[0-9]+"

localrules: all, overview

rule all:
    input: "overview.html"

rule detect:
    input: session=lambda w: SESSIONS[w.rig][w.date]
    output: "{rig}/{date}/shard_{shard}.txt"
    log: "{rig}/{date}/shard_{shard}.log"
    threads: THREADS
    shell:
        with_status("{PROGRAM} detect {input.session:q} -o {wildcards.rig}/{wildcards.date}/shard_{wildcards.shard} "
               "--shard {wildcards.shard}/" + str(SHARDS) + " --cache {wildcards.rig}/{wildcards.date}/cache --threads {threads}")

rule calibrate:
    input:
        session=lambda w: SESSIONS[w.rig][w.date],
        shards=lambda w: [needed(w.rig, w.date, f"shard_{k}.txt") for k in range(1, SHARDS + 1)]
    output: "{rig}/{date}/status.txt"
    log: "{rig}/{date}/calibrate.log"
    threads: THREADS
    shell:
        with_status("{PROGRAM} calibrate {input.session:q} -o {wildcards.rig}/{wildcards.date}/result "
               "--cache {wildcards.rig}/{wildcards.date}/cache --threads {threads}")

rule trial:
    input:
        session=lambda w: SESSIONS[w.rig][w.date],
        status="{rig}/{date}/status.txt"
    output: "{rig}/{date}/trial.txt"
    log: "{rig}/{date}/trial.log"
    threads: THREADS
    shell:
        with_status("{PROGRAM} try {input.session:q} -o {wildcards.rig}/{wildcards.date}/trial --models " + ",".join(MODELS) + " "
               "--cache {wildcards.rig}/{wildcards.date}/cache --threads {threads}")

rule compare:
    input:
        now="{rig}/{date}/status.txt",
        before=lambda w: needed(w.rig, earlier(w.rig, w.date), "status.txt")
    output: "{rig}/{date}/compare.txt"
    log: "{rig}/{date}/compare.log"
    params: before=lambda w: needed(w.rig, earlier(w.rig, w.date), "result/calibration.yaml")
    shell:
        with_status("{PROGRAM} compare {params.before} {wildcards.rig}/{wildcards.date}/result/calibration.yaml "
               "-o {wildcards.rig}/{wildcards.date}/compare --quiet")

rule overview:
    input:
        [needed(rig, date, "status.txt") for rig, date in DATES],
        [needed(rig, date, "compare.txt") for rig, date in DATES if earlier(rig, date)],
        [needed(rig, date, "trial.txt") for rig, date in DATES if MODELS]
    output: "overview.html"
    shell: "{PROGRAM} fleet {PLAN:q} -o . --overview"
)PY";

}  // namespace

FleetPlan ReadFleetPlan(const std::filesystem::path& path) {
  const YamlNode root = YamlNode::ReadFile(path);
  root.CheckVersion();
  root.CheckKeys({"plenocal", "rigs", "shards", "models"});
  root.RequireKeys(std::array<std::string_view, 1>{"rigs"},
                   "rigs: {rig01: {sessions: rig01/*/session.yaml}}\n");
  FleetPlan plan;
  plan.path = std::filesystem::absolute(path).lexically_normal();
  for (const auto& [name, node] : root.At("rigs").Entries()) {
    plan.rigs.push_back(ReadRig(name, node, path));
  }
  if (plan.rigs.empty()) root.At("rigs").Fail("expected at least one rig");
  if (root.Has("shards")) {
    plan.shards = root.At("shards").AsInteger();
    constexpr int kMostShards = 10000;
    if (plan.shards < 1 || plan.shards > kMostShards) {
      root.At("shards").Fail(fmt::format("expected a number from 1 to {}", kMostShards));
    }
  }
  if (root.Has("models")) {
    for (const YamlNode& model : root.At("models").Elements()) {
      plan.models.push_back(model.AsString());
      CheckPlainName("the model", plan.models.back(), model);
    }
  }
  return plan;
}

std::string Snakefile(const FleetPlan& plan, const std::filesystem::path& program) {
  using Json = nlohmann::ordered_json;
  Json sessions = Json::object();
  for (const FleetRig& rig : plan.rigs) {
    for (const FleetRun& run : rig.runs) sessions[rig.name][run.date] = run.session.string();
  }
  // JSON of texts, maps and lists is Python too.
  return fmt::format(
             "# Written by 'plenocal fleet'; the next run replaces it. Run it here:\n"
             "#   snakemake --cores all --keep-going --rerun-incomplete\n"
             "import shlex\n\nSESSIONS = {}\nMODELS = {}\nSHARDS = {}\n"
             "PLAN = {}\nPROGRAM = shlex.quote(config.get(\"plenocal\", {}))\n"
             "THREADS = int(config.get(\"threads\", 1))\n",
             sessions.dump(2),
             Json(plan.models).dump(),
             plan.shards,
             Json(plan.path.string()).dump(),
             Json(program.string()).dump()) +
         kRules;
}

}  // namespace plenocal
