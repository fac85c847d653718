// SPDX-License-Identifier: Apache-2.0
#include "assess/space/accuracy.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "assess/space/points_before_image.h"
#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"
#include "calib/space/space_rig.h"

namespace plenocal {
namespace {

using Row = Eigen::RowVectorXd;
using Seen = std::vector<SpaceObservation>;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kWorst = 0.9;             // part of the image
constexpr double kExtrapolated = 2;        // times the farthest marker
constexpr double kFarthestSearched = 1e3;  // times the farthest distance
constexpr double kLeastDistance = 3;       // sigmas of the inverse distance

// C where some of theta are known: C_oo - C_ok C_kk^-1 C_ko.
Eigen::MatrixXd Given(const Eigen::MatrixXd& C, const std::vector<Eigen::Index>& known) {
  if (known.empty()) return C;
  const Eigen::MatrixXd columns = C(Eigen::all, known);
  return C - columns * PseudoInverse(C(known, known)) * columns.transpose();
}

double Square(const Row& row, const Eigen::MatrixXd& C) { return std::max(0.0, row.dot(row * C)); }

// Numbers with two digits, as a person chooses distances.
double TwoDigits(double value) {
  const double unit = std::pow(10, std::floor(std::log10(value)) - 1);
  return std::round(value / unit) * unit;
}

struct ErringPoint : PointError {
  Eigen::Vector3d X;
};

class Predictor {
 public:
  Predictor(const CalibrationRecord& calibration,
            const std::vector<std::string>& names,
            const std::vector<MicroLensVisibility>& lenses,
            const AccuracyOptions& options)
      : calibration_(calibration),
        options_(options),
        rig_(MakeSpaceRig(calibration, names)),
        points_(calibration, names, rig_, lenses) {
    made_.cameras = names;
    made_.bar = options.bar;
    made_.image_size = rig_.cameras[0].image_size;
    made_.grid = ImageGrid(made_.image_size, options.cells);
    made_.has_depth = names.size() > 1 || rig_.cameras[0].model->plenoptic;
    made_.open = rig_.open;
    for (size_t c = 0; c < names.size(); ++c) AddNoise(names[c], c);
    if (!rig_.has_errors) {
      throw InputError(
          "{}: has no standard errors (correlations.csv beside calibration.yaml), so that nothing "
          "can be predicted; give the folder that 'plenocal calibrate' wrote",
          calibration.path.string());
    }
    if (options.frame == SpaceFrame::kHousing && rig_.follow.size() == 0) {
      throw InputError("{}: has no residuals.csv, by which the frame 'housing' is held",
                       calibration.path.string());
    }
    SetCovariances();
    FindMarkers();
  }

  RigAccuracy Make() {
    for (const double distance : Distances()) made_.distances.push_back(At(distance, made_.grid));
    FindLimits();
    FindFindings();
    return std::move(made_);
  }

 private:
  void AddNoise(const std::string& name, size_t c) {
    const auto stated = options_.noise.find(name);
    made_.noise.push_back(stated != options_.noise.end()
                              ? stated->second
                              : options_.noise_of_all.value_or(rig_.NoiseOf(c, 0)));
    if (made_.noise.back() > 0) return;
    throw InputError("{}: the noise of camera '{}' is not known; state it: --noise {}=0.1",
                     calibration_.path.string(),
                     name,
                     name);
  }

  void SetCovariances() {
    const Eigen::Index n = std::ssize(rig_.unknowns);
    C_ = (rig_.root * rig_.root.transpose()).topLeftCorner(n, n);
    for (const auto& [name, scale] : calibration_.target_scales) {
      scale_sigma_ = std::max(scale_sigma_, scale.sigma);
    }
    std::vector<Eigen::Index> intrinsics, extrinsics;
    std::vector<std::vector<Eigen::Index>> of_camera(rig_.cameras.size());
    for (size_t i = 0; i < rig_.unknowns.size(); ++i) {
      const auto index = static_cast<Eigen::Index>(i);
      const CalibrationPrior::Unknown& unknown = rig_.unknowns[i];
      (unknown.param ? intrinsics : extrinsics).push_back(index);
      if (unknown.param) of_camera[unknown.camera].push_back(index);
    }
    const auto add = [&](const std::string& name, const std::vector<Eigen::Index>& known) {
      if (known.empty()) return;
      made_.known.push_back(name);
      C_if_known_.push_back(Given(C_, known));
    };
    add("intrinsics", intrinsics);
    if (rig_.cameras.size() < 2) return;
    add("extrinsics", extrinsics);
    for (size_t c = 0; c < of_camera.size(); ++c) add(made_.cameras[c], of_camera[c]);
  }

