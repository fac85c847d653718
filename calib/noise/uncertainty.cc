// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/uncertainty.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <utility>

#include "calib/adjust/priors.h"
#include "calib/adjust/reduced/elimination.h"
#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/names.h"
#include "calib/noise/camera_noise.h"
#include "calib/noise/landmark_system.h"
#include "calib/noise/matrix_root.h"
#include "calib/noise/open_directions.h"

namespace plenocal {
namespace {

using internal::UnknownLayout;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Eigenvalues of the reduced normal matrix with unit diagonal below this are rounding: its entries
// are differences of sums that agree to some 1e-15 times the number of unknowns.
constexpr double kRankTolerance = 1e-13;
// Shares of an unknown in directions without information below this are the eigenvectors' rounding.
constexpr double kRoundingShare = 1e-6;
constexpr double kSmallestUnit = 1e-12;

// Normal equations with poses eliminated.
struct ReducedSystem {
  // Of all unknowns of the layout without priors of parameters; its lower triangle.
  Eigen::MatrixXd S;
  // Of half the sum of squares; priors of markers are left out.
  Eigen::VectorXd gradient;
  // Per frame: covariance of its pose, all unknowns of the layout fixed.
  std::vector<Matrix6d> pose_covariances;
};

// Takes the degrees of freedom that poses and jitter use into account in `result`.
ReducedSystem Reduce(const Bundle& bundle, const UnknownLayout& layout, Uncertainty* result) {
  ReducedSystem reduced;
  reduced.pose_covariances.assign(bundle.T_rig_target.size(), Matrix6d::Zero());
  const internal::Objective objective = internal::ObjectiveOf(bundle, {});
  internal::ReducedEquations equations =
      internal::EliminateFrames(bundle, layout, objective, 0, {.keep_views = true});
  internal::States& states = equations.states;
  states.ComputeCovariances();
  for (const internal::EliminatedView& view : equations.views) {
    if (!states.IsDetermined(view.pose)) continue;
    const auto& [by_pose, by_jitter] = view.charts;
    const Matrix6d pose = states.Covariance(view.pose, view.pose);
    reduced.pose_covariances[view.frame] = pose;
    // Covariance of the pose that the camera saw.
    Matrix6d seen = by_pose * pose * by_pose.transpose();
    if (bundle.EstimatesJitter()) {
      const Matrix6d jitter = states.Covariance(view.jitter, view.jitter);
      const Matrix6d cross =
          by_jitter * states.Covariance(view.jitter, view.pose) * by_pose.transpose();
      seen += by_jitter * jitter * by_jitter.transpose() + cross + cross.transpose();
      const size_t index = bundle.View(view.frame, view.camera);
      if (!bundle.jitter.misplaced[index]) {
        const Matrix6d& W = objective.jitter_weights[index];
        const Vector6d known = Vector6d::Ones() - (W * jitter * W.transpose()).diagonal();
        result->jitter_translation_redundancy += known.head<3>().sum();
        result->jitter_rotation_redundancy += known.tail<3>().sum();
      }
    }
    result->redundancy[view.camera] -= (view.information * seen).trace();
    result->degrees_used_by_means[view.camera] += (view.information_of_means * seen).trace();
  }
  reduced.gradient = equations.S.row(layout.total).head(layout.total).transpose();
  for (int m = 0; layout.markers && m < std::ssize(bundle.markers); ++m) {
    reduced.gradient.segment<3>(layout.Marker(m)) -=
        (bundle.markers[static_cast<size_t>(m)].position - bundle.Expected(m)) /
        bundle.marker_freedom.Variance();
  }
  reduced.S = std::move(equations.S);
  AddInformation(internal::RowsOfDistances(bundle, layout), &reduced.S);
  return reduced;
}

// Unknowns before `head`, those after it eliminated from the normal matrix S.
struct TailElimination {
  Eigen::LLT<Eigen::MatrixXd> factor;  // of S_tt
  Eigen::MatrixXd gain;                // S_tt^-1 S_th; empty without a tail
  Eigen::MatrixXd information;         // of the head

