// SPDX-License-Identifier: Apache-2.0
//
// Frames of images by their names and times.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <random>

#include "engine/recording/frames/session_frames.h"
#include "engine/recording/frames/session_times.h"
#include "engine/recording/frames/time_pairs.h"
#include "engine/recording/frames/times.h"
#include "engine/recording/recorded_frames.h"
#include "engine/recording/stores/image_index.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

// ---- frames of a recording

using Shot = std::pair<std::string, std::optional<double>>;  // name and time

Recording RecordingOf(const std::vector<std::vector<Shot>>& cameras) {
  Recording recording{{.path = "rec", .layout = "folders"}};
  for (const std::vector<Shot>& shots : cameras) {
    RecordedCamera& camera = recording.cameras.emplace_back();
    camera.name = fmt::format("c{}", recording.cameras.size() - 1);
    for (const auto& [name, time] : shots) {
      camera.images.push_back({FrameImage{.frame = name, .path = name, .time = time}});
    }
  }
  return recording;
}

/// "name@time 0 -" per frame: the index of the image of each camera.
std::vector<std::string> FramesOf(Recording recording, const Pairing& pairing = {}) {
  MakeFrames(pairing, &recording);
  std::vector<std::string> shown;
  for (const RecordedFrame& frame : recording.frames) {
    shown.push_back(std::isnan(frame.time) ? frame.name
                                           : fmt::format("{}@{}", frame.name, frame.time));
    for (const auto& image : frame.image) {
      shown.back() += image ? fmt::format(" {}", *image) : " -";
    }
  }
  return shown;
}

Pairing By(Pairing::By by, std::optional<double> tolerance = {}) {
  return {.by = by, .tolerance = tolerance};
}

TEST(RecordedFrames, ArePairedByTimeWhereAllImagesHaveOne) {
  const Recording recording =
      RecordingOf({{{"a", 1.0}, {"b", 2.0}, {"c", 3.0}}, {{"x", 1.1}, {"y", 2.4}, {"z", 4.0}}});
  EXPECT_THAT(FramesOf(recording, By(Pairing::By::kTime, 0.2)),
              ElementsAre("a@1 0 0", "b@2 1 -", "y@2.4 - 1", "c@3 2 -", "z@4 - 2"));
  EXPECT_THAT(FramesOf(recording, {.by = {}, .tolerance = 0.5}),
              ElementsAre("a@1 0 0", "b@2 1 1", "c@3 2 -", "z@4 - 2"));
  Recording made = recording;
  MakeFrames({.by = {}, .tolerance = 0.5}, &made);
  EXPECT_EQ(made.paired_by, Pairing::By::kTime);
  EXPECT_EQ(made.tolerance, 0.5);
}

TEST(RecordedFrames, ArePairedByNameElse) {
  Recording recording =
      RecordingOf({{{"10", {}}, {"2", {}}, {"1", {}}}, {{"2", {}}, {"10", {}}, {"3", {}}}});
  EXPECT_THAT(FramesOf(recording), ElementsAre("1 2 -", "2 1 0", "3 - 2", "10 0 1"));
  MakeFrames({}, &recording);
  EXPECT_EQ(recording.paired_by, Pairing::By::kName);
  // By name on demand, then by time where all have one.
  const Recording timed = RecordingOf({{{"p", 5.0}, {"q", 4.0}}, {{"q", 4.5}, {"r", 1.0}}});
  EXPECT_THAT(FramesOf(timed, By(Pairing::By::kName)),
              ElementsAre("r@1 - 1", "q@4 1 0", "p@5 0 -"));
}

TEST(RecordedFrames, HaveNamesThatDiffer) {
  EXPECT_THAT(
      FramesOf(RecordingOf({{{"1", 1.0}, {"2", 2.0}}, {{"1", 1.5}, {"2", 2.0}}, {{"1", 3.0}}}),
               By(Pairing::By::kTime, 0.1)),
      ElementsAre("1@1 0 - -", "1_c1@1.5 - 0 -", "2@2 1 1 -", "1_c2@3 - - 0"));
  EXPECT_THAT(FramesOf(RecordingOf({{{"1", 1.0}, {"1_c1", 2.0}}, {{"1", 3.0}, {"9", 4.0}}}),
                       By(Pairing::By::kTime, 0.1)),
              ElementsAre("1@1 0 -", "1_c1@2 1 -", "1_c1_c1@3 - 0", "9@4 - 1"));
}

