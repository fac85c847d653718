// SPDX-License-Identifier: Apache-2.0
//
// Observations as entries of the detection cache.
#pragma once

#include "calib/camera/observation.h"
#include "calib/io/detection_cache.h"

namespace plenocal {

/// Writes an observation into an entry of the detection cache.
inline void PutObservation(const Observation& seen, CacheEntryWriter* writer) {
  writer->Put(seen.marker);
  for (const double value : seen.values) writer->Put(value);
  writer->Put(seen.detector_sigma);
  writer->Put(seen.lens_type);
}

/// The next observation of an entry.
inline Observation GetObservation(CacheEntryReader* reader) {
  Observation seen;
  seen.marker = reader->Get<int>();
  for (double& value : seen.values) value = reader->Get<double>();
  seen.detector_sigma = reader->Get<double>();
  seen.lens_type = reader->Get<int>();
  return seen;
}

}  // namespace plenocal
