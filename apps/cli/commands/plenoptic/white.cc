// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <optional>

#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "calib/base/error.h"
#include "calib/base/number_text.h"
#include "calib/camera/bayer.h"
#include "calib/files/frame_images.h"
#include "calib/files/raytrix_grid.h"
#include "calib/files/session.h"
#include "calib/io/output_folder.h"
#include "detectors/plenoptic/white/white_camera.h"
#include "engine/recording/stores/image_lister.h"
#include "engine/session/open_session.h"
#include "models/registry.h"

namespace plenocal {
namespace {

/// White images: those of a session's cameras, or, with `model`, the files that `inputs` lists.
struct WhiteArguments {
  std::vector<std::string> inputs;  ///< session.yaml; or folders, globs and files
  std::string model;                ///< camera model; empty: `inputs` is a session
  std::string camera;               ///< name for the results; empty: that of the images' folder
  std::optional<BayerOrder> bayer;  ///< of raw mosaics
  std::optional<std::filesystem::path> grid;  ///< RayCalibData XML
  bool xml = false;                           ///< also write the grid as such a file
  std::filesystem::path out;
};

/// One camera's job.
struct WhiteJob {
  std::string camera;
  std::vector<FrameImage> images;
  WhiteOptions options;
};

/// Whether cameras of this model see through micro lenses.
bool IsPlenoptic(const CameraModel& model) { return model.plenoptic; }

bool IsPlenoptic(const std::string& name) {
  if (const CameraModel* model = FindModel(CameraModels(), name)) return IsPlenoptic(*model);
  std::vector<std::string_view> known;
  for (const CameraModel& model : CameraModels()) known.push_back(model.name);
  throw Error(ErrorKind::kInput,
              fmt::format("--model: unknown camera model '{}'{}", name, SuggestName(name, known)));
}

std::vector<WhiteJob> SessionJobs(const WhiteArguments& arguments, const Session& session) {
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
                 .images = ListImages(camera.white_images, camera.name + ": white_images"),
                 .options = {.plenoptic = plenoptic, .bayer = camera.bayer}};
    if (!camera.images.empty()) {
      const FrameImage raw = ListImages(camera.images, camera.name + ": images").front();
      if (!raw.store) job.options.raw_image = raw.path;
    }
    if (plenoptic) job.options.grid_file = arguments.grid;
    jobs.push_back(std::move(job));
  }
  if (jobs.empty()) {
    throw Error(
        ErrorKind::kInput,
        fmt::format("{}: no camera has 'white_images'; nothing to do", session.path.string()));
  }
  return jobs;
}

WhiteJob FolderJob(const WhiteArguments& arguments) {
  WhiteJob job{.camera = arguments.camera,
               .images = FindImageInputs(arguments.inputs, "white images"),
               .options = {.plenoptic = IsPlenoptic(arguments.model),
                           .bayer = arguments.bayer,
                           .grid_file = arguments.grid}};
  if (job.camera.empty()) {
    const auto folder = std::filesystem::absolute(job.images[0].path).parent_path();
    job.camera = folder.filename().string();
  }
  return job;
}

/// A sensor's raw values follow the line to within this, relative.
constexpr double kRawMisfit = 0.1;
constexpr size_t kDefectsShown = 8;

double Degrees(double radians) { return radians * 180 / std::numbers::pi; }

std::string GridText(const MicroLensGrid& grid) {
  const MicroLensArray& array = grid.array;
  const LatticeKind kind = array.Lattice();
  const double angle = kind == LatticeKind::kHexagonal ? 60 : 90;
  std::vector<size_t> by_type(static_cast<size_t>(array.types), 0);
  size_t unusable = 0;
  for (const MicroLens& lens : array.lenses) {
    ++by_type[static_cast<size_t>(lens.type)];
    if (!lens.usable) ++unusable;
  }
  std::string text = fmt::format(
      "  {}, {} unusable, {}\n",
      Counted(array.lenses.size(), "micro lens", "micro lenses"),
      unusable,
      array.types == 1 ? std::string("one type")
                       : fmt::format("{} types: {}", array.types, fmt::join(by_type, ", ")));
  text += fmt::format(
      "  {} lattice, pitch {} px, rotation {:.4f} deg, in the middle; rows {:.0f} deg apart to "
      "{:.3f} deg\n",
      kind == LatticeKind::kHexagonal ? "hexagonal" : "rectangular",
      kind == LatticeKind::kHexagonal
          ? fmt::format("{:.4f}", array.Pitch())
          : fmt::format("{:.4f} x {:.4f}", array.e_column.norm(), array.e_row.norm()),
      Degrees(std::atan2(array.e_column.y(), array.e_column.x())),
      angle,
      std::abs(angle - Degrees(std::acos(array.e_column.dot(array.e_row) /
                                         (array.e_column.norm() * array.e_row.norm())))));
  text += fmt::format(
      "  single centres about the lattice: {:.4f} px RMS, {:.4f} px robust, per coordinate{}\n",
      grid.centre_rms,
      grid.centre_sigma,
      grid.degree > 0 ? fmt::format(" (lattice bent by order {})", grid.degree) : "");
  text += fmt::format(
      "  micro images: brightness varies by {:.2f} % between neighbours, profile fits to {:.2f} "
      "%\n",
      100 * grid.gain_spread,
      100 * grid.misfit);
  return text;
}

