// SPDX-License-Identifier: Apache-2.0
#include "engine/session/earlier_session.h"

#include <fmt/format.h>

#include <algorithm>
#include <deque>
#include <string>
#include <utility>

#include "calib/base/format_error.h"
#include "engine/formats/camera_format.h"
#include "engine/session/calibration_folder.h"
#include "engine/session/calibration_input.h"

namespace plenocal {
namespace {

const CameraFormat& FormatOf(const EarlierFile& file) {
  if (const CameraFormat* format = FindCameraFormat(file.format, file.path)) return *format;
  std::vector<std::string_view> names;
  for (const CameraFormat& format : CameraFormats()) names.push_back(format.name);
  throw InputError("{}: 'format' is '{}', which is none{}",
                   file.path.string(),
                   file.format,
                   SuggestName(file.format, names));
}

CalibrationRecord ReadEarlierRecord(const EarlierFile& file, ImageSize size) {
  if (!file.format.empty()) {
    CameraSource source{file.path, {}, false};
    if (size != ImageSize{}) source.image_size = size;
    CalibrationRecord record;
    record.path = file.path;
    record.cameras = ReadCameraFile(FormatOf(file), source);
    for (CalibratedCamera& camera : record.cameras) {
      const auto count = std::ssize(camera.params);
      camera.covariance = Eigen::MatrixXd::Zero(count, count);  // no standard errors
    }
    return record;
  }
  return OpenWithCorrelations(file.path);
}

// The files of a session, each once, with the cameras that take their values from it.
struct FileUse {
  EarlierFile file;
  std::vector<size_t> cameras = {};
  bool is_named = false;
};

std::vector<FileUse> FilesOf(const Session& session) {
  std::vector<FileUse> uses;
  for (size_t c = 0; c < session.cameras.size(); ++c) {
    const EarlierFile& own = session.cameras[c].from;
    const EarlierFile& file = own.path.empty() ? session.from : own;
    if (file.path.empty()) continue;
    const bool is_named = !own.path.empty();
    const auto same = std::ranges::find_if(uses, [&](const FileUse& use) {
      return use.file.path == file.path && use.is_named == is_named;
    });
    if (same != uses.end()) {
      same->cameras.push_back(c);
    } else {
      uses.push_back({.file = file, .cameras = {c}, .is_named = is_named});
    }
  }
  return uses;
}

std::vector<Finding> FindingsOfHeld(const Session& session, const EarlierCameras& cameras) {
  std::vector<Finding> findings;
  for (size_t c = 0; c < cameras.inputs.size(); ++c) {
    if (!session.extrinsics_only && !cameras.without_sigmas[c]) continue;
    const std::string& name = cameras.inputs[c].name;
    findings.push_back(
        {.code = "intrinsics_held",
         .grade = Grade::kGood,
         .cameras = {name},
         .what = fmt::format(
             "{}: the parameters stay as the earlier calibration has them{}; the "
             "standard errors leave out theirs.",
             name,
             session.extrinsics_only ? " (extrinsics_only)" : ", which states no standard errors"),
         .remedy = "Give a calibration of plenocal with its correlations.csv as 'from', without "
                   "'extrinsics_only', to have them in."});
  }
  return findings;
}

}  // namespace

EarlierCameras ReadEarlierCameras(const Session& session,
                                  std::vector<CameraInput> cameras,
                                  OpenParams open) {
  std::deque<CalibrationRecord> records;
  std::vector<EarlierSource> sources;
  for (FileUse& use : FilesOf(session)) {
    records.push_back(ReadEarlierRecord(use.file, cameras[use.cameras[0]].image_size));
    // Files of one camera do not always name it.
    std::vector<CalibratedCamera>& read = records.back().cameras;
    if (!use.file.format.empty() && read.size() == 1 && use.cameras.size() == 1) {
      read[0].name = cameras[use.cameras[0]].name;
    }
    sources.push_back({&records.back(), std::move(use.cameras), use.is_named});
  }
  std::vector<EarlierParams> keys;
  for (const SessionCamera& camera : session.cameras) keys.push_back(camera.earlier);
  return UseEarlierCalibrations(
      std::move(cameras),
      keys,
      sources,
      {.open = open,
       .intrinsics =
           session.extrinsics_only ? EarlierIntrinsics::kFixed : EarlierIntrinsics::kPrior});
}

BuiltOnEarlier MakeInputOnEarlier(const Session& session,
                                  const Target& target,
                                  std::vector<CameraInput> cameras,
                                  const Run& run) {
  EarlierCameras earlier = ReadEarlierCameras(session, std::move(cameras), OpenParams::kFree);
  BuiltOnEarlier built;
  built.held = FindingsOfHeld(session, earlier);
  built.input = MakeCalibrationInput(session, target, std::move(earlier.inputs), run);
  built.input.prior = std::move(earlier.prior);
  built.input.earlier_T_camera_rig = std::move(earlier.T_camera_rig);
  return built;
}

}  // namespace plenocal
