// SPDX-License-Identifier: Apache-2.0
//
// Target files of Kalibr, which `ReadTarget` reads as they are.
#include "calib/base/format_error.h"
#include "engine/formats/import_format.h"
#include "targets/target.h"

namespace plenocal {
namespace {

ImportedFile ReadKalibrTarget(const ImportSource& source) {
  const Target target = ReadTarget(source.path);
  if (!target.unequal.empty()) {
    throw InputError(
        "{}: its rows and columns have unequal spacing, which a chessboard here has not; name this "
        "file itself as the session's target",
        source.path.string());
  }
  return {.content = RefinedTargetYaml(target, {}, {}), .message = {}};
}

}  // namespace

ImportFormat KalibrTargetFormat() {
  return {.name = "kalibr-target", .source = {}, .result = "target.yaml", .read = ReadKalibrTarget};
}

}  // namespace plenocal
