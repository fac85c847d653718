// SPDX-License-Identifier: Apache-2.0
#include "calib/prior/merge.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/names.h"
#include "calib/base/statistics.h"
#include "calib/prior/calibrated_rig.h"

namespace plenocal {
namespace {

[[noreturn]] void FailAt(const CalibrationRecord& record, const std::string& what) {
  throw InputError("{}: {}", record.path.string(), what);
}

// Calibrations that contradict each other by far may have a mean that no camera has.
void RequireWithinBounds(const CalibratedCamera& merged) {
  for (size_t i = 0; i < merged.params.size(); ++i) {
    const Param& param = merged.model->params[i];
    if (merged.params[i] > param.lower && merged.params[i] < param.upper) continue;
    throw JobError(
        "camera '{}': the calibrations differ so much that together they have {} = {:.6g} {}, which "
        "is outside ({}, {}); leave the wrong one out",
        merged.name,
        param.name,
        merged.params[i],
        param.unit,
        param.lower,
        param.upper);
  }
}

// One of the calibrations; `cameras` are indices of its cameras among all.
struct MergePart {
  const CalibrationRecord* record = nullptr;
  CalibratedRig rig;
  std::vector<size_t> cameras = {};
};

// Extrinsics of a camera.
struct MergePlace {
  std::optional<RigidTransform> T_camera_rig = {};
  Eigen::Index index = -1;  // of the unknowns; -1: the rig's frame
};

// One camera in all calibrations that have it.
struct MergeCamera {
  std::string name;
  std::vector<std::pair<size_t, size_t>> seen = {};  // part, index of the camera there
  std::vector<double> params = {};
  std::vector<Eigen::Index> param_index = {};  // of the unknowns; -1: not estimated
  std::vector<bool> open = {};                 // per parameter: no calibration determines it
  bool moved = false;
  std::vector<MergePlace> places = {};  // one; of a camera that moved one for each of `seen`
};

// Throws unless another calibration of a camera can be one of the same camera and model.
void CheckAlike(const CalibratedCamera& camera,
                const CalibrationRecord& record,
                const CalibratedCamera& first,
                const CalibrationRecord& first_record) {
  const auto fail = [&](const std::string& here, const std::string& there) {
    FailAt(
        record,
        fmt::format("{} has {}, in {} {}", camera.name, here, first_record.path.string(), there));
  };
  if (camera.model != first.model) {
    fail("model " + std::string(camera.model->name), std::string(first.model->name));
  }
  if (camera.image_size != first.image_size) {
    fail(fmt::format("{} x {} pixels", camera.image_size[0], camera.image_size[1]),
         fmt::format("{} x {}", first.image_size[0], first.image_size[1]));
  }
  for (size_t i = 0; i < camera.config.size(); ++i) {
    if (camera.config[i] == first.config[i]) continue;
    fail(fmt::format("{} {:g}", camera.model->config[i].name, camera.config[i]),
         fmt::format("{:g}", first.config[i]));
  }
}

class Merger {
 public:
  Merger(std::span<const CalibrationRecord> calibrations, const MergeOptions& options) {
    for (const CalibrationRecord& record : calibrations) AddPart(record);
    for (MergeCamera& camera : cameras_) AddParams(&camera);
    for (const std::string& name : options.moved) LetMove(name);
    for (MergeCamera& camera : cameras_) {
      camera.places.resize(camera.moved ? camera.seen.size() : 1);
    }
    PlaceCameras();
  }

  MergedCalibrations Run() {
    constexpr int kMostSteps = 50;
    constexpr double kConverged = 1e-9;  // length of a step, sigmas
    for (int step = 0; step < kMostSteps; ++step) {
      if (Step() < kConverged) break;
    }
    MergedCalibrations merged;
    Compare(&merged);
    Describe(&merged);
    return merged;
  }

 private:
  const CalibratedCamera& Original(const std::pair<size_t, size_t>& seen) const {
    return parts_[seen.first].record->cameras[seen.second];
  }

