// SPDX-License-Identifier: Apache-2.0
#include "assess/missing/missing_families.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <optional>

#include "assess/causes/view_rows.h"
#include "calib/base/error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

constexpr double kFalseAlarms = 0.05;  // of all families of a camera
constexpr size_t kFewestViews = 4;

// Places of a view's points in the plane of the lens, m = (u - c) / f, divided by `size`, the
// largest |m| of the camera.
using Plane = Eigen::Matrix<double, Eigen::Dynamic, 2>;

struct Family {
  const char* name;
  const char* what;
  std::vector<const char*> models;  // to try: parts ("+tilt") or names; the first that there is
  const char* advice = nullptr;     // in place of a model
  /// Fields, 2 n x q in units of f: rows x, y of each point.
  std::function<Eigen::MatrixXd(const Plane& m)> fields = nullptr;
  /// In place of `fields`: fields that depend on the points in space, in units of the noise.
  Eigen::MatrixXd (*in_space)(const Bundle& bundle, size_t camera, const ViewRows& view) = nullptr;
  /// The radial family (the first), which is commoner and resembles it, is an unknown of its test.
  bool beside_radial = false;
};

// One column each of functions of (x, y), for x and for y.
template <typename Function>
Eigen::MatrixXd FieldsOf(const Plane& m, Eigen::Index count, const Function& function) {
  Eigen::MatrixXd fields(2 * m.rows(), count);
  for (Eigen::Index i = 0; i < m.rows(); ++i) {
    for (Eigen::Index k = 0; k < count; ++k) {
      fields.block<2, 1>(2 * i, k) = function(m(i, 0), m(i, 1), k);
    }
  }
  return fields;
}

// Bend of a flat target: displacements along its normal by x^2, x y, y^2. Of refined markers, and
// of targets that are not flat, none.
Eigen::MatrixXd BoardFields(const Bundle& bundle, size_t /*camera*/, const ViewRows& view) {
  Eigen::Matrix3Xd X(3, std::ssize(bundle.markers));
  for (Eigen::Index m = 0; m < X.cols(); ++m) {
    X.col(m) = bundle.markers[static_cast<size_t>(m)].nominal;
  }
  const Eigen::Vector3d middle = X.rowwise().mean();
  const Eigen::Matrix3Xd about = X.colwise() - middle;
  const SymmetricEigen3 axes = DecomposeSymmetric(Eigen::Matrix3d(about * about.transpose()));
  if (!bundle.marker_freedom.IsHeld() || !(axes.values[0] < 1e-6 * axes.values[1])) return {};
  const Eigen::Vector3d normal = axes.vectors.col(0);
  const Eigen::Matrix<double, 2, 3> along = axes.vectors.rightCols<2>().transpose();
  Eigen::MatrixXd fields(view.residual.size(), 3);
  for (size_t i = 0; i < view.markers.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(2 * i);
    const Eigen::Vector2d x = along * about.col(view.markers[i]);
    fields.middleRows<2>(row) = view.marker.middleRows<2>(row) * normal *
                                Eigen::RowVector3d(x.x() * x.x(), x.x() * x.y(), x.y() * x.y());
  }
  return fields;
}

// Derivatives of a point's place by the camera's parameters and by the point in the camera's frame.
struct PointRows {
  Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor> by_params;
  Eigen::Matrix<double, 2, 3, Eigen::RowMajor> by_point;
  Eigen::Vector3d p;
};

PointRows RowsOfPoint(const Bundle& bundle, size_t camera, const ViewRows& view, size_t i) {
  const BundleCamera& of = bundle.cameras[camera];
  const RigidTransform T =
      of.T_camera_rig * bundle.SeenPose(static_cast<size_t>(view.frame), camera);
  PointRows rows{.by_params = {2, std::ssize(of.params)},
                 .by_point = {},
                 .p = T * bundle.markers[static_cast<size_t>(view.markers[i])].position};
  Eigen::Vector2d u;
  const auto row = static_cast<Eigen::Index>(i);
  const std::array<double, kMaxObservationSize> values{view.position(row, 0),
                                                       view.position(row, 1)};
  of.model->ProjectWithJacobian(
      of.params.data(),
      of.config.data(),
      values.data(),
      rows.p,
      {.predicted = u.data(), .J_params = rows.by_params.data(), .J_point = rows.by_point.data()});
  return rows;
}

