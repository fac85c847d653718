// SPDX-License-Identifier: Apache-2.0
#include "assess/target/frame_choice.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <numeric>
#include <string>
#include <vector>

namespace plenocal {
namespace TEST_FILE {

std::string Frame(int index) { return fmt::format("{:04}", index); }

// The second camera has the frames of even number.
std::vector<CameraInput> Cameras(int frames) {
  std::vector<CameraInput> cameras(2);
  for (int f = 0; f < frames; ++f) {
    cameras[0].views.push_back({.frame = Frame(f), .observations = {}});
    if (f % 2 == 0) cameras[1].views.push_back({.frame = Frame(f), .observations = {}});
  }
  return cameras;
}

std::vector<std::string> FramesOf(const CameraInput& camera) {
  std::vector<std::string> frames;
  for (const View& view : camera.views) frames.push_back(view.frame);
  return frames;
}

std::vector<std::string> Every(int step, int frames) {
  std::vector<std::string> names;
  for (int f = 0; f < frames; f += step) names.push_back(Frame(f));
  return names;
}

TEST(ChooseFrames, AreAtMostSixtyEvenlySpaced) {
  struct Case {
    int frames, step;
  };
  for (const auto& [frames, step] :
       {Case{0, 1}, {1, 1}, {60, 1}, {61, 2}, {120, 2}, {121, 3}, {180, 3}, {181, 4}}) {
    const std::vector<CameraInput> few = ChooseFrames(Cameras(frames));
    EXPECT_EQ(FramesOf(few[0]), Every(step, frames)) << frames;
    EXPECT_EQ(FramesOf(few[1]), Every(std::lcm(step, 2), frames)) << frames;
  }
}

// Every number is computed from the frame and the camera to which it belongs.
Calibration WithFrames(int frames) {
  Calibration calibration;
  Bundle& bundle = calibration.bundle;
  bundle.cameras.resize(2);
  bundle.markers.resize(3);
  calibration.fits.resize(2);
  calibration.converged = true;
  calibration.rejection_threshold = 4.5;
  bundle.jitter.translation_sigma = 0.001;
  for (int f = 0; f < frames; ++f) {
    calibration.frames.push_back(Frame(f));
    bundle.T_rig_target.emplace_back().t.z() = f;
    for (int c = 0; c < 2; ++c) {
      bundle.jitter.delta.push_back(Vector6d::Constant(10 * f + c));
      bundle.jitter.misplaced.push_back((f + c) % 3 == 0);
      bundle.motion.push_back({.velocity = Vector6d::Constant(-10 * f - c)});
      BundleObservation& seen = bundle.observations.emplace_back();
      seen.camera = c;
      seen.frame = f;
      seen.marker = f % 3;
      seen.used = f % 5 != 0;
    }
  }
  return calibration;
}

TEST(ChooseFrames, OfACalibrationKeepWhatBelongsToThem) {
  const Calibration few = ChooseFrames(WithFrames(150));
  ASSERT_EQ(few.frames, Every(3, 150));
  EXPECT_TRUE(few.converged);
  EXPECT_EQ(few.rejection_threshold, 4.5);
  EXPECT_EQ(few.fits.size(), 2);
  const Bundle& bundle = few.bundle;
  EXPECT_EQ(bundle.cameras.size(), 2);
  EXPECT_EQ(bundle.markers.size(), 3);
  EXPECT_EQ(bundle.jitter.translation_sigma, 0.001);
  ASSERT_EQ(bundle.T_rig_target.size(), 50);
  ASSERT_EQ(bundle.jitter.delta.size(), 100);
  ASSERT_EQ(bundle.jitter.misplaced.size(), 100);
  ASSERT_EQ(bundle.motion.size(), 100);
  ASSERT_EQ(bundle.observations.size(), 100);
  for (size_t f = 0; f < 50; ++f) {
    const int before = 3 * static_cast<int>(f);
    EXPECT_EQ(bundle.T_rig_target[f].t.z(), before);
    for (size_t c = 0; c < 2; ++c) {
      const int camera = static_cast<int>(c);
      const size_t view = bundle.View(f, c);
      EXPECT_EQ(bundle.jitter.delta[view][3], 10 * before + camera);
      EXPECT_EQ(bundle.jitter.misplaced[view], (before + camera) % 3 == 0);
      EXPECT_EQ(bundle.motion[view].velocity[2], -10 * before - camera);
      const BundleObservation& seen = bundle.observations[view];
      EXPECT_EQ(seen.camera, camera);
      EXPECT_EQ(seen.frame, static_cast<int>(f));
      EXPECT_EQ(seen.marker, before % 3);
      EXPECT_EQ(seen.used, before % 5 != 0);
    }
  }
}

TEST(ChooseFrames, OfACalibrationOfSixtyAreAllAndOfOneWithoutJitterHaveNone) {
  EXPECT_EQ(ChooseFrames(WithFrames(60)).frames.size(), 60);
  Calibration plain = WithFrames(61);
  plain.bundle.jitter = {};
  plain.bundle.motion.clear();
  const Calibration few = ChooseFrames(plain);
  EXPECT_EQ(few.frames, Every(2, 61));
  EXPECT_TRUE(few.bundle.jitter.delta.empty());
  EXPECT_TRUE(few.bundle.jitter.misplaced.empty());
  EXPECT_TRUE(few.bundle.motion.empty());
}

// Of the markers with numbers from 1000 on, those of even index have an observation in each frame.
Calibration WithMarkers(int markers) {
  Calibration calibration = WithFrames(2);
  Bundle& bundle = calibration.bundle;
  bundle.markers.clear();
  bundle.observations.clear();
  for (int m = 0; m < markers; ++m) {
    const Eigen::Vector3d position(m, 0, 0), nominal(m, 1, 0);
    bundle.markers.push_back({.number = 1000 + m, .position = position, .nominal = nominal});
  }
  for (int f = 0; f < 2; ++f) {
    for (int m = 0; m < markers; m += 2) {
      BundleObservation& seen = bundle.observations.emplace_back();
      seen.frame = f;
      seen.marker = m;
    }
  }
  return calibration;
}

TEST(ChooseMarkers, AreAtMostFiveHundredOfTheObservedOnes) {
  struct Case {
    int markers, step, chosen;
  };
  for (const auto& [markers, step, chosen] :
       {Case{502, 2, 251}, {1000, 2, 500}, {1002, 4, 251}, {2002, 6, 334}}) {
    const Bundle bundle = ChooseMarkers(WithMarkers(markers)).bundle;
    ASSERT_EQ(bundle.markers.size(), chosen) << markers;
    for (int i = 0; i < chosen; ++i) {
      const BundleMarker& marker = bundle.markers[static_cast<size_t>(i)];
      EXPECT_EQ(marker.number, 1000 + step * i);
      EXPECT_EQ(marker.position.x(), step * i);
      EXPECT_EQ(marker.nominal.y(), 1);
    }
    ASSERT_EQ(bundle.observations.size(), 2 * chosen);
    for (int o = 0; o < 2 * chosen; ++o) {
      const BundleObservation& seen = bundle.observations[static_cast<size_t>(o)];
      EXPECT_EQ(seen.marker, o % chosen);
      EXPECT_EQ(seen.frame, o / chosen);
    }
  }
}

TEST(ChooseMarkers, AreAllOfATargetOfFiveHundred) {
  const Bundle bundle = ChooseMarkers(WithMarkers(500)).bundle;
  EXPECT_EQ(bundle.markers.size(), 500);
  EXPECT_EQ(bundle.observations.size(), 500);
}

}  // namespace TEST_FILE
}  // namespace plenocal