TEST(RecordedFrames, WithoutNamesInCommonAreRefused) {
  const Recording apart = RecordingOf({{{"l1", {}}}, {{"l1", {}}}, {{"r1", {}}}});
  EXPECT_EQ(RefusalOf([&] { FramesOf(apart); }),
            "rec: images of c0 and c2 share no frame name (l1, r1); in recording.yaml let the last "
            "'*' of 'images' stand for what both names share, or give times");
}

TEST(RecordedFrames, WithoutTimesNeedEqualNumbersOfImages) {
  const Recording uneven =
      RecordingOf({{{"1", {}}, {"2", {}}}, {{"1", {}}, {"2", {}}}, {{"1", 1.0}}});
  EXPECT_EQ(
      RefusalOf([&] { FramesOf(uneven); }),
      "rec: c0 has 2 images and c2 has 1, and no times show which are missing; give 'times' of "
      "each camera in recording.yaml, or write 'pairing: {by: name}' there if equal names are "
      "certain to be one instant");
  EXPECT_EQ(FramesOf(uneven, By(Pairing::By::kName)).size(), 2U);
  EXPECT_EQ(RefusalOf([&] { FramesOf(uneven, By(Pairing::By::kTime)); }),
            "rec: 'pairing' is by time, but camera c0 has no times; add its 'times'");
}

// ---- pairs

TEST(TimePairs, AreNearestToEachOtherWithinTheTolerance) {
  // Against a search of all pairs.
  std::mt19937 engine(3);
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<std::vector<double>> times(2);
    for (std::vector<double>& of : times) {
      for (int i = 0; i < 6; ++i)
        of.push_back(0.25 * static_cast<double>(engine() % 40) + 1e-3 * i);
      std::ranges::sort(of);
    }
    const double tolerance = 0.25 * static_cast<double>(engine() % 8);
    const auto nearest = [](const std::vector<double>& of, double time) {
      size_t best = 0;
      for (size_t i = 1; i < of.size(); ++i) {
        if (std::abs(of[i] - time) < std::abs(of[best] - time)) best = i;
      }
      return best;
    };
    size_t pairs = 0;
    for (const auto& frame : PairTimes(times, tolerance).frames) {
      if (!frame[0] || !frame[1]) continue;
      ++pairs;
      EXPECT_EQ(nearest(times[0], times[1][*frame[1]]), *frame[0]);
    }
    size_t expected = 0;
    for (size_t i = 0; i < 6; ++i) {
      const size_t j = nearest(times[0], times[1][i]);
      const bool near = std::abs(times[0][j] - times[1][i]) <= tolerance;
      expected += near && nearest(times[1], times[0][j]) == i ? 1 : 0;
    }
    EXPECT_EQ(pairs, expected);
    EXPECT_EQ(PairTimes(times, tolerance).frames.size(), 12 - pairs);
  }
}

TEST(TimePairs, HaveATolerance) {
  // Differences of 4, 5, 6, 9 and 5 ms: their median is 5 ms, and that of the deviations 1 ms.
  const std::vector<std::vector<double>> times{{0, 1, 2, 3, 4},
                                               {0.004, 1.005, 2.006, 3.009, 4.005}};
  EXPECT_NEAR(PairTimes(times, {}).tolerance, 0.005 + 5 * 1.4826 * 0.001 + 0.001, 1e-6);
  // Negative differences count by their size, and of several cameras the largest tolerance.
  const std::vector<std::vector<double>> three{
      {0, 1, 2}, {0.004, 1.004, 2.004}, {-0.007, 0.993, 1.993}};
  EXPECT_NEAR(PairTimes(three, {}).tolerance, 0.008, 1e-12);
  // At most half of an interval.
  EXPECT_NEAR(PairTimes({{0, 0.01, 0.02}, {0.0045, 0.0145, 0.0245}}, {}).tolerance, 0.005, 1e-12);
  EXPECT_NEAR(PairTimes({{0}, {0.25}}, {}).tolerance, 0.251, 1e-12);
  EXPECT_EQ(PairTimes({{0}, {0.25}}, 0.25).frames.size(), 1U);
  EXPECT_EQ(PairTimes({{0}, {0.25}}, 0.24).frames.size(), 2U);
  EXPECT_THAT(PairTimes({}, {}).frames, IsEmpty());
}