// A pupil that moves with the angle: models/parts/pupil.h, e_0 and e_1.
Eigen::MatrixXd PupilFields(const Bundle& bundle, size_t camera, const ViewRows& view) {
  Eigen::MatrixXd fields(view.residual.size(), 2);
  for (size_t i = 0; i < view.markers.size(); ++i) {
    const PointRows rows = RowsOfPoint(bundle, camera, view, i);
    const double r = rows.p.head<2>().norm(), theta = std::atan2(r, rows.p.z());
    const double shift = r > 0 ? theta / std::sin(theta) - 1 : 0;
    const auto row = static_cast<Eigen::Index>(i);
    fields.middleRows<2>(2 * row) =
        rows.by_point.col(2) * Eigen::RowVector2d(shift, shift * theta * theta) / view.noise[row];
  }
  return fields;
}

std::vector<Family> Families() {
  using Vector = Eigen::Vector2d;
  const auto radial = [](const Plane& m) {
    return FieldsOf(m, 6, [](double x, double y, Eigen::Index k) {
      const double q = x * x + y * y;  // at most 1
      return Vector(std::legendre(static_cast<unsigned>(k), 2 * q - 1) * q * Vector(x, y));
    });
  };
  const auto decentring = [](const Plane& m) {
    return FieldsOf(m, 2, [](double x, double y, Eigen::Index k) {
      const double q = x * x + y * y;
      return k == 0 ? Vector(2 * x * y, q + 2 * y * y) : Vector(q + 2 * x * x, 2 * x * y);
    });
  };
  const auto prism = [](const Plane& m) {
    return FieldsOf(m, 4, [](double x, double y, Eigen::Index k) {
      const double q = x * x + y * y, value = k % 2 == 0 ? q : q * q;
      return k < 2 ? Vector(value, 0) : Vector(0, value);
    });
  };
  const auto tilt = [](const Plane& m) {
    return FieldsOf(m, 2, [](double x, double y, Eigen::Index k) {
      return Vector((k == 0 ? x : y) * Vector(x, y));
    });
  };
  const auto skew = [](const Plane& m) {
    return FieldsOf(m, 1, [](double, double y, Eigen::Index) { return Vector(y, 0); });
  };
  const auto local = [](const Plane& m) {
    constexpr unsigned kDegree = 6;
    std::vector<std::pair<unsigned, unsigned>> orders;
    for (unsigned i = 0; i <= kDegree; ++i) {
      for (unsigned j = 0; i + j <= kDegree; ++j) orders.emplace_back(i, j);
    }
    const auto count = static_cast<Eigen::Index>(2 * orders.size());
    return FieldsOf(m, count, [&](double x, double y, Eigen::Index k) {
      const auto [i, j] = orders[static_cast<size_t>(k / 2)];
      const double value = std::legendre(i, x) * std::legendre(j, y);
      return k % 2 == 0 ? Vector(value, 0) : Vector(0, value);
    });
  };
  return {{"radial", "radial terms", {"+radial4", "pinhole-radtan8", "splined"}, nullptr, radial},
          {"decentring",
           "decentring of lenses, a thin prism or a tilt, which differ little",
           {"+decentring", "+tilt", "splined"},
           nullptr,
           decentring},
          {"prism", "a thin prism", {"+prism", "pinhole-radtan12", "splined"}, nullptr, prism},
          {"tilt", "a tilted sensor", {"+tilt", "splined"}, nullptr, tilt},
          {"skew", "skewed axes", {"+skew", "splined"}, nullptr, skew},
          {"pupil",
           "rays without a common origin: a pupil that moves with the angle",
           {"+pupil"},
           nullptr,
           nullptr,
           &PupilFields,
           true},
          {"local", "local distortion", {"splined"}, nullptr, local},
          {"board",
           "a bent target, which is not the lens",
           {},
           "set refine_target, or use a flat target",
           nullptr,
           &BoardFields}};
}

