// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/image.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <filesystem>
#include <map>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "calib/base/error.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

class ReadGrayTest : public testing::InTemporaryFolder {
 protected:
  ReadGrayTest() { cv::RNG(1).fill(image_, cv::RNG::UNIFORM, 0, 256); }

  static std::string Encoded(const std::string& extension, const cv::Mat& image) {
    std::vector<uchar> bytes;
    cv::imencode(extension, image, bytes);
    return {bytes.begin(), bytes.end()};
  }
  /// What ReadGray says to a file; nothing may be printed besides.
  static std::string Message(const fs::path& path) {
    ::testing::internal::CaptureStderr();
    std::string message = "(it was read)";
    try {
      ReadGray(path);
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kInput);
      message = error.what();
      EXPECT_THAT(message, HasSubstr(path.string() + ": "));
    }
    EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
    return message;
  }

  cv::Mat image_ = cv::Mat(48, 64, CV_8UC1);
};

TEST_F(ReadGrayTest, ReadsWhatLosslessFormatsHold) {
  for (const std::string extension : {".png", ".bmp", ".tiff", ".pgm"}) {
    const cv::Mat gray = ReadGray(Write("a" + extension, Encoded(extension, image_)));
    ASSERT_EQ(gray.type(), CV_8UC1);
    EXPECT_EQ(cv::norm(gray, image_, cv::NORM_INF), 0) << extension;
  }
}

TEST_F(ReadGrayTest, ScalesSixteenBitsByTheNextPowerOfTwo) {
  cv::Mat twelve(10, 10, CV_16UC1, cv::Scalar(0));
  twelve.at<ushort>(0, 0) = 4000;
  twelve.at<ushort>(0, 1) = 2000;
  const cv::Mat gray = ReadGray(Write("a.png", Encoded(".png", twelve)));
  ASSERT_EQ(gray.type(), CV_8UC1);
  EXPECT_EQ(gray.at<uchar>(0, 0), 249);  // 4000 * 255 / 4095
  EXPECT_EQ(gray.at<uchar>(0, 1), 125);
  EXPECT_EQ(gray.at<uchar>(5, 5), 0);
}

TEST_F(ReadGrayTest, NamesWhatIsWrongWithTheFile) {
  EXPECT_THAT(Message(folder_ / "03.png"), HasSubstr("03.png: no such file"));
  EXPECT_THAT(Message(folder_), HasSubstr("is a directory"));
  EXPECT_THAT(Message(Write("empty.png", "")), HasSubstr("is empty (0 bytes)"));
  EXPECT_THAT(Message(Write("text.jpg", "not an image")),
              HasSubstr("is not an image; expected one of BMP, JPEG, PNG, PNM, TIFF"));
}

TEST_F(ReadGrayTest, RefusesFilesCutAnywhere) {
  for (const std::string extension : {".png", ".jpg", ".bmp", ".tiff", ".pgm"}) {
    const std::string whole = Encoded(extension, image_);
    for (std::size_t size = 1; size < whole.size(); size += 1 + whole.size() / 60) {
      const std::string message = Message(Write("cut" + extension, whole.substr(0, size)));
      EXPECT_NE(message, "(it was read)") << extension << " cut to " << size;
    }
    const std::string almost =
        Message(Write("cut" + extension, whole.substr(0, whole.size() * 3 / 4)));
    EXPECT_THAT(almost, HasSubstr("truncated")) << extension;
    EXPECT_THAT(almost, HasSubstr("; record or copy it again"));
  }
  const std::string png = Encoded(".png", image_);
  EXPECT_THAT(Message(Write("cut.png", png.substr(0, png.size() / 2))),
              HasSubstr("truncated PNG (the file ends inside the image)"));
}

TEST_F(ReadGrayTest, RefusesAPngWithADamagedByte) {
  std::string png = Encoded(".png", image_);
  png[png.size() / 2] = static_cast<char>(png[png.size() / 2] ^ 1);
  EXPECT_THAT(Message(Write("a.png", png)), HasSubstr("PNG: IDAT: "));
}

TEST_F(ReadGrayTest, ToleratesBytesAfterTheEnd) {
  for (const std::string extension : {".png", ".jpg", ".bmp", ".pgm"}) {
    EXPECT_EQ(Message(Write("a" + extension, Encoded(extension, image_) + "trailer")),
              "(it was read)");
  }
}

