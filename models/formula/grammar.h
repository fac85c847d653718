// SPDX-License-Identifier: Apache-2.0
//
// The text of a formula.
#pragma once

#include <map>
#include <string>
#include <string_view>

#include "models/formula/graph.h"

namespace plenocal::formula {

/// Names that a formula may use, and their nodes; -1: not defined yet.
using Names = std::map<std::string, int, std::less<>>;

/// The node of an expression or, with `condition`, of a comparison. Throws `Error` of kind kInput
/// with the column and the part of the text that is wrong.
int Parse(std::string_view text, const Names& names, bool condition, Graph* graph);

/// Whether a text may be the name of a variable: letters, digits and '_', and no function or `pi`.
bool IsName(std::string_view text);

}  // namespace plenocal::formula
