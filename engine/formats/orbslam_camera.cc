// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/orbslam_camera.h"

#include <fmt/format.h>

#include "engine/formats/exact_numbers.h"

namespace plenocal {
namespace {

std::vector<std::string_view> OrbSlamNames(const std::string& type) {
  if (type == "PinHole") return {"k1", "k2", "p1", "p2", "k3"};
  return {"k1", "k2", "k3", "k4"};
}

}  // namespace

std::span<const LensForm> OrbSlamLenses() {
  static const std::vector<LensForm> kForms{
      {"pinhole", "PinHole", {"0", "0", "0", "0", "0"}},
      {"pinhole-radial3", "PinHole", {"A_0", "A_1", "0", "0", "A_2"}},
      {"pinhole-radtan4", "PinHole", {"k_1", "k_2", "p_1", "p_2", "0"}},
      {"pinhole-radtan", "PinHole", {"k_1", "k_2", "p_1", "p_2", "k_3"}},
      {"kannala-brandt4", "KannalaBrandt8", {"k_1", "k_2", "k_3", "k_4"}}};
  return kForms;
}

std::string OrbSlamCamera(const std::string& prefix, const Lens& lens) {
  std::string text;
  const auto add = [&](std::string_view name, double value) {
    text += fmt::format("{}.{}: {}\n", prefix, name, RealText(value));
  };
  add("fx", lens.f_x);
  add("fy", lens.f_y);
  add("cx", lens.c_x);
  add("cy", lens.c_y);
  const std::vector<std::string_view> names = OrbSlamNames(lens.name);
  for (size_t i = 0; i < names.size(); ++i) add(names[i], lens.coefficients[i]);
  return text + "\n";
}

std::string OrbSlamImages(const CalibratedCamera& camera) {
  return fmt::format(
             "Camera.width: {}\nCamera.height: {}\n", camera.image_size[0], camera.image_size[1]) +
         "# A calibration does not know these two.\nCamera.fps: 30\nCamera.RGB: 1\n";
}

Lens ReadOrbSlamCamera(const YamlNode& root, const std::string& prefix, const std::string& type) {
  const auto number = [&](std::string_view name) {
    return root.At(fmt::format("{}.{}", prefix, name)).AsNumber();
  };
  Lens lens{type, number("fx"), number("fy"), number("cx"), number("cy"), {}};
  for (const std::string_view name : OrbSlamNames(type)) {
    const bool has = root.Has(fmt::format("{}.{}", prefix, name));
    lens.coefficients.push_back(has ? number(name) : 0);
  }
  return lens;
}

ImageSize ReadOrbSlamSize(const YamlNode& root, const CameraSource& source) {
  if (root.Has("Camera.width") && root.Has("Camera.height")) {
    return {root.At("Camera.width").AsInteger(), root.At("Camera.height").AsInteger()};
  }
  if (source.image_size) return *source.image_size;
  root.Fail("holds no 'Camera.width' and 'Camera.height'; give --size WIDTHxHEIGHT");
}

}  // namespace plenocal
