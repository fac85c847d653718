// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "apps/console.h"
#include "apps/print/print_target.h"
#include "apps/simulate/simulate.h"

namespace plenocal {

// Each command throws `Error`, or `Stopped` after Ctrl-C; main maps both to the exit status.

struct SessionCommand {
  std::filesystem::path session;
  std::filesystem::path out;
  bool keep = false;       ///< pictures of the stages in OUT/images
  bool fresh = false;      ///< takes over nothing from earlier runs
  bool jackknife = false;  ///< calibrate: sigmas by leaving out frames beside the others
  bool report = true;      ///< write report.html as well
};

/// The white images of a session's cameras, or, with `model`, those that `inputs` name.
struct WhiteCommand {
  std::vector<std::string> inputs;  ///< session.yaml; or folders, globs and files
  std::string model;                ///< camera model; empty: `inputs` is a session
  std::string camera;               ///< name for the results; empty: that of the images' folder
  std::string bayer;                ///< "RGGB" and the like for raw mosaics, else empty
  std::optional<std::filesystem::path> grid;  ///< RayCalibData XML
  std::filesystem::path out;
};

/// Raw plenoptic images and where the micro lenses come from.
struct FocusCommand {
  std::vector<std::string> raw;      ///< folders, globs and files
  std::vector<std::string> white;    ///< likewise
  std::filesystem::path grid;        ///< micro_lenses_<camera>.csv or RayCalibData XML; empty: none
  std::filesystem::path vignetting;  ///< attenuation TIFF; empty: none
  std::filesystem::path markers;     ///< target.yaml; empty: none
  std::string bayer;                 ///< "RGGB" and the like for raw mosaics, else empty
  double scale = 2;                  ///< raw px a pixel of the results
  std::filesystem::path out;
};

/// Estimated trajectories and the truth that they are compared with.
struct EvaluateCommand {
  std::vector<std::string> estimates;  ///< files, or NAME=FILE
  std::filesystem::path truth;         ///< both segments, or the whole path
  std::filesystem::path start, end;    ///< or one file a segment
  std::filesystem::path times;         ///< times of KITTI poses; empty: none
  double tolerance = 0.01;             ///< s between poses that belong together
  int delta = 1;                       ///< pairs of poses between the ends of a relative error
  /// Runs without scale: not set none, empty all.
  std::optional<std::vector<std::string>> monocular;
  bool json = false;
  std::filesystem::path chart;  ///< SVG or PNG; empty: none
};

/// What of a calibration becomes another tool's file.
struct ExportCommand {
  std::filesystem::path calibration;
  std::string format;
  std::vector<std::string> cameras;  ///< empty: all
  std::filesystem::path out;
};

/// Another tool's files that become ours.
struct ImportCommand {
  std::vector<std::filesystem::path> files;
  std::string format;
  std::string size;           ///< "640x480" for files that hold none, else empty
  bool fisheye = false;       ///< OpenCV's files that do not say so
  std::filesystem::path out;  ///< folder, or the file's own name
};

/// The models that a session's cameras are tried with.
struct TryCommand {
  std::filesystem::path session;
  std::filesystem::path out;
  std::vector<std::string> models;  ///< empty: all of the cameras' kind
  std::string camera;               ///< whose model is varied; empty: all of one kind
  int folds = 5;
  bool fresh = false;  ///< takes over nothing from earlier runs
};

/// Two calibrations of the same cameras, or one and new images of them.
struct CompareCommand {
  std::filesystem::path a, b;     ///< calibration.yaml; b is empty when there are new images
  std::filesystem::path session;  ///< of the new images; empty: none
  std::vector<double> distances;  ///< m; empty: 1 m and far away
  std::filesystem::path out;      ///< for picture and table; empty: neither
  bool json = false;              ///< new images: JSON on standard output
};

/// A camera of a calibration as another model's.
struct ConvertCommand {
  std::filesystem::path calibration;
  std::string camera;  ///< empty: the only one
  std::string model;
  std::filesystem::path out;
};

/// Which pinhole camera shows what a camera sees.
struct ViewArguments {
  std::string size;               ///< "640x480"; empty: the camera's own
  std::optional<double> fov;      ///< degrees
  std::optional<double> balance;  ///< 0: every pixel has a source, 1: all that is seen
};

/// How images become those of another camera.
struct ResampleArguments {
  std::string interpolation = "linear";
  std::string bayer;             ///< "RGGB" and the like for raw mosaics, else empty
  bool keep_vignetting = false;  ///< also where the calibration has it
  bool mask = false;             ///< write which pixels have a source
};

/// The remap tables of a camera.
struct MapCommand {
  std::filesystem::path calibration;
  std::string camera;  ///< empty: the only one
  ViewArguments view;
  std::filesystem::path out;  ///< a folder, or FILE.yaml or FILE.xml of OpenCV
};

/// Images of a camera without its distortion.
struct UndistortCommand {
  std::filesystem::path calibration;
  std::string camera;               ///< empty: the only one
  std::vector<std::string> images;  ///< folders, globs and files
  ViewArguments view;
  ResampleArguments resample;
  std::filesystem::path cloud;  ///< PLY of one plenoptic image; empty: none
  std::filesystem::path out;
};

/// A stereo pair whose points lie in equal rows.
struct RectifyCommand {
  std::filesystem::path calibration;
  std::string left, right;           ///< images, each a folder, glob or file; empty: none
  std::filesystem::path session;     ///< session.yaml that has the images; empty: none
  std::vector<std::string> cameras;  ///< two names; empty: the first two
  std::filesystem::path
      detections;  ///< folder of detections_<camera>.csv; empty: the calibration's
  ViewArguments view;
  ResampleArguments resample;
  bool maps = false;  ///< write remap tables
  std::filesystem::path out;
};

/// `plenocal calibrate`: images or detections to calibration.
void RunCalibrate(const SessionCommand& command, const ConsoleOptions& options);
/// `plenocal detect`: only the detections.
void RunDetect(const SessionCommand& command, const ConsoleOptions& options);
/// `plenocal white`: micro-image centres and attenuation images.
void RunWhite(const WhiteCommand& command, const ConsoleOptions& options);
/// `plenocal focus`: totally focused image and virtual depth.
void RunFocus(const FocusCommand& command, const ConsoleOptions& options);
/// `plenocal simulate`: a session with known truth.
void RunSimulate(const SimulateCommand& command, const ConsoleOptions& options);
/// `plenocal target`: a printable target.
void RunTarget(const PrintCommand& command);
/// `plenocal evaluate`: drift and errors of trajectories.
void RunEvaluate(const EvaluateCommand& command, const ConsoleOptions& options);
/// `plenocal export`: another tool's file.
void RunExport(const ExportCommand& command, const ConsoleOptions& options);
/// `plenocal import`: calibration.yaml, target.yaml, detections or micro lenses from another
/// tool's file.
void RunImport(const ImportCommand& command, const ConsoleOptions& options);
/// `plenocal report`: report.html of a calibration's folder, from the files there alone.
void RunReport(const std::filesystem::path& folder);
/// `plenocal try`: which camera model describes the cameras best.
void RunTry(const TryCommand& command, const ConsoleOptions& options);
/// `plenocal compare`: how far two calibrations differ in the image and in space, or whether one
/// still holds for new images (throws `Error` of kind kJob when not).
void RunCompare(const CompareCommand& command, const ConsoleOptions& options);
/// `plenocal convert`: one camera model fitted to another.
void RunConvert(const ConvertCommand& command);
/// `plenocal map`: remap tables of a camera.
void RunMap(const MapCommand& command, const ConsoleOptions& options);
/// `plenocal undistort`: images without distortion.
void RunUndistort(const UndistortCommand& command, const ConsoleOptions& options);
/// `plenocal rectify`: stereo pairs whose points lie in equal rows.
void RunRectify(const RectifyCommand& command, const ConsoleOptions& options);
/// `plenocal models`: the registered camera models on standard output.
void RunModels();
/// `plenocal models check`: the properties of one of them. Throws `Error` of kind kJob when one is
/// violated.
void RunModelCheck(const std::string& name);

}  // namespace plenocal
