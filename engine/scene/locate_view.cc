// SPDX-License-Identifier: Apache-2.0
#include "engine/scene/locate_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>

#include "calib/adjust/poses.h"
#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"
#include "calib/estimate/reject.h"
#include "calib/files/calibration_tables.h"
#include "calib/start/camera_guess.h"
#include "detectors/images/image.h"
#include "engine/scene/scene_start.h"
#include "engine/scene/track/feature_tracker.h"

namespace plenocal {
namespace {

// Root descriptors have length 1 and no number above about 1/2.
constexpr double kDescriptorScale = 512;
constexpr int kFeatures = 3000;

BundleCamera CameraOf(const CalibratedCamera& camera) {
  BundleCamera made{.name = camera.name,
                    .image_size = camera.image_size,
                    .model = camera.model,
                    .config = camera.config,
                    .params = camera.params,
                    .fixed = std::vector<bool>(camera.params.size(), true),
                    .T_camera_rig = {}};
  made.noise.common_sigma = camera.fit.common_noise;
  return made;
}

// One frame of one camera, before known points.
Bundle BundleOf(const CalibratedCamera& camera,
                const View& view,
                const std::map<int, Eigen::Vector3d>& points) {
  Bundle bundle;
  bundle.cameras = {CameraOf(camera)};
  bundle.T_rig_target.resize(1);
  std::map<int, int> index;
  for (const Observation& seen : view.observations) {
    const auto point = points.find(seen.marker);
    if (point == points.end()) continue;
    const auto [entry, is_new] =
        index.emplace(seen.marker, static_cast<int>(bundle.markers.size()));
    if (is_new) bundle.markers.push_back({seen.marker, point->second, point->second});
    bundle.observations.push_back(
        {.marker = entry->second,
         .seen = seen,
         .assumed_sigma = seen.detector_sigma > 0 ? seen.detector_sigma : 1});
  }
  std::ranges::stable_sort(bundle.observations, {}, &BundleObservation::marker);
  return bundle;
}

size_t UsedMarkers(const Bundle& bundle) {
  std::set<int> used;
  for (const BundleObservation& observation : bundle.observations) {
    if (observation.used) used.insert(observation.marker);
  }
  return used.size();
}

// The pose that most points agree with, and its alternative.
std::optional<RigidTransform> PoseAmongWrong(Bundle* bundle,
                                             std::optional<AlternativePose>* alternative) {
  constexpr double kLimit = 3;  // px: a feature's error and that of its point
  SceneState state = MakeSceneState(bundle);
  state.has_point.assign(bundle->markers.size(), true);
  const std::optional<PoseSearch> found = FindPose(state, 0, kLimit);
  if (!found) return std::nullopt;
  bundle->T_rig_target[0] = found->T_rig_target;
  *alternative = FindAlternativePose(state, {0}, kLimit);
  std::erase_if(bundle->observations, [&](const BundleObservation& observation) {
    return ResidualLength(*bundle, observation) > kLimit;
  });
  return found->T_rig_target;
}

// Noise by the used residuals: first robustly, then by their sum.
void SetNoise(bool robust, Bundle* bundle) {
  NoiseModel& noise = bundle->cameras[0].noise;
  const double before = noise.detector_scale;
  std::vector<double> lengths;
  double square = 0, count = 0;
  const auto rows = static_cast<double>(bundle->cameras[0].model->measured.size());
  for (const BundleObservation& observation : bundle->observations) {
    double residual[kMaxObservationSize];
    if (!observation.used || !Residual(*bundle, observation, residual)) continue;
    lengths.push_back(WeightedLength(*bundle, observation, residual));
    square += lengths.back() * lengths.back();
    count += rows;
  }
  constexpr double kPoseUnknowns = 6, kLeast = 1e-6;
  const double sigma = robust ? Median(std::move(lengths)) / std::sqrt(ChiSquareQuantile(rows, 0.5))
                              : std::sqrt(square / std::max(1.0, count - kPoseUnknowns));
  noise.detector_scale = std::max(kLeast, before * sigma);
}

// The pose with the parameters shifted along one of them.
RigidTransform PoseWith(const Bundle& bundle, size_t param, double shift) {
  Bundle shifted = bundle;
  shifted.cameras[0].params[param] += shift;
  AdjustPose(0, shifted.observations.size(), &shifted);
  return shifted.T_rig_target[0];
}

// Change of the pose's chart by each parameter.
Eigen::MatrixXd PoseByParams(const CalibratedCamera& camera, const Bundle& bundle) {
  const RigidTransform& T = bundle.T_rig_target[0];
  Eigen::MatrixXd gain = Eigen::MatrixXd::Zero(6, static_cast<Eigen::Index>(camera.params.size()));
  for (size_t k = 0; k < camera.params.size(); ++k) {
    const double sigma = camera.Sigma(k);
    if (!(sigma > 0) || !std::isfinite(sigma)) continue;
    const RigidTransform above = PoseWith(bundle, k, sigma), below = PoseWith(bundle, k, -sigma);
    auto column = gain.col(static_cast<Eigen::Index>(k));
    column.head<3>() = (above.t - below.t) / (2 * sigma);
    column.tail<3>() =
        (LogRotation(above.R * T.R.transpose()) - LogRotation(below.R * T.R.transpose())) /
        (2 * sigma);
  }
  return gain;
}

Matrix6d CovarianceOfPose(const CalibratedCamera& camera, const Bundle& bundle) {
  const Matrix6d information = PoseInformation(bundle, 0, bundle.observations.size());
  Eigen::MatrixXd of_params = camera.covariance;
  for (Eigen::Index i = 0; i < of_params.rows(); ++i) {
    if (!std::isfinite(of_params(i, i))) of_params(i, i) = 0;
  }
  const Eigen::MatrixXd gain = PoseByParams(camera, bundle);
  const Matrix6d chart = Inverse(information) + gain * of_params * gain.transpose();
  const Matrix6d J = InverseLogJacobian(bundle.T_rig_target[0]);
  return J * chart * J.transpose();
}

}  // namespace

std::optional<LocatedView> LocateView(const CalibratedCamera& camera,
                                      const View& view,
                                      const std::map<int, Eigen::Vector3d>& points,
                                      Numbering numbering) {
  Bundle bundle = BundleOf(camera, view, points);
  LocatedView located;
  located.points = bundle.markers.size();
  if (located.points < kMinMarkersInFrame) return std::nullopt;
  const std::optional<RigidTransform> start = numbering == Numbering::kByMarker
                                                  ? GuessPose(bundle.cameras[0], view, points)
                                                  : PoseAmongWrong(&bundle, &located.alternative);
  if (!start) return std::nullopt;
  bundle.T_rig_target[0] = *start;
  UseProjecting({true}, &bundle);
  constexpr int kRounds = 5;
  for (int round = 0; round < kRounds; ++round) {
    SetNoise(round == 0, &bundle);
    AdjustPose(0, bundle.observations.size(), &bundle);
    if (round + 1 < kRounds) RejectOutliers(&bundle);
  }
  located.used = UsedMarkers(bundle);
  if (located.used < kMinMarkersInFrame) return std::nullopt;
  double square = 0, count = 0;
  for (const BundleObservation& observation : bundle.observations) {
    double residual[kMaxObservationSize];
    if (!observation.used || !Residual(bundle, observation, residual)) continue;
    for (size_t r = 0; r < camera.model->measured.size(); ++r) square += residual[r] * residual[r];
    count += 1;
  }
  located.rms = std::sqrt(square / std::max(1.0, count));
  located.covariance = CovarianceOfPose(camera, bundle);
  if (!located.covariance.allFinite()) return std::nullopt;
  located.T_map_camera = bundle.T_rig_target[0].Inverse();
  return located;
}

std::string PointsCsv(const LandmarkMap& map) {
  std::string text = "marker,x,y,z\n";
  for (const int number : map.numbers) {
    const Eigen::Vector3d& p = map.points.at(number);
    fmt::format_to(
        std::back_inserter(text), "{},{:.9g},{:.9g},{:.9g}\n", number, p.x(), p.y(), p.z());
  }
  return text;
}

std::string DescriptorsPng(const LandmarkMap& map) {
  cv::Mat bytes;
  map.descriptors.convertTo(bytes, CV_8U, kDescriptorScale);
  return EncodeImage(".png", bytes);
}

LandmarkMap ReadLandmarkMap(const std::filesystem::path& path) {
  LandmarkMap map;
  for (const auto& [number, position] : ReadScenePoints(path)) {
    map.points.emplace(number, position);
    map.numbers.push_back(number);
  }
  const std::filesystem::path beside = path.parent_path() / "descriptors.png";
  if (!std::filesystem::exists(beside)) return map;
  const cv::Mat bytes = ReadGray(beside);
  if (bytes.rows != static_cast<int>(map.numbers.size())) {
    throw InputError("{}: has {} rows for the {} points of {}; both come from one run",
                     beside.string(),
                     bytes.rows,
                     map.numbers.size(),
                     path.string());
  }
  bytes.convertTo(map.descriptors, CV_32F, 1 / kDescriptorScale);
  return map;
}

View MatchLandmarks(const cv::Mat& image, const LandmarkMap& map) {
  const ImageFeatures features = FindFeatures(image, kFeatures, {}, 0);
  View view;
  for (const auto& [i, j] : MatchDescriptors(features.descriptors, map.descriptors)) {
    Observation seen{.marker = map.numbers[static_cast<size_t>(j)]};
    seen.values[0] = features.points[static_cast<size_t>(i)].x;
    seen.values[1] = features.points[static_cast<size_t>(i)].y;
    view.observations.push_back(seen);
  }
  return view;
}

View MatchLandmarks(const cv::Mat& raw,
                    const CalibratedCamera& camera,
                    const PlenopticCamera& optics,
                    const LandmarkMap& map,
                    int threads) {
  const BundleCamera tracked = CameraOf(camera);
  PlenopticTracker tracker(tracked, optics, {.wanted = kFeatures}, 0, threads);
  tracker.AddFrame("", raw);
  std::map<int, int> number_of;  // in the map, by track
  for (const auto& [i, j] : MatchDescriptors(tracker.Descriptors(), map.descriptors)) {
    number_of[i] = map.numbers[static_cast<size_t>(j)];
  }
  View view;
  for (const View& measured : tracker.Views()) {
    for (Observation seen : measured.observations) {
      const auto number = number_of.find(seen.marker);
      if (number == number_of.end()) continue;
      seen.marker = number->second;
      view.observations.push_back(seen);
    }
  }
  return view;
}

}  // namespace plenocal
