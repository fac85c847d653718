// SPDX-License-Identifier: Apache-2.0
#include "assess/compare.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "assess/views/projection_jacobian.h"
#include "calib/base/format_error.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"
#include "calib/noise/matrix_root.h"

namespace plenocal {
namespace {

constexpr double kFarAway = 1e8;           // m: stands for infinity
constexpr double kDifferenceLevel = 0.01;  // of all parts and distances together
constexpr double kLensOffset = 8;          // px, of points in micro images from their lens' centre

struct Sample {
  size_t distance = 0, part = 0;
  std::array<double, kMaxObservationSize> values{};
  Eigen::Vector3d p_a;
};

std::vector<Sample> Samples(const CalibratedCamera& a, const std::vector<double>& distances) {
  std::vector<Sample> samples;
  // Through a micro lens the position in its image depends on the depth, so both count.
  static constexpr std::array<std::array<double, 2>, 4> kOffsets{
      {{kLensOffset, 0}, {-kLensOffset, 0}, {0, kLensOffset}, {0, -kLensOffset}}};
  const size_t lenses = a.model->plenoptic ? kOffsets.size() : 1;
  for (size_t d = 0; d < distances.size(); ++d) {
    for (int row = 0; row < kComparedRows; ++row) {
      for (int column = 0; column < kComparedColumns; ++column) {
        for (size_t lens = 0; lens < lenses; ++lens) {
          Sample sample;
          sample.distance = d;
          const int part = 3 * (row * 3 / kComparedRows) + column * 3 / kComparedColumns;
          sample.part = static_cast<size_t>(part);
          const double place[2] = {(column + 0.5) / kComparedColumns * a.image_size[0] - 0.5,
                                   (row + 0.5) / kComparedRows * a.image_size[1] - 0.5};
          const size_t measured = a.model->measured.size();
          for (size_t i = 0; i < measured; ++i) sample.values[i] = place[i % 2];
          for (size_t i = 0; i < a.model->context.size(); ++i) {
            sample.values[measured + i] = place[i % 2] + kOffsets[lens][i % 2];
          }
          const auto ray =
              a.model->Unproject(a.params.data(), a.config.data(), sample.values.data());
          if (!ray) continue;
          const double distance = std::isfinite(distances[d]) ? distances[d] : kFarAway;
          sample.p_a = ray->origin + distance * ray->direction;
          samples.push_back(sample);
        }
      }
    }
  }
  return samples;
}

// Derivative of an image point by the pose, in the chart of `Retract`, with the translation in
// `unit` metres.
Eigen::MatrixXd PoseColumns(const Eigen::MatrixXd& J_point,
                            const RigidTransform& T,
                            const Eigen::Vector3d& p,
                            double unit) {
  Eigen::MatrixXd J(J_point.rows(), 6);
  J.leftCols(3) = unit * J_point;
  J.rightCols(3) = -J_point * Hat(T.R * p);
  return J;
}

struct System {
  Eigen::VectorXd d;       // differences of all used samples, px
  Eigen::MatrixXd H;       // by the pose
  Eigen::MatrixXd G;       // by the parameters of b, then of a
  std::vector<size_t> of;  // sample of each group of rows
};

System Linearise(const CalibratedCamera& a,
                 const CalibratedCamera& b,
                 const std::vector<double>& distances,
                 const RigidTransform& T_b_a,
                 double unit,
                 const std::vector<Sample>& samples) {
  const auto rows = static_cast<Eigen::Index>(b.model->measured.size());
  const auto n_a = static_cast<Eigen::Index>(a.params.size());
  const auto n_b = static_cast<Eigen::Index>(b.params.size());
  System system;
  const auto most = rows * static_cast<Eigen::Index>(samples.size());
  system.d.resize(most);
  system.H.resize(most, 6);
  system.G.resize(most, n_b + n_a);
  Eigen::Index at = 0;
  for (size_t i = 0; i < samples.size(); ++i) {
    const Sample& sample = samples[i];
    ProjectionJacobian of_b, of_a;
    if (!Differentiate(b, sample.values.data(), T_b_a * sample.p_a, &of_b) ||
        !Differentiate(a, sample.values.data(), sample.p_a, &of_a)) {
      continue;
    }
    system.d.segment(at, rows) =
        of_b.predicted - Eigen::Map<const Eigen::VectorXd>(sample.values.data(), rows);
    // a images the point in the same pixel when the point moves by dp: J_a,params da + J_a,point dp
    // = 0.
    const Eigen::MatrixXd dp = -(PseudoInverse(Eigen::MatrixXd(of_a.by_point)) * of_a.by_params);
    // No translation changes what is infinitely far away.
    const double unit_here = std::isfinite(distances[sample.distance]) ? unit : 0;
    system.H.middleRows(at, rows) = PoseColumns(of_b.by_point, T_b_a, sample.p_a, unit_here);
    system.G.block(at, 0, rows, n_b) = of_b.by_params;
    system.G.block(at, n_b, rows, n_a) = of_b.by_point * T_b_a.R * dp;
    system.of.push_back(i);
    at += rows;
  }
  system.d.conservativeResize(at);
  system.H.conservativeResize(at, Eigen::NoChange);
  system.G.conservativeResize(at, Eigen::NoChange);
  return system;
}

// Of each row, 1 / the sigma that a root of the covariance of both cameras' parameters predicts, so
// that the motion is what the image shows where both know it. No row counts more than ten typical
// ones.
Eigen::VectorXd Weights(const System& system, const Eigen::MatrixXd& root, Eigen::Index rows) {
  if (root.size() == 0) return Eigen::VectorXd::Ones(system.d.size());
  constexpr double kLeast = 0.01;
  const Eigen::MatrixXd M = system.G * root;
  std::vector<double> variances;
  for (Eigen::Index at = 0; at < M.rows(); at += rows) {
    variances.push_back(M.middleRows(at, rows).squaredNorm());
  }
  const double least = kLeast * Median(variances);
  Eigen::VectorXd weights(M.rows());
  for (size_t i = 0; i < variances.size(); ++i) {
    weights.segment(rows * static_cast<Eigen::Index>(i), rows)
        .setConstant(1 / std::sqrt(variances[i] + least));
  }
  return weights;
}

// The motion that compensates differences in pixels best, by columns.
Eigen::MatrixXd MotionFor(const System& system,
                          const Eigen::VectorXd& weights,
                          const Eigen::MatrixXd& differences) {
  return -LeastSquares(weights.asDiagonal() * system.H,
                       Eigen::MatrixXd(weights.asDiagonal() * differences));
}

ImageDifference Judge(const System& system,
                      const Eigen::MatrixXd& M,
                      const std::vector<size_t>& groups,
                      Eigen::Index rows,
                      bool has_prediction) {
  ImageDifference result;
  double squares = 0;
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(M.cols(), M.cols());
  for (const size_t group : groups) {
    const Eigen::Index at = rows * static_cast<Eigen::Index>(group);
    const double square = system.d.segment(at, rows).squaredNorm();
    squares += square;
    result.largest = std::max(result.largest, std::sqrt(square));
    information += M.middleRows(at, rows).transpose() * M.middleRows(at, rows);
  }
  result.points = static_cast<int>(groups.size());
  if (groups.empty()) return result;
  result.rms = std::sqrt(squares / static_cast<double>(groups.size()));
  if (!has_prediction) return result;
  result.predicted = std::sqrt(information.trace() / static_cast<double>(groups.size()));
  result.probability =
      TailOfWeightedSquares(squares, information.trace(), information.squaredNorm());
  return result;
}

void RefuseDifferentCameras(const CalibratedCamera& a, const CalibratedCamera& b) {
  if (a.image_size != b.image_size) {
    throw InputError(
        "{}: one calibration is of images of {} x {} px, the other of {} x "
        "{}; only calibrations for equal images can be compared",
        a.name,
        a.image_size[0],
        a.image_size[1],
        b.image_size[0],
        b.image_size[1]);
  }
  if (!std::ranges::equal(a.model->measured, b.model->measured) ||
      !std::ranges::equal(a.model->context, b.model->context)) {
    throw InputError(
        "{}: {} and {} do not measure the same in an image, so that they "
        "cannot be compared",
        a.name,
        a.model->name,
        b.model->name);
  }
}

// Two calibrations of one camera at some distances.
class Comparison {
 public:
  Comparison(const CalibratedCamera& a,
             const CalibratedCamera& b,
             const std::vector<double>& distances)
      : a_(a),
        b_(b),
        distances_(distances),
        samples_(Samples(a, distances)),
        rows_(static_cast<Eigen::Index>(b.model->measured.size())) {
    unit_ = *std::ranges::min_element(distances);
    if (!std::isfinite(unit_)) unit_ = 1;
    result_.name = a.name;
    const Eigen::Index n_b = b.covariance.rows(), n_a = a.covariance.rows();
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(n_b + n_a, n_b + n_a);
    covariance.topLeftCorner(n_b, n_b) = b.covariance;
    covariance.bottomRightCorner(n_a, n_a) = a.covariance;
    result_.has_prediction = covariance.allFinite() && covariance.squaredNorm() > 0;
    if (result_.has_prediction) root_ = Root(covariance);
  }

