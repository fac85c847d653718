// SPDX-License-Identifier: Apache-2.0
#include "engine/scene/scene_findings.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "calib/base/statistics.h"
#include "calib/camera/rays.h"

namespace plenocal {
namespace {

// B is the scale of a plenoptic camera's depths.
constexpr double kCertainSensor = 0.01, kOpenSensor = 0.1;
constexpr double kLeastDepthFactors = 1.5;  // largest over smallest T
// Farthest over nearest point: below it depth and focal length hardly differ in effect.
constexpr double kOneDepth = 1.3;
constexpr double kLeastTurn = 12;      // degrees, between two frames
constexpr double kLeastMotion = 0.02;  // of the distance of the points
constexpr double kPoorFocal = 1e-3;    // of an ordinary camera's focal length

// Depths of the used observations of a camera.
std::vector<double> DepthsOf(const Bundle& bundle, size_t c) {
  std::vector<double> depths;
  const BundleCamera& camera = bundle.cameras[c];
  for (const BundleObservation& seen : bundle.observations) {
    if (!seen.used || seen.camera != static_cast<int>(c)) continue;
    depths.push_back(
        (camera.T_camera_rig * (bundle.T_rig_target[static_cast<size_t>(seen.frame)] *
                                bundle.markers[static_cast<size_t>(seen.marker)].position))
            .z());
  }
  return depths;
}

// Largest angle, degrees, and distance between two frames with used observations.
struct PathExtent {
  double turn = 0, motion = 0;
};

PathExtent ExtentOf(const Bundle& bundle) {
  std::set<int> frames;
  for (const BundleObservation& seen : bundle.observations) {
    if (seen.used) frames.insert(seen.frame);
  }
  PathExtent extent;
  for (const int i : frames) {
    for (const int j : frames) {
      if (j >= i) break;
      const RigidTransform& a = bundle.T_rig_target[static_cast<size_t>(i)];
      const RigidTransform& b = bundle.T_rig_target[static_cast<size_t>(j)];
      extent.turn =
          std::max(extent.turn, LogRotation(a.R * b.R.transpose()).norm() * 180 / std::numbers::pi);
      extent.motion = std::max(extent.motion, (a.Inverse().t - b.Inverse().t).norm());
    }
  }
  return extent;
}

// Largest relative standard error of a length: f_L, b_L0, B of plenoptic cameras, focal lengths of
// others.
struct LengthError {
  std::string name;
  double part = 0;
};

LengthError WorstLength(const Calibration& calibration, size_t c) {
  const BundleCamera& camera = calibration.bundle.cameras[c];
  LengthError worst;
  for (size_t k = 0; k < camera.ModelParams(); ++k) {
    const Param& param = camera.model->params[k];
    const bool length =
        camera.model->plenoptic ? param.unit == "m" : param.unit == "px" && param.name[0] == 'f';
    if (!length || camera.fixed[k]) continue;
    const double part = calibration.uncertainty.param_std_errors[c][k] / std::abs(camera.params[k]);
    if (part > worst.part) worst = {std::string(param.name), part};
  }
  return worst;
}

std::string PartText(const LengthError& error) {
  return std::isinf(error.part) ? error.name + " is open"
                                : fmt::format("{} known to {:.2g} %", error.name, 100 * error.part);
}

bool IsPoor(const BundleCamera& camera, const LengthError& error) {
  return error.part > (camera.model->plenoptic ? kCertainSensor : kPoorFocal);
}

class SceneFindings {
 public:
  explicit SceneFindings(const Calibration& calibration)
      : calibration_(calibration), bundle_(calibration.bundle), extent_(ExtentOf(bundle_)) {}

  std::vector<Finding> Find() {
    if (bundle_.scale_distance) AddNoScale();
    for (size_t c = 0; c < bundle_.cameras.size(); ++c) {
      worst_ = WorstLength(calibration_, c);
      poor_ = IsPoor(bundle_.cameras[c], worst_);
      AddDepth(c);
      AddPath(c);
      if (bundle_.cameras[c].model->plenoptic) {
        AddSensor(c);
        AddDepthFactors(c);
      }
    }
    return std::move(findings_);
  }

