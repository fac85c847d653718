// SPDX-License-Identifier: Apache-2.0
//
// The images of one camera of a recording with their exposures, as photometric calibration needs
// them.
#pragma once

#include <string>
#include <vector>

#include "engine/recording/recording.h"

namespace plenocal {

/// The camera called `name`, or the only one if it is empty. Throws `Error` of kind kInput.
const RecordedCamera& ChooseRecordedCamera(const Recording& recording, const std::string& name);

/// An image as grey values of 8 bits. Throws `Error` of kind kInput for a depth of 16 bits: a
/// response holds 256 values.
cv::Mat ReadExposed(const RecordedCamera& camera, std::size_t index);

/// Exposures of all images, ms, in their order. Throws `Error` of kind kInput when there is none;
/// `purpose` ends the message.
std::vector<double> ExposuresOf(const Recording& recording,
                                const RecordedCamera& camera,
                                const std::string& purpose);

/// The table of exposures (exposures.csv) without its rows, and a row: exposure in ms, NaN: not
/// known; its relative deviation from the recorded one and the standard deviation of this.
inline constexpr const char* kExposuresHead = "frame,camera,exposure_ms,relative,sigma\n";
std::string ExposureRow(const std::string& frame,
                        const std::string& camera,
                        double exposure,
                        double relative,
                        double sigma);

/// Images of the camera that the reader of the recording left out.
std::vector<LeftOut> LeftOutOf(const Recording& recording, const RecordedCamera& camera);

}  // namespace plenocal
