// SPDX-License-Identifier: Apache-2.0
#include "apps/report/transform_json.h"

#include "apps/report/residual_sections.h"

namespace plenocal {
namespace {

constexpr int kRotationDigits = 6, kLengthDigits = 7;

}  // namespace

nlohmann::json TransformJson(const RigidTransform& T) {
  nlohmann::json rows = nlohmann::json::array();
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) rows.push_back(Short(T.R(r, c), kRotationDigits));
    rows.push_back(Short(T.t[r], kLengthDigits));
  }
  return rows;
}

nlohmann::json VectorJson(const Eigen::Vector3d& v) {
  return {Short(v.x(), kLengthDigits), Short(v.y(), kLengthDigits), Short(v.z(), kLengthDigits)};
}

}  // namespace plenocal