// Of "+part" the camera's model with the part, else the model of that name; of which there is
// none that has the model's own fields already, the next.
std::string ModelToTry(const CameraModel& model, const std::vector<const char*>& candidates) {
  for (const std::string candidate : candidates) {
    if (candidate[0] != '+') {
      const bool is_pinhole = model.name.starts_with("pinhole");
      if (candidate != model.name && (is_pinhole || !candidate.starts_with("pinhole"))) {
        return candidate;
      }
      continue;
    }
    try {
      const std::string name = std::string(model.name) + candidate;
      if (model.functions.with_parts != nullptr && model.functions.with_parts(model, name)) {
        return name;
      }
    } catch (const Error&) {
      continue;  // a parameter twice
    }
  }
  return "";
}

// Inverse of the products of columns of length 1, less directions in which it is rounding alone.
Eigen::MatrixXd InverseOf(const Eigen::MatrixXd& products) {
  constexpr double kRounding = 1e-10;
  const SymmetricEigen axes = DecomposeSymmetric(products);
  const Eigen::VectorXd inverse =
      (axes.values.array() > kRounding).select(axes.values.cwiseInverse(), 0.0);
  return axes.vectors * inverse.asDiagonal() * axes.vectors.transpose();
}

// A family's place among the columns.
struct Columns {
  Eigen::Index first = 0, count = 0;
  [[nodiscard]] auto All() const { return Eigen::seqN(first, count); }
};

// Sums of products of all columns and the residual (last), less the pose of each view.
struct Products {
  std::vector<Eigen::MatrixXd> of_view;
  Eigen::MatrixXd all;
  double rows = 0;               // less six of each view's pose
  double points = 0, noise = 0;  // px, RMS of a coordinate
};

struct Score {
  double square = 0, probability = 1;
  int degrees = 0;
  double variance = 1;  // of residuals that are left
};

class Search {
 public:
  Search(const Calibration& calibration, size_t camera)
      : bundle_(calibration.bundle),
        index_(camera),
        camera_(bundle_.cameras[camera]),
        families_(Families()) {
    const std::vector<ViewRows> views = RowsOfViews(bundle_, camera);
    if (views.size() < kFewestViews || camera_.model->plenoptic) return;
    for (const ViewRows& view : views) Add(view);
    products_.noise = std::sqrt(products_.noise / products_.points);
  }

  std::vector<MissingFamily> Find() {
    std::vector<MissingFamily> found;
    std::vector<size_t> open(families_.size());
    std::iota(open.begin(), open.end(), size_t{0});
    if (products_.of_view.empty()) return found;
    std::vector<Eigen::Index> unknowns(static_cast<size_t>(of_family_[0].first));
    std::iota(unknowns.begin(), unknowns.end(), Eigen::Index{0});
    while (!open.empty()) {
      std::optional<size_t> best;
      Score score;
      for (const size_t k : open) {
        std::vector<Eigen::Index> beside = unknowns;
        if (families_[k].beside_radial && open[0] == 0) Append(of_family_[0], &beside);
        Score of = Test(beside, of_family_[k]);
        of.probability = std::min(1.0, of.probability * static_cast<double>(open.size()));
        if (!(of.probability < kFalseAlarms) || (best && !IsBetter(of, score))) continue;
        best = k;
        score = of;
      }
      if (!best) break;
      found.push_back(Describe(families_[*best], score));
      Append(of_family_[*best], &unknowns);
      std::erase(open, *best);
    }
    return found;
  }

 private:
  // One of fewer fields that explains nearly as much; else the one that explains more for its
  // number of fields, by Schwarz's criterion.
  [[nodiscard]] bool IsBetter(const Score& a, const Score& b) const {
    constexpr double kNearly = 0.9;
    if (a.degrees < b.degrees && a.square > kNearly * b.square) return true;
    if (b.degrees < a.degrees && b.square > kNearly * a.square) return false;
    const auto worth = [&](const Score& of) {
      return of.square / of.variance - of.degrees * std::log(products_.rows);
    };
    return worth(a) > worth(b);
  }

  static void Append(const Columns& columns, std::vector<Eigen::Index>* unknowns) {
    for (Eigen::Index i = 0; i < columns.count; ++i) unknowns->push_back(columns.first + i);
  }

