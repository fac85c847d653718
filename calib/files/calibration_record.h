// SPDX-License-Identifier: Apache-2.0
//
// The result of a calibration as plain data: the content of calibration.yaml and of the tables
// beside it (docs/formats.md). `calibrate` fills it (`Describe`), one writer and one reader
// (calibration_file.h, calibration_tables.h) put it into files and back, and the report takes it.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calib/camera/camera_model.h"
#include "calib/camera/image_circle.h"
#include "calib/camera/lens_type_optics.h"
#include "calib/camera/marker_freedom.h"
#include "calib/camera/observation.h"
#include "calib/camera/rigid_transform.h"
#include "calib/files/finding.h"

namespace plenocal {

/// The smallest residuals that any camera parameters can leave: the noise estimated from repeated
/// observations of the same marker in one view, by the affine law that they obey behind a thin
/// lens.
struct NoiseFloor {
  double length = 0;       ///< RMS of the residual vector's length, px
  double third_order = 0;  ///< likewise with the third order of a thick lens; 0: not known
  double coordinate = 0;   ///< RMS of one coordinate, px; not in files
  double redundancy = 0;   ///< its degrees of freedom; not in files
};

/// Reprojection error of one camera.
struct CameraFit {
  int points = 0;    ///< used observations
  int rejected = 0;  ///< observations left out as outliers or outside the model's domain
  int views = 0;     ///< views with used observations
  double rms = 0;    ///< of the residual vector's length over the used observations, px
  /// Standard deviation of one coordinate of a typical observation, estimated from the residuals,
  /// px.
  double noise_sigma = 0;
  /// The typical sigma that came with the observations, px; 0: none came. Noise above it is an
  /// error that the detector's sigma does not include (model, target, motion).
  double detector_sigma = 0;
  /// Standard deviation of each coordinate of the error that all observations of one marker in one
  /// view share, px; 0: none.
  double common_noise = 0;
  /// Over the observations of one lens type.
  struct LensType {
    int points = 0;  ///< not in files
    double rms = 0;
  };
  std::map<int, LensType> lens_types;  ///< empty for a camera with one type or without lenses
  /// Noise floor of the used observations and of all that project.
  std::optional<NoiseFloor> noise_floor, noise_floor_all;
  double rms_all = 0;  ///< as `rms`, over all observations that project
};

/// One observation and its reprojection error: a row of residuals.csv.
struct ResidualRow {
  int frame = 0;                                     ///< index into CalibrationRecord::frames
  int marker = 0;                                    ///< number of the marker
  std::array<double, kMaxObservationSize> values{};  ///< measured coordinates, then context
  /// Measured minus predicted, per measured coordinate, px; NaN outside the model's domain.
  std::array<double, kMaxObservationSize> residual{};
  double noise_sigma = 0;  ///< of each coordinate under the camera's noise model, px; 0: not known
  bool used = true;

  /// The residual in x and y.
  [[nodiscard]] Eigen::Vector2d Error() const { return {residual[0], residual[1]}; }
};

/// Pose of the rig in the target's frame as one camera sees it in one frame.
struct ViewPose {
  RigidTransform T_target_rig;
  bool misplaced = false;  ///< farther from the frame's pose than the rig's jitter explains
};

/// A number with its standard error.
struct EstimatedNumber {
  double value = 0, sigma = 0;
  bool operator==(const EstimatedNumber&) const = default;
};

/// One calibrated camera.
struct CalibratedCamera {
  std::string name;
  const CameraModel* model = nullptr;
  ImageSize image_size{};
  std::optional<ImageCircle> image_circle = {};  ///< not set: the lens lights the whole image
  std::vector<double> config;
  std::vector<double> params;
  /// Covariance of `params`; zero for fixed ones. The variance of a parameter that was not
  /// determined is infinite, its covariances are zero. Diagonal when the file has no `correlation`.
  Eigen::MatrixXd covariance;
  RigidTransform T_camera_rig;
  Vector6d sigma_xi = Vector6d::Zero();  ///< of T_camera_rig's se(3) vector
  /// By how much later than their times its images were taken, by the clock of the first
  /// camera, s; not set: not estimated.
  std::optional<EstimatedNumber> time_shift = {};
  /// Sizes of the displacements common to all images (`View::by_nuisance`), in standard deviations
  /// of their priors.
  std::vector<EstimatedNumber> nuisances = {};
  /// Names of files beside calibration.yaml: the micro lenses of a plenoptic camera, the errors of
  /// their centres, the attenuation, pictures of one frame; and that frame's name. Empty: there is
  /// none.
  std::string micro_lenses = {}, lattice = {}, vignetting = {};
  std::string sample = {}, sample_depth = {}, sample_frame = {};
  /// Optics by lens type of a plenoptic camera; empty where the blur does not determine them.
  std::vector<LensTypeOptics> lens_type_optics = {};
  std::vector<std::string> at_bound = {};  ///< parameters estimated at a bound of the session
  /// Standard errors by leaving out frames; empty when they were not asked for.
  std::vector<double> sigma_jackknife = {}, sigma_xi_jackknife = {};
  CameraFit fit = {};
  /// By index of the frame, for frames in which this camera has used observations; empty for a rig
  /// of one camera, where they are the frame's pose.
  std::map<int, ViewPose> view_poses = {};
  std::vector<ResidualRow> residuals = {};

