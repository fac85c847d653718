// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "apps/cli/options.h"
#include "calib/base/json_text.h"
#include "calib/base/quoted_text.h"
#include "engine/locate_images.h"

namespace plenocal {
namespace {

struct LocateArguments : LocateRequest {
  bool json = false;
};

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

void RunLocate(const LocateArguments& arguments, Console* console) {
  std::string lines;
  nlohmann::ordered_json poses = nlohmann::ordered_json::array();
  for (const auto& [name, located] : LocateImages(arguments, console->NewRun())) {
    lines += LineText(name, located);
    poses.push_back(JsonOf(name, located));
  }
  console->Print(arguments.json ? JsonText(poses) + "\n" : lines);
}

constexpr const char* kLocateHelp =
    "Pose of single images of a calibrated camera, with covariance.\n"
    "\n"
    "  plenocal locate calibration.yaml target.yaml image.png --camera left\n"
    "  plenocal locate calibration.yaml target.yaml raw.png --camera plenoptic --white 'white/*.png'\n"
    "  plenocal locate calibration.yaml truth/points.csv image.png --camera left -o poses.csv\n"
    "\n"
    "MAP is a target, or points.csv of an earlier groundtruth run. Tables of detections (CSV) stand for images.";

void DeclareLocate(CLI::App* app, LocateArguments* arguments, ConsoleOptions* shared) {
  AddCalibration(app, &arguments->calibration);
  app->add_option("map", arguments->map, "target.yaml, or points.csv of an earlier run")
      ->required();
  app->add_option("images", arguments->images, "images, or detections (CSV)")->required();
  app->add_option("--camera", arguments->camera, "camera of the calibration");
  app->add_option("--white", arguments->white, "white images of a plenoptic camera");
  AddBayer(app, &arguments->bayer, "colours of the top-left 2 x 2 pixels of raw mosaics");
  AddJson(app, &arguments->json);
  app->add_option("-o,--out", arguments->out, "table of poses and covariances (CSV)");
  AddThreadsAndQuiet(app, shared);
}

}  // namespace

Command LocateCommand() { return MakeCommand("locate", kLocateHelp, DeclareLocate, RunLocate); }

}  // namespace plenocal
