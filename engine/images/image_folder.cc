// SPDX-License-Identifier: Apache-2.0
#include "engine/images/image_folder.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <array>
#include <atomic>
#include <filesystem>
#include <mutex>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "calib/base/format_error.h"
#include "calib/base/parallel.h"
#include "detectors/images/image.h"
#include "detectors/photometry/response_curve.h"
#include "engine/resample/remap.h"

namespace plenocal {
namespace {

std::optional<ResponseCurve> ResponseOf(const ResampleSettings& settings,
                                        const std::string& camera) {
  for (const std::string& given : settings.photometric) {
    const size_t equals = given.find('=');
    if (equals == std::string::npos) return ReadResponse(given);
    if (given.substr(0, equals) == camera) return ReadResponse(given.substr(equals + 1));
  }
  if (settings.photometric.empty()) return std::nullopt;
  throw InputError("--photometric: names no response of camera '{0}'; add {0}=pcalib.txt", camera);
}

/// OpenCV's conversions of a mosaic to colours, by `BayerOrder`.
constexpr std::array kDemosaicking{cv::COLOR_BayerRGGB2BGR,
                                   cv::COLOR_BayerBGGR2BGR,
                                   cv::COLOR_BayerGRBG2BGR,
                                   cv::COLOR_BayerGBRG2BGR};
static_assert(kDemosaicking.size() == kBayerOrders.size());

std::string SizeText(const cv::Mat& image) {
  return fmt::format("{} x {}", image.cols, image.rows);
}

cv::Mat ReadOfSize(const FrameImage& source, ImageSize size) {
  cv::Mat image = ReadImage(source);
  if (image.cols == size[0] && image.rows == size[1]) return image;
  throw InputError("{}: is {} pixels, but the calibration is of {}",
                   source.path.string(),
                   SizeText(image),
                   fmt::join(size, " x "));
}

/// One image after another through the same map.
class Resampler {
 public:
  explicit Resampler(const FolderResampling& resampling)
      : size_(resampling.map.source_size),
        bayer_(resampling.settings.bayer),
        response_(ResponseOf(resampling.settings, resampling.camera.name)),
        remap_(resampling.map, resampling.settings.interpolation) {
    const std::string& vignetting = resampling.camera.vignetting;
    if (resampling.settings.keep_vignetting || vignetting.empty()) return;
    const std::filesystem::path file = FileBeside(resampling.calibration, vignetting);
    attenuation_ = ReadAttenuation(file);
    if (attenuation_.cols != size_[0] || attenuation_.rows != size_[1]) {
      throw InputError("{}: is {} pixels, but the camera's images are {}",
                       file.string(),
                       SizeText(attenuation_),
                       fmt::join(size_, " x "));
    }
  }

  [[nodiscard]] std::string Png(const FrameImage& source) const {
    const std::filesystem::path& path = source.path;
    cv::Mat image = ReadOfSize(source, size_);
    if (bayer_ && image.channels() != 1) {
      throw InputError("{}: is no mosaic but has colours; leave --bayer out", path.string());
    }
    if (response_) {
      if (image.depth() != CV_8U) {
        throw InputError("{}: has 16 bits, but the response is of grey values of 8 bits",
                         path.string());
      }
      constexpr double kScale = 65535.0 / 255;
      LightOf(image, *response_).convertTo(image, CV_16U, kScale);
    }
    if (!attenuation_.empty()) image = Even(image);
    if (bayer_) {
      cv::Mat colours;
      cv::cvtColor(image, colours, kDemosaicking[static_cast<size_t>(*bayer_)]);
      image = colours;
    }
    return EncodeImage(".png", remap_(image));
  }

 private:
  /// The image as a camera without vignetting has it.
  [[nodiscard]] cv::Mat Even(const cv::Mat& image) const {
    std::vector<cv::Mat> channels;
    cv::split(image, channels);
    for (cv::Mat& channel : channels) {
      cv::Mat exact;
      channel.convertTo(exact, CV_32F);
      exact /= attenuation_;
      exact.convertTo(channel, image.depth());
    }
    cv::Mat even;
    cv::merge(channels, even);
    return even;
  }

  ImageSize size_;
  std::optional<BayerOrder> bayer_;
  std::optional<ResponseCurve> response_;
  Remap remap_;
  cv::Mat attenuation_;  // empty: vignetting stays
};

}  // namespace

void CheckImageNames(const std::vector<FrameImage>& images, const std::string& suffix, bool mask) {
  std::map<std::string, std::filesystem::path> seen;
  for (const FrameImage& image : images) {
    if (mask && image.frame == "mask") {
      throw InputError(
          "{}: its result would have the name of the mask; rename it, or leave out --mask",
          image.path.string());
    }
    const auto [first, is_new] = seen.emplace(image.frame, image.path);
    if (!is_new) {
      throw InputError(
          "{} and {}: both results would be named '{}{}'; rename one, or run them with different "
          "-o",
          first->second.string(),
          image.path.string(),
          image.frame,
          suffix);
    }
  }
}

void CheckImageSizes(const std::vector<FrameImage>& images, ImageSize size) {
  std::optional<Error> first;
  for (const FrameImage& image : images) {
    try {
      static_cast<void>(ReadOfSize(image, size));
      return;
    } catch (const Error& error) {
      if (!first) first = error;
    }
  }
  if (first) throw Error(*first);
}

size_t ResampleToFolder(const std::vector<FrameImage>& images,
                        const FolderResampling& resampling,
                        const Run& run,
                        OutputFolder* out) {
  const Resampler resampler(resampling);
  std::mutex keeping;
  std::vector<std::optional<Error>> failures(images.size());
  std::atomic<size_t> done = 0;
  ParallelFor(images.size(), run.threads, [&](size_t i) {
    const std::string& frame = images[i].frame;
    std::string png;
    try {
      png = resampler.Png(images[i]);
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::kInput) throw;
      failures[i] = error;
    }
    if (!failures[i]) out->Write(resampling.prefix + frame + ".png", png);
    if (!failures[i] && resampling.keep != nullptr) {
      const std::lock_guard lock(keeping);
      (*resampling.keep)[frame] = std::move(png);
    }
    if (!run.Progress(resampling.camera.name + ": images", ++done, images.size())) throw Stopped();
  });
  size_t resampled = 0;
  const Error* first = nullptr;
  for (const auto& failure : failures) {
    if (!failure) {
      ++resampled;
      continue;
    }
    if (first == nullptr) first = &*failure;
    if (failures.size() > 1) run.Message(fmt::format("  left out {}", failure->what()));
  }
  if (resampled == 0) throw Error(*first);
  return resampled;
}

}  // namespace plenocal
