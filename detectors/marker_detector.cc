// SPDX-License-Identifier: Apache-2.0
#include "detectors/marker_detector.h"

#include <variant>

#include "calib/error.h"

namespace plenocal {
namespace {

template <typename... Functions>
struct Overloaded : Functions... {
  using Functions::operator()...;
};
template <typename... Functions>
Overloaded(Functions...) -> Overloaded<Functions...>;

}  // namespace

std::unique_ptr<MarkerDetector> MakeMarkerDetector(const Target& target) {
  using Result = std::unique_ptr<MarkerDetector>;
  return std::visit(
      Overloaded{[&](const TagLayout&) { return MakeTagDetector(target); },
                 [&](const ChessboardLayout&) { return MakeChessboardDetector(target); },
                 [&](const CharucoLayout&) { return MakeCharucoDetector(target); },
                 [&](const CirclesLayout&) { return MakeCirclesDetector(target); },
                 [](const MarkersLayout&) -> Result {
                   throw Error(
                       ErrorKind::kInput,
                       "a target of type markers has no detector; give the camera 'detections: "
                       "file.csv' instead of 'images'");
                 }},
      target.layout);
}

}  // namespace plenocal
