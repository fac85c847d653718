// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include "apps/cli/options.h"
#include "apps/report/accuracy_page.h"
#include "calib/base/format_error.h"
#include "calib/base/json_text.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"
#include "engine/json/accuracy_json.h"
#include "engine/rigs/predict_accuracy.h"

namespace plenocal {
namespace {

struct AccuracyArguments : AccuracyRequest {
  std::vector<std::string> pairs, noises;
  bool json = false;
  std::filesystem::path out;
};

// "0.1" of all cameras, or "left=0.1".
void AddNoise(const std::string& word, AccuracyRequest* request) {
  const size_t equals = word.find('=');
  double sigma = 0;
  // Without a name all of the word is the number: npos + 1 is 0.
  if (!CLI::detail::lexical_cast(word.substr(equals + 1), sigma) || !(sigma > 0)) {
    throw InputError("--noise {}: expected px above 0, as 0.1 or left=0.1", word);
  }
  if (equals == std::string::npos) {
    request->noise_of_all = sigma;
  } else {
    request->noise[word.substr(0, equals)] = sigma;
  }
}

void RunAccuracy(const AccuracyArguments& arguments, Console* console) {
  AccuracyRequest request = arguments;
  for (const std::string& word : arguments.pairs) {
    request.sets.push_back(CLI::detail::split(word, ','));
  }
  for (const std::string& word : arguments.noises) AddNoise(word, &request);
  const RunScope inputs;
  const std::unique_ptr<OutputFolder> out = OpenOutput(arguments.out);
  const std::vector<RigAccuracy> accuracies = PredictAccuracy(request, console->NewRun());
  if (out) {
    for (const auto& [name, text] : AccuracyFiles(request, accuracies)) out->Write(name, text);
    out->Write("accuracy.html", AccuracyPage(accuracies));
    out->Commit();
  }
  if (arguments.json) return fmt::print("{}\n", JsonText(AccuracyJson(accuracies)));
  console->Print(AccuracyText(accuracies));
}

constexpr const char* kAccuracyHelp =
    "What a calibration is worth in millimetres: standard errors of points and lengths over image and distance, by noise and by the calibration; no images are needed.\n"
    "\n"
    "  plenocal accuracy OUT\n"
    "  plenocal accuracy OUT --pair left,right --distances 0.5,1,2,5 --noise 0.1 -o DIR\n"
    "\n"
    "OUT is the folder that 'plenocal calibrate' wrote. Writes accuracy.csv, accuracy.json and accuracy.html; docs/space.md.";

void DeclareAccuracy(CLI::App* app, AccuracyArguments* arguments, ConsoleOptions* shared) {
  app->add_option("calibration",
                  arguments->calibration,
                  "folder that 'plenocal calibrate' wrote, or its calibration.yaml")
      ->required();
  app->add_option(
      "--pair",
      arguments->pairs,
      "cameras that measure together: left,right; may be repeated (default: every pair, every plenoptic camera, all)");
  app->add_option(
         "--distances",
         arguments->distances,
         "z of points in the first camera's frame, m (default: from the nearest marker to ten times the farthest)")
      ->delimiter(',');
  app->add_option(
      "--noise",
      arguments->noises,
      "PX or CAMERA=PX: noise of each coordinate of a point (default: that of one corner of the calibration)");
  app->add_option("--bar", arguments->bar, "length whose sigma is stated, m")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  AddSpaceFrame(app, &arguments->frame);
  AddJson(app, &arguments->json);
  app->add_option("-o,--out", arguments->out, "folder for the results");
  AddThreadsAndQuiet(app, shared);
}

}  // namespace

Command AccuracyCommand() {
  return MakeCommand("accuracy", kAccuracyHelp, DeclareAccuracy, RunAccuracy);
}

}  // namespace plenocal
