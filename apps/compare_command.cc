// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "apps/commands.h"
#include "calib/calibration_file.h"
#include "calib/compare.h"
#include "calib/error.h"
#include "models/registry.h"

namespace plenocal {
namespace {

constexpr std::array<std::string_view, 3> kRowNames{"top", "middle", "bottom"};
constexpr std::array<std::string_view, 3> kColumnNames{"left", "centre", "right"};

std::string DistanceText(double distance) {
  return std::isfinite(distance) ? fmt::format("{:g} m", distance) : "far away";
}

std::string PartText(size_t part) {
  return part == 4 ? "centre" : fmt::format("{} {}", kRowNames[part / 3], kColumnNames[part % 3]);
}

std::string Verdict(const CameraDifference& camera) {
  if (!camera.has_prediction) {
    return "no verdict: a file has no sigmas, or a parameter that is not determined";
  }
  if (camera.same) return "same within uncertainty";
  std::string places;
  for (const DistanceDifference& at : camera.distances) {
    std::string parts;
    for (size_t p = 0; p < at.parts.size(); ++p) {
      if (at.parts[p].differs) parts += (parts.empty() ? "" : ", ") + PartText(p);
    }
    if (!parts.empty()) {
      places +=
          fmt::format("{}{}: {}", places.empty() ? "" : "; ", DistanceText(at.distance), parts);
    }
  }
  return fmt::format("they differ by more than their sigmas explain at {}", places);
}

void PrintCamera(const CameraDifference& camera,
                 const CalibratedCamera& a,
                 const CalibratedCamera& b) {
  fmt::print("{}  ({} and {}, {} x {} px)\n",
             camera.name,
             a.model->name,
             b.model->name,
             a.image_size[0],
             a.image_size[1]);
  const Eigen::Vector3d turn = LogRotation(camera.T_b_a.R) * 180 / std::numbers::pi;
  const Eigen::Vector3d shift = 1e3 * camera.T_b_a.t;
  fmt::print(
      "  taken out: a turn by ({:.4f}, {:.4f}, {:.4f}) degrees and a shift by ({:.3f}, "
      "{:.3f}, {:.3f}) mm of the camera's frame\n",
      turn.x(),
      turn.y(),
      turn.z(),
      shift.x(),
      shift.y(),
      shift.z());
  fmt::print("  {:<10} {:<14} {:>10} {:>10} {:>12} {:>8}\n",
             "distance",
             "part",
             "RMS px",
             "max px",
             "sigmas' px",
             "pixels");
  for (const DistanceDifference& at : camera.distances) {
    const auto line = [&](const std::string& part, const ImageDifference& difference) {
      fmt::print("  {:<10} {:<14} {:>10.4f} {:>10.4f} {:>12} {:>8}{}\n",
                 DistanceText(at.distance),
                 part,
                 difference.rms,
                 difference.largest,
                 camera.has_prediction ? fmt::format("{:.4f}", difference.predicted) : "unknown",
                 difference.points,
                 difference.differs ? "  differs" : "");
    };
    line("all", at.all);
    for (size_t p = 0; p < at.parts.size(); ++p) line(PartText(p), at.parts[p]);
  }
  fmt::print("  {}\n", Verdict(camera));
}

// How the cameras' places on the rig differ once each camera's frame has moved as its intrinsics
// imply.
void PrintMount(const CameraDifference& master,
                const CameraDifference& camera,
                const CalibratedCamera& a,
                const CalibratedCamera& b) {
  const RigidTransform expected = camera.T_b_a * a.T_camera_rig * master.T_b_a.Inverse();
  const RigidTransform left = b.T_camera_rig * expected.Inverse();
  const Vector6d sigma = (a.sigma_xi.cwiseAbs2() + b.sigma_xi.cwiseAbs2()).cwiseSqrt();
  fmt::print(
      "  on the rig: turned by {:.4f} degrees (sigmas: {:.4f}), shifted by {:.3f} mm "
      "(sigmas: {:.3f})\n",
      LogRotation(left.R).norm() * 180 / std::numbers::pi,
      sigma.tail<3>().norm() * 180 / std::numbers::pi,
      1e3 * (b.T_camera_rig.t - expected.t).norm(),
      1e3 * sigma.head<3>().norm());
}

}  // namespace

void RunCompare(const CompareCommand& command) {
  const CalibrationFile a = ReadCalibration(command.a, CameraModels());
  const CalibrationFile b = ReadCalibration(command.b, CameraModels());
  std::vector<double> distances = command.distances;
  if (distances.empty()) distances = {1, std::numeric_limits<double>::infinity()};
  for (const double distance : distances) {
    if (!(distance > 0)) {
      throw Error(
          ErrorKind::kInput,
          fmt::format("--distance {}: expected a positive number of metres, or inf", distance));
    }
  }
  std::vector<CameraDifference> differences;
  bool same = true, judged = true;
  for (const CalibratedCamera& camera : a.cameras) {
    // Single cameras are compared whatever they are called.
    const std::string name = a.cameras.size() == 1 && b.cameras.size() == 1 ? "" : camera.name;
    const CalibratedCamera& other = FindCamera(b, name);
    differences.push_back(CompareCameras(camera, other, distances));
    const CameraDifference& difference = differences.back();
    PrintCamera(difference, camera, other);
    if (differences.size() > 1) PrintMount(differences.front(), difference, camera, other);
    fmt::print("\n");
    same = same && difference.same;
    judged = judged && difference.has_prediction;
  }
  fmt::print("{}\n",
             !judged ? "no verdict for all cameras"
                     : (same ? "same within uncertainty" : "not the same within uncertainty"));
}

}  // namespace plenocal
