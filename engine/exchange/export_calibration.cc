// SPDX-License-Identifier: Apache-2.0
#include "engine/exchange/export_calibration.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <optional>

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/base/number_text.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"
#include "detectors/photometry/response_curve.h"
#include "engine/formats/camera_format.h"
#include "engine/resample/map_files.h"
#include "engine/session/calibration_folder.h"

namespace plenocal {
namespace {

const CameraFormat& FindFormat(const std::string& name, const std::filesystem::path& file) {
  if (const CameraFormat* format = FindCameraFormat(name, file)) return *format;
  throw InputError("--format: unknown '{}'{}", name, SuggestName(name, NamesOf(CameraFormats())));
}

std::vector<CalibratedCamera> ChosenCameras(const CalibrationRecord& calibration,
                                            const std::vector<std::string>& names) {
  if (names.empty()) return calibration.cameras;
  std::vector<CalibratedCamera> chosen;
  chosen.reserve(names.size());
  for (const std::string& name : names) chosen.push_back(FindCamera(calibration, name));
  return chosen;
}

void RefuseTooMany(const std::vector<CalibratedCamera>& cameras,
                   const CameraFormat& format,
                   const std::filesystem::path& calibration) {
  if (cameras.size() <= format.most_cameras) return;
  throw InputError("format {} holds {}, but {} has {} ({}); choose with --camera",
                   format.name,
                   Counted(format.most_cameras, "camera"),
                   calibration.string(),
                   cameras.size(),
                   fmt::join(NamesOf(cameras), ", "));
}

/// Indices of the chosen cameras.
std::vector<size_t> IndicesOf(const std::vector<CalibratedCamera>& chosen,
                              const CalibrationRecord& calibration) {
  std::vector<size_t> indices;
  for (const CalibratedCamera& camera : chosen) {
    const auto found = std::ranges::find(calibration.cameras, camera.name, &CalibratedCamera::name);
    indices.push_back(static_cast<size_t>(found - calibration.cameras.begin()));
  }
  return indices;
}

/// The contents of the files to write: one, or one a camera.
std::vector<std::string> MakeTexts(const CalibrationRecord& calibration,
                                   const std::vector<CalibratedCamera>& cameras,
                                   const CameraFormat& format) {
  if (format.write_views != nullptr && !calibration.frames.empty()) {
    std::vector<std::string> texts;
    for (const size_t camera : IndicesOf(cameras, calibration)) {
      texts.push_back(format.write_views(calibration, camera));
    }
    return texts;
  }
  if (cameras.size() > 1 && format.write_files != nullptr) return format.write_files(cameras);
  if (!format.has_file_per_camera) return {format.write(cameras)};
  std::vector<std::string> texts;
  for (const CalibratedCamera& camera : cameras) texts.push_back(format.write({camera}));
  return texts;
}

/// The files to write, by name: one, or of formats with one file a camera FILE_<camera>.
std::vector<std::pair<std::string, std::string>> MakeFiles(
    const CalibrationRecord& calibration,
    const std::vector<CalibratedCamera>& cameras,
    const CameraFormat& format,
    const std::filesystem::path& file) {
  const std::vector<std::string> texts = MakeTexts(calibration, cameras, format);
  if (texts.size() == 1) return {{file.filename().string(), texts[0]}};
  std::vector<std::pair<std::string, std::string>> files;
  for (size_t c = 0; c < texts.size(); ++c) {
    files.emplace_back(
        fmt::format("{}_{}{}", file.stem().string(), cameras[c].name, file.extension().string()),
        texts[c]);
  }
  return files;
}

/// True if a folder is to hold the poses and the points as well.
bool IsModel(const ExportRequest& request, const CameraFormat& format) {
  return format.write_model != nullptr && !request.out.has_extension();
}

/// The calibration; for a format that holds the poses of images, with those beside it.
CalibrationRecord ReadForFormat(const ExportRequest& request, const CameraFormat& format) {
  const std::filesystem::path& file = request.calibration;
  const std::filesystem::path folder = file.parent_path();
  const bool has_poses =
      file.filename() == "calibration.yaml" && std::filesystem::exists(folder / "poses.csv");
  if (has_poses && (format.write_views != nullptr || IsModel(request, format))) {
    return OpenCalibrationFolder(folder.empty() ? "." : folder);
  }
  return OpenCalibration(file);
}

}  // namespace

std::vector<std::filesystem::path> ExportCalibration(const ExportRequest& request, const Run& run) {
  const RunScope inputs;
  const CameraFormat& format = FindFormat(request.format, request.out);
  return ExportCalibration(ReadForFormat(request, format), request, run);
}

std::vector<std::filesystem::path> ExportCalibration(const CalibrationRecord& calibration,
                                                     const ExportRequest& request,
                                                     const Run& run) {
  const RunScope inputs;
  UseAsInput(calibration.path);
  const CameraFormat& format = FindFormat(request.format, request.out);
  std::optional<ResponseCurve> response;
  if (!request.response.empty()) {
    if (!format.holds_vignetting) {
      throw InputError("--response: format {} has no place for a response; dso has", format.name);
    }
    response = ReadResponse(request.response);
  }
  const bool is_model = IsModel(request, format);
  if (is_model && calibration.frames.empty()) {
    throw InputError(
        "{}: has no poses.csv of 'plenocal calibrate' beside it, which a folder "
        "of {} needs; for the cameras alone give -o {}",
        calibration.path.string(),
        format.name,
        format.file);
  }
  const std::vector<CalibratedCamera> cameras = ChosenCameras(calibration, request.cameras);
  RefuseTooMany(cameras, format, calibration.path);
  if (cameras.size() > 1 && !format.holds_extrinsics && format.write_views == nullptr &&
      !is_model) {
    run.Message(fmt::format(
        "format {} has no place for the cameras' poses in the rig; they are not in the file",
        format.name));
  }
  auto files = is_model ? format.write_model(calibration, IndicesOf(cameras, calibration))
                        : MakeFiles(calibration, cameras, format, request.out);
  if (format.holds_vignetting && !cameras[0].vignetting.empty()) {
    files.emplace_back("vignette.png", VignettePng(FileBeside(calibration, cameras[0].vignetting)));
  }
  if (response) files.emplace_back("pcalib.txt", PcalibText(*response));
  return is_model ? WriteInto(request.out, files) : WriteOutputs(request.out, files);
}

}  // namespace plenocal
