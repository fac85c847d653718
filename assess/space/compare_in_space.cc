// SPDX-License-Identifier: Apache-2.0
#include "assess/space/compare_in_space.h"

#include <algorithm>
#include <cmath>

#include "assess/space/accuracy.h"
#include "assess/space/points_before_image.h"
#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

constexpr int kCells = 12;                 // along the longer side of the image
constexpr double kDifferenceLevel = 0.01;  // of all numbers together

// A difference of one point, or of one length, and its derivative by the errors of both files in
// units of their standard deviations.
struct Difference {
  size_t distance;
  Eigen::VectorXd d;  // 3: of a point; 1: of a length
  Eigen::MatrixXd by_errors;
  Eigen::MatrixXd by_motion;  // of the set's frame
};

class SetComparison {
 public:
  SetComparison(const CalibrationRecord& a,
                const CalibrationRecord& b,
                const std::vector<std::string>& names,
                const std::vector<MicroLensVisibility>& lenses)
      : rig_a_(MakeSpaceRig(a, names)),
        rig_b_(MakeSpaceRig(b, names)),
        points_(a, names, rig_a_, lenses),
        grid_(rig_a_.cameras[0].image_size, kCells) {}

  [[nodiscard]] bool HasPrediction() const { return rig_a_.has_errors || rig_b_.has_errors; }

  void Add(size_t distance, double z, double bar) {
    for (size_t cell = 0; cell < grid_.Cells(); ++cell) {
      const std::optional<Eigen::Vector3d> X = points_.At(grid_.Middle(cell), z);
      if (!X) continue;
      const std::optional<Pair> from = Find(*X);
      if (!from) continue;
      places_.push_back(Of(distance, *from));
      // Towards the middle of the image, where the end is imaged as well.
      const Eigen::Vector3d across(X->x() > 0 ? -1 : 1, 0, 0);
      const std::optional<Pair> to = Find(*X + bar * across);
      if (to) bars_.push_back(Length(distance, *from, *to, across));
    }
  }

  // Takes the motion out. Places in all cells and at all distances share it.
  void TakeOutMotion() {
    if (places_.empty()) return;
    const Eigen::Index rows = 3 * std::ssize(places_), columns = places_[0].by_errors.cols();
    Eigen::MatrixXd H(rows, 6), M(rows, columns + 1);
    for (size_t i = 0; i < places_.size(); ++i) {
      const auto row = 3 * static_cast<Eigen::Index>(i);
      H.middleRows<3>(row) = places_[i].by_motion;
      M.middleRows<3>(row) << places_[i].by_errors, places_[i].d;
    }
    // What both predict well holds the frame; no row counts more than ten typical ones.
    constexpr double kLeast = 0.01;
    Eigen::VectorXd variances = M.leftCols(columns).rowwise().squaredNorm();
    const double least = kLeast * Median(std::vector<double>(variances.begin(), variances.end()));
    const Eigen::VectorXd weights = HasPrediction()
                                        ? Eigen::VectorXd((variances.array() + least).rsqrt())
                                        : Eigen::VectorXd::Ones(rows);
    M -= H * LeastSquares(Eigen::MatrixXd(weights.asDiagonal() * H),
                          Eigen::MatrixXd(weights.asDiagonal() * M));
    for (size_t i = 0; i < places_.size(); ++i) {
      const auto row = 3 * static_cast<Eigen::Index>(i);
      places_[i].by_errors = M.block(row, 0, 3, columns);
      places_[i].d = M.block<3, 1>(row, columns);
    }
  }

  [[nodiscard]] SpaceDifference Judge(size_t distance, const std::string& quantity) const {
    SpaceDifference result;
    result.quantity = quantity;
    const Eigen::Index first = quantity == "z" ? 2 : 0, count = quantity == "lateral" ? 2 : 1;
    double squares = 0;
    Eigen::MatrixXd information;
    for (const Difference& each : quantity == "bar" ? bars_ : places_) {
      if (each.distance != distance) continue;
      const double square = each.d.segment(first, count).squaredNorm();
      squares += square;
      result.largest = std::max(result.largest, std::sqrt(square));
      ++result.points;
      const Eigen::MatrixXd M = each.by_errors.middleRows(first, count);
      if (information.size() == 0) information = Eigen::MatrixXd::Zero(M.cols(), M.cols());
      information += M.transpose() * M;
    }
    if (result.points == 0) return result;
    result.rms = std::sqrt(squares / result.points);
    if (!HasPrediction()) return result;
    result.predicted = std::sqrt(information.trace() / result.points);
    result.probability =
        TailOfWeightedSquares(squares, information.trace(), information.squaredNorm());
    return result;
  }

