// SPDX-License-Identifier: Apache-2.0
#include "detectors/micro_image_markers.h"

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <variant>

#include "calib/median.h"
#include "calib/parallel.h"
#include "detectors/marker_planes.h"
#include "detectors/vignetting_shift.h"

namespace plenocal::internal {
namespace {

/// Farther from the centre of its micro image than this part of the pitch there is too little light
/// on one side of a marker: what the stop does grows faster than what the longer lever says of
/// depth.
constexpr double kReach = 0.35;
/// Of the light in its micro image's middle a pixel must have at least this share.
constexpr float kLeastLight = 0.75f;

/// One marker in one micro image.
struct Sight {
  size_t look = 0;
  int lens = 0;
  Eigen::Vector2d predicted{0, 0};                  ///< raw px
  Eigen::Matrix3f G = Eigen::Matrix3f::Identity();  ///< raw px about `predicted` to cells
  double cell_px = 0;                               ///< size of a cell in the micro image
  double blur = 0;                                  ///< px, as fitted
  double own = 0;                                   ///< see `Priors`
  Eigen::Matrix2d pull = Eigen::Matrix2d::Zero();   ///< as in `MicroObservation`
  Eigen::Vector2d by_depth{0, 0};                   ///< likewise
  std::optional<Observation> measured = {};
};

struct Prior {
  double mean, sigma;
};

/// What is known before a fit: of the blur, px, and of the one unknown that a drawing has of its
/// own, the brightness beyond a tag or the radius of a disc.
struct Priors {
  Prior blur, own;
  double edge;  ///< px beside an edge that what is known of the blur reaches
};

/// A drawing of cells as a fit sees it.
struct CellsOfMarker {
  using Drawn = CellDrawing::Drawn;

  CellDrawing drawing;
  int around;  ///< as of `MarkerLook`

  static constexpr double kLeast = -2, kMost = 2;  ///< of the brightness beyond
  static constexpr double kWindow = 1.5;           ///< cells: those that meet at the marker

  void SetOwn(double value) {
    if (around > 0) drawing.SetBeyond(static_cast<float>(value));
  }
  [[nodiscard]] double ByOwn(const CellDrawing::Drawn& drawn, int lane) const {
    return around > 0 ? drawn.by_beyond[lane] : 0;
  }
  /// Whether a place may be used. Half a cell around a tag is enough: other tags and Kalibr's black
  /// squares may lie a little beside their places. Of tags that are next to each other the
  /// outermost cells are not of one brightness: half a cell before them is as far as their blur may
  /// be ignored, and `reach` cells that a value itself spans.
  [[nodiscard]] bool Knows(const Eigen::Vector2f& cells, double reach) const {
    if (around == 0) return true;
    const double middle = 0.5 * drawing.size();
    const double off = (cells.array() - static_cast<float>(middle)).abs().maxCoeff();
    return off < middle - around + std::min(0.5, around - 1.5 - reach);
  }
  /// Whether a fit is wrong without the light of a place.
  [[nodiscard]] static bool Needs(const Eigen::Vector2f&, double, double) { return false; }
};

/// A disc likewise.
struct DiscOfMarker {
  using Drawn = DiscDrawing::Drawn;

  DiscDrawing drawing;

  static constexpr double kLeast = 0.2, kMost = 1.9;  ///< of the radius
  static constexpr double kWindow = 2;                ///< nominal radii: half-way to the next disc

