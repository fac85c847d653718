// SPDX-License-Identifier: Apache-2.0
//
// The engine for programs that calibrate or use calibrated cameras: no header of Ceres, Eigen,
// OpenCV or yaml-cpp, and a stable interface (CHANGELOG.md, "API and ABI"). Functions throw
// `plenocal::Error` with file, line, key and remedy, and `plenocal::Stopped`.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "calib/base/error.h"
#include "calib/base/run.h"

namespace plenocal::api {

/// Tables for cv::remap: for each pixel of a new image, row by row, its position in the camera's
/// image, px; -1 both where the camera images nothing.
struct RemapTables {
  std::vector<float> x, y;
};

struct Parameter {
  std::string name, unit;
  double value = 0;
  double sigma = 0;  ///< standard error; 0: fixed, infinite: not determined
};

/// An ordinary camera of a calibration. Copies share their data; all functions may be called
/// from several threads. (0, 0) is the centre of the top-left pixel; x points right, y down, z
/// along the view.
class Camera {
 public:
  struct Data;
  explicit Camera(std::shared_ptr<const Data> data);
  /// The ordinary cameras of a file, the rig's master first; plenoptic ones are left out. Throws
  /// std::runtime_error with file, line and key.
  static std::vector<Camera> Read(const std::string& calibration_yaml);

  [[nodiscard]] std::string name() const;
  [[nodiscard]] std::string model() const;
  [[nodiscard]] std::array<int, 2> image_size() const;  ///< width, height, px
  [[nodiscard]] std::vector<Parameter> parameters() const;
  /// 4 x 4, row by row: p_camera = T_camera_rig p_rig, m.
  [[nodiscard]] std::array<double, 16> T_camera_rig() const;

  /// Image point, px, of a point in the camera's frame, m; nothing where it is not imaged.
  [[nodiscard]] std::optional<std::array<double, 2>> Project(
      const std::array<double, 3>& p_camera) const;
  /// Covariance (2 x 2, row by row, px^2) of the image point from that of the parameters; infinite
  /// where one that is not determined has an effect.
  [[nodiscard]] std::optional<std::array<double, 4>> Covariance(
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
  std::shared_ptr<const Data> data_;
};

/// Pixels row by row, which must stay until the calibration ends.
struct Image {
  std::string frame;         ///< images of one frame were taken at once
  const void* data = nullptr;
  int width = 0, height = 0;
  std::size_t stride = 0;    ///< bytes from one row to the next
  int channels = 1;          ///< 1: gray; 3: blue, green, red
  int bytes_per_value = 1;   ///< 1 or 2
};

/// A marker of the target measured in an image.
struct Point {
  int marker = 0;
  double x = 0, y = 0;  ///< px
  double sigma = 1;     ///< of each coordinate, px; with one value for all its size does not matter
};

struct FramePoints {
  std::string frame;
  std::vector<Point> points;
};

/// One camera of a rig: images or points.
struct Source {
  std::string name;
  std::string model;  ///< as `plenocal models` lists them; empty: chosen by held-out frames
  std::vector<Image> images = {};
  std::vector<FramePoints> points = {};
  int width = 0, height = 0;  ///< of points: the images' size, px
};

/// What is to be calibrated.
class Session {
 public:
  struct Data;

  /// A session.yaml (docs/formats.md).
  static Session Open(const std::string& path);
  /// Images or points in memory, the first camera being the rig's master. `target`: in one word
  /// ("chessboard:9x6:25mm"), or the text of a target.yaml.
  static Session InMemory(const std::string& target, const std::vector<Source>& cameras);

  [[nodiscard]] const Data& data() const { return *data_; }

 private:
  explicit Session(std::shared_ptr<const Data> data) : data_(std::move(data)) {}
  std::shared_ptr<const Data> data_;
};

struct Options {
  std::string out = {};    ///< folder for the result files; empty: none are written
  bool jackknife = false;  ///< standard errors from leaving out frames beside the others
};

enum class Grade { kGood, kUsable, kBad };

struct Finding {
  std::string code;    ///< stable: "noise_excess"; docs/diagnosis.md lists all
  std::string what;    ///< one sentence or more
  std::string remedy;  ///< what to do; empty when nothing
};

struct Calibration {
  std::vector<Camera> cameras;  ///< the ordinary ones, the rig's master first
  Grade grade = Grade::kGood;   ///< that of the worst finding
  std::vector<Finding> findings;
  std::string yaml;     ///< content of calibration.yaml
  std::string summary;  ///< as `plenocal calibrate` prints it

  /// Throws `Error` of kind kInput for a camera that there is not.
  const Camera& operator[](const std::string& name) const;
};

/// Detects, calibrates and judges. Calibrations of several threads go on side by side.
Calibration CalibrateSession(const Session& session,
                             const Options& options = {},
                             const Run& run = {});

}  // namespace plenocal::api