  void Add(const ViewRows& view) {
    const Eigen::Index n = view.noise.size();
    Plane m = view.position;
    const Eigen::Map<const Eigen::RowVector2d> f(camera_.params.data()),
        c(camera_.params.data() + 2);
    m = ((m.rowwise() - c).array().rowwise() / f.array()).matrix();
    const Eigen::Vector2d far =
        (Eigen::Vector2d(camera_.image_size[0], camera_.image_size[1]) - c.transpose())
            .cwiseAbs()
            .cwiseMax(c.transpose().cwiseAbs());
    m /= far.cwiseQuotient(f.transpose()).norm();
    std::vector<Eigen::MatrixXd> parts{ByParams(view)};
    for (const Family& family : families_) {
      if (family.in_space != nullptr) {
        parts.push_back(family.in_space(bundle_, index_, view));
        continue;
      }
      parts.push_back(family.fields(m));
      for (Eigen::Index i = 0; i < 2 * n; ++i) {
        parts.back().row(i) *= f[i % 2] / view.noise[i / 2];
      }
    }
    of_family_.clear();
    Eigen::Index count = parts[0].cols();
    for (size_t k = 1; k < parts.size(); ++k) {
      of_family_.push_back({count, parts[k].cols()});
      count += parts[k].cols();
    }
    Eigen::MatrixXd all(2 * n, count + 1);
    Eigen::Index column = 0;
    for (const Eigen::MatrixXd& part : parts) {
      if (part.size() > 0) all.middleCols(column, part.cols()) = part;
      column += part.cols();
    }
    all.col(count) = view.residual;
    all -= view.pose * LeastSquares(view.pose, all);
    products_.of_view.emplace_back(all.transpose() * all);
    if (products_.all.size() == 0) products_.all = Eigen::MatrixXd::Zero(count + 1, count + 1);
    products_.all += products_.of_view.back();
    products_.rows += static_cast<double>(2 * n - 6);
    products_.points += static_cast<double>(n);
    products_.noise += view.noise.squaredNorm();
  }

  // Derivatives by the camera's free parameters, in units of the noise.
  [[nodiscard]] Eigen::MatrixXd ByParams(const ViewRows& view) const {
    const auto count = static_cast<Eigen::Index>(camera_.model->params.size());
    std::vector<Eigen::Index> free;
    for (Eigen::Index k = 0; k < count; ++k) {
      if (!camera_.fixed[static_cast<size_t>(k)]) free.push_back(k);
    }
    Eigen::MatrixXd by(view.residual.size(), std::ssize(free));
    for (size_t i = 0; i < view.markers.size(); ++i) {
      const auto row = static_cast<Eigen::Index>(i);
      by.middleRows<2>(2 * row) =
          RowsOfPoint(bundle_, index_, view, i).by_params(Eigen::all, free) / view.noise[row];
    }
    return by;
  }

