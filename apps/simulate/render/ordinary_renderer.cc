// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "apps/simulate/render/renderer.h"

namespace plenocal::simulate {
namespace {

constexpr int kSamples = 4;  // a pixel, along each axis
constexpr int kStrip = 64;   // rows at a time, so that large images need little memory

class OrdinaryRenderer : public Renderer {
 public:
  explicit OrdinaryRenderer(const CameraSpec& camera)
      : camera_(camera), margin_(static_cast<int>(std::ceil(4 * camera.sensor.blur)) + 1) {
    FindRays();
    white_.create(camera.image_size[1], camera.image_size[0], CV_32F);
    for (int y = 0; y < white_.rows; ++y) {
      for (int x = 0; x < white_.cols; ++x) {
        white_.at<float>(y, x) =
            static_cast<float>(camera.sensor.vignetting.At(x, y, camera.image_size));
      }
    }
  }

  [[nodiscard]] cv::Mat Render(const Surface& surface, std::uint64_t) const override {
    cv::Mat light(white_.size(), CV_32F);
    for (int first = 0; first < light.rows; first += kStrip) {
      const int rows = std::min(kStrip, light.rows - first);
      cv::Mat fine((rows + 2 * margin_) * kSamples, (light.cols + 2 * margin_) * kSamples, CV_32F);
      for (int y = 0; y < fine.rows; ++y) {
        for (int x = 0; x < fine.cols; ++x) {
          fine.at<float>(y, x) = Sample(surface, x, y + first * kSamples);
        }
      }
      if (camera_.sensor.blur > 0) {
        cv::GaussianBlur(fine, fine, {}, camera_.sensor.blur * kSamples);
      }
      cv::Mat coarse;
      cv::resize(
          fine, coarse, {light.cols + 2 * margin_, rows + 2 * margin_}, 0, 0, cv::INTER_AREA);
      coarse(cv::Rect(margin_, margin_, light.cols, rows))
          .copyTo(light.rowRange(first, first + rows));
    }
    return light.mul(white_);
  }

  [[nodiscard]] const cv::Mat& White() const override { return white_; }

 private:
  // Rays at the corners of all pixels, those of the margin too.
  void FindRays() {
    const int columns = camera_.image_size[0] + 2 * margin_ + 1;
    const int rows = camera_.image_size[1] + 2 * margin_ + 1;
    const auto count = static_cast<size_t>(columns) * static_cast<size_t>(rows);
    stride_ = static_cast<size_t>(columns);
    directions_.assign(count, Eigen::Vector3f::Zero());
    if (!camera_.model->IsCentral()) origins_.assign(count, Eigen::Vector3f::Zero());
    for (int y = 0; y < rows; ++y) {
      for (int x = 0; x < columns; ++x) {
        const Eigen::Vector2d u(x - margin_ - 0.5, y - margin_ - 0.5);
        const auto ray =
            camera_.model->Unproject(camera_.params.data(), camera_.config.data(), u.data());
        if (!ray) continue;
        const size_t at = static_cast<size_t>(y) * stride_ + static_cast<size_t>(x);
        directions_[at] = ray->direction.cast<float>();
        if (!origins_.empty()) origins_[at] = ray->origin.cast<float>();
      }
    }
  }

  // (x, y): of the fine image with margins. Between corners rays are as good as linear.
  [[nodiscard]] float Sample(const Surface& surface, int x, int y) const {
    const size_t at =
        static_cast<size_t>(y / kSamples) * stride_ + static_cast<size_t>(x / kSamples);
    const float fx = (static_cast<float>(x % kSamples) + 0.5f) / kSamples;
    const float fy = (static_cast<float>(y % kSamples) + 0.5f) / kSamples;
    const auto between = [&](const std::vector<Eigen::Vector3f>& corners) -> Eigen::Vector3f {
      return (1 - fy) * ((1 - fx) * corners[at] + fx * corners[at + 1]) +
             fy * ((1 - fx) * corners[at + stride_] + fx * corners[at + stride_ + 1]);
    };
    for (const size_t corner : {at, at + 1, at + stride_, at + stride_ + 1}) {
      if (directions_[corner].isZero()) return Surface::kBackground;
    }
    const float pixel = (directions_[at + 1] - directions_[at]).norm();
    return surface.Radiance(origins_.empty() ? Eigen::Vector3f::Zero() : between(origins_),
                            between(directions_),
                            {.at_origin = 0, .by_distance = pixel / kSamples});
  }

  const CameraSpec& camera_;
  int margin_;  // px, that the blur needs
  size_t stride_ = 0;
  std::vector<Eigen::Vector3f> directions_, origins_;  // zero where nothing is imaged
  cv::Mat white_;
};

}  // namespace

std::unique_ptr<Renderer> MakeOrdinaryRenderer(const CameraSpec& camera) {
  return std::make_unique<OrdinaryRenderer>(camera);
}

}  // namespace plenocal::simulate
