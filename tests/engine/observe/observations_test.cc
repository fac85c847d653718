// SPDX-License-Identifier: Apache-2.0
//
// Points of memory and of files as the observations of a session, what is left out of them, and
// choices that few frames do not allow.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include "calib/files/detections.h"
#include "engine/observe/auto_model.h"
#include "engine/observe/left_out.h"
#include "engine/observe/scene_images.h"
#include "engine/observe/scene_session.h"
#include "engine/observe/session_observations.h"
#include "engine/session/memory_session.h"
#include "models/registry.h"
#include "tests/engine/pinhole_board.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

TEST(LeftOutLines, GroupReasonsThatDifferInNumbersAlone) {
  const std::vector<LeftOut> items{
      {.where = "a.png marker 7", .reason = "corner 12: hidden", .frame = "a"},
      {.where = "b.png", .reason = "no target", .whole = true},
      {.where = "a.png marker 8", .reason = "corner 7: hidden", .frame = "a"},
      {.where = "c.png marker 1", .reason = "corner 100: hidden", .frame = "c"},
      {.where = "d.png", .reason = "no target", .whole = true},
      {.where = "e.png", .reason = "no target"},
      {.where = "f.png marker 1", .reason = "corner : hidden"},
      {.where = "g.png", .reason = "7 twice"},
      {.where = "g.png", .reason = "8 twice"},
      {.where = "h.png", .reason = "8 times"}};
  EXPECT_THAT(
      GroupedByReason(items),
      ElementsAre("left out 3 times in 2 images, the first a.png marker 7: corner 12: hidden",
                  "left out 2 images, the first b.png: no target",
                  "left out e.png: no target",
                  "left out f.png marker 1: corner : hidden",
                  "left out 2 times in 1 image, the first g.png: 7 twice",
                  "left out h.png: 8 times"));
  EXPECT_THAT(GroupedByReason({}), IsEmpty());
  std::vector<std::string> messages;
  plenocal::Run run;
  run.listener.message = [&](const std::string& line) { messages.push_back(line); };
  ReportLeftOut({items[1], items[5]}, run);
  EXPECT_THAT(messages, ElementsAre("  left out b.png: no target", "  left out e.png: no target"));
}

TEST(LeftOutTable, QuotesPlacesAndReasons) {
  EXPECT_EQ(LeftOutCsv({{.where = "a.png",
                         .reason = "is \"black\"",
                         .camera = "l,r",
                         .frame = "1",
                         .marker = "7"},
                        {.where = "b", .reason = "x"},
                        {.where = "\"c", .reason = "\"\"y"}}),
            "camera,frame,marker,where,reason\n\"l,r\",1,7,\"a.png\",\"is \"\"black\"\"\"\n"
            ",,,\"b\",\"x\"\n,,,\"\"\"c\",\"\"\"\"\"y\"\n");
}

MemoryCamera Small(const std::string& name) {
  MemoryCamera camera = PinholeBeforeBoard(1);
  camera.name = name;
  camera.views.resize(3);
  return camera;
}

struct Collected {
  SessionObservations observations;
  std::vector<std::string> messages;
};

Collected Collect(const Session& session) {
  Collected made;
  plenocal::Run run;
  run.listener.message = [&](const std::string& line) { made.messages.push_back(line); };
  made.observations = CollectObservations(session, TargetOfWord(kBoard), run, {});
  return made;
}

TEST(SessionObservations, PointsOfMemoryLoseWhatIsExcluded) {
  Session session = SessionInMemory(kBoard, {Small("left"), Small("right")});
  session.exclude = {{.camera = "left", .frame = "1"},
                     {.camera = "right", .frame = "2", .markers = {0, 5}},
                     {.frame = "never"}};
  const Collected made = Collect(session);
  ASSERT_EQ(made.observations.cameras.size(), 2U);
  const std::vector<View>& left = made.observations.cameras[0].views;
  ASSERT_EQ(left.size(), 2U);
  EXPECT_EQ(left[0].frame, "0");
  EXPECT_EQ(left[1].frame, "2");
  const std::vector<View>& right = made.observations.cameras[1].views;
  ASSERT_EQ(right.size(), 3U);
  EXPECT_EQ(right[2].observations.size(), 33U);
  EXPECT_EQ(made.observations.left_out.size(), 3U);
  EXPECT_EQ(made.observations.traits.size(), 2U);
  EXPECT_EQ(made.observations.blurs.size(), 2U);
  EXPECT_EQ(made.observations.sample_frames.size(), 2U);
  ASSERT_EQ(made.messages.size(), 5U);
  EXPECT_EQ(made.messages[0], "left: 2 frames, 70 points from memory");
  EXPECT_THAT(made.messages[1], ::testing::StartsWith("  left out left frame 1"));
  EXPECT_EQ(made.messages[2], "right: 3 frames, 103 points from memory");
  EXPECT_THAT(made.messages[3], ::testing::StartsWith("  left out 2 times in 1 image, the first "));
  EXPECT_THAT(made.messages[4],
              ::testing::StartsWith("exclude[2] (frame: never) leaves out nothing"));
}

