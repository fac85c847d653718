// SPDX-License-Identifier: Apache-2.0
#include "calib/files/checks/transform_keys.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <numbers>
#include <vector>

namespace plenocal {
namespace {

void CheckDistance(const RigidTransform& T, const YamlNode& node) {
  if (T.t.cwiseAbs().maxCoeff() < kFarthestPart) return;
  node.Fail(fmt::format("expected a translation in metres, each number below {:g}", kFarthestPart));
}

}  // namespace

bool MakeRotation(Eigen::Matrix3d* R) {
  constexpr double kFewDigits = 1e-3, kAllDigits = 1e-9;
  const double off = (*R * R->transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (!(off < kFewDigits && R->determinant() > 0)) return false;
  if (off > kAllDigits) *R = Eigen::Quaterniond(*R).normalized().toRotationMatrix();
  return true;
}

RigidTransform ReadTransform(const YamlNode& node) {
  const auto rows = node.Elements();
  if (rows.size() != 4) node.Fail("expected the four rows of a 4 x 4 matrix");
  RigidTransform T;
  for (int r = 0; r < 3; ++r) {
    const std::vector<double> row = rows[static_cast<size_t>(r)].AsNumbers(4);
    T.R.row(r) << row[0], row[1], row[2];
    T.t[r] = row[3];
  }
  if (rows[3].AsNumbers(4) != std::vector<double>{0, 0, 0, 1}) {
    rows[3].Fail("expected [0, 0, 0, 1]");
  }
  if (!MakeRotation(&T.R)) node.Fail("the left 3 x 3 part is no rotation");
  CheckDistance(T, node);
  return T;
}

RigidTransform ReadXi(const YamlNode& node) {
  constexpr double kMost = 2 * std::numbers::pi;  // a larger angle is that of a smaller one
  const std::vector<double> xi = node.AsNumbers(6);
  const Eigen::Map<const Vector6d> vector(xi.data());
  const double angle = vector.tail<3>().stableNorm();
  if (angle > kMost) {
    node.Fail(
        fmt::format("expected a rotation by at most 2 pi (the last three numbers, in "
                    "radians), found one by {:g}",
                    angle));
  }
  const RigidTransform T = Exp(vector);
  CheckDistance(T, node);
  return T;
}

}  // namespace plenocal
