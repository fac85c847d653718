// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include "calib/camera/rigid_transform.h"

namespace plenocal {

/// Three rows of [R t], as the pages have them.
nlohmann::json TransformJson(const RigidTransform& T);

/// x, y, z.
nlohmann::json VectorJson(const Eigen::Vector3d& v);

}  // namespace plenocal
