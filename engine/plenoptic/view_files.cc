// SPDX-License-Identifier: Apache-2.0
#include "engine/plenoptic/view_files.h"

#include <fmt/format.h>

#include <array>

#include "calib/base/format_error.h"
#include "calib/camera/rays.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"
#include "engine/session/calibration_folder.h"

namespace plenocal {
namespace {

const CalibratedCamera& PlenopticCameraOf(const CalibrationRecord& calibration,
                                          const std::string& name) {
  const CalibratedCamera* found = nullptr;
  for (const CalibratedCamera& camera : calibration.cameras) {
    if (!camera.model->plenoptic || (!name.empty() && camera.name != name)) continue;
    if (found != nullptr) {
      throw InputError("{}: has several plenoptic cameras; name one with --camera",
                       calibration.path.string());
    }
    found = &camera;
  }
  if (found != nullptr) return *found;
  throw InputError("{}: has no plenoptic camera{}",
                   calibration.path.string(),
                   name.empty() ? "" : fmt::format(" '{}'", name));
}

/// Virtual depth, by micro-image centres, of a point before the middle of the camera: images of a
/// point change with the centre by 1 - 1 / v.
double VirtualDepthAt(const CalibratedCamera& camera, double distance) {
  const double step = 10;  // px; the relation is linear but for distortion
  const double x = (camera.image_size[0] - 1) / 2.0, y = (camera.image_size[1] - 1) / 2.0;
  std::array<double, 2> seen{};
  for (const int side : {0, 1}) {
    const double values[kMaxObservationSize] = {0, 0, x + (side == 0 ? -step : step), y};
    std::array<double, 2> at{};
    if (!Project(camera, values, Eigen::Vector3d(0, 0, distance), at.data())) {
      throw InputError("--distance {}: camera '{}' images nothing there", distance, camera.name);
    }
    seen[static_cast<size_t>(side)] = at[0];
  }
  const double inverse = 1 - (seen[1] - seen[0]) / (2 * step);
  return 1 / inverse;
}

std::vector<RefocusPlane> PlanesOf(const ViewFilesRequest& request) {
  std::vector<RefocusPlane> planes;
  for (const double depth : request.depths) planes.push_back({depth});
  if (request.distances.empty()) return planes;
  if (request.calibration.empty()) {
    throw InputError(
        "--distance: needs the calibration of the camera; give it with --calibration, or "
        "virtual depths with --depth");
  }
  const CalibrationRecord calibration = OpenCalibration(request.calibration);
  const CalibratedCamera& camera = PlenopticCameraOf(calibration, request.camera_name);
  for (const double distance : request.distances) {
    planes.push_back({VirtualDepthAt(camera, distance), distance});
  }
  return planes;
}

}  // namespace

ViewsResult MakeViews(ViewFilesRequest request, const Run& run) {
  const RunScope inputs;
  request.camera = FindPlenopticSource(request.lenses);
  request.planes = PlanesOf(request);
  request.threads = run.threads;
  request.message = [&](const std::string& line) { run.Message(line); };
  const auto out = OpenOutput(request.out);
  ViewsResult result = MakeViews(request);
  if (!out) return result;
  for (const auto& [name, content] : result.files) out->Write(name, content);
  out->Commit();
  return result;
}

}  // namespace plenocal
