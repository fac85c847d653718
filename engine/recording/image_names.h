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

/// The shortest list of globs, folders or files for one camera's images: files of one folder whose
/// names differ in one part become a glob if it matches nothing else.
std::vector<std::string> AsGlobs(const std::vector<std::string>& inputs, const std::string& what);

/// If the cameras have one frame in common or none, replaces the files of each by a glob whose "*"
/// stands for the frame, if they have more then: left01.jpg and right01.jpg are frame 01, whatever
/// few other files are there. Throws `Error` if they have none.
void ShareFrames(const std::vector<std::string>& names,
                 std::vector<std::vector<std::string>>* images);

/// The value of a camera's `images` in a session file in `folder`: one pattern, or a list of them
/// with the indentation of that file.
std::string PathsYaml(const std::vector<std::string>& patterns,
                      const std::filesystem::path& folder);

}  // namespace plenocal
