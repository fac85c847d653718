// SPDX-License-Identifier: Apache-2.0
#include "assess/views/next_views.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

#include "assess/views/information_state.h"
#include "assess/views/view_information.h"
#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/parallel.h"

namespace plenocal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kDegrees = 57.29577951308232;
// Sizes of the stages from coarse to fine: markers and candidates.
constexpr size_t kCoarseMarkers = 12, kFineMarkers = 80;
constexpr size_t kKept = 400, kExecuted = 16;

struct Candidate {
  TargetPose pose;
  RigidTransform T_rig_target;
  std::optional<Eigen::MatrixXd> information = std::nullopt;
  double score = 0;
};

// Whether a person sees two suggestions as different.
bool Differ(const TargetPose& a, const TargetPose& b, ImageSize image_size) {
  if (a.camera != b.camera) return true;
  constexpr double kAngle = 20 / kDegrees, kDistance = 0.2, kPart = 1.0 / 3;
  const auto normal = [](const TargetPose& pose) {
    return Eigen::Vector3d(std::sin(pose.tilt) * std::cos(pose.away),
                           std::sin(pose.tilt) * std::sin(pose.away),
                           std::cos(pose.tilt));
  };
  const double angle = std::acos(std::clamp(normal(a).dot(normal(b)), -1.0, 1.0));
  return angle > kAngle || a.turn != b.turn ||
         std::abs(a.distance - b.distance) > kDistance * std::max(a.distance, b.distance) ||
         std::abs(a.place.x() - b.place.x()) > kPart * image_size[0] ||
         std::abs(a.place.y() - b.place.y()) > kPart * image_size[1];
}

class Choice {
 public:
  Choice(const RigEstimate& rig, const ViewTarget& shape, const NextViewOptions& options)
      : rig_(rig),
        shape_(shape),
        options_(options),
        ranges_(Ranges()),
        distances_(Distances()),
        unknowns_(MakeRigUnknowns(rig.bundle, distances_[0])),
        predictor_(rig, unknowns_, shape),
        projection_(rig, unknowns_, distances_),
        state_(predictor_.InformationSoFar(), unknowns_.head, projection_) {}

  NextViews Run() {
    NextViews result{.goal = options_.goal, .distances = distances_};
    result.frames = rig_.bundle.T_rig_target.size();
    result.sigma = state_.SigmaOfImages();
    result.reached = result.sigma <= options_.goal;
    MakeCandidates();
    for (int i = 0; i < options_.count; ++i) {
      const std::optional<NextView> view = Choose(result.views);
      if (!view) break;
      result.views.push_back(*view);
    }
    constexpr double kWorthIt = 0.9;
    result.exhausted = std::isfinite(result.sigma) && !result.views.empty() &&
                       result.views.back().sigma_after > kWorthIt * result.sigma;
    return result;
  }

 private:
  std::vector<ViewRange> Ranges() const {
    std::vector<ViewRange> ranges;
    for (size_t c = 0; c < rig_.bundle.cameras.size(); ++c) {
      ranges.push_back(
          FeasibleRange(rig_, c, shape_, PointDistances(rig_.bundle, c), options_.range));
    }
    return ranges;
  }

  std::vector<double> Distances() const {
    double nearest = kInfinity, farthest = 0;
    bool plenoptic = false;
    for (const ViewRange& range : ranges_) {
      nearest = std::min(nearest, range.nearest);
      farthest = std::max(farthest, range.farthest);
    }
    for (const BundleCamera& camera : rig_.bundle.cameras) plenoptic |= camera.model->plenoptic;
    if (plenoptic) return {nearest, 2 / (1 / nearest + 1 / farthest), farthest};
    return {nearest, farthest, 10 * farthest};
  }

