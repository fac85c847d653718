// SPDX-License-Identifier: Apache-2.0
//
// Errors of the metrics of a loop by those of its ground truth.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "apps/evaluate/trajectory_metrics.h"
#include "calib/scene/segment_covariance.h"

namespace plenocal {

/// Errors of both segments as small similarities about these centres.
struct TruthUncertainty {
  Eigen::Vector3d start_centre = Eigen::Vector3d::Zero(), end_centre = Eigen::Vector3d::Zero();
  LoopCovariance covariance;  ///< its `segments` and `scale_sigma` alone
};

/// The content of groundtruth.yaml for one camera.
struct GroundTruthFile {
  std::vector<std::string> cameras;  ///< all that have a path, the one of the covariance first
  std::filesystem::path segments;    ///< trajectory of the camera
  TruthUncertainty uncertainty;
};

/// `camera` empty: the first one. Throws `Error` of kind kInput with file, line and key.
GroundTruthFile ReadGroundTruth(const std::filesystem::path& path, const std::string& camera);

/// One metric's error, in its unit.
struct MetricError {
  double sigma = 0;      ///< standard error from the truth's; below the floor: the floor
  double floor = 0;      ///< root mean square deviation from perfect of an estimate without errors
  bool resolved = true;  ///< the metric deviates from perfect by the floor or more
};

struct LoopMetricErrors {
  MetricError scale_drift, rotation_drift_deg, translation_drift, alignment_error, absolute_scale;
};

LoopMetricErrors ErrorsByTruth(const LoopMetrics& metrics,
                               const Trajectory& estimate,
                               const TruthUncertainty& uncertainty);

}  // namespace plenocal
