// SPDX-License-Identifier: Apache-2.0
//
// The summary of a recording that is made here in memory.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "engine/recording/recording_summary.h"
#include "engine/recording/supplied_detections.h"
#include "models/registry.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

struct Shot {
  const char* name;
  std::optional<double> time = {}, exposure = {};
};

RecordedCamera CameraOf(const std::string& name, const std::vector<Shot>& shots) {
  RecordedCamera camera;
  camera.name = name;
  camera.image_size = {640, 480};
  for (const Shot& shot : shots) {
    camera.images.push_back(
        {FrameImage{.frame = shot.name, .path = shot.name, .time = shot.time}, shot.exposure});
  }
  return camera;
}

/// Frames of images with the same index; -1 in `lacks`: the second camera has none there.
Recording RecordingOf(const std::vector<RecordedCamera>& cameras, std::vector<size_t> lacks = {}) {
  Recording recording{{.path = "rec", .layout = "folders"}};
  recording.cameras = cameras;
  for (size_t i = 0; i < cameras[0].images.size(); ++i) {
    RecordedFrame frame{.name = cameras[0].images[i].frame,
                        .time = cameras[0].images[i].time.value_or(std::nan("")),
                        .image = {}};
    for (size_t c = 0; c < cameras.size(); ++c) {
      const bool lack = c == 1 && std::ranges::find(lacks, i) != lacks.end();
      frame.image.push_back(lack ? std::nullopt : std::optional<size_t>(i));
    }
    recording.frames.push_back(frame);
  }
  recording.paired_by = Pairing::By::kTime;
  recording.tolerance = 0.0125;
  return recording;
}

RecordingSummary SummaryOf(const Recording& recording) {
  return Summarise(recording, CameraModels());
}

std::vector<std::string> GapsOf(const std::vector<Shot>& shots) {
  const auto gaps = SummaryOf(RecordingOf({CameraOf("a", shots)})).cameras[0].gaps;
  if (!gaps) return {"unknown"};
  std::vector<std::string> shown;
  for (const Gap& gap : *gaps) shown.push_back(fmt::format("{} after {}", gap.missing, gap.after));
  return shown;
}

TEST(RecordingSummaries, CountImagesThatFitIntoGaps) {
  EXPECT_THAT(GapsOf({{"a", 0.0}, {"b", 1.0}, {"c", 2.0}, {"d", 4.1}, {"e", 5.1}, {"f", 9.0}}),
              ElementsAre("1 after c", "3 after e"));
  // From half of an interval more on.
  EXPECT_THAT(GapsOf({{"a", 0.0}, {"b", 1.0}, {"c", 2.0}, {"d", 3.49}}), IsEmpty());
  EXPECT_THAT(GapsOf({{"a", 0.0}, {"b", 1.0}, {"c", 2.0}, {"d", 3.51}}), ElementsAre("1 after c"));
  EXPECT_THAT(GapsOf({{"08"}, {"09"}, {"10"}, {"13"}}), ElementsAre("2 after 10"));
  EXPECT_THAT(GapsOf({{"1"}, {"2"}, {"x3"}}), ElementsAre("unknown"));
  EXPECT_THAT(GapsOf({{"7"}}), IsEmpty());
  const CameraSummary none{.name = "a", .gaps = {}, .exposure = {}};
  EXPECT_EQ(none.Missing(), 0U);
  const CameraSummary some{
      .name = "a", .gaps = std::vector<Gap>{{"x", 2}, {"y", 3}}, .exposure = {}};
  EXPECT_EQ(some.Missing(), 5U);
}

TEST(RecordingSummaries, HaveTheRangeAndStepsOfExposures) {
  const auto exposure = [](const std::vector<Shot>& shots) {
    return SummaryOf(RecordingOf({CameraOf("a", shots)})).cameras[0].exposure;
  };
  const auto found =
      exposure({{"1", {}, 4.0}, {"2", {}, 4.0}, {"3", {}, 8.0}, {"4", {}, 2.0}, {"5", {}, 3.0}});
  ASSERT_TRUE(found);
  EXPECT_EQ(found->least, 2);
  EXPECT_EQ(found->largest, 8);
  EXPECT_EQ(found->changes, 3U);
  EXPECT_EQ(found->largest_step, 4);
  const auto same = exposure({{"1", {}, 4.0}, {"2", {}, 4.0}});
  EXPECT_EQ(same->changes, 0U);
  EXPECT_EQ(same->largest_step, 1);
  EXPECT_EQ(exposure({{"1", {}, 2.0}, {"2", {}, 6.0}})->largest_step, 3);
  EXPECT_FALSE(exposure({{"1"}, {"2"}}));
}

