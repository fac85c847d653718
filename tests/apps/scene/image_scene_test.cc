// SPDX-License-Identifier: Apache-2.0
//
// Scene points followed through rendered images of a stereo pair and a plenoptic camera.
#include <sstream>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;

constexpr const char* kSpecification = R"(plenocal: 1
seed: 4
scene: {points: 50, near: 0.35, far: 0.9}
trajectory: {kind: loop, length: 3, speed: 0.1, rate: 10, segment: 3, frames: 8, winding: {amplitude: 0.1, seconds: 3}}
cameras:
  left:
    model: pinhole-radial3
    image_size: [320, 256]
    parameters: {f_x: 410, f_y: 411, c_x: 158, c_y: 129, A_0: -0.1, A_1: 0.03, A_2: 0}
    blur: 0.6
  right:
    model: pinhole-radial3
    image_size: [320, 256]
    parameters: {f_x: 405, f_y: 404, c_x: 161, c_y: 125, A_0: -0.1, A_1: 0.03, A_2: 0}
    xi_camera_rig: [-0.05, 0.001, -0.002, 0.005, -0.02, 0.01]
    blur: 0.6
  plenoptic:
    model: focused-plenoptic
    image_size: [300, 300]
    pixel_size: 7.4e-6
    parameters: {f_L: 0.0122, b_L0: 0.01166, B: 0.00026, c_x: 151, c_y: 148, A_0: 0, A_1: 0, B_0: 0, B_1: 0}
    xi_camera_rig: [-0.03, 0.02, -0.008, -0.01, 0.01, 0.005]
    blur: 0.35
    micro_lenses: {pitch: 19, rotation: 0.006, focus: [2.4, 3.0, 3.9], aperture: 0.7, fill: 0.92}
)";

class ImageScene : public Workspace {
 protected:
  void Simulate() {
    Write("spec.yaml", kSpecification);
    const Outcome outcome = Run({"simulate", "spec.yaml", "-o", "set"});
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
  }
  Outcome Calibrate(const std::string& session) {
    Write("session.yaml", session);
    return Run({"calibrate", "session.yaml", "--no-report", "-o", "out"});
  }
};

TEST_F(ImageScene, OfAStereoPairAndRawPlenopticImagesIsARecalibration) {
  Simulate();
  Outcome outcome = Calibrate(
      "plenocal: 1\nscene: {points: 300}\nfrom: set/calibration.yaml\ncameras:\n"
      "  left: {model: pinhole-radial3, images: 'set/left/0000*.png'}\n"
      "  right: {model: pinhole-radial3, images: 'set/right/0000*.png'}\n"
      "  plenoptic: {model: focused-plenoptic, images: 'set/plenoptic/0000*.png',\n"
      "    white_images: 'set/plenoptic_white/*.png', pixel_size: 7.4e-6}\n");
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const YAML::Node cameras = YAML::Load(Read("out/calibration.yaml"))["cameras"];
  const auto value = [&](const char* camera, const char* name) {
    return cameras[camera]["parameters"][name].as<double>();
  };
  EXPECT_NEAR(value("left", "f_x"), 410, 0.4);
  EXPECT_NEAR(value("plenoptic", "f_L"), 0.0122, 0.003 * 0.0122);
  EXPECT_NEAR(value("plenoptic", "B"), 0.00026, 0.02 * 0.00026);
  EXPECT_LT(cameras["plenoptic"]["residuals"]["rms"].as<double>(), 0.2);
  EXPECT_TRUE(Files("out").contains("micro_lenses_plenoptic.csv"));
  EXPECT_TRUE(Files("out").contains("detections_plenoptic.csv"));
  EXPECT_THAT(outcome.out, HasSubstr("scene_patches"));

  // A raw image, in the frame of the points that the recording's loop has mapped.
  const std::string calibration = "set/truth/calibration.yaml";
  outcome =
      Run({"groundtruth", "set", "--calibration", calibration, "--points", "300", "-o", "loop"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  std::vector<std::string> locate{"locate",
                                  calibration,
                                  "loop/points.csv",
                                  "set/plenoptic/000012.png",
                                  "--camera",
                                  "plenoptic"};
  outcome = Run(locate);
  EXPECT_EQ(outcome.status, kWrongInput);
  EXPECT_THAT(outcome.err, HasSubstr("--white"));
  locate.insert(locate.end(), {"--white", "set/plenoptic_white/*.png", "-o", "poses.csv"});
  outcome = Run(locate);
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  std::istringstream row(Lines(Read("loop/segments_plenoptic.txt"))[4]);
  double time = 0, x = 0, y = 0, z = 0;
  row >> time >> x >> y >> z;
  EXPECT_NEAR(time, 1.2, 1e-6);
  const Table poses(Read("poses.csv"));
  EXPECT_NEAR(poses.Numbers("x")[0], x, 0.005);
  EXPECT_NEAR(poses.Numbers("y")[0], y, 0.005);
  EXPECT_NEAR(poses.Numbers("z")[0], z, 0.005);

  // What cannot be followed is refused, and the earlier result stays.
  const std::string before = Read("out/calibration.yaml");
  const std::string plenoptic =
      "plenocal: 1\nscene: {points: 300}\nfrom: set/calibration.yaml\ncameras:\n"
      "  plenoptic: {model: focused-plenoptic, images: 'set/plenoptic/0000*.png', pixel_size: 7.4e-6}\n";
  outcome = Calibrate(plenoptic);
  EXPECT_EQ(outcome.status, kWrongInput);
  EXPECT_THAT(outcome.err, HasSubstr("white_images"));
  outcome = Calibrate(
      "plenocal: 1\nscene: {points: 300}\ncameras:\n"
      "  left: {model: pinhole-radial3, images: 'set/left/0000*.png'}\n"
      "  right: {model: pinhole-radial3, image_size: [320, 256], detections: tracks.csv}\n");
  EXPECT_EQ(outcome.status, kWrongInput);
  EXPECT_THAT(outcome.err, HasSubstr("all cameras images or all 'detections'"));
  EXPECT_EQ(Read("out/calibration.yaml"), before);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
