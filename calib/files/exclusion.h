// SPDX-License-Identifier: Apache-2.0
//
// The rules by which a session leaves out images and markers.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "calib/camera/observation.h"
#include "calib/files/frame_images.h"
#include "calib/files/session.h"

namespace plenocal {

/// The rules `exclude` of a session, applied to one camera after the other.
class Exclusion {
 public:
  explicit Exclusion(std::vector<ExcludeRule> rules);

  /// Removes the images of `camera` that are left out as a whole, and adds them to `left_out`.
  void RemoveImages(const std::string& camera,
                    std::vector<FrameImage>* images,
                    std::vector<LeftOut>* left_out);
  /// Removes views and observations of `camera` likewise. `images`: those of the camera, whose file
  /// names rules may give for frames; empty: its detections were read from a file.
  void RemoveViews(const std::string& camera,
                   const std::vector<FrameImage>& images,
                   std::vector<View>* views,
                   std::vector<LeftOut>* left_out);

  /// A sentence for each rule that has removed nothing so far, with the nearest name of a frame.
  [[nodiscard]] std::vector<std::string> Unused() const;

 private:
  std::vector<ExcludeRule> rules_;
  std::vector<bool> used_;        // per rule
  std::set<std::string> frames_;  // all that were seen, to name the nearest
};

}  // namespace plenocal
