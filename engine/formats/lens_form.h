// SPDX-License-Identifier: Apache-2.0
//
// Camera models as other tools call them: one description for reading and for writing.
#pragma once

#include <array>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "calib/files/calibration_record.h"
#include "calib/io/yaml.h"

namespace plenocal {

/// Words between blanks; views of `text`.
std::vector<std::string_view> WordsOf(std::string_view text);

/// A camera model in a tool: its name there and the model's parameters, f_x f_y c_x c_y aside, in
/// the tool's order. "0" is a coefficient that the model lacks. A camera model that several tools
/// have is one line in each.
struct LensForm {
  LensForm(std::string_view of_model, std::string_view in_tool, std::string_view in_order)
      : model(of_model), name(in_tool), coefficients(WordsOf(in_order)) {}

  std::string_view model;
  std::string_view name;
  std::vector<std::string_view> coefficients;
};

/// The lenses of a tool and how its files hold them.
struct LensTable {
  std::string_view tool;  ///< for messages
  std::vector<LensForm> forms;
  double first_pixel = 0;  ///< coordinate of the centre of the top-left pixel, px
  /// Keys in files that name numbers: of f_x f_y c_x c_y, and of the coefficients of each lens.
  std::array<std::string_view, 4> keys{"fx", "fy", "cx", "cy"};
  std::map<std::string_view, std::string_view> coefficient_keys = {};
  bool may_lack_coefficients = false;  ///< in files that name numbers; then they are zero
  bool has_all_coefficients = false;   ///< in files: another number of them is a mistake
};

/// One camera of a tool's file.
struct Lens {
  std::string name;           ///< of the camera model, as the tool calls it
  double f_x, f_y, c_x, c_y;  ///< px, as the tool counts them
  std::vector<double> coefficients;

  /// f_x f_y c_x c_y and the coefficients.
  [[nodiscard]] std::vector<double> Numbers() const;
  /// Key and value of each number.
  [[nodiscard]] std::vector<std::pair<std::string, double>> Entries(const LensTable& table) const;
};

/// The inverse of `Numbers`, of at least four.
Lens LensOfNumbers(std::string name, const std::vector<double>& numbers);

/// The inverse of `Entries`; `prefix` stands before each key.
Lens ReadLensEntries(const YamlNode& node,
                     const std::string& name,
                     const LensTable& table,
                     const std::string& prefix = {});

/// The camera as the tool has it. Throws `Error` of kind kJob when no form holds the model, or a
/// parameter without a place there is not zero.
Lens ToLens(const CalibratedCamera& camera, const LensTable& table);

/// The camera by the first form that holds the lens; missing coefficients are zero, or a mistake
/// (`has_all_coefficients`). Throws `Error` of kind kInput, `where` before the message, when there
/// is none.
CalibratedCamera FromLens(const Lens& lens,
                          ImageSize image_size,
                          const LensTable& table,
                          const std::string& where);

/// A spherical camera of a tool that takes f_x f_y c_x c_y from the size of the image.
CalibratedCamera PanoramaCamera(ImageSize image_size, const std::array<double, 4>& params);
/// Throws `Error` of kind kJob when a spherical camera has other parameters than the tool takes.
void CheckPanorama(const CalibratedCamera& camera,
                   const std::array<double, 4>& params,
                   std::string_view tool);

/// Throws `Error` of kind kJob when the focal lengths differ, for tools that have one.
void RequireOneFocalLength(const CalibratedCamera& camera, const Lens& lens, std::string_view tool);

/// Lens coordinates, on which distortion acts, divided by `scale`; `first` becomes the first
/// coefficient, k_1 k_2 p_1 p_2 may follow.
Lens ScaledPlane(const Lens& lens, double scale, double first);

/// Kalibr's "omni" and OpenCV's omnidir: the unified model by xi > -1 in place of alpha
/// (models/ucm.h). Their lens coordinates are ours times 1 - alpha.
Lens FromOmni(const Lens& omni);
/// The lenses that it returns.
const std::array<LensForm, 2>& OmniForms();

/// OpenCV's coefficients k1 k2 p1 p2 k3 ..., named "radtan", and its fisheye's, named "fisheye".
const LensTable& OpenCvLenses();

}  // namespace plenocal
