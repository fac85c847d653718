// SPDX-License-Identifier: Apache-2.0
#include "assess/views/next_views.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

#include "assess/views/candidates.h"
#include "assess/views/information_state.h"
#include "assess/views/optimal_design.h"
#include "assess/views/view_information.h"
#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/parallel.h"

namespace plenocal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Sizes of the stages from coarse to fine: markers and candidates.
constexpr size_t kCoarseMarkers = 24, kFineMarkers = 150;
constexpr size_t kKept = 400;
struct Effort {
  size_t preferred;  // candidates whose gain is computed
  size_t executed;   // of these, candidates whose mean gain over inexact poses is computed
};
constexpr Effort kSuggested{100, 16}, kCounted{20, 4};
// The most views that are counted until the goal.
constexpr size_t kMostViews = 30;

}  // namespace

class NextViewChooser::Impl {
 public:
  Impl(ViewTarget shape, const NextViewOptions& options)
      : shape_(std::move(shape)), options_(options) {}

  NextViews Run(RigEstimate rig) {
    rig_ = std::move(rig);
    std::vector<CandidateBasis> cameras = Cameras();
    // A choice that failed leaves no candidates.
    const bool stay = !fine_.poses.empty() && CandidatesStay(cameras_, cameras, unknowns_);
    if (!stay) {
      fine_ = {};
      cameras_ = std::move(cameras);
      distances_ = JudgedDistances(cameras_, IsPlenoptic());
      unknowns_ = MakeRigUnknowns(rig_.bundle, distances_[0]);
    }
    predictor_.emplace(rig_, unknowns_, shape_);
    projection_.emplace(options_.lowered ? options_.lowered(rig_, unknowns_)
                                         : ProjectionSigma(rig_, unknowns_, distances_));
    state_.emplace(predictor_->InformationSoFar(), unknowns_.head, *projection_);
    if (!stay) MakeCandidates();
    NextViews result{
        .goal = options_.goal, .lowered = projection_->Words(), .distances = distances_};
    result.frames = rig_.bundle.T_rig_target.size();
    result.sigma = state_->SigmaOfImages();
    result.reached = result.sigma <= options_.goal;
    // Before there are frames the estimate is the lens' as the user states it.
    if (result.frames == 0 || std::isfinite(result.sigma)) result.bound = Bound(result.frames);
    const auto wanted = static_cast<size_t>(options_.count);
    const bool is_near = result.bound && result.bound->further <= kMostViews;
    for (size_t i = 0; i < std::max(wanted, is_near ? kMostViews : 0); ++i) {
      const bool reached = state_->SigmaOfImages() <= options_.goal;
      if (reached && !result.suggested) result.suggested = i;
      if (reached && i >= wanted) break;
      Candidate* const best = i < wanted ? Best(result.views, kSuggested) : Best({}, kCounted);
      if (best == nullptr) break;
      if (i < wanted) {
        result.views.push_back(Take(Improved(*best, result.views)));
      } else {
        state_->Add(best->expected);
      }
    }
    constexpr double kWorthIt = 0.9;
    result.exhausted = std::isfinite(result.sigma) && !result.views.empty() &&
                       result.views.back().sigma_after > kWorthIt * result.sigma;
    return result;
  }

 private:
  struct Candidate {
    TargetPose pose;
    RigidTransform T_rig_target;
    Eigen::VectorXf coarse = {};    // packed information by few markers
    std::optional<size_t> fine{};   // column of that by more, if it is known
    Eigen::MatrixXd expected = {};  // mean over executed poses; empty: not known
  };

  // Views whose information is computed by many markers: candidates and places between them.
  struct FineViews {
    std::vector<TargetPose> poses;

    size_t Add(const TargetPose& pose, const Eigen::VectorXd& information) {
      packed_.insert(packed_.end(), information.begin(), information.end());
      size_ = information.size();
      poses.push_back(pose);
      return poses.size() - 1;
    }
    // Packed information.
    [[nodiscard]] Eigen::VectorXd Column(size_t i) const {
      return Columns().col(static_cast<Eigen::Index>(i));
    }
    [[nodiscard]] Eigen::Map<const Eigen::MatrixXd> Columns() const {
      return {packed_.data(), size_, static_cast<Eigen::Index>(poses.size())};
    }

   private:
    std::vector<double> packed_;
    Eigen::Index size_ = 0;
  };

