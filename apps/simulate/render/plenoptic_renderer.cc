// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>
#include <span>
#include <vector>

#include "apps/simulate/render/renderer.h"
#include "apps/simulate/render/sensor.h"
#include "apps/simulate/spec/random.h"
#include "calib/base/parallel.h"

namespace plenocal::simulate {
namespace {

using Vector4f = Eigen::Vector4f;

// Points of a pixel, each with a point of the micro lens: (x, y) px from the pixel's centre,
// (a, b) in the unit disc.
struct Samples {
  explicit Samples(size_t count) : x(count), y(count), a(count), b(count) {}
  [[nodiscard]] size_t size() const { return x.size(); }
  std::vector<float> x, y, a, b;
};

// A point of the pixel and one of the micro lens, with the axes that pairs are ordered along.
struct SamplePair {
  float x, y, a, b, along, across;
};

// Points of the unit hypercube that leave no gaps: multiples of the powers of 1 / g, g^5 = g + 1.
class GaplessSequence {
 public:
  explicit GaplessSequence(Random* random) {
    constexpr double kInverse = 1 / 1.1673039782614187;
    double power = 1;
    for (size_t i = 0; i < 4; ++i) {
      start_[i] = random->Uniform(0, 1);
      step_[i] = power *= kInverse;
    }
  }

  [[nodiscard]] std::array<double, 4> At(size_t k) const {
    std::array<double, 4> at{};
    for (size_t i = 0; i < 4; ++i) {
      const double value = start_[i] + static_cast<double>(k) * step_[i];
      at[i] = value - std::floor(value);
    }
    return at;
  }

 private:
  std::array<double, 4> start_{}, step_{};
};

std::vector<SamplePair> DrawPairs(size_t count, double blur, double spread, Random* random) {
  constexpr int kQuantiles = 512;
  const std::vector<float> quantiles = PixelQuantiles(kQuantiles, blur);
  const auto quantile = [&](double share) {
    return quantiles[static_cast<size_t>(share * static_cast<double>(quantiles.size()))];
  };
  const GaplessSequence sequence(random);
  std::vector<SamplePair> pairs(count);
  const double axis = random->Uniform(0, std::numbers::pi);
  for (size_t k = 0; k < count; ++k) {
    SamplePair& pair = pairs[k];
    const std::array<double, 4> at = sequence.At(k);
    const double r = std::sqrt(at[2]), angle = 2 * std::numbers::pi * at[3];
    pair = {quantile(at[0]),
            quantile(at[1]),
            static_cast<float>(r * std::cos(angle)),
            static_cast<float>(r * std::sin(angle)),
            0,
            0};
    const double x = pair.x + spread * pair.a, y = pair.y + spread * pair.b;
    pair.along = static_cast<float>(x * std::cos(axis) + y * std::sin(axis));
    pair.across = static_cast<float>(y * std::cos(axis) - x * std::sin(axis));
  }
  return pairs;
}

// The pair of a group that is nearest to the group's mean.
const SamplePair& FindMiddle(std::span<const SamplePair> group) {
  Eigen::Vector2f middle(0, 0);
  for (const SamplePair& pair : group) {
    middle += Eigen::Vector2f(pair.along, pair.across) / static_cast<float>(group.size());
  }
  const auto distance = [&](const SamplePair& pair) {
    return (Eigen::Vector2f(pair.along, pair.across) - middle).squaredNorm();
  };
  return *std::min_element(
      group.begin(), group.end(), [&](const SamplePair& p, const SamplePair& q) {
        return distance(p) < distance(q);
      });
}

// n x n samples of a pixel. Its light comes from x + spread a in the micro image's sharp picture of
// the scene, for a point x of the pixel and a of the micro lens, `spread` (px) the radius of the
// defocused micro lens. So the distribution of these sums must be even: many pairs of points are
// divided along two axes into n x n groups of equal size, and of each group the pair nearest to its
// middle is the sample.
Samples EvenSamples(size_t n, double blur, double spread, Random* random) {
  constexpr size_t kGroup = 32;  // pairs in a group
  std::vector<SamplePair> pairs = DrawPairs(n * n * kGroup, blur, spread, random);
  std::sort(pairs.begin(), pairs.end(), [](const SamplePair& p, const SamplePair& q) {
    return p.along < q.along;
  });
  Samples samples(n * n);
  for (size_t column = 0; column < n; ++column) {
    const std::span strip = std::span(pairs).subspan(column * n * kGroup, n * kGroup);
    std::sort(strip.begin(), strip.end(), [](const SamplePair& p, const SamplePair& q) {
      return p.across < q.across;
    });
    for (size_t row = 0; row < n; ++row) {
      const SamplePair& chosen = FindMiddle(strip.subspan(row * kGroup, kGroup));
      const size_t k = column * n + row;
      samples.x[k] = chosen.x, samples.y[k] = chosen.y;
      samples.a[k] = chosen.a, samples.b[k] = chosen.b;
    }
  }
  return samples;
}

// Sets of samples for any spread, several for each, so that neighbouring pixels differ.
class SampleSets {
 public:
  SampleSets(size_t n, double blur, int seed) {
    Random random(seed, "samples", {n});
    for (int bucket = -kBuckets; bucket <= kBuckets; ++bucket) {
      for (int variant = 0; variant < kVariants; ++variant) {
        sets_.push_back(EvenSamples(n, blur, kFinest * std::sinh(bucket / kGrowth), &random));
      }
    }
  }
  /// `any`: any number.
  [[nodiscard]] const Samples& For(float spread, std::uint64_t any) const {
    const auto bucket = std::clamp(
        static_cast<int>(std::lround(kGrowth * std::asinh(spread / kFinest))), -kBuckets, kBuckets);
    return sets_[static_cast<size_t>((bucket + kBuckets) * kVariants) + any % kVariants];
  }