  void AddPart(const CalibrationRecord& record) {
    MergePart part{.record = &record, .rig = MakeCalibratedRig(record, {})};
    if (!part.rig.prior) FailAt(record, "has no standard errors, which weight calibrations");
    std::vector<std::string> names;
    for (size_t c = 0; c < record.cameras.size(); ++c) {
      const CalibratedCamera& camera = record.cameras[c];
      if (c > 0 && part.rig.cameras[c].is_master) {
        FailAt(record, fmt::format("the extrinsics of {} have no standard errors", camera.name));
      }
      names.push_back(camera.name);
      const auto known = std::ranges::find(cameras_, camera.name, &MergeCamera::name);
      part.cameras.push_back(static_cast<size_t>(known - cameras_.begin()));
      if (known != cameras_.end()) {
        const auto& first = known->seen[0];
        CheckAlike(camera, record, Original(first), *parts_[first.first].record);
      } else {
        cameras_.push_back({.name = camera.name});
      }
    }
    ScaleAlike(record, names, &*part.rig.prior);
    for (size_t c = 0; c < part.cameras.size(); ++c) {
      cameras_[part.cameras[c]].seen.emplace_back(parts_.size(), c);
    }
    parts_.push_back(std::move(part));
  }

  // Fixed parameters move all estimated ones, so only equal values can be merged.
  void AddParams(MergeCamera* camera) {
    const CalibratedCamera& first = Original(camera->seen[0]);
    camera->params = first.params;
    for (size_t k = 0; k < first.params.size(); ++k) {
      const CalibratedCamera* known = nullptr;  // the first that does not leave it open
      for (const auto& seen : camera->seen) {
        const CalibratedCamera& other = Original(seen);
        if (std::isinf(other.Sigma(k))) continue;
        if (known == nullptr) known = &other;
        const bool fixed = other.Sigma(k) == 0, was_fixed = known->Sigma(k) == 0;
        if (fixed == was_fixed && (!fixed || other.params[k] == known->params[k])) continue;
        FailAt(*parts_[seen.first].record,
               fmt::format("{}.{} is {} {:g}, elsewhere {} {:g}; calibrate it alike",
                           other.name,
                           other.model->params[k].name,
                           fixed ? "fixed at" : "estimated as",
                           other.params[k],
                           was_fixed ? "fixed at" : "estimated as",
                           known->params[k]));
      }
      camera->open.push_back(known == nullptr);
      if (known != nullptr) camera->params[k] = known->params[k];
      const bool estimated = known != nullptr && known->Sigma(k) > 0;
      camera->param_index.push_back(estimated ? unknowns_++ : -1);
    }
  }

  void LetMove(const std::string& name) {
    const auto camera = std::ranges::find(cameras_, name, &MergeCamera::name);
    if (camera == cameras_.end()) {
      throw InputError("no camera '{}'{}", name, SuggestName(name, NamesOf(cameras_)));
    }
    if (camera == cameras_.begin()) {
      throw InputError(
          "the rig's frame is that of '{}', so that others move: name these, "
          "or give a calibration with another first camera first",
          name);
    }
    camera->moved = true;
  }

  // Index of a camera's place in a part. REQUIRES: the part has the camera.
  [[nodiscard]] size_t PlaceIndex(const MergePart& part, size_t camera) const {
    const MergeCamera& of = cameras_[camera];
    if (!of.moved) return 0;
    const auto index = static_cast<size_t>(&part - parts_.data());
    const auto seen = std::ranges::find(of.seen, index, &std::pair<size_t, size_t>::first);
    return static_cast<size_t>(seen - of.seen.begin());
  }
  [[nodiscard]] const MergePlace& PlaceIn(const MergePart& part, size_t camera) const {
    return cameras_[camera].places[PlaceIndex(part, camera)];
  }

