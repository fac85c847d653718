// SPDX-License-Identifier: Apache-2.0
#include "calib/judge/views/view_information.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "calib/adjust/linearise.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

constexpr double kBorder = 3;     // px from the image's border that a marker must keep
constexpr double kResolved = 3;   // px a detail of the target
constexpr double kFacing = 0.26;  // cosine between line of sight and normal: 75 degrees
constexpr double kFoundPart = 0.5;
constexpr size_t kFewestMarkers = 6;                   // for a pose with redundancy
constexpr size_t kFewestLenses = 2, kMostLenses = 12;  // two give the depth

using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

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

ViewPredictor::ViewPredictor(const RigKnowledge& rig,
                             const RigUnknowns& unknowns,
                             const ViewTarget& shape)
    : rig_(rig), unknowns_(unknowns), shape_(shape) {
  std::vector<MarkerShape> rest;
  const double prior = rig.bundle.marker_sigma;
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
  for (const MicroLensArray& array : rig.lenses) {
    lenses_.push_back(array.lenses.empty() ? MicroLensSight() : MicroLensSight(array));
  }
}

std::vector<size_t> ViewPredictor::Chosen(size_t most) const {
  std::vector<size_t> chosen(std::min(most, markers_.size()));
  for (size_t i = 0; i < chosen.size(); ++i) chosen[i] = i;
  return chosen;
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
    const MicroLensSight::Seen seen = lenses_[c].LensesOf(camera, p, kFewestLenses);
    if (seen.all < kFewestLenses) return std::nullopt;
    return seen.image;
  }
  const std::array<double, kMaxObservationSize> values{};
  const auto project = [&](const Eigen::Vector3d& point, Eigen::Vector2d* u_px) {
    return camera.model->project(
        camera.params.data(), camera.config.data(), values.data(), point, u_px->data());
  };
  Eigen::Vector2d u;
  if (!project(p, &u)) return std::nullopt;
  const Eigen::Vector2d end(camera.image_size[0] - 1 - kBorder, camera.image_size[1] - 1 - kBorder);
  if (!(u.minCoeff() >= kBorder) || !(u.x() <= end.x()) || !(u.y() <= end.y())) return std::nullopt;
  // Models may fold places far outside the image back into it.
  const std::array<double, kMaxObservationSize> at{u.x(), u.y()};
  const auto ray = camera.model->unproject(camera.params.data(), camera.config.data(), at.data());
  constexpr double kSameRay = 0.999;
  if (!ray || !(ray->direction.dot(p.normalized()) > kSameRay)) return std::nullopt;
  if (shape_.finest <= 0) return u;
  const Eigen::Vector3d facing =
      marker.normal == Eigen::Vector3d::Zero() ? Eigen::Vector3d(-p.normalized()) : normal;
  const Eigen::Vector3d across = facing.unitOrthogonal();
  for (const Eigen::Vector3d& side : {across, Eigen::Vector3d(facing.cross(across))}) {
    Eigen::Vector2d moved;
    if (!project(p + shape_.finest * side, &moved)) return std::nullopt;
    if (!((moved - u).norm() >= kResolved)) return std::nullopt;
  }
  return u;
}

Sight ViewPredictor::SightOf(size_t camera, const RigidTransform& T_rig_target, size_t most) const {
  Sight sight;
  const RigidTransform T_camera_target = rig_.bundle.cameras[camera].T_camera_rig * T_rig_target;
  const std::vector<size_t> chosen = Chosen(most);
  for (const size_t m : chosen) {
    if (const auto u_px = Image(camera, T_camera_target, markers_[m])) sight.u_px.push_back(*u_px);
  }
  sight.markers = sight.u_px.size();
  const double part = static_cast<double>(sight.markers) / static_cast<double>(chosen.size());
  sight.found = sight.markers >= std::min(kFewestMarkers, chosen.size()) &&
                part >= (shape_.found_in_part ? kFoundPart : 1);
  return sight;
}

std::vector<BundleObservation> ViewPredictor::Predicted(size_t c,
                                                        const RigidTransform& T_rig_target,
                                                        const MarkerShape& marker,
                                                        double* repeats) const {
  const BundleCamera& camera = rig_.bundle.cameras[c];
  BundleObservation observation{
      .camera = static_cast<int>(c), .seen = {}, .assumed_sigma = rig_.sigma_px[c]};
  *repeats = 1;
  if (!camera.model->plenoptic) return {observation};
  const MicroLensSight::Seen seen = lenses_[c].LensesOf(
      camera, camera.T_camera_rig * (T_rig_target * marker.position), kMostLenses);
  std::vector<BundleObservation> observations;
  for (const Eigen::Vector2d& lens : seen.centres) {
    observation.seen.values = {lens.x(), lens.y(), lens.x(), lens.y()};
    observations.push_back(observation);
  }
  *repeats =
      static_cast<double>(seen.all) / static_cast<double>(std::max<size_t>(1, observations.size()));
  return observations;
}

