// SPDX-License-Identifier: Apache-2.0
//
// Interface of the engine for programs that calibrate or use calibrated cameras. It is stable
// (CHANGELOG.md, "API and ABI") and includes no header of Ceres, Eigen, OpenCV or yaml-cpp.
// Functions throw `plenocal::Error` with file, line, key and remedy, and `plenocal::Stopped` after
// a request to stop.
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
/// image, px; x = y = -1 where the camera has no image point.
struct RemapTables {
  std::vector<float> x, y;
};

struct Parameter {
  std::string name, unit;
  double value = 0;
  double sigma = 0;  ///< standard error; 0: fixed, infinite: not determined by the images
};

/// An ordinary camera of a calibration. Copies share their data; all functions may be called
/// from several threads. (0, 0) is the centre of the top-left pixel; x points right, y down, z
/// in the viewing direction.
class Camera {
 public:
  struct Data;
  explicit Camera(std::shared_ptr<const Data> data);
  /// Reads the ordinary cameras of a file, the rig's master first; plenoptic ones are left out.
  /// Throws std::runtime_error with file, line and key.
  static std::vector<Camera> Read(const std::string& calibration_yaml);

  [[nodiscard]] std::string name() const;
  [[nodiscard]] std::string model() const;
  [[nodiscard]] std::array<int, 2> image_size() const;  ///< width, height, px
  [[nodiscard]] std::vector<Parameter> parameters() const;
  /// 4 x 4, row by row: p_camera = T_camera_rig p_rig, m.
  [[nodiscard]] std::array<double, 16> T_camera_rig() const;

  /// Image point, px, of a point in the camera's frame, m; nothing if it has none.
  [[nodiscard]] std::optional<std::array<double, 2>> Project(
      const std::array<double, 3>& p_camera) const;
  /// Covariance (2 x 2, row by row, px^2) of the image point by that of the parameters; infinite
  /// where a parameter that is not determined has an effect.
  [[nodiscard]] std::optional<std::array<double, 4>> Covariance(
      const std::array<double, 3>& p_camera) const;
  /// Unit vector along the ray of an image point; nothing if there is no ray.
  [[nodiscard]] std::optional<std::array<double, 3>> Unproject(
      const std::array<double, 2>& pixel) const;
  /// Tables that undistort images of this camera: to those of a pinhole camera with image size
  /// `size`, focal length f and principal point (c_x, c_y), px.
  [[nodiscard]] RemapTables Undistort(const std::array<int, 2>& size,
                                      double f,
                                      double c_x,
                                      double c_y) const;

 private:
  std::shared_ptr<const Data> data_;
};

/// Image in memory, row by row. Its pixels must stay valid until the calibration ends.
struct Image {
  std::string frame;  ///< images of one frame were taken at once
  const void* data = nullptr;
  int width = 0, height = 0;
  std::size_t stride = 0;   ///< bytes from one row to the next
  int channels = 1;         ///< 1: gray; 3: blue, green, red
  int bytes_per_value = 1;  ///< 1 or 2
};

/// Measured image point of a marker of the target.
struct Point {
  int marker = 0;
  double x = 0, y = 0;  ///< px
  double sigma = 1;     ///< of each coordinate, px; no effect if equal for all points
};

struct FramePoints {
  std::string frame;
  std::vector<Point> points;
};

/// One camera of a rig: images or points.
struct Source {
  std::string name;
  std::string model = {};  ///< as `plenocal models` lists them; empty: chosen by cross-validation
  std::vector<Image> images = {};
  std::vector<FramePoints> points = {};
  int width = 0, height = 0;  ///< of points: the images' size, px
};

/// Input of a calibration: cameras with images or points, and a target.
class Session {
 public:
  struct Data;

  /// Reads a session.yaml (docs/formats.md).
  static Session Open(const std::string& path);
  /// Makes a session of images or points in memory; the first camera is the rig's master.
  /// `target`: in one word ("chessboard:9x6:25mm"), or the text of a target.yaml.
  static Session InMemory(const std::string& target, const std::vector<Source>& cameras);

  [[nodiscard]] const Data& data() const { return *data_; }

 private:
  explicit Session(std::shared_ptr<const Data> data) : data_(std::move(data)) {}
  std::shared_ptr<const Data> data_;
};

struct Options {
  std::string out = {};    ///< folder for the result files; empty: none are written
  bool jackknife = false;  ///< also estimate standard errors by leaving out frames
};

enum class Grade { kGood, kUsable, kBad };

struct Finding {
  std::string code;    ///< stable: "noise_excess"; docs/diagnosis.md lists all
  std::string what;    ///< one sentence or more
  std::string remedy;  ///< what to do; empty when nothing
};

