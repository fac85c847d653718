// SPDX-License-Identifier: Apache-2.0
//
// Times of a session's images, from files of times and from names.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "calib/files/frame_images.h"

namespace plenocal {

/// Gives the images of a session's camera the times of a file (times.h), and puts them into their
/// order. `owner` is for messages: "camera left". Throws `Error` of kind kInput with the file for
/// images without a time and for times that belong to none.
void TakeTimes(const std::filesystem::path& times,
               const std::string& owner,
               std::vector<FrameImage>* images);

/// The same for image files that are called after their times in nanoseconds since 1970, as in data
/// sets for Kalibr: "1403636579763555584.png". Others stay as they are.
void TakeTimesOfNames(std::vector<FrameImage>* images);

/// Times, s, of the frames of these names. Throws likewise.
std::map<std::string, double> TimesOfFrames(const std::filesystem::path& times,
                                            const std::string& owner,
                                            const std::vector<std::string>& frames);

}  // namespace plenocal