  [[nodiscard]] std::vector<CandidateBasis> Cameras() const {
    std::vector<CandidateBasis> cameras;
    for (size_t c = 0; c < rig_.bundle.cameras.size(); ++c) {
      const BundleCamera& camera = rig_.bundle.cameras[c];
      const std::vector<double> seen = PointDistances(rig_.bundle, c);
      cameras.push_back({camera.params,
                         camera.fixed,
                         rig_.sigma_px[c],
                         FeasibleRange(rig_, c, shape_, seen, options_.range)});
    }
    return cameras;
  }

  [[nodiscard]] bool IsPlenoptic() const {
    return std::ranges::any_of(rig_.bundle.cameras,
                               [](const BundleCamera& camera) { return camera.model->plenoptic; });
  }

  void MakeCandidates() {
    candidates_.clear();
    searches_ = kSearches;
    for (size_t c = 0; c < cameras_.size(); ++c) {
      for (const TargetPose& pose :
           CandidatePoses(rig_, c, shape_, cameras_[c].range, options_.largest_tilt)) {
        if (auto candidate = MakeCandidate(pose)) candidates_.push_back(std::move(*candidate));
      }
    }
    std::vector<double> scores(candidates_.size(), -kInfinity);
    ParallelFor(candidates_.size(), options_.threads, [&](size_t i) {
      const auto information = InformationOf(candidates_[i], kCoarseMarkers);
      if (!information) return;
      candidates_[i].coarse = Packed(*information).cast<float>();
      scores[i] = state_->Gain(*information);
    });
    std::vector<size_t> best(candidates_.size());
    std::iota(best.begin(), best.end(), size_t{0});
    std::erase_if(best, [&](size_t i) { return scores[i] == -kInfinity; });
    std::ranges::stable_sort(best, [&](size_t a, size_t b) { return scores[a] > scores[b]; });
    // Later suggestions come from the best at different places, so those of each ninth of the
    // image and camera are among them.
    std::vector<TargetPose> poses;
    for (const Candidate& each : candidates_) poses.push_back(each.pose);
    std::vector<ImageSize> sizes;
    for (const BundleCamera& camera : rig_.bundle.cameras) sizes.push_back(camera.image_size);
    Refine(KeepSpread(std::move(best), poses, sizes, kKept));
    if (fine_.poses.empty()) {
      throw JobError(
          "no pose of the target is feasible: nowhere between these distances can enough "
          "of it be seen; check target, image size and lens angle, or set --near and "
          "--far");
    }
  }

  // Computes the information of candidates by more markers.
  void Refine(const std::vector<size_t>& chosen) {
    std::vector<std::optional<Eigen::MatrixXd>> all(chosen.size());
    ParallelFor(chosen.size(), options_.threads, [&](size_t i) {
      all[i] = InformationOf(candidates_[chosen[i]], kFineMarkers);
    });
    for (size_t i = 0; i < chosen.size(); ++i) {
      Candidate& candidate = candidates_[chosen[i]];
      if (all[i]) {
        candidate.fine = fine_.Add(candidate.pose, Packed(*all[i]));
      } else {
        candidate.coarse.resize(0);
      }
    }
  }

  // Adds views between the candidates, found from those of the design by a local search, that lower
  // f by more than any candidate. False when there are none.
  bool AddBetween(const OptimalDesign& design) {
    constexpr double kClearly = 1.005;
    const double least = 0.01 * design.weights.sum();
    std::vector<size_t> chosen;
    for (Eigen::Index i = 0; i < design.weights.size(); ++i) {
      if (design.weights[i] > least) chosen.push_back(static_cast<size_t>(i));
    }
    const Eigen::VectorXd slope = PackedTwice(design.slope);
    const auto packed = [&](const TargetPose& pose) -> std::optional<Eigen::VectorXd> {
      const auto candidate = MakeCandidate(pose);
      const auto more = candidate ? InformationOf(*candidate, kFineMarkers) : std::nullopt;
      return more ? std::optional(Packed(*more)) : std::nullopt;
    };
    const auto loss = [&](const TargetPose& pose) {
      const auto information = packed(pose);
      return information ? slope.dot(*information) : -kInfinity;
    };
    const auto neighbour = [&](const TargetPose& pose, size_t k, double step) {
      return Neighbour(pose, k, step);
    };
    std::vector<std::pair<TargetPose, Eigen::VectorXd>> found(chosen.size());
    ParallelFor(chosen.size(), options_.threads, [&](size_t i) {
      const TargetPose pose = LargestNearby(fine_.poses[chosen[i]], neighbour, loss);
      found[i] = {pose, *packed(pose)};
    });
    const size_t before = fine_.poses.size();
    for (const auto& [pose, information] : found) {
      if (slope.dot(information) > kClearly * design.steepest) fine_.Add(pose, information);
    }
    return fine_.poses.size() > before;
  }

