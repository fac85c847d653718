// SPDX-License-Identifier: Apache-2.0
//
// Image files of all kinds, read as OpenCV's imgcodecs reads them, the peer of these tests.
#include "detectors/images/image_codecs.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <jpeglib.h>
#include <tiffio.h>
#include <unistd.h>
#include <zlib.h>

#include <cstdio>
#include <cstdlib>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <thread>
#include <vector>

#include "calib/io/input_file.h"
#include "detectors/images/image.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::Not;
using Bytes = std::vector<std::uint8_t>;
constexpr int kWide = 37, kHigh = 23;

cv::Mat Noise(int type, int largest = 65535, int wide = kWide, int high = kHigh) {
  cv::Mat image(high, wide, type);
  cv::RNG random(7);
  random.fill(image, cv::RNG::UNIFORM, 0, CV_MAT_DEPTH(type) == CV_8U ? 256 : largest + 1);
  return image;
}

Bytes Encoded(const std::string& extension,
              const cv::Mat& image,
              const std::vector<int>& parameters = {}) {
  Bytes bytes;
  cv::imencode(extension, image, bytes, parameters);
  return bytes;
}

/// What OpenCV reads, by the flags that stand for `channels`.
cv::Mat ByOpenCv(const Bytes& content, Channels channels) {
  return cv::imdecode(content,
                      (channels == Channels::kGrey ? cv::IMREAD_GRAYSCALE : cv::IMREAD_ANYCOLOR) |
                          cv::IMREAD_ANYDEPTH | cv::IMREAD_IGNORE_ORIENTATION);
}

void ExpectSame(const cv::Mat& image, const cv::Mat& expected, const std::string& what) {
  ASSERT_EQ(image.size(), expected.size()) << what;
  ASSERT_EQ(image.type(), expected.type()) << what;
  EXPECT_EQ(cv::norm(image, expected, cv::NORM_INF), 0) << what;
}

void ExpectReadAsByOpenCv(const Bytes& content, const std::string& what) {
  for (const Channels channels : {Channels::kAsStored, Channels::kGrey}) {
    ExpectSame(DecodeImage(content, channels), ByOpenCv(content, channels), what);
  }
}

std::string Defect(const Bytes& content) {
  ::testing::internal::CaptureStderr();
  std::string message = "(it was read)";
  try {
    DecodeImage(content, Channels::kAsStored);
  } catch (const ImageDefect& defect) {
    message = defect.what();
  }
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
  return message;
}

TEST(ImageCodecs, ReadWhatOpenCvWrites) {
  for (const int type : {CV_8UC1, CV_8UC3, CV_8UC4, CV_16UC1, CV_16UC3, CV_16UC4}) {
    for (const std::string extension : {".png", ".jpg", ".tiff", ".bmp", ".pnm"}) {
      if (extension == ".pnm" && CV_MAT_CN(type) == 4) continue;
      ExpectReadAsByOpenCv(Encoded(extension, Noise(type)), fmt::format("{} {}", extension, type));
    }
  }
}

// ---- PNG

std::string Number(std::uint32_t value) {
  std::string text;
  for (const int shift : {24, 16, 8, 0}) text += static_cast<char>(value >> shift);
  return text;
}

std::string Chunk(const std::string& type_and_data) {
  const auto* const data = reinterpret_cast<const Bytef*>(type_and_data.data());
  const auto size = static_cast<uInt>(type_and_data.size());
  return Number(size - 4) + type_and_data +
         Number(static_cast<std::uint32_t>(crc32(0, data, size)));
}

