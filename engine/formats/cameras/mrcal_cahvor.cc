// SPDX-License-Identifier: Apache-2.0
//
// .cahvor of mrcal and JPL's programs: "key = numbers" in lines. OpenCV's distortions, which mrcal
// writes into comments of it, are in its .cameramodel.
//
// Source: mrcal/cahvor.py.
#include <fmt/format.h>

#include <array>
#include <map>
#include <optional>

#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/lenses/cahvor.h"
#include "engine/formats/word_lines.h"

namespace plenocal {
namespace {

std::string WriteCahvor(const std::vector<CalibratedCamera>& cameras) {
  const Cahvor cahvor = ToCahvor(cameras[0]);
  const bool has_lens = cahvor.linearity || !cahvor.R.isZero(0);
  std::string text =
      fmt::format("Dimensions = {} {}\nModel = {}\n",
                  cameras[0].image_size[0],
                  cameras[0].image_size[1],
                  cahvor.linearity ? fmt::format("CAHVORE3,{} = general", *cahvor.linearity)
                  : has_lens       ? "CAHVOR = perspective, distortion"
                                   : "CAHV = perspective, linear");
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
  if (cahvor.linearity) add("E", cahvor.E);
  return text;
}

// Of "CAHVORE1" (perspective), "CAHVORE2" (fisheye), "CAHVORE3,0.35"; none of other models.
std::optional<double> ReadLinearity(const WordLine& line) {
  std::string_view model = line.words[2];
  constexpr std::string_view kName = "CAHVORE", kAny = "3,";
  if (!model.starts_with(kName)) return std::nullopt;
  model.remove_prefix(kName.size());
  if (model == "1") return 1;
  if (model == "2") return 0;
  if (model.starts_with(kAny)) {
    if (const auto linearity = ParseDouble(model.substr(kAny.size()))) return linearity;
  }
  line.Fail("expected CAHVORE1, CAHVORE2 or CAHVORE3 with its linearity, like CAHVORE3,0.35");
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
  }
  Cahvor cahvor;
  cahvor.linearity = ReadLinearity(at("Model"));
  cahvor.C = vector("C");
  cahvor.HVA.row(0) = vector("H");
  cahvor.HVA.row(1) = vector("V");
  cahvor.HVA.row(2) = vector("A");
  cahvor.O = lines.contains("O") ? vector("O") : vector("A");
  if (lines.contains("R")) cahvor.R = vector("R");
  if (cahvor.linearity) cahvor.E = vector("E");
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