TEST(RecordingSummaries, HaveRateDurationAndPairs) {
  const Recording recording =
      RecordingOf({CameraOf("a", {{"1", 10.0}, {"2", 10.25}, {"3", 10.5}, {"4", 11.0}}),
                   CameraOf("b", {{"1", 10.002}, {"2", 10.2}, {"3", 10.497}, {"4", 11.001}})},
                  {1});
  const RecordingSummary summary = SummaryOf(recording);
  EXPECT_EQ(summary.complete, 3U);
  EXPECT_DOUBLE_EQ(summary.duration, 1);
  EXPECT_DOUBLE_EQ(summary.rate, 4);
  ASSERT_EQ(summary.pairs.size(), 1U);
  EXPECT_EQ(summary.pairs[0].camera, "b");
  EXPECT_EQ(summary.pairs[0].frames, 3U);
  EXPECT_NEAR(summary.pairs[0].median, 0.002, 1e-12);
  EXPECT_NEAR(summary.pairs[0].largest, 0.003, 1e-12);
  const RecordingSummary untimed =
      SummaryOf(RecordingOf({CameraOf("a", {{"1"}, {"2"}}), CameraOf("b", {{"1"}, {"2"}})}));
  EXPECT_EQ(untimed.duration, 0);
  EXPECT_EQ(untimed.rate, 0);
  EXPECT_EQ(untimed.pairs[0].frames, 2U);
  EXPECT_EQ(untimed.pairs[0].largest, 0);
}

/// "command: what it lacks; ..." of each command.
std::map<std::string, std::vector<std::string>> NeedsOf(const Recording& recording) {
  std::map<std::string, std::vector<std::string>> needs;
  for (const CommandNeeds& each : SummaryOf(recording).needs) needs[each.command] = each.lacks;
  return needs;
}

class Needs : public InTemporaryFolder {};

TEST_F(Needs, AreNamedOfEachCommand) {
  const std::string calibration =
      "a calibration ('calibration' in recording.yaml, or calibration.yaml in the folder)";
  Recording recording = RecordingOf({CameraOf("left", {{"1"}, {"2"}})});
  auto needs = NeedsOf(recording);
  EXPECT_THAT(needs["calibrate"], ElementsAre("a session with the target (plenocal init)"));
  EXPECT_THAT(needs["groundtruth"],
              ElementsAre(calibration,
                          "a second camera, or white images of a plenoptic one: nothing "
                          "gives the scale"));
  EXPECT_THAT(needs["response"],
              ElementsAre("exposure times of left (third column of its 'times')"));
  EXPECT_THAT(needs["vignette"], ElementsAre(calibration, "the response of left ('response')"));
  EXPECT_THAT(needs["evaluate"], ElementsAre("the true trajectory ('truth')"));
  recording.cameras[0].white_images.push_back({.frame = "w", .path = "w"});
  recording.cameras[0].response = "pcalib.txt";
  recording.truth = "truth.txt";
  for (RecordedImage& image : recording.cameras[0].images) image.exposure = 2;
  recording.foreign = {{"x/sensor.yaml", ""}, {"x/camera.txt", "dso"}, {"x/other", "ros"}};
  needs = NeedsOf(recording);
  const std::string import =
      "a calibration: plenocal import x/camera.txt --format dso -o x/calibration.yaml";
  EXPECT_THAT(needs["groundtruth"], ElementsAre(import));
  EXPECT_THAT(needs["vignette"], ElementsAre(import));
  EXPECT_THAT(needs["response"], ElementsAre("exposures of left that differ"));
  EXPECT_THAT(needs["evaluate"], IsEmpty());
  recording.cameras[0].images[1].exposure = 3;
  EXPECT_THAT(NeedsOf(recording)["response"], IsEmpty());
}

TEST_F(Needs, OfACalibrationAreItsCamerasAndSizes) {
  Recording recording = RecordingOf(
      {CameraOf("a", {{"1"}, {"2"}}), CameraOf("b", {{"1"}, {"2"}}), CameraOf("c", {{"1"}, {"2"}})},
      {0, 1});
  const auto camera = [](const std::string& name, const std::string& size) {
    return fmt::format(
        "  {}:\n    model: pinhole\n    image_size: [{}]\n"
        "    parameters: {{f_x: 500, f_y: 500, c_x: 320, c_y: 240}}\n"
        "    T_camera_rig: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n",
        name,
        size);
  };
  recording.calibration =
      Write("calibration.yaml",
            "plenocal: 1\ncameras:\n" + camera("a", "640, 480") + camera("b", "320, 240"));
  const std::string file = recording.calibration.string();
  EXPECT_THAT(NeedsOf(recording)["groundtruth"],
              ElementsAre("a calibration of b for 640 x 480 px; " + file + " has 320 x 240",
                          "camera c in " + file,
                          "frames that all cameras have"));
}

