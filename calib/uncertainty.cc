// SPDX-License-Identifier: Apache-2.0
#include "calib/uncertainty.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "calib/names.h"

namespace plenocal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Eigenvalues of the reduced normal matrix with unit diagonal below this are rounding: its entries
// are differences of sums that agree to some 1e-15 times the number of unknowns.
constexpr double kRankTolerance = 1e-12;
// An unknown takes part in an open direction when its share is at least this.
constexpr double kShare = 0.1;

// Where each unknown stands in the reduced system: intrinsics and mounts of the cameras first, then
// three coordinates a marker.
struct Layout {
  std::vector<std::vector<int>> params;  // per camera and parameter; -1 when not estimated
  std::vector<int> mount;                // per camera; -1 for the master or a camera without data
  int head = 0;                          // number of unknowns before the markers
  int total = 0;
  bool markers = false;

  [[nodiscard]] int Marker(int index) const { return head + 3 * index; }
};

Layout MakeLayout(const Bundle& bundle, const std::vector<bool>& has_data) {
  Layout layout;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const BundleCamera& camera = bundle.cameras[c];
    std::vector<int> places;
    for (size_t k = 0; k < camera.params.size(); ++k) {
      const bool own = bundle.Root(c, k) == ParamPlace{c, k};
      const bool held = camera.fixed[k] || (!camera.at_bound.empty() && camera.at_bound[k]);
      places.push_back(!own || held || !has_data[c] ? -1 : layout.head++);
    }
    layout.params.push_back(places);
    const bool free = !camera.is_master && has_data[c];
    layout.mount.push_back(free ? layout.head : -1);
    if (free) layout.head += 6;
  }
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    for (size_t k = 0; k < layout.params[c].size(); ++k) {
      const ParamPlace root = bundle.Root(c, k);
      layout.params[c][k] = layout.params[root.camera][root.param];
    }
  }
  layout.markers = bundle.marker_sigma > 0;
  layout.total = layout.head + (layout.markers ? 3 * static_cast<int>(bundle.markers.size()) : 0);
  return layout;
}

// What priors tell of parameters: place and 1 / sigma^2.
std::vector<std::pair<int, double>> PriorInformation(const Bundle& bundle, const Layout& layout) {
  std::vector<std::pair<int, double>> information;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) {
    const std::vector<ParamRule>& rules = bundle.cameras[c].rules;
    for (size_t k = 0; k < rules.size(); ++k) {
      if (!rules[k].prior || layout.params[c][k] < 0) continue;
      information.emplace_back(layout.params[c][k],
                               1 / (rules[k].prior->sigma * rules[k].prior->sigma));
    }
  }
  return information;
}

// The derivatives of one camera's observations by its own unknowns (intrinsics and mount), and
// their sums: those by the same unknowns are collected in a small matrix.
class OwnColumns {
 public:
  OwnColumns(const Bundle& bundle, const Layout& layout, size_t camera)
      : rows_(static_cast<int>(bundle.cameras[camera].model->measured.size())),
        local_(bundle.cameras[camera].model->local) {
    const auto& params = layout.params[camera];
    J_params_.resize(rows_, static_cast<Eigen::Index>(params.size()));
    for (size_t k = 0; k < params.size(); ++k) {
      if (params[k] < 0) continue;
      const auto place = std::find(places_.begin(), places_.end(), params[k]);
      free_.emplace_back(static_cast<Eigen::Index>(k), place - places_.begin());
      if (place == places_.end()) places_.push_back(params[k]);
    }
    own_params_ = static_cast<Eigen::Index>(places_.size());
    mount_ = layout.mount[camera] >= 0;
    for (int i = 0; mount_ && i < 6; ++i) places_.push_back(layout.mount[camera] + i);
    J_.resize(rows_, static_cast<Eigen::Index>(places_.size()));
    ClearSum();
    square_ = Eigen::MatrixXd::Zero(J_.cols(), J_.cols());
    touched_.resize(places_.size());
    std::iota(touched_.begin(), touched_.end(), Eigen::Index{0});
  }

