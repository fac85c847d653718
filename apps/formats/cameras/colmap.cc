// SPDX-License-Identifier: Apache-2.0
//
// cameras.txt of COLMAP, "ID MODEL WIDTH HEIGHT PARAMS"; cameras.bin is read as well.
#include <fmt/format.h>

#include "apps/formats/camera_format.h"
#include "apps/formats/colmap_files.h"
#include "apps/formats/exact_numbers.h"
#include "apps/formats/lens_form.h"
#include "apps/formats/word_lines.h"
#include "calib/base/error.h"

namespace plenocal {
namespace {

std::span<const LensForm> ColmapLenses() {
  static const std::vector<LensForm> kForms{
      {"pinhole", "PINHOLE", {}},
      {"pinhole-radial3", "FULL_OPENCV", {"A_0", "A_1", "0", "0", "A_2", "0", "0", "0"}},
      {"pinhole-radial3", "OPENCV", {"A_0", "A_1", "0", "0"}},
      {"pinhole-radtan4", "OPENCV", {"k_1", "k_2", "p_1", "p_2"}},
      {"pinhole-radtan", "FULL_OPENCV", {"k_1", "k_2", "p_1", "p_2", "k_3", "0", "0", "0"}},
      {"pinhole-radtan8", "FULL_OPENCV", {"k_1", "k_2", "p_1", "p_2", "k_3", "k_4", "k_5", "k_6"}},
      {"kannala-brandt4", "OPENCV_FISHEYE", {"k_1", "k_2", "k_3", "k_4"}},
      {"fov", "FOV", {"omega"}}};
  return kForms;
}

std::string WriteColmap(const std::vector<CalibratedCamera>& cameras) {
  std::string text =
      "# Camera list with one line of data per camera:\n"
      "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n";
  text += fmt::format("# Number of cameras: {}\n", cameras.size());
  for (size_t i = 0; i < cameras.size(); ++i) {
    const Lens lens = ToLens(cameras[i], ColmapLenses(), "colmap");
    std::vector<double> values{
        lens.f_x, lens.f_y, lens.c_x + kColmapPixelCentre, lens.c_y + kColmapPixelCentre};
    values.insert(values.end(), lens.coefficients.begin(), lens.coefficients.end());
    text += fmt::format("{} {} {} {} {}\n",
                        i + 1,
                        lens.name,
                        cameras[i].image_size[0],
                        cameras[i].image_size[1],
                        BlankSeparated(values));
  }
  return text;
}

double FromCorner(double value) {
  return Inverted(
      value, value - kColmapPixelCentre, [](double x) { return x + kColmapPixelCentre; });
}

std::vector<CalibratedCamera> ReadColmap(const CameraSource& source) {
  std::vector<CalibratedCamera> cameras;
  for (ColmapCamera& camera : ReadColmapCameras(source.path)) {
    std::string& name = camera.model;
    std::vector<double>& values = camera.params;
    // Models with one focal length.
    if (name == "SIMPLE_PINHOLE" || name == "SIMPLE_RADIAL" || name == "RADIAL") {
      values.insert(values.begin(), values[0]);
      name = name == "SIMPLE_PINHOLE" ? "PINHOLE" : "OPENCV";
    }
    if (values.size() < 4) {
      throw Error(ErrorKind::kInput, camera.where + ": expected at least f, cx, cy");
    }
    cameras.push_back(FromLens({name,
                                values[0],
                                values[1],
                                FromCorner(values[2]),
                                FromCorner(values[3]),
                                {values.begin() + 4, values.end()}},
                               camera.image_size,
                               ColmapLenses(),
                               camera.where));
    cameras.back().name = fmt::format("camera{}", camera.id);
  }
  return cameras;
}

}  // namespace

CameraFormat ColmapFormat() {
  return {.name = "colmap",
          .file = "cameras.txt",
          .most_cameras = kAnyNumber,
          .holds_extrinsics = false,
          .write = WriteColmap,
          .read = ReadColmap};
}

}  // namespace plenocal