// ---- texts

constexpr const char* kNeeds =
    "\nmissing for\n"
    "  calibrate   a session with the target (plenocal init)\n";

TEST(SummaryTexts, OfOneCameraAreShort) {
  const Recording recording = RecordingOf({CameraOf("left", {{"1"}, {"2"}, {"3"}, {"6"}})});
  EXPECT_THAT(SummaryText(recording, SummaryOf(recording)),
              StartsWith(std::string("rec (folders)\n"
                                     "  cameras     left: 4 images, 640 x 480 px\n"
                                     "  frames      4\n"
                                     "  times       none: the order is that of the names\n"
                                     "  missing     left: 2 images (2 after 3)\n") +
                         kNeeds));
}

/// A recording that has some of everything.
Recording Rich() {
  Recording recording = RecordingOf(
      {CameraOf("a", {{"1", 0.0, 4.0}, {"2", 0.5, 8.0}, {"3", 1.0, 8.0}, {"4", 2.0, 8.0}}),
       CameraOf("b", {{"x1", 0.001}, {"x2", 0.502}, {"x3", 1.0}, {"x4", 1.5}})},
      {3});
  recording.cameras[0].bayer = BayerOrder::kRggb;
  recording.cameras[0].white_images.push_back({.frame = "w", .path = "w"});
  recording.cameras[0].exposures_filled = 2;
  recording.cameras[0].response = "r.txt";
  recording.cameras[0].vignetting = "v.png";
  recording.cameras[1].markers = MarkerFile{.path = "m.txt", .columns = {}};
  recording.topics = {{.name = "/a/image",
                       .type = "T",
                       .count = 4,
                       .encoding = "mono8",
                       .size = {640, 480},
                       .rate = 2.5,
                       .camera_info = "/a/camera_info",
                       .camera = "a",
                       .defect = ""},
                      {.name = "/c/image",
                       .type = "T",
                       .count = 1,
                       .encoding = "",
                       .camera_info = "",
                       .defect = "is cut off"}};
  recording.other_topics = {{.name = "/imu", .type = "sensor_msgs/Imu", .count = 9}};
  recording.notes = {"one note", "another"};
  recording.foreign = {{"x/sensor.yaml", ""}, {"x/camera.txt", "dso"}};
  recording.truth = "truth.txt";
  for (const char* where : {"p", "q", "r", "s"}) {
    recording.left_out.push_back({.where = where, .reason = "has no time", .camera = "a"});
  }
  recording.left_out.push_back({.where = "t", .reason = "is no image", .camera = "b"});
  return recording;
}

TEST(SummaryTexts, HaveALineOfEachProperty) {
  const Recording recording = Rich();
  EXPECT_EQ(
      SummaryText(recording, SummaryOf(recording)),
      "rec (folders)\n"
      "  topics      /a/image: 4 images, mono8, 640 x 480 px, 2.5 a second, camera a, intrinsics "
      "in /a/camera_info\n"
      "              /c/image: 1 image, not used: is cut off\n"
      "              /imu: no images, 9 messages of sensor_msgs/Imu\n"
      "  cameras     a: 4 images, 640 x 480 px, mosaic RGGB, 1 white image\n"
      "              b: 4 images, 640 x 480 px, supplied markers\n"
      "  frames      4, 3 with images of all cameras (paired by time, at most 12.5 ms apart)\n"
      "  times       2.000 s, 2 frames/s\n"
      "  pairs       a and b: 3 frames, times differ by 1 ms (median), at most 2 ms\n"
      "  missing     a: 1 image (1 after 3)\n"
      "              b: none, no interval is larger than usual\n"
      "  exposure    a: 4 to 8 ms, 1 change, the largest by a factor of 2; not given for 2 "
      "images, where it is the mean of the neighbours'\n"
      "  left out    4 images, a: has no time (p, q, r, ...)\n"
      "              1 image, b: is no image (t)\n"
      "  notes       one note\n"
      "              another\n"
      "  calibration x/sensor.yaml, a form that is not read\n"
      "  calibration x/camera.txt, of the format dso\n"
      "  truth       truth.txt\n"
      "  response    r.txt\n"
      "  vignetting  v.png\n" +
          std::string(kNeeds) +
          "  groundtruth a calibration: plenocal import x/camera.txt --format dso -o "
          "x/calibration.yaml\n"
          "  response    exposure times of b (third column of its 'times')\n"
          "  vignette    a calibration: plenocal import x/camera.txt --format dso -o "
          "x/calibration.yaml; the response of b ('response')\n"
          "  evaluate    nothing\n");
}

