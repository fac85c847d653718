// SPDX-License-Identifier: Apache-2.0
//
// What `plenocal simulate` is told to make: docs/simulate.md describes the file.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "calib/camera_model.h"
#include "calib/rigid_transform.h"

namespace plenocal::simulate {

/// The micro-lens array of a plenoptic camera, as its white images show it.
struct MicroLensSpec {
  double pitch = 0;              ///< px, distance of micro-image centres
  double rotation = 0;           ///< rad, of the lattice's rows about the x axis
  Eigen::Vector2d offset{0, 0};  ///< px, of a centre from the principal point
  /// Virtual depth (FORMATS.md) at which each lens type is sharp: one value or three.
  std::vector<double> focus = {};
  double aperture = 0.7;  ///< diameter of a micro lens / pitch
  double fill = 0.92;     ///< diameter of the main lens' stop, as a micro image shows it / pitch
  double gain_sigma = 0;  ///< scatter of the micro lenses' transmission
  int dull = 0;           ///< number of micro lenses with 30 to 70 % of the others' transmission
};

/// From radiance to grey values.
struct SensorSpec {
  int bits = 8;              ///< 8 or, in 16-bit files, 10, 12, 14, 16
  double full_well = 10000;  ///< electrons at the largest grey value
  double read_noise = 8;     ///< electrons
  double exposure = 0.8;     ///< white paper where nothing is lost / the largest grey value
  double blur = 0.5;         ///< px, sigma of the point-spread function before the pixel's own area
  double vignetting = 0.2;   ///< ordinary cameras: part of the light that is lost in the corners
  std::string bayer = {};    ///< "RGGB" and the like; empty: monochrome
};

struct CameraSpec {
  std::string name;
  const CameraModel* model = nullptr;
  ImageSize image_size{};
  std::vector<double> config, params;
  RigidTransform T_camera_rig;
  SensorSpec sensor;
  std::optional<MicroLensSpec> micro_lenses;  ///< exactly of models that observe through them
  double detection_sigma = 0.1;  ///< px, noise of each coordinate with --points; may be 0

  [[nodiscard]] bool IsPlenoptic() const { return !model->context.empty(); }
};

/// How the rig moves before the target.
struct PoseSpec {
  // Bad on purpose; none of them: varied.
  bool one_distance = false, no_tilt = false;
  bool corner = false;  ///< markers are seen in the image's upper left quarter alone
  int frames = 0;
  double nearest = 0, farthest = 0;  ///< m, from the aiming camera to the target's middle
  double tilt = 0.7;                 ///< rad, largest
  double roll = 0.6;                 ///< rad, largest
  double partial = 0.2;              ///< share of frames with the target at an image's rim
  std::size_t aim = 0;               ///< camera that the target is put before
  /// Given poses (name, T_target_rig) in place of generated ones.
  std::vector<std::pair<std::string, RigidTransform>> given;
};

struct SimulationSpec {
  std::filesystem::path path;
  int seed = 1;
  std::filesystem::path target;
  std::optional<double> target_error;  ///< m, sigma of each marker coordinate; else the tolerance
  bool rigid_tags = true;              ///< tags keep their shape; else each corner errs by itself
  std::vector<CameraSpec> cameras;     ///< the first is the rig's master
  PoseSpec poses;
  int white_images = 5;  ///< a camera
};

/// Reads and checks a specification. Throws `Error` with file, line and key.
SimulationSpec ReadSimulationSpec(const std::filesystem::path& path,
                                  std::span<const CameraModel> models);

}  // namespace plenocal::simulate
