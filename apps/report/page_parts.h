// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

namespace plenocal {

// Files that the build puts into the program (embed.cmake).
extern const std::string_view kPageHtml;          ///< page.html
extern const std::string_view kPageCss;           ///< page.css
extern const std::string_view kPlotsJs;           ///< plots.js
extern const std::string_view kSceneJs;           ///< scene.js
extern const std::string_view kElementsJs;        ///< elements.js
extern const std::string_view kPageJs;            ///< page.js
extern const std::string_view kTrialPageJs;       ///< trial_page.js
extern const std::string_view kTruthPageJs;       ///< truth_page.js
extern const std::string_view kPhotometryPageJs;  ///< photometry_page.js
extern const std::string_view kChartLibrary;      ///< Chart.js of Debian's libjs-chart.js

}  // namespace plenocal