 private:
  // The grade of a defect follows from the standard errors of the camera's parameters.
  [[nodiscard]] Grade GradeOfDefect() const {
    if (!poor_) return Grade::kGood;
    return worst_.part > kOpenSensor ? Grade::kBad : Grade::kUsable;
  }

  [[nodiscard]] const std::string& NameOf(size_t c) const { return bundle_.cameras[c].name; }

  void AddNoScale() {
    const bool matters = std::ranges::any_of(bundle_.cameras, [](const BundleCamera& camera) {
      return camera.model->plenoptic || !camera.is_master;
    });
    findings_.push_back(
        {.code = "scene_no_scale",
         .role = FindingRole::kCause,
         .grade = matters ? Grade::kBad : Grade::kGood,
         .what = fmt::format("No scale: all lengths ({}) are known up to one common factor.",
                             matters ? "B of a plenoptic camera, translations in the rig, poses, "
                                       "points"
                                     : "poses and points; the parameters have no lengths"),
         .remedy = "no scale: give the stereo pair, a distance, tags of known size or B (sessions: "
                   "'from', 'distances', 'prior')"});
  }

  void AddDepth(size_t c) {
    const std::vector<double> depths = DepthsOf(bundle_, c);
    const double near = Quantile(depths, 0.02), far = Quantile(depths, 0.98);
    if (!(near > 0) || far / near >= kOneDepth) return;
    findings_.push_back({.code = "scene_one_depth",
                         .role = FindingRole::kCause,
                         .grade = GradeOfDefect(),
                         .cameras = {NameOf(c)},
                         .value = far / near,
                         .limit = kOneDepth,
                         .what = fmt::format("{}: all points are between {:.3g} and {:.3g} m: {}.",
                                             NameOf(c),
                                             near,
                                             far,
                                             PartText(worst_)),
                         .remedy = "Add points at half or at twice the distance."});
  }

  void AddPath(size_t c) {
    const double distance = Quantile(DepthsOf(bundle_, c), 0.5);
    const bool turns = extent_.turn >= kLeastTurn,
               moves = extent_.motion >= kLeastMotion * distance;
    if (!turns) {
      findings_.push_back({.code = "scene_no_turning",
                           .role = FindingRole::kCause,
                           .grade = GradeOfDefect(),
                           .cameras = {NameOf(c)},
                           .value = extent_.turn,
                           .limit = kLeastTurn,
                           .what = fmt::format("{}: the camera never turned (by at most {:.1f} "
                                               "degrees): {}.",
                                               NameOf(c),
                                               extent_.turn,
                                               PartText(worst_)),
                           .remedy = "Turn the camera about both image axes and roll it."});
    }
    if (!moves) {
      findings_.push_back({.code = "scene_no_parallax",
                           .role = FindingRole::kCause,
                           .grade = GradeOfDefect(),
                           .cameras = {NameOf(c)},
                           .value = extent_.motion / distance,
                           .limit = kLeastMotion,
                           .what = fmt::format("{}: the camera hardly moved ({:.2g} m at points "
                                               "{:.2g} m away): {}.",
                                               NameOf(c),
                                               extent_.motion,
                                               distance,
                                               PartText(worst_)),
                           .remedy = "Move the camera by a tenth of the distance or more."});
    }
  }

  void AddSensor(size_t c) {
    const BundleCamera& camera = bundle_.cameras[c];
    for (size_t k = 0; k < camera.ModelParams(); ++k) {
      if (camera.model->params[k].name != "B") continue;
      const double part = calibration_.uncertainty.param_std_errors[c][k] / camera.params[k];
      if (part < kCertainSensor) return;
      findings_.push_back(
          {.code = "scene_B",
           .grade = part > kOpenSensor ? Grade::kBad : Grade::kUsable,
           .cameras = {camera.name},
           .value = part,
           .limit = kCertainSensor,
           .what = std::isinf(part)
                       ? fmt::format("{}: B is open, and with it all depths.", camera.name)
                       : fmt::format("{}: B is known to {:.2g} %, and depths no better.",
                                     camera.name,
                                     100 * part),
           .remedy = "Add points over a larger range of depths, near ones above all, and more of "
                     "them; a prior on B from an earlier calibration helps as well."});
    }
  }

