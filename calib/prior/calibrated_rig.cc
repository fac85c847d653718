// SPDX-License-Identifier: Apache-2.0
#include "calib/prior/calibrated_rig.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"

namespace plenocal {
namespace {

// Rounded correlations may leave negative eigenvalues of this size, with unit diagonal.
constexpr double kRounding = 1e-9;

// W with W' W = covariance^-1.
Eigen::MatrixXd InverseRoot(const Eigen::MatrixXd& covariance) {
  const Eigen::VectorXd scale = covariance.diagonal().cwiseSqrt().cwiseInverse();
  const SymmetricEigen spectrum =
      DecomposeSymmetric(Eigen::MatrixXd(scale.asDiagonal() * covariance * scale.asDiagonal()));
  return spectrum.values.cwiseMax(kRounding).cwiseSqrt().cwiseInverse().asDiagonal() *
         spectrum.vectors.transpose() * scale.asDiagonal();
}

bool StatesExtrinsics(const CalibratedCamera& camera) {
  return camera.sigma_xi.allFinite() && (camera.sigma_xi.array() > 0).all();
}

bool StatesParam(const CalibratedCamera& camera, size_t param) {
  return camera.Sigma(param) > 0 && std::isfinite(camera.Sigma(param));
}

// The rows of the prior's unknowns among all numbers of the cameras: per camera its parameters,
// then the chart of its extrinsics.
class PriorMaker {
 public:
  PriorMaker(const std::vector<const CalibratedCamera*>& cameras, bool with_nuisances)
      : cameras_(cameras) {
    for (const CalibratedCamera* camera : cameras) {
      first_.push_back(count_);
      count_ += std::ssize(camera->params) + 6;
    }
    const Eigen::Index first_nuisance = count_;
    for (const CalibratedCamera* camera : cameras) count_ += std::ssize(camera->nuisances);
    chart_ = Eigen::MatrixXd::Identity(count_, count_);
    for (size_t c = 0; c < cameras.size(); ++c) AddCamera(c);
    if (with_nuisances) AddNuisances(first_nuisance);
  }

  std::optional<CalibrationPrior> Make(const Correlations& correlations) {
    if (rows_.empty()) return std::nullopt;
    Eigen::MatrixXd all = JointCovariance(cameras_, correlations);
    for (Eigen::Index i = 0; i < count_; ++i) {
      if (!std::isfinite(all(i, i))) all(i, i) = 0;
    }
    const Eigen::MatrixXd covariance = chart_ * all * chart_.transpose();
    prior_.weight = InverseRoot(covariance(rows_, rows_));
    return std::move(prior_);
  }

 private:
  [[nodiscard]] Eigen::Index Extrinsics(size_t c) const {
    return first_[c] + std::ssize(cameras_[c]->params);
  }

  void AddCamera(size_t c) {
    const CalibratedCamera& camera = *cameras_[c];
    const CalibratedCamera& master = *cameras_[0];
    for (size_t k = 0; k < camera.params.size(); ++k) {
      if (!StatesParam(camera, k)) continue;
      prior_.unknowns.push_back({.camera = c, .param = k, .value = camera.params[k]});
      rows_.push_back(first_[c] + static_cast<Eigen::Index>(k));
    }
    prior_.T_camera_rig.push_back(camera.T_camera_rig * master.T_camera_rig.Inverse());
    if (c == 0 || !(StatesExtrinsics(camera) || StatesExtrinsics(master))) return;
    const RelativeChart chart = ChartOfRelative(camera.T_camera_rig, master.T_camera_rig);
    const Eigen::Index own = Extrinsics(c), of_master = Extrinsics(0);
    chart_.block<6, 6>(own, own) = chart.by_camera * Inverse(LogJacobian(camera.T_camera_rig));
    chart_.block<6, 6>(own, of_master) =
        chart.by_master * Inverse(LogJacobian(master.T_camera_rig));
    for (Eigen::Index i = 0; i < 6; ++i) {
      prior_.unknowns.push_back({.camera = c, .component = i});
      rows_.push_back(own + i);
    }
  }

