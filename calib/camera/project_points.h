// SPDX-License-Identifier: Apache-2.0
//
// Projection of many points by one camera.
#pragma once

#include "calib/camera/camera_model.h"

namespace plenocal {

/// Projects all points of `in`. All numbers of a point lie together, in `in` and in `out`; those of
/// a point outside the domain are NaN. Much faster than calls for each point where the model has
/// `ModelFunctions::project_block`.
void ProjectPoints(const CameraModel& model,
                   const double* params,
                   const double* config,
                   const PointBlock& in,
                   const ProjectionOutput& out);

}  // namespace plenocal
