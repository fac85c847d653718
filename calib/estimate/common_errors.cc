// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/common_errors.h"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "calib/adjust/rows.h"
#include "calib/base/linear_algebra.h"

namespace plenocal {
namespace {

using Eigen::MatrixXd;

// Derivatives of the prediction by the camera's parameters; empty outside the model's domain.
MatrixXd DerivativesOf(const Bundle& bundle, const BundleObservation& observation) {
  const auto frame = static_cast<size_t>(observation.frame);
  const auto c = static_cast<size_t>(observation.camera);
  const BundleCamera& camera = bundle.cameras[c];
  const auto rows = static_cast<Eigen::Index>(camera.model->measured.size());
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> J(rows,
                                                                           camera.params.size());
  Eigen::VectorXd residual(rows);
  if (!internal::Linearise(camera,
                           internal::ViewOf(bundle, frame, c),
                           bundle.markers[static_cast<size_t>(observation.marker)].position,
                           observation,
                           {.residual = residual.data(), .J_params = J.data()})) {
    return {};
  }
  // The rows are those of measured less predicted, in standard deviations.
  return -camera.noise.OwnSigma(observation.assumed_sigma) * J;
}

// Index of c_x, which c_y follows, of a model with micro-image centres.
std::optional<size_t> PlaceOfCentre(const CameraModel& model) {
  const auto c_x = std::ranges::find(model.params, "c_x", &Param::name);
  if (!model.plenoptic || model.params.end() - c_x < 2 || c_x[1].name != "c_y") return {};
  return static_cast<size_t>(c_x - model.params.begin());
}

// The bundle with the errors of one camera's micro-image centres. A point, its micro image and the
// principal point that move together change nothing: the derivative by the micro-image centre is 1
// less that by the principal point.
Bundle WithLatticeErrors(Bundle bundle, size_t c, size_t centre, const LatticeErrors& errors) {
  const MatrixXd root = errors.Root();
  const auto columns = [&](const Observation& seen, const MatrixXd& J) -> MatrixXd {
    const Eigen::Matrix2d by_centre =
        Eigen::Matrix2d::Identity() - J.middleCols<2>(static_cast<Eigen::Index>(centre));
    const Eigen::RowVectorXd along =
        errors.Terms({seen.values[2], seen.values[3]}).transpose() * root;
    MatrixXd by_errors(2, 2 * along.size());
    by_errors << by_centre.col(0) * along, by_centre.col(1) * along;
    return by_errors;
  };
  return WithSharedErrors(std::move(bundle), c, 2 * root.cols(), columns);
}

}  // namespace

Bundle WithSharedErrors(Bundle bundle,
                        size_t camera,
                        Eigen::Index count,
                        const ErrorColumns& columns) {
  BundleCamera& of = bundle.cameras[camera];
  const Eigen::Index rows = std::ssize(of.model->measured);
  const Eigen::Index stated = std::ranges::count(of.nuisances, &nuisances::kSharedError);
  using Table = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  for (BundleObservation& observation : bundle.observations) {
    if (observation.camera != static_cast<int>(camera) || !observation.used) continue;
    std::vector<double> all(static_cast<size_t>(rows * (stated + count)), 0.0);
    Eigen::Map<Table> table(all.data(), rows, stated + count);
    if (!observation.by_nuisance.empty()) {
      table.leftCols(stated) =
          Eigen::Map<const Table>(observation.by_nuisance.data(), rows, stated);
    }
    const MatrixXd J = DerivativesOf(bundle, observation);
    if (J.size() > 0) table.rightCols(count) = columns(observation.seen, J);
    observation.by_nuisance = std::move(all);
  }
  for (Eigen::Index k = 0; k < count; ++k) AddNuisance(nuisances::kSharedError, 1, &of);
  return bundle;
}

void AddLatticeErrors(std::span<const CameraInput> inputs,
                      const Bundle& bundle,
                      Uncertainty* uncertainty) {
  Bundle with = bundle;
  bool any = false;
  for (size_t c = 0; c < inputs.size(); ++c) {
    const std::optional<size_t> centre = PlaceOfCentre(*inputs[c].model);
    if (!inputs[c].lattice_errors.AreKnown() || !centre) continue;
    with = WithLatticeErrors(std::move(with), c, *centre, inputs[c].lattice_errors);
    any = true;
  }
  if (!any) return;
  const Uncertainty all = EstimateUncertainty(with);
  std::vector<int> own, added;  // indices of the unknowns; of the first in the order of `bundle`
  std::vector<bool> is_added(all.names.size(), false);
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    for (size_t k = bundle.cameras[c].params.size(); k < all.param_index[c].size(); ++k) {
      const int index = all.param_index[c][k];
      if (index >= 0) is_added[static_cast<size_t>(index)] = true;
    }
  }
  for (size_t i = 0; i < is_added.size(); ++i) {
    (is_added[i] ? added : own).push_back(static_cast<int>(i));
  }
  // The mean of the unknowns where the errors are given.
  const MatrixXd of_added = all.covariance(added, added), with_own = all.covariance(added, own);
  const MatrixXd G = SolveSymmetric(of_added, with_own).transpose();
  SetCovariance(uncertainty->covariance + G * G.transpose(), uncertainty);
  if (uncertainty->marker_std_errors.empty()) return;
  const MatrixXd of_markers =
      all.marker_gain(Eigen::all, added) + all.marker_gain(Eigen::all, own) * G;
  for (size_t m = 0; m < uncertainty->marker_std_errors.size(); ++m) {
    Eigen::Vector3d& sigma = uncertainty->marker_std_errors[m];
    const auto rows = of_markers.middleRows<3>(3 * static_cast<Eigen::Index>(m));
    sigma = (sigma.cwiseAbs2() + rows.rowwise().squaredNorm()).cwiseSqrt();
  }
}

}  // namespace plenocal
