// SPDX-License-Identifier: Apache-2.0
//
// The camera-model plug-in.
//
// A camera model is one header in models/ with one struct that satisfies `CameraModelPlugin`. The
// build finds it (models/CMakeLists.txt) and puts its `CameraModel`, the table that the rest of the
// project uses, into the registry. Reader, writer, `plenocal models`, the bundle adjuster and the
// property tests all run over that table; no parameter has a meaning outside models/.
#pragma once

#include <ceres/jet.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <concepts>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <vector>

#include "calib/camera/observation.h"
#include "calib/camera/param_rule.h"
#include "calib/camera/rigid_transform.h"

namespace plenocal {

template <typename T>
using Vector2 = Eigen::Matrix<T, 2, 1>;
template <typename T>
using Vector3 = Eigen::Matrix<T, 3, 1>;

/// A scalar's value without its derivatives.
inline double ValueOf(double value) { return value; }
template <typename T, int N>
double ValueOf(const ceres::Jet<T, N>& value) {
  return value.a;
}

/// The cases in which a parameter keeps its initial value.
enum class Fixed {
  kNever,
  /// In a calibration: a motion of the camera's frame, and so the poses, has the same effect.
  kAgainstPoses,
  /// The model's `Start` chooses it; other parameters have the same effect.
  kAlways,
};

/// One parameter of a camera model.
struct Param {
  std::string_view name;  ///< the symbol of the model's source: "f_x"
  std::string_view unit;  ///< "px", "m", "1"
  double lower = -std::numeric_limits<double>::infinity();  ///< a value must be above this
  double upper = std::numeric_limits<double>::infinity();   ///< and below this
  /// Characteristic scale: uncertainty is judged in this unit, or in the parameter's own size where
  /// that is larger. A direction whose standard deviation exceeds it is not determined by the data.
  double scale = 0;
  /// The value at which the parameter has no effect; one that is fixed without an initial value
  /// takes it.
  std::optional<double> neutral = std::nullopt;
  Fixed fixed = Fixed::kNever;
  /// Positive for one of many coefficients of a field over the image, which points determine only
  /// in their neighbourhood: standard deviation of the Gaussian prior around 0.
  double prior_sigma = 0;
  /// Of a parameter that is estimated only where the session states a value or a prior: the value
  /// that it has by the others elsewhere. In an adjustment it is `kByOthers` then.
  double (*by_others)(const double* params) = nullptr;
};

/// Stands for the value of `Param::by_others`, which changes with the others.
inline constexpr double kByOthers = std::numeric_limits<double>::max();

/// Gaussian prior around 0 on a weighted sum of parameters, as the roughness of a spline: a second
/// difference of neighbouring coefficients.
struct PriorRow {
  std::span<const size_t> indices;  ///< of the parameters
  std::span<const double> weights;  ///< parallel
  double sigma = 0;
};

/// The number of other programs that read a model. Of models that describe a camera equally well,
/// the one of wider use is recommended.
enum class Usage {
  kCommon,  ///< most: OpenCV, ROS, COLMAP
  kSome,    ///< some: Kalibr, Basalt, DSO
  kRare,    ///< hardly any
};

/// Where the rays of a camera meet.
enum class Centre {
  kPoint,  ///< all in the camera frame's origin: a central model
  kAxis,   ///< all rays meet the optical axis: a pupil that moves with the angle, a flat port
  kNone,
};

/// Ray of an image point, in the camera's frame: the scene point lies on origin + lambda *
/// direction, lambda > 0. |direction| = 1.
struct Ray {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();
};

/// Input of a model's initial guess.
struct StartProblem {
  std::span<const View> views;
  const std::map<int, Eigen::Vector3d>* markers = nullptr;  ///< marker number -> point, m
  ImageSize image_size{};
  std::span<const double> config;
  std::span<const std::optional<double>> given;  ///< the user's initial value of each parameter
  const std::vector<bool>* fixed = nullptr;      ///< parameters that keep their initial value
  std::span<const ParamRule> rules = {};         ///< of each parameter, or empty
};

/// One of several initial guesses; the best is chosen by adjusting each.
struct StartCandidate {
  std::vector<double> params;
};

/// The reason for which a model does not describe a camera.
struct Misfit {
  std::string reason;       ///< a sentence without its full stop; empty when it does
  bool impossible = false;  ///< points lie where the model images nothing
};

/// Depths at which a camera has seen the target.
struct DepthRange {
  double nearest = 0, farthest = 0;  ///< z of the target's points in the camera's frame, m
};

/// Residual of one observation in a replicate fit (`CameraModel::replicate_fit`).
struct ReplicateResidual {
  double squared = 0;     ///< squared length of the residual, px^2
  double redundancy = 0;  ///< its coordinates less its share of the fit's unknowns
};

/// Memory for a projection and its derivatives; row-major, one row a measured coordinate. Null: not
/// needed (`predicted` and J_point always are).
struct ProjectionOutput {
  double* predicted = nullptr;  ///< measured coordinates
  double* J_params = nullptr;   ///< measured x params
  double* J_point = nullptr;    ///< measured x 3, by p
  /// Receives the `support_size` indices of the parameters on which the point depends, and J_params
  /// their columns only. Null, or a model whose `support_size` is 0: the columns of all.
  size_t* support = nullptr;
  double* J_h = nullptr;  ///< measured, by h; of a model that is `homogeneous`
};

/// Points that are projected together (calib/camera/rays.h).
struct PointBlock {
  size_t count = 0;
  const double* p = nullptr;       ///< count x 3, m
  const double* values = nullptr;  ///< of observations, count x kMaxObservationSize; null: zeros
  const double* h = nullptr;       ///< count; null: ones
};

struct CameraModel;

/// The functions of a `CameraModel`, which they get as first argument; its member functions call
/// them and describe them. Those after `start` may be null.
struct ModelFunctions {
  bool (*project)(const CameraModel& model,
                  const double* params,
                  const double* config,
                  const double* values,
                  const Eigen::Vector3d& p,
                  double h,
                  double* predicted) = nullptr;
  bool (*project_with_jacobian)(const CameraModel& model,
                                const double* params,
                                const double* config,
                                const double* values,
                                const Eigen::Vector3d& p,
                                double h,
                                const ProjectionOutput& out) = nullptr;
  std::optional<Ray> (*unproject)(const CameraModel& model,
                                  const double* params,
                                  const double* config,
                                  const double* values) = nullptr;
  std::vector<StartCandidate> (*start)(const CameraModel& model,
                                       const StartProblem& problem) = nullptr;
  std::string (*refusal)(const CameraModel& model, const StartProblem& problem) = nullptr;
  Misfit (*misfit)(const CameraModel& model,
                   const StartProblem& problem,
                   std::span<const double> params,
                   double median_error) = nullptr;
  std::string (*remedy)(const CameraModel& model,
                        std::span<const size_t> weak,
                        const DepthRange& seen) = nullptr;
  /// All points of a block, as `ProjectPoints`, but here all x lie together, then all y, and so on:
  /// column i of `out.J_params` is by parameter i. J_params and J_point may be null; no support.
  void (*project_block)(const CameraModel& model,
                        const double* params,
                        const double* config,
                        const PointBlock& in,
                        const ProjectionOutput& out) = nullptr;
  /// `unproject` of many image points.
  std::vector<std::optional<Ray>> (*unproject_block)(
      const CameraModel& model,
      const double* params,
      const double* config,
      std::span<const std::array<double, kMaxObservationSize>> values) = nullptr;
  std::vector<double> (*prior_sigmas)(const CameraModel& model,
                                      const StartProblem& problem) = nullptr;
  /// Unit of the sigmas of `prior_rows`, by the parameters that are always fixed; null: 1.
  double (*prior_unit)(const CameraModel& model, const double* params) = nullptr;
  /// The model "lens+part+..." of this lens; null for a model that takes no parts. Throws `Error`
  /// of kind kInput for parts that there are not.
  const CameraModel* (*with_parts)(const CameraModel& lens, std::string_view name) = nullptr;
  /// Of a model that stands for a family: the member of that name ("splined-20x14" of `splined`),
  /// null for a name of another kind. Throws `Error` of kind kInput for a member that there is not.
  const CameraModel* (*member)(std::string_view name) = nullptr;
};

/// A camera model as the rest of the project sees it: data and functions, no assumption about what
/// the parameters mean. A value; what it refers to is static, or has an owner in models/registry.h.
/// `values` is an observation's: `measured.size()` measured coordinates, then `context.size()`
/// numbers on which its projection depends besides (a micro lens' centre), then those of
/// `optional_context`; others are zero.
struct CameraModel {
  std::string_view name;
  std::string_view source;        ///< publication and equations
  std::span<const Param> params;  ///< estimated
  std::span<const Param> config;  ///< never estimated, given in the session: pixel_size
  std::span<const std::string_view> measured;  ///< names of the residuals' coordinates
  std::span<const std::string_view> context;
  std::span<const double> example;         ///< valid parameters, for tests
  std::span<const double> example_config;  ///< likewise
  ImageSize example_size;                  ///< image that goes with the example, px
  Centre centre = Centre::kPoint;
  bool plenoptic;  ///< observations are made through micro lenses, whose centre is their context
  ModelFunctions functions;
  const void* self = nullptr;                 ///< data of the model's own, for `functions`
  bool homogeneous = false;                   ///< (p, h) may have any h, else 1 only
  size_t support_size = 0;                    ///< parameters on which one point depends; 0: all
  std::span<const PriorRow> prior_rows = {};  ///< beside `Param::prior_sigma`
  /// YAML of the formula from which the model, or its lens, was made (docs/formats.md); else empty.
  /// calibration.yaml carries it.
  std::string_view formula = {};