 private:
  struct Pair {
    SpacePoint a, b;
  };

  [[nodiscard]] std::optional<Pair> Find(const Eigen::Vector3d& X) const {
    std::vector<SpaceObservation> seen = points_.Seen(X);
    if (seen.empty()) return std::nullopt;
    for (SpaceObservation& each : seen) {
      const double noise = rig_a_.NoiseOf(each.camera, 0);
      each.sigma = noise > 0 ? noise : 1;
    }
    Pair pair{FitPoint(rig_a_, seen), FitPoint(rig_b_, seen)};
    const auto is_finite = [](const SpacePoint& point) { return point.IsFound() && point.rho > 0; };
    return is_finite(pair.a) && is_finite(pair.b) ? std::optional(pair) : std::nullopt;
  }

  static Eigen::MatrixXd ByErrors(const Pair& pair) {
    const auto a = pair.a.ByCalibration(), b = pair.b.ByCalibration();
    Eigen::MatrixXd by(3, a.cols() + b.cols());
    by << -a, b;
    return by;
  }

  static Difference Of(size_t distance, const Pair& pair) {
    Difference each{distance, pair.b.position - pair.a.position, ByErrors(pair), {}};
    each.by_motion.resize(3, 6);
    each.by_motion << Eigen::Matrix3d::Identity(), -Hat(pair.a.position);
    return each;
  }

  static Difference Length(size_t distance,
                           const Pair& from,
                           const Pair& to,
                           const Eigen::Vector3d& along) {
    const double change =
        (to.b.position - from.b.position).norm() - (to.a.position - from.a.position).norm();
    return {distance,
            Eigen::VectorXd::Constant(1, change),
            along.transpose() * (ByErrors(to) - ByErrors(from)),
            {}};
  }

  const SpaceRig rig_a_, rig_b_;
  const PointsBeforeImage points_;
  const ImageGrid grid_;
  std::vector<Difference> places_, bars_;
};

bool MeasuresPoints(const CalibrationRecord& calibration, const std::vector<std::string>& names) {
  return names.size() > 1 || FindCamera(calibration, names[0]).model->plenoptic;
}

}  // namespace

SpaceComparison CompareInSpace(const CalibrationRecord& a,
                               const CalibrationRecord& b,
                               const std::vector<MicroLensVisibility>& lenses,
                               const std::vector<double>& distances,
                               double bar) {
  CalibrationRecord common = a;
  std::erase_if(common.cameras, [&](const CalibratedCamera& camera) {
    return std::ranges::find(b.cameras, camera.name, &CalibratedCamera::name) == b.cameras.end();
  });
  SpaceComparison comparison;
  comparison.bar = bar;
  for (const std::vector<std::string>& names : CameraSets(common)) {
    if (!MeasuresPoints(a, names)) continue;
    SetComparison set(a, b, names, lenses);
    for (size_t d = 0; d < distances.size(); ++d) set.Add(d, distances[d], bar);
    set.TakeOutMotion();
    comparison.has_prediction = set.HasPrediction();
    for (size_t d = 0; d < distances.size(); ++d) {
      for (const char* quantity : {"z", "lateral", "bar"}) {
        SpaceDifference difference = set.Judge(d, quantity);
        difference.cameras = names;
        difference.distance = distances[d];
        if (difference.points > 0) comparison.differences.push_back(std::move(difference));
      }
    }
  }
  if (comparison.differences.empty()) {
    throw InputError(
        "{}: no two cameras, and no plenoptic one, that both calibrations have measure points at "
        "these distances",
        b.path.string());
  }
  const double limit = kDifferenceLevel / static_cast<double>(comparison.differences.size());
  comparison.same = comparison.has_prediction;
  for (SpaceDifference& each : comparison.differences) {
    each.differs = comparison.has_prediction && each.probability < limit;
    comparison.same = comparison.same && !each.differs;
  }
  return comparison;
}

}  // namespace plenocal
