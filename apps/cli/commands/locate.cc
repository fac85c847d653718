// SPDX-License-Identifier: Apache-2.0
#include "engine/scene/locate.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>

#include "apps/cli/command.h"
#include "apps/cli/image_inputs.h"
#include "apps/cli/options.h"
#include "calib/base/error.h"
#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"
#include "calib/files/calibration_file.h"
#include "calib/files/detections.h"
#include "calib/io/output_folder.h"
#include "detectors/detect.h"
#include "detectors/images/image.h"
#include "models/registry.h"
#include "targets/target.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

struct LocateArguments {
  fs::path calibration, map;
  std::vector<std::string> inputs;  ///< images, or one table of detections
  std::string camera;               ///< empty: the calibration's only one
  std::vector<std::string> white;
  std::optional<BayerOrder> bayer;
  bool json = false;
  fs::path out;  ///< CSV; empty: none
};

/// A view and the image that it comes from.
struct NamedView {
  std::string name;
  View view;
};

/// What is seen, and where the points are.
struct Sightings {
  std::vector<NamedView> views;
  std::map<int, Eigen::Vector3d> points;
  Numbering numbering = Numbering::kByMarker;
};

bool IsTable(const fs::path& path) { return path.extension() == ".csv"; }

void CheckSize(const CalibratedCamera& camera, ImageSize size, const std::string& image) {
  if (size == camera.image_size) return;
  throw Error(ErrorKind::kInput,
              fmt::format("{}: {} x {} px, but the calibration of '{}' is for {} x {}",
                          image,
                          size[0],
                          size[1],
                          camera.name,
                          camera.image_size[0],
                          camera.image_size[1]));
}

/// The target's markers in the images.
void DetectMarkers(const LocateArguments& arguments,
                   const CalibratedCamera& camera,
                   const ConsoleOptions& shared,
                   Console* console,
                   Sightings* seen) {
  const std::vector<FrameImage> images = FindImageInputs(arguments.inputs, "images");
  const DetectOptions options{
      .white_images = arguments.white.empty() ? std::vector<FrameImage>()
                                              : FindImageInputs(arguments.white, "white images"),
      .bayer = arguments.bayer,
      .threads = shared.threads,
      .progress = [&](size_t done) { return console->Progress("images", done, images.size()); }};
  ImageDetections found =
      DetectImages(images,
                   ReadTarget(arguments.map),
                   camera.model->plenoptic ? CameraOptics::kPlenoptic : CameraOptics::kOrdinary,
                   options);
  CheckSize(camera, found.image_size, arguments.inputs[0]);
  if (camera.model->assign_lens_types != nullptr) camera.model->assign_lens_types(&found.views);
  for (const FrameImage& image : images) {
    const auto same = [&](const View& view) { return view.frame == image.frame; };
    const auto view = std::ranges::find_if(found.views, same);
    seen->views.push_back({image.path.string(), view == found.views.end() ? View{} : *view});
  }
}

/// Micro lenses and attenuation from the white images.
PlenopticCamera OpticsOf(const LocateArguments& arguments,
                         const CalibratedCamera& camera,
                         const ConsoleOptions& shared,
                         Console* console) {
  if (arguments.white.empty()) {
    throw Error(
        ErrorKind::kInput,
        fmt::format("camera '{}' is plenoptic: give its white images with --white", camera.name));
  }
  std::vector<LeftOut> left_out;
  PlenopticCamera optics = MeasurePlenopticCamera(
      FindImageInputs(arguments.white, "white images"), arguments.bayer, shared.threads, &left_out);
  for (const LeftOut& item : left_out) {
    console->Message(fmt::format("  left out {}: {}", item.where, item.reason));
  }
  return optics;
}

