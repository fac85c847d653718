// SPDX-License-Identifier: Apache-2.0
#include "engine/resample/resample_images.h"

#include <fmt/format.h>

#include <array>
#include <atomic>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "calib/base/format_error.h"
#include "calib/base/parallel.h"
#include "detectors/images/image.h"
#include "engine/resample/remap.h"

namespace plenocal {
namespace {

/// OpenCV's conversions of a mosaic to colours, by `BayerOrder`.
constexpr std::array kDemosaicking{cv::COLOR_BayerRGGB2BGR,
                                   cv::COLOR_BayerBGGR2BGR,
                                   cv::COLOR_BayerGRBG2BGR,
                                   cv::COLOR_BayerGBRG2BGR};
static_assert(kDemosaicking.size() == kBayerOrders.size());

std::string SizeText(const cv::Mat& image) {
  return fmt::format("{} x {}", image.cols, image.rows);
}

/// One image after another through the same map.
class Resampler {
 public:
  explicit Resampler(const ResampleRequest& request)
      : request_(request), remap_(*request.map, request.interpolation) {
    const PixelMap& map = *request.map;
    if (request.vignetting.empty()) return;
    attenuation_ = ReadAttenuation(request.vignetting);
    if (attenuation_.cols != map.source_size[0] || attenuation_.rows != map.source_size[1]) {
      throw InputError("{}: is {} pixels, but the camera's images are {} x {}",
                       request.vignetting.string(),
                       SizeText(attenuation_),
                       map.source_size[0],
                       map.source_size[1]);
    }
  }

  [[nodiscard]] std::string Png(const FrameImage& source) const {
    const std::filesystem::path& path = source.path;
    cv::Mat image = ReadImage(source);
    const ImageSize size = request_.map->source_size;
    if (image.cols != size[0] || image.rows != size[1]) {
      throw InputError("{}: is {} pixels, but the calibration is of {} x {}",
                       path.string(),
                       SizeText(image),
                       size[0],
                       size[1]);
    }
    if (request_.bayer && image.channels() != 1) {
      throw InputError("{}: is no mosaic but has colours; leave --bayer out", path.string());
    }
    if (request_.response) {
      if (image.depth() != CV_8U) {
        throw InputError("{}: has 16 bits, but the response is of grey values of 8 bits",
                         path.string());
      }
      constexpr double kScale = 65535.0 / 255;
      LightOf(image, *request_.response).convertTo(image, CV_16U, kScale);
    }
    if (!attenuation_.empty()) image = Even(image);
    if (request_.bayer) {
      cv::Mat colours;
      cv::cvtColor(image, colours, kDemosaicking[static_cast<size_t>(*request_.bayer)]);
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

  const ResampleRequest& request_;
  Remap remap_;
  cv::Mat attenuation_;  // empty: vignetting stays
};

}  // namespace

size_t ResampleImages(const ResampleRequest& request) {
  const Resampler resampler(request);
  std::vector<std::optional<Error>> failures(request.images.size());
  std::atomic<size_t> done = 0;
  ParallelFor(request.images.size(), request.threads, [&](size_t i) {
    const FrameImage& image = request.images[i];
    std::string png;
    try {
      png = resampler.Png(image);
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::kInput) throw;
      failures[i] = error;
    }
    if (!failures[i]) request.result(image.frame, png);
    if (!request.progress(++done)) throw Stopped();
  });
  size_t resampled = 0;
  const Error* first = nullptr;
  for (const auto& failure : failures) {
    if (!failure) {
      ++resampled;
      continue;
    }
    if (first == nullptr) first = &*failure;
    if (failures.size() > 1) request.message(fmt::format("  left out {}", failure->what()));
  }
  if (resampled == 0) throw Error(*first);
  return resampled;
}

std::map<std::string, std::string> MapFiles(const PixelMap& map,
                                            const std::vector<double>& pinhole,
                                            const std::string& format) {
  const auto plane = [&](const std::vector<float>& values) {
    return cv::Mat(values, false).reshape(1, map.size[1]);
  };
  const cv::Mat x = plane(map.x), y = plane(map.y);
  if (format.empty()) {
    return {{"map_x.tiff", EncodeImage(".tiff", x)},
            {"map_y.tiff", EncodeImage(".tiff", y)},
            {"mask.png", EncodeImage(".png", Remap(map, kInterpolations[0]).Mask())}};
  }
  cv::FileStorage storage("." + format, cv::FileStorage::WRITE | cv::FileStorage::MEMORY);
  const cv::Matx33d K(pinhole[0], 0, pinhole[2], 0, pinhole[1], pinhole[3], 0, 0, 1);
  storage << "image_width" << map.size[0] << "image_height" << map.size[1] << "source_width"
          << map.source_size[0] << "source_height" << map.source_size[1] << "camera_matrix"
          << cv::Mat(K) << "map_x" << x << "map_y" << y;
  return {{"", storage.releaseAndGetString()}};
}

std::string VignettePng(const cv::Mat& attenuation) {
  double largest = 0;
  cv::minMaxLoc(attenuation, nullptr, &largest);
  cv::Mat image;
  attenuation.convertTo(image, CV_16U, 65535 / largest);
  return EncodeImage(".png", image);
}

std::string VignettePng(const std::filesystem::path& attenuation) {
  return VignettePng(ReadAttenuation(attenuation));
}

}  // namespace plenocal
