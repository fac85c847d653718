// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/image.h"

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "calib/base/error.h"
#include "calib/io/detection_cache.h"
#include "calib/io/input_file.h"
#include "detectors/images/bytes.h"
#include "detectors/images/image_codecs.h"
#include "detectors/images/image_header.h"
#include "detectors/images/orientation_tag.h"
#include "detectors/images/stored/stored_pixels.h"

// The decoders fill missing parts with gray, with a line on stderr or without any. So the structure
// of a file is checked first, and only complete files reach a decoder.

namespace plenocal {
namespace {

namespace fs = std::filesystem;
using Bytes = std::vector<std::uint8_t>;
using internal::BigEndian, internal::ByteView, internal::LittleEndian, internal::StartsWith;

/// The first defect of a file in words, or nothing.
using Defect = std::optional<std::string>;

/// `bits` a pixel, or fewer, in a file of `bytes`: no codec packs an image more than deflate does
/// at best, so the memory for an image is bounded by its file's size too.
Defect CheckSize(std::uint64_t width,
                 std::uint64_t height,
                 std::uint64_t bits,
                 std::uint64_t bytes) {
  constexpr std::uint64_t kMostBytesOfOne = 1032;
  if (width == 0 || height == 0 || width * height > kMostPixels) {
    return "the header says " + PixelsText(width, height);
  }
  constexpr auto kMostBytes = static_cast<std::uint64_t>(InputLimit::kImage);
  if (width * height * bits / 8 > kMostBytes) {
    return fmt::format("the header says {} x {} pixels of {} bits; at most {} MB are read",
                       width,
                       height,
                       bits,
                       kMostBytes >> 20);
  }
  if (width * height * bits / 8 > kMostBytesOfOne * bytes) {
    return fmt::format(
        "the header says {} x {} pixels, more than {} bytes can hold", width, height, bytes);
  }
  return std::nullopt;
}

/// The CRC of PNG (ISO 3309), over chunk type and data.
std::uint32_t Crc(ByteView bytes) {
  return static_cast<std::uint32_t>(crc32_z(0, bytes.data(), bytes.size()));
}

constexpr std::string_view kPngMagic = "\x89PNG\r\n\x1a\n";

/// Of a colour type, whose bits are: palette, colour, alpha.
std::uint64_t PngChannels(std::uint8_t colour_type) {
  if ((colour_type & 1) != 0) return 1;
  return ((colour_type & 2) != 0 ? 3 : 1) + ((colour_type & 4) != 0 ? 1 : 0);
}

/// Walks the chunks up to IEND, and drops the ancillary ones from `bytes`: libpng would complain on
/// stderr about colour profiles that do not matter here.
Defect CheckPng(Bytes* bytes) {
  const ByteView in(*bytes);
  Bytes kept(in.begin(), in.begin() + kPngMagic.size());
  std::size_t at = kPngMagic.size();
  std::string last = "signature";
  while (true) {
    if (in.size() - at < 12) return fmt::format("truncated PNG (the file ends after the {})", last);
    const std::uint32_t length = BigEndian(in, at, 4);
    const std::string type(in.begin() + at + 4, in.begin() + at + 8);
    if (!std::all_of(type.begin(), type.end(), [](unsigned char c) { return std::isalpha(c); })) {
      return fmt::format("corrupt PNG (no chunk follows the {})", last);
    }
    if (in.size() - at - 12 < length) {
      return fmt::format("truncated PNG (the file ends inside the chunk {})", type);
    }
    if (Crc(in.subspan(at + 4, length + 4)) != BigEndian(in, at + 8 + length, 4)) {
      return fmt::format("corrupt PNG (wrong checksum of the chunk {})", type);
    }
    if (at == kPngMagic.size()) {
      if (type != "IHDR" || length < 13) return "corrupt PNG (it does not begin with IHDR)";
      const std::uint64_t bits = in[at + 16] * PngChannels(in[at + 17]);
      if (auto defect =
              CheckSize(BigEndian(in, at + 8, 4), BigEndian(in, at + 12, 4), bits, in.size())) {
        return defect;
      }
    }
    const std::size_t end = at + 12 + length;
    // Upper case: critical. Without tRNS a palette's colours stay what they are.
    if (std::isupper(static_cast<unsigned char>(type[0])) != 0) {
      kept.insert(kept.end(), in.begin() + at, in.begin() + end);
    }
    if (type == "IEND") break;
    last = "chunk " + type;
    at = end;
  }
  *bytes = std::move(kept);
  return std::nullopt;
}

/// Walks the segments and the entropy-coded scans up to EOI; bytes after it do no harm.
Defect CheckJpeg(ByteView in) {
  std::size_t at = 2;
  bool in_scan = false;
  while (true) {
    // To the next marker: 0xff followed by neither a stuffed 0 nor, within a scan, a restart.
    if (!in_scan && at < in.size() && in[at] != 0xff) return "corrupt JPEG (a segment is missing)";
    while (at + 1 < in.size() && (in[at] != 0xff || in[at + 1] == 0 || in[at + 1] == 0xff ||
                                  (in_scan && in[at + 1] >= 0xd0 && in[at + 1] <= 0xd7))) {
      ++at;
    }
    if (at + 1 >= in.size()) {
      return fmt::format("truncated JPEG (the file ends inside {})",
                         in_scan ? "the image data" : "its header");
    }
    const std::uint8_t marker = in[at + 1];
    if (marker == 0xd9) {
      if (!in_scan) return "corrupt JPEG (it has no image data)";
      return std::nullopt;
    }
    if (at + 4 > in.size()) return "truncated JPEG (the file ends inside its header)";
    const std::uint32_t length = BigEndian(in, at + 2, 2);
    if (length < 2) return "corrupt JPEG (a segment has no length)";
    if (at + 2 + length > in.size()) return "truncated JPEG (the file ends inside its header)";
    const bool start_of_frame =
        marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (start_of_frame && length >= 7) {
      if (auto defect =
              CheckSize(BigEndian(in, at + 7, 2), BigEndian(in, at + 5, 2), 8, in.size())) {
        return defect;
      }
    }
    in_scan = marker == 0xda;
    at += 2 + length;
  }
}

Defect CheckBmp(ByteView in) {
  constexpr std::size_t kHeader = 30;
  if (in.size() < kHeader) return "truncated BMP (the file ends inside its header)";
  if (LittleEndian(in, 14, 4) < 40) return std::nullopt;  // OS/2's: left to the decoder
  const auto width = static_cast<std::int32_t>(LittleEndian(in, 18, 4));
  const auto height = static_cast<std::int32_t>(LittleEndian(in, 22, 4));
  const std::uint64_t rows = std::abs(static_cast<std::int64_t>(height));
  if (width < 0) return "corrupt BMP (negative width)";
  const std::uint64_t bits = LittleEndian(in, 28, 2);
  if (auto defect = CheckSize(width, rows, bits, in.size())) return defect;
  constexpr std::size_t kCompression = 30;
  if (in.size() < kCompression + 4 || LittleEndian(in, kCompression, 4) != 0) return std::nullopt;
  const std::uint64_t row_bytes = (width * bits + 31) / 32 * 4;
  const std::uint64_t expected = LittleEndian(in, 10, 4) + row_bytes * rows;
  if (in.size() < expected) {
    return fmt::format("truncated BMP ({} bytes where {} are expected)", in.size(), expected);
  }
  return std::nullopt;
}

/// Binary PGM and PPM.
Defect CheckPnm(ByteView in) {
  std::size_t at = 2;
  std::array<std::uint64_t, 3> numbers{};  // width, height, largest value
  for (std::uint64_t& number : numbers) {
    while (at < in.size() && (std::isspace(in[at]) != 0 || in[at] == '#')) {
      if (in[at] == '#') {
        while (at < in.size() && in[at] != '\n') ++at;
      } else {
        ++at;
      }
    }
    if (at == in.size() || std::isdigit(in[at]) == 0) return "corrupt PGM or PPM header";
    while (at < in.size() && std::isdigit(in[at]) != 0 && number <= kMostPixels) {
      number = number * 10 + (in[at++] - '0');
    }
  }
  const std::uint64_t bytes = (in[1] == '6' ? 3 : 1) * (numbers[2] > 255 ? 2 : 1);  // a pixel
  if (auto defect = CheckSize(numbers[0], numbers[1], 8 * bytes, in.size())) return defect;
  const std::uint64_t expected = at + 1 + numbers[0] * numbers[1] * bytes;
  if (in.size() < expected) {
    return fmt::format(
        "truncated PGM or PPM ({} bytes where {} are expected)", in.size(), expected);
  }
  return std::nullopt;
}

/// The strips or tiles of the first image must lie within the file.
Defect CheckTiff(ByteView in) {
  const bool big = in[0] == 'M';
  const auto read = [&](std::uint64_t at, int size) -> std::optional<std::uint64_t> {
    if (at + size > in.size()) return std::nullopt;
    return big ? BigEndian(in, at, size) : LittleEndian(in, at, size);
  };
  const std::string truncated = "truncated TIFF (the file ends before its image data do)";
  if (in.size() < 8) return truncated;
  const std::uint64_t directory = *read(4, 4);
  const auto entries = read(directory, 2);
  if (!entries) return truncated;
  std::uint64_t width = 1, height = 1, bits = 1, channels = 1;
  std::vector<std::uint64_t> offsets, counts;
  for (std::uint64_t k = 0; k < *entries; ++k) {
    const std::uint64_t at = directory + 2 + 12 * k;
    const auto tag = read(at, 2), type = read(at + 2, 2), count = read(at + 4, 4);
    if (!read(at + 8, 4)) return truncated;
    const int size = *type == 3 ? 2 : 4;  // SHORT, else LONG: all that these tags may have
    const auto values = [&]() -> std::optional<std::vector<std::uint64_t>> {
      const std::uint64_t start = *count * size <= 4 ? at + 8 : *read(at + 8, 4);
      if (start + *count * size > in.size()) return std::nullopt;
      std::vector<std::uint64_t> out(*count);
      for (std::uint64_t i = 0; i < *count; ++i) out[i] = *read(start + i * size, size);
      return out;
    };
    constexpr int kWidth = 256, kHeight = 257, kBits = 258, kStripOffsets = 273, kChannels = 277,
                  kStripCounts = 279, kTileOffsets = 324, kTileCounts = 325;
    switch (*tag) {
      case kWidth:
        width = *read(at + 8, size);
        break;
      case kHeight:
        height = *read(at + 8, size);
        break;
      case kChannels:
        channels = *read(at + 8, size);
        break;
      case kBits: {
        const auto all = values();
        if (!all) return truncated;
        if (!all->empty()) bits = all->front();
        break;
      }
      case kStripOffsets:
      case kTileOffsets:
      case kStripCounts:
      case kTileCounts: {
        auto all = values();
        if (!all) return truncated;
        (*tag == kStripOffsets || *tag == kTileOffsets ? offsets : counts) = std::move(*all);
        break;
      }
      default:
        break;
    }
  }
  // Of a 16-bit field both are at most 65535, so that the product of all is far from overflow.
  if (auto defect = CheckSize(width, height, (bits & 0xffff) * (channels & 0xffff), in.size())) {
    return defect;
  }
  for (std::size_t i = 0; i < std::min(offsets.size(), counts.size()); ++i) {
    if (offsets[i] + counts[i] > in.size()) return truncated;
  }
  return std::nullopt;
}

constexpr std::string_view kJpeg2000 = "\xff\x4f\xff\x51";        // a codestream alone
constexpr std::string_view kJp2{"\0\0\0\x0cjP  \r\n\x87\n", 12};  // in a box

/// The header of the codestream: the decoder holds 32 bits a channel.
Defect CheckJpeg2000(ByteView in) {
  constexpr std::size_t kBox = 8, kLongBox = 16, kHeader = 42;  // bytes
  constexpr std::uint32_t kStream = 0x6a703263;                 // "jp2c"
  while (!StartsWith(in, kJpeg2000)) {
    if (in.size() < kLongBox) return "truncated JPEG 2000";
    std::size_t length = BigEndian(in, 0, 4);
    if (BigEndian(in, 4, 4) == kStream) length = length == 1 ? kLongBox : kBox;
    if (length < kBox || length > in.size()) return "corrupt JPEG 2000 (no box follows another)";
    in = in.subspan(length);
  }
  if (in.size() < kHeader) return "truncated JPEG 2000";
  const auto side = [&](std::size_t end, std::size_t start) {
    return BigEndian(in, end, 4) - BigEndian(in, start, 4);
  };
  return CheckSize(side(8, 16), side(12, 20), 32 * BigEndian(in, 40, 2), in.size());
}

Defect CheckIntegrity(Bytes* bytes) {
  const ByteView in(*bytes);
  if (StartsWith(in, kPngMagic)) return CheckPng(bytes);
  if (StartsWith(in, "\xff\xd8")) return CheckJpeg(in);
  if (StartsWith(in, "BM")) return CheckBmp(in);
  if (StartsWith(in, "P5") || StartsWith(in, "P6")) return CheckPnm(in);
  if (StartsWith(in, kJpeg2000) || StartsWith(in, kJp2)) return CheckJpeg2000(in);
  using namespace std::string_view_literals;
  if (StartsWith(in, "II*\0"sv) || StartsWith(in, "MM\0*"sv)) return CheckTiff(in);
  return std::nullopt;
}

[[noreturn]] void Refuse(const fs::path& path, std::string_view reason) {
  throw Error(ErrorKind::kInput, fmt::format("{}: {}", path.string(), reason));
}

void RefuseEmpty(const Bytes& content, const fs::path& path) {
  if (content.empty()) Refuse(path, "is empty (0 bytes); record or copy it again");
}

Bytes ReadFile(const fs::path& path) {
  const std::string content = ReadInput(path, InputLimit::kImage);
  Bytes bytes(content.begin(), content.end());
  RefuseEmpty(bytes, path);
  return bytes;
}

/// What `make` returns; names the file where the memory does not suffice.
template <typename Make>
auto WithinMemory(const fs::path& path, const Make& make) {
  constexpr const char* kReason = "needs more memory than there is";
  try {
    return make();
  } catch (const std::bad_alloc&) {
    Refuse(path, kReason);
  } catch (const cv::Exception& error) {
    if (error.code == cv::Error::StsNoMem) Refuse(path, kReason);
    throw;
  }
}

/// An image in a store.
StoredImage ReadStored(const FrameImage& image) {
  StoredImage stored = WithinMemory(image.path, [&] { return image.store->Read(image.index); });
  RefuseEmpty(stored.bytes, image.path);
  return stored;
}

constexpr const char* kDepth = "expected 8 or 16 bits a channel; convert it";

/// The image of a file's content; `flags` of cv::imdecode.
cv::Mat Decoded(Bytes bytes, const fs::path& path, int flags) {
  // HDR and PFM: their decoders take 12 bytes a pixel.
  for (const char* magic : {"#?", "PF", "Pf"}) {
    if (StartsWith(bytes, magic)) Refuse(path, kDepth);
  }
  if (const Defect defect = CheckIntegrity(&bytes)) {
    Refuse(path, *defect + "; record or copy it again");
  }
  const cv::Mat image = WithinMemory(path, [&] { return DecodeImage(bytes, flags); });
  if (image.empty()) Refuse(path, "is not an image OpenCV can read");
  return image;
}

/// The same of 8 or 16 bits.
cv::Mat DecodePixels(Bytes bytes, const fs::path& path, int flags) {
  // A camera's pixels as they were recorded: the orientation that a viewer would turn them by
  // (EXIF) would exchange width and height between images of one camera.
  cv::Mat image =
      Decoded(std::move(bytes), path, flags | cv::IMREAD_ANYDEPTH | cv::IMREAD_IGNORE_ORIENTATION);
  if (image.depth() != CV_8U && image.depth() != CV_16U) {
    Refuse(path, kDepth);
  }
  return image;
}

}  // namespace

cv::Mat ToGray(const cv::Mat& image) {
  if (image.channels() == 1) return image;
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  return gray;
}

cv::Mat ReadImage(const fs::path& path) {
  return DecodePixels(ReadFile(path), path, cv::IMREAD_ANYCOLOR);
}

cv::Mat DecodeRawGray(std::vector<std::uint8_t> content, const fs::path& place) {
  RefuseEmpty(content, place);
  return DecodePixels(std::move(content), place, cv::IMREAD_GRAYSCALE);
}

cv::Mat ScaledTo8Bits(const cv::Mat& image) {
  if (image.depth() == CV_8U) return image;
  double largest = 0;
  cv::minMaxLoc(image, nullptr, &largest);
  const unsigned range = std::bit_ceil(static_cast<unsigned>(largest) + 1);
  cv::Mat gray;
  // Values up to range - 1 onto 0..255; an image of 8 significant bits keeps its values.
  image.convertTo(gray, CV_8U, std::min(1.0, 255.0 / (range - 1.0)));
  return gray;
}

cv::Mat ReadGray(const fs::path& path) {
  return ScaledTo8Bits(DecodePixels(ReadFile(path), path, cv::IMREAD_GRAYSCALE));
}

cv::Mat ReadRawGray(const FrameImage& image) {
  if (!image.store) return DecodePixels(ReadFile(image.path), image.path, cv::IMREAD_GRAYSCALE);
  StoredImage stored = ReadStored(image);
  if (!stored.encoding.empty()) {
    return WithinMemory(image.path, [&] { return internal::GrayOfPixels(stored, image.path); });
  }
  return DecodeRawGray(std::move(stored.bytes), image.path);
}

cv::Mat ReadGray(const FrameImage& image) { return ScaledTo8Bits(ReadRawGray(image)); }

cv::Mat ReadImage(const FrameImage& image) {
  if (!image.store) return ReadImage(image.path);
  StoredImage stored = ReadStored(image);
  if (!stored.encoding.empty()) {
    return WithinMemory(image.path, [&] { return internal::ImageOfPixels(stored, image.path); });
  }
  return DecodePixels(std::move(stored.bytes), image.path, cv::IMREAD_ANYCOLOR);
}

int ReadOrientation(const fs::path& path) { return internal::OrientationTag(ReadFile(path)); }

int ReadOrientation(const FrameImage& image) {
  if (!image.store) return ReadOrientation(image.path);
  if (!image.store->HasFiles()) return 1;
  const StoredImage stored = ReadStored(image);
  return stored.encoding.empty() ? internal::OrientationTag(stored.bytes) : 1;
}

std::string HashImage(const FrameImage& image) {
  return image.store ? image.store->Hash(image.index) : HashFile(image.path);
}

cv::Mat DecodeFloat(std::vector<std::uint8_t> content, const fs::path& place) {
  cv::Mat image = Decoded(std::move(content), place, cv::IMREAD_UNCHANGED);
  if (image.type() == CV_32F) return image;
  throw Error(ErrorKind::kInput,
              fmt::format("{}: expected a TIFF of one 32-bit channel", place.string()));
}

cv::Mat ReadAttenuation(const fs::path& path) {
  cv::Mat attenuation = Decoded(ReadFile(path), path, cv::IMREAD_UNCHANGED);
  if (attenuation.type() != CV_32F) {
    throw Error(
        ErrorKind::kInput,
        fmt::format(
            "{}: expected an attenuation image, a TIFF of one 32-bit channel as 'plenocal white' "
            "writes it",
            path.string()));
  }
  double lowest = 0, highest = 0;
  cv::minMaxLoc(attenuation, &lowest, &highest);
  if (!(lowest >= 0 && highest > 0) || !cv::checkRange(attenuation)) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: expected attenuations from 0 to 1, found {} to {}",
                            path.string(),
                            lowest,
                            highest));
  }
  return attenuation;
}

std::string WithoutPath(const std::string& message, const fs::path& path) {
  const std::string prefix = path.string() + ": ";
  return message.starts_with(prefix) ? message.substr(prefix.size()) : message;
}

std::string EncodeImage(const std::string& format, const cv::Mat& image) {
  return EncodeImage(format, image, {});
}

}  // namespace plenocal
