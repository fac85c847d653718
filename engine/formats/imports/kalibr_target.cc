// SPDX-License-Identifier: Apache-2.0
//
// Target files of Kalibr, which `ReadTarget` reads as they are.
#include "engine/formats/import_format.h"
#include "targets/target.h"

namespace plenocal {
namespace {

ImportedFile ReadKalibrTarget(const ImportSource& source) {
  return {.content = ReadTarget(source.path).nominal_yaml, .message = {}};
}

}  // namespace

ImportFormat KalibrTargetFormat() {
  return {.name = "kalibr-target", .source = {}, .result = "target.yaml", .read = ReadKalibrTarget};
}

}  // namespace plenocal
