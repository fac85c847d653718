// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <variant>
#include <vector>

#include "calib/camera/corner_orders.h"
#include "targets/target.h"
#include "tests/targets/target_texts.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using testing::ErrorOf;
using testing::ExpectAt;
using ::testing::HasSubstr;
using testing::Read;

const std::string kTag = "[[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]]";
const std::string kTags =
    "plenocal: 1\ntype: apriltag\nfamily: tag36h11\ntolerance: 0.0005\ntags:\n"
    "  - {id: 7, corners: [[1, 0, 0], [1.1, 0, 0], [1.1, 0.1, 0], [1, 0.1, 0.01]]}\n"
    "  - {id: 2, corners: " +
    kTag + "}\n";
const std::string kGrid =
    "plenocal: 1\ntype: aprilgrid\ncolumns: 3\nrows: 2\nsize: 0.08\nspacing: 0.25\n";

TEST(TagTarget, NumbersTheCornersOfFreeTags) {
  const Target target = Read(kTags);
  const auto& layout = std::get<TagLayout>(target.layout);
  EXPECT_EQ(layout.family, "tag36h11");
  EXPECT_EQ(layout.border_bits, 1);
  EXPECT_FALSE(layout.black_corner_squares);
  EXPECT_THAT(layout.ids, ElementsAre(2, 7));
  EXPECT_EQ(target.markers.size(), 8u);
  ExpectAt(target, 8, 0, 0, 0);
  ExpectAt(target, 11, 0, 0.1, 0);
  ExpectAt(target, 29, 1.1, 0, 0);
  ExpectAt(target, 31, 1, 0.1, 0.01);
  EXPECT_EQ(target.tolerance, 0.0005);
}

TEST(TagTarget, LaysTagGridsFromTheLowerLeft) {
  const Target target = Read(kGrid + "first_id: 10\n");
  const auto& layout = std::get<TagLayout>(target.layout);
  EXPECT_EQ(layout.family, "tag36h11");
  EXPECT_THAT(layout.ids, ElementsAre(10, 11, 12, 13, 14, 15));
  EXPECT_EQ(target.markers.size(), 24u);
  EXPECT_FALSE(target.tolerance.has_value());
  ExpectAt(target, 40, 0, 0, 0);
  ExpectAt(target, 45, 0.18, 0, 0);     // second tag, lower right
  ExpectAt(target, 4 * 13, 0, 0.1, 0);  // second row
  ExpectAt(target, 4 * 15 + 2, 0.28, 0.18, 0);
  ExpectAt(target, 4 * 15 + 3, 0.2, 0.18, 0);
}

TEST(TagTarget, ReadsTagGridsAsKalibrsPrintByDefault) {
  EXPECT_EQ(std::get<TagLayout>(Read(kGrid).layout).border_bits, 2);
  EXPECT_TRUE(std::get<TagLayout>(Read(kGrid).layout).black_corner_squares);
  const Target target = Read(kGrid + "border_bits: 1\nfamily: tag25h9\n");
  EXPECT_EQ(std::get<TagLayout>(target.layout).border_bits, 1);
  EXPECT_FALSE(std::get<TagLayout>(target.layout).black_corner_squares);
  EXPECT_EQ(std::get<TagLayout>(target.layout).family, "tag25h9");
}