TEST_F(ReadGrayTest, RefusesAHeaderThatAsksForAbsurdMemory) {
  std::string bmp = Encoded(".bmp", image_);
  const std::string huge("\xa0\x86\x01\x00", 4);  // 100000
  bmp.replace(18, 4, huge).replace(22, 4, huge);
  EXPECT_THAT(Message(Write("a.bmp", bmp)), HasSubstr("100000 x 100000 pixels"));
  EXPECT_THAT(Message(Write("a.pgm", "P5 100000 100000 255\n")),
              HasSubstr("100000 x 100000 pixels"));
}

// The files would hold such images.
TEST_F(ReadGrayTest, RefusesMorePixelsOrBytesThanTheLargestCamerasHave) {
  const std::string most = "; at most 268 million are read; record or copy it again";
  std::string png = Encoded(".png", image_);
  const auto number = [](std::uint32_t value) {
    std::string text;
    for (const int shift : {24, 16, 8, 0}) text += static_cast<char>(value >> shift);
    return text;
  };
  constexpr size_t kHeader = 12, kSize = 16, kDepth = 24, kType = 25, kCrc = 29;  // places
  const auto with_header = [&](std::uint32_t side, char depth, char type) {
    std::string changed = png;
    changed.replace(kSize, 8, number(side) + number(side));
    changed[kDepth] = depth;
    changed[kType] = type;
    const auto* const header = reinterpret_cast<const unsigned char*>(changed.data()) + kHeader;
    changed.replace(kCrc, 4, number(static_cast<std::uint32_t>(crc32(0, header, kCrc - kHeader))));
    return changed;
  };
  EXPECT_THAT(Message(Write("a.png", with_header(16385, 8, 0))),
              HasSubstr("16385 x 16385 pixels" + most));
  EXPECT_THAT(Message(Write("a.png", with_header(16000, 16, 6))),
              HasSubstr("16000 x 16000 pixels of 64 bits; at most 960 MB are read"));
  EXPECT_THAT(Message(Write("a.png", with_header(16000, 8, 0))), HasSubstr("bytes can hold"));
  EXPECT_THAT(Message(Write("a.pgm", "P5 16384 16385 255\n")), HasSubstr("16385 pixels" + most));
}

TEST_F(ReadGrayTest, NamesTheFormatThatIsNotRead) {
  std::string dicom(128, '\0');
  dicom += "DICM";
  const std::string jp2("\0\0\0\x0cjP  \r\n\x87\n", 12);
  const std::map<std::string, std::string> names{{"GIF89a", "GIF"},
                                                 {"RIFF....WEBPVP8 ", "WebP"},
                                                 {jp2, "JPEG 2000"},
                                                 {"#?RADIANCE\n", "Radiance HDR"},
                                                 {"Pf 9 9 1", "PFM"},
                                                 {dicom, "DICOM"}};
  for (const auto& [content, name] : names) {
    EXPECT_THAT(Message(Write("a.png", content)),
                AllOf(HasSubstr("a.png: is a " + name + " file; expected one of BMP, JPEG, PNG"),
                      HasSubstr("with 8 or 16 bits a channel: convert it")));
  }
}

TEST_F(ReadGrayTest, KeepsTheRecordedOrientation) {
  // A JPEG with an EXIF segment that asks viewers for a quarter turn.
  const std::string exif(
      "\xff\xe1\x00\x22"
      "Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0",
      36);
  std::string jpeg = Encoded(".jpg", image_);
  jpeg.insert(2, exif);
  EXPECT_EQ(ReadGray(Write("a.jpg", jpeg)).size(), image_.size());
  EXPECT_EQ(ReadOrientation({.frame = {}, .path = Write("a.jpg", jpeg)}), 6);
  EXPECT_EQ(ReadOrientation({.frame = {}, .path = Write("a.png", Encoded(".png", image_))}), 1);
}

// Nothing is packed more than an image of one grey value.
TEST_F(ReadGrayTest, ReadsEmptyImagesAndRefusesHeadersOfMoreThanTheirFileHolds) {
  const cv::Mat empty(3000, 3000, CV_8UC1, cv::Scalar(255));
  for (const std::string format : {".png", ".jpg", ".tiff"}) {
    EXPECT_EQ(Message(Write("empty" + format, Encoded(format, empty))), "(it was read)");
  }
  std::string jpeg = Encoded(".jpg", image_);
  const size_t frame = jpeg.find("\xff\xc0");
  ASSERT_NE(frame, std::string::npos);
  jpeg.replace(frame + 5, 4, "\x3e\x80\x3e\x80");  // 16000 x 16000
  EXPECT_THAT(Message(Write("large.jpg", jpeg)), HasSubstr("bytes can hold"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
