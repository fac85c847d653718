// SPDX-License-Identifier: Apache-2.0
#include "calib/files/exclusion.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <fnmatch.h>

#include <algorithm>
#include <filesystem>
#include <set>
#include <string_view>
#include <utility>

#include "calib/base/error.h"
#include "calib/base/names.h"

namespace plenocal {
namespace {

bool Matches(const std::string& glob, const std::string& name) {
  return glob == name || fnmatch(glob.c_str(), name.c_str(), 0) == 0;
}

// `file`: empty when there is none.
bool Matches(const ExcludeRule& rule,
             const std::string& camera,
             const std::string& frame,
             const std::filesystem::path& file) {
  if (!rule.camera.empty() && rule.camera != camera) return false;
  return rule.frame.empty() || Matches(rule.frame, frame) ||
         (!file.empty() && (Matches(rule.frame, file.filename().string()) ||
                            Matches(rule.frame, file.stem().string())));
}

std::string Reason(const ExcludeRule& rule) {
  return rule.note.empty() ? "excluded by the session" : "excluded by the session: " + rule.note;
}

std::filesystem::path FileOf(const std::string& frame, const std::vector<FrameImage>& images) {
  const auto image = std::ranges::find(images, frame, &FrameImage::frame);
  return image == images.end() ? std::filesystem::path() : image->path;
}

// Removes the rule's markers from a view; returns their numbers.
std::set<int> RemoveMarkers(const ExcludeRule& rule, View* view) {
  std::set<int> removed;
  View rest{.frame = view->frame, .observations = {}};
  for (size_t i = 0; i < view->observations.size(); ++i) {
    const Observation& observation = view->observations[i];
    if (std::ranges::find(rule.markers, observation.marker) != rule.markers.end()) {
      removed.insert(observation.marker);
      continue;
    }
    rest.observations.push_back(observation);
    if (!view->by_nuisance.empty()) rest.by_nuisance.push_back(view->by_nuisance[i]);
  }
  if (!removed.empty()) *view = std::move(rest);
  return removed;
}

}  // namespace

Exclusion::Exclusion(std::vector<ExcludeRule> rules)
    : rules_(std::move(rules)), used_(rules_.size(), false) {}

void Exclusion::RemoveImages(const std::string& camera,
                             std::vector<FrameImage>* images,
                             std::vector<LeftOut>* left_out) {
  for (const FrameImage& image : *images) frames_.insert(image.frame);
  std::erase_if(*images, [&](const FrameImage& image) {
    for (size_t r = 0; r < rules_.size(); ++r) {
      if (!rules_[r].markers.empty()) continue;
      if (!Matches(rules_[r], camera, image.frame, image.path)) continue;
      used_[r] = true;
      left_out->push_back({image.path.string(), Reason(rules_[r]), true, camera, image.frame});
      return true;
    }
    return false;
  });
}

void Exclusion::RemoveViews(const std::string& camera,
                            const std::vector<FrameImage>& images,
                            std::vector<View>* views,
                            std::vector<LeftOut>* left_out) {
  for (const View& view : *views) frames_.insert(view.frame);
  for (size_t r = 0; r < rules_.size(); ++r) {
    const ExcludeRule& rule = rules_[r];
    std::erase_if(*views, [&](View& view) {
      const std::filesystem::path file = FileOf(view.frame, images);
      if (!Matches(rule, camera, view.frame, file)) return false;
      const std::string where =
          file.empty() ? fmt::format("{} frame {}", camera, view.frame) : file.string();
      if (rule.markers.empty()) {
        used_[r] = true;
        left_out->push_back({where, Reason(rule), true, camera, view.frame});
        return true;
      }
      for (const int marker : RemoveMarkers(rule, &view)) {
        used_[r] = true;
        left_out->push_back({fmt::format("{} marker {}", where, marker),
                             Reason(rule),
                             false,
                             camera,
                             view.frame,
                             fmt::format("{}", marker)});
      }
      return view.observations.empty();
    });
  }
}

std::vector<std::string> Exclusion::Unused() const {
  std::vector<std::string> unused;
  for (size_t r = 0; r < rules_.size(); ++r) {
    if (used_[r]) continue;
    const ExcludeRule& rule = rules_[r];
    std::vector<std::string> parts;
    if (!rule.camera.empty()) parts.push_back("camera: " + rule.camera);
    if (!rule.frame.empty()) parts.push_back("frame: " + rule.frame);
    if (!rule.markers.empty()) {
      parts.push_back(fmt::format("markers: [{}]", fmt::join(rule.markers, ", ")));
    }
    const std::vector<std::string_view> known(frames_.begin(), frames_.end());
    unused.push_back(
        fmt::format("exclude[{}] ({}) leaves out nothing: no image or point is called so{}",
                    r,
                    fmt::join(parts, ", "),
                    rule.frame.empty() ? "" : SuggestName(rule.frame, known)));
  }
  return unused;
}

}  // namespace plenocal
