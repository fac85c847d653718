// SPDX-License-Identifier: Apache-2.0
#include "calib/prior/earlier_cameras.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/prior/calibrated_rig.h"

namespace plenocal {
namespace {

bool Contains(const std::vector<size_t>& params, size_t k) {
  return std::ranges::find(params, k) != params.end();
}

bool HasPrior(const EarlierParams& keys, size_t k) {
  return !Contains(keys.free, k) && (!keys.prior || Contains(*keys.prior, k));
}

bool HasStandardErrors(const CalibratedCamera& camera) {
  return (camera.covariance.diagonal().array() > 0).any();
}

// The camera of that name, or the only one where the user has chosen it; null: there is none.
const CalibratedCamera* FindEarlier(const EarlierSource& source, const std::string& name) {
  const std::vector<CalibratedCamera>& cameras = source.record->cameras;
  const auto found = std::ranges::find(cameras, name, &CalibratedCamera::name);
  if (found != cameras.end()) return &*found;
  if (source.is_named && cameras.size() == 1) return cameras.data();
  if (source.is_named) (void)FindCamera(*source.record, name);  // throws with the known names
  return nullptr;
}

void CheckAlike(const CameraInput& input,
                const CalibratedCamera& earlier,
                const CalibrationRecord& record) {
  const auto fail = [&](const std::string& what) {
    throw InputError("{}: {}", record.path.string(), what);
  };
  if (earlier.model != input.model) {
    fail(fmt::format("{} has model {}, the session has {}; use one model",
                     earlier.name,
                     earlier.model->name,
                     input.model->name));
  }
  if (input.image_size != ImageSize{} && earlier.image_size != ImageSize{} &&
      input.image_size != earlier.image_size) {
    fail(
        fmt::format("{} was calibrated with images of {} x {} pixels, these are {} x {}; its "
                    "parameters are of no use for them",
                    earlier.name,
                    earlier.image_size[0],
                    earlier.image_size[1],
                    input.image_size[0],
                    input.image_size[1]));
  }
  for (size_t i = 0; i < input.config.size() && i < earlier.config.size(); ++i) {
    if (input.config[i] == earlier.config[i]) continue;
    fail(fmt::format("{} has {} {:g}, the session has {:g}; use one value",
                     earlier.name,
                     input.model->config[i].name,
                     earlier.config[i],
                     input.config[i]));
  }
}

// One camera of the session in an earlier calibration.
struct CommonCamera {
  size_t index = 0;  ///< in the session
  const CalibratedCamera* earlier = nullptr;
};

std::vector<CommonCamera> CommonCameras(const std::vector<CameraInput>& inputs,
                                        const EarlierSource& source) {
  std::vector<CommonCamera> common;
  for (const size_t c : source.cameras) {
    const CalibratedCamera* const earlier = FindEarlier(source, inputs[c].name);
    if (earlier == nullptr) continue;
    CheckAlike(inputs[c], *earlier, *source.record);
    common.push_back({c, earlier});
  }
  if (common.empty()) {
    throw InputError("{}: has none of the session's cameras; their names must be the same",
                     source.record->path.string());
  }
  const bool lacks_first = source.cameras[0] == 0 && common[0].index != 0;
  if (!source.is_named && common.size() > 1 && lacks_first) {
    throw InputError(
        "{}: has not the session's first camera, {}, but others; name one of "
        "them first",
        source.record->path.string(),
        inputs[0].name);
  }
  return common;
}

// W of a part of the unknowns: W'W of it is the inverse of that part of the covariance.
Eigen::MatrixXd MarginalWeight(const Eigen::MatrixXd& weight,
                               const std::vector<Eigen::Index>& rows) {
  const Eigen::MatrixXd root = weight.inverse();  // covariance = root root'
  const Eigen::MatrixXd part = root(rows, Eigen::all);
  const Eigen::LLT<Eigen::MatrixXd> factor(part * part.transpose());
  return factor.matrixL().solve(Eigen::MatrixXd::Identity(part.rows(), part.rows()));
}

// Joins two independent priors.
void AppendPrior(const CalibrationPrior& more, CalibrationPrior* prior) {
  const Eigen::Index old = prior->weight.rows(), added = more.weight.rows();
  Eigen::MatrixXd weight = Eigen::MatrixXd::Zero(old + added, old + added);
  weight.topLeftCorner(old, old) = prior->weight;
  weight.bottomRightCorner(added, added) = more.weight;
  prior->weight = std::move(weight);
  prior->unknowns.insert(prior->unknowns.end(), more.unknowns.begin(), more.unknowns.end());
}

class EarlierCameraMaker {
 public:
  EarlierCameraMaker(std::vector<CameraInput> inputs,
                     const std::vector<EarlierParams>& keys,
                     const EarlierOptions& options)
      : keys_(keys), options_(options) {
    cameras_.T_camera_rig.resize(inputs.size());
    cameras_.T_camera_rig[0] = RigidTransform{};
    cameras_.fixed_extrinsics.resize(inputs.size(), false);
    cameras_.without_sigmas.resize(inputs.size(), false);
    cameras_.inputs = std::move(inputs);
  }

