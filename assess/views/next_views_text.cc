// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <array>
#include <cmath>
#include <numbers>

#include "assess/views/next_views.h"
#include "calib/base/number_text.h"

namespace plenocal {
namespace {

constexpr double kDegreesPerRadian = 180 / std::numbers::pi;

// The side of the target, as the camera sees it, that is farther away.
std::string SideTowards(double direction) {
  constexpr std::array<const char*, 8> kSides{"right side",
                                              "lower right corner",
                                              "lower edge",
                                              "lower left corner",
                                              "left side",
                                              "upper left corner",
                                              "upper edge",
                                              "upper right corner"};
  const auto eighth = std::lround(direction / (std::numbers::pi / 4));
  return kSides[static_cast<size_t>((eighth % 8 + 8) % 8)];
}

std::string Metres(double length) {
  return length < 1 ? fmt::format("{:.0f} cm", 100 * length) : fmt::format("{:.1f} m", length);
}

}  // namespace

std::string RegionName(size_t region) {
  constexpr std::array<const char*, kRegions> kNames{"upper left corner",
                                                     "upper part",
                                                     "upper right corner",
                                                     "left part",
                                                     "middle",
                                                     "right part",
                                                     "lower left corner",
                                                     "lower part",
                                                     "lower right corner"};
  return kNames[region];
}

std::string NextViewText(const NextView& view,
                         const RigEstimate& rig,
                         const LoweredSigma& lowered) {
  const BundleCamera& camera = rig.bundle.cameras[view.pose.camera];
  const bool several = rig.bundle.cameras.size() > 1;
  std::string words = fmt::format("target in the {}{}, {} away",
                                  RegionName(RegionOf(view.pose.place, camera.image_size)),
                                  several ? fmt::format(" of {}", camera.name) : "",
                                  Metres(view.pose.distance));
  words += view.pose.tilt > 0 ? fmt::format(", its {} tilted away by {:.0f} degrees",
                                            SideTowards(view.pose.away),
                                            kDegreesPerRadian * view.pose.tilt)
                              : ", facing the camera";
  if (view.pose.turn != 0) words += ", turned by 90 degrees";
  if (several) {
    std::vector<std::string> names;
    for (const size_t c : view.cameras) names.push_back(rig.bundle.cameras[c].name);
    words += fmt::format(", seen by {}", fmt::join(names, ", "));
  }
  if (view.criterion == ViewCriterion::kEntropy) {
    return words + ": determines what the images so far leave open";
  }
  // Of a camera in whose image the sigma is not judged: as a whole.
  const bool in_region = view.region_before > 0;
  return words + fmt::format(": sigma {}{:.2g} -> {:.2g} {}",
                             in_region ? fmt::format("in the {} ", RegionName(view.region)) : "",
                             in_region ? view.region_before : view.sigma_before,
                             in_region ? view.region_after : view.sigma_after,
                             lowered.unit);
}

std::string ViewBoundText(const NextViews& suggestions) {
  if (!suggestions.bound) return "";
  const ViewBound& bound = *suggestions.bound;
  std::string words;
  if (std::isfinite(bound.sigma)) {
    words = fmt::format("the best {} possible would reach {:.2g} {}",
                        Counted(suggestions.frames, "frame"),
                        bound.sigma,
                        suggestions.lowered.unit);
  }
  if (suggestions.reached) return words;
  words += words.empty() ? "" : "; ";
  if (std::isinf(bound.further)) return words + "no number of these views reaches the goal";
  words += fmt::format("the goal takes at least {:.0f} more", bound.WholeFurther());
  return words +
         (suggestions.suggested ? fmt::format(", {} as suggested", *suggestions.suggested) : "");
}

std::string NextViewsText(const NextViews& suggestions,
                          const RigEstimate& rig,
                          const std::optional<Verdict>& verdict,
                          bool assumed_angle) {
  std::string text =
      std::isfinite(suggestions.sigma)
          ? fmt::format("{0}; sigma of {1} {2:.2g} {4}, goal {3:.2g} {4}\n",
                        Counted(suggestions.frames, "frame"),
                        suggestions.lowered.of,
                        suggestions.sigma,
                        suggestions.goal,
                        suggestions.lowered.unit)
          : fmt::format("{}; they do not determine all parameters yet{}\n",
                        Counted(suggestions.frames, "frame"),
                        assumed_angle
                            ? ""
                            : ", so distances are uncertain as well: --angle DEGREES, the "
                              "lens' horizontal field of view, makes them better");
  if (const std::string bound = ViewBoundText(suggestions); !bound.empty()) text += bound + "\n";
  if (suggestions.reached) text += "the goal is reached; these views would add most:\n";
  if (!suggestions.reached && suggestions.exhausted) {
    text +=
        "more views of this target at these distances add little; allow nearer ones (--near), "
        "or take a larger target:\n";
  }
  for (size_t i = 0; i < suggestions.views.size(); ++i) {
    text += fmt::format(
        "  {}. {}\n", i + 1, NextViewText(suggestions.views[i], rig, suggestions.lowered));
  }
  if (!suggestions.views.empty() && suggestions.views.back().criterion == ViewCriterion::kSigma) {
    text += fmt::format("with all of them: sigma of {} {:.2g} {}\n",
                        suggestions.lowered.of,
                        suggestions.views.back().sigma_after,
                        suggestions.lowered.unit);
  }
  // Standard errors do not include errors of the model.
  if (verdict && verdict->grade == Grade::kBad) {
    const std::vector<Finding>& findings = verdict->findings;
    text += fmt::format("the calibration so far is bad, and more views may not help{}\n",
                        findings.empty() ? "" : ": " + findings.front().what);
  }
  return text;
}

}  // namespace plenocal