TEST(TimePairs, TakeTheEarlierOfTwoThatAreEquallyNear) {
  const TimePairs pairs = PairTimes({{0, 1}, {0.5}}, 1);
  ASSERT_EQ(pairs.frames.size(), 2U);
  EXPECT_EQ(pairs.frames[0][1], 0U);
  EXPECT_FALSE(pairs.frames[1][1]);
}

TEST(TimePairs, KnowTheUsualIntervalAndTheFirstCamera) {
  EXPECT_EQ(UsualInterval({}), 0);
  EXPECT_EQ(UsualInterval({5}), 0);
  EXPECT_EQ(UsualInterval({1, 2, 4, 5}), 1);
  EXPECT_EQ(FirstCamera({{}, 3, 4}), 1U);
  EXPECT_EQ(FirstCamera({0, {}}), 0U);
  EXPECT_EQ(FirstCamera({{}, {}}), 2U);
}

// ---- files of times

class TimesFiles : public InTemporaryFolder {
 protected:
  [[nodiscard]] std::vector<std::string> Rows(
      const std::string& text, ExposureUnit unit = ExposureUnit::kMilliseconds) const {
    const ImageTimes times = ReadImageTimes(Write("t.txt", text), unit);
    std::vector<std::string> rows{times.has_ids ? "ids" : "no ids"};
    for (const ImageTime& row : times.rows) {
      rows.push_back(fmt::format("{}|{:.9g}|{}|{}",
                                 row.id,
                                 row.time,
                                 row.exposure ? fmt::format("{:g}", *row.exposure) : "-",
                                 row.line));
    }
    return rows;
  }
  [[nodiscard]] std::string Refusal(const std::string& text) const {
    return RefusalOf([&] { static_cast<void>(Rows(text)); });
  }
};

TEST_F(TimesFiles, HaveTheFormOfTheirFirstRow) {
  EXPECT_THAT(Rows("# id time\n\na 1.5 4\nb 2 0\nc 3\n"),
              ElementsAre("ids", "a|1.5|4|3", "b|2|-|4", "c|3|-|5"));
  EXPECT_THAT(Rows("1e0\n2.5 \r\n"), ElementsAre("no ids", "|1|-|1", "|2.5|-|2"));
  EXPECT_THAT(Rows("  7\t\n8\n"), ElementsAre("no ids", "|7|-|1", "|8|-|2"));
  // Between commas in nanoseconds, else from 1e11 on.
  EXPECT_THAT(Rows("#timestamp,name\n1000000000,a.png\n1500000000,b.png\n"),
              ElementsAre("ids", "a.png|1|-|2", "b.png|1.5|-|3"));
  EXPECT_THAT(Rows("200000000000\n300000000000\n"), ElementsAre("no ids", "|200|-|1", "|300|-|2"));
  EXPECT_THAT(Rows("100000000000\n"), ElementsAre("no ids", "|1e+11|-|1"));
  // The first row decides for all.
  EXPECT_THAT(Rows("1\n300000000000\n"), ElementsAre("no ids", "|1|-|1", "|3e+11|-|2"));
  EXPECT_THAT(Rows("a 1 2\n", ExposureUnit::kSeconds), ElementsAre("ids", "a|1|2000|1"));
  EXPECT_THAT(Rows("a 1 2\n", ExposureUnit::kMicroseconds), ElementsAre("ids", "a|1|0.002|1"));
}

TEST_F(TimesFiles, AreRefusedWhereTheyAreNone) {
  EXPECT_EQ(Refusal("# nothing\n"),
            Path("t.txt").string() +
                ": holds no times; expected lines 'id time exposure' (TUM), "
                "'time' (KITTI) or 'time,file' (EuRoC)");
  const std::string order =
      ": the time 2.000000000 s comes after 2.000000000 s in line 1; times "
      "must increase: sort the lines, or remove the one that is wrong";
  EXPECT_THAT(Refusal("a 2\nb 2\n"), EndsWith(order));
  EXPECT_THAT(Refusal("a 2\nb 1\n"),
              HasSubstr("t.txt:2:3: time: the time 1.000000000 s comes after"));
  EXPECT_EQ(Refusal("a 2\nb 2.000000001\n"), "no refusal");
  EXPECT_THAT(Refusal("a 2 -0.5\n"),
              EndsWith("exposure: expected a positive number, found '-0.5'"));
}

TEST_F(TimesFiles, HaveAFirstRow) {
  EXPECT_EQ(FirstRow("# a\n \t\n  b c\nd", 0), "b c");
  EXPECT_EQ(FirstRow("a\nb\nc", 1), "b");
  EXPECT_EQ(FirstRow("a\nb\nc", 2), "c");
  EXPECT_EQ(FirstRow("a\nb\nc", 3), "");
  EXPECT_EQ(FirstRow("", 0), "");
  EXPECT_EQ(FirstRow("#", 0), "");
}