  // z of the first camera's markers.
  void FindMarkers() {
    const CalibratedCamera& camera = FindCamera(calibration_, made_.cameras[0]);
    const auto c = static_cast<size_t>(&camera - calibration_.cameras.data());
    for (const ResidualRow& row : camera.residuals) {
      const auto marker = calibration_.markers.find(row.marker);
      if (!row.used || marker == calibration_.markers.end()) continue;
      const double z = (calibration_.CameraFromTarget(c, row.frame) * marker->second.position).z();
      if (!(z > 0)) continue;
      nearest_ = std::min(nearest_, z);
      farthest_ = std::max(farthest_, z);
    }
  }

  [[nodiscard]] std::vector<double> Distances() const {
    if (!options_.distances.empty()) return options_.distances;
    if (!(farthest_ > 0)) {
      throw InputError(
          "{}: has no residuals.csv, so that no distance of a marker is known; give --distances 0.5,1,2",
          calibration_.path.string());
    }
    std::vector<double> distances{TwoDigits(nearest_)};
    for (const double times : {1, 2, 5, 10}) {
      const double distance = TwoDigits(times * farthest_);
      if (distance > distances.back()) distances.push_back(distance);
    }
    return distances;
  }

  [[nodiscard]] std::optional<ErringPoint> ErrorOf(const Eigen::Vector3d& X) const {
    Seen seen = points_.Seen(X);
    for (SpaceObservation& each : seen) each.sigma = made_.noise[each.camera];
    if (seen.empty()) return std::nullopt;
    std::optional<PointError> error = ErrorAt(rig_, seen, X, options_.frame, !made_.has_depth);
    if (!error) return std::nullopt;
    return ErringPoint{std::move(*error), X};
  }

  // Of the number whose derivatives by points are `by`.
  [[nodiscard]] ErrorBudget BudgetOf(
      const std::vector<std::pair<const ErringPoint*, Eigen::RowVector3d>>& by) const {
    double noise = 0;
    double by_scale = 0;
    Row by_theta = Row::Zero(rig_.Size());
    for (const auto& [point, row] : by) {
      by_scale += row.dot(point->X);
      noise += row.dot(row * point->noise);
      by_theta += row * point->by_theta;
    }
    const double all = Square(by_theta.head(C_.cols()), C_);
    ErrorBudget budget{.noise = std::sqrt(noise)};
    // An error of the target's size scales all of space.
    budget.scale = std::min(scale_sigma_ * std::abs(by_scale), std::sqrt(all));
    budget.calibration = std::sqrt(std::max(0.0, all - budget.scale * budget.scale));
    // Shifts of what a camera sees, alike for all points of an instant; not its turn, which depends
    // on where they are.
    double square = 0;
    for (Eigen::Index k = C_.cols(); k < by_theta.size(); k += 6) {
      square += by_theta.segment<3>(k).squaredNorm();
    }
    if (calibration_.jitter)
      budget.jitter = calibration_.jitter->translation_sigma * std::sqrt(square);
    return budget;
  }

