// SPDX-License-Identifier: Apache-2.0
#include "models/start/plenoptic_points.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <utility>

#include "calib/base/statistics.h"
#include "calib/camera/lens_lattice.h"
#include "calib/noise/replicate_noise.h"

namespace plenocal {
namespace {

using Eigen::Vector2d;

Vector2d Point(const Observation& seen) { return {seen.values[0], seen.values[1]}; }
Vector2d CentreOf(const Observation& seen) { return {seen.values[2], seen.values[3]}; }

/// Point and centre of an observation by a template of the right depth. x + s_t (1 - v_t / v) is
/// affine in c with 1 - 1 / v, s_t being the change of x with ln v_t; so are x + s_t (1 - v_t) and
/// c - s_t v_t, in which v does not stand.
struct AtRightDepth {
  Vector2d point, centre;

  explicit AtRightDepth(const Observation& seen) : point(Point(seen)), centre(CentreOf(seen)) {
    const double v_t = seen.values[4];
    if (v_t == 0) return;
    const Vector2d by_log_depth(seen.values[5], seen.values[6]);
    point += (1 - v_t) * by_log_depth;
    centre -= v_t * by_log_depth;
  }
};

using Types = std::map<std::pair<double, double>, int>;  // by micro-image centre

/// Basis of the hexagonal lattice on which most points have a neighbour; points by ascending x.
std::optional<Eigen::Matrix2d> BasisFromPairs(const std::vector<Vector2d>& points) {
  std::vector<Vector2d> to_nearest;
  std::vector<double> distances;
  for (size_t i = 0; i < points.size(); ++i) {
    double best = std::numeric_limits<double>::infinity();
    Vector2d vector(0, 0);
    const auto look_at = [&](size_t k) {
      const Vector2d d = points[k] - points[i];
      if (d.x() * d.x() > best) return false;
      if (d.squaredNorm() < best) {
        best = d.squaredNorm();
        vector = d;
      }
      return true;
    };
    for (size_t k = i; k-- > 0 && look_at(k);) {
    }
    for (size_t k = i + 1; k < points.size() && look_at(k); ++k) {
    }
    to_nearest.push_back(vector);
    distances.push_back(vector.norm());
  }
  constexpr size_t kFewest = 100;  // a lattice, not some points in a row
  if (points.size() < kFewest) return std::nullopt;
  const double pitch = Median(distances);
  // Six directions 60 degrees apart are one in the sixth power.
  constexpr double kSame = 0.1, kAligned = 0.9;
  std::complex<double> sum = 0;
  double count = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    if (std::abs(distances[i] / pitch - 1) > kSame) continue;
    sum += std::polar(1.0, 6 * std::atan2(to_nearest[i].y(), to_nearest[i].x()));
    ++count;
  }
  if (!(std::abs(sum) > kAligned * count)) return std::nullopt;
  const double angle = std::arg(sum) / 6, next = angle + std::numbers::pi / 3;
  Eigen::Matrix2d basis;
  basis << std::cos(angle), std::cos(next), std::sin(angle), std::sin(next);
  return pitch * basis;
}

/// The interleaved set of each micro lens that was looked through; nothing when they are no
/// lattice. Markers show islands of micro lenses, so each is counted from the nearest one whose
/// place is known, in the order of these distances (Prim's tree).
std::optional<Types> ColourLenses(const std::vector<View>& views) {
  Types types;
  for (const View& view : views) {
    for (const Observation& seen : view.observations) types[{seen.values[2], seen.values[3]}] = 0;
  }
  struct Lens {
    Vector2d centre;
    int* type;
    LatticeNode node = {};
    double distance = std::numeric_limits<double>::infinity();  // squared, to the nearest known one
    const Lens* nearest = nullptr;
  };
  std::vector<Lens> lenses;
  std::vector<Vector2d> centres;
  for (auto& [centre, type] : types) {
    centres.emplace_back(centre.first, centre.second);
    lenses.push_back({centres.back(), &type});
  }
  const auto basis = BasisFromPairs(centres);
  if (!basis) return std::nullopt;
  const Eigen::Matrix2d to_nodes = basis->inverse();
  // The first `known` lenses are; they are moved by no later step.
  for (size_t known = 0; known < lenses.size(); ++known) {
    const auto next =
        std::min_element(lenses.begin() + static_cast<std::ptrdiff_t>(known),
                         lenses.end(),
                         [](const Lens& a, const Lens& b) { return a.distance < b.distance; });
    std::iter_swap(lenses.begin() + static_cast<std::ptrdiff_t>(known), next);
    Lens& lens = lenses[known];
    if (lens.nearest != nullptr) {
      constexpr double kOff = 0.25;  // of a pitch
      const Vector2d steps = to_nodes * (lens.centre - lens.nearest->centre);
      const Vector2d whole = steps.array().round();
      if (!((steps - whole).cwiseAbs().maxCoeff() < kOff)) return std::nullopt;
      lens.node = {lens.nearest->node.column + static_cast<int>(whole.x()),
                   lens.nearest->node.row + static_cast<int>(whole.y())};
    }
    *lens.type = kThreeInterleaved.Set(lens.node);
    for (size_t i = known + 1; i < lenses.size(); ++i) {
      const double distance = (lenses[i].centre - lens.centre).squaredNorm();
      if (distance >= lenses[i].distance) continue;
      lenses[i].distance = distance;
      lenses[i].nearest = &lens;
    }
  }
  return types;
}

}  // namespace