 private:
  // Spreads in steps of 0.03 px for small ones, of a tenth of themselves for large ones.
  static constexpr int kBuckets = 45, kVariants = 6;
  static constexpr double kFinest = 0.3, kGrowth = 10;
  std::vector<Samples> sets_;
};

class PlenopticRenderer : public Renderer {
 public:
  PlenopticRenderer(const CameraSpec& camera, const MicroLensOptics& optics, int seed, int threads)
      : camera_(camera),
        pupil_(optics.Pupil().cast<float>()),
        coarse_(4, camera.sensor.blur, seed),
        fine_(12, camera.sensor.blur, seed) {
    FindLenses(optics, seed);
    FindWhite(seed, threads);
  }

  [[nodiscard]] cv::Mat Render(const Surface& surface, std::uint64_t seed) const override {
    cv::Mat light(white_.size(), CV_32F, cv::Scalar(0));
    for (const Lens& lens : lenses_) {
      const Scenery scenery = FindScenery(surface, lens);
      auto passed = lens.passed.begin();
      ForEachPixel(lens, [&](int x, int y, float dx, float dy) {
        const float share = *passed++;
        if (share > 0) {
          light.at<float>(y, x) +=
              share * MeanRadiance(surface, lens, scenery, dx, dy, Mix(x, y, seed));
        }
      });
    }
    return light;
  }

  [[nodiscard]] const cv::Mat& White() const override { return white_; }

 private:
  // A ray's intersection with the pupil's plane (m from its middle) and its slope, as they change
  // with the raw position x about the micro-image centre (px, to second order) and with the centre
  // itself.
  struct Lens {
    Eigen::Vector2f centre;
    float gain = 1;
    Vector4f ray, by_x, by_y, by_xx, by_xy, by_yy, by_cx, by_cy;
    std::vector<float> passed = {};  // light of the white field at each of its pixels
    float reach = 0;                 // px, of the micro image with its soft edge
    float shift = 0;                 // of x for a unit of a point on the micro lens: 1 - 1 / T_f
  };

  // The part of the scene in a micro image.
  struct Scenery {
    int face = -1;     // the one that all of it shows, or -1
    float spread = 0;  // px, radius of the defocused micro lens
  };