/// A file of noise; `further` are chunks before its pixels.
Bytes Png(int colour_type, int bits, bool interlaced, const std::string& further) {
  const int channels = colour_type == 2 ? 3 : colour_type == 4 ? 2 : colour_type == 6 ? 4 : 1;
  const auto rows = [&](int width, int height) {
    std::string pixels;
    if (width == 0) return pixels;
    const cv::Mat noise = Noise(CV_8U, 255, (width * channels * bits + 7) / 8, height);
    for (int y = 0; y < height; ++y) {
      const auto filter = static_cast<char>(y % 5);
      pixels += filter + std::string(noise.ptr<char>(y), noise.ptr<char>(y) + noise.cols);
    }
    return pixels;
  };
  std::string pixels = interlaced ? "" : rows(kWide, kHigh);
  // Start and step of the passes, columns and rows.
  constexpr std::array<std::array<int, 4>, 7> kPasses{{{0, 8, 0, 8},
                                                       {4, 8, 0, 8},
                                                       {0, 4, 4, 8},
                                                       {2, 4, 0, 4},
                                                       {0, 2, 2, 4},
                                                       {1, 2, 0, 2},
                                                       {0, 1, 1, 2}}};
  for (const auto& [x, dx, y, dy] : kPasses) {
    if (interlaced) pixels += rows((kWide - x + dx - 1) / dx, (kHigh - y + dy - 1) / dy);
  }
  std::string packed(compressBound(pixels.size()), '\0');
  uLongf size = packed.size();
  compress(reinterpret_cast<Bytef*>(packed.data()),
           &size,
           reinterpret_cast<const Bytef*>(pixels.data()),
           pixels.size());
  packed.resize(size);
  const std::string header = "IHDR" + Number(kWide) + Number(kHigh) + static_cast<char>(bits) +
                             static_cast<char>(colour_type) + std::string(2, '\0') +
                             static_cast<char>(interlaced);
  std::string palette = "PLTE";
  for (int k = 0; k < 3 << bits; ++k) palette += static_cast<char>(k * 37);
  const std::string file = "\x89PNG\r\n\x1a\n" + Chunk(header) +
                           (colour_type == 3 ? Chunk(palette) : "") + further +
                           Chunk("IDAT" + packed) + Chunk("IEND");
  return {file.begin(), file.end()};
}

TEST(ImageCodecs, ReadPngOfAllColourTypesAndDepths) {
  const std::vector<std::pair<int, std::vector<int>>> kinds{
      {0, {1, 2, 4, 8, 16}}, {2, {8, 16}}, {3, {1, 2, 4, 8}}, {4, {8, 16}}, {6, {8, 16}}};
  for (const auto& [type, depths] : kinds) {
    for (const int bits : depths) {
      for (const bool interlaced : {false, true}) {
        ExpectReadAsByOpenCv(Png(type, bits, interlaced, ""),
                             fmt::format("type {}, {} bits, {}", type, bits, interlaced));
      }
    }
  }
}

// Grey of linear light would be another.
// Deflate needs a byte for 1032 at least.
TEST(ImageCodecs, ReadPngOfNothingButBlack) {
  const cv::Mat black(4000, 4000, CV_8U, cv::Scalar(0));
  const Bytes content = Encoded(".png", black, {cv::IMWRITE_PNG_COMPRESSION, 9});
  ASSERT_LT(content.size(), black.total() / 950);
  ExpectReadAsByOpenCv(content, "black");
  const auto of_rows = [](std::uint32_t rows) {
    const std::string file =
        "\x89PNG\r\n\x1a\n" +
        Chunk("IHDR" + Number(1032) + Number(rows) + std::string("\x8\0\0\0", 5)) + Chunk("IDATx") +
        Chunk("IEND");
    return Bytes(file.begin(), file.end());
  };
  const auto size = static_cast<std::uint32_t>(of_rows(1).size());
  EXPECT_THAT(Defect(of_rows(size)), Not(HasSubstr("bytes can hold")));
  EXPECT_THAT(Defect(of_rows(size + 1)), HasSubstr("bytes can hold"));
}

TEST(ImageCodecs, LeaveGammaTransparencyAndProfilesOfPngOutOfAccount) {
  const std::string gamma = Chunk("gAMA" + Number(100000)), profile = Chunk("iCCPx");
  for (const auto& [type, transparent] : std::vector<std::pair<int, std::string>>{
           {0, {"tRNS\0\1", 6}}, {2, {"tRNS\0\1\0\2\0\3", 10}}, {3, "tRNS\x80\x10"}}) {
    const Bytes plain = Png(type, 8, false, "");
    const Bytes with = Png(type, 8, false, gamma + profile + Chunk(transparent));
    for (const Channels channels : {Channels::kAsStored, Channels::kGrey}) {
      ExpectSame(DecodeImage(with, channels), DecodeImage(plain, channels), transparent);
    }
  }
}

// ---- JPEG

TEST(ImageCodecs, ReadProgressiveAndRestartedJpeg) {
  for (const int type : {CV_8UC1, CV_8UC3}) {
    for (const int parameter : {cv::IMWRITE_JPEG_PROGRESSIVE, cv::IMWRITE_JPEG_RST_INTERVAL}) {
      ExpectReadAsByOpenCv(Encoded(".jpg", Noise(type), {parameter, 1}), std::to_string(type));
    }
  }
}