  TailElimination(const Eigen::MatrixXd& S, Eigen::Index head, Eigen::Index tail)
      : information(S.topLeftCorner(head, head).selfadjointView<Eigen::Lower>()) {
    if (tail == 0) return;
    factor.compute(S.block(head, head, tail, tail).selfadjointView<Eigen::Lower>());
    if (head == 0) return;
    const auto S_th = S.block(head, 0, tail, head);
    gain = factor.solve(S_th);
    information -= S_th.transpose() * gain;
  }
};

// Information on parameters and extrinsics alone, poses at their best.
Eigen::MatrixXd HeadInformation(const PoseSystem& system) {
  const TailElimination poses(system.information, system.head, system.Size() - system.head);
  if (poses.gain.size() > 0 && poses.factor.info() != Eigen::Success) {
    throw JobError(
        "the scene points do not determine the poses of all frames; images that overlap "
        "more, or more of them, may");
  }
  return poses.information;
}

double MeanTargetDistance(const Bundle& bundle) {
  double distance = 0, used = 0;
  for (const BundleObservation& observation : bundle.observations) {
    if (!observation.used) continue;
    distance += bundle.T_rig_target[static_cast<size_t>(observation.frame)].t.norm();
    used += 1;
  }
  return distance / std::max(1.0, used);
}

// Names and natural units of the unknowns before the markers.
struct Naming {
  std::vector<std::string> names;
  Eigen::VectorXd unit;
  // Those that change with the scale of all lengths: translations in the rig, and the lengths
  // inside of plenoptic cameras. Those inside of others have no unit of length.
  std::vector<bool> scaled;

  void Add(std::string name, double of_unit, bool is_scaled) {
    unit[std::ssize(names)] = of_unit;
    names.push_back(std::move(name));
    scaled.push_back(is_scaled);
  }
};

Naming NameUnknowns(const Bundle& bundle, const UnknownLayout& layout) {
  const double target_distance = std::max(MeanTargetDistance(bundle), kSmallestUnit);
  Naming naming{{}, Eigen::VectorXd(layout.head), {}};
  const auto add_pose = [&](const std::string& of) {
    for (size_t i = 0; i < 6; ++i) {
      naming.Add(of + kExtrinsicsNames[i], i < 3 ? target_distance : 1, i < 3);
    }
  };
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const BundleCamera& camera = bundle.cameras[c];
    for (size_t k = 0; k < camera.params.size(); ++k) {
      if (layout.params[c][k] < 0 || bundle.Root(c, k) != ParamIndex{c, k}) continue;
      if (k >= camera.ModelParams()) {
        const double unit = camera.nuisances[k - camera.ModelParams()]->unit;
        naming.Add(NuisanceName(camera, k), unit * camera.rules[k].prior->sigma, false);
        continue;
      }
      const Param& param = camera.model->params[k];
      naming.Add(camera.name + "." + std::string(param.name),
                 std::max({std::abs(camera.params[k]), param.scale, kSmallestUnit}),
                 param.unit == "m");
    }
    if (layout.extrinsics[c] >= 0) add_pose(camera.name + ".T_camera_rig.");
  }
  for (size_t k = 0; k < layout.targets.size(); ++k) {
    if (layout.targets[k] >= 0) add_pose(bundle.targets[k].name + ".T_target.");
  }
  for (size_t k = 0; layout.scales >= 0 && k < bundle.scales.size(); ++k) {
    naming.Add(NameOfScale(bundle, bundle.scales[k]), 1, false);
  }
  return naming;
}

// Covariance of the determined directions.
struct CovarianceOfUnknowns {
  Eigen::MatrixXd covariance;
  Eigen::VectorXd open_share;  // of each unknown in directions without information, 0 to 1
  std::vector<OpenDirection> open;
  Eigen::MatrixXd undetermined;  // columns: directions without information

