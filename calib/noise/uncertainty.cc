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
#include "calib/base/linear_algebra.h"
#include "calib/base/names.h"
#include "calib/noise/camera_noise.h"
#include "calib/noise/landmark_system.h"
#include "calib/noise/matrix_root.h"
#include "calib/noise/open_directions.h"
#include "calib/noise/reduced_system.h"

namespace plenocal {
namespace {

using internal::ReducedSystem;
using internal::UnknownLayout;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Eigenvalues of the reduced normal matrix with unit diagonal below this are rounding: its entries
// are differences of sums that agree to some 1e-15 times the number of unknowns.
constexpr double kRankTolerance = 1e-13;
// Shares of an unknown in directions without information below this are the eigenvectors' rounding.
constexpr double kRoundingShare = 1e-6;
constexpr double kSmallestUnit = 1e-12;

// Markers eliminated from the reduced system: their block is positive definite by their prior.
struct MarkerElimination {
  Eigen::LLT<Eigen::MatrixXd> factor;  // of S_mm
  Eigen::MatrixXd gain;                // S_mm^-1 S_mh; empty when markers are not estimated
  Eigen::MatrixXd information;         // of parameters and extrinsics
};

MarkerElimination EliminateMarkers(const Eigen::MatrixXd& S, const UnknownLayout& layout) {
  const int head = layout.head, tail = layout.total - layout.head;
  MarkerElimination result;
  result.information = S.topLeftCorner(head, head).selfadjointView<Eigen::Lower>();
  if (tail > 0) {
    const Eigen::MatrixXd S_mh = S.bottomLeftCorner(tail, head);
    result.factor.compute(S.bottomRightCorner(tail, tail).selfadjointView<Eigen::Lower>());
    result.gain = result.factor.solve(S_mh);
    result.information -= S_mh.transpose() * result.gain;
  }
  return result;
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
};

Naming NameUnknowns(const Bundle& bundle, const UnknownLayout& layout) {
  const double target_distance = MeanTargetDistance(bundle);
  Naming naming{{}, Eigen::VectorXd(layout.head)};
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const BundleCamera& camera = bundle.cameras[c];
    for (size_t k = 0; k < camera.params.size(); ++k) {
      if (layout.params[c][k] < 0 || bundle.Root(c, k) != ParamIndex{c, k}) continue;
      if (k >= camera.ModelParams()) {
        naming.unit[layout.params[c][k]] =
            camera.nuisances[k - camera.ModelParams()]->unit * camera.rules[k].prior->sigma;
        naming.names.push_back(NuisanceName(camera, k));
        continue;
      }
      const Param& param = camera.model->params[k];
      naming.unit[layout.params[c][k]] =
          std::max({std::abs(camera.params[k]), param.scale, kSmallestUnit});
      naming.names.push_back(bundle.cameras[c].name + "." + std::string(param.name));
    }
    const int extrinsics = layout.extrinsics[c];
    if (extrinsics < 0) continue;
    naming.unit.segment<3>(extrinsics).setConstant(std::max(target_distance, kSmallestUnit));
    naming.unit.segment<3>(extrinsics + 3).setOnes();
    for (const char* name : kExtrinsicsNames) {
      naming.names.push_back(bundle.cameras[c].name + ".T_camera_rig." + name);
    }
  }
  for (size_t k = 0; k < layout.targets.size(); ++k) {
    const int target = layout.targets[k];
    if (target < 0) continue;
    naming.unit.segment<3>(target).setConstant(std::max(target_distance, kSmallestUnit));
    naming.unit.segment<3>(target + 3).setOnes();
    for (const char* name : kExtrinsicsNames) {
      naming.names.push_back(bundle.targets[k].name + ".T_target." + name);
    }
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
  const Eigen::Index head = information.rows();
  const Eigen::VectorXd diagonal = information.diagonal().cwiseMax(0);
  Eigen::VectorXd scale(head);
  for (Eigen::Index i = 0; i < head; ++i) {
    scale[i] = diagonal[i] > 0 ? 1 / std::sqrt(diagonal[i]) : 1;
  }
  const SymmetricEigen spectrum =
      DecomposeSymmetric(Eigen::MatrixXd(scale.asDiagonal() * information * scale.asDiagonal()));
  for (Eigen::Index i = 0; i < head; ++i) {
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

// Standard errors of the markers; returns how many of their coordinates the data determine.
double SetMarkerErrors(const MarkerElimination& markers, double marker_sigma, Uncertainty* result) {
  double determined = 0;
  const Eigen::Index tail = markers.gain.rows();
  if (tail == 0) return determined;
  const Eigen::VectorXd inverse_diagonal = InverseDiagonal(markers.factor);
  const Eigen::MatrixXd spread = markers.gain * result->covariance;
  for (Eigen::Index m = 0; m < tail / 3; ++m) {
    Eigen::Vector3d variance;
    for (Eigen::Index i = 0; i < 3; ++i) {
      const Eigen::Index row = 3 * m + i;
      variance[i] = inverse_diagonal[row] + spread.row(row).dot(markers.gain.row(row));
      determined += 1 - variance[i] / (marker_sigma * marker_sigma);
    }
    result->marker_std_errors.push_back(variance.cwiseSqrt());
  }
  return determined;
}

// Per camera: degrees of freedom of its parameters and extrinsics that priors determine.
std::vector<double> DegreesOfPriors(const Bundle& bundle,
                                    const UnknownLayout& layout,
                                    const Eigen::MatrixXd& of_priors,
                                    const Eigen::MatrixXd& covariance) {
  const Eigen::VectorXd determined = covariance.cwiseProduct(of_priors).rowwise().sum();
  std::vector<double> degrees(layout.params.size(), 0.0);
  for (size_t c = 0; c < degrees.size(); ++c) {
    for (size_t k = 0; k < layout.params[c].size(); ++k) {
      const int index = layout.params[c][k];
      if (index >= 0 && bundle.Root(c, k) == ParamIndex{c, k}) degrees[c] += determined[index];
    }
    if (layout.extrinsics[c] >= 0) degrees[c] += determined.segment<6>(layout.extrinsics[c]).sum();
  }
  return degrees;
}

// Degrees of freedom of each camera's own parameters and extrinsics, and those of the jitter. The
// extrinsics are known from a mean over the frames: of their jitter, where there is any.
std::vector<double> DegreesOfCameras(const Bundle& bundle,
                                     const UnknownLayout& layout,
                                     Uncertainty* result) {
  std::vector<double> degrees(layout.params.size(), 0.0);
  for (size_t c = 0; c < degrees.size(); ++c) {
    if (layout.extrinsics[c] >= 0) {
      if (bundle.EstimatesJitter()) {
        result->jitter_translation_redundancy -= 3;
        result->jitter_rotation_redundancy -= 3;
      } else {
        degrees[c] = 6;
      }
    }
    for (size_t k = 0; k < layout.params[c].size(); ++k) {
      degrees[c] += layout.params[c][k] >= 0 && bundle.Root(c, k) == ParamIndex{c, k} ? 1 : 0;
    }
  }
  return degrees;
}

// Information of all priors on the unknowns before the markers.
Eigen::MatrixXd InformationOfPriors(const Bundle& bundle, const UnknownLayout& layout) {
  Eigen::MatrixXd lower = Eigen::MatrixXd::Zero(layout.head, layout.head);
  AddInformation(internal::RowsOfParamPriors(bundle, layout), &lower);
  AddInformation(internal::RowsOfCalibrationPrior(bundle, layout), &lower);
  return lower.selfadjointView<Eigen::Lower>();
}

// The unknowns that change with the scale of all lengths: translations in the rig, and the lengths
// inside of plenoptic cameras. Those inside of others have no unit of length.
std::vector<bool> ScaledUnknowns(const Bundle& bundle, const UnknownLayout& layout) {
  std::vector<bool> scaled(static_cast<size_t>(layout.head), false);
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const CameraModel& model = *bundle.cameras[c].model;
    for (size_t k = 0; k < model.params.size(); ++k) {
      if (layout.params[c][k] < 0 || model.params[k].unit != "m") continue;
      scaled[static_cast<size_t>(layout.params[c][k])] = true;
    }
    for (int i = 0; layout.extrinsics[c] >= 0 && i < 3; ++i) {
      scaled[static_cast<size_t>(layout.extrinsics[c]) + static_cast<size_t>(i)] = true;
    }
  }
  return scaled;
}

// Adds to `inverse`, in which a distance holds the scale, that nothing determines it: the direction
// of the smallest information without that distance.
void OpenScale(const Bundle& bundle,
               const UnknownLayout& layout,
               const Naming& naming,
               CovarianceOfUnknowns* inverse) {
  const std::vector<bool> scaled = ScaledUnknowns(bundle, layout);
  if (std::ranges::find(scaled, true) == scaled.end()) return;
  Bundle without = bundle;
  without.scale_distance.reset();
  Eigen::MatrixXd information = HeadInformation(EliminateLandmarks(without, layout));
  AddInformation(internal::RowsOfParamPriors(bundle, layout), &information);
  const Eigen::VectorXd scale = information.diagonal()
                                    .cwiseMax(std::numeric_limits<double>::min())
                                    .cwiseSqrt()
                                    .cwiseInverse();
  const SymmetricEigen spectrum =
      DecomposeSymmetric(Eigen::MatrixXd(scale.asDiagonal() * information * scale.asDiagonal()));
  Eigen::VectorXd direction = (scale.asDiagonal() * spectrum.vectors.col(0)).eval();
  for (Eigen::Index i = 0; i < direction.size(); ++i) {
    direction[i] = scaled[static_cast<size_t>(i)] ? direction[i] / naming.unit[i] : 0;
  }
  inverse->AddUndetermined(direction.cwiseProduct(naming.unit), naming);
}

// Sets the results that follow from the information on parameters and extrinsics, with priors.
void SetFromInformation(const Bundle& bundle,
                        const UnknownLayout& layout,
                        const NoisyInformation& information,
                        Uncertainty* result) {
  result->param_index = layout.params;
  result->extrinsics_index = layout.extrinsics;
  result->target_index = layout.targets;
  const Naming naming = NameUnknowns(bundle, layout);
  result->names = naming.names;
  CovarianceOfUnknowns inverse = InvertInformation(information, naming);
  if (bundle.scale_distance) OpenScale(bundle, layout, naming, &inverse);
  result->covariance = inverse.covariance;
  result->open = inverse.open;
  result->undetermined = inverse.undetermined;
  SetCameraErrors(inverse, layout, result);
  const Eigen::VectorXd sigma = result->covariance.diagonal().cwiseMax(1e-300).cwiseSqrt();
  result->correlation =
      sigma.cwiseInverse().asDiagonal() * result->covariance * sigma.cwiseInverse().asDiagonal();
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

// Normal matrices with the poses moved by their errors: those of their own points, and those by
// which they follow the errors of all other unknowns.
class PoseNoise {
 public:
  PoseNoise(const Bundle& bundle,
            const UnknownLayout& layout,
            const ReducedSystem& reduced,
            const MarkerElimination& markers,
            Eigen::MatrixXd information)
      : bundle_(bundle),
        layout_(layout),
        gain_(markers.gain),
        information_(std::move(information)),
        of_priors_(information_ - markers.information),
        moved_(bundle),
        equations_(internal::EliminateFrames(
            bundle, layout, internal::ObjectiveOf(bundle, {}), 0, {.keep_steps = true})) {
    for (const Matrix6d& covariance : reduced.pose_covariances)
      roots_.emplace_back(Root(covariance));
  }

  // `covariance`: of the unknowns before the markers.
  NoisyInformation Sample(const Eigen::MatrixXd& covariance) {
    const Eigen::MatrixXd root = Root(covariance);
    return SampleNoise(information_, [&](unsigned sample, double sign) -> Eigen::MatrixXd {
      Move(root, sample, sign);
      return EliminateMarkers(internal::Reduce(moved_, layout_).S, layout_).information +
             of_priors_;
    });
  }

 private:
  void Move(const Eigen::MatrixXd& root, unsigned sample, double sign) {
    std::mt19937 random(sample);
    std::normal_distribution<double> normal;
    const auto draw = [&] { return sign * normal(random); };
    Eigen::VectorXd step = Eigen::VectorXd::Zero(layout_.total);
    step.head(layout_.head) = root * Eigen::VectorXd::NullaryExpr(layout_.head, draw);
    if (layout_.markers) {
      step.tail(layout_.total - layout_.head) = -gain_ * step.head(layout_.head);
    }
    moved_.T_rig_target = bundle_.T_rig_target;
    moved_.jitter = bundle_.jitter;
    equations_.MoveStates(step, 0, &moved_);
    for (size_t frame = 0; frame < roots_.size(); ++frame) {
      const Vector6d error = roots_[frame] * Vector6d::NullaryExpr(draw);
      moved_.T_rig_target[frame] = Retract(moved_.T_rig_target[frame], error);
    }
  }

  const Bundle& bundle_;
  const UnknownLayout& layout_;
  const Eigen::MatrixXd& gain_;
  Eigen::MatrixXd information_, of_priors_;
  Bundle moved_;
  internal::ReducedEquations equations_;
  std::vector<Matrix6d> roots_;
};

enum class By { kViews, kMotion };

Uncertainty Estimate(const Bundle& bundle, By by) {
  const std::vector<double> coordinates = UsedCoordinates(bundle);
  const UnknownLayout layout = internal::MakeLayout(bundle);
  if (bundle.HasLandmarks()) return UncertaintyWithLandmarks(bundle, layout, coordinates);
  const ReducedSystem reduced = internal::Reduce(bundle, layout);
  const MarkerElimination markers = EliminateMarkers(reduced.S, layout);

  Uncertainty result;
  result.frames_information = markers.information;
  result.frames_gradient = reduced.gradient.head(layout.head);
  if (layout.markers) {
    result.frames_gradient -=
        markers.gain.transpose() * reduced.gradient.tail(layout.total - layout.head);
    result.frames_information -=
        markers.gain.transpose() * markers.gain / bundle.marker_freedom.Variance();
  }
  const Eigen::MatrixXd of_priors = InformationOfPriors(bundle, layout);
  const Eigen::MatrixXd information = markers.information + of_priors;
  result.marker_gain = markers.gain;
  NoisyInformation noisy{information, {}};
  if (by == By::kMotion) {
    PoseNoise noise(bundle, layout, reduced, markers, information);
    const Eigen::VectorXd unit = NameUnknowns(bundle, layout).unit;
    noisy = noise.Sample(Eigen::MatrixXd::Zero(layout.head, layout.head));
    noisy = noise.Sample(Separate(noisy, unit).covariance);
  }
  SetFromInformation(bundle, layout, noisy, &result);
  const double marker_degrees = SetMarkerErrors(markers, bundle.marker_freedom.Sigma(), &result);

  // Markers and targets are shared: each camera's part of them is in proportion to its
  // measurements. Its own unknowns and its part of the poses are its alone.
  const auto free_targets =
      static_cast<double>(std::ranges::count(bundle.targets, false, &BundleTarget::is_fixed));
  const double all_coordinates = std::accumulate(coordinates.begin(), coordinates.end(), 0.0);
  result.jitter_translation_redundancy = reduced.jitter_translations;
  result.jitter_rotation_redundancy = reduced.jitter_rotations;
  const std::vector<double> by_priors =
      DegreesOfPriors(bundle, layout, of_priors, result.covariance);
  std::vector<double> own = DegreesOfCameras(bundle, layout, &result);
  for (size_t c = 0; c < coordinates.size(); ++c) {
    own[c] -= by_priors[c];
    own[c] += (marker_degrees + 6 * free_targets) * coordinates[c] / std::max(1.0, all_coordinates);
    result.redundancy.push_back(coordinates[c] - own[c] - reduced.degrees_of_poses[c]);
    result.degrees_used_by_means.push_back(own[c] + reduced.degrees_of_poses_by_means[c]);
  }
  return result;
}

}  // namespace

Uncertainty EstimateUncertainty(const Bundle& bundle) { return Estimate(bundle, By::kViews); }

Uncertainty EstimateUncertaintyByMotion(const Bundle& bundle) {
  return Estimate(bundle, By::kMotion);
}

}  // namespace plenocal
