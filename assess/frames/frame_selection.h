// SPDX-License-Identifier: Apache-2.0
//
// Selection of the frames of a long recording by their information.
#pragma once

#include <vector>

#include "assess/views/rig_estimate.h"

namespace plenocal {

/// Frames in the order in which they were chosen, with the uncertainty that remains.
struct FrameSelection {
  std::vector<size_t> chosen;  ///< indices of the poses
  std::vector<double> sigma;   ///< px of the projection, after each of them
  double sigma_of_all = 0;     ///< px, of all poses
};

/// Chooses frames that were taken already, as `ChooseNextViews` does those to be taken: each next
/// one lowers the standard error of the projection most. `rig` gives parameters and extrinsics; its
/// own frames do not count. Stops at `most`, and where all others together lower sigma by less
/// than a fiftieth.
FrameSelection SelectFrames(const RigEstimate& rig,
                            const ViewTarget& shape,
                            const std::vector<RigidTransform>& T_rig_target,
                            size_t most,
                            int threads);

}  // namespace plenocal
