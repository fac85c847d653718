// SPDX-License-Identifier: Apache-2.0
#include "assess/views/view_information.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "assess/views/place_in_image.h"
#include "calib/adjust/rows.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/parallel.h"
#include "calib/base/statistics.h"
#include "calib/camera/rays.h"
#include "calib/kernels/row_products.h"

namespace plenocal {
namespace {

constexpr double kBorder = 3;     // px from the image's border that a marker must keep
constexpr double kResolved = 3;   // px a detail of the target
constexpr double kFacing = 0.26;  // cosine between line of visibility and normal: 75 degrees
constexpr double kFoundPart = 0.5;
constexpr size_t kFewestMarkers = 6;                   // for a pose with redundancy
constexpr size_t kFewestLenses = 2, kMostLenses = 12;  // two give the depth

}  // namespace

struct ViewPredictor::Sums {
  explicit Sums(Eigen::Index unknowns)
      : tt(Eigen::MatrixXd::Zero(unknowns, unknowns)),
        tx(Eigen::MatrixXd::Zero(unknowns, 6)),
        xx(Matrix6d::Zero()),
        tr(Eigen::VectorXd::Zero(unknowns)),
        xr(Vector6d::Zero()) {}
  Eigen::MatrixXd tt, tx;  // t: unknowns, x: pose, r: residual
  Matrix6d xx;
  Eigen::VectorXd tr;
  Vector6d xr;
};

ViewPredictor::ViewPredictor(const RigEstimate& rig,
                             const RigUnknowns& unknowns,
                             const ViewTarget& shape)
    : rig_(rig), unknowns_(unknowns), shape_(shape) {
  std::vector<MarkerShape> rest;
  const double prior = rig.bundle.marker_freedom.Sigma();
  for (const auto& [number, position] : shape.markers) {
    const auto sigma = rig.marker_sigmas.find(number);
    const auto normal = shape.normals.find(number);
    rest.push_back({number,
                    position,
                    normal == shape.normals.end() ? Eigen::Vector3d::Zero() : normal->second,
                    sigma == rig.marker_sigmas.end() ? Eigen::Vector3d::Constant(prior).eval()
                                                     : sigma->second});
  }
  // The first few of the list are spread over the target as well as all of them are.
  std::vector<double> distance(rest.size(), std::numeric_limits<double>::infinity());
  while (!rest.empty()) {
    const auto next = static_cast<size_t>(std::ranges::max_element(distance) - distance.begin());
    markers_.push_back(rest[next]);
    rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(next));
    distance.erase(distance.begin() + static_cast<std::ptrdiff_t>(next));
    for (size_t i = 0; i < rest.size(); ++i) {
      distance[i] = std::min(distance[i], (rest[i].position - markers_.back().position).norm());
    }
  }
  for (size_t m = 0; m < markers_.size(); ++m) by_number_[markers_[m].number] = m;
  for (const MicroLensArray& array : rig.lenses) {
    lenses_.push_back(array.lenses.empty() ? MicroLensVisibility() : MicroLensVisibility(array));
  }
}

std::optional<Eigen::Vector2d> ViewPredictor::Image(size_t c,
                                                    const RigidTransform& T_camera_target,
                                                    const MarkerShape& marker) const {
  const BundleCamera& camera = rig_.bundle.cameras[c];
  const Eigen::Vector3d p = T_camera_target * marker.position;
  const Eigen::Vector3d normal = T_camera_target.R * marker.normal;
  if (marker.normal != Eigen::Vector3d::Zero() && !(-normal.dot(p.normalized()) > kFacing)) {
    return std::nullopt;
  }
  if (camera.model->plenoptic) {
    if (!lenses_[c].HasLenses()) return std::nullopt;
    const MicroLensVisibility::Seen seen = lenses_[c].LensesShowing(camera, p, kFewestLenses);
    if (seen.all < kFewestLenses) return std::nullopt;
    return seen.image;
  }
  const std::optional<Eigen::Vector2d> u = PlaceInImage(camera, p, kBorder);
  if (!u) return std::nullopt;
  if (shape_.finest <= 0) return u;
  const Eigen::Vector3d facing =
      marker.normal == Eigen::Vector3d::Zero() ? Eigen::Vector3d(-p.normalized()) : normal;
  const Eigen::Vector3d across = facing.unitOrthogonal();
  for (const Eigen::Vector3d& side : {across, Eigen::Vector3d(facing.cross(across))}) {
    Eigen::Vector2d moved;
    const std::array<double, kMaxObservationSize> values{};
    if (!Project(camera, values.data(), p + shape_.finest * side, moved.data()))
      return std::nullopt;
    if (!((moved - *u).norm() >= kResolved)) return std::nullopt;
  }
  return u;
}

