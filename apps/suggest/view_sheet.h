// SPDX-License-Identifier: Apache-2.0
//
// Draws suggested views as a picture.
#pragma once

#include <string>

#include "apps/charts/picture.h"
#include "assess/views/next_views.h"

namespace plenocal {

/// The content of a picture file: a row for each suggestion with the image of each camera as it
/// should look, the target white with its markers, over the points so far, and the suggestion in
/// words.
std::string DrawViewSheet(const NextViews& suggestions,
                          const RigEstimate& rig,
                          const ViewTarget& shape,
                          PictureFormat format);

}  // namespace plenocal
