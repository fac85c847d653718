// SPDX-License-Identifier: Apache-2.0
//
// Members of an observation in entries of the detection cache.
#pragma once

#include "calib/camera/observation.h"
#include "calib/io/cache_entry.h"

namespace plenocal {

template <MaybeConst<Observation> T>
auto EntryMembers(T& seen) {
  return std::tie(seen.marker, seen.values, seen.detector_sigma, seen.lens_type);
}

}  // namespace plenocal
