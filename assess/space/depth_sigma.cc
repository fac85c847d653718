// SPDX-License-Identifier: Apache-2.0
#include "assess/space/depth_sigma.h"

#include <fmt/format.h>

#include "assess/space/points_before_image.h"
#include "calib/base/format_error.h"
#include "calib/space/space_rig.h"
#include "calib/traits/image_grid.h"

namespace plenocal {
namespace {

constexpr int kDepthCells = 12;  // along the longer side of the image
constexpr double kMillimetres = 1e3;

// Cameras of an estimate, and the place of each of their unknowns in the estimate's.
struct Subset {
  SpaceRig rig;
  std::vector<int> places;
};

Subset SubsetOf(const RigEstimate& rig,
                const RigUnknowns& unknowns,
                const std::vector<size_t>& cameras) {
  Subset subset;
  for (size_t i = 0; i < cameras.size(); ++i) {
    const size_t c = cameras[i];
    subset.rig.cameras.push_back(rig.bundle.cameras[c]);
    subset.rig.fits.emplace_back();
    const auto add = [&](CalibrationPrior::Unknown unknown, int place) {
      subset.rig.unknowns.push_back(unknown);
      subset.places.push_back(place);
    };
    for (size_t k = 0; k < unknowns.params[c].size(); ++k) {
      if (unknowns.params[c][k] >= 0) add({.camera = i, .param = k}, unknowns.params[c][k]);
    }
    for (int k = 0; unknowns.extrinsics[c] >= 0 && k < 6; ++k) {
      add({.camera = i, .component = k}, unknowns.extrinsics[c] + k);
    }
  }
  const Eigen::Index size = std::ssize(subset.places);
  subset.rig.root = Eigen::MatrixXd::Identity(size, size);
  return subset;
}

}  // namespace

ProjectionSigma DepthSigma(const RigEstimate& rig, const RigUnknowns& unknowns, double distance) {
  const std::vector<BundleCamera>& cameras = rig.bundle.cameras;
  std::vector<std::vector<size_t>> sets;
  if (cameras[0].model->plenoptic) {
    sets.push_back({0});
  } else {
    for (size_t c = 1; c < cameras.size(); ++c) {
      if (!cameras[c].model->plenoptic) sets.push_back({0, c});
    }
  }
  const Eigen::VectorXd scale = UnknownScales(rig, unknowns);
  std::vector<ProjectionSigma::Result> results;
  for (const std::vector<size_t>& set : sets) {
    const Subset subset = SubsetOf(rig, unknowns, set);
    std::vector<MicroLensVisibility> lenses(set.size());
    if (!rig.lenses[0].lenses.empty()) lenses[0] = MicroLensVisibility(rig.lenses[0]);
    const PointsBeforeImage points(subset.rig, lenses);
    const ImageGrid grid(cameras[0].image_size, kDepthCells);
    for (size_t cell = 0; cell < grid.Cells(); ++cell) {
      const std::optional<Eigen::Vector3d> X = points.At(grid.Middle(cell), distance);
      if (!X) continue;
      std::vector<SpaceObservation> seen = points.Seen(*X);
      for (SpaceObservation& each : seen) each.sigma = rig.sigma_px[set[each.camera]];
      const std::optional<PointError> error =
          seen.empty() ? std::nullopt : ErrorAt(subset.rig, seen, *X, SpaceFrame::kRig);
      if (!error) continue;
      Eigen::RowVectorXd by = Eigen::RowVectorXd::Zero(scale.size());
      for (size_t i = 0; i < subset.places.size(); ++i) {
        const int place = subset.places[i];
        by[place] = kMillimetres * scale[place] * error->by_theta(2, static_cast<Eigen::Index>(i));
      }
      results.push_back({0, RegionOf(grid.Middle(cell), cameras[0].image_size), by});
    }
  }
  if (results.empty()) {
    throw InputError(
        "depth@{:g}m: no two ordinary cameras, and no plenoptic one, measure points there",
        distance);
  }
  return {results,
          cameras.size(),
          {.of = fmt::format("z at {:g} m", distance),
           .unit = "mm",
           .determined = kMillimetres * distance}};
}

}  // namespace plenocal
