// SPDX-License-Identifier: Apache-2.0
//
// Camera models as other tools call them, with the parameters in their order.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "calib/files/calibration_record.h"

namespace plenocal {

/// A camera model in a tool: its name there and the model's parameters, f_x f_y c_x c_y aside, in
/// the tool's order. "0" is a coefficient that the model lacks. A camera model that several tools
/// have is one line in each.
struct LensForm {
  std::string_view model;
  std::string_view name;
  std::vector<std::string_view> coefficients;
};

/// One camera of a tool's file.
struct Lens {
  std::string name;           ///< of the camera model, as the tool calls it
  double f_x, f_y, c_x, c_y;  ///< px, (0, 0) at the centre of the top-left pixel
  std::vector<double> coefficients;
};

/// The camera as the tool has it. Throws `Error` of kind kJob when no form holds the model, or a
/// parameter without a place there is not zero.
Lens ToLens(const CalibratedCamera& camera,
            std::span<const LensForm> forms,
            std::string_view format);

/// The camera by the first form that holds the lens; missing coefficients are zero. Throws `Error`
/// of kind kInput, `where` before the message, when there is none.
CalibratedCamera FromLens(const Lens& lens,
                          ImageSize image_size,
                          std::span<const LensForm> forms,
                          const std::string& where);

/// OpenCV's coefficients k1 k2 p1 p2 k3 ..., named "radtan", and its fisheye's, named "fisheye".
std::span<const LensForm> OpenCvLenses();

}  // namespace plenocal
