// SPDX-License-Identifier: Apache-2.0
//
// Points, lengths, angles and planes in space from their images, with standard errors.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calib/base/run.h"
#include "calib/camera/observation.h"
#include "calib/files/calibration_record.h"
#include "calib/files/finding.h"
#include "calib/io/output_folder.h"
#include "calib/space/measures.h"
#include "calib/space/point_fit.h"

namespace plenocal {

/// Places at which a camera sees points; images of one instant have one frame.
struct SeenPoints {
  std::string camera;
  std::string source;  ///< for messages: file, or name
  std::vector<View> views;
};

struct TriangulateRequest {
  std::filesystem::path calibration;  ///< folder of `calibrate`, or a calibration.yaml
  /// Names of cameras and their tables of detections.
  std::vector<std::pair<std::string, std::filesystem::path>> tables;
  std::optional<double> sigma;  ///< of each coordinate, px; not set: the calibration's noise
  SpaceFrame frame = SpaceFrame::kRig;
  std::vector<std::vector<int>> lengths, angles, planes;  ///< numbers of points, in each frame
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

struct Triangulation {
  std::vector<std::string> cameras;
  SpaceFrame frame = SpaceFrame::kRig;
  double level = 0.95, sigmas = 0;  ///< of intervals, and half their width
  std::vector<TriangulatedPoint> points;
  std::vector<TriangulatedMeasure> measures;
  RaysTest rays;                  ///< of all used points together
  std::vector<LeftOut> left_out;  ///< points and measures
  std::vector<Finding> findings;
};

/// points.csv, shared.csv, measures.csv and triangulation.yaml (docs/formats.md).
OutputContents TriangulationFiles(const CalibrationRecord& calibration, const Triangulation& made);
/// A summary for a person, some lines.
std::string TriangulationText(const Triangulation& made);

/// Throws `Error`: of kind kInput for cameras, points and measures that do not fit, of kind kJob
/// where no point is found.
Triangulation TriangulatePoints(const TriangulateRequest& request, const Run& run);
Triangulation TriangulatePoints(const CalibrationRecord& calibration,
                                const std::vector<SeenPoints>& seen,
                                const TriangulateRequest& request,
                                const Run& run);

}  // namespace plenocal
