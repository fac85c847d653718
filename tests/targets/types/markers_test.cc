// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <variant>

#include "targets/target.h"
#include "tests/targets/target_texts.h"

namespace plenocal {
namespace TEST_FILE {

using testing::ExpectAt;
using testing::Read;

const std::string kMarkers =
    "plenocal: 1\ntype: markers\nmarkers:\n  0: [0, 0, 0]\n  12: [0.1, 0.2, 0.3]\n";

TEST(MarkersTarget, ReadsMarkersWithoutDetector) {
  const Target target = Read(kMarkers);
  EXPECT_TRUE(std::holds_alternative<MarkersLayout>(target.layout));
  EXPECT_EQ(target.markers.size(), 2u);
  ExpectAt(target, 12, 0.1, 0.2, 0.3);
}

}  // namespace TEST_FILE
}  // namespace plenocal
