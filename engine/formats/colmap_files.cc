// SPDX-License-Identifier: Apache-2.0
//
// The layouts are those of COLMAP's documentation ("Output Format").
#include "engine/formats/colmap_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <string_view>

#include "calib/base/format_error.h"
#include "calib/io/input_file.h"
#include "engine/formats/word_lines.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kNoPoint = std::numeric_limits<std::uint64_t>::max();

struct Model {
  std::string_view name;
  size_t params;
};
/// By the number that stands for the model in binary files; with the number of its parameters.
constexpr std::array<Model, 18> kModels{{{"SIMPLE_PINHOLE", 3},
                                         {"PINHOLE", 4},
                                         {"SIMPLE_RADIAL", 4},
                                         {"RADIAL", 5},
                                         {"OPENCV", 8},
                                         {"OPENCV_FISHEYE", 8},
                                         {"FULL_OPENCV", 12},
                                         {"FOV", 5},
                                         {"SIMPLE_RADIAL_FISHEYE", 4},
                                         {"RADIAL_FISHEYE", 5},
                                         {"THIN_PRISM_FISHEYE", 12},
                                         {"RAD_TAN_THIN_PRISM_FISHEYE", 16},
                                         {"SIMPLE_DIVISION", 4},
                                         {"DIVISION", 5},
                                         {"SIMPLE_FISHEYE", 3},
                                         {"FISHEYE", 4},
                                         {"EUCM", 6},
                                         {"EQUIRECTANGULAR", 2}}};

/// A member of a model file, numbered from 1.
std::string PlaceIn(const fs::path& file, const char* what, std::uint64_t number) {
  return fmt::format("{}: {} {}", file.string(), what, number);
}

/// Little-endian numbers one after another.
class BinaryReader {
 public:
  explicit BinaryReader(const fs::path& file)
      : file_(file), content_(ReadInput(file, InputLimit::kTable)) {}

  template <typename Number>
  Number Read() {
    Number value;
    if (content_.size() - at_ < sizeof(value)) FailAtEnd();
    std::memcpy(&value, content_.data() + at_, sizeof(value));
    at_ += sizeof(value);
    return value;
  }
  double ReadFinite(const std::string& where) {
    const auto value = Read<double>();
    if (!std::isfinite(value)) throw InputError("{}: expected a number, found {}", where, value);
    return value;
  }
  /// Up to a zero byte.
  std::string ReadName() {
    const size_t end = content_.find('\0', at_);
    if (end == std::string::npos) FailAtEnd();
    std::string name = content_.substr(at_, end - at_);
    at_ = end + 1;
    return name;
  }
  /// A number of members, of which each takes at least `bytes`.
  std::uint64_t ReadCount(size_t bytes) {
    const auto count = Read<std::uint64_t>();
    if (count > (content_.size() - at_) / bytes) FailAtEnd();
    return count;
  }
  void Skip(size_t bytes) {
    if (content_.size() - at_ < bytes) FailAtEnd();
    at_ += bytes;
  }

 private:
  [[noreturn]] void FailAtEnd() const {
    throw InputError("{}: is cut short, or is no such file of a COLMAP model", file_.string());
  }

  fs::path file_;
  std::string content_;
  size_t at_ = 0;
};

int Pixels(std::uint64_t value, const std::string& where) {
  constexpr std::uint64_t kMost = 1'000'000;  // no image has more columns
  if (value < 1 || value > kMost) {
    throw InputError("{}: expected a number of pixels, found {}", where, value);
  }
  return static_cast<int>(value);
}

std::vector<ColmapCamera> ReadBinaryCameras(const fs::path& file) {
  BinaryReader reader(file);
  constexpr size_t kLeast = 24;  // bytes of a camera without parameters
  std::vector<ColmapCamera> cameras(reader.ReadCount(kLeast));
  std::uint64_t number = 0;
  for (ColmapCamera& camera : cameras) {
    camera.where = PlaceIn(file, "camera", ++number);
    camera.id = reader.Read<std::uint32_t>();
    const auto model = reader.Read<std::uint32_t>();
    if (model >= kModels.size()) throw InputError("{}: unknown model {}", camera.where, model);
    camera.model = kModels[model].name;
    for (int& side : camera.image_size) side = Pixels(reader.Read<std::uint64_t>(), camera.where);
    camera.params.resize(kModels[model].params);
    for (double& value : camera.params) value = reader.ReadFinite(camera.where);
  }
  return cameras;
}

