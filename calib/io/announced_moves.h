// SPDX-License-Identifier: Apache-2.0
//
// Detects result folders whose new files are complete but not all moved into place yet, as a killed
// run leaves them (output_folder.h).
#pragma once

#include <filesystem>
#include <vector>

namespace plenocal {

/// Subfolder of a result folder that holds the new files until they are moved.
inline constexpr const char* kPartial = ".partial";
/// File in that subfolder, which exists when the new files are complete and are to be moved one
/// folder up. It lists the old files to be removed there.
inline constexpr const char* kComplete = "complete";

/// Number of checks, and microseconds between them, while another run finishes its moves.
inline constexpr int kTries = 20, kPause = 50000;

/// True if a run left complete files in `folder` that are not moved yet. Throws `Error` of kind
/// kJob if they belong to another user, who could otherwise have files in a shared folder replaced.
bool IsAnnounced(const std::filesystem::path& folder);

/// Folders with unfinished moves: among `path`, if it is a folder, and the three folders above it
/// (OUT/images/left/01.png).
std::vector<std::filesystem::path> AnnouncedAround(const std::filesystem::path& path);

/// Throws `Error` of kind kJob if results around the file `path` are still half moved after a
/// second, so that no reader mixes old and new files. Changes nothing on the disk.
void RefuseHalfMoved(const std::filesystem::path& path);

}  // namespace plenocal
