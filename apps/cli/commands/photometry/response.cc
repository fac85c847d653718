// SPDX-License-Identifier: Apache-2.0

#include "apps/cli/options.h"
#include "apps/photometry/images/exposed_images.h"
#include "apps/photometry/response_files.h"
#include "calib/base/error.h"
#include "calib/io/output_folder.h"
#include "engine/observe/left_out.h"

namespace plenocal {
namespace {

struct ResponseArguments {
  std::filesystem::path recording;
  std::string camera;  ///< empty: the only one
  std::filesystem::path out;
};

void RunResponse(const ResponseArguments& arguments, Console* console) {
  console->Progress("read " + arguments.recording.string());
  const Recording recording = ReadRecording(arguments.recording);
  const RecordedCamera& camera = ChooseRecordedCamera(recording, arguments.camera);
  OutputFolder output(arguments.out);
  std::vector<LeftOut> left_out = LeftOutOf(recording, camera);
  const ExposureSweep sweep = ReadExposureSweep(
      recording,
      camera,
      console->Options().threads,
      [&](size_t done, size_t total) {
        return console->Progress(camera.name + ": images", done, total);
      },
      &left_out);
  ReportLeftOut(left_out, console->NewRun());
  console->Progress("fit the response");
  const ResponseEstimate estimate = FitResponse(
      sweep, recording.path.string() + ": camera " + camera.name, console->Options().threads);
  if (Interrupted()) throw Stopped();
  const std::vector<std::string> findings = FindingsOf(estimate, sweep);
  for (const std::string& finding : findings) console->Warning(finding);
  output.Write("pcalib.txt", PcalibText(estimate.curve));
  output.Write("response.csv", ResponseCsv(estimate));
  output.Write("report.html", ResponsePage(estimate, sweep, camera.name, findings));
  output.Commit();
  console->Print(ResponseSummary(estimate, camera.name));
  console->PrintWritten(arguments.out);
}

constexpr const char* kResponseHelp =
    "Response of a camera, light by grey value, from images of a static scene at many exposures.\n"
    "\n"
    "  plenocal response RECORDING --camera left -o OUT\n"
    "\n"
    "Writes pcalib.txt, as DSO reads it, response.csv with standard deviations, and a report; "
    "docs/photometry.md.";

void DeclareResponse(CLI::App* app, ResponseArguments* arguments, ConsoleOptions* shared) {
  AddRecording(app, &arguments->recording);
  app->add_option("--camera", arguments->camera, "camera of the recording (default: the only)")
      ->expected(1);
  AddOut(app, &arguments->out);
  AddThreadsAndQuiet(app, shared);
}

}  // namespace

Command ResponseCommand() {
  return MakeCommand("response", kResponseHelp, DeclareResponse, RunResponse);
}

}  // namespace plenocal