  // The ray of raw position `x` through the micro lens with image centre `centre`, both px, as
  // `Lens` holds it; nothing where the optics have none.
  static std::optional<Vector4f> RayAt(const MicroLensOptics& optics,
                                       const Eigen::Vector2d& x,
                                       const Eigen::Vector2d& centre) {
    const auto found = optics.RayThrough(x, centre);
    if (!found) return std::nullopt;
    const Eigen::Vector2d slope = found->direction.head<2>() / found->direction.z();
    const Eigen::Vector2d at =
        found->origin.head<2>() + slope * (optics.Pupil().z() - found->origin.z());
    return Eigen::Vector4d(
               at.x() - optics.Pupil().x(), at.y() - optics.Pupil().y(), slope.x(), slope.y())
        .cast<float>();
  }

  // The micro lens' rays by differences; nothing where some of them do not exist.
  static std::optional<Lens> MakeLens(const MicroLensOptics& optics,
                                      const Eigen::Vector2d& centre,
                                      double pitch) {
    const double h = 0.4 * pitch;
    bool complete = true;
    const auto ray = [&](const Eigen::Vector2d& x, const Eigen::Vector2d& c) -> Vector4f {
      const auto found = RayAt(optics, x, c);
      if (!found) complete = false;
      return found.value_or(Vector4f::Zero());
    };
    std::array<std::array<Vector4f, 3>, 3> f;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        f[i][j] = ray(centre + h * Eigen::Vector2d(i - 1, j - 1), centre);
      }
    }
    const auto by = [&](const Eigen::Vector2d& d) -> Vector4f {
      return (ray(centre, centre + d) - ray(centre, centre - d)) / static_cast<float>(2 * h);
    };
    const auto s = static_cast<float>(h);
    Lens lens{.centre = centre.cast<float>(),
              .ray = f[1][1],
              .by_x = (f[2][1] - f[0][1]) / (2 * s),
              .by_y = (f[1][2] - f[1][0]) / (2 * s),
              .by_xx = (f[2][1] - 2 * f[1][1] + f[0][1]) / (2 * s * s),
              .by_xy = (f[2][2] - f[2][0] - f[0][2] + f[0][0]) / (4 * s * s),
              .by_yy = (f[1][2] - 2 * f[1][1] + f[1][0]) / (2 * s * s),
              .by_cx = by({h, 0}),
              .by_cy = by({0, h})};
    if (!complete) return std::nullopt;
    return lens;
  }

  void FindLenses(const MicroLensOptics& optics, int seed) {
    constexpr double kLeastGain = 0.05;
    const MicroLensSpec& spec = *camera_.micro_lenses;
    radius_ = static_cast<float>(spec.aperture * spec.pitch / 2);
    Random random(seed, "micro lenses");
    for (const MicroLens& micro_lens : optics.Lenses()) {
      const double gain = std::max(kLeastGain, 1 + random.Gaussian(spec.gain_sigma));
      std::optional<Lens> lens = MakeLens(optics, micro_lens.centre, spec.pitch);
      if (!lens) continue;
      const auto type = static_cast<size_t>(micro_lens.type);
      lens->shift = static_cast<float>(1 - 1 / spec.focus[type]);
      lens->gain = static_cast<float>(gain);
      lenses_.push_back(*lens);
    }
    for (int i = 0; i < spec.dull && !lenses_.empty(); ++i) {
      const auto at = static_cast<size_t>(random.Uniform(0, static_cast<double>(lenses_.size())));
      lenses_[at].gain *= static_cast<float>(random.Uniform(0.3, 0.7));
    }
    FindStop(spec);
  }

  // The stop, from the micro image at the middle: its edge is fill / 2 pitches from the centre.
  void FindStop(const MicroLensSpec& spec) {
    const Eigen::Vector2d middle(camera_.image_size[0] / 2.0, camera_.image_size[1] / 2.0);
    const auto central =
        std::min_element(lenses_.begin(), lenses_.end(), [&](const Lens& a, const Lens& b) {
          return (a.centre.cast<double>() - middle).norm() <
                 (b.centre.cast<double>() - middle).norm();
        });
    const auto edge = static_cast<float>(spec.fill * spec.pitch / 2);
    stop_ = spec.regular_in_raw ? edge : edge * central->by_x.head<2>().norm();
    // How far from the centre light can fall: a ray on the edge of the micro lens meets the stop
    // 1 / T_f of its position farther out.
    const float pixel = 1.5f * (0.5f + 2.5f * static_cast<float>(camera_.sensor.blur));
    for (Lens& lens : lenses_) lens.reach = edge + std::abs(1 - lens.shift) * radius_ + pixel;
  }

