// SPDX-License-Identifier: Apache-2.0
//
// Points that a command line names: tables or images of cameras, or a session.
#pragma once

#include <string>
#include <vector>

#include "engine/rigs/triangulate_points.h"

namespace plenocal {

/// `given`: CAMERA=FILE of each camera, or a session.yaml alone. Throws `Error` of kind kInput for
/// other words, and as `TriangulatePoints`.
Triangulation TriangulateGiven(const std::vector<std::string>& given,
                               TriangulateRequest request,
                               const Run& run);

}  // namespace plenocal