  // Of the fields less what the unknowns replace.
  [[nodiscard]] Score Test(const std::vector<Eigen::Index>& unknowns, const Columns& family) const {
    Score score;
    if (family.count == 0) return score;
    const Eigen::MatrixXd& S = products_.all;
    const Eigen::Index last = S.cols() - 1;
    const Eigen::VectorXd scale = S.diagonal().cwiseSqrt().cwiseMax(1e-300).cwiseInverse();
    const auto scaled = [&](const Eigen::MatrixXd& products) {
      return Eigen::MatrixXd(scale.asDiagonal() * products * scale.asDiagonal());
    };
    const Eigen::MatrixXd R = scaled(S);
    const Eigen::MatrixXd inverse = InverseOf(Eigen::MatrixXd(R(unknowns, unknowns)));
    const Eigen::MatrixXd B = inverse * R(unknowns, family.All());
    const Eigen::VectorXd theta = inverse * R(unknowns, last);
    const SymmetricEigen axes = DecomposeSymmetric(
        Eigen::MatrixXd(R(family.All(), family.All()) - R(family.All(), unknowns) * B));
    constexpr double kReplaced = 1e-4;  // of a field's own length^2; rounding is less
    const Eigen::Index q = (axes.values.array() > kReplaced).count();
    if (q == 0) return score;
    // The score in units of its standard error, and what each view adds to it that the fitted
    // fields do not explain.
    const Eigen::MatrixXd W =
        axes.vectors.rightCols(q) * axes.values.tail(q).cwiseSqrt().cwiseInverse().asDiagonal();
    const auto score_of = [&](const Eigen::MatrixXd& r) -> Eigen::VectorXd {
      return W.transpose() *
             (r(family.All(), last) - r(family.All(), unknowns) * theta -
              B.transpose() * (r(unknowns, last) - r(unknowns, unknowns) * theta)) /
             scale[last];
    };
    const auto information_of = [&](const Eigen::MatrixXd& r) -> Eigen::MatrixXd {
      const Eigen::MatrixXd cross = r(family.All(), unknowns) * B;
      return W.transpose() *
             (r(family.All(), family.All()) - cross - cross.transpose() +
              B.transpose() * r(unknowns, unknowns) * B) *
             W;
    };
    const Eigen::VectorXd sum = score_of(R);
    Eigen::MatrixXd by_view = Eigen::MatrixXd::Zero(q, q);
    for (const Eigen::MatrixXd& of_view : products_.of_view) {
      const Eigen::MatrixXd r = scaled(of_view);
      const Eigen::VectorXd z = score_of(r) - information_of(r) * sum;
      by_view += z * z.transpose();
    }
    score.degrees = static_cast<int>(q);
    score.square = sum.squaredNorm();
    const double left =
        (R(last, last) - R(last, unknowns) * theta) / (scale[last] * scale[last]) - score.square;
    const double degrees =
        products_.rows - static_cast<double>(unknowns.size()) - static_cast<double>(q);
    if (!(degrees > 1)) return score;
    score.variance = left / degrees;
    const auto n = static_cast<double>(q);
    const double alone = FTail(score.square / n / score.variance, n, degrees);
    score.probability = std::max(alone, ByViews(sum, by_view, score));
    return score;
  }

  // The same with the scatter of the views' scores in place of independent points: errors that the
  // points of a view share make it larger.
  [[nodiscard]] double ByViews(const Eigen::VectorXd& sum,
                               const Eigen::MatrixXd& by_view,
                               const Score& score) const {
    const auto views = static_cast<double>(products_.of_view.size()),
               n = static_cast<double>(sum.size());
    if (views > 2 * n) {
      const double square = sum.dot(by_view.ldlt().solve(sum)) * (views - 1) / views;
      return FTail(square * (views - n) / (n * (views - 1)), n, views - n);
    }
    const double variance = std::max(score.variance, by_view.trace() / n);
    return FTail(score.square / n / variance, n, views - 1);
  }

  [[nodiscard]] MissingFamily Describe(const Family& family, const Score& score) const {
    const double excess = std::max(0.0, score.square - score.degrees * score.variance);
    const std::string model =
        family.advice == nullptr ? ModelToTry(*camera_.model, family.models) : "";
    return {.camera = camera_.name,
            .family = family.name,
            .what = family.what,
            .remedy = family.advice != nullptr ? family.advice
                      : model.empty()          ? "no model of plenocal has it"
                                               : "try " + model,
            .degrees = score.degrees,
            .probability = score.probability,
            .gain = products_.noise * std::sqrt(excess / products_.points)};
  }

  const Bundle& bundle_;
  size_t index_;
  const BundleCamera& camera_;
  std::vector<Family> families_;
  std::vector<Columns> of_family_;
  Products products_;
};

}  // namespace

std::vector<MissingFamily> FindMissingFamilies(const Calibration& calibration, size_t camera) {
  return Search(calibration, camera).Find();
}

std::string MissingText(const std::vector<MissingFamily>& missing) {
  std::string text;
  for (const MissingFamily& each : missing) {
    text += fmt::format("{}: the residuals contain {} ({:.2g} px, p = {:.1g}); {}.\n",
                        each.camera,
                        each.what,
                        each.gain,
                        each.probability,
                        each.remedy);
  }
  return text;
}

}  // namespace plenocal
