// SPDX-License-Identifier: Apache-2.0
//
// The specification of `plenocal simulate`; docs/simulate.md describes the file.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "apps/simulate/spec/photometry_spec.h"
#include "apps/simulate/spec/request.h"
#include "apps/simulate/spec/scene_spec.h"
#include "calib/camera/bayer.h"
#include "calib/camera/camera_model.h"
#include "calib/camera/lens_lattice.h"
#include "calib/camera/rigid_transform.h"
#include "calib/files/calibration_record.h"

namespace plenocal::simulate {

/// The micro-lens array of a plenoptic camera, as it appears in white images.
struct MicroLensSpec {
  LatticeKind lattice = LatticeKind::kHexagonal;
  double pitch = 0;              ///< px, distance of micro-image centres in a row
  double row_pitch = 0;          ///< px, distance of the rows of a rectangular lattice
  double rotation = 0;           ///< rad, of the lattice's rows about the x axis
  Eigen::Vector2d offset{0, 0};  ///< px, of a centre from the principal point
  /// Centres are a lattice, and the shadow of the stop is round, in the raw image, as behind a real
  /// lens; else without distortion.
  bool regular_in_raw = false;
  /// Virtual depth (docs/plenoptic.md) at which each lens type is in focus, at most four.
  std::vector<double> focus = {};
  /// Lens types by (row, column) of the lattice, repeated in both directions.
  Eigen::MatrixXi pattern = Eigen::MatrixXi::Zero(1, 1);
  double aperture = 0.7;  ///< diameter of a micro lens / pitch
  double fill = 0.92;  ///< diameter of the main lens' stop, as it appears in a micro image / pitch
  double gain_sigma = 0;  ///< scatter of the micro lenses' transmission
  int dull = 0;           ///< number of micro lenses with 30 to 70 % of the others' transmission
};

/// The pattern of so many lens types, if there is a usual one: three interleaved in a hexagonal
/// lattice; in a rectangular one two as on a chessboard, or blocks of 2 x 2.
std::optional<Eigen::MatrixXi> UsualPattern(LatticeKind lattice, size_t types);

/// From radiance to grey values.
struct SensorSpec {
  int bits = 8;              ///< 8 or, in 16-bit files, 10, 12, 14, 16
  double full_well = 10000;  ///< electrons at the largest grey value
  double read_noise = 8;     ///< electrons
  double exposure = 0.8;     ///< white paper where nothing is lost / the largest grey value
  double blur = 0.5;         ///< px, sigma of the point-spread function before the pixel's own area
  VignettingSpec vignetting = {};         ///< of ordinary cameras
  std::optional<ToneSpec> response = {};  ///< empty: grey values proportional to the light
  std::optional<BayerOrder> bayer = {};   ///< empty: monochrome
};

struct CameraSpec {
  std::string name;
  const CameraModel* model = nullptr;
  ImageSize image_size{};
  std::vector<double> config, params;
  RigidTransform T_camera_rig;
  SensorSpec sensor;
  std::optional<MicroLensSpec> micro_lenses;  ///< for plenoptic models only
  double detection_sigma = 0.1;  ///< px, noise of each coordinate with --points; may be 0
  /// Of a rig that moves: its images are taken by this much later than those of the first camera,
  /// as its times state; and by this much later than these, s.
  double time_offset = 0, time_shift = 0;

  [[nodiscard]] bool IsPlenoptic() const { return model->plenoptic; }
};

struct TargetSpec {
  std::string name;  ///< empty: the only one
  std::filesystem::path file;
  RigidTransform T_target_own;  ///< to the frame of the first
};

/// The rig's poses before the target.
struct PoseSpec {
  // Deliberately bad sets; varied poses when none is set.
  bool one_distance = false, no_tilt = false;
  bool corner = false;  ///< markers are seen in the image's upper left quarter alone
  bool still = false;   ///< all frames from one pose
  bool moving = false;  ///< frames follow each other on one path; the images have times
  double rate = 20;     ///< 1/s, frames of a rig that moves
  int frames = 0;
  double nearest = 0, farthest = 0;  ///< m, from the aiming camera to the target's middle
  double tilt = 0.7;                 ///< rad, largest
  double roll = 0.6;                 ///< rad, largest
  double partial = 0.2;              ///< share of frames with the target at the rim of the image
  std::size_t aim = 0;               ///< index of the camera that the target is placed before
  /// Each camera in turn, at each target in turn; where possible a second camera sees one too.
  bool aim_all = false;
  /// Given poses (name, T_target_rig) in place of generated ones.
  std::vector<FrameRecord> given;
};

struct SimulationSpec {
  std::filesystem::path path;
  int seed = 1;
  std::vector<TargetSpec> targets;
  std::optional<double> target_error;  ///< m, sigma of each marker coordinate; else the tolerance
  bool rigid_tags = true;  ///< tags keep their shape; else each corner has an error of its own
  std::vector<CameraSpec> cameras;  ///< the first is the rig's master
  PoseSpec poses;
  std::optional<WallSpec> wall;           ///< that the target hangs on; empty: nothing is behind it
  std::optional<ExposureSpec> exposures;  ///< empty: equal, and there is no recording
  /// A scene in place of the target; target and poses are not set then.
  std::optional<ScenerySpec> scenery;
  int white_images = 5;  ///< per camera
};

/// The cameras as a perfect calibration gives them.
CalibrationRecord TrueRecord(const SimulationSpec& spec);

/// The provenance of a file of the simulation; `what` it holds, in words.
Provenance SimulationProvenance(const SimulateRequest& request,
                                const std::string& program,
                                std::string_view what = "the parameters are true, not estimated");

/// Keys of a camera in recording.yaml and session.yaml, as lines. `white`: it has white images.
std::string ImageKeys(const CameraSpec& camera, bool white);
std::string BayerKey(const CameraSpec& camera);  ///< none of a monochrome camera
std::string ConfigKeys(const CameraSpec& camera);
/// In session.yaml: its name, its model, and `detections`, a file, with the image size.
std::string ModelKeys(const CameraSpec& camera);
std::string DetectionKeys(const CameraSpec& camera, const std::string& file);

/// Reads and checks a specification. Throws `Error` with file, line and key.
SimulationSpec ReadSimulationSpec(const std::filesystem::path& path,
                                  std::span<const CameraModel> models);

}  // namespace plenocal::simulate