TEST(ImageCodecs, ReadCmykJpeg) {
  jpeg_compress_struct jpeg{};
  jpeg_error_mgr errors{};
  jpeg.err = jpeg_std_error(&errors);
  jpeg_create_compress(&jpeg);
  unsigned char* content = nullptr;
  unsigned long size = 0;  // NOLINT(google-runtime-int): libjpeg's type
  jpeg_mem_dest(&jpeg, &content, &size);
  cv::Mat image = Noise(CV_8UC4);
  jpeg.image_width = image.cols;
  jpeg.image_height = image.rows;
  jpeg.input_components = 4;
  jpeg.in_color_space = JCS_CMYK;
  jpeg_set_defaults(&jpeg);
  jpeg_start_compress(&jpeg, TRUE);
  for (int y = 0; y < image.rows; ++y) {
    JSAMPROW row = image.ptr(y);
    jpeg_write_scanlines(&jpeg, &row, 1);
  }
  jpeg_finish_compress(&jpeg);
  jpeg_destroy_compress(&jpeg);
  const Bytes file(content, content + size);
  std::free(content);
  ExpectReadAsByOpenCv(file, "CMYK");
}

TEST(ImageCodecs, RefuseAProgressiveJpegWithoutItsLastScans) {
  const Bytes whole = Encoded(".jpg", Noise(CV_8U), {cv::IMWRITE_JPEG_PROGRESSIVE, 1});
  size_t last = whole.size() - 2;
  while (whole[last] != 0xff || whole[last + 1] != 0xc4) --last;  // tables of the last scan
  Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(last));
  cut.insert(cut.end(), {0xff, 0xd9});
  EXPECT_THAT(Defect(cut), HasSubstr("truncated JPEG"));
}

// ---- TIFF

struct TiffKind {
  int bits = 8, channels = 1, photometric = PHOTOMETRIC_MINISBLACK;
  int format = SAMPLEFORMAT_UINT, planar = PLANARCONFIG_CONTIG, orientation = ORIENTATION_TOPLEFT;
  int compression = COMPRESSION_LZW;
  bool tiled = false;
  const char* mode = "w";
};

/// A file of noise.
Bytes Tiff(const TiffKind& kind) {
  const std::string path = fmt::format("{}plenocal_codecs_{}.tiff", ::testing::TempDir(), getpid());
  TIFF* const tiff = TIFFOpen(path.c_str(), kind.mode);
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, kWide);
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, kHigh);
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, kind.bits);
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, kind.channels);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, kind.photometric);
  TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, kind.format);
  TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, kind.planar);
  TIFFSetField(tiff, TIFFTAG_ORIENTATION, kind.orientation);
  TIFFSetField(tiff, TIFFTAG_COMPRESSION, kind.compression);
  std::vector<std::uint16_t> colours(256);
  for (size_t k = 0; k < colours.size(); ++k) colours[k] = static_cast<std::uint16_t>(k * 1237);
  if (kind.photometric == PHOTOMETRIC_PALETTE) {
    TIFFSetField(tiff, TIFFTAG_COLORMAP, colours.data(), &colours[0], colours.data());
  }
  if (kind.channels == 4) {
    std::uint16_t alpha = EXTRASAMPLE_UNASSALPHA;
    TIFFSetField(tiff, TIFFTAG_EXTRASAMPLES, 1, &alpha);
  }
  constexpr int kPiece = 16;
  if (kind.tiled) {
    TIFFSetField(tiff, TIFFTAG_TILEWIDTH, kPiece);
    TIFFSetField(tiff, TIFFTAG_TILELENGTH, kPiece);
  } else {
    TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, 5);
  }
  const auto size = kind.tiled ? TIFFTileSize(tiff) : TIFFStripSize(tiff);
  const auto pieces = kind.tiled ? TIFFNumberOfTiles(tiff) : TIFFNumberOfStrips(tiff);
  cv::Mat noise = Noise(CV_8U, 255, static_cast<int>(size), static_cast<int>(pieces));
  for (std::uint32_t k = 0; k < pieces; ++k) {
    (kind.tiled ? TIFFWriteEncodedTile : TIFFWriteEncodedStrip)(
        tiff, k, noise.ptr(static_cast<int>(k)), size);
  }
  TIFFClose(tiff);
  const std::string content = ReadInput(path, InputLimit::kImage);
  std::remove(path.c_str());
  return {content.begin(), content.end()};
}

