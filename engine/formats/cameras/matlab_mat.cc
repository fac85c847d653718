// SPDX-License-Identifier: Apache-2.0
//
// MATLAB's MAT-files, level 5, as load reads them: one variable a name of cameraIntrinsics or
// fisheyeIntrinsics, of a pair with 1 and 2 after it, and PoseCamera2 (4 x 4, camera 1 to camera 2,
// as rigidtform3d takes it).
//
// Source: MathWorks, MAT-File Format. A header of 128 bytes, then elements of tag (type, bytes) and
// data, padded to 8 bytes; a matrix is an element of elements: flags, dimensions, name, numbers
// column by column.
#include <fmt/format.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <map>

#include "calib/base/format_error.h"
#include "calib/io/input_file.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/matlab_intrinsics.h"
#include "engine/formats/pose_matrices.h"

namespace plenocal {
namespace {

constexpr std::uint32_t kInt8 = 1, kInt32 = 5, kUint32 = 6, kDouble = 9, kMatrix = 14,
                        kCompressed = 15;
constexpr std::uint32_t kDoubleClass = 6;
constexpr size_t kHeader = 128, kTag = 8;

struct Variable {
  int rows = 0, columns = 0;
  std::vector<double> values;  // column by column
};

template <typename T>
void Append(T value, std::string* bytes) {
  for (size_t i = 0; i < sizeof(T); ++i) *bytes += static_cast<char>(value >> (8 * i) & 0xff);
}

std::string Element(std::uint32_t type, const std::string& data) {
  std::string bytes;
  Append(type, &bytes);
  Append(static_cast<std::uint32_t>(data.size()), &bytes);
  bytes += data;
  bytes.resize((bytes.size() + 7) / 8 * 8);
  return bytes;
}

std::string MatrixElement(const std::string& name, const Variable& variable) {
  std::string flags, dimensions, numbers;
  Append(kDoubleClass, &flags);
  Append(std::uint32_t{0}, &flags);
  Append(static_cast<std::uint32_t>(variable.rows), &dimensions);
  Append(static_cast<std::uint32_t>(variable.columns), &dimensions);
  for (const double value : variable.values) Append(std::bit_cast<std::uint64_t>(value), &numbers);
  return Element(kMatrix,
                 Element(kUint32, flags) + Element(kInt32, dimensions) + Element(kInt8, name) +
                     Element(kDouble, numbers));
}

std::string WriteMat(const std::vector<CalibratedCamera>& cameras) {
  std::string bytes = "MATLAB 5.0 MAT-file, camera intrinsics by plenocal";
  bytes.resize(124, ' ');
  Append(std::uint16_t{0x0100}, &bytes);  // version
  bytes += "IM";                          // little endian
  for (size_t c = 0; c < cameras.size(); ++c) {
    const std::string number = cameras.size() == 1 ? "" : fmt::format("{}", c + 1);
    for (const MatlabArgument& argument : ToMatlab(cameras[c])) {
      const int columns = static_cast<int>(argument.values.size()) / argument.rows;
      bytes += MatrixElement(argument.name + number, {argument.rows, columns, argument.values});
    }
  }
  if (cameras.size() == 2) {
    const RigidTransform T = SecondFromFirst(cameras);
    Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
    pose.topLeftCorner<3, 3>() = T.R;
    pose.topRightCorner<3, 1>() = T.t;
    bytes += MatrixElement("PoseCamera2", {4, 4, {pose.data(), pose.data() + 16}});
  }
  return bytes;
}

/// Elements one after another.
class Elements {
 public:
  Elements(std::string_view bytes, std::string where) : bytes_(bytes), where_(std::move(where)) {}

  [[nodiscard]] bool AtEnd() const { return at_ >= bytes_.size(); }

  /// Type and data of the next one.
  std::pair<std::uint32_t, std::string_view> Next() {
    if (bytes_.size() - at_ < kTag) Fail("truncated");
    const std::uint32_t first = Number<std::uint32_t>(bytes_.substr(at_));
    // Up to four bytes of data may be in the tag itself, whose upper half is then their number.
    if (const std::uint32_t small = first >> 16; small > 0) {
      if (small > 4) Fail("corrupt");
      const auto data = bytes_.substr(at_ + 4, small);
      at_ += kTag;
      return {first & 0xffff, data};
    }
    const std::uint32_t size = Number<std::uint32_t>(bytes_.substr(at_ + 4));
    if (bytes_.size() - at_ - kTag < size) Fail("truncated");
    const auto data = bytes_.substr(at_ + kTag, size);
    at_ = std::min(bytes_.size(), at_ + kTag + (size + 7) / 8 * 8);
    return {first, data};
  }

  template <typename T>
  static T Number(std::string_view bytes) {
    T value = 0;
    for (size_t i = 0; i < sizeof(T); ++i) {
      value |= static_cast<T>(static_cast<unsigned char>(bytes[i])) << (8 * i);
    }
    return value;
  }

