// SPDX-License-Identifier: Apache-2.0
//
// Names of image files: globs, and the frames that cameras share.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "calib/files/frame_images.h"

namespace plenocal {

/// The glob that matches files of one folder whose names differ in one part, and else only files
/// that are `allowed`; empty when there is none.
std::string GlobOf(const std::vector<FrameImage>& files,
                   const std::function<bool(const std::filesystem::path&)>& allowed);

/// True when each camera shares frames with the first.
bool FramesAreShared(const std::vector<std::string>& names,
                     const std::vector<std::vector<std::string>>& images);

/// The shortest list of globs, folders or files that stands for one camera's images: files of one
/// folder whose names differ in one part become a glob, if nothing else matches it.
std::vector<std::string> AsGlobs(const std::vector<std::string>& inputs, const std::string& what);

/// Makes globs of the cameras' names that differ in the frame alone, where the cameras share no
/// frame otherwise: left01.jpg and right01.jpg are frame 01. Throws `Error` when they still share
/// none.
void ShareFrames(const std::vector<std::string>& names,
                 std::vector<std::vector<std::string>>* images);

/// The value of a camera's `images` in a session file in `folder`: one pattern, or a list of them
/// with the indentation that it has there.
std::string PathsYaml(const std::vector<std::string>& patterns,
                      const std::filesystem::path& folder);

}  // namespace plenocal