TEST(TagTarget, RefusesWrongTags) {
  const auto tags = [](const std::string& more, const std::string& family = "tag36h11") {
    return ErrorOf("plenocal: 1\ntype: apriltag\nfamily: " + family +
                   "\ntags:\n  - {id: 5, corners: " + kTag + "}\n" + more);
  };
  EXPECT_THAT(tags("  - {id: 5, corners: " + kTag + "}\n"),
              HasSubstr(".yaml:6:10: tags[1].id: tag 5 stands in line 5 already; give"));
  EXPECT_THAT(tags("  - {id: 587, corners: " + kTag + "}\n"),
              HasSubstr("tags[1].id: expected an id of tag36h11, 0 to 586, got 587"));
  EXPECT_THAT(tags("  - {id: -1, corners: " + kTag + "}\n"), HasSubstr("got -1"));
  EXPECT_THAT(tags("  - {id: 6, corners: [[0, 0, 0], [1, 0, 0], [1, 1, 0]]}\n"),
              HasSubstr("tags[1].corners: expected 4 corners, got 3"));
  EXPECT_THAT(tags("  - {id: 6, corners: [[0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]}\n"),
              HasSubstr("tags[1].corners[0]: expected 3 lengths, got a list of 2"));
  EXPECT_THAT(tags("  - {id: 6, corners: [[0, 0, .inf], [1, 0, 0], [1, 1, 0], [0, 1, 0]]}\n"),
              HasSubstr("tags[1].corners[0][2]: expected a length"));
  EXPECT_THAT(tags("  - {id: 6, corner: " + kTag + "}\n"), HasSubstr("did you mean 'corners'?"));
  EXPECT_THAT(tags("", "tag36h111"),
              HasSubstr("family: expected an AprilTag family, got 'tag36h111'; did you mean "
                        "'tag36h11'?"));
  EXPECT_THAT(ErrorOf("plenocal: 1\ntype: apriltag\nfamily: tag16h5\ntags: []\n"),
              HasSubstr("tags: expected at least one tag"));
}

TEST(TagTarget, RefusesTagsThatAreNoQuadrangles) {
  const char* bad[] = {
      "[[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]",  // one point
      "[[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]]",  // a line
      "[[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 0]]",  // a corner twice
      "[[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]",  // crossed
  };
  for (const char* corners : bad) {
    EXPECT_THAT(ErrorOf("plenocal: 1\ntype: apriltag\nfamily: tag36h11\ntags:\n  - {id: 0, "
                        "corners: " +
                        std::string(corners) + "}\n"),
                HasSubstr(".yaml:5:22: tags[0].corners: the corners of tag 0 coincide"))
        << corners;
  }
}

TEST(TagTarget, RefusesWrongGrids) {
  EXPECT_THAT(ErrorOf(kGrid + "border_bits: 3\n"), HasSubstr("expected 1, or 2 as Kalibr prints"));
  EXPECT_THAT(ErrorOf(kGrid + "first_id: 582\n"),
              HasSubstr("first_id: expected an id of tag36h11, 0 to 586, got 587"));
  EXPECT_THAT(ErrorOf(kGrid + "first_id: -1\n"), HasSubstr("got -1"));
  EXPECT_THAT(ErrorOf(kGrid + "first_id: 2147483647\n"), HasSubstr("got 2147483647"));
}

TEST(TagTarget, DoubtsTheOrderOfTheCornersOfItsTags) {
  for (const std::string& text : {kTags, kGrid}) {
    const Target target = Read(text);
    std::vector<TargetHypothesis> hypotheses = DoubtsAbout(target).hypotheses;
    std::erase_if(hypotheses, [](const TargetHypothesis& hypothesis) {
      return hypothesis.code != "target_corner_order";
    });
    ASSERT_EQ(hypotheses.size(), kCornerOrders.size());
    for (size_t i = 0; i < kCornerOrders.size(); ++i) {
      EXPECT_EQ(hypotheses[i].what, "the corners of each tag run " + CornerOrderText(i));
      EXPECT_EQ(hypotheses[i].remedy.starts_with("number the detections"), text == kGrid);
      const CandidatePlaces places = hypotheses[i].places();
      ASSERT_EQ(places.size(), target.markers.size());
      for (const auto& [number, candidates] : places) {
        const int first = number - number % 4;
        const auto corner = static_cast<int>(kCornerOrders[i][static_cast<size_t>(number % 4)]);
        EXPECT_THAT(candidates, ElementsAre(target.markers.at(first + corner)));
      }
    }
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
