// SPDX-License-Identifier: Apache-2.0
//
// Puts text, data and components together to a page of one HTML file.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "apps/report/page_text.h"

namespace plenocal {

/// One HTML file that needs no network: `text` for readers without script, and `data`, from which
/// the components of web/src/report make the page of its `kind`.
std::string MakePage(std::string_view title, const PageText& text, const nlohmann::json& data);

}  // namespace plenocal