  CameraDifference Run() {
    FindMotion();
    const System system = LineariseHere();
    const Eigen::MatrixXd motion = MotionFor(system, Weights(system, root_, rows_), system.G);
    result_.T_b_a_by_b = motion.leftCols(b_.covariance.rows());
    result_.T_b_a_by_a = motion.rightCols(a_.covariance.rows());
    for (Eigen::MatrixXd* each : {&result_.T_b_a_by_a, &result_.T_b_a_by_b}) {
      each->topRows(3) *= unit_;
    }
    Eigen::MatrixXd M = Eigen::MatrixXd::Zero(system.G.rows(), 1);
    if (result_.has_prediction) M = (system.G + system.H * motion) * root_;
    result_.same = result_.has_prediction;
    for (size_t d = 0; d < distances_.size(); ++d) {
      result_.distances.push_back(JudgeDistance(d, system, M));
      for (const ImageDifference& part : result_.distances.back().parts) {
        result_.same = result_.same && !part.differs;
      }
    }
    return std::move(result_);
  }

 private:
  System LineariseHere() { return Linearise(a_, b_, distances_, result_.T_b_a, unit_, samples_); }

  // Gauss-Newton for the implied motion. Where nothing determines the translation (all is far away)
  // the shortest step leaves it alone.
  void FindMotion() {
    constexpr int kIterations = 20;
    constexpr double kConverged = 1e-12;
    for (int i = 0; i < kIterations; ++i) {
      const System system = LineariseHere();
      if (system.of.size() < 6) {
        throw JobError("{}: hardly a pixel of one calibration is seen by the other", a_.name);
      }
      Vector6d step = MotionFor(system, Weights(system, root_, rows_), system.d);
      step.head<3>() *= unit_;
      result_.T_b_a = Retract(result_.T_b_a, step);
      if (step.norm() < kConverged * std::max(1.0, unit_)) return;
    }
  }

