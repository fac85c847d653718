// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/nuisance.h"

#include "calib/adjust/bundle.h"

namespace plenocal::nuisances {

constinit const NuisanceKind kSharedError{
    .name = "shared",
    .numbered = true,
    .unit = 2,  // the prior, of standard deviation 1, determines it
    .displace = [](const BundleObservation& observation,
                   size_t index,
                   size_t rows,
                   double value,
                   double* displacement) {
      const size_t stated = observation.by_nuisance.size() / rows;
      for (size_t r = 0; r < rows && index < stated; ++r) {
        displacement[r] += value * observation.by_nuisance[r * stated + index];
      }
    }};

constinit const NuisanceKind kTimeShift{
    .name = "time_shift",
    .pose_rate = [](const ViewMotion& motion) -> const Vector6d& { return motion.velocity; }};

}  // namespace plenocal::nuisances
