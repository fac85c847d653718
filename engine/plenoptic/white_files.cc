// SPDX-License-Identifier: Apache-2.0
#include "engine/plenoptic/white_files.h"

#include <fmt/format.h>

#include "calib/base/format_error.h"
#include "calib/files/raytrix_grid.h"
#include "calib/files/session.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"
#include "engine/observe/left_out.h"
#include "engine/recording/stores/image_lister.h"
#include "engine/session/open_session.h"

namespace plenocal {
namespace {

/// One camera's job.
struct WhiteJob {
  std::string camera;
  std::vector<FrameImage> images;
  WhiteOptions options;
};

std::vector<WhiteJob> SessionJobs(const WhiteRequest& request) {
  if (request.inputs.size() != 1 || std::filesystem::is_directory(request.inputs[0])) {
    throw InputError("white: give one session.yaml, or a folder or images with --model");
  }
  if (!request.camera.empty() || request.bayer) {
    throw InputError("white: --camera and --bayer go with --model; a session has both in its file");
  }
  const Session session = OpenSession(request.inputs[0]);
  std::vector<WhiteJob> jobs;
  for (const SessionCamera& camera : session.cameras) {
    const bool plenoptic = camera.model->plenoptic;
    if (camera.white_images.empty()) {
      if (!plenoptic) continue;
      throw InputError(
          "{}: {}: a plenoptic camera needs 'white_images'", session.path.string(), camera.name);
    }
    WhiteJob job{.camera = camera.name,
                 .images = ListImages(camera.white_images, camera.name + ": white_images"),
                 .options = {.plenoptic = plenoptic, .bayer = camera.bayer}};
    if (!camera.images.empty()) {
      const FrameImage raw = ListImages(camera.images, camera.name + ": images").front();
      if (!raw.store) job.options.raw_image = raw.path;
    }
    if (plenoptic) job.options.grid_file = request.grid;
    jobs.push_back(std::move(job));
  }
  if (jobs.empty()) {
    throw InputError("{}: no camera has 'white_images'; nothing to do", session.path.string());
  }
  return jobs;
}

WhiteJob FolderJob(const WhiteRequest& request) {
  WhiteJob job{.camera = request.camera,
               .images = FindImageInputs(request.inputs, "white images"),
               .options = {.plenoptic = ModelNamed("--model", request.model)->plenoptic,
                           .bayer = request.bayer,
                           .grid_file = request.grid}};
  if (job.camera.empty()) {
    const auto folder = std::filesystem::absolute(job.images[0].path).parent_path();
    job.camera = folder.filename().string();
  }
  return job;
}

void Write(const std::string& camera,
           const WhiteCamera& white,
           bool xml,
           const Run& run,
           OutputFolder* out) {
  out->Write(fmt::format("vignetting_{}.tiff", camera), white.attenuation_tiff);
  if (white.noise) {
    out->Write(fmt::format("noise_{}.yaml", camera), PhotonTransferYaml(*white.noise));
  }
  if (!white.grid) return;
  out->Write(fmt::format("micro_lenses_{}.csv", camera), FormatMicroLenses(white.grid->array));
  out->Write(fmt::format("lattice_{}.yaml", camera), FormatLatticeErrors(white.grid->array.errors));
  out->Write(fmt::format("grid_{}.png", camera), white.grid_png);
  if (!xml) return;
  std::string text;
  try {
    text = RayCalibDataXml(white.grid->array);
  } catch (const Error& error) {
    run.Warning(fmt::format("{}: the grid is not written as XML: {}", camera, error.what()));
    return;
  }
  out->Write(fmt::format("micro_lenses_{}.xml", camera), text);
}

}  // namespace

std::vector<WhiteResult> MeasureWhiteImages(const WhiteRequest& request, const Run& run) {
  const RunScope inputs;
  std::vector<WhiteJob> jobs;
  if (request.model.empty()) {
    jobs = SessionJobs(request);
  } else {
    jobs.push_back(FolderJob(request));
  }
  const auto out = OpenOutput(request.out);
  std::vector<WhiteResult> results;
  for (WhiteJob& job : jobs) {
    run.Progress(job.camera + ": white images");
    job.options.threads = run.threads;
    job.options.measure_noise = true;
    WhiteResult& result = results.emplace_back();
    result.camera = job.camera;
    result.images = job.images.size();
    try {
      result.white = MeasureWhiteImages(job.images, job.options);
    } catch (const Error& error) {
      throw Error(error.kind(), fmt::format("{}: {}", job.camera, error.what()));
    }
    if (run.stop.stop_requested()) throw Stopped();
    for (const std::string& warning : result.white.warnings) run.Warning(warning);
    ReportLeftOut(result.white.left_out, run);
    if (out) Write(job.camera, result.white, request.xml, run, out.get());
  }
  if (out) out->Commit();
  return results;
}

}  // namespace plenocal