  void AddUndetermined(const Eigen::VectorXd& direction, const Naming& naming) {
    const Eigen::VectorXd in_units = direction.cwiseQuotient(naming.unit);
    open_share = open_share.cwiseMax(in_units.cwiseAbs() / in_units.cwiseAbs().maxCoeff());
    open.push_back(Describe(in_units, kInfinity, naming.names));
    undetermined.conservativeResize(direction.size(), undetermined.cols() + 1);
    undetermined.rightCols<1>() = direction;
  }
};

// Adds the covariance of directions with information to `inverse`, and the others.
void InvertByRank(const Eigen::MatrixXd& information,
                  const Naming& naming,
                  CovarianceOfUnknowns* inverse) {
  // Rank: directions without information in the matrix with unit diagonal.
  const auto& [scale, spectrum] = UnitSpectrum(information);
  for (Eigen::Index i = 0; i < scale.size(); ++i) {
    const Eigen::VectorXd direction = scale.asDiagonal() * spectrum.vectors.col(i);
    if (spectrum.values[i] > kRankTolerance) {
      inverse->covariance += direction * direction.transpose() / spectrum.values[i];
    } else {
      inverse->AddUndetermined(direction, naming);
    }
  }
}

CovarianceOfUnknowns InvertInformation(const NoisyInformation& noisy, const Naming& naming) {
  const Eigen::Index head = noisy.information.rows();
  CovarianceOfUnknowns inverse{
      Eigen::MatrixXd::Zero(head, head), Eigen::VectorXd::Zero(head), {}, {}};
  // Eigen's solver does not take the empty matrix of cameras that are fixed in all.
  if (head == 0) return inverse;
  if (noisy.of_noise.empty()) {
    InvertByRank(noisy.information, naming, &inverse);
  } else {
    const DeterminedPart determined = Separate(noisy, naming.unit);
    inverse.covariance = determined.covariance;
    for (const auto& direction : determined.open.colwise()) {
      inverse.AddUndetermined(direction, naming);
    }
  }
  // Directions with information that still leave a parameter open by its own size.
  const SymmetricEigen natural = DecomposeSymmetric(
      Eigen::MatrixXd(naming.unit.cwiseInverse().asDiagonal() * inverse.covariance *
                      naming.unit.cwiseInverse().asDiagonal()));
  for (Eigen::Index i = head - 1; i >= 0; --i) {
    const double sigma = std::sqrt(std::max(0.0, natural.values[i]));
    if (sigma > 1) {
      inverse.open.push_back(Describe(natural.vectors.col(i), sigma, naming.names));
    }
  }
  return inverse;
}

// Standard errors of the cameras' parameters and covariances of their extrinsics.
void SetCameraErrors(const CovarianceOfUnknowns& inverse,
                     const UnknownLayout& layout,
                     Uncertainty* result) {
  const Eigen::MatrixXd& covariance = inverse.covariance;
  const auto is_open = [&](int index) { return inverse.open_share[index] > kRoundingShare; };
  for (size_t c = 0; c < layout.params.size(); ++c) {
    std::vector<double> errors;
    for (const int index : layout.params[c]) {
      errors.push_back(index < 0        ? 0
                       : is_open(index) ? kInfinity
                                        : std::sqrt(covariance(index, index)));
    }
    result->param_std_errors.push_back(errors);
    Matrix6d extrinsics = Matrix6d::Zero();
    const int first = layout.extrinsics[c];
    if (first >= 0) {
      extrinsics = covariance.block<6, 6>(first, first);
      for (int i = 0; i < 6; ++i) {
        if (is_open(first + i)) extrinsics(i, i) = kInfinity;
      }
    }
    result->extrinsics_covariance.push_back(extrinsics);
  }
}

// Diagonal of (L L')^-1: the squares of the columns of L^-1, which are zero above its diagonal.
Eigen::VectorXd InverseDiagonal(const Eigen::LLT<Eigen::MatrixXd>& factor) {
  constexpr Eigen::Index kColumns = 96;
  const Eigen::Index size = factor.rows();
  Eigen::VectorXd diagonal(size);
  for (Eigen::Index begin = 0; begin < size; begin += kColumns) {
    const Eigen::Index columns = std::min(kColumns, size - begin), rest = size - begin;
    const auto L = factor.matrixLLT().bottomRightCorner(rest, rest);
    diagonal.segment(begin, columns) = L.triangularView<Eigen::Lower>()
                                           .solve(Eigen::MatrixXd::Identity(rest, columns))
                                           .colwise()
                                           .squaredNorm();
  }
  return diagonal;
}

// Rows of distances by the unknowns before the markers, which follow these.
Eigen::MatrixXd DistancesByHead(const std::vector<internal::SparseRow>& distances,
                                const TailElimination& markers,
                                Eigen::Index head) {
  Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(std::ssize(distances), head);
  for (Eigen::Index r = 0; r < rows.rows(); ++r) {
    for (const auto& [index, J] : distances[static_cast<size_t>(r)].J) {
      if (index < head) {
        rows(r, index) += J;
      } else {
        rows.row(r) -= J * markers.gain.row(index - head);
      }
    }
  }
  return rows;
}

// Standard errors of the markers; returns how many of their coordinates, and of their targets'
// scales, the images determine.
double SetMarkerErrors(const Bundle& bundle,
                       const UnknownLayout& layout,
                       const TailElimination& markers,
                       const std::vector<internal::SparseRow>& distances,
                       Uncertainty* result) {
  double determined = 0;
  const Eigen::Index tail = markers.gain.rows();
  if (tail == 0) return determined;
  const Eigen::VectorXd inverse_diagonal = InverseDiagonal(markers.factor);
  const auto variances = [&](const Eigen::MatrixXd& gain) {
    const Eigen::MatrixXd spread = gain * result->covariance;
    Eigen::VectorXd variance = inverse_diagonal;
    for (Eigen::Index i = 0; i < tail; ++i) variance[i] += spread.row(i).dot(gain.row(i));
    return variance;
  };
  Eigen::VectorXd variance = variances(markers.gain);
  for (const double of_one : variance) determined += 1 - of_one / bundle.marker_freedom.Variance();
  if (layout.scales >= 0) {
    // They move markers beside these unknowns.
    Eigen::MatrixXd gain = markers.gain;
    for (Eigen::Index k = 0; k < std::ssize(bundle.scales); ++k) {
      for (Eigen::Index m = 0; m < tail / 3; ++m) {
        gain.block<3, 1>(3 * m, layout.scales + k) -=
            bundle.ByScale(bundle.scales[static_cast<size_t>(k)], static_cast<int>(m));
      }
    }
    variance = variances(gain);
  }
  for (Eigen::Index row = 0; row < tail; row += 3) {
    result->marker_std_errors.emplace_back(variance.segment<3>(row).cwiseSqrt());
  }
  // What distances determine the images do not.
  if (distances.empty()) return determined;
  const Eigen::MatrixXd by_head = DistancesByHead(distances, markers, layout.head);
  determined -= by_head.cwiseProduct(by_head * result->covariance).sum();
  for (const internal::SparseRow& row : distances) {
    Eigen::VectorXd of_markers = Eigen::VectorXd::Zero(tail);
    for (const auto& [index, J] : row.J) {
      if (index >= layout.head) of_markers[index - layout.head] = J;
    }
    determined -= of_markers.dot(markers.factor.solve(of_markers));
  }
  return determined;
}

// Information of all priors on the unknowns before the markers.
Eigen::MatrixXd InformationOfPriors(const Bundle& bundle, const UnknownLayout& layout) {
  Eigen::MatrixXd lower = Eigen::MatrixXd::Zero(layout.head, layout.head);
  AddInformation(internal::RowsOfPriors(bundle, layout), &lower);
  return lower.selfadjointView<Eigen::Lower>();
}

// Adds to `inverse`, in which a distance holds the scale, that nothing determines it: the direction
// of the smallest information without that distance.
void OpenScale(const Bundle& bundle,
               const UnknownLayout& layout,
               const Naming& naming,
               CovarianceOfUnknowns* inverse) {
  if (std::ranges::find(naming.scaled, true) == naming.scaled.end()) return;
  Bundle without = bundle;
  without.scale_distance.reset();
  Eigen::MatrixXd information = HeadInformation(EliminateLandmarks(without, layout));
  AddInformation(internal::RowsOfParamPriors(bundle, layout), &information);
  const auto& [scale, spectrum] = UnitSpectrum(information);
  Eigen::VectorXd direction = scale.asDiagonal() * spectrum.vectors.col(0);
  for (Eigen::Index i = 0; i < direction.size(); ++i) {
    direction[i] = naming.scaled[static_cast<size_t>(i)] ? direction[i] / naming.unit[i] : 0;
  }
  inverse->AddUndetermined(direction.cwiseProduct(naming.unit), naming);
}

void SetCorrelation(Uncertainty* uncertainty) {
  const Eigen::MatrixXd& C = uncertainty->covariance;
  const Eigen::VectorXd inverse = C.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  uncertainty->correlation = inverse.asDiagonal() * C * inverse.asDiagonal();
}

// Sets the results that follow from the information on parameters and extrinsics, with priors.
void SetFromInformation(const Bundle& bundle,
                        const UnknownLayout& layout,
                        const NoisyInformation& information,
                        Uncertainty* result) {
  result->param_index = layout.params;
  result->extrinsics_index = layout.extrinsics;
  result->target_index = layout.targets;
  result->scale_index = layout.scales;
  const Naming naming = NameUnknowns(bundle, layout);
  result->names = naming.names;
  CovarianceOfUnknowns inverse = InvertInformation(information, naming);
  if (bundle.scale_distance) OpenScale(bundle, layout, naming, &inverse);
  result->covariance = inverse.covariance;
  result->open = inverse.open;
  result->undetermined = inverse.undetermined;
  SetCameraErrors(inverse, layout, result);
  SetCorrelation(result);
}

Uncertainty UncertaintyWithLandmarks(const Bundle& bundle,
                                     const UnknownLayout& layout,
                                     const std::vector<double>& coordinates) {
  const PoseSystem system = EliminateLandmarks(bundle, layout);
  Uncertainty result;
  result.frames_information = HeadInformation(system);
  Eigen::MatrixXd information = result.frames_information;
  AddInformation(internal::RowsOfParamPriors(bundle, layout), &information);
  SetFromInformation(bundle, layout, {information, {}}, &result);
  result.degrees_used_by_means = DegreesWithLandmarks(bundle);
  for (size_t c = 0; c < coordinates.size(); ++c) {
    result.redundancy.push_back(coordinates[c] - result.degrees_used_by_means[c]);
  }
  return result;
}

// Normal matrices with the poses moved by random errors: by the noise of their own points, and by
// the errors of all other unknowns. `covariance`: of the unknowns before the markers.
NoisyInformation SamplePoseNoise(const Bundle& bundle,
                                 const UnknownLayout& layout,
                                 const ReducedSystem& reduced,
                                 const TailElimination& markers,
                                 const Eigen::MatrixXd& of_priors,
                                 const Eigen::MatrixXd& covariance) {
  const internal::ReducedEquations equations = internal::EliminateFrames(
      bundle, layout, internal::ObjectiveOf(bundle, {}), 0, {.keep_steps = true});
  const Eigen::MatrixXd root = Root(covariance);
  std::vector<Matrix6d> roots;
  for (const Matrix6d& of_pose : reduced.pose_covariances) roots.emplace_back(Root(of_pose));
  Bundle moved = bundle;
  const auto information_at = [&](unsigned sample, double sign) -> Eigen::MatrixXd {
    std::mt19937 random(sample);
    std::normal_distribution<double> normal;
    const auto draw = [&] { return sign * normal(random); };
    Eigen::VectorXd step = Eigen::VectorXd::Zero(layout.total);
    step.head(layout.head) = root * Eigen::VectorXd::NullaryExpr(layout.head, draw);
    if (layout.markers) step.tail(layout.Markers()) = -markers.gain * step.head(layout.head);
    moved.T_rig_target = bundle.T_rig_target;
    moved.jitter = bundle.jitter;
    equations.MoveStates(step, 0, &moved);
    for (size_t frame = 0; frame < roots.size(); ++frame) {
      const Vector6d error = roots[frame] * Vector6d::NullaryExpr(draw);
      moved.T_rig_target[frame] = Retract(moved.T_rig_target[frame], error);
    }
    const internal::Objective objective = internal::ObjectiveOf(moved, {});
    Eigen::MatrixXd S = internal::EliminateFrames(moved, layout, objective, 0, {}).S;
    AddInformation(internal::RowsOfDistances(moved, layout), &S);
    return TailElimination(S, layout.head, layout.Markers()).information + of_priors;
  };
  return SampleNoise(markers.information + of_priors, information_at);
}

enum class By { kViews, kMotion };

Uncertainty Estimate(const Bundle& bundle, By by) {
  const std::vector<double> coordinates = UsedCoordinates(bundle);
  const UnknownLayout layout = internal::MakeLayout(bundle);
  if (bundle.HasLandmarks()) return UncertaintyWithLandmarks(bundle, layout, coordinates);
  Uncertainty result;
  result.redundancy = coordinates;
  result.degrees_used_by_means.assign(coordinates.size(), 0.0);
  const ReducedSystem reduced = Reduce(bundle, layout, &result);
  // The markers' block is positive definite by their prior.
  const TailElimination markers(reduced.S, layout.head, layout.Markers());
  const std::vector<internal::SparseRow> distances = internal::RowsOfDistances(bundle, layout);
  result.frames_information = markers.information;
  result.frames_gradient = reduced.gradient.head(layout.head);
  if (layout.markers) {
    result.frames_gradient -=
        markers.gain.transpose() * reduced.gradient.tail(layout.total - layout.head);
    result.frames_information -=
        markers.gain.transpose() * markers.gain / bundle.marker_freedom.Variance();
    const Eigen::MatrixXd of_distances = DistancesByHead(distances, markers, layout.head);
    result.frames_information -= of_distances.transpose() * of_distances;
  }
  const Eigen::MatrixXd of_priors = InformationOfPriors(bundle, layout);
  const Eigen::MatrixXd information = markers.information + of_priors;
  result.marker_gain = markers.gain;
  NoisyInformation noisy{information, {}};
  if (by == By::kMotion) {
    const auto sample = [&](const Eigen::MatrixXd& covariance) {
      return SamplePoseNoise(bundle, layout, reduced, markers, of_priors, covariance);
    };
    noisy = sample(Eigen::MatrixXd::Zero(layout.head, layout.head));
    noisy = sample(Separate(noisy, NameUnknowns(bundle, layout).unit).covariance);
  }
  SetFromInformation(bundle, layout, noisy, &result);
  double marker_degrees = SetMarkerErrors(bundle, layout, markers, distances, &result);

  // Markers and targets are shared: each camera's part of them is in proportion to its
  // measurements. Its own unknowns and its part of the poses count for it alone.
  const auto free_targets =
      static_cast<double>(std::ranges::count(bundle.targets, false, &BundleTarget::is_fixed));
  const double all_coordinates = std::accumulate(coordinates.begin(), coordinates.end(), 0.0);
  const Eigen::VectorXd by_priors =
      result.covariance.cwiseProduct(of_priors).rowwise().sum();  // degrees that these determine
  if (layout.scales >= 0) {
    const Eigen::Index count = layout.head - layout.scales;
    marker_degrees += static_cast<double>(count) - by_priors.tail(count).sum();
  }
  for (size_t c = 0; c < coordinates.size(); ++c) {
    const int first = layout.first[c], count = layout.first[c + 1] - first;
    double own =
        count - by_priors.segment(first, count).sum() +
        (marker_degrees + 6 * free_targets) * coordinates[c] / std::max(1.0, all_coordinates);
    // The extrinsics are known from a mean over the frames: of their jitter, where there is any.
    if (layout.extrinsics[c] >= 0 && bundle.EstimatesJitter()) {
      own -= 6;
      result.jitter_translation_redundancy -= 3;
      result.jitter_rotation_redundancy -= 3;
    }
    result.redundancy[c] -= own;
    result.degrees_used_by_means[c] += own;
  }
  return result;
}

}  // namespace

