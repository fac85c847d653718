// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/pages.h"

#include <array>

namespace plenocal {

// Made by the build (cmake/embed.cmake).
std::string_view WorkbenchHtml();
std::string_view WorkbenchJs();
std::string_view WorkbenchCss();

}  // namespace plenocal

namespace plenocal::workbench {

std::span<const Page> Pages() {
  static const std::array pages{
      Page{"index.html", "text/html; charset=utf-8", WorkbenchHtml()},
      Page{"workbench.js", "text/javascript; charset=utf-8", WorkbenchJs()},
      Page{"workbench.css", "text/css; charset=utf-8", WorkbenchCss()}};
  return pages;
}

}  // namespace plenocal::workbench