  [[nodiscard]] TargetPose Neighbour(const TargetPose& pose, size_t neighbour, double step) const {
    return NeighbourPose(pose,
                         neighbour,
                         step,
                         rig_.bundle.cameras[pose.camera].image_size,
                         cameras_[pose.camera].range,
                         options_.largest_tilt);
  }

  [[nodiscard]] std::optional<Candidate> MakeCandidate(const TargetPose& pose) const {
    const auto T_camera_target = PlaceTarget(rig_, shape_, pose);
    if (!T_camera_target) return std::nullopt;
    const RigidTransform& T_camera_rig = rig_.bundle.cameras[pose.camera].T_camera_rig;
    return Candidate{.pose = pose, .T_rig_target = T_camera_rig.Inverse() * *T_camera_target};
  }

  // The best `count` views beside those so far. Few markers leave an error in the information, so
  // that of all views that may be among the best is computed by more.
  OptimalDesign Design(const Eigen::MatrixXd& so_far, double count, Eigen::VectorXd* weights) {
    constexpr float kMayBe = 0.7F;  // of the steepest
    constexpr size_t kAtOnce = 200;
    for (;;) {
      OptimalDesign design =
          SolveDesign(projection_->All(), so_far, fine_.Columns(), count, *weights);
      *weights = design.weights;
      const Eigen::VectorXf slope = PackedTwice(design.slope).cast<float>();
      std::vector<std::pair<float, size_t>> steep;
      for (size_t i = 0; i < candidates_.size(); ++i) {
        const Candidate& each = candidates_[i];
        if (each.fine || each.coarse.size() == 0) continue;
        const float loss = slope.dot(each.coarse);
        if (loss > kMayBe * static_cast<float>(design.steepest)) steep.emplace_back(-loss, i);
      }
      if (steep.empty()) {
        if (searches_ == 0) return design;
        --searches_;
        if (!AddBetween(design)) return design;
        continue;
      }
      std::ranges::sort(steep);
      steep.resize(std::min(steep.size(), kAtOnce));
      std::vector<size_t> chosen;
      for (const auto& [loss, i] : steep) chosen.push_back(i);
      Refine(chosen);
    }
  }

  ViewBound Bound(size_t frames) {
    ViewBound bound;
    Eigen::VectorXd weights;
    if (frames > 0) {
      const auto count = static_cast<double>(frames);
      const Eigen::Index size = unknowns_.unit.size();
      const OptimalDesign design = Design(Eigen::MatrixXd::Identity(size, size), count, &weights);
      const InformationState best(Inverse(design.covariance), unknowns_.head, *projection_);
      if (best.IsDetermined()) bound.sigma = std::sqrt(design.LeastTrace(count));
    }
    if (state_->Sigma() <= options_.goal) return bound;
    // Newton's method: f is convex in the number of views, so that each step stays a bound.
    const double goal = options_.goal * options_.goal;
    constexpr double kLarge = 1000, kSame = 1.005;
    weights.resize(0);
    for (double count = 0, next = 1; next > kSame * count; next = bound.further) {
      count = next;
      bound.further = Design(state_->Information(), count, &weights).FewestViews(goal);
      if (!(bound.further < kLarge)) bound.further = kInfinity;
      if (std::isinf(bound.further)) break;
    }
    return bound;
  }