  /// Standard error of a parameter; 0: fixed, infinite: not determined.
  [[nodiscard]] double Sigma(size_t param) const {
    const auto i = static_cast<Eigen::Index>(param);
    return std::sqrt(covariance(i, i));
  }
};

/// The distances of a camera whose model has the parameters f_L, b_L0, B, if any b_P, and a pixel
/// size; nothing for others.
std::optional<MicroLensGeometry> MicroLensGeometryOf(const CalibratedCamera& camera);

/// The keys of `CalibratedCamera`'s texts in calibration.yaml.
inline constexpr std::array<std::pair<const char*, std::string CalibratedCamera::*>, 6>
    kCameraTextKeys{{{"micro_lenses", &CalibratedCamera::micro_lenses},
                     {"lattice", &CalibratedCamera::lattice},
                     {"vignetting", &CalibratedCamera::vignetting},
                     {"sample", &CalibratedCamera::sample},
                     {"sample_depth", &CalibratedCamera::sample_depth},
                     {"sample_frame", &CalibratedCamera::sample_frame}}};

/// One instant.
struct FrameRecord {
  std::string name;
  RigidTransform T_target_rig;
};

/// One marker of the target, m.
struct MarkerRecord {
  Eigen::Vector3d position{0, 0, 0};
  std::optional<Eigen::Vector3d> nominal = std::nullopt;
  /// Standard errors; not set: the marker was not seen.
  std::optional<Eigen::Vector3d> sigma = std::nullopt;
};

/// One of several targets.
struct TargetRecord {
  std::string name;
  RigidTransform T_target_own;           ///< its frame to that of the first target of its body
  Vector6d sigma_xi = Vector6d::Zero();  ///< of the se(3) vector; zero: the first, known, or unseen
};

/// The end of the bundle adjustment.
struct AdjustmentRecord {
  bool converged = false;
  int iterations = 0;
  /// Observations with a weighted residual longer than this are outliers, in sigmas.
  double rejection_sigmas = 0;
  MarkerFreedom marker_freedom = {};
};

/// Motion between the images of one frame, for a rig that is not rigid or not synchronous.
struct JitterRecord {
  double translation_sigma = 0, rotation_sigma = 0;  ///< of each coordinate, m and rad
  int misplaced = 0;                                 ///< views farther off than these explain
};

/// A combination of unknowns that the data leave open.
struct OpenDirection {
  /// Unknowns with a share in it (largest is 1), largest first: "left.f_x".
  std::vector<std::pair<std::string, double>> parts;
  /// Standard error along it in units of Param::scale; infinite when nothing determines it.
  double sigma = 0;
};

/// Unknowns that the data determine badly or not at all.
struct WeakUnknowns {
  bool open = false;               ///< not determined at all; else badly
  std::vector<std::string> names;  ///< "left.f_x"
  std::string what;                ///< "their standard error is 3.2 times their value"
  std::string remedy;              ///< what to do, in sentences; ends in a full stop
};

/// Correlations of all unknowns of a calibration. Parameters are named "camera.name", sizes of
/// common displacements "camera.shared_1", ..., the components of a camera's se(3) vector
/// "camera.T_camera_rig.x", y, z, w_x, w_y, w_z, targets' sizes "target.scale".
struct Correlations {
  std::vector<std::string> names;
  Eigen::MatrixXd matrix;
};

/// Lines "key: value" that state from what and how a file was made.
using Provenance = std::vector<std::pair<std::string, std::string>>;

/// The result of a calibration. What a file does not have is empty.
struct CalibrationRecord {
  std::filesystem::path path;             ///< of calibration.yaml, for messages
  std::vector<CalibratedCamera> cameras;  ///< the first is the rig's master
  std::vector<FrameRecord> frames;
  std::map<int, MarkerRecord> markers;  ///< by number
  std::vector<TargetRecord> targets;    ///< of several; empty: one target
  /// Relative deviations of targets from their sizes, by name in `correlations`.
  std::vector<std::pair<std::string, EstimatedNumber>> target_scales = {};
  std::optional<AdjustmentRecord> adjustment;  ///< not set: the parameters were not estimated
  std::optional<JitterRecord> jitter;          ///< not set: a rigid, synchronous rig
  Correlations correlations;
  std::vector<OpenDirection> undetermined;
  std::vector<WeakUnknowns> weak;
  /// Results of the estimation and of the tests for causes; in files a part of `verdict`.
  std::vector<Finding> findings;
  std::optional<Verdict> verdict;     ///< not set: not judged yet
  std::vector<std::string> left_out;  ///< "image or observation: why"
  Provenance provenance;

  /// True for a calibration without a target, whose markers are scene points.
  [[nodiscard]] bool HasScene() const {
    return adjustment && adjustment->marker_freedom.IsLandmarks();
  }

  /// Pose of the target in a camera's frame.
  [[nodiscard]] RigidTransform CameraFromTarget(size_t camera, int frame) const;
};

/// Path of a file beside calibration.yaml. Throws `Error` of kind kInput for a calibration in
/// memory, which has none.
std::filesystem::path FileBeside(const CalibrationRecord& calibration, const std::string& name);

/// Covariance as `CalibratedCamera` holds it.
Eigen::MatrixXd CovarianceOf(const std::vector<double>& sigma, const Eigen::MatrixXd& correlation);

/// Covariance of the parameters and the se(3) vectors of some cameras of one record, camera by
/// camera, then of all their `nuisances`. Unknowns that `correlations` does not name have the
/// correlations of `CalibratedCamera::covariance` alone. Infinite as there.
Eigen::MatrixXd JointCovariance(const std::vector<const CalibratedCamera*>& cameras,
                                const Correlations& correlations);

/// The camera of that name. Throws `Error` with the known names when there is none. An empty name
/// stands for the only camera.
const CalibratedCamera& FindCamera(const CalibrationRecord& calibration, const std::string& name);

}  // namespace plenocal
