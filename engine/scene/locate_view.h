// SPDX-License-Identifier: Apache-2.0
//
// Pose of one image of a calibrated camera in the frame of known points.
#pragma once

#include <filesystem>
#include <map>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/camera/observation.h"
#include "calib/files/calibration_record.h"
#include "engine/scene/alternative_pose.h"
#include "engine/scene/track/plenoptic_tracker.h"

namespace plenocal {

struct LocatedView {
  RigidTransform T_map_camera;
  /// Covariance of the se(3) vector of T_map_camera: the observations' noise and the calibration's
  /// covariance; the points count as exact.
  Matrix6d covariance = Matrix6d::Zero();
  size_t points = 0;  ///< observed points of the map
  size_t used = 0;    ///< those that agree with the pose
  double rms = 0;     ///< of the used residuals' length, px
  /// Among points that are numbered by appearance: another pose that many agree on.
  std::optional<AlternativePose> alternative;
};

/// How the observations got the numbers of their points.
enum class Numbering {
  kByMarker,      ///< read from markers: hardly ever wrong
  kByAppearance,  ///< by features that look alike: most may be wrong
};

/// Nothing when fewer than four points of the map are seen or they determine no pose. Points that
/// disagree (chi-square, one in 20 images) are left out.
std::optional<LocatedView> LocateView(const CalibratedCamera& camera,
                                      const View& view,
                                      const std::map<int, Eigen::Vector3d>& points,
                                      Numbering numbering);

/// Points of an earlier run with their descriptors.
struct LandmarkMap {
  std::map<int, Eigen::Vector3d> points;
  std::vector<int> numbers;  ///< of the rows of `descriptors`
  cv::Mat descriptors;       ///< one row a point; empty: not known
};

/// Reads points.csv (marker, x, y, z) and, where there is one beside it, descriptors.png. Throws
/// `Error` of kind kInput with file and line.
LandmarkMap ReadLandmarkMap(const std::filesystem::path& path);
/// The two files of a map.
std::string PointsCsv(const LandmarkMap& map);
std::string DescriptorsPng(const LandmarkMap& map);

/// Features of an 8-bit grey image that look like points of the map.
View MatchLandmarks(const cv::Mat& image, const LandmarkMap& map);
/// Features of the totally focused image of a raw plenoptic image that look like points of the map,
/// measured in the micro images. Throws `Error` for an image that cannot be reconstructed.
View MatchLandmarks(const cv::Mat& raw,
                    const CalibratedCamera& camera,
                    const PlenopticCamera& optics,
                    const LandmarkMap& map,
                    int threads);

}  // namespace plenocal