  // Exact enough that only the scene's own brightness is left to the sampling of an image.
  void FindWhite(int seed, int threads) {
    constexpr size_t kWhiteBundle = 64;
    Random random(seed, "white samples");
    std::map<float, Samples> samples;  // by the lenses' shift
    for (const Lens& lens : lenses_) {
      if (samples.contains(lens.shift)) continue;
      // A ray through a point of the micro lens meets the stop 1 / T_f of its position farther out.
      samples.emplace(lens.shift,
                      EvenSamples(16, camera_.sensor.blur, radius_ * (lens.shift - 1), &random));
    }
    white_ = cv::Mat(camera_.image_size[1], camera_.image_size[0], CV_32F, cv::Scalar(0));
    ParallelFor(lenses_.size(), threads, [&](size_t i) {
      Lens& lens = lenses_[i];
      const Samples& points = samples.at(lens.shift);
      RayBundle rays;
      ForEachPixel(lens, [&](int, int, float dx, float dy) {
        int passed = 0;
        for (size_t k = 0; k < points.size(); k += kWhiteBundle) {
          AimRays(lens, dx, dy, {points, k, kWhiteBundle}, &rays);
          passed += rays.count;
        }
        const Vector4f ray = lens.ray + dx * lens.by_x + dy * lens.by_y;
        const float fall_off = 1 / (1 + ray.tail<2>().squaredNorm());  // cos^2
        lens.passed.push_back(lens.gain * fall_off * fall_off * static_cast<float>(passed) /
                              static_cast<float>(points.size()));
      });
    });
    for (const Lens& lens : lenses_) {
      auto passed = lens.passed.begin();
      ForEachPixel(lens, [&](int x, int y, float, float) { white_.at<float>(y, x) += *passed++; });
    }
  }

