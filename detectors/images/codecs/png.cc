// SPDX-License-Identifier: Apache-2.0
//
// PNG files by libpng.
#include <png.h>
#include <zlib.h>

#include <bit>
#include <new>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "detectors/images/codecs/image_codec.h"

namespace plenocal {
namespace {

constexpr const char* kPng = "PNG";

/// A reader or writer of libpng, and the message of an error.
class PngCalls {
 public:
  explicit PngCalls(bool reads)
      : png_((reads ? png_create_read_struct : png_create_write_struct)(
            PNG_LIBPNG_VER_STRING, this, &PngCalls::OnError, [](png_structp, png_const_charp) {})),
        reads_(reads) {
    if (png_ != nullptr) info_ = png_create_info_struct(png_);
    if (info_ == nullptr) throw std::bad_alloc();
  }
  ~PngCalls() {
    if (reads_) {
      png_destroy_read_struct(&png_, &info_, nullptr);
    } else {
      png_destroy_write_struct(&png_, &info_);
    }
  }
  PngCalls(const PngCalls&) = delete;
  PngCalls& operator=(const PngCalls&) = delete;

  /// False: libpng has reported an error. It leaves `calls` by longjmp, so that nothing in it may
  /// need a destructor.
  template <typename Calls>
  bool Succeed(const Calls& calls) {
    if (setjmp(png_jmpbuf(png_)) != 0) return false;
    calls(png_, info_);
    return true;
  }
  [[nodiscard]] ImageDefect Defect() const {
    return truncated_ ? internal::TruncatedImage(kPng) : internal::DamagedImage(kPng, error_);
  }
  void SetInput(internal::ByteView content) {
    rest_ = content;
    png_set_read_fn(png_, this, &PngCalls::OnRead);
    // Colour profiles, gamma, texts: of no use here, and gamma would change what is grey.
    png_set_keep_unknown_chunks(png_, PNG_HANDLE_CHUNK_NEVER, nullptr, -1);
    png_set_crc_action(png_, PNG_CRC_ERROR_QUIT, PNG_CRC_ERROR_QUIT);
  }

 private:
  static void OnError(png_structp png, png_const_charp message) {
    static_cast<PngCalls*>(png_get_error_ptr(png))->error_ = message;
    png_longjmp(png, 1);
  }
  static void OnRead(png_structp png, png_bytep out, std::size_t size) {
    auto& self = *static_cast<PngCalls*>(png_get_io_ptr(png));
    if (size > self.rest_.size()) {
      self.truncated_ = true;
      png_error(png, "");
    }
    std::copy_n(self.rest_.begin(), size, out);
    self.rest_ = self.rest_.subspan(size);
  }

  png_structp png_;
  png_infop info_ = nullptr;
  bool reads_;
  internal::ByteView rest_;
  bool truncated_ = false;
  std::string error_;
};

bool IsPng(internal::ByteView content) {
  return internal::StartsWith(content, "\x89PNG\r\n\x1a\n");
}

ImageHeader ReadPngHeader(internal::ByteView content) {
  PngCalls calls(true);
  calls.SetInput(content);
  ImageHeader header;
  const bool good =
      calls.Succeed([](png_structp png, png_infop info) { png_read_info(png, info); });
  calls.Succeed([&](png_structp png, png_infop info) {
    header.width = png_get_image_width(png, info);
    header.height = png_get_image_height(png, info);
    header.bits = png_get_bit_depth(png, info) * png_get_channels(png, info);
  });
  // The first part of a file may end behind the size.
  if (!good && header.width == 0) throw calls.Defect();
  return header;
}

cv::Mat DecodePng(internal::ByteView content, Channels channels) {
  PngCalls calls(true);
  calls.SetInput(content);
  cv::Mat image;
  std::vector<png_bytep> rows;
  int type = 0;
  cv::Size size;
  const bool is_read = calls.Succeed([&](png_structp png, png_infop info) {
    png_read_info(png, info);
    size.width = static_cast<int>(png_get_image_width(png, info));
    size.height = static_cast<int>(png_get_image_height(png, info));
    const int colours = png_get_color_type(png, info), bits = png_get_bit_depth(png, info);
    const bool grey = channels == Channels::kGrey || colours == PNG_COLOR_TYPE_GRAY;
    type = CV_MAKETYPE(bits == 16 ? CV_16U : CV_8U, grey ? 1 : 3);
    if constexpr (std::endian::native == std::endian::little) png_set_swap(png);
    png_set_strip_alpha(png);
    if (colours == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(png);
    if ((colours & PNG_COLOR_MASK_COLOR) == 0) png_set_expand_gray_1_2_4_to_8(png);
    if (grey) {
      constexpr double kRed = 0.299, kGreen = 0.587;
      png_set_rgb_to_gray(png, PNG_ERROR_ACTION_NONE, kRed, kGreen);
    } else if ((colours & PNG_COLOR_MASK_COLOR) != 0) {
      png_set_bgr(png);
    } else {
      png_set_gray_to_rgb(png);
    }
    png_set_interlace_handling(png);
    png_read_update_info(png, info);
  });
  if (!is_read) throw calls.Defect();
  image.create(size, type);
  for (int y = 0; y < image.rows; ++y) rows.push_back(image.ptr(y));
  const bool is_whole = calls.Succeed([&](png_structp png, png_infop) {
    png_read_image(png, rows.data());
    png_read_end(png, nullptr);
  });
  if (!is_whole) throw calls.Defect();
  return image;
}

std::string EncodePng(const cv::Mat& image, int /*quality*/) {
  PngCalls calls(false);
  std::string content;
  std::vector<png_const_bytep> rows;
  for (int y = 0; y < image.rows; ++y) rows.push_back(image.ptr(y));
  const bool is_written = calls.Succeed([&](png_structp png, png_infop info) {
    const auto write = [](png_structp of, png_bytep bytes, std::size_t size) {
      static_cast<std::string*>(png_get_io_ptr(of))
          ->append(reinterpret_cast<const char*>(bytes), size);
    };
    png_set_write_fn(png, &content, write, [](png_structp) {});
    // Twice as fast as libpng's default for images of cameras, which are a tenth larger.
    png_set_filter(png, PNG_FILTER_TYPE_BASE, PNG_FILTER_SUB);
    png_set_compression_level(png, Z_BEST_SPEED);
    png_set_compression_strategy(png, Z_RLE);
    png_set_IHDR(png,
                 info,
                 image.cols,
                 image.rows,
                 image.depth() == CV_16U ? 16 : 8,
                 image.channels() == 1 ? PNG_COLOR_TYPE_GRAY : PNG_COLOR_TYPE_RGB,
                 PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png, info);
    png_set_bgr(png);
    if constexpr (std::endian::native == std::endian::little) png_set_swap(png);
    png_write_image(png, const_cast<png_bytepp>(rows.data()));
    png_write_end(png, info);
  });
  if (!is_written) throw calls.Defect();
  return content;
}

}  // namespace

ImageCodec PngCodec() { return {kPng, ".png", &IsPng, &ReadPngHeader, &DecodePng, &EncodePng}; }

}  // namespace plenocal
