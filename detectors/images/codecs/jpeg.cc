// SPDX-License-Identifier: Apache-2.0
//
// JPEG files by libjpeg-turbo.
#include <jpeglib.h>

#include <algorithm>
#include <array>
#include <csetjmp>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>
// After jpeglib.h.
#include <jerror.h>

#include "detectors/images/codecs/image_codec.h"

namespace plenocal {
namespace {

using namespace std::string_view_literals;

constexpr const char* kJpeg = "JPEG";

/// The orientation of an EXIF segment's content: a TIFF header and its first directory.
int OrientationOfExif(internal::ByteView exif) {
  constexpr int kAsRecorded = 1;
  const bool little = internal::StartsWith(exif, "II*\0"sv);
  if (exif.size() < 8 || !(little || internal::StartsWith(exif, "MM\0*"sv))) return kAsRecorded;
  const auto read = little ? internal::LittleEndian : internal::BigEndian;
  const std::size_t directory = read(exif, 4, 4);
  if (directory + 2 > exif.size()) return kAsRecorded;
  constexpr std::size_t kEntry = 12;  // tag, type, count, value
  constexpr std::uint32_t kOrientation = 0x0112, kShort = 3;
  const std::size_t end = directory + 2 + kEntry * read(exif, directory, 2);
  for (std::size_t at = directory + 2; at < end && at + kEntry <= exif.size(); at += kEntry) {
    if (read(exif, at, 2) != kOrientation || read(exif, at + 2, 2) != kShort) continue;
    const auto value = static_cast<int>(read(exif, at + 8, 2));
    return value <= 8 ? std::max(value, kAsRecorded) : kAsRecorded;
  }
  return kAsRecorded;
}

/// A decompressor or compressor of libjpeg, and the message of an error.
template <typename Struct, void (*Destroy)(Struct*)>
class JpegCalls {
 public:
  JpegCalls() {
    jpeg_.err = jpeg_std_error(&errors_.manager);
    errors_.manager.error_exit = [](j_common_ptr jpeg) {
      std::longjmp(reinterpret_cast<Errors*>(jpeg->err)->jump, 1);
    };
    errors_.manager.emit_message = [](j_common_ptr jpeg, int level) {
      auto& errors = *reinterpret_cast<Errors*>(jpeg->err);
      if (level >= 0) return;
      errors.truncated = jpeg->err->msg_code == JWRN_JPEG_EOF;
      const bool between_segments = errors.in_header && jpeg->err->msg_code == JWRN_EXTRANEOUS_DATA;
      if (errors.truncated || between_segments) std::longjmp(errors.jump, 1);
    };
  }
  ~JpegCalls() { Destroy(&jpeg_); }
  JpegCalls(const JpegCalls&) = delete;
  JpegCalls& operator=(const JpegCalls&) = delete;

  /// False: libjpeg has reported an error. It leaves `calls` by longjmp, so that nothing in it may
  /// need a destructor.
  template <typename Calls>
  bool Succeed(const Calls& calls) {
    if (setjmp(errors_.jump) != 0) return false;
    calls(&jpeg_);
    return true;
  }
  /// To the start of the first scan.
  bool ReadHeader(internal::ByteView content) {
    errors_.in_header = true;
    const bool good = Succeed([&](Struct* jpeg) {
      jpeg_create_decompress(jpeg);
      jpeg_mem_src(jpeg, content.data(), content.size());
      jpeg_save_markers(jpeg, JPEG_APP0 + 1, 0xffff);
      jpeg_read_header(jpeg, TRUE);
    });
    errors_.in_header = false;
    return good;
  }
  [[nodiscard]] ImageDefect Defect() {
    if (errors_.truncated) return internal::TruncatedImage(kJpeg);
    std::array<char, JMSG_LENGTH_MAX> message{};
    errors_.manager.format_message(reinterpret_cast<j_common_ptr>(&jpeg_), message.data());
    return internal::DamagedImage(kJpeg, message.data());
  }
  [[nodiscard]] const Struct& Get() const { return jpeg_; }

