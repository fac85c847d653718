// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/landmark_system.h"

#include <algorithm>
#include <set>
#include <utility>

#include "calib/adjust/priors.h"
#include "calib/adjust/rows.h"
#include "calib/base/format_error.h"
#include "calib/noise/camera_noise.h"

namespace plenocal {
namespace {

using internal::UnknownLayout;

// The rows of one landmark in one view: their derivatives by parameters, extrinsics and pose side
// by side, with the index of each column in the whole system, and those by the landmark.
struct LandmarkRows {
  std::vector<int> columns;
  Eigen::MatrixXd J;
  Eigen::Matrix<double, Eigen::Dynamic, 3> J_landmark;
  Eigen::VectorXd residual;
};

// Parts of the system that one landmark touches: sums by global index.
class LandmarkSums {
 public:
  explicit LandmarkSums(size_t unknowns) : place_(unknowns, -1) {}

  void Clear() {
    for (const int column : columns_) place_[static_cast<size_t>(column)] = -1;
    columns_.clear();
    V_.setZero();
    W_.setZero();
  }
  // Adds rows' rows: the part without the landmark to `S`, the others here.
  void Add(const LandmarkRows& rows, Eigen::MatrixXd* S) {
    const Eigen::MatrixXd square = rows.J.transpose() * rows.J;
    const Eigen::MatrixXd cross = rows.J.transpose() * rows.J_landmark;
    V_ += rows.J_landmark.transpose() * rows.J_landmark;
    const auto count = static_cast<Eigen::Index>(rows.columns.size());
    for (Eigen::Index i = 0; i < count; ++i) {
      const int column = rows.columns[static_cast<size_t>(i)];
      W_.row(PlaceOf(column)) += cross.row(i);
      for (Eigen::Index j = 0; j <= i; ++j) {
        const auto [low, high] = std::minmax(column, rows.columns[static_cast<size_t>(j)]);
        (*S)(high, low) += square(i, j);
        // Two columns of one index (tied parameters) stand for both halves of the square.
        if (i != j && low == high) (*S)(high, low) += square(i, j);
      }
    }
  }
  // S -= W V^-1 W'
  void Eliminate(Eigen::MatrixXd* S) {
    const Eigen::LLT<Eigen::Matrix3d> factor(V_);
    if (factor.info() != Eigen::Success || columns_.empty()) return;
    const auto count = static_cast<Eigen::Index>(columns_.size());
    const Eigen::MatrixXd half =
        factor.matrixL().solve(W_.topRows(count).transpose());  // 3 x count
    std::vector<Eigen::Index> order(columns_.size());
    for (size_t i = 0; i < order.size(); ++i) order[i] = static_cast<Eigen::Index>(i);
    std::ranges::sort(order, {}, [&](Eigen::Index i) { return columns_[static_cast<size_t>(i)]; });
    for (size_t j = 0; j < order.size(); ++j) {
      const Eigen::Vector3d column = half.col(order[j]);
      double* const out = &(*S)(0, columns_[static_cast<size_t>(order[j])]);
      for (size_t i = j; i < order.size(); ++i) {
        out[columns_[static_cast<size_t>(order[i])]] -= half.col(order[i]).dot(column);
      }
    }
  }
  // For a landmark that stays, at `index` of S.
  void Keep(int index, Eigen::MatrixXd* S) const {
    S->block<3, 3>(index, index) += V_;
    for (size_t i = 0; i < columns_.size(); ++i) {
      S->block<3, 1>(index, columns_[i]) += W_.row(static_cast<Eigen::Index>(i)).transpose();
    }
  }

 private:
  Eigen::Index PlaceOf(int column) {
    int& place = place_[static_cast<size_t>(column)];
    if (place < 0) {
      place = static_cast<int>(columns_.size());
      columns_.push_back(column);
      if (W_.rows() <= place) W_.conservativeResizeLike(Eigen::MatrixXd::Zero(2 * place + 32, 3));
    }
    return place;
  }