  // Start values of the extrinsics, calibration by calibration from the first camera on.
  void PlaceCameras() {
    cameras_[0].places[0].T_camera_rig = RigidTransform{};
    for (bool placed = true; placed;) {
      placed = false;
      for (const MergePart& part : parts_) placed = PlaceBy(part) || placed;
    }
    for (const MergePart& part : parts_) {
      for (const size_t c : part.cameras) {
        // A camera that moved and stands alone in a calibration has no place there.
        if (PlaceIn(part, c).T_camera_rig || (part.cameras.size() == 1 && cameras_[c].moved)) {
          continue;
        }
        FailAt(*part.record,
               fmt::format("nothing in the calibrations places {} with respect to {}",
                           cameras_[c].name,
                           cameras_[0].name));
      }
    }
  }

  bool PlaceBy(const MergePart& part) {
    std::optional<RigidTransform> T_part_rig;
    for (size_t c = 0; c < part.cameras.size() && !T_part_rig; ++c) {
      const auto& known = PlaceIn(part, part.cameras[c]).T_camera_rig;
      if (known) T_part_rig = part.rig.cameras[c].T_camera_rig.Inverse() * *known;
    }
    if (!T_part_rig) return false;
    bool any = false;
    for (size_t c = 0; c < part.cameras.size(); ++c) {
      const size_t camera = part.cameras[c];
      MergePlace& place = cameras_[camera].places[PlaceIndex(part, camera)];
      if (place.T_camera_rig) continue;
      place.T_camera_rig = part.rig.cameras[c].T_camera_rig * *T_part_rig;
      place.index = std::exchange(unknowns_, unknowns_ + 6);
      any = true;
    }
    return any;
  }

  // Deviation of the merged calibration from a part, in the unknowns of its prior; with
  // derivatives.
  struct PartResidual {
    Eigen::VectorXd deviation;
    Eigen::MatrixXd J;
  };

  PartResidual ResidualOf(const MergePart& part) const {
    const CalibrationPrior& prior = *part.rig.prior;
    const auto count = static_cast<Eigen::Index>(prior.unknowns.size());
    PartResidual residual{Eigen::VectorXd(count), Eigen::MatrixXd::Zero(count, unknowns_)};
    const MergePlace& master = PlaceIn(part, part.cameras[0]);
    for (Eigen::Index i = 0; i < count; ++i) {
      const CalibrationPrior::Unknown& unknown = prior.unknowns[static_cast<size_t>(i)];
      const MergeCamera& camera = cameras_[part.cameras[unknown.camera]];
      if (unknown.param) {
        residual.deviation[i] = camera.params[*unknown.param] - unknown.value;
        residual.J(i, camera.param_index[*unknown.param]) = 1;
        continue;
      }
      const RigidTransform& expected = prior.T_camera_rig[unknown.camera];
      const MergePlace& place = PlaceIn(part, part.cameras[unknown.camera]);
      const RigidTransform T = *place.T_camera_rig * master.T_camera_rig->Inverse();
      residual.deviation[i] = LocalCoordinates(expected, T)[unknown.component];
      const RelativeChart by = ChartOfRelative(*place.T_camera_rig, *master.T_camera_rig);
      if (place.index >= 0) {
        residual.J.block<1, 6>(i, place.index) = by.by_camera.row(unknown.component);
      }
      if (master.index >= 0) {
        residual.J.block<1, 6>(i, master.index) = by.by_master.row(unknown.component);
      }
    }
    return residual;
  }

