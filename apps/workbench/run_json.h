// SPDX-License-Identifier: Apache-2.0
//
// Results of a run for the page.
#pragma once

#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "calib/files/frame_images.h"
#include "calib/files/session.h"

namespace plenocal::workbench {

/// Number, grade, RMS and number of frames of a run; only the number of one that cannot be read.
nlohmann::json RunBriefJson(const std::filesystem::path& folder, int number);

/// Verdict, cameras with parameters and sigmas, frames with points and RMS, what was left out.
nlohmann::json RunJson(const std::filesystem::path& folder, int number);

/// The points of one image: marker, x, y, dx, dy, used.
nlohmann::json PointsJson(const std::filesystem::path& folder,
                          const std::string& camera,
                          const std::string& frame);

/// Per marker of a camera its used and rejected points, RMS and the frame with its largest
/// residual; means of the residuals over the image (`FieldJson`).
nlohmann::json ResidualsJson(const std::filesystem::path& folder, const std::string& camera);

/// Micro-image centres of a plenoptic camera from its file: x, y, lens type; their pitch, raw px.
nlohmann::json LensesJson(const std::filesystem::path& folder,
                          const std::string& camera,
                          const std::filesystem::path& micro_lenses);

/// By how many standard errors the result changes without each frame, and what changes most; `why`
/// there is nothing for this calibration.
nlohmann::json InfluenceJson(const std::filesystem::path& folder);

/// Images of a camera of the session.
using ImagesOf = std::function<std::vector<FrameImage>(const std::string& camera)>;

/// What the run would be without the points that the session leaves out by now: `PreviewExclusion`;
/// null where it leaves out none of them, and for a calibration without a target.
nlohmann::json PreviewJson(const std::filesystem::path& folder,
                           const Session& session,
                           const ImagesOf& images_of);

/// Markers (m, in the target's frame) and their displacements by the refinement, cameras with
/// T_rig_camera, frames with T_target_rig; transforms as twelve numbers, the rows of [R t].
nlohmann::json SpaceJson(const std::filesystem::path& folder);

/// Of each camera that both runs have: by how much the images of points at 1 m and far away differ,
/// as a field over the image like that of residuals, and RMS, its prediction (null: none), and
/// whether it is more than predicted. Cameras that cannot be compared are left out.
nlohmann::json DifferenceJson(const std::filesystem::path& a, const std::filesystem::path& b);

/// Sigma of the projection over a camera's image, at each distance.
nlohmann::json MapsJson(const std::filesystem::path& folder, const std::string& camera);

}  // namespace plenocal::workbench
