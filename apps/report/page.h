// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <initializer_list>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

namespace plenocal {

/// One HTML file that needs no network: the page's style, charts and elements, then `scripts`,
/// which find `data` in `report`.
std::string MakePage(std::string_view title,
                     std::initializer_list<std::string_view> scripts,
                     const nlohmann::json& data);

}  // namespace plenocal
