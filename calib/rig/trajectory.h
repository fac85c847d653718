// SPDX-License-Identifier: Apache-2.0
//
// The path of a camera, and the reader of files of poses.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace plenocal {

/// The path of a camera: poses T_world_camera at strictly increasing times.
struct Trajectory {
  std::string path;           ///< the file, for messages
  std::vector<double> times;  ///< s; of a file without times the number of the pose, from 0
  bool has_times = true;      ///< false: KITTI poses without a file of times
  std::vector<Eigen::Vector3d> positions;        ///< m, or the estimate's own unit
  std::vector<Eigen::Quaterniond> orientations;  ///< unit length
  size_t repeated = 0;  ///< poses left out because their time is that of the pose before

  [[nodiscard]] size_t Size() const { return times.size(); }
};

/// Reads a trajectory in the form that its first line of numbers has:
/// - `t x y z qx qy qz qw` between blanks: TUM, ORB-SLAM (t in seconds; above 1e11 nanoseconds, as
///   ORB-SLAM3 writes for EuRoC);
/// - `t, x, y, z, qw, qx, qy, qz, ...` between commas: EuRoC, t in nanoseconds;
/// - 12 numbers, the upper rows of T_world_camera: KITTI. `kitti_times` is the file with their
///   times, s, one a line; empty: there are none.
/// Empty lines, lines that begin with '#' and a header of words are skipped.
///
/// Throws `Error` of kind kInput with file and line: no poses, numbers missing or not finite,
/// rotations that are none, times that go back.
Trajectory ReadTrajectory(const std::filesystem::path& path,
                          const std::filesystem::path& kitti_times);

}  // namespace plenocal
