// SPDX-License-Identifier: Apache-2.0
//
// Points, lengths, angles and planes in space from their images, with standard errors.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calib/base/run.h"
#include "calib/camera/observation.h"
#include "calib/files/calibration_record.h"
#include "calib/files/finding.h"
#include "calib/files/scene_keys.h"
#include "calib/files/session.h"
#include "calib/io/output_folder.h"
#include "calib/space/common_errors.h"
#include "calib/space/measures.h"
#include "calib/space/point_fit.h"

namespace plenocal {

/// Places at which a camera sees points; images of one instant have one frame.
struct SeenPoints {
  std::string camera;
  std::string source;  ///< for messages: file, or name
  std::vector<View> views;
  bool is_noise = false;  ///< `Observation::detector_sigma` is the noise itself
};

/// A point of an image, px.
struct PickedPoint {
  std::string camera;
  double x = 0, y = 0;
};

struct TriangulateRequest {
  std::filesystem::path calibration;  ///< folder of `calibrate`, or a calibration.yaml
  /// Names of cameras and their tables of detections; with `at` their images.
  std::vector<std::pair<std::string, std::filesystem::path>> files;
  /// Points 0, 1, ..., which are found in the images of the other cameras.
  std::vector<PickedPoint> at;
  std::optional<double> sigma;  ///< of each coordinate, px; not set: the calibration's noise
  /// Of the noise of one coordinate between two cameras, all ordinary; in (-1, 1).
  double correlation = 0;
  bool adjust = false;  ///< the calibration too, as far as the points' rays determine it
  SpaceFrame frame = SpaceFrame::kRig;
  std::vector<std::vector<ScenePosition>> lengths, angles, planes;  ///< in each frame
  bool all_lengths = false;
  double level = 0.95;        ///< of intervals
  std::filesystem::path out;  ///< folder; empty: none is written
};

struct TriangulatedPoint {
  std::string frame;
  int marker = 0;
  SpacePoint point;
  bool used = false;  ///< found, and its rays meet

  [[nodiscard]] std::string Place() const;
};

struct TriangulatedMeasure {
  std::string frame, kind, of;  ///< "length", "angle" or "plane"; "12 40"
  std::optional<Measured> number;
  std::optional<MeasuredPlane> plane;
};

/// A number of the calibration that points adjusted.
struct AdjustedNumber {
  std::string name;  ///< as in correlations.csv
  double change = 0, sigma_before = 0, sigma = 0;
};

struct Triangulation {
  std::vector<std::string> cameras;
  SpaceFrame frame = SpaceFrame::kRig;
  std::string calibration;          ///< file, or ""
  double correlation = 0;           ///< as requested
  double level = 0.95, sigmas = 0;  ///< of intervals, and half their width
  std::vector<TriangulatedPoint> points;
  std::vector<TriangulatedMeasure> measures;
  RaysTest rays;  ///< of all used points together
  std::vector<AdjustedNumber> adjusted = {};
  std::vector<LeftOut> left_out;  ///< points and measures
  std::vector<Finding> findings;
};

/// "12", "tag 3" (its centre) or "tag 3 corner 0", of tags whose markers have the numbers 4 * id +
/// corner. Throws `Error` of kind kInput.
ScenePosition PositionNamed(const std::string& name);

/// Writes points.csv, shared.csv, measures.csv and triangulation.yaml (docs/formats.md).
void WriteTriangulation(const Triangulation& made, OutputFolder* out);
/// The same numbers: the keys of triangulation.yaml, and in place of the count the rows of
/// `points`, `shared` and `measures` by the names of their columns; null where one is not finite.
std::string TriangulationJson(const Triangulation& made);
/// By name: `change`, `sigma_before`, `sigma`.
nlohmann::ordered_json AdjustedJson(const std::vector<AdjustedNumber>& adjusted);
/// A summary for a person, some lines.
std::string TriangulationText(const Triangulation& made);

/// Throws `Error`: of kind kInput for cameras, points and measures that do not fit, of kind kJob
/// where no point is found.
Triangulation TriangulatePoints(const TriangulateRequest& request, const Run& run);
/// The markers of the session's target in its images, in place of files.
Triangulation TriangulatePoints(const Session& session,
                                const TriangulateRequest& request,
                                const Run& run);
Triangulation TriangulatePoints(const CalibrationRecord& calibration,
                                const std::vector<SeenPoints>& seen,
                                const TriangulateRequest& request,
                                const Run& run);

}  // namespace plenocal