 private:
  struct Errors {
    jpeg_error_mgr manager;
    std::jmp_buf jump;
    bool in_header, truncated;
  };
  Struct jpeg_{};
  Errors errors_{};
};

using JpegReader = JpegCalls<jpeg_decompress_struct, &jpeg_destroy_decompress>;
using JpegWriter = JpegCalls<jpeg_compress_struct, &jpeg_destroy_compress>;

bool IsJpeg(internal::ByteView content) { return internal::StartsWith(content, "\xff\xd8\xff"); }

ImageHeader ReadJpegHeader(internal::ByteView content) {
  JpegReader reader;
  const bool good = reader.ReadHeader(content);
  const jpeg_decompress_struct& jpeg = reader.Get();
  // The first part of a file may end behind the size.
  if (!good && jpeg.image_width == 0) throw reader.Defect();
  ImageHeader header{.width = jpeg.image_width, .height = jpeg.image_height, .bits = 8};
  for (const auto* marker = jpeg.marker_list; marker != nullptr; marker = marker->next) {
    const internal::ByteView segment(marker->data, marker->data_length);
    constexpr std::string_view kExif = "Exif\0\0"sv;
    if (!internal::StartsWith(segment, kExif)) continue;
    header.orientation = OrientationOfExif(segment.subspan(kExif.size()));
    break;
  }
  return header;
}

/// CMYK as Adobe stores it, inverted, to BGR.
void ConvertCmyk(const std::uint8_t* cmyk, int count, std::uint8_t* bgr) {
  for (int x = 0; x < count; ++x, cmyk += 4, bgr += 3) {
    const int black = cmyk[3];
    for (int c = 0; c < 3; ++c) {
      bgr[2 - c] = static_cast<std::uint8_t>(black - ((255 - cmyk[c]) * black >> 8));
    }
  }
}

/// False: scans are missing that would refine the image.
bool HasAllScans(const jpeg_decompress_struct& jpeg) {
  for (int c = 0; jpeg.progressive_mode != 0 && c < jpeg.num_components; ++c) {
    const int(&missing_bits)[DCTSIZE2] = jpeg.coef_bits[c];
    if (std::ranges::any_of(missing_bits, [](int bits) { return bits != 0; })) return false;
  }
  return true;
}

cv::Mat DecodeJpeg(internal::ByteView content, Channels channels) {
  JpegReader reader;
  if (!reader.ReadHeader(content)) throw reader.Defect();
  const jpeg_decompress_struct& header = reader.Get();
  const bool cmyk = header.num_components == 4;
  const bool grey = !cmyk && (channels == Channels::kGrey || header.num_components == 1);
  cv::Mat image(static_cast<int>(header.image_height),
                static_cast<int>(header.image_width),
                grey ? CV_8UC1 : CV_8UC3);
  std::vector<std::uint8_t> row(cmyk ? std::size_t{4} * header.image_width : 0);
  bool is_whole = false;
  const bool good = reader.Succeed([&](j_decompress_ptr jpeg) {
    // Grey of colours is Y.
    jpeg->out_color_space = cmyk ? JCS_CMYK : grey ? JCS_GRAYSCALE : JCS_EXT_BGR;
    jpeg_start_decompress(jpeg);
    is_whole = HasAllScans(*jpeg);
    while (jpeg->output_scanline < jpeg->output_height) {
      std::uint8_t* const out = image.ptr(static_cast<int>(jpeg->output_scanline));
      JSAMPROW to = cmyk ? row.data() : out;
      jpeg_read_scanlines(jpeg, &to, 1);
      if (cmyk) ConvertCmyk(to, image.cols, out);
    }
    jpeg_finish_decompress(jpeg);
  });
  if (!good) throw reader.Defect();
  if (!is_whole) throw internal::TruncatedImage(kJpeg);
  return image;
}

std::string EncodeJpeg(const cv::Mat& image, int quality) {
  JpegWriter writer;
  unsigned char* content = nullptr;
  unsigned long size = 0;  // NOLINT(google-runtime-int): libjpeg's type
  const bool good = writer.Succeed([&](j_compress_ptr jpeg) {
    jpeg_create_compress(jpeg);
    jpeg_mem_dest(jpeg, &content, &size);
    jpeg->image_width = image.cols;
    jpeg->image_height = image.rows;
    jpeg->input_components = image.channels();
    jpeg->in_color_space = image.channels() == 1 ? JCS_GRAYSCALE : JCS_EXT_BGR;
    jpeg_set_defaults(jpeg);
    jpeg_set_quality(jpeg, quality, TRUE);
    jpeg_start_compress(jpeg, TRUE);
    while (jpeg->next_scanline < jpeg->image_height) {
      auto* row = const_cast<JSAMPROW>(image.ptr(static_cast<int>(jpeg->next_scanline)));
      jpeg_write_scanlines(jpeg, &row, 1);
    }
    jpeg_finish_compress(jpeg);
  });
  const std::unique_ptr<unsigned char, decltype(&std::free)> owner(content, &std::free);
  if (!good) throw writer.Defect();
  return {reinterpret_cast<const char*>(content), size};
}

}  // namespace

ImageCodec JpegCodec() {
  return {kJpeg, ".jpg", &IsJpeg, &ReadJpegHeader, &DecodeJpeg, &EncodeJpeg};
}

}  // namespace plenocal