struct Calibration {
  struct Data;

  /// Reads the folder of `plenocal calibrate`, or a calibration.yaml.
  static Calibration Read(const std::string& path);

  std::vector<Camera> cameras;  ///< the ordinary ones, the rig's master first
  Grade grade = Grade::kGood;   ///< that of the worst finding
  std::vector<Finding> findings;
  std::string yaml;     ///< content of calibration.yaml
  std::string summary;  ///< as `plenocal calibrate` prints it; empty if read from files
  std::shared_ptr<const Data> data;

  /// Throws `Error` of kind kInput for an unknown name.
  const Camera& operator[](const std::string& name) const;
};

/// Detects the target, calibrates and grades the result. May be called from several threads at
/// once.
Calibration CalibrateSession(const Session& session,
                             const Options& options = {},
                             const Run& run = {});

/// Detects the target in all images: a source of points for each camera, for use in another
/// session. Ordinary cameras only.
std::vector<Source> DetectSession(const Session& session, const Run& run = {});

/// A camera model and its error in held-out frames.
struct TriedModel {
  std::string model;
  bool recommended = false;
  double held_out_rms = 0;  ///< px; NaN: not known
  std::string judgement;    ///< comparison with the best model, or why there is no error
};

/// Tries these models, or all that fit, for the cameras of a session (`plenocal try`).
std::vector<TriedModel> TrySession(const Session& session,
                                   const std::vector<std::string>& models = {},
                                   const Run& run = {});

/// Result of a check for one camera.
struct CheckedCamera {
  std::string name;
  bool valid = true;  ///< its parameters and its pose in the rig are still valid
  int points = 0;
  double rms = 0;                        ///< with the calibration's parameters, px
  double expected = 0;                   ///< expectation of `rms` if `valid`, px
  double rotation = 0, translation = 0;  ///< change of the pose in the rig, rad and m
};

struct Check {
  bool valid = true;  ///< of all cameras
  std::vector<CheckedCamera> cameras;
  std::vector<Finding> findings;
};

/// Tests whether a calibration is still valid for new images (`plenocal compare --check`).
Check CheckSession(const Calibration& calibration, const Session& session, const Run& run = {});

/// Difference of two calibrations of one camera over the whole image.
struct Difference {
  std::string camera;
  double distance = 0;          ///< of the scene, m; infinite: far away
  double rms = 0, largest = 0;  ///< px
  double predicted = 0;         ///< RMS by the standard errors of both, px; NaN: not known
  bool differs = false;         ///< by more than the standard errors explain
};

/// Compares each camera that both have, at each distance, m; without distances at 1 m and infinity.
std::vector<Difference> CompareCalibrations(const Calibration& a,
                                            const Calibration& b,
                                            const std::vector<double>& distances = {});

struct SuggestOptions {
  int count = 5;
  double nearest = 0, farthest = 0;  ///< of the target, m; 0: as target and lens allow
  double tilt = 50;                  ///< of the target against the line of sight, at most, degrees
  double goal = 0.05;                ///< standard error of the projection that suffices, px
};

/// A pose of the target whose image lowers the standard error of the projection most.
struct SuggestedView {
  std::string words;                         ///< "board in the lower left corner, 0.30 m away, ..."
  std::string camera;                        ///< the camera that takes the image
  std::array<double, 16> T_camera_target{};  ///< 4 x 4, row by row, m
  double sigma_before = 0, sigma_after = 0;  ///< over the image, px; infinite: not determined
};

/// Suggests views, best first; each assumes that those before it have been taken. The calibration
/// must have been made with a target.
std::vector<SuggestedView> SuggestViews(const Calibration& calibration,
                                        const SuggestOptions& options = {},
                                        const Run& run = {});

/// Pose of a camera relative to a target.
struct Location {
  std::string frame;
  std::array<double, 16>
      T_target_camera{};  ///< 4 x 4, row by row: p_target = T_target_camera p_camera, m
  /// 6 x 6, row by row: of translation (m) and rotation vector (rad).
  std::array<double, 36> covariance{};
  std::size_t points = 0, used = 0;  ///< detected; consistent with the pose
  double rms = 0;                    ///< px
};

/// Estimates the pose for each image that shows enough of the target. `target`: in one word, a
/// file, or the text of a target.yaml; `camera`: empty if there is only one. Throws `Error` of kind
/// kJob if no image shows enough.
std::vector<Location> LocateImages(const Calibration& calibration,
                                   const std::string& camera,
                                   const std::string& target,
                                   const std::vector<Image>& images,
                                   const Run& run = {});

}  // namespace plenocal::api