  void Add(const EarlierSource& source) {
    common_ = CommonCameras(cameras_.inputs, source);
    std::vector<std::string> names;
    for (const CommonCamera& camera : common_) names.push_back(camera.earlier->name);
    rig_ = MakeCalibratedRig(*source.record, names);
    if (rig_.prior) ScaleAlike(*source.record, names, &*rig_.prior);
    has_extrinsics_ = common_.size() > 1 && common_[0].index == 0;
    for (size_t i = 0; i < common_.size(); ++i) Take(i);
    if (options_.intrinsics == EarlierIntrinsics::kFixed || !rig_.prior) return;
    if (const auto chosen = ChosenPrior(*rig_.prior)) Append(*chosen);
  }

  EarlierCameras Finish() {
    for (const CameraInput& input : cameras_.inputs) {
      for (size_t k = 0; k < input.initial.size(); ++k) {
        if (!input.fixed[k] || input.initial[k]) continue;
        throw InputError(
            "{}: '{}' is to be fixed, but neither 'initial' nor the earlier "
            "calibration gives a value for it",
            input.name,
            input.model->params[k].name);
      }
    }
    return std::move(cameras_);
  }

 private:
  void Take(size_t i) {
    const auto& [c, earlier] = common_[i];
    const BundleCamera& known = rig_.cameras[i];
    CameraInput& input = cameras_.inputs[c];
    const EarlierParams& keys = keys_[c];
    cameras_.without_sigmas[c] = !HasStandardErrors(*earlier);
    for (size_t k = 0; k < known.ModelParams(); ++k) {
      // A parameter without prior is looked for anew where its start value is not given.
      if (!input.initial[k] && !Contains(keys.free, k)) input.initial[k] = known.params[k];
      if (!Contains(keys.free, k) && StaysFixed(known, *earlier, k)) input.fixed[k] = true;
    }
    if (!has_extrinsics_) return;
    cameras_.T_camera_rig[c] = known.T_camera_rig;
    cameras_.fixed_extrinsics[c] = known.is_master;
  }

  [[nodiscard]] bool StaysFixed(const BundleCamera& known,
                                const CalibratedCamera& earlier,
                                size_t k) const {
    if (options_.intrinsics == EarlierIntrinsics::kFixed) return true;
    if (options_.open == OpenParams::kFree && std::isinf(earlier.Sigma(k))) return false;
    return known.fixed[k];
  }

  // The marginal prior of the chosen unknowns, by the session's cameras.
  [[nodiscard]] std::optional<CalibrationPrior> ChosenPrior(const CalibrationPrior& all) const {
    CalibrationPrior chosen;
    std::vector<Eigen::Index> rows;
    for (size_t i = 0; i < all.unknowns.size(); ++i) {
      CalibrationPrior::Unknown unknown = all.unknowns[i];
      unknown.camera = common_[unknown.camera].index;
      if (!IsChosen(unknown)) continue;
      chosen.unknowns.push_back(unknown);
      rows.push_back(static_cast<Eigen::Index>(i));
    }
    if (rows.empty()) return std::nullopt;
    chosen.T_camera_rig.resize(cameras_.inputs.size());
    for (size_t i = 0; i < common_.size(); ++i) {
      chosen.T_camera_rig[common_[i].index] = all.T_camera_rig[i];
    }
    chosen.weight = MarginalWeight(all.weight, rows);
    return chosen;
  }

  [[nodiscard]] bool IsChosen(const CalibrationPrior::Unknown& unknown) const {
    const EarlierParams& keys = keys_[unknown.camera];
    if (!unknown.param) return has_extrinsics_ && !keys.free_extrinsics;
    return HasPrior(keys, *unknown.param) && !cameras_.inputs[unknown.camera].fixed[*unknown.param];
  }

  void Append(const CalibrationPrior& chosen) {
    if (!cameras_.prior) {
      cameras_.prior = chosen;
      return;
    }
    AppendPrior(chosen, &*cameras_.prior);
    for (const CommonCamera& camera : common_) {
      cameras_.prior->T_camera_rig[camera.index] = chosen.T_camera_rig[camera.index];
    }
  }

  const std::vector<EarlierParams>& keys_;
  const EarlierOptions& options_;
  EarlierCameras cameras_;
  // State of the present source:
  std::vector<CommonCamera> common_;
  CalibratedRig rig_;
  bool has_extrinsics_ = false;
};

}  // namespace

EarlierCameras UseEarlierCalibrations(std::vector<CameraInput> inputs,
                                      const std::vector<EarlierParams>& keys,
                                      const std::vector<EarlierSource>& sources,
                                      const EarlierOptions& options) {
  EarlierCameraMaker maker(std::move(inputs), keys, options);
  for (const EarlierSource& source : sources) maker.Add(source);
  return maker.Finish();
}

}  // namespace plenocal
