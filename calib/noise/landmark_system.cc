// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/landmark_system.h"

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "calib/adjust/priors.h"
#include "calib/adjust/rows.h"
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

// Parts of the system that one landmark touches.
struct LandmarkSums {
  Eigen::Matrix3d V = Eigen::Matrix3d::Zero();
  std::map<int, Eigen::Vector3d> W;  // columns by other unknowns that are not zero

  // Adds rows' rows: the part without the landmark to `S`, the others here.
  void Add(const LandmarkRows& rows, Eigen::MatrixXd* S) {
    const Eigen::MatrixXd square = rows.J.transpose() * rows.J;
    const Eigen::MatrixXd cross = rows.J_landmark.transpose() * rows.J;
    V += rows.J_landmark.transpose() * rows.J_landmark;
    for (Eigen::Index i = 0; i < std::ssize(rows.columns); ++i) {
      const int column = rows.columns[static_cast<size_t>(i)];
      W.try_emplace(column, Eigen::Vector3d::Zero()).first->second += cross.col(i);
      for (Eigen::Index j = 0; j <= i; ++j) {
        const auto [low, high] = std::minmax(column, rows.columns[static_cast<size_t>(j)]);
        (*S)(high, low) += square(i, j);
        // Two columns of one index (tied parameters) stand for both halves of the square.
        if (i != j && low == high) (*S)(high, low) += square(i, j);
      }
    }
  }
  // S -= W' V^-1 W
  void Eliminate(Eigen::MatrixXd* S) {
    const Eigen::LLT<Eigen::Matrix3d> factor(V);
    if (factor.info() != Eigen::Success) return;
    std::vector<std::pair<int, Eigen::Vector3d>> columns(W.begin(), W.end());
    for (auto& [column, w] : columns) factor.matrixL().solveInPlace(w);
    for (size_t j = 0; j < columns.size(); ++j) {
      double* const out = &(*S)(0, columns[j].first);
      for (size_t i = j; i < columns.size(); ++i) {
        out[columns[i].first] -= columns[i].second.dot(columns[j].second);
      }
    }
  }
  // For a landmark that stays, at `index` of S.
  void Keep(int index, Eigen::MatrixXd* S) const {
    S->block<3, 3>(index, index) += V;
    for (const auto& [column, w] : W) S->block<3, 1>(index, column) += w;
  }
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
    const auto observed_landmark = [&](int m) {
      return by_landmark_[static_cast<size_t>(m)].empty() ? -1 : 3 * m;
    };
    for (const internal::SparseRow& row :
         internal::RowsOfDistances(bundle, layout, observed_landmark, bundle)) {
      for (const auto& [unknown, derivative] : row.J) {
        int& index = system_.landmark[static_cast<size_t>(unknown / 3)];
        if (index < 0) index = std::exchange(next, next + 3);
      }
    }
    system_.information = Eigen::MatrixXd::Zero(next, next);
  }

  PoseSystem Run() {
    for (size_t m = 0; m < by_landmark_.size(); ++m) {
      if (by_landmark_[m].empty()) continue;
      LandmarkSums sums;
      VisitLandmark(m, [&](const LandmarkRows& rows) { sums.Add(rows, &system_.information); });
      if (system_.landmark[m] < 0) {
        sums.Eliminate(&system_.information);
      } else {
        sums.Keep(system_.landmark[m], &system_.information);
      }
    }
    const auto index = [&](int m) { return system_.landmark[static_cast<size_t>(m)]; };
    AddInformation(internal::RowsOfDistances(bundle_, layout_, index, bundle_),
                   &system_.information);
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
    rows_.columns.clear();
    rows_.J.resize(of_view.Count(), std::ssize(layout_.params[c]) + 12);
    const auto add = [&](int first, const auto& by) {
      if (by.isZero(0)) return;  // of local models nearly all
      rows_.J.middleCols(std::ssize(rows_.columns), by.cols()) = by;
      for (int i = 0; i < by.cols(); ++i) rows_.columns.push_back(first + i);
    };
    internal::ForEachDerivative(bundle_, layout_, c, of_view, add);
    if (pose >= 0) add(pose, of_view.Pose());
    rows_.J.conservativeResize(Eigen::NoChange, std::ssize(rows_.columns));
    rows_.J_landmark = of_view.Position();
    rows_.residual = of_view.Residual();
  }

  const Bundle& bundle_;
  const UnknownLayout& layout_;
  // Used observations of each landmark, those of a view together.
  std::vector<std::vector<std::span<const BundleObservation>>> by_landmark_;
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
  shared -= static_cast<double>(bundle.distances.size()) + (bundle.scale_distance ? 1 : 0);
  double all = 0;
  for (const double count : coordinates) all += count;
  const UnknownLayout layout = internal::MakeLayout(bundle);
  std::vector<double> degrees;
  for (size_t c = 0; c < coordinates.size(); ++c) {
    degrees.push_back(shared * coordinates[c] / std::max(1.0, all));
    // A prior determines what the images leave open.
    if (!bundle.prior) degrees.back() += layout.first[c + 1] - layout.first[c];
  }
  return degrees;
}

}  // namespace plenocal
