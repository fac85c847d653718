// SPDX-License-Identifier: Apache-2.0
#include "calib/judge/target_trial.h"

#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <tuple>

#include "calib/base/error.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

using Point = std::tuple<size_t, int, std::array<double, kMaxObservationSize>>;

Point PointOf(size_t camera, const Observation& seen) { return {camera, seen.marker, seen.values}; }

/// Sums over the points of a frame that both trials image.
struct FrameSquares {
  double rigid = 0, refined = 0;  ///< px^2
  double points = 0;
};

double SquareOf(const HeldOutPoint& point) {
  double square = 0;
  for (const double residual : point.residual) square += residual * residual;
  return square;
}

std::vector<FrameSquares> Squares(const CalibrationInput& input,
                                  const std::vector<HeldOutPoint>& rigid,
                                  const std::vector<HeldOutPoint>& refined) {
  std::map<Point, double> square_if_refined;
  for (const HeldOutPoint& point : refined) {
    square_if_refined[PointOf(point.camera, point.seen)] = SquareOf(point);
  }
  std::map<Point, std::string> frame_of;
  for (size_t c = 0; c < input.cameras.size(); ++c) {
    for (const View& view : input.cameras[c].views) {
      for (const Observation& seen : view.observations) frame_of[PointOf(c, seen)] = view.frame;
    }
  }
  std::map<std::string, FrameSquares> frames;
  for (const HeldOutPoint& point : rigid) {
    const Point name = PointOf(point.camera, point.seen);
    const auto other = square_if_refined.find(name);
    if (other == square_if_refined.end()) continue;
    FrameSquares& frame = frames[frame_of.at(name)];
    frame.rigid += SquareOf(point);
    frame.refined += other->second;
    frame.points += 1;
  }
  std::vector<FrameSquares> squares;
  for (const auto& [name, frame] : frames) squares.push_back(frame);
  return squares;
}

// Of so much smaller squares with refinement, frame by frame, if both were equally good.
double ProbabilityOfGain(const std::vector<FrameSquares>& frames, size_t folds) {
  constexpr double kExact = 1e-6;  // px; smaller residuals are rounding
  double sum = 0, points = 0, squares = 0;
  std::vector<double> gains;
  for (const FrameSquares& frame : frames) {
    const double rounding = frame.points * kExact * kExact;
    gains.push_back(frame.points * std::log((frame.rigid + rounding) / (frame.refined + rounding)));
    sum += gains.back();
    points += frame.points;
  }
  if (!(sum > 0)) return 1;
  for (size_t f = 0; f < frames.size(); ++f) {
    squares += std::pow(gains[f] - sum / points * frames[f].points, 2);
  }
  const auto n = static_cast<double>(frames.size()), k = static_cast<double>(folds);
  return StudentTail(sum / std::sqrt(squares * n / (n - 1) * (1 + k / (k - 1))), n - 1);
}

}  // namespace

TargetTrial TryTarget(const CalibrationInput& input,
                      double marker_sigma,
                      const std::vector<size_t>& varied,
                      const CameraModel& model,
                      const TrialOptions& options) {
  constexpr double kSignificant = 0.05;
  const std::array models{&model};
  CalibrationInput variant = input;
  variant.marker_sigma = 0;
  const ModelChoice rigid = TryModels(variant, varied, models, options);
  variant.marker_sigma = marker_sigma;
  std::optional<ModelChoice> refined;
  try {
    refined = TryModels(variant, varied, models, options);
  } catch (const Error&) {
    return {.rms_rigid = rigid.trials[0].rms};
  }
  const auto frames = Squares(input, rigid.trials[0].held_out, refined->trials[0].held_out);
  TargetTrial trial;
  double points = 0;
  for (const FrameSquares& frame : frames) {
    trial.rms_rigid += frame.rigid;
    trial.rms_refined += frame.refined;
    points += frame.points;
  }
  trial.rms_rigid = std::sqrt(trial.rms_rigid / points);
  trial.rms_refined = std::sqrt(trial.rms_refined / points);
  trial.probability = ProbabilityOfGain(frames, rigid.folds);
  trial.refine = trial.rms_refined < trial.rms_rigid && trial.probability < kSignificant;
  return trial;
}

}  // namespace plenocal
