// SPDX-License-Identifier: Apache-2.0
//
// Camera files of other tools (docs/exchange.md). Each format is one file of
// engine/formats/cameras: kalibr.cc defines `CameraFormat KalibrFormat()`. CMake finds the files
// and generates the table `CameraFormats()`, so a new format is a new file and edits no other.
#pragma once

#include <cstddef>
#include <filesystem>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "calib/files/calibration_record.h"

namespace plenocal {

/// A file to read, and what the user adds where the file does not hold it.
struct CameraSource {
  std::filesystem::path path;
  std::optional<ImageSize> image_size;
  bool fisheye = false;  ///< the distortion coefficients are those of cv::fisheye
};

inline constexpr size_t kAnyNumber = std::numeric_limits<size_t>::max();

/// One tool's file format.
struct CameraFormat {
  std::string_view name;  ///< of the tool, as `--format` takes it
  std::string_view file;  ///< name that the tool itself gives its files
  /// The name of the tool's other format, in whose place this one is taken for
  /// files with `extension`.
  std::string_view variant_of = {}, extension = {};
  size_t most_cameras = 1;        ///< in one file
  bool holds_extrinsics = false;  ///< the file holds the cameras' extrinsics in the rig
  /// Throws `Error` of kind kJob for what the format cannot hold.
  std::string (*write)(const std::vector<CalibratedCamera>& cameras) = nullptr;
  /// Throws `Error` of kind kInput with file and place.
  std::vector<CalibratedCamera> (*read)(const CameraSource& source) = nullptr;
  bool has_file_per_camera = false;  ///< `write` takes one camera at a time
  /// For formats whose files, one a camera, depend on each other: those of a pair, in the order of
  /// the cameras.
  std::vector<std::string> (*write_files)(const std::vector<CalibratedCamera>& cameras) = nullptr;
  /// For formats that hold the poses of images: the file of one camera of a calibration that has
  /// frames. Null: the format has no place for them.
  std::string (*write_views)(const CalibrationRecord& calibration, size_t camera) = nullptr;
  /// For formats that are a folder with the poses of images and the points in them: the names and
  /// contents of its files, for these cameras of a calibration that has frames. Null: no such
  /// folder.
  std::vector<std::pair<std::string, std::string>> (*write_model)(
      const CalibrationRecord& calibration, const std::vector<size_t>& cameras) = nullptr;
  bool holds_vignetting = false;  ///< an image beside the file holds the attenuation
};

/// All formats, in alphabetical order of their files.
std::span<const CameraFormat> CameraFormats();

/// The format of that name for such a file, or null.
const CameraFormat* FindCameraFormat(std::string_view name, const std::filesystem::path& file);

/// The cameras of a tool's file, as a calibration.yaml can hold them: rotations of few digits
/// become the nearest ones. Throws `Error` of kind kInput with the file for what is no camera of a
/// rig: a size, parameter or pose that none has.
std::vector<CalibratedCamera> ReadCameraFile(const CameraFormat& format,
                                             const CameraSource& source);

/// The formats for `--help`: "basalt, colmap, ..., matlab (FILE or FILE.mat), ...".
std::string CameraFormatList();

}  // namespace plenocal