TEST(SummaryTexts, ShowThreeGapsAndNoTimesOfNames) {
  Recording recording = RecordingOf(
      {CameraOf("a",
                {{"1"},
                 {"2"},
                 {"3"},
                 {"4"},
                 {"5"},
                 {"6"},
                 {"7"},
                 {"9"},
                 {"11"},
                 {"13"},
                 {"16"},
                 {"18"}}),
       CameraOf(
           "b",
           {{"x"}, {"x"}, {"x"}, {"x"}, {"x"}, {"x"}, {"x"}, {"x"}, {"x"}, {"x"}, {"x"}, {"x"}})});
  recording.paired_by = Pairing::By::kName;
  const std::string text = SummaryText(recording, SummaryOf(recording));
  EXPECT_THAT(
      text,
      HasSubstr("  missing     a: 6 images (1 after 7, 1 after 9, 1 after 11, 2 more gaps)\n"
                "              b: not known, as there are neither times nor numbers\n"));
  EXPECT_THAT(text, HasSubstr("12 with images of all cameras (paired by name)\n"));
  EXPECT_THAT(text, HasSubstr("  pairs       a and b: 12 frames\n"));
}

TEST(SummaryTexts, OfNamesEscapeWhatSteersATerminal) {
  Recording recording = RecordingOf({CameraOf("a", {{"1"}})});
  recording.notes = {"red \x1b[31m"};
  EXPECT_THAT(SummaryText(recording, SummaryOf(recording)), HasSubstr("red \\u001b[31m\n"));
}

TEST(SummaryJsons, HaveAKeyOfEachProperty) {
  const Recording recording = Rich();
  const std::string text = SummaryJson(recording, SummaryOf(recording));
  EXPECT_TRUE(text.ends_with("}\n"));
  const auto json = nlohmann::json::parse(text);
  EXPECT_EQ(json["path"], "rec");
  EXPECT_EQ(json["layout"], "folders");
  const auto expected = [](const char* of) { return nlohmann::json::parse(of); };
  EXPECT_EQ(json["cameras"]["a"],
            expected(R"({"images": 4, "image_size": [640, 480], "bayer": "RGGB", "white_images": 1,
                         "missing": 1, "gaps": [{"after": "3", "missing": 1}],
                         "exposure": {"least": 4.0, "largest": 8.0, "changes": 1,
                                      "largest_step": 2.0, "filled": 2}})"));
  EXPECT_EQ(json["cameras"]["b"],
            expected(R"({"images": 4, "image_size": [640, 480], "white_images": 0, "missing": 0,
                         "gaps": []})"));
  EXPECT_EQ(json["topics"]["/a/image"],
            expected(R"({"type": "T", "count": 4, "encoding": "mono8", "image_size": [640, 480],
                         "rate": 2.5, "camera": "a", "camera_info": "/a/camera_info",
                         "defect": ""})"));
  EXPECT_EQ(json["topics"]["/imu"], expected(R"({"type": "sensor_msgs/Imu", "count": 9})"));
  EXPECT_EQ(json["notes"], expected(R"(["one note", "another"])"));
  EXPECT_EQ(json["frames"], 4);
  EXPECT_EQ(json["complete"], 3);
  EXPECT_EQ(json["paired_by"], "time");
  EXPECT_EQ(json["duration"], 2.0);
  EXPECT_EQ(json["rate"], 2.0);
  EXPECT_EQ(json["pairs"]["b"]["frames"], 3);
  EXPECT_NEAR(json["pairs"]["b"]["median"].get<double>(), 0.001, 1e-9);
  EXPECT_NEAR(json["pairs"]["b"]["largest"].get<double>(), 0.002, 1e-9);
  EXPECT_EQ(json["left_out"].size(), 5U);
  EXPECT_EQ(json["left_out"][4],
            expected(R"({"camera": "b", "image": "t", "reason": "is no image"})"));
  EXPECT_EQ(json["lacks"]["evaluate"], expected("[]"));
  Recording untimed = RecordingOf({CameraOf("a", {{"1"}}), CameraOf("b", {{"1"}})});
  untimed.paired_by = Pairing::By::kName;
  const auto other = nlohmann::json::parse(SummaryJson(untimed, SummaryOf(untimed)));
  EXPECT_EQ(other["paired_by"], "name");
  EXPECT_FALSE(other.contains("rate"));
  EXPECT_FALSE(other["pairs"]["b"].contains("median"));
}