TEST(ImageCodecs, ReadTiffOfAllKinds) {
  for (const char* mode : {"wl", "wb", "w8"}) {
    for (const bool tiled : {false, true}) {
      const std::string what = std::string(mode) + (tiled ? " tiled" : " striped");
      const auto expect = [&](TiffKind kind) {
        kind.mode = mode;
        kind.tiled = tiled;
        ExpectReadAsByOpenCv(Tiff(kind), fmt::format("{} {} {}", what, kind.bits, kind.channels));
      };
      for (const int bits : {1, 8, 10, 12, 14, 16}) {
        expect({.bits = bits});
        expect({.bits = bits, .photometric = PHOTOMETRIC_MINISWHITE});
      }
      for (const int bits : {8, 16}) {
        for (const int channels : {3, 4}) {
          expect({.bits = bits, .channels = channels, .photometric = PHOTOMETRIC_RGB});
        }
      }
      expect({.photometric = PHOTOMETRIC_PALETTE});
      expect({.channels = 4, .photometric = PHOTOMETRIC_SEPARATED});
      expect({.channels = 3, .photometric = PHOTOMETRIC_RGB, .planar = PLANARCONFIG_SEPARATE});
      expect({.compression = COMPRESSION_ADOBE_DEFLATE});
    }
  }
}

TEST(ImageCodecs, ReadTiffOfFloats) {
  const cv::Mat image = Noise(CV_32F);
  ExpectSame(DecodeImage(Encoded(".tiff", image), Channels::kAsStored), image, "floats");
}

// OpenCV mixes the planes up.
TEST(ImageCodecs, ReadThePlanesOfTiffOfSixteenBits) {
  Bytes files[2];
  cv::Mat colours[2], planes[3];
  for (const int planar : {PLANARCONFIG_CONTIG, PLANARCONFIG_SEPARATE}) {
    const Bytes file = Tiff(
        {.bits = 16,
         .channels = planar == PLANARCONFIG_CONTIG ? 1 : 3,
         .photometric = planar == PLANARCONFIG_CONTIG ? PHOTOMETRIC_MINISBLACK : PHOTOMETRIC_RGB,
         .planar = planar});
    colours[planar == PLANARCONFIG_SEPARATE] = DecodeImage(file, Channels::kAsStored);
  }
  // The noise of the first plane is that of the grey image.
  cv::split(colours[1], planes);
  ExpectSame(planes[2], colours[0], "red");
}

TEST(ImageCodecs, TurnTiffUpright) {
  for (int orientation = ORIENTATION_TOPLEFT; orientation <= ORIENTATION_LEFTBOT; ++orientation) {
    for (const int bits : {8, 16}) {
      ExpectReadAsByOpenCv(Tiff({.bits = bits, .orientation = orientation}),
                           fmt::format("{} of {} bits", orientation, bits));
      // OpenCV turns each tile of 8 bits in its place.
      if (bits == 16)
        ExpectReadAsByOpenCv(Tiff({.bits = bits, .orientation = orientation, .tiled = true}),
                             "tiled");
    }
  }
}

TEST(ImageCodecs, RefuseNumbersOfOtherKinds) {
  for (const auto& [bits, format] : std::vector<std::pair<int, int>>{{8, SAMPLEFORMAT_INT},
                                                                     {16, SAMPLEFORMAT_INT},
                                                                     {32, SAMPLEFORMAT_UINT},
                                                                     {16, SAMPLEFORMAT_IEEEFP},
                                                                     {64, SAMPLEFORMAT_IEEEFP}}) {
    EXPECT_EQ(Defect(Tiff({.bits = bits, .format = format})),
              "expected 8 or 16 bits a channel; convert it");
  }
}

// ---- BMP and PNM

Bytes BytesOf(const std::string& text) { return {text.begin(), text.end()}; }

std::string Little(std::int64_t value, int bytes) {
  std::string text;
  for (int k = 0; k < bytes; ++k) text += static_cast<char>(k < 8 ? value >> 8 * k : 0);
  return text;
}

TEST(ImageCodecs, ReadBmpOfAllDepths) {
  for (const int bits : {1, 4, 8, 16, 24, 32}) {
    for (const bool upward : {true, false}) {
      for (const bool is_grey : {true, false}) {
        std::string palette;
        for (int k = 0; bits <= 8 && k < 1 << bits; ++k) {
          palette += Little(is_grey ? k * 0x010101 : k * 0x123457, 4);
        }
        const cv::Mat noise = Noise(CV_8U, 255, (kWide * bits + 31) / 32 * 4, kHigh);
        ExpectReadAsByOpenCv(
            BytesOf("BM" + Little(0, 8) + Little(54 + static_cast<int>(palette.size()), 4) +
                    Little(40, 4) + Little(kWide, 4) + Little(upward ? kHigh : -kHigh, 4) +
                    Little(1, 2) + Little(bits, 2) + Little(0, 24) + palette +
                    std::string(noise.ptr<char>(), noise.total())),
            fmt::format("{} bits, upward {}", bits, upward));
      }
    }
  }
}