void FitMicroImages(std::span<const Observation* const> of_marker,
                    std::span<const double> weights,
                    ReplicateResidual* residuals) {
  double sum = 0;
  Vector2d mean_x(0, 0), mean_c(0, 0);
  std::vector<AtRightDepth> seen;
  seen.reserve(of_marker.size());
  for (size_t i = 0; i < of_marker.size(); ++i) {
    seen.emplace_back(*of_marker[i]);
    sum += weights[i];
    mean_x += weights[i] * seen[i].point;
    mean_c += weights[i] * seen[i].centre;
  }
  mean_x /= sum;
  mean_c /= sum;
  double spread = 0, product = 0;
  for (size_t i = 0; i < of_marker.size(); ++i) {
    const Vector2d c = seen[i].centre - mean_c;
    spread += weights[i] * c.squaredNorm();
    product += weights[i] * c.dot(seen[i].point - mean_x);
  }
  if (!(spread > 0)) {
    std::fill_n(residuals, of_marker.size(), ReplicateResidual{});
    return;
  }
  const double s = product / spread;
  for (size_t i = 0; i < of_marker.size(); ++i) {
    const Vector2d c = seen[i].centre - mean_c;
    residuals[i] = {(seen[i].point - mean_x - s * c).squaredNorm(),
                    2 - 2 * weights[i] / sum - weights[i] * c.squaredNorm() / spread};
  }
}

Eigen::MatrixXd ThirdOrderOfMicroImages(const Vector2d& principal_point,
                                        std::span<const Observation* const> of_marker) {
  const auto n = static_cast<Eigen::Index>(of_marker.size());
  Eigen::MatrixXd rows(2 * n, 5), of_fit = Eigen::MatrixXd::Zero(2 * n, 3);  // by u_0 and s
  std::vector<AtRightDepth> seen;
  for (Eigen::Index i = 0; i < n; ++i) {
    const AtRightDepth& at = seen.emplace_back(*of_marker[static_cast<size_t>(i)]);
    rows.col(0).segment<2>(2 * i) = at.point;
    of_fit.middleRows<2>(2 * i) << 1, 0, at.centre.x(), 0, 1, at.centre.y();
  }
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> fit(of_fit);
  if (fit.rank() < of_fit.cols()) return {};
  const Eigen::VectorXd fitted = of_fit * fit.solve(rows.col(0));
  for (Eigen::Index i = 0; i < n; ++i) {
    const Vector2d centre = CentreOf(*of_marker[static_cast<size_t>(i)]);
    const auto& [point, at_centre] = seen[static_cast<size_t>(i)];
    const Vector2d by_depth = Point(*of_marker[static_cast<size_t>(i)]) - point;
    rows.block<2, 4>(2 * i, 1) =
        ThirdOrderTerms(centre - principal_point, fitted.segment<2>(2 * i) + by_depth - centre);
  }
  return rows - of_fit * fit.solve(rows);
}

