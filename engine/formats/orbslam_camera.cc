// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/orbslam_camera.h"

#include <fmt/format.h>

#include "engine/formats/exact_numbers.h"

namespace plenocal {
namespace {

LensTable PinHoleLenses(std::string_view tool) {
  return {.tool = tool,
          .forms = {{"pinhole", "PinHole", "0 0 0 0 0"},
                    {"pinhole-radial3", "PinHole", "A_0 A_1 0 0 A_2"},
                    {"pinhole-radtan4", "PinHole", "k_1 k_2 p_1 p_2 0"},
                    {"pinhole-radtan", "PinHole", "k_1 k_2 p_1 p_2 k_3"}},
          .coefficient_keys = {{"PinHole", "k1 k2 p1 p2 k3"}, {"KannalaBrandt8", "k1 k2 k3 k4"}},
          .may_lack_coefficients = true};
}

}  // namespace

const LensTable& OrbSlam2Lenses() {
  static const LensTable kTable = PinHoleLenses("orbslam2");
  return kTable;
}

const LensTable& OrbSlam3Lenses() {
  static const LensTable kTable = [] {
    LensTable table = PinHoleLenses("orbslam3");
    table.forms.emplace_back("kannala-brandt4", "KannalaBrandt8", "k_1 k_2 k_3 k_4");
    return table;
  }();
  return kTable;
}

std::string OrbSlamCamera(const std::string& prefix, const Lens& lens) {
  std::string text;
  for (const auto& [key, value] : lens.Entries(OrbSlam3Lenses())) {
    text += fmt::format("{}.{}: {}\n", prefix, key, RealText(value));
  }
  return text + "\n";
}

std::string OrbSlamImages(const CalibratedCamera& camera) {
  return fmt::format(
             "Camera.width: {}\nCamera.height: {}\n", camera.image_size[0], camera.image_size[1]) +
         "# A calibration does not know these two.\nCamera.fps: 30\nCamera.RGB: 1\n";
}

ImageSize ReadOrbSlamSize(const YamlNode& root, const CameraSource& source) {
  if (root.Has("Camera.width") && root.Has("Camera.height")) {
    return {root.At("Camera.width").AsInteger(), root.At("Camera.height").AsInteger()};
  }
  if (source.image_size) return *source.image_size;
  root.Fail("holds no 'Camera.width' and 'Camera.height'; give --size WIDTHxHEIGHT");
}

}  // namespace plenocal
