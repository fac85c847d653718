// SPDX-License-Identifier: Apache-2.0
#include "models/start/central_start.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "calib/base/linear_algebra.h"
#include "calib/camera/ray_fit.h"

namespace plenocal {
namespace {

constexpr int kProfileTerms = 3;  // a_0, a_2, a_4
using Profile = Eigen::Vector3d;

// Image points are divided by half the image's diagonal, so that rho is about 1 in the corners.
struct AlignedView {
  std::vector<double> rho;     // distance from the image centre
  std::vector<double> radial;  // distance from the axis in the camera frame, in the target's unit
  std::vector<double> zeta;    // camera z without t_z, for the first sign of the tilt
  bool mirrored = false;       // the other sign of the tilt fits better
  bool ambiguous = false;      // a plane: the sign of the tilt is not known from alignment
  double t_z = 0;

  [[nodiscard]] double Zeta(size_t i) const { return mirrored ? -zeta[i] : zeta[i]; }
};

double Evaluate(const Profile& a, double rho) {
  const double s = rho * rho;
  return a[0] + s * (a[1] + s * a[2]);
}

// Null vector of the rows, with columns scaled to equal size first.
Eigen::VectorXd NullVector(const Eigen::MatrixXd& A) {
  const Eigen::VectorXd scale = A.colwise().norm().cwiseMax(std::numeric_limits<double>::min());
  const Eigen::MatrixXd scaled = A * scale.cwiseInverse().asDiagonal();
  const Eigen::MatrixXd square = scaled.transpose() * scaled;
  return scale.cwiseInverse().asDiagonal() * DecomposeSymmetric(square).vectors.col(0);
}

using TwoRows = Eigen::Matrix<double, 2, 3>;

// Scales the first two rows of a rotation, of which the third column is unknown, and the
// translation to their size; returns the first two elements of the third row.
std::optional<Eigen::Vector3d> CompletePlane(TwoRows* R, Eigen::Vector2d* t) {
  // Columns of the rotation have unit length and are orthogonal: with A, B, C their known parts,
  // (w - A)(w - B) = C^2 for the squared scale w.
  const double a = R->col(0).squaredNorm(), b = R->col(1).squaredNorm();
  const double c = R->col(0).dot(R->col(1));
  const double w = (a + b + std::hypot(a - b, 2 * c)) / 2;
  if (!(w > 0)) return std::nullopt;
  *R /= std::sqrt(w);
  *t /= std::sqrt(w);
  const double r31 = std::sqrt(std::max(0.0, 1 - a / w));
  const double r32 = std::sqrt(std::max(0.0, 1 - b / w)) * (c > 0 ? -1 : 1);
  return Eigen::Vector3d(r31, r32, 0);
}

// The same for two whole rows; returns the third.
std::optional<Eigen::Vector3d> CompleteSpace(TwoRows* R, Eigen::Vector2d* t) {
  const double scale = (R->row(0).norm() + R->row(1).norm()) / 2;
  if (!(scale > 0)) return std::nullopt;
  *R /= scale;
  *t /= scale;
  return Eigen::Vector3d(R->row(0)).cross(Eigen::Vector3d(R->row(1)));
}

std::optional<AlignedView> Align(const std::vector<Eigen::Vector2d>& image,
                                 const std::vector<Eigen::Vector3d>& points) {
  const auto n = static_cast<Eigen::Index>(points.size());
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const auto& p : points) centre += p;
  centre /= static_cast<double>(n);
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const auto& p : points) scatter += (p - centre) * (p - centre).transpose();
  const SymmetricEigen3 eigen = DecomposeSymmetric(scatter);
  Eigen::Matrix3d axes = eigen.vectors.rowwise().reverse();
  if (axes.determinant() < 0) axes.col(2) *= -1;
  const Eigen::Vector3d extent = eigen.values.reverse().cwiseMax(0).cwiseSqrt();
  constexpr double kFlat = 0.05;  // thickness over width below which the points count as a plane
  const bool flat = extent[2] < kFlat * extent[1];
  const int per_row = flat ? 3 : 4;
  if (n < 2 * per_row || !(extent[1] > 1e-3 * extent[0])) return std::nullopt;