TEST_F(TimesFiles, OfExposuresAreByCameraAndFrame) {
  const auto read = [&](const std::string& rows) {
    return ReadExposureTable(Write("e.csv", "frame,camera,exposure_ms\n" + rows));
  };
  const auto table = read("f1,left,2.5\nf1,right,3\nf2,left,\n");
  ASSERT_EQ(table.size(), 2U);
  EXPECT_EQ(table.at({"left", "f1"}), 2.5);
  EXPECT_EQ(table.at({"right", "f1"}), 3);
  const auto refusal = [&](const std::string& rows) { return RefusalOf([&] { read(rows); }); };
  EXPECT_THAT(refusal("f1,left,0\n"),
              EndsWith("e.csv:2:9: exposure_ms: expected a positive number, found '0'"));
  EXPECT_THAT(refusal("f1,left,-1\n"), EndsWith("expected a positive number, found '-1'"));
  EXPECT_THAT(refusal("f1,left,1\nf1,left,2\n"),
              AllOf(HasSubstr("e.csv:3"),
                    EndsWith("image 'f1' of camera 'left' has an exposure "
                             "already; remove one of them")));
}

// ---- times of a session's images

std::vector<FrameImage> ImagesOf(const std::vector<std::string>& files) {
  std::vector<FrameImage> images;
  for (const std::string& file : files) {
    images.push_back({.frame = std::filesystem::path(file).stem().string(), .path = file});
  }
  return images;
}

TEST_F(TimesFiles, GiveAndSortTheImages) {
  std::vector<FrameImage> images = ImagesOf({"l/0001.png", "l/0002.png", "l/0003.png"});
  TakeTimes(Write("t.txt", "3 1\n0001.png 2\n0002 4\n77 5\n"), "camera left", &images);
  EXPECT_EQ(images[0].frame, "0003");
  EXPECT_EQ(images[1].frame, "0001");
  EXPECT_EQ(images[2].time, 4);
  TakeTimes(Write("t.txt", "10\n11\n12\n"), "camera left", &images);
  EXPECT_EQ(images[0].frame, "0003");
  EXPECT_EQ(images[0].time, 10);
  EXPECT_EQ(RefusalOf([&] { TakeTimes(Write("t.txt", "10\n11\n"), "camera left", &images); }),
            Path("t.txt").string() +
                ": has 2 times, but camera left has 3 frames; times without "
                "names must be one per frame");
  EXPECT_EQ(RefusalOf([&] { TakeTimes(Write("t.txt", "1 10\n3 11\n"), "camera left", &images); }),
            Path("t.txt").string() +
                ": has no time for frame '0002' of camera left (its first row "
                "is for '1'); is it the right file?");
  const auto times = TimesOfFrames(Write("t.txt", "b 3\na 5\n"), "left", {"a", "b"});
  EXPECT_EQ(times.at("a"), 5);
  EXPECT_EQ(times.at("b"), 3);
}

TEST_F(TimesFiles, AreTheNamesOfNineteenDigits) {
  const auto time = [](const std::vector<std::string>& files) {
    std::vector<FrameImage> images = ImagesOf(files);
    TakeTimesOfNames(&images);
    return images[0].time;
  };
  EXPECT_NEAR(
      *time({"1403636579763555584.png", "1403636579763555585.png"}), 1403636579.763555584, 1e-6);
  EXPECT_FALSE(time({"1403636579763555584.png", "a.png"}));
  EXPECT_FALSE(time({"2403636579763555584.png"}));
  EXPECT_FALSE(time({"140363657976355558.png"}));
  EXPECT_FALSE(time({"14036365797635555840.png"}));
  EXPECT_FALSE(time({"140363657976355558x.png"}));
  EXPECT_FALSE(time({"140363657976355558/.png"}));
}