TargetVisibility ViewPredictor::PredictVisibility(size_t camera,
                                                  const RigidTransform& T_rig_target,
                                                  size_t most) const {
  TargetVisibility visibility;
  const RigidTransform T_camera_target = rig_.bundle.cameras[camera].T_camera_rig * T_rig_target;
  const size_t chosen = std::min(most, markers_.size());
  for (size_t m = 0; m < chosen; ++m) {
    const auto u_px = Image(camera, T_camera_target, markers_[m]);
    if (!u_px) continue;
    visibility.markers.push_back(m);
    visibility.u_px.push_back(*u_px);
  }
  const size_t count = visibility.markers.size();
  const double part = static_cast<double>(count) / static_cast<double>(chosen);
  visibility.found =
      count >= std::min(kFewestMarkers, chosen) && part >= (shape_.found_in_part ? kFoundPart : 1);
  return visibility;
}

std::pair<std::vector<BundleObservation>, double> ViewPredictor::Predicted(
    size_t c, const RigidTransform& T_rig_target, const MarkerShape& marker) const {
  const BundleCamera& camera = rig_.bundle.cameras[c];
  BundleObservation observation{
      .camera = static_cast<int>(c), .seen = {}, .assumed_sigma = rig_.sigma_px[c]};
  if (!camera.model->plenoptic) return {{observation}, 1};
  const MicroLensVisibility::Seen seen = lenses_[c].LensesShowing(
      camera, camera.T_camera_rig * (T_rig_target * marker.position), kMostLenses);
  std::vector<BundleObservation> observations;
  for (const Eigen::Vector2d& lens : seen.centres) {
    observation.seen.values = {lens.x(), lens.y(), lens.x(), lens.y()};
    observations.push_back(observation);
  }
  const double repeats = static_cast<double>(seen.all) / static_cast<double>(observations.size());
  return {std::move(observations), repeats};
}

// The rows of one camera in one frame. Columns of its products: the camera's unknowns, the
// target's, the pose, the residual.
class ViewPredictor::CameraRows {
 public:
  CameraRows(const ViewPredictor& predictor, size_t camera, const RigidTransform& T_rig_target)
      : unknowns_(predictor.unknowns_),
        index_(camera),
        camera_(predictor.rig_.bundle.cameras[camera]),
        view_{.T_camera_rig = camera_.T_camera_rig, .T_rig_target = T_rig_target},
        rows_(static_cast<Eigen::Index>(camera_.model->measured.size())),
        params_(static_cast<Eigen::Index>(camera_.params.size())),
        deformations_(unknowns_.unit.size() - unknowns_.head),
        own_(params_ + 6 + deformations_),
        N_(Eigen::MatrixXd::Zero(own_ + 7, own_ + 7)),
        J_params_(rows_, params_),
        J_(rows_, own_ + 7),
        B_(rows_, 3 + rows_),
        JB_(own_ + 7, 3 + rows_),
        plus_(ZeroRows(own_ + 7, kCapacity)),
        minus_(ZeroRows(own_ + 7, kCapacity)) {}

