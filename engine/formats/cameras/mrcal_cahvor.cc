// SPDX-License-Identifier: Apache-2.0
//
// .cahvor of mrcal and JPL's programs: "key = numbers" in lines. OpenCV's distortions, which mrcal
// writes into comments of it, are in its .cameramodel.
//
// Source: mrcal/cahvor.py.
#include <fmt/format.h>

#include <array>
#include <map>

#include "calib/base/format_error.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/lenses/cahvor.h"
#include "engine/formats/word_lines.h"

namespace plenocal {
namespace {

std::string WriteCahvor(const std::vector<CalibratedCamera>& cameras) {
  const Cahvor cahvor = ToCahvor(cameras[0]);
  const bool has_lens = !cahvor.R.isZero(0);
  std::string text =
      fmt::format("Dimensions = {} {}\nModel = {}\n",
                  cameras[0].image_size[0],
                  cameras[0].image_size[1],
                  has_lens ? "CAHVOR = perspective, distortion" : "CAHV = perspective, linear");
  const auto add = [&](const char* key, const Eigen::Vector3d& v) {
    text += fmt::format("{} = {}\n", key, BlankSeparated(std::array{v.x(), v.y(), v.z()}));
  };
  add("C", cahvor.C);
  add("A", cahvor.HVA.row(2));
  add("H", cahvor.HVA.row(0));
  add("V", cahvor.HVA.row(1));
  if (has_lens) {
    add("O", cahvor.O);
    add("R", cahvor.R);
  }
  return text;
}

std::vector<CalibratedCamera> ReadCahvor(const CameraSource& source) {
  std::map<std::string, WordLine> lines;
  for (const WordLine& line : ReadWordLines(source.path)) {
    if (line.words.size() < 3 || line.words[1] != "=") continue;
    if (!lines.emplace(line.words[0], line).second) {
      line.Fail(fmt::format("a second '{}'", line.words[0]));
    }
  }
  const auto at = [&](const std::string& key) -> const WordLine& {
    const auto found = lines.find(key);
    if (found == lines.end()) {
      throw InputError("{}: expected a line '{} = ...'", source.path.string(), key);
    }
    return found->second;
  };
  const auto vector = [&](const std::string& key) {
    const std::vector<double> v = at(key).NumbersFrom(2);
    if (v.size() != 3) at(key).Fail("expected three numbers");
    return Eigen::Vector3d(v[0], v[1], v[2]);
  };
  for (const auto& [key, line] : lines) {
    const bool is_distortion = key.starts_with("LENSMODEL_") || key.starts_with("DISTORTION_");
    if (is_distortion) line.Fail("is read from the .cameramodel only");
    if (key == "E" && !vector("E").isZero(0)) line.Fail("CAHVORE's moving centre is not read");
    if (key == "Model" && line.words[2].starts_with("CAHVORE")) line.Fail("CAHVORE is not read");
  }
  Cahvor cahvor;
  cahvor.C = vector("C");
  cahvor.HVA << vector("H").transpose(), vector("V").transpose(), vector("A").transpose();
  cahvor.O = lines.contains("O") ? vector("O") : vector("A");
  if (lines.contains("R")) cahvor.R = vector("R");
  const WordLine& size = at("Dimensions");
  return {FromCahvor(cahvor, {size.Pixels(2), size.Pixels(3)}, source.path.string())};
}

}  // namespace

CameraFormat MrcalCahvorFormat() {
  return {.name = "cahvor",
          .file = "camera.cahvor",
          .variant_of = "mrcal",
          .extension = ".cahvor",
          .most_cameras = kAnyNumber,
          .holds_extrinsics = true,
          .write = WriteCahvor,
          .read = ReadCahvor,
          .has_file_per_camera = true};
}

}  // namespace plenocal
