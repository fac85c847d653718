// SPDX-License-Identifier: Apache-2.0
//
// The models of formulas.model.yaml, from their headers.
#include "formula_map.h"
#include "formula_radius.h"
#include "models/plugin/plugin.h"

PLENOCAL_CAMERA_MODEL_PLUGIN(plenocal::FormulaRadius, plenocal::FormulaMap)
