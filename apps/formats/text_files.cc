// SPDX-License-Identifier: Apache-2.0
//
// Lines of numbers. Both tools have (0, 0) at the corner of the top-left pixel.
// - COLMAP: cameras.txt, "ID MODEL WIDTH HEIGHT PARAMS".
// - DSO: camera.txt, "MODEL fx fy cx cy ...", relative to the image's size (absolute numbers would
//   be taken as they are, without the half pixel).
#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <sstream>

#include "apps/formats/formats.h"
#include "calib/error.h"
#include "calib/text_file.h"

namespace plenocal {
namespace {

constexpr double kHalfPixel = 0.5;

/// A line's words, and numbers among them.
struct Line {
  std::string where;
  std::vector<std::string> words;

  [[noreturn]] void Fail(const std::string& message) const {
    throw Error(ErrorKind::kInput, fmt::format("{}: {}", where, message));
  }
  [[nodiscard]] double Number(size_t i) const {
    if (i >= words.size()) Fail(fmt::format("expected more than {} words", words.size()));
    double value = 0;
    const char* const end = words[i].data() + words[i].size();
    const auto [after, error] = std::from_chars(words[i].data(), end, value);
    if (error != std::errc() || after != end || !std::isfinite(value)) {
      Fail(fmt::format("expected a number, found '{}'", words[i]));
    }
    return value;
  }
  [[nodiscard]] int Pixels(size_t i) const {
    const double value = Number(i);
    if (value < 1 || value != std::floor(value) || value > 1e6) {
      Fail(fmt::format("expected a number of pixels, found '{}'", words[i]));
    }
    return static_cast<int>(value);
  }
  [[nodiscard]] std::vector<double> NumbersFrom(size_t first) const {
    std::vector<double> numbers;
    for (size_t i = first; i < words.size(); ++i) numbers.push_back(Number(i));
    return numbers;
  }
};

/// Lines that hold something; '#' begins a comment.
std::vector<Line> ReadLines(const std::filesystem::path& path) {
  std::istringstream text(ReadTextFile(path));
  std::vector<Line> lines;
  int number = 0;
  for (std::string line; std::getline(text, line);) {
    ++number;
    std::istringstream words(line.substr(0, line.find('#')));
    Line read{fmt::format("{}:{}", path.string(), number), {}};
    for (std::string word; words >> word;) read.words.push_back(word);
    if (!read.words.empty()) lines.push_back(read);
  }
  if (lines.empty()) throw Error(ErrorKind::kInput, path.string() + ": holds no cameras");
  return lines;
}

std::string Blanks(std::span<const double> values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : " ") + RealText(value);
  return text;
}

// COLMAP

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
                        Blanks(values));
  }
  return text;
}

double FromCorner(double value) {
  return Inverted(value, value - kHalfPixel, [](double x) { return x + kHalfPixel; });
}

std::vector<CalibratedCamera> ReadColmap(const CameraSource& source) {
  std::vector<CalibratedCamera> cameras;
  for (const Line& line : ReadLines(source.path)) {
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

// DSO

std::span<const LensForm> DsoLenses() {
  static const std::vector<LensForm> kForms{
      {"pinhole", "Pinhole", {"0"}},
      {"pinhole-radial3", "RadTan", {"A_0", "A_1", "0", "0"}},
      {"pinhole-radtan4", "RadTan", {"k_1", "k_2", "p_1", "p_2"}},
      {"pinhole-radtan", "RadTan", {"k_1", "k_2", "p_1", "p_2"}},
      {"kannala-brandt4", "EquiDistant", {"k_1", "k_2", "k_3", "k_4"}},
      {"fov", "FOV", {"omega"}}};
  return kForms;
}

std::string WriteDso(const std::vector<CalibratedCamera>& cameras) {
  const CalibratedCamera& camera = cameras[0];
  const Lens lens = ToLens(camera, DsoLenses(), "dso");
  const double width = camera.image_size[0], height = camera.image_size[1];
  std::vector<double> values{lens.f_x / width,
                             lens.f_y / height,
                             (lens.c_x + kHalfPixel) / width,
                             (lens.c_y + kHalfPixel) / height};
  if (!(values[2] < 1 && values[3] < 1)) {
    throw Error(ErrorKind::kJob,
                fmt::format("camera '{}': the principal point lies right of or below the image, "
                            "which dso cannot hold",
                            camera.name));
  }
  values.insert(values.end(), lens.coefficients.begin(), lens.coefficients.end());
  const std::string size = fmt::format("{} {}\n", camera.image_size[0], camera.image_size[1]);
  return fmt::format("{} {}\n{}crop\n{}", lens.name, Blanks(values), size, size);
}

std::vector<CalibratedCamera> ReadDso(const CameraSource& source) {
  const std::vector<Line> lines = ReadLines(source.path);
  if (lines.size() < 2) lines[0].Fail("expected the image's size in the second line");
  Line lens = lines[0];
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
      const double offset = i < 2 ? 0 : kHalfPixel;
      values[i] = Inverted(
          values[i], values[i] * extent - offset, [&](double x) { return (x + offset) / extent; });
    }
  }
  return {FromLens({lens.words[0],
                    values[0],
                    values[1],
                    values[2],
                    values[3],
                    {values.begin() + 4, values.end()}},
                   size,
                   DsoLenses(),
                   lens.where)};
}

}  // namespace

CameraFormat ColmapFormat() {
  constexpr size_t kMost = 1000000;
  return {"colmap", "cameras.txt", kMost, false, WriteColmap, ReadColmap};
}
CameraFormat DsoFormat() {
  return {"dso", "camera.txt", 1, false, WriteDso, ReadDso, nullptr, true};
}

}  // namespace plenocal