bool ViewPredictor::AddMarker(const RigidTransform& T_rig_target,
                              const MarkerShape& marker,
                              const std::vector<BundleObservation>& observations,
                              double weight,
                              Sums* sums) const {
  if (observations.empty()) return true;
  const auto c = static_cast<size_t>(observations[0].camera);
  const BundleCamera& camera = rig_.bundle.cameras[c];
  const internal::LinearisedView view{.T_camera_rig = camera.T_camera_rig,
                                      .T_rig_target = T_rig_target};
  const auto rows = static_cast<Eigen::Index>(camera.model->measured.size());
  const auto params = static_cast<Eigen::Index>(camera.params.size());
  const auto deformation = unknowns_.deformations.find(marker.number);
  const Eigen::Index deformations =
      deformation == unknowns_.deformations.end() ? 0 : deformation->second.cols();
  RowMatrix J_params(rows, params), J_extrinsics(rows, 6), J_pose(rows, 6), J_marker(rows, 3);
  double residual[kMaxObservationSize];
  // Columns: the camera's unknowns, the target's, the pose, the residual; and what all rows of the
  // marker share, in sigmas: its own position and the common noise.
  const Eigen::Index own = params + 6 + deformations, all = own + 7, shared = 3 + rows;
  Eigen::MatrixXd J(rows, all), B(rows, shared);
  Eigen::MatrixXd JJ = Eigen::MatrixXd::Zero(all, all), JB = Eigen::MatrixXd::Zero(all, shared);
  Eigen::MatrixXd BB = Eigen::MatrixXd::Identity(shared, shared);
  for (const BundleObservation& observation : observations) {
    if (!internal::Linearise(camera,
                             camera.params.data(),
                             view,
                             marker.position,
                             observation,
                             {.residual = residual,
                              .J_params = J_params.data(),
                              .J_extrinsics = J_extrinsics.data(),
                              .J_pose = J_pose.data(),
                              .J_marker = J_marker.data()})) {
      continue;
    }
    J.leftCols(params) = J_params;
    J.middleCols<6>(params) = J_extrinsics;
    if (deformations > 0) {
      J.middleCols(params + 6, deformations) = J_marker * deformation->second;
    }
    J.middleCols<6>(own) = J_pose;
    J.rightCols<1>() = Eigen::Map<const Eigen::VectorXd>(residual, rows);
    B.leftCols<3>() = J_marker * marker.sigma.asDiagonal();
    B.rightCols(rows) = camera.noise.common_sigma /
                        camera.noise.OwnSigma(observation.assumed_sigma) *
                        Eigen::MatrixXd::Identity(rows, rows);
    JJ.noalias() += weight * J.transpose() * J;
    JB.noalias() += weight * J.transpose() * B;
    BB.noalias() += weight * B.transpose() * B;
  }
  if (!JJ.allFinite()) return false;
  const Eigen::MatrixXd N = JJ - JB * BB.llt().solve(JB.transpose());
  const auto unknown = [&](Eigen::Index column) {
    if (column < params) return unknowns_.params[c][static_cast<size_t>(column)];
    if (column >= params + 6) return static_cast<int>(unknowns_.head + column - params - 6);
    const int first = unknowns_.extrinsics[c];
    return first < 0 ? -1 : first + static_cast<int>(column - params);
  };
  for (Eigen::Index i = 0; i < own; ++i) {
    const int a = unknown(i);
    if (a < 0) continue;
    const double unit = unknowns_.unit[a];
    sums->tx.row(a) += unit * N.row(i).segment<6>(own);
    sums->tr[a] += unit * N(i, own + 6);
    for (Eigen::Index j = 0; j < own; ++j) {
      const int b = unknown(j);
      if (b >= 0) sums->tt(a, b) += unit * unknowns_.unit[b] * N(i, j);
    }
  }
  sums->xx += N.block<6, 6>(own, own);
  sums->xr += N.col(own + 6).segment<6>(own);
  return true;
}

std::optional<ViewPredictor::OfFrame> ViewPredictor::WithoutPose(const Sums& sums) const {
  const auto passed = SolvePositive(sums.xx, Eigen::MatrixXd(sums.tx.transpose()));
  if (!passed) return std::nullopt;
  OfFrame frame;
  frame.information = sums.tt - sums.tx * *passed;
  frame.information = ((frame.information + frame.information.transpose()) / 2).eval();
  frame.gradient = sums.tr - passed->transpose() * sums.xr;
  frame.pose_covariance = Inverse(sums.xx);
  frame.pose_by_unknowns = -*passed;
  if (!frame.information.allFinite() || !frame.gradient.allFinite()) return std::nullopt;
  return frame;
}