  template <typename Use>
  void ForEachPixel(const Lens& lens, const Use& use) const {
    const int x0 = std::max(0, static_cast<int>(std::ceil(lens.centre.x() - lens.reach)));
    const int x1 =
        std::min(white_.cols - 1, static_cast<int>(std::floor(lens.centre.x() + lens.reach)));
    const int y0 = std::max(0, static_cast<int>(std::ceil(lens.centre.y() - lens.reach)));
    const int y1 =
        std::min(white_.rows - 1, static_cast<int>(std::floor(lens.centre.y() + lens.reach)));
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        const float dx = static_cast<float>(x) - lens.centre.x();
        const float dy = static_cast<float>(y) - lens.centre.y();
        if (dx * dx + dy * dy < lens.reach * lens.reach) use(x, y, dx, dy);
      }
    }
  }

  // `count` of the samples from `first` on.
  struct SampleRange {
    const Samples& samples;
    size_t first, count;
  };

  // The rays that pass the stop, of a pixel at (dx, dy) from the micro image's centre.
  void AimRays(
      const Lens& lens, float dx, float dy, const SampleRange& range, RayBundle* rays) const {
    const auto& [samples, first, count] = range;
    const bool raw = camera_.micro_lenses->regular_in_raw;
    std::array<std::array<float, RayBundle::kMost>, 4> found;
    std::array<float, RayBundle::kMost> from_middle;  // of the stop, squared
    for (size_t k = 0; k < count; ++k) {
      const float a = radius_ * samples.a[first + k], b = radius_ * samples.b[first + k];
      const float x = dx + samples.x[first + k] + lens.shift * a;
      const float y = dy + samples.y[first + k] + lens.shift * b;
      for (int i = 0; i < 4; ++i) {
        found[static_cast<size_t>(i)][k] =
            lens.ray[i] + x * (lens.by_x[i] + x * lens.by_xx[i] + y * lens.by_xy[i]) +
            y * (lens.by_y[i] + y * lens.by_yy[i]) + a * lens.by_cx[i] + b * lens.by_cy[i];
      }
      const float at_x = raw ? x - a : found[0][k], at_y = raw ? y - b : found[1][k];
      from_middle[k] = at_x * at_x + at_y * at_y;
    }
    rays->count = 0;
    rays->z = pupil_.z();
    for (size_t k = 0; k < count; ++k) {
      if (from_middle[k] >= stop_ * stop_) continue;
      const auto at = static_cast<size_t>(rays->count++);
      rays->x[at] = pupil_.x() + found[0][k];
      rays->y[at] = pupil_.y() + found[1][k];
      rays->dx[at] = found[2][k];
      rays->dy[at] = found[3][k];
    }
  }

  // Over the rays that pass the stop.
  float MeanRadiance(const Surface& surface,
                     const Lens& lens,
                     const Scenery& scenery,
                     float dx,
                     float dy,
                     std::uint64_t any) const {
    RayBundle rays;
    std::array<float, RayBundle::kMost> radiances;
    float contrast = 0;
    const auto trace = [&](const Samples& samples, float n) {
      // A sample stands for about 1 / n of a pixel's width.
      const Spread spread{.at_origin = lens.by_x[0] / n, .by_distance = lens.by_x[2] / n};
      AimRays(lens, dx, dy, {samples, 0, samples.size()}, &rays);
      if (rays.count == 0) return 0.f;
      surface.Radiances(rays, spread, scenery.face, &radiances);
      float sum = 0, low = 1, high = 0;
      for (size_t k = 0; k < static_cast<size_t>(rays.count); ++k) {
        sum += radiances[k];
        low = std::min(low, radiances[k]), high = std::max(high, radiances[k]);
      }
      contrast = high - low;
      return sum / static_cast<float>(rays.count);
    };
    const float first = trace(coarse_.For(scenery.spread, any), 4);
    // Where the first rays find the same brightness everywhere, more rays would not change it; of
    // few that pass that is not certain.
    constexpr float kEven = 0.06f;
    constexpr int kFew = 8;
    return contrast > kEven || rays.count < kFew ? trace(fine_.For(scenery.spread, any), 5) : first;
  }

  Scenery FindScenery(const Surface& surface, const Lens& lens) const {
    Scenery scenery;
    constexpr int kSteps = 3;
    for (int i = -kSteps; i <= kSteps; ++i) {
      for (int j = -kSteps; j <= kSteps; ++j) {
        const float dx = lens.reach * static_cast<float>(i) / kSteps;
        const float dy = lens.reach * static_cast<float>(j) / kSteps;
        const Vector4f ray = lens.ray + dx * lens.by_x + dy * lens.by_y;
        const auto [face, distance] =
            surface.FaceOf(pupil_ + Eigen::Vector3f(ray[0], ray[1], 0), {ray[2], ray[3], 1});
        if (i == -kSteps && j == -kSteps) scenery.face = face;
        if (face != scenery.face) scenery.face = -1;
        if (i == 0 && j == 0 && distance > 0) {
          // By how much a point of the scene moves for a px of the pixel and of the micro lens.
          const float by_x = lens.by_x[0] + distance * lens.by_x[2];
          const float by_a = lens.shift * by_x + lens.by_cx[0] + distance * lens.by_cx[2];
          scenery.spread = radius_ * by_a / by_x;
        }
      }
    }
    return scenery;
  }

  // A number that differs from pixel to pixel and image to image.
  [[nodiscard]] static std::uint64_t Mix(int x, int y, std::uint64_t seed) {
    std::uint64_t h = seed ^ (static_cast<std::uint64_t>(y) << 32U) ^ static_cast<std::uint64_t>(x);
    h = (h ^ (h >> 31U)) * 0x9E3779B97F4A7C15U;
    h = (h ^ (h >> 29U)) * 0xBF58476D1CE4E5B9U;
    return h >> 40U;
  }

  const CameraSpec& camera_;
  Eigen::Vector3f pupil_;
  SampleSets coarse_, fine_;
  std::vector<Lens> lenses_;
  float radius_ = 0;  // px, of a micro lens
  float stop_ = 0;    // radius of the entrance pupil, m; of its shadow, px, where that is round
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