  // One step of Gauss and Newton; returns its length in sigmas, and keeps the covariance.
  double Step() {
    Eigen::MatrixXd information = Eigen::MatrixXd::Zero(unknowns_, unknowns_);
    Eigen::VectorXd gradient = Eigen::VectorXd::Zero(unknowns_);
    for (const MergePart& part : parts_) {
      const PartResidual residual = ResidualOf(part);
      const Eigen::MatrixXd J = part.rig.prior->weight * residual.J;
      information.noalias() += J.transpose() * J;
      gradient.noalias() += J.transpose() * (part.rig.prior->weight * residual.deviation);
    }
    // Parameters differ in size by many powers of ten.
    const Eigen::VectorXd size = information.diagonal().cwiseSqrt().cwiseInverse();
    const SymmetricEigen spectrum =
        DecomposeSymmetric(Eigen::MatrixXd(size.asDiagonal() * information * size.asDiagonal()));
    const Eigen::MatrixXd root = size.asDiagonal() * spectrum.vectors *
                                 spectrum.values.cwiseSqrt().cwiseInverse().asDiagonal();
    covariance_ = root * root.transpose();
    const Eigen::VectorXd step = -covariance_ * gradient;
    for (MergeCamera& camera : cameras_) {
      for (size_t k = 0; k < camera.params.size(); ++k) {
        if (camera.param_index[k] >= 0) camera.params[k] += step[camera.param_index[k]];
      }
      for (MergePlace& place : camera.places) {
        if (place.index < 0) continue;
        place.T_camera_rig = Retract(*place.T_camera_rig, step.segment<6>(place.index));
      }
    }
    return std::sqrt(step.dot(information * step));
  }

  void Compare(MergedCalibrations* merged) const {
    merged->degrees = -static_cast<int>(unknowns_);
    for (size_t p = 0; p < parts_.size(); ++p) {
      const MergePart& part = parts_[p];
      const CalibrationPrior& prior = *part.rig.prior;
      const PartResidual residual = ResidualOf(part);
      merged->chi_square += (prior.weight * residual.deviation).squaredNorm();
      merged->degrees += static_cast<int>(prior.unknowns.size());
      const Eigen::MatrixXd root = Inverse(prior.weight);
      const Eigen::MatrixXd taken = residual.J * covariance_ * residual.J.transpose();
      for (Eigen::Index i = 0; i < residual.deviation.size(); ++i) {
        const CalibrationPrior::Unknown& unknown = prior.unknowns[static_cast<size_t>(i)];
        // The covariance of the deviation from an estimate of which the prior is a part.
        const double own = root.row(i).squaredNorm(), variance = own - taken(i, i);
        constexpr double kLeastTested = 1e-6;  // of its own variance; below it tests rounding
        const bool tested = variance > kLeastTested * own;
        merged->deviations.push_back({.calibration = p,
                                      .camera = part.cameras[unknown.camera],
                                      .param = unknown.param,
                                      .master = part.cameras[0],
                                      .component = static_cast<int>(unknown.component),
                                      .deviation = -residual.deviation[i],
                                      .sigma = tested ? std::sqrt(variance) : 0});
      }
    }
    if (merged->degrees > 0 && ChiSquareTail(merged->degrees, merged->chi_square) < kFalseAlarm) {
      merged->scale = std::sqrt(merged->chi_square / merged->degrees);
    }
  }

  // The last place of a camera that any calibration has.
  static const MergePlace& LastPlace(const MergeCamera& camera) {
    return *std::ranges::find_if(camera.places.rbegin(), camera.places.rend(), [](const auto& p) {
      return p.T_camera_rig.has_value();
    });
  }

  void Describe(MergedCalibrations* merged) const {
    // From the charts of the extrinsics to se(3) vectors.
    Eigen::MatrixXd J = Eigen::MatrixXd::Identity(unknowns_, unknowns_);
    for (const MergeCamera& camera : cameras_) {
      for (const MergePlace& place : camera.places) {
        if (place.index >= 0) {
          J.block<6, 6>(place.index, place.index) = LogJacobian(*place.T_camera_rig);
        }
      }
    }
    const Eigen::MatrixXd covariance =
        merged->scale * merged->scale * J * covariance_ * J.transpose();
    CalibrationRecord& record = merged->record;
    std::vector<Eigen::Index> described;  // unknowns in the order of the names
    for (const MergeCamera& camera : cameras_) {
      record.cameras.push_back(DescribeCamera(camera, covariance));
      const CameraModel& model = *record.cameras.back().model;
      for (size_t k = 0; k < camera.params.size(); ++k) {
        if (camera.param_index[k] < 0) continue;
        described.push_back(camera.param_index[k]);
        record.correlations.names.push_back(
            fmt::format("{}.{}", camera.name, model.params[k].name));
      }
      const Eigen::Index first = LastPlace(camera).index;
      for (size_t i = 0; first >= 0 && i < kExtrinsicsNames.size(); ++i) {
        described.push_back(first + static_cast<Eigen::Index>(i));
        record.correlations.names.push_back(
            fmt::format("{}.T_camera_rig.{}", camera.name, kExtrinsicsNames[i]));
      }
      if (camera.moved) DescribeMounts(camera, covariance, merged);
    }
    const Eigen::MatrixXd part = covariance(described, described);
    const Eigen::VectorXd size = part.diagonal().cwiseSqrt().cwiseInverse();
    record.correlations.matrix = size.asDiagonal() * part * size.asDiagonal();
    record.adjustment = {.converged = true};
  }

