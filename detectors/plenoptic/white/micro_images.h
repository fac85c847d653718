// SPDX-License-Identifier: Apache-2.0
//
// All micro images of a white image and the properties they share.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <map>
#include <opencv2/core/mat.hpp>
#include <utility>
#include <vector>

#include "calib/camera/lens_lattice.h"
#include "detectors/plenoptic/white/micro_image.h"

namespace plenocal::internal {

/// Median and robust standard deviation.
struct Spread {
  double middle = 0, sigma = 0;
};
Spread RobustSpread(const std::vector<double>& values);

class MicroImages {
 public:
  /// `basis`: of the lattice, px.
  MicroImages(const cv::Mat& white, const Eigen::Matrix2d& basis, int threads)
      : scene_{.white = white, .light = {}},
        kind_(KindOfLattice(basis)),
        pitch_(basis.colwise().norm().mean()),
        threads_(threads) {}

  /// Sets the nodes, their centres and maps; the earlier measurement at a node is kept as its
  /// initial guess.
  void Place(std::vector<LatticeNode> nodes,
             const std::vector<Eigen::Vector2d>& centres,
             const std::vector<LocalMap>& maps);
  /// Fits the profile of each type to the micro images as placed, then each micro image by its
  /// profile, and decides which are usable.
  void Measure(const std::vector<int>& types, int type_count);

  /// The usable micro images.
  [[nodiscard]] std::vector<LatticeMeasurement> Measurements() const;
  /// Lens types: sets of a pattern, of which several may have one type.
  struct Types {
    LensPattern pattern;
    std::vector<int> type_of_set{0};
    double share = 0;  ///< of the variance between micro images, explained by the types

    [[nodiscard]] int Of(const LatticeNode& node) const {
      return type_of_set[static_cast<size_t>(pattern.Set(node))];
    }
    [[nodiscard]] int Count() const { return 1 + *std::ranges::max_element(type_of_set); }
  };
  /// The types of at most `kMostLensTypes` sets in which the micro images differ, as measured with
  /// one common profile: the fewest that leave less than twice the variance which any more leave.
  /// Compared are light in rings, brightness and size relative to the neighbours; the quantity in
  /// which the types differ most decides.
  [[nodiscard]] Types FindTypes();

  [[nodiscard]] const std::vector<LatticeNode>& Nodes() const { return nodes_; }
  [[nodiscard]] const std::vector<MicroImage>& Images() const { return images_; }
  [[nodiscard]] bool IsInside(size_t i) const { return inside_[i]; }
  [[nodiscard]] bool IsUsable(size_t i) const { return usable_[i]; }
  /// True when all pixels of the profile fit lie in the image.
  [[nodiscard]] bool IsWhole(size_t i) const;
  /// Median of residual / brightness.
  [[nodiscard]] double Misfit() const;
  /// Of the brightness relative to the neighbours.
  [[nodiscard]] double GainSpread() const { return RobustSpread(gain_ratios_).sigma; }

 private:
  /// Measured micro images by node, and what makes them comparable.
  struct Comparison {
    size_t index;
    double gain_ratio;  ///< brightness over that of the nodes up to two steps away
    double misfit;      ///< residual over brightness
    double error;       ///< distance from the expected position, standard deviations
  };

  [[nodiscard]] double BrightnessNear(const Eigen::Vector2d& centre) const;
  [[nodiscard]] std::map<LatticeNode, size_t> IndexByNode() const;
  void NormaliseSizes();
  void CompleteOutside();
  void ModelLight();
  void FitProfiles();
  void AddCell(const std::vector<size_t>& shared, ProfileFit* fit) const;
  [[nodiscard]] std::vector<Comparison> CompareWithNeighbours() const;
  void DecideUsable();
  [[nodiscard]] std::vector<std::pair<LatticeNode, Eigen::VectorXd>> Features() const;

  ModelledImage scene_;
  LatticeKind kind_;
  double pitch_;
  int threads_;
  std::vector<LatticeNode> nodes_;
  std::vector<Eigen::Vector2d> positions_;  ///< expected
  std::vector<int> types_;
  int type_count_ = 1;
  std::vector<MicroImage> images_;
  std::vector<RadialProfile> profiles_;
  std::vector<bool> inside_, usable_;
  std::vector<double> gain_ratios_, misfits_;
};

}  // namespace plenocal::internal
