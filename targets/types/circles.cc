// SPDX-License-Identifier: Apache-2.0
#include "targets/types/circles.h"

#include <fmt/format.h>

#include <cmath>
#include <string>
#include <utility>

#include "calib/base/error.h"
#include "targets/reading.h"
#include "targets/target.h"

namespace plenocal {

namespace {

Eigen::Vector2d CircleAt(const CirclesLayout& circles, int column, int row) {
  const int step = circles.asymmetric ? 2 * column + row % 2 : column;
  return {step * circles.spacing, row * circles.spacing};
}

}  // namespace

MarkerPositions internal::CirclePositions(const CirclesLayout& circles) {
  return PlaneMarkers(circles.columns, circles.rows, [&](int column, int row) {
    return CircleAt(circles, column, row);
  });
}

Target CirclesLayout::Read(const YamlNode& node) {
  CirclesLayout circles;
  circles.columns = internal::ReadCount(node.At("columns"), 2);
  circles.rows = internal::ReadCount(node.At("rows"), 2);
  circles.spacing = internal::ReadPrintedLength(node.At("spacing"));
  const YamlNode pattern = node.At("pattern");
  const std::string name = pattern.AsString();
  circles.asymmetric = name == "asymmetric";
  if (!circles.asymmetric && name != "symmetric") {
    constexpr std::string_view kPatterns[] = {"symmetric", "asymmetric"};
    pattern.Fail(fmt::format(
        "expected symmetric or asymmetric, got '{}'{}", name, SuggestName(name, kPatterns)));
  }
  Target target;
  target.layout = circles;
  target.markers = internal::CirclePositions(circles);
  return target;
}

TargetDoubts CirclesLayout::Doubts(const YamlNode& /*nominal*/) const {
  TargetDoubts doubts{.hypotheses = internal::OtherRows(columns,
                                                        rows,
                                                        "circles",
                                                        [circles = *this](int column, int row) {
                                                          return CircleAt(circles, column, row);
                                                        }),
                      .numbers = {},
                      .quads = {}};
  CirclesLayout other = *this;
  other.asymmetric = !asymmetric;
  const char* pattern = other.asymmetric ? "asymmetric" : "symmetric";
  doubts.hypotheses.push_back({.code = "target_layout",
                               .what = fmt::format("the circles form a grid that is {}", pattern),
                               .remedy = fmt::format("set pattern: {}", pattern),
                               .places = [other] {
                                 CandidatePlaces places;
                                 for (const auto& [number, place] :
                                      internal::CirclePositions(other)) {
                                   places[number] = {place};
                                 }
                                 return places;
                               }});
  return doubts;
}

double CirclesLayout::NearestDistance() const {
  return spacing * (asymmetric ? std::sqrt(2.0) : 1);
}

double CirclesLayout::DrawnRadius() const { return NearestDistance() / 4; }

std::vector<TargetPart> CirclesLayout::Draw(const MarkerPositions& markers,
                                            Pieces /*pieces*/) const {
  TargetPart part;
  const double radius = DrawnRadius();
  for (const auto& [number, position] : markers) {
    part.black_discs.push_back({position.head<2>(), radius, number});
    part.paper.extend(position.head<2>());
  }
  const Eigen::Vector2d margin = Eigen::Vector2d::Constant(4 * radius);
  part.paper = {Eigen::Vector2d(part.paper.min() - margin),
                Eigen::Vector2d(part.paper.max() + margin)};
  part.finest = radius;
  return {part};
}

}  // namespace plenocal