  void SetOwn(double value) { drawing.SetRadius(static_cast<float>(value)); }
  [[nodiscard]] static double ByOwn(const DiscDrawing::Drawn& drawn, int lane) {
    return drawn.by_radius[lane];
  }
  [[nodiscard]] static bool Knows(const Eigen::Vector2f& radii, double) {
    return radii.norm() < kWindow;
  }
  /// A disc whose edge is not lit all around moves with its radius, and with what the stop does to
  /// the other side.
  [[nodiscard]] static bool Needs(const Eigen::Vector2f& radii, double radius, double edge) {
    return radii.norm() < radius + edge;
  }
};

CellsOfMarker ForFit(const CellDrawing& drawing, const MarkerLook& look) {
  return {drawing, look.around};
}
DiscOfMarker ForFit(const DiscDrawing& drawing, const MarkerLook&) { return {drawing}; }

/// What is beyond a tag is about as bright as the tag; a disc is about as large as it is drawn.
Prior OwnPrior(const CellDrawing&) { return {0, 1}; }
Prior OwnPrior(const DiscDrawing&) { return {1, 0.5}; }

/// Unknowns of a fit.
enum { kShiftX, kShiftY, kLevel, kContrast, kBlur, kOwn, kCount };
using Vector = Eigen::Matrix<double, kCount, 1>;
using Matrix = Eigen::Matrix<double, kCount, kCount>;

/// A pixel of a fit.
struct SeenPixel {
  float x, y;  ///< about the predicted place
  float value, weight;
};

/// What a value of a fit changes with: the unknowns (with the contrast: the drawing itself),
/// k_pixel and k.
struct Change {
  Vector by_unknowns = Vector::Zero();
  Eigen::RowVector2d by_stop = Eigen::RowVector2d::Zero();
};

/// What the stop does to the raw pixels of one micro image.
class Stop {
 public:
  Stop(const LensPatches& patches, size_t lens)
      : patches_(patches), lens_(lens), brightest_(patches.BrightestLight(lens)) {}

  /// Appends px for one of k_pixel and of k, of each of the value's pixels by rows. False where one
  /// of these has lost too much light.
  bool Displace(int column, int row, std::vector<Eigen::Matrix2d>* displacements) const {
    const size_t before = displacements->size();
    const int reach = patches_.reach;
    for (int y = row - reach; y <= row + reach; ++y) {
      for (int x = column - reach; x <= column + reach; ++x) {
        const float V = patches_.Light(lens_, x, y) / brightest_;
        if (V < kLeastLight) {
          displacements->resize(before);
          return false;
        }
        const double shape = ApertureShape(V);
        const Eigen::Vector2d slope = patches_.LightSlope(lens_, x, y).cast<double>();
        displacements->emplace_back() << std::sqrt(shape) * slope, shape * slope;
      }
    }
    return true;
  }