  void MakeCandidates() {
    for (size_t c = 0; c < rig_.bundle.cameras.size(); ++c) {
      for (const TargetPose& pose :
           CandidatePoses(rig_, c, shape_, ranges_[c], options_.largest_tilt)) {
        const auto T_camera_target = PlaceTarget(rig_, shape_, pose);
        if (!T_camera_target) continue;
        candidates_.push_back(
            {.pose = pose,
             .T_rig_target = rig_.bundle.cameras[c].T_camera_rig.Inverse() * *T_camera_target});
      }
    }
    Score(kCoarseMarkers);
    Keep(kKept);
    if (candidates_.empty()) {
      throw JobError(
          "no pose of the target is feasible: nowhere between these distances can enough "
          "of it be seen; check target, image size and lens angle, or set --near and "
          "--far");
    }
    ParallelFor(candidates_.size(), options_.threads, [&](size_t i) {
      candidates_[i].information = InformationOf(candidates_[i], kFineMarkers);
    });
  }

  // Nothing where the camera before which the pose was made, and which its words name, does not
  // find the target, even if another one does.
  std::optional<Eigen::MatrixXd> InformationOf(const Candidate& candidate, size_t markers) const {
    const bool found =
        predictor_.PredictVisibility(candidate.pose.camera, candidate.T_rig_target, markers).found;
    if (!found) return std::nullopt;
    return predictor_.Information(candidate.T_rig_target, markers);
  }

  void Score(size_t markers) {
    ParallelFor(candidates_.size(), options_.threads, [&](size_t i) {
      const auto information = InformationOf(candidates_[i], markers);
      candidates_[i].score = information ? state_.Gain(*information) : -kInfinity;
    });
  }

  // The best by score; later suggestions come from the best at different places, so those of each
  // ninth of the image and camera are kept.
  void Keep(size_t most) {
    std::erase_if(candidates_, [](const Candidate& each) { return each.score == -kInfinity; });
    std::ranges::stable_sort(candidates_, std::ranges::greater{}, &Candidate::score);
    const size_t of_each = most / (kRegions * rig_.bundle.cameras.size()) + 1;
    std::map<std::pair<size_t, size_t>, size_t> counts;
    size_t kept = 0;
    std::erase_if(candidates_, [&](const Candidate& each) {
      const ImageSize size = rig_.bundle.cameras[each.pose.camera].image_size;
      size_t& count = counts[{each.pose.camera, RegionOf(each.pose.place, size)}];
      return kept++ >= most && ++count > of_each;
    });
  }

  // Mean of the information over the poses that come of it. A target that is not found then adds
  // nothing.
  Eigen::MatrixXd Expected(const Candidate& candidate) const {
    const RigidTransform& T_camera_rig = rig_.bundle.cameras[candidate.pose.camera].T_camera_rig;
    const std::vector<RigidTransform> executed =
        ExecutedPoses(T_camera_rig * candidate.T_rig_target,
                      shape_,
                      options_.angle_error,
                      options_.distance_error);
    const Eigen::Index size = unknowns_.unit.size();
    Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(size, size);
    for (const RigidTransform& T_camera_target : executed) {
      const auto more =
          predictor_.Information(T_camera_rig.Inverse() * T_camera_target, kFineMarkers);
      if (more) sum += *more / static_cast<double>(executed.size());
    }
    return sum;
  }

  std::optional<NextView> Choose(const std::vector<NextView>& before) {
    std::vector<std::pair<double, const Candidate*>> open;
    for (Candidate& each : candidates_) {
      if (!each.information) continue;
      const ImageSize size = rig_.bundle.cameras[each.pose.camera].image_size;
      if (!std::ranges::all_of(
              before, [&](const NextView& view) { return Differ(view.pose, each.pose, size); })) {
        continue;
      }
      open.emplace_back(0, &each);
    }
    ParallelFor(open.size(), options_.threads, [&](size_t i) {
      open[i].first = state_.Gain(*open[i].second->information);
    });
    std::ranges::stable_sort(open, [](const auto& a, const auto& b) { return a.first > b.first; });
    open.resize(std::min(open.size(), kExecuted));
    std::vector<Eigen::MatrixXd> expected(open.size());
    ParallelFor(open.size(), options_.threads, [&](size_t i) {
      expected[i] = Expected(*open[i].second);
      open[i].first = state_.Gain(expected[i]);
    });
    const auto best = std::ranges::max_element(
        open, [](const auto& a, const auto& b) { return a.first < b.first; });
    if (best == open.end() || !(best->first > 0)) return std::nullopt;
    return Take(*best->second, expected[static_cast<size_t>(best - open.begin())]);
  }

