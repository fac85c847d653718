// SPDX-License-Identifier: Apache-2.0
#include "engine/resample/virtual_view_images.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <optional>

#include "calib/base/error.h"
#include "calib/base/parallel.h"
#include "detectors/images/image.h"
#include "detectors/plenoptic/depth/image_synthesis.h"
#include "detectors/plenoptic/depth/reconstruction.h"
#include "detectors/plenoptic/focus_images.h"
#include "engine/resample/point_cloud.h"
#include "engine/resample/remap.h"

namespace plenocal {
namespace {

constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

/// The point that a place of the virtual image shows, where its depth is known.
std::optional<VirtualImage::UncertainPoint> PointAt(const VirtualImage& image,
                                                    const VirtualDepth& depth,
                                                    const Eigen::Vector2d& place) {
  const auto x = static_cast<int>(std::lround(place.x()));
  const auto y = static_cast<int>(std::lround(place.y()));
  if (x < 0 || y < 0 || x >= depth.known.cols || y >= depth.known.rows ||
      depth.known.at<uchar>(y, x) == 0) {
    return std::nullopt;
  }
  return image.Point(
      depth.scale * place, depth.inverse.at<float>(y, x), depth.sigma.at<float>(y, x));
}

struct DepthMaps {
  cv::Mat z, sigma;  // CV_32F, m
};

DepthMaps DepthOf(const VirtualViewRequest& request, const VirtualDepth& depth) {
  const PixelMap& map = *request.map;
  DepthMaps maps;
  maps.z = cv::Mat(map.size[1], map.size[0], CV_32F, cv::Scalar(kUnknown));
  maps.sigma = maps.z.clone();
  ParallelFor(static_cast<size_t>(map.size[1]), request.threads, [&](size_t row) {
    for (int x = 0; x < map.size[0]; ++x) {
      const auto y = static_cast<int>(row);
      const size_t i = row * static_cast<size_t>(map.size[0]) + static_cast<size_t>(x);
      if (!map.HasSource(i)) continue;
      const auto point = PointAt(*request.virtual_image, depth, {map.x[i], map.y[i]});
      if (!point) continue;
      maps.z.at<float>(y, x) = static_cast<float>(point->p.z());
      maps.sigma.at<float>(y, x) = static_cast<float>(point->sigma_z);
    }
  });
  return maps;
}

/// All points of the virtual image whose depth is known; `colours`: CV_8U of one or three channels.
std::string Cloud(const VirtualViewRequest& request,
                  const VirtualDepth& depth,
                  const cv::Mat& colours) {
  std::vector<std::vector<CloudPoint>> rows(static_cast<size_t>(colours.rows));
  ParallelFor(rows.size(), request.threads, [&](size_t row) {
    const auto y = static_cast<int>(row);
    for (int x = 0; x < colours.cols; ++x) {
      const auto point =
          PointAt(*request.virtual_image, depth, Eigen::Vector2d(x, static_cast<double>(y)));
      if (!point) continue;
      const uchar* const pixel = colours.ptr(y, x);
      const bool grey = colours.channels() == 1;
      rows[row].push_back({{static_cast<float>(point->p.x()),
                            static_cast<float>(point->p.y()),
                            static_cast<float>(point->p.z())},
                           static_cast<float>(point->sigma_z),
                           {pixel[grey ? 0 : 2], pixel[grey ? 0 : 1], pixel[0]}});
    }
  });
  std::vector<CloudPoint> points;
  for (const auto& row : rows) points.insert(points.end(), row.begin(), row.end());
  return PlyText(points, "m, camera frame: x right, y down, z forward; sigma of z");
}

std::string Summary(const DepthMaps& maps) {
  std::vector<float> z, sigma;
  for (int y = 0; y < maps.z.rows; ++y) {
    for (int x = 0; x < maps.z.cols; ++x) {
      if (std::isnan(maps.z.at<float>(y, x))) continue;
      z.push_back(maps.z.at<float>(y, x));
      sigma.push_back(maps.sigma.at<float>(y, x));
    }
  }
  if (z.empty()) return "no depth in this view";
  const auto quantile = [](std::vector<float>* values, double share) {
    const auto at = values->begin() +
                    static_cast<std::ptrdiff_t>(share * static_cast<double>(values->size() - 1));
    std::nth_element(values->begin(), at, values->end());
    return *at;
  };
  const double known = 100.0 * static_cast<double>(z.size()) / static_cast<double>(maps.z.total());
  const float nearest = quantile(&z, 0.01), farthest = quantile(&z, 0.99);
  return fmt::format("depth known in {:.0f} %, {:.3f} to {:.3f} m, median sigma {:.2g} mm",
                     known,
                     nearest,
                     farthest,
                     1e3F * quantile(&sigma, 0.5));
}

}  // namespace

size_t MakeVirtualViews(const VirtualViewRequest& request) {
  PlenopticCamera camera;
  camera.bayer = request.bayer;
  camera.attenuation =
      request.vignetting.empty()
          ? cv::Mat(request.raw_size[1], request.raw_size[0], CV_32F, cv::Scalar(1))
          : ReadAttenuation(request.vignetting);
  camera.array = ReadMicroLenses(request.grid, request.raw_size);
  const Remap remap(*request.map, request.interpolation);
  const ReconstructionOptions options{
      .scale = request.scale, .colour = true, .threads = request.threads, .find_flat_parts = {}};
  return ReconstructImages(
      request.images,
      camera,
      options,
      {request.progress, request.message},
      [&](const FrameImage& raw, const Reconstruction& view, int bits) {
        // Grey values as in the raw image, unless the corrected ones exceed its range.
        const cv::Mat& exact = view.colour.empty() ? view.image : view.colour;
        const double to_8_bits = internal::ScaleTo8Bits(exact.reshape(1));
        cv::Mat values;
        exact.convertTo(values,
                        bits,
                        bits == CV_8U ? std::min(1.0, to_8_bits) : std::min(1.0, to_8_bits * 257));
        const DepthMaps maps = DepthOf(request, view.depth);
        std::map<std::string, std::string> files{
            {".png", EncodeImage(".png", remap(values))},
            {"_depth.tiff", EncodeImage(".tiff", maps.z)},
            {"_depth_sigma.tiff", EncodeImage(".tiff", maps.sigma)}};
        if (request.cloud) {
          cv::Mat colours;
          exact.convertTo(colours, CV_8U, bits == CV_8U ? std::min(1.0, to_8_bits) : to_8_bits);
          files[".ply"] = Cloud(request, view.depth, colours);
        }
        request.result(raw.frame, files, Summary(maps));
      });
}

}  // namespace plenocal
