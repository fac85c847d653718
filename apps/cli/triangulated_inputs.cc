// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/triangulated_inputs.h"

#include "calib/base/format_error.h"
#include "engine/session/open_session.h"

namespace plenocal {

Triangulation TriangulateGiven(const std::vector<std::string>& given,
                               TriangulateRequest request,
                               const Run& run) {
  const bool is_session =
      given.size() == 1 && given[0].find('=') == std::string::npos && !given[0].ends_with(".csv");
  if (is_session) {
    if (request.at.empty()) return TriangulatePoints(OpenSession(given[0]), request, run);
    throw InputError("--at goes with images, as left=a.png right=b.png");
  }
  for (const std::string& word : given) {
    const size_t equals = word.find('=');
    if (equals == std::string::npos || equals == 0) {
      throw InputError("{}: expected a camera and its table, as left=left.csv, or a session alone",
                       word);
    }
    request.files.emplace_back(word.substr(0, equals), word.substr(equals + 1));
  }
  return TriangulatePoints(request, run);
}

}  // namespace plenocal
