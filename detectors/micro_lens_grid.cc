// SPDX-License-Identifier: Apache-2.0
//
// White image -> micro-lens array, in the steps of Zeller's thesis and PLENOPTIC.md section 3:
// period by autocorrelation, one seed per cell, profile fit of each micro image, smooth lattice.
#include "detectors/micro_lens_grid.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>

#include "calib/error.h"
#include "calib/hexagonal_lattice.h"
#include "calib/median.h"
#include "calib/parallel.h"
#include "detectors/attenuation.h"
#include "detectors/hexagonal_period.h"
#include "detectors/micro_image.h"

namespace plenocal {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;
using internal::FitMicroImage;
using internal::MicroImage;
using internal::ProfileFit;
using internal::RadialProfile;

/// Standard deviation of a normal distribution / median of absolute deviations.
constexpr double kSigmaPerMad = 1.4826;
/// An outlier lies beyond this many robust standard deviations: of normal values one in 5e8 does.
constexpr double kOutlier = 6;
/// Below these a micro image differs too little from its like for harm, however alike the others
/// are: brightness relative to neighbours, misfit relative to brightness, centre in pitches.
constexpr double kGainTolerance = 0.1;
constexpr double kCutGainTolerance = 0.5;  // where the edge of the sensor cuts the micro image
constexpr double kMisfitTolerance = 0.02;
constexpr double kCentreTolerance = 0.02;
/// The part of the image that micro images fill at least: more can be neither dirt nor dark
/// corners.
constexpr double kCoverage = 0.5;
/// Profiles reach this many pitches: over the gaps, into the edges of the neighbours.
constexpr double kProfileRadius = 0.7;
/// Profiles, centres and lattice improve one another: each turn shrinks what is left by more than
/// ten.
constexpr int kTurns = 4;

struct Spread {
  double middle = 0, sigma = 0;
};

Spread RobustSpread(const std::vector<double>& values) {
  Spread spread{.middle = Median(values)};
  std::vector<double> distances;
  distances.reserve(values.size());
  for (const double value : values) distances.push_back(std::abs(value - spread.middle));
  spread.sigma = kSigmaPerMad * Median(std::move(distances));
  return spread;
}

/// Local maxima of the image smoothed to about a micro image's size, to a fraction of a pixel.
std::vector<Vector2d> FindSeeds(const cv::Mat& flat, double pitch) {
  cv::Mat smooth, highest;
  cv::GaussianBlur(flat, smooth, {}, pitch / 4);
  cv::dilate(smooth, highest, {});
  std::vector<Vector2d> seeds;
  for (int y = 1; y + 1 < flat.rows; ++y) {
    for (int x = 1; x + 1 < flat.cols; ++x) {
      const double here = smooth.at<float>(y, x);
      if (here < highest.at<float>(y, x)) continue;
      const auto offset = [&](double before, double after) {
        const double bend = before - 2 * here + after;
        return bend < 0 ? 0.5 * (before - after) / bend : 0.0;
      };
      seeds.emplace_back(x + offset(smooth.at<float>(y, x - 1), smooth.at<float>(y, x + 1)),
                         y + offset(smooth.at<float>(y - 1, x), smooth.at<float>(y + 1, x)));
    }
  }
  return seeds;
}

/// All micro images of a white image and what is common to them.
class MicroImages {
 public:
  MicroImages(const cv::Mat& white, double pitch, int threads)
      : scene_{.white = white, .light = {}}, pitch_(pitch), threads_(threads) {}

  /// Takes the nodes and their centres; what an earlier call measured at a node is kept as its
  /// start.
  void Place(std::vector<LatticeNode> nodes, const std::vector<Vector2d>& centres) {
    std::map<LatticeNode, MicroImage> known;
    for (size_t i = 0; i < nodes_.size(); ++i) known[nodes_[i]] = images_[i];
    nodes_ = std::move(nodes);
    places_ = centres;
    images_.assign(nodes_.size(), {});
    inside_.clear();
    for (const Vector2d& centre : centres) {
      inside_.push_back(IsInside(centre, {scene_.white.cols, scene_.white.rows}));
    }
    good_ = inside_;
    for (size_t i = 0; i < nodes_.size(); ++i) {
      const auto found = known.find(nodes_[i]);
      if (found != known.end() && found->second.centre_sigma > 0) images_[i] = found->second;
      images_[i].centre = centres[i];
      if (images_[i].centre_sigma == 0) images_[i].gain = BrightnessNear(centres[i]);
    }
    colours_.clear();
    for (const LatticeNode& node : nodes_) colours_.push_back(LatticeColour(node));
  }