  std::vector<int> place_;    // of a global column in W_; -1: not touched
  std::vector<int> columns_;  // the global columns
  Eigen::Matrix3d V_ = Eigen::Matrix3d::Zero();
  Eigen::MatrixXd W_ = Eigen::MatrixXd::Zero(32, 3);
};

class LandmarkReduction {
 public:
  LandmarkReduction(const Bundle& bundle, const UnknownLayout& layout)
      : bundle_(bundle), layout_(layout), by_landmark_(bundle.markers.size()) {
    for (size_t c = 0; c < bundle.cameras.size(); ++c) {
      rows_of_camera_.emplace_back(bundle.cameras[c],
                                   internal::RowColumns{.params = true,
                                                        .extrinsics = layout.extrinsics[c] >= 0,
                                                        .pose = true,
                                                        .marker = true});
    }
    system_.head = layout.head;
    int next = layout.head;
    std::vector<bool> observed(bundle.T_rig_target.size(), false);
    const std::span<const BundleObservation> all = bundle.observations;
    for (size_t begin = 0, end = 0; begin < all.size(); begin = end) {
      end = EndOfMarker(bundle.observations, begin);
      const auto run = all.subspan(begin, end - begin);
      if (std::ranges::none_of(run, &BundleObservation::used)) continue;
      by_landmark_[static_cast<size_t>(run.front().marker)].push_back(run);
      observed[static_cast<size_t>(run.front().frame)] = true;
    }
    for (size_t frame = 0; frame < observed.size(); ++frame) {
      const bool free = observed[frame] && bundle.fixed_frame != frame;
      system_.pose.push_back(free ? std::exchange(next, next + 6) : -1);
    }
    system_.landmark.assign(bundle.markers.size(), -1);
    distances_ = internal::RowsOfDistances(
        bundle, [&](int m) { return !by_landmark_[static_cast<size_t>(m)].empty(); });
    for (const internal::DistanceRows& rows : distances_) {
      for (const int m : rows.Markers()) {
        int& index = system_.landmark[static_cast<size_t>(m)];
        if (index < 0) index = std::exchange(next, next + 3);
      }
    }
    system_.information = Eigen::MatrixXd::Zero(next, next);
  }

  PoseSystem Run() {
    LandmarkSums sums(static_cast<size_t>(system_.Size()));
    for (size_t m = 0; m < by_landmark_.size(); ++m) {
      if (by_landmark_[m].empty()) continue;
      sums.Clear();
      VisitLandmark(m, [&](const LandmarkRows& rows) { sums.Add(rows, &system_.information); });
      if (system_.landmark[m] < 0) {
        sums.Eliminate(&system_.information);
      } else {
        sums.Keep(system_.landmark[m], &system_.information);
      }
    }
    AddDistances();
    AddInformation(internal::RowsOfCalibrationPrior(bundle_, layout_), &system_.information);
    return std::move(system_);
  }

  LandmarkScores Scores(const Eigen::MatrixXd& directions, std::span<const int> group) {
    const Eigen::Index size = directions.cols();
    LandmarkScores scores;
    scores.gradients = Eigen::MatrixXd::Zero(size, static_cast<Eigen::Index>(by_landmark_.size()));
    for (const int g : group) {
      if (static_cast<size_t>(g) < scores.information.size()) continue;
      scores.information.resize(static_cast<size_t>(g) + 1, Eigen::MatrixXd::Zero(size, size));
    }
    for (size_t m = 0; m < by_landmark_.size(); ++m) {
      if (by_landmark_[m].empty()) continue;
      Eigen::MatrixXd& information = scores.information[static_cast<size_t>(group[m])];
      Eigen::VectorXd gradient = Eigen::VectorXd::Zero(size);
      Eigen::MatrixXd cross = Eigen::MatrixXd::Zero(size, 3);
      Eigen::Vector3d of_landmark = Eigen::Vector3d::Zero();
      Eigen::Matrix3d V = Eigen::Matrix3d::Zero();
      VisitLandmark(m, [&](const LandmarkRows& rows) {
        const Eigen::MatrixXd along = rows.J * directions(rows.columns, Eigen::all);
        information += along.transpose() * along;
        gradient += along.transpose() * rows.residual;
        cross += along.transpose() * rows.J_landmark;
        of_landmark += rows.J_landmark.transpose() * rows.residual;
        V += rows.J_landmark.transpose() * rows.J_landmark;
      });
      // The landmark's own gradient is zero only as far as the adjustment has converged.
      const Eigen::LLT<Eigen::Matrix3d> factor(V);
      if (system_.landmark[m] < 0 && factor.info() == Eigen::Success) {
        gradient -= cross * factor.solve(of_landmark);
        information -= cross * factor.solve(cross.transpose());
      }
      scores.gradients.col(static_cast<Eigen::Index>(m)) = gradient;
    }
    return scores;
  }

 private:
  // Calls add(rows) for the rows of one landmark in each view.
  template <typename Add>
  void VisitLandmark(size_t landmark, const Add& add) {
    for (const std::span<const BundleObservation> run : by_landmark_[landmark]) {
      const auto c = static_cast<size_t>(run.front().camera);
      const auto frame = static_cast<size_t>(run.front().frame);
      internal::MarkerRows& of_view = rows_of_camera_[c];
      of_view.Load(
          internal::ViewOf(bundle_, frame, c), bundle_.markers[landmark].position, run, {});
      if (of_view.Count() == 0) continue;
      SetRows(of_view, c, system_.pose[frame]);
      add(rows_);
    }
  }