  // Nothing where the camera before which the pose was made, and which its words name, does not
  // find the target, even if another one does.
  std::optional<Eigen::MatrixXd> InformationOf(const Candidate& candidate, size_t markers) const {
    return predictor_->Information(candidate.T_rig_target, markers, candidate.pose.camera);
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
          predictor_->Information(T_camera_rig.Inverse() * T_camera_target, kFineMarkers);
      if (more) sum += *more / static_cast<double>(executed.size());
    }
    return sum;
  }

  // The candidate of the largest expected gain that differs from those views; null: none gains.
  Candidate* Best(const std::vector<NextView>& before, const Effort& effort) {
    const bool sigma = state_->Criterion() == ViewCriterion::kSigma;
    const Eigen::VectorXd losses =
        fine_.Columns().transpose() *
        PackedTwice(sigma ? state_->Covariance() * projection_->All() * state_->Covariance()
                          : state_->Covariance());
    std::vector<std::pair<double, Candidate*>> open;
    for (Candidate& each : candidates_) {
      if (!each.fine || !DiffersFrom(before, each.pose)) continue;
      open.emplace_back(losses[static_cast<Eigen::Index>(*each.fine)], &each);
    }
    const auto keep_best = [&](size_t count) {
      std::ranges::stable_sort(open,
                               [](const auto& a, const auto& b) { return a.first > b.first; });
      open.resize(std::min(open.size(), count));
    };
    // The loss per view is the gain by a small part of it.
    if (sigma) keep_best(effort.preferred);
    ParallelFor(open.size(), options_.threads, [&](size_t i) {
      open[i].first = state_->Gain(Unpacked(fine_.Column(*open[i].second->fine)));
    });
    keep_best(effort.executed);
    ParallelFor(open.size(), options_.threads, [&](size_t i) {
      Candidate& each = *open[i].second;
      if (each.expected.size() == 0) each.expected = Expected(each);
      open[i].first = state_->Gain(each.expected);
    });
    keep_best(1);
    return open.empty() || !(open[0].first > 0) ? nullptr : open[0].second;
  }

  [[nodiscard]] bool DiffersFrom(const std::vector<NextView>& before,
                                 const TargetPose& pose) const {
    const ImageSize size = rig_.bundle.cameras[pose.camera].image_size;
    return std::ranges::all_of(
        before, [&](const NextView& view) { return LookDifferent(view.pose, pose, size); });
  }

  // The candidate at the place, distance and tilt nearby with the largest expected gain.
  [[nodiscard]] Candidate Improved(Candidate best, const std::vector<NextView>& before) const {
    constexpr size_t kMoves = 8;  // neighbours of the same direction and turn
    constexpr int kMostSteps = 6;
    double most = state_->Gain(best.expected), step = 1;
    for (int i = 0; i < kMostSteps; ++i) {
      std::array<std::optional<Candidate>, kMoves> moved;
      std::array<double, kMoves> gains{};
      ParallelFor(kMoves, options_.threads, [&](size_t k) {
        const TargetPose pose = Neighbour(best.pose, k, step);
        if (!DiffersFrom(before, pose)) return;
        moved[k] = MakeCandidate(pose);
        if (!moved[k] || !InformationOf(*moved[k], kCoarseMarkers)) return;
        moved[k]->expected = Expected(*moved[k]);
        gains[k] = state_->Gain(moved[k]->expected);
      });
      const auto k = static_cast<size_t>(std::ranges::max_element(gains) - gains.begin());
      if (gains[k] > most) {
        most = gains[k];
        best = *moved[k];
      } else {
        step /= 2;
      }
    }
    return best;
  }

  NextView Take(const Candidate& candidate) {
    const size_t camera = candidate.pose.camera;
    NextView view{.pose = candidate.pose,
                  .T_rig_target = candidate.T_rig_target,
                  .criterion = state_->Criterion()};
    const Eigen::MatrixXd before = state_->Covariance();
    view.sigma_before = state_->Sigma();
    state_->Add(candidate.expected);
    view.sigma_after = state_->Sigma();
    double most = -kInfinity;
    for (size_t r = 0; r < kRegions; ++r) {
      const double was = projection_->InRegion(camera, r, before);
      const double is = projection_->InRegion(camera, r, state_->Covariance());
      if (!(was - is > most)) continue;
      most = was - is;
      view.region = r;
      view.region_before = was;
      view.region_after = is;
    }
    for (size_t c = 0; c < rig_.bundle.cameras.size(); ++c) {
      if (!predictor_->PredictVisibility(c, view.T_rig_target, kFineMarkers).found) continue;
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

  static constexpr int kSearches = 8;

  ViewTarget shape_;
  NextViewOptions options_;
  // Of the estimate that the candidates were made for.
  std::vector<CandidateBasis> cameras_;
  std::vector<double> distances_;
  RigUnknowns unknowns_;
  std::vector<Candidate> candidates_;
  FineViews fine_;
  int searches_ = kSearches;  // left: they take longer than all else
  // Of the last estimate.
  RigEstimate rig_;
  std::optional<ViewPredictor> predictor_;
  std::optional<ProjectionSigma> projection_;
  std::optional<InformationState> state_;
};

NextViewChooser::NextViewChooser(ViewTarget shape, const NextViewOptions& options)
    : impl_(std::make_unique<Impl>(std::move(shape), options)) {}
NextViewChooser::NextViewChooser(NextViewChooser&&) noexcept = default;
NextViewChooser::~NextViewChooser() = default;

NextViews NextViewChooser::Choose(RigEstimate rig) { return impl_->Run(std::move(rig)); }

NextViews ChooseNextViews(const RigEstimate& rig,
                          const ViewTarget& shape,
                          const NextViewOptions& options) {
  return NextViewChooser(shape, options).Choose(rig);
}

}  // namespace plenocal