  void AddDepthFactors(size_t c) {
    const DepthFactors factors = DepthFactorsOf(bundle_, c);
    const double span = factors.high / factors.low;
    if (span >= kLeastDepthFactors) return;
    findings_.push_back(
        {.code = "scene_depth_factors",
         .grade = poor_ ? GradeOfDefect() : Grade::kUsable,
         .cameras = {NameOf(c)},
         .value = span,
         .limit = kLeastDepthFactors,
         .what = fmt::format("{}: the points' virtual depths differ little (depth factor T from "
                             "{:.2g} to {:.2g}).",
                             NameOf(c),
                             factors.low,
                             factors.high),
         .remedy =
             "Add nearer and farther points: the largest T should be 1.5 times the smallest."});
  }

  const Calibration& calibration_;
  const Bundle& bundle_;
  PathExtent extent_;
  LengthError worst_;  // of the present camera
  bool poor_ = false;
  std::vector<Finding> findings_;
};

bool PriorHasTranslation(const Bundle& bundle) {
  return bundle.prior && std::ranges::any_of(bundle.prior->unknowns, [&](const auto& unknown) {
           return !unknown.param && bundle.prior->T_camera_rig[unknown.camera].t.norm() > 0;
         });
}

// A fixed parameter or one with a prior that is a length inside of a plenoptic camera.
bool KnowsLength(const Bundle& bundle, size_t c, size_t k) {
  const BundleCamera& camera = bundle.cameras[c];
  if (!camera.model->plenoptic || camera.model->params[k].unit != "m") return false;
  if (camera.fixed[k] || (!camera.rules.empty() && camera.rules[k].prior)) return true;
  return bundle.prior && std::ranges::any_of(bundle.prior->unknowns, [&](const auto& unknown) {
           return unknown.camera == c && unknown.param == k;
         });
}

}  // namespace

bool HasScale(const Bundle& bundle) {
  if (!bundle.distances.empty() || PriorHasTranslation(bundle)) return true;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const BundleCamera& camera = bundle.cameras[c];
    if (c > 0 && camera.is_master && camera.T_camera_rig.t.norm() > 0) return true;
    for (size_t k = 0; k < camera.ModelParams(); ++k) {
      if (KnowsLength(bundle, c, k)) return true;
    }
  }
  return false;
}

DepthFactors DepthFactorsOf(const Bundle& bundle, size_t c) {
  const BundleCamera& camera = bundle.cameras[c];
  std::vector<double> factors;
  for (const BundleObservation& seen : bundle.observations) {
    if (!seen.used || seen.camera != static_cast<int>(c)) continue;
    const Eigen::Vector3d p =
        camera.T_camera_rig * (bundle.T_rig_target[static_cast<size_t>(seen.frame)] *
                               bundle.markers[static_cast<size_t>(seen.marker)].position);
    std::array<double, kMaxObservationSize> values = seen.seen.values;
    double here[kMaxObservationSize], there[kMaxObservationSize];
    const auto project = [&](double* out) { return Project(camera, values.data(), p, out); };
    if (!project(here)) continue;
    values[2] += 1;  // the micro lens one pixel to the right
    if (project(there)) factors.push_back(1 / (1 - (there[0] - here[0])));
  }
  return {Quantile(factors, 0.02), Quantile(factors, 0.98)};
}

std::vector<Finding> FindingsOfScene(const Calibration& calibration) {
  return SceneFindings(calibration).Find();
}

Finding FindingOfPatches() {
  return {.code = "scene_patches",
          .grade = Grade::kUsable,
          .what =
              "the points are patches of images: errors that all observations of a patch share, by "
              "depth inside of it or by blur, are not in the standard errors.",
          .remedy =
              "Compare with a calibration from a target or from other images before trusting "
              "differences of a few standard errors."};
}

}  // namespace plenocal