  /// Profiles from the micro images as placed, then each micro image from its profile.
  void Measure(const std::vector<int>& types, int type_count) {
    types_ = types;
    NormaliseSizes();
    FitProfiles(type_count);
    Explain();
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
    Judge();
  }

  [[nodiscard]] std::vector<LatticeMeasurement> Measurements() const {
    std::vector<LatticeMeasurement> out;
    for (size_t i = 0; i < nodes_.size(); ++i) {
      if (good_[i]) out.push_back({nodes_[i], images_[i].centre, images_[i].centre_sigma});
    }
    return out;
  }

  /// The share of variance between micro images that the interleaved sets explain, at its largest
  /// over rings of the micro image and its brightness.
  [[nodiscard]] double TypeShare();

  [[nodiscard]] const std::vector<LatticeNode>& Nodes() const { return nodes_; }
  [[nodiscard]] const std::vector<MicroImage>& Images() const { return images_; }
  [[nodiscard]] const std::vector<int>& Colours() const { return colours_; }
  [[nodiscard]] bool Inside(size_t i) const { return inside_[i]; }
  [[nodiscard]] bool Good(size_t i) const { return good_[i]; }
  /// Whether all pixels of the profile fit lie in the image.
  [[nodiscard]] bool Whole(size_t i) const {
    const Vector2d& c = places_[i];
    return std::min(c.x(), c.y()) >= pitch_ / 2 && c.x() <= scene_.white.cols - 1 - pitch_ / 2 &&
           c.y() <= scene_.white.rows - 1 - pitch_ / 2;
  }
  [[nodiscard]] double Misfit() const { return Median(misfits_); }
  [[nodiscard]] double GainSpread() const { return RobustSpread(gain_ratios_).sigma; }

 private:
  [[nodiscard]] double BrightnessNear(const Vector2d& centre) const {
    const int x = std::clamp(static_cast<int>(std::lround(centre.x())), 0, scene_.white.cols - 1);
    const int y = std::clamp(static_cast<int>(std::lround(centre.y())), 0, scene_.white.rows - 1);
    return std::max(scene_.white.at<float>(y, x), 1e-3f);
  }

  /// Makes the usual size in each interleaved set 1: profiles take up the rest.
  void NormaliseSizes() {
    for (int colour = 0; colour < 3; ++colour) {
      std::vector<double> scales;
      for (size_t i = 0; i < nodes_.size(); ++i) {
        if (colours_[i] == colour && good_[i] && Whole(i)) scales.push_back(images_[i].scale);
      }
      const double usual = scales.empty() ? 1 : Median(std::move(scales));
      for (size_t i = 0; i < nodes_.size(); ++i) {
        if (colours_[i] == colour) images_[i].scale /= usual;
      }
    }
    CompleteOutside();
  }

  /// Micro lenses beside the sensor, whose light shines in, are like their neighbours.
  void CompleteOutside() {
    std::map<LatticeNode, size_t> index;
    for (size_t i = 0; i < nodes_.size(); ++i) index[nodes_[i]] = i;
    for (size_t i = 0; i < nodes_.size(); ++i) {
      if (inside_[i]) continue;
      double gain = 0, scale = 0;
      Vector2d gradient(0, 0);
      int inside = 0, whole = 0;
      for (const LatticeNode& step : kLatticeNeighbours) {
        const auto near = index.find({nodes_[i].column + step.column, nodes_[i].row + step.row});
        if (near == index.end() || !inside_[near->second]) continue;
        const MicroImage& neighbour = images_[near->second];
        gain += neighbour.gain;
        gradient += neighbour.gradient;
        ++inside;
        if (!Whole(near->second)) continue;
        scale += neighbour.scale;
        ++whole;
      }
      if (whole > 0) images_[i].scale = scale / whole;
      images_[i].gain = inside > 0 ? gain / inside : 0;
      images_[i].gradient = gradient / std::max(1, inside);
    }
  }

  /// The light of all micro images as now known.
  void Explain() {
    scene_.light = cv::Mat::zeros(scene_.white.size(), CV_32F);
    for (size_t i = 0; i < nodes_.size(); ++i) {
      internal::AddLight(profiles_[types_[i]], images_[i], &scene_.light);
    }
  }