  static void DescribeMounts(const MergeCamera& camera,
                             const Eigen::MatrixXd& covariance,
                             MergedCalibrations* merged) {
    for (size_t i = 0; i < camera.places.size(); ++i) {
      const MergePlace& place = camera.places[i];
      if (!place.T_camera_rig) continue;
      merged->mounts.push_back(
          {.calibration = camera.seen[i].first,
           .camera = merged->record.cameras.size() - 1,
           .T_camera_rig = *place.T_camera_rig,
           .sigma_xi = covariance.diagonal().segment<6>(place.index).cwiseSqrt()});
    }
  }

  CalibratedCamera DescribeCamera(const MergeCamera& camera,
                                  const Eigen::MatrixXd& covariance) const {
    const CalibratedCamera& original = Original(camera.seen[0]);
    CalibratedCamera merged{.name = camera.name,
                            .model = original.model,
                            .image_size = original.image_size,
                            .image_circle = original.image_circle,
                            .config = original.config,
                            .params = camera.params,
                            .covariance = {},
                            .T_camera_rig = *LastPlace(camera).T_camera_rig};
    RequireWithinBounds(merged);
    const auto count = static_cast<Eigen::Index>(camera.params.size());
    merged.covariance = Eigen::MatrixXd::Zero(count, count);
    for (Eigen::Index i = 0; i < count; ++i) {
      const Eigen::Index a = camera.param_index[static_cast<size_t>(i)];
      if (camera.open[static_cast<size_t>(i)]) {
        merged.covariance(i, i) = std::numeric_limits<double>::infinity();
      }
      for (Eigen::Index j = 0; a >= 0 && j < count; ++j) {
        const Eigen::Index b = camera.param_index[static_cast<size_t>(j)];
        if (b >= 0) merged.covariance(i, j) = covariance(a, b);
      }
    }
    if (const Eigen::Index first = LastPlace(camera).index; first >= 0) {
      merged.sigma_xi = covariance.diagonal().segment<6>(first).cwiseSqrt();
    }
    double squares = 0, noise = 0;
    for (const auto& seen : camera.seen) {
      const CameraFit& fit = Original(seen).fit;
      merged.fit.points += fit.points;
      merged.fit.rejected += fit.rejected;
      merged.fit.views += fit.views;
      squares += fit.points * fit.rms * fit.rms;
      noise += fit.points * fit.noise_sigma * fit.noise_sigma;
    }
    if (merged.fit.points > 0) {
      merged.fit.rms = std::sqrt(squares / merged.fit.points);
      merged.fit.noise_sigma = std::sqrt(noise / merged.fit.points);
    }
    return merged;
  }

  std::vector<MergePart> parts_;
  std::vector<MergeCamera> cameras_;
  Eigen::Index unknowns_ = 0;
  Eigen::MatrixXd covariance_;  // of the unknowns, extrinsics in their charts
};

}  // namespace

MergedCalibrations MergeCalibrations(std::span<const CalibrationRecord> calibrations,
                                     const MergeOptions& options) {
  return Merger(calibrations, options).Run();
}

}  // namespace plenocal