  // u (r_2 p + t_y) - v (r_1 p + t_x) = 0
  Eigen::MatrixXd A(n, 2 * per_row);
  std::vector<Eigen::Vector3d> local(points.size());
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto k = static_cast<size_t>(i);
    local[k] = axes.transpose() * (points[k] - centre);
    Eigen::VectorXd q(per_row);
    q.head(per_row - 1) = local[k].head(per_row - 1);
    q[per_row - 1] = 1;
    A.row(i).head(per_row) = -image[k].y() * q;
    A.row(i).tail(per_row) = image[k].x() * q;
  }
  const Eigen::VectorXd h = NullVector(A);
  TwoRows R = TwoRows::Zero();
  R.row(0).head(per_row - 1) = h.head(per_row - 1);
  R.row(1).head(per_row - 1) = h.segment(per_row, per_row - 1);
  Eigen::Vector2d t(h[per_row - 1], h[2 * per_row - 1]);

  const std::optional<Eigen::Vector3d> row3 = flat ? CompletePlane(&R, &t) : CompleteSpace(&R, &t);
  if (!row3) return std::nullopt;

  AlignedView view;
  view.ambiguous = flat;
  // The sign of (r_1, r_2, t) is open, but neither lengths nor r_3 = r_1 x r_2 depend on it.
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto k = static_cast<size_t>(i);
    const Eigen::Vector2d p = R * local[k] + t;
    view.rho.push_back(image[k].norm());
    view.radial.push_back(p.norm());
    view.zeta.push_back(row3->dot(local[k]));
  }
  return view;
}

// Least squares for t_z of one view when F is known, and its residual relative to the depth.
double SolveDistance(const Profile& a, bool mirrored, AlignedView* view) {
  view->mirrored = mirrored;
  double weight_depth = 1;
  double error = 0;
  // Twice: the second time the residuals are divided by depth, which makes them image distances.
  for (int pass = 0; pass < 2; ++pass) {
    double num = 0, den = 0;
    for (size_t i = 0; i < view->rho.size(); ++i) {
      const double weight = pass == 0 ? 1 : 1 / std::max(1e-6, weight_depth + view->Zeta(i));
      const double rhs = Evaluate(a, view->rho[i]) * view->radial[i] - view->rho[i] * view->Zeta(i);
      num += weight * weight * view->rho[i] * rhs;
      den += weight * weight * view->rho[i] * view->rho[i];
    }
    view->t_z = den > 0 ? num / den : 0;
    weight_depth = view->t_z;
  }
  for (size_t i = 0; i < view->rho.size(); ++i) {
    const double z = view->Zeta(i) + view->t_z;
    const double F = Evaluate(a, view->rho[i]);
    // Compare angles: finite for all directions, also at and beyond 90 degrees.
    const double difference = std::atan2(view->rho[i], F) - std::atan2(view->radial[i], z);
    error += difference * difference;
  }
  return error;
}

// Chooses each plane's sign of the tilt and its t_z under F; returns the sum of squared angles.
double SolveDistances(const Profile& a, std::vector<AlignedView>* views) {
  double sum = 0;
  for (AlignedView& view : *views) {
    double error = SolveDistance(a, false, &view);
    if (view.ambiguous) {
      const double mirrored = SolveDistance(a, true, &view);
      if (mirrored < error) {
        error = mirrored;
      } else {
        SolveDistance(a, false, &view);
      }
    }
    sum += error;
  }
  return sum;
}

