// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string_view>

namespace plenocal::workbench {

/// A file of the page, built from web/ and part of the program.
struct Page {
  std::string_view name, type, content;
};

std::span<const Page> Pages();

}  // namespace plenocal::workbench
