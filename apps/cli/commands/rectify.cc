// SPDX-License-Identifier: Apache-2.0
#include "engine/resample/rectify.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/image_inputs.h"
#include "apps/cli/options.h"
#include "apps/cli/resample_to_folder.h"
#include "apps/cli/view_options.h"
#include "calib/base/error.h"
#include "calib/base/number_text.h"
#include "calib/files/calibration_file.h"
#include "calib/files/detections.h"
#include "calib/files/session.h"
#include "engine/formats/opencv_storage.h"
#include "engine/formats/poses.h"
#include "engine/recording/frames/session_images.h"
#include "engine/resample/resample_images.h"
#include "engine/resample/stereo_pairs.h"
#include "engine/session/open_session.h"
#include "models/registry.h"

namespace plenocal {
namespace {

/// A stereo pair and its images.
struct RectifyArguments {
  std::filesystem::path calibration;
  std::string left, right;           ///< images, each a folder, glob or file; empty: none
  std::filesystem::path session;     ///< session.yaml that lists the images; empty: none
  std::vector<std::string> cameras;  ///< two names; empty: the calibration's two
  std::filesystem::path
      detections;  ///< folder of detections_<camera>.csv; empty: that of the calibration
  ViewArguments view;
  ResampleArguments resample;
  bool maps = false;     ///< write remap tables
  bool preview = false;  ///< write pictures of the pairs
  std::filesystem::path out;
};

namespace fs = std::filesystem;

using Cameras = std::array<const CalibratedCamera*, 2>;

Cameras ChooseCameras(const CalibrationRecord& calibration, const std::vector<std::string>& names) {
  if (!names.empty()) {
    return {&FindCamera(calibration, names[0]), &FindCamera(calibration, names[1])};
  }
  if (calibration.cameras.size() == 2) return {&calibration.cameras[0], &calibration.cameras[1]};
  throw Error(
      ErrorKind::kInput,
      fmt::format("{}: holds {}; a pair is needed{}",
                  calibration.path.string(),
                  Counted(calibration.cameras.size(), "camera"),
                  calibration.cameras.size() > 2 ? ", say which by --cameras LEFT RIGHT" : ""));
}

/// One folder with the images of both cameras: in subfolders named after them, or in files whose
/// names contain the cameras'.
StereoImages FolderOfBoth(const fs::path& folder, const Cameras& cameras) {
  StereoImages images;
  for (size_t c = 0; c < 2; ++c) {
    const fs::path own = folder / cameras[c]->name;
    if (fs::is_directory(own)) {
      images[c] = FindImageInputs({own}, "images");
      continue;
    }
    for (const FrameImage& image : FindImageInputs({folder}, "images")) {
      const size_t at = image.frame.find(cameras[c]->name);
      if (at == std::string::npos) continue;
      images[c].push_back(image);
      images[c].back().frame.erase(at, cameras[c]->name.size());
    }
    if (!images[c].empty()) continue;
    throw Error(
        ErrorKind::kInput,
        fmt::format("{}: has neither a folder '{}' nor images with that camera's name; give "
                    "the images of both cameras, LEFT RIGHT",
                    folder.string(),
                    cameras[c]->name));
  }
  return images;
}

StereoImages FindImages(const RectifyArguments& arguments, const Cameras& cameras) {
  if (!arguments.session.empty()) {
    const Session session = OpenSession(arguments.session);
    StereoImages images;
    std::vector<std::string> notes;
    std::vector<std::vector<FrameImage>> all = ListSessionImages(session, &notes);
    for (size_t c = 0; c < 2; ++c) {
      const auto found =
          std::find_if(session.cameras.begin(), session.cameras.end(), [&](const auto& camera) {
            return camera.name == cameras[c]->name;
          });
      if (found == session.cameras.end() || found->images.empty()) {
        throw Error(
            ErrorKind::kInput,
            fmt::format(
                "{}: has no images of camera '{}'", arguments.session.string(), cameras[c]->name));
      }
      images[c] = all[static_cast<size_t>(found - session.cameras.begin())];
    }
    return images;
  }
  if (arguments.left.empty()) return {};
  if (arguments.right.empty() && fs::is_directory(arguments.left)) {
    return FolderOfBoth(arguments.left, cameras);
  }
  if (arguments.right.empty()) {
    throw Error(ErrorKind::kInput, "the images of the second camera are missing; give LEFT RIGHT");
  }
  return {FindImageInputs({arguments.left}, "images"),
          FindImageInputs({arguments.right}, "images")};
}

/// Images that belong together, with messages about those that do not.
StereoImages KeepPairs(StereoImages images, Console* console) {
  StereoPairs pairs = PairImages(std::move(images));
  for (const LeftOut& item : pairs.left_out) {
    console->Message(fmt::format("  left out {}: {}", item.where, item.reason));
  }
  if (pairs.by_number) {
    console->Message(fmt::format("paired by the numbers in their names: {} with {}",
                                 pairs.images[0][0].path.string(),
                                 pairs.images[1][0].path.string()));
  }
  return std::move(pairs.images);
}

/// R1 R2 P1 P2 Q as cv::stereoRectify returns them.
std::string RectificationText(const RectifiedPair& pair) {
  const std::vector<double>& p = pair.views[0].params;
  const double b = pair.baseline;
  std::string text = kOpenCvHead;
  for (size_t c = 0; c < 2; ++c) {
    text += OpenCvMatrix(fmt::format("R{}", c + 1), 3, 3, 'd', RowMajor(pair.R_view_camera[c]));
  }
  for (size_t c = 0; c < 2; ++c) {
    text += OpenCvMatrix(fmt::format("P{}", c + 1), 3, 4, 'd', pair.ProjectionMatrix(c));
  }
  const std::array Q{
      1.0, 0.0, 0.0, -p[2], 0.0, 1.0, 0.0, -p[3], 0.0, 0.0, 0.0, p[0], 0.0, 0.0, 1 / b, 0.0};
  return text + OpenCvMatrix("Q", 4, 4, 'd', Q);
}

/// How well the rectified views fit the calibration's own detections.
std::string EpipolarText(const RectifyArguments& arguments,
                         const RectifiedPair& pair,
                         const Cameras& cameras) {
  const fs::path folder =
      arguments.detections.empty() ? arguments.calibration.parent_path() : arguments.detections;
  std::array<fs::path, 2> files;
  std::array<std::vector<View>, 2> views;
  for (size_t c = 0; c < 2; ++c) {
    files[c] = folder / fmt::format("detections_{}.csv", cameras[c]->name);
    if (!fs::exists(files[c]) && arguments.detections.empty()) {
      return fmt::format(
          "epipolar error: no {}; give the folder of the detections with --detections\n",
          files[c].string());
    }
    views[c] = ReadDetections(files[c], *cameras[c]->model);
  }
  const EpipolarErrors errors = MeasureEpipolarErrors(pair, cameras, views);
  if (errors.points == 0) {
    return "epipolar error: no marker was seen by both cameras in one frame\n";
  }
  return fmt::format(
      "epipolar error of the detected markers ({} and {}): vertical difference over {} in {}: RMS "
      "{:.4f} px, mean |dy| {:.4f} px, largest {:.3f} px\n",
      files[0].string(),
      files[1].string(),
      Counted(errors.points, "point"),
      Counted(errors.frames, "pair"),
      errors.rms,
      errors.mean_absolute,
      errors.largest);
}

/// Encoded images of both cameras by frame.
using Encoded = std::array<std::map<std::string, std::string>, 2>;

/// Writes preview/<frame>.png of each pair. Pairs are in the order of `images`.
void WritePreviews(const StereoImages& images, const Encoded& encoded, OutputFolder* out) {
  for (size_t i = 0; i < images[0].size(); ++i) {
    const std::string& frame = images[0][i].frame;
    const auto first = encoded[0].find(frame), second = encoded[1].find(images[1][i].frame);
    if (first == encoded[0].end() || second == encoded[1].end()) continue;
    out->Write(fmt::format("preview/{}.png", frame), DrawPair(first->second, second->second));
  }
}

std::string SummaryText(const RectifiedPair& pair, const std::array<size_t, 2>& images) {
  return fmt::format(
      "{} and {}: {} and {} images; {}\nbaseline {:.6g} m{}\n",
      pair.views[0].name,
      pair.views[1].name,
      images[0],
      images[1],
      ViewText(pair.views[0]),
      pair.baseline,
      pair.turned         ? "; the cameras stand above each other: images turned by 90 degrees"
      : pair.baseline < 0 ? "; the second camera stands on the left: disparities are negative"
                          : "");
}

void RunRectify(const RectifyArguments& arguments, const ConsoleOptions& shared) {
  const CalibrationRecord calibration = ReadCalibration(arguments.calibration, CameraModels());
  const Cameras cameras = ChooseCameras(calibration, arguments.cameras);
  const RectifiedPair pair = Rectify(*cameras[0], *cameras[1], ToViewOptions(arguments.view));
  Console console(shared);
  const StereoImages images = KeepPairs(FindImages(arguments, cameras), &console);
  if (arguments.preview && images[0].empty()) {
    throw Error(ErrorKind::kInput, "--preview: there are no images; give LEFT RIGHT or --session");
  }

  std::array<size_t, 2> counts{};
  for (size_t c = 0; c < 2; ++c) CheckImageNames(images[c]);
  OutputFolder out(arguments.out);
  out.RefuseInputs({"calibration.yaml"});
  Encoded encoded;
  for (size_t c = 0; c < 2; ++c) {
    const PixelMap map =
        MapPixels(pair.views[c], *cameras[c], pair.R_view_camera[c].transpose(), shared.threads);
    const std::string folder = cameras[c]->name + "/";
    if (!images[c].empty()) {
      counts[c] = ResampleToFolder(images[c],
                                   {calibration,
                                    *cameras[c],
                                    map,
                                    arguments.resample,
                                    folder,
                                    arguments.preview ? &encoded[c] : nullptr},
                                   shared,
                                   &out);
    }
    if (!arguments.maps && !arguments.resample.mask) continue;
    for (const auto& [name, content] : MapFiles(map, {}, "")) {
      if (name == "mask.png" ? arguments.resample.mask : arguments.maps) {
        out.Write(folder + name, content);
      }
    }
  }
  out.Write("calibration.yaml",
            GivenCamerasYaml(pair.views,
                             {{"plenocal_version", PLENOCAL_VERSION},
                              {"rectified_from", arguments.calibration.string()}}));
  out.Write("rectification.yaml", RectificationText(pair));
  WritePreviews(images, encoded, &out);
  out.Commit();
  console.Print(fmt::format("{}{}written to {}\n",
                            SummaryText(pair, counts),
                            EpipolarText(arguments, pair, cameras),
                            arguments.out.string()));
}

constexpr const char* kRectifyHelp =
    "Stereo pairs whose points lie in equal rows.\n"
    "\n"
    "  plenocal rectify calibration.yaml 'left/*.png' 'right/*.png' -o DIR\n"
    "  plenocal rectify calibration.yaml LEFT_FOLDER RIGHT_FOLDER -o DIR --preview\n"
    "  plenocal rectify OUT/calibration.yaml --session session.yaml -o DIR\n"
    "\n"
    "writes DIR/<camera>/<frame>.png, DIR/calibration.yaml (two pinhole cameras of equal parameters, baseline along x) and rectification.yaml (R1 R2 P1 P2 Q of OpenCV); prints the epipolar error of the calibration's detections.";

RunCommand DeclareRectify(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<RectifyArguments>();
  app->add_option("calibration", arguments->calibration, "calibration.yaml")->required();
  app->add_option("left",
                  arguments->left,
                  "images of the first camera: glob, folder, file; or a folder of both");
  app->add_option("right", arguments->right, "images of the second camera, likewise");
  app->add_option("--session", arguments->session, "session.yaml that names the images")
      ->excludes("left");
  app->add_option("--cameras", arguments->cameras, "first and second camera (default: the two)")
      ->expected(2);
  app->add_option("--detections",
                  arguments->detections,
                  "folder of detections_<camera>.csv (default: that of the calibration)");
  app->add_option("-o,--out", arguments->out, "folder for the results")->required();
  app->add_flag("--maps", arguments->maps, "write <camera>/map_x.tiff and map_y.tiff");
  app->add_flag("--preview",
                arguments->preview,
                "write preview/<frame>.png: both images side by side with lines along rows");
  AddViewOptions(app, &arguments->view);
  AddResampleOptions(app, &arguments->resample);
  AddThreads(app, shared);
  AddQuiet(app, shared);
  return [arguments, shared] { RunRectify(*arguments, *shared); };
}

}  // namespace

Command RectifyCommand() { return {"rectify", kRectifyHelp, DeclareRectify}; }

}  // namespace plenocal