void FindLensTypes(std::vector<View>* views) {
  const auto types = ColourLenses(*views);
  if (!types) return;
  const auto assign = [&](const auto& type_of) {
    for (View& view : *views) {
      for (Observation& seen : view.observations) seen.lens_type = type_of(seen);
    }
  };
  assign([&](const Observation& seen) { return types->at({seen.values[2], seen.values[3]}); });
  std::vector<Replicates> replicates;
  for (const View& view : *views) AddReplicates(view.observations, &replicates);
  const std::map<int, LensTypeNoise> noise = NoiseByLensType(replicates, &FitMicroImages);
  // Five standard deviations of log(sigma) apart.
  constexpr double kApart = 5;
  for (const auto& [type, a] : noise) {
    for (const auto& [other, b] : noise) {
      const double sigma = std::sqrt((1 / a.redundancy + 1 / b.redundancy) / 2);
      if (std::log(a.sigma / b.sigma) > kApart * sigma) return;
    }
  }
  assign([](const Observation&) { return 0; });
}

std::string PlenopticRemedy(std::span<const size_t> weak,
                            size_t pupil,
                            std::optional<size_t> tilt,
                            const DepthRange& seen) {
  enum { kFocal, kCentreX = 3, kA0 = 5, kB0 = 7, kOthers = 9 };
  const auto any = [&](size_t from, size_t to) {
    return std::any_of(weak.begin(), weak.end(), [&](size_t k) { return k >= from && k < to; });
  };
  std::string text;
  const auto add = [&](const std::string& sentence) {
    text += (text.empty() ? "" : " ") + sentence;
  };
  if (any(kFocal, kCentreX) || any(pupil, pupil + 1)) {
    // A depth range of three to one moves the virtual depth by as much as these cameras' range.
    const double middle = std::sqrt(seen.nearest * seen.farthest);
    const double near = std::min(seen.nearest, middle / std::sqrt(3));
    const double far = std::max(seen.farthest, middle * std::sqrt(3));
    add(
        fmt::format("f_L, b_L0 and B follow from how the virtual depth changes with distance, and "
                    "the target was seen from {:.2g} to {:.2g} m only: ",
                    seen.nearest,
                    seen.farthest));
    if (far > 1.2 * seen.farthest || near < seen.nearest / 1.2) {
      text += fmt::format("add views between {:.2g} and {:.2g} m, tilted ones too,", near, far);
    } else {
      text += "add tilted views and views at both ends of that range,";
    }
    text += " or hold f_L from the data sheet (initial: {f_L: ...}, fixed: [f_L]).";
  }
  if (any(kB0, kOthers)) {
    add("The tangential terms B_0, B_1 trade against the principal point and the target's tilt: "
        "add views tilted by 30 degrees or more about both axes, or hold them (fixed: [B_0, "
        "B_1]).");
  } else if (any(kCentreX, kA0)) {
    add("The principal point trades against the target's tilt: add views tilted by 30 degrees or "
        "more about both axes and some turned by 90 degrees.");
  }
  if (any(kA0, kB0)) {
    add("The radial terms A_0, A_1 need points over the whole image: add views with the target "
        "in each corner, or hold A_1 (fixed: [A_1]).");
  }
  if (tilt && any(*tilt, *tilt + 2)) {
    add("The array's tilt t_x, t_y changes B over the image: add near and far views with the target "
        "in each corner, or hold it (fixed: [t_x, t_y]).");
  }
  return text;
}

}  // namespace plenocal