  /// One marker that stands for `markers`: observations of it, each repeated `repeats` times.
  /// Adds nothing where a row is not finite.
  void Add(const MarkerShape& marker,
           std::span<const BundleObservation* const> observations,
           double repeats,
           double markers) {
    if (observations.size() == 1 && repeats == 1) {
      AddOne(marker, *observations[0], markers);
      return;
    }
    Shared BB = Shared::Identity(B_.cols(), B_.cols());
    JB_.setZero();
    Eigen::MatrixXd more(J_.cols(), rows_ * static_cast<Eigen::Index>(observations.size()));
    Eigen::Index count = 0;
    for (const BundleObservation* observation : observations) {
      if (!Linearise(marker, *observation)) continue;
      more.middleCols(count, rows_) = std::sqrt(markers * repeats) * J_.transpose();
      JB_.noalias() += repeats * J_.transpose() * B_;
      BB.noalias() += repeats * B_.transpose() * B_;
      count += rows_;
    }
    if (!more.leftCols(count).allFinite()) return;
    // What all rows of the marker share, in sigmas, is taken out: its own position and the common
    // noise.
    const Eigen::LLT<Shared> shared(BB);
    for (Eigen::Index k = 0; k < count; ++k) Put(more.col(k), &plus_, &plus_count_);
    const Eigen::MatrixXd common = shared.matrixL().solve(std::sqrt(markers) * JB_.transpose());
    for (Eigen::Index k = 0; k < common.rows(); ++k) Put(common.row(k), &minus_, &minus_count_);
  }

  void AddTo(Sums* sums) {
    Flush();
    N_.triangularView<Eigen::StrictlyUpper>() = N_.transpose();
    for (Eigen::Index i = 0; i < own_; ++i) {
      const int a = Unknown(i);
      if (a < 0) continue;
      const double unit = unknowns_.unit[a];
      sums->tx.row(a) += unit * N_.row(i).segment<6>(own_);
      sums->tr[a] += unit * N_(i, own_ + 6);
      for (Eigen::Index j = 0; j < own_; ++j) {
        const int b = Unknown(j);
        if (b >= 0) sums->tt(a, b) += unit * unknowns_.unit[b] * N_(i, j);
      }
    }
    sums->xx += N_.block<6, 6>(own_, own_);
    sums->xr += N_.col(own_ + 6).segment<6>(own_);
  }

 private:
  static constexpr Eigen::Index kCapacity = 128;
  static constexpr int kMostShared = 3 + kMaxObservationSize;
  using Shared = Eigen::
      Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMostShared, kMostShared>;

  // J' (1 + B B')^-1 J, which is what remains without the shared part.
  void AddOne(const MarkerShape& marker, const BundleObservation& observation, double markers) {
    if (!Linearise(marker, observation) || !J_.allFinite()) return;
    Shared variance = Shared::Identity(rows_, rows_);
    variance.noalias() += B_ * B_.transpose();
    const Eigen::LLT<Shared> factor(variance);
    factor.matrixL().solveInPlace(J_);
    for (Eigen::Index k = 0; k < rows_; ++k) {
      Put(std::sqrt(markers) * J_.row(k), &plus_, &plus_count_);
    }
  }

  [[nodiscard]] int Unknown(Eigen::Index column) const {
    if (column < params_) return unknowns_.params[index_][static_cast<size_t>(column)];
    if (column >= params_ + 6) return static_cast<int>(unknowns_.head + column - params_ - 6);
    const int first = unknowns_.extrinsics[index_];
    return first < 0 ? -1 : first + static_cast<int>(column - params_);
  }

  // Into `J_` and `B_`; false outside the model's domain.
  bool Linearise(const MarkerShape& marker, const BundleObservation& observation) {
    Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::RowMajor, kMaxObservationSize, 6> extrinsics(
        rows_, 6),
        pose(rows_, 6);
    Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor, kMaxObservationSize, 3> position(
        rows_, 3);
    double residual[kMaxObservationSize];
    if (!internal::Linearise(camera_,
                             view_,
                             marker.position,
                             observation,
                             {.residual = residual,
                              .J_params = J_params_.data(),
                              .J_extrinsics = extrinsics.data(),
                              .J_pose = pose.data(),
                              .J_marker = position.data()})) {
      return false;
    }
    J_.leftCols(params_) = J_params_;
    J_.middleCols<6>(params_) = extrinsics;
    const auto deformation = unknowns_.deformations.find(marker.number);
    if (deformation == unknowns_.deformations.end()) {
      J_.middleCols(params_ + 6, deformations_).setZero();
    } else {
      J_.middleCols(params_ + 6, deformations_).noalias() = position * deformation->second;
    }
    J_.middleCols<6>(own_) = pose;
    J_.rightCols<1>() = Eigen::Map<const Eigen::VectorXd>(residual, rows_);
    B_.leftCols<3>() = position * marker.sigma.asDiagonal();
    B_.rightCols(rows_) = camera_.noise.common_sigma /
                          camera_.noise.OwnSigma(observation.assumed_sigma) *
                          Eigen::MatrixXd::Identity(rows_, rows_);
    return true;
  }

