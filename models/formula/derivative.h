// SPDX-License-Identifier: Apache-2.0
//
// Exact derivatives of a formula, as nodes of its graph.
#pragma once

#include <span>
#include <vector>

#include "models/formula/graph.h"

namespace plenocal::formula {

/// Derivatives of `outputs` by an input. Conditions count as constant.
std::vector<int> Derivatives(Graph* graph, std::span<const int> outputs, int input);

}  // namespace plenocal::formula
