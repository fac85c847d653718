// SPDX-License-Identifier: Apache-2.0
//
// Exact observations of the target's markers by the cameras of a simulated rig.
#pragma once

#include <map>
#include <memory>
#include <vector>

#include "apps/simulate/render/micro_lens_optics.h"
#include "apps/simulate/spec/random.h"
#include "apps/simulate/spec/simulation_spec.h"
#include "targets/target.h"

namespace plenocal::simulate {

/// A target with its manufacturing errors.
struct TrueTarget {
  std::map<int, Eigen::Vector3d> markers;  ///< true positions, m, target's frame
  /// Unit normals on the printed side at each marker; zero: visible from all sides.
  std::map<int, Eigen::Vector3d> normals;
};

/// Manufacturing errors of tags. Rigid: tags are displaced, rotated and scaled as a whole, like
/// printed tags glued to a board. Corners: each corner has an error of its own, tags stay flat.
enum class TagErrors { kRigid, kCorners };

/// Displaces the markers by `sigma` (m) in each coordinate.
TrueTarget MakeTarget(const Target& nominal, double sigma, TagErrors tag_errors, int seed);

/// Observes points with the cameras of a specification.
class Observer {
 public:
  explicit Observer(const SimulationSpec& spec);

  /// Exact observations of all markers that camera `c` can see: printed side towards it, within
  /// the image, for a plenoptic camera within micro images. Nothing is occluded by the target.
  [[nodiscard]] std::vector<Observation> Observe(std::size_t c,
                                                 const TrueTarget& target,
                                                 const RigidTransform& T_rig_target) const;
  /// Exact observations of one point, p_cam in the camera's frame: none, one or, by a plenoptic
  /// camera, one through each micro lens that images it.
  [[nodiscard]] std::vector<Observation> ObservePoint(std::size_t c,
                                                      int marker,
                                                      const Eigen::Vector3d& p_cam) const;
  /// The ray through the centre of the camera's pupil that reaches pixel `u`.
  [[nodiscard]] std::optional<Ray> CentralRay(std::size_t c, const Eigen::Vector2d& u) const;
  /// Null for an ordinary camera.
  [[nodiscard]] const MicroLensOptics* Optics(std::size_t c) const { return optics_[c].get(); }

 private:
  const SimulationSpec& spec_;
  std::vector<std::unique_ptr<MicroLensOptics>> optics_;
};

/// Adds the noise of the camera's detections to an observation.
void AddNoise(const CameraSpec& camera, Random* random, Observation* observation);

/// Number of different markers in the observations.
int CountMarkers(const std::vector<Observation>& observations);

}  // namespace plenocal::simulate
