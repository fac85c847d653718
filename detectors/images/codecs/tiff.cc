// SPDX-License-Identifier: Apache-2.0
//
// TIFF and BigTIFF files by libtiff: the first image of a file.
#include <tiffio.h>

#include <algorithm>
#include <array>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <memory>
#include <new>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "calib/io/input_file.h"
#include "detectors/images/codecs/image_codec.h"

namespace plenocal {
namespace {

using namespace std::string_view_literals;

constexpr const char* kTiff = "TIFF";
constexpr std::uint64_t kMostTiffBytes = std::uint64_t{1} << 30;  // of a strip or tile

/// A TIFF file in memory, opened for reading or writing.
class TiffFile {
 public:
  /// For reading. Throws `ImageDefect`.
  explicit TiffFile(internal::ByteView content) : content_(content) { Open("r"); }
  /// For writing to `out`.
  explicit TiffFile(std::string* out) : out_(out) { Open("w"); }
  TiffFile(const TiffFile&) = delete;
  TiffFile& operator=(const TiffFile&) = delete;

  [[nodiscard]] TIFF* Get() const { return tiff_.get(); }
  /// Throws `ImageDefect` unless `good`, a call's success, and after any error.
  void Check(bool good) const {
    if (good && error_.empty()) return;
    if (truncated_) throw internal::TruncatedImage(kTiff);
    throw internal::DamagedImage(kTiff, error_.empty() ? "a tag is missing" : error_);
  }
  template <typename T>
  T Tag(std::uint32_t tag, T otherwise) const {
    T value = otherwise;
    return TIFFGetField(tiff_.get(), tag, &value) != 0 ? value : otherwise;
  }

 private:
  void Open(const char* mode) {
    const std::unique_ptr<TIFFOpenOptions, decltype(&TIFFOpenOptionsFree)> options(
        TIFFOpenOptionsAlloc(), &TIFFOpenOptionsFree);
    if (options == nullptr) throw std::bad_alloc();
    TIFFOpenOptionsSetMaxSingleMemAlloc(options.get(), kMostTiffBytes);
    TIFFOpenOptionsSetErrorHandlerExtR(options.get(), &TiffFile::OnError, this);
    TIFFOpenOptionsSetWarningHandlerExtR(
        options.get(),
        [](TIFF*, void*, const char*, const char*, std::va_list) { return 1; },
        nullptr);
    tiff_.reset(TIFFClientOpenExt(
        "",
        mode,
        this,
        &TiffFile::OnRead,
        &TiffFile::OnWrite,
        &TiffFile::OnSeek,
        [](thandle_t) { return 0; },
        [](thandle_t file) { return static_cast<TiffFile*>(file)->Size(); },
        nullptr,
        nullptr,
        options.get()));
    Check(tiff_ != nullptr);
  }
  [[nodiscard]] toff_t Size() const { return out_ != nullptr ? out_->size() : content_.size(); }

  /// Of the errors the first is kept.
  static int OnError(
      TIFF*, void* file, const char* /*module*/, const char* format, std::va_list values) {
    std::array<char, 256> text{};
    std::vsnprintf(text.data(), text.size(), format, values);
    std::string& error = static_cast<TiffFile*>(file)->error_;
    if (error.empty()) error = text.data();
    return 1;
  }
  static tmsize_t OnRead(thandle_t file, void* out, tmsize_t size) {
    auto& self = *static_cast<TiffFile*>(file);
    const std::size_t begin = std::min<std::size_t>(self.at_, self.content_.size());
    const std::size_t rest = std::min<std::size_t>(size, self.content_.size() - begin);
    if (rest < static_cast<std::size_t>(size)) self.truncated_ = true;
    std::memcpy(out, self.content_.data() + begin, rest);
    self.at_ = begin + rest;
    return static_cast<tmsize_t>(rest);
  }
  static tmsize_t OnWrite(thandle_t file, void* bytes, tmsize_t size) {
    auto& self = *static_cast<TiffFile*>(file);
    if (self.out_->size() < self.at_ + size) self.out_->resize(self.at_ + size);
    std::memcpy(self.out_->data() + self.at_, bytes, size);
    self.at_ += size;
    return size;
  }
  static toff_t OnSeek(thandle_t file, toff_t offset, int from) {
    auto& self = *static_cast<TiffFile*>(file);
    self.at_ = offset + (from == SEEK_SET ? 0 : from == SEEK_CUR ? self.at_ : self.Size());
    return self.at_;
  }

  internal::ByteView content_;
  std::string* out_ = nullptr;
  toff_t at_ = 0;
  std::string error_;
  bool truncated_ = false;
  // Last: it is closed first, and also where the constructor throws.
  std::unique_ptr<TIFF, decltype(&TIFFClose)> tiff_{nullptr, &TIFFClose};
};

/// What decides how the pixels are read.
struct TiffLayout {
  std::uint32_t width, height;
  int bits, channels, photometric, format;
  bool is_grey;

