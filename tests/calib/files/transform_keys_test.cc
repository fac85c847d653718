// SPDX-License-Identifier: Apache-2.0
#include "calib/files/checks/transform_keys.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>
#include <string>

#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;
using testing::RefusalOf;

class TransformKeys : public testing::InTemporaryFolder {
 protected:
  [[nodiscard]] RigidTransform Transform(const std::string& text) const {
    return ReadTransform(YamlNode::ReadFile(Write("file.yaml", "T: " + text)).At("T"));
  }
  [[nodiscard]] RigidTransform Xi(const std::string& text) const {
    return ReadXi(YamlNode::ReadFile(Write("file.yaml", "xi: " + text)).At("xi"));
  }
  [[nodiscard]] std::string RefusedTransform(const std::string& text) const {
    return RefusalOf([&] { (void)Transform(text); });
  }
  [[nodiscard]] std::string RefusedXi(const std::string& text) const {
    return RefusalOf([&] { (void)Xi(text); });
  }
};

TEST_F(TransformKeys, HoldFourRows) {
  const RigidTransform T = Transform("[[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]");
  EXPECT_EQ(T.t, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(T.R, (Eigen::Matrix3d() << 0, -1, 0, 1, 0, 0, 0, 0, 1).finished());
  EXPECT_THAT(RefusedTransform("[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]"),
              HasSubstr("expected the four rows of a 4 x 4 matrix"));
  EXPECT_THAT(RefusedTransform("[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 2]]"),
              HasSubstr("expected [0, 0, 0, 1]"));
  for (const char* no_rotation : {"[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]",
                                  "[[1, 0, 0, 0], [0, 1, 0.01, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
                                  "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1.01, 0], [0, 0, 0, 1]]",
                                  "[[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]]"}) {
    EXPECT_THAT(RefusedTransform(no_rotation), HasSubstr("the left 3 x 3 part is no rotation"));
  }
  EXPECT_THAT(RefusedTransform("[[1, 0, 0, 0], [0, 1, 0, -2e6], [0, 0, 1, 0], [0, 0, 0, 1]]"),
              HasSubstr("expected a translation in metres"));
}

TEST(MakeRotation, CorrectsFewDigitsAndKeepsAll) {
  const Eigen::Matrix3d exact = ExpRotation({0.3, -0.2, 0.5});
  Eigen::Matrix3d same = exact;
  EXPECT_TRUE(MakeRotation(&same));
  EXPECT_EQ(same, exact);
  Eigen::Matrix3d rounded = (1e4 * exact).array().round() / 1e4;
  EXPECT_TRUE(MakeRotation(&rounded));
  EXPECT_LT((rounded - exact).norm(), 2e-4);
  EXPECT_LT((rounded * rounded.transpose() - Eigen::Matrix3d::Identity()).norm(), 1e-14);
  Eigen::Matrix3d scaled = 1.001 * exact;
  EXPECT_FALSE(MakeRotation(&scaled)) << "2e-3 off";
  Eigen::Matrix3d mirrored = -exact;
  EXPECT_FALSE(MakeRotation(&mirrored));
}

TEST_F(TransformKeys, HoldAnElementOfSe3) {
  const RigidTransform T = Xi("[1, 2, 3, 0, 0, 1.5707963267948966]");
  EXPECT_LT((T.R * Eigen::Vector3d::UnitX() - Eigen::Vector3d::UnitY()).norm(), 1e-12);
  Vector6d xi;
  xi << 1, 2, 3, 0, 0, std::numbers::pi / 2;
  EXPECT_LT((T.t - Exp(xi).t).norm(), 1e-12);
  EXPECT_EQ(Xi("[0, 0, 0, 6.28, 0, 0]").t, Eigen::Vector3d::Zero());
  EXPECT_THAT(RefusedXi("[0, 0, 0, 0, 90, 0]"),
              HasSubstr("expected a rotation by at most 2 pi (the last three numbers, in radians), "
                        "found one by 90"));
  EXPECT_THAT(RefusedXi("[0, 0, 0, 6.29, 0, 0]"), HasSubstr("found one by 6.29"));
  EXPECT_THAT(RefusedXi("[2e6, 0, 0, 0, 0, 0]"), HasSubstr("expected a translation in metres"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