  void Put(const auto& row, RowMajorMatrix* rows, Eigen::Index* count) {
    for (Eigen::Index i = 0; i < row.size(); ++i) (*rows)(i, *count) = row(i);
    if (++*count == kCapacity) Flush();
  }

  void Flush() {
    const Eigen::Index plus = RoundUpToFour(plus_count_), minus = RoundUpToFour(minus_count_);
    AddRowProducts(1, plus_, plus, &N_);
    AddRowProducts(-1, minus_, minus, &N_);
    plus_.leftCols(plus).setZero();
    minus_.leftCols(minus).setZero();
    plus_count_ = minus_count_ = 0;
  }

  const RigUnknowns& unknowns_;
  size_t index_;
  const BundleCamera& camera_;
  internal::LinearisedView view_;
  Eigen::Index rows_, params_, deformations_, own_;
  Eigen::MatrixXd N_;
  RowMajorMatrix J_params_;
  Eigen::MatrixXd J_, B_, JB_;
  RowMajorMatrix plus_, minus_;
  Eigen::Index plus_count_ = 0, minus_count_ = 0;
};

std::optional<ViewPredictor::FrameInformation> ViewPredictor::WithoutPose(const Sums& sums) const {
  const auto passed = SolvePositive(sums.xx, Eigen::MatrixXd(sums.tx.transpose()));
  if (!passed) return std::nullopt;
  FrameInformation frame;
  frame.information = sums.tt - sums.tx * *passed;
  frame.information = ((frame.information + frame.information.transpose()) / 2).eval();
  frame.gradient = sums.tr - passed->transpose() * sums.xr;
  frame.pose_covariance = Inverse(sums.xx);
  frame.pose_by_unknowns = -*passed;
  if (!frame.information.allFinite()) return std::nullopt;
  return frame;
}

std::optional<Eigen::MatrixXd> ViewPredictor::Information(const RigidTransform& T_rig_target,
                                                          size_t most,
                                                          std::optional<size_t> must) const {
  std::vector<TargetVisibility> visibilities(rig_.bundle.cameras.size());
  if (must) {
    visibilities[*must] = PredictVisibility(*must, T_rig_target, most);
    if (!visibilities[*must].found) return std::nullopt;
  }
  Sums sums(unknowns_.unit.size());
  const double weight =
      static_cast<double>(markers_.size()) / static_cast<double>(std::min(most, markers_.size()));
  bool found = false;
  for (size_t c = 0; c < rig_.bundle.cameras.size(); ++c) {
    if (c != must) visibilities[c] = PredictVisibility(c, T_rig_target, most);
    if (!visibilities[c].found) continue;
    found = true;
    CameraRows rows(*this, c, T_rig_target);
    for (const size_t m : visibilities[c].markers) {
      const auto [observations, repeats] = Predicted(c, T_rig_target, markers_[m]);
      std::vector<const BundleObservation*> all;
      for (const BundleObservation& each : observations) all.push_back(&each);
      rows.Add(markers_[m], all, repeats, weight);
    }
    rows.AddTo(&sums);
  }
  if (!found) return std::nullopt;
  std::optional<FrameInformation> frame = WithoutPose(sums);
  if (!frame) return std::nullopt;
  return std::move(frame->information);
}