  [[nodiscard]] DistanceDifference JudgeDistance(size_t d,
                                                 const System& system,
                                                 const Eigen::MatrixXd& M) const {
    const double limit = kDifferenceLevel / (9.0 * static_cast<double>(distances_.size()));
    DistanceDifference at;
    at.distance = distances_[d];
    std::vector<size_t> all;
    std::array<std::vector<size_t>, 9> parts;
    for (size_t group = 0; group < system.of.size(); ++group) {
      const Sample& sample = samples_[system.of[group]];
      if (sample.distance != d) continue;
      all.push_back(group);
      const Eigen::Index row = rows_ * static_cast<Eigen::Index>(group);
      at.pixels.push_back({{sample.values[0], sample.values[1]},
                           system.d.segment<2>(row),
                           M.middleRows(row, rows_).norm()});
      parts[sample.part].push_back(group);
    }
    at.all = Judge(system, M, all, rows_, result_.has_prediction);
    for (size_t p = 0; p < parts.size(); ++p) {
      at.parts[p] = Judge(system, M, parts[p], rows_, result_.has_prediction);
      at.parts[p].differs = result_.has_prediction && at.parts[p].probability < limit;
      at.all.differs = at.all.differs || at.parts[p].differs;
    }
    return at;
  }

  const CalibratedCamera& a_;
  const CalibratedCamera& b_;
  const std::vector<double>& distances_;
  const std::vector<Sample> samples_;
  Eigen::Index rows_;     // of one sample
  double unit_ = 1;       // of translations, m
  Eigen::MatrixXd root_;  // of the covariance of b's parameters, then a's; empty: not known
  CameraDifference result_;
};

}  // namespace

CameraDifference CompareCameras(const CalibratedCamera& a,
                                const CalibratedCamera& b,
                                const std::vector<double>& distances) {
  RefuseDifferentCameras(a, b);
  return Comparison(a, b, distances).Run();
}

namespace {

// A transform and its derivatives by all errors of two files, in the chart of `Retract`.
struct ErringTransform {
  RigidTransform T;
  Eigen::MatrixXd J;