std::string NoiseText(const PhotonTransfer& noise) {
  std::string text =
      fmt::format("  noise: variance = ({:.3f} +- {:.3f})^2 + ({:.4f} +- {:.4f}) x grey value\n",
                  noise.read,
                  noise.read_sigma,
                  noise.gain,
                  noise.gain_sigma);
  if (noise.misfit > kRawMisfit) {
    text += fmt::format(
        "  the noise deviates from this line by {:.0f} %: these are no raw values (gamma, JPEG, "
        "noise reduction), or noise below the rounding\n",
        100 * noise.misfit);
  }
  if (noise.defects.empty()) return text;
  text += fmt::format("  {}:", Counted(noise.defects.size(), "defective pixel"));
  for (size_t i = 0; i < std::min(noise.defects.size(), kDefectsShown); ++i) {
    text += fmt::format(" ({}, {})", noise.defects[i].x, noise.defects[i].y);
  }
  return text + (noise.defects.size() > kDefectsShown ? " ...\n" : "\n");
}

std::string SummaryText(const WhiteJob& job, const WhiteCamera& camera) {
  std::string text =
      fmt::format("{}: {} of {} white images, {} x {} px, mean {:.1f} of {:.0f} grey values\n",
                  job.camera,
                  camera.images,
                  job.images.size(),
                  camera.image_size[0],
                  camera.image_size[1],
                  camera.level,
                  camera.full_scale);
  text += fmt::format(
      "  saturated {:.3f} %, black {:.3f} % of the pixels; illumination uneven by {:.1f} % from "
      "side to side\n",
      100 * camera.saturated,
      100 * camera.black,
      100 * camera.unevenness);
  text += fmt::format("  attenuation from {:.3f} to 1\n", camera.darkest);
  if (camera.noise) text += NoiseText(*camera.noise);
  if (camera.grid) text += GridText(*camera.grid);
  return text;
}

void RunWhite(const WhiteArguments& arguments, const ConsoleOptions& shared) {
  std::vector<WhiteJob> jobs;
  if (arguments.model.empty()) {
    if (arguments.inputs.size() != 1 || std::filesystem::is_directory(arguments.inputs[0])) {
      throw Error(ErrorKind::kInput,
                  "white: give one session.yaml, or a folder or images with --model");
    }
    const Session session = OpenSession(arguments.inputs[0]);
    jobs = SessionJobs(arguments, session);
  } else {
    jobs.push_back(FolderJob(arguments));
  }

  OutputFolder out(arguments.out);
  Console console(shared);
  std::vector<WhiteCamera> cameras;
  for (WhiteJob& job : jobs) {
    console.Progress(job.camera + ": white images");
    job.options.threads = shared.threads;
    job.options.measure_noise = true;
    try {
      cameras.push_back(MeasureWhiteImages(job.images, job.options));
    } catch (const Error& error) {
      throw Error(error.kind(), fmt::format("{}: {}", job.camera, error.what()));
    }
    if (Interrupted()) throw Stopped();
    const WhiteCamera& camera = cameras.back();
    for (const std::string& warning : camera.warnings) console.Warning(warning);
    for (const LeftOut& item : camera.left_out) {
      console.Message(fmt::format("  left out {}: {}", item.where, item.reason));
    }
    out.Write(fmt::format("vignetting_{}.tiff", job.camera), camera.attenuation_tiff);
    if (camera.noise) {
      out.Write(fmt::format("noise_{}.yaml", job.camera), PhotonTransferYaml(*camera.noise));
    }
    if (camera.grid) {
      out.Write(fmt::format("micro_lenses_{}.csv", job.camera),
                FormatMicroLenses(camera.grid->array));
      out.Write(fmt::format("grid_{}.png", job.camera), camera.grid_png);
      if (arguments.xml) {
        out.Write(fmt::format("micro_lenses_{}.xml", job.camera),
                  RayCalibDataXml(camera.grid->array));
      }
    }
  }
  out.Commit();
  for (size_t i = 0; i < jobs.size(); ++i) console.Print(SummaryText(jobs[i], cameras[i]));
}

constexpr const char* kWhiteHelp =
    "From white images to micro-image centres and attenuation.\n"
    "\n"
    "  plenocal white session.yaml -o OUT\n"
    "  plenocal white FOLDER --model focused-plenoptic -o OUT\n"
    "\n"
    "writes OUT/vignetting_<camera>.tiff, noise_<camera>.yaml and, for a plenoptic camera, micro_lenses_<camera>.csv and grid_<camera>.png.";

RunCommand DeclareWhite(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<WhiteArguments>();
  app->add_option("input", arguments->inputs, "session.yaml; with --model a folder, glob or files")
      ->required();
  app->add_option("-o,--out", arguments->out, "folder for the results")->required();
  app->add_option("--model", arguments->model, "camera model of the images")->expected(1);
  app->add_option("--camera", arguments->camera, "name for the results (default: the folder's)");
  AddBayer(app, &arguments->bayer, "colours of the top-left 2 x 2 pixels of raw mosaics");
  app->add_option("--grid", arguments->grid, "RayCalibData XML with the micro-lens grid");
  app->add_flag("--xml", arguments->xml, "also write micro_lenses_<camera>.xml (RayCalibData)");
  AddThreads(app, shared);
  AddQuiet(app, shared);
  return [arguments, shared] { RunWhite(*arguments, *shared); };
}

}  // namespace

Command WhiteCommand() { return {"white", kWhiteHelp, DeclareWhite}; }

}  // namespace plenocal
