// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "apps/simulate/random.h"
#include "apps/simulate/renderer.h"
#include "apps/simulate/sensor.h"
#include "calib/parallel.h"

namespace plenocal::simulate {
namespace {

using Vector4f = Eigen::Vector4f;

// Points of a pixel, each with a point of the micro lens: (dx, dy) px from the pixel's centre,
// (a_x, a_y) in the unit disc.
struct Sample {
  float dx, dy, a_x, a_y;
};

// n x n points of the pixel; those of the disc lie on a sunflower's spiral, as evenly as can be,
// and are dealt out at random, so that the two do not follow each other.
std::vector<Sample> MakeSamples(int n, double blur, int seed) {
  const std::vector<float> quantiles = PixelQuantiles(n, blur);
  std::vector<int> order(static_cast<size_t>(n * n));
  for (size_t i = 0; i < order.size(); ++i) order[i] = static_cast<int>(i);
  Random random(seed, "samples", {order.size()});
  for (size_t i = order.size() - 1; i > 0; --i) {
    std::swap(order[i], order[static_cast<size_t>(random.Uniform(0, static_cast<double>(i + 1)))]);
  }
  const double golden_angle = std::numbers::pi * (3 - std::sqrt(5.0));
  std::vector<Sample> samples;
  for (int k = 0; k < n * n; ++k) {
    const double at = order[static_cast<size_t>(k)], r = std::sqrt((at + 0.5) / (n * n));
    samples.push_back({quantiles[static_cast<size_t>(k % n)],
                       quantiles[static_cast<size_t>(k / n)],
                       static_cast<float>(r * std::cos(golden_angle * at)),
                       static_cast<float>(r * std::sin(golden_angle * at))});
  }
  return samples;
}

class PlenopticRenderer : public Renderer {
 public:
  PlenopticRenderer(const CameraSpec& camera, const MicroLensOptics& optics, int seed, int threads)
      : camera_(camera),
        pupil_(optics.Pupil().cast<float>()),
        coarse_(MakeSamples(4, camera.sensor.blur, seed)),
        fine_(MakeSamples(8, camera.sensor.blur, seed)) {
    for (size_t i = 0; i < turns_.size(); ++i) {
      const double angle = 2 * std::numbers::pi * static_cast<double>(i) / turns_.size();
      turns_[i] = {static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle))};
    }
    FindLenses(optics, seed);
    FindWhite(seed, threads);
  }

  [[nodiscard]] cv::Mat Render(const PosedSurface& surface, std::uint64_t seed) const override {
    // Mean radiance over the rays that pass, times what the white field gives: the edge of the
    // stop then needs no finer sampling than the scene.
    cv::Mat sum(white_.size(), CV_32F, cv::Scalar(0)), weight(white_.size(), CV_32F, cv::Scalar(0));
    for (const Lens& lens : lenses_) {
      ForEachPixel(lens, [&](int x, int y, float dx, float dy) {
        const auto [light, passed] = Trace(surface, lens, dx, dy, Turn(x, y, seed));
        sum.at<float>(y, x) += lens.gain * light;
        weight.at<float>(y, x) += lens.gain * passed;
      });
    }
    cv::Mat light(white_.size(), CV_32F, cv::Scalar(0));
    for (int y = 0; y < light.rows; ++y) {
      for (int x = 0; x < light.cols; ++x) {
        const float passed = weight.at<float>(y, x);
        if (passed > 0) {
          light.at<float>(y, x) = white_.at<float>(y, x) * sum.at<float>(y, x) / passed;
        }
      }
    }
    return light;
  }

  [[nodiscard]] const cv::Mat& White() const override { return white_; }

 private:
  // Of a ray: where it meets the pupil's plane (m from its middle) and its slope, as they change with the raw
  // place x about the micro-image centre (px, to second order) and with the centre itself.
  struct Lens {
    Eigen::Vector2f centre;
    float gain = 1;
    Vector4f ray, by_x, by_y, by_xx, by_xy, by_yy, by_cx, by_cy;
    float shift = 0;  // of x for a unit of a point on the micro lens: 1 - 1 / T_f
  };