 private:
  const LensPatches& patches_;
  size_t lens_;
  float brightest_;
};

/// What each value changes with at p. Of a mosaic, whose values are means, so are the changes.
template <typename Drawing>
void Draw(Drawing& drawing,
          const Eigen::Matrix3f& G,
          const Vector& p,
          const LensPatches& patches,
          const std::vector<SeenPixel>& pixels,
          const std::vector<Eigen::Matrix2d>& displacements,
          std::vector<Change>* changes) {
  std::fill(changes->begin(), changes->end(), Change{});
  const double k = p[kContrast];
  const size_t pixels_of_value = displacements.size() / pixels.size();
  size_t number = 0;  // of a value's pixel
  typename Drawing::Drawn drawn;
  for (int down = -patches.reach; down <= patches.reach; ++down) {
    for (int right = -patches.reach; right <= patches.reach; ++right) {
      const double share = patches.Share(right, down);
      for (std::size_t i = 0; i < pixels.size(); ++i) {
        const auto lane = static_cast<int>(i % kLanes);
        if (lane == 0) {
          Lanes x{}, y{};
          for (std::size_t l = 0; l < kLanes && i + l < pixels.size(); ++l) {
            x[l] = pixels[i + l].x + static_cast<float>(right - p[kShiftX]);
            y[l] = pixels[i + l].y + static_cast<float>(down - p[kShiftY]);
          }
          drawing.drawing.Draw(G, static_cast<float>(p[kBlur]), x, y, &drawn);
        }
        const float by_u = drawn.by_u[lane], by_v = drawn.by_v[lane];
        const float u = drawn.u[lane], v = drawn.v[lane], scale = drawn.scale[lane];
        Vector j;
        j << -k * (by_u * (G(0, 0) - u * G(2, 0)) + by_v * (G(1, 0) - v * G(2, 0))) / scale,
            -k * (by_u * (G(0, 1) - u * G(2, 1)) + by_v * (G(1, 1) - v * G(2, 1))) / scale, 1,
            drawn.value[lane], k * drawn.by_blur[lane], k * drawing.ByOwn(drawn, lane);
        Change& change = (*changes)[i];
        change.by_unknowns += share * j;
        // What a displacement does is what a shift of the drawing undoes.
        change.by_stop -=
            share * j.head<2>().transpose() * displacements[i * pixels_of_value + number];
      }
      ++number;
    }
  }
}

/// Fits the drawing to the micro image.
template <typename Drawing>
void Measure(const MarkerLook& look,
             Drawing drawing,
             const LensPatches& patches,
             const MicroLensArray& array,
             const SensorNoise& noise,
             const Priors& priors,
             Sight* sight) {
  constexpr int kIterations = 12;
  constexpr double kLeastBlur = 0.29, kMostBlur = 4;  // px; the least is that of the pixel's area
  constexpr double kConverged = 1e-3;                 // px

  sight->measured.reset();
  const auto lens = static_cast<size_t>(sight->lens);
  const float* value = patches.Value(lens);
  std::vector<SeenPixel> pixels;
  std::vector<Eigen::Matrix2d> displacements;
  // What meets at the marker, and as much as blurs into it.
  const double window = Drawing::kWindow * sight->cell_px + 2;
  double low = 1e30, high = -1e30;
  const Stop stop(patches, lens);
  for (int row = 0; row < patches.size; ++row) {
    for (int column = 0; column < patches.size; ++column) {
      const int i = row * patches.size + column;
      const double x = patches.origin[lens].x() + column - sight->predicted.x();
      const double y = patches.origin[lens].y() + row - sight->predicted.y();
      if (x * x + y * y > window * window) continue;
      const Eigen::Vector3f there(static_cast<float>(x), static_cast<float>(y), 1);
      const Eigen::Vector2f cells = (sight->G * there).hnormalized();
      if (!drawing.Knows(cells, patches.reach / sight->cell_px)) continue;
      if (std::isnan(value[i]) || !stop.Displace(column, row, &displacements)) {
        if (drawing.Needs(cells, priors.own.mean, priors.edge / sight->cell_px)) return;
        continue;
      }
      const float light = patches.Light(lens, column, row), raw = value[i] * light;
      const float variance = noise.read + noise.shot * std::max(raw, 0.f);
      pixels.push_back(
          {static_cast<float>(x), static_cast<float>(y), value[i], light * light / variance});
      low = std::min(low, static_cast<double>(value[i]));
      high = std::max(high, static_cast<double>(value[i]));
    }
  }
  if (pixels.size() < 3 * kCount) return;

  Vector p = Vector::Zero();
  p[kLevel] = (low + high) / 2;
  p[kContrast] = 0;
  p[kBlur] = priors.blur.mean;
  p[kOwn] = priors.own.mean;
  const double limit = std::max(1.0, 0.5 * sight->cell_px);
  double chi2 = 0;
  Eigen::Matrix<double, kCount, 2> pull;
  Vector by_depth;
  Matrix information = Matrix::Zero();
  std::vector<Change> changes(pixels.size());
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    drawing.SetOwn(p[kOwn]);
    Matrix H = Matrix::Zero();
    Vector g = Vector::Zero();
    chi2 = 0;
    pull.setZero();
    by_depth.setZero();
    const auto& G = sight->G;
    const double k = p[kContrast];
    Draw(drawing, G, p, patches, pixels, displacements, &changes);
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      const SeenPixel& pixel = pixels[i];
      const Vector& j = changes[i].by_unknowns;
      const double residual = pixel.value - p[kLevel] - k * j[kContrast];
      H += pixel.weight * j * j.transpose();
      g += pixel.weight * residual * j;
      pull += pixel.weight * j * changes[i].by_stop;
      // A drawing of a larger depth is smaller.
      const Eigen::Vector2d arm(pixel.x - p[kShiftX], pixel.y - p[kShiftY]);
      by_depth += pixel.weight * j * j.head<2>().dot(arm);
      chi2 += pixel.weight * residual * residual;
    }
    const auto add_prior = [&](int at, const Prior& prior) {
      const double precision = 1 / (prior.sigma * prior.sigma);
      H(at, at) += precision;
      g[at] += precision * (prior.mean - p[at]);
    };
    add_prior(kBlur, priors.blur);
    add_prior(kOwn, priors.own);
    information = H;
    // The first step finds level and contrast, which the others need.
    Vector step = Vector::Zero();
    if (iteration == 0) {
      step.segment<2>(kLevel) = H.block<2, 2>(kLevel, kLevel).ldlt().solve(g.segment<2>(kLevel));
    } else {
      step = H.ldlt().solve(g);
    }
    if (!step.allFinite()) return;
    const double length = step.head<2>().norm();
    if (length > limit / 2) step *= limit / 2 / length;
    p += step;
    p[kBlur] = std::clamp(p[kBlur], kLeastBlur, kMostBlur);
    p[kOwn] = std::clamp(p[kOwn], Drawing::kLeast, Drawing::kMost);
    if (p.head<2>().norm() > limit) return;
    if (iteration > 1 && length < kConverged) break;
  }
  const Matrix covariance_of_all = information.inverse();
  const Eigen::Matrix2d covariance = covariance_of_all.topLeftCorner<2, 2>();
  const double excess = chi2 / static_cast<double>(pixels.size() - kCount);
  const double sigma = std::sqrt(covariance.trace() / 2 * std::max(1.0, excess));
  // Without two edges in the window one direction is open; also false for NaN.
  if (!(sigma < limit / 3)) return;
  const Eigen::Vector2d place = sight->predicted + p.head<2>();
  const Eigen::Vector2d& centre = array.lenses[lens].centre;
  sight->blur = p[kBlur];
  sight->own = p[kOwn];
  sight->pull = covariance_of_all.topRows<2>() * pull;
  sight->by_depth = covariance_of_all.topRows<2>() * by_depth;
  sight->measured = Observation{.marker = look.marker,
                                .values = {place.x(), place.y(), centre.x(), centre.y()},
                                .sigma = sigma};
}