// ---- supplied detections

class Supplied : public InTemporaryFolder {
 protected:
  SuppliedDetections Read(const std::string& text,
                          std::vector<std::string> columns,
                          int skip = 0,
                          double origin = 0) const {
    Recording recording = RecordingOf({CameraOf("a", {{"01"}, {"02"}})});
    recording.frames[1].name = "f2";
    recording.cameras[0].markers = MarkerFile{.path = Write("m.txt", text),
                                              .columns = std::move(columns),
                                              .pixel_origin = origin,
                                              .skip = skip};
    return ReadSuppliedDetections(recording, 0);
  }
};

TEST_F(Supplied, AreRowsOfTheFramesOfTheImages) {
  const SuppliedDetections found =
      Read("title\n9 1 5 6\n8 1 5 6\n1 7 10.5 20\n02.png 7 11 21.25\n1 8 0 0\n",
           {"frame", "marker", "x", "y"},
           1,
           1);
  EXPECT_EQ(found.csv, "frame,marker,x,y\n01,7,9.5,19\nf2,7,10,20.25\n01,8,-1,-1\n");
  EXPECT_EQ(found.points, 3U);
  EXPECT_EQ(found.left_out, 2U);
  EXPECT_EQ(found.first_left_out, 2);
  // Through different micro lenses a marker is seen several times.
  EXPECT_EQ(Read("1,7,10,20,30,40,0.5\n1,7,10,20,31,40,\n",
                 {"frame", "marker", "x", "y", "lens_x", "lens_y", "sigma"},
                 0,
                 0.5)
                .csv,
            "frame,marker,x,y,lens_x,lens_y,sigma\n01,7,9.5,19.5,29.5,39.5,0.5\n"
            "01,7,9.5,19.5,30.5,39.5,\n");
}

TEST_F(Supplied, AreRefusedWithTheirLine) {
  const auto refusal = [&](const std::string& text) {
    return RefusalOf([&] { Read(text, {"frame", "marker", "x", "y", "sigma"}); });
  };
  const std::string file = Path("m.txt").string();
  EXPECT_THAT(refusal("1,7,10,20,1\n01,7,11,21,1\n"),
              ::testing::AllOf(
                  StartsWith(file + ":2: "),
                  HasSubstr("frame '01' has this marker in line 1 already; keep one of the rows")));
  for (const std::string sigma : {"0", "-1", "1e-200", "1e200"}) {
    EXPECT_THAT(refusal("1,7,10,20," + sigma + "\n"),
                HasSubstr("sigma: expected a positive number from 1e-150 to 1e150"));
  }
  EXPECT_EQ(refusal("1,7,10,20,1e-150\n"), "no refusal");
  EXPECT_EQ(refusal("5,7,10,20,1\n"),
            file +
                ": names no image of camera a in its column 'frame'; are 'columns' and 'skip' "
                "right?");
}

TEST_F(Supplied, AreFilesOfTheCamerasThatHaveThem) {
  Recording recording =
      RecordingOf({CameraOf("a", {{"01"}, {"02"}}), CameraOf("b", {{"01"}, {"02"}})});
  EXPECT_EQ(RefusalOf([&] { SuppliedMarkers(recording, {}); }),
            "rec: has no supplied detections; name them in recording.yaml: 'markers: {a: {file: "
            "markers.txt, columns: [frame, marker, x, y]}}'");
  recording.cameras[1].markers = MarkerFile{.path = Write("m.txt", "1 7 10 20\n9 7 1 1\n"),
                                            .columns = {"frame", "marker", "x", "y"}};
  std::vector<std::string> messages;
  plenocal::Run run;
  run.listener.message =
      run.listener.warning = [&](const std::string& line) { messages.push_back(line); };
  const OutputContents files = SuppliedMarkers(recording, run);
  ASSERT_EQ(files.size(), 1U);
  EXPECT_EQ(files[0].first, "detections_b.csv");
  EXPECT_THAT(
      messages,
      ElementsAre("b: 1 point",
                  Path("m.txt").string() + ":2: 1 row of images that the recording does not have"));
  EXPECT_EQ(RefusalOf([&] { CameraInfoFiles(recording, run); }),
            "rec: has no camera_info with a calibration beside its images; 'plenocal recording' "
            "lists its topics");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
