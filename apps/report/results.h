// SPDX-License-Identifier: Apache-2.0
//
// What a calibration left in its folder, read back.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "calib/calibration_file.h"

namespace plenocal {

/// Name and content of the files of one calibration.
using ResultFiles = std::map<std::string, std::string>;

/// One row of residuals.csv.
struct ResidualRow {
  int frame = 0;  ///< index into Results::frames
  int marker = 0;
  std::array<double, kMaxObservationSize> values{};  ///< measured, then context
  Eigen::Vector2d d{0, 0};  ///< measured minus predicted, px; NaN outside the model's domain
  double sigma = 0;         ///< of each coordinate, px; 0: the file does not say
  bool used = true;
};

struct CameraResult : CalibratedCamera {
  std::vector<double> xi;  ///< of T_camera_rig
  int points = 0, rejected = 0, views = 0;
  double rms = 0, noise = 0;                  ///< px
  std::optional<double> stated_sigma;         ///< the detector's, px
  std::optional<double> floor;                ///< px, see `residuals` in calibration.yaml
  std::map<std::string, double> rms_by_type;  ///< px, by lens type; may be empty
  std::vector<ResidualRow> residuals;
  /// Names of the files with pictures of one frame, and the frame's name; empty: there are none.
  std::string sample, sample_depth, sample_frame;

  /// Of a parameter; 0: held, infinite: not determined.
  [[nodiscard]] double Sigma(size_t param) const {
    const auto i = static_cast<Eigen::Index>(param);
    return std::sqrt(covariance(i, i));
  }
};

/// Unknowns that the data determine badly or not at all, as calibration.yaml names them.
struct WeakResult {
  std::vector<std::string> parameters;
  bool determined = false;
  std::string what, remedy;  ///< may be empty
};

struct Results {
  std::vector<CameraResult> cameras;
  std::vector<std::string> frames;
  std::vector<RigidTransform> T_target_rig;  ///< per frame
  /// T_target_rig as one camera saw it, [camera][frame], where that is not the frame's.
  std::vector<std::map<int, RigidTransform>> seen_poses;
  std::map<int, Eigen::Vector3d> markers, nominal_markers;  ///< m
  std::map<int, Eigen::Vector3d> marker_sigma;              ///< m; empty: held
  bool converged = false;
  double marker_tolerance = 0;  ///< m; 0: markers were held
  Correlations correlations;    ///< empty when the folder does not have them
  std::vector<WeakResult> weak;
  std::vector<std::string> warnings, left_out;
  std::vector<std::pair<std::string, std::string>> provenance;

  /// Of a target's point in a camera's frame.
  [[nodiscard]] RigidTransform CameraFromTarget(size_t camera, int frame) const;
};

/// Reads calibration.yaml, target.yaml, poses.csv, residuals.csv and, where they are,
/// view_poses.csv and correlations.csv. `folder` is for messages. Throws `Error` of kind kInput
/// with file, line and key.
Results ReadResults(const ResultFiles& files, const std::string& folder);

/// The content of a correlations.csv; `name` stands for it in messages.
Correlations ReadCorrelations(const std::string& text, const std::string& name);

}  // namespace plenocal