TEST(ImageIndexes, FindImagesByNameFileAndNumber) {
  std::vector<FrameImage> images = ImagesOf({"d/007.png", "d/8.png", "d/a.b.png"});
  images.push_back({.frame = "frame", .path = "d/left_9.png"});
  const ImageIndex index(images);
  EXPECT_EQ(index.Find("007"), 0U);
  EXPECT_EQ(index.Find("7"), 0U);
  EXPECT_EQ(index.Find("x/0007.png"), 0U);
  EXPECT_EQ(index.Find("0008"), 1U);
  EXPECT_EQ(index.Find("a.b.png"), 2U);
  EXPECT_EQ(index.Find("a.b"), 2U);
  EXPECT_EQ(index.Find("frame"), 3U);
  EXPECT_EQ(index.Find("left_9.png"), 3U);
  EXPECT_EQ(index.Find("9"), std::nullopt);
  EXPECT_EQ(index.Find(""), std::nullopt);
  const ImageIndex named(std::vector{FrameImage{.frame = "0012", .path = "d/x.png"}});
  EXPECT_EQ(named.Find("12"), 0U);
  const ImageIndex zero(ImagesOf({"000.png"}));
  EXPECT_EQ(zero.Find("0"), 0U);
}

TEST(NaturalOrder, ComparesNumbersByTheirSize) {
  const std::vector<std::string> sorted{
      "", "01", "1", "2", "10", "a", "a01", "a1", "a1b", "a2", "a10", "a10a", "a10b", "b", "b1"};
  for (size_t i = 0; i < sorted.size(); ++i) {
    for (size_t k = 0; k < sorted.size(); ++k) {
      EXPECT_EQ(NaturalLess(sorted[i], sorted[k]), i < k) << sorted[i] << " " << sorted[k];
    }
  }
  EXPECT_TRUE(NaturalLess("x0002y1", "x2y2"));
  EXPECT_TRUE(NaturalLess("x123", "x124"));
}

// ---- frames of a session

Session SessionWith(const std::vector<std::vector<Shot>>& cameras) {
  Session session;
  session.path = "s.yaml";
  for (const std::vector<Shot>& shots : cameras) {
    SessionCamera& camera = session.cameras.emplace_back();
    camera.name = fmt::format("c{}", session.cameras.size() - 1);
    for (const auto& [name, time] : shots) {
      camera.given_images.push_back({.frame = name, .path = name, .time = time});
    }
  }
  return session;
}

std::vector<std::string> NamesOf(const Session& session, std::vector<std::string>* notes) {
  std::vector<std::string> names;
  for (const auto& images : ListSessionImages(session, notes)) {
    std::string& of_camera = names.emplace_back();
    for (const FrameImage& image : images) of_camera += image.frame + " ";
  }
  return names;
}

TEST(SessionFrames, HaveTheNameOfTheirFirstCamera) {
  std::vector<std::string> notes;
  Session session = SessionWith({{{"a", 1.0}, {"b", 2.0}, {"c", 3.0}, {"d", 4.0}},
                                 {},
                                 {{"x", 1.002}, {"b", 2.504}, {"y", 3.004}, {"z", 4.003}}});
  session.pairing.tolerance = 0.01;
  EXPECT_THAT(NamesOf(session, &notes), ElementsAre("a b c d ", "", "a b_c2 c d "));
  EXPECT_THAT(notes,
              ElementsAre("c2: 3 of 4 images are paired by time with those of c0; differences 3 ms "
                          "in the median, 4 ms at most, tolerance 10 ms"));
}

TEST(SessionFrames, ArePairedByNameOnDemandOrWithoutTimes) {
  std::vector<std::string> notes;
  Session session = SessionWith({{{"a", 1.0}}, {{"x", 1.0}}});
  session.pairing.by = Pairing::By::kName;
  EXPECT_THAT(NamesOf(session, &notes), ElementsAre("a ", "x "));
  EXPECT_THAT(notes, IsEmpty());
  Session untimed = SessionWith({{{"a", 1.0}}, {{"x", {}}}});
  EXPECT_THAT(NamesOf(untimed, &notes), ElementsAre("a ", "x "));
  untimed.pairing.by = Pairing::By::kTime;
  EXPECT_EQ(
      RefusalOf([&] { NamesOf(untimed, &notes); }),
      "s.yaml: 'pairing' is by time, but the images of camera c1 have no times; give 'times', a "
      "recording or a video, or pair by name");
  Session timed = SessionWith({{{"a", 1.0}}, {{"x", 1.0}}});
  timed.pairing.by = Pairing::By::kTime;
  EXPECT_THAT(NamesOf(timed, &notes), ElementsAre("a ", "a "));
  Session one = SessionWith({{{"a", {}}}});
  one.pairing.by = Pairing::By::kTime;
  EXPECT_THAT(NamesOf(one, &notes), ElementsAre("a "));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
