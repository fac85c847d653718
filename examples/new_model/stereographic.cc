// SPDX-License-Identifier: Apache-2.0
#include "stereographic.h"

#include "models/plugin/plugin.h"

PLENOCAL_CAMERA_MODEL_PLUGIN(Stereographic)