TEST(SessionObservations, PointsOfFilesHaveTheTimesOfTheirFrames) {
  const TemporaryFolder folder;
  Session session = SessionInMemory(kBoard, {Small("left")});
  SessionCamera& camera = session.cameras[0];
  camera.detections =
      folder.Write("detections_left.csv", DetectionsCsv(camera.given_views, *camera.model));
  camera.given_views.clear();
  camera.times = folder.Write("times.txt", "0 1.5\n1 2.5\n2 4\n");
  const Collected made = Collect(session);
  EXPECT_THAT(made.messages,
              ElementsAre("left: 3 frames, 105 points from " + camera.detections.string()));
  const std::map<std::string, double> times{{"0", 1.5}, {"1", 2.5}, {"2", 4}};
  EXPECT_EQ(made.observations.cameras[0].times, times);
}

TEST(SessionObservations, AreWrittenUnlessTheyWereReadThere) {
  const TemporaryFolder folder;
  Session session = SessionInMemory(kBoard, {Small("left"), Small("right")});
  SessionObservations observations = Collect(session).observations;
  observations.files = {{0, "frames", "chosen_frames.csv", "table"}};
  const std::string left = DetectionsCsv(observations.cameras[0].views, *session.cameras[0].model);
  session.cameras[1].detections = folder.Write("results/detections_right.csv", "given");
  {
    OutputFolder out(folder / "results");
    WriteDetections(session, observations, folder / "results", &out);
    out.Commit();
  }
  EXPECT_EQ(folder.Read("results/detections_left.csv"), left);
  EXPECT_EQ(folder.Read("results/detections_right.csv"), "given");
  EXPECT_EQ(folder.Read("results/chosen_frames.csv"), "table");
  {
    OutputFolder out(folder / "other");
    WriteDetections(session, observations, folder / "other", &out);
    out.Commit();
  }
  EXPECT_EQ(folder.Read("other/detections_right.csv"), left);
}

TEST(AutomaticChoice, IsTheUsualOfTooFewFrames) {
  const Target target = TargetOfWord(kBoard);
  Session session = SessionInMemory(kBoard, {Small("left"), Small("right")});
  for (SessionCamera& camera : session.cameras) camera.auto_model = false;
  session.auto_refine = false;
  SessionObservations observations = Collect(session).observations;
  const auto choose = [&] { return ChooseByHeldOutFrames(target, {}, &session, &observations); };
  EXPECT_FALSE(choose());

  session.cameras[1].auto_model = true;
  std::optional<Finding> note = choose();
  ASSERT_TRUE(note);
  EXPECT_EQ(note->code, "automatic_choice");
  EXPECT_EQ(note->grade, Grade::kGood);
  EXPECT_THAT(note->cameras, ElementsAre("right"));
  EXPECT_EQ(note->what,
            "3 frames are too few to choose by: camera model pinhole-radtan taken; record 4 or "
            "more.");
  EXPECT_EQ(note->remedy, "To keep this choice, state it in the session: right: {model: pinhole}.");
  EXPECT_FALSE(session.cameras[1].auto_model);

  session.auto_refine = true;
  note = choose();
  ASSERT_TRUE(note);
  EXPECT_THAT(note->cameras, IsEmpty());
  EXPECT_EQ(note->what,
            "3 frames are too few to choose by: a rigid target taken; record 4 or more.");
  EXPECT_EQ(note->remedy, "To keep this choice, state it in the session: refine_target: false.");
  EXPECT_FALSE(session.auto_refine);
  EXPECT_EQ(session.refine_target, false);

  // A target with a stated tolerance is not chosen.
  Target stated = target;
  stated.tolerance = 1e-3;
  session.auto_refine = true;
  EXPECT_FALSE(ChooseByHeldOutFrames(stated, {}, &session, &observations));
  EXPECT_FALSE(session.auto_refine);
}

TEST(SceneSessions, HaveImagesOrTracksInAllCameras) {
  Session session;
  session.path = "s.yaml";
  session.cameras.resize(2);
  session.cameras[0].name = "left";
  session.cameras[1].name = "right";
  EXPECT_FALSE(FollowsImages(session));
  session.cameras[1].images = {"*.png"};
  EXPECT_EQ(
      Refusal([&] { FollowsImages(session); }),
      "input: s.yaml: cameras.right has images, other cameras have tracks, whose numbers mean "
      "other points; give all cameras images or all 'detections'");
  session.cameras[0].given_images.resize(1);
  EXPECT_TRUE(FollowsImages(session));
}

TEST(SceneSessions, HaveNoJackknife) {
  Session session;
  session.path = "s.yaml";
  EXPECT_EQ(Refusal([&] { CheckSceneSession(session, true); }),
            "input: s.yaml: --jackknife needs a target: scene points are seen in few frames each; "
            "leave the option out");
  EXPECT_EQ(Refusal([&] { CheckSceneSession(session, false); }), "");
}

TEST(SceneSessions, GiveTheirKeysToTheCalibration) {
  Session session = SessionInMemory(kBoard, {Small("left")});
  session.loss = Loss::kNone;
  session.scene.emplace();
  const YamlNode node = YamlNode::Parse("a: 1", "s.yaml");
  for (const double length : {2, 3}) {
    session.scene->distances.push_back({.a = {}, .b = {}, .length = length, .place = node});
  }
  session.scene->tags = SceneTags{.ids = {4}, .node = node};
  const SceneCalibrationInput input =
      MakeSceneInput(session, Collect(session).observations.cameras);
  ASSERT_EQ(input.cameras.inputs.size(), 1U);
  EXPECT_EQ(input.cameras.inputs[0].name, "left");
  ASSERT_EQ(input.distances.size(), 2U);
  EXPECT_EQ(input.distances[1].length, 3);
  EXPECT_THAT(input.tags.value().ids, ElementsAre(4));
  EXPECT_EQ(input.loss, Loss::kNone);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
