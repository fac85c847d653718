// SPDX-License-Identifier: Apache-2.0
#include "assess/stress/part_calibration.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "calib/adjust/solver/adjust.h"
#include "calib/base/format_error.h"
#include "calib/estimate/reject.h"
#include "calib/noise/frame_scatter.h"

namespace plenocal {
namespace {

void RequirePoints(const Bundle& bundle) {
  std::vector<size_t> points(bundle.cameras.size(), 0);
  for (const BundleObservation& observation : bundle.observations) {
    points[static_cast<size_t>(observation.camera)] += observation.used ? 1 : 0;
  }
  for (size_t c = 0; c < points.size(); ++c) {
    if (points[c] >= kFewestPartPoints) continue;
    throw JobError("a calibration with {} points of {}; it needs {}",
                   points[c],
                   bundle.cameras[c].name,
                   kFewestPartPoints);
  }
}

void ScaleUncertainty(PartCalibration* part) {
  Calibration& calibration = part->calibration;
  const auto [of_frames, of_markers] = EstimateScatter(calibration.bundle, calibration.uncertainty);
  for (size_t c = 0; c < of_frames.size(); ++c) {
    part->factors.push_back(std::max(1.0, of_frames[c].factor) +
                            std::max(0.0, of_markers[c].factor - 1));
    part->degrees.push_back(std::max(1.0, of_frames[c].degrees));
  }
  ScaleByScatter(part->factors, &calibration.uncertainty);
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
    result.at_optimum_of_all = EstimateUncertainty(calibration.bundle);
    const AdjustSummary summary =
        Adjust(&calibration.bundle,
               {.loss = loss, .cost_tolerance = 1e-9, .on_iteration = [&](int, double) {
                  return go_on();
                }});
    if (summary.stopped) throw Stopped();
    if (!summary.usable) throw Error(ErrorKind::kJob, summary.message);
    calibration.uncertainty = EstimateUncertainty(calibration.bundle);
    ScaleUncertainty(&result);
  } catch (const Error& error) {
    result.failure = error.what();
  }
  return result;
}

void UsePart(const Bundle& all, const PartOfObservations& part, Bundle* bundle) {
  for (size_t i = 0; i < part.size(); ++i) {
    bundle->observations[i].used = all.observations[i].used && part[i];
  }
  DropWeakFrames(bundle);
}

double RmsResidual(const Bundle& bundle, size_t camera) {
  double squares = 0, points = 0;
  const size_t measured = bundle.cameras[camera].model->measured.size();
  for (const BundleObservation& observation : bundle.observations) {
    std::array<double, kMaxObservationSize> residual{};
    if (!observation.used || observation.camera != static_cast<int>(camera) ||
        !Residual(bundle, observation, residual.data())) {
      continue;
    }
    for (size_t r = 0; r < measured; ++r) squares += residual[r] * residual[r];
    points += 1;
  }
  return std::sqrt(squares / points);
}

}  // namespace plenocal
