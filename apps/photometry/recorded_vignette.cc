// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/recorded_vignette.h"

#include <fmt/format.h>

#include "apps/photometry/images/exposed_images.h"
#include "apps/photometry/vignette_files.h"
#include "apps/photometry/white_attenuation.h"
#include "calib/base/format_error.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"
#include "detectors/images/image.h"
#include "engine/observe/left_out.h"
#include "engine/recording/stores/image_lister.h"
#include "engine/resample/map_files.h"
#include "engine/session/calibration_folder.h"

namespace plenocal {

RecordedVignette MeasureVignette(const VignetteRequest& request, const Run& run) {
  const RunScope inputs;
  run.Progress("read " + request.recording.string());
  const Recording recording = ReadRecording(request.recording);
  const RecordedCamera& images = ChooseRecordedCamera(recording, request.camera);
  const CalibrationRecord calibration =
      OpenCalibration(CalibrationOf(recording.path, recording.calibration, request.calibration));
  const CalibratedCamera& camera = FindCamera(calibration, images.name);
  if (camera.model->plenoptic) {
    throw InputError(
        "camera '{}' is plenoptic: its vignetting is that of micro images; use "
        "'plenocal white'",
        camera.name);
  }
  const Target target = ReadTarget(request.target);
  const std::filesystem::path& response =
      request.response.empty() ? images.response : request.response;
  const auto out = OpenOutput(request.out);
  WallOptions options{.recording = &recording,
                      .images = &images,
                      .camera = &camera,
                      .response = response.empty() ? ResponseCurve() : ReadResponse(response),
                      .target = &target,
                      .threads = run.threads,
                      .progress = [&](size_t done, size_t total) {
                        return run.Progress(images.name + ": images", done, total);
                      }};
  WallRecording wall = ReadWall(options);
  ReportLeftOut(wall.left_out, run);
  if (response.empty()) {
    run.Warning(
        "no response is known: grey values count as proportional to the light; measure it with "
        "'plenocal response' and give --response pcalib.txt");
  }
  if (!wall.exposures_known) {
    run.Warning("exposure times are not known: the brightness of each image is estimated too");
  }
  const bool exposures_known = wall.exposures_known;
  RecordedVignette result{.camera = images.name};
  std::vector<double> exposures;
  for (const WallView& view : wall.views) {
    result.frames.push_back(view.frame);
    exposures.push_back(view.exposure);
  }
  result.estimate = FitVignette(std::move(wall),
                                recording.path.string() + ": camera " + images.name,
                                run.threads,
                                [&](const std::string& stage) { return run.Progress(stage); });
  const std::vector<FrameImage> white =
      request.white.empty() ? images.white_images : FindImageInputs(request.white, "white images");
  if (!white.empty()) {
    run.Progress("white images");
    const Attenuation of_white =
        MeasureAttenuation(white, options.response, camera.image_size, run.threads);
    result.with_white =
        CompareAttenuations({result.estimate.attenuation, result.estimate.sigma}, of_white);
  }
  const std::vector<std::string> findings =
      FindingsOf(result.estimate, exposures_known ? result.frames : std::vector<std::string>());
  for (const std::string& finding : findings) run.Warning(finding);
  if (!out) return result;
  const VignetteEstimate& estimate = result.estimate;
  const AttenuationComparison* const comparison = result.with_white ? &*result.with_white : nullptr;
  if (comparison != nullptr) out->Write("vignetting_compare.csv", ComparisonCsv(*comparison));
  out->Write(fmt::format("vignetting_{}.tiff", images.name),
             EncodeImage(".tiff", estimate.attenuation));
  out->Write(fmt::format("vignetting_sigma_{}.tiff", images.name),
             EncodeImage(".tiff", estimate.sigma));
  out->Write("vignette.png", VignettePng(estimate.attenuation));
  out->Write("wall.png", WallPng(estimate));
  if (exposures_known) {
    out->Write("exposures.csv", ExposuresCsv(estimate, images.name, result.frames, exposures));
  }
  out->Write("report.html",
             VignettePage(estimate, images.name, result.frames, findings, comparison));
  out->Commit();
  return result;
}

}  // namespace plenocal
