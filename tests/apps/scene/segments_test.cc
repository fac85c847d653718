// SPDX-License-Identifier: Apache-2.0
#include "apps/groundtruth/segments.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <string>
#include <vector>

#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;
using testing::RefusalOf;
using ::testing::StartsWith;

// Ten frames a second, "f000", "f001", ...
SceneTracks Recording(size_t frames, bool with_times) {
  SceneTracks tracks;
  for (size_t f = 0; f < frames; ++f) {
    tracks.frames.push_back(fmt::format("f{:03}", f));
    if (with_times) tracks.times.push_back(1000 + 0.1 * static_cast<double>(f));
  }
  return tracks;
}

LoopSegments Choose(const SceneTracks& tracks, const SegmentChoice& choice) {
  return ChooseSegments(tracks, choice, [&](const std::vector<size_t>& start) {
    EXPECT_FALSE(start.empty());
    return FramesFrom(tracks.frames.size() - 5, tracks.frames.size());
  });
}

TEST(FramesFrom, AreTheIndices) {
  EXPECT_EQ(FramesFrom(2, 5), (std::vector<size_t>{2, 3, 4}));
  EXPECT_TRUE(FramesFrom(5, 5).empty());
  EXPECT_TRUE(FramesFrom(5, 2).empty());
}

TEST(ChooseSegments, StartIsTheFirstFifteenSecondsOrSixth) {
  const LoopSegments timed = Choose(Recording(400, true), {});
  EXPECT_EQ(timed.start, FramesFrom(0, 151));
  EXPECT_EQ(timed.end, FramesFrom(395, 400));
  EXPECT_EQ(Choose(Recording(60, false), {}).start, FramesFrom(0, 10));
  EXPECT_EQ(Choose(Recording(61, false), {}).start, FramesFrom(0, 11));
}

TEST(ChooseSegments, AreOnBothSidesOfAGapThatStandsOut) {
  SceneTracks tracks = Recording(100, true);
  for (size_t f = 40; f < 100; ++f) tracks.times[f] += 30;
  const LoopSegments segments = Choose(tracks, {});
  EXPECT_EQ(segments.start, FramesFrom(0, 40));
  EXPECT_EQ(segments.end, FramesFrom(40, 100));
  // A choice of either counts for more.
  EXPECT_EQ(Choose(tracks, {.start = "f000:f009", .end = {}}).start, FramesFrom(0, 10));
  EXPECT_EQ(Choose(tracks, {.start = {}, .end = "f090:"}).start, FramesFrom(0, 40));
}

TEST(ChooseSegments, AreGivenByNamesOrSeconds) {
  const SceneTracks tracks = Recording(100, true);
  const auto start = [&](const std::string& text) {
    return Choose(tracks, {.start = text, .end = {}}).start;
  };
  EXPECT_EQ(start("f003:f005"), FramesFrom(3, 6)) << "a frame that is named belongs to it";
  EXPECT_EQ(start(":f005"), FramesFrom(0, 6));
  EXPECT_EQ(start("0.3:0.5"), FramesFrom(3, 5)) << "a frame at the last second does not";
  EXPECT_EQ(start("0.35:0.55"), FramesFrom(4, 6));
  EXPECT_EQ(start("f003:0.5"), FramesFrom(3, 5));
  const LoopSegments both = Choose(tracks, {.start = ":1", .end = "f080:"});
  EXPECT_EQ(both.start, FramesFrom(0, 10));
  EXPECT_EQ(both.end, FramesFrom(80, 100));
  // A frame whose name is a number.
  SceneTracks numbered = Recording(10, true);
  numbered.frames[7] = "0.2";
  EXPECT_EQ(Choose(numbered, {.start = "f000:f001", .end = "0.2:"}).end, FramesFrom(7, 10));
}

TEST(ChooseSegments, RefusesWhatNamesNoFrames) {
  const SceneTracks timed = Recording(100, true), named = Recording(100, false);
  const auto refused = [](const SceneTracks& tracks, const SegmentChoice& choice) {
    return RefusalOf([&] { Choose(tracks, choice); });
  };
  EXPECT_EQ(refused(timed, {.start = "f003", .end = {}}),
            "--start f003: no ':'; write A:B, names of frames or seconds");
  EXPECT_EQ(refused(named, {.start = {}, .end = "f003"}),
            "--end f003: no ':'; write A:B, names of frames");
  EXPECT_THAT(refused(named, {.start = "0.3:f005", .end = {}}), HasSubstr(": no frame '0.3'; "));
  EXPECT_THAT(refused(timed, {.start = "f003:g", .end = {}}), HasSubstr(": no frame 'g'; "));
  EXPECT_THAT(refused(timed, {.start = "nan:", .end = {}}), HasSubstr(": no frame 'nan'; "));
  EXPECT_THAT(refused(timed, {.start = "f005:f003", .end = {}}),
              StartsWith("--start f005:f003: no frames lie there; "));
  EXPECT_EQ(refused(timed, {.start = ":f050", .end = "f050:"}),
            "the end segment begins before the start segment ends");
  EXPECT_EQ(refused(timed, {.start = ":f050", .end = "f051:"}), "no refusal");
}

}  // namespace TEST_FILE
}  // namespace plenocal
