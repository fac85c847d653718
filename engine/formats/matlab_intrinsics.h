// SPDX-License-Identifier: Apache-2.0
//
// The arguments of MATLAB's cameraIntrinsics, of a fisheye those of fisheyeIntrinsics.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "calib/files/calibration_record.h"

namespace plenocal {

/// One argument, a matrix.
struct MatlabArgument {
  std::string name;
  int rows = 1;
  std::vector<double> values;  ///< column by column
};

std::vector<MatlabArgument> ToMatlab(const CalibratedCamera& camera);

/// Of a file: the values of an argument, column by column, of which there are `least` to `most`.
/// Throws `Error` of kind kInput with the file.
using ReadMatlabArgument =
    std::function<std::vector<double>(const std::string& name, size_t least, size_t most)>;
CalibratedCamera FromMatlab(const ReadMatlabArgument& read,
                            bool is_fisheye,
                            const std::string& where);

/// The argument that fisheyeIntrinsics alone has.
inline constexpr const char* kMatlabFisheye = "MappingCoefficients";

}  // namespace plenocal
