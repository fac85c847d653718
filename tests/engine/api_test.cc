// SPDX-License-Identifier: Apache-2.0
//
// The engine as other programs call it.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <future>
#include <stdexcept>
#include <string>
#include <vector>

#include "engine/api/plenocal/engine.h"
#include "tests/engine/pinhole_board.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;
using EngineRun = plenocal::Run;  // GoogleTest has a function of this name

api::Session SessionOf(unsigned seed, const std::string& model = "pinhole", double focal = kFocal) {
  const MemoryCamera camera = PinholeBeforeBoard(seed, focal);
  api::Source source{.name = camera.name, .model = model, .width = 640, .height = 480};
  for (const View& view : camera.views) {
    api::FramePoints& frame = source.points.emplace_back();
    frame.frame = view.frame;
    for (const Observation& seen : view.observations) {
      frame.points.push_back({seen.marker, seen.values[0], seen.values[1], seen.detector_sigma});
    }
  }
  return api::Session::InMemory(kBoard, {source});
}

TEST(TheEngineForPrograms, CalibratesAndProjects) {
  const api::Calibration found = api::CalibrateSession(SessionOf(1));
  const api::Parameter f_x = found["left"].parameters().at(0);
  EXPECT_LT(std::abs(f_x.value - kFocal), 4 * f_x.sigma);
  EXPECT_THAT(found.summary, HasSubstr("verdict"));
  const auto pixel = found["left"].Project({0, 0, 1});
  ASSERT_TRUE(pixel);
  EXPECT_NEAR((*pixel)[0], 320, 5);
  EXPECT_THROW((void)found["right"], Error);
}

TEST(TheEngineForPrograms, GivesThePointsOfASessionAsSourcesOfAnother) {
  const std::vector<api::Source> sources = api::DetectSession(SessionOf(1));
  ASSERT_THAT(sources, SizeIs(1));
  EXPECT_THAT(sources[0].points, SizeIs(10));
  const api::Session again = api::Session::InMemory(kBoard, sources);
  EXPECT_EQ(api::CalibrateSession(again).yaml, api::CalibrateSession(SessionOf(1)).yaml);
}

TEST(TheEngineForPrograms, TriesModelsOfASessionThatNamesNone) {
  const std::vector<api::TriedModel> tried =
      api::TrySession(SessionOf(1, ""), {"pinhole", "pinhole-radtan4"});
  ASSERT_THAT(tried, SizeIs(2));
  const auto& recommended = tried[tried[0].recommended ? 0 : 1];
  EXPECT_EQ(recommended.model, "pinhole");
  EXPECT_NEAR(recommended.held_out_rms, 0.1 * std::sqrt(2.0), 0.03);
}

TEST(TheEngineForPrograms, ChecksACalibrationWithNewImages) {
  const api::Calibration calibration = api::CalibrateSession(SessionOf(1));
  const api::Check same = api::CheckSession(calibration, SessionOf(2));
  EXPECT_TRUE(same.valid);
  ASSERT_THAT(same.cameras, SizeIs(1));
  EXPECT_LT(same.cameras[0].rms, 1.5 * same.cameras[0].expected);
  const api::Check zoomed = api::CheckSession(calibration, SessionOf(2, "pinhole", 1.05 * kFocal));
  EXPECT_FALSE(zoomed.valid);
  EXPECT_EQ(zoomed.findings.at(0).code, "parameters_changed");
}

TEST(TheEngineForPrograms, ComparesCalibrations) {
  const api::Calibration a = api::CalibrateSession(SessionOf(1));
  for (const api::Difference& at : api::CompareCalibrations(a, a)) {
    EXPECT_LT(at.largest, 1e-9) << at.distance;
  }
  const api::Calibration b = api::CalibrateSession(SessionOf(2, "pinhole", 1.05 * kFocal));
  const std::vector<api::Difference> differences = api::CompareCalibrations(a, b);
  ASSERT_THAT(differences, SizeIs(2));
  EXPECT_TRUE(std::ranges::any_of(differences, &api::Difference::differs));
  EXPECT_GT(differences[0].rms, differences[0].predicted);
  EXPECT_THROW(api::CompareCalibrations(a, b, {-1}), Error);
}

TEST(TheEngineForPrograms, SuggestsViewsThatLowerSigma) {
  const api::Calibration calibration = api::CalibrateSession(SessionOf(1));
  const std::vector<api::SuggestedView> views =
      api::SuggestViews(calibration, {.count = 1, .goal = 1e-6});
  ASSERT_THAT(views, SizeIs(1));
  EXPECT_EQ(views[0].camera, "left");
  EXPECT_LT(views[0].sigma_after, views[0].sigma_before);
  EXPECT_GT(views[0].T_camera_target[11], 0);  // before the camera
  EXPECT_THROW(api::SuggestViews(calibration, {.count = 0}), Error);
}

TEST(TheEngineForPrograms, RefusesACalibrationThatHoldsNothing) {
  const api::Calibration nothing;
  EXPECT_THROW(api::CheckSession(nothing, SessionOf(1)), Error);
  EXPECT_THROW(api::CompareCalibrations(nothing, nothing), Error);
  EXPECT_THROW(api::SuggestViews(nothing), Error);
  EXPECT_THROW(api::LocateImages(nothing, "", kBoard, {}), Error);
}

TEST(TheEngineForPrograms, RefusesAViewOfMemoryByName) {
  const std::vector<std::uint8_t> pixels(640 * 480);
  const api::Image image{
      .frame = "07", .data = pixels.data(), .width = 640, .height = 480, .stride = 600};
  const auto refusal = [](const auto& call) -> std::string { return RefusalOf([&] { call(); }); };
  EXPECT_THAT(
      refusal([&] { (void)api::Session::InMemory(kBoard, {{.name = "left", .images = {image}}}); }),
      HasSubstr("left: frame 07: the stride of 600 bytes is shorter than a row of 640"));
  const api::Calibration calibration = api::CalibrateSession(SessionOf(1));
  EXPECT_THAT(refusal([&] { (void)api::LocateImages(calibration, "left", kBoard, {image}); }),
              HasSubstr("left: frame 07: the stride of 600 bytes"));
}

TEST(TheEngineForPrograms, EndsARunAloneAtAnExceptionOfItsListener) {
  EngineRun run;
  run.listener.progress = [](const std::string&, size_t, size_t) {
    throw std::domain_error("of the listener");
  };
  auto other = std::async(std::launch::async, [] { return api::CalibrateSession(SessionOf(2)); });
  EXPECT_THROW(api::CalibrateSession(SessionOf(1), {}, run), std::domain_error);
  EXPECT_THROW(api::TrySession(SessionOf(1), {}, run), std::domain_error);
  EXPECT_EQ(other.get().yaml, api::CalibrateSession(SessionOf(2)).yaml);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
