// SPDX-License-Identifier: Apache-2.0
//
// MAT-files of level 5 as MATLAB's save -v6 writes them, byte by byte.
#include <gmock/gmock.h>

#include <bit>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "engine/formats/camera_format.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

template <typename Number>
std::string Bytes(Number number) {
  std::string text;
  for (size_t i = 0; i < sizeof(number); ++i) {
    text += static_cast<char>(static_cast<std::uint64_t>(number) >> (8 * i));
  }
  return text;
}

std::string Header() {
  std::string header = "MATLAB 5.0 MAT-file";
  header.resize(124, ' ');
  return header + std::string("\0\1", 2) + "IM";
}

// Types of elements.
enum : std::uint32_t {
  kInt8 = 1,
  kUint8 = 2,
  kUint16 = 4,
  kInt32 = 5,
  kUint32 = 6,
  kDouble = 9,
  kMatrix = 14,
  kCompressed = 15,
};

std::string Element(std::uint32_t type, std::string content) {
  const auto size = static_cast<std::uint32_t>(content.size());
  content.resize((content.size() + 7) / 8 * 8, '\0');
  return Bytes(type) + Bytes(size) + content;
}

// One row of numbers, stored as `type`.
std::string Matrix(const std::string& name, std::uint32_t type, const std::vector<double>& row) {
  constexpr std::uint32_t kDoubleClass = 6;
  std::string numbers;
  for (const double number : row) {
    if (type == kDouble) numbers += Bytes(std::bit_cast<std::uint64_t>(number));
    if (type == kUint16) numbers += Bytes(static_cast<std::uint16_t>(number));
    if (type == kUint8) numbers += Bytes(static_cast<std::uint8_t>(number));
  }
  return Element(kMatrix,
                 Element(kUint32, Bytes(kDoubleClass) + Bytes(std::uint32_t{0})) +
                     Element(kInt32, Bytes(1) + Bytes(static_cast<std::int32_t>(row.size()))) +
                     Element(kInt8, name) + Element(type, numbers));
}

class MatFile : public testing::InTemporaryFolder {
 protected:
  [[nodiscard]] std::vector<CalibratedCamera> Read(const std::string& bytes) const {
    return ReadCameraFile(*FindCameraFormat("matlab", "camera.mat"),
                          {.path = Write("camera.mat", bytes), .image_size = {}});
  }
  [[nodiscard]] std::string Refused(const std::string& bytes) const {
    return testing::RefusalOf([&] { (void)Read(bytes); });
  }
};

const std::string kCamera =
    Matrix("FocalLength", kDouble, {500.25, 501}) + Matrix("PrincipalPoint", kUint16, {321, 241}) +
    Matrix("ImageSize", kUint16, {480, 640}) + Matrix("RadialDistortion", kUint8, {0, 0}) +
    Matrix("TangentialDistortion", kUint8, {0, 0});

TEST_F(MatFile, HoldsWholeNumbersInFewBytes) {
  const std::vector<CalibratedCamera> cameras = Read(Header() + kCamera);
  ASSERT_EQ(cameras.size(), 1);
  EXPECT_EQ(cameras[0].model->name, "pinhole");
  EXPECT_THAT(cameras[0].params, ElementsAre(500.25, 501, 320, 240));
  EXPECT_EQ(cameras[0].image_size, (ImageSize{640, 480}));
}

// Elements that are no matrices are skipped; the skew may be missing.
TEST_F(MatFile, MayHoldOtherThings) {
  const std::vector<CalibratedCamera> cameras =
      Read(Header() + Element(kInt32, Bytes(7)) + kCamera + Matrix("Skew", kDouble, {5}) +
           Matrix("note", kUint8, {1, 2, 3}));
  EXPECT_EQ(cameras.at(0).model->name, "pinhole+skew");
  EXPECT_DOUBLE_EQ(cameras.at(0).params.back(), 5 / 500.25);
}

TEST_F(MatFile, IsRefusedWithTheReason) {
  const std::string no_mat = "is no MAT-file of level 5 in little endian";
  EXPECT_THAT(Refused(""), HasSubstr("camera.mat"));
  EXPECT_THAT(Refused(Header().substr(0, 127)), HasSubstr(no_mat));
  EXPECT_THAT(Refused("x" + Header()), HasSubstr(no_mat));
  std::string other_end = Header();
  other_end.replace(126, 2, "MI");
  EXPECT_THAT(Refused(other_end + kCamera), HasSubstr(no_mat));
  EXPECT_THAT(Refused(Header()), HasSubstr("expected a variable 'ImageSize' of 2 numbers"));
  EXPECT_THAT(Refused(Header() + Element(kCompressed, "abc") + kCamera),
              HasSubstr("compressed MAT-file; write it again with save -v6 or as JSON"));
  EXPECT_THAT(Refused(Header() + Matrix("ImageSize", kInt8, {1})),
              HasSubstr("'ImageSize' has an unexpected type in this MAT-file"));
  EXPECT_THAT(Refused(Header() + Matrix("ImageSize", kUint16, {480})),
              HasSubstr("expected a variable 'ImageSize' of 2 numbers"));
  EXPECT_THAT(Refused(Header() + Matrix("ImageSize", kUint16, {480, 640, 3})),
              HasSubstr("expected a variable 'ImageSize' of 2 numbers"));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(Refused(Header() + Matrix("ImageSize", kUint16, {480, 640}) +
                      Matrix("FocalLength", kDouble, {nan, 500})),
              HasSubstr("FocalLength is not finite"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
