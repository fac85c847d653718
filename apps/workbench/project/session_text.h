// SPDX-License-Identifier: Apache-2.0
//
// Edits a session's text and leaves all other bytes as they are.
#pragma once

#include <string>

#include "calib/files/session.h"

namespace plenocal::workbench {

/// With one more rule in `exclude`, which is added where there is none. Nothing but this line
/// changes.
std::string WithRule(const std::string& text, const ExcludeRule& rule);

/// Without the line of a rule that `WithRule` wrote, and without `exclude:` when it was the only
/// one. Throws `Error` of kind kInput when no line is that rule: the text is to be edited then.
std::string WithoutRule(const std::string& text, const ExcludeRule& rule);

/// With another model of a camera. Throws `Error` of kind kInput when the text has not exactly one
/// place where it can stand: the text is to be edited then.
std::string WithModel(const std::string& text, const std::string& camera, const std::string& model);

}  // namespace plenocal::workbench
