// SPDX-License-Identifier: Apache-2.0
#include "assess/views/micro_lens_visibility.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

namespace plenocal {
namespace {

// Radius of the part of a micro image that measures, in pitches: its border is dark.
constexpr double kMeasuring = 0.45;
// Virtual depth beyond which disparities between neighbours drown in noise.
constexpr double kFarthestDepth = 30;

std::optional<Eigen::Vector2d> Through(const BundleCamera& camera,
                                       const Eigen::Vector2d& centre,
                                       const Eigen::Vector3d& p_cam) {
  const std::array<double, kMaxObservationSize> values{
      centre.x(), centre.y(), centre.x(), centre.y()};
  Eigen::Vector2d u_px;
  if (!camera.model->Project(
          camera.params.data(), camera.config.data(), values.data(), p_cam, u_px.data())) {
    return std::nullopt;
  }
  return u_px;
}

std::vector<Eigen::Vector2d> UsableCentres(const MicroLensArray& array) {
  std::vector<Eigen::Vector2d> centres;
  for (const MicroLens& lens : array.lenses) {
    if (lens.usable) centres.push_back(lens.centre);
  }
  return centres;
}

}  // namespace

MicroLensVisibility::MicroLensVisibility(const MicroLensArray& array)
    : MicroLensVisibility(array.image_size, array.Pitch(), UsableCentres(array)) {}

MicroLensVisibility::MicroLensVisibility(ImageSize image_size,
                                         double pitch,
                                         std::vector<Eigen::Vector2d> centres)
    : pitch_(pitch),
      columns_(static_cast<int>(image_size[0] / pitch_) + 1),
      rows_(static_cast<int>(image_size[1] / pitch_) + 1),
      centres_(std::move(centres)),
      buckets_(static_cast<size_t>(columns_) * static_cast<size_t>(rows_)) {
  for (size_t i = 0; i < centres_.size(); ++i) buckets_[Bucket(centres_[i])].push_back(i);
}

size_t MicroLensVisibility::Bucket(const Eigen::Vector2d& u_px) const {
  const auto place = [&](double u, int count) {
    return std::clamp(static_cast<int>(std::floor(u / pitch_)), 0, count - 1);
  };
  return static_cast<size_t>(place(u_px.y(), rows_)) * static_cast<size_t>(columns_) +
         static_cast<size_t>(place(u_px.x(), columns_));
}

Eigen::Vector2d MicroLensVisibility::Nearest(const Eigen::Vector2d& u_px) const {
  return *std::ranges::min_element(
      centres_, {}, [&](const Eigen::Vector2d& each) { return (each - u_px).squaredNorm(); });
}

// Through a micro lens with its image's centre at c, a virtual image point p of depth v is seen at
// c + (p - c) / v. Two lenses give v and p, then those near p see the point.
MicroLensVisibility::Seen MicroLensVisibility::LensesShowing(const BundleCamera& camera,
                                                             const Eigen::Vector3d& p_cam,
                                                             size_t most) const {
  Seen seen;
  const Eigen::Vector2d a = centres_[centres_.size() / 2];
  const Eigen::Vector2d b = a + Eigen::Vector2d(pitch_, pitch_);
  const std::optional<Eigen::Vector2d> u_a = Through(camera, a, p_cam),
                                       u_b = Through(camera, b, p_cam);
  if (!u_a || !u_b) return seen;
  const double inverse_v = 1 - (*u_b - *u_a).dot(b - a) / (b - a).squaredNorm();
  if (!(std::abs(inverse_v) > 1 / kFarthestDepth)) return seen;
  Eigen::Vector2d image = a + (*u_a - a) / inverse_v;
  // Distortion makes the relation local: once more beside the image point.
  if (const auto u = Through(camera, image, p_cam)) image += (*u - image) / inverse_v;
  seen.image = image;
  const double radius = kMeasuring * pitch_ / std::abs(inverse_v);
  const int reach = static_cast<int>(std::ceil(radius / pitch_)) + 1;
  const int column = static_cast<int>(std::floor(image.x() / pitch_)),
            row = static_cast<int>(std::floor(image.y() / pitch_));
  std::vector<Eigen::Vector2d> all;
  for (int y = std::max(0, row - reach); y <= std::min(rows_ - 1, row + reach); ++y) {
    for (int x = std::max(0, column - reach); x <= std::min(columns_ - 1, column + reach); ++x) {
      for (const size_t lens : buckets_[static_cast<size_t>(y) * static_cast<size_t>(columns_) +
                                        static_cast<size_t>(x)]) {
        if ((centres_[lens] - image).norm() < radius) all.push_back(centres_[lens]);
      }
    }
  }
  seen.all = all.size();
  for (size_t i = 0; i < std::min(most, all.size()); ++i) {
    seen.centres.push_back(all[i * all.size() / std::min(most, all.size())]);
  }
  return seen;
}

}  // namespace plenocal