  ErringTransform operator*(const ErringTransform& b) const {
    ErringTransform product{T * b.T, J};
    product.J.topRows(3) += T.R * b.J.topRows(3) - Hat(T.R * b.T.t) * J.bottomRows(3);
    product.J.bottomRows(3) += T.R * b.J.bottomRows(3);
    return product;
  }
  [[nodiscard]] ErringTransform Inverse() const {
    ErringTransform inverse{T.Inverse(), -J};
    inverse.J.topRows(3) -= Hat(T.t) * J.bottomRows(3);
    inverse.J.topRows(3) = (T.R.transpose() * inverse.J.topRows(3)).eval();
    inverse.J.bottomRows(3) = (T.R.transpose() * inverse.J.bottomRows(3)).eval();
    return inverse;
  }
};

}  // namespace

ExtrinsicsDifference CompareExtrinsics(const Counterparts& master,
                                       const Counterparts& camera,
                                       const Correlations& of_a,
                                       const Correlations& of_b) {
  const Eigen::MatrixXd C_a = JointCovariance({&master.a, &camera.a}, of_a);
  const Eigen::MatrixXd C_b = JointCovariance({&master.b, &camera.b}, of_b);
  // Places of the errors: each file's as in its covariance, those of b after those of a.
  struct Places {
    Eigen::Index a = 0, b = 0;
  };
  const Places of_master{0, C_a.rows()};
  const Places of_camera{master.a.covariance.rows() + 6,
                         C_a.rows() + master.b.covariance.rows() + 6};
  const auto none = [&] { return Eigen::MatrixXd::Zero(6, C_a.rows() + C_b.rows()).eval(); };
  const auto place_on_rig = [&](const CalibratedCamera& each, Eigen::Index first) {
    ErringTransform result{each.T_camera_rig, none()};
    result.J.middleCols<6>(first + each.covariance.rows()) =
        Inverse(LogJacobian(each.T_camera_rig));
    return result;
  };
  const auto implied = [&](const CameraDifference& difference, const Places& first) {
    ErringTransform result{difference.T_b_a, none()};
    result.J.middleCols(first.a, difference.T_b_a_by_a.cols()) = difference.T_b_a_by_a;
    result.J.middleCols(first.b, difference.T_b_a_by_b.cols()) = difference.T_b_a_by_b;
    return result;
  };
  const ErringTransform found =
      place_on_rig(camera.b, of_camera.b) * place_on_rig(master.b, of_master.b).Inverse();
  const ErringTransform expected =
      implied(camera.difference, of_camera) * place_on_rig(camera.a, of_camera.a) *
      (implied(master.difference, of_master) * place_on_rig(master.a, of_master.a)).Inverse();
  const Vector6d difference = LocalCoordinates(expected.T, found.T);
  ExtrinsicsDifference result;
  result.translation = difference.head<3>().norm();
  result.rotation = difference.tail<3>().norm();
  result.has_prediction = C_a.allFinite() && C_b.allFinite();
  if (!result.has_prediction) return result;
  const Eigen::MatrixXd J = found.J - expected.J;
  const Matrix6d covariance = J.leftCols(C_a.rows()) * C_a * J.leftCols(C_a.rows()).transpose() +
                              J.rightCols(C_b.rows()) * C_b * J.rightCols(C_b.rows()).transpose();
  result.has_prediction = covariance.diagonal().minCoeff() > 0;
  if (!result.has_prediction) return result;
  result.translation_sigma = std::sqrt(covariance.diagonal().head<3>().sum());
  result.rotation_sigma = std::sqrt(covariance.diagonal().tail<3>().sum());
  const Eigen::MatrixXd root = InverseRoot(covariance);
  result.probability = ChiSquareTail(static_cast<double>(root.cols()),
                                     (root.transpose() * difference).squaredNorm());
  result.differs = result.probability < kDifferenceLevel;
  return result;
}

double ImageSigma(const CalibratedCamera& camera, const std::vector<double>& distances) {
  if (!camera.covariance.allFinite()) return std::numeric_limits<double>::infinity();
  CalibratedCamera exact = camera;
  exact.covariance.setZero();
  double squares = 0;
  for (const DistanceDifference& at : CompareCameras(camera, exact, distances).distances) {
    squares += at.all.predicted * at.all.predicted;
  }
  return std::sqrt(squares / static_cast<double>(distances.size()));
}

}  // namespace plenocal