  // Sets `rows_`. `pose`: index of the frame's pose, or -1.
  void SetRows(const internal::MarkerRows& of_view, size_t c, int pose) {
    const std::vector<int>& params = layout_.params[c];
    rows_.columns.clear();
    rows_.J.resize(of_view.Count(), static_cast<Eigen::Index>(params.size()) + 12);
    const auto add = [&](int column, const auto& J) {
      rows_.J.col(std::ssize(rows_.columns)) = J;
      rows_.columns.push_back(column);
    };
    for (size_t k = 0; k < params.size(); ++k) {
      const auto column = of_view.Params().col(static_cast<Eigen::Index>(k));
      const bool local = bundle_.cameras[c].model->support_size > 0;
      if (params[k] < 0 || (local && column.isZero(0))) continue;
      add(params[k], column);
    }
    const int extrinsics = layout_.extrinsics[c];
    for (int i = 0; extrinsics >= 0 && i < 6; ++i) add(extrinsics + i, of_view.Extrinsics().col(i));
    for (int i = 0; pose >= 0 && i < 6; ++i) add(pose + i, of_view.Pose().col(i));
    rows_.J.conservativeResize(Eigen::NoChange, std::ssize(rows_.columns));
    rows_.J_landmark = of_view.Position();
    rows_.residual = of_view.Residual();
  }

  void AddDistances() {
    for (const internal::DistanceRows& rows : distances_) {
      std::vector<Eigen::Vector3d> positions;
      std::vector<int> columns;
      for (const int m : rows.Markers()) {
        positions.push_back(bundle_.markers[static_cast<size_t>(m)].position);
        const int first = system_.landmark[static_cast<size_t>(m)];
        for (int i = 0; i < 3; ++i) columns.push_back(first + i);
      }
      Eigen::VectorXd residual;
      Eigen::MatrixXd J;
      if (!rows.Evaluate(positions, &residual, &J)) continue;
      const Eigen::MatrixXd square = J.transpose() * J;
      for (size_t i = 0; i < columns.size(); ++i) {
        for (size_t j = 0; j < columns.size(); ++j) {
          if (columns[i] < columns[j]) continue;  // the lower half alone is used
          system_.information(columns[i], columns[j]) +=
              square(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
        }
      }
    }
  }

  const Bundle& bundle_;
  const UnknownLayout& layout_;
  // Used observations of each landmark, those of a view together.
  std::vector<std::vector<std::span<const BundleObservation>>> by_landmark_;
  std::vector<internal::DistanceRows> distances_;
  PoseSystem system_;
  std::vector<internal::MarkerRows> rows_of_camera_;
  LandmarkRows rows_;
};

}  // namespace

PoseSystem EliminateLandmarks(const Bundle& bundle, const UnknownLayout& layout) {
  return LandmarkReduction(bundle, layout).Run();
}

LandmarkScores ScoreLandmarks(const Bundle& bundle,
                              const UnknownLayout& layout,
                              const Eigen::MatrixXd& directions,
                              std::span<const int> group) {
  return LandmarkReduction(bundle, layout).Scores(directions, group);
}

Eigen::MatrixXd HeadInformation(const PoseSystem& system) {
  const Eigen::Index head = system.head, tail = system.Size() - head;
  Eigen::MatrixXd information =
      system.information.topLeftCorner(head, head).selfadjointView<Eigen::Lower>();
  if (tail == 0 || head == 0) return information;
  const Eigen::LLT<Eigen::MatrixXd> factor(
      system.information.bottomRightCorner(tail, tail).selfadjointView<Eigen::Lower>());
  if (factor.info() != Eigen::Success) {
    throw JobError(
        "the scene points do not determine the poses of all frames; images that overlap "
        "more, or more of them, may");
  }
  const Eigen::MatrixXd half =
      factor.matrixL().solve(system.information.bottomLeftCorner(tail, head));
  information -= half.transpose() * half;
  return information;
}

std::vector<double> DegreesWithLandmarks(const Bundle& bundle) {
  const std::vector<double> coordinates = UsedCoordinates(bundle);
  std::set<int> frames, landmarks;
  for (const BundleObservation& observation : bundle.observations) {
    if (!observation.used) continue;
    frames.insert(observation.frame);
    landmarks.insert(observation.marker);
  }
  double shared = 6 * static_cast<double>(frames.size()) - (bundle.fixed_frame ? 6 : 0) +
                  3 * static_cast<double>(landmarks.size());
  for (const auto& group : bundle.DistanceGroups()) shared -= static_cast<double>(group.size());
  double all = 0;
  for (const double count : coordinates) all += count;
  const UnknownLayout layout = internal::MakeLayout(bundle);
  std::vector<double> degrees;
  for (size_t c = 0; c < coordinates.size(); ++c) {
    degrees.push_back(shared * coordinates[c] / std::max(1.0, all));
    if (bundle.prior) continue;  // which determines what the images leave open
    degrees.back() += layout.extrinsics[c] >= 0 ? 6 : 0;
    for (size_t k = 0; k < layout.params[c].size(); ++k) {
      const bool own = bundle.Root(c, k) == ParamIndex{c, k};
      degrees.back() += own && layout.params[c][k] >= 0 ? 1 : 0;
    }
  }
  return degrees;
}

}  // namespace plenocal