/// Points of a map in the images, by their looks.
void MatchPoints(const LocateArguments& arguments,
                 const CalibratedCamera& camera,
                 const LandmarkMap& map,
                 const ConsoleOptions& shared,
                 Console* console,
                 Sightings* seen) {
  if (map.descriptors.empty()) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: no descriptors.png beside it, by which points are recognised in "
                            "images; give detections (CSV) in their place",
                            arguments.map.string()));
  }
  std::optional<PlenopticCamera> optics;
  if (camera.model->plenoptic) optics = OpticsOf(arguments, camera, shared, console);
  const std::vector<FrameImage> images = FindImageInputs(arguments.inputs, "images");
  for (const FrameImage& image : images) {
    if (!console->Progress("images", seen->views.size(), images.size())) throw Stopped();
    const cv::Mat pixels = optics ? ReadImage(image) : ReadGray(image);
    CheckSize(camera, {pixels.cols, pixels.rows}, image.path.string());
    seen->views.push_back({image.path.string(),
                           optics ? MatchLandmarks(pixels, camera, *optics, map, shared.threads)
                                  : MatchLandmarks(pixels, map)});
  }
  seen->numbering = Numbering::kByAppearance;
}

Sightings FindSightings(const LocateArguments& arguments,
                        const CalibratedCamera& camera,
                        const ConsoleOptions& shared,
                        Console* console) {
  Sightings seen;
  LandmarkMap map;
  if (IsTable(arguments.map)) {
    map = ReadLandmarkMap(arguments.map);
    seen.points = map.points;
  } else {
    seen.points = ReadTarget(arguments.map).markers;
  }
  if (IsTable(arguments.inputs[0])) {
    for (const std::string& input : arguments.inputs) {
      for (View& view : ReadDetections(input, *camera.model)) {
        seen.views.push_back({view.frame, std::move(view)});
      }
    }
  } else if (IsTable(arguments.map)) {
    MatchPoints(arguments, camera, map, shared, console, &seen);
  } else {
    DetectMarkers(arguments, camera, shared, console, &seen);
  }
  return seen;
}

constexpr std::array kPoseNames{"x", "y", "z", "w_x", "w_y", "w_z"};

std::string HeaderText() {
  std::string text = "image,points,used,rms,x,y,z,qx,qy,qz,qw";
  for (size_t i = 0; i < kPoseNames.size(); ++i) {
    for (size_t j = i; j < kPoseNames.size(); ++j) {
      text += fmt::format(",cov_{}_{}", kPoseNames[i], kPoseNames[j]);
    }
  }
  return text + "\n";
}

std::string RowText(const std::string& name, const LocatedView& located) {
  const Eigen::Quaterniond q(located.T_map_camera.R);
  const Eigen::Vector3d& t = located.T_map_camera.t;
  std::string text =
      fmt::format("{},{},{},{:.6g},{:.12g},{:.12g},{:.12g},{:.12g},{:.12g},{:.12g},{:.12g}",
                  CsvCell(name),
                  located.points,
                  located.used,
                  located.rms,
                  t.x(),
                  t.y(),
                  t.z(),
                  q.x(),
                  q.y(),
                  q.z(),
                  q.w());
  for (Eigen::Index i = 0; i < 6; ++i) {
    for (Eigen::Index j = i; j < 6; ++j) text += fmt::format(",{:.9g}", located.covariance(i, j));
  }
  return text + "\n";
}

nlohmann::ordered_json JsonOf(const std::string& name, const LocatedView& located) {
  const Eigen::Quaterniond q(located.T_map_camera.R);
  const Eigen::Vector3d& t = located.T_map_camera.t;
  nlohmann::ordered_json covariance = nlohmann::ordered_json::array();
  for (Eigen::Index i = 0; i < 6; ++i) {
    const Vector6d row = located.covariance.row(i);
    covariance.push_back(std::vector<double>(row.begin(), row.end()));
  }
  return {{"image", name},
          {"points", located.points},
          {"used", located.used},
          {"rms", located.rms},
          {"translation", {t.x(), t.y(), t.z()}},
          {"quaternion", {q.x(), q.y(), q.z(), q.w()}},
          {"covariance", covariance}};
}

