// SPDX-License-Identifier: Apache-2.0
//
// Calibrations of sessions in memory, several at once.
#include "engine/calibrate_session.h"

#include <gmock/gmock.h>

#include <cmath>
#include <filesystem>
#include <future>
#include <stdexcept>
#include <stop_token>
#include <string>
#include <vector>

#include "calib/base/error.h"
#include "calib/files/calibration_file.h"
#include "engine/detect_session.h"
#include "engine/session/memory_session.h"
#include "tests/engine/pinhole_board.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
using EngineRun = plenocal::Run;  // GoogleTest has a function of this name

CalibrateRequest RequestOf(unsigned seed) {
  CalibrateRequest request;
  request.session = SessionInMemory(kBoard, {PinholeBeforeBoard(seed)});
  return request;
}

std::string YamlOf(unsigned seed, const Run& run) {
  return CalibrationYaml(CalibrateSession(RequestOf(seed), run).record);
}

TEST(CalibrateSessions, InMemoryFindTheCameraAndWriteNothing) {
  const auto before = std::filesystem::directory_iterator(std::filesystem::current_path());
  const auto files = std::distance(begin(before), end(before));
  const SessionCalibration found = CalibrateSession(RequestOf(1), {});
  const CalibratedCamera& camera = found.record.cameras.at(0);
  EXPECT_LT(std::abs(camera.params[0] - kFocal), 4 * camera.Sigma(0));
  EXPECT_LT(camera.Sigma(0), 2);
  EXPECT_EQ(found.folders->out(), nullptr);
  const auto after = std::filesystem::directory_iterator(std::filesystem::current_path());
  EXPECT_EQ(std::distance(begin(after), end(after)), files);
}

TEST(CalibrateSessions, KeepStatedModelsWhateverIsAskedForTheOthers) {
  CalibrateRequest request = RequestOf(1);
  ASSERT_FALSE(request.session->cameras[0].auto_model);
  const CameraModel* stated = request.session->cameras[0].model;
  ASSERT_NE(stated->name, "pinhole-radtan");
  request.model = "pinhole-radtan";
  EXPECT_EQ(CalibrateSession(request, {}).record.cameras[0].model, stated);
  request.session->cameras[0].auto_model = true;
  EXPECT_EQ(CalibrateSession(request, {}).record.cameras[0].model->name, "pinhole-radtan");
}

TEST(CalibrateSessions, OfImagesWithoutAFolderIgnoreSessionsInTheWorkingFolder) {
  const std::filesystem::path before = std::filesystem::current_path();
  const testing::TemporaryFolder folder;
  folder.Write("session.yaml", "another's\n");
  std::filesystem::current_path(folder.Path());
  CalibrateRequest request;
  request.images.images = {"none.png"};
  request.images.target = kBoard;
  const std::string message = RefusalOf([&] { CalibrateSession(request, {}); });
  std::filesystem::current_path(before);
  EXPECT_THAT(message, HasSubstr("none.png"));
}

TEST(CalibrateSessions, SideBySideGiveTheBytesOfOneAfterTheOther) {
  std::vector<std::future<std::string>> at_once;
  for (unsigned seed = 1; seed <= 3; ++seed) {
    at_once.push_back(std::async(std::launch::async, YamlOf, seed, EngineRun{}));
  }
  for (unsigned seed = 1; seed <= 3; ++seed) EXPECT_EQ(at_once[seed - 1].get(), YamlOf(seed, {}));
}

TEST(CalibrateSessions, AreStoppedEachByItself) {
  std::stop_source stop;
  EngineRun stopped{.stop = stop.get_token()};
  stopped.listener.progress = [&](const std::string&, size_t, size_t) { stop.request_stop(); };
  auto other = std::async(std::launch::async, YamlOf, 2, EngineRun{});
  EXPECT_THROW(YamlOf(1, stopped), Stopped);
  EXPECT_THAT(other.get(), HasSubstr("f_x"));
}

TEST(CalibrateSessions, EndAtAnExceptionOfTheirListener) {
  EngineRun run;
  run.listener.progress = [](const std::string&, size_t, size_t) {
    throw std::domain_error("of the listener");
  };
  auto other = std::async(std::launch::async, YamlOf, 2, EngineRun{});
  EXPECT_THROW(YamlOf(1, run), std::domain_error);
  EXPECT_THAT(other.get(), HasSubstr("f_x"));
}

std::string RefusalOfCameras(const std::vector<MemoryCamera>& cameras) {
  return RefusalOf([&] { SessionInMemory(kBoard, cameras); });
}

TEST(SessionsInMemory, NeedNoModelForAShardOfTheirImages) {
  const std::vector<std::uint8_t> pixels(640 * 480);
  const PixelView black{.data = pixels.data(), .size = {640, 480}, .stride = 640};
  const testing::TemporaryFolder folder;
  SessionOptions options;
  options.out = folder / "out";
  options.cache = folder / "cache";
  DetectShard(
      SessionInMemory(kBoard, {{.name = "left", .images = {{"07", black}}}}), options, {}, {});
  EXPECT_TRUE(std::filesystem::exists(folder / "out/shard.csv"));
}

TEST(SessionsInMemory, RefuseViewsOfMemoryByName) {
  const std::vector<std::uint8_t> pixels(640 * 480);
  const PixelView good{.data = pixels.data(), .size = {640, 480}, .stride = 640};
  const auto refusal = [](const PixelView& view) {
    return RefusalOfCameras({{.name = "left", .images = {{"07", view}}}});
  };
  EXPECT_EQ(refusal(good), "no refusal");
  PixelView view = good;
  view.stride = 639;
  EXPECT_THAT(refusal(view),
              HasSubstr("left: frame 07: the stride of 639 bytes is shorter than a row of 640"));
  view = good;
  view.size = {640, 0};
  EXPECT_THAT(refusal(view), HasSubstr("left: frame 07: expected a positive size, found 640 x 0"));
  view = good;
  view.channels = 2;
  EXPECT_THAT(refusal(view), HasSubstr("expected 1 or 3 channels, found 2"));
  view = good;
  view.data = nullptr;
  EXPECT_THAT(refusal(view), HasSubstr("without pixels"));
  const MemoryCamera camera{.name = "left", .images = {{"07", good}}};
  EXPECT_THAT(RefusalOfCameras({camera, camera}), HasSubstr("camera left is given twice"));
  EXPECT_THAT(RefusalOfCameras({{.name = "left"}}), HasSubstr("give either images or points"));
  EXPECT_THAT(RefusalOfCameras({{.name = "../left", .images = {{"07", good}}}}),
              HasSubstr("camera ../left: the name"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
