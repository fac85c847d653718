// SPDX-License-Identifier: Apache-2.0
//
// Single markers and tags that are not where the target's file puts them.
#pragma once

#include <vector>

#include "calib/camera/target_hypothesis.h"
#include "calib/estimate/calibrate.h"
#include "calib/files/finding.h"

namespace plenocal {

/// The residuals of each marker, rejected ones too, carried back to the target's plane in each view
/// and compared over the views: a marker or tag that is displaced, a tag of another size, whose
/// corners have another order, or that exists twice. A displacement counts when it is six standard
/// errors (from its scatter over the views) long, stands out among the displacements of all others
/// beside a smooth field (one false alarm in ten thousand sessions, Rayleigh's distribution), and
/// exceeds three times the scatter in one image. Of targets in one plane and of tags anywhere.
std::vector<Finding> FindMovedMarkers(const Calibration& calibration, const TargetDoubts& doubts);

}  // namespace plenocal
