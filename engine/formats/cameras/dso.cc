// SPDX-License-Identifier: Apache-2.0
//
// camera.txt of DSO: "MODEL fx fy cx cy ...", relative to the size of the image (absolute numbers
// would be taken as they are, without the half pixel).
#include <fmt/format.h>

#include <cctype>

#include "calib/base/format_error.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/lens_form.h"
#include "engine/formats/word_lines.h"

namespace plenocal {
namespace {

constexpr double kShift = 0.5;  // (0, 0) is the corner of the top-left pixel there

const LensTable& DsoLenses() {
  static const LensTable kTable{"dso",
                                {{"pinhole", "Pinhole", "0"},
                                 {"pinhole-radial3", "RadTan", "A_0 A_1 0 0"},
                                 {"pinhole-radtan4", "RadTan", "k_1 k_2 p_1 p_2"},
                                 {"pinhole-radtan", "RadTan", "k_1 k_2 p_1 p_2"},
                                 {"kannala-brandt4", "EquiDistant", "k_1 k_2 k_3 k_4"},
                                 {"fov", "FOV", "omega"}}};
  return kTable;
}

std::string WriteDso(const std::vector<CalibratedCamera>& cameras) {
  const CalibratedCamera& camera = cameras[0];
  const Lens lens = ToLens(camera, DsoLenses());
  std::vector<double> values = lens.Numbers();
  for (size_t i = 0; i < 4; ++i) {
    values[i] = (values[i] + (i < 2 ? 0 : kShift)) / camera.image_size[i % 2];
  }
  if (!(values[2] < 1 && values[3] < 1)) {
    throw JobError(
        "camera '{}': the principal point lies right of or below the image, "
        "which dso cannot hold",
        camera.name);
  }
  const std::string size = fmt::format("{} {}\n", camera.image_size[0], camera.image_size[1]);
  return fmt::format("{} {}\n{}crop\n{}", lens.name, BlankSeparated(values), size, size);
}

std::vector<CalibratedCamera> ReadDso(const CameraSource& source) {
  const std::vector<WordLine> lines = ReadWordLines(source.path);
  if (lines.size() < 2) lines[0].Fail("expected the image's size in the second line");
  WordLine lens = lines[0];
  const ImageSize size{lines[1].Pixels(0), lines[1].Pixels(1)};
  // Files without a name are FOV's with five numbers.
  if (std::isdigit(static_cast<unsigned char>(lens.words[0][0])) != 0) {
    lens.words.insert(lens.words.begin(), lens.words.size() == 5 ? "FOV" : "RadTan");
  }
  std::vector<double> values = lens.NumbersFrom(1);
  if (values.size() < 4) lens.Fail("expected a lens' name, fx, fy, cx, cy and its coefficients");
  const bool is_pinhole = lens.words[0] == "FOV" && values.size() == 5 && values[4] == 0;
  if (is_pinhole) lens.words[0] = "Pinhole";
  if (values[2] < 1 && values[3] < 1) {
    for (size_t i = 0; i < 4; ++i) {
      const double extent = size[i % 2];
      const double offset = i < 2 ? 0 : kShift;
      values[i] = values[i] * extent - offset;
    }
  }
  return {FromLens(LensOfNumbers(lens.words[0], values), size, DsoLenses(), lens.where)};
}

}  // namespace

CameraFormat DsoFormat() {
  return {.name = "dso",
          .file = "camera.txt",
          .write = WriteDso,
          .read = ReadDso,
          .holds_vignetting = true};
}

}  // namespace plenocal
