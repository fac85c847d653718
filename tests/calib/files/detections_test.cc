// SPDX-License-Identifier: Apache-2.0
#include "calib/files/detections.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::HasSubstr;

// Eight decimals are written.
constexpr double kWritten = 0.5e-8;

constexpr std::array<std::string_view, 2> kMeasured{"x", "y"};
constexpr std::array<std::string_view, 2> kLens{"lens_x", "lens_y"};

CameraModel Ordinary() {
  CameraModel model{};
  model.name = "ordinary";
  model.measured = kMeasured;
  return model;
}
CameraModel ThroughALens() {
  CameraModel model = Ordinary();
  model.context = kLens;
  return model;
}

class Detections : public testing::InTemporaryFolder {
 protected:
  [[nodiscard]] std::vector<View> Read(const std::string& text, const CameraModel& model) const {
    return ReadDetections(Write("detections.csv", text), model);
  }
  [[nodiscard]] std::string MessageOf(const std::string& text, const CameraModel& model) const {
    return testing::RefusalOf([&] { (void)Read(text, model); });
  }
};

TEST_F(Detections, ComeBackFromTheirTable) {
  const std::vector<View> views{{"0001", {{3, {12.25, -0.5}, 0.1}, {4, {1e4, 1.0 / 3}, 0}}},
                                {"b", {{3, {1, 2}, 0.25}}}};
  const std::vector<View> again = Read(DetectionsCsv(views, Ordinary()), Ordinary());
  ASSERT_EQ(again.size(), views.size());
  for (size_t v = 0; v < views.size(); ++v) {
    EXPECT_EQ(again[v].frame, views[v].frame);
    ASSERT_EQ(again[v].observations.size(), views[v].observations.size());
    for (size_t i = 0; i < views[v].observations.size(); ++i) {
      const Observation &a = again[v].observations[i], &b = views[v].observations[i];
      EXPECT_EQ(a.marker, b.marker);
      EXPECT_NEAR(a.detector_sigma, b.detector_sigma, kWritten);
      for (size_t k = 0; k < kMaxObservationSize; ++k)
        EXPECT_NEAR(a.values[k], b.values[k], kWritten);
    }
  }
}

TEST_F(Detections, WriteTheColumnsOfTheModel) {
  const std::vector<View> views{{"7", {{3, {12.25, 1, 10, 2.5}, 0.1}}}};
  EXPECT_EQ(DetectionsCsv(views, ThroughALens()),
            "frame,marker,x,y,lens_x,lens_y,sigma\n7,3,12.25,1,10,2.5,0.1\n");
  EXPECT_EQ(DetectionsCsv(views, Ordinary()), "frame,marker,x,y,sigma\n7,3,12.25,1,0.1\n");
}

TEST_F(Detections, KeepTheErrorsThatTheyShare) {
  // Coordinates x errors.
  const std::vector<View> views{
      {"7", {{3, {12.25, 1}, 0.1}}, {{0.25, -0.5, 0.125, 1}}},
      {"8", {{3, {2, 1}, 0.1}, {4, {2, 3}, 0.1}}, {{1, 2, 3, 4}, {5, 6, 7, 8}}}};
  const std::string text = DetectionsCsv(views, Ordinary());
  EXPECT_THAT(
      text,
      ::testing::StartsWith("frame,marker,x,y,sigma,x_shared_1,y_shared_1,x_shared_2,y_shared_2\n"
                            "7,3,12.25,1,0.1,0.25,0.125,-0.5,1\n"));
  const std::vector<View> again = Read(text, Ordinary());
  ASSERT_EQ(again.size(), 2);
  for (size_t v = 0; v < 2; ++v) EXPECT_EQ(again[v].by_nuisance, views[v].by_nuisance);
  EXPECT_THAT(MessageOf("frame,marker,x,y,x_shared_1\n1,2,3,4,5\n", Ordinary()),
              HasSubstr(":1: column 'y_shared_1' is missing"));
  EXPECT_THAT(MessageOf("frame,marker,x,y,x_shared_1,y_shared_1\n1,2,3,4,5,\n", Ordinary()),
              HasSubstr(":2:11: y_shared_1: expected a number"));
}