// F and all t_z together for the present signs of the tilts:
// F(rho) radial - rho t_z = rho zeta, each row divided by its present depth.
std::optional<Profile> SolveProfile(const std::vector<AlignedView>& views, int terms) {
  Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
  Eigen::Vector3d g = Eigen::Vector3d::Zero();
  for (const AlignedView& view : views) {
    Eigen::Vector3d cross = Eigen::Vector3d::Zero();
    double t_square = 0, t_rhs = 0;
    for (size_t i = 0; i < view.rho.size(); ++i) {
      const double rho = view.rho[i], s = rho * rho;
      const double weight = 1 / std::max(1e-6, std::abs(view.Zeta(i) + view.t_z));
      const Eigen::Vector3d row = weight * view.radial[i] * Eigen::Vector3d(1, s, s * s);
      const double t_column = -weight * rho, rhs = weight * rho * view.Zeta(i);
      H += row * row.transpose();
      g += row * rhs;
      cross += row * t_column;
      t_square += t_column * t_column;
      t_rhs += t_column * rhs;
    }
    H -= cross * cross.transpose() / t_square;
    g -= cross * t_rhs / t_square;
  }
  Profile a = Profile::Zero();
  a.head(terms) = SolveSymmetric(Eigen::MatrixXd(H.topLeftCorner(terms, terms)),
                                 Eigen::VectorXd(g.head(terms)));
  if (!a.allFinite() || !(a[0] > 0)) return std::nullopt;
  return a;
}

// Image points with the directions in which a first guess sees them.
struct Directions {
  std::vector<Eigen::Vector3d> directions;
  const std::vector<Eigen::Vector2d>& image;  // px
};

// Parameters near `params` that image the directions at their points; the user's initial values and
// those of `options.fixed` stay.
std::vector<double> FitToDirections(const CameraModel& model,
                                    const StartProblem& problem,
                                    std::vector<double> params,
                                    const Directions& seen,
                                    RayFitOptions options) {
  for (size_t i = 0; i < params.size(); ++i) {
    if (!problem.given[i]) continue;
    params[i] = *problem.given[i];
    options.fixed.push_back(static_cast<int>(i));
  }
  FitToRays(model, problem.config, seen.directions, seen.image, options, &params);
  return params;
}

// The views' points in an image of unit half-diagonal about its centre.
class CentredImage {
 public:
  explicit CentredImage(const ImageSize& size)
      : centre_((size[0] - 1) / 2.0, (size[1] - 1) / 2.0),
        half_diagonal_(std::max(1.0, centre_.norm())) {}

  [[nodiscard]] const Eigen::Vector2d& Centre() const { return centre_; }
  [[nodiscard]] double HalfDiagonal() const { return half_diagonal_; }
  [[nodiscard]] Eigen::Vector2d Scaled(const Eigen::Vector2d& u) const {
    return (u - centre_) / half_diagonal_;
  }

 private:
  Eigen::Vector2d centre_;
  double half_diagonal_;
};

struct ImagePoints {
  std::vector<AlignedView> aligned;
  std::vector<Eigen::Vector2d>
      sample;  // px; a spread of the points: more add time, not information
};

ImagePoints CollectPoints(const StartProblem& problem, const CentredImage& centred) {
  constexpr size_t kFitPoints = 500;
  ImagePoints points;
  std::vector<Eigen::Vector2d> all;
  for (const View& view : problem.views) {
    std::vector<Eigen::Vector2d> image;
    std::vector<Eigen::Vector3d> in_target;
    for (const Observation& observation : view.observations) {
      const auto marker = problem.markers->find(observation.marker);
      if (marker == problem.markers->end()) continue;
      const Eigen::Vector2d u(observation.values[0], observation.values[1]);
      all.push_back(u);
      image.push_back(centred.Scaled(u));
      in_target.push_back(marker->second);
    }
    if (auto aligned = Align(image, in_target)) points.aligned.push_back(std::move(*aligned));
  }
  const size_t stride = all.size() / kFitPoints + 1;
  for (size_t i = 0; i < all.size(); i += stride) points.sample.push_back(all[i]);
  return points;
}

// Parameters with limits, at which a fit may end and from where no step leads back.
std::vector<int> ConfinedParams(const CameraModel& model) {
  std::vector<int> confined;
  for (size_t i = 0; i < model.params.size(); ++i) {
    const Param& param = model.params[i];
    if (param.neutral && (std::isfinite(param.lower) || std::isfinite(param.upper))) {
      confined.push_back(static_cast<int>(i));
    }
  }
  return confined;
}