  void AddNuisances(Eigen::Index row) {
    for (size_t c = 0; c < cameras_.size(); ++c) {
      const CalibratedCamera& camera = *cameras_[c];
      for (size_t k = 0; k < camera.nuisances.size(); ++k) {
        prior_.unknowns.push_back(
            {.camera = c, .param = camera.params.size() + k, .value = camera.nuisances[k].value});
        rows_.push_back(row++);
      }
    }
  }

  const std::vector<const CalibratedCamera*>& cameras_;
  std::vector<Eigen::Index> first_;
  Eigen::Index count_ = 0;
  Eigen::MatrixXd chart_;
  CalibrationPrior prior_;
  std::vector<Eigen::Index> rows_;
};

// Factor of a camera's standard errors for errors that the points of its frames share; 1 without.
double FactorOfSystematicErrors(const CalibrationRecord& record, const std::string& camera) {
  std::vector<Finding> findings = record.findings;
  if (record.verdict) {
    findings.insert(
        findings.end(), record.verdict->findings.begin(), record.verdict->findings.end());
  }
  double factor = 1;
  for (const Finding& finding : findings) {
    if (finding.code != "points_share_errors" || !finding.value) continue;
    if (std::ranges::find(finding.cameras, camera) == finding.cameras.end()) continue;
    if (!std::isfinite(*finding.value)) {
      throw InputError(
          "{}: the finding {} of {} has no finite value, the factor of the "
          "standard errors",
          record.path.string(),
          finding.code,
          camera);
    }
    factor = std::max(factor, *finding.value);
  }
  return factor;
}

BundleCamera MakeCamera(const CalibratedCamera& camera, const CalibratedCamera& master) {
  BundleCamera made{.name = camera.name,
                    .image_size = camera.image_size,
                    .image_circle = camera.image_circle,
                    .model = camera.model,
                    .config = camera.config,
                    .params = camera.params,
                    .fixed = {},
                    .T_camera_rig = camera.T_camera_rig * master.T_camera_rig.Inverse()};
  for (size_t k = 0; k < camera.params.size(); ++k) made.fixed.push_back(!StatesParam(camera, k));
  made.is_master = &camera == &master || !(StatesExtrinsics(camera) || StatesExtrinsics(master));
  return made;
}

}  // namespace

RelativeChart ChartOfRelative(const RigidTransform& T_camera_rig,
                              const RigidTransform& T_master_rig) {
  const Eigen::Matrix3d R = T_camera_rig.R * T_master_rig.R.transpose();
  RelativeChart chart;
  chart.by_camera.topRightCorner<3, 3>() = Hat(R * T_master_rig.t);
  chart.by_master.topLeftCorner<3, 3>() = -R;
  chart.by_master.topRightCorner<3, 3>() = -R * Hat(T_master_rig.t);
  chart.by_master.bottomRightCorner<3, 3>() = -R;
  return chart;
}

CalibratedRig MakeCalibratedRig(const CalibrationRecord& calibration,
                                std::span<const std::string> names,
                                bool with_nuisances) {
  std::vector<const CalibratedCamera*> chosen;
  for (const std::string& name : names) chosen.push_back(&FindCamera(calibration, name));
  if (names.empty()) {
    for (const CalibratedCamera& camera : calibration.cameras) chosen.push_back(&camera);
  }
  CalibratedRig rig;
  for (const CalibratedCamera* camera : chosen) {
    rig.cameras.push_back(MakeCamera(*camera, *chosen[0]));
    for (size_t k = 0; with_nuisances && k < camera->nuisances.size(); ++k) {
      rig.cameras.back().params.push_back(camera->nuisances[k].value);
      rig.cameras.back().fixed.push_back(false);
      rig.cameras.back().nuisances.push_back(&nuisances::kSharedError);
    }
  }
  rig.prior = PriorMaker(chosen, with_nuisances).Make(calibration.correlations);
  return rig;
}

void ScaleAlike(const CalibrationRecord& record,
                const std::vector<std::string>& names,
                CalibrationPrior* prior) {
  std::vector<double> factors;
  for (const std::string& name : names) {
    factors.push_back(FactorOfSystematicErrors(record, name));
  }
  const double largest = *std::ranges::max_element(factors);
  for (size_t i = 0; i < prior->unknowns.size(); ++i) {
    prior->weight.col(static_cast<Eigen::Index>(i)) *= factors[prior->unknowns[i].camera] / largest;
  }
}

}  // namespace plenocal
