// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/image_codecs.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <limits>
#include <optional>

#include "calib/io/input_file.h"
#include "detectors/images/image_header.h"

namespace plenocal {
namespace {

using internal::ByteView, internal::StartsWith;
using namespace std::string_view_literals;

constexpr const char* kAgain = "; record or copy it again";

struct OtherFormat {
  std::size_t at;  // of the magic bytes
  std::string_view magic;
  std::string_view name;
};

constexpr std::array kOtherFormats{OtherFormat{0, "GIF8", "GIF"},
                                   OtherFormat{8, "WEBP", "WebP"},
                                   OtherFormat{0, "\xff\x4f\xff\x51", "JPEG 2000"},
                                   OtherFormat{4, "jP  \r\n\x87\n", "JPEG 2000"},
                                   OtherFormat{0, "\xff\x0a", "JPEG XL"},
                                   OtherFormat{4, "JXL ", "JPEG XL"},
                                   OtherFormat{4, "ftyp", "HEIF or AVIF"},
                                   OtherFormat{0, "\x76\x2f\x31\x01", "OpenEXR"},
                                   OtherFormat{0, "#?", "Radiance HDR"},
                                   OtherFormat{0, "PF", "PFM"},
                                   OtherFormat{0, "Pf", "PFM"},
                                   OtherFormat{0, "P7", "PAM"},
                                   OtherFormat{0, "\x59\xa6\x6a\x95", "Sun raster"},
                                   OtherFormat{0, "8BPS", "Photoshop"},
                                   OtherFormat{128, "DICM", "DICOM"}};

const ImageCodec* FindCodec(ByteView content) {
  const auto codecs = ImageCodecs();
  const auto found = std::ranges::find_if(
      codecs, [&](const ImageCodec& codec) { return codec.is_format(content); });
  return found == codecs.end() ? nullptr : &*found;
}

[[noreturn]] void RefuseFormat(ByteView content) {
  std::string known;
  for (const ImageCodec& codec : ImageCodecs()) {
    known += (known.empty() ? "" : ", ") + std::string(codec.name);
  }
  for (const OtherFormat& other : kOtherFormats) {
    if (content.size() <= other.at || !StartsWith(content.subspan(other.at), other.magic)) continue;
    throw ImageDefect(
        fmt::format("is a {0} file; expected one of {1} with 8 or 16 bits a channel: convert it, "
                    "for instance by ImageMagick's 'convert IMAGE IMAGE.png'",
                    other.name,
                    known));
  }
  throw ImageDefect(fmt::format("is not an image; expected one of {}", known));
}

/// The size stated by the header of a file of `bytes`: no codec packs an image more than deflate
/// does at best, so the memory for an image is bounded by its file's size too.
void CheckSize(const ImageHeader& header, std::uint64_t bytes) {
  const auto [width, height, bits, orientation] = header;
  constexpr std::uint64_t kMostSide = std::uint64_t{1} << 31;  // the product fits 64 bits
  if (width == 0 || height == 0 || width > kMostSide || height > kMostSide ||
      width * height > kMostPixels) {
    throw ImageDefect("the header states " + PixelsText(width, height) + kAgain);
  }
  constexpr auto kMostBytes = static_cast<std::uint64_t>(InputLimit::kImage);
  if (width * height * bits / 8 > kMostBytes) {
    throw ImageDefect(
        fmt::format("the header states {} x {} pixels of {} bits; at most {} MB are read{}",
                    width,
                    height,
                    bits,
                    kMostBytes >> 20,
                    kAgain));
  }
  constexpr std::uint64_t kMostBytesOfOne = 1032;
  if (width * height * bits / 8 > kMostBytesOfOne * bytes) {
    throw ImageDefect(fmt::format("the header states {} x {} pixels, more than {} bytes can hold{}",
                                  width,
                                  height,
                                  bytes,
                                  kAgain));
  }
}

std::optional<ImageHeader> TryHeader(ByteView start) {
  const ImageCodec* const codec = FindCodec(start);
  if (codec == nullptr) return std::nullopt;
  try {
    return codec->read_header(start);
  } catch (const ImageDefect&) {
    return std::nullopt;
  }
}

}  // namespace

ImageDefect internal::TruncatedImage(std::string_view format) {
  return ImageDefect(
      fmt::format("truncated {} (the file ends inside the image){}", format, kAgain));
}

ImageDefect internal::DamagedImage(std::string_view format, std::string_view reason) {
  return ImageDefect(fmt::format("{}: {}{}, or convert it to PNG", format, reason, kAgain));
}

cv::Mat internal::GreyOfBgr(const cv::Mat& bgr, const GreyWeights& weights) {
  const auto [red, green, bits, round] = weights;
  const std::uint32_t blue = (1u << bits) - red - green, half = round ? 1u << (bits - 1) : 0;
  cv::Mat grey(bgr.size(), bgr.depth());
  const auto convert = [&, red = red, green = green, bits = bits]<typename T>(T) {
    for (int y = 0; y < bgr.rows; ++y) {
      const T* in = bgr.ptr<T>(y);
      T* const out = grey.ptr<T>(y);
      for (int x = 0; x < bgr.cols; ++x, in += 3) {
        out[x] = static_cast<T>((in[0] * blue + in[1] * green + in[2] * red + half) >> bits);
      }
    }
  };
  bgr.depth() == CV_8U ? convert(std::uint8_t{}) : convert(std::uint16_t{});
  return grey;
}

cv::Mat DecodeImage(ByteView content, Channels channels) {
  const ImageCodec* const codec = FindCodec(content);
  if (codec == nullptr) RefuseFormat(content);
  CheckSize(codec->read_header(content), content.size());
  cv::Mat image = codec->decode(content, channels);
  return channels == Channels::kGrey && image.channels() == 3 ? internal::GreyOfBgr(image) : image;
}

std::optional<ImageSize> SizeInHeader(ByteView start) {
  constexpr std::uint64_t kMost = std::numeric_limits<int>::max();
  const auto header = TryHeader(start);
  if (!header || header->width == 0 || header->height == 0 || header->width > kMost ||
      header->height > kMost) {
    return std::nullopt;
  }
  return ImageSize{static_cast<int>(header->width), static_cast<int>(header->height)};
}

bool HasSizeFurtherBack(ByteView start) {
  return FindCodec(start) != nullptr && !SizeInHeader(start);
}

int OrientationInHeader(ByteView file) {
  return TryHeader(file).value_or(ImageHeader{}).orientation;
}

std::string PixelsText(std::uint64_t width, std::uint64_t height) {
  std::string text = fmt::format("{} x {} pixels", width, height);
  constexpr std::uint64_t kMillion = 1'000'000;
  if (width * height > kMostPixels) {
    text += fmt::format("; at most {} million are read", kMostPixels / kMillion);
  }
  return text;
}

}  // namespace plenocal