  bool Linearise(const BundleCamera& camera,
                 const internal::LinearisedView& view,
                 const Eigen::Vector3d& p_target,
                 const Observation& seen) {
    double residual[kMaxObservationSize];
    if (!internal::Linearise(camera,
                             camera.params.data(),
                             view,
                             p_target,
                             seen,
                             {.residual = residual,
                              .J_params = J_params_.data(),
                              .J_mount = mount_ ? J_mount_.data() : nullptr,
                              .J_pose = J_pose_.data(),
                              .J_marker = J_marker_.data()})) {
      return false;
    }
    J_.leftCols(own_params_).setZero();
    for (const auto& [param, column] : free_) J_.col(column) += J_params_.col(param);
    if (mount_) J_.rightCols<6>() = J_mount_.topRows(rows_);
    if (local_) FindTouched();
    return true;
  }

  // Sums over the observations of one marker in one view. The camera's own columns matter where
  // there is common noise.
  void ClearSum() {
    information_ = 0;
    J_sum_.resize(0, 0);
    pose_sum_.setZero();
    marker_sum_.setZero();
  }
  void AddToSum(double own_sigma, double common_noise) {
    information_ += 1 / (own_sigma * own_sigma);
    if (common_noise > 0) {
      if (J_sum_.size() == 0) J_sum_ = Eigen::MatrixXd::Zero(J_.rows(), J_.cols());
      J_sum_ += J_ / own_sigma;
    }
    pose_sum_.topRows(rows_) += J_pose_.topRows(rows_) / own_sigma;
    marker_sum_.topRows(rows_) += J_marker_.topRows(rows_) / own_sigma;
  }
  // Makes the present rows those of the marker's mean, in its sigmas; returns the part of their
  // squares that common noise takes away.
  double LoadMean(double common_noise) {
    const double root = std::sqrt(information_);
    if (common_noise > 0) {
      J_ = J_sum_ / root;
      if (local_) FindTouched();
    }
    J_pose_ = pose_sum_ / root;
    J_marker_ = marker_sum_ / root;
    const double taken = internal::CommonShare(common_noise, information_) * information_;
    ClearSum();
    return taken;
  }

  [[nodiscard]] const Eigen::MatrixXd& Columns() const { return J_; }
  [[nodiscard]] auto Pose() const { return J_pose_.topRows(rows_); }
  [[nodiscard]] auto Marker() const { return J_marker_.topRows(rows_); }

  void AddSquare(double sign) {
    if (!local_) {
      square_.noalias() += sign * J_.transpose().lazyProduct(J_);
      return;
    }
    for (const Eigen::Index i : touched_) {
      for (const Eigen::Index j : touched_) square_(j, i) += sign * J_.col(j).dot(J_.col(i));
    }
  }
  void AddCross(double sign, Eigen::MatrixXd* cross) const {
    for (const Eigen::Index i : touched_) {
      cross->row(places_[static_cast<size_t>(i)]).noalias() +=
          sign * J_.col(i).transpose().lazyProduct(Pose());
    }
  }
  template <typename Product>
  void AddMarkerCross(int marker, const Product& product, Eigen::MatrixXd* S) const {
    for (const Eigen::Index i : touched_) {
      S->block<3, 1>(marker, places_[static_cast<size_t>(i)]) += product.col(i);
    }
  }
  // The lower triangle.
  void AddTo(Eigen::MatrixXd* S) const {
    for (size_t i = 0; i < places_.size(); ++i) {
      for (size_t j = 0; j <= i; ++j) {
        const auto [column, row] = std::minmax(places_[i], places_[j]);
        (*S)(row, column) += square_(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
      }
    }
  }

 private:
  void FindTouched() {
    touched_.clear();
    for (Eigen::Index i = 0; i < J_.cols(); ++i) {
      if (!J_.col(i).isZero(0)) touched_.push_back(i);
    }
  }

  int rows_;
  bool local_;
  bool mount_ = false;
  // Parameters that are estimated, each with its column; equal ones have one.
  std::vector<std::pair<Eigen::Index, Eigen::Index>> free_;
  Eigen::Index own_params_ = 0;        // columns of parameters
  std::vector<int> places_;            // of the columns in the reduced system
  std::vector<Eigen::Index> touched_;  // columns that may differ from zero
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> J_params_;
  Eigen::Matrix<double, kMaxObservationSize, 6, Eigen::RowMajor> J_mount_, J_pose_, pose_sum_;
  Eigen::Matrix<double, kMaxObservationSize, 3, Eigen::RowMajor> J_marker_, marker_sum_;
  Eigen::MatrixXd J_, J_sum_;
  double information_ = 0;
  Eigen::MatrixXd square_;
};

// Reduced normal matrix (without priors of parameters) and, per camera, the number of pose and
// jitter unknowns that its rows pay for; those that the means of markers pay for where they have
// common noise.
struct Reduced {
  Eigen::MatrixXd S;
  std::vector<double> pose_share, pose_share_of_means;
  double jitter_translations = 0, jitter_rotations = 0;  // what the data tell of the jitter
};

// Rows of W' W are collected and subtracted together: one large product is faster than many small.
class Subtraction {
 public:
  explicit Subtraction(Eigen::MatrixXd* S)
      : S_(*S), batch_(Eigen::MatrixXd::Zero(S->rows(), kRows)) {}