  [[noreturn]] void Fail(const std::string& what) const {
    throw InputError("{}: {} MAT-file; write it again with save -v6 or as JSON", where_, what);
  }

 private:
  std::string_view bytes_;
  std::string where_;
  size_t at_ = 0;
};

/// The file's matrices of doubles.
std::map<std::string, Variable> ReadVariables(std::string_view bytes, const std::string& where) {
  if (bytes.size() < kHeader || !bytes.starts_with("MATLAB 5.0") || bytes.substr(126, 2) != "IM") {
    throw InputError(
        "{}: is no MAT-file of level 5 in little endian; write it with save "
        "-v6",
        where);
  }
  std::map<std::string, Variable> variables;
  for (Elements file(bytes.substr(kHeader), where); !file.AtEnd();) {
    const auto [type, content] = file.Next();
    if (type == kCompressed) file.Fail("compressed");
    if (type != kMatrix || content.empty()) continue;
    Elements parts(content, where);
    const auto flags = parts.Next().second, dimensions = parts.Next().second;
    const std::string name(parts.Next().second);
    if (flags.size() < 4 || (Elements::Number<std::uint32_t>(flags) & 0xff) != kDoubleClass ||
        dimensions.size() != 8) {
      continue;
    }
    const auto [number_type, numbers] = parts.Next();
    Variable variable{static_cast<int>(Elements::Number<std::uint32_t>(dimensions)),
                      static_cast<int>(Elements::Number<std::uint32_t>(dimensions.substr(4))),
                      {}};
    // save stores whole numbers in fewer bytes.
    const size_t width = number_type == kDouble ? 8
                         : number_type == 2     ? 1
                         : number_type == 4     ? 2
                                                : 0;
    if (width == 0) file.Fail(fmt::format("'{}' has an unexpected type in this", name));
    for (size_t i = 0; i + width <= numbers.size(); i += width) {
      const std::string_view at = numbers.substr(i);
      variable.values.push_back(width == 8
                                    ? std::bit_cast<double>(Elements::Number<std::uint64_t>(at))
                                : width == 2 ? Elements::Number<std::uint16_t>(at)
                                             : Elements::Number<std::uint8_t>(at));
    }
    variables[name] = variable;
  }
  return variables;
}

/// The variables of a file, by name and number of values.
class Workspace {
 public:
  explicit Workspace(const std::filesystem::path& path)
      : where_(path.string()),
        variables_(ReadVariables(ReadInput(path, InputLimit::kDocument), where_)) {}

  [[nodiscard]] const std::string& Where() const { return where_; }
  [[nodiscard]] bool Has(const std::string& name) const { return variables_.contains(name); }

  [[nodiscard]] std::vector<double> Get(const std::string& name, size_t least, size_t most) const {
    const auto found = variables_.find(name);
    if (found == variables_.end() || found->second.values.size() < least ||
        found->second.values.size() > most) {
      Fail(fmt::format("expected a variable '{}' of {} numbers", name, most));
    }
    for (const double value : found->second.values) {
      if (!std::isfinite(value)) Fail(fmt::format("{} is not finite", name));
    }
    return found->second.values;
  }

  [[noreturn]] void Fail(const std::string& message) const {
    throw InputError("{}: {}", where_, message);
  }

 private:
  std::string where_;
  std::map<std::string, Variable> variables_;
};

/// The camera whose variables end in `number`, which is empty for a single one.
CalibratedCamera ReadNumbered(const Workspace& workspace, const std::string& number) {
  const auto read = [&](const std::string& name, size_t least, size_t most) {
    if (name == "Skew" && !workspace.Has(name + number)) return std::vector{0.0};
    return workspace.Get(name + number, least, most);
  };
  return FromMatlab(read, workspace.Has(kMatlabFisheye + number), workspace.Where());
}

std::vector<CalibratedCamera> ReadMat(const CameraSource& source) {
  const Workspace workspace(source.path);
  if (!workspace.Has("FocalLength1") && !workspace.Has(std::string(kMatlabFisheye) + "1"))
    return {ReadNumbered(workspace, "")};
  std::vector<CalibratedCamera> cameras;
  for (const std::string number : {"1", "2"}) {
    cameras.push_back(ReadNumbered(workspace, number));
    cameras.back().name = "camera" + number;
  }
  const std::vector<double> values = workspace.Get("PoseCamera2", 16, 16);
  const Eigen::Matrix4d pose = Eigen::Map<const Eigen::Matrix4d>(values.data());
  cameras[1].T_camera_rig = {pose.topLeftCorner<3, 3>(), pose.topRightCorner<3, 1>()};
  return cameras;
}

}  // namespace

CameraFormat MatlabMatFormat() {
  return {.name = "mat",
          .file = "camera.mat",
          .variant_of = "matlab",
          .extension = ".mat",
          .most_cameras = 2,
          .holds_extrinsics = true,
          .write = WriteMat,
          .read = ReadMat};
}

}  // namespace plenocal
