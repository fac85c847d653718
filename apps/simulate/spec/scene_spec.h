// SPDX-License-Identifier: Apache-2.0
//
// The parts of a simulation's specification that belong to a scene without a target.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>

#include "calib/io/yaml.h"
#include "calib/rig/trajectory.h"

namespace plenocal::simulate {

/// A room with boxes; its points and how they are tracked.
struct SceneSpec {
  int points = 2000;
  double nearest = 2, farthest = 6;  ///< m, z of the points in a camera's frame
  std::optional<int> boxes = {};     ///< else as many as the path needs
  double moving = 0;                 ///< share of the points that lie on moving boxes
  double track_length = 0;           ///< frames, mean until a track is lost; 0: while it is seen
  double wrong_matches = 0;          ///< share of observations that are another point's
  double merged = 1;  ///< share of the points that keep their number in the end segment
  int distances = 0;  ///< measured distances between points
  double distance_sigma = 0.0005;  ///< m
};

/// The rig's path through the scene.
struct TrajectorySpec {
  enum class Shape { kLoop, kHandheld, kGiven };
  Shape shape = Shape::kLoop;
  // Faulty on purpose.
  bool straight = false;                 ///< start and end move along a line
  bool rotation = false;                 ///< the rig rotates at one position
  bool no_turning = false;               ///< the rig keeps its orientation
  bool one_depth = false;                ///< all points lie at one depth
  bool no_overlap = false;               ///< the end sees nothing of the start's scene
  bool repeated = false;                 ///< the scene repeats itself along the path
  double length = 100;                   ///< m, without winding
  double speed = 1;                      ///< m/s
  double rate = 30;                      ///< frames a second
  double segment = 15;                   ///< s, of the start and of the end
  double overlap = 1;                    ///< share of the start's path that the end covers again
  std::optional<double> amplitude = {};  ///< m, of the winding; of a hand-held path in all axes
  double seconds = 8;                    ///< period of the winding
  double shake = 1;                      ///< of the hand, about 1 degree and 8 mm for 1
  double turn = 0.35, roll = 0.8;        ///< rad, largest, of a hand-held path
  std::optional<int> frames = {};        ///< at most that many a segment; all of a hand-held path
  bool whole = false;                    ///< what lies between the segments is recorded as well
  Trajectory given = {};                 ///< T_world_rig
};

/// Standard deviations of the errors of the calibration that goes with the recording.
struct CalibrationSigma {
  double baseline = 20e-6;    ///< m, of each coordinate of a camera's translation in the rig
  double rotation = 0.05e-3;  ///< rad, likewise
  double focal = 0.15;        ///< px, of each parameter in pixels
  /// By camera and parameter; these take precedence.
  std::map<std::string, std::map<std::string, double>> parameters = {};
};

/// The keys that a specification with `scene` has in addition.
struct ScenerySpec {
  SceneSpec scene;
  TrajectorySpec trajectory;
  CalibrationSigma calibration_sigma;
};

/// Reads `scene`, `trajectory` and `calibration_sigma` of a specification at `path`. Throws
/// `Error` with file, line and key.
ScenerySpec ReadScenery(const YamlNode& root, const std::filesystem::path& path);

}  // namespace plenocal::simulate
