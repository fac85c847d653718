// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/white_attenuation.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "apps/photometry/images/image_spline.h"
#include "calib/base/format_error.h"
#include "calib/base/parallel.h"
#include "detectors/images/image.h"

namespace plenocal {
namespace {

constexpr double kBlock = 4;  // px, side of the blocks whose means are fitted

// Mean light of blocks / that of the image, so that the lamp's flicker is out.
cv::Mat ReadBlocks(const FrameImage& image, const ResponseCurve& response, const ImageSize& size) {
  const std::string path = image.path.string();
  const cv::Mat grey = ToGray(ReadImage(image));
  if (grey.cols != size[0] || grey.rows != size[1]) {
    throw InputError("{}: is {} x {} pixels, but the camera's images are {} x {}",
                     path,
                     grey.cols,
                     grey.rows,
                     size[0],
                     size[1]);
  }
  if (grey.depth() != CV_8U) {
    throw InputError(
        "{}: has 16 bits; a response holds 256 values: give white images of 8 "
        "bits, as the wall's",
        path);
  }
  constexpr double kMostSaturated = 1e-3;
  if (cv::countNonZero(grey == 255) > kMostSaturated * static_cast<double>(grey.total())) {
    throw InputError("{}: is saturated; use a shorter exposure", path);
  }
  cv::Mat blocks;
  cv::resize(LightOf(grey, response),
             blocks,
             {static_cast<int>(size[0] / kBlock), static_cast<int>(size[1] / kBlock)},
             0,
             0,
             cv::INTER_AREA);
  const double mean = cv::mean(blocks)[0];
  if (!(mean > 0)) throw InputError("{}: is black", path);
  return blocks / mean;
}

}  // namespace

Attenuation MeasureAttenuation(const std::vector<FrameImage>& images,
                               const ResponseCurve& response,
                               const ImageSize& size,
                               int threads) {
  std::vector<cv::Mat> blocks(images.size());
  ParallelFor(
      images.size(), threads, [&](size_t i) { blocks[i] = ReadBlocks(images[i], response, size); });
  const auto count = static_cast<double>(images.size());
  cv::Mat mean = cv::Mat::zeros(blocks[0].size(), CV_32F), scatter = mean.clone();
  for (const cv::Mat& block : blocks) mean += block / count;
  for (const cv::Mat& block : blocks) scatter += (block - mean).mul(block - mean);
  // Shot noise: the relative variance of a block falls with its light.
  cv::Mat relative = scatter / mean;
  const double noise = images.size() > 1 ? cv::mean(relative)[0] / (count - 1) / count : 0;

  const ImageSpline spline = MakeAttenuationSpline(size);
  SplineFit fit(spline);
  const double across = static_cast<double>(size[0]) / mean.cols;
  const double down = static_cast<double>(size[1]) / mean.rows;
  for (int y = 0; y < mean.rows; ++y) {
    for (int x = 0; x < mean.cols; ++x) {
      const double light = mean.at<float>(y, x);
      if (!(light > 0)) continue;
      fit.Add((x + 0.5) * across - 0.5,
              (y + 0.5) * down - 0.5,
              std::log(light),
              light / std::max(noise, 1e-12));
    }
  }
  const Eigen::MatrixXd covariance = fit.Covariance();
  Attenuation attenuation{MakeAttenuation(spline, fit.Solve(), size, threads), {}};
  const cv::Mat sigma = MakeImage(mean.size(), threads, [&](int x, int y) {
    const auto basis = spline.At((x + 0.5) * across - 0.5, (y + 0.5) * down - 0.5);
    return std::sqrt(VarianceAt(basis, covariance));
  });
  if (images.size() > 1) cv::resize(sigma, attenuation.sigma, {size[0], size[1]});
  return attenuation;
}

}  // namespace plenocal
