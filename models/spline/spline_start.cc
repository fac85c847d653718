// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numbers>

#include "calib/base/linear_algebra.h"
#include "models/kannala_brandt4.h"
#include "models/splined.h"

namespace plenocal {
namespace {

// Image points with their stereographic coordinates u.
struct SeenPoints {
  std::vector<Eigen::Vector2d> pixels, u;
};

std::optional<Eigen::Vector2d> SeenBy(const double* fisheye, const Eigen::Vector2d& pixel) {
  const auto ray = KannalaBrandt4::Unproject(fisheye, pixel);
  Eigen::Vector2d u;
  if (!ray || !ProjectStereographic(*ray, &u)) return std::nullopt;
  return u;
}

SeenPoints PointsSeenBy(const double* fisheye, const StartProblem& problem) {
  SeenPoints points;
  for (const View& view : problem.views) {
    for (const Observation& seen : view.observations) {
      const Eigen::Vector2d pixel(seen.values[0], seen.values[1]);
      if (const auto u = SeenBy(fisheye, pixel)) {
        points.pixels.push_back(pixel);
        points.u.push_back(*u);
      }
    }
  }
  return points;
}

// f and c of the nearest stereographic lens.
void SetNearestStereographic(const SeenPoints& points,
                             const double* fisheye,
                             const StartProblem& problem,
                             std::vector<double>* params) {
  const auto n = static_cast<double>(points.pixels.size());
  for (Eigen::Index r = 0; r < 2; ++r) {
    double su = 0, sq = 0, suu = 0, suq = 0;
    for (size_t i = 0; i < points.pixels.size(); ++i) {
      const double u = points.u[i][r], q = points.pixels[i][r];
      su += u;
      sq += q;
      suu += u * u;
      suq += u * q;
    }
    const double f = (n * suq - su * sq) / (n * suu - su * su);
    const auto k = static_cast<size_t>(r);
    const bool found = f > 0 && std::isfinite(f);
    double& f_k = (*params)[k];
    f_k = problem.given[k].value_or(found ? f : fisheye[k]);
    (*params)[2 + k] = problem.given[2 + k].value_or(found ? (sq - f_k * su) / n : fisheye[2 + k]);
  }
}

Eigen::Vector2d Normalised(const std::vector<double>& params, const Eigen::Vector2d& pixel) {
  return {(pixel.x() - params[2]) / params[0], (pixel.y() - params[3]) / params[1]};
}

// Largest |u_x| that the knots must reach, over the image's border; where the fisheye is
// extrapolated it may err.
double BorderEdge(const SplineLens& lens,
                  const double* fisheye,
                  const ImageSize& image_size,
                  const std::vector<double>& params) {
  constexpr int kBorder = 16;
  constexpr double kMostStretch = 1.5;
  const double aspect = static_cast<double>(lens.columns - lens.order) / (lens.rows - lens.order);
  double edge = 0;
  for (int i = 0; i <= kBorder; ++i) {
    const double w = image_size[0] - 1.0, h = image_size[1] - 1.0;
    const double part = static_cast<double>(i) / kBorder;
    for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(part * w, 0),
                                         Eigen::Vector2d(part * w, h),
                                         Eigen::Vector2d(0, part * h),
                                         Eigen::Vector2d(w, part * h)}) {
      const Eigen::Vector2d m = Normalised(params, pixel);
      Eigen::Vector2d u = SeenBy(fisheye, pixel).value_or(m);
      u *= std::min(1.0, kMostStretch * m.norm() / std::max(u.norm(), 1e-9));
      edge = std::max({edge, std::abs(u.x()), std::abs(u.y()) * aspect});
    }
  }
  return edge;
}

