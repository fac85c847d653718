// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>

#include "apps/commands.h"
#include "apps/formats/camera_format.h"
#include "calib/error.h"
#include "calib/output_folder.h"
#include "models/registry.h"

namespace plenocal {
namespace {

const CameraFormat& FindFormat(const std::string& name) {
  std::vector<std::string_view> names;
  for (const CameraFormat& format : CameraFormats()) {
    if (format.name == name) return format;
    names.push_back(format.name);
  }
  throw Error(ErrorKind::kInput,
              fmt::format("--format: unknown '{}'{}", name, SuggestName(name, names)));
}

std::vector<CalibratedCamera> ChosenCameras(const CalibrationFile& calibration,
                                            const std::vector<std::string>& names) {
  if (names.empty()) return calibration.cameras;
  std::vector<CalibratedCamera> chosen;
  chosen.reserve(names.size());
  for (const std::string& name : names) chosen.push_back(FindCamera(calibration, name));
  return chosen;
}

}  // namespace

void RunExport(const ExportCommand& command, const ConsoleOptions& options) {
  Console console(options.quiet);
  const CameraFormat& format = FindFormat(command.format);
  const CalibrationFile calibration = ReadCalibration(command.calibration, CameraModels());
  const std::vector<CalibratedCamera> cameras = ChosenCameras(calibration, command.cameras);
  if (cameras.size() > format.most_cameras) {
    std::vector<std::string_view> names;
    for (const CalibratedCamera& camera : cameras) names.emplace_back(camera.name);
    throw Error(ErrorKind::kInput,
                fmt::format("a file of format {} holds {} camera{}, but {} has {} ({}); choose "
                            "with --camera",
                            format.name,
                            format.most_cameras,
                            format.most_cameras == 1 ? "" : "s",
                            command.calibration.string(),
                            cameras.size(),
                            fmt::join(names, ", ")));
  }
  if (cameras.size() > 1 && !format.holds_extrinsics) {
    console.Message(fmt::format(
        "format {} has no place for the cameras' poses in the rig; they are not in the file",
        format.name));
  }
  const std::string text = format.write(cameras);
  const std::filesystem::path folder = command.out.parent_path();
  OutputFolder output(folder.empty() ? "." : folder);
  output.Write(command.out.filename().string(), text);
  output.Commit();
  fmt::print("written to {}\n", command.out.string());
}

}  // namespace plenocal
