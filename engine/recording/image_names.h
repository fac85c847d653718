// SPDX-License-Identifier: Apache-2.0
//
// Names of image files: globs, and frames in common of several cameras.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "calib/files/frame_images.h"

namespace plenocal {

/// The glob that matches all of `files`, which differ in one part of their names in one folder, and
/// no other file unless it is `allowed`; empty if there is none.
std::string GlobOf(const std::vector<FrameImage>& files,
                   const std::function<bool(const std::filesystem::path&)>& allowed);

/// True when each camera shares frames with the first.
bool FramesAreShared(const std::vector<std::string>& names,
                     const std::vector<std::vector<std::string>>& images);

/// The shortest list of globs, folders or files for one camera's images: files of one folder whose
/// names differ in one part become a glob if it matches nothing else.
std::vector<std::string> AsGlobs(const std::vector<std::string>& inputs, const std::string& what);

/// If the cameras have no frame in common, replaces the files of each by a glob whose "*" stands
/// for the frame: left01.jpg and right01.jpg are frame 01. Throws `Error` if they still have none.
void ShareFrames(const std::vector<std::string>& names,
                 std::vector<std::vector<std::string>>* images);

/// The value of a camera's `images` in a session file in `folder`: one pattern, or a list of them
/// with the indentation of that file.
std::string PathsYaml(const std::vector<std::string>& patterns,
                      const std::filesystem::path& folder);

}  // namespace plenocal