// Linear least squares of the knots, with the model's prior.
Eigen::MatrixXd FitKnots(const CameraModel& model,
                         const SeenPoints& points,
                         const std::vector<double>& params) {
  constexpr double kNoise = 1e-3;  // of the points, focal lengths
  const SplineLens& lens = *Splined::LensOf(model);
  const Eigen::Index count = lens.Knots();
  Eigen::MatrixXd H = kNoise * kNoise * Eigen::MatrixXd::Identity(count, count);
  Eigen::MatrixXd g = Eigen::MatrixXd::Zero(count, 2);
  const double unit = model.functions.prior_unit(model, params.data());
  for (const PriorRow& row : model.prior_rows) {
    const double root = kNoise / (row.sigma * unit);
    if (row.indices[0] % 2 == 0) continue;  // y like x
    for (size_t i = 0; i < row.indices.size(); ++i) {
      for (size_t j = 0; j < row.indices.size(); ++j) {
        H(lens.KnotOf(row.indices[i]), lens.KnotOf(row.indices[j])) +=
            root * root * row.weights[i] * row.weights[j];
      }
    }
  }
  std::vector<Eigen::Index> knots;
  Eigen::VectorXd weights((lens.order + 1) * (lens.order + 1));
  for (size_t i = 0; i < points.pixels.size(); ++i) {
    const Eigen::Vector2d place = lens.Place(params[SplineLens::kFov], points.u[i]);
    if (!(std::abs(place.x()) < lens.columns && std::abs(place.y()) < lens.rows)) continue;
    const KnotWeights along = lens.WeightsAt(place.x(), lens.columns),
                      down = lens.WeightsAt(place.y(), lens.rows);
    knots.clear();
    for (int b = 0; b <= lens.order; ++b) {
      for (int a = 0; a <= lens.order; ++a) {
        weights[static_cast<Eigen::Index>(knots.size())] =
            along.weight[static_cast<size_t>(a)] * down.weight[static_cast<size_t>(b)];
        knots.push_back((down.first + b) * lens.columns + along.first + a);
      }
    }
    H(knots, knots) += weights * weights.transpose();
    g(knots, Eigen::all) +=
        weights * (Normalised(params, points.pixels[i]) - points.u[i]).transpose();
  }
  return SolveSymmetric(H, g);
}

// The spline through a fisheye's rays of the points that the views show.
std::vector<double> LikeFisheye(const CameraModel& model,
                                const double* fisheye,
                                const StartProblem& problem) {
  const SplineLens& lens = *Splined::LensOf(model);
  constexpr size_t kFov = SplineLens::kFov;
  const SeenPoints points = PointsSeenBy(fisheye, problem);
  std::vector<double> params(lens.ParamCount(), 0.0);
  SetNearestStereographic(points, fisheye, problem, &params);
  constexpr double kMostFov = 350;
  const double edge = BorderEdge(lens, fisheye, problem.image_size, params);
  const double fov = std::ceil(4 * std::atan(edge / 2) * 180 / std::numbers::pi);
  params[kFov] = problem.given[kFov].value_or(std::clamp(fov, 1.0, kMostFov));
  const Eigen::MatrixXd spline = FitKnots(model, points, params);
  size_t k = SplineLens::kFirstKnot;
  for (int knot = 0; knot < lens.Knots(); ++knot) {
    for (int axis = 0; axis < 2; ++axis, ++k) {
      params[k] = problem.given[k].value_or(spline(knot, axis));
    }
  }
  return params;
}

}  // namespace

std::vector<StartCandidate> StartSpline(const CameraModel& model, const StartProblem& problem) {
  const CameraModel fisheye = MakeCameraModel<KannalaBrandt4>();
  const std::vector<std::optional<double>> given(fisheye.params.size());
  StartProblem of_fisheye = problem;
  of_fisheye.given = given;
  std::vector<StartCandidate> candidates;
  for (const StartCandidate& candidate : KannalaBrandt4::Start(of_fisheye)) {
    candidates.push_back({LikeFisheye(model, candidate.params.data(), problem)});
  }
  return candidates;
}

}  // namespace plenocal