  void FindLenses(const MicroLensOptics& optics, int seed) {
    const MicroLensSpec& spec = *camera_.micro_lenses;
    radius_ = static_cast<float>(spec.aperture * spec.pitch / 2);
    Random random(seed, "micro lenses");
    const double h = 0.4 * spec.pitch;
    for (const MicroLens& micro_lens : optics.Lenses()) {
      const Eigen::Vector2d c = micro_lens.centre;
      bool good = true;
      const auto ray = [&](const Eigen::Vector2d& x, const Eigen::Vector2d& centre) -> Vector4f {
        const auto found = optics.RayThrough(x, centre);
        if (!found) {
          good = false;
          return Vector4f::Zero();
        }
        const Eigen::Vector2d slope = found->direction.head<2>() / found->direction.z();
        const Eigen::Vector2d at =
            found->origin.head<2>() + slope * (optics.Pupil().z() - found->origin.z());
        return Eigen::Vector4d(at.x() - optics.Pupil().x(), at.y() - optics.Pupil().y(), slope.x(),
                               slope.y()).cast<float>();
      };
      std::array<std::array<Vector4f, 3>, 3> f;
      for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) f[i][j] = ray(c + h * Eigen::Vector2d(i - 1, j - 1), c);
      }
      const auto by = [&](const Eigen::Vector2d& d) -> Vector4f {
        return (ray(c, c + d) - ray(c, c - d)) / static_cast<float>(2 * h);
      };
      const auto s = static_cast<float>(h);
      Lens lens{.centre = c.cast<float>(),
                .ray = f[1][1],
                .by_x = (f[2][1] - f[0][1]) / (2 * s),
                .by_y = (f[1][2] - f[1][0]) / (2 * s),
                .by_xx = (f[2][1] - 2 * f[1][1] + f[0][1]) / (2 * s * s),
                .by_xy = (f[2][2] - f[2][0] - f[0][2] + f[0][0]) / (4 * s * s),
                .by_yy = (f[1][2] - 2 * f[1][1] + f[1][0]) / (2 * s * s),
                .by_cx = by({h, 0}),
                .by_cy = by({0, h})};
      const auto type = static_cast<size_t>(micro_lens.type);
      lens.shift = static_cast<float>(1 - 1 / spec.focus[type]);
      lens.gain = static_cast<float>(std::max(0.05, 1 + random.Gaussian(spec.gain_sigma)));
      if (good) lenses_.push_back(lens);
    }
    for (int i = 0; i < spec.dull && !lenses_.empty(); ++i) {
      const auto at = static_cast<size_t>(random.Uniform(0, static_cast<double>(lenses_.size())));
      lenses_[at].gain *= static_cast<float>(random.Uniform(0.3, 0.7));
    }
    // The stop, from the micro image at the middle: its edge is fill / 2 pitches from the centre.
    const Eigen::Vector2d middle(camera_.image_size[0] / 2.0, camera_.image_size[1] / 2.0);
    const auto central = std::min_element(lenses_.begin(), lenses_.end(), [&](const Lens& a, const Lens& b) {
      return (a.centre.cast<double>() - middle).norm() < (b.centre.cast<double>() - middle).norm();
    });
    const auto edge = static_cast<float>(spec.fill * spec.pitch / 2);
    stop_ = edge * central->by_x.head<2>().norm();
    // How far from the centre light can fall: a ray on the edge of the micro lens meets the stop
    // 1 / T_f of its place farther out.
    float most = 0;
    for (const double focus : spec.focus) most = std::max(most, static_cast<float>(1 / std::abs(focus)));
    reach_ = edge + most * radius_ + 1 + 3 * static_cast<float>(camera_.sensor.blur);
  }

  void FindWhite(int seed, int threads) {
    white_ = cv::Mat(camera_.image_size[1], camera_.image_size[0], CV_32F, cv::Scalar(0));
    const std::vector<Sample> samples = MakeSamples(16, camera_.sensor.blur, seed);
    // Bands of rows, so that no two threads write to one pixel.
    constexpr int kBand = 64;
    const int bands = (white_.rows + kBand - 1) / kBand;
    ParallelFor(static_cast<size_t>(bands), threads, [&](size_t band) {
      const int first = static_cast<int>(band) * kBand, end = std::min(first + kBand, white_.rows);
      for (const Lens& lens : lenses_) {
        if (lens.centre.y() + reach_ + 1 < static_cast<float>(first) ||
            lens.centre.y() - reach_ - 1 > static_cast<float>(end)) {
          continue;
        }
        ForEachPixel(lens, [&](int x, int y, float dx, float dy) {
          if (y < first || y >= end) return;
          float passed = 0;
          for (const Sample& sample : samples) {
            if (Ray(lens, dx, dy, sample, turns_[0]).passes(stop_)) ++passed;
          }
          const Vector4f ray = lens.ray + dx * lens.by_x + dy * lens.by_y;
          const float fall_off = 1 / (1 + ray.tail<2>().squaredNorm());  // cos^2
          white_.at<float>(y, x) +=
              lens.gain * fall_off * fall_off * passed / static_cast<float>(samples.size());
        });
      }
    });
  }

  template <typename Use>
  void ForEachPixel(const Lens& lens, const Use& use) const {
    const int x0 = std::max(0, static_cast<int>(std::ceil(lens.centre.x() - reach_)));
    const int x1 = std::min(white_.cols - 1, static_cast<int>(std::floor(lens.centre.x() + reach_)));
    const int y0 = std::max(0, static_cast<int>(std::ceil(lens.centre.y() - reach_)));
    const int y1 = std::min(white_.rows - 1, static_cast<int>(std::floor(lens.centre.y() + reach_)));
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        const float dx = static_cast<float>(x) - lens.centre.x();
        const float dy = static_cast<float>(y) - lens.centre.y();
        if (dx * dx + dy * dy < reach_ * reach_) use(x, y, dx, dy);
      }
    }
  }

  struct TracedRay {
    Vector4f values;
    [[nodiscard]] bool passes(float stop) const {
      return values.head<2>().squaredNorm() < stop * stop;
    }
  };
  TracedRay Ray(const Lens& lens, float dx, float dy, const Sample& sample,
                const Eigen::Vector2f& turn) const {
    const float a_x = radius_ * (turn.x() * sample.a_x - turn.y() * sample.a_y);
    const float a_y = radius_ * (turn.y() * sample.a_x + turn.x() * sample.a_y);
    const float x = dx + sample.dx + lens.shift * a_x, y = dy + sample.dy + lens.shift * a_y;
    return {lens.ray + x * lens.by_x + y * lens.by_y + (x * x) * lens.by_xx + (x * y) * lens.by_xy +
            (y * y) * lens.by_yy + a_x * lens.by_cx + a_y * lens.by_cy};
  }

  // Sum of the radiances of rays that pass and their number, both over the number of rays.
  std::pair<float, float> Trace(const PosedSurface& surface, const Lens& lens, float dx, float dy,
                                const Eigen::Vector2f& turn) const {
    // Where the first rays find the same brightness everywhere, more would tell nothing new.
    constexpr float kEven = 0.02f;
    float low = 1, high = 0;
    const auto trace = [&](const std::vector<Sample>& samples, int n) -> std::pair<float, float> {
      // A sample stands for 1 / n of a pixel's width.
      const Spread spread{.at_origin = lens.by_x[0] / static_cast<float>(n),
                          .by_distance = lens.by_x[2] / static_cast<float>(n)};
      float light = 0, passed = 0;
      for (const Sample& sample : samples) {
        const TracedRay ray = Ray(lens, dx, dy, sample, turn);
        if (!ray.passes(stop_)) continue;
        const float radiance = surface.Radiance(
            pupil_ + Eigen::Vector3f(ray.values[0], ray.values[1], 0),
            {ray.values[2], ray.values[3], 1},
            spread);
        light += radiance;
        low = std::min(low, radiance), high = std::max(high, radiance);
        ++passed;
      }
      const auto count = static_cast<float>(samples.size());
      return {light / count, passed / count};
    };
    const auto first = trace(coarse_, 4);
    return high - low > kEven ? trace(fine_, 8) : first;
  }

  // A turn of the micro lens' points that differs from pixel to pixel and image to image.
  [[nodiscard]] const Eigen::Vector2f& Turn(int x, int y, std::uint64_t seed) const {
    std::uint64_t h = seed ^ (static_cast<std::uint64_t>(y) << 32U) ^ static_cast<std::uint64_t>(x);
    h = (h ^ (h >> 31U)) * 0x9E3779B97F4A7C15U;
    h = (h ^ (h >> 29U)) * 0xBF58476D1CE4E5B9U;
    return turns_[(h >> 56U) % turns_.size()];
  }

  const CameraSpec& camera_;
  Eigen::Vector3f pupil_;
  std::vector<Sample> coarse_, fine_;
  std::array<Eigen::Vector2f, 256> turns_;
  std::vector<Lens> lenses_;
  float radius_ = 0;  // px, of a micro lens
  float stop_ = 0;    // m, radius of the entrance pupil
  float reach_ = 0;   // px, of a micro image with its soft edge
  cv::Mat white_;
};

}  // namespace

std::unique_ptr<Renderer> MakePlenopticRenderer(const CameraSpec& camera,
                                                const MicroLensOptics& optics,
                                                int seed,
                                                int threads) {
  return std::make_unique<PlenopticRenderer>(camera, optics, seed, threads);
}

}  // namespace plenocal::simulate
