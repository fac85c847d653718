// SPDX-License-Identifier: Apache-2.0
#include "apps/scene/scene_rig.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <utility>

#include "calib/base/error.h"
#include "calib/scene/calibrated_rig.h"

namespace plenocal {
namespace {

bool Has(const std::vector<size_t>& params, size_t k) {
  return std::ranges::find(params, k) != params.end();
}

bool HasPrior(const EarlierParams& keys, size_t k) {
  return !Has(keys.free, k) && (!keys.prior || Has(*keys.prior, k));
}

// Indices of the cameras that the earlier calibration has too.
std::vector<size_t> CommonCameras(const std::vector<CameraInput>& inputs,
                                  const CalibrationRecord& earlier) {
  std::vector<size_t> common;
  for (size_t c = 0; c < inputs.size(); ++c) {
    const auto same = [&](const CalibratedCamera& camera) { return camera.name == inputs[c].name; };
    const auto found = std::ranges::find_if(earlier.cameras, same);
    if (found == earlier.cameras.end()) continue;
    if (found->model != inputs[c].model) {
      throw Error(ErrorKind::kInput,
                  fmt::format("{}: {} has model {}, the session says {}; use one model",
                              earlier.path.string(),
                              inputs[c].name,
                              found->model->name,
                              inputs[c].model->name));
    }
    common.push_back(c);
  }
  if (common.empty()) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: has none of the session's cameras; their names must be the same",
                            earlier.path.string()));
  }
  if (common.size() > 1 && common[0] != 0) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: has not the session's first camera, {}, but others; name one of "
                            "them first",
                            earlier.path.string(),
                            inputs[0].name));
  }
  return common;
}

class SceneCameraMaker {
 public:
  SceneCameraMaker(std::vector<CameraInput> inputs,
                   const std::vector<EarlierParams>& keys,
                   const CalibrationRecord& earlier)
      : keys_(keys), common_(CommonCameras(inputs, earlier)) {
    cameras_.inputs = std::move(inputs);
    cameras_.T_camera_rig.resize(cameras_.inputs.size());
    cameras_.holds_extrinsics.resize(cameras_.inputs.size(), false);
    std::vector<std::string> names;
    for (const size_t c : common_) names.push_back(cameras_.inputs[c].name);
    rig_ = MakeCalibratedRig(earlier, names);
  }

  SceneCameras Make() {
    for (size_t i = 0; i < common_.size(); ++i) Take(i);
    if (rig_.prior) cameras_.prior = ChosenPrior(*rig_.prior);
    cameras_.T_camera_rig[0] = RigidTransform{};
    return std::move(cameras_);
  }

 private:
  void Take(size_t i) {
    const BundleCamera& known = rig_.cameras[i];
    CameraInput& input = cameras_.inputs[common_[i]];
    const EarlierParams& keys = keys_[common_[i]];
    for (size_t k = 0; k < known.params.size(); ++k) {
      // A parameter without prior is looked for anew where its start value is not given.
      if (!input.initial[k] && !Has(keys.free, k)) input.initial[k] = known.params[k];
      if (known.fixed[k] && !Has(keys.free, k)) input.fixed[k] = true;
    }
    if (common_.size() < 2) return;
    cameras_.T_camera_rig[common_[i]] = known.T_camera_rig;
    cameras_.holds_extrinsics[common_[i]] = known.is_master;
  }

  // The marginal prior of the chosen unknowns, by the session's cameras.
  [[nodiscard]] std::optional<CalibrationPrior> ChosenPrior(const CalibrationPrior& all) const {
    CalibrationPrior chosen;
    std::vector<Eigen::Index> rows;
    for (size_t i = 0; i < all.unknowns.size(); ++i) {
      CalibrationPrior::Unknown unknown = all.unknowns[i];
      unknown.camera = common_[unknown.camera];
      if (unknown.param && (!HasPrior(keys_[unknown.camera], *unknown.param) ||
                            cameras_.inputs[unknown.camera].fixed[*unknown.param])) {
        continue;
      }
      chosen.unknowns.push_back(unknown);
      rows.push_back(static_cast<Eigen::Index>(i));
    }
    if (rows.empty()) return std::nullopt;
    chosen.T_camera_rig.resize(cameras_.inputs.size());
    for (size_t i = 0; i < common_.size(); ++i) {
      chosen.T_camera_rig[common_[i]] = all.T_camera_rig[i];
    }
    chosen.weight = MarginalWeight(all.weight, rows);
    return chosen;
  }

  // W of a part of the unknowns: W'W of it is the inverse of that part of the covariance.
  static Eigen::MatrixXd MarginalWeight(const Eigen::MatrixXd& weight,
                                        const std::vector<Eigen::Index>& rows) {
    const Eigen::MatrixXd root = weight.inverse();  // covariance = root root'
    const Eigen::MatrixXd part = root(rows, Eigen::all);
    const Eigen::LLT<Eigen::MatrixXd> factor(part * part.transpose());
    return factor.matrixL().solve(Eigen::MatrixXd::Identity(part.rows(), part.rows()));
  }

  const std::vector<EarlierParams>& keys_;
  SceneCameras cameras_;
  std::vector<size_t> common_;
  CalibratedRig rig_;
};

}  // namespace

SceneCameras MakeSceneCameras(std::vector<CameraInput> inputs,
                              const std::vector<EarlierParams>& keys,
                              const CalibrationRecord* earlier) {
  if (earlier != nullptr) return SceneCameraMaker(std::move(inputs), keys, *earlier).Make();
  SceneCameras cameras;
  cameras.T_camera_rig.resize(inputs.size());
  cameras.T_camera_rig[0] = RigidTransform{};
  cameras.holds_extrinsics.resize(inputs.size(), false);
  cameras.inputs = std::move(inputs);
  return cameras;
}

}  // namespace plenocal
