// SPDX-License-Identifier: Apache-2.0
//
// The models of formulas.model.yaml, from their headers.
#include "models/plugin/plugin.h"
#include "written_map.h"
#include "written_radius.h"

PLENOCAL_CAMERA_MODEL_PLUGIN(plenocal::WrittenRadius, plenocal::WrittenMap)
