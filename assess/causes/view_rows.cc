// SPDX-License-Identifier: Apache-2.0
#include "assess/causes/view_rows.h"

#include <algorithm>
#include <map>
#include <span>

#include "assess/residual_field.h"
#include "calib/adjust/rows.h"
#include "calib/base/linear_algebra.h"

namespace plenocal {
namespace {

// Tests need no more observations than these of a camera to find what is as large as its noise.
constexpr size_t kMostObservations = 30'000;
constexpr Eigen::Index kLeastObservations = 6;  // of a view: a pose and as many degrees again

size_t CountUsed(const Bundle& bundle, size_t camera) {
  return static_cast<size_t>(
      std::ranges::count_if(bundle.observations, [&](const BundleObservation& observation) {
        return observation.used && observation.camera == static_cast<int>(camera);
      }));
}

// Of every `step`th used observation of a view.
ViewRows MakeView(const Bundle& bundle,
                  std::span<const BundleObservation> observations,
                  size_t step) {
  const BundleObservation& first = observations.front();
  const BundleCamera& camera = bundle.cameras[static_cast<size_t>(first.camera)];
  const internal::LinearisedView linearised =
      internal::ViewOf(bundle, static_cast<size_t>(first.frame), static_cast<size_t>(first.camera));
  const auto most = static_cast<Eigen::Index>(observations.size());
  ViewRows view{.frame = first.frame,
                .residual = Eigen::VectorXd(2 * most),
                .pose = Eigen::MatrixXd(2 * most, 6),
                .position = Eigen::MatrixXd(most, 2),
                .noise = Eigen::VectorXd(most),
                .markers = {},
                .marker = {}};
  internal::MarkerRows rows(camera, {.pose = true});
  rows.Prepare(linearised, observations, bundle.markers);
  Eigen::Index count = 0;
  size_t used = 0;
  for (const BundleObservation& observation : observations) {
    if (!observation.used || used++ % step != 0) continue;
    Eigen::Matrix<double, 2, 6, Eigen::RowMajor> J;
    Eigen::Vector2d r;
    if (!rows.Linearise(linearised,
                        bundle.markers[static_cast<size_t>(observation.marker)].position,
                        observation,
                        {.residual = r.data(), .J_pose = J.data()})) {
      continue;
    }
    view.residual.segment<2>(2 * count) = r;
    view.pose.middleRows<2>(2 * count) = J;
    view.noise[count] = camera.noise.OwnSigma(observation.assumed_sigma);
    view.position.row(count) << observation.seen.values[0], observation.seen.values[1];
    view.position.row(count) -= view.noise[count] * r.transpose();
    view.markers.push_back(observation.marker);
    ++count;
  }
  view.residual.conservativeResize(2 * count);
  view.pose.conservativeResize(2 * count, 6);
  view.position.conservativeResize(count, 2);
  view.noise.conservativeResize(count);
  // The pose moves the target's points in the rig's frame.
  view.marker = view.pose.leftCols<3>() * linearised.T_rig_target.R;
  return view;
}

}  // namespace

std::vector<ViewRows> RowsOfViews(const Bundle& bundle, size_t camera) {
  std::vector<ViewRows> views;
  if (bundle.cameras[camera].model->measured.size() != 2) return views;
  const size_t step = 1 + CountUsed(bundle, camera) / kMostObservations;
  const auto& observations = bundle.observations;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    end = EndOfView(observations, begin);
    if (observations[begin].camera != static_cast<int>(camera)) continue;
    ViewRows view = MakeView(bundle, std::span(observations).subspan(begin, end - begin), step);
    if (view.noise.size() >= kLeastObservations) views.push_back(std::move(view));
  }
  return views;
}

std::vector<ViewRows> WithoutCommonPart(std::vector<ViewRows> views, ImageSize image_size) {
  constexpr int kCells = 12;           // along the image's longer side
  constexpr double kWeakPrior = 1e-6;  // of the information on a marker
  const ImageGrid grid(image_size, kCells);
  std::map<int, std::pair<Eigen::Matrix3d, Eigen::Vector3d>> markers;  // normal equations
  std::vector<Eigen::Vector2d> field(grid.Cells(), Eigen::Vector2d::Zero());
  std::vector<double> counts(grid.Cells(), 0.0);
  const auto for_each = [&](const auto& visit) {
    for (ViewRows& view : views) {
      for (Eigen::Index i = 0; i < view.noise.size(); ++i) visit(view, i);
    }
  };
  for_each([&](const ViewRows& view, Eigen::Index i) {
    const Eigen::Matrix<double, 2, 3> J = view.marker.middleRows<2>(2 * i);
    auto& [H, g] = markers
                       .try_emplace(view.markers[static_cast<size_t>(i)],
                                    Eigen::Matrix3d::Zero(),
                                    Eigen::Vector3d::Zero())
                       .first->second;
    H += J.transpose() * J;
    g += J.transpose() * view.residual.segment<2>(2 * i);
  });
  std::map<int, Eigen::Vector3d> displacements;
  for (auto& [index, equations] : markers) {
    Eigen::Matrix3d& H = equations.first;
    H.diagonal().array() += kWeakPrior * H.trace();
    displacements[index] = SolveSymmetric(H, equations.second);
  }
  for_each([&](ViewRows& view, Eigen::Index i) {
    view.residual.segment<2>(2 * i) -=
        view.marker.middleRows<2>(2 * i) * displacements.at(view.markers[static_cast<size_t>(i)]);
    const size_t cell = grid.Cell(view.position(i, 0), view.position(i, 1));
    field[cell] += view.residual.segment<2>(2 * i);
    counts[cell] += 1;
  });
  for_each([&](ViewRows& view, Eigen::Index i) {
    const size_t cell = grid.Cell(view.position(i, 0), view.position(i, 1));
    view.residual.segment<2>(2 * i) -= field[cell] / counts[cell];
  });
  return views;
}

Regression Regress(const ViewRows& view, const Eigen::MatrixXd& regressors) {
  const Eigen::Index count = regressors.cols();
  Eigen::MatrixXd right(view.pose.rows(), count + 1);
  right << regressors, view.residual;
  // What the pose can replace is taken out first.
  const Eigen::MatrixXd left = right - view.pose * LeastSquares(view.pose, right);
  const auto X = left.leftCols(count);
  const Eigen::VectorXd r = left.col(count);
  Regression result;
  result.information = X.transpose() * X;
  const SymmetricEigen axes = DecomposeSymmetric(result.information);
  const Eigen::VectorXd g = axes.vectors.transpose() * (X.transpose() * r);
  constexpr double kReplaced = 1e-9;  // part of a regressor that is left beside the pose
  const double scale = regressors.squaredNorm();
  Eigen::VectorXd y = Eigen::VectorXd::Zero(count);
  Eigen::Index rank = 0;
  for (Eigen::Index i = 0; i < count; ++i) {
    if (axes.values[i] <= kReplaced * scale) continue;
    y[i] = g[i] / axes.values[i];
    result.gain += g[i] * y[i];
    ++rank;
  }
  result.estimate = axes.vectors * y;
  result.rest = std::max(0.0, r.squaredNorm() - result.gain);
  result.degrees = static_cast<double>(view.pose.rows() - 6 - rank);
  return result;
}

}  // namespace plenocal
