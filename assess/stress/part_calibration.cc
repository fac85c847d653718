// SPDX-License-Identifier: Apache-2.0
#include "assess/stress/part_calibration.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "calib/adjust/poses.h"
#include "calib/adjust/solver/adjust.h"
#include "calib/base/format_error.h"
#include "calib/estimate/reject.h"
#include "calib/noise/frame_scatter.h"

namespace plenocal {
namespace {

void UsePart(const Bundle& all, const PartOfObservations& part, Bundle* bundle) {
  for (size_t i = 0; i < part.size(); ++i) {
    bundle->observations[i].used = all.observations[i].used && part[i];
  }
  DropWeakFrames(bundle);
}

void RequirePoints(const Bundle& bundle) {
  std::vector<size_t> points(bundle.cameras.size(), 0);
  for (const BundleObservation& observation : bundle.observations) {
    points[static_cast<size_t>(observation.camera)] += observation.used ? 1 : 0;
  }
  if (std::ranges::min(points) >= kFewestPartPoints) return;
  throw JobError("a part of the points has fewer than {}", kFewestPartPoints);
}

void ScaleUncertainty(PartCalibration* part) {
  Calibration& calibration = part->calibration;
  const auto [of_frames, of_markers] =
      EstimateScatter(calibration.bundle, calibration.uncertainty);
  std::vector<double> factors;
  for (size_t c = 0; c < of_frames.size(); ++c) {
    factors.push_back(std::max(1.0, of_frames[c].factor) +
                      std::max(0.0, of_markers[c].factor - 1));
    part->degrees.push_back(std::max(1.0, of_frames[c].degrees));
  }
  ScaleByScatter(factors, &calibration.uncertainty);
}

}  // namespace

PartCalibration CalibratePart(const Calibration& all,
                              const PartOfObservations& part,
                              Loss loss,
                              const std::function<bool()>& go_on) {
  PartCalibration result;
  Calibration& calibration = result.calibration;
  calibration.frames = all.frames;
  calibration.fits = all.fits;
  calibration.bundle = all.bundle;
  UsePart(all.bundle, part, &calibration.bundle);
  try {
    RequirePoints(calibration.bundle);
    const AdjustSummary summary = Adjust(&calibration.bundle,
                                         {.loss = loss,
                                          .cost_tolerance = 1e-9,
                                          .on_iteration = [&](int, double) { return go_on(); }});
    if (summary.stopped) throw Stopped();
    if (!summary.usable) throw Error(ErrorKind::kJob, summary.message);
    calibration.uncertainty = EstimateUncertainty(calibration.bundle);
    ScaleUncertainty(&result);
  } catch (const Error& error) {
    result.failure = error.what();
  }
  return result;
}

void ResidualSum::operator+=(const ResidualSum& other) {
  squares += other.squares;
  points += other.points;
  unseen += other.unseen;
}

double ResidualSum::Rms() const { return std::sqrt(squares / points); }

ResidualSum SumResiduals(const Bundle& bundle, size_t camera) {
  ResidualSum sum;
  for (const BundleObservation& observation : bundle.observations) {
    if (!observation.used || observation.camera != static_cast<int>(camera)) continue;
    std::array<double, kMaxObservationSize> residual{};
    if (!Residual(bundle, observation, residual.data())) {
      ++sum.unseen;
      continue;
    }
    sum.points += 1;
    for (size_t r = 0; r < bundle.cameras[camera].model->measured.size(); ++r) {
      sum.squares += residual[r] * residual[r];
    }
  }
  return sum;
}

Bundle WithOwnPoses(const Bundle& trained, const Bundle& all, const PartOfObservations& part) {
  Bundle bundle = all;
  bundle.cameras = trained.cameras;
  bundle.markers = trained.markers;
  UsePart(all, part, &bundle);
  AdjustPoses(&bundle, std::vector<bool>(bundle.T_rig_target.size(), true));
  return bundle;
}

}  // namespace plenocal