Profile PlainProfile(double half_fov_deg) {
  return {1 / std::tan(half_fov_deg * std::numbers::pi / 180), 0, 0};
}

// The best of a ladder of half fields of view from 3 to 75 degrees to the image's corner.
Profile BestPlainProfile(std::vector<AlignedView>* aligned) {
  Profile best = Profile::Zero();
  double best_error = std::numeric_limits<double>::infinity();
  for (double half_fov_deg = 3; half_fov_deg <= 75; half_fov_deg *= 1.15) {
    const Profile plain = PlainProfile(half_fov_deg);
    const double error = SolveDistances(plain, aligned);
    if (error < best_error) {
      best_error = error;
      best = plain;
    }
  }
  return best;
}

// Alternates between the tilts' signs with distances and the profile, from few terms to all.
Profile RefineProfile(Profile a, std::vector<AlignedView>* aligned) {
  for (const int terms : {1, 2, kProfileTerms, kProfileTerms}) {
    SolveDistances(a, aligned);
    const std::optional<Profile> next = SolveProfile(*aligned, terms);
    if (!next) break;
    a = *next;
  }
  return a;
}

}  // namespace

std::vector<StartCandidate> StartCentral(const CameraModel& model,
                                         const StartProblem& problem,
                                         const CamerasNearAxis& near_axis) {
  const CentredImage centred(problem.image_size);
  ImagePoints points = CollectPoints(problem, centred);
  if (points.sample.empty()) return {};
  const std::vector<int> confined = ConfinedParams(model);

  std::vector<StartCandidate> candidates;
  const auto add = [&](const Profile& a) {
    Directions seen{{}, points.sample};
    seen.directions.reserve(points.sample.size());
    for (const auto& u : points.sample) {
      const Eigen::Vector2d q = centred.Scaled(u);
      seen.directions.push_back(Eigen::Vector3d(q.x(), q.y(), Evaluate(a, q.norm())).normalized());
    }
    const auto fit = [&](std::vector<double> params, const RayFitOptions& options) {
      return FitToDirections(model, problem, std::move(params), seen, options);
    };
    for (const std::vector<double>& plain :
         near_axis(a[0] * centred.HalfDiagonal(), centred.Centre().x(), centred.Centre().y())) {
      // Long lenses pass through parameters out of bounds, wide ones may stay there.
      auto params = fit(plain, {});
      if (!WithinBounds(model, params.data())) params = fit(plain, {.within_bounds = true});
      candidates.push_back({std::move(params)});
      if (confined.empty()) continue;
      params = fit(plain, {.fixed = confined, .within_bounds = true});
      candidates.push_back({params});
      candidates.push_back({fit(std::move(params), {.within_bounds = true})});
    }
  };
  if (!points.aligned.empty()) {
    const Profile best_plain = BestPlainProfile(&points.aligned);
    add(RefineProfile(best_plain, &points.aligned));
    add(best_plain);
  }
  // Without a view good enough for alignment: ordinary, wide and long lenses.
  for (const double half_fov_deg : {35.0, 60.0, 10.0}) add(PlainProfile(half_fov_deg));
  return candidates;
}

std::vector<StartCandidate> StartLens(const CameraModel& model,
                                      const StartProblem& problem,
                                      const std::vector<std::vector<double>>& lenses) {
  return StartCentral(model, problem, [&](double f, double c_x, double c_y) {
    constexpr double kNearAxis = 1e-6;
    std::vector<std::vector<double>> cameras;
    for (const std::vector<double>& lens : lenses) {
      std::vector<double> camera{1, 1, 0, 0};
      camera.insert(camera.end(), lens.begin(), lens.end());
      double m[2] = {};
      if (!model.Project(camera.data(), nullptr, nullptr, {kNearAxis, 0, 1}, m)) continue;
      camera[0] = camera[1] = f * kNearAxis / m[0];
      camera[2] = c_x;
      camera[3] = c_y;
      cameras.push_back(std::move(camera));
    }
    return cameras;
  });
}

}  // namespace plenocal
