// SPDX-License-Identifier: Apache-2.0
//
// Edits a session's text and leaves all other bytes as they are.
#pragma once

#include <string>
#include <vector>

#include "calib/files/session.h"

namespace plenocal::workbench {

/// With one more rule in `exclude`, which is added where there is none. Nothing but this line
/// changes.
std::string WithRule(const std::string& text, const ExcludeRule& rule);

/// Without the line of a rule that `WithRule` wrote, and without `exclude:` when it was the only
/// one. Throws `Error` of kind kInput when no line is that rule: the text is to be edited then.
std::string WithoutRule(const std::string& text, const ExcludeRule& rule);

/// With another value of the key that `path` leads to, {"cameras", "left", "model"}; the line stays
/// with its comment, and a key that is missing is added. Throws `Error` of kind kInput for a value
/// that is not plain (a number, a length, a name), and when the key stands in the text in a way
/// that has to be edited by hand.
std::string WithValue(const std::string& text,
                      const std::vector<std::string>& path,
                      const std::string& value);

/// Without a key that is not indented, and the lines that belong to it.
std::string WithoutKey(const std::string& text, const std::string& key);

}  // namespace plenocal::workbench
