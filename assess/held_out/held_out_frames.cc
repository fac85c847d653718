// SPDX-License-Identifier: Apache-2.0
#include "assess/held_out/held_out_frames.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>

#include "calib/adjust/solver/adjust.h"
#include "calib/base/error.h"
#include "calib/base/statistics.h"
#include "calib/start/camera_guess.h"

namespace plenocal {
namespace {

double MedianLength(const Bundle& bundle, size_t first) {
  std::vector<double> lengths;
  for (size_t i = first; i < bundle.observations.size(); ++i) {
    const BundleObservation& observation = bundle.observations[i];
    double residual[kMaxObservationSize];
    lengths.push_back(Residual(bundle, observation, residual)
                          ? WeightedLength(bundle, observation, residual)
                          : std::numeric_limits<double>::infinity());
  }
  return Median(std::move(lengths));
}

// The bundle of a part's frames, in which only poses are estimated.
class FramePoses {
 public:
  FramePoses(const Bundle& trained,
             std::span<const TrialPoint> points,
             const std::vector<bool>& outliers)
      : points_(points), outliers_(outliers) {
    bundle_.cameras = trained.cameras;
    for (BundleCamera& camera : bundle_.cameras) {
      camera.fixed.assign(camera.params.size(), true);
      camera.rules.clear();
      camera.is_master = true;  // holds its place on the rig
    }
    bundle_.markers = trained.markers;
    for (size_t i = 0; i < bundle_.markers.size(); ++i) {
      marker_index_[bundle_.markers[i].number] = static_cast<int>(i);
      markers_[bundle_.markers[i].number] = bundle_.markers[i].position;
    }
  }

  // Points [begin, end), which share a pose, with that from resection; without one they stay
  // unimaged.
  void Add(size_t begin, size_t end) {
    const size_t first = bundle_.observations.size();
    const std::vector<size_t> order = InOrder(begin, end);
    for (const size_t p : order) AddObservation(p);
    bundle_.T_rig_target.emplace_back();
    const std::optional<RigidTransform> pose = BestPose(begin, end, first);
    if (!pose) {
      bundle_.observations.resize(first);
      bundle_.T_rig_target.pop_back();
      return;
    }
    bundle_.T_rig_target.back() = *pose;
    for (size_t i = first; i < bundle_.observations.size(); ++i) {
      BundleObservation& observation = bundle_.observations[i];
      double residual[kMaxObservationSize];
      observation.used = observation.used && Residual(bundle_, observation, residual);
    }
    point_of_.insert(point_of_.end(), order.begin(), order.end());
  }

  void Solve(std::vector<HeldOutResidual>* residuals) {
    AdjustOptions adjust;
    adjust.cost_tolerance = 1e-12;
    const AdjustSummary summary = Adjust(&bundle_, adjust);
    if (!summary.usable) throw Error(ErrorKind::kJob, "poses cannot be found: " + summary.message);
    const auto found = Residuals(bundle_);
    for (size_t i = 0; i < point_of_.size(); ++i) {
      (*residuals)[point_of_[i]] = {.imaged = !std::isnan(found[i][0]), .values = found[i]};
    }
  }

 private:
  [[nodiscard]] std::vector<size_t> InOrder(size_t begin, size_t end) const {
    std::vector<size_t> order;
    for (size_t p = begin; p < end; ++p) order.push_back(p);
    const auto rank = [&](size_t p) {
      return std::pair(points_[p].camera, marker_index_.at(points_[p].seen->marker));
    };
    std::ranges::stable_sort(order, [&](size_t a, size_t b) { return rank(a) < rank(b); });
    return order;
  }

  void AddObservation(size_t p) {
    const TrialPoint& point = points_[p];
    bundle_.observations.push_back({static_cast<int>(point.camera),
                                    static_cast<int>(bundle_.T_rig_target.size()),
                                    marker_index_.at(point.seen->marker),
                                    *point.seen,
                                    !outliers_[p],
                                    {point.by_nuisance.begin(), point.by_nuisance.end()}});
    if (point.seen->detector_sigma > 0) {
      bundle_.observations.back().assumed_sigma = point.seen->detector_sigma;
    }
  }

  // Of the poses that the single views suggest, the one with the smallest median residual of all
  // observations from `first` on.
  std::optional<RigidTransform> BestPose(size_t begin, size_t end, size_t first) {
    std::map<std::pair<size_t, size_t>, View> views;  // by camera and view: the good points
    for (size_t p = begin; p < end; ++p) {
      const TrialPoint& point = points_[p];
      if (!outliers_[p]) views[{point.camera, point.view}].observations.push_back(*point.seen);
    }
    std::optional<RigidTransform> best;
    double least = 0;
    for (const auto& [place, view] : views) {
      const BundleCamera& camera = bundle_.cameras[place.first];
      const auto T_camera_target = GuessPose(camera, view, markers_);
      if (!T_camera_target) continue;
      bundle_.T_rig_target.back() = camera.T_camera_rig.Inverse() * *T_camera_target;
      const double error = MedianLength(bundle_, first);
      if (best && error >= least) continue;
      best = bundle_.T_rig_target.back();
      least = error;
    }
    return best;
  }

  std::span<const TrialPoint> points_;
  const std::vector<bool>& outliers_;
  Bundle bundle_;
  std::map<int, int> marker_index_;
  std::map<int, Eigen::Vector3d> markers_;
  std::vector<size_t> point_of_;  // per observation
};

}  // namespace

void PredictHeldOut(const Bundle& trained,
                    const HeldOutFrames& frames,
                    size_t fold,
                    const std::vector<bool>& outliers,
                    std::vector<HeldOutResidual>* residuals) {
  const std::span<const TrialPoint> points = frames.points;
  // Frames that were held out have no motion.
  const bool own_poses = trained.jitter.translation_sigma > 0 ||
                         std::ranges::any_of(trained.cameras, [](const BundleCamera& camera) {
                           return camera.Find(nuisances::kTimeShift).has_value();
                         });
  FramePoses poses(trained, points, outliers);
  for (size_t begin = 0; begin < points.size();) {
    const auto together = [&](const TrialPoint& point) {
      return point.frame == points[begin].frame &&
             (!own_poses || point.camera == points[begin].camera);
    };
    size_t end = begin;
    while (end < points.size() && together(points[end])) ++end;
    if (points[begin].frame % frames.folds == fold) poses.Add(begin, end);
    begin = end;
  }
  poses.Solve(residuals);
}

}  // namespace plenocal