  [[nodiscard]] std::optional<AccuracyCell> CellAt(const Eigen::Vector3d& X) const {
    const std::optional<ErringPoint> error = ErrorOf(X);
    if (!error) return std::nullopt;
    AccuracyCell cell;
    const std::pair<const ErringPoint*, Eigen::RowVector3d> x{&*error, Eigen::RowVector3d::UnitX()},
        y{&*error, Eigen::RowVector3d::UnitY()}, z{&*error, Eigen::RowVector3d::UnitZ()};
    const ErrorBudget of_x = BudgetOf({x}), of_y = BudgetOf({y});
    for (const auto part : {&ErrorBudget::noise,
                            &ErrorBudget::calibration,
                            &ErrorBudget::scale,
                            &ErrorBudget::jitter}) {
      cell.lateral.*part = std::hypot(of_x.*part, of_y.*part) / std::sqrt(2);
    }
    // Towards the middle of the image, where the end is imaged as well.
    const Eigen::Vector3d across(X.x() > 0 ? -1 : 1, 0, 0);
    cell.across = BarAt(*error, X, across);
    if (!made_.has_depth) return cell;
    cell.z = BudgetOf({z});
    cell.along = BarAt(*error, X, Eigen::Vector3d::UnitZ());
    const Eigen::RowVector3d radial = X.normalized();
    cell.relative = BudgetOf({{&*error, radial}}).Sigma() / X.norm();
    const double others = std::hypot(cell.z.noise, cell.z.jitter);
    for (const Eigen::MatrixXd& C : C_if_known_) {
      const Row by_theta = error->by_theta.row(2).head(C.cols());
      cell.z_if_known.push_back(std::hypot(others, std::sqrt(Square(by_theta, C))));
    }
    return cell;
  }

  [[nodiscard]] std::optional<ErrorBudget> BarAt(const ErringPoint& from,
                                                 const Eigen::Vector3d& X,
                                                 const Eigen::Vector3d& direction) const {
    const std::optional<ErringPoint> to = ErrorOf(X + options_.bar * direction);
    if (!to) return std::nullopt;
    return BudgetOf({{&*to, direction.transpose()}, {&from, -direction.transpose()}});
  }

  [[nodiscard]] AccuracyAtDistance At(double distance, const ImageGrid& grid) const {
    AccuracyAtDistance at;
    at.distance = distance;
    if (farthest_ > 0) at.seen_at = distance / farthest_;
    for (size_t k = 0; k < grid.Cells(); ++k) {
      const std::optional<Eigen::Vector3d> X = points_.At(grid.Middle(k), distance);
      std::optional<AccuracyCell> cell = X ? CellAt(*X) : std::nullopt;
      if (!cell) continue;
      cell->cell = k;
      at.cells.push_back(std::move(*cell));
    }
    Summarise(&at);
    return at;
  }

  void Summarise(AccuracyAtDistance* at) const {
    // NaN without a cell that has the number.
    const auto quantile = [&](double part, const auto& of) {
      std::vector<double> values;
      for (const AccuracyCell& cell : at->cells) {
        const double value = of(cell);
        if (!std::isnan(value)) values.push_back(value);
      }
      return values.empty() ? kNan : Quantile(std::move(values), part);
    };
    constexpr double kHalf = 0.5;
    for (const auto part : {&ErrorBudget::noise,
                            &ErrorBudget::calibration,
                            &ErrorBudget::scale,
                            &ErrorBudget::jitter}) {
      for (const auto& [of, whole] :
           {std::pair(&AccuracyCell::z, &AccuracyAtDistance::z),
            std::pair(&AccuracyCell::lateral, &AccuracyAtDistance::lateral)}) {
        const auto budget = of;
        (at->*whole).*part =
            quantile(kHalf, [&](const AccuracyCell& cell) { return (cell.*budget).*part; });
      }
    }
    const auto z = [](const AccuracyCell& cell) { return cell.z.Sigma(); };
    const auto lateral = [](const AccuracyCell& cell) { return cell.lateral.Sigma(); };
    at->sigma_z = quantile(kHalf, z);
    at->worst_z = quantile(kWorst, z);
    at->sigma_lateral = quantile(kHalf, lateral);
    at->worst_lateral = quantile(kWorst, lateral);
    at->relative = quantile(kHalf, [](const AccuracyCell& cell) { return cell.relative; });
    for (const auto& [of, whole] : {std::pair(&AccuracyCell::across, &AccuracyAtDistance::across),
                                    std::pair(&AccuracyCell::along, &AccuracyAtDistance::along)}) {
      const auto bar = of;
      const double sigma = quantile(
          kHalf, [&](const AccuracyCell& cell) { return cell.*bar ? (cell.*bar)->Sigma() : kNan; });
      if (!std::isnan(sigma)) at->*whole = sigma;
    }
    for (size_t i = 0; made_.has_depth && i < made_.known.size(); ++i) {
      at->z_if_known.push_back(
          quantile(kHalf, [&](const AccuracyCell& cell) { return cell.z_if_known[i]; }));
    }
  }

