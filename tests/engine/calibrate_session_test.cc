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
#include "calib/camera/rigid_transform.h"
#include "calib/files/calibration_file.h"
#include "engine/session/memory_session.h"
#include "models/registry.h"
#include "targets/target.h"
#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
using EngineRun = plenocal::Run;  // GoogleTest has a function of this name

constexpr const char* kBoard = "chessboard:7x5:40mm";
constexpr double kFocal = 600;  // px

// A pinhole camera of 640 x 480 px before a board, as points with noise of 0.1 px.
MemoryCamera PinholeBeforeBoard(unsigned seed) {
  Random random(seed);
  MemoryCamera camera{
      .name = "left", .model = FindModel(CameraModels(), "pinhole"), .image_size = {640, 480}};
  const Target board = TargetOfWord(kBoard);
  for (int frame = 0; frame < 10; ++frame) {
    const Eigen::Vector3d w(
        random.Uniform(-0.5, 0.5), random.Uniform(-0.5, 0.5), random.Uniform(-0.3, 0.3));
    const RigidTransform T_camera_target{ExpRotation(w), {-0.12, -0.08, random.Uniform(0.4, 0.6)}};
    View view{.frame = std::to_string(frame), .observations = {}};
    for (const auto& [marker, position] : board.markers) {
      const Eigen::Vector3d p = T_camera_target * position;
      Observation& seen = view.observations.emplace_back();
      seen.marker = marker;
      seen.values[0] = 320 + kFocal * p.x() / p.z() + random.Gaussian(0.1);
      seen.values[1] = 240 + kFocal * p.y() / p.z() + random.Gaussian(0.1);
      seen.detector_sigma = 0.1;
    }
    camera.views.push_back(std::move(view));
  }
  return camera;
}

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

std::string RefusalOf(const std::vector<MemoryCamera>& cameras) {
  try {
    SessionInMemory(kBoard, cameras);
  } catch (const Error& error) {
    return error.what();
  }
  return "accepted";
}

TEST(SessionsInMemory, RefuseViewsOfMemoryByName) {
  const std::vector<std::uint8_t> pixels(640 * 480);
  const PixelView good{.data = pixels.data(), .size = {640, 480}, .stride = 640};
  const auto refusal = [](const PixelView& view) {
    return RefusalOf({{.name = "left", .images = {{"07", view}}}});
  };
  EXPECT_EQ(refusal(good), "accepted");
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
  EXPECT_THAT(RefusalOf({camera, camera}), HasSubstr("camera left is given twice"));
  EXPECT_THAT(RefusalOf({{.name = "left"}}), HasSubstr("give either images or points"));
  EXPECT_THAT(RefusalOf({{.name = "../left", .images = {{"07", good}}}}),
              HasSubstr("camera ../left: the name"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
