// SPDX-License-Identifier: Apache-2.0
//
// Camera files of other tools (docs/exchange.md).
#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "calib/calibration_file.h"
#include "calib/yaml.h"

namespace plenocal {

/// The files that are read and what they do not say themselves.
struct CameraSource {
  std::filesystem::path path;
  std::optional<ImageSize> image_size;  ///< for files that hold none
  bool fisheye = false;                 ///< the user says so, of files that do not tell
};

/// One tool's file form.
struct CameraFormat {
  std::string_view name;
  std::string_view file;  ///< how the tool's own files are called
  size_t most_cameras;    ///< at once
  bool holds_extrinsics;  ///< where the cameras are
  std::string (*write)(const std::vector<CalibratedCamera>& cameras);
  /// Throws `Error` of kind kInput with file and place.
  std::vector<CalibratedCamera> (*read)(const CameraSource& source);
  /// For formats with one file a camera of a stereo pair or rig: all of them, in the cameras'
  /// order. Null: all cameras are in one file.
  std::vector<std::string> (*write_files)(const std::vector<CalibratedCamera>& cameras) = nullptr;
  /// An image beside the file holds the attenuation.
  bool holds_vignetting = false;
};

std::span<const CameraFormat> CameraFormats();

/// The format of that name for such a file (MATLAB has two), or null.
const CameraFormat* FindCameraFormat(std::string_view name, const std::filesystem::path& file);

/// How a tool's camera holds a camera model: its name there and the model's parameters, f_x f_y c_x
/// c_y aside, in the tool's order. "0" is a coefficient that the model lacks. A camera model that
/// several tools know is one line in each.
struct LensForm {
  std::string_view model;
  std::string_view name;
  std::vector<std::string_view> coefficients;
};

/// What a tool's file says of one camera.
struct Lens {
  std::string name;
  double f_x, f_y, c_x, c_y;  ///< px, (0, 0) at the centre of the top-left pixel
  std::vector<double> coefficients;
};

/// The camera as the tool has it. Throws `Error` of kind kJob when no form holds the model, or a
/// parameter without a place there is not zero.
Lens ToLens(const CalibratedCamera& camera,
            std::span<const LensForm> forms,
            std::string_view format);

/// The camera of the first form that holds the lens; missing coefficients are zero. Throws `Error`
/// of kind kInput, `where` before the message, when there is none.
CalibratedCamera FromLens(const Lens& lens,
                          ImageSize image_size,
                          std::span<const LensForm> forms,
                          const std::string& where);

/// OpenCV's coefficients k1 k2 p1 p2 k3 ..., named "radtan", and its fisheye's, named "fisheye".
std::span<const LensForm> OpenCvLenses();

/// The shortest text that reads back as `value`, always with a point or an exponent: readers that
/// ask whether a number is real refuse "500".
std::string RealText(double value);
/// The same of several, ", " between.
std::string RealList(std::span<const double> values);

/// A matrix as cv::FileStorage has it in YAML; `type` is "d" or "f". `data`: row by row.
std::string OpenCvMatrix(
    const std::string& key, int rows, int cols, char type, std::span<const double> data);
/// How such a file begins.
inline constexpr const char* kOpenCvHead = "%YAML:1.0\n---\n";

/// R row by row.
std::array<double, 9> RowMajor(const Eigen::Matrix3d& R);

/// T_camera_rig of a camera of a rectified pair: `R` (row by row) turns the camera into the rig's
/// orientation, where it stands `shift` to the left of the first camera, m. Fails at `node` when R
/// is no rotation.
RigidTransform FromRectified(const std::vector<double>& R, double shift, const YamlNode& node);

/// The number that `forward` maps to `value` exactly, looked for about `guess`: undoing a scale or
/// an offset by the inverse operation loses the last digit. `guess` when there is none.
double Inverted(double value, double guess, const std::function<double(double)>& forward);

/// Makes the first camera the rig: all T_camera_rig relative to it.
void MakeFirstMaster(std::vector<CalibratedCamera>* cameras);

}  // namespace plenocal
