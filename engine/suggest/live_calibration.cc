// SPDX-License-Identifier: Apache-2.0
#include "engine/suggest/live_calibration.h"

#include <algorithm>
#include <utility>

#include "assess/views/view_information.h"
#include "calib/base/format_error.h"
#include "calib/estimate/calibrate.h"
#include "calib/estimate/describe.h"
#include "engine/suggest/view_target.h"

namespace plenocal {
namespace {

CameraInput InputOf(const CalibrationRecord& calibration, const CalibratedCamera& camera) {
  CameraInput input{.name = camera.name,
                    .model = camera.model,
                    .config = camera.config,
                    .initial = {},
                    .fixed = {},
                    .image_size = camera.image_size,
                    .image_circle = camera.image_circle,
                    .views = ViewsOf(calibration, camera)};
  for (size_t k = 0; k < camera.params.size(); ++k) {
    input.fixed.push_back(camera.Sigma(k) == 0);
    input.initial.push_back(input.fixed[k] ? std::optional(camera.params[k]) : std::nullopt);
  }
  return input;
}

CalibrationInput InputOf(const CalibrationRecord& calibration) {
  CalibrationInput input;
  CalibrationStart& start = input.start.emplace();
  for (const CalibratedCamera& camera : calibration.cameras) {
    input.cameras.push_back(InputOf(calibration, camera));
    start.params.push_back(camera.params);
    start.T_camera_rig.push_back(camera.T_camera_rig);
  }
  for (const FrameRecord& frame : calibration.frames) {
    start.T_rig_target[frame.name] = frame.T_target_rig.Inverse();
  }
  for (const auto& [number, marker] : calibration.markers) {
    // A print of another size is as large as it was found to be.
    const bool nominal = marker.nominal && calibration.target_scales.empty();
    input.markers[number] = nominal ? *marker.nominal : marker.position;
    start.markers[number] = marker.position;
  }
  if (calibration.adjustment) input.marker_freedom = calibration.adjustment->marker_freedom;
  return input;
}

}  // namespace

LiveCalibration::LiveCalibration(CalibrationRecord calibration,
                                 const Target& target,
                                 RigEstimate rig,
                                 const NextViewOptions& options)
    : record_(std::move(calibration)),
      options_(options),
      chooser_(MakeViewTarget(target), options),
      suggested_{std::move(rig), MakeViewTarget(target), record_.verdict},
      input_(InputOf(record_)) {
  suggested_.views = chooser_.Choose(suggested_.rig);
}

void LiveCalibration::Add(const std::string& frame, const std::vector<View>& views) {
  CalibrationInput input = input_;
  for (size_t c = 0; c < input.cameras.size(); ++c) {
    CameraInput& camera = input.cameras[c];
    if (camera.model->plenoptic) {
      throw InputError("{}: frames of plenoptic cameras are not added one by one", camera.name);
    }
    if (std::ranges::any_of(camera.views, [&](const View& v) { return v.frame == frame; })) {
      throw InputError("{}: there is a frame {} already", camera.name, frame);
    }
    if (views[c].observations.empty()) continue;
    View& view = camera.views.emplace_back(views[c]);
    view.frame = frame;
    // The files of a calibration have the noise that was found, not what the detector stated.
    for (Observation& each : view.observations) each.detector_sigma = suggested_.rig.sigma_px[c];
  }
  const Calibration calibration = Calibrate(input, {.threads = options_.threads, .progress = {}});
  CalibrationRecord record = Describe(calibration);
  RigEstimate rig = MakeRigEstimate(record);
  SetFactors(record, suggested_.shape, &rig);
  suggested_.views = chooser_.Choose(rig);
  suggested_.rig = std::move(rig);
  suggested_.verdict.reset();
  record.path = record_.path;
  record_ = std::move(record);
  input.start = StartFrom(calibration);
  input_ = std::move(input);
}

}  // namespace plenocal
