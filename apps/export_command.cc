// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>

#include "apps/commands.h"
#include "apps/formats/camera_format.h"
#include "apps/image_module.h"
#include "calib/error.h"
#include "calib/names.h"
#include "calib/output_folder.h"
#include "models/registry.h"

namespace plenocal {
namespace {

const CameraFormat& FindFormat(const std::string& name, const std::filesystem::path& file) {
  if (const CameraFormat* format = FindCameraFormat(name, file)) return *format;
  throw Error(
      ErrorKind::kInput,
      fmt::format("--format: unknown '{}'{}", name, SuggestName(name, NamesOf(CameraFormats()))));
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
  const CameraFormat& format = FindFormat(command.format, command.out);
  const CalibrationFile calibration = ReadCalibration(command.calibration, CameraModels());
  const std::vector<CalibratedCamera> cameras = ChosenCameras(calibration, command.cameras);
  if (cameras.size() > format.most_cameras) {
    throw Error(ErrorKind::kInput,
                fmt::format("format {} holds {} camera{}, but {} has {} ({}); choose "
                            "with --camera",
                            format.name,
                            format.most_cameras,
                            format.most_cameras == 1 ? "" : "s",
                            command.calibration.string(),
                            cameras.size(),
                            fmt::join(NamesOf(cameras), ", ")));
  }
  if (cameras.size() > 1 && !format.holds_extrinsics) {
    console.Message(fmt::format(
        "format {} has no place for the cameras' poses in the rig; they are not in the file",
        format.name));
  }
  const bool many = cameras.size() > 1 && format.write_files != nullptr;
  const std::vector<std::string> texts =
      many ? format.write_files(cameras) : std::vector{format.write(cameras)};
  std::vector<std::filesystem::path> written;
  const std::filesystem::path parent = command.out.parent_path();
  OutputFolder output(parent.empty() ? "." : parent);
  const auto write = [&](const std::string& name, const std::string& content) {
    output.Write(name, content);
    written.push_back(parent / name);
  };
  for (size_t c = 0; c < texts.size(); ++c) {
    write(many ? fmt::format("{}_{}{}",
                             command.out.stem().string(),
                             cameras[c].name,
                             command.out.extension().string())
               : command.out.filename().string(),
          texts[c]);
  }
  if (format.holds_vignetting && !cameras[0].vignetting.empty()) {
    write("vignette.png",
          VignettePngByModule(calibration.path.parent_path() / cameras[0].vignetting));
  }
  output.Commit();
  for (const auto& path : written) fmt::print("written to {}\n", path.string());
}

}  // namespace plenocal