std::optional<Eigen::MatrixXd> ViewPredictor::Information(const RigidTransform& T_rig_target,
                                                          size_t most) const {
  Sums sums(unknowns_.unit.size());
  const std::vector<size_t> chosen = Chosen(most);
  const double weight = static_cast<double>(markers_.size()) / static_cast<double>(chosen.size());
  bool found = false;
  for (size_t c = 0; c < rig_.bundle.cameras.size(); ++c) {
    if (!SightOf(c, T_rig_target, most).found) continue;
    found = true;
    const RigidTransform T_camera_target = rig_.bundle.cameras[c].T_camera_rig * T_rig_target;
    for (const size_t m : chosen) {
      if (!Image(c, T_camera_target, markers_[m])) continue;
      double repeats = 1;
      const auto observations = Predicted(c, T_rig_target, markers_[m], &repeats);
      if (!AddMarker(T_rig_target, markers_[m], observations, weight * repeats, &sums)) {
        return std::nullopt;
      }
    }
  }
  if (!found) return std::nullopt;
  std::optional<OfFrame> frame = WithoutPose(sums);
  if (!frame) return std::nullopt;
  return std::move(frame->information);
}

void ViewPredictor::ForFrames(const std::function<void(const OfFrame&)>& take) const {
  std::map<int, const MarkerShape*> markers;
  for (const MarkerShape& marker : markers_) markers[marker.number] = &marker;
  const std::vector<BundleObservation>& all = rig_.bundle.observations;
  for (size_t begin = 0; begin < all.size();) {
    const int frame = all[begin].frame;
    const RigidTransform& T_rig_target = rig_.bundle.T_rig_target[static_cast<size_t>(frame)];
    Sums sums(unknowns_.unit.size());
    while (begin < all.size() && all[begin].frame == frame) {
      const size_t end = EndOfMarker(all, begin);
      const int number = rig_.bundle.markers[static_cast<size_t>(all[begin].marker)].number;
      std::vector<BundleObservation> used;
      for (; begin < end; ++begin) {
        if (all[begin].used) used.push_back(all[begin]);
      }
      const auto marker = markers.find(number);
      if (marker == markers.end()) continue;
      // What is not finite adds nothing.
      (void)AddMarker(T_rig_target, *marker->second, used, 1, &sums);
    }
    if (auto of_frame = WithoutPose(sums)) {
      of_frame->frame = frame;
      take(*of_frame);
    }
  }
}

Eigen::MatrixXd ViewPredictor::InformationSoFar() const {
  const Eigen::Index size = unknowns_.unit.size();
  Eigen::MatrixXd information = Eigen::MatrixXd::Identity(size, size);
  ForFrames([&](const OfFrame& frame) { information += frame.information; });
  return information;
}

namespace {

// With the typical distance of the points from the first camera.
RigUnknowns UnknownsOf(const Bundle& bundle) {
  const std::vector<double> distances = DistancesOfPoints(bundle, 0);
  return UnknownsOf(bundle, distances.empty() ? 1 : distances[distances.size() / 2]);
}

ViewTarget MarkersOf(const CalibrationRecord& calibration) {
  ViewTarget target;
  for (const auto& [number, marker] : calibration.markers) target.markers[number] = marker.position;
  return target;
}

RigKnowledge WithFactors(const CalibrationRecord& calibration, const ViewTarget& target) {
  RigKnowledge rig = KnowledgeOf(calibration);
  SetFactors(calibration, target, &rig);
  return rig;
}

}  // namespace

CalibratedViews::CalibratedViews(const CalibrationRecord& calibration)
    : target_(MarkersOf(calibration)),
      rig_(WithFactors(calibration, target_)),
      unknowns_(UnknownsOf(rig_.bundle)),
      predictor_(rig_, unknowns_, target_) {}

void SetFactors(const CalibrationRecord& calibration, const ViewTarget& target, RigKnowledge* rig) {
  constexpr double kDecidedByImages = 0.01;  // square of a tenth of the unit
  const RigUnknowns unknowns = UnknownsOf(rig->bundle);
  const Eigen::MatrixXd covariance =
      Inverse(ViewPredictor(*rig, unknowns, target).InformationSoFar());
  for (size_t c = 0; c < rig->factors.size(); ++c) {
    std::vector<double> ratios;
    for (size_t k = 0; k < unknowns.params[c].size(); ++k) {
      const int i = unknowns.params[c][k];
      // What the prior here decides says nothing of the factor.
      if (i < 0 || covariance(i, i) > kDecidedByImages) continue;
      const double sigma = unknowns.unit[i] * std::sqrt(covariance(i, i));
      const double ratio = calibration.cameras[c].Sigma(k) / sigma;
      if (std::isfinite(ratio)) ratios.push_back(ratio * ratio);
    }
    rig->factors[c] = std::max(1.0, Median(ratios, 1.0));
  }
}

}  // namespace plenocal