  /// Replicate fit: weighted least-squares fit of the relation that the observations of one marker
  /// in one view obey for any camera parameters, a lower bound of every calibration's residuals.
  /// Null for models that see a marker once in a view.
  void (*replicate_fit)(std::span<const Observation* const> of_marker,
                        std::span<const double> weights,
                        ReplicateResidual* residuals) = nullptr;
  /// Columns that an unweighted replicate fit leaves of: the measured coordinates; terms of a law
  /// of higher order at the fitted places, one a number that is common to the camera. Rows: the
  /// coordinates of each observation. Null for models without these.
  Eigen::MatrixXd (*replicate_terms)(const double* params,
                                     std::span<const Observation* const> of_marker) = nullptr;
  /// Finds `Observation::lens_type` of observations that came without. Null for models with one
  /// type.
  void (*assign_lens_types)(std::vector<View>* views) = nullptr;
  Usage usage = Usage::kRare;
  /// Numbers of an observation that may follow `context`: zeros where it has none, and files may
  /// lack their columns.
  std::span<const std::string_view> optional_context = {};

  [[nodiscard]] bool IsCentral() const { return centre == Centre::kPoint; }

  /// Predicted measured coordinates of the point p / h in the camera's frame, which lies at
  /// infinity where h = 0, and beyond where h < 0; for central models h has no effect. False
  /// outside the model's domain.
  bool Project(const double* of_params,
               const double* of_config,
               const double* values,
               const Eigen::Vector3d& p,
               double* predicted,
               double h = 1) const {
    return functions.project(*this, of_params, of_config, values, p, h, predicted);
  }
  /// `Project` with derivatives.
  bool ProjectWithJacobian(const double* of_params,
                           const double* of_config,
                           const double* values,
                           const Eigen::Vector3d& p,
                           const ProjectionOutput& out,
                           double h = 1) const {
    return functions.project_with_jacobian(*this, of_params, of_config, values, p, h, out);
  }
  /// The ray on which a measured point lies; nothing outside the domain.
  [[nodiscard]] std::optional<Ray> Unproject(const double* of_params,
                                             const double* of_config,
                                             const double* values) const {
    return functions.unproject(*this, of_params, of_config, values);
  }
  /// Initial guesses without help from the user; empty when the views do not suffice.
  [[nodiscard]] std::vector<StartCandidate> Start(const StartProblem& problem) const {
    return functions.start(*this, problem);
  }
  /// The reason, with the remedy, for which the model cannot be calibrated with these initial
  /// values and fixed parameters; empty when it can.
  [[nodiscard]] std::string Refusal(const StartProblem& problem) const {
    return functions.refusal == nullptr ? "" : functions.refusal(*this, problem);
  }
  /// Per parameter: standard deviation of the Gaussian prior around 0 that it has unless the
  /// session states another, by where in the image the observations are; 0: none.
  [[nodiscard]] std::vector<double> PriorSigmas(const StartProblem& problem) const {
    if (functions.prior_sigmas != nullptr) return functions.prior_sigmas(*this, problem);
    std::vector<double> sigmas;
    for (const Param& param : params) sigmas.push_back(param.prior_sigma);
    return sigmas;
  }
  /// A test whether the model describes the camera; `best` are the best initial guess found, with
  /// residuals of median length `median_error`, px.
  [[nodiscard]] Misfit JudgeFit(const StartProblem& problem,
                                std::span<const double> best,
                                double median_error) const {
    return functions.misfit == nullptr ? Misfit()
                                       : functions.misfit(*this, problem, best, median_error);
  }
  /// Advice where observations like these determine some parameters badly (indices into `params`):
  /// why, and which images to add, in one sentence or more; may be empty.
  [[nodiscard]] std::string Remedy(std::span<const size_t> weak, const DepthRange& seen) const {
    return functions.remedy == nullptr ? "" : functions.remedy(*this, weak, seen);
  }
};

/// A struct in models/ whose table is made at run time; it needs no other member.
template <typename M>
concept MakesItsTable = requires {
  { M::Table() } -> std::same_as<CameraModel>;
};

/// Members that any other struct in models/ must have. `Project` is the model's statement of its
/// mathematics; derivatives follow from it.
///
/// Models of ordinary cameras derive from `CentralModel` (models/start/central_model.h), which
/// supplies kMeasured, kContext, kConfig, kCentre, kPlenoptic, and have the short signatures
///   template <typename T> static bool Project(const T* params, const Vector3<T>& p_cam, T* u);
///   static std::optional<Vector3d> Unproject(const double* params, const Vector2d& u);
/// Others take config and context as well, after params:
///   template <typename T> static bool Project(const T* params, const double* config,
///                                             const double* context, const Vector3<T>&, T*);
///   static std::optional<Ray> Unproject(params, config, values);
/// or, for points at infinity as well, Project(params, config, context, p, const T& h, u).
/// A model with many parameters, of which a point depends on a few, has
///   static std::array<size_t, n> Support(const double* params, const Eigen::Vector3d& p_cam);
/// with their indices; `Project` reads no others for that point. Priors of neighbouring ones are
///   static constexpr std::array<PriorRow, n> kPriorRows
/// One whose derivatives are cheaper written out than by dual numbers may have
///   static bool ProjectWithJacobian(...);  // CameraModel::ProjectWithJacobian, less the model
/// and `Project` for numbers only.
/// A model that not all data and fixed parameters can determine may have
///   static std::string Refusal(const StartProblem& problem);
///   static std::string Remedy(std::span<const size_t> weak, const DepthRange& seen);
///   static Misfit JudgeFit(const CameraModel&, const StartProblem&, std::span<const double>,
///                          double);
///   static std::vector<double> PriorSigmas(const StartProblem& problem);
/// One that sees a marker several times in a view may have ReplicateFit, ReplicateTerms and
/// AssignLensTypes (`CameraModel::replicate_fit` and following), and kOptionalContext. A model that
/// other programs read has
///   static constexpr Usage kUsage
template <typename M>
concept CameraModelPlugin = MakesItsTable<M> || requires(const StartProblem& problem) {
  { M::kName } -> std::convertible_to<std::string_view>;
  { M::kSource } -> std::convertible_to<std::string_view>;
  {std::span<const Param>(M::kParams)};
  {std::span<const Param>(M::kConfig)};
  {std::span<const std::string_view>(M::kMeasured)};
  {std::span<const std::string_view>(M::kContext)};
  { M::kCentre } -> std::convertible_to<Centre>;
  { M::kPlenoptic } -> std::convertible_to<bool>;
  {std::span<const double>(M::kExample)};
  {std::span<const double>(M::kExampleConfig)};
  { M::kExampleSize } -> std::convertible_to<ImageSize>;
  { M::Start(problem) } -> std::same_as<std::vector<StartCandidate>>;
  requires M::kParams.size() == M::kExample.size();
  requires M::kConfig.size() == M::kExampleConfig.size();
  requires M::kMeasured.size() + M::kContext.size() <= kMaxObservationSize;
};

namespace internal {

template <typename M>
concept TakesH = requires(const double* in, const Eigen::Vector3d& p, double* out) {
  M::Project(in, in, in, p, 1.0, out);
};

template <typename M>
constexpr bool kHomogeneous = M::kCentre == Centre::kPoint || TakesH<M>;

// The functions of a header have no argument for the model, whose `self` they do not need.
template <CameraModelPlugin M, typename T>
bool Project(const T* params,
             const double* config,
             const double* values,
             const Vector3<T>& p,
             const T& h,
             T* predicted) {
  if constexpr (requires { M::Project(params, p, predicted); }) {
    return M::Project(params, p, predicted);
  } else if constexpr (TakesH<M>) {
    return M::Project(params, config, values + M::kMeasured.size(), p, h, predicted);
  } else {
    return M::Project(params, config, values + M::kMeasured.size(), p, predicted);
  }
}

// Dual numbers of a point: lanes `first` to `first` + 2, and the next where h counts.
template <CameraModelPlugin M>
constexpr int kPointLanes = TakesH<M> ? 4 : 3;

template <CameraModelPlugin M, typename Jet>
bool ProjectJets(const Jet* params,
                 const double* config,
                 const double* values,
                 const Eigen::Vector3d& p,
                 double h,
                 int first,
                 std::array<Jet, M::kMeasured.size()>* predicted) {
  const Vector3<Jet> p_jet(Jet(p.x(), first), Jet(p.y(), first + 1), Jet(p.z(), first + 2));
  Jet h_jet(h);
  if constexpr (TakesH<M>) h_jet = Jet(h, first + 3);
  return Project<M>(params, config, values, p_jet, h_jet, predicted->data());
}

template <CameraModelPlugin M, typename Jet>
void WriteByPoint(const std::array<Jet, M::kMeasured.size()>& predicted,
                  int first,
                  const ProjectionOutput& out) {
  for (size_t r = 0; r < predicted.size(); ++r) {
    out.predicted[r] = predicted[r].a;
    for (int i = 0; i < 3; ++i)
      out.J_point[r * 3 + static_cast<size_t>(i)] = predicted[r].v[first + i];
    if constexpr (TakesH<M>) {
      if (out.J_h != nullptr) out.J_h[r] = predicted[r].v[first + 3];
    }
  }
}

template <typename M>
concept HasSupport = requires(const double* params, const Eigen::Vector3d& p_cam) {
  M::Support(params, p_cam);
};

template <typename M>
constexpr size_t SupportSize() {
  if constexpr (HasSupport<M>) {
    return std::tuple_size_v<decltype(M::Support(nullptr, Eigen::Vector3d()))>;
  } else {
    return 0;
  }
}

// For models with `Support`: derivatives by the parameters that count only.
template <CameraModelPlugin M>
requires HasSupport<M>
bool ProjectWithLocalJacobian(const double* params,
                              const double* config,
                              const double* values,
                              const Eigen::Vector3d& p,
                              double h,
                              const ProjectionOutput& out) {
  constexpr size_t kMeasuredCount = M::kMeasured.size();
  const auto support = M::Support(params, p);
  constexpr size_t kCount = SupportSize<M>();
  using Jet = ceres::Jet<double, static_cast<int>(kCount) + kPointLanes<M>>;
  thread_local std::array<Jet, M::kParams.size()> params_jet;  // what is not read stays unset
  for (size_t i = 0; i < kCount; ++i) {
    params_jet[support[i]] = Jet(params[support[i]], static_cast<int>(i));
  }
  std::array<Jet, kMeasuredCount> predicted;
  if (!ProjectJets<M>(params_jet.data(), config, values, p, h, kCount, &predicted)) return false;
  WriteByPoint<M>(predicted, kCount, out);
  if (out.support != nullptr) std::ranges::copy(support, out.support);
  if (out.J_params == nullptr) return true;
  const size_t width = out.support != nullptr ? kCount : M::kParams.size();
  std::fill_n(out.J_params, kMeasuredCount * width, 0.0);
  for (size_t r = 0; r < kMeasuredCount; ++r) {
    for (size_t i = 0; i < kCount; ++i) {
      out.J_params[r * width + (out.support != nullptr ? i : support[i])] =
          predicted[r].v[static_cast<Eigen::Index>(i)];
    }
  }
  return true;
}

// Derivatives by the point alone take a third of the time of all, and poses need no others.
template <CameraModelPlugin M>
[[gnu::noinline, gnu::flatten]] bool ProjectWithPointJacobian(const double* params,
                                                              const double* config,
                                                              const double* values,
                                                              const Eigen::Vector3d& p,
                                                              double h,
                                                              const ProjectionOutput& out) {
  using Jet = ceres::Jet<double, kPointLanes<M>>;
  thread_local std::array<Jet, M::kParams.size()> params_jet;
  for (size_t i = 0; i < params_jet.size(); ++i) params_jet[i] = Jet(params[i]);
  std::array<Jet, M::kMeasured.size()> predicted;
  if (!ProjectJets<M>(params_jet.data(), config, values, p, h, 0, &predicted)) return false;
  WriteByPoint<M>(predicted, 0, out);
  return true;
}

// Inlined as a whole, since operations of dual numbers are too short for calls: 0.55 to 0.8 of the
// time.
template <CameraModelPlugin M>
[[gnu::flatten]] bool ProjectWithJacobian(const double* params,
                                          const double* config,
                                          const double* values,
                                          const Eigen::Vector3d& p,
                                          double h,
                                          const ProjectionOutput& out) {
  if (out.J_params == nullptr) {
    return ProjectWithPointJacobian<M>(params, config, values, p, h, out);
  }
  constexpr int kParamCount = static_cast<int>(M::kParams.size());
  using Jet = ceres::Jet<double, kParamCount + kPointLanes<M>>;
  std::array<Jet, kParamCount> params_jet;
  for (int i = 0; i < kParamCount; ++i) params_jet[i] = Jet(params[i], i);
  std::array<Jet, M::kMeasured.size()> predicted;
  if (!ProjectJets<M>(params_jet.data(), config, values, p, h, kParamCount, &predicted)) {
    return false;
  }
  WriteByPoint<M>(predicted, kParamCount, out);
  for (size_t r = 0; r < predicted.size(); ++r) {
    for (int i = 0; i < kParamCount; ++i) {
      out.J_params[r * M::kParams.size() + static_cast<size_t>(i)] = predicted[r].v[i];
    }
  }
  return true;
}

template <CameraModelPlugin M>
std::optional<Ray> Unproject(const CameraModel& /*model*/,
                             const double* params,
                             const double* config,
                             const double* values) {
  if constexpr (requires { M::Unproject(params, Eigen::Vector2d()); }) {
    const std::optional<Eigen::Vector3d> direction =
        M::Unproject(params, Eigen::Vector2d(values[0], values[1]));
    if (!direction) return std::nullopt;
    return Ray{Eigen::Vector3d::Zero(), *direction};
  } else {
    return M::Unproject(params, config, values);
  }
}

template <CameraModelPlugin M>
bool ProjectPoint(const CameraModel& /*model*/,
                  const double* params,
                  const double* config,
                  const double* values,
                  const Eigen::Vector3d& p,
                  double h,
                  double* predicted) {
  if (!kHomogeneous<M> && h != 1) return false;
  return Project<M>(params, config, values, p, h, predicted);
}

template <CameraModelPlugin M>
bool DifferentiatePoint(const CameraModel& /*model*/,
                        const double* params,
                        const double* config,
                        const double* values,
                        const Eigen::Vector3d& p,
                        double h,
                        const ProjectionOutput& out) {
  if (!kHomogeneous<M> && h != 1) return false;
  if (!TakesH<M> && out.J_h != nullptr) std::fill_n(out.J_h, M::kMeasured.size(), 0.0);
  if constexpr (HasSupport<M>) {
    return ProjectWithLocalJacobian<M>(params, config, values, p, h, out);
  } else if constexpr (requires { M::ProjectWithJacobian(params, config, values, p, h, out); }) {
    return M::ProjectWithJacobian(params, config, values, p, h, out);
  } else if constexpr (requires { &M::ProjectWithJacobian; }) {
    return M::ProjectWithJacobian(params, config, values, p, out);
  } else {
    return ProjectWithJacobian<M>(params, config, values, p, h, out);
  }
}

template <CameraModelPlugin M>
constexpr void AddOptional(CameraModel* model) {
  if constexpr (requires(const StartProblem& problem) { M::Refusal(problem); }) {
    model->functions.refusal = [](const CameraModel&, const StartProblem& problem) {
      return M::Refusal(problem);
    };
  }
  if constexpr (requires { M::kUsage; }) model->usage = M::kUsage;
  if constexpr (requires { M::kPriorRows; }) model->prior_rows = M::kPriorRows;
  if constexpr (requires { M::kOptionalContext; }) model->optional_context = M::kOptionalContext;
  if constexpr (requires { &M::Remedy; }) {
    model->functions.remedy = [](const CameraModel&,
                                 std::span<const size_t> weak,
                                 const DepthRange& seen) { return M::Remedy(weak, seen); };
  }
  if constexpr (requires { &M::PriorSigmas; }) {
    model->functions.prior_sigmas = [](const CameraModel&, const StartProblem& problem) {
      return M::PriorSigmas(problem);
    };
  }
  if constexpr (requires { &M::JudgeFit; }) model->functions.misfit = &M::JudgeFit;
  if constexpr (requires { &M::ReplicateFit; }) {
    model->replicate_fit = &M::ReplicateFit;
    model->replicate_terms = &M::ReplicateTerms;
    model->assign_lens_types = &M::AssignLensTypes;
  }
}

}  // namespace internal

/// The table of model M.
template <CameraModelPlugin M>
constexpr CameraModel MakeCameraModel() {
  CameraModel model{.name = M::kName,
                    .source = M::kSource,
                    .params = M::kParams,
                    .config = M::kConfig,
                    .measured = M::kMeasured,
                    .context = M::kContext,
                    .example = M::kExample,
                    .example_config = M::kExampleConfig,
                    .example_size = M::kExampleSize,
                    .centre = M::kCentre,
                    .plenoptic = M::kPlenoptic,
                    .functions = {
                        .project = &internal::ProjectPoint<M>,
                        .project_with_jacobian = &internal::DifferentiatePoint<M>,
                        .unproject = &internal::Unproject<M>,
                        .start = [](const CameraModel&,
                                    const StartProblem& problem) { return M::Start(problem); },
                    }};
  model.homogeneous = internal::kHomogeneous<M>;
  model.support_size = internal::SupportSize<M>();
  internal::AddOptional<M>(&model);
  return model;
}

template <MakesItsTable M>
CameraModel MakeCameraModel() {
  return M::Table();
}

/// True when all parameters lie within their limits, which are part of the model's domain.
inline bool WithinBounds(const CameraModel& model, const double* params) {
  for (size_t i = 0; i < model.params.size(); ++i) {
    if (!(params[i] > model.params[i].lower && params[i] < model.params[i].upper)) return false;
  }
  return true;
}

/// The model of that name in `models`, a member of one's family, or a lens of these with the parts
/// that the name has; nullptr for an unknown one. Throws `Error` of kind kInput for unknown parts
/// and members.
inline const CameraModel* FindModel(std::span<const CameraModel> models, std::string_view name) {
  for (const CameraModel& model : models) {
    if (model.name == name) return &model;
  }
  for (const CameraModel& model : models) {
    if (model.functions.member == nullptr) continue;
    if (const CameraModel* const member = model.functions.member(name)) return member;
  }
  const size_t plus = name.find('+');
  if (plus == std::string_view::npos) return nullptr;
  const CameraModel* const lens = FindModel(models, name.substr(0, plus));
  const bool takes_parts = lens != nullptr && lens->functions.with_parts != nullptr;
  return takes_parts ? lens->functions.with_parts(*lens, name) : nullptr;
}

}  // namespace plenocal
