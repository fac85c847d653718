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
  std::string frame;  ///< images of one frame were taken at once
  const void* data = nullptr;
  int width = 0, height = 0;
  std::size_t stride = 0;   ///< bytes from one row to the next
  int channels = 1;         ///< 1: gray; 3: blue, green, red
  int bytes_per_value = 1;  ///< 1 or 2
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
  std::string model = {};  ///< as `plenocal models` lists them; empty: chosen by held-out frames
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
  struct Data;

  /// That of a folder of `plenocal calibrate`, or of a calibration.yaml.
  static Calibration Read(const std::string& path);

  std::vector<Camera> cameras;  ///< the ordinary ones, the rig's master first
  Grade grade = Grade::kGood;   ///< that of the worst finding
  std::vector<Finding> findings;
  std::string yaml;     ///< content of calibration.yaml
  std::string summary;  ///< as `plenocal calibrate` prints it; empty: it was read
  std::shared_ptr<const Data> data;

  /// Throws `Error` of kind kInput for a camera that there is not.
  const Camera& operator[](const std::string& name) const;
};

/// Detects, calibrates and judges. Calibrations of several threads go on side by side.
Calibration CalibrateSession(const Session& session,
                             const Options& options = {},
                             const Run& run = {});

/// The points of the target in all images, by camera: sources for another session. Ordinary cameras
/// only.
std::vector<Source> DetectSession(const Session& session, const Run& run = {});

/// A camera model, judged by frames that it was not calibrated with.
struct TriedModel {
  std::string model;
  bool recommended = false;
  double held_out_rms = 0;  ///< px; NaN: it has no score
  std::string judgement;    ///< against the best model, or why it has no score
};

/// Tries these models, or all that fit, for the cameras of a session (`plenocal try`).
std::vector<TriedModel> TrySession(const Session& session,
                                   const std::vector<std::string>& models = {},
                                   const Run& run = {});

/// A camera of a calibration before new images.
struct CheckedCamera {
  std::string name;
  bool valid = true;  ///< its parameters and its pose in the rig still hold
  int points = 0;
  double rms = 0;                        ///< with the calibration's parameters, px
  double expected = 0;                   ///< of `rms` if the calibration holds, px
  double rotation = 0, translation = 0;  ///< of the camera in the rig since then, rad and m
};

struct Check {
  bool valid = true;  ///< of all cameras
  std::vector<CheckedCamera> cameras;
  std::vector<Finding> findings;
};

/// Does the calibration hold for new images of its cameras (`plenocal compare --check`)?
Check CheckSession(const Calibration& calibration, const Session& session, const Run& run = {});

/// How far two calibrations of one camera differ in the image, over all of it.
struct Difference {
  std::string camera;
  double distance = 0;          ///< of the scene, m; infinite: far away
  double rms = 0, largest = 0;  ///< px
  double predicted = 0;         ///< RMS by the standard errors of both, px; NaN: not known
  bool differs = false;         ///< by more than they explain
};

/// For each camera that both have and each distance, m; without distances at 1 m and far away.
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
  std::string camera;                        ///< that sees it
  std::array<double, 16> T_camera_target{};  ///< 4 x 4, row by row, m
  double sigma_before = 0, sigma_after = 0;  ///< over the image, px; infinite: not determined
};

/// Best first, each with those before it taken. The calibration is one before a target.
std::vector<SuggestedView> SuggestViews(const Calibration& calibration,
                                        const SuggestOptions& options = {},
                                        const Run& run = {});

/// Pose of a camera before a target.
struct Location {
  std::string frame;
  std::array<double, 16>
      T_target_camera{};  ///< 4 x 4, row by row: p_target = T_target_camera p_camera, m
  /// 6 x 6, row by row: of translation (m) and rotation vector (rad).
  std::array<double, 36> covariance{};
  std::size_t points = 0, used = 0;  ///< seen; in agreement with the pose
  double rms = 0;                    ///< px
};

/// Of each image that shows enough of the target (a word, a file, or the text of one). `camera`:
/// empty: the only one. Throws `Error` of kind kJob when no image does.
std::vector<Location> LocateImages(const Calibration& calibration,
                                   const std::string& camera,
                                   const std::string& target,
                                   const std::vector<Image>& images,
                                   const Run& run = {});

}  // namespace plenocal::api