/// The micro images that have a marker well inside; virtual depth is dot(plane, (q, 1)).
void FindSights(const MarkerLook& look,
                size_t number,
                const Eigen::Vector3d& plane,
                const MicroLensArray& array,
                std::vector<Sight>* sights) {
  const double v = plane.dot(look.place.homogeneous());
  if (!(std::abs(v) > 1)) return;
  const double reach = kReach * array.Pitch();
  for (size_t i = 0; i < array.lenses.size(); ++i) {
    const MicroLens& lens = array.lenses[i];
    const Eigen::Vector2d c = lens.centre;
    if (!lens.usable || (look.place - c).norm() > std::abs(v) * reach) continue;
    // x = c + (q - c) / v(q): a homography of the virtual image.
    Eigen::Matrix3d x_by_q;
    x_by_q << c * plane.transpose(), plane.transpose();
    x_by_q.topLeftCorner<2, 2>() += Eigen::Matrix2d::Identity();
    x_by_q.topRightCorner<2, 1>() -= c;
    Sight sight;
    sight.look = number;
    sight.lens = static_cast<int>(i);
    sight.predicted = (x_by_q * look.place.homogeneous()).hnormalized();
    Eigen::Matrix3d about = Eigen::Matrix3d::Identity();
    about.topRightCorner<2, 1>() = sight.predicted;
    Eigen::Matrix3d G = look.cells_by_image * x_by_q.inverse() * about;
    G /= G(2, 2);
    if (!G.allFinite()) continue;
    sight.G = G.cast<float>();
    const Eigen::Vector2d at = G.topRightCorner<2, 1>();
    const Eigen::Matrix2d slope = G.topLeftCorner<2, 2>() - at * G.bottomLeftCorner<1, 2>();
    sight.cell_px = 1 / std::sqrt(std::abs(slope.determinant()));
    sights->push_back(sight);
  }
}

}  // namespace

