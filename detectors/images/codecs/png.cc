// SPDX-License-Identifier: Apache-2.0
//
// PNG files by libpng; grey ones by libdeflate, which takes a third of the time.
#include <libdeflate.h>
#include <png.h>
#include <zlib.h>

#include <array>
#include <bit>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <new>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <utility>
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

/// Takes the filter of a row's bytes off; `kStep`: bytes of a pixel, `above`: the row before.
template <std::size_t kStep>
bool Unfilter(int filter, std::span<std::uint8_t> row, const std::uint8_t* above) {
  // In registers: read back from the row, each byte would wait until it is stored.
  std::array<int, kStep> left{}, above_left{};
  const auto add = [&](const auto& predict) {
    for (std::size_t i = 0; i < row.size(); i += kStep) {
      for (std::size_t k = 0; k < kStep; ++k) {
        const int up = above[i + k];
        left[k] = (row[i + k] + predict(left[k], up, above_left[k])) & 0xff;
        above_left[k] = up;
        row[i + k] = static_cast<std::uint8_t>(left[k]);
      }
    }
  };
  switch (filter) {
    case PNG_FILTER_VALUE_NONE:
      return true;
    case PNG_FILTER_VALUE_SUB:
      add([](int a, int, int) { return a; });
      return true;
    case PNG_FILTER_VALUE_UP:
      for (std::size_t i = 0; i < row.size(); ++i) row[i] += above[i];
      return true;
    case PNG_FILTER_VALUE_AVG:
      add([](int a, int b, int) { return (a + b) / 2; });
      return true;
    case PNG_FILTER_VALUE_PAETH:
      add([](int a, int b, int c) {
        const int to_a = std::abs(b - c), to_b = std::abs(a - c), to_c = std::abs(a + b - 2 * c);
        return to_a <= to_b && to_a <= to_c ? a : to_b <= to_c ? b : c;
      });
      return true;
    default:
      return false;
  }
}

/// The rows of an image with their filters; false for an unknown filter.
template <typename T>
bool TakeRows(std::uint8_t* rows, cv::Mat* image) {
  const std::size_t size = image->cols * sizeof(T);
  const std::vector<std::uint8_t> nothing(size);
  const std::uint8_t* above = nothing.data();
  for (int y = 0; y < image->rows; ++y, rows += size + 1) {
    const std::span row(rows + 1, size);
    if (!Unfilter<sizeof(T)>(*rows, row, above)) return false;
    above = row.data();
    T* const out = image->ptr<T>(y);
    if constexpr (sizeof(T) == 1) {
      std::memcpy(out, above, size);
    } else {
      for (int x = 0; x < image->cols; ++x) {
        out[x] = static_cast<T>(above[2 * x] << 8 | above[2 * x + 1]);
      }
    }
  }
  return true;
}

/// The compressed pixels of a file of grey values without interlacing, and its header; nothing for
/// others and for what libpng refuses or warns of.
struct GreyFile {
  int width = 0, height = 0, bits = 0;
  std::vector<std::uint8_t> pixels;
};

std::optional<GreyFile> ReadGreyFile(internal::ByteView content) {
  constexpr std::size_t kMagic = 8, kAround = 12;  // bytes of length, type, and check sum
  GreyFile file;
  for (std::size_t at = kMagic; at + kAround <= content.size();) {
    const std::size_t size = internal::BigEndian(content, at, 4);
    if (size > content.size() - at - kAround) return std::nullopt;
    const internal::ByteView chunk = content.subspan(at + 8, size);
    if (libdeflate_crc32(0, chunk.data() - 4, size + 4) !=
        internal::BigEndian(content, at + 8 + size, 4)) {
      return std::nullopt;
    }
    const internal::ByteView type = content.subspan(at + 4, 4);
    const bool is_first = at == kMagic;
    at += size + kAround;
    if (is_first) {
      constexpr std::size_t kHeader = 13, kColours = 9, kInterlacing = 12;
      if (!internal::StartsWith(type, "IHDR") || size != kHeader) return std::nullopt;
      file.bits = chunk[8];
      if (chunk[kColours] != PNG_COLOR_TYPE_GRAY || chunk[kInterlacing] != PNG_INTERLACE_NONE ||
          chunk[10] != 0 || chunk[11] != 0 || (file.bits != 8 && file.bits != 16)) {
        return std::nullopt;
      }
      file.width = static_cast<int>(internal::BigEndian(chunk, 0, 4));
      file.height = static_cast<int>(internal::BigEndian(chunk, 4, 4));
    } else if (internal::StartsWith(type, "IDAT")) {
      file.pixels.insert(file.pixels.end(), chunk.begin(), chunk.end());
    } else if (internal::StartsWith(type, "IEND")) {
      return file;
    } else if ((type[0] & 0x20) == 0) {
      return std::nullopt;  // a critical one
    }
  }
  return std::nullopt;
}

std::optional<cv::Mat> DecodeGreyPng(internal::ByteView content) {
  const std::optional<GreyFile> file = ReadGreyFile(content);
  if (!file) return std::nullopt;
  const std::size_t bytes = file->bits / 8;
  const std::size_t size = file->height * (1 + file->width * bytes);
  const std::unique_ptr<std::uint8_t[]> rows(new std::uint8_t[size]);
  const std::unique_ptr<libdeflate_decompressor, decltype(&libdeflate_free_decompressor)>
      decompressor(libdeflate_alloc_decompressor(), &libdeflate_free_decompressor);
  if (!decompressor) throw std::bad_alloc();
  if (libdeflate_zlib_decompress(decompressor.get(),
                                 file->pixels.data(),
                                 file->pixels.size(),
                                 rows.get(),
                                 size,
                                 nullptr) != LIBDEFLATE_SUCCESS) {
    return std::nullopt;
  }
  cv::Mat image(file->height, file->width, bytes == 1 ? CV_8U : CV_16U);
  const bool good = bytes == 1 ? TakeRows<std::uint8_t>(rows.get(), &image)
                               : TakeRows<std::uint16_t>(rows.get(), &image);
  return good ? std::optional(image) : std::nullopt;
}

cv::Mat DecodePng(internal::ByteView content, Channels channels) {
  if (std::optional<cv::Mat> grey = DecodeGreyPng(content)) return *grey;
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