std::vector<ColmapCamera> ReadTextCameras(const fs::path& file) {
  std::vector<ColmapCamera> cameras;
  for (const WordLine& line : ReadWordLines(file)) {
    if (line.words.size() < 6) line.Fail("expected 'ID MODEL WIDTH HEIGHT PARAMS...'");
    cameras.push_back({.id = line.Count(0),
                       .model = line.words[1],
                       .image_size = {line.Pixels(2), line.Pixels(3)},
                       .params = line.NumbersFrom(4),
                       .where = line.where});
    const auto model = std::ranges::find(kModels, line.words[1], &Model::name);
    const size_t count = cameras.back().params.size();
    if (model != kModels.end() && model->params != count) {
      line.Fail(fmt::format("{} has {} parameters, not {}", model->name, model->params, count));
    }
  }
  return cameras;
}

/// Adds an observation of a point; those of none are left out.
void AddObservation(
    double x, double y, std::uint64_t point, const std::string& where, ColmapImage* image) {
  if (point == kNoPoint) return;
  if (point > static_cast<std::uint64_t>(std::numeric_limits<int>::max())) {
    throw InputError("{}: point {} has a number above 2147483647", where, point);
  }
  image->observations.push_back(
      {static_cast<int>(point), x - kColmapPixelCentre, y - kColmapPixelCentre});
}

std::vector<ColmapImage> ReadBinaryImages(const fs::path& file) {
  BinaryReader reader(file);
  constexpr size_t kPose = 7 * sizeof(double), kPoint = 24;
  constexpr size_t kLeast = 4 + kPose + 4 + 1 + 8;  // bytes of an image without points
  std::vector<ColmapImage> images(reader.ReadCount(kLeast));
  std::uint64_t number = 0;
  for (ColmapImage& image : images) {
    image.where = PlaceIn(file, "image", ++number);
    reader.Skip(sizeof(std::uint32_t) + kPose);
    image.camera = reader.Read<std::uint32_t>();
    image.name = reader.ReadName();
    const std::uint64_t points = reader.ReadCount(kPoint);
    for (std::uint64_t i = 0; i < points; ++i) {
      const double x = reader.ReadFinite(image.where), y = reader.ReadFinite(image.where);
      AddObservation(x, y, reader.Read<std::uint64_t>(), image.where, &image);
    }
  }
  return images;
}

/// Two lines an image: "ID QW QX QY QZ TX TY TZ CAMERA NAME", and "X Y POINT" for each of its
/// points; the second one may be empty.
std::vector<ColmapImage> ReadTextImages(const fs::path& file) {
  constexpr size_t kCamera = 8, kName = 9;
  std::vector<ColmapImage> images;
  bool is_first = true;
  for (const WordLine& line : ReadAllLines(file)) {
    if (!line.words.empty() && line.words[0].starts_with('#')) continue;
    if (is_first) {
      if (line.words.empty()) continue;  // at the end
      if (line.words.size() <= kName) {
        line.Fail("expected 'ID QW QX QY QZ TX TY TZ CAMERA NAME'");
      }
      ColmapImage& image = images.emplace_back();
      image.where = line.where;
      image.camera = line.Count(kCamera);
      for (size_t i = kName; i < line.words.size(); ++i) {
        image.name += (i == kName ? "" : " ") + line.words[i];
      }
    } else {
      ColmapImage& image = images.back();
      if (line.words.size() % 3 != 0) line.Fail("expected 'X Y POINT' for each point of the image");
      for (size_t i = 0; i < line.words.size(); i += 3) {
        const std::uint64_t point = line.words[i + 2] == "-1" ? kNoPoint : line.Count(i + 2);
        AddObservation(line.Number(i), line.Number(i + 1), point, line.where, &image);
      }
    }
    is_first = !is_first;
  }
  return images;
}

bool IsBinary(const fs::path& file) { return file.extension() == ".bin"; }

}  // namespace

std::vector<ColmapCamera> ReadColmapCameras(const fs::path& file) {
  std::vector<ColmapCamera> cameras =
      IsBinary(file) ? ReadBinaryCameras(file) : ReadTextCameras(file);
  if (cameras.empty()) throw InputError("{}: has no camera", file.string());
  return cameras;
}

std::vector<ColmapImage> ReadColmapImages(const fs::path& file) {
  return IsBinary(file) ? ReadBinaryImages(file) : ReadTextImages(file);
}

}  // namespace plenocal
