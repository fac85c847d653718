// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <set>

#include "apps/commands.h"
#include "apps/formats/camera_format.h"
#include "apps/formats/corners_vnl.h"
#include "apps/image_inputs.h"
#include "calib/error.h"
#include "calib/micro_lens_array.h"
#include "calib/output_folder.h"
#include "calib/raytrix_grid.h"
#include "calib/text_file.h"
#include "targets/target.h"

namespace plenocal {
namespace {

constexpr std::string_view kKalibrTarget = "kalibr-target";
constexpr std::string_view kMrcalCorners = "mrcal-corners";
constexpr std::string_view kRaytrix = "raytrix";

/// A name that is a key and part of file names.
std::string CleanName(std::string name) {
  for (char& c : name) {
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '_' && c != '-') c = '_';
  }
  return name.empty() ? "camera" : name;
}

std::vector<CalibratedCamera> ReadCameras(const ImportCommand& command,
                                          const CameraFormat& format,
                                          const std::optional<ImageSize>& size) {
  std::vector<CalibratedCamera> all;
  for (const std::filesystem::path& file : command.files) {
    std::vector<CalibratedCamera> cameras = format.read({file, size, command.fisheye});
    for (CalibratedCamera& camera : cameras) {
      if (camera.name.empty()) camera.name = file.stem().string();
      camera.name = CleanName(camera.name);
      all.push_back(camera);
    }
  }
  std::set<std::string> names;
  for (const CalibratedCamera& camera : all) {
    if (names.insert(camera.name).second) continue;
    throw Error(ErrorKind::kInput,
                fmt::format("two cameras are called '{}'; rename a file", camera.name));
  }
  MakeFirstMaster(&all);
  return all;
}

}  // namespace

void RunImport(const ImportCommand& command, const ConsoleOptions& options) {
  Console console(options.quiet);
  std::vector<std::string_view> names{kKalibrTarget, kMrcalCorners, kRaytrix};
  for (const CameraFormat& format : CameraFormats()) names.push_back(format.name);
  const auto found = std::find(names.begin(), names.end(), command.format);
  if (found == names.end()) {
    throw Error(
        ErrorKind::kInput,
        fmt::format(
            "--format: unknown '{}'{}", command.format, SuggestName(command.format, names)));
  }
  const std::optional<ImageSize> size = ParseImageSize(command.size);
  const auto one_file = [&]() -> const std::filesystem::path& {
    if (command.files.size() == 1) return command.files[0];
    throw Error(ErrorKind::kInput, fmt::format("format {} takes one file", command.format));
  };
  const std::filesystem::path& file = command.files[0];
  std::string name = "calibration.yaml", text;
  if (command.format == kKalibrTarget) {
    name = "target.yaml";
    text = ReadTarget(one_file()).nominal_yaml;
  } else if (command.format == kMrcalCorners) {
    one_file();
    name = fmt::format("detections_{}.csv", CleanName(file.stem().string()));
    text = DetectionsFromCornersVnl(file);
  } else if (command.format == kRaytrix) {
    one_file();
    if (!size) {
      throw Error(ErrorKind::kInput,
                  fmt::format("{}: holds no image size; give --size WIDTHxHEIGHT", file.string()));
    }
    name = fmt::format("micro_lenses_{}.csv", CleanName(file.stem().string()));
    text = FormatMicroLenses(ReadRayCalibData(file, *size));
    if (const std::string unused = UnusedRayCalibData(file); !unused.empty()) {
      console.Message(unused);
    }
  } else {
    const CameraFormat& format = *FindCameraFormat(command.format, file);
    if (!format.holds_extrinsics) one_file();
    text = CalibrationText(ReadCameras(command, format, size), {});
  }
  // A file's name is taken as such, anything else is a folder.
  const bool is_file = command.out.extension() == std::filesystem::path(name).extension();
  const std::filesystem::path folder = is_file ? command.out.parent_path() : command.out;
  if (is_file) name = command.out.filename().string();
  OutputFolder output(folder.empty() ? "." : folder);
  output.Write(name, text);
  output.Commit();
  fmt::print("written to {}\n", ((folder.empty() ? "." : folder) / name).string());
}

}  // namespace plenocal
