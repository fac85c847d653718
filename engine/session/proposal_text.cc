// SPDX-License-Identifier: Apache-2.0
#include "engine/session/proposal_text.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <map>

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/io/yaml.h"
#include "engine/recording/stores/image_lister.h"

namespace plenocal {
namespace {

const char* Show(size_t images) { return images == 1 ? "shows" : "show"; }

}  // namespace

TargetProposals LookForTargets(const std::vector<FrameImage>& images, const Run& run) {
  return ProposeTargets(images, {.threads = run.threads, .progress = [&](size_t done, size_t all) {
                                   return run.Progress("looking for a target", done, all);
                                 }});
}

std::string OfImages(size_t count, size_t all) {
  if (count == all) return all == 1 ? "the image" : fmt::format("all {} images", all);
  return fmt::format("{} of {} images", count, all);
}

void FailWithProposal(const std::vector<std::string>& cameras,
                      const std::vector<std::vector<std::string>>& images,
                      const Run& run) {
  std::vector<FrameImage> all;
  for (size_t c = 0; c < images.size(); ++c) {
    const std::vector<FrameImage> of_camera = ListImages(images[c], cameras[c]);
    all.insert(all.end(), of_camera.begin(), of_camera.end());
  }
  const TargetProposals proposals = LookForTargets(all, run);
  if (proposals.found.empty()) {
    throw InputError(
        "--target is missing, and {} {} no chessboard, ChArUco board, AprilTag "
        "or grid of circles; state it, such as --target chessboard:9x6:25mm",
        OfImages(proposals.looked_at, proposals.looked_at),
        Show(proposals.looked_at));
  }
  const TargetProposal& best = proposals.found[0];
  const std::string in = OfImages(best.images, proposals.looked_at);
  if (best.measure.empty()) {
    throw InputError(
        "--target is missing: {} in {}, which no target type describes", best.what, in);
  }
  if (best.word.empty()) {
    throw InputError(
        "--target is missing: {} in {}; describe {} in a target file "
        "(docs/formats.md) and give --target FILE",
        best.what,
        in,
        fmt::join(NamesOf(best.measure), " and "));
  }
  throw InputError("--target is missing: {} in {}; state the {}: --target {}",
                   best.what,
                   in,
                   fmt::join(NamesOf(best.measure), " and the "),
                   best.word);
}

std::string MendOf(const TargetProposals& proposals, const Target& target) {
  if (proposals.found.empty()) return {};
  const TargetProposal& best = proposals.found[0];
  if (2 * best.images < proposals.looked_at || best.keys.empty()) return {};
  // Defaults of keys that an AprilGrid's file may leave out.
  static const std::map<std::string, std::string> kDefaults{
      {"family", "tag36h11"}, {"border_bits", "2"}, {"first_id", "0"}};
  const YamlNode keys = YamlNode::Parse(best.keys, "proposal");
  const YamlNode present = YamlNode::Parse(target.nominal_yaml, "target");
  // Codes of the findings about a wrong value.
  static const std::map<std::string, std::string> kCodes{{"columns", "target_layout"},
                                                         {"rows", "target_layout"},
                                                         {"first_id", "target_layout"},
                                                         {"border_bits", "target_border_bits"},
                                                         {"legacy", "target_legacy"}};
  std::vector<std::string> changes;
  std::string code;
  for (const auto& [key, value] : keys.Entries()) {
    const auto default_value = kDefaults.find(key);
    const bool same =
        present.Has(key)
            ? present.At(key).IsScalar() && present.At(key).AsString() == value.AsString()
            : default_value != kDefaults.end() && default_value->second == value.AsString();
    if (same) continue;
    changes.push_back(fmt::format("{}: {}", key, value.AsString()));
    if (code.empty() && kCodes.contains(key)) code = fmt::format(" ({})", kCodes.at(key));
  }
  if (changes.empty()) return {};
  const bool same_type = !changes[0].starts_with("type: ");
  return fmt::format("{} {} {}: set {}{}",
                     OfImages(best.images, proposals.looked_at),
                     Show(proposals.looked_at),
                     same_type ? best.shows : best.what,
                     fmt::join(changes, ", "),
                     same_type ? code : std::string());
}

}  // namespace plenocal