  explicit TiffLayout(const TiffFile& file)
      : width(file.Tag<std::uint32_t>(TIFFTAG_IMAGEWIDTH, 0)),
        height(file.Tag<std::uint32_t>(TIFFTAG_IMAGELENGTH, 0)),
        bits(file.Tag<std::uint16_t>(TIFFTAG_BITSPERSAMPLE, 1)),
        channels(file.Tag<std::uint16_t>(TIFFTAG_SAMPLESPERPIXEL, 1)),
        photometric(file.Tag<std::uint16_t>(TIFFTAG_PHOTOMETRIC, kNone)),
        format(file.Tag<std::uint16_t>(TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_UINT)),
        is_grey(photometric == PHOTOMETRIC_MINISBLACK || photometric == PHOTOMETRIC_MINISWHITE) {
    if (photometric == kNone) throw internal::DamagedImage(kTiff, "no PhotometricInterpretation");
    if (channels > 4) throw internal::DamagedImage(kTiff, "more than four channels");
    if (!IsFloat() && (format != SAMPLEFORMAT_UINT || bits > 16)) {
      throw ImageDefect(internal::kOtherDepth);
    }
  }
  [[nodiscard]] bool IsFloat() const {
    return format == SAMPLEFORMAT_IEEEFP && bits == 32 && channels == 1;
  }
  /// Numbers of more than 8 bits as they are; all else comes from libtiff as RGBA of 8 bits.
  [[nodiscard]] bool IsRaw() const {
    return bits > 8 && (is_grey || photometric == PHOTOMETRIC_RGB) && channels != 2;
  }

