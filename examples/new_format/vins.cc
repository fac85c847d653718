// SPDX-License-Identifier: Apache-2.0
//
// A new export and import format is one file in engine/formats/cameras; this one is an example that
// scripts/add tries: camera files of VINS-Mono and VINS-Fusion (camodocal), pinhole cameras with
// radial-tangential distortion.
#include <fmt/format.h>

#include <array>

#include "engine/formats/camera_format.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/lens_form.h"
#include "engine/formats/opencv_storage.h"

namespace plenocal {
namespace {

const LensTable& VinsLenses() {
  static const LensTable kTable{"vins",
                                {{"pinhole", "PINHOLE", "0 0 0 0"},
                                 {"pinhole-radial3", "PINHOLE", "A_0 A_1 0 0"},
                                 {"pinhole-radtan4", "PINHOLE", "k_1 k_2 p_1 p_2"}}};
  return kTable;
}

constexpr std::array kDistortion{"k1", "k2", "p1", "p2"};

std::string WriteVins(const std::vector<CalibratedCamera>& cameras) {
  const CalibratedCamera& camera = cameras[0];
  const Lens lens = ToLens(camera, VinsLenses());
  std::string text = kOpenCvHead;
  text += fmt::format("model_type: {}\ncamera_name: {}\nimage_width: {}\nimage_height: {}\n",
                      lens.name,
                      camera.name,
                      camera.image_size[0],
                      camera.image_size[1]);
  text += "distortion_parameters:\n";
  for (size_t i = 0; i < kDistortion.size(); ++i) {
    text += fmt::format("   {}: {}\n", kDistortion[i], RealText(lens.coefficients[i]));
  }
  return text + fmt::format("projection_parameters:\n   fx: {}\n   fy: {}\n   cx: {}\n   cy: {}\n",
                            RealText(lens.f_x),
                            RealText(lens.f_y),
                            RealText(lens.c_x),
                            RealText(lens.c_y));
}

std::vector<CalibratedCamera> ReadVins(const CameraSource& source) {
  const YamlNode root = ReadStorage(source.path);
  const YamlNode projection = root.At("projection_parameters");
  Lens lens{root.At("model_type").AsString(),
            projection.At("fx").AsNumber(),
            projection.At("fy").AsNumber(),
            projection.At("cx").AsNumber(),
            projection.At("cy").AsNumber(),
            {}};
  for (const char* name : kDistortion) {
    lens.coefficients.push_back(root.At("distortion_parameters").At(name).AsNumber());
  }
  return {FromLens(lens,
                   {root.At("image_width").AsInteger(), root.At("image_height").AsInteger()},
                   VinsLenses(),
                   source.path.string())};
}

}  // namespace

CameraFormat VinsFormat() {
  return {.name = "vins", .file = "camera.yaml", .write = WriteVins, .read = ReadVins};
}

}  // namespace plenocal
