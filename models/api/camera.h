// SPDX-License-Identifier: Apache-2.0
//
// Calibrated cameras for programs that only use them: no header of Ceres, Eigen or OpenCV, and a
// stable interface (CHANGELOG.md, "API and ABI").
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace plenocal::api {

/// Tables for cv::remap: for each pixel of a new image, row by row, its position in the camera's
/// image, px; -1 both where the camera images nothing.
struct RemapTables {
  std::vector<float> x, y;
};

/// An ordinary camera of a calibration.yaml. Copies share their data; all functions may be called
/// from several threads. (0, 0) is the centre of the top-left pixel; x points right, y down, z
/// along the view.
class Camera {
 public:
  /// The ordinary cameras of a file, the rig's master first; plenoptic ones are left out. Throws
  /// std::runtime_error with file, line and key.
  static std::vector<Camera> Read(const std::string& calibration_yaml);

  [[nodiscard]] std::string name() const;
  [[nodiscard]] std::string model() const;
  [[nodiscard]] std::array<int, 2> image_size() const;  ///< width, height, px
  /// 4 x 4, row by row: p_camera = T_camera_rig p_rig, m.
  [[nodiscard]] std::array<double, 16> T_camera_rig() const;

  /// Image point, px, of a point in the camera's frame, m; nothing where it is not imaged.
  [[nodiscard]] std::optional<std::array<double, 2>> Project(
      const std::array<double, 3>& p_camera) const;
  /// Direction, of length 1, of the ray of an image point; nothing where there is none.
  [[nodiscard]] std::optional<std::array<double, 3>> Unproject(
      const std::array<double, 2>& pixel) const;
  /// The way from the image of a pinhole camera with focal length f and principal point (c_x, c_y),
  /// px, of this size, to this camera's: undistorts its images.
  [[nodiscard]] RemapTables Undistort(const std::array<int, 2>& size,
                                      double f,
                                      double c_x,
                                      double c_y) const;

 private:
  struct Data;
  explicit Camera(std::shared_ptr<const Data> data);
  std::shared_ptr<const Data> data_;
};

}  // namespace plenocal::api
