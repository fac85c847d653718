// SPDX-License-Identifier: Apache-2.0
//
// Files of times and exposures of images.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace plenocal {

/// Unit of the exposure times in a file.
enum class ExposureUnit { kSeconds, kMilliseconds, kMicroseconds };

/// Time of one image.
struct ImageTime {
  std::string id;   ///< name of the image or its file; empty in a file of times alone
  double time = 0;  ///< s
  std::optional<double> exposure;  ///< ms
  int line = 0;                    ///< in the file
};

/// A file of times, in increasing order.
struct ImageTimes {
  std::filesystem::path path;
  bool has_ids = false;  ///< otherwise the times are in the order of the images
  std::vector<ImageTime> rows;
};

/// Reads the times of a camera's images in the form that the first row has:
/// - `id time exposure` between blanks, the exposure may be missing or 0: TUM monoVO;
/// - `time`, one a line, in the order of the images: KITTI;
/// - `time,file name` between commas: EuRoC, in nanoseconds.
/// Times are in seconds, those above 1e11 in nanoseconds. Throws `Error` of kind kInput with file
/// and line: no times, what is no number, times that do not increase, negative exposures.
ImageTimes ReadImageTimes(const std::filesystem::path& path, ExposureUnit unit);

/// Exposures, ms, by camera and image, of a table with the columns frame, camera and exposure_ms
/// (`plenocal recording --exposures`); rows without an exposure are left out. Throws `Error` of
/// kind kInput with file and line: columns that are missing, what is no positive number, an image
/// twice.
std::map<std::pair<std::string, std::string>, double> ReadExposureTable(
    const std::filesystem::path& path);

/// The first line after `skip` lines that is neither empty nor a comment, without blanks before it;
/// empty if there is none.
std::string_view FirstRow(std::string_view text, int skip);

}  // namespace plenocal
