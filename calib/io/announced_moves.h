// SPDX-License-Identifier: Apache-2.0
//
// The mark of a folder of results whose files are being moved to their places (output_folder.h).
#pragma once

#include <filesystem>
#include <vector>

namespace plenocal {

/// The subfolder of a folder of results that has its new files until they are moved.
inline constexpr const char* kPartial = ".partial";
/// The file in it which announces that the files beside it are complete and belong one folder up;
/// it lists the files that go from there.
inline constexpr const char* kComplete = "complete";

/// Tries, and microseconds between them, until a run that was just killed, or is at work, has made
/// its moves.
inline constexpr int kTries = 20, kPause = 50000;

/// True where a run left complete files in `folder`. Those of another user are not moved, since who
/// can write into a shared folder could have others' files replaced: throws `Error` of kind kJob.
bool IsAnnounced(const std::filesystem::path& folder);

/// `path`, where it is a folder, and the three above it (OUT/images/left/01.png), as far as moves
/// are announced there.
std::vector<std::filesystem::path> AnnouncedAround(const std::filesystem::path& path);

/// Throws `Error` of kind kJob where results around the file `path` are still half moved after a
/// second, so that no reader takes old and new files together. Changes nothing on the disk.
void RefuseHalfMoved(const std::filesystem::path& path);

}  // namespace plenocal