  // The distance at which a number that grows or falls with the distance crosses `limit`.
  template <typename Of>
  [[nodiscard]] std::optional<double> DistanceWhere(double limit, const Of& of) const {
    constexpr int kCoarse = 6, kSteps = 12;
    const ImageGrid grid(rig_.cameras[0].image_size, kCoarse);
    double below = made_.distances.front().distance,
           above = kFarthestSearched * made_.distances.back().distance;
    const auto reached = [&](double distance) { return of(At(distance, grid)) >= limit; };
    const bool at_first = reached(below);
    if (reached(above) == at_first) return std::nullopt;
    for (int i = 0; i < kSteps; ++i) {
      const double middle = std::sqrt(below * above);
      (reached(middle) == at_first ? below : above) = middle;
    }
    return std::sqrt(below * above);
  }

  void FindLimits() {
    if (!made_.has_depth) return;
    made_.calibration_equals_noise = DistanceWhere(
        1, [](const AccuracyAtDistance& at) { return at.z.calibration / at.z.noise; });
    made_.relative_1_percent =
        DistanceWhere(0.01, [](const AccuracyAtDistance& at) { return at.sigma_z / at.distance; });
    made_.beyond =
        DistanceWhere(1 / kLeastDistance, [](const AccuracyAtDistance& at) { return at.relative; });
  }

  void Add(Finding finding) {
    finding.cameras = made_.cameras;
    made_.findings.push_back(std::move(finding));
  }

  void FindFindings() {
    if (made_.has_depth) FindLargestPart();
    FindScale();
    const double last = made_.distances.back().distance;
    if (made_.has_depth && made_.distances.back().relative > 1 / kLeastDistance) {
      Add({.code = "accuracy_far",
           .grade = Grade::kUsable,
           .what = fmt::format(
               "From {:.3g} m on the inverse distance of a point is less than three of its "
               "standard errors: only a least distance is known there.",
               made_.beyond.value_or(made_.distances.front().distance)),
           .remedy = made_.cameras.size() > 1 ? "Use a longer base or a longer focal length."
                                              : "Use a longer focal length."});
    }
    if (farthest_ > 0 && last > kExtrapolated * farthest_) {
      Add({.code = "accuracy_extrapolated",
           .grade = Grade::kUsable,
           .what = fmt::format(
               "The farthest marker was {:.3g} m away: figures beyond {:.3g} m rest on the "
               "camera model alone.",
               farthest_,
               kExtrapolated * farthest_),
           .remedy = "Record the target farther away, or check a known length there "
                     "(plenocal triangulate --length)."});
    }
    const bool has_pattern = Has("residual_pattern");
    if (has_pattern || Has("points_share_errors")) {
      Add({.code = "accuracy_model",
           .grade = Grade::kUsable,
           .what =
               has_pattern
                   ? "The calibration has the finding residual_pattern: the camera model leaves "
                     "errors that no standard error contains, so that all figures are lower "
                     "bounds."
                   : "The calibration has the finding points_share_errors. Its standard errors "
                     "are scaled for that; if points to be measured share errors as well, "
                     "their noise is a lower bound.",
           .remedy = has_pattern ? "Try other camera models: plenocal try."
                                 : "See the calibration's verdict."});
    }
    if (calibration_.jitter) {
      Add({.code = "accuracy_not_rigid",
           .grade = Grade::kUsable,
           .what = fmt::format(
               "The cameras do not see the same instant, or their mounts move: {:.2g} mm of "
               "each coordinate, which are in the figures.",
               1e3 * calibration_.jitter->translation_sigma),
           .remedy =
               "Trigger the cameras together and stiffen their mounts; hold still what is measured."});
    }
  }

  [[nodiscard]] bool Has(std::string_view code) const {
    const auto is = [&](const Finding& finding) { return finding.code == code; };
    return std::ranges::any_of(calibration_.findings, is) ||
           (calibration_.verdict && std::ranges::any_of(calibration_.verdict->findings, is));
  }

