// SPDX-License-Identifier: Apache-2.0
//
// JSON as text.
#pragma once

#include <string>

namespace plenocal {

/// The text of a `nlohmann::basic_json`, indented by `indent` columns; -1: one line. Bytes that are
/// no UTF-8, as paths may have, are replaced.
template <class Json>
std::string JsonText(const Json& json, int indent = 2) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

}  // namespace plenocal
