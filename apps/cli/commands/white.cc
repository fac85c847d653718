// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "apps/commands.h"
#include "apps/image_inputs.h"
#include "apps/image_module.h"
#include "apps/observations.h"
#include "calib/error.h"
#include "calib/output_folder.h"
#include "models/registry.h"

namespace plenocal {
namespace {

/// One camera's job.
struct WhiteJob {
  std::string camera;
  std::vector<FrameImage> images;
  WhiteOptions options;
};

/// Whether cameras of this model look through micro lenses: their observations name the one.
bool IsPlenoptic(const CameraModel& model) {
  return std::find(model.context.begin(), model.context.end(), "lens_x") != model.context.end();
}

bool IsPlenoptic(const std::string& name) {
  if (const CameraModel* model = FindModel(CameraModels(), name)) return IsPlenoptic(*model);
  std::vector<std::string_view> known;
  for (const CameraModel& model : CameraModels()) known.push_back(model.name);
  throw Error(ErrorKind::kInput,
              fmt::format("--model: unknown camera model '{}'{}", name, SuggestName(name, known)));
}

std::vector<WhiteJob> SessionJobs(const WhiteCommand& command, const Session& session) {
  std::vector<WhiteJob> jobs;
  for (const SessionCamera& camera : session.cameras) {
    const bool plenoptic = IsPlenoptic(*camera.model);
    if (camera.white_images.empty()) {
      if (!plenoptic) continue;
      throw Error(ErrorKind::kInput,
                  fmt::format("{}: {}: a plenoptic camera needs 'white_images'",
                              session.path.string(),
                              camera.name));
    }
    WhiteJob job{.camera = camera.name,
                 .images = ExpandImages(camera.white_images, camera.name + ": white_images"),
                 .options = {.plenoptic = plenoptic, .bayer = !camera.bayer.empty()}};
    if (!camera.images.empty()) {
      job.options.raw_image = ExpandImages(camera.images, camera.name + ": images").front().path;
    }
    if (plenoptic) job.options.grid_file = command.grid;
    jobs.push_back(std::move(job));
  }
  if (jobs.empty()) {
    throw Error(
        ErrorKind::kInput,
        fmt::format("{}: no camera has 'white_images'; nothing to do", session.path.string()));
  }
  return jobs;
}

WhiteJob FolderJob(const WhiteCommand& command) {
  WhiteJob job{.camera = command.camera,
               .images = FindImageInputs(command.inputs, "white images"),
               .options = {.plenoptic = IsPlenoptic(command.model),
                           .bayer = !command.bayer.empty(),
                           .grid_file = command.grid}};
  if (job.camera.empty()) {
    const auto folder = std::filesystem::absolute(job.images[0].path).parent_path();
    job.camera = folder.filename().string();
  }
  return job;
}

double Degrees(double radians) { return radians * 180 / std::numbers::pi; }

void PrintGrid(const MicroLensGrid& grid) {
  const MicroLensArray& array = grid.array;
  std::array<size_t, 3> by_type{};
  size_t unusable = 0;
  for (const MicroLens& lens : array.lenses) {
    ++by_type[static_cast<size_t>(lens.type)];
    if (!lens.usable) ++unusable;
  }
  fmt::print("  {} micro lenses, {} unusable, {}\n",
             array.lenses.size(),
             unusable,
             array.types == 1
                 ? std::string("one type")
                 : fmt::format("three types: {}, {}, {}", by_type[0], by_type[1], by_type[2]));
  fmt::print(
      "  pitch {:.4f} px, rotation {:.4f} deg, in the middle; rows 60 deg apart to {:.3f} deg\n",
      array.Pitch(),
      Degrees(std::atan2(array.e_column.y(), array.e_column.x())),
      std::abs(60 - Degrees(std::acos(array.e_column.dot(array.e_row) /
                                      (array.e_column.norm() * array.e_row.norm())))));
  fmt::print(
      "  single centres about the lattice: {:.4f} px RMS, {:.4f} px robust, per coordinate{}\n",
      grid.centre_rms,
      grid.centre_sigma,
      grid.degree > 0 ? fmt::format(" (lattice bent by order {})", grid.degree) : "");
  fmt::print(
      "  micro images: brightness varies by {:.2f} % between neighbours, profile fits to {:.2f} "
      "%\n",
      100 * grid.gain_spread,
      100 * grid.misfit);
}

void PrintSummary(const WhiteJob& job, const WhiteCamera& camera) {
  fmt::print("{}: {} of {} white images, {} x {} px, mean {:.1f} of {:.0f} grey values\n",
             job.camera,
             camera.images,
             job.images.size(),
             camera.image_size[0],
             camera.image_size[1],
             camera.level,
             camera.full_scale);
  fmt::print(
      "  saturated {:.3f} %, black {:.3f} % of the pixels; illumination uneven by {:.1f} % from "
      "side to side\n",
      100 * camera.saturated,
      100 * camera.black,
      100 * camera.unevenness);
  fmt::print("  attenuation from {:.3f} to 1\n", camera.darkest);
  if (camera.grid) PrintGrid(*camera.grid);
}

}  // namespace

void RunWhite(const WhiteCommand& command, const ConsoleOptions& options) {
  std::vector<WhiteJob> jobs;
  if (command.model.empty()) {
    if (command.inputs.size() != 1 || std::filesystem::is_directory(command.inputs[0])) {
      throw Error(ErrorKind::kInput,
                  "white: give one session.yaml, or a folder or images with --model");
    }
    const Session session = ReadSession(command.inputs[0], CameraModels());
    jobs = SessionJobs(command, session);
  } else {
    jobs.push_back(FolderJob(command));
  }

  OutputFolder out(command.out);
  Console console(options.quiet);
  std::vector<WhiteCamera> cameras;
  for (WhiteJob& job : jobs) {
    console.Progress(job.camera + ": white images");
    job.options.threads = options.threads;
    try {
      cameras.push_back(MeasureWhiteImagesByModule(job.images, job.options));
    } catch (const Error& error) {
      throw Error(error.kind(), fmt::format("{}: {}", job.camera, error.what()));
    }
    if (Interrupted()) throw Stopped();
    const WhiteCamera& camera = cameras.back();
    for (const std::string& warning : camera.warnings) console.Message("  " + warning);
    for (const LeftOut& item : camera.left_out) {
      console.Message(fmt::format("  left out {}: {}", item.where, item.reason));
    }
    out.Write(fmt::format("vignetting_{}.tiff", job.camera), camera.attenuation_tiff);
    if (camera.grid) {
      out.Write(fmt::format("micro_lenses_{}.csv", job.camera),
                FormatMicroLenses(camera.grid->array));
      out.Write(fmt::format("grid_{}.png", job.camera), camera.grid_png);
    }
  }
  out.Commit();
  for (size_t i = 0; i < jobs.size(); ++i) PrintSummary(jobs[i], cameras[i]);
}

}  // namespace plenocal
