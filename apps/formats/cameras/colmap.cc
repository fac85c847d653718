// SPDX-License-Identifier: Apache-2.0
//
// cameras.txt of COLMAP: "ID MODEL WIDTH HEIGHT PARAMS".
#include <fmt/format.h>

#include "apps/formats/camera_format.h"
#include "apps/formats/exact_numbers.h"
#include "apps/formats/lens_form.h"
#include "apps/formats/word_lines.h"

namespace plenocal {
namespace {

constexpr double kHalfPixel = 0.5;  // (0, 0) is the corner of the top-left pixel there

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
    std::vector<double> values{lens.f_x, lens.f_y, lens.c_x + kHalfPixel, lens.c_y + kHalfPixel};
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
  return Inverted(value, value - kHalfPixel, [](double x) { return x + kHalfPixel; });
}

std::vector<CalibratedCamera> ReadColmap(const CameraSource& source) {
  std::vector<CalibratedCamera> cameras;
  for (const WordLine& line : ReadWordLines(source.path)) {
    if (line.words.size() < 7) line.Fail("expected 'ID MODEL WIDTH HEIGHT PARAMS...'");
    const ImageSize size{line.Pixels(2), line.Pixels(3)};
    std::string name = line.words[1];
    std::vector<double> values = line.NumbersFrom(4);
    // Models with one focal length.
    if (name == "SIMPLE_PINHOLE" || name == "SIMPLE_RADIAL" || name == "RADIAL") {
      values.insert(values.begin(), values[0]);
      name = name == "SIMPLE_PINHOLE" ? "PINHOLE" : "OPENCV";
    }
    if (values.size() < 4) line.Fail("expected at least f, cx, cy");
    cameras.push_back(FromLens({name,
                                values[0],
                                values[1],
                                FromCorner(values[2]),
                                FromCorner(values[3]),
                                {values.begin() + 4, values.end()}},
                               size,
                               ColmapLenses(),
                               line.where));
    cameras.back().name = "camera" + line.words[0];
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
