// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "calib/io/yaml.h"
#include "targets/target.h"
#include "tests/refusal.h"

namespace plenocal::testing {

// m. Files hold 12 digits, and the markers of these tests are less than 10 m away.
inline constexpr double kRounding = 1e-11;

/// The target of a file's text; messages call the file "target.yaml".
inline Target Read(const std::string& text) {
  return ReadTarget(YamlNode::Parse(text, "target.yaml"));
}

/// The message about a text that is refused.
inline std::string ErrorOf(const std::string& text) {
  const std::string message = RefusalOf([&] { Read(text); });
  EXPECT_THAT(message, ::testing::Not(::testing::HasSubstr("\n")));
  return message;
}

inline void ExpectAt(const Target& target, int marker, double x, double y, double z) {
  const auto found = target.markers.find(marker);
  ASSERT_NE(found, target.markers.end()) << "no marker " << marker;
  EXPECT_LT((found->second - Eigen::Vector3d(x, y, z)).norm(), kRounding)
      << "marker " << marker << " is at " << found->second.transpose();
}

}  // namespace plenocal::testing
