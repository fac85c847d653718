// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/white/micro_images.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "calib/base/parallel.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"
#include "calib/camera/micro_lens_array.h"

namespace plenocal::internal {
namespace {

using Eigen::Vector2d;

/// An outlier lies beyond this many robust standard deviations: of normal values one in 5e8 does.
constexpr double kOutlierSigmas = 6;
/// A micro image within these tolerances is usable, however alike the others are: brightness
/// relative to neighbours, misfit relative to brightness, centre in pitches.
constexpr double kGainTolerance = 0.1;
constexpr double kCutGainTolerance = 0.5;  // where the edge of the sensor cuts the micro image
constexpr double kMisfitTolerance = 0.02;
constexpr double kCentreTolerance = 0.02;
/// Profiles reach this many pitches: over the gaps, into the edges of the neighbours.
constexpr double kProfileRadius = 0.7;
/// Distance, pitches, within which the pixels of a cell lie: the corners of a hexagon are at 0.577,
/// those of a square at 0.707.
constexpr double kCellReach = 0.75;
/// Most micro images whose light a pixel may have: a node and those around it.
constexpr size_t kMostShared = 9;
/// Grey values; keeps relative brightness finite in a black image.
constexpr float kLeastBrightness = 1e-3f;

/// The ways to give each of some sets one of `count` types such that all types occur. Types are
/// numbered in the order of their first sets.
std::vector<std::vector<int>> DivisionsIntoTypes(int sets, int count) {
  std::vector<std::vector<int>> divisions{{}};
  for (int set = 0; set < sets; ++set) {
    std::vector<std::vector<int>> longer;
    for (const std::vector<int>& division : divisions) {
      const int next = division.empty() ? 0 : 1 + *std::ranges::max_element(division);
      for (int type = 0; type <= std::min(next, count - 1); ++type) {
        longer.push_back(division);
        longer.back().push_back(type);
      }
    }
    divisions = std::move(longer);
  }
  std::erase_if(divisions, [&](const std::vector<int>& division) {
    return *std::ranges::max_element(division) != count - 1;
  });
  return divisions;
}

/// A quantity of the micro images: its sums over the sets of a pattern.
struct SetSums {
  std::vector<double> sum, count;  ///< per set
  double squares = 0;              ///< over all

  SetSums(const std::vector<double>& values, const std::vector<int>& set_of_value, int sets)
      : sum(static_cast<size_t>(sets)), count(sum) {
    for (size_t k = 0; k < values.size(); ++k) {
      const auto set = static_cast<size_t>(set_of_value[k]);
      sum[set] += values[k];
      count[set] += 1;
      squares += values[k] * values[k];
    }
  }