  void FindScale() {
    const AccuracyAtDistance at = AtFarthestMarker();
    const ErrorBudget& budget = made_.has_depth ? at.z : at.lateral;
    if (!(budget.scale > budget.Sigma() / std::sqrt(2))) return;
    Add({.code = "accuracy_scale",
         .grade = Grade::kUsable,
         .what = fmt::format("The size of the target is known to {:.2g} %, and so are all lengths; "
                             "at {:.3g} m that makes more than half of the variance.",
                             1e2 * scale_sigma_,
                             at.distance),
         .remedy = "Measure a length on the target and state it in the session (distances)."});
  }

  // To which the calibration is known to hold.
  [[nodiscard]] AccuracyAtDistance AtFarthestMarker() const {
    return At(farthest_ > 0 ? farthest_ : made_.distances.front().distance, made_.grid);
  }

  void FindLargestPart() {
    const AccuracyAtDistance at = AtFarthestMarker();
    const double half = at.sigma_z * at.sigma_z / 2;
    const auto words = [&](double part, const char* by) {
      return fmt::format("At {:.3g} m sigma of z is {} mm, of which {} makes {} mm.",
                         at.distance,
                         MillimetresText(at.sigma_z),
                         by,
                         MillimetresText(part));
    };
    if (at.z.noise * at.z.noise > half) {
      constexpr double kMostAveraged = 1e4;  // nobody records more of one pose
      const double frames = std::ceil(std::pow(at.z.noise / at.z.calibration, 2));
      Add({.code = "accuracy_noise",
           .grade = Grade::kGood,
           .what = words(at.z.noise, "noise"),
           .remedy = fmt::format(
               "Average frames of what is at rest{}. Or {}.",
               frames <= kMostAveraged
                   ? fmt::format(": {:.0f} bring noise down to the share of the calibration",
                                 frames)
                   : "",
               made_.cameras.size() > 1 ? "use a longer base" : "come nearer")});
    } else if (at.z.calibration * at.z.calibration > half) {
      Add({.code = "accuracy_calibration",
           .grade = Grade::kGood,
           .what = words(at.z.calibration, "the calibration"),
           .remedy = fmt::format(
               "Four times as many frames of the target halve it. 'plenocal suggest --goal "
               "depth@{:.2g}m' names the views that lower it most.",
               at.distance)});
    }
  }

  const CalibrationRecord& calibration_;
  const AccuracyOptions& options_;
  SpaceRig rig_;
  PointsBeforeImage points_;
  double nearest_ = std::numeric_limits<double>::infinity(), farthest_ = 0;
  double scale_sigma_ = 0;  // of the target's size
  Eigen::MatrixXd C_;
  std::vector<Eigen::MatrixXd> C_if_known_;
  RigAccuracy made_;
};

}  // namespace

double ErrorBudget::Sigma() const {
  return std::sqrt(noise * noise + calibration * calibration + scale * scale + jitter * jitter);
}

RigAccuracy PredictAccuracy(const CalibrationRecord& calibration,
                            const std::vector<std::string>& names,
                            const std::vector<MicroLensVisibility>& lenses,
                            const AccuracyOptions& options) {
  return Predictor(calibration, names, lenses, options).Make();
}

std::vector<std::vector<std::string>> CameraSets(const CalibrationRecord& calibration) {
  std::vector<std::string> all, ordinary;
  std::vector<std::vector<std::string>> sets;
  for (const CalibratedCamera& camera : calibration.cameras) {
    all.push_back(camera.name);
    if (!camera.model->plenoptic) ordinary.push_back(camera.name);
  }
  for (size_t i = 0; i < ordinary.size(); ++i) {
    for (size_t j = i + 1; j < ordinary.size(); ++j) sets.push_back({ordinary[i], ordinary[j]});
  }
  for (const CalibratedCamera& camera : calibration.cameras) {
    if (camera.model->plenoptic) sets.push_back({camera.name});
  }
  if (std::ranges::find(sets, all) == sets.end()) sets.push_back(all);
  return sets;
}

std::string MillimetresText(double metres) {
  const double mm = 1e3 * metres;
  return std::abs(mm) < 100 ? fmt::format("{:.2g}", mm) : fmt::format("{:.0f}", TwoDigits(mm));
}

std::string CamerasText(const std::vector<std::string>& cameras) {
  return fmt::format("{}", fmt::join(cameras, " + "));
}

}  // namespace plenocal