std::string LineText(const std::string& name, const LocatedView& located) {
  const Eigen::Vector3d& t = located.T_map_camera.t;
  const Vector6d sigma = located.covariance.diagonal().cwiseSqrt();
  return fmt::format(
      "{}: ({:.5f}, {:.5f}, {:.5f}) m +- {:.2g} mm, {:.2g} mrad; {} of {} points, "
      "RMS {:.3f} px\n",
      Escaped(name),
      t.x(),
      t.y(),
      t.z(),
      1e3 * sigma.head<3>().norm(),
      1e3 * sigma.tail<3>().norm(),
      located.used,
      located.points,
      located.rms);
}

void RunLocate(const LocateArguments& arguments, const ConsoleOptions& shared) {
  Console console(shared);
  const CalibrationRecord calibration = ReadCalibration(arguments.calibration, CameraModels());
  const CalibratedCamera& camera = FindCamera(calibration, arguments.camera);
  const Sightings seen = FindSightings(arguments, camera, shared, &console);
  std::string csv = HeaderText(), lines;
  nlohmann::ordered_json poses = nlohmann::ordered_json::array();
  for (const NamedView& each : seen.views) {
    const std::optional<LocatedView> located =
        LocateView(camera, each.view, seen.points, seen.numbering);
    if (!located) {
      console.Message(fmt::format("  left out {}: shows too few points of {} for a pose",
                                  each.name,
                                  arguments.map.string()));
      continue;
    }
    if (located->rival && located->rival->IsAmbiguous()) {
      console.Message(
          fmt::format("  left out {}: fits in two ways: {}", each.name, located->rival->Text()));
      continue;
    }
    csv += RowText(each.name, *located);
    lines += LineText(each.name, *located);
    poses.push_back(JsonOf(each.name, *located));
  }
  if (poses.empty()) {
    throw Error(ErrorKind::kJob,
                fmt::format("none of {} has a pose before {}",
                            Counted(seen.views.size(), "image"),
                            arguments.map.string()));
  }
  if (!arguments.out.empty()) WriteOutput(arguments.out, csv);
  if (arguments.json) {
    using Handler = nlohmann::ordered_json::error_handler_t;
    console.Print(poses.dump(2, ' ', false, Handler::replace) + "\n");
  } else {
    console.Print(lines);
  }
}

constexpr const char* kLocateHelp =
    "Pose of single images of a calibrated camera, with covariance.\n"
    "\n"
    "  plenocal locate calibration.yaml target.yaml image.png --camera left\n"
    "  plenocal locate calibration.yaml target.yaml raw.png --camera plenoptic --white 'white/*.png'\n"
    "  plenocal locate calibration.yaml truth/points.csv image.png --camera left -o poses.csv\n"
    "\n"
    "MAP is a target, or points.csv of an earlier groundtruth run. Tables of detections (CSV) stand for images.";

RunCommand DeclareLocate(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<LocateArguments>();
  app->add_option("calibration", arguments->calibration, "calibration.yaml")->required();
  app->add_option("map", arguments->map, "target.yaml, or points.csv of an earlier run")
      ->required();
  app->add_option("images", arguments->inputs, "images, or detections (CSV)")->required();
  app->add_option("--camera", arguments->camera, "camera of the calibration");
  app->add_option("--white", arguments->white, "white images of a plenoptic camera");
  AddBayer(app, &arguments->bayer, "colours of the top-left 2 x 2 pixels of raw mosaics");
  app->add_flag("--json", arguments->json, "JSON on standard output");
  app->add_option("-o,--out", arguments->out, "table of poses and covariances (CSV)");
  AddQuiet(app, shared);
  AddThreads(app, shared);
  return [arguments, shared] { RunLocate(*arguments, *shared); };
}

}  // namespace

Command LocateCommand() { return {"locate", kLocateHelp, DeclareLocate}; }

}  // namespace plenocal
