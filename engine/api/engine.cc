// SPDX-License-Identifier: Apache-2.0
#include "engine/api/plenocal/engine.h"

#include <fmt/format.h>

#include <utility>

#include "assess/verdict.h"
#include "calib/estimate/summary.h"
#include "calib/files/calibration_file.h"
#include "engine/api/data.h"
#include "engine/calibrate_session.h"
#include "engine/session/memory_session.h"
#include "engine/session/open_session.h"

namespace plenocal::api {
namespace {

View ViewOf(const FramePoints& frame) {
  View view{.frame = frame.frame, .observations = {}};
  for (const Point& point : frame.points) {
    Observation& seen = view.observations.emplace_back();
    seen.marker = point.marker;
    seen.values[0] = point.x;
    seen.values[1] = point.y;
    seen.detector_sigma = point.sigma;
  }
  return view;
}

MemoryCamera CameraOf(const Source& source) {
  MemoryCamera camera{.name = source.name,
                      .model = source.model.empty()
                                   ? nullptr
                                   : ModelNamed(source.name + ": model", source.model),
                      .image_size = {source.width, source.height}};
  for (const Image& image : source.images) {
    camera.images.emplace_back(image.frame,
                               PixelView{.data = image.data,
                                         .size = {image.width, image.height},
                                         .stride = image.stride,
                                         .channels = image.channels,
                                         .bytes_per_value = image.bytes_per_value});
  }
  for (const FramePoints& frame : source.points) camera.views.push_back(ViewOf(frame));
  return camera;
}

}  // namespace

Session Session::Open(const std::string& path) {
  return Session(std::make_shared<const Data>(Data{OpenSession(path)}));
}

Session Session::InMemory(const std::string& target, const std::vector<Source>& cameras) {
  std::vector<MemoryCamera> all;
  for (const Source& source : cameras) all.push_back(CameraOf(source));
  return Session(std::make_shared<const Data>(Data{SessionInMemory(target, all)}));
}

const Camera& Calibration::operator[](const std::string& name) const {
  for (const Camera& camera : cameras) {
    if (camera.name() == name) return camera;
  }
  throw Error(ErrorKind::kInput, fmt::format("the calibration has no ordinary camera '{}'", name));
}

Calibration CalibrateSession(const Session& session, const Options& options, const Run& run) {
  CalibrateRequest request;
  request.out = options.out;
  request.jackknife = options.jackknife;
  request.session = session.data().session;
  SessionCalibration found = plenocal::CalibrateSession(request, run);
  found.folders->Commit();
  const Verdict& verdict = *found.record.verdict;
  Calibration calibration{.cameras = {},
                          .grade = static_cast<Grade>(verdict.grade),
                          .findings = {},
                          .yaml = CalibrationYaml(found.record),
                          .summary = Summary(found.calibration) + "\n" + VerdictText(verdict)};
  for (const plenocal::Finding& finding : verdict.findings) {
    calibration.findings.push_back({finding.code, finding.what, finding.remedy});
  }
  for (CalibratedCamera& camera : found.record.cameras) {
    if (!camera.model->central) continue;
    calibration.cameras.emplace_back(
        std::make_shared<const Camera::Data>(Camera::Data{std::move(camera)}));
  }
  return calibration;
}

}  // namespace plenocal::api