std::optional<ViewPredictor::FrameInformation> ViewPredictor::MakeFrameInformation(
    std::span<const BundleObservation> of_frame) const {
  const int frame = of_frame.front().frame;
  const RigidTransform& T_rig_target = rig_.bundle.T_rig_target[static_cast<size_t>(frame)];
  Sums sums(unknowns_.unit.size());
  std::vector<const BundleObservation*> used;
  for (size_t begin = 0; begin < of_frame.size();) {
    const int camera = of_frame[begin].camera;
    CameraRows rows(*this, static_cast<size_t>(camera), T_rig_target);
    while (begin < of_frame.size() && of_frame[begin].camera == camera) {
      const int index = of_frame[begin].marker;
      used.clear();
      for (; begin < of_frame.size() && of_frame[begin].camera == camera &&
             of_frame[begin].marker == index;
           ++begin) {
        if (of_frame[begin].used) used.push_back(&of_frame[begin]);
      }
      const auto marker = by_number_.find(rig_.bundle.markers[static_cast<size_t>(index)].number);
      if (marker == by_number_.end() || used.empty()) continue;
      rows.Add(markers_[marker->second], used, 1, 1);
    }
    rows.AddTo(&sums);
  }
  std::optional<FrameInformation> result = WithoutPose(sums);
  if (result) result->frame = frame;
  return result;
}

void ViewPredictor::ForFrames(const std::function<void(const FrameInformation&)>& take) const {
  constexpr size_t kAtOnce = 64;  // frames: their results wait in memory
  const std::span<const BundleObservation> all = rig_.bundle.observations;
  std::vector<std::span<const BundleObservation>> frames;
  const auto work = [&] {
    std::vector<std::optional<FrameInformation>> results(frames.size());
    ParallelFor(frames.size(), 0, [&](size_t i) { results[i] = MakeFrameInformation(frames[i]); });
    for (const std::optional<FrameInformation>& result : results) {
      if (result) take(*result);
    }
    frames.clear();
  };
  for (size_t begin = 0, end = 0; begin < all.size(); begin = end) {
    while (end < all.size() && all[end].frame == all[begin].frame) ++end;
    frames.push_back(all.subspan(begin, end - begin));
    if (frames.size() == kAtOnce) work();
  }
  work();
}

Eigen::MatrixXd ViewPredictor::InformationSoFar() const {
  const Eigen::Index size = unknowns_.unit.size();
  Eigen::MatrixXd information = Eigen::MatrixXd::Identity(size, size);
  ForFrames([&](const FrameInformation& frame) { information += frame.information; });
  return information;
}

namespace {

// With the typical distance of the points from the first camera.
RigUnknowns MakeRigUnknowns(const Bundle& bundle) {
  const std::vector<double> distances = PointDistances(bundle, 0);
  return MakeRigUnknowns(bundle, distances.empty() ? 1 : distances[distances.size() / 2]);
}

ViewTarget MarkersOf(const CalibrationRecord& calibration) {
  ViewTarget target;
  for (const auto& [number, marker] : calibration.markers) target.markers[number] = marker.position;
  return target;
}

RigEstimate WithFactors(const CalibrationRecord& calibration, const ViewTarget& target) {
  RigEstimate rig = MakeRigEstimate(calibration);
  SetFactors(calibration, target, &rig);
  return rig;
}

}  // namespace

CalibratedViews::CalibratedViews(const CalibrationRecord& calibration)
    : target_(MarkersOf(calibration)),
      rig_(WithFactors(calibration, target_)),
      unknowns_(MakeRigUnknowns(rig_.bundle)),
      predictor_(rig_, unknowns_, target_) {}

void SetFactors(const CalibrationRecord& calibration, const ViewTarget& target, RigEstimate* rig) {
  constexpr double kDecidedByImages = 0.01;  // square of a tenth of the unit
  const RigUnknowns unknowns = MakeRigUnknowns(rig->bundle);
  const Eigen::MatrixXd covariance =
      Inverse(ViewPredictor(*rig, unknowns, target).InformationSoFar());
  for (size_t c = 0; c < rig->factors.size(); ++c) {
    std::vector<double> ratios;
    for (size_t k = 0; k < unknowns.params[c].size(); ++k) {
      const int i = unknowns.params[c][k];
      // What the prior decides here has no information on the factor.
      if (i < 0 || covariance(i, i) > kDecidedByImages) continue;
      const double sigma = unknowns.unit[i] * std::sqrt(covariance(i, i));
      const double ratio = calibration.cameras[c].Sigma(k) / sigma;
      if (std::isfinite(ratio)) ratios.push_back(ratio * ratio);
    }
    rig->factors[c] = std::max(1.0, Median(ratios, 1.0));
  }
}

}  // namespace plenocal