Uncertainty EstimateUncertainty(const Bundle& bundle) { return Estimate(bundle, By::kViews); }

Uncertainty EstimateUncertaintyByMotion(const Bundle& bundle) {
  return Estimate(bundle, By::kMotion);
}

void SetCovariance(const Eigen::MatrixXd& covariance, Uncertainty* uncertainty) {
  Eigen::MatrixXd& C = uncertainty->covariance;
  const Eigen::VectorXd before = C.diagonal();
  C = covariance;
  for (size_t c = 0; c < uncertainty->param_index.size(); ++c) {
    for (size_t k = 0; k < uncertainty->param_std_errors[c].size(); ++k) {
      const int index = uncertainty->param_index[c][k];
      if (index < 0 || !(before[index] > 0)) continue;
      uncertainty->param_std_errors[c][k] *= std::sqrt(C(index, index) / before[index]);
    }
    const int first = uncertainty->extrinsics_index[c];
    // An unknown without any information stays infinite.
    for (int i = 0; first >= 0 && i < 6; ++i) {
      for (int j = 0; j < 6; ++j) {
        double& entry = uncertainty->extrinsics_covariance[c](i, j);
        if (std::isfinite(entry)) entry = C(first + i, first + j);
      }
    }
  }
  SetCorrelation(uncertainty);
}

}  // namespace plenocal
