// SPDX-License-Identifier: Apache-2.0
//
// The files of a simulated recording and of its truth, but for images.
#pragma once

#include <string>
#include <vector>

#include "apps/simulate/scene/scene_points.h"
#include "calib/files/calibration_record.h"

namespace plenocal::simulate {

/// recording.yaml: cameras, times, calibration.
std::string RecordingYaml(const SimulationSpec& spec, bool points);
/// session.yaml of a calibration from the scene. `distances`: lines of the list of that name.
std::string SceneSessionYaml(const SimulationSpec& spec,
                             bool points,
                             const std::vector<std::string>& distances);
/// times.txt: a line "name time exposure_ms" for each used frame.
std::string TimesText(const RigPath& path);

/// The cameras with errors of the specified standard deviations, which the record states.
CalibrationRecord GivenRecord(const SimulationSpec& spec);

/// T_world_camera as lines "t x y z qx qy qz qw" (TUM): of the segments, or of the whole path.
enum class PathExtent { kSegments, kWhole };
std::string TrajectoryText(const RigPath& path, const CameraSpec& camera, PathExtent extent);

/// poses.csv: T_world_rig of the used frames.
std::string PathPosesCsv(const RigPath& path);
/// points.csv: world positions of the points that stand still, by marker number. A point with two
/// numbers stands there twice.
std::string PointsCsv(const std::vector<ScenePoint>& points);
/// moving.csv: marker numbers of the points on moving boxes, and their box.
std::string MovingCsv(const std::vector<ScenePoint>& points);
/// wrong_matches_<camera>.csv: the observations that are another point's.
std::string WrongMatchesCsv(const CameraTracks& tracks);

/// Distances between points that stand still and were seen often, with errors of the specified
/// standard deviation; as lines of a session's list. `observed`: by point.
std::vector<std::string> DrawDistances(const SimulationSpec& spec,
                                       const std::vector<ScenePoint>& points,
                                       const std::vector<int>& observed);

}  // namespace plenocal::simulate