 private:
  static constexpr std::uint16_t kNone = 0xffff;
};

/// Numbers of 9 to 15 bits, most significant bit first.
void UnpackTiffRow(const std::uint8_t* packed, int bits, int count, std::uint16_t* out) {
  std::uint32_t window = 0;
  int filled = 0;
  for (int k = 0; k < count; ++k) {
    for (; filled < bits; filled += 8) window = window << 8 | *packed++;
    filled -= bits;
    out[k] = static_cast<std::uint16_t>(window >> filled & ((1u << bits) - 1));
  }
}

/// Numbered as in EXIF.
cv::Mat TurnedUpright(const cv::Mat& image, int orientation) {
  cv::Mat turned = image;
  if (orientation >= ORIENTATION_LEFTTOP) cv::transpose(image, turned);
  if ((orientation & 2) != 0) cv::flip(turned, turned, 1);        // TOPRIGHT, BOTRIGHT and so on
  if (((orientation - 1) & 2) != 0) cv::flip(turned, turned, 0);  // BOTRIGHT, BOTLEFT and so on
  return turned;
}

bool IsTiff(internal::ByteView content) {
  return internal::StartsWith(content, "II*\0"sv) || internal::StartsWith(content, "MM\0*"sv) ||
         internal::StartsWith(content, "II+\0"sv) || internal::StartsWith(content, "MM\0+"sv);
}

ImageHeader ReadTiffHeader(internal::ByteView content) {
  const TiffFile file(content);
  return {.width = file.Tag<std::uint32_t>(TIFFTAG_IMAGEWIDTH, 0),
          .height = file.Tag<std::uint32_t>(TIFFTAG_IMAGELENGTH, 0),
          .bits = std::uint64_t{file.Tag<std::uint16_t>(TIFFTAG_BITSPERSAMPLE, 1)} *
                  file.Tag<std::uint16_t>(TIFFTAG_SAMPLESPERPIXEL, 1)};
}

/// Reads a strip or tile, whose first pixel is (x, y), into `out`, which has its size.
void ReadTiffPiece(
    const TiffFile& file, const TiffLayout& layout, int x, int y, int plane, cv::Mat* out) {
  TIFF* const tiff = file.Get();
  const bool tiled = TIFFIsTiled(tiff) != 0;
  if (!layout.IsRaw()) {
    auto* const pixels = out->ptr<std::uint32_t>();
    file.Check((tiled ? TIFFReadRGBATileExt(tiff, x, y, pixels, 1)
                      : TIFFReadRGBAStripExt(tiff, y, pixels, 1)) != 0);
    return;
  }
  const bool packed = layout.bits % 16 != 0;
  const int count = out->cols * out->channels();
  const std::size_t row = (static_cast<std::size_t>(count) * layout.bits + 7) / 8;
  std::vector<std::uint8_t> bytes(packed ? row * out->rows : 0);
  void* const to = packed ? bytes.data() : out->data;
  const auto size = static_cast<tmsize_t>(row * out->rows);
  const auto read = tiled
                        ? TIFFReadEncodedTile(tiff, TIFFComputeTile(tiff, x, y, 0, plane), to, size)
                        : TIFFReadEncodedStrip(tiff, TIFFComputeStrip(tiff, y, plane), to, size);
  file.Check(read >= 0);
  for (int k = 0; packed && k < out->rows; ++k) {
    UnpackTiffRow(bytes.data() + row * k, layout.bits, count, out->ptr<std::uint16_t>(k));
  }
}

cv::Mat DecodeTiff(internal::ByteView content, Channels channels) {
  const TiffFile file(content);
  TIFF* const tiff = file.Get();
  const TiffLayout layout(file);
  const auto orientation = file.Tag<std::uint16_t>(TIFFTAG_ORIENTATION, ORIENTATION_TOPLEFT);
  const bool raw = layout.IsRaw();
  std::array<char, 1024> reason{};
  if (!raw && TIFFRGBAImageOK(tiff, reason.data()) == 0) {
    throw internal::DamagedImage(kTiff, reason.data());
  }
  const bool tiled = TIFFIsTiled(tiff) != 0;
  const std::uint32_t pieces = tiled ? TIFFNumberOfTiles(tiff) : TIFFNumberOfStrips(tiff);
  for (std::uint32_t k = 0; k < pieces; ++k) {
    const std::uint64_t at = TIFFGetStrileOffset(tiff, k), size = TIFFGetStrileByteCount(tiff, k);
    if (at > content.size() || size > content.size() - at) throw internal::TruncatedImage(kTiff);
  }
  // Rows in the order of the file, the one in which libtiff hands them out for this orientation.
  TIFFSetField(tiff, TIFFTAG_ORIENTATION, ORIENTATION_BOTLEFT);
  const std::uint32_t columns =
      tiled ? file.Tag<std::uint32_t>(TIFFTAG_TILEWIDTH, 0) : layout.width;
  const std::uint32_t rows =
      tiled ? file.Tag<std::uint32_t>(TIFFTAG_TILELENGTH, 0)
            : std::min(file.Tag(TIFFTAG_ROWSPERSTRIP, layout.height), layout.height);
  const int stored = raw ? layout.channels : 4;
  const bool planar = raw && stored > 1 &&
                      file.Tag<std::uint16_t>(TIFFTAG_PLANARCONFIG, 0) == PLANARCONFIG_SEPARATE;
  const int in_piece = planar ? 1 : stored;
  const int depth = !raw ? CV_8U : layout.IsFloat() ? CV_32F : CV_16U;
  const std::uint64_t bytes = std::uint64_t{columns} * rows * in_piece * CV_ELEM_SIZE1(depth);
  if (bytes == 0 || bytes >= kMostTiffBytes) {
    throw internal::DamagedImage(kTiff, "a strip or tile has no pixels or more than 1 GB");
  }
  const int width = static_cast<int>(layout.width), height = static_cast<int>(layout.height);
  cv::Mat piece(static_cast<int>(rows),
                static_cast<int>(columns),
                CV_MAKETYPE(depth, in_piece),
                cv::Scalar::all(0));
  const bool one_channel = raw ? stored == 1 : layout.is_grey;
  cv::Mat image(height, width, CV_MAKETYPE(depth, one_channel ? 1 : 3));
  for (int y = 0; y < height; y += piece.rows) {
    for (int x = 0; x < width; x += piece.cols) {
      const cv::Rect part(x, y, std::min(piece.cols, width - x), std::min(piece.rows, height - y));
      // Of a tile at the lower end libtiff gives the last rows of RGBA.
      const int first = tiled && !raw ? piece.rows - part.height : 0;
      const cv::Mat here = piece(cv::Rect({0, first}, part.size()));
      cv::Mat there = image(part);
      for (int plane = 0; plane < (planar ? 3 : 1); ++plane) {
        ReadTiffPiece(file, layout, x, y, plane, &piece);
        if (planar) {
          cv::insertChannel(here, there, 2 - plane);
        } else if (one_channel) {
          cv::extractChannel(here, there, 0);
        } else {
          cv::cvtColor(here, there, in_piece == 3 ? cv::COLOR_RGB2BGR : cv::COLOR_RGBA2BGR);
        }
      }
    }
  }
  if (!one_channel && (layout.is_grey || channels == Channels::kGrey)) {
    image = internal::GreyOfBgr(image);
  }
  if (raw && layout.bits < 16) image *= 1 << (16 - layout.bits);
  return TurnedUpright(image,
                       orientation <= ORIENTATION_LEFTBOT ? orientation : ORIENTATION_TOPLEFT);
}

/// One channel of floats, uncompressed.
std::string EncodeTiff(const cv::Mat& image, int /*quality*/) {
  CV_Assert(image.type() == CV_32FC1);
  std::string content;
  {
    const TiffFile file(&content);
    TIFF* const tiff = file.Get();
    constexpr std::size_t kStrip = 1 << 13;  // bytes
    const auto rows = static_cast<std::uint32_t>(
        std::clamp<std::size_t>(kStrip / (image.cols * image.elemSize()), 1, image.rows));
    TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, image.cols);
    TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, image.rows);
    TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, 32);
    TIFFSetField(tiff, TIFFTAG_COMPRESSION, COMPRESSION_NONE);
    TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
    TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 1);
    TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
    TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, rows);
    TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_IEEEFP);
    for (int y = 0; y < image.rows; ++y) {
      file.Check(TIFFWriteScanline(tiff, const_cast<std::uint8_t*>(image.ptr(y)), y, 0) == 1);
    }
    file.Check(TIFFWriteDirectory(tiff) != 0);
  }
  return content;
}

}  // namespace

ImageCodec TiffCodec() {
  return {kTiff, ".tiff", &IsTiff, &ReadTiffHeader, &DecodeTiff, &EncodeTiff};
}

}  // namespace plenocal
