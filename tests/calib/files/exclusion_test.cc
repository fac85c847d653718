// SPDX-License-Identifier: Apache-2.0
#include "calib/files/exclusion.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::vector<FrameImage> Images() {
  return {{"01", "a/left01.png"}, {"02", "a/left02.png"}, {"11", "a/left11.png"}};
}

ExcludeRule Rule(const std::string& frame,
                 const std::vector<int>& markers = {},
                 const std::string& camera = {}) {
  return {.camera = camera, .frame = frame, .markers = markers, .note = {}};
}

std::vector<std::string> FramesLeft(const ExcludeRule& rule, const std::string& camera) {
  Exclusion exclusion({rule});
  std::vector<FrameImage> images = Images();
  std::vector<LeftOut> left_out;
  exclusion.RemoveImages(camera, &images, &left_out);
  EXPECT_EQ(images.size() + left_out.size(), Images().size());
  std::vector<std::string> frames;
  for (const FrameImage& image : images) frames.push_back(image.frame);
  return frames;
}

TEST(Exclusion, LeavesOutImagesByFrameGlobAndFile) {
  EXPECT_THAT(FramesLeft(Rule("02"), "left"), ElementsAre("01", "11"));
  EXPECT_THAT(FramesLeft(Rule("0*"), "left"), ElementsAre("11"));
  EXPECT_THAT(FramesLeft(Rule("left11.png"), "left"), ElementsAre("01", "02"));
  EXPECT_THAT(FramesLeft(Rule("left11"), "left"), ElementsAre("01", "02"));
  EXPECT_THAT(FramesLeft(Rule("*", {}, "right"), "left"), ElementsAre("01", "02", "11"));
}

TEST(Exclusion, StatesTheReason) {
  ExcludeRule rule = Rule("02", {}, "left");
  rule.note = "blurred";
  Exclusion exclusion({rule});
  std::vector<FrameImage> images = Images();
  std::vector<LeftOut> left_out;
  exclusion.RemoveImages("left", &images, &left_out);
  ASSERT_EQ(left_out.size(), 1U);
  EXPECT_EQ(left_out[0].where, "a/left02.png");
  EXPECT_EQ(left_out[0].reason, "excluded by the session: blurred");
  EXPECT_EQ(left_out[0].camera, "left");
  EXPECT_EQ(left_out[0].frame, "02");
  EXPECT_TRUE(left_out[0].whole);
  EXPECT_THAT(exclusion.Unused(), IsEmpty());
}

TEST(Exclusion, NamesTheNearestFrameOfARuleThatLeavesOutNothing) {
  Exclusion exclusion({Rule("img_0012")});
  std::vector<FrameImage> images{{"img_0001", "a.png"}, {"img_0013", "b.png"}};
  std::vector<LeftOut> left_out;
  exclusion.RemoveImages("left", &images, &left_out);
  ASSERT_EQ(exclusion.Unused().size(), 1U);
  EXPECT_THAT(exclusion.Unused()[0], HasSubstr("did you mean 'img_0013'?"));
}

TEST(Exclusion, LeavesOutMarkersWithTheirSharedErrors) {
  std::vector<View> views{{.frame = "a",
                           .observations = {{.marker = 3}, {.marker = 4}, {.marker = 3}},
                           .by_nuisance = {{1}, {2}, {3}}},
                          {.frame = "b", .observations = {{.marker = 3}}}};
  Exclusion exclusion({Rule("", {3, 9}), Rule("zzz", {4})});
  std::vector<LeftOut> left_out;
  exclusion.RemoveViews("cam", {}, &views, &left_out);
  ASSERT_EQ(views.size(), 1U) << "a view without points is none";
  ASSERT_EQ(views[0].observations.size(), 1U);
  EXPECT_EQ(views[0].observations[0].marker, 4);
  EXPECT_EQ(views[0].by_nuisance, (std::vector<std::vector<double>>{{2}}));
  ASSERT_EQ(left_out.size(), 2U) << "one a marker and view, however often it was seen";
  EXPECT_EQ(left_out[0].where, "cam frame a marker 3");
  EXPECT_EQ(left_out[0].marker, "3");
  EXPECT_FALSE(left_out[0].whole);
  EXPECT_THAT(exclusion.Unused(), ElementsAre(HasSubstr("exclude[1] (frame: zzz, markers: [4])")));
}

}  // namespace TEST_FILE
}  // namespace plenocal