  // S -= cross (L L')^-1 cross'
  void Add(const Eigen::MatrixXd& cross, const Eigen::LLT<Matrix6d>& factor) {
    // Only poses are estimated: Eigen's solver does not take the empty matrix.
    if (cross.rows() == 0) return;
    batch_.middleCols<6>(columns_) = factor.matrixL().solve(cross.transpose()).transpose();
    columns_ += 6;
    if (columns_ == kRows) Flush();
  }
  void Flush() {
    if (columns_ > 0) {
      S_.selfadjointView<Eigen::Lower>().rankUpdate(batch_.leftCols(columns_), -1);
    }
    columns_ = 0;
  }

 private:
  static constexpr int kRows = 6 * 64;
  Eigen::MatrixXd& S_;
  Eigen::MatrixXd batch_;
  int columns_ = 0;
};

// One camera's observations in one frame, as far as its target pose is concerned.
struct ReducedView {
  size_t camera = 0;
  Matrix6d information = Matrix6d::Zero();  // of the pose that the camera saw, E' E
  Matrix6d of_means = Matrix6d::Zero();     // that of the means of markers
  // With jitter about the frame's pose, of information W' W = Q: W and (E' E + Q)^-1.
  Matrix6d W = Matrix6d::Zero();
  Matrix6d jitter_covariance = Matrix6d::Zero();
};

Reduced Reduce(const Bundle& bundle, const Layout& layout) {
  Reduced reduced{.S = Eigen::MatrixXd::Zero(layout.total, layout.total),
                  .pose_share = std::vector<double>(bundle.cameras.size(), 0.0),
                  .pose_share_of_means = std::vector<double>(bundle.cameras.size(), 0.0)};
  Eigen::MatrixXd& S = reduced.S;
  Subtraction subtraction(&S);
  const bool has_jitter = bundle.jitter.translation_sigma > 0;

  const auto& observations = bundle.observations;
  Eigen::MatrixXd cross(layout.total, 6);       // F' E of the frame
  Eigen::MatrixXd view_cross(layout.total, 6);  // and of one view, where views have jitter
  std::vector<ReducedView> views;
  std::vector<OwnColumns> own;
  for (size_t c = 0; c < bundle.cameras.size(); ++c) own.emplace_back(bundle, layout, c);
  for (size_t begin = 0; begin < observations.size();) {
    const int frame = observations[begin].frame;
    Matrix6d pose = Matrix6d::Zero();
    cross.setZero();
    views.clear();
    while (begin < observations.size() && observations[begin].frame == frame) {
      const auto c = static_cast<size_t>(observations[begin].camera);
      const BundleCamera& camera = bundle.cameras[c];
      const internal::LinearisedView linearised{
          .T_camera_rig = camera.T_camera_rig,
          .T_rig_target = bundle.SeenPose(static_cast<size_t>(frame), c)};
      Eigen::MatrixXd& own_cross = has_jitter ? view_cross : cross;
      if (has_jitter) view_cross.setZero();
      ReducedView view{.camera = c};
      const auto add = [&](int marker, double sign) {
        const auto J = own[c].Columns();
        const auto E = own[c].Pose();
        view.information.noalias() += sign * E.transpose().lazyProduct(E);
        own[c].AddSquare(sign);
        own[c].AddCross(sign, &own_cross);
        if (layout.markers) {
          const int m = layout.Marker(marker);
          const auto M = own[c].Marker();
          own_cross.middleRows<3>(m).noalias() += sign * M.transpose().lazyProduct(E);
          S.block<3, 3>(m, m).noalias() += sign * M.transpose().lazyProduct(M);
          own[c].AddMarkerCross(m, sign * M.transpose().lazyProduct(J), &S);
        }
      };
      while (begin < observations.size() && observations[begin].frame == frame &&
             observations[begin].camera == static_cast<int>(c)) {
        const int marker = observations[begin].marker;
        bool any = false;
        for (const size_t end = EndOfMarker(observations, begin); begin < end; ++begin) {
          const BundleObservation& observation = observations[begin];
          if (!observation.used ||
              !own[c].Linearise(camera,
                                linearised,
                                bundle.markers[static_cast<size_t>(marker)].position,
                                observation.seen)) {
            continue;
          }
          add(marker, 1);
          own[c].AddToSum(OwnNoiseSigma(camera, observation.seen), camera.common_noise);
          any = true;
        }
        if (!any) continue;
        const double taken = own[c].LoadMean(camera.common_noise);
        view.of_means.noalias() +=
            (1 - taken) * own[c].Pose().transpose().lazyProduct(own[c].Pose());
        if (taken > 0) add(marker, -taken);
      }
      if (has_jitter) {
        // Eliminate the view's jitter.
        view.W = JitterWeight(bundle, static_cast<size_t>(frame), c);
        const Matrix6d Q = view.W.transpose() * view.W;
        const Eigen::LLT<Matrix6d> factor(view.information + Q);
        subtraction.Add(view_cross, factor);
        view.jitter_covariance = factor.solve(Matrix6d::Identity());
        const Matrix6d passed = view.jitter_covariance * Q;
        cross.noalias() += view_cross * passed;
        pose += view.information * passed;
      } else {
        pose += view.information;
      }
      views.push_back(view);
    }
    const Eigen::LLT<Matrix6d> factor(pose);
    if (factor.info() != Eigen::Success) continue;  // a frame without used observations
    subtraction.Add(cross, factor);
    const Matrix6d pose_covariance = factor.solve(Matrix6d::Identity());
    for (const ReducedView& view : views) {
      const Matrix6d& A = view.jitter_covariance;
      const Matrix6d& N = view.information;
      Matrix6d seen = pose_covariance;  // covariance of the pose that the camera saw
      if (has_jitter) {
        const Matrix6d Q = view.W.transpose() * view.W;
        seen = A + A * Q * pose_covariance * Q * A;
        const Matrix6d jitter = A + A * N * pose_covariance * N * A;
        const Vector6d known = Vector6d::Ones() - (view.W * jitter * view.W.transpose()).diagonal();
        if (!bundle.jitter.misplaced[bundle.View(static_cast<size_t>(frame), view.camera)]) {
          reduced.jitter_translations += known.head<3>().sum();
          reduced.jitter_rotations += known.tail<3>().sum();
        }
      }
      reduced.pose_share[view.camera] += (N * seen).trace();
      reduced.pose_share_of_means[view.camera] += (view.of_means * seen).trace();
    }
  }
  subtraction.Flush();
  for (const OwnColumns& columns : own) columns.AddTo(&S);
  if (layout.markers) {
    S.diagonal().tail(layout.total - layout.head).array() +=
        1 / (bundle.marker_sigma * bundle.marker_sigma);
  }
  return reduced;
}

// Of (L L')^-1: the squares of the columns of L^-1, which are zero above its diagonal.
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

}  // namespace