  NextView Take(const Candidate& candidate, const Eigen::MatrixXd& information) {
    const size_t camera = candidate.pose.camera;
    NextView view{.pose = candidate.pose,
                  .T_rig_target = candidate.T_rig_target,
                  .criterion = state_.Criterion()};
    const Eigen::MatrixXd before = state_.Covariance();
    view.sigma_before = state_.Sigma();
    state_.Add(information);
    view.sigma_after = state_.Sigma();
    double most = -kInfinity;
    for (size_t r = 0; r < kRegions; ++r) {
      const double was = projection_.InRegion(camera, r, before);
      const double is = projection_.InRegion(camera, r, state_.Covariance());
      if (!(was - is > most)) continue;
      most = was - is;
      view.region = r;
      view.region_before = was;
      view.region_after = is;
    }
    for (size_t c = 0; c < rig_.bundle.cameras.size(); ++c) {
      if (!predictor_.PredictVisibility(c, view.T_rig_target, kFineMarkers).found) continue;
      view.cameras.push_back(c);
      view.outlines[c] = OutlinesIn(c, view.T_rig_target);
    }
    return view;
  }

  std::vector<std::vector<Eigen::Vector2d>> OutlinesIn(size_t c,
                                                       const RigidTransform& T_rig_target) const {
    const BundleCamera& camera = rig_.bundle.cameras[c];
    const RigidTransform T = camera.T_camera_rig * T_rig_target;
    const MicroLensVisibility lenses =
        camera.model->plenoptic ? MicroLensVisibility(rig_.lenses[c]) : MicroLensVisibility();
    std::vector<std::vector<Eigen::Vector2d>> outlines;
    for (const auto& outline : shape_.outlines) {
      auto& drawn = outlines.emplace_back();
      for (size_t i = 0; i < outline.size(); ++i) {
        // Straight edges bend in the image.
        constexpr int kSteps = 12;
        const Eigen::Vector3d &a = outline[i], &b = outline[(i + 1) % outline.size()];
        for (int s = 0; s < kSteps; ++s) {
          const Eigen::Vector3d p = T * (a + (b - a) * s / kSteps);
          Eigen::Vector2d u_px;
          const std::array<double, kMaxObservationSize> values{};
          if (lenses.HasLenses()) {
            const MicroLensVisibility::Seen seen = lenses.LensesShowing(camera, p, 1);
            if (seen.all > 0) drawn.push_back(seen.image);
          } else if (camera.model->Project(camera.params.data(),
                                           camera.config.data(),
                                           values.data(),
                                           p,
                                           u_px.data())) {
            drawn.push_back(u_px);
          }
        }
      }
    }
    return outlines;
  }

  const RigEstimate& rig_;
  const ViewTarget& shape_;
  const NextViewOptions& options_;
  std::vector<ViewRange> ranges_;  // per camera
  std::vector<double> distances_;
  RigUnknowns unknowns_;
  ViewPredictor predictor_;
  ProjectionSigma projection_;
  InformationState state_;
  std::vector<Candidate> candidates_;
};

}  // namespace

NextViews ChooseNextViews(const RigEstimate& rig,
                          const ViewTarget& shape,
                          const NextViewOptions& options) {
  return Choice(rig, shape, options).Run();
}

}  // namespace plenocal
