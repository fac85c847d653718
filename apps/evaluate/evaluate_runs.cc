// SPDX-License-Identifier: Apache-2.0
#include "apps/evaluate/evaluate_runs.h"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/base/number_text.h"
#include "calib/io/input_file.h"

namespace plenocal {
namespace {

/// The truth of all runs.
struct Truth {
  Trajectory whole;                                  ///< both segments, when there are two
  std::optional<LoopTruth> loop;                     ///< nothing: the truth covers the whole path
  std::optional<TruthUncertainty> uncertainty = {};  ///< of both segments
};

Trajectory ReadAndReport(const std::filesystem::path& path,
                         const EvaluateRequest& request,
                         const Run& listener) {
  Trajectory trajectory = ReadTrajectory(path, request.times);
  if (trajectory.repeated > 0) {
    listener.Message(fmt::format("{}: left out {} whose time is that of the pose before",
                                 path.string(),
                                 Counted(static_cast<size_t>(trajectory.repeated), "pose")));
  }
  return trajectory;
}

bool IsGroundTruthFile(const std::filesystem::path& truth) { return truth.extension() == ".yaml"; }

Truth ReadTruth(const EvaluateRequest& request, const Run& listener) {
  Truth truth;
  if (!request.truth.empty()) {
    std::filesystem::path path = request.truth;
    if (IsGroundTruthFile(path)) {
      GroundTruthFile file = ReadGroundTruth(path, request.camera);
      path = file.segments;
      truth.uncertainty = std::move(file.uncertainty);
    }
    truth.whole = ReadAndReport(path, request, listener);
    truth.loop = SplitAtLargestGap(truth.whole);
    if (!truth.loop) {
      listener.Message(
          fmt::format("{}: no gap stands out, so it is taken for the truth of the whole path; the "
                      "drift over a loop is left out",
                      path.string()));
    }
    return truth;
  }
  truth.loop = {ReadAndReport(request.start, request, listener),
                ReadAndReport(request.end, request, listener)};
  const LoopTruth& loop = *truth.loop;
  if (!loop.start.has_times || !loop.end.has_times) {
    throw InputError(
        "{}: KITTI poses have no times, so it is unknown which part of the "
        "path they are; use another form",
        (loop.start.has_times ? request.end : request.start).string());
  }
  if (!(loop.start.times.back() < loop.end.times.front())) {
    throw InputError("{}: begins before {} ends; --start and --end may be exchanged",
                     request.end.string(),
                     request.start.string());
  }
  truth.whole = loop.start;
  const auto append = [](auto* to, const auto& more) {
    to->insert(to->end(), more.begin(), more.end());
  };
  append(&truth.whole.times, loop.end.times);
  append(&truth.whole.positions, loop.end.positions);
  append(&truth.whole.orientations, loop.end.orientations);
  return truth;
}

/// "NAME=FILE" or a file, which its stem then names.
std::vector<EvaluatedRun> NamedRuns(const EvaluateRequest& request) {
  std::vector<EvaluatedRun> runs;
  std::error_code error;
  for (const std::string& text : request.estimates) {
    EvaluatedRun run;
    const size_t equals = text.find('=');
    const bool is_file = std::filesystem::exists(text, error);
    run.path = is_file || equals == std::string::npos ? text : text.substr(equals + 1);
    run.name =
        is_file || equals == std::string::npos ? run.path.stem().string() : text.substr(0, equals);
    if (!std::filesystem::exists(run.path, error)) {
      throw InputError("{}: no such file", run.path.string());
    }
    const auto same = [&](const EvaluatedRun& other) { return other.name == run.name; };
    if (std::any_of(runs.begin(), runs.end(), same)) {
      throw InputError("two runs are called '{}'; write --estimate NAME=FILE", run.name);
    }
    runs.push_back(run);
  }
  using MonocularRuns = EvaluateRequest::MonocularRuns;
  if (request.monocular_runs == MonocularRuns::kNone) return runs;
  const std::vector<std::string_view> names = NamesOf(runs);
  for (const std::string& name : request.monocular) {
    if (std::find(names.begin(), names.end(), name) != names.end()) continue;
    throw InputError("--monocular: no run '{}'{}", name, SuggestName(name, names));
  }
  for (EvaluatedRun& run : runs) {
    run.monocular = request.monocular_runs == MonocularRuns::kAll ||
                    std::ranges::find(request.monocular, run.name) != request.monocular.end();
  }
  return runs;
}

void Evaluate(const EvaluateRequest& request,
              const Truth& truth,
              const Run& listener,
              EvaluatedRun* run) {
  const Trajectory estimate = ReadAndReport(run->path, request, listener);
  if (estimate.has_times != truth.whole.has_times) {
    throw InputError("{}: KITTI poses have no times; give them with --times FILE",
                     (estimate.has_times ? truth.whole : estimate).path);
  }
  if (truth.loop) run->loop = MeasureLoop(estimate, *truth.loop, request.tolerance);
  if (run->loop && truth.uncertainty) {
    run->loop_errors = ErrorsByTruth(*run->loop, estimate, *truth.uncertainty);
  }
  run->errors =
      MeasurePath(estimate, truth.whole, request.tolerance, static_cast<size_t>(request.delta));
}

void CheckRequest(const EvaluateRequest& request) {
  const bool both_segments = !request.start.empty() && !request.end.empty();
  const bool any_segment = !request.start.empty() || !request.end.empty();
  if (!request.camera.empty() && !IsGroundTruthFile(request.truth)) {
    throw InputError(
        "--camera chooses one of the cameras of --truth groundtruth.yaml; other files of "
        "the truth hold one path only");
  }
  if (request.truth.empty() ? both_segments : !any_segment) return;
  throw InputError("give the truth either by --truth FILE or by --start FILE and --end FILE");
}

/// Measures all runs. Beside others a failed run is a result.
void EvaluateAll(const EvaluateRequest& request,
                 const Truth& truth,
                 const Run& listener,
                 std::vector<EvaluatedRun>* runs) {
  for (EvaluatedRun& run : *runs) {
    listener.Progress("evaluate " + run.name);
    try {
      Evaluate(request, truth, listener, &run);
    } catch (const Error& error) {
      if (runs->size() == 1) throw;
      run.failure = error.what();
    }
    if (listener.stop.stop_requested()) throw Stopped();
  }
  if (std::ranges::any_of(*runs, [](const EvaluatedRun& run) { return run.failure.empty(); }))
    return;
  throw JobError("all runs failed; the first: {}", runs->front().failure);
}

}  // namespace

Evaluation EvaluateRuns(const EvaluateRequest& request, const Run& listener) {
  const RunScope inputs;
  CheckRequest(request);
  Evaluation evaluation{
      .runs = NamedRuns(request), .tolerance = request.tolerance, .delta = request.delta};
  const Truth truth = ReadTruth(request, listener);
  evaluation.has_loop = truth.loop.has_value();
  EvaluateAll(request, truth, listener, &evaluation.runs);
  return evaluation;
}

}  // namespace plenocal