Uncertainty EstimateUncertainty(const Bundle& bundle,
                                const std::vector<std::string>& camera_names) {
  const size_t camera_count = bundle.cameras.size();
  std::vector<bool> has_data(camera_count, false);
  std::vector<double> coordinates(camera_count, 0.0);
  double target_distance = 0;
  double used = 0;
  for (const BundleObservation& observation : bundle.observations) {
    if (!observation.used) continue;
    const auto c = static_cast<size_t>(observation.camera);
    has_data[c] = true;
    coordinates[c] += static_cast<double>(bundle.cameras[c].model->measured.size());
    target_distance += bundle.T_rig_target[static_cast<size_t>(observation.frame)].t.norm();
    used += 1;
  }
  target_distance /= std::max(1.0, used);

  const Layout layout = MakeLayout(bundle, has_data);
  const Reduced reduced = Reduce(bundle, layout);
  const int head = layout.head;
  const int tail = layout.total - head;

  // Eliminate the markers as well: their block is positive definite by their prior.
  Eigen::MatrixXd C = reduced.S.topLeftCorner(head, head).selfadjointView<Eigen::Lower>();
  Eigen::LLT<Eigen::MatrixXd> marker_factor;
  Eigen::MatrixXd gain;  // S_mm^-1 S_mh
  if (tail > 0) {
    const Eigen::MatrixXd S_mh = reduced.S.bottomLeftCorner(tail, head);
    marker_factor.compute(reduced.S.bottomRightCorner(tail, tail).selfadjointView<Eigen::Lower>());
    gain = marker_factor.solve(S_mh);
    C -= S_mh.transpose() * gain;
  }

  Uncertainty result;
  result.frames_information = C;
  if (tail > 0) {
    result.frames_information -=
        gain.transpose() * gain / (bundle.marker_sigma * bundle.marker_sigma);
  }
  for (const auto& [place, information] : PriorInformation(bundle, layout)) {
    C(place, place) += information;
  }
  result.places = layout.params;
  result.mount_places = layout.mount;
  // Natural units of the unknowns.
  Eigen::VectorXd unit(head);
  for (size_t c = 0; c < camera_count; ++c) {
    const BundleCamera& camera = bundle.cameras[c];
    for (size_t k = 0; k < camera.params.size(); ++k) {
      if (layout.params[c][k] < 0 || bundle.Root(c, k) != ParamPlace{c, k}) continue;
      const Param& param = camera.model->params[k];
      unit[layout.params[c][k]] = std::max({std::abs(camera.params[k]), param.scale, 1e-12});
      result.names.push_back(camera_names[c] + "." + std::string(param.name));
    }
    if (layout.mount[c] >= 0) {
      unit.segment<3>(layout.mount[c]).setConstant(std::max(target_distance, 1e-12));
      unit.segment<3>(layout.mount[c] + 3).setOnes();
      for (const char* name : kMountNames) {
        result.names.push_back(camera_names[c] + ".T_camera_rig." + name);
      }
    }
  }

  // Rank: directions without information in the matrix with unit diagonal.
  const Eigen::VectorXd diagonal = C.diagonal().cwiseMax(0);
  Eigen::VectorXd scale(head);
  for (int i = 0; i < head; ++i) scale[i] = diagonal[i] > 0 ? 1 / std::sqrt(diagonal[i]) : 1;
  // Eigen's solver does not take the empty matrix of cameras that are held in all.
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> spectrum(head), natural(head);
  if (head > 0) spectrum.compute(scale.asDiagonal() * C * scale.asDiagonal());
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(head, head);
  Eigen::VectorXd open = Eigen::VectorXd::Zero(head);  // share in directions without information
  const auto describe = [&](const Eigen::VectorXd& direction, double sigma) {
    OpenDirection described{{}, sigma};
    const double largest = direction.cwiseAbs().maxCoeff();
    for (int i = 0; i < head; ++i) {
      const double share = std::abs(direction[i]) / largest;
      if (share >= kShare)
        described.parts.emplace_back(result.names[static_cast<size_t>(i)], share);
    }
    std::stable_sort(described.parts.begin(), described.parts.end(), [](auto& a, auto& b) {
      return a.second > b.second;
    });
    result.open.push_back(described);
  };
  for (int i = 0; i < head; ++i) {
    const Eigen::VectorXd direction = scale.asDiagonal() * spectrum.eigenvectors().col(i);
    if (spectrum.eigenvalues()[i] > kRankTolerance) {
      covariance += direction * direction.transpose() / spectrum.eigenvalues()[i];
    } else {
      const Eigen::VectorXd in_units = direction.cwiseQuotient(unit);
      open = open.cwiseMax(in_units.cwiseAbs() / in_units.cwiseAbs().maxCoeff());
      describe(in_units, kInfinity);
    }
  }
  // Directions with information that still leave a parameter open by its own size.
  if (head > 0) {
    natural.compute(unit.cwiseInverse().asDiagonal() * covariance *
                    unit.cwiseInverse().asDiagonal());
  }
  for (int i = head - 1; i >= 0; --i) {
    const double sigma = std::sqrt(std::max(0.0, natural.eigenvalues()[i]));
    if (sigma > 1) describe(natural.eigenvectors().col(i), sigma);
  }

  const auto sigma_of = [&](int place) {
    // The share is rounding unless it is far above the precision of an eigenvector.
    return open[place] > 1e-6 ? kInfinity : std::sqrt(covariance(place, place));
  };
  for (size_t c = 0; c < camera_count; ++c) {
    std::vector<double> sigmas;
    for (const int place : layout.params[c]) sigmas.push_back(place < 0 ? 0 : sigma_of(place));
    result.params.push_back(sigmas);
    Matrix6d mount = Matrix6d::Zero();
    if (layout.mount[c] >= 0) {
      mount = covariance.block<6, 6>(layout.mount[c], layout.mount[c]);
      for (int i = 0; i < 6; ++i) {
        if (open[layout.mount[c] + i] > 1e-6) mount(i, i) = kInfinity;
      }
    }
    result.mount.push_back(mount);
  }

  double marker_unknowns = 0;  // how many of the marker coordinates the data pay for
  if (tail > 0) {
    const Eigen::VectorXd inverse_diagonal = InverseDiagonal(marker_factor);
    const Eigen::MatrixXd spread = gain * covariance;
    for (int m = 0; m < tail / 3; ++m) {
      Eigen::Vector3d variance;
      for (int i = 0; i < 3; ++i) {
        const int row = 3 * m + i;
        variance[i] = inverse_diagonal[row] + spread.row(row).dot(gain.row(row));
        marker_unknowns += 1 - variance[i] / (bundle.marker_sigma * bundle.marker_sigma);
      }
      result.markers.push_back(variance.cwiseSqrt());
    }
  }

  result.covariance = covariance;
  result.marker_gain = gain;
  const Eigen::VectorXd sigma = covariance.diagonal().cwiseMax(1e-300).cwiseSqrt();
  result.correlation =
      sigma.cwiseInverse().asDiagonal() * covariance * sigma.cwiseInverse().asDiagonal();

  // A prior pays for its part of a parameter.
  std::vector<double> paid_by_priors(camera_count, 0.0);
  for (const auto& [place, information] : PriorInformation(bundle, layout)) {
    for (size_t c = 0; c < camera_count; ++c) {
      const auto& places = layout.params[c];
      if (std::find(places.begin(), places.end(), place) == places.end()) continue;
      paid_by_priors[c] += covariance(place, place) * information;
      break;
    }
  }

  // Markers are shared: each camera pays in proportion to what it measured. Its own unknowns and
  // its part of the poses are its alone.
  double all_coordinates = 0;
  for (const double count : coordinates) all_coordinates += count;
  const bool has_jitter = bundle.jitter.translation_sigma > 0;
  result.jitter_translation_redundancy = reduced.jitter_translations;
  result.jitter_rotation_redundancy = reduced.jitter_rotations;
  for (size_t c = 0; c < camera_count; ++c) {
    double own = 0;
    if (layout.mount[c] >= 0) {
      // A mount is known from a mean over the frames: of their jitter, where there is any.
      if (has_jitter) {
        result.jitter_translation_redundancy -= 3;
        result.jitter_rotation_redundancy -= 3;
      } else {
        own = 6;
      }
    }
    for (size_t k = 0; k < layout.params[c].size(); ++k) {
      own += layout.params[c][k] >= 0 && bundle.Root(c, k) == ParamPlace{c, k} ? 1 : 0;
    }
    own -= paid_by_priors[c];
    own += marker_unknowns * coordinates[c] / std::max(1.0, all_coordinates);
    result.redundancy.push_back(coordinates[c] - own - reduced.pose_share[c]);
    result.paid_by_means.push_back(own + reduced.pose_share_of_means[c]);
  }
  return result;
}

}  // namespace plenocal