  /// Fits the profiles to the cells of all micro images that have their six neighbours.
  void FitProfiles(int type_count) {
    std::map<LatticeNode, size_t> index;
    for (size_t i = 0; i < nodes_.size(); ++i) index[nodes_[i]] = i;
    const double radius = kProfileRadius * pitch_;
    // A fixed number of parts, so that the sums do not depend on the number of threads.
    constexpr size_t kParts = 8;
    // A profile's coefficient has enough pixels in some thousand micro images; more take only time.
    constexpr size_t kCells = 1500;
    const size_t stride = std::max<size_t>(1, nodes_.size() / kCells);
    std::vector<ProfileFit> parts(kParts, ProfileFit(radius, type_count));
    ParallelFor(kParts, threads_, [&](size_t part) {
      for (size_t i = part * stride; i < nodes_.size(); i += kParts * stride) {
        if (!good_[i]) continue;
        std::vector<size_t> shared{i};
        for (const LatticeNode& step : kLatticeNeighbours) {
          const auto near = index.find({nodes_[i].column + step.column, nodes_[i].row + step.row});
          if (near != index.end() && inside_[near->second]) shared.push_back(near->second);
        }
        if (shared.size() == 1 + kLatticeNeighbours.size()) AddCell(shared, &parts[part]);
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

  /// The pixels nearest to the first of `shared`, whose light all of them may share.
  void AddCell(const std::vector<size_t>& shared, ProfileFit* fit) const {
    const MicroImage& own = images_[shared[0]];
    const double weight = 1 / (own.gain * own.gain);
    const double reach = 0.65 * pitch_;  // corners of a hexagonal cell are at 0.577 pitches
    const cv::Mat& white = scene_.white;
    std::array<internal::Contribution, 1 + kLatticeNeighbours.size()> parts;
    for (int y = std::max(0, static_cast<int>(std::ceil(own.centre.y() - reach)));
         y <= std::min(white.rows - 1.0, own.centre.y() + reach);
         ++y) {
      for (int x = std::max(0, static_cast<int>(std::ceil(own.centre.x() - reach)));
           x <= std::min(white.cols - 1.0, own.centre.x() + reach);
           ++x) {
        bool nearest = true;
        for (size_t k = 0; k < shared.size(); ++k) {
          const MicroImage& image = images_[shared[k]];
          const Vector2d d = Vector2d(x, y) - image.centre;
          parts[k] = {
              types_[shared[k]], d.norm() / image.scale, image.gain + image.gradient.dot(d)};
          nearest = nearest && parts[k].r >= parts[0].r;
        }
        if (nearest) fit->Add(white.at<float>(y, x), weight, parts);
      }
    }
  }

  /// Which micro images are like the others: measured, as bright as their neighbours, as well
  /// explained by the profile, and where they were expected.
  void Judge();

  internal::ExplainedImage scene_;
  double pitch_;
  int threads_;
  std::vector<LatticeNode> nodes_;
  std::vector<Vector2d> places_;
  std::vector<int> colours_, types_;
  std::vector<MicroImage> images_;
  std::vector<RadialProfile> profiles_;
  std::vector<bool> inside_, good_;
  std::vector<double> gain_ratios_, misfits_;
};

void MicroImages::Judge() {
  std::map<LatticeNode, double> gains;
  for (size_t i = 0; i < nodes_.size(); ++i) {
    if (images_[i].centre_sigma > 0) gains[nodes_[i]] = images_[i].gain;
  }
  // Brightness relative to the nodes up to two steps away, misfit, distance from the expected
  // place.
  std::vector<double> ratios, misfits, errors;
  std::vector<size_t> measured;
  for (size_t i = 0; i < nodes_.size(); ++i) {
    if (!inside_[i] || images_[i].centre_sigma == 0 || images_[i].gain <= 0) continue;
    std::vector<double> around;
    for (int row = -2; row <= 2; ++row) {
      for (int column = -2; column <= 2; ++column) {
        if (std::abs(column + row) > 2) continue;
        const auto near = gains.find({nodes_[i].column + column, nodes_[i].row + row});
        if (near != gains.end()) around.push_back(near->second);
      }
    }
    measured.push_back(i);
    ratios.push_back(images_[i].gain / Median(around));
    misfits.push_back(images_[i].residual / images_[i].gain);
    errors.push_back((images_[i].centre - places_[i]).norm() / images_[i].centre_sigma);
  }
  good_.assign(nodes_.size(), false);
  gain_ratios_ = ratios;
  misfits_ = misfits;
  // Each interleaved set by itself: lens types differ in all three.
  for (int colour = 0; colour < 3; ++colour) {
    std::vector<double> set_ratios, set_misfits, set_errors;
    for (size_t k = 0; k < measured.size(); ++k) {
      if (colours_[measured[k]] != colour) continue;
      set_ratios.push_back(ratios[k]);
      set_misfits.push_back(misfits[k]);
      set_errors.push_back(errors[k]);
    }
    const Spread ratio = RobustSpread(set_ratios), misfit = RobustSpread(set_misfits),
                 error = RobustSpread(set_errors);
    for (size_t k = 0; k < measured.size(); ++k) {
      const size_t i = measured[k];
      if (colours_[i] != colour) continue;
      const double gain_tolerance = Whole(i) ? kGainTolerance : kCutGainTolerance;
      const bool elsewhere = errors[k] * images_[i].centre_sigma > kCentreTolerance * pitch_ &&
                             errors[k] - error.middle > kOutlier * error.sigma;
      good_[i] =
          std::abs(ratios[k] - ratio.middle) <= std::max(gain_tolerance, kOutlier * ratio.sigma) &&
          misfits[k] - misfit.middle <= std::max(kMisfitTolerance, kOutlier * misfit.sigma) &&
          !elsewhere;
    }
  }
}

double MicroImages::TypeShare() {
  Explain();
  constexpr int kRings = 8;
  std::map<LatticeNode, double> gains;
  for (size_t i = 0; i < nodes_.size(); ++i) {
    if (good_[i]) gains[nodes_[i]] = images_[i].gain;
  }
  std::vector<Eigen::VectorXd> features;
  std::vector<int> colours;
  for (size_t i = 0; i < nodes_.size(); ++i) {
    if (!good_[i] || !Whole(i)) continue;
    // The six neighbours are of the other two sets.
    double around = 0;
    int count = 0;
    for (const auto& [column, row] : kLatticeNeighbours) {
      const auto near = gains.find({nodes_[i].column + column, nodes_[i].row + row});
      if (near == gains.end()) continue;
      around += near->second;
      ++count;
    }
    if (count < 6) continue;
    Eigen::VectorXd feature(kRings + 1);
    feature << internal::RingResiduals(scene_, images_[i], pitch_ / 2, kRings),
        images_[i].gain * count / around - 1;
    features.push_back(feature);
    colours.push_back(colours_[i]);
  }
  double largest = 0;
  for (int f = 0; f <= kRings; ++f) {
    std::vector<double> values;
    values.reserve(features.size());
    for (const Eigen::VectorXd& feature : features) values.push_back(feature[f]);
    const Spread spread = RobustSpread(values);
    std::array<double, 3> sums{}, counts{};
    double total = 0, squares = 0;
    for (size_t k = 0; k < values.size(); ++k) {
      const double bound = kOutlier * spread.sigma;
      const double value = std::clamp(values[k] - spread.middle, -bound, bound);
      sums[colours[k]] += value;
      counts[colours[k]] += 1;
      total += value;
      squares += value * value;
    }
    const double n = static_cast<double>(values.size());
    if (std::min({counts[0], counts[1], counts[2]}) < 3) continue;
    const double all = squares - total * total / n;
    double between = -total * total / n;
    for (int c = 0; c < 3; ++c) between += sums[c] * sums[c] / counts[c];
    if (all > 0) largest = std::max(largest, between / all);
  }
  return largest;
}

/// The result at the centres of `lattice`.
MicroLensGrid MakeGrid(const MicroImages& images,
                       const std::vector<Vector2d>& centres,
                       const std::vector<int>& types) {
  MicroLensGrid grid;
  double sum = 0;
  int count = 0;
  for (size_t i = 0; i < centres.size(); ++i) {
    if (!images.Inside(i)) continue;
    const LatticeNode& node = images.Nodes()[i];
    grid.array.lenses.push_back({.row = node.row,
                                 .column = node.column,
                                 .centre = centres[i],
                                 .type = types[i],
                                 .usable = images.Good(i)});
    grid.gains.push_back(images.Images()[i].gain);
    if (images.Good(i) && images.Whole(i)) {
      sum += (images.Images()[i].centre - centres[i]).squaredNorm() / 2;
      ++count;
    }
  }
  grid.centre_rms = std::sqrt(sum / std::max(1, count));
  grid.misfit = images.Misfit();
  grid.gain_spread = images.GainSpread();
  return grid;
}

std::vector<Vector2d> Positions(const SmoothLattice& lattice,
                                const std::vector<LatticeNode>& nodes) {
  std::vector<Vector2d> positions;
  positions.reserve(nodes.size());
  for (const LatticeNode& node : nodes)
    positions.push_back(lattice.Position(node.column, node.row));
  return positions;
}

}  // namespace

MicroLensGrid FindMicroLensGrid(const cv::Mat& white, int threads) {
  const ImageSize size{white.cols, white.rows};
  const cv::Mat flat = white / LargeScaleMean(white) - 1;
  const std::optional<Matrix2d> basis = internal::FindHexagonalPeriod(flat);
  if (!basis) {
    throw Error(
        ErrorKind::kJob,
        "the white images show no hexagonal lattice of micro images; are they of a plenoptic "
        "camera, and in focus?");
  }
  const double pitch = basis->colwise().norm().mean();
  const std::vector<Vector2d> seeds = FindSeeds(flat, pitch);
  const auto nodes = IndexLattice(seeds, *basis, size);
  std::vector<LatticeMeasurement> measurements;
  for (size_t i = 0; i < seeds.size(); ++i) {
    if (nodes[i]) measurements.push_back({.node = *nodes[i], .position = seeds[i]});
  }
  const double cell = std::abs(basis->determinant());
  if (static_cast<double>(measurements.size()) * cell < kCoverage * white.cols * white.rows) {
    throw Error(
        ErrorKind::kJob,
        "micro images fill less than half of the white images; do they show a scene? Record "
        "an even white field");
  }
  SmoothLattice lattice = SmoothLattice::Fit(measurements);

  MicroImages images(white, pitch, threads);
  double type_share = 0;
  int types = 1;
  for (int turn = 0; turn < kTurns; ++turn) {
    std::vector<LatticeNode> inside = lattice.NodesInside(measurements, size, pitch);
    const std::vector<Vector2d> centres = Positions(lattice, inside);
    images.Place(std::move(inside), centres);
    images.Measure(types == 1 ? std::vector<int>(centres.size(), 0) : images.Colours(), types);
    if (turn == 1) {
      // Own profiles once one common profile has found the places.
      type_share = images.TypeShare();
      constexpr double kTypeShare = 0.5;
      if (type_share > kTypeShare) types = 3;
    }
    measurements = images.Measurements();
    lattice = SmoothLattice::Fit(measurements);
  }
  const std::vector<LatticeNode> inside = lattice.NodesInside(measurements, size, pitch);
  images.Place(inside, Positions(lattice, inside));
  const std::vector<int> lens_types =
      types == 1 ? std::vector<int>(inside.size(), 0) : images.Colours();
  images.Measure(lens_types, types);
  MicroLensGrid grid = MakeGrid(images, Positions(lattice, inside), lens_types);
  grid.degree = lattice.Degree();
  grid.type_share = type_share;
  std::vector<double> sigmas;
  sigmas.reserve(measurements.size());
  for (const LatticeMeasurement& m : measurements) sigmas.push_back(m.sigma);
  grid.centre_sigma = lattice.Sigma() * Median(std::move(sigmas));
  grid.array.image_size = size;
  grid.array.types = types;
  const Vector2d middle = lattice.Coordinates({(size[0] - 1) / 2.0, (size[1] - 1) / 2.0});
  const Matrix2d there = lattice.Basis(middle.x(), middle.y());
  grid.array.e_column = there.col(0);
  grid.array.e_row = there.col(1);
  return grid;
}

MicroLensGrid MeasureMicroLensGrid(const cv::Mat& white, MicroLensArray array, int threads) {
  std::vector<LatticeNode> nodes;
  std::vector<Vector2d> centres;
  std::vector<int> types;
  for (const MicroLens& lens : array.lenses) {
    nodes.push_back({lens.column, lens.row});
    centres.push_back(lens.centre);
    types.push_back(lens.type);
  }
  MicroImages images(white, array.Pitch(), threads);
  images.Place(nodes, centres);
  images.Measure(types, array.types);
  MicroLensGrid grid = MakeGrid(images, centres, types);
  grid.centre_sigma = grid.centre_rms;
  std::vector<MicroLens> lenses = std::move(grid.array.lenses);
  grid.array = std::move(array);
  grid.array.lenses = std::move(lenses);
  return grid;
}

}  // namespace plenocal