MicroView MeasureInMicroImages(const std::vector<MarkerLook>& looks,
                               const VirtualDepth& depth,
                               const LensPatches& patches,
                               const MicroLensArray& array,
                               const SensorNoise& noise,
                               int threads) {
  std::map<int, FlatPart> places;
  for (const MarkerLook& look : looks) {
    const Eigen::Vector2f pixel = (look.place / depth.scale).cast<float>();
    places[look.part].emplace_back(pixel.x(), pixel.y());
  }
  std::map<int, Eigen::Vector3d> planes;
  for (const auto& [part, points] : places) {
    FlatPart hull;
    cv::convexHull(points, hull);
    if (const auto plane = FitDepthPlane(depth, hull)) planes[part] = plane->by_q;
  }
  std::vector<Sight> sights;
  for (size_t i = 0; i < looks.size(); ++i) {
    const auto plane = planes.find(looks[i].part);
    if (plane != planes.end()) FindSights(looks[i], i, plane->second, array, &sights);
  }

  // Some pixels of blur; what one marker says of it is weak, all of a part and type together tell.
  // Likewise all discs are of one size.
  const Prior first_blur{1.0, 0.5};
  const auto measure_all = [&](const auto& blur_of, const std::optional<Prior>& radius) {
    ParallelFor(sights.size(), threads, [&](size_t i) {
      const MarkerLook& look = looks[sights[i].look];
      std::visit(
          [&](const auto& drawing) {
            Priors priors{blur_of(sights[i]), OwnPrior(drawing), 0};
            if (radius) {
              priors.own = *radius;
              priors.edge = priors.blur.mean + 0.5 + patches.reach;  // into half a pixel
            }
            Measure(look, ForFit(drawing, look), patches, array, noise, priors, &sights[i]);
          },
          look.drawing);
    });
  };
  measure_all([&](const Sight&) { return first_blur; }, std::nullopt);
  std::map<std::pair<int, int>, std::vector<double>> blurs;
  std::vector<double> radii;
  const auto group = [&](const Sight& sight) {
    return std::pair(looks[sight.look].part, array.lenses[static_cast<size_t>(sight.lens)].type);
  };
  for (const Sight& sight : sights) {
    if (!sight.measured) continue;
    blurs[group(sight)].push_back(sight.blur);
    if (std::holds_alternative<DiscDrawing>(looks[sight.look].drawing)) radii.push_back(sight.own);
  }
  const auto together = [](const std::vector<double>& values, double sigma) {
    return Prior{Median(values), sigma / std::sqrt(static_cast<double>(values.size()))};
  };
  std::map<std::pair<int, int>, Prior> known;
  for (const auto& [key, values] : blurs) known[key] = together(values, first_blur.sigma);
  std::optional<Prior> radius;
  if (!radii.empty()) radius = together(radii, OwnPrior(DiscDrawing(1)).sigma);
  measure_all(
      [&](const Sight& sight) {
        const auto prior = known.find(group(sight));
        return prior == known.end() ? first_blur : prior->second;
      },
      radius);

  MicroView observations;
  for (const Sight& sight : sights) {
    if (!sight.measured) continue;
    const MarkerLook& look = looks[sight.look];
    observations.push_back({.seen = *sight.measured,
                            .inverse_depth = 1 / planes.at(look.part).dot(look.place.homogeneous()),
                            .pull = sight.pull,
                            .by_depth = sight.by_depth,
                            .type = array.lenses[static_cast<size_t>(sight.lens)].type});
  }
  std::stable_sort(observations.begin(), observations.end(), [](const auto& a, const auto& b) {
    return a.seen.marker < b.seen.marker;
  });
  return observations;
}

}  // namespace plenocal::internal