TEST_F(Detections, FindColumnsByNameInAnyOrderAndIgnoreOthers) {
  const auto views =
      Read("lens_y,note,y,marker,lens_x,x,frame\n2.5,hello,1,3,10,12.25,007\n", ThroughALens());
  ASSERT_EQ(views.size(), 1);
  EXPECT_EQ(views[0].frame, "007") << "a frame's name is text";
  ASSERT_EQ(views[0].observations.size(), 1);
  const Observation& observation = views[0].observations[0];
  EXPECT_EQ(observation.marker, 3);
  EXPECT_THAT(observation.values, ::testing::ElementsAre(12.25, 1, 10, 2.5, 0, 0, 0));
  EXPECT_EQ(observation.detector_sigma, 0);
}

TEST_F(Detections, GroupTheRowsOfAFrameWhereverTheyStand) {
  const auto views = Read("frame,marker,x,y\nb,1,0,0\na,1,0,0\nb,2,0,0\n", Ordinary());
  ASSERT_EQ(views.size(), 2);
  EXPECT_EQ(views[0].frame, "b");
  EXPECT_EQ(views[0].observations.size(), 2);
}

TEST_F(Detections, TakeWindowsLineEndsAndTheirByteOrderMark) {
  const auto views = Read(
      "\xEF\xBB\xBF"
      "frame,marker,x,y\r\n1,2,3.5,4\r\n",
      Ordinary());
  ASSERT_EQ(views.size(), 1);
  EXPECT_EQ(views[0].observations[0].values[0], 3.5);
}

TEST_F(Detections, MayShowAMarkerOnceAMicroLens) {
  const std::string rows = "frame,marker,x,y,lens_x,lens_y\n1,2,3,4,5,6\n1,2,3,4,5,";
  EXPECT_EQ(Read(rows + "7\n", ThroughALens())[0].observations.size(), 2);
  EXPECT_THAT(MessageOf(rows + "6\n", ThroughALens()), HasSubstr("has marker 2 in line 2 already"));
  EXPECT_THAT(MessageOf(rows + "7\n", Ordinary()), HasSubstr("has marker 2 in line 2 already"));
}

TEST_F(Detections, AreRefusedWithFileAndLine) {
  const std::string file = Path("detections.csv").string();
  const std::string head = "frame,marker,x,y,sigma\n0,1,2,3,0.1\n";
  const auto message = [&](const std::string& row) { return MessageOf(head + row, Ordinary()); };
  for (const char* row :
       {"0,2,nan,3,0.1", "0,2,inf,3,0.1", "0,2,3px,3,0.1", "0,2,,3,0.1", "0,2,1e999,3,0.1"}) {
    EXPECT_THAT(message(row), AllOf(HasSubstr(file + ":3:5: x: "), HasSubstr("number"))) << row;
  }
  EXPECT_THAT(message("0,1.5,2,3,0.1"), HasSubstr(":3:3: marker: expected a whole number"));
  EXPECT_THAT(message("0,2,2,3,-0.1"), HasSubstr(":3:9: sigma: expected a positive number"));
  EXPECT_THAT(message("0,2,2,3,0"), HasSubstr(":3:9: sigma: expected a positive number"));
  EXPECT_THAT(message("0,2,2"), HasSubstr(":3: expected 5 columns"));
  EXPECT_THAT(message(",2,2,3,0.1"), HasSubstr(":3:1: frame: this frame's name is empty"));
  EXPECT_THAT(message("0,1,5,5,0.1"), HasSubstr(":3: frame '0' has marker 1 in line 2 already"));
  EXPECT_THAT(MessageOf("", Ordinary()), HasSubstr("expected a header line"));
  EXPECT_THAT(MessageOf("frame,marker,x\n", Ordinary()),
              AllOf(HasSubstr(":1: column 'y' is missing"), HasSubstr("ordinary")));
  EXPECT_THAT(MessageOf("frame,marker,x,y\n", ThroughALens()), HasSubstr("'lens_x' is missing"));
  EXPECT_THAT(testing::RefusalOf([] { (void)ReadDetections("/nowhere/d.csv", Ordinary()); }),
              HasSubstr("/nowhere/d.csv: no such file"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