TEST(ImageCodecs, RefuseBmpWithCompression) {
  std::string file(200, '\0');
  file.replace(0,
               34,
               "BM" + Little(0, 8) + Little(54, 4) + Little(40, 4) + Little(8, 4) + Little(8, 4) +
                   Little(1, 2) + Little(8, 2) + Little(1, 4));
  EXPECT_EQ(Defect(BytesOf(file)), "is a compressed BMP, which is not read; convert it to PNG");
}

TEST(ImageCodecs, ReadPnmOfBytesAndDigits) {
  for (const char* text : {"P1\n3 2\n0 1 1\n1 0 0\n",
                           "P1 3 2 011100",
                           "P2\n# 9 9\n3 2 7\n0 1 2\n3 4 7\n",
                           "P2 3 2 4095 0 1 2 3 400 4095\n",
                           "P3 1 2 255 9 8 7 0 0 255\n",
                           "P4\n11 2\nabcd",
                           "P5\n3 2\n255\nabcdef",
                           "P5 3 2 1000 abcdefabcdef",
                           "P6\n#\n1 2\n200\nabcdef",
                           "P6 1 1 65535 abcdef"}) {
    ExpectReadAsByOpenCv(BytesOf(text), text);
  }
  EXPECT_THAT(Defect(BytesOf("P5 3 2 255 abc")), HasSubstr("truncated PNM"));
  EXPECT_THAT(Defect(BytesOf("P5 3 2 70000 abc")), HasSubstr("largest value from 1 to 65535"));
  EXPECT_THAT(Defect(BytesOf("P2 3 2 255 1 2 x")), HasSubstr("PNM: expected a number"));
}

// ---- all

TEST(ImageCodecs, WriteTheFilesThatOpenCvWrites) {
  for (const int type : {CV_8UC1, CV_8UC3}) {
    EXPECT_EQ(BytesOf(EncodeImage(".jpg", Noise(type))), Encoded(".jpg", Noise(type)));
    EXPECT_EQ(BytesOf(EncodeImage(".jpg", Noise(type), 40)),
              Encoded(".jpg", Noise(type), {cv::IMWRITE_JPEG_QUALITY, 40}));
  }
  for (const int type : {CV_8UC1, CV_8UC3, CV_16UC1, CV_16UC3}) {
    EXPECT_EQ(BytesOf(EncodeImage(".png", Noise(type))), Encoded(".png", Noise(type)));
  }
  EXPECT_EQ(BytesOf(EncodeImage(".tiff", Noise(CV_32F))), Encoded(".tiff", Noise(CV_32F)));
}

TEST(ImageCodecs, GiveTheReasonOfTheLibrary) {
  Bytes png = Encoded(".png", Noise(CV_8U)), tiff = Encoded(".tiff", Noise(CV_8U));
  png[png.size() - 14] ^= 1;  // before IEND
  EXPECT_EQ(Defect(png), "PNG: IDAT: CRC error; record or copy it again, or convert it to PNG");
  std::fill_n(tiff.begin() + 8, 30, std::uint8_t{0xff});
  EXPECT_THAT(Defect(tiff), ::testing::StartsWith("TIFF: "));
  Bytes jpeg = Encoded(".jpg", Noise(CV_8U));
  const std::array<std::uint8_t, 2> marker{0xff, 0xc0};
  std::search(jpeg.begin(), jpeg.end(), marker.begin(), marker.end())[4] = 12;
  EXPECT_THAT(Defect(jpeg), HasSubstr("JPEG: Unsupported JPEG data precision 12"));
}

TEST(ImageCodecs, ReadInSeveralThreadsAtOnce) {
  constexpr int kTimes = 40;
  std::vector<std::thread> threads;
  for (const std::string extension : {".png", ".jpg", ".tiff"}) {
    threads.emplace_back([extension] {
      const Bytes good = Encoded(extension, Noise(CV_8UC3));
      const Bytes cut(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(good.size() / 2));
      const cv::Mat expected = ByOpenCv(good, Channels::kAsStored);
      for (int k = 0; k < kTimes; ++k) {
        ExpectSame(DecodeImage(good, Channels::kAsStored), expected, extension);
        EXPECT_THROW(DecodeImage(cut, Channels::kAsStored), ImageDefect);
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
}

}  // namespace TEST_FILE
}  // namespace plenocal