  /// Share of the variance that lies between types; 0 on average for random types, and 0 where a
  /// type has fewer than three values.
  [[nodiscard]] double ShareBetweenTypes(const std::vector<int>& type_of_set, int types) const {
    std::vector<double> type_sum(static_cast<size_t>(types)), type_count(type_sum);
    double total = 0, n = 0;
    for (size_t set = 0; set < sum.size(); ++set) {
      const auto type = static_cast<size_t>(type_of_set[set]);
      type_sum[type] += sum[set];
      type_count[type] += count[set];
      total += sum[set];
      n += count[set];
    }
    if (*std::min_element(type_count.begin(), type_count.end()) < 3) return 0;
    const double all = squares - total * total / n;
    double within = squares;
    for (size_t c = 0; c < type_sum.size(); ++c)
      within -= type_sum[c] * type_sum[c] / type_count[c];
    return all > 0 ? 1 - within / (n - types) / (all / (n - 1)) : 0;
  }
};

}  // namespace

Spread RobustSpread(const std::vector<double>& values) {
  Spread spread{.middle = Median(values)};
  std::vector<double> distances;
  distances.reserve(values.size());
  for (const double value : values) distances.push_back(std::abs(value - spread.middle));
  spread.sigma = kSigmaPerMad * Median(std::move(distances));
  return spread;
}

void MicroImages::Place(std::vector<LatticeNode> nodes,
                        const std::vector<Vector2d>& centres,
                        const std::vector<LocalMap>& maps) {
  std::map<LatticeNode, MicroImage> known;
  for (size_t i = 0; i < nodes_.size(); ++i) known[nodes_[i]] = images_[i];
  nodes_ = std::move(nodes);
  positions_ = centres;
  images_.assign(nodes_.size(), {});
  inside_.clear();
  for (const Vector2d& centre : centres) {
    inside_.push_back(plenocal::IsInside(centre, {scene_.white.cols, scene_.white.rows}));
  }
  usable_ = inside_;
  for (size_t i = 0; i < nodes_.size(); ++i) {
    const auto found = known.find(nodes_[i]);
    if (found != known.end() && found->second.centre_sigma > 0) images_[i] = found->second;
    images_[i].centre = centres[i];
    images_[i].map = maps[i];
    if (images_[i].centre_sigma == 0) images_[i].gain = BrightnessNear(centres[i]);
  }
}

void MicroImages::Measure(const std::vector<int>& types, int type_count) {
  types_ = types;
  type_count_ = type_count;
  NormaliseSizes();
  FitProfiles();
  ModelLight();
  std::vector<MicroImage> fits(nodes_.size());
  ParallelFor(nodes_.size(), threads_, [&](size_t i) {
    MicroImage start = images_[i];
    start.centre_sigma = 0;
    if (!inside_[i]) return;
    fits[i] = FitMicroImage(scene_, profiles_[types_[i]], pitch_ / 2, start);
  });
  for (size_t i = 0; i < fits.size(); ++i) {
    if (inside_[i]) images_[i] = fits[i];
  }
  CompleteOutside();
  DecideUsable();
}

std::vector<LatticeMeasurement> MicroImages::Measurements() const {
  std::vector<LatticeMeasurement> out;
  for (size_t i = 0; i < nodes_.size(); ++i) {
    if (usable_[i] && IsWhole(i)) {
      out.push_back({nodes_[i], images_[i].centre, images_[i].centre_sigma});
    }
  }
  return out;
}

bool MicroImages::IsWhole(size_t i) const {
  const Vector2d& c = positions_[i];
  return std::min(c.x(), c.y()) >= pitch_ / 2 && c.x() <= scene_.white.cols - 1 - pitch_ / 2 &&
         c.y() <= scene_.white.rows - 1 - pitch_ / 2;
}

double MicroImages::Misfit() const { return Median(misfits_); }

double MicroImages::BrightnessNear(const Vector2d& centre) const {
  const int x = std::clamp(static_cast<int>(std::lround(centre.x())), 0, scene_.white.cols - 1);
  const int y = std::clamp(static_cast<int>(std::lround(centre.y())), 0, scene_.white.rows - 1);
  return std::max(scene_.white.at<float>(y, x), kLeastBrightness);
}

std::map<LatticeNode, size_t> MicroImages::IndexByNode() const {
  std::map<LatticeNode, size_t> index;
  for (size_t i = 0; i < nodes_.size(); ++i) index[nodes_[i]] = i;
  return index;
}

/// Makes the median size of each type 1: the profiles take up the rest.
void MicroImages::NormaliseSizes() {
  for (int type = 0; type < type_count_; ++type) {
    std::vector<double> scales;
    for (size_t i = 0; i < nodes_.size(); ++i) {
      if (types_[i] == type && usable_[i] && IsWhole(i)) scales.push_back(images_[i].scale);
    }
    const double usual = scales.empty() ? 1 : Median(std::move(scales));
    for (size_t i = 0; i < nodes_.size(); ++i) {
      if (types_[i] == type) images_[i].scale /= usual;
    }
  }
  CompleteOutside();
}

/// Micro lenses beside the sensor, whose light falls on it, get the means of their neighbours.
void MicroImages::CompleteOutside() {
  const std::map<LatticeNode, size_t> index = IndexByNode();
  for (size_t i = 0; i < nodes_.size(); ++i) {
    if (inside_[i]) continue;
    double gain = 0, scale = 0;
    Vector2d gradient(0, 0);
    int inside = 0, whole = 0;
    for (const LatticeNode& step : LatticeNeighbours(kind_)) {
      const auto near = index.find({nodes_[i].column + step.column, nodes_[i].row + step.row});
      if (near == index.end() || !inside_[near->second]) continue;
      const MicroImage& neighbour = images_[near->second];
      gain += neighbour.gain;
      gradient += neighbour.gradient;
      ++inside;
      if (!IsWhole(near->second)) continue;
      scale += neighbour.scale;
      ++whole;
    }
    if (whole > 0) images_[i].scale = scale / whole;
    images_[i].gain = inside > 0 ? gain / inside : 0;
    images_[i].gradient = gradient / std::max(1, inside);
  }
}

/// The modelled light of all micro images.
void MicroImages::ModelLight() {
  scene_.light = cv::Mat::zeros(scene_.white.size(), CV_32F);
  for (size_t i = 0; i < nodes_.size(); ++i) {
    AddLight(profiles_[types_[i]], images_[i], &scene_.light);
  }
}

/// Fits the profiles to the cells of all micro images that have all their neighbours.
void MicroImages::FitProfiles() {
  const std::map<LatticeNode, size_t> index = IndexByNode();
  const double radius = kProfileRadius * pitch_;
  // A fixed number of parts, so that the sums do not depend on the number of threads.
  constexpr size_t kParts = 8;
  // Some thousand micro images have enough pixels for each coefficient of a profile; more take only
  // time.
  constexpr size_t kCells = 1500;
  const size_t stride = std::max<size_t>(1, nodes_.size() / kCells);
  std::vector<ProfileFit> parts(kParts, ProfileFit(radius, type_count_));
  ParallelFor(kParts, threads_, [&](size_t part) {
    for (size_t i = part * stride; i < nodes_.size(); i += kParts * stride) {
      if (!usable_[i]) continue;
      std::vector<size_t> shared{i};
      for (const LatticeNode& step : LatticeNeighbours(kind_)) {
        const auto near = index.find({nodes_[i].column + step.column, nodes_[i].row + step.row});
        if (near != index.end() && inside_[near->second]) shared.push_back(near->second);
      }
      if (shared.size() == 1 + LatticeNeighbours(kind_).size()) AddCell(shared, &parts[part]);
    }
  });
  for (size_t part = 1; part < kParts; ++part) parts[0].Add(parts[part]);
  profiles_ = parts[0].Solve();
  std::vector<double> highest;
  for (RadialProfile& profile : profiles_) highest.push_back(profile.Normalise());
  for (size_t i = 0; i < nodes_.size(); ++i) {
    images_[i].gain *= highest[types_[i]];
    images_[i].gradient *= highest[types_[i]];
  }
}

/// Adds the pixels nearest to the first of `shared`, which may have light of all of them.
void MicroImages::AddCell(const std::vector<size_t>& shared, ProfileFit* fit) const {
  const MicroImage& own = images_[shared[0]];
  const double weight = 1 / (own.gain * own.gain);
  const double reach = kCellReach * pitch_, radius = kProfileRadius * pitch_;
  const cv::Mat& white = scene_.white;
  const auto square_of = [&](size_t i, const Vector2d& pixel) {
    const MicroImage& image = images_[i];
    return Undistorted(image.map, pixel - image.centre).squaredNorm() / (image.scale * image.scale);
  };
  std::array<Contribution, kMostShared> parts;
  for (int y = std::max(0, static_cast<int>(std::ceil(own.centre.y() - reach)));
       y <= std::min(white.rows - 1.0, own.centre.y() + reach);
       ++y) {
    for (int x = std::max(0, static_cast<int>(std::ceil(own.centre.x() - reach)));
         x <= std::min(white.cols - 1.0, own.centre.x() + reach);
         ++x) {
      const Vector2d pixel(x, y);
      const double own_square = square_of(shared[0], pixel);
      size_t count = 0;
      bool nearest = true;
      for (size_t k = 0; nearest && k < shared.size(); ++k) {
        const MicroImage& image = images_[shared[k]];
        const double square = square_of(shared[k], pixel);
        nearest = square >= own_square;
        if (square > radius * radius) continue;
        parts[count++] = {types_[shared[k]],
                          std::sqrt(square),
                          image.gain + image.gradient.dot(pixel - image.centre)};
      }
      if (nearest) fit->Add(white.at<float>(y, x), weight, std::span(parts).first(count));
    }
  }
}

std::vector<MicroImages::Comparison> MicroImages::CompareWithNeighbours() const {
  std::map<LatticeNode, double> gains;
  for (size_t i = 0; i < nodes_.size(); ++i) {
    if (images_[i].centre_sigma > 0) gains[nodes_[i]] = images_[i].gain;
  }
  std::vector<Comparison> all;
  for (size_t i = 0; i < nodes_.size(); ++i) {
    const MicroImage& image = images_[i];
    if (!inside_[i] || image.centre_sigma == 0 || image.gain <= 0) continue;
    std::vector<double> around;
    for (int row = -2; row <= 2; ++row) {
      for (int column = -2; column <= 2; ++column) {
        if (kind_ == LatticeKind::kHexagonal && std::abs(column + row) > 2) continue;
        const auto near = gains.find({nodes_[i].column + column, nodes_[i].row + row});
        if (near != gains.end()) around.push_back(near->second);
      }
    }
    all.push_back({.index = i,
                   .gain_ratio = image.gain / Median(around),
                   .misfit = image.residual / image.gain,
                   .error = (image.centre - positions_[i]).norm() / image.centre_sigma});
  }
  return all;
}

/// A micro image is usable when it was measured, is as bright as its neighbours, fits its profile
/// as well as the others do and lies at its expected position.
void MicroImages::DecideUsable() {
  const std::vector<Comparison> measured = CompareWithNeighbours();
  usable_.assign(nodes_.size(), false);
  gain_ratios_.clear();
  misfits_.clear();
  for (const Comparison& c : measured) {
    gain_ratios_.push_back(c.gain_ratio);
    misfits_.push_back(c.misfit);
  }
  // Each type by itself: types differ in all three.
  for (int type = 0; type < type_count_; ++type) {
    std::vector<double> ratios, misfits, errors;
    for (const Comparison& c : measured) {
      if (types_[c.index] != type) continue;
      ratios.push_back(c.gain_ratio);
      misfits.push_back(c.misfit);
      errors.push_back(c.error);
    }
    const Spread ratio = RobustSpread(ratios), misfit = RobustSpread(misfits),
                 error = RobustSpread(errors);
    for (const Comparison& c : measured) {
      const size_t i = c.index;
      if (types_[i] != type) continue;
      const double gain_tolerance = IsWhole(i) ? kGainTolerance : kCutGainTolerance;
      const bool elsewhere = c.error * images_[i].centre_sigma > kCentreTolerance * pitch_ &&
                             c.error - error.middle > kOutlierSigmas * error.sigma;
      usable_[i] =
          std::abs(c.gain_ratio - ratio.middle) <=
              std::max(gain_tolerance, kOutlierSigmas * ratio.sigma) &&
          c.misfit - misfit.middle <= std::max(kMisfitTolerance, kOutlierSigmas * misfit.sigma) &&
          !elsewhere;
    }
  }
}

/// Of each whole micro image with all neighbours: residuals in rings, and brightness and size
/// relative to the neighbours. Unusable ones, too: while the types are unknown, all micro images of
/// one type may count as outliers.
std::vector<std::pair<LatticeNode, Eigen::VectorXd>> MicroImages::Features() const {
  constexpr int kRings = 8;
  std::map<LatticeNode, const MicroImage*> measured;
  for (size_t i = 0; i < nodes_.size(); ++i) {
    const MicroImage& image = images_[i];
    if (inside_[i] && image.centre_sigma > 0 && image.gain > 0) measured[nodes_[i]] = &image;
  }
  std::vector<std::pair<LatticeNode, Eigen::VectorXd>> features;
  for (size_t i = 0; i < nodes_.size(); ++i) {
    if (!measured.contains(nodes_[i]) || !IsWhole(i)) continue;
    double gain = 0, scale = 0;
    int count = 0;
    for (const auto& [column, row] : LatticeNeighbours(kind_)) {
      const auto near = measured.find({nodes_[i].column + column, nodes_[i].row + row});
      if (near == measured.end()) continue;
      gain += near->second->gain;
      scale += near->second->scale;
      ++count;
    }
    if (count < static_cast<int>(LatticeNeighbours(kind_).size())) continue;
    Eigen::VectorXd feature(kRings + 2);
    feature << RingResiduals(scene_, images_[i], pitch_ / 2, kRings),
        images_[i].gain * count / gain - 1, images_[i].scale * count / scale - 1;
    features.emplace_back(nodes_[i], feature);
  }
  return features;
}

MicroImages::Types MicroImages::FindTypes() {
  ModelLight();
  const auto features = Features();
  const Eigen::Index quantities = features.empty() ? 0 : features.front().second.size();
  std::vector<std::vector<double>> values(static_cast<size_t>(quantities));
  for (size_t f = 0; f < values.size(); ++f) {
    for (const auto& [node, feature] : features) {
      values[f].push_back(feature[static_cast<Eigen::Index>(f)]);
    }
    const Spread spread = RobustSpread(values[f]);
    const double bound = kOutlierSigmas * spread.sigma;
    for (double& value : values[f]) value = std::clamp(value - spread.middle, -bound, bound);
  }
  Types best;
  for (int count = 2; count <= kMostLensTypes; ++count) {
    Types larger;
    for (int sets = count; sets <= kMostLensTypes; ++sets) {
      const std::vector<std::vector<int>> divisions = DivisionsIntoTypes(sets, count);
      for (const LensPattern& pattern : LensPatterns(sets)) {
        std::vector<int> set_of_image;
        set_of_image.reserve(features.size());
        for (const auto& [node, feature] : features) set_of_image.push_back(pattern.Set(node));
        for (const std::vector<double>& of_quantity : values) {
          const SetSums sums(of_quantity, set_of_image, sets);
          for (const std::vector<int>& type_of_set : divisions) {
            const double share = sums.ShareBetweenTypes(type_of_set, count);
            if (share > larger.share) larger = {pattern, type_of_set, share};
          }
        }
      }
    }
    constexpr double kLeft = 0.5;  // of the variance that fewer types leave
    if (1 - larger.share < kLeft * (1 - best.share)) best = std::move(larger);
  }
  return best;
}

}  // namespace plenocal::internal
