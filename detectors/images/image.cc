// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/image.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "calib/base/format_error.h"
#include "calib/io/detection_cache.h"
#include "calib/io/input_file.h"
#include "detectors/images/image_codecs.h"
#include "detectors/images/image_header.h"
#include "detectors/images/stored/stored_pixels.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;
using Bytes = std::vector<std::uint8_t>;

[[noreturn]] void Refuse(const fs::path& path, std::string_view reason) {
  throw InputError("{}: {}", path.string(), reason);
}

void RefuseEmpty(const Bytes& content, const fs::path& path) {
  if (content.empty()) Refuse(path, "is empty (0 bytes); record or copy it again");
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

/// An image file, or pixels of an image in a store.
StoredImage ReadContent(const FrameImage& image) {
  StoredImage content;
  if (image.store) {
    content = WithinMemory(image.path, [&] { return image.store->Read(image.index); });
  } else {
    const std::string file = ReadInput(image.path, InputLimit::kImage);
    content.bytes.assign(file.begin(), file.end());
  }
  RefuseEmpty(content.bytes, image.path);
  return content;
}

/// The image of a file's content.
cv::Mat Decoded(const Bytes& bytes, const fs::path& path, Channels channels) {
  try {
    return WithinMemory(path, [&] { return DecodeImage(bytes, channels); });
  } catch (const ImageDefect& defect) {
    Refuse(path, defect.what());
  }
}

/// The same of 8 or 16 bits.
cv::Mat DecodePixels(const Bytes& bytes, const fs::path& path, Channels channels) {
  cv::Mat image = Decoded(bytes, path, channels);
  if (image.depth() == CV_32F) Refuse(path, internal::kOtherDepth);
  return image;
}

cv::Mat PixelsOf(const StoredImage& content, const fs::path& path, Channels channels) {
  if (content.encoding.empty()) return DecodePixels(content.bytes, path, channels);
  return WithinMemory(path, [&] {
    return channels == Channels::kGrey ? internal::GrayOfPixels(content, path)
                                       : internal::ImageOfPixels(content, path);
  });
}

}  // namespace

cv::Mat ToGray(const cv::Mat& image) {
  if (image.channels() == 1) return image;
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  return gray;
}

cv::Mat DecodeRawGray(std::vector<std::uint8_t> content, const fs::path& place) {
  RefuseEmpty(content, place);
  return DecodePixels(content, place, Channels::kGrey);
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

cv::Mat ReadImage(const FrameImage& image) {
  return PixelsOf(ReadContent(image), image.path, Channels::kAsStored);
}

cv::Mat ReadRawGray(const FrameImage& image) {
  return PixelsOf(ReadContent(image), image.path, Channels::kGrey);
}

cv::Mat ReadGray(const FrameImage& image) { return ImageContent(image).Gray(); }

int ReadOrientation(const FrameImage& image) { return ImageContent(image).Orientation(); }

std::string HashImage(const FrameImage& image) { return ImageContent(image).Hash(); }

const StoredImage& ImageContent::Read() {
  if (!content_) content_ = ReadContent(image_);
  return *content_;
}

cv::Mat ImageContent::Gray() {
  return ScaledTo8Bits(PixelsOf(Read(), image_.path, Channels::kGrey));
}

int ImageContent::Orientation() {
  if (image_.store && !image_.store->HasFiles()) return 1;
  return Read().encoding.empty() ? OrientationInHeader(Read().bytes) : 1;
}

std::string ImageContent::Hash() {
  if (image_.store) return image_.store->Hash(image_.index);
  try {
    return HashBytes(Read().bytes);
  } catch (const Error&) {
    return {};
  }
}

cv::Mat DecodeFloat(std::vector<std::uint8_t> content, const fs::path& place) {
  cv::Mat image = Decoded(content, place, Channels::kAsStored);
  if (image.type() == CV_32F) return image;
  throw InputError("{}: expected a TIFF of one 32-bit channel", place.string());
}

cv::Mat ReadAttenuation(const fs::path& path) {
  cv::Mat attenuation =
      Decoded(ReadContent({.frame = {}, .path = path}).bytes, path, Channels::kAsStored);
  if (attenuation.type() != CV_32F) {
    throw InputError(
        "{}: expected an attenuation image, a TIFF of one 32-bit channel as 'plenocal white' "
        "writes it",
        path.string());
  }
  double lowest = 0, highest = 0;
  cv::minMaxLoc(attenuation, &lowest, &highest);
  // The brightest pixels of a measured one are 1 to within noise and uneven light.
  constexpr double kMost = 2;
  const std::string expected = path.string() + ": expected attenuations from 0 to 1, found ";
  if (!cv::checkRange(attenuation)) throw InputError("{}pixels that are not finite", expected);
  if (!(lowest >= 0 && highest > 0 && highest < kMost)) {
    throw InputError("{}{} to {}", expected, lowest, highest);
  }
  return attenuation;
}

std::string WithoutPath(const std::string& message, const fs::path& path) {
  const std::string prefix = path.string() + ": ";
  return message.starts_with(prefix) ? message.substr(prefix.size()) : message;
}

std::string EncodeImage(const std::string& format, const cv::Mat& image, int quality) {
  const auto codecs = ImageCodecs();
  const auto codec = std::ranges::find(codecs, format, &ImageCodec::extension);
  if (codec == codecs.end()) {
    throw JobError("{} files cannot be written", format);
  }
  try {
    return codec->encode(image, quality);
  } catch (const ImageDefect& defect) {
    throw JobError("cannot write a {} file: {}", codec->name, defect.what());
  }
}

}  // namespace plenocal
