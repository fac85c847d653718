// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/opencv_storage.h"

#include <fmt/format.h>

#include <array>
#include <cctype>

#include "calib/base/format_error.h"
#include "calib/io/input_file.h"
#include "engine/formats/exact_numbers.h"

namespace plenocal {
std::string OpenCvMatrix(
    const std::string& key, int rows, int cols, char type, std::span<const double> data) {
  return fmt::format("{}: !!opencv-matrix\n   rows: {}\n   cols: {}\n   dt: {}\n   data: [ {} ]\n",
                     key,
                     rows,
                     cols,
                     type,
                     RealList(data));
}

std::string CameraMatrix(const std::string& key, const Lens& lens) {
  return OpenCvMatrix(
      key, 3, 3, 'd', std::array{lens.f_x, 0.0, lens.c_x, 0.0, lens.f_y, lens.c_y, 0.0, 0.0, 1.0});
}

std::string Coefficients(const std::string& key, const Lens& lens) {
  return OpenCvMatrix(key, 1, static_cast<int>(lens.coefficients.size()), 'd', lens.coefficients);
}

namespace {

/// OpenCV reads 'key:value', which is no YAML: a blank after the colon of each line's key.
std::string WithBlanks(const std::string& text) {
  std::string yaml;
  bool in_key = true;
  for (size_t i = 0; i < text.size(); ++i) {
    yaml += text[i];
    if (text[i] == '\n') {
      in_key = true;
    } else if (in_key && text[i] == ':') {
      in_key = false;
      if (i + 1 < text.size() && std::isspace(static_cast<unsigned char>(text[i + 1])) == 0) {
        yaml += ' ';
      }
    } else if (std::string_view("\"'#[{").find(text[i]) != std::string_view::npos) {
      in_key = false;
    }
  }
  return yaml;
}

}  // namespace

YamlNode ReadStorage(const std::filesystem::path& path) {
  std::string text = ReadTextFile(path, InputLimit::kDocument);
  if (text.starts_with("<?xml")) {
    throw InputError("{}: OpenCV's XML is not read; write it as YAML (a name in .yml)",
                     path.string());
  }
  // OpenCV's first line is not a YAML directive.
  if (text.starts_with("%YAML:1.0")) text = WithBlanks("#" + text.substr(1));
  return YamlNode::Parse(text, path.string());
}

std::vector<double> MatrixData(const YamlNode& node, size_t count) {
  // Plain lists, possibly of rows, are common too.
  if (node.IsMap()) return node.At("data").AsNumbers(count);
  std::vector<double> data;
  for (const YamlNode& element : node.Elements()) {
    if (element.IsScalar()) {
      data.push_back(element.AsNumber());
    } else {
      for (const double value : element.AsNumbers(0)) data.push_back(value);
    }
  }
  if (count > 0 && data.size() != count) node.Fail(fmt::format("expected {} numbers", count));
  return data;
}

Lens LensOf(const YamlNode& K, const std::optional<YamlNode>& D, OpenCvDistortion distortion) {
  const std::vector<double> k = MatrixData(K, 9);
  if (k[1] != 0) K.Fail("a skewed camera matrix is not read");
  return {distortion == OpenCvDistortion::kFisheye ? "fisheye" : "radtan",
          k[0],
          k[4],
          k[2],
          k[5],
          D ? MatrixData(*D, 0) : std::vector<double>{}};
}

}  // namespace plenocal
